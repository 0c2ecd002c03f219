"""What a simulator is given: by name, of the parameters first, then of the recording's inputs."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError, closest
from jumpvision.engine.study.study import Recording


def value_of(name: str, parameters: Mapping[str, float], recording: Recording) -> float:
    """A number. Raises InputError where there is none of this name, or a series."""
    value = _found(name, parameters, recording)
    if np.ndim(value):
        raise InputError([f"recording {recording.name!r}: inputs[{name!r}] must be one number, not {np.shape(value)}"])
    return float(value)


def track_of(name: str, parameters: Mapping[str, float], recording: Recording) -> tuple[Array, Array]:
    """A number over time as times (n,) [s] and values (n,): constant, one at every recording.t, or (times, values).
    Raises InputError."""
    value, t = _found(name, parameters, recording), recording.t
    if np.ndim(value) == 0:
        return t[[0, -1]], np.full(2, float(value))
    times, values = value if isinstance(value, tuple) and len(value) == 2 else (t, value)
    times, values = np.asarray(times, float), np.asarray(values, float)
    if times.shape != values.shape or times.ndim != 1 or not np.all(np.diff(times) > 0):
        raise InputError(
            [
                f"recording {recording.name!r}: inputs[{name!r}] {np.shape(value)} must be a number, one at each of "
                f"the {t.size} times, or (times, values) with times that increase"
            ]
        )
    return times, values


def series_of(name: str, parameters: Mapping[str, float], recording: Recording) -> Callable[[float], float]:
    """The same at any time [s]: straight between the times, kept before the first and after the last."""
    times, values = track_of(name, parameters, recording)
    return lambda t: float(np.interp(t, times, values))


def _found(name: str, parameters: Mapping[str, float], recording: Recording) -> Any:
    if name in parameters:
        return parameters[name]
    if name in recording.inputs:
        return recording.inputs[name]
    known = [*parameters, *recording.inputs]
    raise InputError(
        [
            f"recording {recording.name!r}: {name!r} is neither a parameter of the study nor one of the recording's "
            f"inputs{closest(name, known)}"
        ]
    )
