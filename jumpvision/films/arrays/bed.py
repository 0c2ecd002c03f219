"""`jv.bed` of pictures: a table of the height of a bed in each."""

from __future__ import annotations

import os
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from jumpvision.base.parameters import of_keywords
from jumpvision.base.schema import InputError
from jumpvision.films.parameters import BedParams
from jumpvision.films.vision.saturation import saturation_of
from jumpvision.films.vision.surface import bed_height, bed_surface

from .images import grey_images, is_path, only_numbers, scale_problem


def bed(
    pictures: ArrayLike | str | os.PathLike[str],
    *,
    floor_row: float,
    scale: float | None = None,
    saturation: float | None = None,
    **parameters: Any,
) -> pd.DataFrame:
    """Height of a bed above its floor in a back-lit picture (H, W), or in each of several (n, H, W): a row a picture.
    Or the path of one, or several paths.

    floor_row: of the floor [px, down]. scale [m/px]: heights are in m with it, in px without. saturation: pixel value
    of saturated light; default: the greatest of whole numbers,
    or where values pile up below it. parameters: those of [params.bed] but the reference.

    Columns: height, sigma, roughness (px or m, in their names), tilt_rad (positive where it rises to the right),
    columns: how many were used; NaN where fewer than 8 show a surface. Raises InputError for a parameter, ValueError
    for pictures that are not grey.
    """
    if problem := scale_problem("jv.bed", scale):
        raise InputError([problem])
    p = of_keywords(BedParams, parameters, folder=("reference_height", "reference_fraction"))
    given: Any = [pictures] if is_path(pictures) else pictures
    if not is_path(next(iter(given), None)):
        given = pictures if np.ma.isMaskedArray(pictures) else np.asarray(pictures)
        given = given[None] if given.ndim == 2 else given
    images = only_numbers("bed", grey_images("bed", given))
    unit, size = ("px", 1.0) if scale is None else ("m", scale)
    rows = []
    for picture in images:
        s = bed_surface(
            picture.astype(float),
            floor_row=floor_row,
            method=p.method,
            saturation=saturation_of(picture, saturation),
            threshold=p.threshold,
        )
        h = bed_height(s, floor_row)
        rows.append((h.height * size, h.sigma * size, h.roughness * size, h.tilt, h.n))
    return pd.DataFrame(rows, columns=[f"height_{unit}", f"sigma_{unit}", f"roughness_{unit}", "tilt_rad", "columns"])
