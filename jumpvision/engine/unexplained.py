"""The gate's other side: what a model and its whole vocabulary leave over, described by generic forces.

Columns are sensitivities of the predicted motion to a small force of each shape, whitened and less their part within
the span of the fitted parameters. This is the weak form: the motion's own response is the test function, so that no
measurement is differentiated. Forward selection; the first term is then fitted through the whole simulation, since the
strongest residuals are not linear; which shape wins is judged again over bootstrap draws of the groups.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Protocol

import numpy as np
import scipy

from jumpvision.base.arrays import Array

from .detect import LEVEL, Detection, Direction, Span, detect, directions
from .discovery import wins
from .document.values import Coefficient, Unexplained
from .fitting import Fit, Problem
from .naming import held_out_score
from .search import Start, best_starts, race, start_of
from .system import System
from .worth.refitted import held_out_ratio

LEAST_OWN = 0.05  # share of a second shape that the first model cannot mimic
HALVED = 2.0  # factor on the error of conditions held out from which a shape is told
TOLD = 0.1  # share of the draws from which a shape is worth telling


class Shapes(System, Protocol):
    """The system questioned with generic forces among its candidates: one number each, 0 where it is absent."""

    @property
    def shapes(self) -> Mapping[str, object]: ...
    def reach(self, shape: str, mechanisms: tuple[str, ...], values: Mapping[str, float]) -> str:
        """Where in position and speed the shape acted, in words."""
        ...


def unexplained(problem: Problem, fits: Sequence[Fit], shapes: Shapes, rng: np.random.Generator) -> Unexplained | None:
    """Describes what the first of the fits leaves over by generic forces; None where none is seen, or none
    halves the error on conditions held out.

    fits: models beside which a shape is tried: the baseline, and the best of the vocabulary, which may hold a part of
    the truth or only imitate it; the pair that explains most is told.
    """
    whole = Problem(shapes, problem.noise, problem.scattered, problem.measured)
    seen = {}
    tried: list[tuple[Fit, Fit]] = []
    for fit in fits:
        columns = directions(whole, fit, list(shapes.shapes))
        found = detect(whole, fit, columns, rng)
        if columns and found.p_score < LEVEL:
            seen[fit.mechanisms] = columns
            tried += [(fit, f) for f in race(whole, _starts(whole, fit, found))]
    limit = min((held_out_score(problem, f) for f in fits), default=0.0)
    tried = [(a, b) for a, b in tried if b.chi2 < a.chi2 and held_out_score(whole, b) > limit]
    if not tried:
        return None
    before, best = max(tried, key=lambda x: x[1].log_evidence)
    first, plain = best.mechanisms[-1], fits[0]
    alone = whole.fit((*plain.mechanisms, first), best.named)  # without what only imitated it
    if alone is not None and alone.log_evidence > best.log_evidence:
        before, best = plain, alone
    strength = shapes.candidates[first].parameters[0]
    terms = {first: Coefficient(best.named[strength.name], best.sigma(strength.name), strength.unit)}
    span, left = Span(best), best.chi2
    others = _seconds(span, span.off(span.residual), seen.get(before.mechanisms, []), first)
    if others and len(others) * float(scipy.special.erfc(abs(others[0][1]) / math.sqrt(2.0))) < LEVEL:
        d, z, share = others[0]
        value, unit = d.strength * z / share, shapes.candidates[d.mechanism].parameters[0].unit
        terms[d.mechanism] = Coefficient(value, abs(value / z), unit)
        left -= z * z
    if HALVED**2 * left > plain.chi2 or held_out_ratio(whole, plain, best) < HALVED:
        return None
    dof = max(problem.n - len(plain.parameters), 1)
    reached = shapes.reach(first, best.mechanisms, best.named)
    return Unexplained(
        terms=tuple(terms),
        coefficients=terms,
        r2=(plain.chi2 - left) / (plain.chi2 - min(left, dof)),
        where="; ".join(x for x in (_parts(problem, plain, best), reached) if x),
        beside=before.mechanisms,
        stability=wins(problem, [f for _, f in tried], rng, TOLD, 0.0),
    )


def _starts(problem: Problem, fit: Fit, found: Detection) -> list[Start]:
    """Of the shapes that are seen best, the better of the linear estimate of the strength and shares of it."""
    ranked = sorted(zip(found.directions, found.score), key=lambda x: -abs(x[1]))
    out = []
    for d, z in ranked[:8]:  # shapes of the greatest scores are fitted through the simulation
        full = start_of(problem, fit, d, float(z))
        r = problem.system.candidates[d.mechanism].parameters[0].name
        tries = [{**full, r: full[r] * share} for share in (1.0, 0.3)]
        out += best_starts(problem, fit, (*fit.mechanisms, d.mechanism), tries, 1)
    return out


def _seconds(
    span: Span, residual: Array, columns: Sequence[Direction], first: str
) -> list[tuple[Direction, float, float]]:
    """The other shapes beside the first: (direction, score, share left beside the new span), the best first."""
    out = []
    for d in columns:
        rest = span.off(d.vector)
        share = float(np.linalg.norm(rest))
        if d.mechanism != first and share > LEAST_OWN:
            out.append((d, float(rest @ residual) / share, share))
    return sorted(out, key=lambda x: -abs(x[1]))


def _parts(problem: Problem, before: Fit, after: Fit) -> str:
    """The parts of the motion, by kind, in which the term explains most."""
    total: dict[str, float] = {}
    for o, a, b in zip(problem.system.observations, before.residuals, after.residuals):
        parts = o.parts if o.parts is not None else np.full(o.t.size, "all")
        for part in np.unique(parts):
            key = " ".join(str(x) for x in (o.labels.get("kind"), part) if x and x != "all")
            here = parts == part
            total[key] = total.get(key, 0.0) + float(a[here] @ a[here] - b[here] @ b[here])
    gained = max(sum(total.values()), 1e-300)
    top = sorted(total.items(), key=lambda x: -x[1])[:3]
    return ", ".join(f"{k or 'everywhere'} {100 * v / gained:.0f} %" for k, v in top if v > 0.1 * gained)
