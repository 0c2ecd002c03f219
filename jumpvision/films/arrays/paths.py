"""Paths of grains through the fields of a film, as a table; `jv.paths` of such fields."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from jumpvision.base.arrays import Array
from jumpvision.base.attributes import attributes_of
from jumpvision.base.parameters import of_keywords
from jumpvision.base.schema import InputError, NotApplicable
from jumpvision.films.grains.dataset import as_matched
from jumpvision.films.grains.grid import VectorGrid
from jumpvision.films.grains.paths import NO_FOOT, REASONS, Carried, Grid, Step, carried
from jumpvision.films.grains.steady import Velocities
from jumpvision.films.parameters import PathsParams


def paths(field: xr.Dataset, *, spacing: float = 16.0, **parameters: Any) -> pd.DataFrame:
    """Paths through the fields of a stack of evenly timed frames, as `jv.piv(frames)` gives them (t, y, x).

    spacing [px] between the points they start from; parameters: the others of [params.paths]. Columns as in paths.csv.
    """
    p = of_keywords(PathsParams, {"spacing": spacing, **parameters}, spacing=spacing)
    if "t" not in field.dims:
        raise ValueError("paths: one field; give the fields of three frames and more, jv.piv(frames)")
    return through(as_matched(field), attributes_of(VectorGrid, field), None, None, p)


class Span(NamedTuple):
    """The time [s] from the first to the second frame of a pair, and the field that holds then."""

    field: int
    begin: float
    end: float


def through(
    data: xr.Dataset, grid: VectorGrid, times: Array | None, half_width_px: float | None, p: PathsParams
) -> pd.DataFrame:
    """The table of paths. times: of the film's frames [s]; None: evenly timed."""
    spans = chain(spans_of(data.t.values, grid, times), p.start)
    length = grid.scale_m_per_px if grid.metric else 1.0
    places = Grid(np.sort(data.x.values), np.sort(data.y.values), grid.window_px * length)
    if min(data.sizes["x"], data.sizes["y"]) < 4:
        raise NotApplicable([f"paths: {data.sizes['x']} x {data.sizes['y']} vectors; a cubic spline needs 4 each way"])
    wide = half_width_px * length if half_width_px else math.inf
    x, y = starts(plane(data, spans[0].field), places, p.spacing * length, p.most)
    found = carried(places, steps_of(data, spans, wide), x, y)
    return table(found, np.array([spans[0].begin, *(s.end for s in spans)]))


def spans_of(middle: Array, grid: VectorGrid, times: Array | None) -> list[Span]:
    """Of every pair, in order. middle: mid-time of every field [s]; times: of the frames, None: even."""
    gap, each, dt = int(grid.gap_frames), int(grid.ensemble_pairs), grid.delta_t
    if grid.stride_frames > 1:
        raise NotApplicable(
            ["paths: double exposures: nothing is seen from one pair to the next, so no grain is followed"]
        )
    if times is not None:
        return [Span(j // each, times[j], times[j + gap]) for j in range(len(times) - gap)]
    if each == 1:
        return [Span(k, t - 0.5 * dt, t + 0.5 * dt) for k, t in enumerate(middle)]
    frame = dt / gap
    first = middle[0] - 0.5 * (dt + (each - 1) * frame) if len(middle) > 1 else 0.0
    before = (len(middle) - 1) * each  # pairs of all fields but the last, which may hold fewer
    last = round((2.0 * (middle[-1] - first) - dt) / frame) + 1 - 2 * before
    pairs = before + last
    return [Span(j // each, first + j * frame, first + j * frame + dt) for j in range(pairs)]


def chain(spans: Sequence[Span], start: int) -> list[Span]:
    """Spans that touch one another, from the first of field `start` on: each begins where the one before ends."""
    out: list[Span] = []
    for s in spans:
        # the next pair may begin this part of the time between its frames beside the end of this one
        near = 0.02 * (s.end - s.begin)
        if s.field < start or (out and s.begin < out[-1].end - near):
            continue
        if out and s.begin > out[-1].end + near:
            raise NotApplicable(
                [f"paths: nothing is known from t = {out[-1].end:.6g} s to {s.begin:.6g} s, between two pairs"]
            )
        out.append(s)
    if not out:
        raise ValueError(f"[params.paths] start = {start}: must be below the {spans[-1].field + 1} fields of the film")
    return out


def starts(field: xr.Dataset, places: Grid, apart: float, most: int) -> tuple[Array, Array]:
    """x, y (n,) of a square grid in the middle of the vectors, where the nearest of the field is measured."""
    many = [max(1, math.ceil(np.ptp(g) / apart)) for g in places[:2]]  # none on the outermost vectors
    if math.prod(many) > most:
        raise InputError(
            [
                f"[params.paths] spacing: {many[0]} x {many[1]} points, more than most = {most}: give a wider spacing, "
                "or a greater most (a path takes some 100 bytes a frame)"
            ]
        )
    lines = [0.5 * (g[0] + g[-1]) + apart * (np.arange(m) - 0.5 * (m - 1)) for g, m in zip(places[:2], many)]
    near = np.meshgrid(*(np.abs(g[:, None] - a).argmin(axis=0) for g, a in zip(places[:2], lines)))
    x, y = (a.ravel() for a in np.meshgrid(*lines))
    good = field.chc.values[near[1].ravel(), near[0].ravel()] > 0
    if not good.any():
        raise NotApplicable(
            ["paths: nothing is measured where they would start: change [params.paths] spacing or start"]
        )
    return x[good], y[good]


def plane(data: xr.Dataset, k: int) -> xr.Dataset:
    """The field at time k, x and y rising."""
    needed = [n for n in ("u", "v", "u_sigma", "v_sigma", "chc", "foot_y", "foot_v") if n in data]
    return data[needed].isel(t=k).load().transpose("y", "x").sortby("y").sortby("x")


def steps_of(data: xr.Dataset, spans: Sequence[Span], wide: float) -> Iterator[Step]:
    """The fields, read one at a time, and how far each carries; wide: half width of the foot."""
    for s in spans:
        f = plane(data, s.field)
        seen = Velocities(f.u.values, f.v.values, f.u_sigma.values, f.v_sigma.values, f.chc.values > 0)
        foot = (-wide, wide, float(f.foot_y) + 0.5 * (s.end - s.begin) * float(f.foot_v)) if "foot_y" in f else NO_FOOT
        yield Step(seen, s.end - s.begin, foot)


def table(found: Carried, times: Array) -> pd.DataFrame:
    """A row a point and time, up to where a path ends, with that row."""
    rows, n = found.x.shape
    lasted = np.isfinite(found.x).sum(axis=0)
    ids, at = np.meshgrid(np.arange(n), np.arange(rows), indexing="ij")
    kept = at <= lasted[:, None]
    i, k = ids[kept], at[kept]
    last = k == lasted[i]
    values = {name: getattr(found, name)[k, i] for name in ("x", "y", "x_sigma", "y_sigma")}
    words = np.array([REASONS[int(w)] for w in found.why])
    start = {"start_x": found.x[0, i], "start_y": found.y[0, i]}
    return pd.DataFrame({"id": i, "t": times[k], **values, **start, "reason": np.where(last, words[i], "")})
