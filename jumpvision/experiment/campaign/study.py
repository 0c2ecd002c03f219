"""A user's own simulator questioned: from recordings and a study to the same Diagnosis as a campaign of jumps gives."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace

import numpy as np

from jumpvision.base.schema import InputError, read
from jumpvision.engine.diagnose import Findings, diagnose, fit_baseline
from jumpvision.engine.fitting import Fit, Problem
from jumpvision.engine.naming import Explanation
from jumpvision.engine.study.learn import Readings, learn_readings
from jumpvision.engine.study.processes import How, described
from jumpvision.engine.study.runs import BudgetUsed, Runs
from jumpvision.engine.study.study import Recording, Study
from jumpvision.engine.study.system import DUMMY, Studied
from jumpvision.engine.study.walk import with_walks
from jumpvision.engine.worth.gain import FEW_GROUPS
from jumpvision.experiment.inputs.experiment import Campaign
from jumpvision.experiment.inputs.parameters import SimulateParams
from jumpvision.experiment.inputs.sections import Actuation, Motor, MotorLog
from jumpvision.experiment.results import findings as record
from jumpvision.experiment.results.diagnosis import Diagnosis
from jumpvision.experiment.results.findings import Trace
from jumpvision.experiment.results.tables import RodMotion
from jumpvision.experiment.stages.simulate import driver
from jumpvision.experiment.workflow.run import Outcome
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.jumper.physics.forcing import Loop

from .findings import Teller, agreement, interval, told
from .jumps import states_noise

SEED = 1  # of the simulated noise: the same data give the same answer


def question_study(recordings: Sequence[Recording], study: Study | None, how: How) -> Diagnosis:
    """What the simulator gets wrong on these recordings. Raises InputError for what cannot be questioned.

    study: None where how.source names one that only another process may import.
    """
    if problems := recordings_problems(recordings):
        raise InputError(problems)
    study = described(how.source, recordings) if study is None else study
    readings = learn_readings(study, recordings)
    runs = Runs(study, recordings, how)
    try:
        system = Studied(study, recordings, readings, runs)
        system.predict((), {p.name: p.start for p in system.baseline}, range(len(recordings)))
        if runs.count.failures:  # what the user himself gave must work, whatever may be avoided later
            raise runs.count.failures[0]
        if any(c.process for c in study.channels):
            problem = Problem(system, readings.noise, system.scatter_sigma)
            readings = with_walks(system, fit_baseline(problem, np.random.default_rng(SEED)))
            system = Studied(study, recordings, readings, runs)
        so_far: list[Findings] = []
        try:
            found, stopped = _asked(system, how, so_far.append), ""
        except BudgetUsed as e:
            if not so_far:
                raise
            found, stopped = so_far[-1], e.problems[0]
        return document(found, system, readings, stopped)
    finally:
        runs.close()


def _asked(system: Studied, how: How, known: Callable[[Findings], None]) -> Findings:
    return diagnose(
        system,
        system.readings.noise,
        np.random.default_rng(SEED),
        scatter=system.scatter_sigma,
        by=("kind",),
        say=how.progress or (lambda text: None),
        known=known,
    )


FINE = 4  # values of the motor's position a frame


def recordings_of(campaign: Campaign, outcomes: Mapping[str, Outcome]) -> list[Recording]:
    """The tracks of a campaign's jumps as recordings of a simulator that is not ours.

    values: height above rest [m]; inputs: motor_time_s, motor_m, motor_stop_s where a motor is known, and every section
    of the experiment by name ("robot", "bed", ...) as a dict; labels: kind, frequency, delay, volume_fraction.
    Raises InputError where no experiment has a track.
    """
    out = []
    for e in campaign.experiments:
        outcome = outcomes.get(e.name)
        if outcome is None or not (outcome.results / RodMotion.file).exists():
            continue
        t, y, sigma = RodMotion.load(outcome.results).arrays
        law, log, motor = e.section(Actuation), e.section(MotorLog), e.section(Motor)
        inputs: dict[str, object] = {n: asdict(x) for n, x in e.sections.items()}
        if (law and law.moves) or log:
            p, _ = read(SimulateParams, e.params.get("simulate", {}), "")
            with warnings.catch_warnings():
                warnings.simplefilter("ignore", StageWarning)  # said by the stage `simulate`
                forcing, stop = driver(log, law, motor, p or SimulateParams(), sand=e.ground == "granular")
            inputs["motor_stop_s"] = stop
            if not isinstance(forcing, Loop):
                fine = np.linspace(t[0], t[-1], FINE * (t.size - 1) + 1)
                inputs |= {"motor_time_s": fine, "motor_m": forcing(fine)[0]}
        labels: dict[str, str | float | None] = {"kind": law.kind if law else "logged_motion"}
        labels |= {"frequency": law.frequency, "delay": law.delay} if law else {}
        group = e.header.group or e.name
        known = sigma if states_noise(e) else None
        out.append(Recording(e.name, t, y, inputs, labels, group, sigma=known))
    if not out:
        raise InputError(
            [f"{campaign.path}: no experiment has a track ([rod_video] or [rod_track]): nothing to diagnose"]
        )
    return out


def recordings_problems(recordings: Sequence[Recording]) -> list[str]:
    """What is wrong with a set of recordings."""
    if not recordings:
        return ["no recordings: give a list of Recording"]
    if wrong := [r for r in recordings if not isinstance(r, Recording)]:
        return [f"recordings: {type(wrong[0]).__name__} is no Recording(name, t, values)"]
    names = [r.name for r in recordings]
    return [f"two recordings are called {n!r}" for n in dict.fromkeys(names) if names.count(n) > 1]


def document(d: Findings, system: Studied, readings: Readings, stopped: str = "") -> Diagnosis:
    """The record of the findings; keys that end in _m are in `unit`. stopped: why they are not all there could be."""
    best, count, channels = told(d), system.runs.count, system.study.channels
    out = replace(
        teller(system).record(d, best, noise_of(d, system, readings)),
        unexplained=record.Unexplained() if d.naming and not d.naming.named else None,
        unit=channels[0].unit or "1" if len(channels) == 1 else "noise",
        fitted=intervals(best, [p.name for p in best.parameters]),
        lacks={name: m.lacks for name, m in system.mechanisms.items()},
        runs=record.Runs(count.made, count.kept, count.seconds, tuple(str(f) for f in count.failures)),
    )
    if stopped:
        out = replace(out, status=out.status if out.named else "undetermined")
    out = replace(out, sentence=sentence(out, stopped))
    object.__setattr__(out, "traces", traces(d, system))
    return out


def teller(system: Studied) -> Teller:
    """How models of a user's simulator are told."""

    def model(fit: Fit) -> record.Model:
        values = {n: v for n, v in fit.named.items() if not n.startswith(DUMMY)}
        return record.Model((model_name(system), *fit.mechanisms), values)

    def own(e: Explanation, mechanism: str) -> dict[str, record.Parameter]:
        return intervals(e.fit, [p.name for p in system.candidates[mechanism].parameters])

    return Teller(system, model, own, heights=False)


def model_name(system: Studied) -> str:
    """What the simulator is called."""
    return system.study.name or getattr(system.study.simulate, "__name__", "simulate").strip("_")


def intervals(fit: Fit, names: Sequence[str]) -> dict[str, record.Parameter]:
    """Parameters by name with their 90 % intervals, without what does nothing."""
    return {p.name: interval(fit, p) for p in fit.parameters if p.name in names and not p.name.startswith(DUMMY)}


def noise_of(d: Findings, system: Studied, readings: Readings) -> record.Noise:
    """The noise by channel, with what a reader must be warned of."""
    channels = system.study.channels
    sources = {
        f"{c.name}: {how}" if len(channels) > 1 else how: record.NoiseSource(s.sigma, s.log_sigma, s.n)
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


def traces(d: Findings, system: Studied) -> tuple[Trace, ...]:
    """Measured, simulated and extended values of every channel of every recording, in its unit."""
    every, best = range(len(system.observations)), told(d)
    before = system.predict(d.baseline.mechanisms, d.baseline.named, every)
    after = system.predict(best.mechanisms, best.named, every)
    out = []
    for i, o in enumerate(system.observations):
        channels = [c for c, m in zip(system.study.channels, system.masks[i].T) if m.sum() >= 2]
        for c, b in zip(channels, o.blocks):
            unit = system.units[system.study.channels.index(c)]
            y = (o.y[b.readings] * unit, before[i][b.readings] * unit, after[i][b.readings] * unit)
            out.append(Trace(o.name, c.name, c.unit, o.t[b.readings], *y))
    return tuple(out)


def sentence(d: Diagnosis, stopped: str = "") -> str:
    """The verdict in plain words. stopped: what kept it from being whole."""
    unit = "" if d.unit in (None, "1") else f" {d.unit}"
    size = f"{d.baseline.rmse_track_m:.2g}" + (" times the noise" if d.unit == "noise" else unit)
    if d.adequate:
        return f"The simulation agrees with the recordings within their noise (p = {d.p_value:.2g})."
    lacks = d.lacks or {}
    text = f"The simulation misses the recordings by {size} rms"
    if stopped and not d.causes:
        return f"{text}; which mechanism it lacks is not known yet: {stopped}."
    if not d.named:
        text += ", and no mechanism of the study explains all that it gets wrong"
        if near := d.closest:
            text += f"; the closest, {words(near.mechanisms, lacks)}, leaves {near.rmse_track_m:.2g}"
            text += " times the noise" if d.unit == "noise" else unit
        return text + "."
    text += f" because it lacks {words(d.named, lacks)}"
    if d.indistinguishable:
        text += (
            f" (the data cannot tell apart: {'; '.join(' or '.join(lacks[m] for m in t) for t in d.indistinguishable)})"
        )
    if d.gain:
        it = "it" if len(d.named) == 1 else "them"
        text += f"; with {it} the error on recordings held out falls {d.gain.ratio:.3g}x"
        text += "" if math.isfinite(d.gain.ratio_ci95[1]) else f" ({FEW_GROUPS} groups are needed for its interval)"
    if d.status == "partial" and d.left_over:
        text += f"; {100 * d.left_over.share:.2g} % of the discrepancy (in chi^2) stays, beyond the noise"
    return text + (f"; not tried on recordings held out: {stopped}." if stopped else ".")


def words(mechanisms: Sequence[str], lacks: Mapping[str, str]) -> str:
    """What is lacking, in words."""
    return " and ".join(lacks.get(m, m.replace("_", " ")) for m in mechanisms)
