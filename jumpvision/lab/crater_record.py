"""The crater under a laser line as a recording: the picture, its section and its truth."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np

from . import write
from .crater_picture import crater_profile, laser_picture
from .protocol_keys import CraterImage
from .sensor import record, texture

RIM = 0.3  # width of the rim over the foot's radius
BESIDE = 3.5  # foot radii from the axis to the picture's edges: the undisturbed surface begins at about 2.5


def write_crater(
    folder: Path,
    volume: float,
    picture: CraterImage,
    rng: np.random.Generator,
    *,
    foot_radius: float,
    size: float,
    grain_diameter: float,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """crater.png of a bowl as wide as the foot, with a rim that makes the volume change `volume` [m^3].

    foot_radius [m] of this foot, `size` times the robot's: the bowl's depth goes with it. The truth's volume is that
    of the crater before its halves were made uneven and its surface rough.
    """
    columns = 2 * math.ceil(BESIDE * foot_radius / picture.scale)
    axis = 0.5 * (columns - 1) + rng.uniform(-0.1, 0.1) * foot_radius / picture.scale
    x = (np.arange(columns) - axis) * picture.scale
    depth = picture.depth * size
    shape = {"depth": depth, "radius": foot_radius, "rim_width": RIM * foot_radius}
    _, bowl = crater_profile(np.zeros(1), rim_height=0.0, **shape)
    _, per_metre = crater_profile(np.zeros(1), rim_height=1.0, **shape)
    rim = (volume - bowl) / (per_metre - bowl)  # the volume is linear in the rim's height
    h, _ = crater_profile(np.abs(x), rim_height=rim, **shape)
    true = {"volume_m3": volume, "depth_m": -h.min(), "rim_height_m": h.max(), "axis_column_px": axis}
    if picture.uneven:
        h = h * np.where(x < 0, *(1.0 + rng.normal(0.0, picture.uneven, 2)))
    h = h + picture.roughness * texture((3, columns), sigma=0.5 * grain_diameter / picture.scale + 0.3, rng=rng)[1]
    rise = h / picture.scale * math.sin(picture.laser_angle)
    above = math.ceil(float(rise.max())) + 30
    line = above - rise
    rows = math.ceil(float(line.max())) + 30
    mean = laser_picture(
        line, rows=rows, width=np.full(columns, picture.line_width), peak=np.full(columns, 170.0),
        background=np.full((rows, columns), 20.0), speckle=picture.speckle, speckle_size=1.5, rng=rng,
    )  # fmt: skip
    write.picture(folder / "crater.png", record(mean, electrons_per_grey=60.0, read_noise=1.5, rng=rng))
    section = {"file": "crater.png", "scale": picture.scale, "laser_angle": picture.laser_angle}
    return {"crater_image": section}, true
