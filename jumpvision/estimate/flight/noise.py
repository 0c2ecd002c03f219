"""Noise and motion of a record, learned from each other: how it scatters about its own motion, how correlated."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy

from jumpvision.base.arrays import Array

from .motion import calm, parts_of
from .piece import Piece
from .segments import FLIGHT, NUMBERS, evidence

STRONGEST = 0.8  # correlation from sample to sample that is looked for
RHOS = np.linspace(0.0, STRONGEST, 17)
WALKS = np.concatenate([[0.0], np.geomspace(1e-7, 0.1, 25)])  # variance of a step over the noise's
CHANCE = 2.7  # chi^2 of a number that is >= 0, which chance makes once in twenty
LONG, MOST = 12, 40_000  # samples of a stretch that tells noise; of all of them, at most
QUARTILE = 0.31864  # lower quartile of the absolute value of a normal deviate
LOOSE = 0.7  # of a stated sigma: a scatter far below it
SURE = 3.0  # standard deviations by which the scatter must exceed what is stated
RESTING = 40  # samples of rest that are believed more than all others
LEARNED = 3  # rounds
ENOUGH = 0.05  # change of factor or correlation that needs no further round


@dataclass(frozen=True)
class Noise:
    """factor: of the stated sigma; rho: correlation from sample to sample; n: samples that tell it; wander: rms step
    from sample to sample of what drifts beside it, in stated sigmas."""

    factor: float
    rho: float
    n: int = 0
    wander: float = 0.0

    def of_stated(self) -> Noise:
        """For a sigma that is stated: believed until the scatter contradicts it, never shrunk.

        Where the record scatters far less, what is stated holds more than its noise, whose correlation then tells
        nothing of it.
        """
        spread = (1.0 + self.rho**2) / (1.0 - self.rho**2) / (2.0 * max(self.n, 1))
        sure = self.n and self.factor > 1.0 + SURE * math.sqrt(spread)
        rho = self.rho if self.factor > LOOSE else 0.0
        return Noise(self.factor if sure else 1.0, rho, self.n)


def _bends(rho: Array | float, k: int) -> Array | float:
    """Variance of third differences over k samples of noise of variance 1."""
    r = rho**k
    return 20.0 - 30.0 * r + 12.0 * r**2 - 2.0 * r**3


def guessed(scaled: Array) -> list[Noise]:
    """White noise and, where it may be, correlated noise: from third differences of neighbours and of every second
    sample of y/sigma (n,), medians: most of a motion has none of its own. The ratio of the two tells the correlation,
    which a quick motion imitates: guesses."""
    if scaled.size < 16:
        return [Noise(1.0, 0.0)]
    one, two = ((float(np.quantile(np.abs(_third(scaled, k)), 0.25)) / QUARTILE) ** 2 for k in (1, 2))
    if one <= 0.0:
        return [Noise(1.0, 0.0)]
    ratio = np.asarray(_bends(RHOS, 2)) / np.asarray(_bends(RHOS, 1))
    rho = float(np.interp(two / one, ratio, RHOS))
    both = [0.0, rho] if rho > 3.0 / math.sqrt(scaled.size) else [0.0]
    return [Noise(math.sqrt(one / float(_bends(r, 1))), r) for r in both]


def _third(y: Array, k: int) -> Array:
    return np.asarray(y[3 * k :] - 3.0 * y[2 * k : -k] + 3.0 * y[k : -2 * k] - y[: -3 * k])


def learned(stretches: Iterable[tuple[Piece, Array]], price: float) -> Noise | None:
    """Restricted maximum likelihood of factor and correlation over stretches whose course columns (n, p) span.

    Correlation is taken for one where the evidence pays `price` for it. None without stretches.
    """
    chi2, logs, free = np.zeros(RHOS.size), np.zeros(RHOS.size), 0
    n = 0
    for piece, columns in stretches:
        free += piece.t.size - columns.shape[1]
        n += piece.t.size
        gaps = np.maximum(np.round(np.diff(piece.t) / piece.step), 1.0)
        z = np.column_stack([np.linalg.qr(columns / piece.sigma[:, None])[0], piece.y / piece.sigma])
        whitened = np.tile(np.outer(z[0], z[0]), (RHOS.size, 1, 1))  # z^T z of the whitened, by correlation
        for gap, count in zip(*np.unique(gaps, return_counts=True)):
            kept, here = (RHOS**gap)[:, None, None], gaps == gap
            now, before = z[1:][here], z[:-1][here]
            both = now.T @ before
            whitened += (now.T @ now + kept**2 * (before.T @ before) - kept * (both + both.T)) / (1.0 - kept**2)
            logs += count * np.log(1.0 - kept[:, 0, 0] ** 2)
        inner, by = whitened[:, :-1, :-1], whitened[:, :-1, -1:]
        course = (by.swapaxes(1, 2) @ np.linalg.solve(inner, by))[:, 0, 0]
        chi2 += np.maximum(whitened[:, -1, -1] - course, 0.0)
        logs += np.linalg.slogdet(inner)[1]
        if n > MOST:
            break
    if free < LONG or not np.all(chi2 > 0.0):
        return None
    cost = free * np.log(chi2 / free) + logs
    k = int(np.argmin(cost))
    rho, factor2 = _between(RHOS, cost, k), chi2[k] / free
    if cost[0] - cost[k] < price:
        rho, factor2 = 0.0, chi2[0] / free
    else:
        factor2 = float(np.interp(rho, RHOS, chi2 / free))
    return Noise(math.sqrt(factor2), rho, free)


def wandering(stretches: Iterable[tuple[Piece, Array]], rho: float) -> float:
    """rms step of a random walk beside noise of correlation rho, in sigmas: by the likelihood of cosine modes
    (Whittle), those left out that a course takes; 0 where chance makes as much."""
    power, noise, walk = [], [], []
    for piece, columns in stretches:
        n, low = piece.t.size, columns.shape[1]
        q = np.linalg.qr(columns)[0]
        y = piece.y / piece.sigma
        mode = scipy.fft.dct(y - q @ (q.T @ y), norm="ortho")[low:]
        cosine = np.cos(np.pi * np.arange(low, n) / n)
        power.append(mode**2)
        noise.append((1.0 - rho**2) / (1.0 - 2.0 * rho * cosine + rho**2))
        walk.append(0.5 / (1.0 - cosine))
    if not power:
        return 0.0
    p, white, slow = np.concatenate(power), np.concatenate(noise), np.concatenate(walk)
    found = []
    for share in WALKS:
        spread = white + share * slow
        size = float(np.mean(p / spread))
        found.append((p.size * math.log(max(size, 1e-300)) + float(np.sum(np.log(spread))), math.sqrt(share * size)))
    cost, step = min(found)
    return step if found[0][0] - cost > CHANCE else 0.0


def _between(x: Array, cost: Array, k: int) -> float:
    """Where a parabola through three neighbours is least."""
    if not 0 < k < x.size - 1:
        return float(x[k])
    a, b, c = cost[k - 1 : k + 2]
    return float(x[k] + 0.5 * (x[1] - x[0]) * (a - c) / max(a - 2.0 * b + c, 1e-300))


def with_noise(given: list[Piece], gravity: float, stated: bool, finest: float = 0.0) -> tuple[list[Piece], Noise]:
    """The pieces with the noise that they show about their own motion.

    stated: their sigma is believed until they scatter more. finest: the least factor of one that is not (rounding).
    Whether the noise is correlated is decided by the evidence of the whole motion with the one and with the other,
    then learned from its calm parts.
    """
    noise = _first(given, gravity, stated)
    noise = replace(noise, factor=max(noise.factor, finest))
    price = math.log(max(sum(p.t.size for p in given), 2))
    stretches: list[tuple[Piece, Array]] = []
    for _ in range(LEARNED):
        stretches = list(_stretches(given, _scaled(given, noise), gravity))
        found = _shown(stretches, price)
        if found is None:
            break
        last, noise = noise, found.of_stated() if stated else replace(found, factor=max(found.factor, finest))
        if abs(last.factor / noise.factor - 1.0) < ENOUGH and abs(last.rho - noise.rho) < ENOUGH:
            break
    noise = replace(noise, wander=wandering(stretches, noise.rho))
    return _scaled(given, noise), noise


def _shown(stretches: list[tuple[Piece, Array]], price: float) -> Noise | None:
    """Of all stretches where they agree with those of rest, else of those: a motion may be none of what it was taken
    for."""
    everywhere = learned(stretches, price)
    at_rest = learned([(p, c) for p, c in stretches if c.shape[1] == 1], price)
    if everywhere is None or at_rest is None or at_rest.n < RESTING:
        return everywhere
    spread = (1.0 + at_rest.rho**2) / (1.0 - at_rest.rho**2) / (2.0 * at_rest.n)
    off = abs(math.log(everywhere.factor / at_rest.factor)) / math.sqrt(spread)
    turned = abs(everywhere.rho - at_rest.rho) / math.sqrt((1.0 - at_rest.rho**2) / at_rest.n)
    return everywhere if max(off, turned) < SURE else at_rest


def _first(given: list[Piece], gravity: float, stated: bool) -> Noise:
    long = [p for p in given if p.t.size >= LONG]
    if not long:
        return Noise(1.0, 0.0)
    tried = guessed(np.concatenate([p.y / p.sigma for p in long]))
    if stated:
        tried = [replace(n, factor=max(n.factor, 1.0)) for n in tried if n.factor > LOOSE or not n.rho]
    if len(tried) == 1:
        return tried[0]

    def cost(noise: Noise) -> float:
        return sum(
            evidence(*p.whitened, p.weights, gravity) + p.t.size * math.log(noise.factor**2 * (1.0 - noise.rho**2))
            for p in _scaled(long, noise)
        )

    return min(tried, key=cost)


def _scaled(given: list[Piece], noise: Noise) -> list[Piece]:
    steps = [noise.wander * float(np.median(p.sigma)) if noise.wander else 0.0 for p in given]
    return [replace(p, sigma=noise.factor * p.sigma, rho=noise.rho, wander=step) for p, step in zip(given, steps)]


def _stretches(given: list[Piece], now: list[Piece], gravity: float) -> Iterator[tuple[Piece, Array]]:
    """Calm stretches of the pieces as given, with the columns of their course."""
    for original, piece in zip(given, now):
        if piece.t.size < LONG:
            continue
        kept, parts = parts_of(piece, gravity)
        original = original.of(np.flatnonzero(np.isin(original.t, kept.t)))
        for part in calm(parts, LONG):
            here = original.part(part.i, part.j)
            tau = (here.t - here.t[0]) / (here.t[-1] - here.t[0])
            if part.kind == FLIGHT:
                here = replace(here, y=here.y + 0.5 * gravity * (here.t - here.t[0]) ** 2)
            yield here, tau[:, None] ** np.arange(NUMBERS[part.kind])
