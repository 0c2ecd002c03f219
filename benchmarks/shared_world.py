"""Campaigns whose apparatus errs alike in every jump: scale, clock, gravity and spring wrong within what is stated.

All of it is the laboratory's: the declared values are wrong, the tracks are made with the true ones. Films and tests
of the campaign are drawn about the truth.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.engine.priors import Measured
from jumpvision.laboratory.blind import ROBOTS, Setting, draw

Array = NDArray[np.float64]

SCALE, OFFSET, RATE = 0.01, 1e-3, 1e-3  # stated standard uncertainties of the camera: relative, s, s/s
GRAVITY, STIFFNESS = 0.005, 0.005  # of the robot, relative; that of the stiffness is drawn by the laboratory itself
MU, THETA = (2.2, 0.4), (math.pi / 3, math.radians(5.0))  # mean and sigma of the vocabulary's priors
C, B = (1.5, 3.5), (6.0, 25.0)  # ranges of the cone's scale and of the depth drag, log-uniform
PHYSICAL = {"mu": (0.6, 6.0), "theta": (0.65, 1.4), "C": (0.2, 20.0)}
FILM = {"mu": 0.03, "theta": 0.02, "C": 0.1}  # standard uncertainties of a grain film
TOGETHER = -0.5  # correlation of its mu and theta
INTRUDED, SPRUNG = 0.01, 0.003  # relative, of k1 and k2 from slow intrusions and of the spring test
KINDS = ("cone", "hard", "static", "hard")  # by the campaign's number
SAND = ("viscous_friction", "coulomb_friction", "spring_hardening", "spring_damping", "payload", "foot_mass",
        "reintrusion_overshoot", "compaction")  # fmt: skip
HARD = ("viscous_friction", "coulomb_friction", "spring_hardening", "spring_damping", "payload", "landing_loss")


def shifted(film: Measured, name: str, by: float) -> Measured:
    """The same, one value off by `by`."""
    moved = film.values.copy()
    moved[film.names.index(name)] += by
    return replace(film, values=moved)


@dataclass(frozen=True)
class World:
    """A campaign with its truth. true: of every parameter that may be named or fitted, the robot's own included.

    common: what is wrong in all jumps, in units of its stated sigma. film: what was measured beside the jumps.
    """

    kind: str
    setting: Setting
    true: dict[str, float]
    common: dict[str, float]
    film: Measured


def world(number: int) -> World:
    """Campaign `number`: the same whenever it is asked for."""
    rng = np.random.default_rng([181, number])
    kind = KINDS[number % len(KINDS)]
    ground = "hard" if kind == "hard" else "granular"
    hidden = {
        "cone": ("added_mass", "depth_drag"),
        "hard": (str(rng.choice(HARD)),),
        "static": (str(rng.choice(SAND)),),
    }
    setting = draw(rng, ground=ground, hidden=hidden[kind], strength=float(rng.uniform(0.4, 1.0)))
    if kind == "cone":
        setting = with_cone(setting, rng)
    if kind == "static":
        setting = with_fitted_force(setting)
    setting, common = with_common_errors(setting, rng)
    true = truth(setting)
    return World(kind, setting, true, common, film(kind, true, rng))


def with_parameters(setting: Setting, values: Mapping[str, float], terms: tuple[str, ...] = ()) -> Setting:
    """True parameters set, terms added."""
    p = setting.protocol
    p = replace(p, parameters={**p.parameters, **values}, terms=(*p.terms, *(t for t in terms if t not in p.terms)))
    own = {n: v for n, v in values.items() if n in setting.parameters}
    return replace(setting, protocol=p, parameters=setting.parameters | own)


def with_cone(setting: Setting, rng: np.random.Generator) -> Setting:
    """The cone's angles from their priors, its scale and the depth drag from their ranges."""
    mu, theta = (float(np.clip(rng.normal(*prior), *PHYSICAL[n])) for n, prior in (("mu", MU), ("theta", THETA)))
    scale, b = (float(np.exp(rng.uniform(*np.log(limits)))) for limits in (C, B))
    return with_parameters(setting, {"mu": mu, "theta": theta, "C": scale, "b": b})


def with_fitted_force(setting: Setting) -> Setting:
    """A campaign that states no k1: both stiffnesses are fitted."""
    p = setting.protocol
    model = dict(p.model)
    model["fit"] = {**model.get("fit", {}), "k1": [1000.0, 5000.0], "k2": [500.0, 6000.0]}
    model["sigma"] = {n: s for n, s in model.get("sigma", {}).items() if n not in ("k1", "k2")}
    return replace(setting, protocol=replace(p, model=model))


def with_common_errors(setting: Setting, rng: np.random.Generator) -> tuple[Setting, dict[str, float]]:
    """The apparatus wrong within its stated sigmas, and by how many of them."""
    names = ("scale", "offset", "rate", "gravity")
    common = dict(zip(names, rng.standard_normal(len(names)).tolist()))
    gravity = GRAVITY * setting.protocol.robot.gravity
    setting = with_parameters(setting, {"dg": gravity * common["gravity"]}, ("tilt",))
    p = setting.protocol
    track = replace(
        setting.nuisance, scale_error=SCALE * common["scale"], clock_offset=OFFSET * common["offset"],
        clock_drift=RATE * common["rate"],
    )  # fmt: skip
    sigma = {**p.robot_sigma, "gravity": gravity}
    p = replace(p, records=replace(p.records, rod_track=track), robot_sigma=sigma)
    common["spring"] = p.parameters["dk"] / sigma["spring_stiffness"]
    return replace(setting, protocol=p), common


def truth(setting: Setting) -> dict[str, float]:
    """Every true parameter; the robot's own stiffness and gravity and the camera's errors by the analysis' names."""
    p = setting.protocol
    track = setting.nuisance
    apparatus = {
        "spring_stiffness": p.robot.spring_stiffness + p.parameters["dk"],
        "gravity": p.robot.gravity + p.parameters["dg"],
        "scale[0]": 1.0 + track.scale_error,
        "offset[0]": track.clock_offset,
        "rate[0]": track.clock_drift,
    }
    return {**p.parameters, **apparatus}


def film(kind: str, true: Mapping[str, float], rng: np.random.Generator) -> Measured:
    """What was measured beside the jumps: the cone by a grain film, k1 and k2 by intrusions, the spring by a test."""
    if kind == "cone":
        sigma, source = FILM, "grain film"
    elif kind == "static":
        sigma, source = {n: INTRUDED * true[n] for n in ("k1", "k2")}, "slow intrusions"
    else:
        sigma, source = {"spring_stiffness": SPRUNG * ROBOTS["hard"].spring_stiffness}, "spring test"
    size = np.array(list(sigma.values()))
    correlation = np.eye(size.size)
    if kind == "cone":
        correlation[0, 1] = correlation[1, 0] = TOGETHER
    covariance = correlation * np.multiply.outer(size, size)
    at = np.array([true[n] for n in sigma])
    return Measured(tuple(sigma), rng.multivariate_normal(at, covariance), covariance, source)


def physical(name: str, value: float) -> bool:
    """Whether a value is one that a film could report."""
    low, high = PHYSICAL.get(name, (0.0, math.inf))
    return low < value < high


def stated() -> dict[str, Any]:
    """What the campaign says of the camera that all its jumps share."""
    return {"apparatus": "camera", "scale": SCALE, "offset": OFFSET, "rate": RATE}
