"""What films and tests measure beside what the jumps alone imply: measurements that share nothing."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from jumpvision.engine.document.measured import compared, confirmations
from jumpvision.engine.document.values import Confirmation, Energies
from jumpvision.engine.fitting import Fit
from jumpvision.engine.order import Findings
from jumpvision.engine.priors import Measured
from jumpvision.experiment.results.fields import Flow
from jumpvision.experiment.results.values import Fits
from jumpvision.experiment.workflow.run import Outcome
from jumpvision.films.grains.momentum import ANGLE, peak_momentum
from jumpvision.jumper.mechanisms.cone import cone_mass
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.energy import energy_ledger
from jumpvision.jumper.physics.model import ROBOT, Model
from jumpvision.jumper.question.jumper import Jumper, of_jump

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
        if not (outcome.made(Flow) and outcome.made(Fits)):
            continue
        fits = Fits.load(outcome.results)
        seen = fits.get("added_mass_kg")
        flow = Flow.load(outcome.results)
        peak = peak_momentum(flow.field.momentum, flow.field.added_mass)
        if seen and seen.sigma > 0.0 and peak is not None:
            depth = float(flow.field.foot_depth.values[peak])
            moved = [fits["momentum_per_vector_of_window"].value, AXIS * fits["momentum_per_mm_of_axis"].value]
            share = math.hypot(seen.sigma / seen.value, *(x for x in moved if math.isfinite(x)))
            whole = seen.value * ANGLE["full"] / ANGLE[flow.geometry.disc]
            out.append(Film(name, depth, whole, whole * share))
    return out


def confirmation(alone: Fit, system: Jumper, seen: Sequence[Film], measured: Sequence[Measured]) -> list[Confirmation]:
    """Every quantity that films or tests measure and the model has: by them, by the jumps alone."""
    model = system.build(alone.mechanisms, alone.named)
    names = {n for t in model.terms for n in model.mechanism(t).names} | set(ROBOT)
    rows = confirmations(alone, measured, {n: (_of(model, n), _unit(n)) for n in sorted(names)})
    own = {j.name: j.model for j in system.jumps}
    for film in seen:
        by = implied(alone, system, own.get(film.experiment, system.model), film.depth)
        if by[0] > 0:
            row = compared("added_mass", f"film {film.experiment}", by, (film.mass, film.sigma), "kg")
            rows.append(replace(row, experiment=film.experiment, depth_m=film.depth))
    return rows


def _of(model: Model, name: str) -> float:
    """A given value of the model or its robot; NaN where it is not given."""
    value = getattr(model if name in ROBOT else model.parameters, name)
    return math.nan if value is None else float(value)


def _unit(name: str) -> str:
    owner = Model if name in ROBOT else ModelParameters
    return str(owner.__dataclass_fields__[name].metadata["unit"] or "1")


def implied(fit: Fit, system: Jumper, own: Model, depth: float) -> tuple[float, float]:
    """(added mass [kg] at a depth [m] as a fitted model has it, its standard uncertainty)."""

    def mass(values: Mapping[str, float]) -> float:
        model = of_jump(system.build(fit.mechanisms, values), own, values)
        if "added_mass" not in model:
            return 0.0
        names = ("C", "mu", "theta", "R", "phi", "rho")
        return float(cone_mass(np, z=depth, **{n: model.symbol(n) for n in names}))

    at = mass(fit.named)
    steps = [STEP * p.scale for p in fit.parameters]
    moved = [mass({**fit.named, p.name: fit.named[p.name] + h}) for p, h in zip(fit.parameters, steps)]
    slope = (np.array(moved) - at) / np.array(steps)
    return at, float(math.sqrt(max(slope @ fit.covariance @ slope, 0.0))) if slope.size else 0.0


def energies(d: Findings, system: Jumper) -> list[Energies]:
    """Energies from rest to the measured apex, of the jump of each kind that the baseline misses most."""
    worst: dict[str, int] = {}
    miss = [float(np.mean(r * r)) for r in d.baseline.residuals]
    for i, o in enumerate(system.observations):
        kind = str(o.labels.get("kind"))
        if kind not in worst or miss[i] > miss[worst[kind]]:
            worst[kind] = i
    fits = {"baseline": d.baseline}
    if d.naming and d.naming.named:
        fits["extended"] = d.naming.best.fit
    found = (_energies(system, i, kind, name, f) for kind, i in sorted(worst.items()) for name, f in fits.items())
    return [e for e in found if e is not None]


def _energies(system: Jumper, i: int, kind: str, name: str, fit: Fit) -> Energies | None:
    jump = system.jumps[i]
    late = np.flatnonzero(jump.t >= jump.stop)
    if not late.size:
        return None
    apex = float(jump.t[late[np.argmax(jump.y[late])]])
    model = system.model_of(jump, fit.mechanisms, fit.named)
    try:
        e = energy_ledger(model, jump.forcing, end=apex)
    except RuntimeError:
        return None
    return Energies(jump.name, kind, name, apex, e.motor + e.impulse, e.potential, e.kinetic, e.spring, e.losses)
