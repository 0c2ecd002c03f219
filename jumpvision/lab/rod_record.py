"""The rod film of a jump as a recording: the file, its sections and its truth, with the faults of the camera."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from . import write
from .jumper import Motion
from .lens import lens_of, seen_places
from .protocol_keys import Camera, RodFilm, chip_of
from .rod_film import exposure_times, rod_film
from .sensor import record

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
) -> tuple[dict[str, Any], dict[str, Any]]:
    """The film, as long as the motion; returns its sections and its truth.

    scale, dt: of the mechanisms camera_scale and time_offset. In the truth, time_s are the stamps (mid-exposure),
    shown_s the times that the frames show, x_px and y_px the places at which the lens shows the ball's centre.
    """
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
        rows, column, radius=radius, shape=shape, brightness=205.0, rng=rng,
        lens=lens, reflection=camera.reflection, shading=camera.shading,
    )  # fmt: skip
    kept = np.flatnonzero((rng.random(n) >= camera.dropped) | (np.arange(n) == 0))
    pixels = record(mean[kept], rng=rng, **chip_of(camera))
    write.movie(folder / film.file, pixels, rate=film.rate, numbers=kept, bits=camera.bits)
    section = {
        "file": film.file,
        "frame_rate": film.rate,
        "scale": film.scale * (1 + camera.scale_error),
        "ball_diameter": film.ball_diameter,
        "exposure": film.exposure,
        "start": 0.0,
    }
    y, x = seen_places(rows[kept].mean(axis=1), column, lens)
    true = {
        "frame": kept,
        "time_s": stamps[kept].mean(axis=1),
        "shown_s": shown[kept].mean(axis=1),
        "rod_m": motion.at("rod", shown[kept].mean(axis=1)),
        "x_px": x,
        "y_px": y,
        "scale_m_px": film.scale,
    }
    return {"rod_video": section}, true
