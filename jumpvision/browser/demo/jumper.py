"""The page's questions answered by the package's own solvers: one jump with its motion, or a map of heights.

A question is JSON: `ground`, `set` (the sections robot, actuation, bed, model of an experiment.toml, SI units),
`frequency2` [Hz] of the second half cycle where it has its own, and `hand` (t [s], x [m], step [m]) where the motor
was moved by hand: X_m(t) as recorded, each x right to about a step.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from threading import Lock
from typing import Any

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.mechanisms.cone import cone_mass, flat_radius
from jumpvision.physics.batch import (
    VALUES_OF_ROBOT,
    hard_points,
    jump_results,
    law_rows,
    resolve,
    simulated_points,
    until_landed,
)
from jumpvision.physics.energy import powers
from jumpvision.physics.forcing import Forcing, Segments, from_log
from jumpvision.physics.hard.jump import HardMotion, hard_jump
from jumpvision.physics.oscillator import damping_of, gravity_of, natural_frequency
from jumpvision.physics.sand.jump import Motion, simulate
from jumpvision.studies.compute import ATOL, RTOL
from jumpvision.studies.machine import Machine, machine

from .controls import GROUNDS

FEWEST, MOST = 600, 2000  # samples of the motion that is drawn
SPACING = 2e-3  # s, of the samples where their number is between those
LEAD, AFTER = 0.08, 0.3  # s, drawn before the motor starts and after the landing (or the motor's stop)
LONGEST = 20.0  # s, of a law
MOST_POINTS = 100_000  # of a map
HOLD = 0.04  # s, for which the hand holds still before and after its motion
PARALLEL = Lock()  # one parallel sweep at a time: not every threading layer of numba allows two

RANGES = {"t": (0.0, 60.0), "x": (-0.5, 0.5)}


def jump(question: Mapping[str, Any]) -> dict[str, Any]:
    """The motion for drawing in m, N, W, s, rounded to 1e-6, and the numbers. InputError for bad input."""
    m = _machine(question)
    law = _law(m, question)
    numbers, end = _exact(m, law) if m.exact else _integrated(m, law)
    first, last = law.start - LEAD, max(end, law.stop) + AFTER
    t = np.linspace(first, last, int(np.clip((last - first) / SPACING, FEWEST, MOST)))
    motion: HardMotion | Motion
    if m.exact:
        motion = hard_jump(**_robot(m), forcing=law, t=t, t_end=float(t[-1]))
        foot, rest = np.maximum(motion.rod, 0.0), float(motion.rod[0])
    else:
        motion = simulate(m.model, law, t=t, rtol=RTOL, atol=ATOL)
        foot, rest = motion.foot, motion.rest
    power = powers(motion, law, motor_mass=m.model.m_m, rod_mass=m.model.rod_mass, gravity=m.model.g)
    columns = {
        "t": t,
        "rod": motion.rod - rest,
        "motor": motion.motor - rest,
        "foot": foot,
        "stretch": motion.rod - foot,
        "drive": motion.motor - motion.rod,
        "spring": motion.spring_force,
        "ground": motion.ground_force,
        "power": power["internal_power"],
    }
    columns |= _hole(m, foot)
    v = m.values
    mass = v["motor_mass"] + v["rod_mass"]
    f0 = float(natural_frequency(v["stiffness"], mass))
    numbers |= {
        "f0_Hz": f0,
        "alpha": v["gravity"] / gravity_of(1.0, v["stiffness"], mass, v["amplitude"]),
        "zeta": v["damping"] / float(damping_of(1.0, v["stiffness"], mass)),
        "f_over_f0": v["frequency"] / f0,
        "stop_s": law.stop - law.start,
    }
    if m.model.ground == "granular":
        numbers["depth_m"] = float(-np.min(foot))
        if "added_mass" in m.model:
            numbers["added_mass_kg"] = float(
                cone_mass(np, numbers["depth_m"], **_cone(m, "C", "mu", "theta"), **_bed(m))
            )
    return {
        "exact": m.exact,
        "motion": {n: np.round(c, 6).tolist() for n, c in columns.items()},
        "numbers": {n: x if math.isfinite(x) else None for n, x in numbers.items()},
    }


def height_map(question: Mapping[str, Any]) -> dict[str, Any]:
    """jump_height_m over `frequencies` (nf,) [Hz] and `phases` (np,) [rad]: (nf, np), null where unknown."""
    m = _machine(question)
    f, phase = (_list(question, n, lo, hi) for n, lo, hi in (("frequencies", 0.01, 1000.0), ("phases", -10.0, 10.0)))
    if f.size * phase.size > MOST_POINTS:
        raise InputError([f"frequencies, phases: {f.size * phase.size} points; at most {MOST_POINTS}: use fewer"])
    given = {"frequency": f[:, None], "phase": phase[None, :]}
    if question.get("frequency2") is not None:
        given["frequency2"] = np.asarray(m.values["frequency2"])
    try:
        v = resolve(m.values, given)
        v = {n: np.broadcast_to(x, (f.size, phase.size)).ravel() for n, x in v.items()}
        with PARALLEL:
            found = hard_points(v) if m.exact else simulated_points(m.model, v, rtol=RTOL, atol=ATOL)
    except InputError:
        raise
    except ValueError as e:
        raise InputError([str(e)]) from None
    height = np.round(found["jump_height_m"], 6).reshape(f.size, phase.size)
    return {"height_m": [[h if math.isfinite(h) else None for h in row] for row in height.tolist()]}


def _machine(question: Mapping[str, Any]) -> Machine:
    """The thesis' robot with the question's values. InputError as for a file."""
    ground, tables = question.get("ground"), question.get("set", {})
    if ground not in GROUNDS:
        raise InputError([f"ground = {ground!r}: must be one of {', '.join(GROUNDS)}"])
    if not isinstance(tables, Mapping) or not all(isinstance(t, Mapping) for t in tables.values()):
        raise InputError(["set: must be the sections robot, actuation, bed, model, each a table"])
    try:
        m = machine(ground, None, tables)
    except InputError as e:
        raise InputError([p.replace("--set/experiment.toml: ", "").replace("--set ", "") for p in e.problems]) from None
    second = question.get("frequency2")
    if second is None:
        return m
    if isinstance(second, bool) or not isinstance(second, (int, float)) or not 0.0 < second <= 1000.0:
        raise InputError([f"frequency2 = {second!r}: must be in (0, 1000] Hz (frequency of the second half cycle)"])
    return dataclasses.replace(m, values={**m.values, "frequency2": float(second)})


def _law(m: Machine, question: Mapping[str, Any]) -> Forcing:
    """The commanded law, or the motion of the hand."""
    hand = question.get("hand")
    if hand is not None:
        return _by_hand(hand)
    try:
        law = Segments(law_rows({n: np.asarray(x, float) for n, x in m.values.items()}))
    except InputError:
        raise
    except ValueError as e:
        raise InputError([str(e)]) from None
    if law.stop > LONGEST:
        raise InputError([f"frequency, cycles, delay: the motor would run for {law.stop:.4g} s; at most {LONGEST:g} s"])
    return law


def _by_hand(hand: Any) -> Forcing:
    """X_m(t) as a smooth spline within the hand's resolution, from rest to rest."""
    if not isinstance(hand, Mapping):
        raise InputError(["hand: must be a table of t [s], x [m] and step [m]"])
    t, x = (_list(hand, n, *RANGES[n], where="hand ") for n in ("t", "x"))
    step = hand.get("step")
    if t.size != x.size or t.size < 2 or not (np.diff(t) > 0.0).all():
        raise InputError(["hand t, x: must be as long as each other, at least 2, with t increasing"])
    if isinstance(step, bool) or not isinstance(step, (int, float)) or not 1e-6 <= step <= 0.01:
        raise InputError([f"hand step = {step!r}: must be in [1e-06, 0.01] m (resolution of x)"])
    still = np.linspace(0.0, HOLD, 6)
    time = np.concatenate([t[0] - HOLD + still[:-1], t, t[-1] + still[1:]])
    return from_log(time, np.concatenate([np.full(5, x[0]), x, np.full(5, x[-1])]), step / math.sqrt(12.0))


def _exact(m: Machine, law: Forcing) -> tuple[dict[str, float], float]:
    """The numbers of a hard-ground jump and the time [s] of its landing."""

    def follow(end: float) -> tuple[HardMotion, Array]:
        motion = hard_jump(**_robot(m), forcing=law, t=None, t_end=end)
        return motion, np.column_stack([motion.lift_off, motion.landing])

    j = until_landed(follow, law.stop)
    numbers = {
        "com_height_m": j.com_height,
        "jump_height_m": j.jump_height,
        "flight_height_m": j.flight_height,
        "n_jumps": float(j.n_jumps),
        "lift_off_s": float(j.lift_off[0]) - law.start if j.lift_off.size else math.nan,
        "peak_power_W": j.peak_power_W,
        "peak_force_N": j.peak_force_N,
        "peak_motor_speed": j.peak_motor_speed,
    }
    return numbers, _landing(j.landing, law)


def _integrated(m: Machine, law: Forcing) -> tuple[dict[str, float], float]:
    try:
        numbers, motion = jump_results(m.model, law, rtol=RTOL, atol=ATOL)
    except (RuntimeError, ValueError) as e:
        raise InputError([str(e).split("\n")[0]]) from None
    return numbers, _landing(motion.flights[:, 1], law)


def _landing(landings: Array, law: Forcing) -> float:
    """When the first flight that outlasts the motor ends [s]; the motor's stop where none does."""
    late = landings[landings > law.stop]
    return float(late[0]) if late.size else law.stop


def _robot(m: Machine) -> dict[str, float]:
    return {n: m.values[n] for n in VALUES_OF_ROBOT}


def _cone(m: Machine, *names: str) -> dict[str, float]:
    return {n: m.model.symbol(n) for n in names}


def _bed(m: Machine) -> dict[str, float]:
    return _cone(m, "R", "phi", "rho")


def _hole(m: Machine, foot: Array) -> dict[str, Array]:
    """Depth of the hole so far and, with a cone, radius and height of its truncated top below the foot [m]."""
    if m.model.ground == "hard":
        return {}
    depth = np.maximum.accumulate(-foot)
    if "added_mass" not in m.model:
        return {"hole": depth}
    R, theta = m.model.symbol("R"), m.model.symbol("theta")
    flat = flat_radius(np, depth, **_cone(m, "mu", "theta", "R"))
    return {"hole": depth, "cone_radius": flat, "cone_height": (R - flat) * math.tan(theta)}


def _list(table: Mapping[str, Any], name: str, lo: float, hi: float, where: str = "") -> Array:
    """A JSON list of numbers as an array."""
    value = table.get(name)
    try:
        a = np.asarray(value, float)
    except (TypeError, ValueError):
        a = np.empty(0)
    if a.ndim != 1 or not 1 <= a.size <= 10_000 or not ((a >= lo) & (a <= hi)).all():
        raise InputError([f"{where}{name}: must be a list of 1 to 10000 numbers in [{lo:g}, {hi:g}]"])
    return a


def warm_up() -> None:
    """Compile what a question needs, so that the first answer is as quick as the next."""
    for ground in GROUNDS:
        jump({"ground": ground})
        jump({"ground": ground, "hand": {"t": [0.0, 0.1, 0.2], "x": [0.0, 0.004, 0.0], "step": 1e-4}})
        height_map({"ground": ground, "frequencies": [8.0], "phases": [1.0, 2.0]})
