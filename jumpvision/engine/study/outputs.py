"""The same models fitted as if the simulation erred by independent readings alone (output error), beside the walk.

With `process=True` a fit weighs how the simulation drifts, not how far it is off: it foretells the parameters better
where small random forces kick the motion, and may simulate the record worse. Where the two differ by much, a user has
to know of both, and what that means.
"""

from __future__ import annotations

from jumpvision.base.numbers import said
from jumpvision.engine.document import values as record
from jumpvision.engine.fitting import Fit, Problem
from jumpvision.engine.noise.noise import Noise

from .learn import STATED, together
from .system import Studied
from .words import intervals, rms_by_channel

FURTHER = 2.0  # times: the open-loop errors of two fits that differ by more are told side by side


def output_errors(problem: Problem, fits: list[Fit]) -> tuple[list[record.Simulated], tuple[record.Doubt, ...]]:
    """(each model as its output-error fit simulates it; what it means where that is much closer)."""
    system = problem.system
    assert isinstance(system, Studied)
    out, doubts = [], []
    for fit in fits:
        before = rms_by_channel(system, fit)
        best = _fitted(problem, system, fit, before)
        if best is None:
            continue
        after = rms_by_channel(system, best)
        parameters = intervals(system, best, list(best.named))
        n = max(problem.n - len(best.parameters), 1)
        out.append(record.Simulated(best.mechanisms, record.ByFit.OUTPUT_ERROR, best.chi2 / n, after, parameters))
        far = [c for c in before if before[c] > FURTHER * after[c]]
        if far:
            unit = {c.name: c.unit for c in system.study.channels}
            each = "; ".join(f"{c}: {said(before[c], '.3g')} and {said(after[c], '.3g')} {unit[c]}" for c in far)
            model = " + ".join(best.mechanisms) or "the model as it is"
            text = (
                f"open loop, {model} errs by (rms; fitted with process=True, and fitted to the recordings' readings) "
                f"{each}: either the model lacks something slow, for which the second fit's parameters make up, or "
                "there are few random kicks; take the first for the parameters, the second for the motion"
            )
            doubts.append(record.Doubt(record.DoubtKind.TWO_FITS, best.mechanisms, text))
    return out, tuple(doubts)


def _fitted(problem: Problem, system: Studied, fit: Fit, before: dict[str, float]) -> Fit | None:
    """From where the other fit ended, and from the first values."""
    noises = [
        Noise(max(before[c.name], 1e-300), 0.0, n.frame, log_sigma=2 * STATED, log_power=2 * STATED) if c.process else n
        for c, n in zip(system.study.channels, system.readings.channels)
    ]
    samples = [sum(int(m[:, k].sum()) for m in system.masks) for k in range(len(noises))]
    readings = system.readings.of(tuple(noises), noises[0] if len(noises) == 1 else together(noises, samples))
    plain = Studied(system.study, system.recordings, readings, system.runs, system.probed).remembering(system)
    beside = Problem(plain, readings.noise, plain.scatter_sigma, problem.measured)
    first = {p.name: p.start for p in fit.parameters}
    fits = [f for start in (fit.named, first) if (f := beside.fit(fit.mechanisms, start)) is not None]
    return beside.polished(min(fits, key=lambda f: f.chi2)) if fits else None
