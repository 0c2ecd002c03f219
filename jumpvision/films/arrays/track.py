"""`jv.track` of images: a table of each body that a stack shows, and of their centre of mass."""

from __future__ import annotations

import cmath
import math
import os
import warnings
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array, Image
from jumpvision.base.parameters import of_keywords
from jumpvision.base.schema import InputError, StageWarning
from jumpvision.estimate.height import exposure_shift, shift_noise, shift_sigma
from jumpvision.films.frames import Film
from jumpvision.films.parameters import TrackParams
from jumpvision.films.vision.ball.film import track_film
from jumpvision.films.vision.ball.track import BallSettings, BallTrack
from jumpvision.films.vision.interlaced import INTERLACED, is_interlaced
from jumpvision.films.vision.repeats import Repeats, Seen, without_repeats
from jumpvision.films.vision.scene import scene_shift

from .images import film_at, grey_images, in_grey, only_numbers, scale_problem
from .motion import with_derivatives


def track(
    frames: Iterable[ArrayLike] | str | os.PathLike[str],
    *,
    frame_rate: float | None = None,
    scale: float | None = None,
    exposure: float = 0.0,
    origin: tuple[float, float] | None = None,
    angle: float = 0.0,
    masses: tuple[float, ...] = (),
    window: int = 7,
    **parameters: Any,
) -> pd.DataFrame:
    """A ball in every one of the frames (n, H, W), an array, a sequence of grey images or a film's path: a row a frame.

    frame_rate [1/s]: default the film's own, of arrays one frame a second. scale [m/px]. exposure [s]: positions are
    then those at mid-exposure. origin: (column, row) [px] of the axes' origin; angle [rad] of the x axis, counter-
    clockwise from the picture's row. masses [kg]: of the ball and of those at `markers`, for their centre of mass.
    window: frames of the parabola from which speed and acceleration are taken; fewer where the acceleration changes
    within them. parameters: those of [params.track], such as diameter=12 [px], polarity="dark", seed=(column, row),
    markers=[(column, row)].

    Columns: body (with markers: from 1; 0 is the centre of mass), frame, time_s, x_px right, y_px down, sigma_px (of
    either); with a scale, an origin or an angle x, y up and sigma in the axes; vx, vy, v_sigma, ax, ay, a_sigma; the
    unit is in the names, m with a scale, else px, and y is down only where no axes are given. shift_x, shift_y,
    shift_sigma [px]: what the exposure added and was taken out, NaN beside a gap. flag: "" or why the ball is lost (all
    else is NaN then). Raises InputError for a parameter, ValueError for what is no stack of grey images.
    """
    if problem := scale_problem("jv.track", scale):
        raise InputError([problem])
    p = of_keywords(TrackParams, parameters, folder=("exposure_correction",), frame_rate=frame_rate or 1.0)
    film = film_at(frames, frame_rate) if isinstance(frames, str | os.PathLike) else None
    images: Film | Sequence[Image]
    if film is not None and film.dtype.kind == "u":
        images = film  # one frame at a time
    else:
        images = in_grey(only_numbers("track", grey_images("track", film or frames)))
    if not frame_rate:
        frame_rate = film.rate if film else 1.0
    if not images:
        raise ValueError("track: no frame: give grey images (H, W), one or more in a stack")
    _check(p, exposure, frame_rate, origin, angle, masses, window)
    seed = (p.seed[0], p.seed[1]) if p.seed else None
    settings = BallSettings(p.diameter, p.polarity, p.method, p.search, seed, exposure > 0.0, exposure * frame_rate)
    markers = [(m[0], m[1]) for m in p.markers]
    repeats = Repeats()
    found = track_film(Seen(images, repeats), settings, scene=p.background == "static", markers=markers)
    found, said = without_repeats(found, repeats)
    if said:
        warnings.warn(StageWarning("reading", said), stacklevel=2)
    if is_interlaced(images):
        warnings.warn(StageWarning("frames", INTERLACED), stacklevel=2)
    if said := scene_shift(images):
        warnings.warn(StageWarning("place", said), stacklevel=2)
    for number, ball in enumerate(found, 1):
        for note in ball.notes:
            warnings.warn(StageWarning("frames", f"ball {number}: {note}" if markers else note), stacklevel=2)
    begun = film.time - film.time[0] if film else np.arange(len(images)) / frame_rate
    time = begun + exposure / 2.0
    bodies = [_in_pixels(ball, time, exposure) for ball in found]
    if masses:
        bodies.insert(0, _centre_of_mass(bodies, np.asarray(masses, float)))
    tables = [_moving(body, scale, origin, angle, window) for body in bodies]
    if not markers:
        return tables[0]
    first = 0 if masses else 1
    return pd.concat([t.assign(body=k) for k, t in enumerate(tables, first)], ignore_index=True)[
        ["body", *tables[0].columns]
    ]


def _check(
    p: TrackParams,
    exposure: float,
    rate: float,
    origin: tuple[float, float] | None,
    angle: float,
    masses: tuple[float, ...],
    window: int,
) -> None:
    problems = []
    if window < 3:
        problems.append(f"jv.track window = {window}: must be >= 3 frames")
    if not 0.0 <= exposure * rate <= 1.0:
        problems.append(f"jv.track exposure = {exposure!r}: must be 0 to one frame ({1.0 / rate:g} s)")
    if origin is not None and (len(origin) != 2 or not all(map(math.isfinite, origin))):
        problems.append(f"jv.track origin = {origin!r}: must be (column, row) in px")
    if not math.isfinite(angle):
        problems.append(f"jv.track angle = {angle!r}: must be a finite number of radians")
    if len(masses) and (len(masses) != len(p.markers) + 1 or not all(0.0 < m < math.inf for m in masses)):
        problems.append(f"jv.track masses = {masses!r}: must be {len(p.markers) + 1} numbers > 0, one a body")
    if problems:
        raise InputError(problems)


def _in_pixels(ball: BallTrack, time: Array, exposure: float) -> pd.DataFrame:
    """frame, time_s, x_px, y_px, sigma_px, flag of a ball, at mid-exposure; with an exposure its shifts [px]."""
    lost = ball.flag != ""
    x, y, sigma = (np.where(lost, np.nan, c) for c in (ball.x, ball.y, ball.sigma))
    table = pd.DataFrame({"frame": range(len(x)), "time_s": time, "x_px": x, "y_px": y, "sigma_px": sigma})
    if exposure > 0.0:
        shifts = [exposure_shift(time, c, exposure) for c in (x, y)]
        known = np.isfinite(shifts[0])
        table["x_px"], table["y_px"] = (c - np.where(known, s, 0.0) for c, s in zip((x, y), shifts))
        table["sigma_px"] = np.where(known, shift_sigma(sigma, time, exposure), sigma)
        own = np.where(known, shift_noise(sigma, time, exposure), np.nan)
        table = table.assign(shift_x_px=shifts[0], shift_y_px=shifts[1], shift_sigma_px=own)
    return table.assign(flag=ball.flag)


def _centre_of_mass(bodies: list[pd.DataFrame], masses: Array) -> pd.DataFrame:
    """The same columns of the centre of mass: NaN, and flagged, where a body is lost."""
    share = masses / masses.sum()
    out = bodies[0].copy()
    for c in out.columns[out.columns.str.startswith(("x_", "y_", "shift_x", "shift_y"))]:
        out[c] = sum(s * b[c] for s, b in zip(share, bodies))
    for c in out.columns[out.columns.str.contains("sigma")]:
        out[c] = np.sqrt(sum((s * b[c]) ** 2 for s, b in zip(share, bodies)))
    lost = np.array([[str(f) for f in b.flag] for b in bodies])
    out["flag"] = [next((f"body {k + 1}: {f}" for k, f in enumerate(col) if f), "") for col in lost.T]
    return out


def _moving(
    body: pd.DataFrame, scale: float | None, origin: tuple[float, float] | None, angle: float, window: int
) -> pd.DataFrame:
    """A body with its place in the axes, its speed and acceleration; the flag last."""
    flag, out = body.flag, body.drop(columns="flag")
    place, sigma = (body[["x_px", "y_px"]].to_numpy(float).T, body.sigma_px.to_numpy(float))
    unit = "px" if scale is None else "m"
    if scale is not None or origin is not None or angle:
        column, row = (0.0, 0.0) if origin is None else origin
        turned = (place[0] - column - 1j * (place[1] - row)) * cmath.exp(-1j * angle) * (scale or 1.0)
        place, sigma = np.stack([turned.real, turned.imag]), sigma * (scale or 1.0)
        names = ("x_m", "y_m", "sigma_m") if scale is not None else ("x_axes_px", "y_axes_px")
        out = out.assign(**dict(zip(names, (*place, sigma))))
    return with_derivatives(out, place, sigma, "xy", unit, window).assign(flag=flag)
