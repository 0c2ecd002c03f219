"""Figures of velocity fields of any flow: what was measured and what replaced, maps, means along lines."""

from __future__ import annotations

from collections.abc import Sequence
from textwrap import fill
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.experiment.inputs.sections import NotApplicable
from jumpvision.experiment.results.fields import Piv, Statistics, by_time, rate_of, unit_of
from jumpvision.experiment.results.tables import Profiles
from jumpvision.experiment.workflow.stage import stage
from jumpvision.films.vision.piv.pair import MASKED, REASONS
from jumpvision.report.style import MAP, MEASURED, MODEL, QUIET, SIGNED, NewFigure, styled

from .pictures import Picture, png

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.collections import QuadMesh
    from matplotlib.figure import Figure

COLOURS = ("#ececec", "white", "#56B4E9", "#D55E00", "#0072B2", "#E69F00", "#F0E442", "#CC79A7")  # as REASONS
LONGEST = 4.0  # typical speeds: a wild vector is drawn no longer
MOST = 2000  # points of a line


class ValidationPicture(Picture):
    file = "validation.png"


class StatisticsPicture(Picture):
    file = "statistics.png"


class ProfilesPicture(Picture):
    file = "profiles.png"


def worst_and_shares(field: xr.Dataset) -> tuple[int, Array, Array]:
    """Index of the time with the smallest share of measured vectors, of several the fastest; that share (t,), of all
    that are not masked; shares of the vectors, for every reason of REASONS (k, t)."""

    def of(f: xr.Dataset) -> list[xr.DataArray]:
        plane = "y", "x"
        share = (f.chc > 0).sum(plane) / np.maximum((f.reason != MASKED).sum(plane), 1)
        return [
            share,
            (f.u_raw**2 + f.v_raw**2).mean(plane).fillna(0.0),
            *((f.reason == k).mean(plane) for k in sorted(REASONS)),
        ]

    share, speed, *shares = by_time(field, ("chc", "reason", "u_raw", "v_raw"), of)
    return int(np.argmax(np.where(share <= share.min() + 1e-9, speed, -1.0))), share, np.array(shares)


def worst_of_parts(measured: Array) -> NDArray[np.int64]:
    """Indices of the times (t,) that are drawn: all of them, of a long film the worst of each of MOST parts."""
    parts = np.array_split(np.arange(measured.size), min(MOST, measured.size))
    return np.array([p[np.argmin(measured[p])] for p in parts])


@stage(version=4, picture=True)
def validation_picture(piv: Piv) -> ValidationPicture:
    """Raw vectors at the worst moment, over what became of them; the shares against time."""
    from matplotlib.colors import ListedColormap

    field = piv.field
    if "u_raw" not in field or "reason" not in field:
        raise NotApplicable(["validation: a field of another program, without raw vectors"])
    factor, shown = (1e3, "mm") if piv.geometry.metric else (1.0, "px")
    i, measured, shares = worst_and_shares(field)
    f = field.isel(t=i).transpose("y", "x")
    x, y = f.x.values * factor, f.y.values * factor
    typical = _typical(f.u, f.v) or _typical(f.u_raw, f.v_raw) or 1.0  # no valid vector may be left
    every = max(1, -(-len(x) // 48))  # arrows along a row, at most
    few = np.s_[every // 2 :: every, every // 2 :: every]
    u, v = (np.clip(a.values, -LONGEST * typical, LONGEST * typical)[few] for a in (f.u_raw, f.v_raw))
    apart = every * abs(float(x[1] - x[0])) if len(x) > 1 else 1.0
    worst = worst_of_parts(measured)
    present = {k: share[worst] for k, share in zip(sorted(REASONS), shares) if k != MASKED and share.any()}
    with styled() as Figure:
        figure = Figure(figsize=(9.6, 4.6), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1.7, 1))
        codes = {"cmap": ListedColormap(COLOURS), "vmin": -0.5, "vmax": len(COLOURS) - 0.5}
        left.pcolormesh(x, y, f.reason.values, rasterized=True, **codes)
        at = np.meshgrid(x, y)[0][few], np.meshgrid(x, y)[1][few]
        left.quiver(*at, u, v, angles="xy", scale_units="xy", scale=typical / (1.5 * apart), width=0.003)
        one_of = round(shares.shape[1] / worst.size)
        which, line = (f", the worst of every {one_of} pairs", "none") if one_of > 1 else ("", "-")
        for k, share in present.items():
            how = {"ls": line, "color": COLOURS[k] if k else QUIET, "label": fill(REASONS[k].split(":")[0], 40)}
            right.plot(field.t.values[worst], 100.0 * share, marker=".", ms=4, **how)
        left.set(title=f"raw vectors, t = {float(f.t):.4g} s", xlabel=f"x [{shown}]", ylabel=f"y [{shown}] (up)")
        left.set_aspect("equal")
        left.grid(False)
        right.set(title="what became of the vectors", xlabel=f"time [s]{which}", ylabel="share [%]")
        right.set_yscale("symlog", linthresh=1.0)
        right.set_yticks([0, 0.5, 1, 5, 10, 50, 100], ["0", "0.5", "1", "5", "10", "50", "100"])
        right.set_ylim(0.0, 120.0)
        figure.legend(*right.get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=7)
        return ValidationPicture(png(figure))


def _typical(u: xr.DataArray, v: xr.DataArray) -> float:
    """A speed that nine vectors of ten do not exceed; 0 of none."""
    speed = np.hypot(u.values, v.values)
    return float(np.nanquantile(speed, 0.9)) if np.isfinite(speed).any() else 0.0


class Map(NamedTuple):
    """One panel: what it shows, values (ny, nx), colours, whether they have a sign."""

    label: str
    values: Array
    colours: str
    signed: bool = False


def draw_maps(
    figure: Figure, shape: tuple[int, int], data: xr.Dataset, unit: str, panels: Sequence[Map], title: str
) -> None:
    """Maps over data.x and data.y (rising) [unit], of whose velocity the first has the streamlines."""
    factor, shown = (1e3, "mm") if unit == "m" else (1.0, "px")
    x, y = data.x.values * factor, data.y.values * factor
    axes = figure.subplots(*shape, sharex=True, sharey=True)
    for axis, m in zip(axes.flat, panels, strict=True):
        figure.colorbar(draw_map(axis, data, m, factor), ax=axis, label=m.label, shrink=0.85)
    streamlines(axes[0, 0], x, y, data.u.values, data.v.values)
    axes[0, 0].set_title(title)
    for axis in axes[-1]:
        axis.set_xlabel(f"x [{shown}]")
    for axis in axes[:, 0]:
        axis.set_ylabel(f"y [{shown}] (up)")


def draw_map(axis: Axes, data: xr.Dataset, m: Map, factor: float) -> QuadMesh:
    """A map over data.x and data.y (rising), times factor; grey where nothing is known."""
    top = float(np.nanquantile(np.abs(m.values), 0.995)) if np.isfinite(m.values).any() else 0.0
    x, y = data.x.values * factor, data.y.values * factor
    least = -top if m.signed else 0.0
    seen = axis.pcolormesh(x, y, m.values, cmap=m.colours, rasterized=True, vmin=least, vmax=top or 1.0)
    axis.set(aspect="equal", facecolor="#dddddd")
    axis.grid(False)
    return seen


def tall(data: xr.Dataset, rows: int, most: float) -> float:
    """Inches of a figure, two maps wide."""
    return min(most, 1.0 + rows * 3.7 * float(np.ptp(data.y.values) / max(float(np.ptp(data.x.values)), 1e-12)))


def maps(field: xr.Dataset, flow: xr.Dataset, i: int, unit: str, Figure: NewFigure) -> Figure:
    """Speed with streamlines, vorticity, shear rate and divergence at time i. unit: of places, "m" or "px"."""
    f, g = (a.isel(t=i).transpose("y", "x").sortby("y") for a in (field, flow))
    figure, rate = Figure(figsize=(9.6, tall(f, 2, 9.0)), layout="compressed"), rate_of(f)
    panels = (
        Map(f"speed [{unit_of(f.u)}]", np.hypot(f.u.values, f.v.values), MAP),
        Map(f"vorticity [{rate}]", g.vorticity.values, SIGNED, True),
        Map(f"shear rate [{rate}]", g.shear_rate.values, "magma"),
        Map(f"divergence [{rate}]", g.divergence.values, SIGNED, True),
    )
    draw_maps(figure, (2, 2), f, unit, panels, f"t = {float(f.t):.4g} s")
    return figure


def streamlines(axis: Axes, x: Array, y: Array, u: Array, v: Array) -> None:
    """Lines along the velocity, on axes whose x and y rise."""
    if min(u.shape) > 2:
        axis.streamplot(
            x, y, np.nan_to_num(u), np.nan_to_num(v), color="white", linewidth=0.6, arrowsize=0.7, density=1.2
        )
        axis.set(xlim=(x[0], x[-1]), ylim=(y[0], y[-1]))


@stage(version=1, picture=True)
def statistics_picture(found: Statistics, piv: Piv) -> StatisticsPicture:
    """Mean speed with streamlines, mean vorticity, fluctuations of both components and the Reynolds shear stress."""
    data, unit = found.field.transpose("y", "x").sortby("y"), piv.geometry.unit
    speed, square = unit_of(data.u), unit_of(data.uv).replace("^2", "²")
    panels = (
        Map(f"mean speed [{speed}]", np.hypot(data.u.values, data.v.values), MAP),
        Map(f"mean vorticity [{rate_of(data)}]", data.vorticity.values, SIGNED, True),
        Map(f"u rms [{speed}]", data.u_rms.values, "magma"),
        Map(f"v rms [{speed}]", data.v_rms.values, "magma"),
        Map(f"u'v' [{square}]", data.uv.values, SIGNED, True),
        Map(f"energy (u'² + v'²)/2 [{square}]", data.tke.values, "magma"),
    )
    with styled() as Figure:
        figure = Figure(figsize=(9.6, tall(data, 3, 11.0)), layout="compressed")
        draw_maps(figure, (3, 2), data, unit, panels, f"mean of {found.fields} fields")
        return StatisticsPicture(png(figure))


@stage(version=1, picture=True)
def profiles_picture(found: Profiles, piv: Piv) -> ProfilesPicture:
    """Mean velocity along and across every line, with its ±2σ, and the fluctuations."""
    table, unit = found.table, unit_of(piv.field.u)
    factor, shown = (1e3, "mm") if piv.geometry.metric else (1.0, "px")
    lines = [part for _, part in table.groupby("line")]
    with styled() as Figure:
        figure = Figure(figsize=(9.0, 2.6 * len(lines)), layout="constrained")
        for row, part in zip(figure.subplots(len(lines), 2, squeeze=False), lines):
            s = part.s * factor
            for name, colour in (("along", MEASURED), ("across", MODEL)):
                sigma = part[f"{name}_sigma"]
                row[0].fill_between(s, part[name] - 2 * sigma, part[name] + 2 * sigma, color=colour, alpha=0.25, lw=0)
                row[0].plot(s, part[name], color=colour, label=f"{name} the line")
            for name, colour in (("u_rms", MEASURED), ("v_rms", MODEL)):
                row[1].plot(s, part[name], color=colour, label=name.replace("_", " "))
            a, b = part.iloc[0], part.iloc[-1]
            ends = f"({a.x * factor:.4g}, {a.y * factor:.4g}) to ({b.x * factor:.4g}, {b.y * factor:.4g}) {shown}"
            row[0].set(title=ends, ylabel=f"mean velocity [{unit}]", xlabel=f"s [{shown}]")
            row[1].set(ylabel=f"fluctuation [{unit}]", xlabel=f"s [{shown}]")
            for axis in row:
                axis.axhline(0.0, color=QUIET, lw=0.6)
                axis.legend(fontsize=7)
        return ProfilesPicture(png(figure))
