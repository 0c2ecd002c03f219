"""Which law an oscillation decays by: viscous, quadratic and Coulomb friction told apart on the whole waveform."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np
import scipy
from numba import njit
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array

from .estimate import Estimate, checked, checked_sigma
from .mean import correlation_time
from .ringdown import RingDown, ring_down

NAN = float("nan")
Fit = tuple[Array, float, Array, Array]
LAWS = ("viscous", "quadratic", "coulomb")
SETS = tuple(c for r in (1, 2, 3) for c in combinations(LAWS, r))
DRAWS, BURN = 2000, 50
REFUSED = 0.01  # chance below which a law alone is refused


@dataclass(frozen=True)
class Decay:
    """share: of the energy lost over the record, by law, summing to 1. rate: gamma [1/s], beta [1/unit of x], friction
    over mass [unit of x / s^2]. p_alone: chance of a misfit as large as that of each law alone, against all three
    together. law: the only one not refused, "undetermined" where several are left, "mixed" where none is."""

    share: dict[str, Estimate]
    rate: dict[str, Estimate]
    p_alone: dict[str, float]
    law: str
    fitted: Array
    reason: str = ""


def decay_law(t: ArrayLike, x: ArrayLike, sigma: ArrayLike, *, rng: np.random.Generator) -> Decay:
    """The three dampings, none negative, fitted to a free oscillation t [s], x, sigma (n,), NaN left out.

    A cubic spring term takes part, so that a frequency that changes with the amplitude is not read as damping. The
    noise is that left by all three laws together, with its correlation; the single laws are held against it. Shares
    and rates are means and standard deviations over the posterior of dampings >= 0 (drawn with rng),
    averaged over all sets of laws by their evidence (BIC): two laws together nearly mimic the third.
    """
    t, x, sigma = checked("decay_law", t=t, x=x, sigma=sigma)
    checked_sigma("decay_law", sigma)
    good = np.isfinite(t) & np.isfinite(x) & np.isfinite(sigma)
    t, x, sigma = t[good], x[good], sigma[good]
    ring = ring_down(t, x, sigma)
    if ring.reason:
        return _none(ring.reason, x.size)
    t = np.asarray(t - t[0], dtype=np.float64)
    size = float(np.quantile(np.abs(x - ring.offset), 0.9))
    fits = {
        laws: min((_fit(t, x, sigma, ring, size, laws, lead) for lead in laws), key=lambda f: f[1]) for laws in SETS
    }
    q, rss, _, left = fits[LAWS]
    tau = correlation_time(left)
    independent = x.size / tau
    dof = max(independent - q.size, 1.0)
    noise = max(rss / dof, 1.0)  # variance of an independent residual; the stated errors are not shrunk
    p_alone = {law: float(scipy.special.fdtrc(2, dof, max(fits[(law,)][1] - rss, 0.0) / noise / 2.0)) for law in LAWS}
    passed = [law for law in LAWS if p_alone[law] >= REFUSED]
    log = np.array([-0.5 * (f[1] - rss) / noise - 0.5 * len(laws) * math.log(independent) for laws, f in fits.items()])
    weight = np.exp(log - log.max()) / np.exp(log - log.max()).sum()
    shares, rates = [], []
    for w, laws in zip(weight, SETS):
        count = round(DRAWS * w)
        if count:
            draws = _draws(fits[laws], laws, noise, count, rng)
            energy = draws * _losses(t, fits[laws][0], ring, size)
            shares.append(energy / energy.sum(axis=1, keepdims=True))
            rates.append(draws * _scales(ring, size))
    share, rate = np.concatenate(shares), np.concatenate(rates)

    def estimate(values: Array, unit: str) -> Estimate:
        return Estimate(float(values.mean()), float(values.std()), unit, x.size, rss)

    return Decay(
        {k: estimate(share[:, i], "") for i, k in enumerate(LAWS)},
        {k: estimate(rate[:, i], u) for i, (k, u) in enumerate(zip(LAWS, ("1/s", "1/m", "m/s^2")))},
        p_alone,
        passed[0] if len(passed) == 1 else "undetermined" if passed else "mixed",
        x - left * sigma,
    )


def _scales(ring: RingDown, size: float) -> Array:
    """gamma, beta and dry friction that each alone would lose the observed energy at the amplitude `size`."""
    gamma = max(ring.zeta, 1e-5) * ring.omega0
    return np.array(
        [gamma, gamma * 3.0 * math.pi / (4.0 * ring.omega0 * size), 0.5 * math.pi * gamma * ring.omega0 * size]
    )


def _motion(t: Array, q: Array, ring: RingDown, size: float) -> Array:
    """x at t for q = (y0, v0, offset in `size`, frequency shift, cubic term, the three dampings in their scales)."""
    w = ring.omega0 * (1.0 + q[3])
    gamma, beta, dry = q[5:] * _scales(ring, size)
    return np.asarray(
        ring.offset
        + size * q[2]
        + swing(t, size * q[0], size * w * q[1], w, q[4] / size**2, max(gamma, 0.0), max(beta, 0.0), max(dry, 0.0))
    )


def _fit(t: Array, x: Array, sigma: Array, ring: RingDown, size: float, laws: tuple[str, ...], lead: str) -> Fit:
    """(q (8,), chi2, jacobian (n, 8), residual/sigma); `lead` of the `laws` starts with all the loss, others stay 0."""
    free = np.r_[np.arange(5), [5 + LAWS.index(k) for k in laws]].astype(int)
    a = ring.amplitude / size
    gamma = ring.zeta * ring.omega0
    v0 = -gamma / ring.omega0 * a * math.cos(ring.phase) - a * math.sin(ring.phase)
    start = np.r_[a * math.cos(ring.phase), v0, 0.0, 0.0, 0.0, 0.05 * np.ones(3)]
    start[5 + LAWS.index(lead)] = 0.9

    def residual(p: Array) -> Array:
        q = np.zeros(8)
        q[free] = p
        return np.asarray((x - _motion(t, q, ring, size)) / sigma)

    low = np.r_[np.full(5, -np.inf), np.zeros(3)][free]
    narrow = np.r_[0.1, 0.1, 0.1, 1e-3, 1e-2, 0.3, 0.3, 0.3][free]
    fit = scipy.optimize.least_squares(residual, start[free], bounds=(low, np.inf), x_scale=narrow)
    q = np.zeros(8)
    q[free] = fit.x
    jac = np.zeros((x.size, 8))
    jac[:, free] = fit.jac
    return q, float(2.0 * fit.cost), jac, fit.fun


def _losses(t: Array, q: Array, ring: RingDown, size: float) -> Array:
    """Mean power lost to a unit of each damping in q, along the fitted motion."""
    fine = np.linspace(t[0], t[-1], max(t.size, math.ceil((t[-1] - t[0]) * ring.omega0 * 8.0)))
    v = np.gradient(_motion(fine, q, ring, size), fine)
    return _scales(ring, size) * np.array([2.0 * np.mean(v**2), np.mean(np.abs(v) ** 3), np.mean(np.abs(v))])


def _draws(fit: Fit, laws: tuple[str, ...], noise: float, count: int, rng: np.random.Generator) -> Array:
    """Posterior draws (count, 3) of the dampings: normal about the fit, cut to positive values (Gibbs)."""
    q, _, jac, left = fit
    at = np.array([5 + LAWS.index(k) for k in laws])
    free = np.r_[np.arange(5), at]
    cov = np.linalg.pinv(jac[:, free].T @ jac[:, free])
    centre = (q[free] - cov @ (jac[:, free].T @ left))[5:]  # of the unbounded parabola of chi2
    inner = np.linalg.inv(cov[5:, 5:] * noise)
    x, out = np.maximum(centre, 0.01), np.zeros((count, 3))
    for k, u in enumerate(rng.random((count + BURN, at.size))):
        for i in range(at.size):
            width = inner[i, i] ** -0.5
            mean = centre[i] - (inner[i] @ (x - centre) - inner[i, i] * (x[i] - centre[i])) / inner[i, i]
            above = scipy.special.ndtr(mean / width)  # the upper tail, accurate where the mean is far below 0
            x[i] = max(mean - width * scipy.special.ndtri(u[i] * above), 0.0) if above > 1e-290 else 0.0
        if k >= BURN:
            out[k - BURN, at - 5] = x
    return out


def _none(reason: str, n: int) -> Decay:
    nothing = {k: Estimate(NAN, NAN, "", n, NAN, reason) for k in LAWS}
    return Decay(nothing, nothing, dict.fromkeys(LAWS, NAN), "undetermined", np.full(0, NAN), reason)


PHASE_STEP = 0.12  # rad of the oscillation a Runge-Kutta step may cover


@njit(cache=True)
def _acceleration(y: float, v: float, w2: float, kappa: float, gamma: float, beta: float, dry: float) -> float:
    return -w2 * (y + kappa * y * y * y) - 2.0 * gamma * v - beta * abs(v) * v - dry


@njit(cache=True)
def _step(
    y: float, v: float, h: float, w2: float, kappa: float, gamma: float, beta: float, dry: float
) -> tuple[float, float]:
    a1 = _acceleration(y, v, w2, kappa, gamma, beta, dry)
    v2 = v + 0.5 * h * a1
    a2 = _acceleration(y + 0.5 * h * v, v2, w2, kappa, gamma, beta, dry)
    v3 = v + 0.5 * h * a2
    a3 = _acceleration(y + 0.5 * h * v2, v3, w2, kappa, gamma, beta, dry)
    v4 = v + h * a3
    a4 = _acceleration(y + h * v3, v4, w2, kappa, gamma, beta, dry)
    return y + h * (v + 2.0 * v2 + 2.0 * v3 + v4) / 6.0, v + h * (a1 + 2.0 * a2 + 2.0 * a3 + a4) / 6.0


@njit(cache=True)
def swing(t: Array, y: float, v: float, w: float, kappa: float, gamma: float, beta: float, dry: float) -> Array:
    """y at the times t (n,) [s] of y'' = -w^2 (y + kappa y^3) - 2 gamma y' - beta |y'| y' - dry sign(y').

    y, v are those at t[0].
    Coulomb friction holds the body where the spring is weaker than it; steps end where the velocity passes zero.
    """
    out = np.empty(t.size)
    out[0] = y
    w2, stuck = w * w, False
    for i in range(1, t.size):
        left = t[i] - t[i - 1]
        count = max(1, math.ceil(left * w / PHASE_STEP))
        full = left / count
        while left > 1e-14 and not stuck:
            h = min(full, left)
            side = 1.0 if v > 0.0 else -1.0
            if v == 0.0:
                pull = -w2 * (y + kappa * y * y * y)
                if abs(pull) <= dry:
                    stuck = True
                    break
                side = 1.0 if pull > 0.0 else -1.0
            y1, v1 = _step(y, v, h, w2, kappa, gamma, beta, dry * side)
            if dry > 0.0 and v1 * side < 0.0:  # turned within the step: end it at the turning point
                low, high = 0.0, h
                for _ in range(30):
                    h = 0.5 * (low + high)
                    y1, v1 = _step(y, v, h, w2, kappa, gamma, beta, dry * side)
                    if v1 * side < 0.0:
                        high = h
                    else:
                        low = h
                v1 = 0.0
            left -= h
            y, v = y1, v1
        out[i] = y
    return out
