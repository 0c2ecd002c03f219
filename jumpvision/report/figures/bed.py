"""Pictures of the bed: the air through it (thesis Fig 41), and craters against packing (Fig 46)."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from jumpvision.base.arrays import Array, measured
from jumpvision.estimate.crater import ZeroCrossing
from jumpvision.experiment.campaign.measured.craters import Crater
from jumpvision.experiment.inputs.sections import CraterDepth, CraterImage, Fan, NotApplicable
from jumpvision.experiment.results.values import Column, CraterShape, CraterValues, Geometry
from jumpvision.experiment.stages.bed.crater import read_map
from jumpvision.experiment.stages.recordings import open_pictures
from jumpvision.experiment.workflow.stage import stage
from jumpvision.jumper.physics.air import Drop
from jumpvision.report.style import ACCENT, GREEN, MEASURED, MODEL, QUIET, SIGNED, NewFigure, label_points, styled

from .pictures import Picture, png, show_frame

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


class AirPicture(Picture):
    file = "air.png"


@stage(version=2, picture=True)
def air_picture(geometry: Geometry, fan: Fan | None) -> AirPicture:
    """Pressure against air speed: Ergun, Wu, the bed's weight, and where it is given the fan's curve and its place."""
    if (found := air_of(geometry, fan)) is None:
        raise NotApplicable(["air_picture needs [bed] grain_diameter, a volume fraction and the bed's height"])
    with styled() as Figure:
        return AirPicture(png(air(found, Figure)))


class Air(NamedTuple):
    """Pressures [Pa] at air speeds [m/s]. lines: of the bed by law and with its duct; onsets, works: (speed, pressure);
    weight of the bed; title: whether it moves."""

    speed: Array
    lines: dict[str, Array]
    onsets: dict[str, tuple[float, float]]
    weight: float
    fan: tuple[Sequence[float], Sequence[float]] | None
    works: tuple[float, float] | None
    title: str

    @property
    def top(self) -> float:
        """What is shown of the pressure: as high as the bed's weight and the fan."""
        return 1.15 * max((self.weight, *(self.fan[1] if self.fan else ())))


def air_of(geometry: Geometry, fan: Fan | None) -> Air | None:
    """The air through a bed; None where its grains, packing or height are not known."""
    flow, height = geometry.values["fluidisation"], geometry.values["bed_height_m"]
    weight = flow["bed_weight_Pa"] if flow else None
    if flow is None or height is None or weight is None:
        return None
    known = fan if fan and fan.speed else None
    v = np.linspace(0.0, max(1.6 * flow["onset_wu_m_s"], known.speed[-1] if known else 0.0), 300)
    lines, onsets = {}, {}
    for law, onset in (("ergun", flow["onset_ergun_m_s"]), ("wu", flow["onset_wu_m_s"])):
        name = f"{law.title()}, onset {onset:.3f} m/s"
        lines[name], onsets[name] = height * Drop(**flow["laws"][law])(v), (onset, weight)
    if known and known.loss:
        lines["bed (Wu) and duct"] = np.minimum(height * Drop(**flow["laws"]["wu"])(v), weight) + known.loss * v**2
    at, pressure = flow.get("fan_speed_m_s"), flow.get("fan_pressure_Pa")
    works = (at, pressure) if at is not None and pressure is not None else None
    moves = "" if not known else ": the bed is fluidised" if flow["fluidised"] else ": the bed stays at rest"
    curve = (known.speed, known.pressure) if known else None
    return Air(v, lines, onsets, weight, curve, works, f"air through the bed{moves}")


def air(a: Air, Figure: NewFigure) -> Figure:
    """Pressure against air speed."""
    figure = Figure(figsize=(6.0, 3.6), layout="constrained")
    axis = figure.subplots()
    for (name, pressure), color, ls in zip(a.lines.items(), (QUIET, MEASURED, MEASURED), ("-", "-", ":")):
        axis.plot(a.speed, pressure / 1e3, color=color, ls=ls, label=name)
        if name in a.onsets:
            axis.plot(a.onsets[name][0], a.onsets[name][1] / 1e3, "o", color=color, ms=4)
    axis.axhline(a.weight / 1e3, color=GREEN, ls="--", lw=1, label="weight of the bed")
    if a.fan:
        axis.plot(a.fan[0], np.array(a.fan[1]) / 1e3, ".-", color=MODEL, label="fan")
    if a.works:
        axis.plot(a.works[0], a.works[1] / 1e3, "*", ms=11, color=ACCENT, label="works here")
    axis.set_ylim(0.0, a.top / 1e3)
    axis.set(title=a.title, xlabel="superficial air speed [m/s]", ylabel="pressure [kPa]")
    axis.legend()
    return figure


class CraterPicture(Picture):
    file = "crater.png"


@stage(version=2, picture=True)
def crater_picture(crater: CraterShape, line: CraterImage | None, depth: CraterDepth | None) -> CraterPicture:
    """What was measured, and the profile about the axis."""
    v = crater.values
    with styled() as Figure:
        figure = Figure(figsize=(8.6, 3.4), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.5))
        if depth is not None:
            draw_map(figure, left, v, depth)
        elif line is not None:
            with open_pictures(line) as frames:
                show_frame(left, frames[0], aspect="auto")
            left.plot(v["line"]["column_px"], as_floats(v["line"]["row_px"]), color=MODEL, lw=0.7)
            left.set(title="laser line", xlabel="column [px]", ylabel="row [px]")
        left.grid(False)
        draw_profile(right, v)
        return CraterPicture(png(figure))


def as_floats(values: Column) -> Array:
    """A list of numbers and None as an array with NaN."""
    return np.array(values, float)


def draw_map(figure: Figure, axis: Axes, v: CraterValues, depth: CraterDepth) -> None:
    """Height about its median with the circle that was integrated."""
    scale = depth.scale or 1.0
    z = read_map(depth) * depth.height_scale
    z = (z - np.nanmedian(z)) * 1e3
    top = max(v["depth_m"], v["rim_height_m"]) * 1e3
    image = axis.imshow(z, cmap=SIGNED, vmin=-top, vmax=top)
    figure.colorbar(image, ax=axis, label="height [mm]", shrink=0.8)
    x, y = v["axis_m"]
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    column, row = (x + v["radius_m"] * np.cos(turn)) / scale, (-y + v["radius_m"] * np.sin(turn)) / scale
    axis.plot(column, row, color=ACCENT, lw=1)
    axis.set(title="depth map and integrated disc", xlabel="column [px]", ylabel="row [px]")


def draw_profile(axis: Axes, v: CraterValues) -> None:
    """Height against distance from the axis; a line's two halves one over the other."""
    r, h = as_floats(v["profile"]["r_m"]) * 1e3, as_floats(v["profile"]["height_m"]) * 1e3
    if r.min() < 0.0:
        axis.plot(r[r >= 0], h[r >= 0], color=MEASURED, lw=0.9, label="right of the axis")
        axis.plot(-r[r < 0], h[r < 0], color=MODEL, lw=0.9, label="left of the axis")
    else:
        axis.plot(r, h, color=MEASURED, label="azimuthal mean")
    axis.axhline(0.0, color=QUIET, lw=0.8)
    axis.axvline(v["radius_m"] * 1e3, color=ACCENT, lw=0.8, ls="--", label="integrated to here")
    axis.set(
        title=f"volume change {measured(v['volume_m3'], v['sigma_m3'], 1e6)} cm³",
        xlabel="distance from the axis [mm]",
        ylabel="height [mm]",
    )
    axis.legend()


def critical(craters: Sequence[Crater], found: ZeroCrossing, Figure: NewFigure) -> Figure:
    """Volume change against volume fraction, where that is known, with the line through phi_c."""
    known = [c for c in craters if c.volume_fraction is not None]
    phi, v = np.array([(c.volume_fraction, c.volume_m3) for c in known], float).T
    dphi, dv = np.array([(c.sigma_volume_fraction, c.sigma_m3) for c in known], float).T
    figure = Figure(figsize=(6.0, 3.6), layout="constrained")
    axis = figure.subplots()
    axis.axhline(0.0, color=QUIET, lw=0.8)
    axis.errorbar(phi, v * 1e6, dv * 1e6, dphi, fmt="o", ms=4, lw=0.8, color=MEASURED, label="craters, ±σ")
    label_points(axis, phi, v * 1e6, [f"{c.experiment}: {measured(c.volume_m3, c.sigma_m3, 1e6)} cm³" for c in known])
    title = f"no critical packing: {found.reason}"
    if not found.reason:
        ends = np.array([phi.min(), phi.max()])
        axis.plot(ends, found.slope * (ends - found.value) * 1e6, color=MODEL, label="line")
        axis.axvspan(
            max(found.low95, axis.get_xlim()[0]),
            min(found.high95, axis.get_xlim()[1]),
            color=MODEL,
            alpha=0.15,
            lw=0,
            label=r"95 % of $\phi_c$",
        )
        title = rf"$\phi_c$ = {measured(found.value, found.sigma)}"
    axis.set(title=title, xlabel=r"volume fraction $\phi$", ylabel="volume change [cm³]\n(below zero: compacted)")
    axis.legend()
    return figure
