"""The added mass that grain films show, beside the one that the jumps imply: two measurements that share nothing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..campaign import Outcome
from ..diagnosis.diagnose import Diagnosis
from ..diagnosis.fitting import Fit
from ..diagnosis.jumper import Jumper, of_jump
from ..field.momentum import ANGLE
from ..physics.cone import cone_mass
from ..physics.model import Model
from ..records import Fits, Flow

STEP = 1e-3  # of a parameter's scale, for derivatives
AXIS = 0.5  # mm, how well the axis of the foot is known


@dataclass(frozen=True)
class Film:
    """The mass that moves with a whole foot at the greatest momentum of the grains [kg], and how deep it is [m].

    sigma: of the fit, and of where the picture's windows end and the axis lies (one vector, AXIS).
    """

    experiment: str
    depth: float
    mass: float
    sigma: float


def films(outcomes: Mapping[str, Outcome]) -> list[Film]:
    """Added masses from the grain films of a campaign; those of experiments that cannot be questioned count too.

    A film shows what is in view: a little less than all that moves.
    """
    out = []
    for name, outcome in outcomes.items():
        if not all((outcome.results / r.file).exists() for r in (Flow, Fits)):
            continue
        fits = Fits.load(outcome.results).values
        seen = fits.get("added_mass_kg", {})
        field = Flow.load(outcome.results).field
        momentum = np.where(np.isfinite(field.added_mass.values), field.momentum.values, np.nan)
        if seen.get("sigma") and np.isfinite(momentum).any():
            depth = float(field.foot_depth.values[np.nanargmax(momentum)])
            moved = [fits["momentum_per_vector_of_window"]["value"], AXIS * fits["momentum_per_mm_of_axis"]["value"]]
            share = math.hypot(seen["sigma"] / seen["value"], *(x for x in moved if x is not None))
            whole = seen["value"] * ANGLE["full"] / ANGLE[field.attrs["disc"]]
            out.append(Film(name, depth, whole, whole * share))
    return out


def confirmation(d: Diagnosis, system: Jumper, seen: Sequence[Film]) -> list[dict[str, Any]]:
    """One row a film: its added mass and that of the extended model there [kg], their difference over its sigma."""
    fit = d.naming.best.fit if d.naming and d.naming.named else d.baseline
    own = {j.name: j.model for j in system.jumps}
    rows = []
    for film in seen:
        mass, sigma = implied(fit, system, own.get(film.experiment, system.model), film.depth)
        rows.append(
            {
                "experiment": film.experiment,
                "depth_m": film.depth,
                "film_kg": film.mass,
                "film_sigma_kg": film.sigma,
                "jumps_kg": mass,
                "jumps_sigma_kg": sigma,
                "z_score": (film.mass - mass) / math.hypot(sigma, film.sigma),
            }
        )
    return rows


def implied(fit: Fit, system: Jumper, own: Model, depth: float) -> tuple[float, float]:
    """(added mass [kg] at a depth [m] as a fitted model has it, its standard uncertainty)."""

    def mass(values: Mapping[str, float]) -> float:
        model = of_jump(system.build(fit.mechanisms, values), own, values)
        if "added_mass" not in model:
            return 0.0
        names = ("C", "mu", "theta", "R", "phi", "rho")
        return float(cone_mass(np, depth, **{n: model.symbol(n) for n in names}))

    at = mass(fit.named)
    steps = [STEP * p.scale for p in fit.parameters]
    moved = [mass({**fit.named, p.name: fit.named[p.name] + h}) for p, h in zip(fit.parameters, steps)]
    slope = (np.array(moved) - at) / np.array(steps)
    return at, float(math.sqrt(max(slope @ fit.covariance @ slope, 0.0))) if slope.size else 0.0
