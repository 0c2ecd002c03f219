"""Discs under a foot (thesis Fig 53): the bed, forces and masses against depth, a film's momentum beside theirs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from jumpvision.base.arrays import Array
from jumpvision.report.style import ACCENT, MEASURED, MODEL, QUIET, styled

from .pictures import png

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHOWN = 0.25, 0.6, 1.0  # of the way to the deepest place


def disc_picture(runs: Sequence[xr.Dataset], foot: float, film: tuple[xr.Dataset, Array] | None = None) -> bytes:
    """Draw the first bed at three instants, coloured by speed over the foot's, and force, added mass and plug against
    depth. foot: half width [m]. film: momentum and its sigma over t, and the momentum of discs (bed, t) [kg m/s]."""
    data = runs[0]
    with styled() as Figure:
        figure = Figure(figsize=(10.0, 6.4), layout="constrained")
        (top,), (below,) = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.5, 1))
        axes = top.subplots(1, len(SHOWN), sharey=True)
        for axis, share in zip(axes, SHOWN):
            cells = draw_discs(axis, data, foot, max(round(share * int(np.argmin(data.foot_y.values))), 1))
        axes[0].set_ylabel("y [mm]")
        top.colorbar(cells, ax=list(axes), label="downward speed / foot's", shrink=0.8)
        left, right, *last = below.subplots(1, 3 if film else 2)
        for run in runs:
            depth = -1e3 * run.foot_y.values
            left.plot(depth, run.foot_force, color=MEASURED, lw=1.0)
            right.plot(depth, run.added_mass, color=MEASURED, lw=1.0)
            right.plot(depth, run.plug, color=MODEL, lw=1.0)
        left.set(title="force on the foot", ylabel="force [N]")
        right.set(title="added mass; plug (orange)", ylabel="mass [kg]", ylim=(0.0, None))
        for axis in (left, right):
            axis.set_xlabel("depth of the foot [mm]")
        if film:
            draw_film(last[0], *film)
        return png(figure)


def draw_film(axis: Axes, flow: xr.Dataset, discs: Array) -> None:
    """Draw a film's momentum with 2 sigma, and that of discs (bed, t) (thesis Fig 53b)."""
    ms, film, sigma = 1e3 * (flow.t - flow.t[0]), 1e3 * flow.momentum, 2e3 * flow.momentum_sigma
    axis.fill_between(ms, film - sigma, film + sigma, color=MEASURED, alpha=0.2, lw=0)
    axis.plot(ms, film, color=MEASURED)
    axis.plot(ms, 1e3 * discs.T, "--", color=MODEL, lw=1.0)
    axis.set(title="momentum; of discs (orange)", xlabel="time [ms]", ylabel="momentum [g m/s]")


def draw_discs(axis: Axes, data: xr.Dataset, foot: float, k: int) -> Any:
    """Draw the discs near the foot at instant k, and the triangle of 60 degrees below its face."""
    from matplotlib.collections import EllipseCollection
    from matplotlib.patches import Rectangle

    at, before, foot = data.isel(t=k), data.isel(t=k - 1), 1e3 * foot
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
    axis.add_patch(Rectangle((-foot, face), 2.0 * foot, foot, color=QUIET))
    axis.plot([-foot, 0.0, foot], [face, face - foot * math.sqrt(3.0), face], color=ACCENT, lw=0.8)
    low = max(1e3 * float(data.y.min()), face - 2.4 * foot)
    title = f"{-face:.1f} mm deep"
    axis.set(xlim=(-2.2 * foot, 2.2 * foot), ylim=(low, 0.7 * foot), aspect="equal", title=title, xlabel="x [mm]")
    axis.grid(False)
    return cells
