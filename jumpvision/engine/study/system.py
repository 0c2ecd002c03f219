"""A study as a system that can be questioned: predictions from few runs, derivatives kept and mended between them.

A derivative that was had by differences at one point serves at another where the linear prediction from there agrees
with the run that was made here; Broyden's rank-one update (Math. Comp. 19, 577, 1965) takes up what is left.
"""

from __future__ import annotations

import copy
import dataclasses
import math
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from numbers import Real
from typing import TYPE_CHECKING, Self

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.engine.noise.whitening import Whitening, axes
from jumpvision.engine.series import at_times, places
from jumpvision.engine.system import Block, Candidate, Circumstances, Observation, Parameter

from .inputs import factors_of
from .learn import Probed, Readings
from .processes import Ask
from .runs import Runs, SimulatorError
from .study import DELAYS, INSTRUMENT, READS, Mechanism, Recording, Study

if TYPE_CHECKING:  # imported where a number of a recording is its own: most questions have none
    from jumpvision.engine.vary.patterns import Pattern, Weighed
    from jumpvision.engine.vary.variables import Changes, Variable

OLD = 6  # times that a derivative is handed on
LEAP = 3.0  # sigmas that its values may move in a round
SPREAD, STEP = 0.1, 1e-3  # shares: what recordings may plausibly differ by at least, step of derivatives
DUMMY = "chosen_"  # an alternative function without parameters has one that does nothing


@dataclass
class _Point:
    """A run of one recording: at x (by the names of `Studied`), values y (n, channels), derivatives, their age."""

    x: Array
    y: Array
    columns: dict[int, Array] = field(default_factory=dict)
    age: dict[int, int] = field(default_factory=dict)


class Studied:
    """System of a study and its recordings. readings: the noise of their channels.

    Several channels are compared in units of their own noise, one channel in its own unit.
    """

    def __init__(
        self,
        study: Study,
        recordings: Sequence[Recording],
        readings: Readings,
        runs: Runs,
        probed: Probed | None = None,
    ) -> None:
        self.study, self.recordings, self.runs, self.readings = study, list(recordings), runs, readings
        self.probed = probed or Probed()
        self.units = [c.s for c in readings.channels] if len(study.channels) > 1 else [1.0]
        self.each = tuple(p for p in study.parameters if p.each)
        frame = float(np.median(np.concatenate([np.diff(r.t) for r in recordings])))
        idle = set(self.probed.idle)
        own = tuple(p.free() for p in study.parameters if not p.each and p.name not in idle)
        self.baseline = own + self._instruments()
        self.laws = [{n: INSTRUMENT[n] for n in {*study.considered(c), *c.sigmas}} for c in study.channels]
        self.mechanisms = {m.name: m for m in study.vocabulary if not self._absent(m)}
        self.candidates = {n: self._candidate(m, frame) for n, m in self.mechanisms.items()}
        self.inputs = factors_of(self.recordings)
        # of the simulator's parameters, mechanisms absent; inputs as they are given
        self.rest = {**study.first, **dict.fromkeys(self.inputs, 1.0)}
        self.names = [*self.rest, *(p.name for p in self.each)]
        free = [*self.baseline, *(p for c in self.candidates.values() for p in c.parameters)]
        self.tops, self.bottoms = {p.name: p.high for p in free}, {p.name: p.low for p in free}
        scales = {p.name: p.scale for p in free}
        scales |= {p.name: float(p.scale or p.sigma or 1.0) for p in self.each}
        self.scales = np.array([scales.get(n, 1.0) for n in self.names])
        self.careful = False  # whether derivatives that were handed on do not serve
        self.fine = False  # whether steps are the usual ones where the simulator is rough too
        self.masks = [np.isfinite(r.of_channels(r.values, study.channels)) for r in self.recordings]
        self.circumstances = circumstances(self.recordings)
        self.observations = [self._observation(i) for i in range(len(self.recordings))]
        self.white = [Whitening(readings.noise, o) for o in self.observations]
        self.steady = [axes(w.wander) for w in self.white]
        self.points: dict[tuple[int, int, bytes], _Point] = {}
        self.donors: dict[tuple[int, int], list[_Point]] = {}  # points with derivatives
        self.first = [np.array([_start(p.start, r) for p in self.each]) for r in self.recordings]
        self.settled: dict[tuple[object, ...], tuple[_Point, Array | float]] = {}
        self.patterns: Mapping[str, Pattern] = {}
        self.scattering: tuple[str, ...] = ()
        self.always: Changes = {}  # of every prediction: about these, recordings scatter
        self.starts: dict[tuple[int, tuple[str, ...]], tuple[float, Array]] = {}  # the best so far: chi^2, values

    def _absent(self, m: Mechanism) -> bool:
        """Whether a mechanism has no effect on any output."""
        return m.function is None and bool(m.parameters) and m.parameters[0].name in self.probed.idle

    @property
    def scatter_sigma(self) -> dict[str, float]:
        """How far what each recording has for itself may be from its first value."""
        return {p.name: float(p.sigma or 0.0) for p in self.each}

    def _instruments(self) -> tuple[Parameter, ...]:
        """What is known of scales and clocks, as parameters with a prior."""
        out = []
        for c in self.study.channels:
            for law, sigma in c.sigmas.items():
                null, unit = INSTRUMENT[law][0], READS[law][0]
                out.append(Parameter(c.name_of(law), null, null - 8 * sigma, null + 8 * sigma, sigma, sigma, unit))
        return tuple(out)

    def _candidate(self, m: Mechanism, frame: float) -> Candidate:
        free = [p.free() for p in m.parameters if p.name not in self.probed.idle]
        instrument = {c.name_of(n): (k, n) for k, c in enumerate(self.study.channels) for n in self.study.considered(c)}
        own = instrument.get(m.name) if m not in self.study.mechanisms else None
        if own is not None:
            free = [self._of_instrument(free[0], *own, frame)]
        if m.function is not None and not free:
            free = [Parameter(DUMMY + m.name, 0.0, -1.0, 1.0, 1.0)]
        active = [p.name not in self.probed.idle for p in m.parameters[1:]]
        shapes = tuple(tuple(float(x) for x, kept in zip(s, active) if kept) for s in m.shapes)
        dear = own is not None and self.study.channels[own[0]].consider is None
        return Candidate(tuple(free), m.null, shapes, replaces="simulate" if m.function is not None else "", dear=dear)

    def _of_instrument(self, p: Parameter, channel: int, law: str, frame: float) -> Parameter:
        """A law of an instrument with the range that the recordings give it."""
        if law == "delay":
            span = 0.1 * float(np.median([r.t[-1] - r.t[0] for r in self.recordings]))
            return dataclasses.replace(p, low=-span, high=span, scale=min(DELAYS * frame, span))
        if law != "zero":
            return p
        each = [r.of_channels(r.values, self.study.channels)[:, channel] for r in self.recordings]
        reach = float(np.median([np.ptp(y[np.isfinite(y)]) for y in each if np.isfinite(y).any()])) or 1.0
        return dataclasses.replace(p, low=p.low * reach, high=p.high * reach, scale=p.scale * reach)

    def _observation(self, i: int) -> Observation:
        r, channels = self.recordings[i], self.study.channels
        values, mask = r.of_channels(r.values, channels), self.masks[i]
        sigma = None if r.sigma is None else r.of_channels(r.sigma, channels, "sigma")
        t, y, spread, parts, blocks, at = [], [], [], [], [], 0
        for k, (c, unit, noise) in enumerate(zip(channels, self.units, self.readings.channels)):
            here = mask[:, k]
            if (n := int(here.sum())) < 2:
                continue
            t.append(r.t[here])
            y.append(values[here, k] / unit)
            spread.append(np.ones(n) if sigma is None else sigma[here, k] / noise.s)
            blocks.append(Block(slice(at, at + n), self.readings.scaled(k, unit), c.zero_sigma / unit))
            at += n
            part = np.asarray(thirds(r.t) if r.parts is None else r.parts).astype(str)[here]
            parts.append(np.char.add(f"{c.name}, ", part) if len(channels) > 1 else part)
        if not t:
            raise InputError([f"recording {r.name!r}: no channel has two readings"])
        group = r.group or r.name
        labels = {"kind": "recordings", **r.labels}
        return Observation(
            r.name,
            np.concatenate(t),
            np.concatenate(y),
            group,
            r.condition or group,
            labels,
            np.concatenate(spread),
            np.concatenate(parts),
            tuple(blocks),
            self.circumstances[i],
        )

    def call_of(self, mechanisms: Sequence[str], values: Mapping[str, float]) -> tuple[int, Array] | None:
        """(function, its parameters) of a model; None where two mechanisms take the place of one function."""
        functions = [m.name for m in self.study.mechanisms if m.function is not None]
        chosen = [m for m in mechanisms if m in functions]
        if len(chosen) > 1:
            return None
        own = {p.name for p in self.baseline} | {p.name for m in mechanisms for p in self.candidates[m].parameters}
        full = [values.get(n, self.rest[n]) if n in own else self.rest[n] for n in self.rest]
        return (1 + functions.index(chosen[0]) if chosen else 0), np.array(full)

    @property
    def variables(self) -> dict[str, Variable]:
        """Inputs, parameters that are fitted to all recordings alike, scales and zeros of single channels."""
        from jumpvision.engine.vary.variables import Variable

        out = {n: Variable(n, 1.0, "1", SPREAD, STEP, drive=True) for n in self.inputs}
        out |= {p.name: self._variable(p) for p in self.baseline if p.name in self.rest}
        several = len(self.study.channels) > 1
        for c, unit in zip(self.study.channels, self.units):
            if several:
                name = f"scale of {c.name}"
                out[name] = Variable(name, 1.0, "1", 0.05, 1e-4, least=-0.9)
            name, wide = f"zero of {c.name}", 0.05 * self._reach(c.name) * unit
            if wide > 0:
                out[name] = Variable(name, 0.0, c.unit or "1", wide, 0.01 * wide, relative=False)
        return out

    def _variable(self, p: Parameter) -> Variable:
        from jumpvision.engine.vary.variables import Variable

        wide = max(0.1 * (p.high - p.low), p.sigma if math.isfinite(p.sigma) else 0.0)
        if not p.start:
            return Variable(p.name, 0.0, p.unit or "1", wide, STEP * p.scale, relative=False)
        share = min(max(wide / abs(p.start), SPREAD), 0.5)
        return Variable(p.name, p.start, p.unit or "1", share, STEP, least=-0.9)

    def _reach(self, channel: str) -> float:
        """How far the readings of a channel go, in the observations' unit."""
        each = [np.ptp(o.y[b]) for i, o in enumerate(self.observations) if (b := self._block(i, channel)) is not None]
        return float(np.median(each)) if each else 0.0

    def _block(self, i: int, channel: str) -> slice | None:
        read = [c.name for c, m in zip(self.study.channels, self.masks[i].T) if m.sum() >= 2]
        return self.observations[i].blocks[read.index(channel)].readings if channel in read else None

    def blocks(self, i: int) -> dict[int, slice]:
        """Where in an observation the readings of each channel are, by its place."""
        read = [k for k, m in enumerate(self.masks[i].T) if m.sum() >= 2]
        return {k: b.readings for k, b in zip(read, self.observations[i].blocks)}

    def varying(self, weighed: Sequence[Weighed], log_price: float = 0.0) -> Self:
        """The same recordings with these patterns, by which numbers differ between them, beside the mechanisms."""
        from jumpvision.engine.vary.candidates import candidate

        out = copy.copy(self)
        out.patterns = {**self.patterns, **{w.pattern.name: w.pattern for w in weighed}}
        out.candidates = {**self.candidates, **{w.pattern.name: candidate(w, log_price) for w in weighed}}
        return out._anew()

    def scattered(self, name: str, changes: Array) -> Self:
        """The same recordings about these changes of a number, by which they differ without order."""
        from jumpvision.engine.vary.variables import added

        out = copy.copy(self)
        out.always = added(self.always, {name: changes})
        out.scattering = (*self.scattering, name)
        return out._anew()

    def at_common(self) -> Self:
        """The same recordings with one value for all of what scatters."""
        out = copy.copy(self)
        out.always = {}
        return out._anew()

    def _anew(self) -> Self:
        """With no memory of where predictions ended; the runs are kept."""
        self.settled, self.starts = {}, {}
        return self

    def remembering(self, other: Studied) -> Self:
        """With the runs of another system of the same study and recordings."""
        self.points = other.points
        return self

    def changes(self, mechanisms: Sequence[str], values: Mapping[str, float]) -> Changes:
        """Of each recording's own: what is always so, and the patterns among the mechanisms."""
        if not (self.always or self.patterns):
            return {}
        from jumpvision.engine.vary.candidates import changes_of
        from jumpvision.engine.vary.variables import added

        return added(self.always, changes_of(self.patterns, mechanisms, values, len(self.recordings)))

    def predict(self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: Sequence[int]) -> list[Array]:
        """Readings of these recordings, from the starts that suit each best; NaN where a run is to be avoided."""
        return self.predict_apart(mechanisms, values, {}, which)

    def predict_apart(
        self, mechanisms: tuple[str, ...], values: Mapping[str, float], changes: Changes, which: Sequence[int]
    ) -> list[Array]:
        """`predict` with a change of each recording's own, beside those of the patterns among the mechanisms."""
        if (asked := self.call_of(mechanisms, values)) is None:
            return [np.full(self.observations[i].t.size, np.nan) for i in which]
        trial, changes = bool(changes), self._with(self.changes(mechanisms, values), changes)
        try:
            found = self._found(asked, mechanisms, values, which, changes)
        except SimulatorError:
            if not trial:
                raise
            return [np.full(self.observations[i].t.size, np.nan) for i in which]  # none that was asked for
        return [
            self._reported(i, self._turned(i, found[i][0].y, mechanisms, values) + found[i][1], changes) for i in which
        ]

    def predict_commanded(
        self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: int, like: int
    ) -> Array:
        """Readings of a recording with the inputs of another; NaN where these are of another length or fail."""
        mine, other, none = (
            self.recordings[which],
            self.recordings[like],
            np.full(self.observations[which].t.size, np.nan),
        )
        series = any(np.ndim(x) and len(x) == other.t.size for x in other.inputs.values())  # type: ignore[arg-type]
        if (asked := self.call_of(mechanisms, values)) is None or (series and mine.t.size != other.t.size):
            return none
        function, x = asked
        changes = self.changes(mechanisms, values)
        x = self._point(which, function, self._moved(which, x, changes), mechanisms)
        try:
            y = self.runs.many([Ask(function, which, self.given(x), like)])[0]
        except SimulatorError:
            return none
        return self._reported(which, self._turned(which, y, mechanisms, values), changes)

    @staticmethod
    def _with(own: Changes, changes: Changes) -> Changes:
        if not (own and changes):
            return own or changes
        from jumpvision.engine.vary.variables import added

        return added(own, changes)

    def _reported(self, i: int, y: Array, changes: Changes, zeros: bool = True) -> Array:
        """Readings (n,), or a change of them (without zeros), with the instruments' faults of this recording."""
        if not changes:
            return y
        from jumpvision.engine.vary.variables import faults_of, shown_each

        for c, unit in zip(self.study.channels, self.units):
            scale, zero = changes.get(f"scale of {c.name}"), changes.get(f"zero of {c.name}")
            if (scale is None and zero is None) or (block := self._block(i, c.name)) is None:
                continue
            y = y.copy()
            y[block] *= 1.0 if scale is None else 1.0 + float(scale[i])
            y[block] += 0.0 if zero is None or not zeros else float(zero[i]) / unit
        return shown_each(self.observations, [y], faults_of(changes), [i])[0]

    def _moved(self, i: int, x: Array, changes: Changes) -> Array:
        """The simulator's parameters with those of this recording that are its own, within what is possible."""
        x, names = x.copy(), list(self.rest)
        variables = self.variables if changes else {}
        for n, c in changes.items():
            if n in self.rest and n in variables and c[i]:
                k = names.index(n)
                x[k] = x[k] * (1.0 + float(c[i])) if variables[n].relative else x[k] + float(c[i])
        return x

    def _found(
        self,
        asked: tuple[int, Array],
        mechanisms: tuple[str, ...],
        values: Mapping[str, float],
        which: Sequence[int],
        changes: Changes,
    ) -> dict[int, tuple[_Point, Array | float]]:
        """The run of each recording from the start that suits it, and the small change of its readings that is left."""
        function, x = asked
        key = (function, mechanisms, tuple(sorted(values.items())))
        own = {i: self._moved(i, x, changes) for i in which}
        known = {
            i: self.settled[i, own[i].tobytes(), *key] for i in which if (i, own[i].tobytes(), *key) in self.settled
        }
        at = {i: self._point(i, function, own[i], mechanisms) for i in which if i not in known}
        if self.each:
            at = {i: self._foreseen(i, function, full, mechanisms, values) for i, full in at.items()}
        found = dict(zip(at, self._run([(i, function, full) for i, full in at.items()])))
        left = self._settle(found, function, mechanisms, values) if self.each and found else {}
        new = {i: (p, left.get(i, 0.0)) for i, p in found.items()}
        self.settled |= {(i, own[i].tobytes(), *key): p for i, p in new.items()}
        return known | new

    def _point(self, i: int, function: int, x: Array, mechanisms: tuple[str, ...]) -> Array:
        _, own = self.starts.get((i, mechanisms)) or self.starts.get((i, ())) or (math.inf, self.first[i])
        return np.concatenate([x, own])

    def _foreseen(
        self, i: int, function: int, x: Array, mechanisms: tuple[str, ...], values: Mapping[str, float]
    ) -> Array:
        """x with what the recording has for itself as it will fit best, linearly from a point nearby."""
        own = list(range(len(self.rest), len(self.names)))
        donor = self._donor(i, function, x, own)
        if donor is None:
            return x
        first, sigma = len(self.rest), np.array(list(self.scatter_sigma.values()))
        shift = x - donor.x
        there = donor.y + sum(donor.columns[k] * shift[k] for k in np.flatnonzero(shift).tolist())
        step = self._best_step(i, x, there, [donor.columns[k] for k in own], mechanisms, values)[0]
        return np.concatenate([x[:first], x[first:] + sigma * step])

    def _best_step(
        self,
        i: int,
        x: Array,
        y: Array,
        columns: Sequence[Array],
        mechanisms: tuple[str, ...],
        values: Mapping[str, float],
    ) -> tuple[Array, Array, Array, Array]:
        """(step of what the recording has for itself [sigma], whitened residual, whitened columns, columns)."""
        first, sigma = len(self.rest), np.array(list(self.scatter_sigma.values()))
        r = self._whitened(i, self.observations[i].y - self._turned(i, y, mechanisms, values))
        small = np.stack([self._turned(i, c, mechanisms, values, False) for c in columns], axis=1) * sigma
        j = self._whitened(i, small)
        off = (x[first:] - self.first[i]) / sigma
        if not (np.all(np.isfinite(r)) and np.all(np.isfinite(j))):
            return np.zeros(sigma.size), r, j, small
        rows, wanted = np.vstack([j, np.eye(sigma.size)]), np.concatenate([r, -off])
        return np.clip(np.linalg.lstsq(rows, wanted, rcond=None)[0], -LEAP, LEAP), r, j, small

    def _settle(
        self, found: dict[int, _Point], function: int, mechanisms: tuple[str, ...], values: Mapping[str, float]
    ) -> dict[int, Array]:
        """Move what each recording has for itself to where it fits best, by Gauss-Newton; the change of the readings
        (n,) that is left to it, which is small and linear."""
        first, sigma = len(self.rest), np.array(list(self.scatter_sigma.values()))
        open_, left = set(found), {}
        for _ in range(4):  # rounds that fit what each recording has for itself
            places = list(range(first, len(self.names)))
            columns = self._columns(found, function, sorted(open_), places)
            moved = {}
            for i in sorted(open_):
                p = found[i]
                if not np.all(np.isfinite(p.y)):
                    continue
                step, r, j, small = self._best_step(i, p.x, p.y, columns[i], mechanisms, values)
                # a change of less than 0.3 noise units, or of so little of the misfit, is taken as linear
                if float(np.linalg.norm(j @ step)) > max(0.3, 0.03 * float(np.linalg.norm(r))):
                    moved[i] = np.concatenate([p.x[:first], p.x[first:] + sigma * step])
                left[i] = small @ step
            open_ = set(moved)
            if not open_:
                break
            again = self._run([(i, function, x) for i, x in moved.items()])
            for i, p in zip(list(moved), again):
                if self._misfit(i, p, mechanisms, values) < self._misfit(i, found[i], mechanisms, values):
                    found[i] = p
                else:  # no way on: it stays where it is
                    open_.discard(i)
                    left.pop(i)
        for i in open_:
            left.pop(i)  # not known at the last point
        for i, p in found.items():
            if (chi2 := self._misfit(i, p, mechanisms, values)) < self.starts.get((i, mechanisms), (math.inf,))[0]:
                self.starts[i, mechanisms] = chi2, p.x[first:]
        return left

    def _misfit(self, i: int, p: _Point, mechanisms: tuple[str, ...], values: Mapping[str, float]) -> float:
        """chi^2 of a recording and of how far its own parameters are off; inf where a run failed."""
        if not np.all(np.isfinite(p.y)):
            return math.inf
        r = self._whitened(i, self.observations[i].y - self._turned(i, p.y, mechanisms, values))
        off = (p.x[len(self.rest) :] - self.first[i]) / np.array(list(self.scatter_sigma.values()))
        return float(r @ r + off @ off)

    def scatter(
        self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: Sequence[int]
    ) -> dict[str, list[Array]]:
        """d(reading)/d(what each recording has for itself)."""
        if (asked := self.call_of(mechanisms, values)) is None:
            return {}
        changes = self.changes(mechanisms, values)
        found = {i: p for i, (p, _) in self._found(asked, mechanisms, values, which, changes).items()}
        places = list(range(len(self.rest), len(self.names)))
        columns = self._columns(found, asked[0], list(which), places) if places else {}
        out = {
            p.name: [
                self._reported(i, self._turned(i, columns[i][k], mechanisms, values, False), changes, False)
                for i in which
            ]
            for k, p in enumerate(self.each)
        }
        for n in self.scattering:
            out[n] = [self._own(i, n, asked[0], found, mechanisms, values, changes) for i in which]
        return out

    def _own(
        self,
        i: int,
        name: str,
        function: int,
        found: Mapping[int, _Point],
        mechanisms: tuple[str, ...],
        values: Mapping[str, float],
        changes: Changes,
    ) -> Array:
        """d(reading)/d(change of a number in a recording): by the derivative of the simulator; without a run where it
        is the instrument's."""
        if name in self.rest:
            k = list(self.rest).index(name)
            column = self._columns({i: found[i]}, function, [i], [k])[i][0]
            size = found[i].x[k] / (1.0 + self._change(name, i, changes)) if self.variables[name].relative else 1.0
            return size * self._reported(i, self._turned(i, column, mechanisms, values, False), changes, False)
        from jumpvision.engine.vary.apart import variables

        step, none = variables(self)[name].step, np.zeros(len(self.recordings))
        y = self._turned(i, found[i].y, mechanisms, values)
        ends = [self._reported(i, y, self._with(changes, {name: none + s * step})) for s in (1.0, -1.0)]
        return np.asarray((ends[0] - ends[1]) / (2.0 * step))

    def _coefficients(self, mechanisms: Sequence[str]) -> dict[str, tuple[str, Array]]:
        """Of the patterns among the mechanisms: (number, design (N,)) by the name of the parameter."""
        chosen = {m: self.patterns[m] for m in mechanisms if m in self.patterns}
        if not chosen:
            return {}
        from jumpvision.engine.vary.candidates import coefficient

        each = [
            (coefficient(m, k), v.name, p.design[:, k]) for m, p in chosen.items() for k, v in enumerate(p.variables)
        ]
        return {c: (name, column) for c, name, column in each}

    def _change(self, name: str, i: int, changes: Changes) -> float:
        return float(changes[name][i]) if name in changes else 0.0

    def derivatives(
        self, mechanisms: tuple[str, ...], free: Sequence[Parameter], values: Mapping[str, float], which: Sequence[int]
    ) -> list[Array]:
        """d(reading)/d(parameter) (n, k); laws of the instruments need no run, nor do coefficients of patterns where
        the number is fitted."""
        asked = self.call_of(mechanisms, values)
        assert asked is not None
        changes = self.changes(mechanisms, values)
        found = {i: p for i, (p, _) in self._found(asked, mechanisms, values, which, changes).items()}
        inside = [p.name for p in free if p.name in self.rest]
        columns = self._columns(found, asked[0], list(which), [self.names.index(n) for n in inside])
        coefficients = self._coefficients(mechanisms)
        variables, out = self.variables if changes else {}, []
        for i in which:
            here = dict(zip(inside, columns[i]))
            turned = []
            for p in free:
                if p.name in coefficients:
                    n, design = coefficients[p.name]
                    own = self._own(i, n, asked[0], found, mechanisms, values, changes) if design[i] else 0.0
                    turned.append(design[i] * own + np.zeros(self.observations[i].t.size))
                elif p.name in here:
                    y = self._turned(i, here[p.name], mechanisms, values, False)
                    if p.name in variables and variables[p.name].relative:
                        y = y * (1.0 + self._change(p.name, i, changes))
                    turned.append(self._reported(i, y, changes, False))
                else:
                    y = self._instrument(i, found[i].y, p, mechanisms, values)
                    turned.append(self._reported(i, y, changes, False))
            out.append(np.nan_to_num(np.stack(turned, axis=1)))
        return out

    def scouts(self, which: Sequence[int]) -> Sequence[int]:
        """The first, and those evenly after it."""
        # first values are compared over two recordings
        return [which[k] for k in np.unique(np.linspace(0, len(which) - 1, 2).round().astype(int))]

    @property
    def rough(self) -> bool:
        """Whether the simulator moves in steps, or with noise of its own, as what all recordings share is changed."""
        return bool(set(self.probed.steps) - {p.name for p in self.each})

    @contextmanager
    def carefully(self, fine: bool = False) -> Iterator[None]:
        """Within it derivatives are of their own point, or handed on once from close by. fine: over the usual short
        steps, where the simulator is rough too."""
        before, self.careful, self.fine = (self.careful, self.fine), True, fine
        if fine:
            self._forget()
        try:
            yield
        finally:
            self.careful, self.fine = before
            if fine:
                self._forget()

    def _forget(self) -> None:
        """The derivatives; the runs that they came from are kept."""
        self.donors.clear()
        for p in self.points.values():
            p.columns.clear()
            p.age.clear()

    def _run(self, wanted: Sequence[tuple[int, int, Array]]) -> list[_Point]:
        """The runs (recording, function, x) as points of the memory."""
        keys = [(i, function, x.tobytes()) for i, function, x in wanted]
        new = {k: w for k, w in zip(keys, wanted) if k not in self.points}
        asked = [Ask(f, i, self.given(x)) for i, f, x in new.values()]
        for (key, (_, _, x)), y in zip(new.items(), self.runs.many(asked)):
            self.points[key] = _Point(x, y)
        return [self.points[k] for k in keys]

    def given(self, x: Array) -> dict[str, float]:
        """What a run is made with: parameters, and factors on inputs that are not as they are given."""
        return {n: v for n, v in zip(self.names, x.tolist()) if not (n in self.inputs and v == 1.0)}

    def _columns(
        self, found: Mapping[int, _Point], function: int, which: Sequence[int], places: Sequence[int]
    ) -> dict[int, list[Array]]:
        """d(values)/d(x[place]) (n, channels) at the points found: remembered, handed on, or by differences."""
        wanted, steps, lacking = [], [], {}
        for i in which:
            here = found[i]
            missing = [k for k in places if k not in here.columns or here.age[k] > self._oldest]
            if not np.all(np.isfinite(here.y)):
                here.columns.update({k: np.zeros_like(here.y) for k in missing})
                missing = []
            if missing:
                missing = self._handed_on(i, function, here, missing)
            lacking[i] = missing
        self._own_slopes(found, function, lacking)
        for i, missing in lacking.items():
            here = found[i]
            for k in missing:
                for h in self._steps(k, here.x[k]):
                    x = here.x.copy()
                    x[k] += h
                    wanted.append((i, function, x))
                    steps.append((here, k))
        ends: dict[tuple[int, int], list[_Point]] = {}
        for (here, k), there in zip(steps, self._run(wanted)):
            ends.setdefault((id(here), k), []).append(there)
        for here, k in {(id(h), k): (h, k) for h, k in steps}.values():
            here.columns[k], here.age[k] = _slope(here, k, ends[id(here), k]), 0
        for i in which:
            if (near := self.donors.setdefault((i, function), [])) and near[-1] is found[i]:
                continue
            near.append(found[i])
        return {i: [found[i].columns[k] for k in places] for i in which}

    def _own_slopes(self, found: Mapping[int, _Point], function: int, lacking: dict[int, list[int]]) -> None:
        """The function's own derivatives in the place of differences, where they were found right."""
        exact = {k for k, n in enumerate(self.names) if n in self.probed.exact} if function == 0 else set()
        which = [i for i, missing in lacking.items() if exact & set(missing)]
        asked = [Ask(0, i, self.given(found[i].x)) for i in which]
        for i, given in zip(which, self.runs.slopes(asked) if asked else ()):
            here, had = found[i], [k for k in lacking[i] if k in exact and self.names[k] in given]
            here.columns.update({k: given[self.names[k]] for k in had})
            here.age.update(dict.fromkeys(had, 0))
            lacking[i] = [k for k in lacking[i] if k not in had]

    def _steps(self, k: int, value: float) -> tuple[float, ...]:
        """Steps of a difference: one, away from the upper end of the range; both ways where the simulator is rough."""
        high, low = self.tops.get(self.names[k], math.inf), self.bottoms.get(self.names[k], -math.inf)
        if not self.fine and (wide := self.probed.steps.get(self.names[k])) is not None:
            ways = tuple(h for h in (wide, -wide) if low <= value + h <= high)
            return ways or ((high - value,) if high - value > value - low else (low - value,))
        h = self.study.step * float(self.scales[k])
        return (-h,) if value + h > high else (h,)

    def _handed_on(self, i: int, function: int, here: _Point, missing: list[int]) -> list[int]:
        """Take derivatives over from the nearest point that foretells this one; those that no point can give. What does
        nothing there, as a phase where the amplitude is 0, may do much here."""
        if (donor := self._donor(i, function, here.x, missing, here)) is None:
            return missing
        shift = here.x - donor.x
        change = here.y - donor.y
        left = change - sum(donor.columns[k] * shift[k] for k in np.flatnonzero(shift).tolist())
        size, all_of_it = self._size(i, left), self._size(i, change)
        # a linear prediction may miss a tenth of a change, or half a noise unit; near a minimum less
        share, least = (0.03, 0.3) if self.careful else (0.1, 0.5)
        if not size <= max(share * all_of_it, least):
            return missing
        scaled, idle = shift / self.scales, [k for k in missing if not donor.columns[k].any()]
        for k in set(missing) - set(idle):
            update = left * (scaled[k] / self.scales[k] / float(scaled @ scaled))
            here.columns[k], here.age[k] = donor.columns[k] + update, donor.age[k] + 1
        return idle

    @property
    def _oldest(self) -> int:
        """Times that a derivative may have been handed on."""
        return 1 if self.careful else OLD

    def _donor(
        self, i: int, function: int, x: Array, wanted: Sequence[int], but: _Point | None = None
    ) -> _Point | None:
        """The nearest point that has the derivatives wanted, and those along the way to x."""
        best: tuple[float, _Point] | None = None
        for p in self.donors.get((i, function), ()):
            away = np.abs(x - p.x) / self.scales
            # a derivative from more than three scales off does not serve
            if p is but or away.max() > 3.0 or any(k not in p.columns for k in np.flatnonzero(away)):
                continue
            if all(p.age.get(k, OLD) < self._oldest for k in wanted) and (best is None or away.max() < best[0]):
                best = (float(away.max()), p)
        return None if best is None else best[1]

    def _size(self, i: int, y: Array) -> float:
        """Length of a change of the values (n, channels) in noise units."""
        return float(np.linalg.norm(self._whitened(i, self._flat(i, y))))

    def _whitened(self, i: int, r: Array) -> Array:
        """Columns of an observation (n,) or (n, k) as independent numbers of unit variance."""
        return self.white[i].whitened(r, self.steady[i])

    def _flat(self, i: int, y: Array) -> Array:
        """Values (n, channels) as the readings of an observation, one channel after the other."""
        mask = self.masks[i]
        each = [y[mask[:, k], k] / u for k, u in enumerate(self.units) if mask[:, k].sum() >= 2]
        return np.concatenate(each)

    def _turned(
        self, i: int, y: Array, mechanisms: Sequence[str], values: Mapping[str, float], zeros: bool = True
    ) -> Array:
        """Values (n, channels), or a change of them (without zeros), as the instruments show them."""
        own = {p.name for p in self.baseline} | {p.name for m in mechanisms for p in self.candidates[m].parameters}
        shown, t = y, self.recordings[i].t
        for k, c in enumerate(self.study.channels):
            law = {n: values.get(c.name_of(n), v[0]) if c.name_of(n) in own else v[0] for n, v in self.laws[k].items()}
            if any(x != self.laws[k][n][0] for n, x in law.items()):
                shown = shown.copy() if shown is y else shown
                late = law.get("delay", 0.0) - law.get("rate", 0.0) * (t - t[0])
                shown[:, k] = law.get("scale", 1.0) * later(t, y[:, k], late) + zeros * law.get("zero", 0.0)
        return self._flat(i, shown)

    def _instrument(
        self, i: int, y: Array, p: Parameter, mechanisms: Sequence[str], values: Mapping[str, float]
    ) -> Array:
        """d(reading)/d(a parameter that the simulator does not have)."""
        h = self.study.step * p.scale
        at = values.get(p.name, p.start)
        ends = [self._turned(i, y, mechanisms, {**values, p.name: at + s * h}) for s in (1.0, -1.0)]
        return (ends[0] - ends[1]) / (2.0 * h)


def _slope(here: _Point, k: int, ends: Sequence[_Point]) -> Array:
    """d(values)/d(x[k]) by the runs at one side or at both."""
    if len(ends) == 2:
        return np.asarray((ends[0].y - ends[1].y) / (ends[0].x[k] - ends[1].x[k]))
    return np.asarray((ends[0].y - here.y) / (ends[0].x[k] - here.x[k]))


def circumstances(recordings: Sequence[Recording]) -> list[Circumstances]:
    """When, by whom and with what each was recorded; ordered by time where no order is given."""
    timed = places({str(i): t for i, r in enumerate(recordings) if (t := r.time) is not None})
    given = any(r.order is not None for r in recordings)
    out = []
    for i, r in enumerate(recordings):
        order = r.order if given else timed.get(str(i))
        source = r.source or f"`{'order' if given else 'recorded'}` of the recordings"
        labels = {n: x if isinstance(x, str) else float(x) for n, x in r.labels.items() if isinstance(x, str | Real)}
        out.append(Circumstances(order, r.time, r.session or None, labels, "" if order is None else source))
    return out


def _start(start: object, recording: Recording) -> float:
    return float(start(recording)) if callable(start) else float(start)  # type: ignore[arg-type]


def later(t: Array, y: Array, delay: float | Array) -> Array:
    """y (n,) a delay [s], one or (n,), later."""
    if not np.any(delay) or not np.all(np.isfinite(y)):
        return y
    return at_times(t, y, t - delay)


def thirds(t: Array) -> Array:
    """The names of the thirds of a record, for where a misfit is."""
    names = np.array(["first third", "second third", "last third"])
    place = np.minimum((3 * (t - t[0]) / (t[-1] - t[0])).astype(int), 2)
    return np.asarray(names[place])
