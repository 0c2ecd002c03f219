"""`jv.particles` of images: many small particles at once, found and linked by trackpy, each fitted anew with its sigma;
their common drift, mean squared displacement and diffusion coefficient."""

from __future__ import annotations

import math
import warnings
from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from numba import njit
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array, Image
from jumpvision.base.schema import InputError

from ..vision.ball.disc import invert
from .images import grey_images, in_grey, only_numbers, scale_problem

STEPS = 30  # of a fit at most
REST = 1e-4  # px: the last step
AWAY, SURE = 0.3, 0.03  # diameters: a fit that goes farther is not of this particle; noise is placed less surely


class Particles(NamedTuple):
    """tracks: a row a particle and frame; drift: of all alike, from the first frame on; msd: mean squared displacement
    about the drift by lag; diffusion, diffusion_sigma: D of one axis' <dx^2> = 2 D t, in (unit of length)^2/s."""

    tracks: pd.DataFrame
    drift: pd.DataFrame
    msd: pd.DataFrame
    diffusion: float
    diffusion_sigma: float


def particles(
    frames: Iterable[ArrayLike],
    *,
    diameter: int = 11,
    frame_rate: float = 1.0,
    scale: float | None = None,
    polarity: str = "bright",
    search: float = 5.0,
    memory: int = 3,
    shortest: int = 5,
    least_mass: float | None = None,
) -> Particles:
    """Small particles (blurred spots) in frames (n, H, W): places, paths, drift, mean squared displacement.

    trackpy finds and links them (pip install 'jumpvision[particles]'); a round Gaussian spot is fitted to each by least
    squares, whose sigma_px is stated. diameter [px], odd: of the area about a particle that is looked at. search [px]:
    largest step from frame to frame. memory: frames that a particle may be unseen. shortest: frames of a path that is
    kept. least_mass: summed grey of a particle, over trackpy's; what is placed less surely than 0.03 diameters
    is no particle. scale [m/px], frame_rate [1/s].

    tracks: particle, frame, time_s, x_px right, y_px down, sigma_px (of either), with a scale x_m, y_m up, sigma_m.
    drift: frame, time_s, x, y of unit. msd: lag_s, msd (of both axes, in unit^2), pairs. diffusion by the covariance of
    successive steps, which an error of the places does not shift (Vestergaard, Blainey and Flyvbjerg 2014), weighted by
    steps; its sigma is the scatter between particles. NaN where no path has three frames in a row.

    Raises InputError for a bad call or without trackpy, ValueError for what is no stack of grey images.

    Example: jv.particles(frames, diameter=9, frame_rate=50.0, scale=2e-7).diffusion
    """
    _check(diameter, frame_rate, scale, polarity, search, memory, shortest)
    tp = _trackpy()
    images = in_grey(only_numbers("particles", grey_images("particles", frames)))
    found = [_located(tp, np.asarray(a), i, diameter, polarity, least_mass) for i, a in enumerate(images)]
    if not any(map(len, found)):
        raise ValueError("particles: none found in any frame: try another diameter, polarity or least_mass")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        linked = tp.link(pd.concat(found, ignore_index=True), search, memory=memory)
        linked = tp.filter_stubs(linked, shortest).reset_index(drop=True)
    unit, length = ("px", 1.0) if scale is None else ("m", scale)
    table = linked[["particle", "frame", "x", "y", "sigma"]].sort_values(["particle", "frame"], ignore_index=True)
    steps = _steps(table)
    drift = _drift(steps, len(images))
    own = table.assign(x=table.x - drift[table.frame, 0], y=table.y - drift[table.frame, 1])
    msd = _displacements(own, length, frame_rate, unit, len(images))
    diffusion, sigma = _diffusion(own)
    table.insert(2, "time_s", table.frame / frame_rate)
    table = table.rename(columns={"x": "x_px", "y": "y_px", "sigma": "sigma_px"})
    if scale is not None:
        table = table.assign(x_m=table.x_px * scale, y_m=-table.y_px * scale, sigma_m=table.sigma_px * scale)
    number = np.arange(len(images))
    up = 1.0 if scale is None else -1.0
    moved = {f"x_{unit}": drift[:, 0] * length, f"y_{unit}": up * drift[:, 1] * length}
    d = length**2 * frame_rate
    return Particles(
        table, pd.DataFrame({"frame": number, "time_s": number / frame_rate, **moved}), msd, diffusion * d, sigma * d
    )


def _check(
    diameter: int, frame_rate: float, scale: float | None, polarity: str, search: float, memory: int, shortest: int
) -> None:
    problems = [p] if (p := scale_problem("jv.particles", scale)) else []
    if diameter < 3 or diameter % 2 == 0:
        problems.append(f"jv.particles diameter = {diameter}: must be odd and at least 3 px")
    if polarity not in ("bright", "dark"):
        problems.append(f"jv.particles polarity = {polarity!r}: must be 'bright' or 'dark'")
    for name, value in (("frame_rate", frame_rate), ("search", search)):
        if not 0.0 < value < math.inf:
            problems.append(f"jv.particles {name} = {value!r}: must be above 0")
    for name, whole, least in (("memory", memory, 0), ("shortest", shortest, 1)):
        if whole < least:
            problems.append(f"jv.particles {name} = {whole}: must be at least {least} frames")
    if problems:
        raise InputError(problems)


def _trackpy() -> Any:
    try:
        import trackpy
    except ImportError as e:
        raise InputError(["jv.particles needs trackpy: pip install 'jumpvision[particles]'"]) from e
    trackpy.quiet()
    return trackpy


def _located(tp: Any, image: Image, i: int, diameter: int, polarity: str, least_mass: float | None) -> pd.DataFrame:
    """frame, x, y, sigma [px] of the particles in a frame."""
    with warnings.catch_warnings():  # of pandas, for trackpy's writers
        warnings.simplefilter("ignore")
        found = tp.locate(image, diameter, minmass=least_mass, invert=polarity == "dark")
    places = found[["x", "y"]].to_numpy(float)
    grey = image.astype(np.float32)
    fits = np.array([fitted(grey, x, y, diameter // 2) for x, y in places]).reshape(-1, 3)
    near = np.hypot(*(fits[:, :2] - places).T) < AWAY * diameter
    x, y, sigma = fits[near & (fits[:, 2] < SURE * diameter)].T
    return pd.DataFrame({"frame": np.full(x.size, i), "x": x, "y": y, "sigma": sigma})


@njit(cache=True, nogil=True, error_model="numpy")
def fitted(image, x, y, half):  # type: ignore[no-untyped-def]
    """x, y and sigma [px] of a round Gaussian spot on an even ground, fitted by least squares to the pixels within half
    [px] of (x, y), rounded; NaN where the fit fails."""
    height, width = image.shape
    cx, cy = math.floor(x + 0.5), math.floor(y + 0.5)
    rows, columns = (
        range(max(0, cy - half), min(height, cy + half + 1)),
        range(max(0, cx - half), min(width, cx + half + 1)),
    )
    p = np.array([x, y, 0.0, 0.0, 0.45 * half])  # x, y, height, ground, width
    rim = count = 0.0
    for r in rows:
        for c in columns:
            if (c - cx) ** 2 + (r - cy) ** 2 > (half - 1) ** 2:
                rim += image[r, c]
                count += 1.0
    p[3] = rim / max(count, 1.0)
    p[2] = image[min(max(cy, 0), height - 1), min(max(cx, 0), width - 1)] - p[3]
    h, g, j = np.zeros((5, 5)), np.zeros(5), np.zeros(5)
    inverse, step = np.zeros((5, 5)), np.zeros(5)
    squares = 0.0
    n = 0
    for _ in range(STEPS):
        h[:] = 0.0
        g[:] = 0.0
        squares, n = 0.0, 0
        for r in rows:
            for c in columns:
                if (c - cx) ** 2 + (r - cy) ** 2 > (half + 0.5) ** 2:
                    continue
                dx, dy, s2 = c - p[0], r - p[1], p[4] ** 2
                e = math.exp(-0.5 * (dx * dx + dy * dy) / s2)
                left = image[r, c] - p[3] - p[2] * e
                j[0], j[1], j[2], j[3] = p[2] * e * dx / s2, p[2] * e * dy / s2, e, 1.0
                j[4] = p[2] * e * (dx * dx + dy * dy) / (s2 * p[4])
                for a in range(5):
                    g[a] += j[a] * left
                    for b in range(5):
                        h[a, b] += j[a] * j[b]
                squares += left * left
                n += 1
        for a in range(5):
            h[a, a] = h[a, a] * (1.0 + 1e-9) + 1e-12
        if n < 7 or not invert(h, 5, inverse):
            return np.full(3, np.nan)
        for a in range(5):
            step[a] = 0.0
            for b in range(5):
                step[a] += inverse[a, b] * g[b]
            p[a] += step[a]
        p[4] = min(max(p[4], 0.5), 4.0 * half)
        if not math.hypot(p[0] - x, p[1] - y) < half:
            return np.full(3, np.nan)
        if math.hypot(step[0], step[1]) < REST:
            break
    variance = max(inverse[0, 0], inverse[1, 1]) * squares / (n - 5)
    return np.array([p[0], p[1], math.sqrt(variance)])


def _steps(table: pd.DataFrame) -> pd.DataFrame:
    """particle, frame and (x, y) steps to the next frame, where the particle is seen in both."""
    after = table.groupby("particle").shift(-1)
    steps = pd.DataFrame(
        {"particle": table.particle, "frame": table.frame, "x": after.x - table.x, "y": after.y - table.y}
    )
    return steps[after.frame - table.frame == 1]


def _drift(steps: pd.DataFrame, n: int) -> Array:
    """(n, 2): way of all particles since the first frame [px], the mean step of those seen in both frames."""
    mean = steps.groupby("frame")[["x", "y"]].mean().reindex(range(n - 1)).fillna(0.0).to_numpy()
    return np.vstack([np.zeros((1, 2)), np.cumsum(mean, axis=0)])


def _displacements(own: pd.DataFrame, length: float, rate: float, unit: str, n: int) -> pd.DataFrame:
    """Mean squared displacement of both axes by lag, up to a quarter of the film; pairs that it is the mean of."""
    grids = own.pivot(index="frame", columns="particle", values=["x", "y"]).reindex(range(n)).to_numpy()
    x, y = np.split(grids, 2, axis=1)
    rows = []
    for lag in range(1, max(2, n // 4 + 1)):
        squared = (x[lag:] - x[:-lag]) ** 2 + (y[lag:] - y[:-lag]) ** 2
        if pairs := int(np.isfinite(squared).sum()):
            rows.append((lag / rate, float(np.nanmean(squared)) * length**2, pairs))
    return pd.DataFrame(rows, columns=["lag_s", f"msd_{unit}2", "pairs"])


def _diffusion(own: pd.DataFrame) -> tuple[float, float]:
    """(D, sigma) [px^2 a frame] from <dx^2>/2 + <dx dx'> of steps that follow each other."""
    values, weights = [], []
    for _, steps in _steps(own).groupby("particle"):
        xy, frame = steps[["x", "y"]].to_numpy(), steps.frame.to_numpy()
        follow = np.diff(frame) == 1
        if follow.any():
            values.append(0.5 * float(np.mean(xy**2)) + float(np.mean((xy[1:] * xy[:-1])[follow])))
            weights.append(len(xy))
    if len(values) < 2:
        return math.nan, math.nan
    v, w = np.array(values), np.array(weights, float) / np.sum(weights)
    mean = float(w @ v)
    return mean, math.sqrt(float(np.sum((w * (v - mean)) ** 2)) * len(v) / (len(v) - 1))
