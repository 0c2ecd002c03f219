"""What a drive makes of the motion that is asked of it: play, ends of travel and speed, its loop."""

from __future__ import annotations

import math
from collections.abc import Hashable

import numpy as np

from jumpvision.jumper.mechanisms.record import Body, Mechanism
from jumpvision.jumper.mechanisms.registry import acting

from .forcing import Forcing, Loop, Spline
from .model import Model

RESOLVED = 0.15  # rad of a sine in a cubic: off by 1.3e-6 of its amplitude


ORDER = acting(Body.DRIVE)


def drive_of(model: Model) -> tuple[Hashable, ...]:
    """The faults of a model's drive with their values, in the order in which they act; () without one."""
    return tuple((m.name, *(model.symbol(n) for n in m.names)) for m in ordered(model))


def ordered(model: Model) -> list[Mechanism]:
    """Its mechanisms on the drive: the loop first, the play behind it last."""
    return sorted(model.acting(Body.DRIVE), key=ORDER.index)


def played(model: Model, forcing: Forcing | Loop) -> Forcing | Loop:
    """The motion of the carriage on the rod where the drive is asked for another; the same without a fault.

    Raises ValueError for a feedback loop, which has limits of its own.
    """
    faults = ordered(model)
    if not faults:
        return forcing
    if isinstance(forcing, Loop):
        raise ValueError(f"model terms: '{faults[0].name}' acts on a motion; remove it, or [motor]'s loop")
    motion = cubics(forcing)
    knots, c = motion.knots, motion.c
    for m in faults:
        assert m.operator is not None
        knots, c = m.operator(knots, np.ascontiguousarray(c), *(float(model.symbol(n)) for n in m.names))
    return Spline(knots, np.ascontiguousarray(c), motion.sigma)


def cubics(forcing: Forcing) -> Spline:
    """A motion as cubics: a spline itself, sines by their values and rates at points RESOLVED apart."""
    if isinstance(forcing, Spline):
        return forcing
    knots, columns = [np.array([forcing.start])], []
    for t0, t1, c, size, omega, phase in forcing.rows:
        if t1 <= t0:
            continue
        u = np.linspace(0.0, t1 - t0, max(math.ceil(abs(omega) * (t1 - t0) / RESOLVED), 1) + 1)
        x, v = c + size * np.sin(omega * u + phase), size * omega * np.cos(omega * u + phase)
        h, slope = np.diff(u), np.diff(x) / np.diff(u)
        third, second = (v[:-1] + v[1:] - 2.0 * slope) / h**2, (3.0 * slope - 2.0 * v[:-1] - v[1:]) / h
        knots.append(t0 + u[1:])
        columns.append(np.array([third, second, v[:-1], x[:-1]]))
    return Spline(np.concatenate(knots), np.concatenate(columns, axis=1))
