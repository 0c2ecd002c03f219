"""The sums of the disc fit against plain numpy; how a fit is reached does not show in its result. About 4 s."""

from __future__ import annotations

import numpy as np
import pytest
from test_ball import BACK, CONTRAST, ball_image

from jumpvision.films.vision.ball import disc
from jumpvision.films.vision.ball.film import track_film
from jumpvision.films.vision.ball.normal_equations import BLOCK, RES, ROOM, Zone, _bell, accumulate, pixels_in_use
from jumpvision.films.vision.ball.track import BallSettings

NOISE = np.array([4.0, 4.0, 0.0])


def test_pixels_in_use_are_those_of_the_zone_and_find_room():
    """Run as plain Python, which raises where the compiled loop would write beyond its array."""
    rng = np.random.default_rng(1)
    image = rng.normal(size=(47, 52))
    image[20, 25] = np.nan
    rows, columns = np.indices(image.shape)
    for k in range(60):
        w = rng.normal(0.0, 6.0, 2) * (k % 2)
        zone = Zone(rng.uniform(-5, 57), rng.uniform(-5, 52), rng.uniform(1.5, 20), *w, 0.0, rng.uniform(0.1, 4))
        zone = zone._replace(inside=rng.uniform(0.1, 1.0) * zone.radius)
        ends = np.linspace(-0.5, 0.5, 2001)
        reach = np.hypot(columns[..., None] - zone.x - ends * w[0], rows[..., None] - zone.y - ends * w[1])
        nearest, farthest = reach.min(-1), reach.max(-1)
        r_in, r_out = zone.radius - zone.inside, zone.radius + zone.outside
        sure = np.isfinite(image) & (nearest < r_out - 1e-3) & (farthest > r_in + 1e-3)
        maybe = np.isfinite(image) & (nearest < r_out + 1e-3) & (farthest > r_in - 1e-3)
        for every in (1, 3):
            x, y, value = pixels_in_use.py_func(image, zone, every)
            at = (y.astype(int), x.astype(int))
            taken = np.zeros(image.shape, dtype=bool)
            taken[at] = True
            first = max(0, int(np.floor(zone.y - abs(w[1]) / 2 - r_out)))
            line = (rows >= first) & ((rows - first) % every == 0)
            assert np.array_equal(value, image[at]) and taken.sum() == len(x)
            assert not (sure & line & ~taken).any() and not (taken & ~(maybe & line)).any()


def test_bell_is_the_exponential():
    z = np.linspace(-4.6, 4.6, 1001)
    assert [_bell.py_func(v) for v in z] == pytest.approx(np.exp(-(z**2) / 2), rel=4e-6)


@pytest.mark.parametrize("n_par", [10, 12])
def test_normal_equations_are_the_slopes_of_the_model(n_par):
    """h and g against differences of the model itself: the residual's change with each parameter, at no noise."""
    p = np.array([30.3, 29.6, 15.2, 0.8, 30.0, 180.0, 0.5, -0.75, 1.0, 0.25, 3.0, 1.5])
    pixels = pixels_in_use(np.zeros((60, 61)), Zone(30.3, 29.6, 15.2, 3.0, 1.5, 6.0, 4.0), 1)
    assert pixels.shape[1] > 2 * BLOCK  # more than one block, the last one not full
    h, g, work = np.zeros((12, 14)), np.zeros(12), np.empty(ROOM)
    unused = np.zeros((3, 6)), np.zeros((4, 16))

    def model(q):
        """The residuals of pixels of value 0 and variance 1, from where a block leaves them, less their sign."""
        parts = []
        for first in range(0, pixels.shape[1], BLOCK):
            some = pixels[:, first : first + BLOCK]
            accumulate(some, q, n_par, np.array([1.0, 1.0, 0.0]), 1e30, False, work, h, g, *unused)
            parts.append(-work[RES : RES + some.shape[1]].copy())
        return np.concatenate(parts)

    steps = 1e-4 * np.eye(12)[:n_par]
    slopes = np.array([(model(p + step) - model(p - step)) / 2e-4 for step in steps])
    residual = -model(p)
    accumulate(pixels, p, n_par, np.array([1.0, 1.0, 0.0]), 1e30, False, work, h, g, *unused)
    size = np.sqrt((slopes**2).sum(1))
    # Left out of the slopes: that the lighting moves with the ball (|b'| sqrt(pixels)/R over the slope along x:
    # 0.4 %) and the slope of the square pixel's term (3/(2880 s^4): 0.3 %)
    assert h[:n_par, :n_par] / np.outer(size, size) == pytest.approx(slopes @ slopes.T / np.outer(size, size), abs=0.01)
    # both are left out once in g, against residuals as large as the picture itself
    assert g[:n_par] / size == pytest.approx(slopes @ residual / size, abs=0.01 * np.sqrt((residual**2).sum()))


def test_the_way_to_a_fit_does_not_show_in_it():
    """A large ball from 3 px off, by every fourth row at first, and from its own answer: a fit ends within 0.1 sigma
    of rest and the next step is some tenth of the last, so two of them differ by 0.1 sigma at most."""
    rng = np.random.default_rng(2)
    part = ball_image((100, 100), 49.7, 50.2, 66.0, ss=8)[0]
    image = BACK + CONTRAST * part + rng.normal(0.0, 2.0, part.shape)
    start = np.array([52.0, 47.5, 31.5, 1.2, BACK, BACK + CONTRAST, 0, 0, 0, 0, 0, 0])
    prior = {"noise": NOISE, "mean": start, "var": np.full(12, np.inf)}
    far = disc.fit_disc(image, start, streak=False, **prior)
    near = disc.fit_disc(image, far.p, streak=False, **prior)
    sigma = np.sqrt(np.diag(far.cov)[:3])
    assert far.converged and near.converged
    assert np.all(np.abs(far.p[:3] - near.p[:3]) < 0.1 * sigma)
    assert np.all(np.abs(far.p[:2] - (49.7, 50.2)) < 4.0 * sigma[:2])
    assert far.cov[:3, :3] == pytest.approx(near.cov[:3, :3], rel=0.01)


def test_the_noise_of_a_fit_is_that_of_its_pixels():
    """A fit takes its parameters out of what is left: the variance per freedom is that of the noise. Well inside a ball
    of 12 px lie some 20 pixels, whose level and gradient take up to three freedoms (the edge tells of them too): the
    mean of 1,000 frames is the noise or up to a fifth above it, to four times sqrt(2 / 20,000); it would be a tenth
    below it if no freedom were taken."""
    rng, found = np.random.default_rng(4), []
    for _ in range(1000):
        x, y = 14.0 + rng.uniform(-0.5, 0.5, 2)
        image = BACK + CONTRAST * ball_image((29, 30), x, y, 12.0, ss=4)[0]
        image += rng.normal(0.0, 2.0, image.shape)
        start = np.array([x, y, 6.0, 0.75, BACK, BACK + CONTRAST, 0, 0, 0, 0, 0, 0])
        fit = disc.fit_disc(image, start, streak=False, noise=NOISE, mean=start, var=np.full(12, np.inf))
        found.append(fit.noise[:2] / 4.0)
    assert np.all(np.mean(found, axis=0) > 1.0 - 0.04) and np.all(np.mean(found, axis=0) < 1.2 + 0.04)


class Once:
    """Frames that may be read once each."""

    def __init__(self, frames):
        self.frames, self.read = frames, []

    def __len__(self):
        return len(self.frames)

    def __getitem__(self, i):
        self.read.append(i)
        return self.frames[i]


def test_the_pass_without_the_scene_reads_no_frame_again():
    rng = np.random.default_rng(3)
    ys = 30.0 + 2.0 * np.arange(40)
    frames = [BACK + CONTRAST * ball_image((140, 60), 30.2, y, 16.0, ss=4)[0] for y in ys]
    film = Once([np.rint(f + rng.normal(0, 2, f.shape)).astype(np.uint8) for f in frames])
    settings = BallSettings(
        diameter=16.0, polarity="bright", method="disc", search=1.5, seed=None, streak=False, exposure_fraction=0.0
    )
    track = track_film(film, settings, scene=True)[0]
    assert film.read == list(range(40))
    # noise 2 of 150 grey, 16 px: sigma 0.005 px; five of them
    assert np.abs(track.y - ys).max() < 0.025 and not any(track.flag)
