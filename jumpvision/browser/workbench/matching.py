"""One picture of the bed or of a crater, read as its stage does; and what its stage makes of it."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from math import hypot

import numpy as np

from jumpvision.base.record import plain
from jumpvision.base.schema import StageWarning
from jumpvision.experiment.inputs.sections import Bed, BedImage, Calibration, CraterImage
from jumpvision.experiment.stages.bed.crater import from_line
from jumpvision.experiment.stages.bed.height import bed
from jumpvision.films.frames import FrameError
from jumpvision.films.parameters import BedParams, CraterParams
from jumpvision.films.vision.laser_line import laser_line
from jumpvision.films.vision.saturation import saturation_of
from jumpvision.films.vision.surface import bed_surface, otsu


@dataclass(frozen=True)
class BedLine:
    """The surface in a picture: row [px] by column, None where it is lost, and why. levels: darkest and brightest grey,
    threshold: in use, or Otsu's. height [m] and phi: of the stage, each with its sigma; lacks: why there are none."""

    row: list[float | None]
    lost: int
    why: str
    levels: tuple[float, float]
    threshold: float
    height: tuple[float, float] | None
    phi: tuple[float, float] | None
    lacks: str


def bed_line(
    image: BedImage, section: Bed | None, calibration: Calibration | None, p: BedParams, picture: np.ndarray
) -> BedLine:
    """The surface that the bed stage finds in this picture (rows, columns), and what it makes of [bed_image]."""
    limit, light = saturation_of(picture, image.saturation), picture.astype(float) ** image.gamma
    s = bed_surface(
        light,
        floor_row=image.floor_row,
        method=p.method,
        saturation=None if limit is None else limit**image.gamma,
        threshold=None if p.threshold is None else p.threshold**image.gamma,
    )
    height, phi, lacks = None, None, ""
    try:
        with warnings.catch_warnings(action="ignore", category=StageWarning):
            found = bed(image, section, calibration, p=p).values
        height = found["height_m"], found["sigma_m"]
        if found["volume_fraction"] is not None and found["sigma_volume_fraction"] is not None:
            phi = found["volume_fraction"], found["sigma_volume_fraction"]
    except (ValueError, FrameError) as e:
        lacks = str(e)
    level = p.threshold if p.threshold is not None else otsu(light, image.floor_row) ** (1.0 / image.gamma)
    return BedLine(
        row=plain(np.round(s.row, 2)),
        lost=int(np.count_nonzero(s.flag != "")),
        why=_why(s.flag),
        levels=(float(np.nanmin(picture)), float(np.nanmax(picture))),
        threshold=level,
        height=height,
        phi=phi,
        lacks=lacks,
    )


@dataclass(frozen=True)
class CraterLine:
    """The laser line in a picture, as `BedLine` has the surface; contrast: in use. volume [m^3], negative
    where the bed was compacted, depth, radius [m]: of the stage; lacks: why there are none."""

    row: list[float | None]
    lost: int
    why: str
    contrast: float
    volume: tuple[float, float] | None
    depth: float | None
    radius: float | None
    lacks: str


def crater_line(
    image: CraterImage, calibration: Calibration | None, p: CraterParams, picture: np.ndarray
) -> CraterLine:
    """The line that the crater's stage finds in this picture (rows, columns), and what it makes of [crater_image]."""
    s = laser_line(picture, saturation=saturation_of(picture, image.saturation), contrast=p.contrast)
    volume, depth, radius, lacks = None, None, None, ""
    try:
        with warnings.catch_warnings(action="ignore", category=StageWarning):
            found, share, _ = from_line(image, calibration, p)
        lacks = found.reason
        if not found.reason:
            volume, depth, radius = (found.volume, hypot(found.sigma, share * found.volume)), found.depth, found.radius
    except (ValueError, FrameError) as e:
        lacks = str(e)
    lost = int(np.count_nonzero(s.flag != ""))
    return CraterLine(plain(np.round(s.row, 2)), lost, _why(s.flag), p.contrast, volume, depth, radius, lacks)


def _why(flag: np.ndarray) -> str:
    return "; ".join(sorted({str(f) for f in flag if f}))
