"""Crater: how much the bed's volume has changed, from a laser line over it or a depth map of it."""

from __future__ import annotations

import math
import warnings
import zipfile

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.estimate.crater import Crater, line_crater
from jumpvision.estimate.crater_map import map_crater
from jumpvision.experiment.inputs.sections import Bed, Calibration, CraterDepth, CraterImage, lacking, need
from jumpvision.experiment.results.values import BedHeight, CraterShape, CraterValues, LaserLine
from jumpvision.experiment.stages.recordings import open_pictures, view_of
from jumpvision.experiment.workflow.stage import StageWarning, stage
from jumpvision.films.frames import open_frames
from jumpvision.films.parameters import CraterParams
from jumpvision.films.vision.laser_line import laser_line
from jumpvision.films.vision.saturation import saturation_of

from .height import packing, packing_common


def needs_of_crater(line: CraterImage | None, depth: CraterDepth | None, calibration: Calibration | None) -> list[str]:
    """A scale; of a picture marks do as well."""
    if depth is not None:
        return lacking(depth, "scale")
    return [] if line is None or (calibration and calibration.marks) else lacking(line, "scale")


@stage(version=2, any_of=("line", "depth"), needs=needs_of_crater)
def crater(
    line: CraterImage | None,
    depth: CraterDepth | None,
    calibration: Calibration | None,
    section: Bed | None,
    bed: BedHeight | None,
    *,
    p: CraterParams,
) -> CraterShape:
    """Volume change of a crater [m^3] from [crater_image] or [crater_depth], negative where the bed was compacted.

    A depth map goes before a laser line.
    """
    found, share, seen = from_map(depth, p) if depth is not None else from_line(line, calibration, p)  # type: ignore[arg-type]
    if found.reason:
        raise ValueError(f"{(depth or line).path}: {found.reason}")  # type: ignore[union-attr]
    phi, phi_sigma = packing(section, bed)
    common = share * abs(found.volume)
    out: CraterValues = {
        "volume_m3": found.volume,
        "sigma_m3": math.hypot(found.sigma, common),
        "sigma_common_m3": common,
        "noise_sigma_m3": found.noise_sigma,
        "half_difference_m3": found.half_difference,
        "depth_m": found.depth,
        "rim_height_m": found.rim_height,
        "radius_m": found.radius,
        "axis_m": found.axis,
        "volume_fraction": phi,
        "sigma_volume_fraction": phi_sigma,
        "sigma_common_volume_fraction": None if phi is None else phi * packing_common(section, bed),
        "profile": {"r_m": found.r, "height_m": found.height, "sigma_m": found.height_sigma},
    }
    if seen is not None:
        out["line"] = seen
    return CraterShape(out)


def from_line(
    section: CraterImage, calibration: Calibration | None, p: CraterParams
) -> tuple[Crater, float, LaserLine | None]:
    """The crater along the laser line, the relative uncertainty of its volume that others share, and where the line
    was seen. The one scale gives height and radius."""
    with open_pictures(section) as frames:
        view, picture = view_of(calibration, section, frames.shape), frames[0]
    seen = laser_line(picture, saturation=saturation_of(picture, section.saturation), contrast=p.contrast)
    lost = seen.flag != ""
    if lost.all():
        raise ValueError(f"{section.path}: {seen.flag[0]}; a bright line on a darker bed is needed")
    if lost.mean() > 0.2:
        said = f"no line in {lost.sum()} of {lost.size} columns"
        warnings.warn(StageWarning("frames", said, section.name), stacklevel=3)
    row = np.where(lost, np.interp(seen.column, seen.column[~lost], seen.row[~lost]), seen.row)
    x = view.across(seen.column, row)
    rise = 1.0 / math.sin(section.laser_angle)
    height = np.where(lost, np.nan, view.height(seen.column, row) * rise)
    axis = None
    if section.axis_column is not None:
        axis = float(np.interp(section.axis_column, seen.column, x))
    # the camera may see the line unevenly spaced: the profile is equally spaced
    even = np.linspace(x[0], x[-1], x.size)
    found = line_crater(
        even, np.interp(even, x, height), np.interp(even, x, seen.sigma * view.scale * rise), axis=axis, radius=p.radius
    )
    return found, 3.0 * view.scale_share, {"column_px": seen.column, "row_px": seen.row, "sigma_px": seen.sigma}


def from_map(section: CraterDepth, p: CraterParams) -> tuple[Crater, float, None]:
    """The crater in a depth map, whose heights do not come from its pixels; the rest as in `from_line`."""
    (scale,) = need(section, "scale")
    z = read_map(section) * section.height_scale
    deep, wide = float(np.ptp(z[np.isfinite(z)])) if np.isfinite(z).any() else 0.0, scale * max(z.shape)
    if deep > wide:
        said = f"[crater_depth] is {deep:.3g} m deep and {wide:.3g} m wide: in mm? then give height_scale = "
        warnings.warn(
            StageWarning(
                "unit", f"{said}{section.height_scale / 1e3:g}", section.name, {"depth_m": deep, "width_m": wide}
            ),
            stacklevel=2,
        )
    axis = (section.axis[0] * scale, -section.axis[1] * scale) if section.axis else None
    return map_crater(z, scale, axis=axis, radius=p.radius), 2.0 * section.scale_sigma / scale, None


APART = 1.0  # ranges of what is measured, by which what is not lies outside
LARGEST = 10**9  # bytes of an unpacked .npz


def read_map(section: CraterDepth) -> Array:
    """The 2-D array of a depth map as it is stored; ValueError where the file holds none, or more than one."""
    path = section.path
    if path.suffix.lower() not in (".npy", ".npz"):
        with open_frames(path, frame_rate=1.0) as film:
            return measured_only(film[0])
    try:
        if path.suffix.lower() == ".npz":
            with zipfile.ZipFile(path) as packed:
                claimed = sum(i.file_size for i in packed.infolist())
            if claimed > LARGEST:
                raise ValueError(f"{claimed} bytes unpacked; at most {LARGEST} are read: save the map alone")
        loaded = np.load(path, allow_pickle=False)
        maps = [loaded] if isinstance(loaded, np.ndarray) else [a for a in map(loaded.get, loaded.files) if a.ndim == 2]
    except Exception as e:  # of a damaged file numpy, zip and zlib raise what their parsing meets, MemoryError included
        raise ValueError(
            f"{path}: not a {path.suffix} file of plain numbers, or damaged ({e}); save it again"
        ) from None
    if len(maps) != 1 or maps[0].ndim != 2 or maps[0].dtype.kind not in "fiu":
        raise ValueError(f"{path}: needs exactly one 2-D array of numbers; found {len(maps)}; save the map alone")
    if not maps[0].size:
        raise ValueError(f"{path}: a map of {maps[0].shape[0]} rows x {maps[0].shape[1]} columns; save it again")
    dark = np.all(maps[0] == 0, axis=1)
    if dark[-1] and not dark.all():
        said = f"{path}: rows {dark.size - int(dark[::-1].argmin())} to {dark.size - 1} are exactly 0"
        said += ": not measured, or a copy that was cut off? make them NaN"
        warnings.warn(StageWarning("missing", said, "crater_image"), stacklevel=3)
    return measured_only(maps[0])


def measured_only(stored: NDArray[np.generic]) -> Array:
    """A depth map as decimals, NaN where a depth camera has measured nothing: it stores 0, or the greatest number, far
    from all that it has measured. A map of decimals is as it is."""
    z = np.asarray(stored, dtype=float)
    if stored.dtype.kind != "u":
        return z
    for nothing in (0.0, float(2 ** (8 * stored.dtype.itemsize) - 1)):
        others = z[np.isfinite(z) & (z != nothing)]
        if others.size and np.abs(others - nothing).min() > APART * np.ptp(others):
            z[z == nothing] = np.nan
    return z
