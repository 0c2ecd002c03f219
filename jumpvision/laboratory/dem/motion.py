"""Motion of discs under a foot on a prescribed path: velocity Verlet over a neighbour list."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array
from jumpvision.base.progress import watch
from jumpvision.base.threads import at_once, threads

from . import contacts, march, neighbours
from .discs import Block, Box, Discs, Law, Plate
from .packing import pack

SKIN = 0.3  # of the mean diameter: neighbours are listed so much farther than they touch
BAND, MOST_BANDS = 2000, 16  # discs of a band at least, bands at most
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
    The bits of the result do not depend on the number of threads, which share the discs in bands (`march.march`).
    """
    times = np.asarray(times, dtype=float)
    if times.ndim != 1 or times.size < 2 or not np.all(np.diff(times) > 0.0):
        raise ValueError("integrate: times must be two or more increasing numbers")
    if not dt > 0.0:
        raise ValueError(f"integrate: dt = {dt!r} s must be > 0; `time_step` gives one")
    height, rising = foot_path(foot, foot_t, foot_y, times)
    order, state, size, n = packed(discs, foot, float(height(times[0])), float(rising(times[0])))
    plate = (foot.half_width, foot.height) if isinstance(foot, Plate) else (-math.inf, 0.0)
    rules = (law.stiffness, law.damping, law.viscous, law.coulomb, law.gravity)
    walls = (box.left, box.right, box.bottom, box.top)
    bands = Bands(state, size, n, law, SKIN * 2.0 * float(discs.radius.mean()))
    out = np.empty((4, times.size, n))
    force = np.full((times.size, 5), np.nan)
    out[:, 0, order] = state[:4, :n]
    spin = np.empty((times.size, n))
    spin[:] = discs.spin
    for k in watch(range(1, times.size), "discs, instants"):
        steps = math.ceil((times[k] - times[k - 1]) / dt * (1.0 - 1e-9))
        at = np.linspace(times[k - 1], times[k], steps + 1)
        h = (times[k] - times[k - 1]) / steps
        impulse = bands.march(rules, walls, plate, h, height(at), rising(at))
        out[:, k, order] = bands.state[0, :4, :n]
        spin[k, order] = bands.state[0, neighbours.SPIN, :n]
        force[k] = impulse / (times[k] - times[k - 1])
    seen = (height(times), rising(times)) if foot is not None else (np.full(times.size, np.nan),) * 2
    return Motion(
        times, out[0], out[1], out[2], out[3], seen[0], seen[1], force[:, :2], force[:, 2:4], force[:, 4], spin
    )


class Bands:
    """Discs in bands that threads share, their state at even and odd steps, and the lists of who is near whom."""

    def __init__(self, state: Array, size: Array, n: int, law: Law, skin: float) -> None:
        """state (STATE, n + m), size (2, n + m) as `packed` gives them, the n free discs first; all springs relaxed."""
        bands = max(1, min(MOST_BANDS, n // BAND))
        self.edges = np.linspace(0, n, bands + 1).astype(np.int64)
        self.state, self.size, self.n, self.skin = np.stack([state, state]), size, n, skin
        self.f, self.held = np.zeros((3, n)), np.zeros((3, n if law.friction > 0.0 else 0))
        self.rough = law.friction, contacts.STIFFNESS * law.stiffness, contacts.DAMPING * law.damping
        whole = state.shape[1]
        places = np.empty(whole, np.int64), np.empty(4 * whole + 16, np.int64), np.empty(whole, np.int64)
        self.binned = *places, np.empty(2, np.int64)
        self.sync = np.zeros(march.CLAIM + bands, np.int64)
        self.lists = tuple(self.listed(0) for _ in range(2))
        self.room(4 * n // bands + 16)

    def listed(self, pairs: int) -> tuple[NDArray[Any], ...]:
        """Empty lists of `neighbours.listed`, by band, without springs where nothing rubs."""
        shape = (len(self.edges) - 1, 2, pairs)
        sprung = shape if self.held.size else (*shape[:2], 0)
        of_disc = np.zeros((2, self.n), np.uint32), np.zeros((2, self.n), np.uint32)
        return *of_disc, np.empty(shape, np.uint32), np.empty(sprung), np.empty(sprung, np.int64)

    def room(self, pairs: int) -> None:
        """Makes room for so many pairs of a band; keeps the lists."""
        old, self.lists = self.lists, tuple(self.listed(pairs) for _ in range(2))
        for before, after in zip(old, self.lists):
            after[0][:], after[1][:] = before[0], before[1]
            for short, long in zip(before[2:], after[2:]):
                long[:, :, : short.shape[2]] = short
        bands, shape = len(self.edges) - 1, self.lists[0][2].shape
        one, other, where, soon, hits = (np.empty(shape, np.uint32) for _ in range(5))
        walls = np.empty((bands, self.n // bands + 1), np.uint32)
        square, wide, found = np.empty(shape), np.empty(shape), np.empty((bands, 5), np.int64)
        self.close: tuple[NDArray[Any], ...] = one, other, where, square, wide, walls, soon, hits, found

    def march(
        self,
        rules: tuple[float, ...],
        walls: tuple[float, ...],
        plate: tuple[float, float],
        h: float,
        path: Array,
        speed: Array,
    ) -> Array:
        """`march.march` on all threads; the impulses (4,) [N s] and the work of friction [J], as one array."""
        bands, sync = len(self.edges) - 1, self.sync
        about, results = np.zeros(3), np.zeros((bands, 16))
        sync[march.STEP] = 0
        while True:
            sync[march.PHASE], sync[march.DONE], sync[march.TASKS] = 0, 0, 1
            sync[march.KIND], sync[march.FULL] = march.SORT, 0
            sync[march.CLAIM :] = [0] + [march.NEVER] * (bands - 1)
            shared = (sync, about, self.state, self.size, self.f, self.edges, self.n, rules, walls, plate, h, path)
            lists = (speed, self.skin, self.binned, self.lists, self.close, results, self.rough, self.held)
            crew = min(threads(), bands)
            at_once([functools.partial(march.march, me * bands // crew, *shared, *lists) for me in range(crew)])
            if not sync[march.FULL]:
                break
            self.room(2 * self.lists[0][2].shape[2])
        steps = len(path) - 1
        self.state[0, :, : self.n] = self.state[(steps + 1) % 2, :, : self.n]
        self.state[0, :, self.n :] = self.state[steps % 2, :, self.n :]
        return results[:, 6:11].sum(axis=0)


def forces(discs: Discs, law: Law, box: Box) -> Array:
    """Force of contacts, walls and gravity on each disc [N], (n, 2), at the given places and velocities; no drag, no
    friction."""
    order, state, size, n = packed(discs, None, 0.0, 0.0)
    bands = Bands(state, size, n, replace(law, friction=0.0), 1e-6 * float(discs.radius.mean()))
    rules = (law.stiffness, law.damping, 0.0, 0.0, law.gravity)
    walls, none = (box.left, box.right, box.bottom, box.top), (-math.inf, 0.0)
    bands.march(rules, walls, none, 1.0, np.zeros(1), np.zeros(1))  # no step: the lists
    now, new = bands.state
    begin, end, partner, slide, seen = bands.lists[bands.sync[march.BUFFER]]
    *close, found = bands.close
    for b, (low, high) in enumerate(itertools.pairwise(bands.edges)):
        h = 1.0  # s: the half kick of a step of 2 s is the acceleration
        contacts.step(
            now,
            new,
            size,
            bands.f,
            low,
            high,
            n,
            (begin, end, partner[b], slide[b], seen[b]),
            tuple(a[b] for a in close),
            found[b],
            False,
            rules,
            walls,
            (*none, 0.0, 0.0, 0.0),
            2.0 * h,
            True,
            False,
            np.empty(5),
            bands.rough,
            bands.held,
            0,
        )
    out = np.empty((n, 2))
    out[order] = ((new - now)[neighbours.UX : neighbours.UY + 1] / size[1]).T
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
) -> tuple[NDArray[np.intp], Array, Array, int]:
    """order, state (STATE, n + m) and size (2, n + m) as `contacts` wants them, n: discs by rows of cells (near in
    memory), then the foot."""
    cell = 4.0 * float(discs.radius.mean())
    order = np.lexsort((discs.x, np.floor(discs.y / cell)))
    rows = (discs.x, discs.y, discs.vx, discs.vy, discs.vx, discs.vy, discs.spin, discs.spin)
    state, size = np.stack([a[order] for a in rows]), np.stack([discs.radius[order], 1.0 / discs.mass[order]])
    if isinstance(foot, Block):
        none = np.zeros(len(foot.x))
        driven = (foot.x, foot.y + height, none, none + rising, none, none + rising, none, none)
        state = np.concatenate([state, np.stack(driven)], axis=1)
        size = np.concatenate([size, np.stack([foot.radius, none])], axis=1)
    return order, np.ascontiguousarray(state), np.ascontiguousarray(size), len(order)


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
