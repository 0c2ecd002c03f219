"""`jv.crater` of a picture: the volume change of a crater in a map of heights, or under a laser line."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from jumpvision.base.parameters import of_keywords
from jumpvision.estimate.crater import line_crater
from jumpvision.estimate.crater_map import map_crater
from jumpvision.films.parameters import CraterParams
from jumpvision.films.vision.laser_line import laser_line
from jumpvision.films.vision.saturation import saturation_of


def crater(
    picture: ArrayLike,
    *,
    scale: float,
    laser_angle: float | None = None,
    axis: Any = None,
    **parameters: Any,
) -> pd.Series:
    """Volume change of a crater, negative where the bed was compacted, from a map of heights or a laser line.

    picture (H, W): heights up [m], NaN where unknown; with laser_angle [rad], of the laser's plane over the ground, a
    grey picture of its line from straight above. scale [m/px]. axis: of the crater, (column, row) of a map [px], column
    of a line; default: found. parameters: those of [params.crater].

    Series: volume_m3, sigma_m3, depth_m, rim_height_m, radius_m. Raises InputError for a parameter, ValueError where
    there is no crater to be seen, with the reason.
    """
    p = of_keywords(CraterParams, parameters, scale=scale, laser_angle=laser_angle)
    image = np.asarray(picture)
    if laser_angle is None:
        at = None if axis is None else (axis[0] * scale, -axis[1] * scale)
        found = map_crater(image.astype(float), scale, axis=at, radius=p.radius)
    else:
        seen = laser_line(image, saturation=saturation_of(image), contrast=p.contrast)
        lost, rise = seen.flag != "", scale / math.sin(laser_angle)
        if lost.all():
            raise ValueError(f"crater: {seen.flag[0]}; a bright line on a darker bed is needed")
        height = np.where(lost, np.nan, -seen.row * rise)
        middle = None if axis is None else float(axis) * scale
        found = line_crater(seen.column * scale, height, seen.sigma * rise, axis=middle, radius=p.radius)
    if found.reason:
        raise ValueError(f"crater: {found.reason}")
    values = (found.volume, found.sigma, found.depth, found.rim_height, found.radius)
    return pd.Series(dict(zip(("volume_m3", "sigma_m3", "depth_m", "rim_height_m", "radius_m"), values)), dtype=float)
