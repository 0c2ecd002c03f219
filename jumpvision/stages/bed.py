"""Bed: height of the grains in the back-lit side view, and the volume fraction that follows from it."""

from __future__ import annotations

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..params import BedParams
from ..records import BedHeight
from ..sections import Bed, BedImage, Calibration, need
from ..stage import StageWarning, stage
from ..vision.surface import Surface, bed_height, bed_surface, volume_fraction
from .films import open_pictures
from .view import view_of

Array = NDArray[np.float64]

EDGE_COMMON = 0.025  # px, by which all columns of one picture may be off together (light through the topmost grains)


@stage(version=3)
def bed(image: BedImage, section: Bed | None, calibration: Calibration | None, *, p: BedParams) -> BedHeight:
    """Mean height above the floor [m]; volume fraction from the grains' solid volume, or relative to a reference."""
    pixels, surfaces, time, scale = surfaces_of(image, calibration, p)
    if saturated := max(s.clipped / s.row.size for s in pixels):
        warnings.warn(
            f"the light is saturated in {100 * saturated:.0f} % of the columns: the surface is known there only to a "
            "tenth of a pixel or worse (sigma says so); expose less, or give [bed_image] saturation if that is wrong",
            StageWarning, stacklevel=2,
        )  # fmt: skip
    found = [bed_height(s, 0.0) for s in surfaces]
    chosen = 0 if image.use == "first" else len(found) - 1
    best, surface = found[chosen], surfaces[chosen]
    # pictures of one bed share most of the surface's roughness: what changed is measured column by column
    moved = [
        bed_height(replace(s, row=s.row - surfaces[0].row, common=s.common if s.clipped else 0.0), 0.0)
        for s in surfaces[1:]
    ]
    common = np.sqrt(2.0) * EDGE_COMMON * scale
    change = [(0.0, 0.0), *((m.height, float(np.hypot(m.sigma, common))) for m in moved)]
    heights = [(f.height, f.sigma) for f in found]
    packings = [fraction(h, s, section, p, heights[0], c) for (h, s), c in zip(heights, change)]
    out: dict[str, Any] = {
        "height_m": best.height, "sigma_m": best.sigma,
        "volume_fraction": packings[chosen][0], "sigma_volume_fraction": packings[chosen][1],
        "tilt_rad": best.tilt, "roughness_m": best.roughness, "columns": best.n, "picture": chosen,
        "profile": {"column_px": pixels[chosen].column, "row_px": pixels[chosen].row,
                    "sigma_px": pixels[chosen].sigma, "x_m": surface.column, "height_m": -surface.row},
    }  # fmt: skip
    if len(found) > 1:
        out["series"] = {
            "time_s": time, "height_m": [h for h, _ in heights], "sigma_m": [s for _, s in heights],
            "change_m": [c for c, _ in change], "sigma_change_m": [s for _, s in change],
            "volume_fraction": [f for f, _ in packings], "sigma_volume_fraction": [s for _, s in packings],
        }  # fmt: skip
    return BedHeight(out)


def surfaces_of(
    image: BedImage, calibration: Calibration | None, p: BedParams
) -> tuple[list[Surface], list[Surface], Array, float]:
    """Of every picture: its surface in pixels, and in metres (x, height above the floor as -row); times [s]; m/px."""
    pixels, surfaces = [], []
    with open_pictures(image) as frames:
        view = view_of(calibration, image, frames.shape)
        rows, columns = frames.shape
        if image.floor_row is None and not (calibration and calibration.marks):
            need(image, "floor_row")
        if image.floor_row is not None and not 0 <= image.floor_row < rows:
            raise ValueError(
                f"[bed_image] floor_row = {image.floor_row:g}: outside the picture, whose rows are 0 to {rows - 1}"
            )
        # without a floor row the marks' y is counted from the floor
        floor = 0.0 if image.floor_row is None else float(view.height(0.5 * (columns - 1), image.floor_row))
        for picture in frames:
            limit = image.saturation or (float(np.iinfo(picture.dtype).max) if picture.dtype.kind == "u" else None)
            s = bed_surface(
                picture.astype(float) ** image.gamma,  # light, up to a factor
                floor_row=image.floor_row, method=p.method,
                saturation=None if limit is None else limit**image.gamma,
            )  # fmt: skip
            pixels.append(s)
            lost = ~np.isfinite(s.row)
            row = np.where(lost, np.nanmedian(s.row) if not lost.all() else 0.0, s.row)
            height = np.where(lost, np.nan, view.height(s.column, row) - floor)
            surfaces.append(
                Surface(
                    view.across(s.column, row), -height, s.sigma * view.scale, s.flag, s.common * view.scale, s.clipped
                )
            )
        return pixels, surfaces, np.asarray(frames.time, float), view.scale


def fraction(
    height: float,
    sigma: float,
    section: Bed | None,
    p: BedParams,
    first: tuple[float, float] = (np.nan, np.nan),
    change: tuple[float, float] = (np.nan, np.nan),
) -> tuple[float | None, float | None]:
    """(phi, sigma), or None where neither the solid volume nor a reference is known.

    first: (height, sigma) of the series' first picture, whose packing is the reference where only reference_fraction is
    given; change: (height minus the first's, sigma), column by column.
    """
    if section and section.solid_volume is not None:
        length, width = need(section, "length", "width")
        return volume_fraction(section.solid_volume, length, width, height, sigma)
    if p.reference_fraction is None:
        return None, None
    if p.reference_height is not None:
        relative = p.reference_fraction * p.reference_height / height
        return relative, relative * sigma / height
    # h_0/h = 1 - (h - h_0)/h: what both pictures share of the height's error cancels to first order
    relative = p.reference_fraction * (1.0 - change[0] / height)
    spread = np.hypot(change[1] * first[0], sigma * change[0]) / height**2
    return relative, p.reference_fraction * float(spread)


def packing(section: Bed | None, bed: BedHeight | None) -> tuple[float | None, float | None]:
    """(phi, sigma) of an experiment: as given in [bed], else as measured from the picture; None where unknown."""
    if section and section.volume_fraction is not None:
        return section.volume_fraction, 0.0
    if bed and bed.values["volume_fraction"] is not None:
        return bed.values["volume_fraction"], bed.values["sigma_volume_fraction"]
    return None, None
