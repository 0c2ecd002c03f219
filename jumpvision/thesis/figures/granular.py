"""Figures of jumps on sand: thesis Figs 45, 47, 49, 59(b), 60, 61, the scale of the drag and the size of the foot."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from jumpvision.experiment.results.fields import attributes_of, unit_of
from jumpvision.jumper.physics.sand.jump import MODES
from jumpvision.report.style import ACCENT, GREEN, MEASURED, MODEL, QUIET, NewFigure
from jumpvision.thesis.figures.sweeps import figure_of
from jumpvision.thesis.studies.sand import beds, models
from jumpvision.thesis.studies.sand import drag_fit as measured
from jumpvision.thesis.studies.sand import packing as prepared

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

TYPE = {"single": (MEASURED, "o"), "stutter": (MODEL, "s"), "delayed stutter": (GREEN, "^")}
FORCE = {  # force model: colour, line
    "static": (GREEN, ":"),
    "constant drag": ("black", "--"),
    "depth drag": (QUIET, "-."),
    "drag and added mass": (ACCENT, (0, (5, 1, 1, 1))),
    "cone": (MODEL, "-"),
}
PHI = "volume fraction φ"
HEIGHT = "jump height [mm]"


@figure_of(beds.height_phi)
def height_phi(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """The map of heights, and the best height and its frequency against packing."""
    figure = Figure(figsize=(9.6, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.2, 1))
    h = data.jump_height_m * 1e3
    seen = left.pcolormesh(data.phi, data.frequency, h, shading="nearest", rasterized=True)
    figure.colorbar(seen, ax=left).ax.set_ylabel("[mm]")
    left.plot(data.phi, data.best_frequency_Hz, "w.", ms=3)
    left.set(title="single jump height (white: best f)", xlabel=PHI, ylabel="frequency [Hz]")
    left.grid(False)
    right.plot(data.phi, h.max("frequency"), "o-", ms=3, color=MEASURED)
    hard = float(data.hard_ground_height_m) * 1e3
    right.axhline(hard, color=QUIET, ls="--", lw=1)
    right.axhline(hard / 3, color=QUIET, ls=":", lw=1)
    right.set(
        title="best single; dashed: hard ground,\ndotted: a third of it", xlabel=PHI, ylabel=HEIGHT, ylim=(0, None)
    )
    return figure


@figure_of(beds.jump_types)
def jump_types(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Types against packing, the cone and the older model; heights from after the hop; the fitted drag."""
    figure = Figure(figsize=(10.6, 3.8), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.5, 1.1, 1))
    for kind, (color, mark) in TYPE.items():
        one = data.sel(jump=kind)
        f = float(one.kept_frequency_Hz)
        left.plot(data.phi, one.jump_height_m * 1e3, mark + "-", ms=4, color=color, label=f"{kind}, {f:.3g} Hz")
        left.plot(data.phi, one.baseline_height_m * 1e3, "--", color=color, lw=1)
        left.axhline(float(one.hard_ground_height_m) * 1e3, color=color, lw=0.7, ls=":")
    left.set(
        title=f"cone; dashed: {attributes_of(beds.JumpTypes, data).baseline};\ndotted: hard ground",
        xlabel=PHI,
        ylabel=HEIGHT,
    )
    left.legend(fontsize=7)
    delayed, single = data.jump_height_m.sel(jump="delayed stutter"), data.jump_height_m.sel(jump="single")
    middle.plot(data.phi, single * 1e3, "o-", ms=3, color=MEASURED, label="single")
    middle.plot(data.phi, delayed * 1e3, "^-", ms=3, color=GREEN, label="delayed, from the start")
    middle.plot(data.phi, data.height_after_hop_m * 1e3, "v--", ms=3, color=ACCENT, label="delayed, from after the hop")
    middle.set(title="measured from after the hop", xlabel=PHI, ylabel=HEIGHT)
    middle.legend(fontsize=7)
    right.plot(data.phi, data.alpha_kg_per_m, "o-", ms=3, color="black")
    right.set(title="α fitted to the singles", xlabel=PHI, ylabel="α [kg/m]", ylim=(0, None))
    return figure


@figure_of(beds.ringing)
def ringing(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Heights of undamped delayed jumps against packing, beside damped ones and singles."""
    figure = Figure(figsize=(7.2, 3.6), layout="constrained")
    axis = figure.subplots()
    gain = attributes_of(beds.Ringing, data).dwell_gain
    axis.plot(data.phi, data.jump_height_m * 1e3, color=ACCENT, label="delayed, spring rings on (full gain)")
    axis.plot(data.phi, data.damped_height_m * 1e3, color=GREEN, label=f"delayed, gain x {gain:g} in the pause")
    axis.plot(data.phi, data.single_height_m * 1e3, color=MEASURED, label="single")
    axis.set(title=f"delayed stutter at {float(data.frequency):.3g} Hz", xlabel=PHI, ylabel=HEIGHT)
    axis.legend(fontsize=7)
    return figure


@figure_of(beds.delay)
def delay(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Heights against delay."""
    figure = Figure(figsize=(8.4, 3.6), layout="constrained")
    axis = figure.subplots()
    facts, wait = attributes_of(beds.Delay, data), data.delay * 1e3
    axis.plot(wait, data.undamped_height_m * 1e3, color=QUIET, lw=0.7, label="cone, full gain in the pause")
    axis.plot(wait, data.jump_height_m * 1e3, color=MODEL, label=f"cone, gain x {facts.dwell_gain:g} in the pause")
    axis.plot(wait, data.baseline_height_m * 1e3, "--", color="black", lw=1, label=facts.baseline)
    axis.axhline(float(data.single_height_m) * 1e3, color=MEASURED, lw=1, ls=":", label="best single")
    axis.axvline(facts.loaded_half_period_s * 1e3, color=QUIET, lw=0.8)
    title = f"delayed stutter at {float(data.frequency):.3g} Hz (grey: half a loaded period)"
    axis.set(title=title, xlabel="delay [ms]", ylabel=HEIGHT)
    axis.legend(fontsize=7, ncols=2)
    return figure


@figure_of(models.alpha_fit)
def alpha_fit(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Heights with constant drags, and the fitted drag against packing."""
    import matplotlib as mpl

    figure = Figure(figsize=(9.6, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.4, 1))
    facts = attributes_of(models.AlphaFit, data)
    norm, colors = mpl.colors.SymLogNorm(10.0, vmin=0.0, vmax=float(data.drag[-1])), mpl.colormaps["viridis"]
    for drag in data.drag.values:
        left.plot(data.frequency, data.tried_height_m.sel(drag=drag) * 1e3, lw=0.8, color=colors(norm(drag)))
    left.plot(data.frequency, data.jump_height_m * 1e3, "--", color="black", label=f"fitted, {facts.alpha:.0f} kg/m")
    left.plot(data.frequency, data.cone_height_m * 1e3, "s", ms=3.5, color=MODEL, label="cone, taken as measured")
    bar = figure.colorbar(mpl.cm.ScalarMappable(norm, colors), ax=left)
    bar.ax.set_ylabel("α [kg/m]")
    bar.set_ticks([0, 10, 100, 1000], labels=["0", "10", "100", "1000"])
    left.set(title=f"single jumps at φ = {facts.phi:.3g}", xlabel="frequency [Hz]", ylabel=HEIGHT)
    left.legend(fontsize=7)
    right.plot(data.packing, data.alpha_kg_per_m, "o-", ms=3, color="black")
    right.set(title="α of the singles", xlabel=PHI, ylabel="α [kg/m]", ylim=(0, None))
    return figure


@figure_of(models.force_models)
def force_models(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Motion with the cone, spring force with every force model, what it comes to; four moments of the landing."""
    figure = Figure(figsize=(10.6, 9.2), layout="constrained")
    upper, lower = figure.subfigures(2, 1, height_ratios=(2.0, 1.1)).flat  # type: ignore[union-attr]
    (motion, push), (feet, bars) = upper.subplots(2, 2)
    ms = data.time * 1e3
    facts = attributes_of(models.ForceModels, data)
    up = [x * 1e3 for x in facts.upswing_s]
    cone = data.sel(model="cone")
    for name, color in (("motor", QUIET), ("rod", MEASURED), ("foot", MODEL)):
        motion.plot(ms, (cone[name] - cone[name][0]) * 1e3, color=color, label=name)
    mass = motion.twinx()
    mass.fill_between(ms, 0, cone.added_mass * 1e3, color="#E69F00", alpha=0.35, lw=0)
    mass.set(ylabel="added mass [g] (orange)", ylim=(0, 4e3 * float(cone.added_mass.max())))
    mass.grid(False)
    motion.set(title=f"cone, {facts.frequency:.3g} Hz, φ = {facts.phi:.3g}", ylabel="position [mm]")
    motion.legend(fontsize=7)
    for name, (color, line) in FORCE.items():
        one = data.sel(model=name)
        push.plot(ms, one.spring_force, ls=line, color=color, label=name)
        feet.plot(ms, (one.foot - one.foot[0]) * 1e3, ls=line, color=color, label=name)
    push.set(title="spring force (blue: the motor swings up)", ylabel="[N]", xlim=(0, up[1] * 1.3))
    feet.set(title="foot", xlabel="time [ms]", ylabel="[mm]", xlim=(0, up[1] * 1.3))
    feet.legend(fontsize=7)
    motion.set(xlabel="time [ms]")
    for axis in (motion, push, feet):
        axis.axvspan(*up, color=MEASURED, alpha=0.1, lw=0)
    names = list(FORCE)
    h = data.jump_height_m.sel(model=names) * 1e3
    bars.barh(names, h, color=[c for c, _ in FORCE.values()])
    for i, name in enumerate(names):
        bars.text(float(h[i]) + 0.4, i, f"{float(data.mean_push_N.sel(model=name)):.1f} N", va="center", fontsize=7)
    bars.set(title="jump height; mean spring force in the upswing", xlabel="[mm]", xlim=(0, float(h.max()) * 1.2))
    bars.invert_yaxis()
    row = lower.subplots(1, 4, sharey=True)
    for axis, (words, i) in zip(row, moments(cone).items()):
        snapshot(axis, cone.isel(time=i), cone.isel(time=0), facts)
        axis.set_title(f"{words}, {float(ms[i]):.1f} ms", fontsize=8)
    row[0].set_ylabel("height [mm]")
    return figure


def moments(cone: xr.Dataset) -> dict[str, int]:
    """Samples of the longest intrusion: the foot lands, half of the added mass has come, all of it, the foot rests."""
    intrudes = np.flatnonzero(cone["mode"].values == MODES.index("intrude"))
    if intrudes.size == 0:
        return {"at rest": 0}
    runs = np.split(intrudes, np.flatnonzero(np.diff(intrudes) > 1) + 1)
    one = max(runs, key=lambda r: r.size)
    mass = cone.added_mass.values[one]
    return {
        "foot lands": int(one[0]),
        "sand joins": int(one[np.argmax(mass >= 0.5 * (mass[0] + mass.max()))]),
        "whole cone": int(one[np.argmax(mass)]),
        "foot rests": int(min(one[-1] + 1, cone.sizes["time"] - 1)),
    }


ROBOT = (60.0, 150.0, 70.0, 45.0)  # mm: rest of the spring, rod, motor above the rod's lower end, motor's height


def snapshot(axis: Axes, now: xr.Dataset, rest: xr.Dataset, facts: models.ForceModels) -> None:
    """The robot over and in the sand: foot, spring, rod, motor at their places [mm], and the sand that goes with it."""
    spring, rod, above, high = ROBOT
    foot, radius = 1e3 * float(now.foot), 1e3 * facts.foot_radius
    lower = 1e3 * float(rest.foot) + spring + 1e3 * float(now.rod - rest.rod)
    motor = lower + above + 1e3 * float((now.motor - now.rod) - (rest.motor - rest.rod))
    axis.axhspan(-110.0, 0.0, color="#e8d3a8", lw=0)
    if float(now.added_mass) > 0.0:
        jammed = min(-facts.mu * foot, radius * np.tan(facts.theta))
        left = radius - jammed / np.tan(facts.theta)
        edge = ([-radius, radius, left, -left], [foot, foot, foot - jammed, foot - jammed])
        axis.fill(*edge, color="#E69F00", lw=0)
    axis.plot([-radius, radius], [foot, foot], color=MODEL, lw=3, solid_capstyle="butt")
    turns = np.linspace(foot, lower, 11)
    axis.plot(np.r_[0.0, 7.0 * (-1.0) ** np.arange(9), 0.0], turns, color=QUIET, lw=1)
    axis.plot([0.0, 0.0], [lower, lower + rod], color=MEASURED, lw=3, solid_capstyle="butt")
    axis.fill([-18.0, 18.0, 18.0, -18.0], [motor, motor, motor + high, motor + high], color=QUIET, lw=0)
    axis.set(xlim=(-70.0, 70.0), ylim=(-110.0, 260.0), aspect="equal", xticks=[])
    axis.grid(False)


@figure_of(models.drag_scale)
def drag_scale(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Heights with b scaled and without added mass, loose and dense."""
    n = data.sizes["phi"]
    figure = Figure(figsize=(9.6, 3.1 * n), layout="constrained")
    axes = figure.subplots(n, 2, squeeze=False, sharex=True)
    for (i, j), axis in np.ndenumerate(axes):
        one = data.isel(phi=i, jump=j)
        for scale, line in zip(data.scale.values, (":", "-", "--")):
            axis.plot(
                data.frequency, one.scaled_height_m.sel(scale=scale) * 1e3, line, color=MODEL, label=f"{scale:g} b"
            )
        axis.plot(data.frequency, one.massless_height_m * 1e3, "-.", color=MEASURED, label="b, no added mass")
        axis.set(title=f"{one.jump.values!s}, φ = {float(one.phi):.3g}", ylabel=HEIGHT)
        if i == n - 1:
            axis.set(xlabel="frequency [Hz]")
    axes[0, 0].legend(fontsize=7)
    return figure


@figure_of(beds.foot_radius)
def foot_radius(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Best heights, and drag and added mass against the radius."""
    figure = Figure(figsize=(9.6, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    r = data.foot_radius * 1e3
    for kind in data.jump.values:
        color, mark = TYPE[str(kind)]
        left.plot(r, data.jump_height_m.sel(jump=kind) * 1e3, mark + "-", ms=3, color=color, label=f"best {kind}")
    left.set(title="best height over frequency", xlabel="foot radius [mm]", ylabel=HEIGHT)
    left.legend(fontsize=7)
    middle = data.foot_radius.size // 2
    for name, label, color, line in (
        ("drag_kg_per_m", "drag at the surface, R²", MODEL, "-"),
        ("added_mass_kg", "added mass, R³", MEASURED, "--"),
    ):
        right.plot(r, data[name] / float(data[name][middle]), line, color=color, label=label)
    right.set(title=f"relative to R = {float(r[middle]):.3g} mm", xlabel="foot radius [mm]", ylim=(0, None))
    right.legend(fontsize=7)
    return figure


@figure_of(measured.drag_fit)
def drag_fit(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """The drag fitted to the measured jumps of every packing, and those jumps."""
    figure = Figure(figsize=(9.6, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    name, unit = attributes_of(measured.DragFit, data).parameter, unit_of(data.value)
    left.errorbar(
        data.packing, data.value, 2.0 * data.value_sigma, 2.0 * data.packing_sigma, fmt="o", ms=4, color=MEASURED
    )
    left.set(
        title=f"{name} of the measured jumps, ±2σ", xlabel=PHI, ylabel=name + (f" [{unit}]" if unit != "1" else "")
    )
    right.errorbar(data.phi_of_jump, data.measured_height_m * 1e3, 2e3 * data.sigma_height_m, fmt=".", color=MEASURED)
    right.set(title="the jumps", xlabel=PHI, ylabel=HEIGHT)
    return figure


@figure_of(prepared.packing)
def packing(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """The beds and the law of each setting, with its uncertainty."""
    figure = Figure(figsize=(6.4, 4.2), layout="constrained")
    axis = figure.subplots()
    names = attributes_of(prepared.Settings, data).settings.split(" | ")
    colors = [MEASURED, MODEL, GREEN, ACCENT, QUIET]
    for i, name in enumerate(names):
        color, of = colors[i % len(colors)], data.setting_of_bed == i
        axis.errorbar(
            data.pulses[of], data.volume_fraction[of], 2 * data.sigma_volume_fraction[of], fmt="o", ms=4, color=color
        )
        line, sigma = data.law_volume_fraction[i], 2 * data.law_sigma[i]
        axis.plot(data.law_pulses, line, color=color, label=f"{name}: {data.law.values[i]} law")
        axis.fill_between(data.law_pulses, line - sigma, line + sigma, color=color, alpha=0.2, lw=0)
    axis.set_xscale("symlog", linthresh=1.0)
    axis.set(xlim=(0, None), xlabel="air pulses since fluidisation", ylabel=PHI, title="packing of the bed, ±2σ")
    axis.legend(fontsize=7)
    return figure
