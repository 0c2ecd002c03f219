"""Noise and motion of a record, learned from each other."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from jumpvision.base.arrays import Array

from .motion import calm, parts_of
from .noise import LONG, SURE, Noise, guessed, learned
from .piece import Piece
from .segments import FLIGHT, NUMBERS, evidence

RESTING = 40  # samples of rest that are believed more than all others
LEARNED = 3  # rounds
ENOUGH = 0.05  # change of factor or correlation that needs no further round


def with_noise(given: list[Piece], gravity: float, stated: bool) -> tuple[list[Piece], Noise]:
    """The pieces with the noise that they show about their own motion.

    stated: their sigma is believed until they scatter more. Whether the noise is correlated is decided by the evidence
    of the whole motion with the one and with the other, then learned from its calm parts.
    """
    noise = _first(given, gravity, stated)
    price = math.log(max(sum(p.t.size for p in given), 2))
    for _ in range(LEARNED):
        found = _shown(list(_stretches(given, _scaled(given, noise), gravity)), price)
        if found is None:
            break
        last, noise = noise, found.of_stated() if stated else found
        if abs(last.factor / noise.factor - 1.0) < ENOUGH and abs(last.rho - noise.rho) < ENOUGH:
            break
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
        tried = [replace(n, factor=max(n.factor, 1.0)) for n in tried]
    if len(tried) == 1:
        return tried[0]

    def cost(noise: Noise) -> float:
        return sum(
            evidence(*p.seen, p.weights, gravity) + p.t.size * math.log(noise.factor**2 * (1.0 - noise.rho**2))
            for p in _scaled(long, noise)
        )

    return min(tried, key=cost)


def _scaled(given: list[Piece], noise: Noise) -> list[Piece]:
    return [replace(p, sigma=noise.factor * p.sigma, rho=noise.rho) for p in given]


def _stretches(given: list[Piece], now: list[Piece], gravity: float) -> Iterator[tuple[Piece, Array]]:
    """Calm stretches of the pieces as given, with the columns of their course."""
    for told, piece in zip(given, now):
        if piece.t.size < LONG:
            continue
        kept, parts = parts_of(piece, gravity)
        told = told.of(np.flatnonzero(np.isin(told.t, kept.t)))
        for part in calm(parts, LONG):
            here = told.part(part.i, part.j)
            tau = (here.t - here.t[0]) / (here.t[-1] - here.t[0])
            if part.kind == FLIGHT:
                here = replace(here, y=here.y + 0.5 * gravity * (here.t - here.t[0]) ** 2)
            yield here, tau[:, None] ** np.arange(NUMBERS[part.kind])
