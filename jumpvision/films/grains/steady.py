"""Means and fluctuations of a steady flow from its velocity fields, one in memory at a time."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import Array


class Velocities(NamedTuple):
    """One field, all (ny, nx): u, v, their standard uncertainties, and where they were measured."""

    u: Array
    v: Array
    u_sigma: Array
    v_sigma: Array
    measured: NDArray[np.bool_]


class Memory(NamedTuple):
    """How long a component remembers: twice the sum of its correlation over all lags, and of that squared."""

    mean: float
    square: float

    @classmethod
    def of(cls, series: Array) -> Memory:
        """Of series (n, k) of k vectors over n times, all together, up to where they are first uncorrelated.

        NaN is left out. Nothing is remembered where nothing fluctuates.
        """
        n = len(series)
        size = scipy.fft.next_fast_len(2 * n)
        powers = np.zeros((2, size // 2 + 1))  # of what fluctuates, and of where it is known
        for a in series.T:  # one at a time: a film of 100,000 fields has long ones
            known = np.isfinite(a)
            powers += np.abs(np.fft.rfft([np.where(known, a - np.nanmean(a), 0.0), known * 1.0], size)) ** 2
        product, count = np.fft.irfft(powers, size)[:, :n]
        if not product[0] > 0.0:
            return cls(0.0, 0.0)
        rho = product / np.maximum(count, 0.5) * (count[0] / product[0])
        end = int(np.argmax(rho <= 0.0)) if (rho <= 0.0).any() else n
        weights = 2.0 * (1.0 - np.arange(1, end) / n)
        return cls(float(weights @ rho[1:end]), float(weights @ rho[1:end] ** 2))


def independent(n: Array, times: int, memory: float) -> Array:
    """How many independent values n are worth that were measured at random among so many times; memory: of `Memory`."""
    return np.asarray(n / (1.0 + memory * n / times))


def mean_half_width(worth: Array) -> Array:
    """Return the half width that holds 68 % of the errors of a mean, in scatters of its values (Student's t).

    worth: number of independent values, see `independent`.
    """
    return np.asarray(scipy.special.stdtrit(degrees_of_freedom(worth), scipy.special.ndtr(1.0)) / np.sqrt(worth))


def degrees_of_freedom(worth: Array) -> Array:
    """Return the degrees of freedom of a scatter about the mean of the same values; half of one at least."""
    return np.asarray(np.maximum(worth, 1.5) - 1.0)


class Steady(NamedTuple):
    """Of a flow, all (ny, nx); NaN where too little was measured.

    u, v: means; uu, vv, uv: Reynolds stresses over density, without the noise of the matching; each with its standard
    uncertainty. n: measured vectors.
    """

    u: Array
    v: Array
    u_sigma: Array
    v_sigma: Array
    uu: Array
    vv: Array
    uv: Array
    uu_sigma: Array
    vv_sigma: Array
    uv_sigma: Array
    n: Array


def steady(fields: Iterable[Velocities], u: Memory, v: Memory) -> Steady:
    """Mean and fluctuations of fields of equal shape; u, v: what the components remember. ValueError for no field.

    What one vector is uncertain by is taken from the squares: a velocity that never changes has no fluctuation. The
    uncertainty of a stress is that of Gaussian fluctuations. Sigmas hold 68 % of the errors, of few fields too.
    """
    times, n, first, sums = 0, np.zeros(0), [np.zeros(0)] * 2, np.zeros(0)
    for f in fields:
        if times == 0:
            first = [np.where(f.measured, a, 0.0) for a in f[:2]]  # near the mean: squares lose nothing to rounding
            n, sums = np.zeros(f.u.shape), np.zeros((7, *f.u.shape))
        a, b = (np.where(f.measured, x - x0, 0.0) for x, x0 in zip(f[:2], first))
        noise = [np.where(f.measured, s * s, 0.0) for s in (f.u_sigma, f.v_sigma)]
        sums += np.stack([a, b, a * a, b * b, a * b, *noise])
        n += f.measured
        times += 1
    if times == 0:
        raise ValueError("steady: no field")
    known = np.where(n >= 2, n, np.nan)  # a single measured vector has no fluctuation
    u_worth, v_worth, uu_worth, vv_worth, uv_worth = (
        independent(known, times, m) for m in (u.mean, v.mean, u.square, v.square, math.sqrt(u.square * v.square))
    )
    a, b, aa, bb, ab, u_noise, v_noise = sums / known
    both = np.sqrt(u_worth * v_worth)
    uu, vv, uv = (
        q * (1.0 + 1.0 / degrees_of_freedom(w))
        for q, w in ((aa - a * a, u_worth), (bb - b * b, v_worth), (ab - a * b, both))
    )
    return Steady(
        first[0] + a,
        first[1] + b,
        np.sqrt(uu) * mean_half_width(u_worth),
        np.sqrt(vv) * mean_half_width(v_worth),
        uu - u_noise,
        vv - v_noise,
        uv,
        uu * np.sqrt(2.0 / degrees_of_freedom(uu_worth)),
        vv * np.sqrt(2.0 / degrees_of_freedom(vv_worth)),
        np.sqrt((uu * vv + uv * uv) / degrees_of_freedom(uv_worth)),
        n,
    )
