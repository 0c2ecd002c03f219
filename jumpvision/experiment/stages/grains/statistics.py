"""A steady flow: its mean, fluctuations and Reynolds stresses, and profiles of them along lines."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence

import numpy as np
import pandas as pd
import xarray as xr

from jumpvision.base.arrays import Array
from jumpvision.base.numbers import format_count
from jumpvision.experiment.inputs.parameters import ProfilesParams, StatisticsParams
from jumpvision.experiment.inputs.sections import NotApplicable
from jumpvision.experiment.results.fields import Flow, Piv, Planes, Statistics, rate_of, unit_of
from jumpvision.experiment.results.tables import Profiles
from jumpvision.experiment.workflow.stage import stage
from jumpvision.films.grains.steady import Memory, Velocities, independent, mean_half_width, steady

SERIES = 4_000_000  # numbers that are held at once to learn how long a flow remembers
AT_MOST = 256  # vectors that it is learned from


@stage(version=3)
def statistics(piv: Piv, flow: Flow, *, p: StatisticsParams) -> Statistics:
    """Mean velocity and vorticity, fluctuations and Reynolds stresses of a steady flow.

    Over (y, x): u, v, vorticity with their sigmas; uu, vv, uv [m^2/s^2], u_rms, v_rms and tke = (uu + vv)/2 without the
    noise of the matching; n measured vectors. The sigmas heed how long the flow remembers. Not for a foot that moves.
    """
    field = piv.as_matched
    if "foot_y" in field:
        raise NotApplicable(["statistics: the foot of [grain_video] moves: no steady flow"])
    chosen = field.isel(t=np.flatnonzero((field.t.values >= p.first) & (field.t.values <= p.last)))
    if chosen.sizes["t"] < 2:
        raise NotApplicable([f"statistics: {format_count(chosen.sizes['t'], 'field')}; the scatter of a mean needs 2"])
    found = steady(of_times(chosen), *(Memory.of(x) for x in remembered(chosen)))
    unit, rate = unit_of(field.u), rate_of(field)
    square = unit.replace("/", "^2/") + "^2"
    values: dict[str, tuple[Array, str]] = {
        **{n: (getattr(found, n), unit) for n in ("u", "v", "u_sigma", "v_sigma")},
        **{n: (getattr(found, n), square) for n in ("uu", "vv", "uv", "uu_sigma", "vv_sigma", "uv_sigma")},
        "u_rms": (np.sqrt(np.maximum(found.uu, 0.0)), unit),
        "v_rms": (np.sqrt(np.maximum(found.vv, 0.0)), unit),
        "tke": (0.5 * (found.uu + found.vv), square),
        **{n: (a, rate) for n, a in zip(("vorticity", "vorticity_sigma"), mean_of(flow.field.vorticity, chosen.t))},
        "n": (found.n, "1"),
    }
    data = xr.Dataset(
        {k: (("y", "x"), a, {"units": u}) for k, (a, u) in values.items()}, coords={c: field[c] for c in ("x", "y")}
    )
    facts = {"fields": chosen.sizes["t"], "source": piv.geometry.source}
    return Statistics(data.assign_attrs(facts))


def of_times(field: xr.Dataset) -> Iterator[Velocities]:
    """The fields of a film, read one at a time."""
    for f in Planes(field, ("u", "v", "u_sigma", "v_sigma", "chc")):
        f = f.transpose("y", "x")
        yield Velocities(f.u.values, f.v.values, f.u_sigma.values, f.v_sigma.values, f.chc.values > 0)


def mean_of(values: xr.DataArray, t: xr.DataArray) -> tuple[Array, Array]:
    """Mean (y, x) of values (y, x, t) at the times t and its standard uncertainty; NaN where fewer than 2 are known.

    A long film is read part by part.
    """
    field = values.sel(t=t).to_dataset(name="a")
    n, first, total, squares = (np.zeros([field.sizes[d] for d in ("y", "x")]) for _ in range(4))
    for f in Planes(field):
        a = f.a.transpose("y", "x").values
        known = np.isfinite(a)
        first = np.where((n == 0) & known, a, first)  # near the mean: squares lose nothing to rounding
        off = np.where(known, a - first, 0.0)
        n, total, squares = n + known, total + off, squares + off * off
    n[n < 2] = np.nan
    series = evenly(field).a.transpose("t", "y", "x").values.reshape(field.sizes["t"], -1)
    series = series[:, np.isfinite(series).sum(axis=0) >= 2]
    memory = Memory.of(series).mean if series.size else 0.0
    scatter = np.sqrt(np.maximum(squares - total**2 / n, 0.0) / (n - 1.0))
    return first + total / n, scatter * mean_half_width(independent(n, field.sizes["t"], memory))


def remembered(field: xr.Dataset) -> list[Array]:
    """Both components, each (t, k), of vectors that lie evenly over the field, NaN where not measured."""
    f = evenly(field[["u", "v", "chc"]]).transpose("t", "y", "x")
    seen = f.chc.values > 0
    parts = [np.where(seen, f[n].values, np.nan).reshape(len(seen), -1) for n in ("u", "v")]
    return [a[:, np.isfinite(a).sum(axis=0) >= 2] for a in parts]


def evenly(field: xr.Dataset) -> xr.Dataset:
    """A field (y, x, t) at vectors that lie evenly over it, few enough to be held over all times."""
    many = field.sizes["y"] * field.sizes["x"]
    every = max(1, math.ceil(math.sqrt(many / max(1, min(AT_MOST, SERIES // (2 * field.sizes["t"]))))))
    return field.isel(x=slice(None, None, every), y=slice(None, None, every))


@stage(version=1)
def profiles(found: Statistics, *, p: ProfilesParams) -> Profiles:
    """Mean velocity and stresses along lines, between the vectors by straight lines.

    A row a place, a vector's distance apart: line, s along it, x, y, then what statistics.nc holds; `along` and
    `across` are the mean velocity's components along the line and to its left.
    """
    if not p.lines:
        raise NotApplicable(["profiles: give [params.profiles] lines = [[x1, y1, x2, y2], ...]"])
    parts = []
    for k, line in enumerate(p.lines):
        try:
            parts.append(along_line(found.field, line))
        except ValueError as e:
            raise ValueError(f"[params.profiles] lines[{k}] = {list(line)}: {e}") from None
        parts[-1].insert(0, "line", k)
    return Profiles(pd.concat(parts, ignore_index=True))


def along_line(data: xr.Dataset, line: Sequence[float]) -> pd.DataFrame:
    """A field (y, x) along the line x1, y1, x2, y2 in its axes: columns s, x, y, along, across, their sigmas, and all
    variables, between the vectors by straight lines. Raises ValueError where nothing was measured on it."""
    x1, y1, x2, y2 = line
    apart = abs(float(data.x[1] - data.x[0])) if data.sizes["x"] > 1 else 1.0
    length = math.hypot(x2 - x1, y2 - y1)
    s = np.linspace(0.0, length, max(2, round(length / apart) + 1))
    c, n = (x2 - x1) / length, (y2 - y1) / length
    x, y = (xr.DataArray(a, dims="s") for a in (x1 + c * s, y1 + n * s))
    at = data.sortby("y").interp(x=x, y=y)
    if not np.isfinite(at.u.values).any():
        raise ValueError(
            f"nothing was measured on it; the field lies in x {float(data.x.min()):.4g} to {float(data.x.max()):.4g}, "
            f"y {float(data.y.min()):.4g} to {float(data.y.max()):.4g}"
        )
    table = pd.DataFrame({"s": s, "x": x.values, "y": y.values})
    table["along"], table["across"] = c * at.u.values + n * at.v.values, c * at.v.values - n * at.u.values
    table["along_sigma"] = np.hypot(c * at.u_sigma.values, n * at.v_sigma.values)
    table["across_sigma"] = np.hypot(c * at.v_sigma.values, n * at.u_sigma.values)
    return table.assign(**{str(name): at[name].values for name in at.data_vars})
