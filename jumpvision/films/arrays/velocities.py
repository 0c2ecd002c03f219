"""From matched pairs to a velocity field over (y, x, t): places, times and units, y up, as pivpy schema 1 has them."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from jumpvision import __version__
from jumpvision.base.arrays import Array
from jumpvision.base.schema import StageWarning
from jumpvision.films.grains.dataset import described
from jumpvision.films.grains.grid import VectorGrid
from jumpvision.films.parameters import PivParams
from jumpvision.films.vision.piv.engine import Usable, length_of_errors, piv_film, vector_places
from jumpvision.films.vision.piv.pair import MEASURED, REASONS, VectorField
from jumpvision.films.vision.repeats import Repeats, repeats_told


class Places(NamedTuple):
    """Where and when the pixels of a film lie. file: its name; scale [m/px] with its sigma, None: not known; column,
    row [px] of the origin; time: the unit of its times, "frame" where the rate is not known."""

    file: str
    scale: float | None
    scale_sigma: float
    column: float
    row: float
    time: str = "s"

    @property
    def speed(self) -> str:
        """The unit of velocities."""
        return f"{'m' if self.scale else 'px'}/{self.time}"


def matching(p: PivParams) -> dict[str, Any]:
    """What `piv_film` calls settings."""
    names = "preset", "smooth", "window", "step", "passes", "min_correlation", "min_texture", "outlier"
    return {name: getattr(p, name) for name in names}


def fields_of(
    images: Iterable[NDArray[np.generic]],
    usable: Usable | None,
    stride: int,
    p: PivParams,
    coded: float = 0.0,
) -> Iterator[VectorField]:
    """Fields of the pairs of frames that have their light; coded: what the film's codec may add to a displacement
    [px]."""
    repeats = Repeats()

    def shown(k: int) -> NDArray[np.bool_] | None:
        nothing = repeats.nothing_new  # a pair with it would show no motion, or that of two frames
        return nothing if nothing is not None else None if usable is None else usable(k)

    yield from piv_film(
        repeats.watch(images),
        mask=shown,
        gap=p.gap,
        baseline=p.baseline,
        ensemble=p.ensemble,
        stride=stride,
        coded=coded,
        **matching(p),
    )
    if said := repeats_told(repeats.same, "pairs with them are masked; match frames farther apart (gap)"):
        warnings.warn(StageWarning("reading", said), stacklevel=2)


def ends(time: Array, stride: int, p: PivParams) -> tuple[Array, Array]:
    """Times (pairs,) of the first and the second frame of every pair."""
    return time[: len(time) - p.gap : stride], time[p.gap :: stride]


def of_fields(values: Array, p: PivParams) -> Array:
    """Means of the values of pairs over the pairs of each field."""
    first = np.arange(0, len(values), p.ensemble)
    return np.asarray(np.add.reduceat(values, first) / np.diff(first, append=len(values)))


def header(time: Array, shape: tuple[int, int], at: Places, stride: int, p: PivParams) -> xr.Dataset:
    """Places, times and attributes of pivpy schema 1: y up, origin as in the contract, SI where the scale is known."""
    begin, end = ends(time, stride, p)
    x, y = (vector_places(n, p.window, p.step) for n in shape[::-1])
    grid = VectorGrid(
        delta_t=float(np.median(end - begin)),
        source=f"jumpvision {__version__}",
        scale_m_per_px=at.scale or np.nan,
        scale_share=at.scale_sigma / at.scale if at.scale else 0.0,
        origin_column_px=at.column,
        origin_row_px=at.row,
        window_px=p.window,
        step_px=p.step,
        error_correlation_length_px=length_of_errors(p.window, p.step, p.preset),
        image_rows=shape[0],
        image_columns=shape[1],
        gap_frames=p.gap,
        ensemble_pairs=p.ensemble,
        stride_frames=stride,
    )
    scale, unit = at.scale or 1.0, grid.unit
    places = xr.Dataset(
        coords={
            "x": ("x", (x - at.column) * scale, {"units": unit, "long_name": "right"}),
            "y": ("y", -(y - at.row) * scale, {"units": unit, "long_name": "up"}),
            "t": ("t", of_fields(0.5 * (begin + end), p), {"units": at.time, "long_name": "mid-time, common clock"}),
        }
    )
    return described(
        places,
        grid,
        matched=True,
        files=[at.file],
        preset=p.preset,
        smooth=p.smooth,
        baseline_frames=p.baseline,
        where="a vector is the velocity at (x, y) half-way in time between its two frames; x right, y up",
    )


def velocities(f: VectorField, at: Places, dt: float) -> xr.Dataset:
    """One pixel field as velocities [at.speed], y up. dt [at.time]: between the frames of a pair."""
    size = at.scale or 1.0

    def speed(values: Array, sign: float = 1.0, **attrs: str) -> tuple[tuple[str, str], Array, dict[str, str]]:
        return ("y", "x"), values * (sign * size / dt), {"units": at.speed, **attrs}

    return xr.Dataset(
        {
            "u": speed(f.u, standard_name="u_velocity"),
            "v": speed(f.v, -1.0, standard_name="v_velocity"),
            "u_sigma": speed(f.u_sigma),
            "v_sigma": speed(f.v_sigma),
            "u_raw": speed(f.u_raw),
            "v_raw": speed(f.v_raw, -1.0),
            "u_matched": speed(f.matched[0]),
            "v_matched": speed(f.matched[1], -1.0),
            "u_matched_sigma": speed(f.matched[2]),
            "v_matched_sigma": speed(f.matched[3]),
            "chc": (
                ("y", "x"),
                np.isin(f.reason, MEASURED).astype(float),
                {
                    "units": "1",
                    "standard_name": "validity_flag",
                },
            ),
            "correlation": (("y", "x"), f.correlation, {"units": "1"}),
            "reason": (
                ("y", "x"),
                f.reason.astype(np.int8),
                {
                    "units": "1",
                    "flag_values": np.array(sorted(REASONS), np.int8),
                    "flag_meanings": " ".join(_word(REASONS[k]) for k in sorted(REASONS)),
                    "long_name": "; ".join(f"{k}: {REASONS[k]}" for k in sorted(REASONS)),
                },
            ),
        }
    )


def _word(meaning: str) -> str:
    """A CF flag meaning: one word."""
    return meaning.split(":")[0].split(",")[0].replace(" (", "_").replace(")", "").replace(" ", "_")
