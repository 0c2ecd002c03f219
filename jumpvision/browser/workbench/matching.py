"""One picture of the bed, read as its stage does; and the packing that its stage makes of it."""

from __future__ import annotations

import warnings
from dataclasses import dataclass

import numpy as np

from jumpvision.base.record import plain
from jumpvision.base.schema import StageWarning
from jumpvision.experiment.inputs.sections import Bed, BedImage, Calibration
from jumpvision.experiment.stages.bed.height import bed
from jumpvision.films.frames import FrameError
from jumpvision.films.parameters import BedParams
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
        why="; ".join(sorted({str(f) for f in s.flag if f})),
        levels=(float(np.nanmin(picture)), float(np.nanmax(picture))),
        threshold=level,
        height=height,
        phi=phi,
        lacks=lacks,
    )
