"""What the analyses of jumps on sand share: batches, single motions, the constant drag fitted to single jumps."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array
from jumpvision.base.progress import watch
from jumpvision.base.schema import InputError
from jumpvision.jumper.mechanisms.registry import MECHANISMS, ModelParameters
from jumpvision.jumper.physics.batch import law_rows, looped, model_at, resolve
from jumpvision.jumper.physics.forcing import Loop, Segments
from jumpvision.jumper.physics.hard.analysis import SINGLE, STUTTER
from jumpvision.jumper.physics.model import FORCE_MODELS, Model, fitted_drag, force_model
from jumpvision.jumper.physics.sand.jump import Motion, simulate
from jumpvision.thesis.studies.axes import Laws
from jumpvision.thesis.studies.compute import ATOL, RTOL, grid_results
from jumpvision.thesis.studies.study import Sweep

HOP_DELAY = 0.75  # s, of the thesis' delayed stutter jump


TYPES: dict[str, tuple[float, float]] = {  # phase [rad], delay [s]
    "single": (SINGLE, 0.0),
    "stutter": (STUTTER, 0.0),
    "delayed stutter": (STUTTER, HOP_DELAY),
}


FREQUENCIES = np.linspace(3.0, 12.0, 37)  # Hz


EXAMPLE_RANGE = (0.57, 0.63)


DRAGS = np.r_[0.0, np.geomspace(5.0, 1000.0, 18)]  # kg/m, tried for alpha


def batch(s: Sweep, given: Mapping[str, ArrayLike], model: Model | None = None, laws: Laws | None = None) -> Any:
    """Results of jumps over the grid of `given`, with another model or other laws in place of its own."""
    setup = dataclasses.replace(s.setup, model=model or s.setup.model, laws=laws or s.setup.laws)
    arrays = {n: np.asarray(a, float) for n, a in given.items()}
    return grid_results(setup, arrays, workers=s.workers, say=s.say)


def heights(
    s: Sweep, kind: str, given: Mapping[str, ArrayLike], model: Model | None = None, laws: Laws | None = None
) -> Array:
    """Jump heights [m] of a type over the grid of `given`."""
    phase, delay = TYPES[kind]
    return np.asarray(batch(s, {"phase": phase, "delay": delay, **given}, model, laws)["jump_height_m"])


def motion(s: Sweep, model: Model, given: Mapping[str, float], samples: int) -> tuple[Motion, Segments, Model]:
    """One jump sampled evenly from its start to 0.5 s after its stop, with its law and model, driven as in a batch."""
    v = resolve(s.setup.values, given)
    if s.setup.laws:
        v |= s.setup.laws.points(v["phi"], model.foot_radius or np.nan, s.setup.phi_sigma)
    here = model_at(model, v)
    law = Segments(law_rows({n: np.atleast_1d(x) for n, x in v.items()})[0])
    t = np.linspace(law.start, law.stop + 0.5, samples)
    loop = looped(v)
    gains = {n: float(x) for n, x in loop.items()} if loop else {}
    driver = Loop(law, dwell_gain=float(v["dwell_gain"]), **gains) if loop else law
    return simulate(here, driver, t=t, rtol=RTOL, atol=ATOL), law, here


def packings(s: Sweep, count: int) -> Array:
    """Volume fractions over the range that all laws know; of the example where they are all constants."""
    laws = s.setup.laws.laws.values() if s.setup.laws else ()
    low, high = max((x.phi[0] for x in laws), default=0.0), min((x.phi[-1] for x in laws), default=1.0)
    return np.linspace(*((low, high) if high - low < 1.0 else EXAMPLE_RANGE), count)


def need_cone(s: Sweep) -> None:
    """InputError unless the model is the cone of eq. (34), against which the older force models are compared."""
    model = s.setup.model
    lacking = [t for t in FORCE_MODELS["cone"] if t not in model]
    if lacking:
        raise InputError(
            [
                f"model terms = {list(model.terms)}: this analysis compares the older force models with the "
                f"cone of eq. (34); add {', '.join(lacking)} with b, C, mu, theta"
            ]
        )


def baseline(s: Sweep) -> str:
    """The last of the older force models whose parameters are known: with the overshoot where s and lam are."""
    laws, p = s.setup.laws, s.setup.model.parameters
    known = [getattr(p, n) is not None or (laws is not None and n in laws.laws) for n in ("s", "lam")]
    return "drag and overshoot" if all(known) else "constant drag"


def placeholder(model: Model, name: str) -> Model:
    """The force model with a stand-in for what its laws give: a Model wants a number for each of its parameters."""
    wanted = {n for t in FORCE_MODELS[name] for n in MECHANISMS[t].names}
    fields = ModelParameters.__dataclass_fields__
    missing = {n: 1.0 for n in fields if n in wanted and getattr(model.parameters, n) is None}
    if "alpha" in missing and "added_mass" in FORCE_MODELS[name]:
        missing["alpha"] = DRAGS[-1]  # one that creates no energy
    return force_model(model, name, **missing)


def drag_heights(s: Sweep, frequency: Array, phi: Array) -> Array:
    """Heights [m] of single jumps with every constant drag of DRAGS, (na, n_phi, n_f)."""
    model, out = placeholder(s.setup.model, "constant drag"), np.empty((DRAGS.size, phi.size, frequency.size))
    for i, alpha in enumerate(watch(DRAGS, "drags")):
        out[i] = heights(s, "single", {"phi": phi, "frequency": frequency}, model, with_alpha(s, phi, alpha))
    return out


def with_alpha(s: Sweep, phi: Array, alpha: ArrayLike) -> Laws:
    """The laws of the setup with alpha (n,) at phi (n,), for the robot's own foot."""
    laws = s.setup.laws or Laws({})
    value = np.broadcast_to(np.asarray(alpha, float), phi.shape)
    if laws.foot_radius and s.setup.model.foot_radius:
        value = value * (laws.foot_radius / s.setup.model.foot_radius) ** 2
    if phi.size == 1:  # holds everywhere
        phi, value = np.array([0.0, 1.0]), np.repeat(value, 2)
    return laws.with_law("alpha", phi, value)


def drag_of_singles(s: Sweep, frequency: Array, phi: Array) -> tuple[Array, Array, Array, Array]:
    """The thesis' fit of alpha at every phi, with the single jumps of the cone as the measured ones.

    Returns alpha [kg/m] (n_phi,), the rms of its heights [m] (n_phi,), the cone's heights (n_phi, n_f) and those with
    every drag of DRAGS (na, n_phi, n_f).
    """
    cone = heights(s, "single", {"phi": phi, "frequency": frequency})
    tried = drag_heights(s, frequency, phi)
    fits = [fitted_drag(DRAGS, tried[:, i], cone[i]) for i in range(phi.size)]
    alpha, rms = (np.array(v) for v in zip(*fits))
    return alpha, rms, cone, tried
