"""From findings to the record: one document for jumps and for whatever a user's own simulator predicts.

What only some systems have (heights, an apparatus, runs) and their words come from a `Speaker`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np

from jumpvision.base.arrays import Z90, Array
from jumpvision.engine.fitting import Fit
from jumpvision.engine.naming import likely
from jumpvision.engine.order import Findings
from jumpvision.engine.search import MOST
from jumpvision.engine.system import Parameter, System, patterns_of
from jumpvision.engine.worth.gain import Gain

from . import values as record
from .diagnosis import Diagnosis
from .sentence import contradictions, sentence
from .words import Words, say

if TYPE_CHECKING:
    from jumpvision.engine.discovery import Law
    from jumpvision.engine.vary.patterns import Pattern

HALVED = 2.0  # factor on the error of held-out motions from which a formula is told
LOOK = 3  # recordings with the largest misfit that are named
LOOSE = 0.5  # chi^2 per degree of freedom below which a model agrees better than noise lets it


class Speaker(Protocol):
    """How a system and its models are told."""

    @property
    def system(self) -> System: ...
    @property
    def heights(self) -> bool:
        """Whether its motions have an apex."""
        ...

    def model(self, fit: Fit) -> record.Model:
        """Terms and parameters of a fit."""
        ...

    def parameters(self, fit: Fit, mechanism: str) -> dict[str, record.Parameter]:
        """Those that a mechanism has in a model."""
        ...

    def noise(self, d: Findings) -> record.Noise:
        """The noise, where it was learned, and what a reader must be warned of."""
        ...

    def completed(self, data: Diagnosis, d: Findings) -> Diagnosis:
        """The record with what only such a system has."""
        ...

    def words(self, data: Diagnosis) -> Words: ...


def document(d: Findings, speaker: Speaker, stopped: str = "") -> Diagnosis:
    """The record of findings. stopped: why they are not all that there could be; "" where they are."""
    d = worth_telling(d)
    n, extended, before = d.naming, d.best is not d.baseline, speaker.model(d.baseline)
    called, known = titles(d), patterns(d)
    # forms of one pattern are one to a reader
    twins = [tuple(dict.fromkeys(called.get(m, m) for m in t)) for t in n.twins] if n else []
    chosen = d.gain.selection if d.gain else ()
    varies: tuple[record.Varies, ...] = ()
    if d.varies:
        from .varied import varies_of

        varies = varies_of(d)
    data = Diagnosis(
        verdict=record.Verdict.ADEQUATE if d.adequate else record.Verdict.DISCREPANT,
        p_value=d.detection.p_value,
        baseline=record.Baseline(
            before.terms, before.parameters, math.nan, rmse(speaker, d.baseline), d.detection.chi2_per_dof
        ),
        where=tuple(d.where[:12]),  # a page tells no more
        heights=(),
        causes=causes(d, speaker),
        named=forces(d, n.named) if n else (),
        status=n.status if n else record.Status.UNDETERMINED if stopped else record.Status.COMPLETE,
        left_over=left_over(d, speaker),
        # what varies between recordings has no strength of its own
        detectable=tuple(x for x in d.detectable if x.mechanism not in known),
        indistinguishable=tuple(t for t in twins if len(t) > 1),
        closest=closest(d, speaker),
        extended_model=speaker.model(d.best),
        gain=gain(d.gain, speaker) if extended and d.gain else None,
        selection=tuple(record.Selection(tuple(called.get(m, m) for m in s), k) for s, k in chosen),
        extrapolation={k: gain(g, speaker) for k, g in (d.extrapolation or {}).items()} if extended else {},
        next_experiment=None,
        priors=priors(d),
        noise=speaker.noise(d),
        common=(),
        energy=(),
        confirmation=(),
        sentence="",
        confirmed=None,
        varies=varies,
    )
    data = speaker.completed(with_law(data, d.law) if d.law else data, d)
    if data.status == record.Status.UNDETERMINED:  # what a rejected model foretells is worth nothing
        data = replace(data, next_experiment=None, detectable=())
    off = rms(np.array([h.simulated_m - h.measured_m for h in data.heights]))
    data = replace(data, baseline=replace(data.baseline, rmse_height_m=off))
    words = speaker.words(data)
    untold = [x.words for x in data.doubts if x.kind != record.DoubtKind.STEPPED]
    text = " ".join([sentence(data, words, stopped), *(f"{x[0].upper()}{x[1:].rstrip('.?')}." for x in untold)])
    return replace(data, sentence=text, confirmed=contradictions(data, words.apart))


def forces(d: Findings, names: Sequence[str]) -> tuple[str, ...]:
    """The mechanisms among the names of a model's candidates."""
    known = patterns(d)
    return tuple(n for n in names if n not in known)


def patterns(d: Findings) -> Mapping[str, Pattern]:
    """Ways in which numbers may vary, among the candidates."""
    return patterns_of(d.problem.system) if d.problem else {}


def titles(d: Findings) -> Mapping[str, str]:
    """Of these, for a reader."""
    if not (known := patterns(d)) or d.problem is None:
        return {}
    from .varied import title

    return {n: title(p, d.problem.system.observations) for n, p in known.items()}


def worth_telling(d: Findings) -> Findings:
    """Without a law of no list that may be chance and does not halve the error, on conditions held out where they were
    predicted."""
    if d.law is None or d.law.found.sure:
        return d
    ratio = d.gain.ratio if d.gain else math.sqrt(d.baseline.chi2 / max(d.law.fit.chi2, 1e-300))
    return d if ratio >= HALVED else replace(d, law=None, gain=None, extrapolation=None)


def gain(g: Gain, speaker: Speaker) -> record.Gain:
    """The gain on motions held out."""
    tops = (g.height_before, g.height_after) if speaker.heights else (math.nan, math.nan)
    return record.Gain(g.held_out, *tops, g.track_before, g.track_after, g.ratio, g.ratio_ci95, g.claimed)


def rmse(speaker: Speaker, fit: Fit) -> float:
    """Root mean square of measured minus predicted over all motions [unit of y]."""
    every = speaker.system.observations
    predicted = speaker.system.predict(fit.mechanisms, fit.named, range(len(every)))
    return rms(np.concatenate([o.y - y for o, y in zip(every, predicted)]))


def causes(d: Findings, speaker: Speaker) -> tuple[record.Cause, ...]:
    """Mechanisms by probability, each with the parameters of the likeliest model that has it."""
    if (n := d.naming) is None:
        return ()
    out, called = [], titles(d)
    for m in forces(d, likely(n))[:8]:  # a page tells no more causes
        e = next(e for e in n.tried if m in e.mechanisms)
        others = tuple(called.get(o, o) for o in e.mechanisms if o != m)
        spread, found = (min(n.chances(m)), max(n.chances(m))), speaker.parameters(e.fit, m)
        out.append(record.Cause(m, others, n.probability(m), spread, e.delta_score, found))
    return tuple(out)


def closest(d: Findings, speaker: Speaker) -> record.Closest | None:
    """The likeliest model where none passes the test; None where one does, or that is the baseline."""
    if d.naming is None or d.naming.named or not (mechanisms := forces(d, (e := d.naming.best).mechanisms)):
        return None
    found = {name: value for m in mechanisms for name, value in speaker.parameters(e.fit, m).items()}
    worth = gain(d.gain, speaker) if d.gain else None
    return record.Closest(mechanisms, d.naming.suffices * e.probability, found, rmse(speaker, e.fit), worth)


def with_law(data: Diagnosis, law: Law) -> Diagnosis:
    """The record with a law of no list in the place of what the vocabulary says."""
    look_at = data.left_over.look_at if data.left_over and law.status is record.Status.PARTIAL else ()
    return replace(
        data,
        named=tuple(m for m in law.fit.mechanisms[:-1] if m not in patterns_of(law.system)),
        status=law.status,
        left_over=record.LeftOver(law.found.detection.chi2_per_dof, 1.0 - law.found.r2, 1.0, look_at),
        indistinguishable=(),
        closest=None,
        discovered=law.described,
    )


def left_over(d: Findings, speaker: Speaker) -> record.LeftOver | None:
    """What the model that is told leaves; None where the baseline is adequate."""
    n = d.naming
    if n is None:
        return None
    look_at = () if n.by_chance or n.status == record.Status.COMPLETE else misfits(d, speaker)
    if not n.named:
        return record.LeftOver(d.detection.chi2_per_dof, 1.0, 1.0, look_at)
    test = n.best.detection
    return record.LeftOver(test.chi2_per_dof if test else math.nan, n.left, n.widened, look_at)


def misfits(d: Findings, speaker: Speaker) -> tuple[str, ...]:
    """The recordings that the model that is told misses most, by chi^2 a sample."""
    each = [float(np.mean(r * r)) if r.size else 0.0 for r in d.best.residuals]
    names = [o.name for o in speaker.system.observations]
    return tuple(names[i] for i in np.argsort(each)[::-1][:LOOK])


def priors(d: Findings) -> record.Priors | None:
    """What was taken of causes and parameters before the data; None where no cause was sought."""
    if d.naming is None:
        return None
    found = {p.name: p for e in d.naming.tried for p in e.fit.parameters}
    return record.Priors(
        tuple([1.0 / (MOST + 1)] * (MOST + 1)),
        {p.name: record.Prior(p.low, p.high, p.start, p.sigma, p.unit or "1") for p in found.values()},
    )


def interval(fit: Fit, p: Parameter) -> record.Parameter:
    """A fitted parameter, the ends of its 90 % interval within its range."""
    value, half = fit.named[p.name], Z90 * fit.sigma(p.name)
    if p.name in fit.reach:
        return record.Parameter(value, *fit.reach[p.name], p.unit or "1")
    return record.Parameter(value, max(value - half, p.low), min(value + half, p.high), p.unit or "1")


def agreement(d: Findings) -> list[str]:
    """Warnings where the best model agrees with the data too well, or not as well as the noise says."""
    best = d.naming.best if d.naming and d.naming.named else None
    test = best.detection if best else d.detection
    if test is None:
        return []
    if test.chi2_per_dof < LOOSE:
        return [say("too well", chi2=test.chi2_per_dof)]
    return [say("not as well", chi2=test.chi2_per_dof, p=test.p_value)] if best and test.discrepant else []


def rms(x: Array) -> float:
    """Root mean square of what is finite; NaN where nothing is."""
    x = np.asarray(x, float)
    x = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(x * x))) if x.size else math.nan
