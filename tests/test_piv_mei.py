"""A star of speckle as the DIC Challenge 2.0 draws it (Reu et al. 2022, doi:10.1007/s11340-021-00806-6): waves of
0.5 px whose period grows along x. The vectors hold them."""

import numpy as np
import pytest
from numpy.typing import NDArray
from test_piv import SETTINGS, camera

from jumpvision.films.vision.piv.engine import piv_pair

Array = NDArray[np.float64]
Star = tuple[NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8], NDArray[np.uint8]]  # star's two, then the still

SHAPE = (128, 2048)
CENTRE = 63  # row where v is greatest
WINDOW, STEP = 40, 4
FIXED = {
    "window": WINDOW,
    "step": STEP,
    "preset": "sharp",
}  # least on stars drawn with seeds 51 to 53, of 24 settings; the
# challenge's star and those of the table had no say
AMPLITUDE, SHORTEST, GROWTH = 0.5, 10.0, 0.07  # px, px, px of period per px
DEGREE, KEPT = 12, 0.9
SPOTS, SPREAD, NOISE = 12_000, 1.2, 2.0  # number, standard deviation [px], grey levels
REACH = 6  # px, half of the box a spot is drawn in: 5 standard deviations


def periods(x: Array) -> Array:
    return SHORTEST + GROWTH * x


def resolution(period: Array, ratio: Array) -> float:
    """First period [px] at which the polynomial through ratio, ordered by period, is KEPT; NaN where it never is."""
    fit = np.polynomial.Polynomial.fit(period, ratio, DEGREE)
    fine = np.linspace(period[0], period[-1], 20_000)
    return float(fine[np.argmax(fit(fine) >= KEPT)]) if (fit(fine) >= KEPT).any() else np.nan


def drawn(seed: int) -> Star:
    """A star of Gaussian spots; each moves as its centre does."""
    rng = np.random.default_rng(seed)
    x, y = rng.uniform(0, SHAPE[1], SPOTS), rng.uniform(0, SHAPE[0], SPOTS)
    grey = rng.uniform(60, 160, SPOTS)
    v = AMPLITUDE * np.cos(2 * np.pi * (y - CENTRE) / periods(x))
    rest, moved = (_speckle(x, y + s, grey) for s in (0.0, v))
    return (camera(rest, 0, rng), camera(moved, 0, rng), *(camera(rest, NOISE, rng) for _ in range(2)))  # type: ignore[return-value]


def _speckle(x: Array, y: Array, grey: Array) -> Array:
    image = np.full([n + 2 * REACH for n in SHAPE], 20.0)
    around = np.arange(-REACH, REACH + 1)
    for cx, cy, g in zip(x, y, grey):
        i, j = round(cx), round(cy)
        if not (0 <= i < SHAPE[1] and 0 <= j < SHAPE[0]):
            continue
        of_x, of_y = (np.exp(-((around + k - c) ** 2) / (2 * SPREAD**2)) for k, c in ((i, cx), (j, cy)))
        image[j : j + 2 * REACH + 1, i : i + 2 * REACH + 1] += g * np.outer(of_y, of_x)
    return image[REACH:-REACH, REACH:-REACH]


def test_drawn_star_moves_as_stated():
    """Where P > 120 px, a Gaussian of 0.45 half windows, 9.2 px, averages (2 pi / 120)^2 9.2^2 / 2 = 12 % of 0.5 px
    away at most, of which the eight steps leave nothing: 7 % is allowed; the matching errs by 0.01 px."""
    ref, moved, still, again = drawn(5)
    f = piv_pair(ref, moved, **SETTINGS | FIXED)
    x, y = np.meshgrid(f.x, f.y)
    v = AMPLITUDE * np.cos(2 * np.pi * (y - CENTRE) / periods(x))
    off = np.abs(f.v - v)[periods(x) > 120]
    assert np.median(off) < 0.07 * AMPLITUDE + 0.01
    difference = still.astype(float) - again
    assert difference.std() == pytest.approx(np.sqrt(2 * (NOISE**2 + 1 / 12)), rel=0.01)
