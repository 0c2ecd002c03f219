"""Pictures of the matter under a foot: simulated discs (thesis Fig 53) and resistive forces on a foot of any shape."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas as pd
import xarray as xr

from jumpvision.base.arrays import Array
from jumpvision.report.figures.pictures import png
from jumpvision.report.style import ACCENT, MEASURED, MODEL, QUIET, kind_of, styled
from jumpvision.thesis.studies.sand.beside import SERIES, Film, compared
from jumpvision.thesis.studies.sand.discs import CONSTANT, DiscBed, DiscNumbers
from jumpvision.thesis.studies.sand.feet import Foot

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHOWN = 0.25, 0.6, 1.0  # of the stroke


def disc_picture(runs: Sequence[xr.Dataset], bed: DiscBed, numbers: DiscNumbers) -> bytes:
    """The first bed at three instants, coloured by speed over that of the foot; front and added mass against depth."""
    data = runs[0]
    with styled() as Figure:
        figure = Figure(figsize=(10.0, 6.4), layout="constrained")
        (top,), (below,) = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.5, 1))
        axes = top.subplots(1, len(SHOWN), sharey=True)
        for axis, share in zip(axes, SHOWN):
            cells = draw_discs(axis, data, bed, round(share * (data.sizes["t"] - 1)))
        axes[0].set_ylabel("y [mm]")
        top.colorbar(cells, ax=list(axes), label="downward speed / foot's", shrink=0.8)
        left, middle, right = below.subplots(1, 3)
        for run in runs:
            depth = -1e3 * run.foot_y.values
            left.plot(depth, 1e3 * run.front, color=MEASURED, lw=1.0)
            middle.plot(depth, run.theta, color=MEASURED, lw=1.0)
            right.plot(depth, run.added_mass, color=MEASURED, lw=1.0)
            right.plot(depth, run.plug, color=MODEL, lw=1.0)
        left.axhline(1e3 * bed.foot * math.sqrt(3.0), color=QUIET, lw=0.8, ls="--")
        left.set(title="front below the face", ylabel="[mm]")
        middle.axhline(60.0, color=QUIET, lw=0.8, ls="--")
        middle.axvspan(1e3 * CONSTANT * bed.stroke, 1e3 * bed.stroke, color=QUIET, alpha=0.15, lw=0)
        middle.set(
            title=f"θ = {with_sigma(numbers.theta_deg, numbers.theta_sigma_deg)}°", ylabel="angle of the sides [°]"
        )
        right.set(title="added mass; the plug alone (orange)", ylabel="[kg]", ylim=(0.0, None))
        for axis in (left, middle, right):
            axis.set_xlabel("depth of the foot [mm]")
        return png(figure)


def beside_picture(films: Sequence[Film], runs: Sequence[Sequence[xr.Dataset]]) -> bytes:
    """Momentum against time, added mass against depth: films with 2 sigma (thesis Fig 52), discs dashed, scaled
    (Fig 53b, c)."""
    with styled() as Figure:
        figure = Figure(figsize=(10.0, 3.8), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1.4, 1))
        for film, beds in zip(films, runs):
            scale, f, color = compared(film, beds).scale, film.flow, kind_of(film.kind).color
            t = 1e3 * (f.t.values - f.t.values[0])
            if scale is not None:
                mean = {n: scale * np.mean([r[n].values for r in beds], axis=0) for n in SERIES}
            places = ((left, t, "momentum"), (right, 1e3 * f.foot_depth.values, "added_mass"))
            for axis, x, name in places:
                y, sigma = 1e3 * f[name].values, 2e3 * f[f"{name}_sigma"].values
                axis.fill_between(x, y - sigma, y + sigma, color=color, alpha=0.2, lw=0)
                axis.plot(x, y, color=color, label=film.name)
                if scale is not None:
                    axis.plot(x, 1e3 * mean[name], "--", color=color, label=f"discs × {scale:.2f}")
        left.set(title="momentum of the grains, down", xlabel="time from the film's first field [ms]", ylabel="[g m/s]")
        room = 1.6 if any(runs) else 1.15  # of discs that glide on it has no bound
        top = 1e3 * room * max(float(np.nanmax(f.flow.added_mass)) for f in films)
        right.set(title="added mass", xlabel="depth of the foot [mm]", ylabel="[g]", ylim=(0, top))
        left.legend()
        return png(figure)


def with_sigma(value: float, sigma: float) -> str:
    """A number of several beds with its sigma, of one bed alone."""
    return f"{value:.1f} ± {sigma:.1f}" if math.isfinite(sigma) else f"{value:.1f}"


def draw_discs(axis: Axes, data: xr.Dataset, bed: DiscBed, k: int) -> Any:
    """The discs near the foot at instant k, and the triangle of 60 degrees below its face."""
    from matplotlib.collections import EllipseCollection
    from matplotlib.patches import Rectangle

    at, before = data.isel(t=k), data.isel(t=k - 1)
    face = 1e3 * float(at.foot_y)
    share = np.clip(((at.y - before.y) / (at.foot_y - before.foot_y)).values, 0.0, 1.0)
    width = 2e3 * at.radius.values
    cells = EllipseCollection(
        width,
        width,
        0.0,
        units="xy",
        offsets=1e3 * np.stack([at.x, at.y], axis=1),
        offset_transform=axis.transData,
        array=share,
        cmap="viridis",
        clim=(0.0, 1.0),
    )
    axis.add_collection(cells)
    foot = 1e3 * bed.foot
    axis.add_patch(Rectangle((-foot, face), 2.0 * foot, foot, color=QUIET))
    axis.plot([-foot, 0.0, foot], [face, face - foot * math.sqrt(3.0), face], color=ACCENT, lw=0.8)
    reach = min(1e3 * bed.half_width, 2.2 * foot)
    axis.set(
        xlim=(-reach, reach),
        ylim=(max(-1e3 * bed.depth, face - 2.4 * foot), 0.7 * foot),
        aspect="equal",
        title=f"{-face:.1f} mm deep",
        xlabel="x [mm]",
    )
    axis.grid(False)
    return cells


def foot_picture(triangles: Array, found: pd.DataFrame, foot: Foot) -> bytes:
    """The foot from the side; vertical and horizontal force against depth by tilt and attack, or against the angle."""
    with styled() as Figure:
        figure = Figure(figsize=(10.0, 3.6), layout="constrained")
        side, *panels = figure.subplots(1, 4, width_ratios=(1, 1.2, 1.2, 1.2))
        draw_side(side, triangles)
        kinds = list(found.groupby(["tilt_deg", "attack_deg"]))
        for axis, name, title in zip(panels, ("Fz_N", "Fx_N", "Ty_Nm"), ("force up [N]", "force along x", "torque, y")):
            if found.depth_m.nunique() > 1:
                curves(axis, kinds, name)
                axis.set_xlabel("depth of the lowest point [mm]")
            else:
                angle = "tilt_deg" if found.tilt_deg.nunique() > 1 else "attack_deg"
                axis.plot(found[angle], found[name], ".-", color=MEASURED)
                axis.set_xlabel(f"{angle.split('_')[0]} [°]")
            axis.set(title=title, ylabel="[N m]" if name == "Ty_Nm" else "[N]")
        if len(kinds) > 1:
            panels[0].legend(fontsize=7)
        return png(figure)


def curves(axis: Axes, kinds: Sequence[object], name: str) -> None:
    """One column against depth for at most 8 pairs of angles, evenly chosen."""
    import matplotlib as mpl

    some = [kinds[round(i)] for i in np.linspace(0, len(kinds) - 1, min(8, len(kinds)))]
    for color, ((tilt, attack), rows) in zip(mpl.colormaps["viridis"](np.linspace(0.0, 0.85, len(some))), some):
        axis.plot(1e3 * rows.depth_m, rows[name], color=color, label=f"tilt {tilt:g}°, attack {attack:g}°")


def draw_side(axis: Axes, triangles: Array) -> None:
    """The body seen along y, as it stands without tilt."""
    from matplotlib.collections import PolyCollection

    order = np.argsort(-triangles[:, :, 1].mean(axis=1))
    axis.add_collection(
        PolyCollection(list(1e3 * triangles[order][:, :, [0, 2]]), facecolor="0.85", edgecolor="0.6", lw=0.2)
    )
    axis.autoscale_view()
    axis.set(aspect="equal", title="the foot", xlabel="x [mm]", ylabel="z [mm]")
    axis.grid(False)
