"""Bed: height of the grains in the back-lit side view, and the volume fraction that follows from it."""

from __future__ import annotations

import warnings
from dataclasses import replace
from math import hypot

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.experiment.inputs.sections import Bed, BedImage, Calibration, lacking, need
from jumpvision.experiment.results.values import BedHeight, BedValues
from jumpvision.experiment.stages.recordings import open_pictures, other_lens, view_of
from jumpvision.experiment.workflow.stage import StageWarning, stage
from jumpvision.films.calibration import EDGE_OF_BED
from jumpvision.films.parameters import BedParams
from jumpvision.films.vision.camera import Camera
from jumpvision.films.vision.saturation import saturation_of
from jumpvision.films.vision.surface import BedHeightPx, Surface, bed_height, bed_surface, volume_fraction


def needs_of_bed(image: BedImage, section: Bed | None, calibration: Calibration | None) -> list[str]:
    """A scale and the floor, unless marks say where they are; the bed's area where its grains are known."""
    found = [] if calibration and calibration.marks else lacking(image, "scale", "floor_row")
    return found + (lacking(section, "length", "width") if section and section.solid_volume is not None else [])


@stage(version=4, needs=needs_of_bed)
def bed(image: BedImage, section: Bed | None, calibration: Calibration | None, *, p: BedParams) -> BedHeight:
    """Height of the bed [m] and its volume fraction from [bed_image].

    Mean height above the floor; volume fraction from the grains' solid volume, or relative to a reference.
    """
    pixels, surfaces, time, view, other = surfaces_of(image, calibration, p)
    scale = view.scale
    if saturated := max(s.clipped / s.row.size for s in pixels):
        said = (
            f"the light is saturated in {100 * saturated:.0f} % of the columns: the surface is known there only to a "
            "tenth of a pixel or worse (sigma says so); expose less, or give [bed_image] saturation if that is wrong"
        )
        warnings.warn(StageWarning("light", said, image.name, {"share": saturated}), stacklevel=2)
    found = [bed_height(s, 0.0) for s in surfaces]
    chosen = 0 if image.use == "first" else len(found) - 1
    best, surface = found[chosen], surfaces[chosen]
    # pictures of one bed share most of the surface's roughness: what changed is measured column by column
    moved = [
        bed_height(replace(s, row=s.row - surfaces[0].row, common=s.common if s.clipped else 0.0), 0.0)
        for s in surfaces[1:]
    ]
    common = np.sqrt(2.0) * EDGE_OF_BED.value * scale
    change = [(0.0, 0.0), *((m.height, float(np.hypot(m.sigma, common))) for m in moved)]
    heights = [(f.height, f.sigma) for f in found]
    packings = [fraction(h, s, section, p, heights[0], c) for (h, s), c in zip(heights, change)]
    # scale and lens: alike in every picture of this camera, so a change knows them better than a height
    off = [hypot(view.scale_share * f.height, lens) for f, lens in zip(found, by_lens(found, other))]
    off_change = [view.scale_share * abs(c) for c, _ in change]
    off_packing = [fraction_common(f[0], h, o, section, p) for f, (h, _), o in zip(packings, heights, off)]
    out: BedValues = {
        "height_m": best.height,
        "sigma_m": hypot(best.sigma, off[chosen]),
        "sigma_common_m": off[chosen],
        "volume_fraction": packings[chosen][0],
        "sigma_volume_fraction": both(packings[chosen][1], off_packing[chosen]),
        "sigma_common_volume_fraction": off_packing[chosen],
        "tilt_rad": best.tilt,
        "roughness_m": best.roughness,
        "columns": best.n,
        "picture": chosen,
        "profile": {
            "column_px": pixels[chosen].column,
            "row_px": pixels[chosen].row,
            "sigma_px": pixels[chosen].sigma,
            "x_m": surface.column,
            "height_m": -surface.row,
        },
    }
    if len(found) > 1:
        out["series"] = {
            "time_s": time,
            "height_m": [h for h, _ in heights],
            "sigma_m": [hypot(s, o) for (_, s), o in zip(heights, off)],
            "sigma_common_m": off,
            "change_m": [c for c, _ in change],
            "sigma_change_m": [hypot(s, o) for (_, s), o in zip(change, off_change)],
            "sigma_common_change_m": off_change,
            "volume_fraction": [f for f, _ in packings],
            "sigma_volume_fraction": [both(s, o) for (_, s), o in zip(packings, off_packing)],
            "sigma_common_volume_fraction": off_packing,
        }
    return BedHeight(out)


def both(sigma: float | None, common: float | None) -> float | None:
    """The two in one, None where the value is not known."""
    return None if sigma is None or common is None else hypot(sigma, common)


def by_lens(found: list[BedHeightPx], other: list[Surface]) -> list[float]:
    """Change of the mean height [m] of every picture by one standard uncertainty of k1; zeros where it is exact."""
    return [bed_height(s, 0.0).height - f.height for f, s in zip(found, other)] or [0.0] * len(found)


def surfaces_of(
    image: BedImage, calibration: Calibration | None, p: BedParams
) -> tuple[list[Surface], list[Surface], Array, Camera, list[Surface]]:
    """Of every picture: its surface in pixels, and in metres (x, height above the floor as -row); times [s]; camera.

    Last, the same in metres if k1 were one standard uncertainty larger; empty where it is exact.
    """
    pixels, surfaces, others = [], [], []
    with open_pictures(image) as frames:
        view = view_of(calibration, image, frames.shape)
        other = other_lens(calibration, image, frames.shape)
        rows, columns = frames.shape
        if image.floor_row is not None and not 0 <= image.floor_row < rows:
            raise ValueError(
                f"[bed_image] floor_row = {image.floor_row:g}: outside the picture, whose rows are 0 to {rows - 1}"
            )
        for picture in frames:
            limit = saturation_of(picture, image.saturation)
            s = bed_surface(
                picture.astype(float) ** image.gamma,  # light, up to a factor
                floor_row=image.floor_row,
                method=p.method,
                saturation=None if limit is None else limit**image.gamma,
                threshold=None if p.threshold is None else p.threshold**image.gamma,
            )
            pixels.append(s)
            surfaces.append(in_metres(s, view, image.floor_row, 0.5 * (columns - 1)))
            if other is not None:
                others.append(in_metres(s, other, image.floor_row, 0.5 * (columns - 1)))
        return pixels, surfaces, np.asarray(frames.time, float), view, others


def in_metres(s: Surface, view: Camera, floor_row: float | None, middle: float) -> Surface:
    """A surface in pixels as x and, for the row, minus the height above the floor [m]; middle: column of the floor."""
    # without a floor row the marks' y is counted from the floor
    floor = 0.0 if floor_row is None else float(view.height(middle, floor_row))
    lost = ~np.isfinite(s.row)
    row = np.where(lost, np.nanmedian(s.row) if not lost.all() else 0.0, s.row)
    height = np.where(lost, np.nan, view.height(s.column, row) - floor)
    scale = view.scale
    return Surface(view.across(s.column, row), -height, s.sigma * scale, s.flag, s.common * scale, s.clipped)


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


def fraction_common(phi: float | None, height: float, common: float, section: Bed | None, p: BedParams) -> float | None:
    """The part of a volume fraction's sigma that all pictures of the camera share; common: of the height, both [m].

    Zero where only the change since the series' first picture counts: what both share of a height's error cancels.
    """
    if phi is None:
        return None
    absolute = (section and section.solid_volume is not None) or p.reference_height is not None
    return phi * common / height if absolute else 0.0


def packing_common(section: Bed | None, bed: BedHeight | None) -> float:
    """Relative standard uncertainty of `packing` that all experiments of the bed's camera share; 0 where given."""
    phi, sigma = packing(section, bed)
    if not phi or sigma is None or bed is None or (section and section.volume_fraction is not None):
        return 0.0
    return float(bed.values.get("sigma_common_volume_fraction") or 0.0) / phi


def packing(section: Bed | None, bed: BedHeight | None) -> tuple[float | None, float | None]:
    """(phi, sigma) of an experiment: as given in [bed], else as measured from the picture; None where unknown."""
    if section and section.volume_fraction is not None:
        return section.volume_fraction, 0.0
    if bed and bed.values["volume_fraction"] is not None:
        return bed.values["volume_fraction"], bed.values["sigma_volume_fraction"]
    return None, None
