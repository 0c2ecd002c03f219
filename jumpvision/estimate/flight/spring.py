"""Gradual edges: beyond them the body is on a spring, and its fall turns into an oscillation."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
import scipy

from jumpvision.base.arrays import Array

from ..estimate import least_squares_fit, scatter_factor
from .beyond import Beyond, Drive, Ring
from .piece import Line, Piece, root_of

STIFFNESS = (20.0, 30.0, 45.0, 65.0, 100.0, 150.0, 250.0, 400.0, 700.0, 1200.0)  # rad/s, where a fit starts
KNOWN = {-1: 0.1, 1: 0.3}  # sigma of log w of a spring that is told, at a lift-off; at a landing sand softens it
ABOUT = (0.5, 0.7, 0.85, 1.0, 1.2)  # times that w, where a fit starts
PLACES, MOST = 24, 100  # of an edge, where a fit starts; samples that this looks at
SHRUNK = (1.0, 0.6, 0.35, 0.2)  # of the way to the turning point, tried in turn
POWER, STRONGEST = 3.0, 0.8  # sigmas of a correlation that is looked for, and the strongest
DOUBT = 1.5  # sigmas by which a fit of half a contact must differ
SLOW = 4  # samples
TRIES = 250  # of a fit, which takes 10
FREE = 0.3  # of gravity: what is known of a curvature that is fitted freely
HALF = 0.5  # of a contact, whose edges must be those of the whole
POOR = 1e-3  # chance of chi^2 below which a contact is none of a spring


@dataclass(frozen=True)
class Settings:
    """gravity, its sigma [m/s^2]; shortest flight [s]; ring of a foot; lag = c/k [s] of the damper at the spring.

    fitted: whether that gravity is one of the record's own, which a swing's top may imitate. drive: of the motor.
    quiet: share of the noise in a sigma that was widened for the ring, which is fitted here, and its correlation rho.
    stiffness: w [rad/s] of the spring, known to KNOWN.
    """

    gravity: float
    gravity_sigma: float = 0.0
    shortest: float = 0.0
    ring: Ring | None = None
    lag: float = 0.0
    fitted: bool = False
    drive: Drive | None = None
    quiet: float = 1.0
    rho: float = 0.0
    stiffness: float = 0.0

    def slow(self, step: float) -> bool:
        """Whether a contact is on a spring that is told, whose turn takes SLOW samples: it makes no corner."""
        return 0.0 < self.stiffness * step * SLOW < math.pi


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
    window: tuple[int, int] = (0, 0)
    own: tuple[float, float] = (0.0, 0.0)  # gravity and its sigma as this fit would have it
    rho: float = 0.0  # correlation of what is left from sample to sample
    wide: float = 1.0  # chi^2 with the noise that other curves are judged by, over chi2

    @property
    def line(self) -> Line:
        """The flight's parabola."""
        root = root_of(self.cov[:2, :2])
        return Line(self.p[:2], -0.5 * self.curvature[0], self.origin, self.chi2, self.n, root)

    @property
    def good(self) -> bool:
        return well(self.chi2, self.dof)

    @property
    def dof(self) -> int:
        return self.n - self.p.size - 2 * len(self.edges)

    @property
    def spent(self) -> float:
        """chi^2 beside curves that have no ring of their own."""
        return self.chi2 * self.wide


def departure(tau: Array, w: Array) -> tuple[Array, Array]:
    """(per m/s of speed down at the edge [s], per m/s^2 of gravity [s^2]): how far a spring without a damper holds the
    body above the parabola, tau >= 0 [s] after the edge. x'' = -g - w^2 x from x = 0; w [rad/s]."""
    turned = w * tau
    return np.asarray(tau - np.sin(turned) / w), np.asarray(0.5 * tau**2 - (1.0 - np.cos(turned)) / (w * w))


def sprung(
    piece: Piece,
    inside: tuple[int, int],
    reach: tuple[int, int],
    edges: tuple[int, ...],
    how: Settings,
    shares: tuple[float, ...] = SHRUNK,
) -> Sprung | None:
    """Fit of the flight of samples inside[0] .. inside[1] and of the contact as far as reach[0] .. reach[1].

    The contact is left out bit by bit from its turning point on, until a spring explains the rest of it.
    """
    best = None
    still = quiet(piece, how)
    wide = float(np.median(still.sigma / piece.sigma)) ** 2

    def fitted(share: float) -> Sprung | None:
        lo = inside[0] - round(share * (inside[0] - reach[0])) if -1 in edges else inside[0]
        hi = inside[1] + round(share * (reach[1] - inside[1])) if 1 in edges else inside[1]
        ends = piece.t[inside[0]], piece.t[inside[1] - 1]
        found = _fitted(still.part(lo, hi), *ends, edges, how)
        if found is not None and how.quiet < 1.0 and found.rho > POWER / math.sqrt(hi - lo):
            coloured = replace(still, rho=min(found.rho, STRONGEST))
            found = _fitted(coloured.part(lo, hi), *ends, edges, how) or found
        return None if found is None else replace(found, window=(lo, hi), wide=wide)

    for share in shares:
        found = fitted(share)
        if found is not None:
            best = found
            if found.good:
                break
    if best is None or len(shares) == 1:
        return best
    less = fitted(HALF * share)
    return best if less is None else doubted(best, less)


def doubted(best: Sprung, less: Sprung) -> Sprung:
    """With what a fit of less of the contact finds elsewhere, beyond what it knows less, where that is no chance: the
    ground or the foot is none of the model's."""
    m = len(best.edges)
    cov = best.cov.copy()
    at = np.arange(len(cov))[-m:]
    off, chance = (less.times - best.times) ** 2, np.maximum(np.diag(less.cov)[-m:] - cov[at, at], 0.0)
    cov[at, at] += np.where(off > DOUBT**2 * chance, off - chance, 0.0)
    return replace(best, cov=cov)


def quiet(piece: Piece, how: Settings) -> Piece:
    """With the noise of its samples alone, where the ring is fitted."""
    return piece if how.quiet == 1.0 else replace(piece, sigma=how.quiet * piece.sigma, rho=how.rho)


def _fitted(
    piece: Piece,
    first: float,
    last: float,
    edges: tuple[int, ...],
    how: Settings,
) -> Sprung | None:
    gravity, gravity_sigma = how.gravity, how.gravity_sigma
    t, n = piece.t, piece.t.size
    origin = 0.5 * (first + last)
    tau, span = t - origin, max(last - first, 4.0 * piece.step)
    free_gravity = gravity_sigma > 0.0
    drive = how.drive.near(t, origin) if how.drive is not None else None
    beyond = Beyond(tau, edges, how.lag, how.ring, drive, first - origin)
    many = 2 + free_gravity + beyond.free
    if n <= many + 2 * len(edges) + 1:
        return None
    hung = how.ring.share * np.interp(tau, drive.t, drive.o) if how.ring and drive else 0.0
    base = piece.y + hung + 0.5 * gravity * tau * tau
    asked: dict[bytes, tuple[Array, Array, Array]] = {}

    def fallen(added: Array) -> Array:
        return np.asarray(added[:, 1] - 0.5 * tau * tau)

    def added_by(nonlinear: Array) -> Array:
        return beyond.added(nonlinear[: len(edges)], np.exp(np.minimum(np.maximum(nonlinear[len(edges) :], -9.0), 9.0)))

    def design(nonlinear: Array) -> tuple[Array, Array, Array]:
        """(columns of the linear numbers, what depends on none of them, what is added); kept: it is asked for the
        residual and for its slopes."""
        key = nonlinear.tobytes()
        if key not in asked:
            added = added_by(nonlinear)
            a = np.empty((n, many))
            a[:, 0], a[:, 1], a[:, 2 + free_gravity :] = 1.0, tau + added[:, 0], added[:, 3:]
            if free_gravity:
                a[:, 2] = gravity_sigma * fallen(added)
            asked.clear()
            asked[key] = a, gravity * added[:, 1] + added[:, 2], added
        return asked[key]

    start = _start(piece, tau, many, base, edges, np.array([first, last]) - origin, how, drive)
    if start is None:
        return None
    where, stiff, p = start
    known = np.zeros(many + 2 * len(edges))
    prior = np.eye(known.size)[2:3] if free_gravity else np.zeros((0, known.size))
    if how.stiffness:
        known[many + len(edges) :] = math.log(how.stiffness)
        sure = np.array([1.0 / KNOWN[side] for side in edges])
        prior = np.vstack([prior, sure[:, None] * np.eye(known.size)[many + len(edges) :]])

    def residual(q: Array) -> Array:
        a, rest, _ = design(q[many:])
        return np.concatenate([piece.white(base - rest - a @ q[:many]), -prior @ (q - known)])

    def jacobian(q: Array) -> Array:
        a, _, added = design(q[many:])
        out = np.empty((n, q.size))
        out[:, :many] = a
        fall = gravity + gravity_sigma * q[2] if free_gravity else gravity
        by = np.concatenate([[q[1], fall, 1.0], q[2 + free_gravity : many]])
        for k in range(many, q.size):
            moved, step = q[many:].copy(), 1e-4 * piece.step if k < many + len(edges) else 1e-5
            moved[k - many] += step
            out[:, k] = (added_by(moved) - added) @ by / step
        return np.vstack([-piece.white(out), -prior])

    noise = float(np.median(piece.sigma))
    scale = [noise, noise / span, *[1.0] * free_gravity, *[noise] * beyond.free]
    scale += [piece.step] * len(edges) + [0.2] * len(edges)
    q0 = np.concatenate([p, where, np.log(stiff)])
    tries = iter(range(TRIES))

    def tried(q: Array) -> Array:
        if next(tries, None) is None:  # what has not closed in by then has no edge there
            raise ValueError("no fit")
        return residual(q)

    fit = least_squares_fit(tried, q0, scale=scale, jacobian=jacobian)
    if fit is None:
        return None
    q, cov, chi2 = fit
    keep = many + len(edges)
    times = q[many:keep]
    softest, stiffest = -9.0, math.log(0.5 * math.pi / piece.step)  # that turns before the next sample
    if np.any(times < tau[0]) or np.any(times > tau[-1]) or np.any((q[keep:] < softest) | (q[keep:] > stiffest)):
        return None
    if len(edges) == 2 and times[1] <= times[0]:
        return None
    dof = n - q.size
    factor = scatter_factor(chi2, dof) ** 2
    g = (gravity + gravity_sigma * q[2], gravity_sigma * math.sqrt(cov[2, 2])) if free_gravity else (gravity, 0.0)
    slopes = jacobian(q)
    if piece.wander:  # its steps move all samples behind them
        by = cov @ slopes[:n].T * (-math.sqrt((1.0 - piece.rho) / (1.0 + piece.rho)) / piece.sigma)
        behind = piece.wander * np.cumsum(by[:, ::-1], axis=1)
        cov = cov + behind @ behind.T
    left, by_gravity = residual(q)[:n], piece.white(fallen(beyond.added(times, np.exp(q[keep:]))))
    apart = by_gravity + slopes[:n] @ (cov @ (slopes[:n].T @ -by_gravity))
    sure = 1.0 / (float(apart @ apart) / factor + (FREE * gravity) ** -2.0)
    own = g if free_gravity else (gravity + sure * float(apart @ left) / factor, math.sqrt(sure))
    rho = float(left[1:] @ left[:-1]) / max(float(left @ left), 1e-300)
    return Sprung(origin, q[:many], origin + times, factor * cov[:keep, :keep], edges, chi2, n, g, own=own, rho=rho)


def _start(
    piece: Piece,
    tau: Array,
    many: int,
    base: Array,
    edges: tuple[int, ...],
    middle: Array,
    how: Settings,
    drive: Drive | None,
) -> tuple[Array, Array, Array] | None:
    """(places from the origin, stiffnesses, linear numbers): each edge over a grid, with the half of the flight beside
    it. middle (2,): where the flight begins and ends. The damper does not matter here."""
    span = float(middle[1] - middle[0])
    where, stiff, p, gravity = [], [], None, how.gravity
    springs = how.stiffness * np.array(ABOUT) if how.stiffness else np.array(STIFFNESS)
    for side in edges:
        end = middle[(side + 1) // 2]
        use = np.flatnonzero(side * (tau - middle.mean()) >= 0.0) if len(edges) == 2 else np.arange(tau.size)
        use = use[:: max(1, use.size // MOST)]
        places = end - side * span * np.linspace(-0.06, 0.4, PLACES)
        edge, w = (a.ravel()[:, None] for a in np.meshgrid(places, springs, indexing="ij"))
        if use.size < 4:
            return None
        speed, fall = departure(np.maximum(side * (tau[use] - edge), 0.0), w)
        y = base[use] - side * gravity * edge * speed - gravity * fall
        if drive is not None:
            alone = Beyond(tau[use], (side,), 0.0, None, drive, 0.0)
            y -= [alone.pulled(e, v) for e, v in zip(edge[:, 0], w[:, 0])]
        one = 1.0 / piece.sigma[use]  # the columns of the flight's height, and of its speed
        rate = (tau[use] - side * speed) * one
        y *= one
        square, product = np.empty((len(y), 2, 2)), np.stack([y @ one, np.sum(y * rate, axis=1)], axis=1)
        square[:, 0, 0], square[:, 1, 1] = one @ one, np.sum(rate * rate, axis=1)
        square[:, 0, 1] = square[:, 1, 0] = rate @ one
        square += 1e-12 * np.trace(square, axis1=1, axis2=2)[:, None, None] * np.eye(2)
        x = np.linalg.solve(square, product[..., None])[..., 0]
        chi2 = np.sum(y * y, axis=1) - np.sum(product * x, axis=1)
        best = int(np.argmin(chi2))
        where.append(float(edge[best, 0]))
        stiff.append(float(w[best, 0]))
        p = x[best]
    start = np.zeros(many)
    start[:2] = p
    return np.array(where), np.array(stiff), start


def swings(piece: Piece, how: Settings) -> float:
    """Least chi^2 of one swing about a level: on the spring and with the damper that are told, which swings as far down
    as up; or else of changing amplitude and any frequency about one period in the piece."""
    tau = piece.t - piece.t[0]
    y = piece.white(piece.y)

    def chi2(w: Array) -> Array:
        turned, of = w * tau[:, None], np.ones((tau.size, w.size))
        fall = np.exp(-0.5 * how.lag * w * w * tau[:, None]) if how.stiffness else of
        columns = [of, fall * np.cos(turned), fall * np.sin(turned)]
        columns += [] if how.stiffness else [tau[:, None] * c for c in columns[1:]]
        a = piece.white(np.concatenate(columns, axis=1)).reshape(tau.size, len(columns), w.size)
        q = np.linalg.qr(a.transpose(2, 0, 1))[0]
        left = y - (q @ (q.swapaxes(1, 2) @ y[:, None]))[..., 0]
        known = np.log(w / how.stiffness) / KNOWN[-1] if how.stiffness else 0.0
        return np.asarray(np.sum(left * left, axis=1) + known * known)

    tried = 2.0 * math.pi / tau[-1] * np.linspace(0.3, 2.0, 18)
    if how.stiffness:
        tried = how.stiffness * np.exp(3.0 * KNOWN[-1] * np.linspace(-1.0, 1.0, 7))
    best = int(np.argmin(chi2(tried)))
    bounds = tried[max(best - 1, 0)], tried[min(best + 1, tried.size - 1)]
    found = scipy.optimize.minimize_scalar(lambda w: chi2(np.array([w]))[0], bounds=bounds, method="bounded")
    return float(found.fun)


def well(chi2: float, dof: int) -> bool:
    """Whether a chi^2 is one that chance makes."""
    return dof > 0 and chi2 <= scipy.special.chdtri(dof, POOR)
