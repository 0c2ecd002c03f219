"""A grain film of simulated discs as a recording: the file, its section and the truth of the discs' own motion.

The discs come from outside: the laboratory draws them, and shares nothing with the analysis. Their numbers here use
neither a grid of vectors nor the momentum code: the field is that of the nearest disc on a fine raster, with the
displacement between two frames as its velocity.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import write
from .dem_film import DiscCamera
from .grain_film import View
from .grain_record import GRAIN_RATE, Clock, Glass, middle, start_of
from .jumper import Motion
from .protocol_keys import GrainCamera, GrainFilm, chip_of
from .sensor import record_bright

Array = NDArray[np.float64]
# (t, foot_y, times, *, half_width, bed, diameter, fraction, rng, deepest) -> (discs with .radius, motion with .x, .y)
Runner = Callable[..., tuple[Any, Any]]

EXPOSURE, INSTANTS = 2e-4, 3  # s, drawn in an exposure
SURFACE_ROW = 20.0
FOOT_HEIGHT = 0.012  # m
BED = 1.12  # the bed is so much larger than the picture


def write_disc_film(
    folder: Path,
    motion: Motion,
    bed_density: float,
    rng: np.random.Generator,
    runner: Runner,
    *,
    radius: float,
    diameter: float,
    film: GrainFilm,
    camera: GrainCamera,
) -> tuple[dict[str, Any], float, dict[str, Any]]:
    """grains.mkv around the first landing: its section, the foot's depth in frame 0 [m], its truth.

    bed_density: phi rho [kg/m^3] of the momentum; radius of the foot, mean diameter of the discs [m].
    """
    shape = (film.rows, film.columns)
    view = View(shape, film.scale, SURFACE_ROW, 0.5 * (shape[1] - 1))
    glass = Glass(view, camera)
    clock = Clock(start_of(motion), film.frames, camera, rng)
    instants = clock.shown[:, None] + (np.arange(INSTANTS) + 0.5) / INSTANTS * EXPOSURE
    begin = float(instants[0, 0]) - 1e-3
    extent = max(BED * 0.5 * glass.wide.shape[1] * film.scale, 1.5 * radius)
    discs, m = runner(
        motion.t, motion.foot, np.concatenate([[begin], instants.ravel()]), half_width=radius,
        bed=(extent, BED * glass.wide.shape[0] * film.scale), diameter=diameter, fraction=film.area_fraction, rng=rng,
        deepest=float(motion.foot[motion.t <= begin].min()),
    )  # fmt: skip
    x, y = (a[1:].reshape(len(instants), INSTANTS, -1) for a in (m.x, m.y))
    face = motion.at("foot", instants)
    draw = DiscCamera(
        glass.wide.shape, discs.radius, scale=film.scale, surface_row=glass.wide.surface_row,
        axis_column=glass.wide.axis_column, half_width=radius, height=FOOT_HEIGHT, glare=0.0, rng=rng,
    )  # fmt: skip
    frames = np.stack([record_bright(glass(draw.frame(*at)), rng=rng, **chip_of(camera)) for at in zip(x, y, face)])
    write.movie(folder / "grains.mkv", frames, rate=GRAIN_RATE, numbers=clock.number, bits=camera.bits)

    k = INSTANTS // 2
    depth_0 = -float(face[0, k])
    section = {"file": "grains.mkv", "frame_rate": GRAIN_RATE, **glass.section(-depth_0, camera.scale_error),
               "foot": "half", "start": start_of(motion)}  # fmt: skip
    time, shown = clock.stamp + 0.5 * EXPOSURE, clock.shown + 0.5 * EXPOSURE
    height, speed = face[:, k], -np.diff(face[:, k]) / np.diff(shown)
    momentum = disc_momentum(view, shown, x[:, k], y[:, k], height, diameter=diameter, bed_density=bed_density)
    with np.errstate(divide="ignore", invalid="ignore"):
        mass = np.where(speed > 0.05, momentum / speed, 0.0)
    true = {
        "conventions": "foot_speed is downward, the mean between two frames; momentum in view is that of a half foot "
        "(pi r dr dh) at the constant density phi rho, from the nearest disc's displacement; added mass is momentum "
        "over foot_speed, 0 below 0.05 m/s",
        "discs": len(discs.radius),
        "exposure_s": EXPOSURE,
        "frames": {"time_s": time, "foot_row_px": view.row(height), "foot_depth_m": -height} | clock.extra,
        "pairs": {
            "time_s": middle(time), "foot_depth_m": -middle(height), "foot_speed_m_s": speed,
            "momentum_in_view_kg_m_s": momentum, "added_mass_in_view_kg": mass,
        },
    }  # fmt: skip
    return section, depth_0, true


def disc_momentum(
    view: View, t: Array, x: Array, y: Array, face: Array, *, diameter: float, bed_density: float
) -> Array:
    """Downward momentum [kg m/s] of each pair of frames in view below the foot's face, (n - 1,), mean of both halves.

    x, y (n, disc) [m], face (n,) [m] at the times t (n,) [s].
    """
    from scipy.spatial import cKDTree

    left, right = (-0.5 - view.axis_column) * view.scale, (view.shape[1] - 0.5 - view.axis_column) * view.scale
    bottom = -(view.shape[0] - 0.5 - view.surface_row) * view.scale
    step = 0.25 * diameter
    gx = np.arange(left + 0.5 * step, right, step)
    out = []
    for k in range(len(t) - 1):
        speed = -(y[k + 1] - y[k]) / (t[k + 1] - t[k])
        top = 0.5 * (face[k] + face[k + 1])
        n = math.ceil((top - bottom) / step)
        gy = bottom + (np.arange(n) + 0.5) * (top - bottom) / n
        places = np.stack(np.meshgrid(gx, gy), axis=-1).reshape(-1, 2)
        near = cKDTree(0.5 * np.stack([x[k] + x[k + 1], y[k] + y[k + 1]], axis=1)).query(places)[1]
        cell = step * (top - bottom) / n
        out.append(0.5 * math.pi * bed_density * float(np.sum(speed[near] * np.abs(places[:, 0])) * cell))
    return np.array(out)
