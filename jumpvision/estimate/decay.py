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
from .mean import noise_at
from .ringdown import RingDown, ring_down, thinned

NAN = float("nan")
Fit = tuple[Array, float, Array, Array]
LAWS = ("viscous", "quadratic", "coulomb")
SETS = tuple(c for r in (1, 2, 3) for c in combinations(LAWS, r))
DRAWS, BURN = 2000, 50
REFUSED = 0.01  # chance below which a law alone is refused
NAMED = 0.8  # chance from which a set of laws is named
RARER = 0.25  # chance of a set before any data, for each law more: most bodies lose by one
MISFIT = 4.0  # chi2 per degree of freedom beyond which the stated noise does not describe the record


@dataclass(frozen=True)
class Decay:
    """share: of the energy lost over the record, by law, summing to 1. rate: gamma [1/s], beta [1/unit of x], friction
    over mass [unit of x / s^2]. chance: of each set of LAWS; p_alone: of a misfit as large as that of each law alone,
    against all three together. law: the set of chance NAMED or more, as "viscous + coulomb", else "undetermined", or
    "mixed" where no law alone will do.
    excess: chi2 per degree of freedom of all three laws; widened: factor by which all sigmas are larger for it and for
    the colour of the noise. fitted: of the record as averaged by `thinned`.
    """

    share: dict[str, Estimate]
    rate: dict[str, Estimate]
    chance: dict[tuple[str, ...], float]
    p_alone: dict[str, float]
    law: str
    excess: float
    widened: float
    fitted: Array
    reason: str = ""

    def takes_part(self, law: str) -> float:
        """Chance that a law is one of those at work."""
        return sum(c for laws, c in self.chance.items() if law in laws)


def decay_law(t: ArrayLike, x: ArrayLike, sigma: ArrayLike, *, rng: np.random.Generator) -> Decay:
    """The three dampings, none negative, fitted to a free oscillation t [s], x, sigma (n,), NaN left out.

    A cubic spring term takes part, so that a frequency that changes with the amplitude is not read as damping. The
    noise is that which all three laws together leave near the frequency of the oscillation (`noise_at`): a wandering
    zero does not blur a damping, a correlated error of the swing does. Shares are means and standard deviations over
    the posterior of dampings >= 0 (drawn with rng), averaged over all sets of laws by their evidence (BIC): two laws
    together nearly mimic the third. Rates are those of the set that is named, averaged likewise where none is.
    """
    t, x, sigma = checked("decay_law", t=t, x=x, sigma=sigma)
    checked_sigma("decay_law", sigma)
    good = np.isfinite(t) & np.isfinite(x) & np.isfinite(sigma)
    t, x, sigma = t[good], x[good], sigma[good]
    ring = ring_down(t, x, sigma)
    if ring.reason:
        return _none(ring.reason, x.size)
    t, x, sigma = thinned(t - t[0], x, sigma)
    size = float(np.quantile(np.abs(x - ring.offset), 0.9))
    fits: dict[tuple[str, ...], Fit] = {}
    for laws in SETS:  # each from the best of the sets that lack one of its laws
        smaller = [fits[s] for s in SETS if len(s) == len(laws) - 1 and set(s) < set(laws)]
        near = min(smaller, key=lambda f: f[1])[0] if smaller else None
        fits[laws] = _fit(t, x, sigma, ring, size, laws, near)
    q, rss, _, left = fits[LAWS]
    dof = max(x.size - q.size, 1)
    excess = rss / dof
    # variance of a residual near the oscillation; the stated errors are not shrunk but for the colour of the noise
    noise = max(excess, 1.0) * noise_at(left, ring.frequency * float(np.median(np.diff(t))))
    p_alone = {law: float(scipy.special.fdtrc(2, dof, max(fits[(law,)][1] - rss, 0.0) / noise / 2.0)) for law in LAWS}
    price = 0.5 * math.log(x.size) - math.log(RARER)  # of a law more
    log = np.array([-0.5 * (f[1] - rss) / noise - price * len(laws) for laws, f in fits.items()])
    weight = np.exp(log - log.max()) / np.exp(log - log.max()).sum()
    best, alone = int(np.argmax(weight)), max(p_alone.values()) >= REFUSED
    named = weight[best] >= NAMED
    shares, rates = [], []
    for i, laws in enumerate(SETS):
        count = round(DRAWS * weight[i])
        if count:
            draws = _draws(fits[laws], laws, noise, count, rng)
            energy = draws * _losses(t, fits[laws][0], ring, size)
            shares.append(energy / np.maximum(energy.sum(axis=1, keepdims=True), 1e-300))
            if i == best or not named:
                rates.append(draws * _scales(ring, size))
    share, rate = np.concatenate(shares), np.concatenate(rates)

    def estimate(values: Array, unit: str) -> Estimate:
        return Estimate(float(values.mean()), float(values.std()), unit, x.size, rss)

    return Decay(
        {k: estimate(share[:, i], "") for i, k in enumerate(LAWS)},
        {k: estimate(rate[:, i], u) for i, (k, u) in enumerate(zip(LAWS, ("1/s", "1/m", "m/s^2")))},
        dict(zip(SETS, weight.tolist())),
        p_alone,
        " + ".join(SETS[best]) if named else "undetermined" if alone else "mixed",
        excess,
        math.sqrt(noise),
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


def _fit(
    t: Array, x: Array, sigma: Array, ring: RingDown, size: float, laws: tuple[str, ...], near: Array | None
) -> Fit:
    """(q (8,), chi2, jacobian (n, 8), residual/sigma); near: q of a smaller set, None: one law with all the loss."""
    free = np.r_[np.arange(5), [5 + LAWS.index(k) for k in laws]].astype(int)
    a = ring.amplitude / size
    gamma = ring.zeta * ring.omega0
    v0 = -gamma / ring.omega0 * a * math.cos(ring.phase) - a * math.sin(ring.phase)
    if near is None:
        start = np.r_[a * math.cos(ring.phase), v0, 0.0, 0.0, 0.0, 0.9 * np.ones(3)]
    else:
        start = np.where(np.isin(np.arange(8), free[5:]), np.maximum(near, 0.05), near)

    def residual(p: Array) -> Array:
        q = np.zeros(8)
        q[free] = p
        return np.asarray((x - _motion(t, q, ring, size)) / sigma)

    low = np.r_[np.full(5, -np.inf), np.zeros(3)][free]
    narrow = np.r_[0.1, 0.1, 0.1, 1e-3, 1e-2, 0.3, 0.3, 0.3][free]
    fit = scipy.optimize.least_squares(
        residual,
        start[free],
        bounds=(low, np.inf),
        x_scale=narrow,
        ftol=1e-3 / x.size,  # smaller gains over the degrees of freedom end a fit
    )
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
    norm = np.maximum(np.linalg.norm(jac[:, free], axis=0), 1e-300)
    unit = jac[:, free] / norm
    cov = np.linalg.pinv(unit.T @ unit, hermitian=True) / np.outer(norm, norm)
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
    unknown = dict.fromkeys(LAWS, NAN)
    return Decay(nothing, nothing, dict.fromkeys(SETS, NAN), unknown, "undetermined", NAN, NAN, np.full(0, NAN), reason)


PHASE_STEP = 0.2  # rad of the oscillation a step may cover
MOST_STEPS = 1000  # between two samples: more, and what is asked for is no oscillation that was sampled


@njit(cache=True, inline="always")
def resistance(v: float, side: float, linear: float, quadratic: float, coulomb: float) -> float:
    """linear v + quadratic |v| v + coulomb side [x/s^2]: what opposes a speed v; side: of the motion, or within."""
    return linear * v + quadratic * abs(v) * v + coulomb * side


@njit(cache=True)
def _step(
    y: float, v: float, h: float, c: float, s: float, w: float, kappa: float, gamma: float, beta: float, dry: float
) -> tuple[float, float]:
    """(y, v) after h: the linear swing exactly, all else by Runge and Kutta's fourth order along it (Lawson 1967).

    c, s: cosine and sine of w h / 2.
    """
    w2 = w * w
    yh, vh = y * c + v * s / w, v * c - y * w * s  # undisturbed, after half and all of h
    y1, v1 = yh * c + vh * s / w, vh * c - yh * w * s
    a1 = -w2 * kappa * y * y * y - resistance(v, 1.0, 2.0 * gamma, beta, dry)
    ya, va = yh + 0.5 * h * a1 * s / w, vh + 0.5 * h * a1 * c
    a2 = -w2 * kappa * ya * ya * ya - resistance(va, 1.0, 2.0 * gamma, beta, dry)
    vb = vh + 0.5 * h * a2
    a3 = -w2 * kappa * yh * yh * yh - resistance(vb, 1.0, 2.0 * gamma, beta, dry)
    yc, vc = y1 + h * a3 * s / w, v1 + h * a3 * c
    a4 = -w2 * kappa * yc * yc * yc - resistance(vc, 1.0, 2.0 * gamma, beta, dry)
    full_c, full_s = c * c - s * s, 2.0 * s * c
    y_new = y1 + h / 6.0 * (a1 * full_s + 2.0 * (a2 + a3) * s) / w
    v_new = v1 + h / 6.0 * (a1 * full_c + 2.0 * (a2 + a3) * c + a4)
    return y_new, v_new


@njit(cache=True)
def swing(t: Array, y: float, v: float, w: float, kappa: float, gamma: float, beta: float, dry: float) -> Array:
    """y at the times t (n,) [s] of y'' = -w^2 (y + kappa y^3) - 2 gamma y' - beta |y'| y' - dry sign(y').

    y, v are those at t[0].
    Coulomb friction holds the body where the spring is weaker than it; steps end where the velocity passes zero.
    NaN from where MOST_STEPS are not enough between two times.
    """
    out = np.full(t.size, np.nan)
    out[0] = y
    w2, stuck = w * w, False
    of, c, s = -1.0, 1.0, 0.0  # step that cosine and sine belong to
    for i in range(1, t.size):
        left = t[i] - t[i - 1]
        if not left * abs(w) <= 0.5 * MOST_STEPS * PHASE_STEP:
            return out
        full = left / max(1, math.ceil(left * abs(w) / PHASE_STEP))
        steps = 0
        while left > 1e-9 * full and not stuck:
            steps += 1
            if steps > MOST_STEPS:
                return out
            h = min(full, left)
            side = 1.0 if v > 0.0 else -1.0
            if v == 0.0:
                pull = -w2 * (y + kappa * y * y * y)
                if abs(pull) <= dry:
                    stuck = True
                    break
                side = 1.0 if pull > 0.0 else -1.0
            # steps that differ by rounding share their cosine: an even record needs it once
            if abs(h - of) > 1e-12 * h:
                of, c, s = h, math.cos(0.5 * w * h), math.sin(0.5 * w * h)
            y1, v1 = _step(y, v, h, c, s, w, kappa, gamma, beta, dry * side)
            if dry > 0.0 and v1 * side < 0.0:  # turned within the step: end it at the turning point
                low, high, v_low, v_high = 0.0, h, v, v1
                for _ in range(30):  # regula falsi, the end that stays halved (Illinois)
                    h = low - v_low * (high - low) / (v_high - v_low) if v_low != 0.0 else 0.5 * (low + high)
                    ch, sh = math.cos(0.5 * w * h), math.sin(0.5 * w * h)
                    y1, v1 = _step(y, v, h, ch, sh, w, kappa, gamma, beta, dry * side)
                    if abs(v1) < 1e-12 * w * (abs(y) + abs(y1)):
                        break
                    if v1 * side < 0.0:
                        high, v_high, v_low = h, v1, 0.5 * v_low
                    else:
                        low, v_low, v_high = h, v1, 0.5 * v_high
                v1 = 0.0
            left -= h
            y, v = y1, v1
        out[i] = y
    return out
