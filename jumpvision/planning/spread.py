"""How far the apex of a plan may lie off, because robot and model are known only within their uncertainties."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.physics.forcing import Spline
from jumpvision.physics.model import Model

from .plan import Planner


def drawn(model: Model, sigma: Mapping[str, float], rng: np.random.Generator) -> Model:
    """The model with the values of `sigma` (name -> standard uncertainty) drawn from normal distributions.

    Names are those of `Model` (the robot's) or of its parameters. A draw that cannot be (a negative mass) is repeated.
    """
    own = {n for n in sigma if n in Model.__dataclass_fields__}
    for _ in range(1000):
        near = {n: float(rng.normal(getattr(model if n in own else model.parameters, n), s)) for n, s in sigma.items()}
        robot: dict[str, Any] = {n: v for n, v in near.items() if n in own}
        try:
            parameters = dataclasses.replace(model.parameters, **{n: v for n, v in near.items() if n not in own})
            return dataclasses.replace(model, parameters=parameters, **robot)
        except InputError:
            continue
    raise InputError([f"sigma of {', '.join(sigma)}: hardly any draw is a possible model; give smaller uncertainties"])


def apexes(
    planner: Planner, command: Spline, sigma: Mapping[str, float], *, draws: int, rng: np.random.Generator
) -> Array:
    """Apexes [m], (draws,), of one command on models drawn from the uncertainties."""
    return np.array([planner.resimulate(command, drawn(planner.model, sigma, rng))[1] for _ in range(draws)])
