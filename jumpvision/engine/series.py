"""Recordings in the order in which they were made; a motion at other times than it was read."""

from __future__ import annotations

from collections.abc import Mapping
from datetime import UTC, datetime

import numpy as np

from jumpvision.base.arrays import Array

BEYOND = 3.0  # samples past the ends of a record up to which its motion is continued


def seconds(at: datetime) -> float:
    """Since 1970 [s]; a time without an offset from UTC is taken as one at UTC: only differences count."""
    return (at if at.tzinfo else at.replace(tzinfo=UTC)).timestamp()


def places(times: Mapping[str, float]) -> dict[str, float]:
    """1, 2, ... in the order of time; one place for equal times."""
    at = {t: float(k) for k, t in enumerate(sorted(set(times.values())), 1)}
    return {name: at[t] for name, t in times.items()}


def at_times(t: Array, y: Array, at: Array) -> Array:
    """y (n,), read at t (n,), n >= 4, at other times: a cubic spline, continued for BEYOND samples past the ends."""
    from scipy.interpolate import CubicSpline

    past = BEYOND * float(np.median(np.diff(t)))
    return np.asarray(CubicSpline(t, y)(np.clip(at, t[0] - past, t[-1] + past)))
