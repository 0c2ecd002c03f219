"""Free surface of the bed in a back-lit side view (bright above, dark grains below), and the volume fraction."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array

from .laser_line import strongest_chain
from .light import clipped_columns, clipped_shift, glow_shift

REACH = 8  # px above and below the surface that the step filter and the edge fit look at
ITERATIONS = 3  # of dilation and erosion in the threshold method
NAN = float("nan")


@dataclass(frozen=True)
class Surface:
    """Row of the surface in each image column, pixel centres at integers, rows down; shape (n,) [px].

    flag: "" where good, else why row and sigma are NaN. common: standard uncertainty that all rows share. clipped:
    number of columns in which the light is saturated.
    """

    column: Array
    row: Array
    sigma: Array
    flag: NDArray[np.str_]
    common: float = 0.0
    clipped: int = 0


@dataclass(frozen=True)
class BedHeightPx:
    """Mean height of the bed above the floor with its standard uncertainty, in the surface's unit (px, or m).

    tilt [rad], tilt_sigma: slope of the surface, positive where it rises to the right (columns and rows are taken as
    equally spaced). roughness: standard deviation about that slope. n: columns used. block: columns that were
    averaged before the scatter was taken, to get past the correlation of neighbours.
    """

    height: float
    sigma: float
    tilt: float
    tilt_sigma: float
    roughness: float
    n: int
    block: int


def bed_surface(
    image: ArrayLike,
    *,
    floor_row: float | None,
    method: str,
    saturation: float | None = None,
    threshold: float | None = None,
) -> Surface:
    """Surface row of every column of a grey image, shape (ny, nx), light above and dark grains below.

    floor_row [px]: row of the bed's floor; nothing below it is looked at (None: the whole image).
    saturation: grey level at and above which a pixel is clipped (None: none is). The grey values are taken as
    proportional to the light: a camera's response curve is to be undone before.
    method "edge": a smooth chain of columns through the strongest bright-above-dark step, then in each column the row
    and width of an error function fitted to the grey values, less what light through the grains adds (`glow`).
    method "threshold": as published, Otsu's threshold, a few erosions and dilations, and the first dark
    row of what hangs together with the bed; threshold: another one than Otsu's, in the image's grey values.
    """
    grey = np.asarray(image, dtype=float)
    if grey.ndim != 2 or grey.shape[0] < 4 * REACH or grey.shape[1] < 2:
        raise ValueError(
            f"bed_surface: image has shape {grey.shape}; a grey image of {4 * REACH} rows or more is needed"
        )
    if floor_row is not None:
        if not 2 * REACH <= floor_row <= grey.shape[0]:
            raise ValueError(f"bed_surface: floor_row = {floor_row:g} must be in [{2 * REACH}, {grey.shape[0]}]")
        grey = grey[: math.floor(floor_row) + 1]
    grey = np.where(np.isfinite(grey), grey, np.nanmedian(grey))
    if upside_down(grey):
        raise ValueError(
            "bed_surface: dark grains lie above the light in most columns: the picture is upside down; turn it, or cut "
            "off what covers the light at its top"
        )
    if method == "edge":
        return _edge(grey, saturation)
    if method == "threshold":
        return _threshold(grey, threshold)
    raise ValueError(f"bed_surface: method = {method!r} must be 'edge' or 'threshold'")


def upside_down(grey: Array) -> bool:
    """Whether a bed's picture (rows, columns), down to its floor, is darker at its top than at its bottom in most
    columns, by a third of its range."""
    band = max(grey.shape[0] // 8, 4)
    brighter = np.median(grey[-band:], axis=0) - np.median(grey[:band], axis=0)
    low, high = np.percentile(grey, (2.0, 98.0))
    return bool(np.mean(brighter > (high - low) / 3.0) > 0.5)


def bed_height(surface: Surface, floor_row: float) -> BedHeightPx:
    """Mean height above floor_row = floor_row - mean surface row, at the middle of the columns; any one unit.

    A straight line (tilt) is fitted through the good columns and taken at the middle of all columns, so that columns
    lost on one side do not shift the height. The surface is made of grains several px wide, hence neighbouring columns
    scatter together: sigma comes from the scatter of block means (`_blocked_sigma`) and from what all columns
    share. NaN below 8 good columns.
    """
    good = surface.flag == ""
    n = int(good.sum())
    if n < 8:
        return BedHeightPx(NAN, NAN, NAN, NAN, NAN, n, 0)
    d = surface.column - surface.column.mean()
    height = floor_row - surface.row
    slope, middle = np.polyfit(d[good], height[good], 1)
    residual = np.where(good, height - middle - slope * d, np.nan)
    block, sigma = _blocked_sigma(residual, n)
    roughness = float(np.sqrt(np.nanmean(residual**2) * n / (n - 2)))
    spread = float(np.sqrt(np.mean(d[good] ** 2)))
    lean = float(d[good].mean())  # the line is taken at d = 0, off the middle of the good columns by this much
    tilt_sigma = sigma / spread if spread > 0.0 else NAN
    sigma = math.hypot(sigma, lean * tilt_sigma) if lean else sigma
    return BedHeightPx(
        float(middle), math.hypot(sigma, surface.common), math.atan(slope), tilt_sigma, roughness, n, block
    )


def volume_fraction(
    solid_volume: float, length: float, width: float, height: float, sigma_height: float, sigma_solid: float = 0.0
) -> tuple[float, float]:
    """(phi, sigma) = V_s / (l w h), V_s [m^3] the grains' own volume, l, w, h [m] of the bed.

    The thesis prints N pi r^2/(l w h), which is no pure number; for N spheres V_s = N 4/3 pi r^3 (docs/physics.md
    section 8). sigma_height [m] and sigma_solid [m^3] are taken as independent; l and w as exact.
    """
    for name, value in (("solid_volume", solid_volume), ("length", length), ("width", width)):
        if not value > 0.0:
            raise ValueError(f"volume_fraction: {name} = {value!r} must be > 0 (SI units)")
    if not height > 0.0:
        return NAN, NAN
    phi = solid_volume / (length * width * height)
    return phi, phi * math.hypot(sigma_height / height, sigma_solid / solid_volume)


def _edge(grey: Array, saturation: float | None) -> Surface:
    ny, nx = grey.shape
    total = np.concatenate((np.zeros((1, nx)), np.cumsum(grey, axis=0)))
    at = np.arange(REACH, ny - REACH + 1)  # a step at the boundary above row r
    strength = (2.0 * total[at] - total[at - REACH] - total[at + REACH]) / REACH
    typical = float(np.median(strength.max(axis=0)))
    column = np.arange(nx, dtype=float)
    if not typical > 0.0:
        return Surface(column, np.full(nx, NAN), np.full(nx, NAN), np.full(nx, "no bright-above-dark edge"))
    # the surface may change by 6 px from one column to the next,
    # each of which costs 0.02 of the typical contrast
    path = strongest_chain(np.ascontiguousarray(strength.T) / typical, 6, 0.02)
    contrast = strength[path, np.arange(nx)]
    start = at[path] - 0.5
    row, sigma, fitted = _edge_fit(grey, start)
    flag = np.full(nx, "", dtype="<U32")
    flag[~fitted] = "edge fit failed"
    # columns whose step is below 0.3 of the typical one have no surface
    flag[contrast < 0.3 * typical] = "no contrast"
    clipped = np.zeros(nx, bool)
    if saturation is not None:
        clipped = clipped_columns(grey, np.where(flag == "", row, NAN), saturation)
    shift, shift_sigma = glow_shift(grey, np.where((flag != "") | clipped, NAN, row))
    moved, spread = np.full(nx, shift), np.full(nx, shift_sigma)
    if saturation is not None and clipped.any():
        moved[clipped], spread[clipped] = clipped_shift(grey, np.where(clipped, row, NAN), saturation)
        flag[~np.isfinite(moved)] = "light saturated"
    bad = flag != ""
    common = float(spread[~bad].mean()) if not bad.all() else 0.0
    row, sigma = np.where(bad, NAN, row + moved), np.where(bad, NAN, np.hypot(sigma, spread))
    return Surface(column, row, sigma, flag, common, int(clipped.sum()))


def _edge_fit(grey: Array, start: Array) -> tuple[Array, Array, NDArray[np.bool_]]:
    """(row, sigma, converged) of top + (bottom - top) Phi((r - row)/width), fitted to 2 REACH + 1 rows of each column.

    Damped Gauss-Newton, all columns at once. sigma from the scatter of the grey values about the curve.
    """
    ny, nx = grey.shape
    first = np.clip(np.rint(start).astype(int) - REACH, 0, ny - 2 * REACH - 1)
    rows = first[:, None] + np.arange(2 * REACH + 1)[None, :]  # (nx, 17)
    y = grey[rows, np.arange(nx)[:, None]]
    r = rows.astype(float)
    p = np.stack([y[:, :4].mean(axis=1), y[:, -4:].mean(axis=1), start, np.zeros(nx)], axis=1)  # width = exp(p3)
    damping = np.full(nx, 1e-2)

    def model(p: Array) -> tuple[Array, Array]:
        width = np.exp(p[:, 3])[:, None]
        z = (r - p[:, 2:3]) / width
        step, bell = scipy.special.ndtr(z), np.exp(-0.5 * z * z) / math.sqrt(2.0 * math.pi)
        drop = (p[:, 1] - p[:, 0])[:, None]
        return p[:, :1] + drop * step, np.stack([1.0 - step, step, -drop * bell / width, -drop * bell * z], axis=2)

    f, jac = model(p)
    cost = np.sum((y - f) ** 2, axis=1)
    moved = np.full(nx, np.inf)
    for _ in range(40):
        normal = np.einsum("nri,nrj->nij", jac, jac)
        diagonal = np.einsum("nii->ni", normal) + 1e-12
        lhs = normal + damping[:, None, None] * np.einsum("ni,ij->nij", diagonal, np.eye(4))
        step = np.linalg.solve(lhs, np.einsum("nri,nr->ni", jac, y - f)[:, :, None])[:, :, 0]
        trial = p + np.clip(step, [-np.inf, -np.inf, -2.0, -0.5], [np.inf, np.inf, 2.0, 0.5])
        trial[:, 3] = np.clip(trial[:, 3], -2.0, 1.6)  # 0.14..5 px: sharper is not resolved, wider does not fit REACH
        f_new, jac_new = model(trial)
        cost_new = np.sum((y - f_new) ** 2, axis=1)
        better = cost_new <= cost
        moved = np.where(better, np.abs(trial[:, 2] - p[:, 2]), moved)
        p = np.where(better[:, None], trial, p)
        f, jac = np.where(better[:, None], f_new, f), np.where(better[:, None, None], jac_new, jac)
        cost = np.where(better, cost_new, cost)
        damping = np.clip(np.where(better, 0.3 * damping, 5.0 * damping), 1e-9, 1e6)
    normal = np.einsum("nri,nrj->nij", jac, jac)
    cov = np.linalg.pinv(normal, hermitian=True)
    sigma = np.sqrt(np.maximum(cov[:, 2, 2], 0.0) * cost / (r.shape[1] - 4))
    fitted = (moved < 0.01) & (p[:, 0] > p[:, 1]) & (np.abs(p[:, 2] - start) < REACH) & (sigma > 0.0) & (sigma < 2.0)
    return p[:, 2], sigma, fitted


def otsu(grey: Array, floor_row: float | None = None) -> float:
    """Otsu's threshold of a picture (rows, columns) down to its floor."""
    from skimage.filters import threshold_otsu

    return float(threshold_otsu(grey if floor_row is None else grey[: math.floor(floor_row) + 1]))


def _threshold(grey: Array, level: float | None) -> Surface:
    nx = grey.shape[1]
    column = np.arange(nx, dtype=float)
    if np.ptp(grey) == 0.0:
        return Surface(column, np.full(nx, NAN), np.full(nx, NAN), np.full(nx, "no bright-above-dark edge"))
    margin = ITERATIONS + 1  # the picture's border is no edge of the bed
    dark = np.pad(np.asarray(grey < (otsu(grey) if level is None else level)), margin, mode="edge")
    dark = scipy.ndimage.binary_closing(
        scipy.ndimage.binary_opening(dark, iterations=ITERATIONS), iterations=ITERATIONS
    )[margin:-margin, margin:-margin]
    parts, count = scipy.ndimage.label(dark)
    bed = parts == (1 + int(np.argmax(np.bincount(parts.ravel())[1:]))) if count else dark
    has = bed.any(axis=0)
    row = np.where(has, np.argmax(bed, axis=0) - 0.5, NAN)  # the boundary above the first dark row
    flag = np.where(has, "", "no dark region").astype("<U32")
    return Surface(column, row, np.where(has, 1.0 / math.sqrt(12.0), NAN), flag)


def _blocked_sigma(residual: Array, n: int) -> tuple[int, float]:
    """(block, sigma of the mean) of n correlated residuals, NaN where a column is lost.

    Block size: the smallest power of two with B^3 > 2 n (sigma_B/sigma_1)^4 (Lee et al. 2011), at least 8 blocks.
    Finite blocks miss the correlation across their ends, a share proportional to 1/B of the variance: extrapolated
    from B/2 and B. The last factor widens sigma to the 68.3 % range of Student's t, as few blocks make it uncertain.
    """
    single = _sigma_of_mean(residual, 1)
    block, sigma, before = 1, single, single
    while 2 * block <= residual.size // 8:
        block, before = 2 * block, sigma
        sigma = _sigma_of_mean(residual, block)
        if block**3 > 2.0 * n * (sigma / single) ** 4:
            break
    # the difference is noisy: never below half
    sigma = math.sqrt(max(2.0 * sigma**2 - before**2, 0.5 * sigma**2))
    dof = max(residual.size // block - 2, 1)
    return block, sigma * float(scipy.special.stdtrit(dof, 1.0 - 0.158655))


def _sigma_of_mean(residual: Array, block: int) -> float:
    """Standard uncertainty of the mean from the scatter of means over `block` columns, each weighted by its columns."""
    size = residual.size // block * block
    parts = residual[:size].reshape(-1, block)
    count = np.isfinite(parts).sum(axis=1)
    weight = count[count > 0].astype(float)
    sums = np.nansum(parts, axis=1)[count > 0]
    k = weight.size
    # mean = sum of block sums / n; two parameters (mean, tilt) were taken out of the residuals
    return float(np.sqrt(k / max(k - 2, 1) * np.sum((sums - weight * sums.sum() / weight.sum()) ** 2)) / weight.sum())
