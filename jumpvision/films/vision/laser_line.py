"""Row of a laser line in every column of a picture at sub-pixel, by the strongest chain through its columns."""

from __future__ import annotations

from dataclasses import dataclass

import numba as nb
import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import FROM_MAD, Array

SPECKLE_SIZES = (0.2, 0.8, 1.6)  # px, standard deviations of the Gaussians that make up the correlation of speckle
NAN = float("nan")


@dataclass(frozen=True)
class LaserLine:
    """Row of the line in each column [px], pixel centres at integers, rows down; shape (n,).

    sigma: standard uncertainty of a row; width: standard deviation across the line [px]. flag: "" where good, else why
    row and sigma are NaN.
    """

    column: Array
    row: Array
    sigma: Array
    width: Array
    flag: NDArray[np.str_]


def laser_line(image: ArrayLike, *, saturation: float | None = None, contrast: float = 0.2) -> LaserLine:
    """The line in a grey image (ny, nx).

    saturation: grey level at and above which a pixel is clipped and left out of the fit (None: none is).
    contrast: share of the typical contrast below which a column has no line.
    ValueError for an image too small to hold a line.
    """
    grey = np.asarray(image, dtype=float)
    if grey.ndim != 2 or grey.shape[0] < 12 or grey.shape[1] < 8:
        raise ValueError(f"laser_line: image has shape {grey.shape}; a grey image of 12 rows and 8 columns is needed")
    ny, nx = grey.shape
    column = np.arange(nx, dtype=float)
    whole = np.isfinite(grey)
    grey = np.where(whole, grey, np.nanmedian(grey))
    # a line is where the mean over 2 px exceeds that over 8 px
    narrow, wide = (scipy.ndimage.gaussian_filter1d(grey, size, axis=0) for size in (2.0, 8.0))
    strength = narrow - wide
    typical = float(np.median(strength.max(axis=0)))
    noise = FROM_MAD * float(np.median(np.abs(np.diff(grey, axis=0)))) / np.sqrt(2.0)
    if not typical > max(3.0 * noise, 1e-9 * float(np.abs(grey).max())):
        nothing = np.full(nx, NAN)
        return LaserLine(column, nothing, nothing, nothing, np.full(nx, "no bright line"))
    # the line may change by 6 px from one column to the next,
    # each of which costs 0.02 of the typical contrast
    path = strongest_chain(np.ascontiguousarray(strength.T) / typical, 6, 0.02)
    there = strength[path, np.arange(nx)] > contrast * typical

    width = _typical_width(grey, path, there)
    reach = max(4, int(np.ceil(4.0 * width)))  # four line widths on each side
    offsets = np.arange(-reach, reach + 1)
    rows = np.clip(path[:, None] + offsets, 0, ny - 1)
    y = grey[rows, np.arange(nx)[:, None]]
    inside = (path[:, None] + offsets >= 0) & (path[:, None] + offsets < ny) & whole[rows, np.arange(nx)[:, None]]
    clipped = y >= saturation if saturation is not None else np.zeros_like(inside)
    use = inside & ~clipped
    usable = there & (use.sum(axis=1) >= 8) & ((clipped & inside).sum(axis=1) <= 2.5 * width)

    weight = use[:, :, None] * np.eye(offsets.size)
    p, fitted = _fit(offsets, y, weight, width)
    for _ in range(2):  # the second time with the weights that belong to the noise
        good = usable & fitted
        if good.sum() < 8:
            nothing = np.full(nx, NAN)
            return LaserLine(column, nothing, nothing, nothing, np.full(nx, "line fit failed"))
        weight = _inverse_noise(p, offsets, y, use, weight, good, width)
        p, fitted = _fit(offsets, y, weight, width)
    _, jac = _model(p, offsets)
    sigma = np.sqrt(np.linalg.pinv(np.einsum("nri,nrs,nsj->nij", jac, weight, jac), hermitian=True)[:, 0, 0])
    flag = np.full(nx, "", dtype="<U32")
    flag[~fitted] = "line fit failed"
    flag[there & ~usable] = "saturated, or at the border"
    flag[~there] = "no line"
    bad = (flag != "") | ~np.isfinite(sigma)
    flag[bad & (flag == "")] = "line fit failed"
    row, sigma, width_ = (np.where(bad, NAN, a) for a in (path + p[:, 0], sigma, np.exp(p[:, 1])))
    return LaserLine(column, row, sigma, width_, flag)


def _typical_width(grey: Array, path: NDArray[np.int64], there: NDArray[np.bool_]) -> float:
    """Standard deviation across the line [px] from area over height of the columns' mean profile."""
    ny = grey.shape[0]
    reach = min(20, (ny - 1) // 2)
    rows = np.clip(path[there][:, None] + np.arange(-reach, reach + 1), 0, ny - 1)
    mean = np.median(grey[rows, np.flatnonzero(there)[:, None]], axis=0)
    above = np.clip(mean - np.median(np.r_[mean[:3], mean[-3:]]), 0.0, None)
    half = above > 0.5 * above.max()
    return float(np.clip(half.sum() / 2.355, 0.6, reach / 4.0))


def _model(p: Array, offsets: NDArray[np.int64]) -> tuple[Array, Array]:
    """(f, J): crest a exp(-(r - r0)^2 / 2 w^2) + b + c r; p = r0, ln w, a, b, c; shapes (n, rows), (n, rows, 5)."""
    r = offsets[None, :] - p[:, :1]
    w = np.exp(p[:, 1:2])
    bell = np.exp(-0.5 * (r / w) ** 2)
    crest = p[:, 2:3] * bell
    ones = np.ones_like(r)
    jac = np.stack([crest * r / w**2, crest * (r / w) ** 2, bell, ones, ones * offsets / offsets[-1]], axis=2)
    return crest + p[:, 3:4] + p[:, 4:5] * offsets / offsets[-1], jac


def _fit(offsets: NDArray[np.int64], y: Array, weight: Array, width: float) -> tuple[Array, NDArray[np.bool_]]:
    """(parameters (n, 5), converged (n,)): damped Gauss-Newton on all columns at once; weight (n, rows, rows)."""
    n = len(y)
    base = 0.5 * (y[:, :2].mean(axis=1) + y[:, -2:].mean(axis=1))
    p = np.column_stack([np.zeros(n), np.full(n, np.log(width)), y.max(axis=1) - base, base, np.zeros(n)])
    damping, moved = np.full(n, 1e-3), np.full(n, np.inf)

    def cost_of(f: Array) -> Array:
        return np.einsum("nr,nrs,ns->n", y - f, weight, y - f, optimize=True)

    f, jac = _model(p, offsets)
    cost = cost_of(f)
    for _ in range(30):
        side = np.einsum("nri,nrs->nis", jac, weight, optimize=True)
        normal = side @ jac
        diagonal = np.einsum("nii->ni", normal)
        lhs = normal + (damping[:, None] * diagonal + 1e-12 * diagonal.max() + 1e-300)[:, :, None] * np.eye(5)
        step = np.linalg.solve(lhs, side @ (y - f)[:, :, None])[:, :, 0]
        trial = p + np.clip(step, [-1.0, -0.3, -np.inf, -np.inf, -np.inf], [1.0, 0.3, np.inf, np.inf, np.inf])
        trial[:, 1] = np.clip(trial[:, 1], np.log(0.25 * width), np.log(3.0 * width))
        f_new, jac_new = _model(trial, offsets)
        cost_new = cost_of(f_new)
        better = cost_new <= cost
        moved = np.where(better, np.abs(trial[:, 0] - p[:, 0]), moved)
        p = np.where(better[:, None], trial, p)
        f, jac = np.where(better[:, None], f_new, f), np.where(better[:, None, None], jac_new, jac)
        cost = np.where(better, cost_new, cost)
        damping = np.clip(np.where(better, 0.3 * damping, 5.0 * damping), 1e-9, 1e6)
        if np.nanmax(moved) < 1e-4:
            break
    return p, (moved < 1e-2) & (p[:, 2] > 0.0) & (np.abs(p[:, 0]) < 2.0 * width + 2.0)


def _inverse_noise(
    p: Array,
    offsets: NDArray[np.int64],
    y: Array,
    use: NDArray[np.bool_],
    weight: Array,
    good: NDArray[np.bool_],
    width: float,
) -> Array:
    """Inverse covariance of the grey values of each column (n, rows, rows), zero for pixels not used.

    Covariance = delta_rs (a + b I_r) + I_r I_s k(r - s), I the fitted line, k a sum of Gaussians of SPECKLE_SIZES up to
    the line's width (wider ones only change its brightness); all shares >= 0, by least squares of the residuals'
    products. The fit has taken part of the noise out of the residuals: with M its projection, E[r r'] = M C M', which
    keeps the equations linear.
    """
    f, jac = _model(p, offsets)
    light = np.clip(p[:, 2:3] * np.exp(-0.5 * ((offsets - p[:, :1]) / np.exp(p[:, 1:2])) ** 2), 0.0, None)
    rows = offsets.size
    eye = np.eye(rows)
    apart = np.subtract.outer(offsets, offsets)
    shared = [np.exp(-0.5 * (apart / s) ** 2) for s in SPECKLE_SIZES if s < width]

    def parts(i: NDArray[np.int64]) -> list[Array]:
        product = light[i][:, :, None] * light[i][:, None, :]
        return [np.broadcast_to(eye, product.shape), light[i][:, :, None] * eye, *(product * k for k in shared)]

    take = np.flatnonzero(good)
    take = take[:: max(1, take.size // 400)]  # 400 columns tell the noise
    j, w = jac[take], weight[take]
    on = use[take].astype(float)
    solve = np.linalg.pinv(np.einsum("nri,nrs,nsj->nij", j, w, j, optimize=True), hermitian=True)
    project = on[:, :, None] * (eye - j @ solve @ np.swapaxes(j, 1, 2) @ w)
    r = on * (y - f)[take]
    # each entry counts by the spread that the noise found so far gives it
    spread = np.sqrt(np.maximum(np.mean(r**2, axis=0), 1e-300))
    scale = on[:, :, None] * on[:, None, :] / (spread[:, None] * spread[None, :])
    seen = [scale * (project @ c @ np.swapaxes(project, 1, 2)) for c in parts(take)]
    target = scale * r[:, :, None] * r[:, None, :]
    matrix = np.array([[float(np.sum(a * b)) for b in seen] for a in seen])
    right = np.array([float(np.sum(a * target)) for a in seen])
    size = np.sqrt(np.diag(matrix)) + 1e-300
    root = np.linalg.cholesky(matrix / size[:, None] / size + 1e-12 * np.eye(len(size)))
    share = scipy.optimize.nnls(root.T, np.linalg.solve(root, right / size))[0] / size
    every = np.arange(len(y))
    noise = sum((c * t for c, t in zip(share, parts(every))), np.zeros((len(y), rows, rows)))
    floor = 1e-4 * float(np.mean(r**2)) + 1e-12 * float(np.max(light)) ** 2  # keeps the sum positive definite
    noise = noise + floor * eye
    pairs = use[:, :, None] & use[:, None, :]
    return np.where(pairs, np.linalg.inv(np.where(pairs, noise, eye)), 0.0)


@nb.njit(cache=True)
def strongest_chain(strength: Array, largest: int, cost: float) -> NDArray[np.int64]:
    """Row index of each column of the chain with the greatest sum of strength - cost |step|; strength (nx, rows).

    largest: rows by which the chain may step from one column to the next. Dynamic programming. Compiles in about 1 s,
    once.
    """
    nx, rows = strength.shape
    best = strength[0].copy()
    came = np.zeros((nx, rows), dtype=np.int64)
    for j in range(1, nx):
        new = np.empty(rows)
        for r in range(rows):
            top, where = -1e300, r
            for q in range(max(0, r - largest), min(rows, r + largest + 1)):
                score = best[q] - cost * abs(q - r)
                if score > top:
                    top, where = score, q
            new[r], came[j, r] = top + strength[j, r], where
        best = new
    path = np.empty(nx, dtype=np.int64)
    path[nx - 1] = np.argmax(best)
    for j in range(nx - 1, 0, -1):
        path[j - 1] = came[j, path[j]]
    return path
