"""How a simulator answers to its parameters, before anything is fitted: smooth, in steps, noisy, or not at all.

Every parameter is moved over its scale and by small shares of it. Where the slope of a small change foretells that of
a large one, the usual step of a difference serves. Where it does not, the function marches in steps or is noisy there:
its slope is that of a cubic through large changes, what the small ones leave of it is the function's own error, and
differences are taken on both sides at the distance at which this error and the curvature do as little harm as they can
(More and Wild, ACM Trans. Math. Softw. 38, 19, 2012). The times of a recording are moved in the same way.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.numbers import said
from jumpvision.engine.document.values import Doubt, DoubtKind

from .learn import ROUGH, Probed
from .processes import Ask
from .runs import BudgetUsed, SimulatorError
from .system import Studied

FINE = (1e-3, 3e-2, 1.0)  # scales: changes by which every parameter is moved; the first is `Study(step=)`
LADDER = (1e-3, 3e-3, 1e-2, 3e-2, 0.1, 0.3, 1.0)  # the same where the slopes of these disagree
ALIKE = 0.05  # of a slope: so much a smooth function's may differ from what larger changes foretell, over FINE
CLOSE = 0.02  # the same over LADDER, whose steps are shorter
SHIFTS = tuple(0.25 * k for k in range(1, 13))  # samples
LEAST = 1e-2  # scales: a shorter step is not taken where a function is rough


@dataclass(frozen=True)
class _Place:
    """A parameter to be moved: of which function, about which values (by recording) it is, within which range."""

    name: str
    at: int
    function: int
    low: float
    high: float
    scale: float
    unit: str
    owner: str = ""  # the mechanism that has it
    on: Mapping[str, float] = field(default_factory=dict)  # values that make it matter

    def offsets(self, value: float, shares: Sequence[float]) -> Array:
        """Changes of these shares of the scale, towards the wider side, within the range."""
        up, down = self.high - value, value - self.low
        sign, room = (1.0, up) if up >= min(self.scale, down) else (-1.0, down)
        return sign * min(self.scale, room) * np.array(shares)


def probe(system: Studied) -> Probed:
    """What is found of every parameter of a study; of those probed so far where no run is left."""
    steps: dict[str, float] = {}
    idle: list[_Place] = []
    doubts: list[Doubt] = []
    error, slopes, exact = np.zeros(len(system.study.channels)), _Slopes(system), set[str]()
    try:
        for place in _places(system):
            found = _look(system, place, 0, FINE)
            if found is None or not found.answers:
                if found is not None and _never(system, place):
                    idle.append(place)
                continue
            finer = None if found.smooth(ALIKE) else _look(system, place, 0, LADDER)
            if found.smooth(ALIKE) or finer is None or finer.smooth(CLOSE):
                own = slopes.given(place)
                if own is not None and (far := (finer or found).apart(own, system, place)):
                    doubts.append(Doubt(DoubtKind.WRONG_JACOBIAN, (place.name,), far))
                elif own is not None:
                    exact.add(place.name)
                continue
            steps[place.name] = (step := finer.step())
            error = np.maximum(error, finer.error(place.name in {p.name for p in system.each}))
            doubts.append(_stepped(place, step))
        if (below := _marches(system)) is not None:
            error = np.maximum(error, _at_shifts(system))
            doubts.append(below)
    except BudgetUsed:
        pass
    for p in idle:
        what = f"mechanism {p.owner!r}: its parameter" if p.owner else "parameter"
        text = f"{what} {p.name!r} has no effect on any output: see whether the function reads it by this name"
        doubts.append(Doubt(DoubtKind.NO_EFFECT, (p.name,), text))
    return Probed(steps, tuple(p.name for p in idle), error, tuple(doubts), frozenset(exact))


def _stepped(p: _Place, step: float) -> Doubt:
    by = f"{said(step, '.2g')}{f' {p.unit}' if p.unit else ''}"
    return Doubt(
        DoubtKind.STEPPED,
        (p.name,),
        f"the simulator answers to {p.name!r} in steps, or with noise of its own, at changes below {by}: derivatives "
        "are taken over that",
    )


def _places(system: Studied) -> Iterator[_Place]:
    """Every parameter of the baseline, of each recording, of each mechanism."""
    at = {n: k for k, n in enumerate(system.names)}
    for p in system.baseline:
        if p.name in at:
            yield _Place(p.name, at[p.name], 0, p.low, p.high, p.scale, p.unit)
    for e in system.each:
        wide = 3.0 * float(e.sigma or 1.0)
        yield _Place(e.name, at[e.name], 0, -math.inf, math.inf, min(float(system.scales[at[e.name]]), wide), e.unit)
    replacing = [m.name for m in system.study.mechanisms if m.function is not None]
    for m in system.study.mechanisms:
        candidate = system.candidates[m.name]
        on: dict[str, float] = {}
        for k, p in enumerate(candidate.parameters):
            if p.name not in at:
                continue
            function = 1 + replacing.index(m.name) if m.name in replacing else 0
            yield _Place(p.name, at[p.name], function, p.low, p.high, p.scale, p.unit, m.name, dict(on))
            if k == 0 and m.function is None:  # the shape of what is absent shows nowhere
                on = {p.name: min(candidate.null + p.scale, p.high)}


@dataclass(frozen=True)
class _Look:
    """Outputs (n, channels) changed by offsets (k,) of a parameter, in the channels' noise units; scale: its own."""

    offsets: Array
    changes: Array  # (k, n, channels)
    units: Array
    scale: float

    @property
    def size(self) -> Array:
        """(k,) of the changes."""
        return np.asarray(np.sqrt(np.sum(self.changes**2, axis=(1, 2))))

    @property
    def answers(self) -> bool:
        return bool(np.any(self.size > 0.0))

    def _slopes(self) -> Array:
        return np.asarray(self.changes / (self.offsets / self.scale)[:, None, None])

    def smooth(self, alike: float) -> bool:
        """Whether the slope of the smallest change is what the next two foretell, a line through theirs."""
        s, g = np.abs(self.offsets) / self.scale, self._slopes()
        foretold = g[1] - (g[2] - g[1]) * (s[1] - s[0]) / (s[2] - s[1])
        size = float(np.linalg.norm(g[1]))
        return size > 0.0 and float(np.linalg.norm(g[0] - foretold)) <= alike * max(size, float(np.linalg.norm(g[0])))

    def apart(self, own: Array, system: Studied, p: _Place) -> str:
        """Where the function's own derivative (n, channels) is another than differences say; "" where it is none."""
        s, g = np.abs(self.offsets) / self.scale, self._slopes()
        by_steps = g[0] - (g[1] - g[0]) * s[0] / (s[1] - s[0])
        mine = own * self.scale / self.units
        if np.linalg.norm(mine - by_steps) <= ALIKE * max(np.linalg.norm(by_steps), np.linalg.norm(mine)):
            return ""
        i, k = divmod(int(np.argmax(np.abs(mine - by_steps))), mine.shape[1])
        r, c, back = system.recordings[0], system.study.channels[k], self.units[k] / self.scale
        return (
            f"the function's own derivative by {p.name!r} is {said(float(own[i, k]), '.4g')}, a difference's "
            f"{said(float(by_steps[i, k] * back), '.4g')} (recording {r.name!r}, t = {r.t[i]:g} s, {c.name}): "
            "differences are used for it"
        )

    def _cubic(self) -> tuple[Array, Array, Array]:
        """(coefficients (3, n, channels) of a cubic through the three largest changes, their offsets, what the smaller
        ones leave of it)."""
        s = self.offsets / self.scale
        powers = np.stack([s, s**2, s**3], axis=1)
        flat = self.changes.reshape(s.size, -1)
        c = np.linalg.solve(powers[-3:], flat[-3:])
        left = (flat[:-3] - powers[:-3] @ c).reshape(-1, *self.changes.shape[1:])
        return np.asarray(c.reshape(3, *self.changes.shape[1:]), float), s, left

    def step(self) -> float:
        """At which the function's own error and the curvature harm a difference on both sides least."""
        c, s, left = self._cubic()
        own = float(np.sqrt(np.mean(np.sum(left**2, axis=(1, 2)))))
        bent = float(np.linalg.norm(c[2]))
        best = (own / (2.0 * bent)) ** (1.0 / 3.0) if bent > 0.0 else 1.0
        return float(np.clip(best, LEAST, np.abs(s[-1]))) * self.scale

    def error(self, own: bool) -> Array:
        """(channels,) rms of the function's own error in the channels' units. own: of a parameter that each recording
        has for itself, which takes up an error along its own effect."""
        c, _, left = self._cubic()
        if own and (length := float(np.linalg.norm(c[0]))) > 0.0:
            along = c[0] / length
            left = left - np.sum(left * along, axis=(1, 2))[:, None, None] * along
        return np.asarray(np.sqrt(np.mean(left**2, axis=(0, 1))) * self.units)


class _Slopes:
    """The derivatives that the study's function brings itself, in the first recording."""

    def __init__(self, system: Studied) -> None:
        self.system, self.known = system, dict[tuple[float, ...], Mapping[str, Array]]()

    def given(self, p: _Place) -> Array | None:
        """By a parameter, where it is looked at."""
        if p.function != 0:
            return None
        x = _values(self.system, p, 0)
        if (key := tuple(x.tolist())) not in self.known:
            asked = Ask(0, 0, self.system.given(x))
            (self.known[key],) = self.system.runs.slopes([asked])
        return self.known[key].get(p.name)


def _look(system: Studied, p: _Place, i: int, shares: Sequence[float]) -> _Look | None:
    """A parameter moved in one recording; None where a run fails."""
    try:
        base = _values(system, p, i)
        offsets = p.offsets(float(base[p.at]), [system.study.step if s == FINE[0] else s for s in shares])
        moved = []
        for d in offsets:
            x = base.copy()
            x[p.at] += d
            moved.append((i, p.function, x))
        here, *there = system._run([(i, p.function, base), *moved])
    except SimulatorError:
        return None
    units = np.array([n.s for n in system.readings.channels])
    changes = np.stack([(y.y - here.y) / units for y in there])
    return _Look(offsets, changes, units, p.scale) if np.all(np.isfinite(changes)) else None


def _marches(system: Studied) -> Doubt | None:
    """That the function answers to shifted times in steps; None where it is smooth, or does not look at them."""
    found = _shifted(system, FINE)
    if found is None or not found.answers or found.smooth(ALIKE):
        return None
    finer = _shifted(system, LADDER)
    if finer is None or finer.smooth(CLOSE):
        return None
    text = (
        "the simulator answers to shifted times in steps, or with noise of its own: that error is taken into the noise"
    )
    return Doubt(DoubtKind.STEPPED, ("time",), text)


def _at_shifts(system: Studied) -> Array:
    """(channels,) rms by which a motion at shifted times strays from a cubic through them, sample by sample; without
    those at a kink."""
    look = _shifted(system, SHIFTS)
    if look is None:
        return np.zeros(len(system.study.channels))
    shape, s = look.changes.shape, np.array(SHIFTS)
    powers = np.stack([s**k for k in range(4)], axis=1)
    flat = look.changes.reshape(s.size, -1)
    left = flat - powers @ np.linalg.lstsq(powers, flat, rcond=None)[0]
    power = (np.sum(left**2, axis=0) / (s.size - 4)).reshape(shape[1:])
    kept = power <= ROUGH * np.median(power, axis=0)
    return np.asarray(np.sqrt(np.sum(power * kept, axis=0) / kept.sum(axis=0)) * look.units)


def _shifted(system: Studied, shares: Sequence[float]) -> _Look | None:
    """The first recording at times later by these shares of a sample; None where the function cannot be asked so."""
    runs, frame = system.runs, float(np.median(np.diff(system.recordings[0].t)))
    first = np.array([*system.rest.values(), *system.first[0].tolist()])
    before = len(runs.count.failures)
    try:
        here = system._run([(0, 0, first)])[0].y
        there = runs.many([Ask(0, 0, system.given(first), later=s * frame) for s in shares])
    except SimulatorError:
        return None
    finally:
        del runs.count.failures[before:]  # nobody asked for these times
    units = np.array([n.s for n in system.readings.channels])
    changes = np.stack([(y - here) / units for y in there])
    return _Look(frame * np.array(shares), changes, units, frame) if np.all(np.isfinite(changes)) else None


def _values(system: Studied, p: _Place, i: int) -> Array:
    """All parameters of a recording where this one is looked at."""
    full = {**system.rest, **p.on}
    return np.concatenate([[full[n] for n in system.rest], system.first[i]])


def _never(system: Studied, p: _Place) -> bool:
    """Whether a parameter changes no output of any recording, at a scale or at the ends of its range, where the others
    are at their first values and where they are all a scale off (its own strength may be among them)."""
    for i in range(len(system.recordings)):
        first = _values(system, p, i)
        for base in (first, _off(system, first)):
            value = float(first[p.at])
            ends = [e for e in (p.low, p.high) if math.isfinite(e)] or [value - 3.0 * p.scale, value + 3.0 * p.scale]
            wanted = []
            for own in (value, *ends, value + p.offsets(value, (1.0,))[0]):
                x = base.copy()
                x[p.at] = own
                wanted.append(x)
            try:
                here, *there = system._run([(i, p.function, x) for x in wanted])
            except SimulatorError:
                return False
            if any(not np.array_equal(here.y, y.y) for y in there):
                return False
    return True


def _off(system: Studied, x: Array) -> Array:
    """All parameters a scale off, within their ranges."""
    low = np.array([system.bottoms.get(n, -math.inf) for n in system.names])
    high = np.array([system.tops.get(n, math.inf) for n in system.names])
    up = x + system.scales
    return np.asarray(np.where(up <= high, up, np.maximum(x - system.scales, low)))
