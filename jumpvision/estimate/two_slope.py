"""Force of a slow intrusion against depth: two resistances, overshoots after events, contact point and offset.

F = offset + k1 (z - z_c)+ + (k2 - k1)(z - z_c - delta)+ + O_i exp(-(z - z_i)/lam)    (docs/physics.md section 3)

with ()+ the positive part, z_c the depth at which the foot touches the surface, O_i the overshoot after the last event
at depth z_i. Linear in offset, k1, k2, O_i; the breaks z_c, z_c + delta and lam are searched (variable projection).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

from .estimate import Estimate
from .strokes import Fresh, Roughness, roughness

NAN = float("nan")
BINS = 240  # the log is averaged over so many depths: far below delta, few enough to search
CONTACT_GAIN = 15.0  # chi2 gain that shows a contact point within the log (a chance of 1e-4)
AIR = 0.1  # a first slope below this share of the second is air, not grains
NULL_DRAWS = 999
PLACES = 41  # positions of each break that the posterior is summed over


@dataclass(frozen=True)
class Bins:
    """Means over narrow depth ranges: z [m], F [N], event (number of the last event, -1 before), shape (n,).

    event_depth [m] (events,). path [m] (n,): z with a jump at every withdrawal, past which no fluctuation lasts.
    """

    z: Array
    F: Array
    event: NDArray[np.intp]
    event_depth: Array
    path: Array


@dataclass(frozen=True)
class Penetration:
    """Fitted curve; k1, k2 [N/m], delta, contact, lam [m], offset [N], overshoot [N] (events,) with its covariance.

    delta_low, delta_high: 95 % interval. p_value: chance that one slope alone gives a bend as
    strong as this anywhere. fitted, virgin [N] (n,): the curve over the bins with and without overshoots.
    """

    k1: Estimate
    k2: Estimate
    delta: Estimate
    delta_low: float
    delta_high: float
    contact: Estimate
    offset: Estimate
    lam: Estimate
    overshoot: Array
    overshoot_covariance: Array
    p_value: float
    bins: Bins
    fitted: Array
    virgin: Array
    noise: Roughness

    @property
    def residual(self) -> Array:
        return self.bins.F - self.fitted


def in_bins(depth: Array, force: Array, fresh: Fresh) -> Bins:
    """Means of the fresh samples of a log over BINS depth ranges, never across an event."""
    z, F = depth[fresh.index], force[fresh.index]
    span = max(float(np.ptp(z)), 1e-12)
    number = np.floor((z - z.min()) / span * BINS).astype(np.intp)
    key, inverse, count = np.unique((fresh.event + 1) * (BINS + 2) + number, return_inverse=True, return_counts=True)
    mean_z, mean_F = (np.bincount(inverse, weights=a) / count for a in (z, F))
    event = key // (BINS + 2) - 1
    withdrawals = np.r_[0, np.cumsum([kind == "reintrusion" for kind in fresh.event_kind])]
    return Bins(mean_z, mean_F, event, fresh.event_depth, mean_z + 10.0 * span * withdrawals[event + 1])


@dataclass(frozen=True)
class _Shape:
    """Which nonlinear parameters are searched."""

    contact: bool
    knot: bool
    lam: bool

    def unpack(self, q: Array) -> tuple[float | None, float | None, float | None]:
        values = iter(float(v) for v in q)
        return tuple(next(values) if on else None for on in (self.contact, self.knot, self.lam))  # type: ignore[return-value]


@dataclass(frozen=True)
class _Solution:
    shape: _Shape
    q: Array
    linear: Array
    design: Array
    residual: Array  # whitened

    @property
    def rss(self) -> float:
        return float(self.residual @ self.residual)

    @property
    def size(self) -> int:
        return self.q.size + self.linear.size


def fit_penetration(bins: Bins, *, rng: np.random.Generator, significance: float) -> Penetration:
    """The curve through the bins; k2 and delta are NaN with a reason where one slope explains them at `significance`.

    Least squares find the shape, its residuals the noise (white and correlated in depth, see `rough`), generalised
    least squares the values. Without a part in the air at the start of the log depth 0 is taken as the surface.
    """
    n, white = bins.z.size, np.eye(bins.z.size)
    events = bins.event_depth.size > 0
    start = _solve(bins, _Shape(True, True, events), white)
    jacobian = _jacobian(bins, start)
    noise = roughness(
        start.residual, jacobian, bins.path, np.maximum(bins.z - start.q[0], 0.0), width=float(np.ptp(bins.z)) / BINS
    )
    free, flat = (_solve(bins, _Shape(contact, True, events), noise.whiten) for contact in (True, False))
    in_air = abs(flat.linear[1]) < AIR * abs(flat.linear[1] + flat.linear[2])  # its one break is the contact
    two = free if in_air or (flat.rss - free.rss) / (free.rss / (n - free.size)) > CONTACT_GAIN else flat
    one = _solve(bins, replace(two.shape, knot=False), noise.whiten)
    p_value = _chance(bins, one, two, noise.whiten, rng)
    return _report(bins, two if p_value < significance else one, noise, p_value)


def _design(b: Bins, contact: float | None, knot: float | None, lam: float | None) -> Array:
    z = b.z
    columns = [np.ones_like(z), z if contact is None else np.maximum(z - contact, 0.0)]
    if knot is not None:
        columns.append(np.maximum(z - knot, 0.0))
    if lam is not None:
        decay = np.exp(-_beyond(b) / lam)
        columns += [np.where(b.event == i, decay, 0.0) for i in range(b.event_depth.size)]
    return np.stack(columns, axis=1)


def _beyond(b: Bins) -> Array:
    """Depth past the last event [m], 0 before the first."""
    return np.where(b.event >= 0, b.z - b.event_depth[b.event], 0.0)


def _at(b: Bins, shape: _Shape, q: Array, whiten: Array) -> _Solution:
    design = _design(b, *shape.unpack(q))
    a, y = whiten @ design, whiten @ b.F
    linear: Array = np.linalg.lstsq(a, y, rcond=None)[0].astype(np.float64)
    return _Solution(shape, q, linear, design, y - a @ linear)


def _solve(b: Bins, shape: _Shape, whiten: Array) -> _Solution:
    """Least squares over the breaks and lam: one after the other on a grid, then together.

    With both breaks the search starts also from the fit without a bend, whose contact point is sharp.
    """
    low, span = float(b.z.min()), float(np.ptp(b.z))
    inner = low + span * np.linspace(0.02, 0.98, 49)
    first = {"contact": low + 0.05 * span, "knot": low + 0.5 * span, "lam": 0.05 * span}
    grids = {"contact": inner, "knot": inner, "lam": span * np.geomspace(0.005, 0.5, 12)}
    names = [k for k in grids if getattr(shape, k)]
    if not names:
        return _at(b, shape, np.zeros(0), whiten)
    bounds = ([grids[k][0] for k in names], [grids[k][-1] for k in names])

    def search(start: dict[str, float], order: list[str]) -> _Solution:
        q = np.array([start[k] for k in names])
        for k in order:
            i = names.index(k)
            q[i] = min(grids[k], key=lambda g: _at(b, shape, np.r_[q[:i], g, q[i + 1 :]], whiten).rss)
        fit = scipy.optimize.least_squares(
            lambda v: _at(b, shape, v, whiten).residual, q, bounds=bounds, x_scale=0.02 * span
        )
        return _at(b, shape, fit.x, whiten)

    best = search(first, 2 * names)
    if shape.contact and shape.knot:
        one = _solve(b, replace(shape, knot=False), whiten)
        straight = dict(zip([k for k in names if k != "knot"], one.q))
        best = min(best, search(first | straight, ["knot"]), key=lambda s: s.rss)
        if best.q[0] > best.q[1]:  # the breaks are named in order
            best = _at(b, shape, np.r_[best.q[1::-1], best.q[2:]], whiten)
    return best


def _jacobian(b: Bins, s: _Solution) -> Array:
    """Derivatives of the model by the linear, then the nonlinear parameters, shape (n, p)."""
    contact, knot, lam = s.shape.unpack(s.q)
    columns = []
    if contact is not None:
        columns.append(-s.linear[1] * (b.z > contact))
    if knot is not None:
        columns.append(-s.linear[2] * (b.z > knot))
    if lam is not None:
        first = 2 + (knot is not None)
        columns.append(s.design[:, first:] @ s.linear[first:] * _beyond(b) / lam**2)
    return np.column_stack([s.design, *columns])


def _chance(b: Bins, one: _Solution, two: _Solution, whiten: Array, rng: np.random.Generator) -> float:
    """Chance of a gain as large from a break searched anywhere, when there is none (sup-F, null simulated)."""
    n = b.z.size
    seen = (one.rss - two.rss) / (two.rss / (n - two.size))
    base, _ = np.linalg.qr(whiten @ _jacobian(b, one))
    knots = b.z.min() + np.ptp(b.z) * np.linspace(0.03, 0.97, 60)
    hinge = whiten @ np.maximum(b.z[:, None] - knots[None, :], 0.0)
    hinge -= base @ (base.T @ hinge)
    size = np.linalg.norm(hinge, axis=0)
    hinge = hinge[:, size > 1e-6 * size.max()] / size[size > 1e-6 * size.max()]
    noise = rng.normal(size=(n, NULL_DRAWS))
    noise -= base @ (base.T @ noise)
    gain = ((hinge.T @ noise) ** 2).max(axis=0)
    drawn = gain / ((np.sum(noise**2, axis=0) - gain) / (n - two.size))
    return float((1 + np.count_nonzero(drawn >= seen)) / (1 + NULL_DRAWS))


def _report(b: Bins, s: _Solution, noise: Roughness, p_value: float) -> Penetration:
    n, size = b.z.size, s.linear.size
    contact, knot, lam = s.shape.unpack(s.q)
    mean, cov, deltas, weight = _average(b, s, noise.whiten)
    present = [k for k in ("contact", "knot", "lam") if getattr(s.shape, k)]
    column = {"offset": 0, "k1": 1, "bend": 2} | {k: size + i for i, k in enumerate(present)}

    def estimate(unit: str, **weights: float) -> Estimate:
        row = np.zeros(mean.size)
        for name, w in weights.items():
            row[column[name]] = w
        return Estimate(float(row @ mean), float(np.sqrt(row @ cov @ row)), unit, n, s.rss)

    def without(unit: str, reason: str) -> Estimate:
        return Estimate(NAN, NAN, unit, n, s.rss, reason)

    first = 2 + (knot is not None)
    one_slope = f"one slope suffices (p = {p_value:.2g})"
    k2, delta, low, high = without("N/m", one_slope), without("m", one_slope), NAN, NAN
    if knot is not None:
        surface = {} if contact is None else {"contact": -1.0}
        k2, delta = estimate("N/m", k1=1.0, bend=1.0), estimate("m", knot=1.0, **surface)
        order = np.argsort(deltas)
        share = np.cumsum(weight[order]) - 0.5 * weight[order]
        low, high = np.interp([0.025, 0.975], share, deltas[order])
    touching = without("m", "the log begins in contact: depth 0 is taken as the surface")
    design = _design(b, *s.shape.unpack(mean[size:]))
    return Penetration(
        k1=estimate("N/m", k1=1.0),
        k2=k2,
        delta=delta,
        delta_low=float(low),
        delta_high=float(high),
        contact=touching if contact is None else estimate("m", contact=1.0),
        offset=estimate("N", offset=1.0),
        lam=without("m", "no pause or withdrawal") if lam is None else estimate("m", lam=1.0),
        overshoot=mean[first:size],
        overshoot_covariance=cov[first:size, first:size],
        p_value=p_value,
        bins=b,
        fitted=design @ mean[:size],
        virgin=design[:, :first] @ mean[:first],
        noise=noise,
    )


def _average(b: Bins, s: _Solution, whiten: Array) -> tuple[Array, Array, Array, Array]:
    """(mean, covariance) of all parameters over the positions of the breaks, weighted by their posterior probability
    under flat priors; then delta at each of them and the weights.

    A break in noise of short correlation is no regular parameter: its best position scatters more than the curvature of
    chi2 there says. Everything else, lam too, is linear about the best fit.
    """
    contact, knot, lam = s.shape.unpack(s.q)
    variance, size = s.rss / (b.z.size - s.size), s.linear.size
    places = [_places(b, s, whiten, i, 20.0 * variance) for i in range(s.shape.contact + s.shape.knot)]
    hinges = [np.maximum(b.z[:, None] - p[None, :], 0.0) for p in places]
    smooth = np.delete(
        s.design, range(3 - len(places), 2 + s.shape.knot) if contact is None else [1, 2][: len(places)], 1
    )
    if lam is not None:
        smooth = np.column_stack([smooth, _jacobian(b, s)[:, -1]])
    x = whiten @ np.column_stack([smooth, *hinges])
    norm = np.linalg.norm(x, axis=0)
    x, y = x / norm, whiten @ b.F
    gram, right = x.T @ x, x.T @ y
    steps = np.cumsum([smooth.shape[1], *(p.size for p in places)])
    choice = np.meshgrid(*(np.arange(i, i + p.size) for i, p in zip(steps, places)), indexing="ij")
    breaks = np.stack([c.ravel() for c in choice], axis=1) if places else np.zeros((1, 0), dtype=int)
    value = (
        np.stack([np.concatenate(places)[c.ravel() - smooth.shape[1]] for c in choice], axis=1) if places else breaks
    )
    if len(places) == 2:
        ordered = value[:, 0] < value[:, 1]
        breaks, value = breaks[ordered], value[ordered]
    lead = 1 if contact is not None else 2  # smooth columns before the hinges: 1 (and z)
    front = np.tile(np.arange(lead), (len(breaks), 1))
    back = np.tile(np.arange(lead, smooth.shape[1]), (len(breaks), 1))
    use = np.hstack([front, breaks, back])
    inverse = np.linalg.inv(gram[use[:, :, None], use[:, None, :]])
    solution = np.einsum("gij,gj->gi", inverse, right[use])
    rss = y @ y - np.einsum("gi,gi->g", solution, right[use])
    log = -0.5 * (rss - rss.min()) / variance + 0.5 * np.linalg.slogdet(inverse)[1] - np.log(norm[use]).sum(axis=1)
    w = np.exp(log - log.max())
    w /= w.sum()
    theta = solution / norm[use]
    within = variance * inverse / norm[use][:, :, None] / norm[use][:, None, :]
    order = [*range(size), *([size] if lam is not None else [])]
    theta, within = theta[:, order], within[:, order][:, :, order]
    p = size + value.shape[1] + (lam is not None)
    full, spread = np.zeros((len(w), p)), np.zeros((len(w), p, p))
    at = [*range(size), *([p - 1] if lam is not None else [])]
    full[:, at], full[:, size : size + value.shape[1]] = theta, value
    spread[:, np.array(at)[:, None], at] = within
    if lam is not None:
        full[:, -1] += lam
    mean = w @ full
    off = full - mean
    cov = np.einsum("g,gij->ij", w, spread) + np.einsum("g,gi,gj->ij", w, off, off)
    for i, p in enumerate(places):
        cov[size + i, size + i] += (p[1] - p[0]) ** 2 / 12.0
    delta = value[:, -1] - (value[:, 0] if contact is not None else 0.0) if knot is not None else np.zeros(0)
    return mean, cov, delta, w


def _places(b: Bins, s: _Solution, whiten: Array, i: int, allowed: float) -> Array:
    """Positions of break i around the best, as far as the sum of squares rises by at most `allowed`."""
    others = [q for j, q in enumerate(s.q[: s.shape.contact + s.shape.knot]) if j != i]
    ends = []
    for side, edge in ((-1.0, float(b.z.min())), (1.0, float(b.z.max()))):
        limit = min(
            [q for q in [*others, edge] if (q - s.q[i]) * side > 0], key=lambda q: abs(q - s.q[i]), default=edge
        )
        step, end = 2e-4 * float(np.ptp(b.z)), float(s.q[i])
        while (limit - end) * side > step:
            end, step = end + side * step, 1.3 * step
            if _at(b, s.shape, np.r_[s.q[:i], end, s.q[i + 1 :]], whiten).rss - s.rss > allowed:
                break
        ends.append(end)
    return np.linspace(ends[0], ends[1], PLACES)
