"""What a simulator is given: by name, of the parameters first, then of the recording's inputs."""

from __future__ import annotations

from collections.abc import Mapping
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
    """Return a number over time as times (n,) [s] and values (n,): constant, one at every recording.t, or
    (times, values); two rows of one time are a jump. Raises InputError."""
    value, t = _found(name, parameters, recording), recording.t
    if np.ndim(value) == 0:
        return t[[0, -1]], np.full(2, float(value))
    times, values = value if isinstance(value, tuple) and len(value) == 2 else (t, value)
    times, values = np.asarray(times, float), np.asarray(values, float)
    if times.shape != values.shape or times.ndim != 1 or not np.all(np.diff(times) >= 0):
        raise InputError(
            [
                f"recording {recording.name!r}: inputs[{name!r}] {np.shape(value)} must be a number, one at each of "
                f"the {t.size} times, or (times, values) with times that do not go back"
            ]
        )
    return times, values


def step_means(times: Array, values: Array, ends: Array) -> Array:
    """Return the means of a series between successive `ends` (n + 1,) [s]: straight between its rows, kept outside."""
    times = np.concatenate([[min(times[0], ends[0]) - 1.0], times, [max(times[-1], ends[-1]) + 1.0]])
    values = values[[0, *range(values.size), -1]]
    whole = np.concatenate([[0.0], np.cumsum(np.diff(times) * 0.5 * (values[1:] + values[:-1]))])
    k = np.searchsorted(times, ends, side="right") - 1
    since = ends - times[k]
    slope = (values[k + 1] - values[k]) / (times[k + 1] - times[k])
    return np.diff(whole[k] + since * (values[k] + 0.5 * slope * since)) / np.diff(ends)


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
