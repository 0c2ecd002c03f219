"""Pictures of the grains under the foot: their velocities, strain, momentum and added mass."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..records import Column, Flow, Piv
from ..sections import Calibration, GrainVideo, PivField
from ..stage import stage
from ..stages.films import open_grains
from .panels import draw_sides
from .pictures import Picture, png
from .style import ACCENT, MEASURED, styled


class PivPicture(Picture):
    file = "piv.png"


class FlowPicture(Picture):
    file = "flow.png"


def busiest(field: Any) -> int:
    """Index of the frame with the largest mean speed."""
    speed = np.hypot(field.u, field.v).where(field.chc > 0).mean(("y", "x"))
    return int(speed.fillna(0).argmax("t"))


@stage(version=2, picture=True)
def piv_picture(
    piv: Piv, film: GrainVideo | None, calibration: Calibration | None, given: PivField | None
) -> PivPicture:  # fmt: skip
    """Velocity vectors at the busiest moment, over the grains where their film is known; replaced ones told apart."""
    field = piv.field
    i = busiest(field)
    image = None
    if film is not None and given is None:
        straight, film = open_grains(film, calibration)
        with straight as frames:
            image = frames[i * int(field.attrs.get("ensemble_pairs", 1))]
    unit = field.u.attrs["units"].split("/")[0]
    factor, shown = (1e3, "mm") if unit == "m" else (1.0, "px")
    scale = field.attrs["scale_m_per_px"] if unit == "m" else 1.0
    origin_x, origin_y = field.attrs["origin_column_px"], field.attrs["origin_row_px"]
    rows, columns = field.attrs["image_rows"], field.attrs["image_columns"]
    extent = (
        np.array([-0.5 - origin_x, columns - 0.5 - origin_x, -(rows - 0.5 - origin_y), origin_y + 0.5]) * scale * factor
    )
    every = max(1, len(field.x) // 32)
    f = field.isel(t=i, x=slice(None, None, every), y=slice(None, None, every))
    with styled() as Figure:
        figure = Figure(figsize=(6.4, min(8.0, 0.7 + 5.2 * rows / columns)), layout="constrained")
        axis = figure.subplots()
        if image is not None:
            axis.imshow(image, cmap="gray", extent=extent, alpha=0.75)
        axis.set_aspect("equal")
        speed = np.hypot(f.u, f.v)
        x, y = np.meshgrid(f.x * factor, f.y * factor)
        ok = f.chc.values > 0
        apart = abs(float(f.x[1] - f.x[0])) * factor if f.sizes["x"] > 1 else 1.0
        longest = float(np.nanquantile(speed.values[ok], 0.99)) if ok.any() else 1.0
        size = {"angles": "xy", "scale_units": "xy", "scale": (longest or 1.0) / (2.5 * apart)}
        arrows = axis.quiver(
            x[ok], y[ok], f.u.values[ok], f.v.values[ok], speed.values[ok], cmap="viridis", width=0.004, **size
        )
        bad = ~ok & np.isfinite(f.u.values)
        axis.plot(x[bad], y[bad], "x", color=ACCENT, ms=3, mew=0.8, label="not measured")
        if bad.any():
            axis.legend(loc="lower right", facecolor="white", frameon=True)
        axis.set_xlim(extent[0], extent[1])
        axis.set_ylim(extent[2], extent[3])
        figure.colorbar(arrows, ax=axis, label=f"speed [{field.u.attrs['units']}]", shrink=0.8)
        share = float((field.chc.isel(t=i) > 0).sum() / np.isfinite(field.u.isel(t=i)).sum())
        axis.set(
            title=f"t = {float(field.t[i]):.3f} s, {100 * share:.1f} % of vectors measured",
            xlabel=f"x [{shown}]", ylabel=f"y [{shown}] (up)",
        )  # fmt: skip
        axis.grid(False)
        return PivPicture(png(figure))


@stage(version=2, picture=True)
def flow_picture(flow: Flow, piv: Piv, column: Column | None) -> FlowPicture:
    """Shear rate at the busiest moment with the cone's sides; momentum against time, added mass against depth."""
    field = flow.field
    i = busiest(piv.field)
    metres = field.x.attrs["units"] == "m"
    factor, shown = (1e3, "mm") if metres else (1.0, "px")
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
        second.set(title="grain momentum, downwards", xlabel="time [ms]", ylabel="P [kg m/s]")
        depth = field.foot_depth * 1e3
        third.errorbar(
            depth, field.added_mass * 1e3, field.added_mass_sigma * 1e3, fmt=".", color=MEASURED, lw=0.8, ms=4
        )
        third.set(title="added mass P / v_foot", xlabel="foot depth [mm]", ylabel="m_a [g]")
        return FlowPicture(png(figure))


def band(axis: Any, x: Any, y: Any, sigma: Any, color: str) -> None:
    """A line with its ±2σ band."""
    axis.fill_between(x, y - 2 * sigma, y + 2 * sigma, color=color, alpha=0.25, lw=0)
    axis.plot(x, y, color=color)
