"""The derivatives that a user's function brings itself: `Study(jacobian=)`, `simulate.jacobian`, or those of JAX.

Each is a function of what `simulate` is called with, and gives a dict: the outputs' derivative by each parameter,
shaped as the outputs. What it does not name is had by differences.
"""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from typing import Any

from jumpvision.base.arrays import Array

from .study import Recording, Study


def derivatives(study: Study, parameters: Mapping[str, float], recording: Recording) -> dict[str, Array]:
    """d(outputs) / d(parameter) (n, channels) by parameter, as far as the study or its function knows them. Raises
    InputError where a shape is another."""
    function = study.jacobian or getattr(study.simulate, "jacobian", None) or _of_jax(study.simulate)
    if function is None:
        return {}
    given = function(*study.arguments(parameters, recording))
    return {n: recording.of_channels(y, study.channels, f"jacobian of {n!r}") for n, y in given.items()}


def _of_jax(simulate: Callable[..., Any]) -> Callable[..., Any] | None:
    """The forward-mode derivative of a function that gives JAX's arrays; None where JAX is not loaded."""
    if (jax := sys.modules.get("jax")) is None:
        return None

    def jacobian(parameters: dict[str, float], recording: Recording) -> Mapping[str, Any]:
        value = simulate(parameters, recording)
        channels = value if isinstance(value, Mapping) else {}
        if not all(isinstance(y, jax.Array) for y in (channels.values() if channels else [value])):
            return {}
        try:
            found = jax.jacfwd(lambda p: simulate(p, recording))(parameters)
        except (jax.errors.JAXTypeError, TypeError):  # it leaves JAX on the way
            return {}
        return {n: {c: found[c][n] for c in channels} for n in parameters} if channels else found

    return jacobian
