"""One picture of the bed, read as its stage does."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jumpvision.base.record import plain
from jumpvision.experiment.inputs.sections import BedImage
from jumpvision.films.parameters import BedParams
from jumpvision.films.vision.saturation import saturation_of
from jumpvision.films.vision.surface import bed_surface


@dataclass(frozen=True)
class BedLine:
    """The surface in a picture: row [px] by column, None where it is lost, and why."""

    row: list[float | None]
    lost: int
    why: str


def bed_line(image: BedImage, p: BedParams, picture: np.ndarray) -> BedLine:
    """The surface that the bed stage finds in this picture (rows, columns)."""
    limit = saturation_of(picture, image.saturation)
    s = bed_surface(
        picture.astype(float) ** image.gamma,
        floor_row=image.floor_row,
        method=p.method,
        saturation=None if limit is None else limit**image.gamma,
    )
    why = sorted({str(f) for f in s.flag if f})
    return BedLine(plain(np.round(s.row, 2)), int(np.count_nonzero(s.flag != "")), "; ".join(why))
