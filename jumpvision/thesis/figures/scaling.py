"""Figures against alpha = M g/(k A): thesis Figs 32, 33(e), 35 and 36."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr

from jumpvision.base.arrays import Array
from jumpvision.experiment.results.fields import attributes_of
from jumpvision.report.style import ACCENT, GREEN, MEASURED, MODEL, QUIET, NewFigure
from jumpvision.thesis.figures.sweeps import figure_of
from jumpvision.thesis.studies import animals as animals_of
from jumpvision.thesis.studies import muscles, scaling
from jumpvision.thesis.studies.compute import origin_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LOOK = {"stutter": (MODEL, "-"), "single": (MEASURED, "--"), "two frequencies": (GREEN, "-.")}


def logarithmic(axis: Axes, which: str) -> None:
    """A log axis with numbers instead of powers of ten, few enough to read."""
    from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

    one = axis.xaxis if which == "x" else axis.yaxis
    getattr(axis, f"set_{which}scale")("log")
    low, high = one.get_view_interval()
    if high / low < 300:
        one.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
        one.set_major_formatter(FuncFormatter(lambda v, _: f"{v:g}"))
    one.set_minor_formatter(NullFormatter())


@figure_of(scaling.alpha)
def alpha(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Height, power and frequency of both types; where the stutter jump is the better one; height over phase."""
    figure = Figure(figsize=(10.4, 6.4), layout="constrained")
    axes = figure.subplots(2, 3)
    (height, power, freq), (rod, zeta, phase) = axes
    for name, (color, style) in list(LOOK.items())[:2]:
        one = data.sel(jump=name)
        height.plot(data.alpha, one.height_ratio, style, color=color, label=name)
        power.plot(data.alpha, one.power_scaled, style, color=color, label=name)
        freq.plot(data.alpha, one.frequency_ratio, style, color=color, label=name)
    at = attributes_of(scaling.Alpha, data).alpha_of_robot
    ratio = data.sel(jump="stutter") / data.sel(jump="single")
    ideal = ((ratio.com_height_m > 1) & (ratio.peak_power_W < 1)).values
    for axis in (height, power):
        axis.fill_between(
            data.alpha, 0, 1, where=ideal, color=GREEN, alpha=0.15, lw=0, transform=axis.get_xaxis_transform()
        )
        axis.set(xlabel="α = M g / (k A)")
        logarithmic(axis, "y")
    for axis in (height, power, freq):
        logarithmic(axis, "x")
        axis.axvline(at, color=QUIET, lw=0.8, ls=":")
    height.set(title="best height / A")
    height.legend()
    power.set(title=r"its peak power $/ (k A^2 \omega_0)$")
    freq.axhline(1.0, color=QUIET, lw=0.6)
    freq.set(title="its frequency $/ f_0$", xlabel="α (dotted: this robot)", ylim=(0, None))
    for axis, by, name in ((rod, "rod", "rod_share"), (zeta, "zeta", "damping_ratio")):
        lower, upper = data[f"region_low_by_{by}"], data[f"region_high_by_{by}"]
        axis.plot(data[name], lower, "o-", ms=3, color=MEASURED, label="higher than the single from")
        axis.plot(data[name], upper, "s--", ms=3, color=MODEL, label="at lower power up to")
        axis.fill_between(data[name], lower, upper, where=(lower < upper).values, color=GREEN, alpha=0.15, lw=0)
        axis.set(ylabel="α", ylim=(0, None))
    rod.set(title="stutter higher at lower power", xlabel="rod mass / M")
    rod.legend()
    zeta.set(title="the same against damping", xlabel="damping ratio ζ")
    relative = data.phase_height_ratio / data.phase_height_ratio.max("some_phase")
    seen = phase.pcolormesh(data.some_phase / np.pi, data.some_alpha, relative, shading="nearest", rasterized=True)
    for x in (0.5, 1.5):
        phase.axvline(x, color="white", lw=0.8, ls=":")
    phase.set(title="height best over f / its maximum", xlabel="phase [π]", ylabel="α")
    logarithmic(phase, "y")
    phase.grid(False)
    figure.colorbar(seen, ax=phase)
    return figure


@figure_of(scaling.estimates)
def estimates(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Analytic estimates of the best stutter frequency against simulation."""
    figure = Figure(figsize=(6.6, 4.4), layout="constrained")
    axis = figure.subplots()
    for k, (color, style) in enumerate((("black", "-"), (QUIET, "--"))):
        kind = str(data.kind.values[k])
        axis.plot(data.alpha, data.frequency_ratio.isel(kind=k), style, color=color, lw=2, label=f"simulation, {kind}")
    words = {"8": "half a cycle of falling", "10": "fall and push", "12": "with the first lift-off"}
    for (n, text), color, style in zip(words.items(), (MEASURED, MODEL, GREEN), (":", "--", "-.")):
        axis.plot(data.alpha, data[f"estimate_{n}"], style, color=color, label=f"eq. ({n}): {text}")
    last = float(data.alpha.max())
    axis.plot(
        [0.9, max(last, 0.9)], [float(data.estimate_13)] * 2, color=ACCENT, lw=2, label="argmax of eq. (13), α ≥ 0.9"
    )
    axis.set(
        title="best frequency of the stutter jump",
        xlabel="α = M g / (k A)",
        ylabel="$f / f_0$",
        ylim=(0, 1.6),
        xlim=(0, min(last, 1.5)),
    )
    axis.legend(fontsize=8)
    return figure


KEYS = 4  # columns of names under the figure of the animals
REACH = (6.0, 9.0, 12.0, 15.0)  # pt, of a number from its mark


@figure_of(animals_of.animals)
def animals(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Height relative to body length against body length, and the alpha it comes from; names by number below."""
    names = [f"{i} {name}" for i, name in enumerate(data.animal.values, start=1)]
    rows = -(-len(names) // KEYS)
    figure = Figure(figsize=(9.2, 4.4 + 0.12 * rows), layout="constrained")
    (top,), (key,) = figure.subfigures(2, 1, squeeze=False, height_ratios=(4.4, 0.12 * rows))
    left, right = top.subplots(1, 2, width_ratios=(2.2, 1))
    lines = []
    for name in ("stutter", "single"):
        color, style = LOOK[name]
        lines += left.plot(data.length, data.relative_height.sel(jump=name), style, color=color, label=name)
    left.plot([1.8, 1.8], data.relative_height.interp(length=1.8), "o", ms=4, color="black", label="human values")
    places = np.stack([data.animal_length_m, data.animal_height_m / data.animal_length_m], axis=1)
    for kind, mark, color in (("animal", "^", GREEN), ("robot", "s", ACCENT)):
        if (of := data.kind.values == kind).any():
            left.plot(*places[of].T, mark, ms=4, color=color, label=f"{kind}, measured")
    left.set(
        title="isometric animals: height / body length",
        xlabel="body length [m]",
        ylabel="height / length",
        xscale="log",
        yscale="log",
    )
    left.legend(loc="upper right")
    box = 72.0 * np.array([figure.get_figwidth() * 0.6, 3.7])  # pt, of the panel, about
    curves = np.concatenate([line.get_xydata() for line in lines])
    for i, ((x, y), shift) in enumerate(zip(places, free(left, places, curves, box)), start=1):
        how = {"ha": "center", "va": "center", "textcoords": "offset points"}
        left.annotate(str(i), (x, y), fontsize="x-small", xytext=tuple(shift), **how)
    for k in range(KEYS):
        text = "\n".join(names[k * rows : (k + 1) * rows])
        key.text(0.03 + k / KEYS, 1.0, text, fontsize="x-small", va="top", linespacing=1.25)
    right.plot(data.length, data.alpha, color=QUIET)
    right.set(title="α, eq. (14)", xlabel="body length [m]", xscale="log", yscale="log")
    return figure


def free(axis: Axes, places: Array, curves: Array, box: Array) -> Array:
    """Where a number beside each place (n, 2) lies on no mark, no curve and no other number, no other mark nearer:
    shifts (n, 2) [pt].

    box: size of the panel [pt], whose axes are logarithmic.
    """
    low, high = (np.log([lim[k] for lim in (axis.get_xlim(), axis.get_ylim())]) for k in (0, 1))
    marks, taken = ((np.log(p) - low) / (high - low) * box for p in (places, np.concatenate([places, curves])))
    turns = np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False)
    shifts = np.array([(r * np.cos(a), r * np.sin(a)) for r in REACH for a in turns])
    out = []
    for mark in marks:
        others = taken[np.any(taken != mark, axis=1)]
        apart = np.abs(mark + shifts[:, None] - others[None]) / (9.0, 7.5)  # a number of two digits is wider than high
        room = np.min(np.max(apart, axis=2), axis=1)
        strange = marks[np.any(marks != mark, axis=1)]
        nearest = np.min(np.linalg.norm(mark + shifts[:, None] - strange[None], axis=2), axis=1, initial=np.inf)
        room[nearest < 1.2 * np.linalg.norm(shifts, axis=1)] *= 0.5
        out.append(shifts[np.argmax(np.minimum(room, 1.0))])  # the nearest that has room, else the freest
        taken = np.concatenate([taken, [mark + out[-1]]])
    return np.array(out)


@figure_of(scaling.two_frequency)
def two_frequency(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Height, power, efficiency and frequencies of the two-frequency stutter beside the others."""
    figure = Figure(figsize=(8.8, 6.0), layout="constrained")
    (height, power), (efficiency, freq) = figure.subplots(2, 2, sharex=True)
    for name, (color, style) in LOOK.items():
        one = data.sel(jump=name)
        height.plot(data.alpha, one.height_ratio, style, color=color, label=name)
        power.plot(data.alpha, one.peak_power_W / data.sel(jump="stutter").peak_power_W, style, color=color)
        efficiency.plot(data.alpha, one.efficiency, style, color=color)
        freq.plot(
            data.alpha, one.frequency_ratio, style, color=color, label="first half" if name.startswith("two") else name
        )
    freq.plot(
        data.alpha,
        data.sel(jump="two frequencies").frequency2_ratio,
        color=GREEN,
        lw=2.2,
        alpha=0.6,
        label="second half",
    )
    height.set(title="best height / A")
    height.legend()
    power.set(title="peak power / the stutter's")
    efficiency.set(title=r"$M g \omega_0$ height / peak power", xlabel="α = M g / (k A)")
    freq.set(title="best frequencies $/ f_0$", xlabel="α = M g / (k A)")
    freq.legend(fontsize=8)
    logarithmic(height, "x")
    for axis in (height, power, freq):
        logarithmic(axis, "y")
    return figure


@figure_of(scaling.height_amplitude)
def height_amplitude(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Maps of height / A with the best frequency (black) and the least amplitude that lifts off (white)."""
    figure = Figure(figsize=(9.6, 3.8), layout="constrained")
    f0 = origin_of(data).f0_Hz or 1.0
    for axis, kind in zip(figure.subplots(1, 2), data.jump.values):
        one = data.sel(jump=kind)
        seen = axis.pcolormesh(
            data.frequency / f0, data.amplitude * 1e3, one.height_ratio.T, shading="nearest", rasterized=True
        )
        figure.colorbar(seen, ax=axis).ax.set_ylabel("height / A")
        axis.plot(data.frequency / f0, one.minimum_amplitude_m * 1e3, color="white", lw=1.2)
        axis.plot(one.best_frequency_Hz / f0, data.amplitude * 1e3, color="black", lw=1.2)
        ends = [float(x) * 1e3 for x in (data.amplitude[0], data.amplitude[-1])]
        axis.set(title=f"{kind}", xlabel="$f / f_0$", ylabel="amplitude A [mm]", ylim=ends)
        axis.grid(False)
    return figure


@figure_of(muscles.muscle)
def muscle(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Height of three techniques over the spring's compliance, and over the muscle's power, by strength."""
    facts = attributes_of(muscles.Limited, data)
    looks = {"squat": (MEASURED, "--"), "countermovement": (MODEL, "-"), "catapult": (GREEN, "-.")}
    figure = Figure(figsize=(10.4, 6.2), layout="constrained")
    for column, strength in zip(figure.subplots(2, 3).T, data.strength.values):
        one = data.sel(strength=strength)
        for technique, (color, style) in looks.items():
            given = {"ls": style, "color": color, "label": technique}
            column[0].plot(data.compliance, one.relative_height.sel(technique=technique), **given)
            column[1].plot(one.power_W, one.height_by_speed.sel(technique=technique), **given)
        weights = f"{strength}: {muscles.STRENGTHS[str(strength)]:g} weights"
        column[0].set(title=weights, xlabel="compliance F_0 / (k travel)", ylim=(0, None))
        column[1].set(
            title=f"compliance {facts.compliance:g}", xlabel="greatest power of the muscle [W]", ylim=(0, None)
        )
        logarithmic(column[1], "x")
        for axis in column:
            axis.set_ylabel("height / travel")
    figure.axes[0].legend()
    return figure
