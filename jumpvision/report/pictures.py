"""Pictures of the results: a stage each, so that they are cached like every other result."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np

from ..records import BedHeight, Column, Fits, Flow, Record, RodMotion, Simulation, Track
from ..sections import Actuation, BedImage, NotApplicable, RodVideo
from ..stage import stage
from ..stages.films import open_film, open_pictures
from .panels import COLUMN_PANELS, draw_cone
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


class FitPicture(Picture):
    file = "fits.png"


def png(figure: Any) -> bytes:
    """A figure as PNG bytes without a date, so that the same data give the same file."""
    import io

    out = io.BytesIO()
    figure.savefig(out, format="png", metadata={"Software": None})
    return out.getvalue()


def drawn(draw: Callable[..., Any], *data: Any) -> bytes:
    """PNG of a drawing function's figure in the house style."""
    with styled() as Figure:
        return png(draw(*data, Figure))


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


@stage(version=2, picture=True)
def jump_picture(rod: RodMotion, simulation: Simulation | None, actuation: Actuation | None) -> JumpPicture:
    """Measured and simulated height of the rod, and what the model leaves over."""
    t, h, _ = rod.arrays
    sigma = rod.table.sigma_m.to_numpy(float)  # all of it: a wrong scale is a difference to the model too
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


@stage(version=2, picture=True)
def fit_picture(fits: Fits, rod: RodMotion | None, column: Column | None, flow: Flow | None) -> FitPicture:
    """The fits beside the data they were made on."""
    panels: list[Any] = []
    v = fits.values
    if column is not None:
        panels += COLUMN_PANELS
    if flow is not None and (v.get("cone_slope_kg_m") or {}).get("value") is not None:
        panels.append(draw_cone)
    if rod is not None and v.get("ring_start_s"):
        panels.append(draw_ring)
    if not panels:
        raise NotApplicable(["fit_picture needs a ring-down or a grain film"])
    with styled() as Figure:
        figure = Figure(figsize=(3.1 * len(panels) + 0.4, 3.2), layout="constrained")
        for axis, draw in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
            draw(axis, v, {"rod": rod, "column": column, "flow": flow})
        return FitPicture(png(figure))


def draw_ring(axis: Any, fits: dict[str, Any], of: dict[str, Any]) -> None:
    """The ring-down after the last landing and its damped cosine."""
    t, h, _ = of["rod"].arrays
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
