"""Figures of motion and lift-off: scatter, hopper, traces, least amplitudes (thesis Figs 24, 26-31, 33)."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from jumpvision.experiment.results.fields import attributes_of
from jumpvision.report.style import ACCENT, GREEN, MEASURED, MODEL, QUIET, NewFigure
from jumpvision.thesis.figures.sweeps import figure_of
from jumpvision.thesis.studies import motions, thresholds
from jumpvision.thesis.studies.compute import origin_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@figure_of(motions.scatter)
def scatter(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Standard deviation of the flight height over the map, absolute and relative."""
    import matplotlib as mpl

    figure = Figure(figsize=(9.6, 4.0), layout="constrained")
    axes = figure.subplots(1, 3, sharey=True)
    facts = attributes_of(motions.Scatter, data)
    x, y = data.phase / np.pi, data.frequency
    std, height = data.flight_height_std_m, data.flight_height_m
    share = (std / height.where(height > 1e-4)) * 100
    panels = (
        (height * 1e3, "flight height [mm]", None),
        (std * 1e3, "its scatter [mm]", mpl.colors.LogNorm(0.01, 1.0)),
        (share, "scatter / height [%]", mpl.colors.LogNorm(0.1, 30.0)),
    )
    for axis, (z, title, norm) in zip(axes, panels):
        seen = axis.pcolormesh(x, y, z, shading="nearest", norm=norm, rasterized=True)
        figure.colorbar(seen, ax=axis, extend="both" if norm else "neither")
        axis.axhline(4.0, color="white", lw=0.8, ls=":")
        axis.set(title=title, xlabel="phase [π]", facecolor="#dddddd")
        axis.grid(False)
    axes[0].set_ylabel("frequency [Hz] (dotted: 4 Hz)")
    figure.suptitle(
        f"{facts.trials} trials a point; the spring still rings with {facts.ringing_m * 1e6:g} µm rms",
        fontsize=8,
        color=QUIET,
        x=0.01,
        ha="left",
    )
    return figure


@figure_of(motions.bifurcation)
def bifurcation(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Apexes against frequency, up and down; number of apexes and hysteresis over (f, A)."""
    import matplotlib as mpl

    figure = Figure(figsize=(9.6, 7.0), layout="constrained")
    (top,), (bottom,) = figure.subfigures(2, 1, squeeze=False, height_ratios=(1.25, 1))
    axis = top.subplots()
    for i, (color, mark) in enumerate(((MEASURED, "^"), (MODEL, "v"))):
        heights = data.apex_height_m.isel(direction=i)
        f = np.broadcast_to(data.frequency_ratio.values[:, None], heights.shape)
        axis.plot(f.ravel(), heights.values.ravel() * 1e3, mark, ms=1.2, color=color, alpha=0.5, ls="", rasterized=True)
        axis.plot([], [], mark, color=color, ls="", label=f"frequency going {data.direction.values[i]}")
    facts = attributes_of(motions.Bifurcation, data)
    amp, loss = facts.amplitude_m * 1e3, facts.landing_loss
    axis.set(
        title=f"apexes of the driven hopper, A = {amp:g} mm, landing loss {loss:g}",
        xlabel="$f / f_0$",
        ylabel="height of the centre of mass [mm]",
        yscale="log",
    )
    low = np.nanpercentile(data.apex_height_m, 1) * 1e3 if np.isfinite(data.apex_height_m).any() else 0.1
    axis.set_ylim(bottom=max(low * 0.7, 1e-2))
    axis.legend()
    x, y = data.map_frequency / origin_of(data).f0_Hz, data.map_amplitude * 1e3
    edges = [-0.5, 0.5, 1.5, 2.5, 4.5, 8.5, 99]
    colors = mpl.colormaps["viridis"](np.linspace(0.1, 1.0, 5))
    kinds = mpl.colors.ListedColormap(["#dddddd", *colors])
    axes = bottom.subplots(1, 3, sharey=True)
    for i in range(2):
        seen = axes[i].pcolormesh(
            x,
            y,
            data.map_distinct_apexes.isel(direction=i),
            shading="nearest",
            cmap=kinds,
            norm=mpl.colors.BoundaryNorm(edges, 6),
            rasterized=True,
        )
        axes[i].set(title=f"different apexes, going {data.direction.values[i]}", xlabel="$f / f_0$")
    bar = bottom.colorbar(seen, ax=axes[1])
    bar.set_ticks([0, 1, 2, 3.5, 6.5, 50], labels=["none", "1", "2", "3–4", "5–8", "more"])
    mean = data.map_mean_apex_m
    change = (mean.isel(direction=1) - mean.isel(direction=0)) * 1e3
    span = float(np.nanpercentile(np.abs(change), 98)) or 1.0
    seen = axes[2].pcolormesh(x, y, change, shading="nearest", cmap="RdBu_r", vmin=-span, vmax=span, rasterized=True)
    bottom.colorbar(seen, ax=axes[2], extend="both", label="mm")
    axes[2].set(title="mean apex, down − up", xlabel="$f / f_0$")
    axes[0].set_ylabel("amplitude [mm]")
    for axis in axes:
        axis.grid(False)
    return figure


@figure_of(motions.traces)
def traces(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """A column a jump: positions, velocities, forces and powers against time.

    Light grey where the rod is in the air; dark where the ground carries less than the weight: it pulls.
    """
    count = min(data.sizes["case"], 6)
    figure = Figure(figsize=(2.25 * count + 0.8, 8.2), layout="constrained")
    axes = figure.subplots(4, count, sharex="col", sharey="row", squeeze=False)
    t = data.time.values * 1e3
    constants = origin_of(data).values
    weight = (constants["motor_mass"] + constants["rod_mass"]) * constants["gravity"]
    weight *= 1.0 - 1e-6  # a bit above it, a rod at rest is not pulled
    groups = (
        (
            ("rod_position", "rod", MEASURED, "-"),
            ("motor_position", "motor", MODEL, "--"),
            ("relative_position", "motor on rod", QUIET, ":"),
        ),
        (
            ("rod_velocity", "rod", MEASURED, "-"),
            ("motor_velocity", "motor", MODEL, "--"),
            ("relative_velocity", "motor on rod", QUIET, ":"),
        ),
        (("motor_force", "motor", MODEL, "-"), ("spring_force", "spring", MEASURED, "--")),
        (
            ("internal_power", "internal", ACCENT, "-"),
            ("external_power", "external", GREEN, "--"),
            ("absolute_power", "absolute", QUIET, ":"),
        ),
    )
    scales = ((1e3, "position [mm]"), (1.0, "velocity [m/s]"), (1.0, "force [N]"), (1.0, "power [W]"))
    ends = np.minimum(1e3 / data.case_frequency.values + 130.0, t[-1])  # ms of flight shown after the motor stops
    for j in range(count):
        one = data.isel(case=j)
        stop = 1e3 / float(one.case_frequency)
        air = one.rod_position.values > 0
        pulls = ~air & (one.spring_force.values < weight)
        for i, (group, (factor, name)) in enumerate(zip(groups, scales)):
            axis: Axes = axes[i, j]
            for variable, words, color, style in group:
                axis.plot(t, one[variable] * factor, style, color=color, lw=1.1, label=words)
            for where, shade in ((air, "#ececec"), (pulls, "#c4c4c4")):
                across = axis.get_xaxis_transform()
                axis.fill_between(t, 0, 1, where=where, color=shade, lw=0, transform=across, zorder=0)
            axis.axvline(stop, color="black", lw=0.6, ls=":")
            if j == 0:
                axis.set_ylabel(name)
            if j == count - 1:  # beside the last: in the panels it would lie over the curves
                axis.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
        work = [float(w) * 1e3 for w in one.impulse_work_J]
        title = f"{one.case.item()}\n{float(one.case_frequency):.2f} Hz, {float(one.case_phase) / np.pi:.3g} π"
        axes[0, j].set_title(title, fontsize=8)
        if max(map(abs, work)) > 0.1:
            said = f"impulses\n{work[0]:+.1f}, {work[1]:+.1f} mJ".replace("-", "−")
            axes[3, j].set_title(said, fontsize=7, fontweight="normal")
        axes[3, j].set_xlabel("time [ms]")
        axes[3, j].set_xlim(0, ends[j])
    for i, (group, (factor, _)) in enumerate(zip(groups, scales)):
        seen = [data[v].values[j, t <= ends[j]] * factor for v, *_ in group for j in range(count)]
        low, high = min(map(np.min, seen)), max(map(np.max, seen))
        axes[i, 0].set_ylim(low - 0.06 * (high - low), high + 0.06 * (high - low))
    return figure


STYLES = ((MEASURED, "-"), (MODEL, "--"))


def phase_name(phase: float) -> str:
    """0.75 π as text."""
    return f"phase {phase / np.pi:.3g} π"


@figure_of(thresholds.least_amplitude)
def least_amplitude(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """A_min(f): a panel a phase and number of cycles, both windows."""
    rows, columns = data.sizes["phase"], data.sizes["cycles"]
    figure = Figure(figsize=(3.9 * columns + 0.6, 1.75 * rows + 0.6), layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, sharey="col", squeeze=False)
    for (i, j), axis in np.ndenumerate(axes):
        for k, (color, style) in enumerate(STYLES):
            least = data.minimum_amplitude_m.isel(phase=i, cycles=j, window=k)
            axis.plot(data.frequency_ratio, least * 1e3, style, color=color, label=str(data.window.values[k]))
            if k == 0:
                axis.fill_between(data.frequency_ratio, least * 1e3, 1e3, color=MEASURED, alpha=0.12, lw=0)
        axis.axvline(1.0, color=QUIET, lw=0.8, ls=":")
        n = float(data.cycles[j])
        axis.set_title(f"{phase_name(float(data.phase[i]))}, N = {n:g}")
        top = float(np.nanpercentile(data.minimum_amplitude_m.isel(cycles=j), 90)) * 1e3
        axis.set_ylim(0, top)
        if j == 0:
            axis.set_ylabel("amplitude [mm]")
        if i == rows - 1:
            axis.set_xlabel("$f / f_0$")
    axes[0, 0].legend(title="lift-off until", title_fontsize=8, fontsize=8)
    return figure


@figure_of(thresholds.lift_off_time)
def lift_off_time(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Cycles to lift-off over (f, A), the easiest frequency against N, with the motor's loop, and against damping."""
    import matplotlib as mpl

    phases = min(data.sizes["phase"], 2)
    figure = Figure(figsize=(12.0, 7.0), layout="constrained")
    drawn = figure.subplot_mosaic("aaabbb;ccddee")
    most = attributes_of(thresholds.LiftOffTime, data).cycles
    for i in range(phases):
        axis = drawn["ab"[i]]
        seen = axis.pcolormesh(
            data.frequency_ratio,
            data.amplitude * 1e3,
            data.lift_off_cycles.isel(phase=i).T,
            shading="nearest",
            norm=mpl.colors.LogNorm(0.1, most),
            rasterized=True,
        )
        axis.axvline(1.0, color=QUIET, lw=0.8, ls=":")
        axis.set(
            title=f"cycles to lift-off, {phase_name(float(data.phase[i]))}",
            xlabel="$f / f_0$",
            ylabel="A [mm]",
            facecolor="#dddddd",
        )
        if float(data.amplitude.max() / data.amplitude.min()) > 30:
            axis.set_yscale("log")
        axis.grid(False)
        figure.colorbar(seen, ax=axis, label="cycles (grey: never)")
    if phases == 1:
        drawn["b"].set_visible(False)
    left, middle, right = (drawn[n] for n in "cde")
    for i, (color, style) in zip(range(phases), STYLES):
        name = phase_name(float(data.phase[i]))
        left.plot(
            data.cut_off, data.easiest_frequency_ratio.isel(phase=i), style, marker="o", ms=4, color=color, label=name
        )
        off = data.easiest_ratio_damped.isel(phase=i) - 1.0
        right.plot(data.damping_ratio, off, style, marker="o", ms=4, color=color, label=name)
    left.axhline(1.0, color=QUIET, lw=0.8, ls=":")
    left.set(title="easiest frequency against N", xlabel="cycles N", ylabel="$f_N / f_0$", xscale="log")
    left.legend()
    late = data.cut_off >= min(5.0, float(data.cut_off[-1]))
    first = data.isel(phase=0)
    middle.plot(
        data.cut_off[late], first.easiest_frequency_ratio[late], "o-", ms=4, color=MEASURED, label="stiff motor"
    )
    for kp, dashes in zip(data.loop_stiffness.values, ("--", "-.", ":", "-")):
        held = first.easiest_ratio_looped.sel(loop_stiffness=kp)[late]
        middle.plot(data.cut_off[late], held, color=MODEL, ls=dashes, label=f"loop of {kp / 1e3:.3g} kN/m")
    middle.axhline(1.0, color=QUIET, lw=0.8, ls=":")
    middle.set(title="with the motor's loop", xlabel="cycles N", ylabel="$f_N / f_0$", xscale="log")
    middle.legend(fontsize=7)
    z = np.linspace(float(data.damping_ratio[0]), float(data.damping_ratio[-1]), 100)
    right.plot(z, 1 / np.sqrt(1 - 2 * z**2) - 1, color=QUIET, lw=0.9, label="1/√(1 − 2ζ²): inertial forcing")
    right.plot(z, np.sqrt(1 - 2 * z**2) - 1, color=QUIET, lw=0.9, ls=":", label="√(1 − 2ζ²): as suspected")
    right.set(
        title=f"damping never lowers it (N = {float(data.cut_off[-1]):g})",
        xlabel="damping ratio ζ",
        ylabel="$f_N / f_0 - 1$",
    )
    right.legend(fontsize=7)
    return figure


@figure_of(thresholds.power_limit)
def power_limit(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Best height under a limit of the motor's power, and at which frequency and amplitude; a catapult beside them."""
    figure = Figure(figsize=(9.6, 3.6), layout="constrained")
    axes = figure.subplots(1, 3)
    shot = attributes_of(thresholds.Catapult, data)
    shown = {
        "best height [mm]": 1e3 * data.com_height_m,
        "$f / f_0$": data.frequency_ratio,
        "A [mm]": 1e3 * data.amplitude_m,
    }
    for axis, (words, values) in zip(axes, shown.items()):
        for name, color, style in (("stutter", MODEL, "-"), ("single", MEASURED, "--")):
            axis.plot(data.power, values.sel(jump=name), style, color=color, label=name)
        axis.set(title=words, xlabel="limit of the motor's power [W]", xscale="log", ylim=(0, None))
    axes[0].axhline(1e3 * shot.height_m, color=GREEN, ls=":", label="catapult, loaded slowly")
    axes[0].set(ylim=(0, 1.5e3 * np.nanmax([shot.height_m, data.com_height_m.max()])))
    axes[0].legend(loc="upper left")
    return figure
