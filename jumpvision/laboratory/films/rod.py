"""The film of the white ball on the rod as a 200 fps camera sees it, as a recording with truth and camera faults."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numba as nb
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.laboratory import write
from jumpvision.laboratory.jumper import Motion
from jumpvision.laboratory.protocol import RodFilm
from jumpvision.laboratory.write import Recording, Table

from .optics import NO_LENS, Camera, Lens, blur, exposed, lens_of, seen_place, seen_places, shade, texture, true_place

_STEP = 1 / 256  # px, spacing of the tabulated profile
_EXPOSURE_POINTS = 9
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(4)  # over a pixel: exact to 1e-6 for a lens blur >= 0.5 px


def balls(
    rows: Array,
    column: float,
    *,
    radius: float,
    shape: tuple[int, int],
    blur_px: float,
    limb: float,
    side_light: float,
    lens: Lens = NO_LENS,
) -> Array:
    """Coverage times shading of the ball, shape (frame, row, column); 1 inside an unshaded ball.

    rows: (frame, sub-exposure) rows of the centre [px], averaged over sub-exposures: the streak of a moving ball.
    column, radius [px]. blur_px: spread of the lens blur [px]. limb: how much darker the ball's edge is than its
    middle; side_light: relative brightness change from the middle to the upper edge. lens: rows, column and radius are
    then those an undistorted picture would have.
    """
    reach = radius + 6 * blur_px
    table = _disc_profile(radius, blur_px, math.ceil(reach / _STEP) + 2)
    return _draw(rows, column, shape[0], shape[1], table, reach, radius, limb, side_light, lens)


@nb.njit(cache=True)
def _disc_profile(radius, sigma, n):  # type: ignore[no-untyped-def]
    """A disc blurred by a Gaussian, against distance from its centre: erf across, sum over x = radius sin(angle)."""
    m = 600
    out = np.empty(n)
    step = math.pi / m
    for i in range(n):
        rho = i * _STEP
        total = 0.0
        for j in range(1, m):
            angle = j * step - 0.5 * math.pi
            chord = radius * math.cos(angle)
            u = radius * math.sin(angle)
            total += chord * math.exp(-0.5 * ((u - rho) / sigma) ** 2) * math.erf(chord / (sigma * math.sqrt(2.0)))
        out[i] = total * step / (sigma * math.sqrt(2.0 * math.pi))
    return out


@nb.njit(cache=True)
def _draw(rows, column, height, width, table, reach, radius, limb, side_light, lens):  # type: ignore[no-untyped-def]
    n, subs = rows.shape
    out = np.zeros((n, height, width))
    k = len(_NODES)
    for f in range(n):
        for s in range(subs):
            seen_row, seen_column, more = rows[f, s], column, reach
            if lens.k1 != 0.0 or lens.k2 != 0.0:
                seen_row, seen_column = seen_place(rows[f, s], column, lens)
                more = 1.2 * reach + 1.0
            for i in range(max(int(seen_row - more), 0), min(int(seen_row + more) + 2, height)):
                for j in range(max(int(seen_column - more), 0), min(int(seen_column + more) + 2, width)):
                    total = 0.0
                    for a in range(k):
                        dy = i + 0.5 * _NODES[a] - rows[f, s]
                        for b in range(k):
                            dx = j + 0.5 * _NODES[b] - column
                            if lens.k1 != 0.0 or lens.k2 != 0.0:
                                y, x = true_place(i + 0.5 * _NODES[a], j + 0.5 * _NODES[b], lens)
                                dy, dx = y - rows[f, s], x - column
                            rho = math.sqrt(dx * dx + dy * dy)
                            if rho < reach:
                                q = rho / _STEP
                                m = int(q)
                                value = table[m] + (q - m) * (table[m + 1] - table[m])
                                value *= 1.0 - limb * (rho / radius) ** 2 - side_light * dy / radius
                                total += 0.25 * _WEIGHTS[a] * _WEIGHTS[b] * value
                    out[f, i, j] += total / subs
    return out


def exposure_times(start: float, rate: float, exposure: float, n: int) -> Array:
    """Times inside the exposures of n frames, shape (n, sub-exposure) [s]: midpoints of equal parts."""
    inside = (np.arange(_EXPOSURE_POINTS) + 0.5) / _EXPOSURE_POINTS * exposure
    return np.asarray(start + np.arange(n)[:, None] / rate + inside)


def scene(shape: tuple[int, int], *, streak_column: float, rng: np.random.Generator) -> Array:
    """The still background, shape (row, column) [grey]: dark cloth, and the dim reflection of the rod."""
    rows, columns = np.mgrid[: shape[0], : shape[1]].astype(float)
    cloth = 13.0 + 1.5 * texture(shape, sigma=3.0, rng=rng) + 3.0 * rows / shape[0]
    waves = 1.0 + 0.25 * texture(shape, sigma=9.0, rng=rng)[:, :1]
    streak = 16.0 * waves * np.exp(-0.5 * ((columns - streak_column) / 1.3) ** 2)
    return np.clip(cloth + blur(streak, 0.8), 0.0, None)


def rod_film(
    rows: Array,
    column: float,
    *,
    radius: float,
    shape: tuple[int, int],
    brightness: float,
    rng: np.random.Generator,
    lens: Lens = NO_LENS,
    reflection: float = 0.0,
    shading: float = 0.0,
) -> Array:
    """Noise-free film, shape (frame, row, column) [grey]; rows (frame, sub-exposure) [px] as in `balls`.

    reflection: grey of highlights on the rod, below the ball, that move with it; shading: how much darker the corners
    of the picture are than its middle.
    """
    back = scene(shape, streak_column=column + 1.7 * radius, rng=rng)
    film = back
    if reflection:
        film = back + reflection * _highlights(rows.mean(axis=1), column, radius, shape, rng)
    disc = partial(balls, rows, column, radius=radius, shape=shape, blur_px=0.7, lens=lens)
    shaded = disc(limb=0.15, side_light=0.04)
    cover = disc(limb=0.0, side_light=0.0)
    film = film * (1.0 - cover) + brightness * shaded
    if shading:
        film *= shade(shape, shading)
    return np.asarray(film)


def _highlights(rows: Array, column: float, radius: float, shape: tuple[int, int], rng: np.random.Generator) -> Array:
    """Glints along the rod from below the ball on, shape (frame, row, column), 0..1, carried by the rod."""
    length = int(shape[0] + np.ptp(rows)) + 4
    along = np.clip(texture((3, length), sigma=4.0, rng=rng)[1], 0.0, 3.0) / 3.0
    across = np.exp(-0.5 * ((np.arange(shape[1]) - column - 0.3 * radius) / 1.1) ** 2)
    below = np.arange(shape[0]) - rows[:, None] - 1.2 * radius
    glints = np.interp(below, np.arange(length), along, left=0.0) * np.clip(below, 0.0, 1.0)
    return np.asarray(glints[:, :, None] * across)


@dataclass(frozen=True, kw_only=True)
class RodFilmTruth:
    """What is true of the frames (n,): their numbers, their stamps (mid-exposure) [s] and the times that they show [s],
    the rod's height [m], where the lens shows the ball's centre [px]; metres per pixel."""

    frame: NDArray[np.int64] | None = None
    time_s: Array
    shown_s: Array | None = None
    rod_m: Array
    x_px: Array | float
    y_px: Array
    scale_m_px: float | None = None


MARGIN = 1.8  # ball radii between the ball's centre and the picture's edges


def write_rod_film(
    folder: Path,
    motion: Motion,
    film: RodFilm,
    camera: Camera,
    rng: np.random.Generator,
    *,
    scale: float = 1.0,
    dt: float = 0.0,
) -> Recording:
    """The film, as long as the motion. scale, dt: of the mechanisms camera_scale and time_offset."""
    n = int((motion.t[-1] - film.exposure) * film.rate)
    stamps = exposure_times(0.0, film.rate, film.exposure, n)
    shown = stamps + dt + camera.clock_offset + camera.clock_drift * stamps
    radius = 0.5 * film.ball_diameter / film.scale
    up = scale * (motion.at("rod", shown) - motion.rest) / film.scale
    top = float(up.max()) + MARGIN * radius
    shape = (2 * int(0.5 * (top - float(up.min()) + MARGIN * radius)) + 2, film.columns)
    rows, column = top - up, 0.42 * shape[1] + 0.17
    lens = lens_of(camera.k1, camera.k2, shape)
    mean = rod_film(
        rows,
        column,
        radius=radius,
        shape=shape,
        brightness=205.0,
        rng=rng,
        lens=lens,
        reflection=camera.reflection,
        shading=camera.shading,
    )
    kept = np.flatnonzero((rng.random(n) >= camera.dropped) | (np.arange(n) == 0))
    pixels = exposed(mean[kept], camera, rng)
    write.movie(folder / film.file, pixels, rate=film.rate, numbers=kept, bits=camera.bits)
    section: Table = {
        "file": film.file,
        "frame_rate": film.rate,
        "scale": film.scale * (1 + camera.scale_error),
        "ball_diameter": film.ball_diameter,
        "exposure": film.exposure,
        "start": 0.0,
    }
    y, x = seen_places(rows[kept].mean(axis=1), column, lens)
    true = RodFilmTruth(
        frame=kept,
        time_s=stamps[kept].mean(axis=1),
        shown_s=shown[kept].mean(axis=1),
        rod_m=motion.at("rod", shown[kept].mean(axis=1)),
        x_px=x,
        y_px=y,
        scale_m_px=film.scale,
    )
    return Recording({"rod_video": section}, {"film": true})
