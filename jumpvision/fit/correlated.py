"""How many independent samples a correlated series holds."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
WINDOW = 5.0  # the sum over lags ends where the lag exceeds this many correlation times (Sokal 1997)


def correlation_time(residual: Array) -> float:
    """Integrated autocorrelation time 1 + 2 sum rho_k of an evenly sampled series (n,), in samples, at least 1.

    n / correlation_time is the effective number of samples of a mean or of any fit whose model varies more slowly than
    the noise. The sum ends by Sokal's self-consistent window. Anticorrelated noise counts as white: the safe side.
    """
    n = residual.size
    if n < 8:
        return 1.0
    d = residual - residual.mean()
    spectrum = np.fft.rfft(d, 2 * n)
    acf = np.fft.irfft(spectrum * spectrum.conj())[:n]
    if acf[0] <= 0.0:
        return 1.0
    tau = 2.0 * np.cumsum(acf / acf[0]) - 1.0
    far = np.flatnonzero(np.arange(n) >= WINDOW * tau)
    return max(1.0, float(tau[far[0] if far.size else -1]))
