"""Slow intrusion: the force of a first intrusion and the overshoots after pauses and withdrawals, fitted at once.

    F(z) = F_0 + F_first(z - z_c) + O_i exp(-(z - z_i)/lam),   O_i = s (z_i - z_c) + c O_{i-1} exp(-(z_i - z_{i-1})/lam)

after the last event i at z_i. F_first is a `Family`: one slope, two slopes with a bend, or a cone of the caller's.
Posterior means and standard deviations over everything that is not known, the noise included (`posterior`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

from .estimate import Estimate
from .posterior import Drawn, Solved, draw, evidence, maximum, whitened
from .strokes import Fresh

BINS = 240  # the log is averaged over so many depths: far below delta, few enough to search
CONTACT_GAIN = 3.0  # gain in log density that shows a contact point within the log
AIR, AIR_AT_START = 0.1, 0.5  # a first slope below this share of the last is air; the second of a log without a surface
DEEPEST = 0.95  # of the depth that the log reaches: a bend below that is not seen
NULL_DRAWS = 999
KNOTS = 60  # places at which a bend is looked for against one slope
SURE = 3.0  # sigmas from which compounding enters the law
PARTS = (np.arange(5) - 2.0) / 5.0  # of a bin, at which a force is taken
LAWS = {"reintrusion": "s", "stop_go": "s_p"}  # kind of event: its overshoot per depth


@dataclass(frozen=True)
class Bins:
    """Means over narrow depth ranges: z [m], F [N], event (number of the last event, -1 before), shape (n,).

    event_depth [m], event_pause [s], event_kind (events,): see `Fresh`. cells (n, 3): where the bin begins [m], with a
    jump at every withdrawal, past which no fluctuation lasts, how long it is [m], its share of the load cell's noise
    (variance over the usual one).
    """

    z: Array
    F: Array
    event: NDArray[np.intp]
    event_depth: Array
    event_pause: Array
    event_kind: tuple[str, ...]
    cells: Array

    @cached_property
    def width(self) -> float:
        """Of a bin [m]."""
        return float(np.ptp(self.z)) / BINS


def in_bins(depth: Array, force: Array, fresh: Fresh) -> Bins:
    """Means of the fresh samples of a log over BINS depth ranges, never across an event."""
    z, F = depth[fresh.index], force[fresh.index]
    span = max(float(np.ptp(z)), 1e-12)
    number = np.floor((z - z.min()) / span * BINS).astype(np.intp)
    key, inverse, count = np.unique((fresh.event + 1) * (BINS + 2) + number, return_inverse=True, return_counts=True)
    mean_z, mean_F = (np.bincount(inverse, weights=a) / count for a in (z, F))
    event = key // (BINS + 2) - 1
    low, high = np.full(key.size, np.inf), np.full(key.size, -np.inf)
    np.minimum.at(low, inverse, z)
    np.maximum.at(high, inverse, z)
    half = 0.5 * (high - low) / np.maximum(count - 1, 1)  # of the way from a sample to the next
    withdrawals = np.r_[0, np.cumsum([kind == "reintrusion" for kind in fresh.event_kind])]
    begin = low - half + 10.0 * span * withdrawals[event + 1]
    cells = np.stack([begin, high - low + 2.0 * half, count.mean() / count], axis=1)
    return Bins(mean_z, mean_F, event, fresh.event_depth, fresh.event_pause, fresh.event_kind, cells)


@dataclass(frozen=True)
class Family:
    """Forces of a first intrusion: columns(z, shape) (n, p) at depths z >= 0 below the surface [m].

    names, units: of the linear parameters (p,), the first the slope at the surface; deep (p,): the last slope [N/m] is
    their sum with it. shape: a depth [m] whose prior is flat where the log could show its bend; with a range [m]
    that of 1/shape is, over it.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    deep: tuple[float, ...]
    columns: Callable[[Array, float], Array]
    shaped: bool = True
    range: tuple[float, float] | None = None


ONE = Family(("k1",), ("N/m",), (1.0,), lambda z, none: z[:, None], shaped=False)
TWO = Family(
    ("k1", "k2"),
    ("N/m", "N/m"),
    (0.0, 1.0),
    lambda z, delta: np.stack([np.minimum(z, delta), np.maximum(z - delta, 0.0)], axis=1),
)


@dataclass(frozen=True)
class Noise:
    """white, correlated [N]: standard deviations of the two parts; length [m] over which the second is correlated."""

    white: float
    correlated: float
    length: float


@dataclass(frozen=True)
class Place:
    """What a curve is not linear in: contact, shape, lam [m], carry, and the noise's correlated share and length [m].

    NaN where the model has none.
    """

    contact: float
    shape: float
    lam: float
    carry: float
    share: float
    length: float


@dataclass(frozen=True)
class Model:
    """A family with its overshoots over the bins; contact: the log begins in the air; carry: overshoots compound."""

    bins: Bins
    family: Family
    contact: bool
    carry: bool = False

    @cached_property
    def axes(self) -> dict[str, tuple[float, float, float]]:
        """(low, high, first guess of the spread) of each coordinate: depths in bins, lengths as logarithms."""
        n, wide = float(BINS), math.log(BINS)
        first = float(self.bins.z[0]) / self.bins.width
        out = {"contact": (first + 1.0, first + 0.9 * n, 2.0)} if self.contact else {}
        if self.family.shaped:
            out["shape"] = (2.0, DEEPEST * n, 8.0)
        if self.family.range:
            ends = [1.0 / x for x in self.family.range[::-1]]
            out["shape"] = (ends[0], ends[1], 0.05 * (ends[1] - ends[0]))
        if self.bins.event_depth.size:
            out["lam"] = (-0.5, wide, 0.3)
        if self.carry:
            out["carry"] = (-0.9, 1.5, 0.2)
        return out | {"share": (-7.0, 7.0, 1.0), "length": (math.log(0.5), math.log(0.3 * n), 0.5)}

    def at(self, q: Array) -> Place:
        """The place of the coordinates q, in the order of `axes`."""
        v, w = dict(zip(self.axes, map(float, q))), self.bins.width
        shape = v.get("shape", math.nan)
        return Place(
            v["contact"] * w if self.contact else math.nan,
            1.0 / shape if self.family.range else w * shape,
            w * math.exp(v["lam"]) if "lam" in v else math.nan,
            v.get("carry", 0.0),
            1.0 / (1.0 + math.exp(-v["share"])),
            w * math.exp(v["length"]),
        )

    def below(self, p: Place, z: Array | None = None) -> Array:
        """Depths z below the surface [m], 0 in the air, or as they stand in a log without a surface. Default: bins."""
        z = self.bins.z if z is None else z
        return np.maximum(z - p.contact, 0.0) if self.contact else np.maximum(z, 0.0)

    def overshoots(self, p: Place) -> dict[str, Array]:
        """Of each event (events,) for a unit of each parameter of the law, by its name."""
        b = self.bins
        z = np.maximum(b.event_depth - (p.contact if self.contact else 0.0), 0.0)
        kinds, out = np.array(b.event_kind), {}
        for kind, name in LAWS.items():
            if np.any(mine := kinds == kind):
                out[name] = np.where(mine, z, 0.0)
        t = b.event_pause[kinds == "stop_go"] if kinds.size else np.zeros(0)
        # pauses must differ by a factor of 2 to show a dependence
        if t.size >= 3 and t.min() > 0.0 and t.max() > 2.0 * t.min():
            out["s_p_per_decade"] = np.where(
                kinds == "stop_go", z * np.log10(np.where(b.event_pause > 0, b.event_pause, 1)), 0.0
            )
        if self.carry:
            keep = p.carry * np.exp(-np.diff(b.event_depth) / p.lam)
            for column in out.values():
                for i in range(1, column.size):
                    column[i] += keep[i - 1] * column[i - 1]
        return out

    def decay(self, p: Place) -> Array:
        """What is left of the last event's overshoot (n,), 0 before the first."""
        b = self.bins
        if not b.event_depth.size:
            return np.zeros(b.z.size)
        return np.where(b.event >= 0, np.exp(-(b.z - b.event_depth[b.event]) / p.lam), 0.0)

    def design(self, p: Place) -> Array:
        """(n, 1 + family + laws): offset, first intrusion, overshoots."""
        decay, cells = self.decay(p), self.bins.cells
        within = (self.bins.z + PARTS[:, None] * cells[:, 1]).ravel()  # a bend inside a bin is not that of its middle
        first = self.family.columns(self.below(p, within), p.shape).reshape(PARTS.size, decay.size, -1).mean(axis=0)
        over = [decay * column[self.bins.event] for column in self.overshoots(p).values()]
        return np.column_stack([np.ones(decay.size), first, *over])

    def loud(self, p: Place) -> Array:
        """Share of the grains' fluctuations (n,): they build up from nothing at the surface."""
        return np.sqrt(-np.expm1(-2.0 * np.maximum(self.below(p), 0.0) / p.length))

    def solve(self, q: Array) -> Solved:
        """`evidence` at q; no density where the bend is not in the log, or the first slope that of air."""
        p, b = self.at(q), self.bins
        solved: Solved = evidence(b.F, self.design(p), b.cells, self.loud(p), p.share, p.length)
        k = solved[2][1 : 1 + len(self.family.names)]
        deep = float(k @ np.array(self.family.deep))
        late = self.family.shaped and not self.family.range and p.shape > DEEPEST * float(self.below(p)[-1])
        if late or not (k[0] > 0.0 and k[0] > (AIR if self.contact else AIR_AT_START) * deep):
            return -math.inf, *solved[1:]
        return solved

    def starts(self) -> list[Array]:
        """Coordinates over a grid of contact, shape and lam."""
        n, first = float(BINS), float(self.bins.z[0]) / self.bins.width
        usual = {"carry": [0.0], "share": [0.0], "length": [1.0], "lam": list(np.log(np.geomspace(1.5, 0.3 * n, 6)))}
        usual["contact"] = list(first + n * np.r_[np.linspace(0.01, 0.25, 13), np.linspace(0.3, 0.8, 4)])
        usual["shape"] = list(np.geomspace(4.0, 0.9 * n, 10))
        if self.family.range:
            usual["shape"] = list(1.0 / np.geomspace(*self.family.range, 10)[1:-1])
        grids = np.meshgrid(*(usual[name] for name in self.axes), indexing="ij")
        return list(np.stack([g.ravel() for g in grids], axis=1))

    def best(self, start: Mapping[str, float] | None = None) -> tuple[Array, float]:
        """(q, log density) of the greatest density; start: coordinates to begin at in place of a grid."""
        low, high, scale = np.array(list(self.axes.values())).T
        starts = self.starts() if start is None else [np.array([start.get(n, 0.0) for n in self.axes])]
        return maximum(self.solve, starts, low, high, 0.5 * scale)

    def drawn(self, q: Array, rng: np.random.Generator) -> Drawn:
        """The posterior about its best place."""
        low, high, scale = np.array(list(self.axes.values())).T
        size = 1 + len(self.family.names) + len(self.overshoots(self.at(q)))
        return draw(self.solve, q, low, high, scale, dof=self.bins.z.size - size, rng=rng)


@dataclass(frozen=True)
class Fitted:
    """A model with the draws of its posterior. fits: by the names of the file; delta_low, delta_high: 95 %."""

    model: Model
    drawn: Drawn
    fits: Mapping[str, Estimate]
    place: Place
    b: Array
    noise: Noise

    @property
    def surface(self) -> float:
        """Depth of the surface [m]: 0 where the log begins in contact."""
        return self.fits["contact_depth_m"].value if self.model.contact else 0.0

    @property
    def curve(self) -> Array:
        """(n,) [N]: the force over the bins, without the offset."""
        return self.model.design(self.place)[:, 1:] @ self.b[1:]

    @property
    def parts(self) -> Array:
        """(n, p) [N]: what each linear parameter of the first intrusion adds."""
        p = len(self.model.family.names)
        return self.model.design(self.place)[:, 1 : 1 + p] * self.b[1 : 1 + p]

    @property
    def residual(self) -> Array:
        """(n,) [N]"""
        return self.model.bins.F - self.b[0] - self.curve

    def shape_interval(self) -> tuple[float, float]:
        """95 % of the shape [m]."""
        shapes = np.array([self.model.at(q).shape for q in self.drawn.q])
        low, high = self.drawn.quantiles(shapes, (0.025, 0.975))
        return low, high

    def number(self, values: Array, gradient: Array | None, unit: str) -> Estimate:
        """Of the draws' values (m,) of something, gradient (m, p) by their linear parameters."""
        none = np.zeros(self.drawn.b.shape)
        mean, sigma = self.drawn.moments(values, none if gradient is None else gradient)
        return Estimate(mean, sigma, unit, self.model.bins.z.size, self.chi2)

    @property
    def chi2(self) -> float:
        """Sum of squares of the residual over the fitted noise: as many as there are degrees of freedom."""
        return float(self.model.bins.z.size - self.b.size)

    def events(self) -> tuple[Array, Array]:
        """Overshoot of every event by itself [N] (events,) and its covariance, at the fitted contact, shape and lam."""
        m, p, b = self.model, self.place, self.model.bins
        count = b.event_depth.size
        decay, first = m.decay(p), 1 + len(m.family.names)
        each = [np.where(b.event == i, decay, 0.0) for i in range(count)]
        X = np.column_stack([m.design(p)[:, :first], *each])
        W, _ = whitened(np.column_stack([X, b.F]), b.cells, m.loud(p), p.share, p.length)
        inverse = np.linalg.pinv(W[:, :-1].T @ W[:, :-1])
        value = inverse @ (W[:, :-1].T @ W[:, -1])
        return value[first:], self.noise_variance * inverse[first:, first:]

    @property
    def noise_variance(self) -> float:
        """Of white and correlated noise together [N^2]."""
        return self.noise.white**2 + self.noise.correlated**2


def fitted(model: Model, q: Array, rng: np.random.Generator) -> Fitted:
    """The posterior of a model about its best place q."""
    drawn = model.drawn(q, rng)
    place, (_, rss, _, _) = model.at(q), model.solve(q)
    dof = model.bins.z.size - drawn.b.shape[1]
    size = math.sqrt(rss / dof)
    noise = Noise(size * math.sqrt(1.0 - place.share), size * math.sqrt(place.share), place.length)
    mean = {n: float(drawn.weight @ drawn.q[:, i]) for i, n in enumerate(model.axes)}
    centre = model.at(np.array(list(mean.values())))
    b = model.solve(np.array(list(mean.values())))[2]
    out = Fitted(model, drawn, {}, centre, b, noise)
    places = [model.at(x) for x in drawn.q]
    first = 1 + len(model.family.names)
    fits = {"weight_N": out.number(drawn.b[:, 0], _only(drawn.b, 0), "N")}
    for i, (name, unit) in enumerate(zip(model.family.names, model.family.units), 1):
        fits[name] = out.number(drawn.b[:, i], _only(drawn.b, i), unit)
    if model.contact:
        fits["contact_depth_m"] = out.number(np.array([p.contact for p in places]), None, "m")
    if model.family.shaped:
        fits["shape"] = out.number(np.array([p.shape for p in places]), None, "m")
    if model.bins.event_depth.size:
        fits["lam"] = out.number(np.array([p.lam for p in places]), None, "m")
    for i, name in enumerate(model.overshoots(place), first):
        fits[name] = out.number(drawn.b[:, i], _only(drawn.b, i), "N/m")
    if model.carry:
        fits["compounding"] = out.number(np.array([p.carry for p in places]), None, "")
    return replace(out, fits=fits)


def _only(b: Array, i: int) -> Array:
    """Gradient (m, p) of linear parameter i."""
    out = np.zeros(b.shape)
    out[:, i] = 1.0
    return out


def one_slope(two: Fitted, rng: np.random.Generator) -> Fitted:
    """The posterior of one slope, begun where that of two is best."""
    model = replace(two.model, family=ONE)
    q, _ = model.best(dict(zip(two.model.axes, map(float, two.drawn.best))))
    made = fitted(model, q, rng)
    return replace(made, fits={n: e for n, e in two.fits.items() if n == "compounding"} | dict(made.fits))


def begins_in_air(bins: Bins) -> bool:
    """Whether the log shows the surface: two slopes from a contact point are far likelier than two from its start."""
    free, flat = (Model(bins, TWO, contact).best()[1] for contact in (True, False))
    return free - flat > CONTACT_GAIN


def fit_family(bins: Bins, family: Family, contact: bool, rng: np.random.Generator) -> Fitted:
    """A family's posterior. Overshoots compound where that is sure; else `compounding` stands beside a law without."""
    model = Model(bins, family, contact)
    q, _ = model.best()
    out = fitted(model, q, rng)
    # an overshoot farther back than 4 lam leaves nothing
    near = bins.event_depth.size >= 4 and float(np.diff(bins.event_depth).min()) < 4.0 * out.fits["lam"].value
    if not near:
        return out
    start = dict(zip(model.axes, map(float, q)))
    compounds = replace(model, carry=True)
    more = fitted(compounds, compounds.best(start)[0], rng)
    carry = more.fits["compounding"]
    if abs(carry.value) > SURE * carry.sigma:
        return more
    return replace(out, fits={**out.fits, "compounding": carry})


def chance_of_one_slope(two: Fitted, rng: np.random.Generator) -> float:
    """Chance of a gain as large from a bend searched anywhere, when there is none (sup-F, null simulated)."""
    one, b = Model(two.model.bins, ONE, two.model.contact, two.model.carry), two.model.bins
    p = two.place
    start = {n: v for n, v in zip(two.model.axes, map(float, two.drawn.best)) if n != "shape"}
    q, _ = one.best(start)
    at = replace(one.at(q), share=p.share, length=p.length)
    X = one.design(at)
    beta = np.linalg.lstsq(X, b.F, rcond=None)[0]
    moves = []
    for name in ("contact", "lam", "carry"):
        if name in one.axes:
            step = 0.01 if name == "carry" else 0.1 * b.width
            up, down = (replace(at, **{name: getattr(at, name) + d}) for d in (step, -step))
            moves.append((one.design(up) - one.design(down)) @ beta)
    knots = b.z.min() + np.ptp(b.z) * np.linspace(0.03, 0.97, KNOTS)
    hinges = np.maximum(b.z[:, None] - knots[None, :], 0.0)
    A = np.column_stack([X, *moves, hinges, b.F])
    W, _ = whitened(A, b.cells, one.loud(at), at.share, at.length)
    base, _ = np.linalg.qr(W[:, : X.shape[1] + len(moves)])
    left = W - base @ (base.T @ W)
    hinge, seen = left[:, -KNOTS - 1 : -1], left[:, -1:]
    size = np.linalg.norm(hinge, axis=0)
    hinge = hinge[:, size > 1e-6 * size.max()] / size[size > 1e-6 * size.max()]
    noise = rng.normal(size=(b.z.size, NULL_DRAWS))
    noise -= base @ (base.T @ noise)
    dof = b.z.size - base.shape[1] - 2

    def gain(y: Array) -> Array:
        most = ((hinge.T @ y) ** 2).max(axis=0)
        return np.asarray(most / ((np.sum(y**2, axis=0) - most) / dof))

    return float((1 + np.count_nonzero(gain(noise) >= gain(seen)[0])) / (1 + NULL_DRAWS))
