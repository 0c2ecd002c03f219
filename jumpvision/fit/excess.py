"""Lines through points that scatter more than their stated errors: there each counts alike, lest a few small sigmas
decide."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from jumpvision.fit.line import Line, fit_line

Array = NDArray[np.float64]

LEVEL = 0.999  # of chi2's distribution: beyond it the stated sigmas do not describe the scatter


def line_or_alike(x: Array, y: Array, sigma: Array) -> Line:
    """`fit_line`; (n,) each. Where chi2 is beyond LEVEL, all points have one sigma, their scatter about it."""
    line = fit_line(x, y, sigma)
    if line.n < 3 or line.chi2 <= chdtri(line.n - 2, 1.0 - LEVEL):
        return line
    equal = fit_line(x, np.where(line.used, y, math.nan), np.ones(x.size))
    return fit_line(x, np.where(line.used, y, math.nan), np.full(x.size, math.sqrt(equal.chi2 / (line.n - 2))))
