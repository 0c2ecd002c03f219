"""Figures of logs: slow intrusions (thesis Figs 48, 50, 55, 58, 69), spring tests, the actuator (Fig 19c)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jumpvision.base.arrays import Array, measured
from jumpvision.estimate.estimate import Estimate, finite
from jumpvision.estimate.robot import Bandwidth
from jumpvision.experiment.campaign.measured.actuator import Driven
from jumpvision.experiment.campaign.measured.intrusions import IntrusionLaws, SlowIntrusion
from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.sections import Actuation, MotorLog, NotApplicable
from jumpvision.experiment.results.values import ConeValues, Fits, Intrusion, IntrusionEvent, SpringTest
from jumpvision.experiment.stages.rod import commanded, motor_in
from jumpvision.experiment.workflow.stage import stage
from jumpvision.report.style import ACCENT, GREEN, MEASURED, MODEL, QUIET, NewFigure, label_points, styled

from .pictures import Picture, png

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class IntrusionPicture(Picture):
    file = "intrusion.png"


@stage(version=2, picture=True)
def intrusion_picture(intrusion: Intrusion) -> IntrusionPicture:
    """The figure of one log."""
    with styled() as Figure:
        return IntrusionPicture(png(single(intrusion, Figure)))


def single(intrusion: Intrusion, Figure: NewFigure) -> Figure:
    """Force against depth with the fitted curve and the cone; what is left over; overshoot against depth."""
    v, fits = intrusion.values, intrusion.fits
    p = v["profile"]
    z, force, fitted = np.array(p["depth_m"]) * 1e3, np.array(p["force_N"]), np.array(p["fitted_N"])
    figure = Figure(figsize=(9.6, 3.6), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.5, 1, 1))
    left.plot(z, force, ".", ms=3, color=MEASURED, label="measured")
    left.plot(z, fitted, color=MODEL, label="fit")
    if v["events"]:
        left.plot(z, p["first_N"], color=MODEL, lw=0.8, ls="--", label="without events")
    if v["cone"]:
        draw_cone(left, z, v["cone"])
    if delta := fits.determined("delta"):
        left.axvline(delta.value * 1e3, color=QUIET, lw=0.8, label=r"bend $\delta$")
        left.set_title(rf"$\delta$ = {with_sigma(delta, 1e3)} mm")
    else:
        left.set_title(f"one slope suffices (p = {v['p_one_slope']:.2g})")
    left.set(xlabel="depth below the surface [mm]", ylabel="force [N]")
    left.legend()
    middle.plot(z, force - fitted, color=MEASURED, lw=0.8)
    middle.set(title="measured − fit", xlabel="depth below the surface [mm]", ylabel="difference [N]")
    draw_events(right, v["events"], fits)
    return figure


def draw_cone(axis: Axes, z: Array, cone: ConeValues) -> None:
    """The fitted cone against depth [mm], and its flat face and mantle apart (thesis Fig 55)."""
    axis.plot(z, np.array(cone["force_N"]), color=GREEN, lw=1.0, ls=":", label="RFT cone, fitted")
    for part, force, ls in (("flat", cone["flat_N"], "--"), ("mantle", cone["mantle_N"], "-.")):
        axis.plot(z, np.array(force), color=GREEN, lw=0.7, ls=ls, label=f"its {part}")
    if cone["complete_depth_m"] * 1e3 < np.max(z):
        axis.axvline(cone["complete_depth_m"] * 1e3, color=GREEN, lw=0.6, ls=":", label="cone complete")


def draw_events(axis: Axes, events: Sequence[IntrusionEvent], fits: Fits) -> None:
    """Overshoot against depth, with the proportional law of each kind."""
    for kind, name, color, mark in (("reintrusion", "s", MEASURED, "o"), ("stop_go", "s_p", ACCENT, "s")):
        mine = [e for e in events if e["kind"] == kind]
        if not mine:
            continue
        z = np.array([e["depth_m"] for e in mine]) * 1e3
        o, sigma = np.array([(e["overshoot_N"], e["sigma_N"]) for e in mine]).T
        axis.errorbar(z, o, sigma, fmt=mark, ms=4, lw=0.8, color=color, label=kind.replace("_", "-"))
        if s := fits.determined(name):
            law = rf"${name} z$"
            axis.plot([0, z.max()], [0, s.value * z.max() * 1e-3], color=color, lw=0.8, label=law)
    axis.set(title="overshoot", xlabel="depth of the event [mm]", ylabel="overshoot [N]")
    if events:
        axis.legend()
    else:
        axis.text(0.5, 0.5, "no pause or withdrawal", ha="center", transform=axis.transAxes, color=QUIET)


def resistances(rows: Sequence[SlowIntrusion], laws: IntrusionLaws, Figure: NewFigure) -> Figure:
    """k1, k2 per foot area, delta and ripples against packing; force against depth by foot beside the cone."""
    figure = Figure(figsize=(9.6, 6.4), layout="constrained")
    axes = figure.subplots(2, 2)
    known = [r for r in rows if np.isfinite(r.volume_fraction)]
    for name, color, mark in (("k1", MEASURED, "o"), ("k2", MODEL, "s")):
        mine = [r for r in known if np.isfinite(r.fits[name].value) and r.foot_radius > 0.0]
        area = np.array([np.pi * r.foot_radius**2 for r in mine]) * 1e6
        points(axes[0, 0], mine, name, color, mark, 1.0 / area, f"${name[0]}_{name[1]}$")
    axes[0, 0].set(ylabel="resistance / foot area [N/cm³]", xlabel="volume fraction", title="resistances")
    mine = [r for r in known if np.isfinite(r.fits["delta"].value)]
    points(axes[0, 1], mine, "delta", MEASURED, "o", np.full(len(mine), 1e3), r"$\delta$")
    axes[0, 1].set(ylabel=r"$\delta$ [mm]", xlabel="volume fraction", title="depth of the bend")
    mine = [r for r in known if np.isfinite(r.fits["ripple_N"].value)]
    points(axes[1, 0], mine, "ripple_N", GREEN, "o", np.ones(len(mine)), "ripple")
    for axis, law in ((axes[0, 0], "phi_c_from_k1"), (axes[1, 0], "phi_c_from_ripple")):
        bend = laws.laws[law].value
        if np.isfinite(bend):
            axis.axvspan(*laws.intervals[law], color=QUIET, alpha=0.25, lw=0, label="its 95 %")
            axis.axvline(bend, color=QUIET, lw=0.8, label=f"bend at {bend:.3f}")
    axes[1, 0].set(ylabel="amplitude [N]", xlabel="volume fraction", title="oscillations below the bend")
    for axis in (axes[0, 0], axes[1, 0]):
        if axis.get_legend_handles_labels()[0]:
            axis.legend()
    draw_feet(axes[1, 1], rows)
    return figure


def points(
    axis: Axes, rows: Sequence[SlowIntrusion], name: str, color: str, mark: str, factor: Array, label: str
) -> None:
    """One fit of each intrusion against packing, with sigma."""
    if rows:
        value, sigma = np.array([r.fits[name] for r in rows]).T * factor
        phi = [r.volume_fraction for r in rows]
        axis.errorbar(phi, value, sigma, fmt=mark, ms=4, lw=0.8, color=color, label=label)
        said = [measured(v, s) for v, s in zip(value, sigma)]
        label_points(axis, phi, value, [f"{r.experiment}: {x} at φ = {f:.4f}" for r, x, f in zip(rows, said, phi)])


def draw_feet(axis: Axes, rows: Sequence[SlowIntrusion]) -> None:
    """First intrusions in the loosest bed by foot radius; the fitted cone of each, its face and mantle apart."""
    import matplotlib as mpl

    packing = {r.experiment: float(np.nan_to_num(r.volume_fraction)) for r in rows}
    loose = min(packing.values(), default=0.0)
    longest_last = sorted(rows, key=lambda r: int(np.sum(r.event == -1)))
    feet = {r.foot_radius: r for r in longest_last if r.cone is not None and packing[r.experiment] <= loose + 1e-6}
    colors = mpl.colormaps["viridis"](np.linspace(0.0, 0.85, max(len(feet), 1)))
    for color, (radius, row) in zip(colors, sorted(feet.items())):
        assert row.cone is not None
        first = row.event < 0
        z = row.depth[first] * 1e3
        axis.plot(z, row.force[first], color=color, label=f"R = {radius * 1e3:.1f} mm")
        axis.plot(z, row.cone[first], color=color, ls=":", lw=1.0)
        for part, ls in ((row.flat, "--"), (row.mantle, "-.")):
            if part is not None:
                axis.plot(z, part[first], color=color, ls=ls, lw=0.6)
    for name, ls in (("RFT cone", ":"), ("its face", "--"), ("its mantle", "-.")) if feet else ():
        axis.plot([], [], color=QUIET, ls=ls, lw=0.8, label=name)
    axis.set(title="feet", xlabel="depth [mm]", ylabel="force [N]")
    if feet:
        axis.legend()


def steps(rows: Sequence[SlowIntrusion], Figure: NewFigure) -> Figure:
    """Force against depth of intrusions in steps of different lengths, one over the other (thesis Fig 69b).

    rows: of one foot and bed, the longest step first (`stepped`). Beside it the height of each over the one of the
    longest steps: pauses that follow one another before the force has come back add up.
    """
    import matplotlib as mpl

    figure = Figure(figsize=(9.6, 3.6), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.5, 1))
    longest = rows[0]
    colors = mpl.colormaps["viridis"](np.linspace(0.0, 0.85, len(rows)))
    for color, row in zip(colors, rows):
        z, name = row.depth * 1e3, f"{row.step * 1e3:.3g} mm"
        left.plot(z, row.force, color=color, lw=0.9, label=name)
        if row is not longest:
            shared = (row.depth >= longest.depth.min()) & (row.depth <= longest.depth.max())
            over = row.force[shared] - np.interp(row.depth[shared], longest.depth, longest.force)
            right.plot(z[shared], over, color=color, lw=0.9, label=name)
    right.axhline(0.0, color=QUIET, lw=0.8)
    bed = f", φ = {longest.volume_fraction:.3f}" if np.isfinite(longest.volume_fraction) else ""
    left.set(title=f"intrusion in steps{bed}", xlabel="depth [mm]", ylabel="force [N]")
    right.set(title=f"over steps of {longest.step * 1e3:.3g} mm", xlabel="depth [mm]", ylabel="difference [N]")
    left.legend(title="step")
    return figure


class SpringPicture(Picture):
    file = "spring.png"


@stage(version=2, picture=True)
def spring_picture(fit: Fits, spring: SpringTest) -> SpringPicture:
    """Force against displacement of the spring, with its line."""
    with styled() as Figure:
        return SpringPicture(png(stretched(fit, spring, Figure)))


def stretched(fit: Fits, spring: SpringTest, Figure: NewFigure) -> Figure:
    """Loading and unloading apart; the two lines of a loop; turning points, which are left out, in grey."""
    p = spring.values["profile"]
    x, force, fitted = (np.array(p[k], float) for k in ("displacement_m", "force_N", "fitted_N"))
    x = x * 1e3
    left, direction = force - fitted, np.array(p["direction"])
    figure = Figure(figsize=(8.6, 3.4), layout="constrained")
    whole, rest = figure.subplots(1, 2, width_ratios=(1.3, 1))
    turning = direction == 0
    whole.plot(x[turning], force[turning], ".", ms=3, color=QUIET, label="turning points, left out")
    for sign, label, color in ((1, "growing displacement", MEASURED), (-1, "falling displacement", MODEL)):
        mine = direction == sign
        if mine.any():
            order = np.flatnonzero(mine)[np.argsort(x[mine])]
            whole.plot(x[mine], force[mine], ".", ms=4, color=color, label=label)
            whole.plot(x[order], fitted[order], color=color, lw=0.8)
            rest.plot(x[mine], left[mine], ".", ms=4, color=color)
    rest.axhline(0.0, color=QUIET, lw=0.8)
    whole.legend()
    whole.set(xlabel="displacement [mm]", ylabel="force [N]", title=f"k = {with_sigma(fit['spring_stiffness'])} N/m")
    rest.set(xlabel="displacement [mm]", ylabel="measured − line [N]", title=hysteresis_words(fit))
    return figure


def hysteresis_words(fit: Fits) -> str:
    """The loop of a spring test."""
    loop = fit.get("spring_hysteresis_N")
    return f"hysteresis ±{with_sigma(loop)} N" if loop else "one direction: no hysteresis measured"


def with_sigma(e: Estimate, factor: float = 1.0) -> str:
    """Value ± sigma."""
    return measured(finite(e.value), e.sigma, factor)


class MotorPicture(Picture):
    file = "motor.png"


@stage(version=2, picture=True)
def motor_picture(fits: Fits, log: MotorLog, law: Actuation) -> MotorPicture:
    """Encoder and command, their difference, and where force was logged the work it does."""
    if not fits.determined("actuator_ratio"):
        raise NotApplicable(["motor_picture needs a log from rest to rest"])
    with styled() as Figure:
        return MotorPicture(png(moved(fits, log, law, Figure)))


class Played(NamedTuple):
    """A motor about its command: time [s], places on the rod [m]; work [J] of its force so far, None where unknown."""

    t: Array
    command: Array
    position: Array
    work: Array | None


def played(fits: Fits, log: MotorLog, law: Actuation) -> Played:
    """What the motor did, and was told to, from shortly before to shortly after."""
    logged = read_log(log, "time_s", "position_m", optional=("force_N",), at_least=8)
    t, position = motor_in(logged, law)
    around = (t > law.start - 0.05) & (t < law.stop + 0.1)
    t, position = t[around], position[around]
    work = None
    if fits.get("motor_work_J"):
        force = logged.force_N.to_numpy()[around]
        work = np.r_[0.0, np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(position))]
    return Played(t, commanded(law)(t)[0], position, work)


def moved(fits: Fits, log: MotorLog, law: Actuation, Figure: NewFigure) -> Figure:
    """Encoder and command, their difference, the work of the motor's force."""
    m = played(fits, log, law)
    panels = 2 if m.work is None else 3
    figure = Figure(figsize=(3.3 * panels, 3.2), layout="constrained")
    axes = figure.subplots(1, panels)
    axes[0].plot(m.t, m.command * 1e3, color=MODEL, label="command")
    axes[0].plot(m.t, m.position * 1e3, ".", ms=2, color=MEASURED, label="encoder")
    axes[0].set(title=f"ratio {with_sigma(fits['actuator_ratio'])}", ylabel="motor on the rod [mm]")
    axes[1].plot(m.t, (m.position - m.command) * 1e3, color=MEASURED, lw=0.8)
    axes[1].set(title=f"lag {with_sigma(fits['actuator_lag_s'], 1e3)} ms", ylabel="encoder − command [mm]")
    if m.work is not None:
        axes[2].plot(m.t, m.work, color=MEASURED, label="so far")
        axes[2].axhline(fits["motor_work_J"].value, color=QUIET, lw=0.8, ls="--", label="in all")
        axes[2].set(title=work_words(fits, "\n"), ylabel="work of the motor's force [J]")
    for axis in axes:
        axis.axvspan(law.start, law.stop, color=ACCENT, alpha=0.12, lw=0, label="motor runs")
        axis.set_xlabel("time [s]")
        axis.legend()
    return figure


def work_words(fits: Fits, between: str) -> str:
    """What the motor's force did."""
    peak = fits.determined("peak_power_W")
    return f"work {with_sigma(fits['motor_work_J'])} J" + (f"{between}peak power {with_sigma(peak)} W" if peak else "")


def actuator(rows: Sequence[Driven], found: Bandwidth, Figure: NewFigure) -> Figure:
    """Amplitude ratio with the -3 dB level and the bandwidth, and lag, both with 2 sigma."""
    figure = Figure(figsize=(8.6, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    f = np.array([r.frequency for r in rows])
    for axis, name, factor in ((left, "actuator_ratio", 1.0), (right, "actuator_lag_s", 1e3)):
        value, sigma = np.array([r.fits[name] for r in rows]).T * factor
        axis.errorbar(f, value, 2 * sigma, fmt="o", ms=4, lw=0.8, color=MEASURED, label="measured, ±2σ")
        unit = " ms" if axis is right else ""
        said = [f"{r.experiment}: {measured(r.fits[name].value, r.fits[name].sigma, factor)}{unit}" for r in rows]
        label_points(axis, f, value, said)
        axis.legend(loc="upper center")  # lag is least certain at the ends
        axis.margins(y=0.2)
        axis.set(xlabel="frequency [Hz]")
    if np.isfinite(found.gain.value):
        left.axhline(found.gain.value / np.sqrt(2), color=QUIET, lw=0.8, ls="--", label="−3 dB")
    if np.isfinite(found.cutoff.value):
        left.axvspan(found.low, found.high, color=MODEL, alpha=0.2, lw=0, label="its 95 %")
        cutoff = measured(found.cutoff.value, found.cutoff.sigma)
        left.axvline(found.cutoff.value, color=MODEL, lw=0.8, label=f"{cutoff} Hz")
    left.set(title="encoder / command", ylabel="amplitude ratio")
    left.legend()
    right.set(title="lag behind the command", ylabel="lag [ms]")
    return figure
