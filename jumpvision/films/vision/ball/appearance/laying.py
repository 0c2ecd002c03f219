"""Compiled: pictures laid in a frame, with their slopes, and what a layer's fit and the joint fit sum from them.

Cubic convolution (Keys 1981): every pixel takes 4 x 4 points of the picture.
"""

from __future__ import annotations

import math

import numpy as np
from numba import njit

from jumpvision.films.vision.ball.disc import invert

FREE = 0.1  # of the contrast, by which light and contrast may change from frame to frame
OUTLIER = 3.0  # standard deviations, from which a pixel counts less
STEPS = 15  # of a fit at most
REST = 1e-3  # px: the last step
FINE = 3  # points of a picture to a pixel


@njit(cache=True, inline="always")
def _keys(t, w):  # type: ignore[no-untyped-def]
    """Weights of the points about a place t in 0..1 after the second."""
    w[0] = ((-0.5 * t + 1.0) * t - 0.5) * t
    w[1] = (1.5 * t - 2.5) * t * t + 1.0
    w[2] = ((-1.5 * t + 2.0) * t + 0.5) * t
    w[3] = (0.5 * t - 0.5) * t * t


@njit(cache=True, inline="always")
def _slopes(t, w):  # type: ignore[no-untyped-def]
    """Their derivatives by t."""
    w[0] = (-1.5 * t + 2.0) * t - 0.5
    w[1] = (4.5 * t - 5.0) * t
    w[2] = (-4.5 * t + 4.0) * t + 0.5
    w[3] = (1.5 * t - 1.0) * t


@njit(cache=True, nogil=True, error_model="numpy")
def fit_layer(image, scene, alpha, shown, start, d, height):  # type: ignore[no-untyped-def]
    """Gauss-Newton of a layer (alpha, shown: (k, k), as wide as d) before a scene, from start (x, y, turn, light,
    contrast). Gives the five, their normal equations, what the squares sum to over the noise's degrees of freedom, the
    ball's unlikeness and whether it stayed within half a diameter. height: of the face [grey]."""
    k = alpha.shape[0]
    half = (k - 1) // 2
    rows, columns = image.shape
    p, begin = start.copy(), start.copy()
    m = 0.5 * (k - 1)
    u0, v0 = math.floor(p[0] + 0.5) - half, math.floor(p[1] + 0.5) - half
    most = k * k
    j, left, change, share = np.empty((most, 5)), np.empty(most), np.empty(most), np.empty(most)
    wu, wv, su, sv = np.empty(4), np.empty(4), np.empty(4), np.empty(4)
    normal, right, inverse, step = np.zeros((5, 5)), np.zeros(5), np.zeros((5, 5)), np.zeros(5)
    mean_square = 0.0
    n = 0
    for _ in range(STEPS):
        c, s = math.cos(p[2]), math.sin(p[2])
        n = 0
        for row in range(max(0, v0), min(rows, v0 + k)):
            for column in range(max(0, u0), min(columns, u0 + k)):
                du, dv = column - p[0], row - p[1]
                if du * du + dv * dv >= (0.5 * d + 3.0) ** 2:
                    continue
                lu, lv = c * du + s * dv + m, c * dv - s * du + m
                a = b = a_u = a_v = b_u = b_v = 0.0
                iu, iv = math.floor(lu), math.floor(lv)
                if -2 <= iu <= k and -2 <= iv <= k:
                    _keys(lu - iu, wu)
                    _keys(lv - iv, wv)
                    _slopes(lu - iu, su)
                    _slopes(lv - iv, sv)
                    for q in range(4):
                        y = iv + q - 1
                        if not 0 <= y < k:
                            continue
                        for r in range(4):
                            x = iu + r - 1
                            if not 0 <= x < k:
                                continue
                            f, g = alpha[y, x], shown[y, x]
                            a += wv[q] * wu[r] * f
                            b += wv[q] * wu[r] * g
                            a_u += wv[q] * su[r] * f
                            b_u += wv[q] * su[r] * g
                            a_v += sv[q] * wu[r] * f
                            b_v += sv[q] * wu[r] * g
                behind = scene[row, column]
                bright = p[3] - behind
                by_u, by_v = bright * a_u + p[4] * b_u, bright * a_v + p[4] * b_v
                j[n, 0] = -(c * by_u - s * by_v)
                j[n, 1] = -(s * by_u + c * by_v)
                j[n, 2] = by_u * (lv - m) - by_v * (lu - m)
                j[n, 3], j[n, 4] = a, b
                change[n] = image[row, column] - behind
                left[n] = change[n] - bright * a - p[4] * b
                share[n] = a
                n += 1
        if n < 8:
            return p, normal, mean_square, 1.0, False
        # noise is at least 0.002 of the height, up to what digitising leaves
        noise = max(1.4826 * np.median(np.abs(left[:n])), min(0.3, 0.002 * height))
        normal[:] = 0.0
        right[:] = 0.0
        squares = counts = 0.0
        for i in range(n):
            w = min(1.0, OUTLIER * noise / max(abs(left[i]), 1e-9))
            squares += w * left[i] ** 2
            counts += w
            for a in range(5):
                right[a] += w * j[i, a] * left[i]
                for b in range(a + 1):
                    normal[a, b] += w * j[i, a] * j[i, b]
        mean_square = squares / max(counts - 5.0, 1.0)
        for a in range(5):
            for b in range(a):
                normal[b, a] = normal[a, b]
            normal[a, a] += 1e-9
        light, contrast = noise**2 / (FREE * height) ** 2, noise**2 / FREE**2
        normal[3, 3] += light
        normal[4, 4] += contrast
        right[3] -= light * p[3]
        right[4] -= contrast * (p[4] - 1.0)
        step[:] = 0.0
        if invert(normal, 5, inverse):
            for a in range(5):
                for b in range(5):
                    step[a] += inverse[a, b] * right[b]
        size = math.hypot(step[0], step[1])
        short = min(1.0, 0.15 * d / max(size, 1e-9), 0.3 / max(abs(step[2]), 1e-9))
        for a in range(5):
            p[a] += short * step[a]
        if not math.hypot(p[0] - begin[0], p[1] - begin[1]) < 0.5 * d:
            return p, normal, mean_square, 1.0, False
        if size < REST:
            break
    misfit = power = 0.0
    for i in range(n):
        if share[i] > 0.5:
            misfit += left[i] ** 2
            power += change[i] ** 2
    return p, normal, mean_square, misfit / max(power, 1e-9), True


@njit(cache=True, nogil=True, error_model="numpy")
def lay(u, v, place, exposure, velocity, pictures, waves, out, of_waves):  # type: ignore[no-untyped-def]
    """Pictures in a frame at pixels (u, v): out (pixels, m + 4) takes the values of pictures (k k, m), and of their
    columns 2 to 5 the moments along the streak; of_waves (pixels, w) those of waves (k k, w). place: x, y, turn."""
    side = int(math.sqrt(pictures.shape[0]) + 0.5)
    many, w = pictures.shape[1], waves.shape[1]
    way = exposure * math.hypot(velocity[0], velocity[1])
    pieces = 1 + math.ceil(2.0 * way)  # two pieces of a streak to a pixel
    c, s = math.cos(place[2]), math.sin(place[2])
    wu, wv = np.empty(4), np.empty(4)
    out[:] = 0.0
    of_waves[:] = 0.0
    for i in range(u.size):
        for k in range(pieces):
            part = (k + 0.5) / pieces - 0.5
            du = u[i] - place[0] - part * exposure * velocity[0]
            dv = v[i] - place[1] - part * exposure * velocity[1]
            x = FINE * (c * du + s * dv) + 0.5 * (side - 1)
            y = FINE * (c * dv - s * du) + 0.5 * (side - 1)
            ix = min(max(math.floor(x), 1), side - 3)
            iy = min(max(math.floor(y), 1), side - 3)
            _keys(min(max(x - ix, 0.0), 1.0), wu)
            _keys(min(max(y - iy, 0.0), 1.0), wv)
            for q in range(4):
                for r in range(4):
                    weight = wv[q] * wu[r] / pieces
                    at = (iy + q - 1) * side + ix + r - 1
                    for a in range(many):
                        out[i, a] += weight * pictures[at, a]
                    for a in range(4):
                        out[i, many + a] += weight * part * pictures[at, 2 + a]
                    if w:
                        thin = np.float32(weight)
                        for a in range(w):
                            of_waves[i, a] += thin * waves[at, a]
