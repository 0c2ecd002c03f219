"""Flights from a track: the record as one motion, its flights' parabolas, and where these end."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array, with_digits_of
from jumpvision.base.schema import StageWarning

from ..estimate import checked, checked_sigma, checked_times
from ..mean import difference_noise
from .beyond import Drive, Ring
from .edges import Flight, flight
from .flights import NAN, Flights
from .ground import MOST, Ground, ground
from .motion import POWER, Motion, curvature, motion
from .noise import with_noise
from .piece import FINEST, Piece
from .segments import FLIGHT, LIKE
from .spring import Settings

FEWEST = 6  # samples of a piece
GROSS = 1.5  # times its stated sigma that a track scatters, which is said
TOLD = 3.0  # sigmas by which the curvature of all flights is another than gravity's, which is said
FAR, LONGEST, TRIED = 2.5, 8, 3  # factor, samples, number of other curvatures that are looked at
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
    offset: ArrayLike | None = None,
    stiffness: float = 0.0,
) -> Flights:
    """Flights from the track: the record as one motion of rest, straight motion, contact and flight.

    t [s] increasing, h [m] up, sigma [m] > 0 of independent or correlated noise, shape (n,), or None: as the record
    scatters; NaN samples are left out, but a gap longer than max_gap [s] ends a flight with a NaN edge. gravity
    [m/s^2] along the rail, > 0, known to gravity_sigma. Flights shorter than `shortest` [s] are left out. ripple [m]:
    amplitude by which a hanging foot shakes the rod in flight, about m_f/(M + m_f) of the foot's own; it widens sigma
    where the record is cut (0: no foot); ring: its frequency, fitted along. lag [s]: c/k of a damper beside the
    spring; stiffness [rad/s]: its sqrt(k/M), roughly, 0: free. offset (n,) [m]: (m_m/M) X_m of a motor that moves in a
    contact; h is then of the centre of mass of motor and rod (the rod alone follows no parabola). Drift is not
    looked for beside a foot, whose ring looks like one.

    Segments are chosen by evidence (`segments`), the noise, its correlation and drift learned from them (`noise`). A
    flight has a parabola of curvature -gravity. It ends where that meets a rest, the next flight or the ground of a row
    of bounces (`ground`), or where the body is on a spring, whichever the evidence prefers (`edges`); on one that is
    told and slow it meets no corner. A damper that is not told, nor known by the ring, makes both edges early by c/k
    (0.24 ms for the robot of Table 3) and leaves the flight time. Where nothing explains a contact the sigma is a
    sample interval. Raises ValueError for arrays that cannot be used.
    """
    stated = sigma is not None
    t, h, sigma = checked("track_flights", t=t, h=h, sigma=np.ones(np.size(t)) if sigma is None else sigma)
    checked_sigma("track_flights", sigma)
    if not gravity > 0.0:
        raise ValueError(f"track_flights: gravity = {gravity!r} m/s^2 must be > 0 (along the rail)")
    good = np.isfinite(t) & np.isfinite(h) & np.isfinite(sigma)
    checked_times("track_flights", np.where(good, t, np.nan))
    t, h, sigma = t[good], h[good], sigma[good]
    if not stated:
        sigma = np.full(t.size, noise_of(h))
    finest = 0.0 if stated else rounding_of(h) / float(np.max(sigma, initial=FINEST))
    lag = lag or (ring.lag if ring else 0.0)
    drive = None if offset is None else Drive(t, np.asarray(offset, float)[good])
    if drive is not None and ring is not None:  # a foot that hangs goes with the rod: what flies is the whole
        h = h - ring.share * drive.o
    cut, noise = with_noise([Piece(t[i:j], h[i:j], sigma[i:j]) for i, j in pieces(t, max_gap)], gravity, finest)
    quiet = 1.0
    if ripple and t.size:
        still = float(np.median(noise.factor * sigma))
        wide = [np.hypot(p.sigma, ripple / math.sqrt(2.0)) for p in cut]  # correlation, drift, place: the ring's
        cut = [replace(p, sigma=s, rho=0.0, wander=0.0, place=0.0) for p, s in zip(cut, wide)]
        quiet = still / float(np.median(np.concatenate([p.sigma for p in cut]))) if ring else 1.0
    how = Settings(
        gravity, gravity_sigma, shortest, ring, lag, drive=drive, quiet=quiet, rho=noise.rho, stiffness=stiffness
    )
    whole, warned = as_filmed(cut, how)
    if stated and not ripple and noise.factor > GROSS:
        said = (
            f"the track scatters by {noise.factor:.2g} times its sigma of {float(np.median(sigma)):.2g} m: what is "
            "said of its flights is widened"
        )
        warned.append(StageWarning("noise", said, values={"factor": noise.factor}))
    return replace(collected([(m, f) for m, flying in whole for f in flying]), doubts=tuple(warned))


Whole = list[tuple[Motion, list[Flight]]]


def as_filmed(cut: list[Piece], how: Settings) -> tuple[Whole, list[StageWarning]]:
    """The flights of all pieces, at the curvature that they have: gravity's, or what a wrong scale, frame rate or tilt
    makes of it, which is then said."""
    whole = [flights_in(piece, how) for piece in cut]
    for bend in others(whole, how):
        tried = [flights_in(piece, replace(how, gravity=bend, fitted=True)) for piece in cut]
        whole = tried if aloft(tried) > aloft(whole) else whole
    flying = [f for _, some in whole for f in some]
    if not flying:
        return whole, []
    weight = np.array([f.curvature[1] for f in flying]) ** -2.0
    bend = -float(np.average([f.curvature[0] for f in flying], weights=weight))
    sigma = float(weight.sum()) ** -0.5
    if abs(bend - how.gravity) < TOLD * math.hypot(sigma, how.gravity_sigma, LIKE * how.gravity):
        return whole, []
    said = (
        f"free flight at {with_digits_of(bend, sigma)} ± {with_digits_of(sigma, sigma)} m/s^2, not {how.gravity:g}: "
        "scale, frame rate or tilt"
    )
    doubt = StageWarning("scale", said, values={"seen_m_s2": bend, "sigma_m_s2": sigma, "gravity_m_s2": how.gravity})
    seen = replace(how, gravity=bend, gravity_sigma=sigma, fitted=True)
    return [flights_in(piece, seen) for piece in cut], [doubt]


def others(whole: Whole, how: Settings) -> list[float]:
    """Curvatures [m/s^2] that long smooth motions have which are no flights at gravity's, at most TRIED of them."""
    found = []
    longest = max((f.j - f.i for _, some in whole for f in some), default=0)
    for m, _ in whole:
        for p in m.parts:
            if p.kind != FLIGHT and len(p) >= max(LONGEST, 0.5 * longest):
                bend, sigma = curvature(m.piece, p.i, p.j)
                if bend < -POWER * sigma and 1.0 / FAR < -bend / how.gravity < FAR:
                    found.append((bend / sigma, -bend))
    return [b for _, b in sorted(found)[:TRIED]]


def aloft(whole: Whole) -> float:
    """Time [s] in flights whose ends are known for what they are."""
    return sum(
        float(m.piece.t[f.j - 1] - m.piece.t[f.i])
        for m, some in whole
        for f in some
        if all(e is None or e.kind != "contact" for e in f.edges) and any(f.edges)
    )


def in_flight(t: Array, h: Array, sigma: Array, *, gravity: float) -> list[tuple[int, int]]:
    """(first, one past the last) sample of every stretch in which h is a parabola of curvature -gravity.

    t [s] increasing, h [m] up, sigma [m] > 0, shape (n,), all finite, without gaps.
    """
    (piece,), _ = with_noise([Piece(t, h, sigma)], gravity)
    m, flying = flights_in(piece, Settings(gravity))
    at = [(m.piece.t[f.i], m.piece.t[f.j - 1]) for f in flying]
    return [(int(np.searchsorted(t, a)), int(np.searchsorted(t, b)) + 1) for a, b in at]


def stretches(t: Array, h: Array, sigma: Array, *, gravity: float) -> list[tuple[float, float]]:
    """(begin, end) [s] of every stretch of curvature -gravity, to a sample: as `in_flight`, without asking how it ends,
    so that a swing of a spring may pass for one; a fifth of the work."""
    (piece,), _ = with_noise([Piece(t, h, sigma)], gravity)
    m = motion(piece, gravity)
    flying = [p for p in m.parts if p.kind == FLIGHT and -curvature(m.piece, p.i, p.j)[0] > 0.5 * gravity]
    return [(float(m.piece.t[p.i]), float(m.piece.t[p.j - 1])) for p in flying]


def pieces(t: Array, max_gap: float) -> Iterator[tuple[int, int]]:
    """(first, one past the last) sample of every stretch without a longer gap [s]."""
    cuts = [0, *(np.flatnonzero(np.diff(t) > max_gap) + 1).tolist(), t.size]
    return pairwise(cuts)


def noise_of(h: Array) -> float:
    """A first guess of the noise [m] of a record that states none: not below its rounding."""
    return max(difference_noise(h), rounding_of(h), FINEST)


def rounding_of(h: Array) -> float:
    """What rounding makes of heights [m], as a standard deviation: at rest, where all are the same, none is seen."""
    steps = np.diff(np.unique(h))
    return float(steps.min()) / math.sqrt(12.0) if steps.size else 0.0


def flights_in(piece: Piece, how: Settings) -> tuple[Motion, list[Flight]]:
    """The motion of a piece, and its flights."""
    if piece.t.size < FEWEST:
        return Motion(piece, [], [], {}), []
    m = motion(piece, how.gravity)
    under = Ground() if how.slow(piece.step) else ground(m, how.gravity)
    flying = [flight(m, k, how, under) for k, part in enumerate(m.parts) if part.kind == FLIGHT]
    return m, [f for f in flying if flies(m.piece, f, how) and duration(m.piece, f) >= how.shortest]


def flies(piece: Piece, f: Flight, how: Settings) -> bool:
    """Whether a curvature excludes none at all and agrees with gravity's, no swing explains it, and its ends are told
    better than its length."""
    bend, sigma = f.curvature
    near = NEAR * math.hypot(sigma, how.gravity_sigma) + LIKE * how.gravity
    if any(e is not None and not 0.0 < e.variance < duration(piece, f) ** 2 for e in f.edges):
        return False
    return -bend > POWER * sigma and abs(bend + how.gravity) < near and not f.swing


def duration(piece: Piece, f: Flight) -> float:
    """Time in flight [s], of one that the record cuts in the record."""
    begin, end = (e.time if e else at for e, at in zip(f.edges, (piece.t[f.i], piece.t[f.j - 1])))
    return float(end - begin)


def collected(found: list[tuple[Motion, Flight]]) -> Flights:
    """As arrays."""
    n = len(found)
    table, covariance, shared = np.full((n, 4), NAN), np.zeros(n), np.zeros((n, min(MOST, max(n - 1, 0))))
    for a, (whole, f) in enumerate(found):
        for k, e in enumerate(f.edges):
            if e is not None:
                table[a, 2 * k : 2 * k + 2] = e.time, math.sqrt(e.variance)
        covariance[a] = f.covariance(0, f, 1)
        for lag in range(1, shared.shape[1] + 1):
            if a + lag < n and found[a + lag][0] is whole:
                shared[a, lag - 1] = f.times_together(found[a + lag][1])
            if lag > 1 and not shared[a, lag - 1]:  # not of one train of bounces
                break
    bends = np.array([f.curvature for _, f in found]).reshape(-1, 2)
    kinds = tuple((_kind(f, 0), _kind(f, 1)) for _, f in found)
    up, up_sigma, down, down_sigma = table.T.copy()
    return Flights(
        up,
        up_sigma,
        down,
        down_sigma,
        covariance=covariance,
        shared=shared,
        curvature=bends[:, 0].copy(),
        curvature_sigma=bends[:, 1].copy(),
        kinds=kinds,
    )


def _kind(f: Flight, k: int) -> str:
    e = f.edges[k]
    return e.kind if e else "outside"
