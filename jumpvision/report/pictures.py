"""Pictures of the results: a stage each, so that they are cached like every other result."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from ..pipeline import stage
from ..records import BedHeight, Column, Fits, Flow, Piv, Record, RodMotion, Simulation, Track
from ..sections import Actuation, BedImage, Calibration, GrainVideo, NotApplicable, RodVideo
from ..stages.films import open_film, open_grains, open_pictures
from .style import ACCENT, GREEN, MEASURED, MODEL, QUIET, styled


@dataclass(frozen=True)
class Picture(Record):
    """A PNG file."""

    png: bytes

    def save(self, folder: Path) -> None:
        (folder / self.file).write_bytes(self.png)

    @classmethod
    def load(cls, folder: Path) -> Self:
        return cls((folder / cls.file).read_bytes())


class TrackPicture(Picture):
    file = "track.png"


class JumpPicture(Picture):
    file = "jump.png"


class BedPicture(Picture):
    file = "bed.png"


class PivPicture(Picture):
    file = "piv.png"


class FlowPicture(Picture):
    file = "flow.png"


class FitPicture(Picture):
    file = "fits.png"


def png(figure: Any) -> bytes:
    """A figure as PNG bytes without a date, so that the same data give the same file."""
    import io

    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()


@stage(version=1, picture=True)
def track_picture(track: Track, film: RodVideo) -> TrackPicture:
    """The ball where it was found, and its height against time with the lost frames marked."""
    t, good = track.table, track.good
    with open_film(film) as frames:
        top = int(good.height_m.idxmax())
        image = frames[int(t.frame[top])]
    with styled() as Figure:
        figure = Figure(figsize=(8.6, 3.6), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1, 2.6))
        left.imshow(image, cmap="gray", interpolation="nearest")
        left.plot(good.x_px, good.y_px, color=MODEL, lw=0.7, alpha=0.7)
        left.plot(t.x_px[top], t.y_px[top], "+", color=MEASURED, ms=9, mew=1.5)
        left.set(title=f"frame {int(t.frame[top])} and path", xlabel="column [px]", ylabel="row [px]")
        left.grid(False)
        right.errorbar(t.time_s, t.height_m * 1e3, t.sigma_m * 1e3, fmt=".", ms=2.5, lw=0.6, color=MEASURED)
        lost = t[t.height_m.isna()]
        if len(lost):
            right.plot(
                lost.time_s, np.full(len(lost), right.get_ylim()[0]), "|", color=MODEL, label=f"{len(lost)} frames lost"
            )
            right.legend()
        sigma = float(np.median(good.sigma_px))
        right.set(title=f"rod height, median σ {sigma:.3f} px", xlabel="time [s]", ylabel="height above rest [mm]")
        return TrackPicture(png(figure))


@stage(version=1, picture=True)
def jump_picture(rod: RodMotion, simulation: Simulation | None, actuation: Actuation | None) -> JumpPicture:
    """Measured and simulated height of the rod, and what the model leaves over."""
    t, h, sigma = rod.arrays
    with styled() as Figure:
        rows = 2 if simulation else 1
        figure = Figure(figsize=(8.6, 2.4 + 1.5 * rows), layout="constrained")
        axes = figure.subplots(rows, 1, sharex=True, squeeze=False, height_ratios=(2.4, 1)[:rows])[:, 0]
        axes[0].plot(t, h * 1e3, ".", ms=3, color=MEASURED, label="measured")
        axes[0].set(ylabel="rod height [mm]", title="rod height above rest")
        if simulation:
            s = simulation.table
            rest = s.rod_m.iloc[0]
            axes[0].plot(s.time_s, (s.rod_m - rest) * 1e3, color=MODEL, label="model")
            left = h - np.interp(t, s.time_s, s.rod_m - rest)
            axes[1].fill_between(t, -2e3 * sigma, 2e3 * sigma, color=QUIET, alpha=0.35, lw=0, label="±2σ")
            axes[1].plot(t, left * 1e3, ".-", ms=2, lw=0.6, color=MEASURED)
            axes[1].set(ylabel="measured − model [mm]")
            axes[1].legend(loc="upper right")
        if actuation and actuation.moves:
            for axis in axes:
                axis.axvspan(actuation.start, actuation.stop, color=ACCENT, alpha=0.12, lw=0)
            axes[0].text(actuation.start, axes[0].get_ylim()[1], " motor", color=ACCENT, va="top")
        axes[-1].set_xlabel("time [s]")
        axes[0].legend(loc="upper right")
        return JumpPicture(png(figure))


@stage(version=1, picture=True)
def bed_picture(bed: BedHeight, image: BedImage) -> BedPicture:
    """The surface found in the picture of the bed."""
    v, profile = bed.values, bed.values["profile"]
    with open_pictures(image) as frames:
        grey = frames[v["picture"]]
    with styled() as Figure:
        figure = Figure(figsize=(8.6, 3.8), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.6))
        left.imshow(grey, cmap="gray")
        left.plot(profile["column_px"], profile["row_px"], color=MODEL, lw=1)
        if image.floor_row is not None:
            left.axhline(image.floor_row, color=GREEN, lw=1)
        left.set(title="surface and floor", xlabel="column [px]", ylabel="row [px]")
        left.grid(False)
        x, height = (np.array(profile[k], float) * 1e3 for k in ("x_m", "height_m"))
        mean, sigma = v["height_m"] * 1e3, v["sigma_m"] * 1e3
        right.plot(x, height, color=MEASURED, lw=0.8)
        right.axhspan(mean - 2 * sigma, mean + 2 * sigma, color=MODEL, alpha=0.25, lw=0)
        right.axhline(mean, color=MODEL)
        phi = v["volume_fraction"]
        text = f"\nφ = {phi:.4f} ± {v['sigma_volume_fraction']:.4f}" if phi is not None else ""
        right.set(title=f"bed height {mean:.2f} ± {sigma:.2f} mm{text}", xlabel="x [mm]", ylabel="height [mm]")
        return BedPicture(png(figure))


def busiest(field: Any) -> int:
    """Index of the frame with the largest mean speed."""
    speed = np.hypot(field.u, field.v).where(field.chc > 0).mean(("y", "x"))
    return int(speed.fillna(0).argmax("t"))


@stage(version=1, picture=True)
def piv_picture(piv: Piv, film: GrainVideo, calibration: Calibration | None) -> PivPicture:
    """Velocity vectors over the grains at the busiest moment, valid and replaced ones told apart."""
    field = piv.field
    i = busiest(field)
    straight, film = open_grains(film, calibration)
    with straight as frames:
        image = frames[i * int(field.attrs.get("ensemble_pairs", 1))]
    scale = film.scale or 1.0
    unit = field.u.attrs["units"].split("/")[0]
    factor, shown = (1e3, "mm") if unit == "m" else (1.0, "px")
    origin_x, origin_y = field.attrs["origin_column_px"], field.attrs["origin_row_px"]
    rows, columns = image.shape
    extent = (
        np.array([-0.5 - origin_x, columns - 0.5 - origin_x, -(rows - 0.5 - origin_y), origin_y + 0.5]) * scale * factor
    )
    every = max(1, len(field.x) // 32)
    f = field.isel(t=i, x=slice(None, None, every), y=slice(None, None, every))
    with styled() as Figure:
        figure = Figure(figsize=(6.4, min(8.0, 0.7 + 5.2 * rows / columns)), layout="constrained")
        axis = figure.subplots()
        axis.imshow(image, cmap="gray", extent=extent, alpha=0.75)
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
        axis.plot(x[bad], y[bad], "x", color=ACCENT, ms=3, mew=0.8, label="replaced")
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


@stage(version=1, picture=True)
def flow_picture(flow: Flow, piv: Piv) -> FlowPicture:
    """Shear rate at the busiest moment; momentum against time and added mass against depth."""
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


@stage(version=1, picture=True)
def fit_picture(fits: Fits, rod: RodMotion | None, column: Column | None) -> FitPicture:
    """The fits beside the data they were made on."""
    panels: list[Any] = []
    v = fits.values
    if column is not None:
        panels += [draw_profile, draw_beta, draw_front]
    if rod is not None and v.get("ring_start_s"):
        panels.append(draw_ring)
    if not panels:
        raise NotApplicable(["fit_picture needs a ring-down or a grain film"])
    with styled() as Figure:
        figure = Figure(figsize=(3.1 * len(panels) + 0.4, 3.2), layout="constrained")
        for axis, draw in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
            draw(axis, v, rod, column)
        return FitPicture(png(figure))


def draw_profile(axis: Any, fits: dict[str, Any], rod: Any, column: Any) -> None:
    """Speed below the foot at the frame with the fastest foot, and the exponential a^(z+b)."""
    c = column.field
    i = (
        int(np.nanargmax(np.where(np.isfinite(c.beta_deg), c.max_speed, np.nan)))
        if np.isfinite(c.beta_deg).any()
        else 0
    )
    z = c.depth.values[:, i]
    top = float(c.max_speed[i])
    axis.errorbar(
        z * 1e3, c.speed.values[:, i] / top, c.speed_sigma.values[:, i] / top, fmt=".", ms=3, lw=0.6, color=MEASURED
    )
    line = np.linspace(0, np.nanmax(z), 200)
    axis.plot(
        line * 1e3, np.minimum(np.exp(float(c.log_a[i]) * (line + float(c.b[i]))), 1.0), color=MODEL, label="$a^{z+b}$"
    )
    axis.axhline(float(c.attrs["front"]), color=QUIET, lw=0.8, ls="--")
    axis.set_xlim(0)
    axis.set(
        title=f"central column, t = {float(c.t[i]):.3f} s", xlabel="z below the foot [mm]", ylabel="speed / largest"
    )
    axis.legend()


def draw_beta(axis: Any, fits: dict[str, Any], rod: Any, column: Any) -> None:
    """beta against the foot's depth."""
    c = column.field
    axis.errorbar(c.foot_depth * 1e3, c.beta_deg, c.beta_deg_sigma, fmt=".", lw=0.7, color=MEASURED)
    b = fits.get("beta_deg")
    if b and b["value"] is not None:
        axis.axhline(b["value"], color=MODEL)
    axis.set(title="β = asin(a^Δz)", xlabel="foot depth [mm]", ylabel="β [deg]")


def draw_front(axis: Any, fits: dict[str, Any], rod: Any, column: Any) -> None:
    """Thickness of the jammed layer against the foot's depth; the slope is mu."""
    c = column.field
    x = c.foot_depth.values * 1e3
    axis.errorbar(x, c.jammed_thickness * 1e3, c.jammed_thickness_sigma * 1e3, fmt=".", lw=0.7, color=MEASURED)
    mu, cut = fits.get("mu"), fits.get("mu_intercept_m")
    if mu and cut and mu["value"] is not None and np.isfinite(x).any():
        line = np.array([np.nanmin(x), np.nanmax(x)])
        axis.plot(
            line,
            mu["value"] * line + cut["value"] * 1e3,
            color=MODEL,
            label=f"μ = {mu['value']:.2f} ± {mu['sigma']:.2f}",
        )
        axis.legend()
    axis.set(title="jammed front", xlabel="foot depth [mm]", ylabel="thickness [mm]")


def draw_ring(axis: Any, fits: dict[str, Any], rod: Any, column: Any) -> None:
    """The ring-down after the last landing and its damped cosine."""
    t, h, _ = rod.arrays
    f, zeta, a, offset, phase, start, stop = (
        fits[k]["value"] for k in ("frequency_hz", "zeta", "ring_amplitude_m", "ring_offset_m", "ring_phase_rad",
                                   "ring_start_s", "ring_stop_s")
    )  # fmt: skip
    w = (t >= start) & (t <= stop)
    axis.plot(t[w], (h[w] - offset) * 1e3, ".", ms=3, color=MEASURED)
    line = np.linspace(start, stop, 1500)
    omega0 = 2 * np.pi * f / np.sqrt(1 - zeta**2)
    wave = a * np.exp(-zeta * omega0 * (line - start)) * np.cos(2 * np.pi * f * (line - start) + phase)
    axis.plot(line, wave * 1e3, color=MODEL, lw=0.8)
    axis.set(title=f"ring-down {f:.3f} Hz, ζ = {zeta:.4f}", xlabel="time [s]", ylabel="height [mm]")
