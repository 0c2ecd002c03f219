"""Where noise shows without a model: rest, ballistic flight, and the differences of trials made alike."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
import scipy

from jumpvision.base.arrays import Array
from jumpvision.engine.noise.learning import differences as between
from jumpvision.engine.noise.noise import Stretch, powers, samples, step_apart
from jumpvision.estimate.flight import in_flight
from jumpvision.estimate.height import at_rest
from jumpvision.jumper.physics.oscillator import foot_ripple
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.jumps import Jump

SHORTEST = 16  # samples of a flight
DEGREE = 4  # of a flight's course: gravity along the rail, and friction on it, are not taken for granted
RINGS = (1.0, 0.9, 1.1, 0.8, 1.2)  # of the foot's frequency on its spring, which the model may have wrong


def rest(jump: Jump, factor: Array) -> Stretch | None:
    """The track before the motor starts, a line; None where that is too short.

    factor: (n,) on the noise of every reading of the track.
    """
    here = at_rest(jump.t, jump.forcing.start)
    if int(here.sum()) < 6:  # samples at least
        return None
    t = jump.t[here]
    return Stretch(t, jump.y[here], powers(t, 1), factor[here])


def flights(jump: Jump, factor: Array, sigma: float, coarse: float, ring: float) -> list[Stretch]:
    """The flights after the motor stopped, each a polynomial and the ring of the foot on its spring.

    sigma: noise by which a flight is told from rest [m]; coarse: step that readings must lie apart [m], where they are
    rounded; ring: the foot's frequency over the model's. A flight whose course wants a higher degree is trimmed until
    it does not, or left out.
    """
    m = jump.model
    after = jump.t > jump.stop
    t, y, factor = jump.t[after], jump.y[after], factor[after]
    frame = float(np.median(np.diff(jump.t)))
    ripple = foot_ripple(m.k_s, m.m_f, m.M, m.g) / math.sqrt(2.0) if m.m_f > 0 else 0.0
    out = []
    # so many frames without a reading end a flight
    for piece in np.split(np.arange(t.size), np.flatnonzero(np.diff(t) > 3.5 * frame) + 1):
        about = np.hypot(sigma * factor[piece], ripple)
        for i, j in _in_flight(*(a[piece].tobytes() for a in (t, y)), about.tobytes(), m.g):
            edge = max(3, round(0.08 * (j - i)))  # left out at either end: sand lets go gently
            here = piece[i + edge : j - edge]
            # the whole of a flight must be as near as 0.3 g to free fall
            if here.size < SHORTEST or abs(_fall(t[here], y[here]) / m.g - 1.0) > 0.3:
                continue
            if coarse > 0:
                here = here[step_apart(_smooth(t[here], y[here]), coarse)]
            if (x := _course(jump, t[here], y[here], factor[here], ring)) is not None:
                out.append(x)
            if len(out) == 3:  # after the motor's stop: later bounces hardly leave the ground
                return out
    return out


@functools.lru_cache(maxsize=256)  # one track is asked for every frequency that its foot may have
def _in_flight(t: bytes, y: bytes, sigma: bytes, gravity: float) -> list[tuple[int, int]]:
    time, height, noise = (np.frombuffer(a) for a in (t, y, sigma))
    return in_flight(time, height, noise, gravity=gravity)


def _fall(t: Array, y: Array) -> float:
    """Downward acceleration of the whole stretch: a chain of small bounces has next to none."""
    return -2.0 * float(np.polyfit(t - t.mean(), y, 2)[0])


def ring_of(stretches: Callable[[float], list[Stretch]]) -> float:
    """The foot's frequency over the model's that suits the flights best."""
    found = {a: stretches(a) for a in RINGS}
    return min(RINGS, key=lambda a: sum(_squares(x) for x in found[a]) / max(samples(found[a]), 1))


def _smooth(t: Array, y: Array) -> Array:
    design = powers(t, 2)
    return np.asarray(design @ np.linalg.lstsq(design, y, rcond=None)[0])


def _course(jump: Jump, t: Array, y: Array, factor: Array, ring: float) -> Stretch | None:
    """The longest middle part whose course the design holds; None where there is none."""
    while t.size >= SHORTEST:
        design = np.column_stack([powers(t, DEGREE), *_ringing(jump, t, ring)])
        x = Stretch(t, y, design, factor)
        higher = replace(x, design=np.column_stack([design, powers(t, DEGREE + 2)[:, -2:]]))
        free = t.size - higher.design.shape[1]
        if free < 4:
            return None
        left, less = _squares(x), _squares(higher)
        # chance that a flight is trimmed further although its course is a polynomial
        if scipy.special.fdtrc(2, free, (left - less) / 2.0 / max(less / free, 1e-300)) > 0.01:
            return x
        t, y, factor = t[1:-1], y[1:-1], factor[1:-1]
    return None


def _ringing(jump: Jump, t: Array, ring: float) -> list[Array]:
    """What the foot's swing on the spring does to the rod in flight: (n,) for cosine and sine; [] without a foot."""
    m = jump.model
    if m.m_f <= 0:
        return []
    light = 1.0 / m.m_f + 1.0 / m.M
    w = ring * math.sqrt(m.k_s * light)
    decay = np.exp(-0.5 * m.c_s * light * (t - t[0]))
    return [decay * np.cos(w * t), decay * np.sin(w * t)]


def _squares(x: Stretch) -> float:
    w = np.ones(x.t.size) if x.spread is None else 1.0 / x.spread
    design, r = x.design * w[:, None], x.y * w
    return float(np.sum((r - design @ np.linalg.lstsq(design, r, rcond=None)[0]) ** 2))


STEPS = {"start": 1e-5, "bed": 1e-3}  # of the derivatives by what scatters


def differences(system: Jumper, factors: Sequence[Array]) -> list[Stretch]:
    """n - 1 independent differences of n trials of a group, each with the noise of one trial.

    factors: by jump, (n,) on the noise of every reading. Design: the zero level, then what scatters, until the motor
    has stopped (later it depends too much on the model).
    """
    jumps = system.jumps
    start = {p.name: p.start for p in system.baseline}
    groups: dict[str, list[int]] = {}
    for i, j in enumerate(jumps):
        groups.setdefault(j.group, []).append(i)
    out = []
    for trials in groups.values():
        first = jumps[trials[0]]
        each = [(_at(first.t, jumps[i], jumps[i].y), _at(first.t, jumps[i], factors[i])) for i in trials]
        for k, (apart, spread) in enumerate(between(each), 1):
            good = np.isfinite(apart) & (first.t < first.stop + 0.05)
            if good.sum() < 12:  # samples of two trials
                continue
            t = first.t[good]
            effects = [system.height(first, t, (), {**start, n: h}) for n, h in STEPS.items()]
            at = system.height(first, t, (), start)
            columns = [(e - at) / h for e, h in zip(effects, STEPS.values())]
            usable = columns[: 2 if first.model.ground == "granular" else 1]
            design = np.column_stack([np.ones(t.size), *(np.nan_to_num(c) for c in usable)])
            out.append(Stretch(t, apart[good], design, spread[good], trials[k]))
    return out


def steadied(x: Stretch) -> Stretch:
    """A stretch whose course may also wander slowly."""
    design = np.column_stack([x.design, powers(x.t, 3)[:, 1:]])  # the wander up to degree 3 is taken off
    return Stretch(x.t, x.y, design, x.spread, x.track)


def _at(t: Array, jump: Jump, values: Array) -> Array:
    """What a trial has (n,) at the frames t of another, NaN where it has no frame within 2e-6 s."""
    i = np.clip(np.searchsorted(jump.t, t - 1e-6), 0, jump.t.size - 1)
    return np.where(np.abs(jump.t[i] - t) < 2e-6, values[i], np.nan)
