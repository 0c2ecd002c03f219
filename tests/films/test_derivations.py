"""The cases done by hand at the end of docs/piv_sigma.md and docs/disc_image.md. About 10 s."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.polynomial.legendre import leggauss
from scipy.interpolate import CubicSpline
from scipy.stats import ncx2

from jumpvision.films.vision.ball.disc import RIM_FREEDOM, fit_disc
from jumpvision.films.vision.piv import engine
from jumpvision.films.vision.piv.frame import prepare
from jumpvision.films.vision.piv.refine import Grid, refine
from jumpvision.films.vision.piv.validate import factors

# ---- a PIV vector: waves of one length along both axes ---------------------------------------------------------------
WINDOW, STEP, TIMES = 24, 8, 3
AMPLITUDE, WAVE, NOISE = 20.0, 2 * np.pi / 12, 4.0  # grey, rad/px, grey
BLUR = 0.8  # px, of the prefilter
SHIFT = np.array([0.3, -0.2])[:, None, None]  # px
SIDE = 112  # px
REACH = np.arange(-(WINDOW // 2), WINDOW // 2 + 1)
WEIGHT = np.exp(-0.5 * (REACH / (0.45 * (WINDOW // 2 + 0.5))) ** 2)
BOX = np.arange(-2, 3)  # px


def wave_pair(rng):
    """Two pictures (SIDE, SIDE) [grey] of cos kx + cos ky, moved by SHIFT, each with white noise of its own."""
    y, x = np.mgrid[:SIDE, :SIDE]
    for side in (-0.5, 0.5):
        dx, dy = side * SHIFT
        grey = 100 + AMPLITUDE * (np.cos(WAVE * (x - dx)) + np.cos(WAVE * (y - dy)))
        yield grey + rng.normal(0, NOISE, grey.shape)


def single_step_sigma():
    """Equation (5) [px]: 2 noise / (A k sqrt(N))."""
    return 2 * NOISE / (AMPLITUDE * WAVE * WEIGHT.sum() ** 2 / (WEIGHT**2).sum())


def responses():
    """w of a window and R of TIMES steps on the waves of 128 x 128 px."""
    k = 2 * np.pi * np.fft.fftfreq(128)
    window = (WEIGHT * np.cos(np.outer(k, REACH))).sum(1) / WEIGHT.sum()
    surface = np.where(np.abs(k * STEP) < np.pi, 1 / (1 + (2 - 2 * np.cos(k * STEP)) ** 2), 0)
    w, s = np.outer(window, window), np.outer(surface, surface)
    missed = s * (1 - w)
    return w, w * sum(missed**n for n in range(TIMES))


def repetition_gain():
    """Equation (6): what the surface between the vectors and the steps make of the variance of one."""
    w, seen = responses()
    return np.mean(seen**2) / np.mean(w**2)


def taken_as_the_code_has_it():
    """x with R for K."""
    box = np.cos(np.outer(2 * np.pi * np.fft.fftfreq(128), BOX)).sum(1)
    seen = responses()[1]
    return np.mean(np.outer(box, box) * (2 * seen - seen**2))


def clumping():
    """c_e of |grad m|^2 = 2 G (1 - (cos 2kx + cos 2ky) / 2)."""
    return 1 + np.cos(2 * WAVE * BOX).mean() / 4


def box_share():
    """B of equation (7): what of the correlation of grad m r lies within 2 px."""
    lag = np.arange(-12, 13)
    correlation = np.exp(-(lag**2) / (4 * BLUR**2))
    along = correlation * np.cos(WAVE * lag)
    inner = np.abs(lag) <= 2
    return correlation[inner].sum() / correlation.sum() * along[inner].sum() / along.sum()


def taken_by_one_unknown():
    """x of equation (8): of the sum over the box, what a fitted shift takes out, interpolated between the vectors."""
    vectors = np.arange(40, 200, STEP)
    average = np.zeros((len(vectors), 240))
    for row, v in zip(average, vectors):
        row[v + REACH] = WEIGHT / WEIGHT.sum()
    at = CubicSpline(vectors, np.eye(len(vectors)))(np.arange(240)) @ average
    both = at @ at.T
    places = np.arange(100, 140)
    alone = np.mean([at[q + BOX, q].sum() for q in places])
    twice = np.mean([both[q + BOX, q].sum() for q in places])
    return 2 * alone**2 - twice**2


def unknowns_taken():
    """Equation (9): d_x, d_y, offset and gain in units of x, for this texture."""
    b1, b2 = (np.cos(q * WAVE * BOX).mean() for q in (1, 2))
    return np.array([1 + b2 / 2, b1**2, np.exp((BLUR * WAVE) ** 2) * b1, b2 / 4 + b1**2 / 2])


def test_the_single_step_covariance_is_that_of_the_derivation():
    """40 pairs from the true shift. Left out of x: noise is correlated over 1.1 px, (1.1 / 5.6)^2 = 4 % of it, and the
    weight falls within the box by 3 % in the mean; 7 % of 0.47 beside 0.53 are 3 % of sigma. Chance and B: 1 % each."""
    rng = np.random.default_rng(1)
    places = engine.vector_places(SIDE, WINDOW, STEP)
    inner = np.s_[:, 2:-2, 2:-2]
    start = np.broadcast_to(SHIFT, (2, len(places), len(places))).copy()
    steps, variances = [], []
    for _ in range(40):
        frames = tuple(prepare(p, None, WINDOW // 2 + engine.MARGIN, True) for p in wave_pair(rng))
        grid = Grid(places, places, STEP, WINDOW, engine.STIFFNESS)
        m = refine([frames], grid, start, 2.0, np.ones(start.shape[1:], bool), True, None)
        steps.append((m.p[:2] - SHIFT)[inner])
        variances.append(m.sigma[:2][inner] ** 2)
    assert single_step_sigma() == pytest.approx(0.0403, rel=0.003)
    # 98 vectors of which one in (12.9 / 8)^2 is independent (4 pi 5.6^2 px^2 each): 1500 errors, 1.8 %; three of those
    assert np.sqrt(np.mean(np.square(steps))) == pytest.approx(single_step_sigma(), rel=0.055)
    left = 1 - unknowns_taken().sum() * taken_by_one_unknown()
    expected = single_step_sigma() * np.sqrt(box_share() * left)
    assert np.sqrt(np.mean(variances)) == pytest.approx(expected, rel=0.05)


def test_the_scatter_of_vectors_and_their_stated_sigma_are_those_of_the_derivation(monkeypatch):
    rng = np.random.default_rng(2)
    asked, inner = [], np.s_[:, 2:-2, 2:-2]

    def factor(*arguments):
        asked.append(noise_factor(*arguments))
        return asked[-1]

    noise_factor = engine.noise_factor
    monkeypatch.setattr(engine, "noise_factor", factor)
    monkeypatch.setattr(
        engine, "periods_of", lambda *_: np.zeros((0, 2))
    )  # of the shifts a wave allows, this one is known
    errors, variances = [], []
    for _ in range(200):
        f = engine.piv_pair(*wave_pair(rng), window=WINDOW, step=STEP, passes=(32,), min_correlation=0.3,
                            min_texture=2.0, outlier=2.0, smooth="none")  # fmt: skip
        errors.append((f.matched[:2] - SHIFT)[inner])
        variances.append(f.matched[2:][inner] ** 2)
    expected = single_step_sigma() * np.sqrt(repetition_gain())
    # 98 vectors of which one in (17.5 / 8)^2 is independent: 4100 errors, 1.1 %; three of those, 1 % of stencil
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(expected, rel=0.043)
    left = 1 - unknowns_taken().sum() * taken_by_one_unknown()
    given_back = 1 + clumping() * taken_as_the_code_has_it()
    of_one_step = factors(WINDOW, STEP, engine.STIFFNESS, TIMES, clumping())[0]
    assert of_one_step == pytest.approx(np.sqrt(repetition_gain() * given_back), rel=1e-6)
    factor_of_field = np.sqrt(np.mean(np.square(asked))) / (1 + 0.08 * (given_back - 1))
    stated = expected * np.sqrt(box_share() * left * given_back) * factor_of_field
    # as for the single step, and what a finer window adds by chance, 2.5 % of the variance
    assert np.sqrt(np.mean(variances)) == pytest.approx(stated, rel=0.05)


# ---- the centre of a disc --------------------------------------------------------------------------------------------
RADIUS, RIM, CONTRAST, GREY = 10.0, 0.8, 100.0, 4.0  # px, px, grey, grey
CENTRE = np.array([20.3, 19.8])  # px


def drawn_disc():
    """(41, 41) [grey]: a disc behind a Gaussian lens, exactly, as the mean over each pixel of 4 x 4 Gauss points."""
    lens = np.sqrt(RIM**2 - 1 / 12)
    places, weights = (q / 2 for q in leggauss(4))
    y, x = np.mgrid[:41, :41]
    part = np.zeros((41, 41))
    for a, of_a in zip(places, weights):
        for b, of_b in zip(places, weights):
            square = (x + a - CENTRE[0]) ** 2 + (y + b - CENTRE[1]) ** 2
            part += of_a * of_b * ncx2.cdf((RADIUS / lens) ** 2, 2, square / lens**2)
    return 50 + CONTRAST * part


def known_light():
    """Equation (8) [px]: noise / contrast sqrt(2 s / (sqrt(pi) R))."""
    return GREY / CONTRAST * np.sqrt(2 * RIM / (np.sqrt(np.pi) * RADIUS))


def free_light():
    """Equation (9) [px]: the same with the gradients of the light on both sides of the rim unknown."""
    g = RIM / np.sqrt(np.pi)
    inside = RADIUS / 4 * (1 - (1 - min(0.4, 12 / RADIUS)) ** 4) - g
    outside = RADIUS / 4 * ((1 + max(4.0, 5 * RIM) / RADIUS) ** 4 - 1) - g
    c = 0.5 * (1 + 2 * g / RADIUS * np.array([-1, 1]))
    lost = 2 * np.sqrt(np.pi) * RIM * c @ np.linalg.solve([[inside, g], [g, outside]], c)
    return known_light() / np.sqrt(1 - lost)


@pytest.mark.parametrize(("prior", "formula"), [(1e-6, known_light), (np.inf, free_light)])
def test_the_sigma_of_a_disc_s_centre_is_that_of_the_derivation(prior, formula):
    image, rng = drawn_disc(), np.random.default_rng(3)
    start = np.array([*CENTRE, RADIUS, RIM, 50, 50 + CONTRAST, 0, 0, 0, 0, 0, 0])
    var = np.full(12, np.inf)
    var[6:10] = prior
    errors, variances, chi2, rim = [], [], [], []
    for _ in range(1000):
        fit = fit_disc(image + rng.normal(0, GREY, image.shape), start, streak=False,
                       noise=np.array([GREY**2, GREY**2, 0.0]), mean=np.zeros(12), var=var)  # fmt: skip
        assert fit.converged
        errors.append(fit.p[:2] - CENTRE)
        variances.append(np.diag(fit.cov)[:2])
        chi2.append(fit.chi2)
        rim.append(np.sum((fit.shifts / fit.shift_sigmas) ** 2))
    # left out: (s / R)^2 = 0.6 % and what a pixel's side makes of the sum over the rim, exp(-pi^2 s^2) = 0.2 %
    assert np.sqrt(np.mean(variances)) == pytest.approx(formula(), rel=0.01)
    # 2000 errors: 1.6 %, three of those
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(formula(), rel=0.048)
    # some 600 pixels: sqrt(2 / 600 / 1000) = 0.002 of chance; five of those
    assert np.mean(chi2) == pytest.approx(1, abs=0.01)
    # 16 sectors less x, y and R: of sqrt(2 * 13 / 1000) three
    assert np.mean(rim) == pytest.approx(13, abs=0.49)
    assert pytest.approx(np.mean(rim), abs=0.49) == RIM_FREEDOM
