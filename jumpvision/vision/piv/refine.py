"""Affine matching of image windows by Gauss-Newton, symmetric in the two frames, with its covariance.

A window centred at X is read from both spline-interpolated frames at half the displacement each,

    a(xi) = A(X + xi - D(xi) / 2),    b(xi) = B(X + xi + D(xi) / 2),    D = d + G xi + xi K xi / 2,

both brought to zero mean and unit variance, and the six numbers d, G minimise the weighted squares of r = a - b. The
curvature K is given: a window cannot measure it well, its neighbours can, and without it d is wrong by about half
the Laplacian times the square of the window's radius.
Reading both frames half-way puts the vector at mid-time and makes the noise of the gradient of (a + b) / 2
independent of r, so that noise does not bias d.

Uncertainty: to first order the error of the parameters is H^-1 sum w J r over the noise part of r. Its variance is
taken from the residuals themselves, with the correlation between neighbouring ones (as the correlation statistics of
Wieneke 2015, doi:10.1088/0957-0233/26/7/074002, do for a pure shift), so it holds the noise of both frames, the
smoothing by the interpolation and any mismatch that changes within LAG pixels. H comes from the products
grad a grad b: the noise of the two frames does not inflate it.
"""

from __future__ import annotations

from typing import NamedTuple

import numba as nb
import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy import ndimage

from jumpvision.vision.piv.window import RIM, covariance, normal_equations, sample, solve, standardise

Array = NDArray[np.float64]
Float32 = NDArray[np.float32]

SMOOTH = 0.8  # px, standard deviation of the Gaussian both frames are smoothed with, against aliasing
ITERATIONS = 12
TAPER = 0.45  # Gaussian weight: standard deviation over half the window
GUARD = 2  # px next to a masked pixel that the gradient stencil and the spline reach

CONVERGED, LOST, FLAT, COVERED = range(4)


class Frame(NamedTuple):
    """A frame ready for matching."""

    c: Float32  # cubic B-spline coefficients on a grid of half pixels: pixel q lies at index 2 q + 1 / 2
    weight: Float32  # 0 or 1 for each pixel
    pad: int  # px of border around the image, in both arrays


def prepare(image: Array, usable: NDArray[np.bool_], pad: int) -> Frame:
    """Spline of an image (H, W) [grey], smoothed by SMOOTH, and weights that stay GUARD px away from unusable pixels.

    The image is carried to half pixels by its cosine series: a cubic spline between those follows grains of 3 px to
    0.002 px, on the pixels themselves only to 0.02 px.
    """
    whole = [scipy.fft.next_fast_len(n + 2 * pad, real=True) for n in image.shape]
    border = [(pad, m - n - pad) for n, m in zip(image.shape, whole)]
    series = scipy.fft.dctn(np.pad(image, border, mode="symmetric").astype(np.float32), workers=-1)
    for axis, m in enumerate(whole):
        k = np.pi * np.arange(m) / m  # [rad/px]; the spline on half pixels has the samples (4 + 2 cos(k / 2)) / 6
        gain = 2 * np.exp(-0.5 * (SMOOTH * k) ** 2) * 6 / (4 + 2 * np.cos(k / 2))
        series *= gain.astype(np.float32).reshape((-1, 1) if axis == 0 else (1, -1))
    c = np.ascontiguousarray(scipy.fft.idctn(np.pad(series, [(0, m) for m in whole]), workers=-1))
    keep = usable if usable.all() else ndimage.binary_erosion(usable, iterations=GUARD, border_value=1)
    return Frame(c, np.ascontiguousarray(np.pad(keep, border), np.float32), pad)


def taper(window: int) -> Float32:
    """Weight over the window, shape (2 h + 1, 2 h + 1), h = window // 2."""
    h = window // 2
    g = np.exp(-0.5 * (np.arange(-h, h + 1) / (TAPER * (h + 0.5))) ** 2)
    return np.outer(g, g).astype(np.float32)


def refine(
    a: Frame, b: Frame, x: Array, y: Array, seed: Array, weight: Float32, texture: float, tolerance: float, errors: bool
) -> tuple[Array, Array, Array, NDArray[np.int64]]:
    """Match windows at (x, y) (n,) [px], starting from seed (n, 12), until a step changes no place by `tolerance` [px].

    seed: d_x, d_y [px], u_x, u_y, v_x, v_y [1], and the given curvature u_xx, u_xy, u_yy, v_xx, v_xy, v_yy [1/px].
    Returns parameters (n, 12), standard uncertainties of the first six (n, 6; NaN without `errors`), correlation (n,)
    and state (n,): CONVERGED, LOST, FLAT = standard deviation in the window below `texture` [grey], COVERED = less
    than half the weight is usable.
    """
    n = len(x)
    p, sigma, quality = seed.astype(np.float64), np.full((n, 6), np.nan), np.full(n, np.nan)
    state = np.empty(n, np.int64)
    places = x + a.pad, y + a.pad
    _refine(a.c, a.weight, b.c, b.weight, *places, weight, texture, tolerance, errors, p, sigma, quality, state)
    return p, sigma, quality, state


@nb.njit(cache=True, parallel=True, fastmath=True)
def _refine(ca, wa, cb, wb, x, y, weight, texture, tolerance, errors, p, sigma, quality, state):  # type: ignore[no-untyped-def]
    n = weight.shape[0]
    m = n + 2 * RIM
    full = weight.sum()
    for k in nb.prange(len(x)):
        a = np.empty((m, m), np.float32)
        b = np.empty((m, m), np.float32)
        w = np.empty((m, m), np.float32)
        jac = np.empty((m, m, 6), np.float32)
        hess, clean = np.empty((6, 6)), np.empty((6, 6))
        rhs = np.empty(6)
        step = np.empty((6, 1))
        seed_x, seed_y = p[k, 0], p[k, 1]
        state[k] = LOST
        for _ in range(ITERATIONS):
            sample(ca, wa, x[k], y[k], p[k], -0.5, a, w, True)
            sample(cb, wb, x[k], y[k], p[k], 0.5, b, w, False)
            usable = 0.0
            for j in range(n):
                for i in range(n):
                    w[j + RIM, i + RIM] *= weight[j, i]
                    usable += w[j + RIM, i + RIM]
            if usable < 0.5 * full:
                state[k] = COVERED
                break
            if min(standardise(a, w), standardise(b, w)) < texture:
                state[k] = FLAT
                break
            for j in range(m):
                for i in range(m):
                    f, g = a[j, i], b[j, i]
                    a[j, i] = np.float32(0.5) * (f + g)
                    b[j, i] = f - g
            total = normal_equations(a, b, w, jac, hess, clean, rhs)
            step[:, 0] = rhs
            if not solve(hess, step):
                state[k] = FLAT
                break
            for q in range(6):
                p[k, q] += step[q, 0]
            if abs(p[k, 0] - seed_x) > 0.25 * n or abs(p[k, 1] - seed_y) > 0.25 * n:
                break
            edge = 0.25 * n
            worst = max(
                abs(step[0, 0]) + edge * (abs(step[2, 0]) + abs(step[3, 0])),
                abs(step[1, 0]) + edge * (abs(step[4, 0]) + abs(step[5, 0])),
            )
            if worst < tolerance:
                square = 0.0
                for j in range(RIM, m - RIM):
                    for i in range(RIM, m - RIM):
                        square += w[j, i] * b[j, i] ** 2
                quality[k] = 1.0 - 0.5 * square / total
                inverse = np.eye(6)
                if not solve(clean, inverse):  # so noisy that the texture cannot be told from it
                    break
                if errors:
                    covariance(jac, b, w, inverse, sigma[k])
                state[k] = CONVERGED
                break
