"""The benchmark's star: its ruler against a response known in closed form, its pictures against the motion drawn."""

import numpy as np
import pytest

from benchmarks import mei
from jumpvision.films.vision.piv.engine import piv_pair


@pytest.mark.parametrize("length", [5.0, 8.0, 15.0])
def test_resolution_of_a_known_response(length):
    """exp(-(L / P)^2) is 0.9 at P = L / sqrt(-ln 0.9) = 3.08 L; a polynomial of degree 12 through a curve that rises
    within a few percent of the range leaves 1 % of the amplitude, which is 1 % / (2 * 0.9 * 0.105) = 5 % of P."""
    period = mei.periods(np.arange(12.0, 2036, 4))
    found = mei.resolution(period, np.exp(-((length / period) ** 2)))
    assert found == pytest.approx(length / np.sqrt(-np.log(0.9)), rel=0.05)


def test_a_response_that_stays_low_has_no_resolution():
    assert np.isnan(mei.resolution(np.linspace(10, 300, 500), np.full(500, 0.5)))


def test_drawn_star_moves_as_stated():
    """Where P > 120 px, a Gaussian of 0.45 half windows, 9.2 px, averages (2 pi / 120)^2 9.2^2 / 2 = 12 % of 0.5 px
    away at most, of which the eight steps leave nothing: 7 % is allowed; the matching errs by 0.01 px."""
    ref, moved, still, again = mei.drawn(5)
    f = piv_pair(ref, moved, **mei.SETTINGS | mei.FIXED)
    x, y = np.meshgrid(f.x, f.y)
    v = mei.AMPLITUDE * np.cos(2 * np.pi * (y - mei.CENTRE) / mei.periods(x))
    off = np.abs(f.v - v)[mei.periods(x) > 120]
    assert np.median(off) < 0.07 * mei.AMPLITUDE + 0.01
    difference = still.astype(float) - again
    assert difference.std() == pytest.approx(np.sqrt(2 * (mei.NOISE**2 + 1 / 12)), rel=0.01)
