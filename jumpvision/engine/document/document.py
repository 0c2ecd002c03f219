"""The part of a diagnosis that is told alike of every system: jumps, or whatever a user's own simulator predicts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from jumpvision.base.arrays import Z90
from jumpvision.engine.fitting import Fit
from jumpvision.engine.naming import Explanation, likely
from jumpvision.engine.order import Findings
from jumpvision.engine.search import MOST
from jumpvision.engine.system import Parameter, System
from jumpvision.engine.worth.gain import Gain

from . import values as record
from .diagnosis import Diagnosis

TOP, CAUSES = 12, 8  # cells of "where", and causes, that are told
LOOSE = 0.5  # chi^2 per degree of freedom below which a model agrees better than noise lets it


@dataclass(frozen=True)
class Teller:
    """How the fits of a system are told. model: terms and parameters of a fit; own: parameters that a mechanism has in
    a model; heights: whether its motions have an apex."""

    system: System
    model: Callable[[Fit], record.Model]
    own: Callable[[Explanation, str], dict[str, record.Parameter]]
    heights: bool = True

    def gain(self, g: Gain) -> record.Gain:
        """The gain on motions held out."""
        tops = (g.height_before, g.height_after) if self.heights else (math.nan, math.nan)
        return record.Gain(g.held_out, *tops, g.track_before, g.track_after, g.ratio, g.ratio_ci95, g.claimed)

    def rmse(self, fit: Fit) -> float:
        """Root mean square of measured minus predicted over all motions [unit of y]."""
        predicted = self.system.predict(fit.mechanisms, fit.named, range(len(self.system.observations)))
        return rms(np.concatenate([o.y - y for o, y in zip(self.system.observations, predicted)]))

    def causes(self, d: Findings) -> tuple[record.Cause, ...]:
        """Mechanisms by probability, each with the parameters of the likeliest model that has it."""
        if (n := d.naming) is None:
            return ()
        out = []
        for mechanism in likely(n)[:CAUSES]:
            e = next(e for e in n.tried if mechanism in e.mechanisms)
            others = tuple(m for m in e.mechanisms if m != mechanism)
            chances, found = n.chances(mechanism), self.own(e, mechanism)
            spread = (min(chances), max(chances))
            out.append(record.Cause(mechanism, others, n.probability(mechanism), spread, e.delta_score, found))
        return tuple(out)

    def closest(self, d: Findings) -> record.Closest | None:
        """The likeliest model where none passes the test; None where one does, or that is the baseline."""
        if d.naming is None or d.naming.named or not (e := d.naming.best).mechanisms:
            return None
        found = {name: value for m in e.mechanisms for name, value in self.own(e, m).items()}
        gain = self.gain(d.gain) if d.gain else None
        return record.Closest(e.mechanisms, e.probability, found, self.rmse(e.fit), gain)

    def record(self, d: Findings, best: Fit, noise: record.Noise) -> Diagnosis:
        """The record, without words and without what only some systems have. best: the fit that is told."""
        n, extended = d.naming, best is not d.baseline
        before = self.model(d.baseline)
        return Diagnosis(
            verdict="adequate" if d.adequate else "discrepant",
            p_value=d.detection.p_value,
            baseline=record.Baseline(
                before.terms, before.parameters, math.nan, self.rmse(d.baseline), d.detection.chi2_per_dof
            ),
            where=tuple(
                record.Cell(str(c.labels.get("kind")), c.part, c.mean_residual, c.z_score, c.p_value, c.n)
                for c in d.where[:TOP]
            ),
            heights=(),
            causes=self.causes(d),
            named=n.named if n else (),
            status=n.status if n else "complete",
            left_over=left_over(d),
            detectable=tuple(record.Detectable(x.mechanism, x.parameter, x.value, x.unit) for x in d.detectable),
            indistinguishable=n.twins if n else (),
            closest=self.closest(d),
            unexplained=None,
            extended_model=self.model(best),
            gain=self.gain(d.gain) if extended and d.gain else None,
            selection=tuple(record.Selection(*x) for x in d.gain.selection) if d.gain else (),
            extrapolation={k: self.gain(g) for k, g in (d.extrapolation or {}).items()} if extended else {},
            next_experiment=None,
            priors=priors(d),
            noise=noise,
            common=(),
            energy=(),
            confirmation=(),
            sentence="",
            confirmed=None,
        )


def told(d: Findings) -> Fit:
    """The fit that the findings stand by: of the named mechanisms, else the baseline."""
    return d.naming.best.fit if d.naming and d.naming.named else d.baseline


def left_over(d: Findings) -> record.LeftOver | None:
    """What the model that is told leaves; None where the baseline is adequate."""
    n = d.naming
    if n is None:
        return None
    if not n.named:
        return record.LeftOver(d.detection.chi2_per_dof, 1.0, 1.0)
    test = n.best.detection
    return record.LeftOver(test.chi2_per_dof if test else math.nan, n.left, n.widened)


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
    return record.Parameter(value, max(value - half, p.low), min(value + half, p.high), p.unit or "1")


def agreement(d: Findings) -> list[str]:
    """Warnings where the best model agrees with the data too well, or not as well as the noise says."""
    best = d.naming.best if d.naming and d.naming.named else None
    test = best.detection if best else d.detection
    if test is None:
        return []
    if test.chi2_per_dof < LOOSE:
        return [
            f"chi^2 per degree of freedom of the best model is {test.chi2_per_dof:.2g}: the noise is taken too large, "
            "and effects may hide in it; look at where it was learned (`sources`), or state a smaller one"
        ]
    if best and test.discrepant:
        return [
            f"chi^2 per degree of freedom of the best model is {test.chi2_per_dof:.3g} (p = {test.p_value:.2g}): more "
            "is left than the noise explains"
        ]
    return []


def rms(x: Any) -> float:
    """Root mean square of what is finite; NaN where nothing is."""
    x = np.asarray(x, float)
    x = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(x * x))) if x.size else math.nan
