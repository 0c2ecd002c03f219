"""Flights from a track: the record as one motion, its flights' parabolas, and where these end."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array

from ..estimate import checked, checked_sigma
from ..mean import difference_noise
from .edges import Flight, flight
from .flights import NAN, Flights
from .learning import with_noise
from .motion import POWER, Motion, motion
from .piece import Piece
from .segments import FLIGHT, LIKE
from .spring import Ring, Settings

NEAR = 5.0  # sigmas within which the curvature of a flight must be that of gravity


def track_flights(
    t: ArrayLike,
    h: ArrayLike,
    sigma: ArrayLike | None,
    *,
    gravity: float,
    shortest: float,
    max_gap: float,
    ripple: float = 0.0,
    gravity_sigma: float = 0.0,
    lag: float = 0.0,
    ring: Ring | None = None,
) -> Flights:
    """Flights from the track."""
    stated = sigma is not None
    t, h, sigma = checked("track_flights", t=t, h=h, sigma=np.ones(np.size(t)) if sigma is None else sigma)
    checked_sigma("track_flights", sigma)
    if not gravity > 0.0:
        raise ValueError(f"track_flights: gravity = {gravity!r} m/s^2 must be > 0 (along the rail)")
    good = np.isfinite(t) & np.isfinite(h) & np.isfinite(sigma)
    t, h, sigma = t[good], h[good], np.hypot(sigma[good], ripple / math.sqrt(2.0))
    if np.any(np.diff(t) <= 0.0):
        raise ValueError("track_flights: t must increase from sample to sample")
    if not stated:
        sigma = np.full(t.size, noise_of(h))
    how = Settings(gravity, gravity_sigma, shortest, ring, lag)
    cut, _ = with_noise([Piece(t[i:j], h[i:j], sigma[i:j]) for i, j in pieces(t, max_gap)], gravity, stated)
    return collected([(m, f) for piece in cut for m, f in flights_in(piece, how)])


def in_flight(t: Array, h: Array, sigma: Array, *, gravity: float) -> list[tuple[int, int]]:
    """(first, one past the last) sample of every stretch in which h is a parabola of curvature -gravity.

    t [s] increasing, h [m] up, sigma [m] > 0, shape (n,), all finite, without gaps.
    """
    (piece,), _ = with_noise([Piece(t, h, sigma)], gravity, stated=True)
    at = [(m.piece.t[f.i], m.piece.t[f.j - 1]) for m, f in flights_in(piece, Settings(gravity))]
    return [(int(np.searchsorted(t, a)), int(np.searchsorted(t, b)) + 1) for a, b in at]


def pieces(t: Array, max_gap: float) -> Iterator[tuple[int, int]]:
    cuts = [0, *(np.flatnonzero(np.diff(t) > max_gap) + 1).tolist(), t.size]
    return zip(cuts, cuts[1:])


def noise_of(h: Array) -> float:
    """A first guess of the noise [m] of a record that states none: not below its rounding."""
    steps = np.diff(np.unique(h))
    rounding = float(steps.min()) / math.sqrt(12.0) if steps.size else 0.0
    return max(difference_noise(h), rounding, float(np.finfo(float).tiny))


def flights_in(piece: Piece, how: Settings) -> list[tuple[Motion, Flight]]:
    """The flights of a piece, each with the motion that it is part of."""
    if piece.t.size < 6:
        return []
    whole = motion(piece, how.gravity)
    flying = [flight(whole, k, how) for k, part in enumerate(whole.parts) if part.kind == FLIGHT]
    return [(whole, f) for f in flying if flies(f, how) and lasts(whole.piece, f, how)]


def flies(f: Flight, how: Settings) -> bool:
    """Whether a curvature excludes none at all and agrees with gravity's, no swing explains it, and its ends are told
    better than its length."""
    bend, sigma = f.curvature
    near = NEAR * math.hypot(sigma, how.gravity_sigma) + LIKE * how.gravity
    times = [e.time for e in f.edges if e]
    vague = max((e.variance for e in f.edges if e), default=0.0)
    if len(times) == 2 and not 0.0 < vague < (times[1] - times[0]) ** 2:
        return False
    return -bend > POWER * sigma and abs(bend + how.gravity) < near and not f.swing


def lasts(piece: Piece, f: Flight, how: Settings) -> bool:
    begin, end = (e.time if e else at for e, at in zip(f.edges, (piece.t[f.i], piece.t[f.j - 1])))
    return bool(end - begin >= how.shortest)


def collected(found: list[tuple[Motion, Flight]]) -> Flights:
    """As arrays."""
    n = len(found)
    table, covariance, shared = np.full((n, 4), NAN), np.zeros(n), np.zeros((n, 2))
    for a, (whole, f) in enumerate(found):
        for k, e in enumerate(f.edges):
            if e is not None:
                table[a, 2 * k : 2 * k + 2] = e.time, math.sqrt(e.variance)
        covariance[a] = f.covariance(0, f, 1)
        for lag in (1, 2):
            if a + lag < n and found[a + lag][0] is whole:
                other = found[a + lag][1]
                signs = {(0, 0): 1.0, (0, 1): -1.0, (1, 0): -1.0, (1, 1): 1.0}
                shared[a, lag - 1] = sum(s * f.covariance(i, other, j) for (i, j), s in signs.items())
    bends = np.array([f.curvature for _, f in found]).reshape(-1, 2)
    kinds = tuple((_kind(f, 0), _kind(f, 1)) for _, f in found)
    return Flights(*table.T.copy(), covariance, shared, bends[:, 0].copy(), bends[:, 1].copy(), kinds)


def _kind(f: Flight, k: int) -> str:
    e = f.edges[k]
    return e.kind if e else "outside"


