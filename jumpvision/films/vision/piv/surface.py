"""A smooth displacement of every pixel through the vectors of a grid."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import cv2
import numba as nb
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array, Float32
from jumpvision.base.threads import shared
from jumpvision.films.calibration import JUMP_CALM, JUMP_OF_FIELD, STEP_OF_FIELD


class Axis(NamedTuple):
    """Along one axis of the picture; the matrices act on the vectors' values and their two bends, see `with_bends`."""

    coefficients: Array  # (knots, vectors + 2) of the cubic B-spline through the vectors
    smooth: Array  # (vectors, vectors + 2) the smoothed values, see `smoother`
    slope: Array  # (vectors, vectors + 2) d/dpx of the spline at the vectors
    knot: NDArray[np.int64]  # (pixels,) first of the four knots that a pixel hears
    weight: Float32  # (pixels, 4) their weights
    before: int  # knots before that of the first vector
    reach: int  # vectors, see `with_bends`

    def pixels(self, first: int, end: int) -> Axis:
        """The same for some of the pixels."""
        return self._replace(knot=self.knot[first:end], weight=self.weight[first:end])


@functools.lru_cache(maxsize=32)
def smoother(vectors: int, stiffness: float, order: int = 2) -> Array:
    """Matrix (vectors, vectors) to the s of least sum (d - s)^2 + stiffness * sum (difference of s of that order)^2.

    Whittaker 1923: it leaves polynomials of a degree below the order alone and damps a wave of theta rad a vector by
    1 / (1 + stiffness (2 - 2 cos theta)^order).
    """
    difference = np.diff(np.eye(vectors), order, axis=0) if vectors > order else np.zeros((1, vectors))
    return np.linalg.inv(np.eye(vectors) + stiffness * difference.T @ difference).astype(np.float64)


@functools.lru_cache(maxsize=16)
def axis(pixels: int, first: float, step: int, vectors: int, stiffness: float, window: int) -> Axis:
    """Cubic spline through vectors at first + step * k [px], beyond the outer ones a parabola by their slope and
    bend."""
    before = math.ceil(first / step) + 2
    after = math.ceil((pixels - 1 - first) / step) - (vectors - 1) + 2
    k = np.arange(-before, vectors + after)
    beyond = np.maximum(-k, 0), np.maximum(k - vectors + 1, 0)
    straight = np.eye(vectors)[np.clip(k, 0, vectors - 1)]
    if vectors > 1:
        rise = np.eye(vectors)[[1, -1]] - np.eye(vectors)[[0, -2]]
        straight -= beyond[0][:, None] * rise[0] - beyond[1][:, None] * rise[1]
    n = len(k)
    samples = (np.eye(n, k=-1) + 4 * np.eye(n) + np.eye(n, k=1)) / 6
    samples[0, :3] = samples[-1, -3:] = 1, -2, 1  # the bend at both ends of the knots
    values = np.column_stack([straight, *(0.5 * q * (q + 1) for q in beyond)])
    values[[0, -1]] = np.eye(vectors + 2)[vectors:]
    exact = np.linalg.solve(samples, values).astype(np.float64)
    exact[np.abs(exact) < 1e-13] = 0  # what the spline has of a vector beyond some twenty others
    slope = (exact[before + 1 : before + vectors + 1] - exact[before - 1 : before + vectors - 1]) / (2 * step)
    q = (np.arange(pixels) - first) / step + before
    knot = np.floor(q).astype(np.int64)
    t = q - knot
    weight = np.stack([(1 - t) ** 3, 3 * t**3 - 6 * t**2 + 4, 1 + 3 * t + 3 * t**2 - 3 * t**3, t**3], axis=1) / 6
    reach = max(1, round(window / step))
    return Axis(exact, _smooth(vectors, stiffness), slope, knot - 1, weight.astype(np.float32), before, reach)


def _smooth(vectors: int, stiffness: float) -> Array:
    """`smoother` with what it takes from parabolas of bend 1 at either end given back."""
    s = smoother(vectors, stiffness)
    k = np.arange(vectors)
    taken = 0.5 * k**2 - s @ (0.5 * k**2)
    near = np.clip((vectors - 1) / 2 - k + 0.5, 0, 1)  # each end answers for its half
    return np.column_stack([s, near * taken, (near * taken)[::-1]])


def with_bends(f: Array, reach: int) -> Array:
    """Fields (n, ny, nx) with two rows more: their second difference a vector at the first row and at the last.

    By vectors `reach` apart and by half of that: the lesser, none where they differ in sign, so a step near the border
    bends nothing.
    """
    far = min(reach, (f.shape[1] - 1) // 2)
    if far < 1:
        return np.concatenate([f, np.zeros((len(f), 2, f.shape[2]))], axis=1)
    p, q = ((f[:, [0, -1]] - 2 * f[:, [n, -1 - n]] + f[:, [2 * n, -1 - 2 * n]]) / n**2 for n in (far, max(1, far // 2)))
    bends = np.where(p * q > 0, np.copysign(np.minimum(np.abs(p), np.abs(q)), p), 0)
    return np.concatenate([f, bends], axis=1)


def of_columns(matrix: Array, of: Axis, f: Array) -> Array:
    """One of the axis' matrices along y of fields (n, ny, nx)."""
    return along_y(matrix, with_bends(f, of.reach))


def of_rows(matrix: Array, of: Axis, f: Array) -> Array:
    """The same along x."""
    return np.ascontiguousarray(of_columns(matrix, of, f.swapaxes(1, 2)).swapaxes(1, 2))


def lightly_smoothed(
    rows: Axis, columns: Axis, f: Array, matched: NDArray[np.bool_] | None
) -> tuple[Array, NDArray[np.float64] | None]:
    """Fields (n, ny, nx) smoothed where they differ from the smooth surface by no more than chance, kept where by more.

    What chance is, the field itself tells: the median of the squared differences. A smoothed step would ring over
    three vectors on either side. Where not `matched` (ny, nx), and everywhere if it is None, the surface counts.
    Also where the field jumps, see `knots`: (ny, nx) from 0 to 1, or None: nowhere.
    """
    surface = of_rows(columns.smooth, columns, of_columns(rows.smooth, rows, f))
    if matched is None:
        return surface, None
    e = f - surface
    squared = (e**2).sum(0)
    # over 3 x 3 vectors
    power = cv2.boxFilter(squared, -1, (3, 3), borderType=cv2.BORDER_REFLECT)
    # squares of two normal components are exponential
    # differences below 0.02 px are no step
    shares = (0.5, JUMP_CALM.value)
    chance, calm = (
        max(-STEP_OF_FIELD.value * float(x) / math.log(1 - q), 0.02**2)
        for q, x in zip(shares, np.quantile(squared, shares))
    )
    kept = np.where(matched, np.clip(1 - chance / np.maximum(power, 1e-30), 0, 1), 0)
    jumps = np.where(matched, np.clip(power / (JUMP_OF_FIELD.value * calm) - 1, 0, 1), 0)
    jump = np.asarray(cv2.dilate(jumps, np.ones((3, 3))), np.float64)
    return surface + kept * e, jump if jump.any() else None


def knots(rows: Axis, columns: Axis, f: Array, jump: NDArray[np.float64] | None) -> Array:
    """Coefficients of the spline through the vectors f (n, ny, nx); where they jump the vectors themselves.

    The spline through a step rings by a tenth of it beside it, and the windows there would have to answer for that;
    with the vectors as coefficients it runs between them.
    """
    c = of_rows(columns.coefficients, columns, of_columns(rows.coefficients, rows, f))
    if jump is None:
        return c
    border = [(q.before, n - m - q.before) for q, n, m in zip((rows, columns), c.shape[1:], f.shape[1:])]
    return np.asarray(c + np.pad(jump, border) * (np.pad(f, [(0, 0), *border], mode="edge") - c))


def at_vectors(rows: Axis, columns: Axis, f: Array, jump: NDArray[np.float64] | None) -> Array:
    """The spline of `knots` at the vectors."""
    if jump is None:
        return f
    c = knots(rows, columns, f, jump)
    c = (c[:, :-2] + 4 * c[:, 1:-1] + c[:, 2:]) / 6
    c = (c[:, :, :-2] + 4 * c[:, :, 1:-1] + c[:, :, 2:]) / 6
    top, left = rows.before - 1, columns.before - 1
    return c[:, top : top + f.shape[1], left : left + f.shape[2]]


def along_both(rows: Array, columns: Array, f: Array) -> Array:
    """rows f columns^T of fields (n, ny, nx)."""
    return along_x(columns, along_y(rows, f))


def along_y(a: Array, f: Array) -> Array:
    """a f of fields (n, ny, nx), all at once."""
    out = _product(a, np.concatenate(f, axis=1))
    return out.reshape(len(a), len(f), -1).swapaxes(0, 1)


def along_x(a: Array, f: Array) -> Array:
    """f a^T of fields (n, ny, nx), all at once."""
    return np.ascontiguousarray(along_y(a, f.swapaxes(1, 2)).swapaxes(1, 2))


def _product(a: Array, b: Array) -> Array:
    """a b. Not numpy's product, whose threads take longer to meet than such small matrices to multiply."""
    out = np.zeros((len(a), b.shape[1]))
    _times(len(a), np.ascontiguousarray(a), np.ascontiguousarray(b, np.float64), out)
    return out


BLOCK = 8  # rows of b that are added at a time


@shared(fastmath={"contract"})
def _times(first, last, a, b, out):  # type: ignore[no-untyped-def]
    """Two thirds of a spline's matrix are exactly zero, and left out."""
    whole = len(b) // BLOCK * BLOCK
    for k in range(0, whole, BLOCK):
        for j in range(first, last):
            f = a[j, k : k + BLOCK]
            if _magnitude(f) > 0:
                _add_block(out[j], f, b[k : k + BLOCK])
    for k in range(whole, len(b)):
        for j in range(first, last):
            row, f, of = out[j], a[j, k], b[k]
            for i in range(len(row)):
                row[i] += f * of[i]


@nb.njit(cache=True)
def _magnitude(f):  # type: ignore[no-untyped-def]
    total = 0.0
    for q in f:
        total += abs(q)
    return total


@nb.njit(cache=True, fastmath={"contract"})
def _add_block(row, f, of):  # type: ignore[no-untyped-def]
    f0, f1, f2, f3, f4, f5, f6, f7 = f[0], f[1], f[2], f[3], f[4], f[5], f[6], f[7]
    b0, b1, b2, b3, b4, b5, b6, b7 = of[0], of[1], of[2], of[3], of[4], of[5], of[6], of[7]
    for i in range(len(row)):
        near = (((row[i] + f0 * b0[i]) + f1 * b1[i]) + f2 * b2[i]) + f3 * b3[i]
        row[i] = (((near + f4 * b4[i]) + f5 * b5[i]) + f6 * b6[i]) + f7 * b7[i]


class Drawn(NamedTuple):  # the name stands in caches of compiled code, which cannot be read without it
    """Fields of vectors at every column of pixels, still on the knots of the rows: `line` makes a row of pixels."""

    lines: Float32  # (n, knots, width)
    knot: NDArray[np.int64]  # (height,) as of `Axis`
    weight: Float32  # (height, 4)


def pixel_spline(rows: Axis, columns: Axis, fields: Array, jump: NDArray[np.float64] | None = None) -> Drawn:
    """Fields of vectors (n, ny, nx) for the pixels of both axes; with jumps, where they are is one field more."""
    if jump is not None:
        fields = np.concatenate([fields, jump[None]])
    lines = np.empty((len(fields), len(rows.coefficients), len(columns.knot)), np.float32)
    c = knots(rows, columns, fields, jump).astype(np.float32)
    _widen(
        lines.shape[0] * lines.shape[1],
        c.reshape(-1, c.shape[2]),
        columns.knot,
        columns.weight,
        lines.reshape(-1, lines.shape[2]),
    )
    return Drawn(lines, rows.knot, rows.weight)


@shared(fastmath={"contract"})
def _widen(first, last, c, knot, weight, out):  # type: ignore[no-untyped-def]
    for j in range(first, last):
        row = out[j]
        for i in range(len(row)):
            of = c[j, knot[i] :]
            row[i] = weight[i, 0] * of[0] + weight[i, 1] * of[1] + weight[i, 2] * of[2] + weight[i, 3] * of[3]


@nb.njit(cache=True, fastmath={"contract"})
def line(spline, field, j, out):  # type: ignore[no-untyped-def]
    """Row j of pixels of one of the fields of `Drawn`."""
    lines, knot, weight = spline
    k = knot[j]
    w0, w1, w2, w3 = weight[j, 0], weight[j, 1], weight[j, 2], weight[j, 3]
    c0, c1, c2, c3 = lines[field, k], lines[field, k + 1], lines[field, k + 2], lines[field, k + 3]
    for i in range(len(out)):
        out[i] = w0 * c0[i] + w1 * c1[i] + w2 * c2[i] + w3 * c3[i]
