"""What a fit's covariance does not know: ridges along which parameters move together without a trace.

Before an interval is stated the model is run again along the direction in which the fit is weakest. Where chi^2 rises
by less than the curvature says, the parameter is held at ever further values, the others fitted anew, up to the end of
its range (profile likelihood): no interval is narrower than the ridge.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.numbers import said
from jumpvision.engine.document.document import interval
from jumpvision.engine.document.values import Doubt, DoubtKind
from jumpvision.engine.fitting import Fit, Problem
from jumpvision.engine.order import Findings
from jumpvision.engine.priors import Measured

from .system import DUMMY, Studied

FAR = 2.0  # standard uncertainties at which the model is run again
RISE = FAR**2  # of chi^2 there, as the curvature has it
SHARE = 0.25  # of what it says, below which the curvature is not believed
CANCEL = 0.05  # length of the summed effect of parameters over that of each: below it they hide each other
OWN = 0.02  # share of a mechanism's effect that nothing fitted can make: below it the mechanism is hidden
NEARLY = 0.1  # of a range: as good as at its end
WIDE = 0.5  # of a range: a parameter that may lie in so much of it is not told
HELD = 1e-6  # ranges: standard deviation that holds a parameter where it is put
LAPS, TRIES = 8, 7  # iterations of a fit beside a held parameter, ever further values


@dataclass(frozen=True)
class Ridge:
    """reach: of every parameter that moves along it, its least and greatest value. whole: whether it goes on to the
    ends of a range, so that these parameters are not told."""

    reach: dict[str, tuple[float, float]]
    whole: bool


def with_ridges(problem: Problem, d: Findings) -> tuple[Findings, tuple[Doubt, ...]]:
    """The findings, what they stand by with intervals that are no narrower than its ridges; those ridges."""
    fit, n = d.best, d.naming
    if d.law is not None:
        problem = problem.asked_of(d.law.system)
    unnamed = n is not None and not n.named and not n.by_chance and not d.adequate  # a rejected model has no intervals
    if not fit.parameters or (unnamed and d.law is None):
        return d, ()
    found = ridges(problem, fit)
    if not found:
        return d, ()
    reach = {n: ends for r in found for n, ends in r.reach.items()}
    wider = replace(fit, covariance=_widened(fit, reach), reach=reach)
    doubts = tuple(_doubt(fit, r) for r in found if r.whole)
    if d.law is not None:
        from .discovered import with_fit

        return replace(d, law=with_fit(d.law, wider)), doubts
    if d.naming is not None and d.naming.named:
        best = replace(d.naming.best, fit=wider)
        tried = tuple(best if e is d.naming.best else e for e in d.naming.tried)
        return replace(d, naming=replace(d.naming, best=best, tried=tried)), doubts
    return replace(d, baseline=wider), doubts


def hidden(problem: Problem, d: Findings) -> tuple[Doubt, ...]:
    """Mechanisms whose whole effect the fitted parameters can make too."""
    test = d.naming.best.detection if d.naming and d.naming.named else d.detection
    if test is None or not d.named_fit.parameters:
        return ()
    own: dict[str, float] = {}
    for x in test.directions:
        own[x.mechanism] = max(own.get(x.mechanism, 0.0), x.kept)
    system = problem.system
    assert isinstance(system, Studied)
    known = system.candidates  # what nobody asked for may be hidden unsaid
    asked = [m for m in system.mechanisms if not (known[m].replaces or known[m].dear or m in d.named_fit.mechanisms)]
    free = ", ".join(p.name for p in d.named_fit.parameters if not p.name.startswith(DUMMY))
    return tuple(
        Doubt(DoubtKind.CANNOT_TELL, (m,), f"these recordings cannot distinguish {m} from what is fitted ({free})")
        for m in asked
        if own.get(m, 0.0) < OWN
    )


def _doubt(fit: Fit, r: Ridge) -> Doubt:
    units = {p.name: f" {p.unit}" if p.unit not in ("", "1") else "" for p in fit.parameters}
    each = ", ".join(f"{n} {said(a, '.3g')} to {said(b, '.3g')}{units[n]}" for n, (a, b) in r.reach.items())
    what = "cannot determine them separately" if len(r.reach) > 1 else "cannot determine it"
    return Doubt(DoubtKind.CANNOT_TELL, tuple(r.reach), f"these recordings {what}: {each} fit as well")


def _widened(fit: Fit, reach: dict[str, tuple[float, float]]) -> Array:
    """The covariance with the parameters of a ridge as wide as it is."""
    wide = np.ones(len(fit.parameters))
    for k, p in enumerate(fit.parameters):
        if p.name in reach and (own := math.sqrt(float(fit.covariance[k, k]))) > 0.0:
            low, high = reach[p.name]
            wide[k] = max((high - low) / math.sqrt(12.0) / own, 1.0)
    return np.asarray(fit.covariance * np.outer(wide, wide))


def ridges(problem: Problem, fit: Fit) -> list[Ridge]:
    """The ridges of a fit."""
    free = [k for k, p in enumerate(fit.parameters) if not p.name.startswith(DUMMY)]
    width = np.array([p.width for p in fit.parameters])
    effects = np.vstack([*fit.jacobian, fit.known.rows])[:, free] * width[free]
    length = np.linalg.norm(effects, axis=0)
    out: list[Ridge] = []
    seen: set[str] = set()
    for k in np.flatnonzero(length == 0.0):
        p = fit.parameters[free[k]]
        seen.add(p.name)
        out.append(Ridge({p.name: (p.low, p.high)}, True))
    live = [k for k in range(len(free)) if length[k] > 0.0]
    if not live:
        return out
    _, size, ways = np.linalg.svd(effects[:, live] / length[live], full_matrices=False)
    for j in range(size.size - 1, -1, -1):
        way = np.zeros(len(fit.parameters))
        way[[free[k] for k in live]] = ways[j] / length[live] * width[[free[k] for k in live]]
        if size[j] > CANCEL and (j < size.size - 1 or not _shallow(problem, fit, way / size[j])):
            break
        at = int(np.argmax(np.abs(way) / width))
        if fit.parameters[at].name not in seen and (ridge := _followed(problem, fit, at, way)) is not None:
            seen |= set(ridge.reach)
            out.append(ridge)
    return out


def _within(fit: Fit, x: Array) -> dict[str, float]:
    return {p.name: float(min(max(v, p.low), p.high)) for p, v in zip(fit.parameters, x)}


def _shallow(problem: Problem, fit: Fit, sigma: Array) -> bool:
    """Whether chi^2 rises less along a direction, its length a standard uncertainty, than the curvature says."""
    for sign in (FAR, -FAR):
        there = _within(fit, fit.values + sign * sigma)
        moved = np.array([*there.values()]) - fit.values
        share = float(np.linalg.norm(moved) / np.linalg.norm(sign * sigma))
        expected = RISE * share * share
        if expected > 0.1 * RISE and problem.cost(fit.mechanisms, there) - fit.chi2 < SHARE * expected:
            return True
    return False


def _followed(problem: Problem, fit: Fit, at: int, way: Array) -> Ridge | None:
    """The ridge along which a parameter is moved, the others fitted anew; None where its interval stands."""
    sides = [_side(problem, fit, at, way * sign) for sign in (1.0, -1.0)]
    points = [x for side in sides for x in side[0]]
    if not points:
        return None
    low, high = np.min([fit.values, *points], axis=0), np.max([fit.values, *points], axis=0)
    moved = [k for k, q in enumerate(fit.parameters) if k == at or _moves(high[k] - low[k], fit.sigma(q.name), q.width)]
    reach = {}
    for k in moved:
        p = fit.parameters[k]
        near = interval(fit, p)  # where nothing was found on a side, what the curvature says
        both = all(side[0] for side in sides)
        reach[p.name] = (
            float(low[k] if both else min(low[k], near.low)),
            float(high[k] if both else max(high[k], near.high)),
        )
    wide = float(high[at] - low[at]) > WIDE * fit.parameters[at].width
    return Ridge(reach, wide or all(whole for _, whole in sides))


def _moves(by: float, sigma: float, width: float) -> bool:
    """Whether a parameter goes along a ridge: through a part of its range, or further than its sigma says."""
    return by > min(max(sigma, 0.05 * width), 2.0 * FAR * sigma)


def _side(problem: Problem, fit: Fit, at: int, way: Array) -> tuple[list[Array], bool]:
    """(points of the ridge on one side, none where chi^2 rises as it should; whether it reaches an end of a range)."""
    p, value, sigma, sign = fit.parameters[at], float(fit.values[at]), fit.sigma(fit.parameters[at].name), way[at]
    room = p.high - value if sign > 0.0 else value - p.low
    if room <= 0.0 or sigma <= 0.0:
        return [], True
    points: list[Array] = []
    off, reached, beyond = min(FAR * sigma, room), 0.0, math.inf
    for k in range(TRIES):
        there = _held(problem, fit, at, value + math.copysign(off, sign), points[-1] if points else fit.values, way)
        most = RISE if points else SHARE * RISE * min(off / (FAR * sigma), 1.0) ** 2
        if there is not None and there.chi2 - fit.chi2 <= most:
            points.append(there.values)
            reached = off
        elif not points and k == 2:
            return [], False
        else:
            beyond = off  # too far, perhaps only for another parameter's range
        if reached == room:
            break
        off = 0.5 * (reached + beyond) if beyond <= room else room if k > 1 else min(4.0 * off, room)
    ends = ((q, x) for q, x in zip(fit.parameters, points[-1])) if points else ()
    return points, any(min(x - q.low, q.high - x) < NEARLY * q.width for q, x in ends)


def _held(problem: Problem, fit: Fit, at: int, value: float, last: Array, way: Array) -> Fit | None:
    """The fit with one parameter held at a value, from the last one on, along the ridge."""
    p = fit.parameters[at]
    ahead = last + way / way[at] * (value - last[at])
    start = {**_within(fit, ahead), p.name: value}
    held = Measured.of(p.name, value, HELD * p.width, "held")
    beside = Problem(problem.system, problem.noise, problem.scattered, (*problem.measured, held))
    return beside.fit(fit.mechanisms, start, iterations=LAPS)
