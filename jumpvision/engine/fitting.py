"""Fits of a system to its observations: whitened residuals, priors as further residuals, Gauss-Newton with bounds."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TypeVar

import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import Array, log_box
from jumpvision.base.threads import at_once
from jumpvision.engine.noise.noise import Noise
from jumpvision.engine.noise.whitening import Whitening, axes, joined
from jumpvision.engine.priors import Known, Measured, prior_of

from .system import Costly, CostlyPart, Parameter, Part, System, at_a_time, parameters, predict_each

T = TypeVar("T")

STEP = 1e-3  # of a parameter's scale, for derivatives
ITERATIONS = 30
BROAD = 100.0  # ranges: standard deviation, as of a parameter that nothing else says anything of
ENOUGH = 1e-3  # a smaller expected fall of chi^2 is not worth a step
ROUGH = 5e-3  # share of chi^2 that is not worth a step where runs are dear: a model that misses so much is refused
SCANS, WEAKEST = 3, 2  # of a rough function: how often it is looked along how many directions
REACHES, NEAR = (0.5, 1.0, 2.0, 4.0), (0.3, 0.1, 0.03)  # widths at which: far along the weakest, close along all
FINE = 1e-5  # the same share in a fit to its minimum


Frame = list[tuple[Array, Array]]  # by observation: orthonormal directions of its scatter and wander, and their size


@dataclass
class Fit:
    """A fitted model. values: parameters in their order; covariance of them by the curvature at the end.

    residuals: whitened, one array an observation; jacobian: d(whitened prediction)/d(parameters), the same rows.
    chi2: residuals and priors, chi2_first where the fit began; converged: no step was worth taking any more.
    log_evidence: Laplace's approximation, up to a constant that all models share. known: priors and measurements.
    reach: of parameters on a ridge, where they may lie.
    """

    mechanisms: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    values: Array
    residuals: list[Array]
    jacobian: list[Array]
    chi2: float
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))
    log_evidence: float = -math.inf
    frame: Frame = field(default_factory=list)
    chi2_first: float = math.inf
    converged: bool = False
    known: Known = field(default_factory=lambda: Known(np.zeros((0, 0)), np.zeros(0)))
    reach: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def over(self, kept: Sequence[int]) -> Fit:
        """The same model beside some of its observations, not fitted to them anew."""
        residuals, jacobian = ([rows[i] for i in kept] for rows in (self.residuals, self.jacobian))
        return replace(self, residuals=residuals, jacobian=jacobian, frame=[self.frame[i] for i in kept])

    @property
    def at_low(self) -> dict[str, float]:
        """Every parameter at the low end of its range."""
        return {p.name: p.low for p in self.parameters}

    @property
    def named(self) -> dict[str, float]:
        return dict(zip((p.name for p in self.parameters), self.values.tolist()))

    def sigma(self, name: str) -> float:
        i = [p.name for p in self.parameters].index(name)
        return math.sqrt(max(float(self.covariance[i, i]), 0.0))


class Problem:
    """A system with its noise: residuals, derivatives and fits over all or some observations.

    scatter: standard deviation of what differs from trial to trial, by the names of System.scatter. measured: what is
    known of parameters by other means than these motions.
    """

    def __init__(
        self,
        system: System,
        noise: Noise,
        scatter: Mapping[str, float] | None = None,
        measured: Sequence[Measured] = (),
    ) -> None:
        self.system, self.noise, self.measured = system, noise, tuple(measured)
        self.scattered = {n: s for n, s in (scatter or {}).items() if s > 0}
        self.all = tuple(range(len(system.observations)))
        self.whitening = [Whitening(noise, o) for o in system.observations]
        self.steady = [axes(w.wander) for w in self.whitening]

    def over(self, kept: Sequence[int]) -> Problem:
        """The same for some observations."""
        whole = self.system
        part = CostlyPart(whole, tuple(kept)) if isinstance(whole, Costly) else Part(whole, tuple(kept))
        return self.asked_of(part)

    def asked_of(self, system: System) -> Problem:
        """The same noise and measurements with another system of these observations, or of some."""
        return Problem(system, self.noise, self.scattered, self.measured)

    @property
    def n(self) -> int:
        """Independent residuals: each unknown zero level takes one."""
        return sum(o.independent for o in self.system.observations)

    def each(self, calls: Iterable[Callable[[], T]]) -> list[T]:
        """The results of calls that ask the system, as many at a time as it answers."""
        return at_once(list(calls), at_a_time(self.system))

    def scouts(self, which: Sequence[int]) -> Sequence[int]:
        """Of these observations those over which first values are compared: fewer where runs are dear."""
        return self.system.scouts(which) if isinstance(self.system, Costly) else which

    def frame(
        self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: Sequence[int] | None = None
    ) -> Frame:
        """How trials scatter about this model, and tracks wander, observation by observation."""
        which = self.all if which is None else which
        if not self.scattered:
            return [self.steady[i] for i in which]
        effects = self.system.scatter(mechanisms, values, which)
        out: Frame = []
        for k, i in enumerate(which):
            columns = np.stack([effects[n][k] * s for n, s in self.scattered.items() if n in effects], axis=1)
            columns = columns if np.isfinite(columns).all() else np.nan_to_num(columns)
            out.append(joined(self.whitening[i].levelled(columns), self.steady[i]))
        return out

    def residuals(
        self,
        mechanisms: tuple[str, ...],
        values: Mapping[str, float],
        which: Sequence[int] | None = None,
        frame: Frame | None = None,
    ) -> list[Array] | None:
        """Whitened measured-minus-predicted; None where the model cannot be followed there.

        frame: of the observations `which`, from another point of the same model; default: of this one.
        """
        which = self.all if which is None else which
        predicted = self.system.predict(mechanisms, values, which)
        if not all(np.all(np.isfinite(y)) for y in predicted):
            return None
        frame = self.frame(mechanisms, values, which) if frame is None else frame
        observations = self.system.observations
        return [self.whitening[i].whitened(observations[i].y - y, f) for i, y, f in zip(which, predicted, frame)]

    def jacobian(
        self,
        mechanisms: tuple[str, ...],
        free: Sequence[Parameter],
        values: Array,
        at: list[Array],
        which: Sequence[int] | None,
        frame: Frame,
    ) -> list[Array]:
        """d(prediction)/d(parameter) by one-sided differences, away from a bound; zero where it cannot be had."""
        names = [p.name for p in free]
        if free and isinstance(self.system, Costly):
            some = self.all if which is None else which
            own = self.system.derivatives(mechanisms, free, dict(zip(names, values.tolist())), some)
            return [self.whitening[i].whitened(c, f) for i, c, f in zip(some, own, frame)]
        out = [np.zeros((a.size, len(free))) for a in at]
        steps = np.array(
            [-STEP * p.scale if x + STEP * p.scale > p.high else STEP * p.scale for p, x in zip(free, values)]
        )
        left = np.arange(len(free))
        for h in (steps, -steps):
            if not left.size:
                break
            sets = [dict(zip(names, (values + h * (np.arange(len(free)) == i)).tolist())) for i in left]
            there, followed = self.residuals_each(mechanisms, sets, which, frame)
            for o, a, b in zip(out, at, there):
                o[:, left[followed]] = (a[:, None] - b[:, followed]) / h[left[followed]]
            left = left[~followed]
        return out

    def residuals_each(
        self,
        mechanisms: tuple[str, ...],
        sets: Sequence[Mapping[str, float]],
        which: Sequence[int] | None,
        frame: Frame,
    ) -> tuple[list[Array], NDArray[np.bool_]]:
        """`residuals` of several sets of values: (n, sets) by observation, and which sets could be followed."""
        which = self.all if which is None else which
        predicted = predict_each(self.system, mechanisms, sets, which)
        followed = np.array([all(np.all(np.isfinite(y)) for y in p) for p in predicted], bool)
        observations, out = self.system.observations, []
        for k, (i, f) in enumerate(zip(which, frame)):
            y = np.stack([p[k] for p in predicted], axis=1) if predicted else np.zeros((observations[i].t.size, 0))
            r = np.where(followed, observations[i].y[:, None] - y, 0.0)
            out.append(self.whitening[i].whitened(r, f))
        return out, followed

    def cost(
        self,
        mechanisms: tuple[str, ...],
        values: Mapping[str, float],
        which: Sequence[int] | None = None,
        frame: Frame | None = None,
    ) -> float:
        """chi^2 of residuals and priors at some values, without a fit; inf where the model cannot be followed."""
        if frame is None:
            own = {p.name: values.get(p.name, p.start) for p in parameters(self.system, mechanisms)}
            frame = self.frame(mechanisms, own, which)
        return float(self.costs(mechanisms, [values], which, frame)[0])

    def costs(
        self,
        mechanisms: tuple[str, ...],
        sets: Sequence[Mapping[str, float]],
        which: Sequence[int] | None,
        frame: Frame,
    ) -> Array:
        """`cost` of several sets of values, (sets,)."""
        free = parameters(self.system, mechanisms)
        full = [{p.name: s.get(p.name, p.start) for p in free} for s in sets]
        r, followed = self.residuals_each(mechanisms, full, which, frame)
        before = prior_of(free, self.measured)
        pulls = [before.pull(np.array([*s.values()])) for s in full]
        chi2 = sum(np.sum(a * a, axis=0) for a in r) + np.array([p @ p for p in pulls])
        return np.where(followed, chi2, math.inf)

    def fit(
        self,
        mechanisms: tuple[str, ...] = (),
        start: Mapping[str, float] | None = None,
        which: Sequence[int] | None = None,
        iterations: int = ITERATIONS,
        onward: Fit | None = None,
        careful: bool = False,
    ) -> Fit | None:
        """Best values from `start` (default: the parameters' own); None when the model cannot be followed there.

        onward: a fit of these mechanisms to these observations that goes on where it ended. careful: to the minimum,
        also where runs are dear.
        """
        free = parameters(self.system, mechanisms)
        names = [p.name for p in free]
        axes = Axes(free)
        start = onward.named if onward else start or {}
        x = axes.inward(np.array([start.get(p.name, p.start) for p in free], float))
        before = prior_of(free, self.measured)

        def residuals(x: Array, frame: Frame) -> list[Array] | None:
            return self.residuals(mechanisms, dict(zip(names, axes.values(x).tolist())), which, frame)

        def framed(x: Array) -> Frame:
            return self.frame(mechanisms, dict(zip(names, axes.values(x).tolist())), which)

        def cost(r: list[Array], x: Array) -> float:
            pull = before.pull(axes.values(x))
            return float(sum(a @ a for a in r) + pull @ pull)

        frame = onward.frame if onward else framed(x)
        r = onward.residuals if onward else residuals(x, frame)
        if r is None:
            return None
        first = best = cost(r, x)
        damping, converged, costly = 1e-3, True, isinstance(self.system, Costly) and not careful
        share = FINE if careful else ROUGH if costly else 0.0
        jac = onward.jacobian if onward else self.jacobian(mechanisms, free, axes.values(x), r, which, frame)
        for _ in range(iterations if free else 0):
            rate = axes.rate(x)
            scales = np.array([p.scale for p in free]) / rate
            hessian = (sum((j.T @ j for j in jac), before.precision) * rate).T * rate
            slope = rate * (sum(j.T @ a for j, a in zip(jac, r)) + before.rows.T @ before.pull(axes.values(x)))
            gain = 0.0
            enough = max(ENOUGH, share * (best - sum(a.size for a in r))) if share else ENOUGH
            # steps tried in an iteration, ever shorter
            for _ in range(5 if costly else 12):
                step = _bounded(hessian, slope, damping, scales, x, axes.low, axes.high)
                expected = float(2 * slope @ step - step @ hessian @ step)
                if expected < enough:
                    break
                there = residuals(x + step, frame)
                if there is not None and (new := cost(there, x + step)) < best:
                    damping = damping / 10 if best - new > 0.25 * expected else damping
                    gain, best, r, x = best - new, new, there, x + step
                    break
                damping = max(damping * 6.0, 1e-4)
            if gain == 0.0:
                break
            free_step = _bounded(hessian, slope, 1e-9, scales, x, axes.low, axes.high)
            # a small gain of a damped step ends it, unless the free step promised more: then it creeps along a valley
            if gain < enough and float(slope @ free_step) < max(0.02, enough):
                break  # so near that the derivatives are those of here
            # trials scatter about a point less than a standard deviation away as they do about this one
            if self.scattered and gain > 1.0 and (again := residuals(x, moved := framed(x))) is not None:
                frame, r, best = moved, again, cost(again, x)
            jac = self.jacobian(mechanisms, free, axes.values(x), r, which, frame)
        else:
            converged = not free
        fit = self._finish(mechanisms, free, axes.values(x), r, jac, best, before)
        fit.chi2_first, fit.converged, fit.frame = first, converged, frame
        fit.log_evidence -= 0.5 * sum(float(np.sum(np.log1p(size * size))) for _, size in frame)
        return fit

    def polished(self, fit: Fit, *, about: bool = True) -> Fit:
        """A fit of a system whose runs are dear, gone on with derivatives of its own points until no step is worth it;
        where the system is rough, also from the best points about it, along the directions in which it is weakest."""
        system = self.system
        if not (isinstance(system, Costly) and fit.parameters):
            return fit
        with system.carefully():
            again = self.fit(fit.mechanisms, fit.named, careful=True)
            fit = fit if again is None or again.chi2 > fit.chi2 + ENOUGH else again
            for _ in range(SCANS if about and system.rough else 0):
                start = self._along(fit, WEAKEST, REACHES)
                again = None if start is None else self.fit(fit.mechanisms, start, careful=True)
                if again is None or again.chi2 > fit.chi2 - max(1.0, ENOUGH * fit.chi2):
                    break
                fit = again
        return self._close(fit) if about and system.rough else fit

    def _close(self, fit: Fit) -> Fit:
        """A fit of a rough function with derivatives over the usual short steps, as far as they still lead down; its
        covariance by the long ones."""
        system, best = self.system, fit
        assert isinstance(system, Costly)
        with system.carefully(fine=True):
            start: dict[str, float] | None = fit.named
            for _ in range(SCANS):
                again = None if start is None else self.fit(fit.mechanisms, start, careful=True)
                if again is None or again.chi2 >= best.chi2 - ENOUGH:
                    again = best
                best = again
                if (start := self._along(replace(best, covariance=fit.covariance), len(fit.parameters), NEAR)) is None:
                    break
        if best is fit:
            return fit
        with system.carefully():
            return self.fit(fit.mechanisms, best.named, iterations=0) or fit

    def _along(self, fit: Fit, directions: int, reaches: Sequence[float]) -> dict[str, float] | None:
        """The best of a few points along so many directions in which a fit is weakest, as far as misfit makes them
        wide; None where none is better than the fit."""
        width = np.array([p.width for p in fit.parameters])
        size, ways = np.linalg.eigh(fit.covariance / np.outer(width, width))
        wide = math.sqrt(max(fit.chi2 / max(self.n, 1), 1.0))
        low, high = (np.array([getattr(p, end) for p in fit.parameters]) for end in ("low", "high"))
        tries = [
            np.clip(fit.values + sign * far * wide * math.sqrt(size[k]) * ways[:, k] * width, low, high)
            for k in range(size.size)[-directions:]
            for far in reaches
            for sign in (1.0, -1.0)
        ]
        names = [p.name for p in fit.parameters]
        sets = [dict(zip(names, x.tolist())) for x in tries]
        cost = self.costs(fit.mechanisms, sets, None, fit.frame)
        best = int(np.argmin(cost))
        return sets[best] if cost[best] < fit.chi2 - ENOUGH else None

    def evidence_near(self, fit: Fit) -> float:
        """The log evidence that a fit of these observations from `fit` would have, linear about it: without a run."""
        hessian = sum((j.T @ j for j in fit.jacobian), fit.known.precision)
        slope = sum(
            (j.T @ a for j, a in zip(fit.jacobian, fit.residuals)), fit.known.rows.T @ fit.known.pull(fit.values)
        )
        low, high = (np.array([getattr(p, end) for p in fit.parameters]) for end in ("low", "high"))
        step = _bounded(hessian, slope, 1e-9, high - low, fit.values, low, high)
        pull = fit.known.pull(fit.values)
        chi2 = sum(float(a @ a) for a in fit.residuals) + float(pull @ pull)
        chi2 -= float(2 * slope @ step - step @ hessian @ step)
        volume = log_volume(fit.parameters, fit.values + step, hessian, slope - hessian @ step)
        size = sum(float(np.sum(np.log1p(s * s))) for _, s in fit.frame)
        return -0.5 * (chi2 + size) + volume - fit.known.log_chance

    def _finish(
        self,
        mechanisms: tuple[str, ...],
        free: tuple[Parameter, ...],
        x: Array,
        r: list[Array],
        jac: list[Array],
        chi2: float,
        before: Known,
    ) -> Fit:
        hessian = sum((j.T @ j for j in jac), np.zeros((x.size, x.size))) + before.precision
        # a parameter that the data do not touch is as wide as its range
        width = np.array([p.high - p.low for p in free])
        full: Array = np.asarray(hessian + np.diag(12.0 / width**2))
        covariance: Array = np.asarray(np.linalg.inv(full) if x.size else full)
        slope = sum((j.T @ a for j, a in zip(jac, r)), before.rows.T @ before.pull(x))
        evidence = -0.5 * chi2 + log_volume(free, x, hessian, slope) - before.log_chance if x.size else -0.5 * chi2
        return Fit(mechanisms, free, x, r, jac, chi2, covariance, float(evidence), known=before)


HARD = 3.0  # conditional standard deviations by which a parameter's best value lies beyond the end of its range
NEAR_END = 6.0  # standard deviations: an end of a range that is further off cuts nothing from the posterior


def log_volume(free: Sequence[Parameter], x: Array, hessian: Array, slope: Array) -> float:
    """ln of the mean of exp(-(chi^2 - chi^2(x)) / 2) over the priors, chi^2 a parabola cut at the ends of the ranges.

    slope: -d(chi^2/2)/dx, which counts only where it pushes a parameter against an end of its range; elsewhere x is
    the minimum. A parameter that is pushed hard falls off by itself; the others are integrated over together.
    """
    low, high = np.array([p.low for p in free]), np.array([p.high for p in free])
    near_low = x < 0.5 * (low + high)
    curved = hessian + np.diag(1.0 / (BROAD * (high - low)) ** 2)

    def outwards(slope: Array) -> Array:
        return np.where(near_low, slope < 0, slope > 0)

    against = np.array([p.at_end(v) for p, v in zip(free, x)]) & outwards(slope)
    # a fit ends where a step is not worth taking, not where the slope is nil: what the others leave of it is no push
    inside = ~against
    if against.any() and inside.any():
        slope = slope - curved[:, inside] @ np.linalg.solve(curved[np.ix_(inside, inside)], slope[inside])
        against &= outwards(slope)
    push = np.where(against, np.abs(slope), 0.0) / np.sqrt(np.diag(curved))
    hard, soft = push > HARD, push <= HARD
    out = -sum(math.log(p.width) for p in free)
    # over a half-line: of exp(-push u - u^2 / 2)
    alone = 0.5 * push[hard] ** 2 + 0.5 * math.log(2 * math.pi) + scipy.special.log_ndtr(-push[hard])
    out += float(np.sum(alone - 0.5 * np.log(np.diag(curved)[hard])))
    if soft.any():
        inner = curved[np.ix_(soft, soft)]
        covariance: Array = np.asarray(np.linalg.inv(inner))
        pushed = np.where(against, slope, 0.0)[soft]
        mean, sigma = x[soft] + covariance @ pushed, np.sqrt(np.diag(covariance))
        lows, highs = low[soft], high[soft]
        cut = (mean - lows < NEAR_END * sigma) | (highs - mean < NEAR_END * sigma)
        out += 0.5 * float(
            pushed @ covariance @ pushed + soft.sum() * math.log(2 * math.pi) - np.linalg.slogdet(inner)[1]
        )
        out += log_box(mean[cut], covariance[np.ix_(cut, cut)], lows[cut], highs[cut])
    return out


class Axes:
    """Coordinates of a fit: a parameter itself, or its logarithm."""

    def __init__(self, free: Sequence[Parameter]) -> None:
        self.log = np.array([p.log for p in free], bool)
        least = np.array([max(p.low, 1e-4 * p.scale) if p.log else p.low for p in free])
        self.low = np.where(self.log, np.log(np.where(self.log, least, 1.0)), least)
        top = np.array([p.high for p in free])
        self.high = np.where(self.log, np.log(np.where(self.log, top, 1.0)), top)

    def values(self, x: Array) -> Array:
        return np.where(self.log, np.exp(np.where(self.log, x, 0.0)), x)

    def inward(self, values: Array) -> Array:
        """Coordinates of these values, moved into the bounds."""
        with np.errstate(divide="ignore"):
            x = np.where(self.log, np.log(np.where(self.log, np.maximum(values, 0.0), 1.0)), values)
        return np.clip(x, self.low, self.high)

    def rate(self, x: Array) -> Array:
        """d(value)/d(coordinate)."""
        return np.where(self.log, self.values(x), 1.0)


def _bounded(hessian: Array, slope: Array, damping: float, scales: Array, x: Array, low: Array, high: Array) -> Array:
    """Damped Gauss-Newton step that stays within the bounds: coordinates that would leave are set on their bound."""
    step = np.zeros_like(x)
    free = np.ones(x.size, bool)
    # a parameter that does nothing here must not run off: steps much beyond its scale are damped, whatever it does
    damped = hessian + damping * np.diag(np.maximum(np.diag(hessian), 1.0 / scales**2))
    for _ in range(x.size + 1):
        if not free.any():
            break
        rest = slope - damped @ np.where(free, 0.0, step)
        step[free] = np.linalg.solve(damped[np.ix_(free, free)] + 1e-300 * np.eye(int(free.sum())), rest[free])
        out = free & ((x + step < low) | (x + step > high))
        if not out.any():
            break
        step = np.where(out, np.clip(x + step, low, high) - x, step)
        free &= ~out
    return step
