"""How a study and its models are told: its parameters, channels and runs, and the words of the verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

from jumpvision.base.numbers import said
from jumpvision.engine.document import values as record
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.document.document import agreement, interval
from jumpvision.engine.document.words import Words
from jumpvision.engine.fitting import Fit, Problem
from jumpvision.engine.naming import widened
from jumpvision.engine.order import Findings

from .system import DUMMY, Studied

MISSES = 4.0  # standard deviations of chi^2, from which a fit misses more than noise
SEVERAL = "noise"  # the unit of several channels: each in its own
CALLED = {  # what the readings of a recording may have wrong
    "scale": "the scale of the readings",
    "clock_offset": "the offset of the clock",
    "clock_rate": "the rate of the clock",
    "lost_frames": "the count of lost samples",
}


@dataclass(frozen=True)
class StudySpeaker:
    """A study as the document has it; keys that end in _m are in `unit`. alone: the model that is told, fitted without
    what was measured beside the recordings; None where nothing was."""

    system: Studied
    alone: Fit | None = None
    doubts: tuple[record.Doubt, ...] = ()
    simulated: tuple[record.Simulated, ...] = ()
    prediction: record.Prediction | None = None
    heights: ClassVar[bool] = False

    def model(self, fit: Fit) -> record.Model:
        own = self._of_recordings
        values = {n: v for n, v in fit.named.items() if not n.startswith(DUMMY) and n not in own}
        mechanisms = (m for m in fit.mechanisms if m not in self.system.patterns)
        return record.Model((model_name(self.system), *mechanisms), values)

    @property
    def _of_recordings(self) -> set[str]:
        """Parameters by which recordings differ: `varies` tells them."""
        if not self.system.patterns:
            return set()
        from jumpvision.engine.vary.candidates import coefficients_of

        return coefficients_of(self.system.patterns)

    def parameters(self, fit: Fit, mechanism: str) -> dict[str, record.Parameter]:
        return intervals(self.system, fit, [p.name for p in self.system.candidates[mechanism].parameters])

    def noise(self, d: Findings) -> record.Noise:
        return noise_of(d, self.system)

    def completed(self, data: Diagnosis, d: Findings) -> Diagnosis:
        """The record with unit, fitted parameters, words and runs, what else was measured, the next experiment."""
        from jumpvision.engine.document.measured import confirmations

        count, channels = self.system.runs.count, self.system.study.channels
        alone = self.alone
        units = {p.name: (p.start, p.unit or "1") for p in alone.parameters} if alone else {}
        rows = confirmations(alone, self.system.study.measured, units) if alone else []
        apart = alone is not None and any(r.contradicts for r in rows)
        left = data.left_over
        if left is not None and left.look_at:
            from .left import where_left

            left = replace(left, where=where_left(self.system, d.best))
        return replace(
            data,
            left_over=left,
            next_experiment=self._proposal(d),
            confirmation=tuple(rows),
            without_films=record.WithoutFilms(alone.named, alone.chi2) if alone and apart else None,
            unit=channels[0].unit or "1" if len(channels) == 1 else SEVERAL,
            fitted=intervals(self.system, d.best, [n for n in d.best.named if n not in self._of_recordings]),
            correlations=correlations(d.best, [n for n in d.best.named if n not in self._of_recordings]),
            lacks={name: m.lacks for name, m in self.system.mechanisms.items()},
            doubts=self.doubts,
            simulated=self.simulated,
            prediction=self.prediction,
            runs=record.Runs(count.made, count.kept, count.seconds, tuple(str(f) for f in count.failures)),
        )

    def _proposal(self, d: Findings) -> record.NextExperiment | None:
        """The inputs that would tell most."""
        if (p := d.next_experiment) is None:
            return None
        inputs = {n: float(p.labels[n]) for n in self.system.study.inputs}
        return record.NextExperiment(str(p.labels["kind"]), None, None, p.separates, p.expected_log10_odds, inputs)

    def words(self, data: Diagnosis) -> Words:
        lacks = data.lacks or {}
        unit = " times the noise" if data.unit == SEVERAL else "" if data.unit in (None, "1") else f" {data.unit}"

        def size(x: float) -> str:
            return f"{said(x, '.2g')}{unit}"

        misses = f"The simulation misses the recordings by {size(data.baseline.rmse_track_m)} rms"
        quantities = CALLED | {n: f"the {n}" for n in self.system.inputs}
        quantities |= {p.name: p.words for p in self.system.study.parameters if p.words}
        return Words(misses, size, lacks=lacks, called=lacks, quantities=quantities)


def model_name(system: Studied) -> str:
    """What the simulator is called."""
    return system.study.name or getattr(system.study.simulate, "__name__", "simulate").strip("_")


def intervals(system: Studied, fit: Fit, names: Sequence[str]) -> dict[str, record.Parameter]:
    """Parameters by name with their 90 % intervals, wider where the fit misses, without what does nothing."""
    n = sum(o.t.size for o in system.observations)
    if fit.chi2 > n + MISSES * math.sqrt(2.0 * n):
        fit, _ = widened(system, fit)
    return {p.name: interval(fit, p) for p in fit.parameters if p.name in names and not p.name.startswith(DUMMY)}


def correlations(fit: Fit, names: Sequence[str]) -> dict[str, dict[str, float]]:
    """Of the errors of parameters, each with each; without what does nothing or is known exactly."""
    size = [math.sqrt(max(float(v), 0.0)) for v in fit.covariance.diagonal()]
    told = [(k, p.name) for k, p in enumerate(fit.parameters) if p.name in names and not p.name.startswith(DUMMY)]
    known = [(k, n) for k, n in told if size[k] > 0.0]
    return {n: {m: float(fit.covariance[k, j] / (size[k] * size[j])) for j, m in known} for k, n in known}


def rms_by_channel(system: Studied, fit: Fit) -> dict[str, float]:
    """Root mean square of measured minus simulated, open loop, in each channel's unit."""
    total: dict[str, list[float]] = {}
    predicted = system.predict(fit.mechanisms, fit.named, range(len(system.observations)))
    for i, (o, y) in enumerate(zip(system.observations, predicted)):
        channels = [c for c, m in zip(system.study.channels, system.masks[i].T) if m.sum() >= 2]
        for c, b in zip(channels, o.blocks):
            off = (o.y - y)[b.readings] * system.units[system.study.channels.index(c)]
            total.setdefault(c.name, []).extend((off * off).tolist())
    return {n: math.sqrt(sum(x) / len(x)) for n, x in total.items()}


def simulated(system: Studied, problem: Problem, fits: Sequence[Fit]) -> list[record.Simulated]:
    """Every model as its own fit simulates it."""
    by = record.ByFit.PROCESS if any(c.process for c in system.study.channels) else record.ByFit.NOISE
    out = []
    for f in fits:
        n = max(problem.n - len(f.parameters), 1)
        parameters = intervals(system, f, list(f.named))
        out.append(record.Simulated(f.mechanisms, by, f.chi2 / n, rms_by_channel(system, f), parameters))
    return out


def noise_of(d: Findings, system: Studied) -> record.Noise:
    """The noise by channel, with what a reader must be warned of."""
    channels, readings = system.study.channels, system.readings
    sources = {
        f"{c.name}: {how}" if len(channels) > 1 else how: s
        for c, of in zip(channels, readings.sources)
        for how, s in of.items()
    }
    first = readings.channels[0]
    return record.Noise(
        sigma_m=first.s if len(channels) == 1 else 1.0,
        correlation=first.rho,
        tails=None,
        drift_m=first.drift if len(channels) == 1 else math.nan,
        samples=sum(o.t.size for o in system.observations),
        sources=sources,
        scatter=system.scatter_sigma,
        tracks={c.name: n.s for c, n in zip(channels, readings.channels)} if len(channels) > 1 else {},
        outliers=(),
        warnings=(*readings.warnings, *(() if any(c.process for c in channels) else agreement(d))),
    )


def traces(d: Findings, system: Studied) -> tuple[record.Trace, ...]:
    """Measured, simulated and extended values of every channel of every recording, in its unit."""
    every, best = range(len(system.observations)), d.best
    before = system.predict(d.baseline.mechanisms, d.baseline.named, every)
    after = system.predict(best.mechanisms, best.named, every)
    out = []
    for i, o in enumerate(system.observations):
        channels = [c for c, m in zip(system.study.channels, system.masks[i].T) if m.sum() >= 2]
        for c, b in zip(channels, o.blocks):
            unit = system.units[system.study.channels.index(c)]
            y = (o.y[b.readings] * unit, before[i][b.readings] * unit, after[i][b.readings] * unit)
            out.append(record.Trace(o.name, c.name, c.unit, o.t[b.readings], *y))
    return tuple(out)
