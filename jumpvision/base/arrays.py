"""Array types, constants of a normal distribution, and numbers with the digits that their uncertainty is worth."""

from __future__ import annotations

from math import isfinite

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

MAD = 0.6745  # median absolute deviation of a normal distribution over its standard deviation
FROM_MAD = 1.4826  # the other way round


Z90, Z95 = 1.645, 1.960  # half widths of 90 % and 95 % intervals of a normal error, in sigmas


def measured(value: float | None, sigma: float | None, factor: float = 1.0) -> str:
    """`12.34 ± 0.05`: two significant figures of the uncertainty; "" when unknown."""
    if value is None:
        return ""
    if not sigma or not isfinite(sigma):
        return plain_number(value, factor)
    return f"{with_digits_of(value, sigma, factor)} ± {with_digits_of(sigma, sigma, factor)}"


def plain_number(value: float | None, factor: float = 1.0) -> str:
    """Four significant figures, a whole number as it is; "" when unknown."""
    if value is None:
        return ""
    scaled = value * factor
    if scaled and isfinite(scaled) and not 1e-3 <= abs(scaled) < 1e5:
        return f"{scaled:.3e}"
    return f"{scaled:#.4g}".rstrip(".") if abs(scaled) < 1e4 else f"{scaled:.0f}"


def with_digits_of(value: float, sigma: float | None, factor: float = 1.0) -> str:
    """A value to the second figure of an uncertainty, to stand beside what has it."""
    if not sigma or not isfinite(sigma):
        return plain_number(value, factor)
    power = int(f"{sigma * factor:.1e}".partition("e")[2])  # of the rounded sigma: 0.0998 is 0.10
    return f"{round(value * factor, 1 - power) + 0.0:.{max(0, 1 - power)}f}"
