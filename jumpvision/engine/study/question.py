"""A user's own simulator questioned: from recordings and a study to the same Diagnosis as a campaign of jumps gives."""

from __future__ import annotations

import math
import time
import warnings
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from jumpvision.base.schema import InputError, StageWarning
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.document.document import LOOSE, document
from jumpvision.engine.document.values import Doubt, Prediction, Simulated, Status
from jumpvision.engine.fitting import Fit, Problem
from jumpvision.engine.order import Findings, Order, fit_baseline, silent
from jumpvision.engine.system import patterns_of
from jumpvision.engine.worth.gain import best_at_prediction, held_out_error
from jumpvision.estimate.readings import readings

from .learn import learn_readings
from .probe import probe
from .processes import How, described
from .runs import BudgetUsed, Runs
from .study import Recording, Study
from .system import Studied
from .words import StudySpeaker, intervals, simulated, traces

if TYPE_CHECKING:
    from jumpvision.engine.discovery import Laws

LOOKED, NAMED = 0.18, 0.85  # of all runs, made when causes are asked for and when they are named (foreign studies)
SEED = 1  # of the simulated noise: the same data give the same answer


class _Asked(Order):
    """The order in which a study is questioned: one law of no list that explains all recordings goes before what
    explains a part of them, recordings set aside, and numbers of single recordings that are less likely."""

    def explain(self, d: Findings) -> Findings:
        found = super().explain(d)
        laws, worth = self._laws, self._worth(d, found)
        if laws is None or worth == math.inf or not laws.explains(d.baseline):
            return found
        naming = self.name(d).naming
        assert naming is not None
        naming = replace(naming, named=(), status=Status.UNDETERMINED, twins=(), widened=1.0)
        law = laws.law(d.baseline, naming)
        if law is None or not law.found.sure:
            return found
        gained = law.fit.log_evidence - d.baseline.log_evidence - math.log(len(laws.library.forms))
        return replace(d, naming=naming, law=law) if gained > worth else found

    def _worth(self, d: Findings, found: Findings) -> float:
        """Nats that a law has to gain: those of numbers of single recordings that explain all; inf where none is
        asked for."""
        varies, naming = found.varies, found.naming
        if found.law or (found.adequate and not varies):
            return math.inf
        if varies and (varies.mistaken if varies.aside else naming and varies.slipped(naming.named)):
            return math.inf
        if naming is None or naming.status != Status.COMPLETE or (varies and varies.aside):
            return -math.inf
        problem = found.problem or self.problem
        if not set(naming.named) <= set(patterns_of(problem.system)):
            return math.inf
        from jumpvision.engine.vary.explain import gained

        return gained(problem, naming.best.fit, d.baseline)


def diagnose(recordings: Sequence[Recording], study: Study | None, how: How | None = None) -> Diagnosis:
    """What the simulator gets wrong on these recordings. Raises InputError for what cannot be questioned.

    study: None where how.source names one that only another process may import.
    """
    how = how or How()
    if problems := recordings_problems(recordings):
        raise InputError(problems)
    study = described(how.source, recordings) if study is None else study
    recordings, turned = as_read(study, recordings)
    runs = Runs(study, [*recordings, *_unmade(study, recordings)], how, turned)
    try:
        system = studied(study, recordings, runs)
        begun, steps = time.perf_counter(), list[tuple[str, int, float]]()

        def say(words: str) -> None:
            steps.append((words, runs.count.made, time.perf_counter() - begun))
            (how.progress or silent)(words)

        found, stopped = _asked(system, say)
        asked = found.problem.system if found.problem else system
        assert isinstance(asked, Studied)
        found, ridges = (found, ()) if stopped else _with_ridges(found, asked)
        alone = _alone(found, asked)
        shown, apart = _simulated(found, asked, whole=not stopped)
        stated = found.law.system if found.law else asked
        assert isinstance(stated, Studied)
        doubts = (*asked.probed.doubts, *ridges, *apart)
        prediction = None if stopped else _prediction(found, asked)
        data = document(found, StudySpeaker(stated, alone, doubts, shown, prediction), stopped)
        object.__setattr__(data, "traces", traces(found, stated))
        object.__setattr__(data, "search", tuple(steps))
        return data
    finally:
        runs.close()


def as_read(study: Study, recordings: Sequence[Recording]) -> tuple[list[Recording], frozenset[int]]:
    """The recordings with NaN where a channel holds no reading and turns undone, which is told; the turned channels."""
    out, turned = [], set[int]()
    for r in recordings:
        y = r.of_channels(r.values, study.channels).copy()
        for k, c in enumerate(study.channels):
            seen = readings(y[:, k])
            if not np.array_equal(seen.values, y[:, k], equal_nan=True):
                turned.add(k)
            y[:, k] = np.where(seen.kept, seen.values, math.nan)
            for d in seen.doubts:
                said = f"recording {r.name!r}: {c.name} {d.text}"
                warnings.warn(StageWarning("reading", said, "", d.values), stacklevel=3)
        out.append(replace(r, values=y))
    return out, frozenset(turned)


def studied(study: Study, recordings: Sequence[Recording], runs: Runs) -> Studied:
    """The system in question, with the noise of its channels. Raises InputError where the simulator fails as it is."""
    readings = learn_readings(study, recordings)
    system = Studied(study, recordings, readings, runs)
    system.predict((), {p.name: p.start for p in system.baseline}, range(len(recordings)))
    if runs.count.failures:  # what the user himself gave must work, whatever may be avoided later
        raise runs.count.failures[0]
    probed = probe(system)
    readings = readings.with_error(probed.error)
    system = Studied(study, recordings, readings, runs, probed).remembering(system)
    if not any(c.process for c in study.channels):
        return system
    from .walk import with_walks

    base = fit_baseline(problem_of(system), np.random.default_rng(SEED))
    return Studied(study, recordings, with_walks(system, base), runs, probed).remembering(system)


def _with_ridges(found: Findings, system: Studied) -> tuple[Findings, tuple[Doubt, ...]]:
    """With intervals no narrower than the ridges that they lie on, as far as runs are left."""
    from .doubts import hidden, with_ridges

    problem = problem_of(system)
    try:
        wider, ridges = with_ridges(problem, found)
        return wider, (*ridges, *hidden(problem, found))
    except (BudgetUsed, KeyboardInterrupt):
        return found, ()


def _simulated(found: Findings, system: Studied, *, whole: bool) -> tuple[tuple[Simulated, ...], tuple[Doubt, ...]]:
    """How far the models that are told are off, open loop; where runs are left also fitted to be least so."""
    fits = [found.baseline, *([found.named_fit] if found.named_fit is not found.baseline else [])]
    problem = problem_of(system)
    own = simulated(system, problem, fits)
    if not (whole and any(c.process for c in system.study.channels)):
        return tuple(own), ()
    from .outputs import output_errors

    try:
        more, apart = output_errors(problem, fits)
    except (BudgetUsed, KeyboardInterrupt):
        return tuple(own), ()
    return (*own, *more), apart


def _prediction(found: Findings, system: Studied) -> Prediction | None:
    """The model to predict new recordings with: whichever predicts recordings held out best, all listed causes together
    among them where the named ones leave more than noise, or much less; None where the baseline is adequate."""
    if found.naming is None:
        return None
    own = set(patterns_of(system))  # numbers that a new recording has not
    problem = problem_of(system)
    if found.law:
        fits = [found.law.fit]
    else:
        test = found.naming.best.detection
        explained = found.naming.status == Status.COMPLETE and test is not None and test.chi2_per_dof >= LOOSE
        tried = [*(e.fit for e in found.naming.tried), *([] if explained else _of_all(found, problem))]
        fits = [found.baseline, *(f for f in tried if not own & set(f.mechanisms))]
    fit, error = best_at_prediction(problem, fits)
    before = held_out_error(problem, found.baseline)
    ratio = math.sqrt(float(before.sum() / max(error.sum(), 1e-300)))
    return Prediction(tuple(m for m in fit.mechanisms if m not in own), intervals(system, fit, list(fit.named)), ratio)


def _of_all(found: Findings, problem: Problem) -> list[Fit]:
    """The fit of all causes that the user listed; none where one takes another's place, or no run is left."""
    system = problem.system
    assert isinstance(system, Studied) and found.naming
    listed = [m.name for m in system.study.mechanisms if m.name in system.candidates]
    names = tuple(n for n in system.candidates if n in listed)
    if any(system.candidates[n].replaces for n in names):
        return []
    try:
        fit = problem.fit(names, found.naming.best.fit.named)
    except (BudgetUsed, KeyboardInterrupt):
        return []
    return [problem.polished(fit)] if fit else []


def _alone(found: Findings, system: Studied) -> Fit | None:
    """The model that is told, without what else was measured; None where that was not asked for, or no run is left."""
    if not system.study.measured:
        return None
    from jumpvision.engine.document.measured import motions_alone

    try:
        return motions_alone(found.named_fit, problem_of(system))
    except BudgetUsed:
        return None


def problem_of(system: Studied) -> Problem:
    """A study with the noise of its channels and what else was measured."""
    return Problem(system, system.readings.noise, system.scatter_sigma, system.study.measured)


def _asked(system: Studied, say: Callable[[str], None]) -> tuple[Findings, str]:
    """(what is found, why it is not all there could be; "" where it is)."""
    reached: list[Findings] = []

    def step(d: Findings) -> None:
        reached.append(d)
        system.runs.foresee(LOOKED if d.naming is None else NAMED)

    problem, rng = problem_of(system), np.random.default_rng(SEED)
    order = _Asked(problem, rng, by=("kind",), say=say, reached=step)
    if system.study.forms:
        from jumpvision.engine.discovery import Laws

        from .discovered import StudyForms

        def laws(p: Problem) -> Laws:
            assert isinstance(p.system, Studied)
            return Laws(p, StudyForms(p.system), say)

        order = replace(order, laws=laws)
    if system.study.inputs:
        from .offers import offer

        order = replace(order, offered=partial(offer, system, problem))
    try:
        return order.all(), ""
    except BudgetUsed as e:
        if not reached:
            raise
        return reached[-1], e.problems[0]
    except KeyboardInterrupt:
        if not reached:
            raise
        return reached[-1], "it was interrupted"


def _unmade(study: Study, recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings that could be made next."""
    if not study.inputs:
        return []
    from .offers import unmade

    return unmade(study, recordings)


def recordings_problems(recordings: Sequence[Recording]) -> list[str]:
    """What is wrong with a set of recordings."""
    if not recordings:
        return ["no recordings: give a list of Recording"]
    if wrong := [r for r in recordings if not isinstance(r, Recording)]:
        return [f"recordings: {type(wrong[0]).__name__} is no Recording(name, t, values)"]
    names = [r.name for r in recordings]
    return [f"two recordings are called {n!r}" for n in dict.fromkeys(names) if names.count(n) > 1]
