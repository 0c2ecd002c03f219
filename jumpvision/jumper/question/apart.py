"""Jumps that differ in a number of the robot, the ground or the drive: which numbers, and a jump with its own."""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import fields, replace

import numpy as np

from jumpvision.engine.vary.variables import Changes, Variable
from jumpvision.jumper.mechanisms.registry import PARAMETERS
from jumpvision.jumper.physics.forcing import Forcing, Loop, Segments, Spline
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import Tracks, laid

from .jumps import Jump

BED = "bed"  # stiffness of the sand, by one factor
AMPLITUDE, FREQUENCY = "amplitude", "frequency"  # of the drive
DRIVE = (AMPLITUDE, FREQUENCY)
MACHINE = ("spring_stiffness", "spring_damping", "motor_mass", "foot_mass", "gravity")
BUILT = ("motor_mass", "foot_mass", "gravity")
STIFF = tuple(p.name for p in PARAMETERS.values() if p.stiffness)
SPREAD, STEP, LEAST = 0.1, 1e-3, -0.9995  # shares of a value: plausible difference, step of derivatives, greatest loss


def variables_of(jumps: Sequence[Jump]) -> dict[str, Variable]:
    """Numbers that jumps may differ in, as shares of what is declared."""
    first = next((j.model for j in jumps if j.model.ground == "granular"), jumps[0].model)
    out = {n: _share(n, getattr(first, n), _unit(first, n), n in BUILT) for n in MACHINE if getattr(first, n)}
    if any(getattr(first.parameters, n, None) for n in STIFF if _used(first, n)):
        out[BED] = _share(BED, 1.0, "1")
    for n in dict.fromkeys(n for t in first.terms for n in first.mechanism(t).names):
        value = getattr(first.parameters, n, None)
        if value and n not in STIFF and n not in out:
            out[n] = _share(n, float(value), PARAMETERS[n].unit if n in PARAMETERS else "1", rare=True)
    if not any(isinstance(j.forcing, Loop) for j in jumps):
        out |= {n: replace(_share(n, 1.0, "1"), drive=True) for n in DRIVE}
    return out


def _used(model: Model, name: str) -> bool:
    return any(name in model.mechanism(t).names for t in model.terms)


def _share(name: str, value: float, unit: str, rare: bool = False) -> Variable:
    return Variable(name, float(value), unit, SPREAD, STEP, least=LEAST, rare=rare)


def _unit(model: Model, name: str) -> str:
    return str({f.name: f for f in fields(model)}[name].metadata["unit"]) or "1"


def changed(model: Model, changes: Changes, i: int) -> Model:
    """The model of jump i with its own changes; it was checked before, so it is not again."""
    mine = {n: float(c[i]) for n, c in changes.items() if n not in DRIVE and c[i] != 0.0}
    robot = {n: getattr(model, n) * (1.0 + x) for n, x in mine.items() if n in MACHINE}
    held = model.parameters
    inner = {n: getattr(held, n) * (1.0 + x) for n, x in mine.items() if getattr(held, n, None) is not None}
    if BED in mine:
        inner |= {n: v * (1.0 + mine[BED]) for n in STIFF if (v := getattr(held, n, None)) is not None}
    if not robot and not inner:
        return model
    out = copy.copy(model)
    for n, v in robot.items():
        object.__setattr__(out, n, v)
    if inner:
        object.__setattr__(out, "parameters", replace(held, **inner))
    return out


def driven(tracks: Tracks, jumps: Sequence[Jump], changes: Changes, which: Sequence[int]) -> Tracks:
    """The tracks with the drives of those jumps `which` whose own differ; the same where none does."""
    none = np.zeros(len(jumps))
    larger, faster = (1.0 + changes.get(n, none) for n in DRIVE)
    own = [i for i in which if larger[i] != 1.0 or faster[i] != 1.0]
    if not own:
        return tracks
    each, stops = list(tracks.laid), [j.stop for j in jumps]
    for i in own:
        drive = _drive(jumps[i].forcing, float(larger[i]), float(faster[i]))
        stops[i] = drive.start + (stops[i] - drive.start) / float(faster[i])
        each[i] = laid(drive, stops[i])
    return Tracks(each, stops, [tracks.t[p] for p in tracks.places])


def _drive(forcing: Forcing | Loop, larger: float, faster: float) -> Forcing | Loop:
    """A drive whose motion is larger, and runs faster from its start, by these factors."""
    if isinstance(forcing, Segments):
        rows, start = forcing.rows.copy(), forcing.start
        rows[:, :2] = start + (rows[:, :2] - start) / faster
        rows[:, 2:4] *= larger
        rows[:, 4] *= faster
        return Segments(rows)
    if isinstance(forcing, Spline):
        start = forcing.start
        powers = faster ** np.arange(3, -1, -1)
        return Spline(start + (forcing.knots - start) / faster, larger * forcing.c * powers[:, None], forcing.sigma)
    assert math.isclose(larger, 1.0) and math.isclose(faster, 1.0)
    return forcing
