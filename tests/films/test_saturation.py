"""Clipped light is seen wherever the camera clips: at the top of its numbers, of its bits, of video, or below.

Truth: a bed's edge drawn by an error function, its light beyond what the camera can hold, with noise.
"""

from __future__ import annotations

import numpy as np
import pytest
import scipy

from jumpvision.films.vision.saturation import saturation_of
from jumpvision.films.vision.surface import bed_surface

EDGE = 60.3  # px, row of the surface


def back_lit(rng, *, white, clip, noise=0.01):
    """Bright above the edge (white), dark below, blurred by 1.2 px; clipped at `clip`, in whole numbers."""
    row = np.arange(120)[:, None] + np.zeros(160)
    edge = EDGE + 0.02 * (np.arange(160) - 79.5)  # a bed is never level with the rows
    light = 0.1 * white + 0.9 * white * scipy.special.ndtr(-(row - edge) / 1.2)
    return np.rint(np.clip(light * (1.0 + rng.normal(0.0, noise, row.shape)), 0.0, clip))


@pytest.mark.parametrize(
    ("kind", "clip", "factor"),
    [(np.uint8, 255, 1), (np.uint16, 4095, 1), (np.uint16, 1023, 1), (np.uint8, 235, 1), (np.uint16, 4095, 16)],
    ids=["8 bits", "12 bits", "10 bits", "video", "12 bits kept times 16"],
)
def test_the_level_of_clipping_is_found(kind, clip, factor):
    picture = (back_lit(np.random.default_rng(1), white=1.08 * clip, clip=clip) * factor).astype(kind)
    assert saturation_of(picture) == clip * factor
    surface = bed_surface(picture.astype(float), floor_row=110.0, method="edge", saturation=saturation_of(picture))
    assert surface.clipped > 0.9 * 160
    good = surface.flag == ""
    off = surface.row[good] - EDGE - 0.02 * (surface.column[good] - 79.5)
    assert good.mean() > 0.9 and abs(float(off.mean())) < 0.1  # px; 0.42 to 0.52 off where clipping was not seen


def test_light_that_is_not_clipped_has_no_pile():
    """A steady, an uneven and a flickering back-light below the top: the greatest values are the rarest."""
    for seed in range(8):
        rng = np.random.default_rng(seed)
        light = back_lit(rng, white=rng.uniform(0.3, 0.9) * 4000.0, clip=1e9, noise=rng.uniform(0.003, 0.05))
        light *= 1.0 + rng.uniform(0.0, 0.3) * np.linspace(-1.0, 1.0, 160) ** 2
        assert saturation_of(np.rint(light).astype(np.uint16)) == 65535.0
        assert saturation_of(np.rint(light / 20.0).astype(np.uint8)) == 255.0


def test_a_stated_level_is_taken_and_decimals_have_none():
    picture = back_lit(np.random.default_rng(2), white=300.0, clip=255)
    assert saturation_of(picture.astype(np.uint8), 250.0) == 250.0
    assert saturation_of(picture) is None
