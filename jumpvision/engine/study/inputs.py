"""Inputs of recordings as numbers that may be entered wrong in one of them: a unit, a power of ten, a gain."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from .study import Recording

INPUT = "input "  # before an input's name: the factor on it, beside the simulator's own parameters
Values = Mapping[str, float]


def factors_of(recordings: Sequence[Recording]) -> tuple[str, ...]:
    """Factors on the inputs that are measured numbers in every recording, not alike in all: a constant of the method,
    such as a step of time, is none of them."""
    names = [n for n in recordings[0].inputs if all(_is_measured(r.inputs.get(n)) for r in recordings)]
    return tuple(INPUT + n for n in names if len({np.asarray(r.inputs[n]).tobytes() for r in recordings}) > 1)


def _is_measured(value: object) -> bool:
    return isinstance(value, float | np.floating) or (isinstance(value, np.ndarray) and value.dtype.kind == "f")


def applied(parameters: Values, recording: Recording) -> tuple[dict[str, float], Recording]:
    """The simulator's own parameters, and the recording with the factors on its inputs among them."""
    off = {n.removeprefix(INPUT): x for n, x in parameters.items() if n.startswith(INPUT)}
    if not off:
        return dict(parameters), recording
    own = {n: x for n, x in parameters.items() if not n.startswith(INPUT)}
    inputs = {n: off[n] * value if n in off else value for n, value in recording.inputs.items()}  # type: ignore[operator]
    return own, replace(recording, inputs=inputs)
