"""Figures of what the films show: tracks beside simulation, grain speeds and shear with the cone, momentum.

They redraw thesis Figs 52 (grains), 57 and 59a (column and cone) from result files.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from .panels import COLUMN_PANELS, draw_cone, draw_sides
from .style import MAP, MEASURED, MODEL, QUIET

FRAMES = 4  # of a sequence
KINDS = {"single": MEASURED, "stutter": "#7a0f24", "delayed_stutter": "black"}  # as in the thesis


def tracks(jumps: Sequence[Mapping[str, Any]], Figure: Any) -> Any:
    """A column a jump: rod height measured and simulated, and their difference. jumps: name, rod and model tables."""
    n = len(jumps)
    figure = Figure(figsize=(3.4 * max(n, 2), 4.0), layout="constrained")
    axes = figure.subplots(2, n, sharex="col", sharey="row", squeeze=False, height_ratios=(2, 1))
    for (top, low), jump in zip(axes.T, jumps):
        rod, model = jump["rod"], jump["model"]
        top.plot(rod.time_s, rod.height_m * 1e3, ".", ms=2, color=MEASURED, label="measured")
        top.set(title=jump["name"])
        low.axhline(0.0, color=QUIET, lw=0.6)
        low.set(xlabel="time [s]")
        if model is not None:
            height = model.rod_m - model.rod_m.iloc[0]
            top.plot(model.time_s, height * 1e3, color=MODEL, label="simulated")
            left = rod.height_m - np.interp(rod.time_s, model.time_s, height)
            low.plot(rod.time_s, left * 1e3, color=MEASURED, lw=0.8)
    axes[0, 0].set(ylabel="rod height [mm]")
    axes[1, 0].set(ylabel="difference [mm]")
    axes[0, 0].legend()
    return figure


def moments(flow: Any) -> Any:
    """FRAMES times, evenly spaced while the foot moves down at a tenth of its greatest speed or more."""
    speed = flow.foot_speed.values
    if np.isfinite(speed).any():
        moving = np.flatnonzero(speed > 0.1 * np.nanmax(speed))
    else:
        moving = np.arange(flow.sizes["t"])
    return np.unique(np.linspace(moving[0], moving[-1], FRAMES + 2)[1:-1].round().astype(int))


def grain_speed(piv: Any, flow: Any, Figure: Any) -> Any:
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


def shear_rate(flow: Any, column: Any, Figure: Any) -> Any:
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


def framed(axis: Any, f: Any) -> None:
    """Equal axes in mm with the time as the title."""
    axis.set(aspect="equal", title=f"{float(f.t) * 1e3:.0f} ms", xlabel="x [mm]", facecolor="#dddddd")
    axis.grid(False)
    if axis.get_subplotspec().is_first_col():
        axis.set_ylabel("y [mm]")


def momentum(flows: Sequence[tuple[str, str, Any]], Figure: Any) -> Any:
    """Momentum of the grains against time from its start, of every film by kind of jump. flows: name, kind, field."""
    figure = Figure(figsize=(4.4, 3.0), layout="constrained")
    axis = figure.subplots()
    for name, kind, f in flows:
        t, p, s = f.t.values, f.momentum.values * 1e3, f.momentum_sigma.values * 1e3
        if not np.isfinite(p).any():
            continue
        start = t[np.argmax(np.nan_to_num(p) > 0.05 * np.nanmax(p))]
        color = KINDS.get(kind, QUIET)
        ms = (t - start) * 1e3
        axis.fill_between(ms, p - 2 * s, p + 2 * s, color=color, alpha=0.2, lw=0)
        axis.plot(ms, p, color=color, label=name)
    axis.axhline(0.0, color=QUIET, lw=0.6)
    axis.set(xlabel="time from the start of the flow [ms]", ylabel="momentum of the grains [g m/s]")
    axis.legend()
    return figure


def column(fits: dict[str, Any], record: Any, Figure: Any) -> Any:
    """The central column: exponential, beta, jammed front and theta against depth. record: the Column."""
    figure = Figure(figsize=(8.6, 5.4), layout="constrained")
    for axis, draw in zip(figure.subplots(2, 2).flat, COLUMN_PANELS, strict=True):
        draw(axis, fits, {"column": record})
    return figure


def added_mass(fits: dict[str, Any], record: Any, flow: Any, Figure: Any) -> Any:
    """Added mass against depth with the saturating cone. record, flow: the Column and the Flow."""
    figure = Figure(figsize=(4.4, 3.0), layout="constrained")
    axis = figure.subplots()
    draw_cone(axis, fits, {"column": record, "flow": flow})
    axis.set_title("")
    return figure
