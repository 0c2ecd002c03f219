"""Motion of discs under a foot on a prescribed path: velocity Verlet over a neighbour list."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array
from jumpvision.base.progress import watch

from .contacts import DAMPING, STIFFNESS, march, neighbours, step
from .discs import Block, Box, Discs, Law, Plate
from .packing import pack

SKIN = 0.3  # of the mean diameter: neighbours are listed so much farther than they touch
STEPS_PER_CONTACT = 30.0  # time step = the shortest contact time over this: energy of an elastic contact within 0.1 %


@dataclass(frozen=True)
class Motion:
    """State at the times t (T,) [s], the first at the start: x, y [m], vx, vy [m/s] of shape (T, n), x right, y up.

    foot_y [m], foot_v [m/s] (T,): height and velocity up of the foot's face (NaN without a foot). foot_force,
    wall_force (T, 2) [N]: mean force of foot and walls on the discs since the time before, x and y; friction_power (T,)
    [W]: mean power of friction in all contacts, negative where it takes energy; NaN at the start. spin (T, n) [rad/s].
    """

    t: Array
    x: Array
    y: Array
    vx: Array
    vy: Array
    foot_y: Array
    foot_v: Array
    foot_force: Array
    wall_force: Array
    friction_power: Array
    spin: Array

    def last(self, discs: Discs) -> Discs:
        """The discs as they are at the end; the stretch of their tangential springs is not kept."""
        return replace(discs, x=self.x[-1], y=self.y[-1], vx=self.vx[-1], vy=self.vy[-1], spin=self.spin[-1])


def time_step(discs: Discs, law: Law) -> float:
    """Largest step [s] that resolves a collision of the two lightest discs."""
    return law.contact_time(0.5 * float(discs.mass.min())) / STEPS_PER_CONTACT


def integrate(
    discs: Discs,
    law: Law,
    box: Box,
    *,
    times: ArrayLike,
    dt: float,
    foot: Plate | Block | None = None,
    foot_t: ArrayLike | None = None,
    foot_y: ArrayLike | None = None,
) -> Motion:
    """Motion of the discs, returned at `times` (T,) [s], increasing; the first is that of the given state.

    dt [s]: greatest time step (`time_step`); each interval is cut into equal steps no longer than it. foot moves up
    and down by the cubic spline through foot_y [m] (height of its face) at foot_t [s], whatever the discs do.
    Second order in dt while contacts last; a dashpot opens and closes with a jump of its force, which costs an order.
    The result does not depend on threads: there is one.
    """
    times = np.asarray(times, dtype=float)
    if times.ndim != 1 or times.size < 2 or not np.all(np.diff(times) > 0.0):
        raise ValueError("integrate: times must be two or more increasing numbers")
    if not dt > 0.0:
        raise ValueError(f"integrate: dt = {dt!r} s must be > 0; `time_step` gives one")
    height, rising = foot_path(foot, foot_t, foot_y, times)
    order, p, n = packed(discs, foot, float(height(times[0])), float(rising(times[0])))
    plate = (foot.half_width, foot.height) if isinstance(foot, Plate) else (-math.inf, 0.0)
    rules = (law.stiffness, law.damping, law.viscous, law.coulomb, law.gravity)
    walls = (box.left, box.right, box.bottom, box.top)
    v, f = p[:n, 2:4].copy(), np.zeros((len(p), 2))
    out = np.empty((4, times.size, n))
    force = np.full((times.size, 5), np.nan)
    out[:, 0, order] = p[:n, :4].T
    spin = np.empty((times.size, n))
    spin[:] = discs.spin
    rough = roughness(law, discs.spin[order]) if law.friction > 0.0 else None
    skin = SKIN * 2.0 * float(discs.radius.mean())
    start, partner, slide = np.zeros(n + 1, np.int64), np.empty(4 * n + 16, np.int64), np.empty(0)
    for k in watch(range(1, times.size), "discs, instants"):
        steps = math.ceil((times[k] - times[k - 1]) / dt * (1.0 - 1e-9))
        at = np.linspace(times[k - 1], times[k], steps + 1)
        impulse = np.zeros(5)
        h = (times[k] - times[k - 1]) / steps
        partner, slide = march(
            p, v, f, n, rules, walls, plate, h, height(at), rising(at), skin, start, partner, slide, impulse, rough
        )
        out[:, k, order] = p[:n, :4].T
        if rough is not None:
            spin[k, order] = rough[3][:, 1]
        force[k] = impulse / (times[k] - times[k - 1])
    seen = (height(times), rising(times)) if foot is not None else (np.full(times.size, np.nan),) * 2
    return Motion(
        times, out[0], out[1], out[2], out[3], seen[0], seen[1], force[:, :2], force[:, 2:4], force[:, 4], spin
    )


def roughness(law: Law, spin: Array) -> tuple[float, float, float, Array, Array, Array]:
    """State of `friction` at the start, all springs relaxed; spin (n,) [rad/s]."""
    n, both = spin.size, np.stack([spin, spin], axis=1)
    return law.friction, STIFFNESS * law.stiffness, DAMPING * law.damping, both, np.zeros(n), np.zeros((n, 3))


def forces(discs: Discs, law: Law, box: Box) -> Array:
    """Force of contacts, walls and gravity on each disc [N], (n, 2), at the given places and velocities; no drag, no
    friction."""
    order, p, n = packed(discs, None, 0.0, 0.0)
    start, partner = np.empty(n + 1, np.int64), np.empty(n * 64, np.int64)
    neighbours(p, n, 0.0, start, partner)
    before, v = p[:n, 2:4].copy(), p[:n, 2:4].copy()
    rules = (law.stiffness, law.damping, 0.0, 0.0, law.gravity)
    walls = (box.left, box.right, box.bottom, box.top)
    h = 1.0  # s: the half kick of a step of 2 s is the acceleration
    step(
        p,
        v,
        np.zeros((n, 2)),
        start,
        partner,
        n,
        rules,
        walls,
        (-math.inf, 0.0, 0.0, 0.0, 0.0),
        2.0 * h,
        True,
        False,
        np.empty(5),
        np.empty(0),
        None,
    )
    out = np.empty((n, 2))
    out[order] = (v - before) / p[:n, 5:6]
    return out


def foot_path(
    foot: Plate | Block | None, foot_t: ArrayLike | None, foot_y: ArrayLike | None, times: Array
) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """Height and velocity of the foot's face as functions of time; zero without a foot."""
    from scipy.interpolate import CubicSpline

    if foot is None:
        return np.zeros_like, np.zeros_like
    t, y = np.asarray(foot_t, dtype=float), np.asarray(foot_y, dtype=float)
    if t.ndim != 1 or t.shape != y.shape or t.size < 2:
        raise ValueError(
            f"integrate: foot_t and foot_y must be alike and hold two or more values, not {t.shape}, {y.shape}"
        )
    if t[0] > times[0] or t[-1] < times[-1]:
        raise ValueError(
            f"integrate: the foot is known over {t[0]:g}..{t[-1]:g} s, asked is {times[0]:g}..{times[-1]:g} s"
        )
    path = CubicSpline(t, y)
    return path, path.derivative()


def packed(
    discs: Discs, foot: Plate | Block | None, height: float, rising: float
) -> tuple[NDArray[np.intp], Array, int]:
    """order, state (n + m, 6) as `contacts` wants it, n: discs by rows of cells (near in memory), then the foot."""
    size = 4.0 * float(discs.radius.mean())
    order = np.lexsort((discs.x, np.floor(discs.y / size)))
    columns = (discs.x, discs.y, discs.vx, discs.vy, discs.radius, 1.0 / discs.mass)
    p = np.stack([a[order] for a in columns], axis=1)
    if isinstance(foot, Block):
        m = len(foot.x)
        rows = (foot.x, foot.y + height, np.zeros(m), np.full(m, rising), foot.radius, np.zeros(m))
        p = np.concatenate([p, np.stack(rows, axis=1)])
    return order, np.ascontiguousarray(p), len(order)


ENTRY = 0.08  # m/s, mean; discs thrown ahead of the foot slide on by v^2/(2 coulomb) = 0.3 mm
REST = 0.01  # s, between the entry and the path


@dataclass(frozen=True)
class Friction:
    """What rubs: the carpet on every sliding disc [m/s^2], and grains on each other, foot and walls (coefficient)."""

    carpet: float = 10.0
    grains: float = 0.0


def discs_under_foot(
    t: Array,
    foot_y: Array,
    times: Array,
    *,
    half_width: float,
    bed: tuple[float, float],
    diameter: float,
    fraction: float,
    rng: np.random.Generator,
    friction: Friction = Friction(),
    deepest: float | None = None,
) -> tuple[Discs, Motion]:
    """Discs of two sizes "on a carpet" at the times (T,) [s], the first the start, under a foot that goes t, foot_y.

    half_width [m] of the foot, whose face is at foot_y [m] (up, 0 at the surface); bed: half width and depth [m];
    diameter [m]: mean; fraction: of the area. The foot enters slowly to the height `deepest` [m] (default foot_y[0]),
    goes back to foot_y[0] and leaves a hole. ValueError where the discs do not fit.
    """
    half, depth = bed
    box = Box(-half, half, -depth, 0.0)
    d = pack(box, fraction, diameter=diameter, density=1.0, rng=rng)
    rubs = {"coulomb": friction.carpet, "friction": friction.grains}
    law = Law.bouncing(0.5, 1e-4, 0.5 * float(d.mass.min()), **rubs)
    box, plate, h = Box(-half, half, -depth), Plate(half_width, 0.02), time_step(d, law)
    first = float(foot_y[0])
    lowest = first if deepest is None else min(deepest, first)
    begin, at = float(times[0]), d
    ways = [(0.0, lowest), (lowest, first)] if lowest < first else [(0.0, first)]
    spans = [max(abs(b - a) / ENTRY, 1e-3) for a, b in ways]
    clock = begin - REST - sum(spans)
    s = np.linspace(0.0, 1.0, 50)
    for (a, b), span in zip(ways, spans):
        path = a + (b - a) * s**2 * (3.0 - 2.0 * s)
        m = integrate(at, law, box, times=[clock, clock + span], dt=h, foot=plate, foot_t=clock + span * s, foot_y=path)
        at, clock = m.last(d), clock + span
    rest = [begin - REST, begin]
    at = integrate(at, law, box, times=rest, dt=h, foot=plate, foot_t=rest, foot_y=[first, first]).last(d)
    fine = np.linspace(begin, float(times[-1]), max(math.ceil((times[-1] - begin) / 5e-4), 4))
    path = np.interp(fine, t, foot_y)
    return d, integrate(at, law, box, times=times, dt=h, foot=plate, foot_t=fine, foot_y=path)
