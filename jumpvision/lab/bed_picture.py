"""The back-lit picture of the bed whose height gives the volume fraction: bright above, dark grains below."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from .sensor import blur, texture

Array = NDArray[np.float64]


def bed_height(volume_fraction: float, *, solid_volume: float, length: float, width: float) -> float:
    """h = V_s / (phi l w) [m]."""
    return solid_volume / (volume_fraction * length * width)


def bed_picture(
    height: float,
    *,
    scale: float,
    floor_row: float,
    shape: tuple[int, int],
    grain_diameter: float,
    rng: np.random.Generator,
) -> tuple[Array, Array]:
    """Noise-free picture (row, column) [grey] and its true surface (column,) [m] above the floor, of mean `height` [m].

    scale [m/px]; floor_row: row of the bed floor; grain_diameter [m] sets the roughness of the surface.
    """
    rows, columns = np.mgrid[: shape[0], : shape[1]].astype(float)
    grain = grain_diameter / scale  # px
    bumps = 0.35 * texture((3, shape[1]), sigma=0.45 * grain, rng=rng)[1]
    swell = 0.25 * texture((3, shape[1]), sigma=25 * grain, rng=rng)[1]
    rough = (bumps + swell) * grain_diameter
    surface = height + rough - rough.mean()
    edge = floor_row - surface / scale

    light = 222.0 - 26.0 * (columns / shape[1] - 0.4) ** 2 - 22.0 * (1.0 - rows / shape[0])
    light += 1.2 * texture(shape, sigma=12.0, rng=rng)
    shine = 24.0 * np.exp(-np.clip(rows - edge, 0.0, None) / grain)  # the topmost grains let a little light through
    grains = 34.0 + 9.0 * texture(shape, sigma=0.35 * grain, rng=rng) + shine
    below = np.clip(rows + 0.5 - edge, 0.0, 1.0)
    picture = light * (1.0 - below) + grains * below
    frame = np.clip(rows + 0.5 - floor_row, 0.0, 1.0)  # the aluminium frame under the bed
    picture = picture * (1.0 - frame) + 92.0 * frame
    return blur(picture, 0.9), surface
