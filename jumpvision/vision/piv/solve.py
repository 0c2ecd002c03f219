"""From the sums over a window to its Gauss-Newton step and the covariance of the displacement and its gradient."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from jumpvision.vision.piv.moments import (
    FIRST,
    GX,
    GXM,
    GXR,
    GXX,
    GXY,
    GY,
    GYM,
    GYR,
    GYY,
    MM,
    MR,
    ONE,
    RR,
    SXX,
    SXY,
    SYY,
    M,
    R,
)

N = 8  # unknowns: d_x, u_x, u_y, d_y, v_x, v_y, offset and gain of the grey
STEPPED, FLAT, COVERED, LOST = range(4)
# order of the sums of a product of two factors 1, xi, eta
PAIR = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])


@nb.njit(cache=True)
def _factor(a, low):  # type: ignore[no-untyped-def]
    """Cholesky factor of a (n, n); False if it is not positive definite."""
    n = len(a)
    for i in range(n):
        for j in range(i + 1):
            s = a[i, j]
            for k in range(j):
                s -= low[i, k] * low[j, k]
            if i == j:
                if s <= 1e-7 * a[i, i]:
                    return False
                low[i, i] = math.sqrt(s)
            else:
                low[i, j] = s / low[j, j]
    return True


@nb.njit(cache=True)
def _solve(low, b):  # type: ignore[no-untyped-def]
    """Solution of low low^T x = b, in place."""
    n = len(b)
    for i in range(n):
        for k in range(i):
            b[i] -= low[i, k] * b[k]
        b[i] /= low[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            b[i] -= low[k, i] * b[k]
        b[i] /= low[i, i]


@nb.njit(cache=True)
def _block(h, sums, first, c, d, sign):  # type: ignore[no-untyped-def]
    """Add sign * sum of a product of two gradients to the block (c, d) of the normal matrix."""
    for i in range(3):
        for j in range(3):
            value = sign * sums[first + PAIR[i, j]]
            h[3 * c + i, 3 * d + j] += value
            if c != d:
                h[3 * d + j, 3 * c + i] += value


@nb.njit(cache=True, parallel=True)
def steps(sums, full, texture, step, quality, state):  # type: ignore[no-untyped-def]
    """Least-squares step (n, 8) of every window from its sums (n, FIRST[-1] or fewer), correlation (n,) and state.

    full: sum of the weight of a whole window; texture: [grey] least standard deviation.
    """
    for k in nb.prange(len(sums)):
        s = sums[k]
        step[k] = 0.0
        quality[k] = np.nan
        one = s[FIRST[ONE]]
        if one < 0.5 * full:
            state[k] = COVERED
            continue
        mean, offset = s[FIRST[M]] / one, s[FIRST[R]] / one
        mm = s[FIRST[MM]] / one - mean * mean
        mr = s[FIRST[MR]] / one - mean * offset
        rr = s[FIRST[RR]] / one - offset * offset
        if min(mm + mr + 0.25 * rr, mm - mr + 0.25 * rr) < texture * texture:
            state[k] = FLAT
            continue
        h, low, b = np.zeros((N, N)), np.zeros((N, N)), step[k]
        normal(s, h)
        for i in range(3):
            b[i], b[3 + i] = s[FIRST[GXR] + i], s[FIRST[GYR] + i]
        b[6], b[7] = s[FIRST[R]], s[FIRST[MR]]
        if not _factor(h, low):
            state[k] = FLAT
            continue
        q = b.copy()
        _solve(low, b)
        left = s[FIRST[RR]]
        for i in range(N):
            left -= q[i] * b[i]
        left = max(left, 0.0) / one
        quality[k] = (mm - 0.25 * left) / (mm + 0.25 * left)
        state[k] = STEPPED


@nb.njit(cache=True)
def normal(s, h):  # type: ignore[no-untyped-def]
    """Normal matrix of the eight unknowns."""
    _block(h, s, FIRST[GXX], 0, 0, 1.0)
    _block(h, s, FIRST[GXY], 0, 1, 1.0)
    _block(h, s, FIRST[GYY], 1, 1, 1.0)
    for i in range(3):
        h[i, 6] = h[6, i] = s[FIRST[GX] + i]
        h[3 + i, 6] = h[6, 3 + i] = s[FIRST[GY] + i]
        h[i, 7] = h[7, i] = s[FIRST[GXM] + i]
        h[3 + i, 7] = h[7, 3 + i] = s[FIRST[GYM] + i]
    h[6, 6], h[7, 7] = s[FIRST[ONE]], s[FIRST[MM]]
    h[6, 7] = h[7, 6] = s[FIRST[M]]


@nb.njit(cache=True, parallel=True)
def covariances(sums, scatter, sigma):  # type: ignore[no-untyped-def]
    """Standard uncertainties (n, 6) d_x, u_x, u_y, d_y, v_x, v_y: H^-1 Z H^-1, Z the covariance of sum w J r.

    scatter: (n, 18) sums of z_x z_x, z_x z_y, z_y z_y up to second order. H is made of the products of the gradients of
    the two frames, which the noise does not inflate: grad a grad b = grad m grad m - grad r grad r / 4. NaN where the
    noise hides the texture.
    """
    for k in nb.prange(len(sums)):
        h, low = np.zeros((N, N)), np.zeros((N, N))
        normal(sums[k], h)
        _block(h, sums[k], FIRST[SXX], 0, 0, -0.25)
        _block(h, sums[k], FIRST[SXY], 0, 1, -0.25)
        _block(h, sums[k], FIRST[SYY], 1, 1, -0.25)
        sigma[k] = np.nan
        if not _factor(h, low):
            continue
        z = np.zeros((6, 6))
        _block(z, scatter[k], 0, 0, 0, 1.0)
        _block(z, scatter[k], 6, 0, 1, 1.0)
        _block(z, scatter[k], 12, 1, 1, 1.0)
        t = np.empty(N)
        for i in range(6):
            t[:] = 0.0
            t[i] = 1.0
            _solve(low, t)
            var = 0.0
            for p in range(6):
                for q in range(6):
                    var += t[p] * z[p, q] * t[q]
            sigma[k, i] = math.sqrt(var) if var > 0.0 else np.nan
