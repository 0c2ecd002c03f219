"""Bed: height of the grains in the back-lit side view, and the volume fraction that follows from it."""

from __future__ import annotations

from ..params import BedParams
from ..pipeline import stage
from ..records import BedHeight
from ..sections import Bed, BedImage, Calibration, need
from ..vision.surface import bed_height, bed_surface, volume_fraction
from .films import read_picture, warn_uncalibrated


@stage(version=1)
def bed(image: BedImage, section: Bed | None, calibration: Calibration | None, *, p: BedParams) -> BedHeight:
    """Mean height above the floor [m]; volume fraction from the grains' solid volume, or relative to a reference."""
    warn_uncalibrated(calibration, image.name)
    scale, floor = need(image, "scale", "floor_row")
    picture = read_picture(image.path)
    if not 0 <= floor < picture.shape[0]:
        raise ValueError(
            f"[bed_image] floor_row = {floor:g}: outside the picture, whose rows are 0 to {picture.shape[0] - 1}"
        )
    surface = bed_surface(picture, floor_row=floor, method=p.method)
    found = bed_height(surface, floor)
    height, sigma = found.height * scale, found.sigma * scale
    phi, phi_sigma = fraction(height, sigma, section, p)
    return BedHeight(
        {
            "height_m": height, "sigma_m": sigma, "volume_fraction": phi, "sigma_volume_fraction": phi_sigma,
            "tilt_rad": found.tilt, "roughness_m": found.roughness * scale, "columns": found.n,
            "profile": {"column_px": surface.column, "row_px": surface.row, "sigma_px": surface.sigma,
                        "x_m": surface.column * scale, "height_m": (floor - surface.row) * scale},
        }
    )  # fmt: skip


def fraction(height: float, sigma: float, section: Bed | None, p: BedParams) -> tuple[float | None, float | None]:
    """(phi, sigma), or None where neither the solid volume nor a reference is known."""
    if section and section.solid_volume is not None:
        length, width = need(section, "length", "width")
        return volume_fraction(section.solid_volume, length, width, height, sigma)
    if p.reference_height is not None and p.reference_fraction is not None:
        relative = p.reference_fraction * p.reference_height / height
        return relative, relative * sigma / height
    return None, None


def packing(section: Bed | None, bed: BedHeight | None) -> tuple[float | None, float | None]:
    """(phi, sigma) of an experiment: as given in [bed], else as measured from the picture; None where unknown."""
    if section and section.volume_fraction is not None:
        return section.volume_fraction, 0.0
    if bed and bed.values["volume_fraction"] is not None:
        return bed.values["volume_fraction"], bed.values["sigma_volume_fraction"]
    return None, None
