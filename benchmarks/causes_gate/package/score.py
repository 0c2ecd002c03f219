"""One score for sets of causes: the evidence of a linear model whose coefficients are normal about 0 before the data.

With the whitened residual y and the columns U of a set, each times the standard deviation of its coefficient,

    ln Z = -1/2 (y'y - y'U (I + U'U)^-1 U'y) - 1/2 ln det(I + U'U).

Only products of columns enter (`Products`), so that sets are compared in a time that does not grow with the readings.
What fitted parameters can do is taken off with a flat prior (`without`); what no list has is a covariance (`beside`).
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np
from scipy.special import log_ndtr, logsumexp

from jumpvision.base.arrays import Array

MOST = 4  # causes in a set
BEAM = 8  # sets of a size that are built upon
SURE = 0.95  # probability from which a cause is named
ROUNDS = 12  # members at most: one cause may have several
BEHIND = 30.0  # nats: sets so far behind the best lead nowhere


@dataclass(frozen=True)
class Cause:
    """A cause, or a member of one. key: what is told of it; members of one key are one cause. columns: its places in
    the products. widths: by how much its coefficients may differ from 0 before the data, each (k,) as likely as the
    others; () where its size is known and no coefficient is free. log_prior: its share before the data; log_again: of a
    further member where a set has its key (-inf: it has but one). sign: of its first coefficient where it has one."""

    key: Hashable
    columns: tuple[int, ...]
    widths: tuple[Array, ...] = ()
    log_prior: float = 0.0
    log_again: float = -math.inf
    sign: int = 0


@dataclass(frozen=True)
class Products:
    """Products (p, p) of y, which is the first, and all columns; log_det: -1/2 ln det of what was taken off."""

    inner: Array
    log_det: float = 0.0

    @classmethod
    def of(cls, y: Array, columns: Array) -> Products:
        every = np.column_stack([y, columns])
        return cls(every.T @ every)

    def without(self, columns: Sequence[int]) -> Products:
        """The same less what these columns can do, whatever their coefficients are."""
        return self._less(list(columns), np.ones(len(columns)), 0.0)

    def beside(self, columns: Sequence[int], widths: Array) -> Products:
        """The same where these columns, their coefficients of these standard deviations, are part of the noise."""
        return self._less(list(columns), widths, 1.0)

    def _less(self, columns: list[int], widths: Array, own: float) -> Products:
        some = widths[:, None] * self.inner[columns]
        lower = np.linalg.cholesky(some[:, columns] * widths + own * np.eye(len(columns)))
        part = np.linalg.solve(lower, some)
        return Products(self.inner - part.T @ part, self.log_det - float(np.sum(np.log(np.diag(lower)))))


@dataclass(frozen=True)
class Scored:
    """A set: the places of its members with that of their likeliest widths; log: ln of prior times evidence, over all
    widths; share: ln of that over what it is with the likeliest."""

    members: tuple[tuple[int, int], ...]
    log: float
    share: float = 0.0


def log_evidence(y: Array, columns: Array) -> float:
    """ln Z of columns (n, k), each times the standard deviation of its coefficient, up to the constant of noise."""
    inner = np.eye(columns.shape[1]) + columns.T @ columns
    along = columns.T @ y
    return -0.5 * float(y @ y - along @ np.linalg.solve(inner, along)) - 0.5 * float(np.linalg.slogdet(inner)[1])


def signed(sign: int, mean: float, sigma: float) -> float:
    """ln of how much likelier a coefficient of one sign is, whose normal posterior would have either."""
    return math.log(2.0) + float(log_ndtr(sign * mean / sigma)) if sign else 0.0


@dataclass
class Search:
    """The beam over sets of causes. log_prior: of what the products hold beside the noise."""

    causes: Sequence[Cause]
    products: Products
    log_prior: float = 0.0
    seen: dict[frozenset[int], Scored] = field(default_factory=dict)

    def run(self) -> list[Scored]:
        """All sets that were looked at, the likeliest first."""
        front = [self.scored(())]
        self.seen = {frozenset(): front[0]}
        for _ in range(ROUNDS):
            found: dict[frozenset[int], Scored] = {}
            for s in front:
                for members in self._more(s.members):
                    if (key := frozenset(k for k, _ in members)) not in self.seen and key not in found:
                        found[key] = self.scored(members, s.share)
            self.seen |= found
            best = max(s.log for s in self.seen.values())
            front = sorted((s for s in found.values() if s.log > best - BEHIND), key=lambda s: -s.log)[:BEAM]
        return sorted(self.seen.values(), key=lambda s: -s.log)

    def prior(self, members: Sequence[int]) -> float:
        """ln of the prior of a set: every number of causes up to MOST alike, in any order; -inf for more."""
        keys: set[Hashable] = set()
        total = self.log_prior - math.log(MOST + 1)
        for k in members:
            total += self.causes[k].log_again if self.causes[k].key in keys else self.causes[k].log_prior
            keys.add(self.causes[k].key)
        return total + math.lgamma(len(keys) + 1) if len(keys) <= MOST else -math.inf

    def scored(self, members: tuple[tuple[int, int], ...], share: float = 0.0) -> Scored:
        """A set whose members have these widths, the last the likeliest of its own. share: of the set without it."""
        if not members:
            return Scored((), self._log(members))
        *rest, (last, _) = members
        widths = max(len(self.causes[last].widths), 1)
        each = [(*rest, (last, w)) for w in range(widths)]
        logs = [self._log(m) for m in each]
        log, best = float(logsumexp(logs)) - math.log(widths), int(np.argmax(logs))
        return Scored(each[best], log + share, log - logs[best] + share)

    def left(self, members: Sequence[tuple[int, int]]) -> tuple[Array, Array, float]:
        """(y times every column (p,), the squares of the columns (p,), both less what the set can do; -1/2 ln det of
        the set and its signs). The first of either is y'y."""
        inner = self.products.inner
        free: list[int] = []
        known: list[int] = []
        widths: list[float] = []
        signs: list[tuple[int, int]] = []  # place of a cause's first coefficient, its sign
        for k, w in members:
            cause = self.causes[k]
            if not cause.widths:
                known += cause.columns
                continue
            signs.append((len(free), cause.sign))
            free += cause.columns
            widths += cause.widths[w].tolist()
        row = inner[0] - inner[known].sum(axis=0)
        row[0] = row[0] - row[known].sum()
        if not free:
            return row, np.diag(inner).copy(), 0.0
        scale = np.array(widths)
        some = scale[:, None] * inner[free]
        lower = np.linalg.cholesky(np.eye(len(free)) + some[:, free] * scale)
        part, along = np.linalg.solve(lower, some), np.linalg.solve(lower, scale * row[free])
        back = np.linalg.inv(lower).T
        mean, spread = back @ along, np.linalg.norm(back, axis=1)
        log = sum(signed(s, float(mean[j]), float(spread[j])) for j, s in signs) - float(np.sum(np.log(np.diag(lower))))
        left = row - along @ part
        left[0] = row[0] - along @ along
        return left, np.diag(inner) - np.sum(part * part, axis=0), log

    def _log(self, members: tuple[tuple[int, int], ...]) -> float:
        row, _, log = self.left(members)
        return -0.5 * float(row[0]) + log + self.products.log_det + self.prior([k for k, _ in members])

    def _more(self, members: tuple[tuple[int, int], ...]) -> Iterator[tuple[tuple[int, int], ...]]:
        """The set with one member more: those that promise most beside the others as they are."""
        row, square, _ = self.left(members)
        inside = [k for k, _ in members]
        promise = []
        for k, cause in enumerate(self.causes):
            price = -math.inf if k in inside else self.prior([*inside, k])
            if price > -math.inf:
                promise.append((price + self._gain(cause, row, square), k))
        for _, k in sorted(promise, reverse=True)[: 2 * BEAM]:
            yield (*members, (k, 0))

    @staticmethod
    def _gain(cause: Cause, row: Array, square: Array) -> float:
        """Nats that a cause gains at most, were its columns at right angles."""
        b, d = row[list(cause.columns)], np.maximum(square[list(cause.columns)], 0.0)
        if not cause.widths:
            return float(np.sum(b - 0.5 * d))
        return max(
            float(np.sum(0.5 * (w * b) ** 2 / (1.0 + w * w * d) - 0.5 * np.log1p(w * w * d))) for w in cause.widths
        )


def inclusion(sets: Sequence[tuple[frozenset[Hashable], float]]) -> dict[Hashable, float]:
    """Probability of every key over sets of keys with their ln weight, the likeliest first."""
    logs = np.array([log for _, log in sets])
    weights = np.exp(logs - logsumexp(logs))
    out: dict[Hashable, float] = {}
    for (keys, _), w in zip(sets, weights):
        for key in keys:
            out[key] = out.get(key, 0.0) + float(w)
    return dict(sorted(out.items(), key=lambda x: -x[1]))
