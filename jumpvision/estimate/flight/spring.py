"""Gradual edges: beyond them the body is on a spring, and its fall turns into an oscillation."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from jumpvision.base.arrays import Array

from ..estimate import least_squares_fit, scatter_factor
from .piece import Piece

STIFFNESS = (20.0, 30.0, 45.0, 65.0, 100.0, 150.0, 250.0, 400.0, 700.0, 1200.0)  # rad/s, where a fit starts
PLACES = 24  # of an edge, where a fit starts
SHRUNK = (1.0, 0.6, 0.35, 0.2)  # of the way to the turning point, tried in turn
POOR = 1e-3  # chance of chi^2 below which a contact is none of a spring


@dataclass(frozen=True)
class Ring:
    """What a hanging foot does to the body in flight: it swings at `frequency` [rad/s], decaying at `decay` [1/s]."""

    frequency: float
    decay: float

    def columns(self, t: Array) -> Array:
        """(n, 2), t [s] from the lift-off."""
        fallen = np.exp(-self.decay * np.clip(t, 0.0, None))
        return np.stack([fallen * np.cos(self.frequency * t), fallen * np.sin(self.frequency * t)], axis=1)


@dataclass(frozen=True)
class Sprung:
    """A flight fitted together with the springs at its edges: the times [s] and their covariance with the parabola.

    p: value and slope at `origin`, then what is fitted beside; cov: of (p, times). edges: which there are, of
    (-1, lift-off; +1, landing), in the order of times.
    """

    origin: float
    p: Array
    times: Array
    cov: Array
    edges: tuple[int, ...]
    chi2: float
    n: int
    curvature: tuple[float, float]

    @property
    def good(self) -> bool:
        dof = self.n - self.p.size - 2 * len(self.edges)
        return dof > 0 and self.chi2 <= scipy.special.chdtri(dof, POOR)


def departure(tau: Array, w: Array | float, lag: float) -> tuple[Array, Array]:
    """(per m/s of speed down at the edge [s], per m/s^2 of gravity [s^2]): how far the spring holds the body above the
    parabola, tau >= 0 [s] after the edge. x'' = -g - w^2 (x + lag x') from x = 0; w [rad/s], lag = c/k [s]."""
    gamma = 0.5 * w * w * lag
    inner = w * w - gamma * gamma
    wd = np.sqrt(np.maximum(inner, 1e-6 * w * w))
    fall = np.exp(-np.clip(gamma * tau, -50.0, 50.0))
    sine, cosine = fall * np.sin(wd * tau) / wd, fall * np.cos(wd * tau)
    return np.asarray(tau - sine), np.asarray(0.5 * tau**2 - (1.0 - cosine - gamma * sine) / (w * w))


def sprung(
    piece: Piece,
    inside: tuple[int, int],
    reach: tuple[int, int],
    edges: tuple[int, ...],
    gravity: float,
    gravity_sigma: float,
    lag: float,
    ring: Ring | None,
) -> Sprung | None:
    """Fit of the flight of samples inside[0] .. inside[1] and of the contact as far as reach[0] .. reach[1].

    The contact is left out bit by bit from its turning point on, until a spring explains the rest of it.
    """
    best = None
    for share in SHRUNK:
        lo = inside[0] - round(share * (inside[0] - reach[0])) if -1 in edges else inside[0]
        hi = inside[1] + round(share * (reach[1] - inside[1])) if 1 in edges else inside[1]
        found = _fitted(piece.part(lo, hi), piece.t[inside[0]], piece.t[inside[1] - 1], edges, gravity, gravity_sigma, lag, ring)
        if found is not None:
            best = found
            if found.good:
                break
    return best


def _fitted(
    piece: Piece,
    first: float,
    last: float,
    edges: tuple[int, ...],
    gravity: float,
    gravity_sigma: float,
    lag: float,
    ring: Ring | None,
) -> Sprung | None:
    t, n = piece.t, piece.t.size
    origin = 0.5 * (first + last)
    tau, span = t - origin, max(last - first, 4.0 * piece.step)
    free_gravity = gravity_sigma > 0.0
    columns = [np.ones(n), tau]
    if free_gravity:
        columns.append(-0.5 * tau * tau * gravity_sigma)
    swing = [] if ring is None else list(ring.columns(t - first).T)
    linear = np.stack(columns + swing, axis=1)
    many = linear.shape[1]
    if n <= many + 2 * len(edges) + 1:
        return None
    base = piece.y + 0.5 * gravity * tau * tau

    def beyond(edge: float, side: int, w: float) -> tuple[Array, Array, Array]:
        away = np.maximum(side * (tau - edge), 0.0)
        speed, fall = departure(away, w, side * lag)
        return away, speed, fall

    def design(where: Array, w: Array) -> tuple[Array, Array]:
        """(columns of the linear numbers, what depends on none of them)."""
        a, rest = linear.copy(), np.zeros(n)
        for edge, side, stiff in zip(where, edges, w):
            _, speed, fall = beyond(edge, side, stiff)  # speed down beyond the edge: -side (slope - g edge)
            a[:, 1] -= side * speed
            rest += side * gravity * edge * speed + gravity * fall
            if free_gravity:
                a[:, 2] += gravity_sigma * (side * edge * speed + fall)
        return a, rest

    start = _start(piece, linear, base, edges, first - origin, last - origin, span, design)
    if start is None:
        return None
    where, stiff, p = start
    prior = np.eye(many)[2:3] if free_gravity else np.zeros((0, many))

    def residual(q: Array) -> Array:
        a, rest = design(q[many : many + len(edges)], np.exp(np.clip(q[many + len(edges) :], -9.0, 9.0)))
        r = piece.white(base - rest - a @ q[:many])
        return np.concatenate([r, -prior @ q[:many]])

    def jacobian(q: Array) -> Array:
        e, w = q[many : many + len(edges)], np.exp(np.clip(q[many + len(edges) :], -9.0, 9.0))
        a, _ = design(e, w)
        slope = q[1]
        g = gravity + (gravity_sigma * q[2] if free_gravity else 0.0)
        more = []
        for edge, side, stiff in zip(e, edges, w):
            h = 1e-6 * span
            away, speed, fall = beyond(edge, side, stiff)
            _, s2, f2 = beyond(edge - side * h, side, stiff)
            down = -side * (slope - g * edge)
            live = away > 0.0
            more.append(live * (-side * (down * (s2 - speed) + g * (f2 - fall)) / h + side * g * speed))
        for edge, side, stiff in zip(e, edges, w):
            _, speed, fall = beyond(edge, side, stiff)
            _, s2, f2 = beyond(edge, side, stiff * (1.0 + 1e-5))
            down = -side * (slope - g * edge)
            more.append((down * (s2 - speed) + g * (f2 - fall)) / 1e-5)
        out = -piece.white(np.concatenate([a, np.stack(more, axis=1)], axis=1))
        return np.vstack([out, -np.hstack([prior, np.zeros((len(prior), 2 * len(edges)))])])

    noise = float(np.median(piece.sigma))
    scale = [noise, noise / span] + [1.0] * free_gravity + [noise] * len(swing) + [piece.step] * len(edges) + [0.2] * len(edges)
    q0 = np.concatenate([p, where, np.log(stiff)])
    fit = least_squares_fit(residual, q0, scale=scale, jacobian=jacobian)
    if fit is None:
        return None
    q, cov, chi2 = fit
    keep = many + len(edges)
    times = q[many:keep]
    if np.any(times < tau[0]) or np.any(times > tau[-1]) or np.any(np.abs(q[keep:]) > 9.0):
        return None
    if len(edges) == 2 and times[1] <= times[0]:
        return None
    dof = n - q.size
    factor = scatter_factor(chi2, dof) ** 2
    g = (gravity + gravity_sigma * q[2], gravity_sigma * math.sqrt(cov[2, 2])) if free_gravity else (gravity, 0.0)
    return Sprung(origin, q[:many], origin + times, factor * cov[:keep, :keep], edges, chi2, n, g)


def _start(piece, linear, base, edges, first, last, span, design):  # type: ignore[no-untyped-def]
    """Each edge by itself over a grid of places and stiffnesses, beside the parabola through the middle."""
    many = linear.shape[1]
    tau = piece.t - piece.t[0]
    where, stiff = [], []
    rows = slice(None) if piece.t.size < 400 else slice(None, None, piece.t.size // 200)
    white = 1.0 / piece.sigma[rows]
    ends = {-1: first, 1: last}
    p = None
    for k, side in enumerate(edges):
        best = (np.inf, 0.0, 0.0)
        for share in np.linspace(-0.06, 0.4, PLACES):
            edge = ends[side] - side * share * span
            for w in STIFFNESS:
                e = [ends[s] for s in edges]
                s = [65.0] * len(edges)
                e[k], s[k] = edge, w
                for m in range(k):
                    e[m], s[m] = where[m], stiff[m]
                a, rest = design(np.array(e), np.array(s))
                use = slice(None)
                if len(edges) == 2 and k == 0:  # the other edge is not known yet: this half alone
                    middle = 0.5 * (first + last)
                    use = np.flatnonzero((linear[rows, 1] < middle) if side < 0 else (linear[rows, 1] > middle))
                aw, bw = (a[rows] * white[:, None])[use], ((base - rest)[rows] * white)[use]
                if len(bw) <= many:
                    continue
                x = np.linalg.lstsq(aw, bw, rcond=None)[0]
                chi2 = float(np.sum((bw - aw @ x) ** 2))
                if chi2 < best[0]:
                    best, p = (chi2, edge, w), x
        if not math.isfinite(best[0]):
            return None
        where.append(best[1])
        stiff.append(best[2])
    return (np.array(where), np.array(stiff), p) if p is not None else None
