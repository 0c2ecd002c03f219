"""Faults of the laboratory's drive: what the carriage does where a law asks for something else, in equal steps."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numba as nb
import numpy as np

from jumpvision.base.arrays import Array

DRIVE: dict[str, tuple[str, ...]] = {
    "loop_bandwidth": ("t_n", "zeta"),
    "speed_limit": ("top_speed",),
    "stroke_limit": ("reach",),
    "drive_play": ("play", "flank"),
}
RATE = 50_000.0  # 1/s
AFTER = 0.3  # s behind the law, in which what lags arrives


@nb.njit(cache=True)
def _loop(x: Array, t_n: float, zeta: float) -> Array:
    """A driven oscillator by semi-implicit steps, some twenty and more to its time constant."""
    parts = max(math.ceil(20.0 / (t_n * RATE)), 4)
    h = 1.0 / (RATE * parts)
    out, place, rate = np.empty_like(x), x[0], 0.0
    for i in range(x.size):
        before = x[max(i - 1, 0)]
        for k in range(parts):
            goal = before + (x[i] - before) * (k + 0.5) / parts
            rate += h * ((goal - place) / t_n - 2.0 * zeta * rate) / t_n
            place += h * rate
        out[i] = place
    return out


@nb.njit(cache=True)
def _slow(x: Array, top: float) -> Array:
    out, most = x.copy(), top / RATE
    for i in range(1, x.size):
        out[i] = out[i - 1] + max(-most, min(most, x[i] - out[i - 1]))
    return out


@nb.njit(cache=True)
def _loose(x: Array, ahead: float, behind: float) -> Array:
    """A slider that a fork with a gap pushes: its prongs stand `ahead` below and `behind` above it at the start."""
    out = x.copy()
    for i in range(1, x.size):
        out[i] = out[i - 1]
        if x[i] - ahead > out[i]:
            out[i] = x[i] - ahead
        if x[i] + behind < out[i]:
            out[i] = x[i] + behind
    return out


def performed(x: Array, p: Mapping[str, float]) -> Array:
    """X_m [m] at steps of 1/RATE from a law's values x, with the faults whose parameters are given."""
    if "t_n" in p:
        x = _loop(x, p["t_n"], p["zeta"])
    if "top_speed" in p:
        x = _slow(x, p["top_speed"])
    if "reach" in p:
        x = np.clip(x, x[0] - p["reach"], x[0] + p["reach"])
    if "play" in p:
        x = _loose(x, 0.5 * p["play"] * (1.0 - p["flank"]), 0.5 * p["play"] * (1.0 + p["flank"]))
    return x
