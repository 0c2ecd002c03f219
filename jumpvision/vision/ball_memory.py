"""What the disc fit of one frame teaches the next: how the lighting drifts, how the rim's shape scatters. Compiled."""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from jumpvision.vision import disc

SECTOR_OFF = 0.5  # a sector of the rim whose contrast is off by more than this part is covered
SURE = 6.0  # standard deviations of a sector's shift from which on it counts as one
RIM_FREEDOM = 12.7  # of the 16 sectors' shifts, what the fit leaves free (white noise, diameters 10-40 px)
# Drift of the lighting gradients a frame, as part of the contrast: first guess (the background changes most, as the
# ball passes over it), least, and how fast it follows what the frames show
DRIFT = np.array([0.01, 0.01, 0.003, 0.003])
LEAST_DRIFT = 2e-4
DRIFT_GAIN = 0.15
LIGHT = slice(disc.BX, disc.GY + 1)
FIRST_LIGHT, LAST_LIGHT, BALL, BACK = disc.BX, disc.GY, disc.A, disc.B


@njit(cache=True, error_model="numpy")
def rim_faults(sectors, shifts, sigmas, rim, factor):  # type: ignore[no-untyped-def]
    """(sectors whose contrast is wrong, largest significant shift of a sector from its usual place `rim` [px])."""
    off, dent = 0, 0.0
    for q in range(len(rim)):
        if not abs(sectors[q] - 1.0) < SECTOR_OFF:
            off += 1
        moved = abs(shifts[q] - rim[q])
        if moved > SURE * sigmas[q] * math.sqrt(factor):
            dent = max(dent, moved)
    return off, dent


@njit(cache=True, error_model="numpy")
def learn(frames, n, p, cov, shifts, sigmas, rim, factor, last, light_var, drift):  # type: ignore[no-untyped-def]
    """Takes a good fit (p, cov, shifts, sigmas) into rim, last, light_var and drift, in place; the new rim factor.

    frames: good ones so far, this included; n: frames that count in the running means.
    """
    moved = 0.0
    for q in range(len(rim)):
        by = shifts[q] - rim[q]
        if math.isfinite(by):
            moved += (by / sigmas[q]) ** 2
            rim[q] += by / n
    if frames > 1:
        moved *= (n - 1) / n / RIM_FREEDOM
        factor += (min(moved, 10.0 * factor) - factor) / n
    contrast = abs(p[BALL] - p[BACK])
    for m in range(FIRST_LIGHT, LAST_LIGHT + 1):
        k, var = m - FIRST_LIGHT, cov[m, m]
        if frames > 1:
            # A fit moves its prior by (prior variance - posterior variance)^(1/2), if the drift allowed for is right
            ratio = (p[m] - last[m]) ** 2 / max(light_var[k] - var, 1e-30)
            drift[k] = max(drift[k] * math.exp(0.5 * DRIFT_GAIN * (min(ratio, 9.0) - 1.0)), LEAST_DRIFT)
        light_var[k] = var + (drift[k] * contrast) ** 2
    last[:] = p
    return factor
