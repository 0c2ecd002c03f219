"""Noise and motion of a record, learned from each other: how it scatters about its own motion, how correlated."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy

from jumpvision.base.arrays import Array

from ..mean import difference_noise
from .motion import calm, falls, parts_of
from .piece import Piece
from .segments import CURVED, FLIGHT, NUMBERS, REST, STRAIGHT, evidence

RHOS = np.linspace(0.0, 0.8, 33)  # correlations from sample to sample that are looked for
WALKS = np.concatenate([[0.0], np.geomspace(1e-7, 0.1, 25)])  # variance of a step over the noise's
CHANCE = 2.7  # chi^2 of a number that is >= 0, which chance makes once in twenty
LONG, MOST = 12, 40_000  # samples of a stretch that tells noise; of all of them, at most
LEARNED = 12  # rounds, at most
LEAST = 1e-7  # of all that a record moves: its least noise, above what sums are rounded by
FIRST = 0.03  # of all that a record moves: its first noise
ABOVE = 5.0  # times what it differs from sample to sample, if that is more: noise that is correlated is larger
ENOUGH = 0.05  # change of factor or correlation that needs no further round
Stretch = tuple[Piece, Array]  # samples, and the columns that span their course


@dataclass(frozen=True)
class Noise:
    """factor: of the stated sigma; rho: correlation from sample to sample; n: samples that tell it. In stated sigmas:
    wander: rms step from sample to sample of what drifts beside it; place: standard deviation of the part that stays as
    it is while nothing moves."""

    factor: float
    rho: float
    n: int = 0
    wander: float = 0.0
    place: float = 0.0

    @property
    def spread(self) -> float:
        """Relative standard uncertainty of the factor."""
        return math.sqrt((1.0 + self.rho**2) / (1.0 - self.rho**2) / (2.0 * max(self.n, 1)))


def learned(stretches: Iterable[Stretch], price: float) -> Noise | None:
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
    if cost[0] - cost[k] < price:
        k = 0
    return Noise(math.sqrt(chi2[k] / free), float(RHOS[k]), free)


def wandering(stretches: Iterable[Stretch], rho: float) -> float:
    """rms step of a random walk beside noise of correlation rho, in sigmas: by the likelihood of cosine modes
    (Whittle), those left out that a course takes; 0 where chance makes as much."""
    power, noise, walk = [], [], []
    for piece, columns in stretches:
        n, low = piece.t.size, columns.shape[1]
        q = np.linalg.qr(columns / piece.sigma[:, None])[0]
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


def with_noise(given: list[Piece], gravity: float, finest: float = 0.0) -> tuple[list[Piece], Noise]:
    """Learn the noise of pieces about their own motion: (the pieces with it, the noise).

    Their sigma tells ratios: half of the variance of a row is its own and half that of all. finest: the least factor
    (rounding). Whether it is correlated is decided by the evidence of the whole motion with the one and the other.
    """
    given = [replace(p, sigma=np.hypot(p.sigma, np.mean(p.sigma)) / math.sqrt(2.0)) if p.t.size else p for p in given]

    def cost(noise: Noise) -> float:
        scaled = _scaled([p for p in given if p.t.size > 1], noise)
        one = math.log(noise.factor**2 * (1.0 - noise.rho**2))
        return sum(evidence(*p.whitened, p.weights, gravity) + p.t.size * one for p in scaled)

    least = [LEAST * float(np.ptp(p.y)) / float(np.median(p.sigma)) for p in given if p.t.size]
    finest = max([finest, *least])
    prices = math.inf, math.log(max(sum(p.t.size for p in given), 2))
    tried = [_settled(given, gravity, price, finest) for price in prices]
    noise, stretches = min(tried, key=lambda found: cost(found[0]))
    noise = replace(noise, wander=wandering([s for _, s in stretches], noise.rho))
    return _scaled(given, noise), noise


def _settled(
    given: list[Piece], gravity: float, price: float, finest: float
) -> tuple[Noise, list[tuple[int, Stretch]]]:
    """Approach the noise from above, so that a motion is not cut into what explains its noise: (noise, stretches)."""
    first = [max(FIRST * np.ptp(p.y), ABOVE * difference_noise(p.y)) / np.median(p.sigma) for p in given if p.t.size]
    noise = Noise(float(max([finest, 1.0, *first])), 0.0)
    stretches: list[tuple[int, Stretch]] = []
    for _ in range(LEARNED):
        stretches = list(_stretches(given, _scaled(given, noise), gravity))
        found = _shown(stretches, price) or Noise(1.0, 0.0)
        last, noise = noise, replace(found, factor=max(found.factor, finest))
        if abs(last.factor / noise.factor - 1.0) < ENOUGH and abs(last.rho - noise.rho) < ENOUGH:
            break
    return noise, stretches


def _shown(stretches: list[tuple[int, Stretch]], price: float) -> Noise | None:
    """As flights scatter, whose course is known; without them as other curves do. With the errors of places, which a
    rest keeps: what it scatters less by."""
    flying, curved, still = (
        learned([s for kind, s in stretches if kind in kinds], price)
        for kinds in ((FLIGHT,), (FLIGHT, CURVED), (REST, STRAIGHT))
    )
    moving = flying or curved
    if moving is None or still is None:
        return moving or still
    less = moving.factor**2 - still.factor**2 - math.hypot(moving.spread, still.spread) * moving.factor**2
    return replace(moving, place=math.sqrt(max(less, 0.0)))


def _scaled(given: list[Piece], noise: Noise) -> list[Piece]:
    size = [float(np.median(p.sigma)) if p.t.size else 0.0 for p in given]
    return [
        replace(p, sigma=noise.factor * p.sigma, rho=noise.rho, wander=noise.wander * s, place=noise.place * s)
        for p, s in zip(given, size)
    ]


def _stretches(given: list[Piece], now: list[Piece], gravity: float) -> Iterator[tuple[int, Stretch]]:
    """(kind, stretch) of the calm stretches of the pieces as given."""
    for original, piece in zip(given, now):
        if piece.t.size < LONG // 2:
            continue
        kept, parts = parts_of(piece, gravity)
        original = original.of(np.flatnonzero(np.isin(original.t, kept.t)))
        for part in calm(parts, LONG // 2):
            here = original.part(part.i, part.j)
            tau = (here.t - here.t[0]) / (here.t[-1] - here.t[0])
            kind = part.kind if falls(kept, part, gravity) else CURVED
            yield kind, (here, tau[:, None] ** np.arange(NUMBERS[CURVED if kind == FLIGHT else kind]))
