"""A ball's track: its centre in every frame of a film, in pixels, with the uncertainty of each position."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jumpvision.films.parameters import SMALLEST_BALL

from .measure import Found
from .unknowns import A, B

POLARITIES = ("bright", "dark")
METHODS = ("disc", "threshold", "template")


@dataclass(frozen=True)
class BallTrack:
    """Ball centre at mid-exposure in each of n frames; column x right, row y down, pixel centres at integers.

    x, y, sigma, diameter, chi2: (n,) [px; chi2 per degree of freedom, NaN where no disc was fitted].
    sigma: standard uncertainty of each coordinate, the larger of the two where they differ (along a streak).
    flag: (n,) of str, "" when good, else the reason; the numbers are NaN then. notes: what a user should know of it.
    grey, contrast: (n,) of the ball, and against what is behind it [grey]; None where no disc was fitted.
    probability: (n,) of the row; None where no path was sought.
    """

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    sigma: NDArray[np.float64]
    diameter: NDArray[np.float64]
    chi2: NDArray[np.float64]
    flag: NDArray[np.str_]
    notes: tuple[str, ...] = ()
    grey: NDArray[np.float64] | None = None
    contrast: NDArray[np.float64] | None = None
    probability: NDArray[np.float64] | None = None


@dataclass(frozen=True)
class BallSettings:
    """How to follow one ball. Raises ValueError for a value out of range, by name.

    diameter: of the ball [px], None: learned from the film. polarity: "bright" or "dark" against the background.
    method: "disc" (least squares, see `disc`), "threshold" (half height and centroid, the published way) or "template"
    (what is at the seed in the first frame, see `template`).
    search: how far from where it is expected a ball is a matter of course [ball diameters].
    seed: position (x, y) in the first frame [px], None: the likeliest ball of the film. streak: fit the motion blur,
    starting from the velocity times exposure_fraction (exposure over frame interval, 0..1).
    """

    diameter: float | None
    polarity: str
    method: str
    search: float
    seed: tuple[float, float] | None
    streak: bool
    exposure_fraction: float

    def __post_init__(self) -> None:
        if self.diameter is not None and not (SMALLEST_BALL <= self.diameter < math.inf):
            raise ValueError(f"diameter = {self.diameter!r}: must be >= {SMALLEST_BALL:g} px, or None to learn it")
        if self.polarity not in POLARITIES:
            raise ValueError(f"polarity = {self.polarity!r}: must be one of {POLARITIES} (ball against the background)")
        if self.method not in METHODS:
            raise ValueError(f"method = {self.method!r}: must be one of {METHODS}")
        if self.method == "template" and self.seed is None:
            raise ValueError('method = "template" follows what is at the seed in the first frame: give seed = (x, y)')
        if not (0.0 < self.search < math.inf):
            raise ValueError(f"search = {self.search!r}: must be above 0 ball diameters (half width of the window)")
        if self.seed is not None and not (len(self.seed) == 2 and all(math.isfinite(v) for v in self.seed)):
            raise ValueError(f"seed = {self.seed!r}: must be the position (x, y) in px, or None to search")
        if not 0.0 <= self.exposure_fraction <= 1.0:
            raise ValueError(f"exposure_fraction = {self.exposure_fraction!r}: must be in [0, 1] (of the interval)")


def as_track(found: Sequence[Found]) -> BallTrack:
    """Return the track that the measurements of all frames make; numbers of flagged ones are dropped."""
    good = [f if not f.flag else Found(f.flag) for f in found]
    numbers = np.array([(f.x, f.y, f.sigma, f.diameter, f.chi2) for f in good], dtype=np.float64).reshape(-1, 5)
    x, y, sigma, size, chi2 = numbers.T.copy()
    flag = np.array([str(f.flag) for f in good], dtype=np.str_)
    if not any(f.p is not None for f in good):
        return BallTrack(x, y, sigma, size, chi2, flag)
    levels = np.array([(f.p[A], f.p[A] - f.p[B]) if f.p is not None else (np.nan, np.nan) for f in good])
    return BallTrack(x, y, sigma, size, chi2, flag, grey=levels[:, 0], contrast=levels[:, 1])
