"""With what a number goes that differs from recording to recording: patterns of N values, weighed by evidence.

A pattern is linear: the changes are design @ coefficients, each coefficient normal about 0 with the variable's spread
before the data. Its evidence follows from the values and their information alone, no simulation. The price of many
questions is the logarithm of how many alternatives of a kind were looked at.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from jumpvision.base.arrays import Z90, Array
from jumpvision.engine.document.values import Pattern as Kind
from jumpvision.engine.system import Observation

from .apart import Apart
from .variables import Variable

ODD = 4  # recordings at most that stand apart each for itself
WIDTHS = (1.0, 0.1, 0.01)  # spreads that a coefficient may have before the data, one as likely as another
SCATTERS = 5.0  # nats over one value for all recordings, from which they are said to differ: odds of 150
FAR = 1.5  # factor from which a number was entered wrong rather than off
INSTANTS = 1000  # of a record at which frames may have been lost, by one or a few
LEVELS = ("frequency", "amplitude", "delay", "volume_fraction")  # labels of the motion that a number may go with


@dataclass(frozen=True)
class Pattern:
    """A way in which the recordings differ in a number.

    variables: of each coefficient, mostly the same. of: what it goes with, None where it has no order. design: (N, k).
    members: recordings that stand apart. at: (N,) abscissa, NaN where not known. break_at: where a step or a bend lies,
    in units of `at`. log_price: of the alternatives of its kind. since: (N,) as in Apart. widths: (k,) of the
    coefficients before the data, in the place of the numbers' spreads: of a number that is off by a factor. also: other
    numbers of the same recording that do as well.
    """

    variables: tuple[Variable, ...]
    kind: Kind
    of: str | None
    design: Array
    members: tuple[int, ...] = ()
    at: Array | None = None
    break_at: float = math.nan
    log_price: float = 0.0
    since: Array | None = None
    widths: Array | None = None
    also: tuple[str, ...] = ()

    @property
    def variable(self) -> Variable:
        return self.variables[0]

    @property
    def name(self) -> str:
        """Of the candidate that it becomes."""
        what = "+".join(dict.fromkeys(v.name for v in self.variables))
        where = ",".join(map(str, self.members)) if self.kind in (Kind.ODD, Kind.STEP) else ""
        bend = f"@{self.break_at:g}" if math.isfinite(self.break_at) else ""
        return f"{what} {self.kind} {self.of or ''}{where}{bend}/{self.design.shape[1]}"

    @property
    def about_own(self) -> bool:
        """Whether a common value of its own is among the coefficients."""
        return self.design.shape[1] > 1 and bool(np.all(self.design[:, -1] == 1.0))

    @property
    def spreads(self) -> Array:
        """(k,) of the coefficients, before the data."""
        if self.widths is not None:
            return self.widths
        return np.array([v.spread for v in self.variables])

    def far(self, coefficients: Array) -> bool:
        """Whether a number is off by a factor, as what was entered wrong is."""
        changes = zip(self.variables, coefficients)
        return any(v.relative and not 1.0 / FAR < 1.0 + float(x) < FAR for v, x in changes)

    def changes(self, coefficients: Array) -> dict[str, Array]:
        """(N,) of every number that it changes."""
        out: dict[str, Array] = {}
        for v, column, b in zip(self.variables, self.design.T, coefficients):
            out[v.name] = out.get(v.name, 0.0) + b * column
        return out


@dataclass(frozen=True)
class Weighed:
    """A pattern with the coefficients that suit the values best, and its log evidence, the price paid.

    chi2: of the whole model with it, as the information foretells. shared: what the shared parameters are beside it.
    """

    pattern: Pattern
    coefficients: Array
    covariance: Array
    chi2: float
    log_evidence: float
    shared: Mapping[str, float] = field(default_factory=dict)

    @property
    def significance(self) -> float:
        """Of the coefficients other than a common value of its own, in standard uncertainties."""
        own = self.coefficients.size - self.pattern.about_own
        values = self.coefficients[:own]
        return math.sqrt(max(float(values @ np.linalg.solve(self.covariance[:own, :own], values)), 0.0))

    @property
    def far(self) -> bool:
        """Whether a number is off by a factor, as what was entered wrong is."""
        return self.pattern.far(self.coefficients)


@dataclass(frozen=True)
class Scatter:
    """A number that differs from recording to recording without order: its standard deviation [as a change], the 90 %
    interval of it. gained: nats over no scatter, the price of the question paid. shift: of the common value from the
    declared one, in its standard uncertainties; 0 where the common value is fitted."""

    variable: Variable
    value: float
    low: float
    high: float
    log_evidence: float
    apart: Apart = field(repr=False, compare=False)
    gained: float = 0.0
    shift: float = 0.0


def weigh(pattern: Pattern, found: Apart) -> Weighed:
    """The evidence of a pattern, its price off: with the likeliest of the widths that its coefficients may have before
    the data, of which none is likelier than another."""
    x, p = pattern.design, found.information
    normal, right = x.T @ p @ x, x.T @ (p @ found.change)
    spreads = [pattern.spreads * w for w in WIDTHS]
    inner = [normal + np.diag(s**-2.0) for s in spreads]
    fits = np.linalg.solve(inner, np.broadcast_to(right[:, None], (len(WIDTHS), right.size, 1)))[..., 0]
    size = found.chi2 + float(found.change @ p @ found.change)
    volumes = [0.5 * float(d) + float(np.sum(np.log(s))) for d, s in zip(np.linalg.slogdet(inner)[1], spreads)]
    evidence = [-0.5 * (size - float(right @ b)) - v - pattern.log_price for b, v in zip(fits, volumes)]
    k = max(range(len(evidence)), key=evidence.__getitem__)
    off, price = x @ fits[k] - found.change, math.log(len(WIDTHS))
    return Weighed(
        _priced(replace(pattern, widths=spreads[k]), price),
        fits[k],
        np.asarray(np.linalg.inv(inner[k])),
        found.chi2 + float(off @ p @ off),
        evidence[k] - price,
        found.named,
    )


def scatter(found: Apart) -> Scatter | None:
    """Values that are normal about a common one; None where none, or another that all share, explains them as well."""
    if found.variable.whole:
        return None
    values, vectors = np.linalg.eigh(found.information)
    values, wide = np.maximum(values, 0.0), found.variable.spread
    one, along = vectors.T @ np.ones(found.change.size), vectors.T @ found.change

    def log_evidence(tau: float) -> float:
        w = values / (1.0 + values * tau**2)  # inverse variances of the values seen along the axes
        weight = float(w @ one**2) + wide**-2.0
        mean = 0.0 if found.free else float((w * one) @ along) / weight
        chi2 = float(w @ along**2) - weight * mean**2
        return -0.5 * (chi2 + float(np.sum(np.log1p(values * tau**2))) + math.log(weight * wide**2))

    taus = wide * np.geomspace(1e-3, 3.0, 120)
    log = np.array([log_evidence(float(tau)) for tau in taus])
    best, evidence = int(np.argmax(log)), float(np.logaddexp.reduce(log) - math.log(taus.size))  # log-uniform before
    if best in (0, taus.size - 1) or evidence - log_evidence(0.0) < SCATTERS:
        return None
    inside = taus[log > log[best] - 0.5 * Z90**2]
    total, tau = evidence - 0.5 * found.chi2, float(taus[best])
    w = values / (1.0 + values * tau**2)
    shift = 0.0 if found.free else float((w * one) @ along) / math.sqrt(max(float(w @ one**2), 1e-300))
    return Scatter(found.variable, tau, float(inside[0]), float(inside[-1]), total, found, shift=shift)


def patterns(found: Apart, observations: Sequence[Observation]) -> Iterator[Pattern]:
    """All that is asked of the values of one number, kind by kind with its price."""
    if found.variable.whole:
        yield from _counts(found)
        return
    families = (
        _odd(found),
        _steps(found, observations),
        _sessions(found, observations),
        _drifts(found, observations),
        _functions(found, observations),
    )
    for family in families:
        # a common value of its own is one of the shared parameters already, where the number is one
        every = [p for p in family if not (found.free and p.about_own)]
        for p in every:
            yield _priced(p, math.log(len(every)) + found.variable.log_price)


def _pattern(v: Variable, kind: Kind, of: str | None, design: Array, *more: Any, **named: Any) -> Pattern:
    """Of one number."""
    return Pattern((v,) * design.shape[1], kind, of, design, *more, **named)


def _priced(p: Pattern, price: float) -> Pattern:
    return replace(p, log_price=p.log_price + price)


def _odd(found: Apart) -> Iterator[Pattern]:
    """One recording, then those that a greedy choice adds; groups that stand apart by one common amount."""
    n, v = found.change.size, found.variable
    if n < 4:
        return
    eye = np.eye(n)
    chosen: list[int] = []
    for size in range(1, min(ODD, n // 4) + 1):
        rest = [i for i in range(n) if i not in chosen]
        tried = [_pattern(v, Kind.ODD, None, eye[:, [*chosen, i]], (*chosen, i), since=found.since) for i in rest]
        if size == 1:
            yield from tried
        best = max(tried, key=lambda p: weigh(p, found).log_evidence)
        chosen = list(best.members)
        if size > 1:
            # `n` is paid by the family: what is left of the choice of several
            yield _priced(best, _log_choose(n, size) - math.log(n))
    order = np.argsort(found.change)
    for run in (order, order[::-1]):
        for size in range(2, n // 2 + 1):
            here = tuple(sorted(int(i) for i in run[:size]))
            column = np.zeros((n, 1))
            column[list(here)] = 1.0
            price = _log_choose(n, size) - math.log(n)
            yield _pattern(v, Kind.ODD, None, column, here, log_price=price, since=found.since)


def _counts(found: Apart) -> Iterator[Pattern]:
    """Whole numbers where the values are nearest to one that is not 0, each at an instant of its own."""
    counts = np.round(found.change)
    members = tuple(np.flatnonzero(counts).tolist())
    if members and len(members) < counts.size:
        price = _log_choose(counts.size, len(members)) + len(members) * math.log(INSTANTS)
        yield _pattern(found.variable, Kind.ODD, None, counts[:, None], members, log_price=price, since=found.since)


def _log_choose(n: int, k: int) -> float:
    return math.log(math.comb(n, k))


def _steps(found: Apart, observations: Sequence[Observation]) -> Iterator[Pattern]:
    """Two levels, before and after a place in the order."""
    v, n = found.variable, found.change.size
    for of, at in abscissae(observations):
        known = np.isfinite(at)
        if of not in ("order", "time") or known.sum() < n:
            continue
        places = np.unique(at)
        if of == "time" and _same_order(at, observations):
            continue
        for a, b in itertools.pairwise(places[1:-1]):
            later = tuple(np.flatnonzero(at >= b).tolist())
            for design in _with_and_without(_column(n, later)):
                yield _pattern(v, Kind.STEP, of, design, later, at, 0.5 * (a + b), since=found.since)


def _sessions(found: Apart, observations: Sequence[Observation]) -> Iterator[Pattern]:
    """The recordings of one session apart."""
    v, n = found.variable, found.change.size
    for of, members in groups_of(observations):
        if of == "session":
            for design in _with_and_without(_column(n, members)):
                yield _pattern(v, Kind.STEP, of, design, members, since=found.since)


def _drifts(found: Apart, observations: Sequence[Observation]) -> Iterator[Pattern]:
    """A straight line in order or time, from the declared value at the first, or from any."""
    v = found.variable
    for of, at in abscissae(observations):
        if of in ("order", "time") and np.isfinite(at).all() and np.unique(at).size >= 4:
            line = _unit(at)[:, None]
            for design in _with_and_without(line):
                yield _pattern(v, Kind.DRIFT, of, design, (), at, since=found.since)


def _functions(found: Apart, observations: Sequence[Observation]) -> Iterator[Pattern]:
    """A line, or a line from a value on, in what is known of the recordings; one level of a word apart."""
    v, n = found.variable, found.change.size
    for of, at in abscissae(observations):
        places = np.unique(at[np.isfinite(at)])
        if of in ("order", "time") or places.size < 2 or not np.isfinite(at).all():
            continue
        for design in _with_and_without(_unit(at)[:, None]):
            yield _pattern(v, Kind.FUNCTION, of, design, (), at, since=found.since)
        for x in places[1:-1] if places.size > 2 else ():
            for side in (np.maximum(at - x, 0.0), np.maximum(x - at, 0.0)):
                yield _pattern(v, Kind.FUNCTION, of, (side / side.max())[:, None], (), at, float(x), since=found.since)
        for x, y in itertools.pairwise(places[1:-1]):
            later = tuple(np.flatnonzero(at >= y).tolist())
            yield _pattern(v, Kind.FUNCTION, of, _column(n, later), later, at, float(0.5 * (x + y)), since=found.since)
    for of, members in groups_of(observations):
        if of != "session":
            for design in _with_and_without(_column(n, members)):
                yield _pattern(v, Kind.FUNCTION, of, design, members, since=found.since)


def abscissae(observations: Sequence[Observation]) -> Iterator[tuple[str, Array]]:
    """Numbers that are known of the recordings, (N,), NaN where one is not."""
    each = [o.circumstances for o in observations]
    known = {
        "order": [c.order for c in each],
        "time": [c.time for c in each],
        **{n: [o.labels.get(n) for o in observations] for n in LEVELS},
    }
    for n in dict.fromkeys(k for c in each for k in c.labels):
        known.setdefault(n, [c.labels.get(n) for c in each])
    for n, values in known.items():
        if all((isinstance(x, (int, float)) and not isinstance(x, bool)) or x is None for x in values):
            at = np.array([math.nan if x is None else float(x) for x in values])
            if np.unique(at[np.isfinite(at)]).size > 1:
                yield n, at


def groups_of(observations: Sequence[Observation]) -> Iterator[tuple[str, tuple[int, ...]]]:
    """Recordings of one session, and of one word of a label, where others are of another."""
    each = [o.circumstances for o in observations]
    words = {"session": [c.session for c in each]}
    for n in dict.fromkeys(k for c in each for k in c.labels):
        words[n] = [x if isinstance(x := c.labels.get(n), str) else None for c in each]
    for n, values in words.items():
        names = [x for x in dict.fromkeys(values) if x is not None]
        if len(names) < 2:
            continue
        for x in names[1:] if len(names) == 2 else names:
            yield n, tuple(i for i, y in enumerate(values) if y == x)


def _same_order(time: Array, observations: Sequence[Observation]) -> bool:
    order = [x for o in observations if (x := o.circumstances.order) is not None]
    return len(order) == time.size and bool(np.all(np.argsort(time, kind="stable") == np.argsort(order, kind="stable")))


def _unit(at: Array) -> Array:
    """From 0 at the least to 1 at the greatest."""
    return np.asarray((at - at.min()) / (at.max() - at.min()))


def _column(n: int, members: Sequence[int]) -> Array:
    out = np.zeros((n, 1))
    out[list(members)] = 1.0
    return out


def _with_and_without(column: Array) -> tuple[Array, Array]:
    """A pattern about the declared value, and about a common one of its own."""
    return column, np.hstack([column, np.ones_like(column)])
