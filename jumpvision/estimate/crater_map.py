"""Volume change of a crater from a depth map: no symmetry is assumed, the plane around it is height zero."""

from __future__ import annotations

import math

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import FROM_MAD, Array

from .crater import BEYOND, DISTURBED, NAN, Crater, no_crater, settled_radius, sum_sigma

SMOOTH = 2.0  # px, over which the map is smoothed to see where it is disturbed
SPIKE = 8.0  # noise widths beyond which a pixel against its neighbours is no surface
RING = 1.6  # the plane is fitted between the crater's radius and this many of them
RIM = 4  # px around a hole, from which it is filled


def map_crater(
    height: ArrayLike, pitch: float, *, axis: tuple[float, float] | None = None, radius: float | None = None
) -> Crater:
    """The crater in a height map, shape (ny, nx) [m], up; pitch [m] between pixels, NaN where unknown.

    axis [m]: (x, y), x right, y up, from the centre of the top-left pixel (None: centroid of the disturbed ground).
    radius [m]: of the disc that is integrated (None: found). Single pixels far off their neighbours are replaced.
    """
    z = np.asarray(height, dtype=float)
    if z.ndim != 2 or min(z.shape) < 24:
        raise ValueError(f"map_crater: height has shape {z.shape}; a map of at least 24 x 24 pixels is needed")
    if not pitch > 0.0:
        raise ValueError(f"map_crater: pitch = {pitch!r} must be > 0 m")
    z, doubt, hole = _without_holes(z)
    z = _without_spikes(z)
    ny, nx = z.shape
    row, column = np.mgrid[:ny, :nx].astype(float)
    where = None if axis is None else (axis[0] / pitch, -axis[1] / pitch)
    found = _extent(z, where, None if radius is None else radius / pitch)
    if isinstance(found, str):
        return no_crater(found, (NAN, NAN) if axis is None else axis)
    (cx, cy), reach = found
    at = (cx * pitch, -cy * pitch)
    r = np.hypot(column - cx, row - cy)
    room = min(cx, cy, nx - 1 - cx, ny - 1 - cy)
    if reach > room - 3.0:
        return no_crater(
            f"the crater (radius {reach * pitch:.4g} m) reaches the edge of the map, {room * pitch:.4g} m from its "
            "axis: undisturbed ground around it is needed",
            at,
        )
    design = np.stack([np.ones(z.size), column.ravel() - cx, row.ravel() - cy], axis=1)

    def plane(reach: float) -> tuple[NDArray[np.bool_], Array]:
        """(pixels of the ring, matrix (3, pixels) that gives the coefficients of the plane through them)."""
        ring = ((r > reach) & (r < RING * reach)).ravel()
        return ring, np.linalg.pinv(design[ring])

    def levelled(reach: float) -> Array:
        ring, inverse = plane(reach)
        return (z.ravel() - design @ (inverse @ z.ravel()[ring])).reshape(z.shape)

    def weights(reach: float) -> Array:
        """What the volume takes of each pixel: the disc less what the plane through the ring takes off."""
        ring, inverse = plane(reach)
        weight = np.clip(reach - r + 0.5, 0.0, 1.0).ravel() * pitch**2
        weight[ring] -= (np.clip(reach - r + 0.5, 0.0, 1.0).ravel() * pitch**2 @ design) @ inverse
        return weight.reshape(z.shape)

    def rest(reach: float) -> Array:
        return np.where(plane(reach)[0].reshape(z.shape), levelled(reach), np.nan)

    cut = 0.0
    if radius is None:
        reach, cut = settled_radius(z, weights, rest, reach, room - 3.0)
    unknown = np.bincount(hole.ravel(), (weights(reach) * doubt).ravel())[1:]  # of each hole [m^3]
    sigma = math.hypot(sum_sigma(weights(reach), rest(reach)), cut, *unknown)
    level = levelled(reach)
    bins = np.arange(0.0, RING * reach, 1.0)
    which = np.digitize(r, bins) - 1
    keep = which < bins.size - 1
    count = np.bincount(which[keep], minlength=bins.size - 1)
    mean = np.bincount(which[keep], level[keep], minlength=bins.size - 1) / np.maximum(count, 1)
    spread = np.bincount(which[keep], (level[keep] - mean[which[keep]]) ** 2, minlength=bins.size - 1)
    scatter = np.sqrt(spread / np.maximum(count - 1, 1))
    inside = r <= reach
    smooth = scipy.ndimage.gaussian_filter(level, SMOOTH)[inside]
    return Crater(
        float(np.sum(weights(reach) * z)),
        sigma,
        sigma,
        NAN,
        at,
        reach * pitch,
        float(max(-smooth.min(), 0.0)),
        float(max(smooth.max(), 0.0)),
        (bins[:-1] + 0.5) * pitch,
        mean,
        scatter / np.sqrt(np.maximum(count, 1)),
    )


def _without_holes(z: Array) -> tuple[Array, Array, NDArray[np.int32]]:
    """(map with what is unknown filled smoothly from the rim (biharmonic), by how much a fill without any bend would
    differ from it, number of the hole of each pixel, 0: none)."""
    hole, count = scipy.ndimage.label(~np.isfinite(z))
    doubt = np.zeros_like(z)
    if not count or (count and not np.isfinite(z).any()):
        return z, doubt, hole
    from skimage.restoration import inpaint_biharmonic

    out = z.copy()
    for k, found in enumerate(scipy.ndimage.find_objects(hole), 1):
        part = tuple(slice(max(s.start - RIM, 0), s.stop + RIM) for s in found)
        rim, mine = z[part], hole[part] == k
        level, size = float(np.nanmean(rim)), float(np.nanstd(rim)) or 1.0
        known = np.isfinite(rim)
        even = np.where(known, (rim - level) / size, 0.0)
        at = np.argwhere(known)
        flat = scipy.interpolate.griddata(at, rim[known], np.argwhere(mine), method="linear")
        near = scipy.interpolate.griddata(at, rim[known], np.argwhere(mine), method="nearest")
        smooth = level + size * inpaint_biharmonic(even, ~known)[mine]
        out[part][mine] = smooth
        doubt[part][mine] = smooth - np.where(np.isfinite(flat), flat, near)
    return out, doubt, hole


def _without_spikes(z: Array) -> Array:
    """The map with pixels that are unknown or far off the median of their neighbours replaced by it."""
    known = np.isfinite(z)
    filled = np.where(known, z, np.median(z[known])) if known.any() else z
    smooth = scipy.ndimage.median_filter(filled, 5)
    off = filled - smooth
    noise = FROM_MAD * float(np.median(np.abs(off)))
    return np.where(known & (np.abs(off) <= SPIKE * max(noise, 1e-300)), filled, smooth)


def _extent(
    z: Array, where: tuple[float, float] | None, radius: float | None
) -> tuple[tuple[float, float], float] | str:
    """((column, row), radius) [px] of the disturbed ground, or why there is none."""
    if where is not None and radius is not None:
        return where, radius
    ny, nx = z.shape
    row, column = np.mgrid[:ny, :nx].astype(float)
    design = np.stack([np.ones(z.size), column.ravel(), row.ravel()], axis=1)
    use = np.ones(z.size, bool)
    for _ in range(12):  # the plane of the undisturbed ground, which is most of the map
        rest = z.ravel() - design @ np.linalg.lstsq(design[use], z.ravel()[use], rcond=None)[0]
        noise = FROM_MAD * float(np.median(np.abs(rest[use] - np.median(rest[use]))))
        use = np.abs(rest) < 3.0 * max(noise, 1e-300)
    level = scipy.ndimage.gaussian_filter(rest.reshape(z.shape), SMOOTH)
    noise = FROM_MAD * float(np.median(np.abs(level - np.median(level))))
    parts, count = scipy.ndimage.label(np.abs(level) > DISTURBED * noise)
    edge = set(np.unique(np.r_[parts[:2].ravel(), parts[-2:].ravel(), parts[:, :2].ravel(), parts[:, -2:].ravel()]))
    size = np.bincount(parts.ravel())
    # smaller disturbed patches [px] are none: the smoothing alone makes noise hang together over 25
    inner = [k for k in range(1, count + 1) if k not in edge and size[k] >= 40]
    if not inner:
        return "no crater: the ground nowhere leaves its plane, away from the edges of the map"
    strength = np.bincount(parts.ravel(), np.abs(level).ravel())
    main = max(inner, key=lambda k: strength[k])

    def disc(mask: NDArray[np.bool_]) -> tuple[tuple[float, float], float]:
        weight = np.abs(level) * mask
        middle = where or (float(np.sum(weight * column) / weight.sum()), float(np.sum(weight * row) / weight.sum()))
        distance = np.hypot(column - middle[0], row - middle[1])[mask]
        return middle, float(np.max(distance))

    centre, reach = disc(parts == main)
    # parts of the disturbed ground within this many radii of the largest one belong to the crater
    close = np.hypot(column - centre[0], row - centre[1]) < 2.0 * reach
    near = [k for k in inner if strength[k] > 0.02 * strength[main] and (close[parts == k]).all()]
    centre, reach = disc(np.isin(parts, near))
    return centre, radius if radius is not None else BEYOND * reach
