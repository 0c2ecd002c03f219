"""Local polynomials through evenly spaced samples (Savitzky and Golay 1964)."""

from __future__ import annotations

import math

import numpy as np
import scipy

from jumpvision.base.arrays import Array


def local_polynomial(y: Array, width: int, order: int, *, deriv: int = 0, delta: float = 1.0) -> tuple[Array, float]:
    """(derivative `deriv` of the polynomials of this order through `width` samples about each of y (n,), `delta` apart;
    its standard uncertainty where that of the samples is 1, away from the ends). width: odd, <= n.

    As `scipy.signal.savgol_filter`, whose import takes longer than a whole experiment's fits.
    """
    half = width // 2
    powers = np.arange(half, -half - 1.0, -1.0) ** np.arange(order + 1.0)[:, None]
    of = np.zeros(order + 1)
    of[deriv] = math.factorial(deriv) / delta**deriv
    weights = scipy.linalg.lstsq(powers, of)[0]
    out = scipy.ndimage.convolve1d(y, weights, mode="constant")
    for some, at in ((y[:width], slice(0, half)), (y[-width:], slice(-half, None))):
        p = np.polyder(np.polyfit(np.arange(width), some, order), deriv)
        out[at] = np.polyval(p, np.arange(width)[at]) / delta**deriv
    return out, float(np.linalg.norm(weights))
