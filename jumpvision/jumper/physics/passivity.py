"""Can a law give energy? Over closed motions within a range: a passive part never does, a motor may."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.jumper.mechanisms.record import LONG_AGO, Body, Mechanism

from .model import Model

POINTS = 25  # of an argument's range
CYCLES, STEPS = 6, 400  # of a motion in which an internal state settles
Range = tuple[float, float]
POSITIONS = {Body.FOOT: ("z",), Body.CARRIAGE: ("x_m", "x_r"), Body.SPRING: ("stretch",)}
RATES = {Body.FOOT: "v", Body.CARRIAGE: "v_m", Body.SPRING: "stretch_rate"}
TOGETHER = {
    Body.FOOT: (Body.STATIC, Body.DRAG, Body.FOOT),
    Body.CARRIAGE: (Body.CARRIAGE, Body.RAIL),
    Body.SPRING: (Body.SPRING,),
}
"""What acts on a body as one part: the ground, the rail, the spring."""


def is_passive(model: Model, law: Mechanism, seen: Mapping[str, Range], *, alone: bool = False) -> bool | None:
    """Whether the part that the law belongs to gives no energy over any closed motion within the range seen.

    alone: the law by itself instead. Beside a part that resists enough, a law that gives energy leaves it passive: a
    motor, or a resistance that is weaker than the model's. model: with the law among its terms. The foot meets the
    ground only on its way down: the ground's whole force must not pull. Rail and spring: at each position no force on
    the way up may exceed the least on the way down, else a loop between the two gains. A law with an internal state is
    driven through sinusoidal loops until it has settled. Such a law, and a mass, is judged alike with `alone` and not.
    None for an instrument, which has no energy, and for a motor, whose is its own.
    """
    if law.acts_on in (Body.HEIGHT, Body.TIME, Body.MOTOR):
        return None
    if law.acts_on is Body.INERTIA:  # `Model` refuses a mass whose growth would create energy
        z = np.linspace(0.0, max(seen["z"][1], 1e-3), POINTS)
        return bool(np.all(model.m_f - sum(model.force(m, z=z, a=1.0) for m in model.acting(Body.INERTIA)) >= 0.0))
    if law.rate is not None:
        return _by_loops(model, law, seen)
    part = (law,) if alone else model.acting(*TOGETHER[law.acts_on])
    names, rate = POSITIONS[law.acts_on], RATES[law.acts_on]
    top = max(abs(x) for x in seen[rate])
    speed = top * np.r_[1e-6, np.linspace(0.02, 1.0, POINTS)]
    least = 0.0 if law.acts_on is Body.FOOT else -math.inf
    axes = [np.linspace(max(least, seen[n][0]), seen[n][1], POINTS) for n in names]
    grid = dict(zip(names, np.meshgrid(*axes, indexing="ij")))
    at = {n: x[..., None] for n, x in grid.items()} | {
        "z_g": 0.0,
        "z_stop": 0.0,
        "z_left": 0.0,
        "time_s": 0.0,
        "u": 0.0,
    }
    since = np.r_[LONG_AGO, np.geomspace(1e-3, 10.0, POINTS)] if "contact_s" in law.symbols else np.array([LONG_AGO])
    for contact in since:

        def force(sign: float, contact: float = float(contact)) -> NDArray[np.float64]:
            state = at | {rate: sign * speed, "contact_s": contact}
            total = sum(np.asarray(model.force(m, **state), float) for m in part)
            if law.acts_on is Body.SPRING and not alone:
                total = total - model.c_s * sign * speed
            return np.broadcast_to(total, (*grid[names[0]].shape, speed.size))

        down = force(-1.0)
        small = 1e-6 * float(np.max(np.abs(down)))  # less is rounding, not energy
        if law.acts_on is Body.FOOT:
            if np.min(down) < -small:
                return False
        elif np.any(force(1.0).max(axis=-1) > down.min(axis=-1) + small):
            return False
    return True


def _by_loops(model: Model, law: Mechanism, seen: Mapping[str, Range]) -> bool:
    """Whether sinusoidal loops of several sizes and rates, once settled, never end with more energy than they took."""
    name, rate = POSITIONS[law.acts_on][0], RATES[law.acts_on]
    low, high = seen[name]
    reach, speed = 0.5 * (high - low), max(abs(x) for x in seen[rate])
    for share, quick in itertools.product((0.2, 1.0), (0.03, 0.1, 0.3, 1.0)):
        size = share * reach
        omega = quick * speed / size
        t = np.linspace(0.0, CYCLES * 2.0 * math.pi / omega, CYCLES * STEPS + 1)
        sign = -1.0 if law.acts_on is Body.FOOT else 1.0  # z points down, v up
        x = 0.5 * (low + high) + size * np.sin(omega * t)
        v = sign * size * omega * np.cos(omega * t)
        force = _with_state(model, law, {name: x, rate: v}, t)
        power = force * v
        if law.acts_on is Body.FOOT:
            power = np.where(v < 0.0, power, 0.0)
        last = slice(-STEPS - 1, None)
        work, scale = np.trapezoid(power[last], t[last]), np.trapezoid(np.abs(power[last]), t[last])
        if work > 1e-3 * scale:
            return False
    return True


def _with_state(model: Model, law: Mechanism, motion: Mapping[str, Array], t: Array) -> Array:
    """The law's force along a motion, its internal state integrated by Heun's method."""
    rate, form = law.rate, law.expression
    assert rate is not None and form is not None
    given = {n: model.symbol(n) for n in law.asked if n not in (*motion, "u")}
    u, h = np.zeros(t.size), t[1] - t[0]

    def slope(k: int, u: float) -> float:
        at = {**given, **{n: x[k] for n, x in motion.items()}, "u": u}
        return float(rate(np, **at))

    for k in range(t.size - 1):
        first = slope(k, float(u[k]))
        u[k + 1] = u[k] + 0.5 * h * (first + slope(k + 1, float(u[k] + h * first)))
    own = {**motion, "u": u, **given}
    return np.asarray(form(np, **own), float)
