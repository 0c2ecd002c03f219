"""Flights: lift-off and landing from a contact sensor or the track, the height and restitution they imply."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array

from .estimate import Estimate, checked, checked_sigma, fit_line, least_squares_fit, scatter_factor

NAN = float("nan")
ALLOWED = 1e-3  # chance that a window wholly in flight fails the chi2 test
POWER = 5.0  # a window must tell curvature 0 from -g by this many sigmas, so that rest cannot pass as flight
EARLIEST = 12  # samples by which a window may hang over the end of a flight unnoticed, generously
STIFFNESS = (30.0, 45.0, 65.0, 100.0, 150.0)  # rad/s of the contact, where the edge fit starts


@dataclass(frozen=True)
class Flights:
    """Lift-off and landing times [s] and their standard uncertainties, shape (number of flights,), in order.

    NaN stands for an edge outside the record (in the air when it begins or ends). `len()` is n_jumps.
    """

    lift_off: Array
    lift_off_sigma: Array
    landing: Array
    landing_sigma: Array

    def __len__(self) -> int:
        return int(self.lift_off.size)

    @property
    def time(self) -> Array:
        """Flight times [s]."""
        return self.landing - self.lift_off

    @property
    def time_sigma(self) -> Array:
        return np.hypot(self.lift_off_sigma, self.landing_sigma)


def contact_flights(t: ArrayLike, contact: ArrayLike, *, debounce: float) -> Flights:
    """Flights from a contact signal, 1 on the ground and 0 in the air, sampled at t [s]; NaN samples are left out.

    debounce [s]: gaps in contact shorter than this are contact (so a bouncing switch closes at its first and opens at
    its last touch), and then contacts shorter than this are flight. Each edge lies in the middle between two samples,
    with the uncertainty of a uniform distribution over them, interval/sqrt(12).
    """
    t, contact = checked("contact_flights", t=t, contact=contact)
    good = np.isfinite(t) & np.isfinite(contact)
    t, contact = t[good], contact[good]
    bad = np.flatnonzero((contact != 0.0) & (contact != 1.0))
    if bad.size:
        raise ValueError(f"contact_flights: contact[{bad[0]}] = {contact[bad[0]]:g} must be 0 (air) or 1 (ground)")
    if np.any(np.diff(t) <= 0.0):
        raise ValueError("contact_flights: t must increase from sample to sample")
    touch = contact == 1.0
    if touch.size == 0:
        return _flights([])
    edges = 0.5 * (t[1:] + t[:-1])
    for value in (False, True):
        for i, j in _runs(touch == value):
            if i > 0 and j < touch.size and edges[j - 1] - edges[i - 1] < debounce:
                touch[i:j] = not value
    wait = np.diff(t) / math.sqrt(12.0)
    rows: list[tuple[float, ...]] = []
    for i, j in _runs(~touch):
        up = (edges[i - 1], wait[i - 1]) if i > 0 else (NAN, NAN)
        down = (edges[j - 1], wait[j - 1]) if j < t.size else (NAN, NAN)
        rows.append((*up, *down))
    return _flights(rows)


def final_flight(flights: Flights, *, after: float) -> int | None:
    """Index of the longest complete flight that ends later than `after` [s] (forcing stops); None without one."""
    time = np.where(flights.landing > after, flights.time, np.nan)
    return None if not np.isfinite(time).any() else int(np.nanargmax(time))


def flight_height(time: float, sigma: float, *, gravity: float, gravity_sigma: float = 0.0) -> Estimate:
    """g t_f^2 / 8 [m], gravity [m/s^2] along the rail: the apex above a lift-off and a landing at the same height."""
    height = gravity * time**2 / 8.0
    reason = "" if math.isfinite(height) else "no complete flight"
    estimate = Estimate(height, gravity * time / 4.0 * sigma, "m", 1, 0.0, reason)
    return estimate.with_common(time**2 / 8.0 * gravity_sigma)  # one gravity for all jumps


def track_flights(
    t: ArrayLike,
    h: ArrayLike,
    sigma: ArrayLike,
    *,
    gravity: float,
    shortest: float,
    max_gap: float,
    ripple: float = 0.0,
) -> Flights:
    """Flights from the track: the intervals where h is a parabola of curvature -g, longer than `shortest` [s].

    t [s] increasing, h [m] up, sigma [m] > 0, shape (n,); NaN samples are left out, but a gap longer than max_gap [s]
    ends a flight with a NaN edge. gravity [m/s^2] along the rail, > 0. ripple [m]: amplitude by which a hanging foot
    shakes the rod in flight, about m_f/(M + m_f) of the foot's own; it widens sigma (0: no foot). The motor must not
    move during the flight: the rod alone then follows no parabola (give the time after the forcing, or the centre of
    mass of motor and rod).

    Windows slide over h + g t^2/2, which is straight in flight; a window passes when a straight line has a chi2 within
    the 99.9 % range, and all passing windows that touch make one flight. The window is the shortest that separates rest
    from free fall by POWER sigmas, so flights shorter than it are not seen. Each edge is then refined to sub-sample:
    beyond it the parabola turns into an oscillation on a spring of free stiffness. A damper c beside that spring makes
    both edges early by c/k (0.24 ms for the robot of Table 3) and leaves the flight time; where the fit is poor (impact
    loss, sand) the sigma is a sample interval.
    """
    t, h, sigma = checked("track_flights", t=t, h=h, sigma=sigma)
    checked_sigma("track_flights", sigma)
    if not gravity > 0.0:
        raise ValueError(f"track_flights: gravity = {gravity!r} m/s^2 must be > 0 (along the rail)")
    good = np.isfinite(t) & np.isfinite(h) & np.isfinite(sigma)
    t, h, sigma = t[good], h[good], np.hypot(sigma[good], ripple / math.sqrt(2.0))
    if np.any(np.diff(t) <= 0.0):
        raise ValueError("track_flights: t must increase from sample to sample")
    rows: list[tuple[float, ...]] = []
    pieces = np.split(np.arange(t.size), np.flatnonzero(np.diff(t) > max_gap) + 1)
    for piece in pieces:
        rows += _flights_of(t[piece], h[piece], sigma[piece], gravity, shortest)
    return _flights(rows)


def in_flight(t: Array, h: Array, sigma: Array, *, gravity: float) -> list[tuple[int, int]]:
    """(first, one past the last) sample of every stretch in which h is a parabola of curvature -gravity.

    t [s] increasing, h [m] up, sigma [m] > 0, shape (n,), all finite, without gaps. A stretch is made of the windows of
    `track_flights`; its outermost ones may hang over the end of the flight by a few samples that they do not notice.
    """
    width = _window(t, sigma, gravity)
    if width is None:
        return []
    y = h + 0.5 * gravity * (t - t[0]) ** 2
    passes = _straight(*(sliding_window_view(a, width) for a in (t, y, sigma))) <= scipy.special.chdtri(
        width - 2, ALLOWED
    )
    flying = np.zeros(t.size, dtype=bool)
    for i in np.flatnonzero(passes):
        flying[i : i + width] = True
    return _runs(flying)


def _flights_of(t: Array, h: Array, sigma: Array, gravity: float, shortest: float) -> list[tuple[float, ...]]:
    rows: list[tuple[float, ...]] = []
    for i, j in in_flight(t, h, sigma, gravity=gravity):
        if t[j - 1] - t[i] < 0.5 * shortest:
            continue
        # the outermost window may hang over the edge by a few samples that it does not notice: the edge fit finds them
        up = _edge(-t[::-1], h[::-1], sigma[::-1], t.size - j, t.size - i, gravity) if i > 0 else None
        down = _edge(t, h, sigma, i, j, gravity) if j < t.size else None
        lift, lift_sigma = (-up[0], up[1]) if up else (NAN, NAN)
        land, land_sigma = down if down else (NAN, NAN)
        begin, end = lift if up else t[i], land if down else t[j - 1]
        if end - begin >= shortest:
            rows.append((lift, lift_sigma, land, land_sigma))
    return rows


def _window(t: Array, sigma: Array, gravity: float) -> int | None:
    """Samples a window needs to see the curvature g by POWER sigmas; None where the record is too short for it."""
    if t.size < 6:
        return None
    dt, noise = float(np.median(np.diff(t))), float(np.median(sigma))
    for width in range(5, t.size + 1):
        tau = (np.arange(width) - 0.5 * (width - 1)) * dt
        bend = 0.5 * gravity * (tau**2 - np.mean(tau**2))
        if float(np.sum(bend**2)) >= (POWER * noise) ** 2:
            return width
    return None


def _straight(t: Array, y: Array, sigma: Array) -> Array:
    """chi2 (windows,) of the weighted straight line through every row of t, y, sigma (windows, n)."""
    w, d = sigma**-2, t - t[:, :1]
    s, sx, sxx = (np.sum(a, axis=1) for a in (w, w * d, w * d * d))
    sy, sxy = (np.sum(a, axis=1) for a in (w * y, w * d * y))
    det = s * sxx - sx * sx
    a, b = (sxx * sy - sx * sxy) / det, (s * sxy - sx * sy) / det
    return np.asarray(np.sum(w * (y - a[:, None] - b[:, None] * d) ** 2, axis=1))


def _edge(t: Array, h: Array, sigma: Array, i: int, j: int, gravity: float) -> tuple[float, float]:
    """(time, sigma) where the flight of samples i..j ends, between samples.

    After the edge at t_e the rod is on a relaxed spring, x'' = -g - w^2 (x - x_e): against the parabola it gains
    -s (tau - sin(w tau)/w) + g (tau^2/2 - (1 - cos(w tau))/w^2), tau = t - t_e, s its velocity at t_e. For given t_e
    and w that is linear in the parabola's two parameters: the best of a grid of (t_e, w) starts the fit of all four.
    w only has to describe the way down to the turning point. The same holds backwards in time for a lift-off.
    """
    dt = float(np.median(np.diff(t)))
    turn = j
    while turn < t.size - 1 and h[turn] < h[turn - 1]:
        turn += 1
    k = slice(i, min(t.size, max(turn, j + 3)))
    d, sigma = t[k] - t[i], sigma[k]
    y = h[k] + 0.5 * gravity * d**2
    crude = float(0.5 * (t[j - 1] + t[min(j, t.size - 1)])), dt / math.sqrt(12.0)
    dof = d.size - 4
    if dof < 1:
        return crude

    def design(edge: float, w: float | Array) -> tuple[Array, Array]:
        """Columns of value and velocity at d = 0, and the part that depends on neither; w may be (k, 1)."""
        tau = np.maximum(d - edge, 0.0)
        lost = tau - np.sin(w * tau) / w
        return np.stack([np.ones_like(lost), d - lost], axis=-1), gravity * (
            edge * lost + 0.5 * tau**2 - (1.0 - np.cos(w * tau)) / w**2
        )

    last = d[j - 1 - i]
    best = (np.inf, 0.0, 0.0, np.zeros(2))
    w = np.array(STIFFNESS)[:, None]
    for edge in np.arange(max(last - EARLIEST * dt, 2.0 * dt), last + 1.5 * dt, 0.25 * dt):
        a, rest = design(edge, w)  # (5, n, 2), (5, n): the five at once
        a, y_w = a / sigma[:, None], (y - rest) / sigma
        p = np.linalg.solve(a.swapaxes(1, 2) @ a, a.swapaxes(1, 2) @ y_w[..., None])
        chi2 = np.sum((y_w - (a @ p)[..., 0]) ** 2, axis=1)
        least = int(np.argmin(chi2))
        if chi2[least] < best[0]:
            best = (float(chi2[least]), edge, STIFFNESS[least], p[least, :, 0])

    def residual(q: Array) -> Array:
        a, rest = design(q[2], q[3])
        return np.asarray((y - rest - a @ q[:2]) / sigma)

    def jacobian(q: Array) -> Array:
        _, speed, edge, w = q
        tau = np.maximum(d - edge, 0.0)
        sine, fallen = np.sin(w * tau), 1.0 - np.cos(w * tau)
        softer = (sine / w - tau * (1.0 - fallen)) / w  # d lost/dw; d lost/d edge is -fallen
        out = np.ones((d.size, 4))
        out[:, 1] = d - tau + sine / w
        out[:, 2] = (speed - gravity * edge) * fallen
        out[:, 3] = (gravity * edge - speed) * softer + gravity * (2.0 * fallen / w - tau * sine) / w**2
        return np.asarray(out / -sigma[:, None])

    noise = float(np.median(sigma))
    scale = [noise, noise / last, dt, best[2]]
    fit = least_squares_fit(residual, [*best[3], best[1], best[2]], scale=scale, jacobian=jacobian)
    if fit is None or not (fit[0][3] > 0.0 and 0.0 < fit[0][2] < d[-1]):
        return crude
    p, cov, chi2 = fit
    spread = scatter_factor(chi2, dof) * math.sqrt(float(cov[2, 2]))
    if chi2 > scipy.special.chdtri(dof, ALLOWED) or spread > 3.0 * dt:
        return float(t[i] + p[2]), max(spread, dt)  # no spring-like landing: good to a frame at best
    return float(t[i] + p[2]), spread


def _runs(flag: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """(first, one past the last) index of every run of True."""
    change = np.flatnonzero(np.diff(np.concatenate(([0], flag.astype(np.int8), [0]))))
    return [(int(i), int(j)) for i, j in zip(change[::2], change[1::2])]


def _flights(rows: list[tuple[float, ...]]) -> Flights:
    table = np.array(rows, dtype=float).reshape(-1, 4)
    return Flights(*(table[:, c].copy() for c in range(4)))


def restitution(flights: Flights, *, after: float) -> Estimate:
    """e = speed after / before a bounce, from log t_i = log t_0 + i log e over the complete flights that end later than
    `after` [s] (the forcing stops), from the longest on. sigma from the edges' and, where larger, the scatter.

    NaN with a reason below two such flights. Landing and lift-off at the same height are assumed, no forcing between.
    """
    free = np.flatnonzero(np.isfinite(flights.time) & (flights.landing > after))
    if free.size:
        free = free[int(np.argmax(flights.time[free])) :]
    ends = np.flatnonzero(np.diff(free) > 1)
    free = free[: ends[0] + 1] if ends.size else free
    if free.size < 2:
        return Estimate(NAN, NAN, "", free.size, NAN, f"{free.size} free flights, two are needed")
    time, sigma = flights.time[free], flights.time_sigma[free]
    line = fit_line(np.arange(free.size), np.log(time), sigma / time)
    e = math.exp(line.slope)
    return Estimate(e, e * line.slope_sigma, "", free.size, line.chi2)
