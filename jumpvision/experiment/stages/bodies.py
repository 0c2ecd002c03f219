"""Bodies in arrays: a table of each that a stack of pictures shows, their centre of mass, one seen by two cameras."""

from __future__ import annotations

import cmath
import math
import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.estimate.height import exposure_shift, parabolas, shift_noise, shift_sigma
from jumpvision.experiment.inputs.parameters import TrackParams, of_keywords
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.films.vision.ball.film import track_film
from jumpvision.films.vision.ball.track import BallSettings, BallTrack
from jumpvision.films.vision.fields import ORDERS, SIGMA, field, order_of
from jumpvision.films.vision.stereo import FAR, at_times, pinhole
from jumpvision.films.vision.stereo import triangulate as places_of

INTERLACED = 'the film is interlaced: every frame shows two instants; give {} = "{}" to follow both'
SEEN = ("time_s", "x_px", "y_px", "sigma_px")  # what two cameras' tables must have


def of_arrays(
    frames: Any,
    *,
    frame_rate: float = 1.0,
    scale: float | None = None,
    exposure: float = 0.0,
    origin: tuple[float, float] | None = None,
    angle: float = 0.0,
    masses: tuple[float, ...] = (),
    window: int = 7,
    fields: str = "together",
    **parameters: Any,
) -> pd.DataFrame:
    """A ball in every one of the frames (n, H, W), an array or a sequence of grey images: a row a frame.

    frame_rate [1/s]: default one frame a second. scale [m/px]. exposure [s]: positions are then those at mid-exposure.
    origin: (column, row) [px] of the axes' origin; angle [rad] of the x axis, counter-clockwise from the picture's row.
    masses [kg]: of the ball and of those at `markers`, for their centre of mass. window: frames of the parabola from
    which speed and acceleration are taken; fewer where the acceleration changes within them. fields: of interlaced
    frames, "top" or "bottom": a row for each of their half pictures, whose upper or lower rows come first. parameters:
    those of [params.track], such as diameter=12 [px], polarity="dark", seed=(column, row), markers=[(column, row)].

    Columns: body (with markers: from 1; 0 is the centre of mass), frame, time_s, x_px right, y_px down, sigma_px (of
    either); with a scale, an origin or an angle x, y up and sigma in the axes; vx, vy, v_sigma, ax, ay, a_sigma; the
    unit is in the names, m with a scale, else px, and y is down only where no axes are given. shift_x, shift_y,
    shift_sigma [px]: what the exposure added and was taken out, NaN beside a gap. flag: "" or why the ball is lost (all
    else is NaN then). Raises InputError for a parameter, ValueError for what is no stack of grey images.
    """
    p = of_keywords(TrackParams, parameters, folder=("exposure_correction",), frame_rate=frame_rate, scale=scale)
    images = [np.asarray(f) for f in frames]
    if not images or any(f.ndim != 2 for f in images):
        raise ValueError(f"track: {len(images)} frame(s): give grey images (H, W), one or more in a stack")
    if fields not in ORDERS:
        raise InputError([f"jv.track fields = {fields!r}: must be one of {', '.join(ORDERS)}"])
    if halved := fields != "together":
        images = [field(f, lower) for f in images for lower in (fields == "bottom", fields == "top")]
        frame_rate *= 2.0
    _check(p, exposure, frame_rate, origin, angle, masses, window)
    seed = (p.seed[0], p.seed[1]) if p.seed else None
    settings = BallSettings(p.diameter, p.polarity, p.method, p.search, seed, exposure > 0.0, exposure * frame_rate)
    markers = [(m[0], m[1]) for m in p.markers]
    found = track_film(images, settings, scene=p.background == "static", markers=markers)
    if halved:
        found = [replace(ball, sigma=ball.sigma * SIGMA) for ball in found]
    elif order := order_of(images):
        warnings.warn(INTERLACED.format("fields", order), StageWarning, stacklevel=2)
    for number, ball in enumerate(found, 1):
        for note in ball.notes:
            warnings.warn(f"ball {number}: {note}" if markers else note, StageWarning, stacklevel=2)
    time = np.arange(len(images)) / frame_rate + exposure / 2.0
    bodies = [_seen(ball, time, exposure) for ball in found]
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


def _seen(ball: BallTrack, time: Array, exposure: float) -> pd.DataFrame:
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
    return _with_derivatives(out, place, sigma, "xy", unit, window).assign(flag=flag)


def _with_derivatives(out: pd.DataFrame, place: Array, sigma: Array, axes: str, unit: str, window: int) -> pd.DataFrame:
    """The table with speed and acceleration of place (k, n), their sigma from sigma (n,) of every coordinate."""
    *each, (dv, da) = parabolas(out.time_s.to_numpy(float), place, sigma, window)
    names = [f"v{a}_{unit}_s" for a in axes] + [f"v_sigma_{unit}_s"]
    names += [f"a{a}_{unit}_s2" for a in axes] + [f"a_sigma_{unit}_s2"]
    return out.assign(**dict(zip(names, (*(v for v, _ in each), dv, *(a for _, a in each), da))))


def triangulate(
    first: pd.DataFrame,
    second: pd.DataFrame,
    marks: ArrayLike,
    seen: tuple[ArrayLike, ArrayLike],
    *,
    offset: float,
    ball_diameter: float,
    lens: bool,
    window: int,
) -> pd.DataFrame:
    """What `jumpvision.triangulate` gives; seen: of the first and of the second camera."""
    cameras = tuple(_camera(name, pixel, marks, lens) for name, pixel in zip(("first", "second"), seen))
    for name, table in (("first", first), ("second", second)):
        missing = [c for c in SEEN if c not in table.columns]
        if missing or len(table) < 2:
            what = f"columns missing: {missing}" if missing else "fewer than 2 rows"
            raise InputError([f"jv.triangulate: {name} table: {what}; give what jv.track gives"])
    time = first.time_s.to_numpy(float)
    pixels, sigmas = _pixels(first)
    others, other_sigmas = at_times(second.time_s.to_numpy(float) + offset, *_pixels(second), time)
    found = places_of((cameras[0], cameras[1]), (pixels, others), (sigmas, other_sigmas), ball_diameter / 2.0)
    lost = ~np.isfinite(found.place).all(axis=1)
    apart = ~lost & (found.miss > FAR)
    unseen = ~np.isfinite(pixels).all(axis=1)
    why = ["lost by the first camera", "lost by the second camera", "the two rays miss each other"]
    flag = np.select([unseen, lost, apart], why, "")
    if apart.any():
        text = f"{np.count_nonzero(apart)} of {len(time)} frames: the two rays miss each other by more than {FAR} sigma"
        warnings.warn(f"{text}; do both follow the same body? check marks and offset too", StageWarning, stacklevel=2)
    place, sigma = (np.where((lost | apart)[:, None], np.nan, a) for a in (found.place, found.sigma))
    out = pd.DataFrame({"frame": range(len(time)), "time_s": time})
    for k, axis in enumerate("xyz"):
        out[f"{axis}_m"] = place[:, k]
    for k, axis in enumerate("xyz"):
        out[f"sigma_{axis}_m"], out[f"sigma_common_{axis}_m"] = sigma[:, k], found.common[:, k]
    return _with_derivatives(out.assign(miss_sigma=found.miss), place.T, sigma.max(axis=1), "xyz", "m", window).assign(
        flag=flag
    )


def _camera(name: str, pixel: ArrayLike, marks: ArrayLike, lens: bool) -> Any:
    pixel, marks = np.asarray(pixel, float), np.asarray(marks, float)
    if len(pixel) != len(marks):
        text = f"{len(pixel)} pixels of {len(marks)} marks; give one each, in the same order"
        raise InputError([f"jv.triangulate: {name} camera: {text}"])
    try:
        return pinhole(pixel, marks, lens=lens)
    except ValueError as error:
        raise InputError([f"jv.triangulate: {name} camera: {error}"]) from error


def _pixels(table: pd.DataFrame) -> tuple[Array, Array]:
    return table[["x_px", "y_px"]].to_numpy(float), table.sigma_px.to_numpy(float)
