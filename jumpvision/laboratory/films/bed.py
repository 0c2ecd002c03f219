"""Pictures of the bed: back-lit from the side for its height, and a laser line over a crater."""

from __future__ import annotations

import math

import numpy as np

from jumpvision.base.arrays import Array

from .optics import blur, texture


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


FINE = 4  # sub-samples of a pixel in each direction


def crater_profile(
    r: Array, *, depth: float, radius: float, rim_height: float, rim_width: float
) -> tuple[Array, float]:
    """(height [m] at distances r [m] from the axis, volume change [m^3]) of a Gaussian bowl with a Gaussian rim.

    h = -depth exp(-(r/radius)^2) + rim_height exp(-((r - 1.6 radius)/rim_width)^2), cut where both have died away;
    the volume is 2 pi int h r dr, in closed form for a rim far from the axis.
    """
    centre = 1.6 * radius
    h = -depth * np.exp(-((r / radius) ** 2)) + rim_height * np.exp(-(((r - centre) / rim_width) ** 2))
    a = centre / rim_width  # int_0^inf exp(-((r - c)/w)^2) r dr = w^2 [exp(-a^2) + a sqrt(pi) (1 + erf a)]/2
    rim = rim_height * rim_width**2 * (math.exp(-a * a) + a * math.sqrt(math.pi) * (1.0 + math.erf(a))) / 2.0
    return h, 2.0 * math.pi * (rim - depth * radius**2 / 2.0)


def laser_picture(
    line: Array,
    *,
    rows: int,
    width: Array,
    peak: Array,
    background: Array,
    speckle: float,
    speckle_size: float,
    rng: np.random.Generator,
) -> Array:
    """Noise-free grey values (rows, columns) of a line whose true row is line(column) [px], pixel centres at integers.

    width, peak, background: over the columns: standard deviation of the line across itself [px], grey level of its
    crest, grey level beside it (peak 0 is a gap). speckle: contrast (spread over mean) of the light on a point of the
    surface, its grains speckle_size [px] wide; every pixel is the mean of FINE x FINE points.
    """
    columns = line.size
    x = (np.arange(columns * FINE) + 0.5) / FINE - 0.5
    y = (np.arange(rows * FINE) + 0.5) / FINE - 0.5
    at, sigma, crest = (np.interp(x, np.arange(columns), a) for a in (line, width, peak))
    crest = np.where(np.repeat(peak, FINE) > 0.0, crest, 0.0)
    light = crest * np.exp(-0.5 * ((y[:, None] - at) / sigma) ** 2)
    if speckle > 0.0:
        field = blur(rng.normal(size=(2, rows * FINE, columns * FINE)), 0.5 * speckle_size * FINE)
        pattern = (field**2).sum(axis=0)  # a fully developed speckle pattern has contrast 1
        light *= 1.0 + speckle * (pattern / pattern.mean() - 1.0)
    return light.reshape(rows, FINE, columns, FINE).mean(axis=(1, 3)) + background
