"""Damped free oscillation of the loaded spring: frequency and damping, from the waveform or the published peaks."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array

from .estimate import Estimate, checked, checked_sigma, checked_times, fit_line, least_squares_fit, scatter_factor

FALSE_ALARM = 1e-3  # chance that pure noise passes as an oscillation
DECAYS = np.array([0.0, 0.5, 1.5, 5.0, 15.0])  # over the record's length, first tries of the rate of decay
REGULAR, FINER = 0.01, 4  # of the samples' spacing: so regular is a record, and how much finer the grid of another
LONG, A_PERIOD = 20_000, 16  # samples: longer records are averaged over neighbours, as far as leaves so many a period
STILL = 0.01  # of the largest swing, below which a body counts as at rest
NAN = float("nan")


@dataclass(frozen=True)
class RingDown:
    """x = offset + amplitude exp(-zeta omega0 (t - t0)) cos(omega_d (t - t0) + phase), t0 the first good sample.

    frequency = omega_d/(2 pi) [Hz] is the observed (damped) one, omega0 = omega_d/sqrt(1 - zeta^2) [rad/s] not.
    amplitude, offset in the unit of x, phase in rad. chi2 over n - 5 degrees of freedom; the sigmas hold the scatter
    factor. reason: why everything is NaN, empty when good. zeta is not forced to be positive, so that its mean is not
    biased where it is small against its sigma.
    """

    frequency: float
    frequency_sigma: float
    zeta: float
    zeta_sigma: float
    omega0: float
    omega0_sigma: float
    amplitude: float
    amplitude_sigma: float
    offset: float
    offset_sigma: float
    phase: float
    chi2: float
    n: int
    reason: str = ""

    def estimates(self) -> dict[str, Estimate]:
        """The entries `zeta`, `frequency_hz`, `omega0` of fits.json."""
        rows = {
            "zeta": (self.zeta, self.zeta_sigma, ""),
            "frequency_hz": (self.frequency, self.frequency_sigma, "Hz"),
            "omega0": (self.omega0, self.omega0_sigma, "rad/s"),
        }
        return {k: Estimate(v, s, unit, self.n, self.chi2, self.reason) for k, (v, s, unit) in rows.items()}


def ring_down(t: ArrayLike, x: ArrayLike, sigma: ArrayLike) -> RingDown:
    """The damped cosine + offset with the least chi2, started from a least squares periodogram.

    t [s] increasing, x, sigma > 0 in one unit, shape (n,); NaN samples (lost frames) are left out. Only the free
    oscillation may be given: no forcing, foot on the ground. NaN with a reason where no oscillation is significant.
    Of a record that `thinned` averages, n and chi2 are those of the means.
    """
    t, x, sigma = checked("ring_down", t=t, x=x, sigma=sigma)
    checked_sigma("ring_down", sigma)
    good = np.isfinite(t) & np.isfinite(x) & np.isfinite(sigma)
    checked_times("ring_down", np.where(good, t, np.nan))
    t, x, sigma = t[good], x[good], sigma[good]
    n = t.size
    if n < 8:
        return _none(n, NAN, f"{n} good samples, a ring-down needs 8")
    t, x, sigma = thinned(t - t[0], x, sigma)
    n = t.size
    # 8 frequencies of the periodogram for each of the record's length (1 for a first look)
    frequency, n_independent = _start(t, x, sigma, 8)
    flat = _linear(t, x, sigma, 0.0, 0.0)[1]
    span = float(t[-1])

    @functools.lru_cache(maxsize=1)  # slopes are asked for where the model was
    def swing(w: float, decay: float) -> tuple[Array, Array, Array]:
        return np.exp(-decay * t), np.cos(w * t), np.sin(w * t)

    def residual(q: Array) -> Array:
        e, c, s = swing(q[3], q[4])
        return np.asarray((x - (q[2] + e * (q[0] * c + q[1] * s))) / sigma)

    def jacobian(q: Array) -> Array:
        return -_slopes(t, q, *swing(q[3], q[4])) / sigma[:, None]

    # the periodogram peak has no decay of its own
    w = 2.0 * math.pi * frequency
    tries = [(*_linear(t, x, sigma, w, decay), decay) for decay in DECAYS / span]
    best = None
    for p, _, decay in sorted(tries, key=lambda a: a[1])[:2]:  # the two best by chi2 are fitted
        size = max(math.hypot(p[0], p[1]), float(sigma.mean()))
        scale = [size, size, size, 1.0 / span, 1.0 / span]
        fit = least_squares_fit(residual, [*p, w, decay], scale=scale, jacobian=jacobian)
        if fit is not None and (best is None or fit[2] < best[2]):
            best = fit
    if best is None:
        return _none(n, flat, "the damped cosine could not be fitted")
    p, cov, chi2 = best
    factor = scatter_factor(chi2, n - 5)
    gain = (flat - chi2) / factor**2
    # the chi2 of 4 parameters fitted at the best of n_independent frequencies; log1p keeps tiny chances apart
    tail = math.exp(-0.5 * gain) * (1.0 + 0.5 * gain) if gain > 0.0 else 1.0
    if tail >= 1.0 or -math.expm1(n_independent * math.log1p(-tail)) > FALSE_ALARM:
        return _none(
            n, chi2, f"no significant oscillation: chi2 {flat:.1f} of a constant, {chi2:.1f} of a damped cosine"
        )
    if not 0.0 < p[3] < math.pi / float(np.median(np.diff(t))):
        return _none(n, chi2, "the oscillation is at or beyond the Nyquist frequency")
    c, s, offset, w, decay = p
    omega0, amplitude = math.hypot(w, decay), math.hypot(c, s)
    rows = np.array(  # derivatives of frequency, zeta, omega0, amplitude, offset by c, s, offset, w, decay
        [
            [0.0, 0.0, 0.0, 1.0 / (2.0 * math.pi), 0.0],
            [0.0, 0.0, 0.0, -decay * w / omega0**3, w**2 / omega0**3],
            [0.0, 0.0, 0.0, w / omega0, decay / omega0],
            [c / amplitude, s / amplitude, 0.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0, 0.0],
        ]
    )
    e = factor * np.sqrt(np.einsum("ij,jk,ik->i", rows, cov, rows))
    return RingDown(
        frequency=w / (2.0 * math.pi),
        frequency_sigma=float(e[0]),
        zeta=decay / omega0,
        zeta_sigma=float(e[1]),
        omega0=omega0,
        omega0_sigma=float(e[2]),
        amplitude=amplitude,
        amplitude_sigma=float(e[3]),
        offset=float(offset),
        offset_sigma=float(e[4]),
        phase=math.atan2(-s, c),
        chi2=chi2,
        n=n,
    )


def _slopes(t: Array, p: Array, e: Array, cos: Array, sin: Array) -> Array:
    """d(model)/dp, shape (n, 5), of offset + e (p0 cos + p1 sin)."""
    out = np.ones((t.size, 5))
    out[:, 0], out[:, 1] = c, s = e * cos, e * sin
    out[:, 3] = t * (p[1] * c - p[0] * s)
    out[:, 4] = -t * (p[0] * c + p[1] * s)
    return out


def _linear(t: Array, x: Array, sigma: Array, w: float, decay: float) -> tuple[Array, float]:
    """((cos, sin, offset) amplitudes, chi2) at a given angular frequency and decay rate; w = 0: the offset alone."""
    e = np.exp(-decay * t)
    design = np.stack([e * np.cos(w * t), e * np.sin(w * t), np.ones_like(t)], axis=1)
    if w == 0.0:
        design[:, :2] = 0.0
    p: Array = np.linalg.lstsq(design / sigma[:, None], x / sigma, rcond=None)[0].astype(np.float64)
    return p, float(np.sum(((x - design @ p) / sigma) ** 2))


def thinned(t: Array, x: Array, sigma: Array) -> tuple[Array, Array, Array]:
    """A record (n,) of an oscillation; one above LONG as weighted means over neighbours, A_PERIOD or more a period.

    A mean over times t about t_m shows cos(w t + p) as cos(w t_m + p) times the mean of cos(w (t - t_m)): divided by it
    again, about the mean of the record.
    """
    if t.size <= LONG:
        return t, x, sigma
    frequency = _start(t, x, sigma, 1)[0]
    bins = min(t.size, max(LONG, math.ceil(A_PERIOD * frequency * (t[-1] - t[0]))))
    if bins > t.size // 2:
        return t, x, sigma
    cell = np.minimum(((t - t[0]) * (bins / (t[-1] - t[0]))).astype(np.int64), bins - 1)
    w = sigma**-2
    total = np.bincount(cell, w)
    have = total > 0.0
    middle, mean = (np.bincount(cell, w * a)[have] / total[have] for a in (t, x))
    off = t - np.repeat(middle, np.bincount(cell)[have])
    seen = np.bincount(cell, w * np.cos(2.0 * math.pi * frequency * off))[have] / total[have]
    centre = float(np.average(x, weights=w))
    return middle, centre + (mean - centre) / seen, total[have] ** -0.5 / seen


def _start(t: Array, x: Array, sigma: Array, oversampled: int) -> tuple[float, float]:
    """(frequency [Hz] of the highest peak of the weighted least squares periodogram, independent frequencies in it).

    Its sums over samples are fast Fourier transforms of the record laid on a regular grid of times, finer than the
    samples' spacing where that varies: time and memory grow in proportion to the record.
    """
    span, w, dt = t[-1], sigma**-2, float(np.median(np.diff(t)))
    top, place = 0.5 / dt, t / dt
    if np.max(np.abs(place - np.round(place))) > REGULAR:
        place, dt = FINER * place, dt / FINER
    cell = np.round(place).astype(np.int64)
    size = scipy.fft.next_fast_len(oversampled * (int(cell[-1]) + 1))
    y = x - np.average(x, weights=w)

    def sums(a: Array) -> NDArray[np.complex128]:
        """sum of a exp(2 pi i f t) at the frequencies k / (size dt) up to the Nyquist frequency of the grid."""
        return scipy.fft.rfft(np.bincount(cell, a, minlength=size)).conj()

    one, both, total = sums(w), sums(w * y), float(w.sum())
    k = np.arange(math.ceil(0.7 / span * size * dt), min(math.ceil(top * size * dt), size // 2))
    c, s, again = one[k].real, one[k].imag, 2 * k > size // 2  # of a real record the upper half mirrors the lower
    twice = np.where(again, one[np.where(again, size - 2 * k, 2 * k)].conj(), one[np.where(again, 0, 2 * k)])
    cc, ss = 0.5 * (total + twice.real) - c * c / total, 0.5 * (total - twice.real) - s * s / total
    cs = 0.5 * twice.imag - c * s / total
    yc, ys = both[k].real, both[k].imag  # y has no mean: the offset is fitted too
    power = (yc**2 * ss + ys**2 * cc - 2.0 * yc * ys * cs) / np.maximum(cc * ss - cs**2, 1e-9 * cc * ss + 1e-300)
    return float(k[np.argmax(power)] / (size * dt)), float(top * span)


def _none(n: int, chi2: float, reason: str) -> RingDown:
    return RingDown(NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN, NAN, chi2, n, reason)


def swings_until(height: ArrayLike, sigma: ArrayLike) -> int:
    """Number of samples (of n) until the motion has ended; n where it goes on to the end of the record.

    Ended: the last tenth of the record, and all from there on, stays within 5 sigma or STILL of the largest swing about
    its median. A body that dry friction holds off its equilibrium would otherwise be fitted as an oscillation.
    """
    h, noise = checked("swings_until", height=height, sigma=sigma)
    end = float(np.median(h[-max(1, h.size // 10) :]))
    moves = np.abs(h - end) > np.maximum(5.0 * noise, STILL * np.abs(h - end).max())
    last = int(np.flatnonzero(moves)[-1]) + 1 if moves.any() else h.size
    return last if last < 0.9 * h.size else h.size


def peaks_damping(t: Array, x: Array, sigma: Array, *, frequency: float, offset: float) -> Estimate:
    """zeta from the line through log |x - offset| at the peaks, each the top of a parabola over a third of a period.

    t [s] increasing, x, sigma (n,) in one unit; frequency [Hz] and offset as ring_down finds them. NaN with a reason
    below three clear peaks.
    """
    half = 0.5 / frequency
    times: list[float] = []
    logs: list[float] = []
    errors: list[float] = []
    for number in range(int((t[-1] - t[0]) / half)):
        inside = np.flatnonzero((t >= t[0] + number * half) & (t < t[0] + (number + 1) * half))
        if inside.size == 0:
            continue
        top = t[inside[np.argmax(np.abs(x[inside] - offset))]]
        # a third of a half period on each side: a cosine is flatter than its parabola by a constant factor
        near = np.flatnonzero(np.abs(t - top) <= 1.0 / 3.0 * half)
        if near.size < 4 or near[0] == 0 or near[-1] == t.size - 1:
            continue
        d = t[near] - top
        a = np.stack([np.ones_like(d), d, d * d], axis=1) / sigma[near, None]
        cov = np.linalg.inv(a.T @ a)
        p = cov @ (a.T @ ((x[near] - offset) / sigma[near]))
        shift = -0.5 * p[1] / p[2] if p[2] else math.inf
        height = p[0] - 0.25 * p[1] ** 2 / p[2] if p[2] else 0.0
        # a peak must stand three sigmas above the offset
        if abs(shift) > half / 4.0 or height * p[2] > 0.0 or abs(height) < 3.0 * math.sqrt(cov[0, 0]):
            continue
        if not times or top + shift > times[-1] + 0.5 * half:
            times.append(top + shift)
            logs.append(math.log(abs(height)))
            errors.append(math.sqrt(cov[0, 0]) / abs(height))
    if len(times) < 3:
        return Estimate(math.nan, math.nan, "", len(times), math.nan, f"{len(times)} clear peaks, three are needed")
    line = fit_line(times, logs, errors)
    rate = 2.0 * math.pi * frequency
    decay = -line.slope
    omega0 = math.hypot(rate, decay)
    return Estimate(decay / omega0, line.slope_sigma * rate**2 / omega0**3, "", line.n, line.chi2)
