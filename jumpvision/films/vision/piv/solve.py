"""From the sums over a window to its Gauss-Newton step and the covariance of the displacement and its gradient."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from jumpvision.base.threads import shared

from .moments import FIRST, GX, GXM, GXR, GXX, GY, GYM, GYR, MM, MR, ONE, RR, M, R

N = 8  # unknowns: d_x, u_x, u_y, d_y, v_x, v_y, offset and gain of the grey
STEPPED, FLAT, COVERED = range(3)
# order of the sums of a product of two factors 1, xi, eta
PAIR = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


@nb.njit(cache=True)
def _factor(a, low):  # type: ignore[no-untyped-def]
    """Cholesky factor of a (N, N), the inverse of its elements on the diagonal; False if a is not positive definite."""
    for i in range(N):
        for j in range(i + 1):
            s = a[i, j]
            for k in range(j):
                s -= low[i, k] * low[j, k]
            if i == j:
                if s <= 1e-7 * a[i, i]:
                    return False
                low[i, i] = 1.0 / math.sqrt(s)
            else:
                low[i, j] = s * low[j, j]
    return True


@nb.njit(cache=True)
def _solve(low, b):  # type: ignore[no-untyped-def]
    """Solution of a x = b, in place, from the factor of a."""
    for i in range(N):
        for k in range(i):
            b[i] -= low[i, k] * b[k]
        b[i] *= low[i, i]
    for i in range(N - 1, -1, -1):
        for k in range(i + 1, N):
            b[i] -= low[k, i] * b[k]
        b[i] *= low[i, i]


@nb.njit(cache=True)
def _inverse(low, root, inverse):  # type: ignore[no-untyped-def]
    """First six rows and columns of the inverse of a from its factor; root (N, N) becomes the inverse of the factor."""
    for i in range(N):
        for j in range(i + 1):
            s = 1.0 if i == j else 0.0
            for k in range(j, i):
                s -= low[i, k] * root[k, j]
            root[i, j] = s * low[i, i]
    for i in range(6):
        for j in range(i + 1):
            s = 0.0
            for k in range(i, N):
                s += root[k, i] * root[k, j]
            inverse[i, j] = inverse[j, i] = s


@nb.njit(cache=True)
def _blocks(h, sums, sign):  # type: ignore[no-untyped-def]
    """Add sign * the sums (18,) of x x, x y and y y of two gradients to their blocks of the normal matrix."""
    for block in range(3):
        c, d, first = block // 2, (block + 1) // 2, 6 * block
        for i in range(3):
            for j in range(3):
                value = sign * sums[first + PAIR[i, j]]
                h[3 * c + i, 3 * d + j] += value
                if c != d:
                    h[3 * d + j, 3 * c + i] += value


@shared()
def steps(first, last, sums, full, texture, step, quality, rest, state):  # type: ignore[no-untyped-def]
    """Least-squares step (n, 8) of every window from its sums (n, FIRST[-1]), correlation (n,), rest and state.

    rest: [grey^2] variance of what the step leaves of the difference of the frames.

    full: sum of the weight of a whole window; texture: [grey] least standard deviation.
    """
    h, low, q = np.zeros((N, N)), np.zeros((N, N)), np.empty(N)
    for k in range(first, last):
        state[k], quality[k], rest[k] = _step(sums[k], full, texture, h, low, q, step[k])


@nb.njit(cache=True)
def _step(s, full, texture, h, low, q, b):  # type: ignore[no-untyped-def]
    """State, correlation, rest and step b of one window; h, low and q are room to work in."""
    b[:] = 0.0
    one = s[FIRST[ONE]]
    if one < 0.5 * full:
        return COVERED, np.nan, np.nan
    mean, offset = s[FIRST[M]] / one, s[FIRST[R]] / one
    mm = s[FIRST[MM]] / one - mean * mean
    mr = s[FIRST[MR]] / one - mean * offset
    rr = s[FIRST[RR]] / one - offset * offset
    if min(mm + mr + 0.25 * rr, mm - mr + 0.25 * rr) < texture * texture:
        return FLAT, np.nan, np.nan
    h[:] = 0.0
    normal(s, h)
    for i in range(3):
        b[i], b[3 + i] = s[FIRST[GXR] + i], s[FIRST[GYR] + i]
    b[6], b[7] = s[FIRST[R]], s[FIRST[MR]]
    if not _factor(h, low):
        return FLAT, np.nan, np.nan
    for i in range(N):
        q[i] = b[i]
    _solve(low, b)
    left = s[FIRST[RR]]
    for i in range(N):
        left -= q[i] * b[i]
    left = max(left, 0.0) / one
    return STEPPED, (mm - 0.25 * left) / (mm + 0.25 * left), left


@nb.njit(cache=True)
def normal(s, h):  # type: ignore[no-untyped-def]
    """Normal matrix of the eight unknowns."""
    _blocks(h, s[FIRST[GXX] :], 1.0)
    for i in range(3):
        h[i, 6] = h[6, i] = s[FIRST[GX] + i]
        h[3 + i, 6] = h[6, 3 + i] = s[FIRST[GY] + i]
        h[i, 7] = h[7, i] = s[FIRST[GXM] + i]
        h[3 + i, 7] = h[7, 3 + i] = s[FIRST[GYM] + i]
    h[6, 6], h[7, 7] = s[FIRST[ONE]], s[FIRST[MM]]
    h[6, 7] = h[7, 6] = s[FIRST[M]]


@shared()
def covariances(first, last, sums, noise, scatter, certain, least, sigma):  # type: ignore[no-untyped-def]
    """Standard uncertainties (n, 6) d_x, u_x, u_y, d_y, v_x, v_y: H^-1 Z H^-1, Z the covariance of sum w J r.

    scatter, noise: (n, 18) sums of z_x z_x, z_x z_y, z_y z_y, and of the same of grad r, up to second order. H is made
    of the products of the gradients of the two frames, which the noise does not inflate: grad a grad b =
    grad m grad m - grad r grad r / 4. Z is at least `least` H. Where the noise hides the texture: NaN, or, of `certain`
    matches (n,), whose residuals are of the flow, as the mean of both frames has it.
    """
    h, low, root = np.empty((N, N)), np.zeros((N, N)), np.zeros((N, N))
    t, z = np.empty((6, 6)), np.empty((6, 6))
    for k in range(first, last):
        h[:] = 0.0
        normal(sums[k], h)
        _blocks(h, noise[k], -0.25)
        if not _factor(h, low):
            if not certain[k]:
                sigma[k] = np.nan
                continue
            h[:] = 0.0
            normal(sums[k], h)
            _factor(h, low)
        _inverse(low, root, t)
        z[:] = 0.0
        _blocks(z, scatter[k], 1.0)
        for i in range(6):
            var = 0.0
            for p in range(6):
                zt = 0.0
                for q in range(6):
                    zt += z[p, q] * t[i, q]
                var += t[i, p] * zt
            var = max(var, least * t[i, i])
            sigma[k, i] = math.sqrt(var) if var > 0.0 else np.nan
