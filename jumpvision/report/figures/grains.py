"""Figures of what films show: grain velocities, strain, momentum, added mass."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from jumpvision.base.arrays import AnyArray
from jumpvision.experiment.inputs.sections import Calibration, GrainVideo, PivField
from jumpvision.experiment.results.fields import Column, Flow, Piv, by_time, unit_of
from jumpvision.experiment.results.values import Fits
from jumpvision.experiment.stages.recordings import open_grains
from jumpvision.experiment.workflow.stage import stage
from jumpvision.report.style import ACCENT, FOOT, MAP, MEASURED, QUIET, NewFigure, kind_of, styled

from .flows import maps
from .pictures import COLUMN_PANELS, Picture, draw_cone, draw_sides, png, show_frame

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure
    from matplotlib.quiver import Quiver


class PivPicture(Picture):
    file = "piv.png"


class FlowPicture(Picture):
    file = "flow.png"


def busiest(field: xr.Dataset) -> int:
    """Index of the frame with the largest mean speed."""

    def of(f: xr.Dataset) -> list[xr.DataArray]:
        return [np.hypot(f.u, f.v).where(f.chc > 0).mean(("y", "x")).fillna(0)]

    return int(np.argmax(by_time(field, ("u", "v", "chc"), of)[0]))


@stage(version=3, picture=True)
def piv_picture(
    piv: Piv, film: GrainVideo | None, calibration: Calibration | None, given: PivField | None
) -> PivPicture:
    """Velocity vectors at the busiest moment, over the grains where their film is known; replaced ones told apart."""
    field, grid = piv.field, piv.geometry
    i = busiest(field)
    image = None
    if film is not None and given is None:
        straight, film = open_grains(film, calibration)
        with straight as frames:
            image = frames[grid.middle_frame(i, len(frames))]
    factor, shown = (1e3, "mm") if grid.metric else (1.0, "px")
    extent = np.array(grid.edges) * factor
    with styled() as Figure:
        figure = Figure(figsize=(6.4, min(8.0, 0.7 + 5.2 * grid.image_rows / grid.image_columns)), layout="constrained")
        axis = figure.subplots()
        if image is not None:
            show_frame(axis, image, extent=extent, alpha=0.75)
        axis.set_aspect("equal")
        bad, arrows = draw_arrows(axis, field.isel(t=i), factor)
        if bad:
            axis.legend(loc="lower right", facecolor="white", frameon=True)
        axis.set_xlim(extent[0], extent[1])
        axis.set_ylim(extent[2], extent[3])
        figure.colorbar(arrows, ax=axis, label=f"speed [{unit_of(field.u)}]", shrink=0.8)
        share = float((field.chc.isel(t=i) > 0).sum() / np.isfinite(field.u.isel(t=i)).sum())
        axis.set(
            title=f"t = {float(field.t[i]):.3f} s, {100 * share:.1f} % of vectors measured",
            xlabel=f"x [{shown}]",
            ylabel=f"y [{shown}] (up)",
        )
        axis.grid(False)
        return PivPicture(png(figure))


def draw_arrows(axis: Axes, field: xr.Dataset, factor: float) -> tuple[bool, Quiver]:
    """Measured vectors of a field (y, x), at most 32 to a row, coloured by speed; crosses where others stand. factor:
    of places, from the field's unit to that of the axis. (whether there are crosses, the arrows)"""
    every = max(1, len(field.x) // 32)
    f = field.isel(x=slice(None, None, every), y=slice(None, None, every)).transpose("y", "x", ...)
    u, v = f.u.values, f.v.values
    speed, (x, y) = np.hypot(u, v), np.meshgrid(f.x * factor, f.y * factor)
    ok = f.chc.values > 0 if "chc" in f else np.isfinite(speed)
    apart = abs(float(f.x[1] - f.x[0])) * factor if f.sizes["x"] > 1 else 1.0
    longest = float(np.nanquantile(speed[ok], 0.99)) if ok.any() else 1.0
    scale = (longest or 1.0) / (2.5 * apart)
    how: dict[str, Any] = {"cmap": "viridis", "width": 0.004, "angles": "xy", "scale_units": "xy", "scale": scale}
    arrows = axis.quiver(x[ok], y[ok], u[ok], v[ok], speed[ok], **how)
    bad = ~ok & np.isfinite(u)
    axis.plot(x[bad], y[bad], "x", color=ACCENT, ms=3, mew=0.8, label="not measured")
    return bool(bad.any()), arrows


@stage(version=5, picture=True)
def flow_picture(flow: Flow, piv: Piv, column: Column | None) -> FlowPicture:
    """Shear rate at the busiest moment with the cone's sides; momentum against time, added mass against depth.

    Without a foot: maps of speed, vorticity, shear rate and divergence.
    """
    field = flow.field
    i = busiest(piv.field)
    if "foot_y" not in piv.field:
        with styled() as Figure:
            return FlowPicture(png(maps(piv.field, field, i, piv.geometry.unit, Figure)))
    factor, shown = (1e3, "mm") if piv.geometry.metric else (1.0, "px")
    with styled() as Figure:
        figure = Figure(figsize=(9.6, 3.9), layout="constrained")
        first, second, third = figure.subplots(1, 3, width_ratios=(1.45, 1, 1))
        shear = field.shear_rate.isel(t=i)
        top = float(np.nanquantile(shear, 0.99)) if np.isfinite(shear).any() else 1.0
        mesh = first.pcolormesh(field.x * factor, field.y * factor, shear, vmin=0, vmax=top or 1.0, cmap="magma")
        figure.colorbar(mesh, ax=first, label="shear rate [1/s]\nγ/√2 in simple shear", shrink=0.85)
        first.set(
            title=f"t = {float(field.t[i]):.3f} s", xlabel=f"x [{shown}]", ylabel=f"y [{shown}] (up)", aspect="equal"
        )
        first.grid(False)
        if column is not None:
            draw_sides(first, column.field, i)
        band(second, field.t * 1e3, field.momentum, field.momentum_sigma, MEASURED)
        second.set(title="momentum, ±2σ", xlabel="time [ms]", ylabel="$P$ of the grains, downwards [kg m/s]")
        depth = field.foot_depth * 1e3
        third.errorbar(
            depth, field.added_mass * 1e3, field.added_mass_sigma * 1e3, fmt=".", color=MEASURED, lw=0.8, ms=4
        )
        third.set(title="added mass $P/v_f$", xlabel="foot depth [mm]", ylabel="$m_a$ [g]")
        return FlowPicture(png(figure))


def band(axis: Axes, x: xr.DataArray, y: xr.DataArray, sigma: xr.DataArray, color: str) -> None:
    """A line with its ±2σ band."""
    axis.fill_between(x, y - 2 * sigma, y + 2 * sigma, color=color, alpha=0.25, lw=0)
    axis.plot(x, y, color=color)


def moments(flow: xr.Dataset) -> AnyArray:
    """Four times, evenly spaced while the foot moves down at a tenth of its greatest speed or more."""
    speed = flow.foot_speed.values
    if np.isfinite(speed).any():
        moving = np.flatnonzero(speed > 0.1 * np.nanmax(speed))
    else:
        moving = np.arange(flow.sizes["t"])
    return np.unique(np.linspace(moving[0], moving[-1], 6)[1:-1].round().astype(int))


def grain_speed(piv: xr.Dataset, flow: xr.Dataset, Figure: NewFigure) -> Figure:
    """Speed downwards over the foot's, at moments of the push-off; grey where it was not measured."""
    at = moments(flow)
    figure = Figure(figsize=(2.6 * len(at), 3.3), layout="compressed")
    axes = figure.subplots(1, len(at), sharey=True, squeeze=False)[0]
    for axis, i in zip(axes, at):
        f = piv.isel(t=i)
        share = (-f.v).where(f.chc > 0) / float(flow.foot_speed[i])
        seen = axis.pcolormesh(f.x * 1e3, f.y * 1e3, share, vmin=0.0, vmax=1.0, cmap=MAP, rasterized=True)
        framed(axis, f)
    figure.colorbar(seen, ax=axes, label="downwards speed / foot's", shrink=0.8)
    return figure


def shear_rate(flow: xr.Dataset, column: xr.Dataset | None, Figure: NewFigure) -> Figure:
    """Shear strain rate at the same moments, with its ridges and the sides of the cone."""
    at = moments(flow)
    figure = Figure(figsize=(2.6 * len(at), 3.3), layout="compressed")
    axes = figure.subplots(1, len(at), sharey=True, squeeze=False)[0]
    top = float(np.nanquantile(flow.shear_rate.isel(t=at), 0.99))
    for axis, i in zip(axes, at):
        f = flow.isel(t=i)
        seen = axis.pcolormesh(f.x * 1e3, f.y * 1e3, f.shear_rate, vmin=0.0, vmax=top, cmap="inferno", rasterized=True)
        if column is not None:
            draw_sides(axis, column, i)
        framed(axis, f)
    figure.colorbar(seen, ax=axes, label="shear rate [1/s]\n(γ/√2 in simple shear)", shrink=0.8)
    return figure


def framed(axis: Axes, f: xr.Dataset) -> None:
    """Equal axes in mm with the time as the title."""
    axis.set(aspect="equal", title=f"{float(f.t) * 1e3:.0f} ms", xlabel="x [mm]", facecolor="#dddddd")
    axis.grid(False)
    if (place := axis.get_subplotspec()) is None or place.is_first_col():
        axis.set_ylabel("y [mm]")


def momentum(flows: Sequence[tuple[str, str, xr.Dataset]], Figure: NewFigure) -> Figure:
    """Momentum of the grains against time from its start, of every film by kind of jump. flows: name, kind, field."""
    figure = Figure(figsize=(4.4, 3.0), layout="constrained")
    axis = figure.subplots()
    for name, kind, f in flows:
        t, p, s = f.t.values, f.momentum.values * 1e3, f.momentum_sigma.values * 1e3
        if not np.isfinite(p).any():
            continue
        start = t[np.argmax(np.nan_to_num(p) > 0.05 * np.nanmax(p))]
        color = kind_of(kind).color
        ms = (t - start) * 1e3
        axis.fill_between(ms, p - 2 * s, p + 2 * s, color=color, alpha=0.2, lw=0)
        axis.plot(ms, p, color=color, label=f"{name}, ±2σ")
    axis.axhline(0.0, color=QUIET, lw=0.6)
    feet = {FOOT.get(f.attrs.get("disc", ""), "") for *_, f in flows}
    axis.set(xlabel="time from the start of the flow [ms]", ylabel="momentum of the grains [g m/s]")
    axis.set_title(feet.pop() if len(feet) == 1 else "")
    axis.legend()
    return figure


def column(fits: Fits, record: Column, Figure: NewFigure) -> Figure:
    """The central column: speeds over depth and time, exponential, beta, front and theta. record: the Column."""
    figure = Figure(figsize=(11.0, 5.4), layout="constrained")
    *drawn, left = figure.subplots(2, 3).flat
    for axis, draw in zip(drawn, COLUMN_PANELS, strict=True):
        draw(axis, fits, record)
    left.remove()
    return figure


def added_mass(fits: Fits, record: Column, flow: Flow, Figure: NewFigure) -> Figure:
    """Added mass against depth with the saturating cone. record, flow: the Column and the Flow."""
    figure = Figure(figsize=(4.4, 3.0), layout="constrained")
    axis = figure.subplots()
    draw_cone(axis, fits, record, flow)
    axis.set_title(FOOT.get(flow.field.attrs.get("disc", ""), ""))
    return figure
