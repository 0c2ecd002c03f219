"""Figures of plans over a ladder of heights: thesis Figs 64 and 65."""

from __future__ import annotations

from typing import TYPE_CHECKING

import xarray as xr

from jumpvision.experiment.results.fields import attributes_of
from jumpvision.report.style import GREEN, MEASURED, MODEL, QUIET, NewFigure
from jumpvision.thesis.figures.sweeps import figure_of
from jumpvision.thesis.studies import plans

if TYPE_CHECKING:
    from matplotlib.figure import Figure

GROUPS = {
    "rigid plan, rigid ground": (GREEN, "s"),
    "granular plan, sand": (MODEL, "s"),
    "rigid plan, sand": (MEASURED, "s"),
}


@figure_of(plans.plan_heights)
def plan_heights(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Jumped against planned heights."""
    figure = Figure(figsize=(5.6, 4.6), layout="constrained")
    axis = figure.subplots()
    planned = data.apex.values * 1e3
    axis.plot(planned, planned, color=QUIET, lw=0.8)
    for name, (color, mark) in GROUPS.items():
        jumped = data.jumped_m.sel(group=name) * 1e3
        spread = jumped.std("robot")
        axis.errorbar(planned, jumped.mean("robot"), spread, fmt=mark, ms=4, color=color, capsize=2, label=name)
    axis.plot(planned, data.resimulated_m.sel(ground="sand") * 1e3, "o", ms=8, mfc="none", mec="black", label="planned")
    axis.set(xlabel="planned height [mm]", ylabel="jumped height [mm]", title="plans of least effort", ylim=(0, None))
    axis.legend(fontsize=7)
    return figure


@figure_of(plans.plan_strategies)
def plan_strategies(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Motor against time for every height on both grounds, and how far it travels."""
    import matplotlib as mpl

    figure = Figure(figsize=(10.6, 3.6), layout="constrained")
    *panels, last = figure.subplots(1, 3)
    colors = mpl.colormaps["viridis"]
    for axis, ground in zip(panels, data.ground.values):
        for i, apex in enumerate(data.apex.values):
            one = data.sel(ground=ground, apex=apex)
            runs = abs(one.time_from_take_off + one.take_off_s - 0.5 * one.duration_s) <= 0.5 * one.duration_s
            one = one.isel(time_from_take_off=runs.values)
            axis.plot(
                one.time_from_take_off * 1e3,
                one.motor_m * 1e3,
                color=colors(i / data.apex.size),
                label=f"{1e3 * apex:.0f} mm",
            )
        objective = attributes_of(plans.Plans, data).objective
        axis.set(title=f"{ground}, least {objective}", xlabel="time from take-off [ms]", ylabel="motor on the rod [mm]")
    panels[0].legend(fontsize=6)
    travel = data.amplitude_m * 1e3
    for ground, color in (("rigid", GREEN), ("sand", MODEL)):
        last.plot(data.apex * 1e3, travel.sel(ground=ground), "o-", ms=3, color=color, label=ground)
    ratio = travel.sel(ground="sand") / travel.sel(ground="rigid")
    last.set(title=f"travel; sand / rigid: {float(ratio.min()):.1f} to {float(ratio.max()):.1f}", ylim=(0, None))
    last.set(xlabel="planned height [mm]", ylabel="travel of the motor [mm]")
    last.legend(fontsize=7)
    return figure
