"""Pictures of the results: a stage each, so that they are cached like every other result."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self, cast

import numpy as np

from jumpvision.base.arrays import Array, Image, measured
from jumpvision.base.record import Record
from jumpvision.experiment.inputs.sections import Actuation, BedImage, NotApplicable, RodVideo
from jumpvision.experiment.results.fields import Column, Flow
from jumpvision.experiment.results.tables import RodMotion, Simulation, Track
from jumpvision.experiment.results.values import BedHeight, Fits
from jumpvision.experiment.stages.recordings import open_film, open_pictures
from jumpvision.experiment.workflow.stage import stage
from jumpvision.films.grains.cone import mass_curve
from jumpvision.report.style import ACCENT, GREEN, MEASURED, MODEL, QUIET, NewFigure, styled

if TYPE_CHECKING:
    import xarray as xr
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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


def png(figure: Figure) -> bytes:
    """A figure as PNG bytes without a date, so that the same data give the same file."""
    import io

    from matplotlib import rcParams
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.image import imsave

    figure.dpi = rcParams["savefig.dpi"]
    canvas: Any = FigureCanvasAgg(figure)
    out, plain = io.BytesIO(), cast(Any, {"Software": None})
    with warnings.catch_warnings():
        # said by matplotlib's clock, on a busy machine of any figure
        warnings.filterwarnings("ignore", message='Creating legend with loc="best" can be slow')
        canvas.draw()  # once: savefig draws a second time, unseen, to lay out
    kept = {"compress_level": 3}  # half the time for a twentieth more bytes
    imsave(out, canvas.buffer_rgba(), format="png", dpi=figure.dpi, metadata=plain, pil_kwargs=kept)
    return out.getvalue()


# 1600 px are more than a picture of 140 dpi shows
def shrunk(image: Image, longest: float = 1600) -> Image:
    """A frame (rows, columns) as means of whole blocks where its longer side is more than about `longest` pixels."""
    k = int(min(max(image.shape) // longest, min(image.shape)))
    if k < 2:
        return image
    rows, columns = (n // k for n in image.shape)
    blocks = image[: rows * k, : columns * k].reshape(rows, k, columns, -1)
    return np.asarray(blocks.mean(axis=(1, 3), dtype=np.float32))


def show_frame(axis: Axes, image: Image, **look: Any) -> None:
    """A frame in grey on an axis in pixels, or in `extent`; a large one shrunk: matplotlib takes 32 bytes a pixel."""
    rows, columns = image.shape
    axis.imshow(shrunk(image), cmap="gray", **{"extent": (-0.5, columns - 0.5, rows - 0.5, -0.5), **look})


def png_of(draw: Callable[..., Figure], *data: xr.Dataset) -> bytes:
    """PNG of a drawing function's figure in the house style."""
    with styled() as Figure:
        return png(draw(*data, Figure))


@stage(version=3, picture=True)
def track_picture(track: Track, film: RodVideo) -> TrackPicture:
    """The ball where it was found, and its height, or its place in px, against time with the lost frames marked."""
    t, good = track.table, track.good
    metric = bool(good.height_m.notna().any())
    place = t.height_m * 1e3 if metric else t.y_px
    with open_film(film) as frames:
        top = int(good.height_m.idxmax() if metric else good.y_px.idxmin())
        image = frames[int(t.frame[top])]
    with styled() as Figure:
        figure = Figure(figsize=(8.6, 3.6), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1, 2.6))
        show_frame(left, image, interpolation="nearest")
        left.plot(good.x_px, good.y_px, color=MODEL, lw=0.7, alpha=0.7)
        left.plot(t.x_px[top], t.y_px[top], "+", color=MEASURED, ms=9, mew=1.5)
        left.set(title=f"frame {int(t.frame[top])} and path", xlabel="column [px]", ylabel="row [px]")
        left.grid(False)
        error = t.sigma_m * 1e3 if metric else t.sigma_px
        right.errorbar(t.time_s, place, error, fmt=".", ms=2.5, lw=0.6, color=MEASURED)
        if not metric:
            right.invert_yaxis()  # rows are counted down
        lost = t[place.isna()]
        if len(lost):
            right.plot(
                lost.time_s, np.full(len(lost), right.get_ylim()[0]), "|", color=MODEL, label=f"{len(lost)} frames lost"
            )
            right.legend()
        sigma = float(np.median(good.sigma_px))
        name, axis = ("rod height", "height above rest [mm]") if metric else ("ball", "row [px]")
        right.set(title=f"{name}, median σ {sigma:.3f} px", xlabel="time [s]", ylabel=axis)
        return TrackPicture(png(figure))


def draw_beside(
    axes: Sequence[Axes],
    rod: RodMotion,
    model: Simulation | None,
    name: str,
    *,
    size: float,
    line: str,
    ms: float,
    lw: float,
) -> None:
    """Height of a rod on the first of the axes, with its model where there is one; their difference on the second."""
    axes[0].plot(rod.table.time_s, rod.table.height_m * 1e3, ".", ms=size, color=MEASURED, label="measured")
    if model is not None:
        both = rod.beside(model)
        axes[0].plot(both.model_t, both.model_h * 1e3, color=MODEL, label=name)
        axes[1].plot(both.t, both.difference * 1e3, line, color=MEASURED, ms=ms, lw=lw)


class Tracked(NamedTuple):
    """An experiment's rod, and its model where it has been simulated."""

    name: str
    rod: RodMotion
    model: Simulation | None


def tracks(jumps: Sequence[Tracked], Figure: NewFigure) -> Figure:
    """A column a jump: rod height measured and simulated, with the simulated foot, and their difference."""
    n = len(jumps)
    figure = Figure(figsize=(3.4 * max(n, 2), 4.0), layout="constrained")
    axes = figure.subplots(2, n, sharex="col", sharey="row", squeeze=False, height_ratios=(2, 1))
    for (top, low), jump in zip(axes.T, jumps):
        top.set(title=jump.name)
        low.axhline(0.0, color=QUIET, lw=0.6)
        low.set(xlabel="time [s]", title="measured − simulated" if jump.model is not None else "")
        draw_beside((top, low), jump.rod, jump.model, "simulated", size=2, line="-", ms=2, lw=0.8)
        if jump.model is not None:
            s = jump.model.table
            top.plot(s.time_s, s.foot_m * 1e3, color=GREEN, lw=0.8, label="foot over the surface, simulated")
    axes[0, 0].set(ylabel="rod height [mm]")
    axes[1, 0].set(ylabel="difference [mm]")
    axes[0, 0].legend()
    return figure


@stage(version=4, picture=True)
def jump_picture(rod: RodMotion, simulation: Simulation | None, actuation: Actuation | None) -> JumpPicture:
    """Measured and simulated height of the rod, the simulated foot, and what the model leaves over."""
    with styled() as Figure:
        return JumpPicture(png(jump(rod, simulation, actuation, Fits({}), Figure)))


def jump(
    rod: RodMotion, simulation: Simulation | None, actuation: Actuation | None, fits: Fits, Figure: NewFigure
) -> Figure:
    """Measured and simulated height of the rod with its apex, where fits has one, and their difference."""
    rows = 2 if simulation else 1
    figure = Figure(figsize=(8.6, 2.4 + 1.5 * rows), layout="constrained")
    axes = figure.subplots(rows, 1, sharex=True, squeeze=False, height_ratios=(2.4, 1)[:rows])[:, 0]
    axes[0].set(ylabel="rod height [mm]", title="rod height above rest")
    if simulation:  # sigma is all of it: a wrong scale is a difference to the model too
        t, sigma = rod.table.time_s, rod.table.sigma_m.to_numpy(float)
        axes[1].fill_between(t, -2e3 * sigma, 2e3 * sigma, color=QUIET, alpha=0.35, lw=0, label="±2σ")
        axes[1].set(ylabel="measured − model [mm]")
    draw_beside(list(axes), rod, simulation, "model", size=3, line=".-", ms=2, lw=0.6)
    height, at = fits.determined("jump_height_m"), fits.determined("apex_time_s")
    if height and at:
        axes[0].errorbar(
            at.value, height.value * 1e3, 2e3 * height.sigma, fmt="o", ms=7, mfc="none", color="black", label="apex"
        )
    if simulation:
        s = simulation.table
        axes[0].plot(s.time_s, s.foot_m * 1e3, color=GREEN, lw=1, label="foot over the surface, model")
        axes[1].legend(loc="upper right")
    if actuation and actuation.moves:
        for axis in axes:
            axis.axvspan(actuation.start, actuation.stop, color=ACCENT, alpha=0.12, lw=0)
        axes[0].text(actuation.start, axes[0].get_ylim()[1], " motor", color=ACCENT, va="top")
    axes[-1].set_xlabel("time [s]")
    axes[0].legend(loc="upper right")
    return figure


@stage(version=3, picture=True)
def bed_picture(bed: BedHeight, image: BedImage) -> BedPicture:
    """The surface found in the picture of the bed."""
    v, profile = bed.values, bed.values["profile"]
    with open_pictures(image) as frames:
        grey = frames[v["picture"]]
    with styled() as Figure:
        figure = Figure(figsize=(8.6, 3.8), layout="constrained")
        left, right = figure.subplots(1, 2, width_ratios=(1, 1.6))
        show_frame(left, grey)
        left.plot(profile["column_px"], profile["row_px"], color=MODEL, lw=1)
        if image.floor_row is not None:
            left.axhline(image.floor_row, color=GREEN, lw=1)
        left.set(title="surface and floor", xlabel="column [px]", ylabel="row [px]")
        left.grid(False)
        x, height = (np.array(profile[k], float) * 1e3 for k in ("x_m", "height_m"))
        mean, sigma = v["height_m"] * 1e3, v["sigma_m"] * 1e3
        right.plot(x, height, color=MEASURED, lw=0.8, label="surface")
        right.axhspan(mean - 2 * sigma, mean + 2 * sigma, color=MODEL, alpha=0.25, lw=0, label="±2σ")
        right.axhline(mean, color=MODEL, label="mean")
        right.legend()
        phi = v["volume_fraction"]
        text = f"\nφ = {phi:.4f} ± {v['sigma_volume_fraction']:.4f}" if phi is not None else ""
        right.set(title=f"bed height {mean:.2f} ± {sigma:.2f} mm{text}", xlabel="x [mm]", ylabel="height [mm]")
        return BedPicture(png(figure))


@stage(version=4, picture=True)
def fit_picture(fits: Fits, rod: RodMotion | None, column: Column | None, flow: Flow | None) -> FitPicture:
    """The fits beside the data they were made on."""
    panels: list[Callable[[Axes], None]] = []
    if column is not None:
        panels += [partial(draw, fits=fits, column=column) for draw in COLUMN_PANELS]
        if flow is not None and fits.determined("cone_slope_kg_m"):
            panels.append(partial(draw_cone, fits=fits, column=column, flow=flow))
    if rod is not None and fits.get("ring_start_s"):
        panels.append(partial(draw_ring, fits=fits, rod=rod))
    if not panels:
        raise NotApplicable(["fit_picture needs a ring-down or a grain film"])
    with styled() as Figure:
        figure = Figure(figsize=(3.1 * len(panels) + 0.4, 3.2), layout="constrained")
        for axis, draw in zip(figure.subplots(1, len(panels), squeeze=False)[0], panels, strict=True):
            draw(axis)
        return FitPicture(png(figure))


RING = ("frequency_hz", "zeta", "ring_amplitude_m", "ring_offset_m", "ring_phase_rad", "ring_start_s", "ring_stop_s")


def draw_ring(axis: Axes, fits: Fits, rod: RodMotion) -> None:
    """The ring-down after the last landing and its damped cosine."""
    (t, h), (line, wave) = ringing(fits, rod)
    axis.plot(t, h * 1e3, ".", ms=3, color=MEASURED, label="measured")
    axis.plot(line, wave * 1e3, color=MODEL, lw=0.8, label="fit")
    axis.legend(loc="upper right")
    f, zeta = fits["frequency_hz"].value, fits["zeta"].value
    axis.set(title=rf"ring-down {f:.3f} Hz, $\zeta$ = {zeta:.4f}", xlabel="time [s]", ylabel="height [mm]")


def ring_down(fits: Fits, rod: RodMotion, Figure: NewFigure) -> Figure:
    """The figure of a ring-down."""
    figure = Figure(figsize=(4.4, 3.0), layout="constrained")
    draw_ring(figure.subplots(), fits, rod)
    return figure


def ringing(fits: Fits, rod: RodMotion) -> tuple[tuple[Array, Array], tuple[Array, Array]]:
    """Time [s] and height [m] about rest of the ring-down, as measured and as fitted."""
    t, h, _ = rod.arrays
    f, zeta, a, offset, phase, start, stop = (fits[k].value for k in RING)
    w = (t >= start) & (t <= stop)
    line = np.linspace(start, stop, 1500)
    omega0 = 2 * np.pi * f / np.sqrt(1 - zeta**2)
    wave = a * np.exp(-zeta * omega0 * (line - start)) * np.cos(2 * np.pi * f * (line - start) + phase)
    return (t[w], h[w] - offset), (line, wave)


def draw_profile(axis: Axes, fits: Fits, column: Column) -> None:
    """Speed below the foot at the frame with the fastest foot, and the exponential a^(z+b)."""
    c, i = column.field, fastest(column)
    z = c.depth.values[:, i]
    top = float(c.max_speed[i])
    axis.errorbar(
        z * 1e3, c.speed.values[:, i] / top, c.speed_sigma.values[:, i] / top, fmt=".", ms=3, lw=0.6, color=MEASURED
    )
    line = np.linspace(0, np.nanmax(z), 200)
    axis.plot(
        line * 1e3, np.minimum(np.exp(float(c.log_a[i]) * (line + float(c.b[i]))), 1.0), color=MODEL, label="$a^{z+b}$"
    )
    axis.axhline(float(column.geometry.front), color=QUIET, lw=0.8, ls="--", label="jammed above")
    axis.set_xlim(0)
    axis.set(
        title=f"central column, t = {float(c.t[i]):.3f} s", xlabel="z below the foot [mm]", ylabel="speed / largest"
    )
    axis.legend()


def fastest(column: Column) -> int:
    """The frame with the fastest foot of those with an exponential."""
    c = column.field
    known = np.isfinite(c.beta_deg)
    return int(np.nanargmax(np.where(known, c.max_speed, np.nan))) if known.any() else 0


def draw_beta(axis: Axes, fits: Fits, column: Column) -> None:
    """beta against the foot's depth."""
    c = column.field
    axis.errorbar(c.foot_depth * 1e3, c.beta_deg, c.beta_deg_sigma, fmt=".", lw=0.7, color=MEASURED)
    if b := fits.determined("beta_deg"):
        axis.axhline(b.value, color=MODEL, label=f"mean {measured(b.value, b.sigma)}°")
        axis.legend(loc="upper center")  # least certain where the foot is slow: at the ends
    axis.margins(y=0.2)
    axis.set(title=r"$\beta = \arcsin a^{\Delta z}$", xlabel="foot depth [mm]", ylabel=r"$\beta$ [°]")


def draw_front(axis: Axes, fits: Fits, column: Column) -> None:
    """Thickness of the jammed layer against the foot's depth; the slope is mu."""
    c = column.field
    x = c.foot_depth.values * 1e3
    axis.errorbar(x, c.jammed_thickness * 1e3, c.jammed_thickness_sigma * 1e3, fmt=".", lw=0.7, color=MEASURED)
    mu, cut = fits.get("mu"), fits.get("mu_intercept_m")
    if mu and cut and mu.known and np.isfinite(x).any():
        line = np.array([np.nanmin(x), np.nanmax(x)])
        axis.plot(
            line, mu.value * line + cut.value * 1e3, color=MODEL, label=rf"$\mu$ = {measured(mu.value, mu.sigma)}"
        )
        axis.legend()
    axis.set(title="jammed front", xlabel="foot depth [mm]", ylabel="thickness [mm]")


def draw_theta(axis: Axes, fits: Fits, column: Column) -> None:
    """Angle of the cone's side and of the bands of shear against the foot's depth."""
    c = column.field
    for name, color, mark, label in (
        ("theta_bands_deg", QUIET, "x", "bands of shear"),
        ("theta_deg", MEASURED, ".", "side of the cone"),
    ):
        axis.errorbar(c.foot_depth * 1e3, c[name], c[f"{name}_sigma"], fmt=mark, lw=0.7, ms=4, color=color, label=label)
    if theta := fits.determined("theta_deg"):
        axis.axhline(theta.value, color=MODEL, label=f"mean {measured(theta.value, theta.sigma)}°")
    axis.legend()
    axis.set(title=r"$\theta$ of the cone", xlabel="foot depth [mm]", ylabel=r"$\theta$ [°]", ylim=(30, 90))


def draw_cone(axis: Axes, fits: Fits, column: Column, flow: Flow) -> None:
    """Added mass against depth and, where it was fitted, the saturating cone (33)."""
    f = flow.field
    z = f.foot_depth.values
    sinks = np.gradient(z) > 0.0 if len(z) > 1 else np.ones(len(z), bool)
    for which, color, mark, label in ((sinks, MEASURED, ".", "foot sinks"), (~sinks, QUIET, "x", "foot rises")):
        mass, sigma = f.added_mass.values[which] * 1e3, f.added_mass_sigma.values[which] * 1e3
        if np.isfinite(mass).any():
            axis.errorbar(z[which] * 1e3, mass, sigma, fmt=mark, lw=0.7, ms=4, color=color, label=label)
    slope, narrowing = fits.determined("cone_slope_kg_m"), fits.determined("mu_over_tan_theta")
    if slope and narrowing:
        line = np.linspace(0.0, np.nanmax(z[np.isfinite(f.added_mass.values)]), 100)
        c, R = fits["C"], column.geometry.foot_radius_m
        label = f"$C$ = {measured(c.value, c.sigma)}" if c.known else "cone"
        axis.plot(line * 1e3, mass_curve(line, slope.value, narrowing.value, R) * 1e3, color=GREEN, label=label)
    axis.legend()
    axis.set(title="added mass and cone", xlabel="foot depth [mm]", ylabel="$m_a$ [g]")


def draw_sides(axis: Axes, column: xr.Dataset, i: int) -> None:
    """Ridges of the shear rate, outline and its straight sides, over a map of frame i in mm (Fig. 52b)."""
    c = column.isel(t=i)
    face = float(c.depth[0] + c.y[0])
    for name, color, mark in (("ridge", "white", "."), ("outline", ACCENT, "_")):
        for way in ("left", "right"):
            axis.plot(c[f"{name}_{way}"] * 1e3, c.y * 1e3, mark, color=color, ms=3)
    theta, radius = np.radians(float(c.theta_deg)), float(c.cone_radius)
    if np.isfinite(theta):
        depth = np.array([0.0, min(float(c.jammed_thickness), radius * np.tan(theta))])
        for sign in (-1.0, 1.0):
            axis.plot(sign * (radius - depth / np.tan(theta)) * 1e3, (face - depth) * 1e3, color=GREEN, lw=1.2)
        axis.set_title(f"θ = {float(c.theta_deg):.1f}°, bands {float(c.theta_bands_deg):.1f}°", fontsize=9)


def draw_history(axis: Axes, fits: Fits, column: Column) -> None:
    """Speed below the foot over depth and time, as a share of each frame's largest; the front's thickness on it."""
    c = column.field
    levels, shown = history(column)
    levels, deep = levels * 1e3, levels[-1] * 1e3
    drawn = axis.pcolormesh(c.t, levels, shown, shading="nearest", vmin=0.0, vmax=1.0, rasterized=True)
    axis.plot(c.t, c.jammed_thickness * 1e3, "w.", ms=3)
    axis.figure.colorbar(drawn, ax=axis, label="speed / largest")
    axis.set(title="central column (white: front)", xlabel="time [s]", ylabel="z below the foot [mm]", ylim=(deep, 0.0))
    if (seen := np.flatnonzero(np.isfinite(shown).any(axis=0))).size > 1:
        axis.set_xlim(float(c.t[seen[0]]), float(c.t[seen[-1]]))
    axis.grid(False)


def history(column: Column) -> tuple[Array, Array]:
    """Depths below the foot (n,) [m], and the speed there over each frame's largest (n, t), NaN where not seen."""
    c = column.field
    z, shown = c.depth.values, (c.speed / c.max_speed).transpose("y", "t").values
    levels = np.linspace(0.0, np.nanmax(np.where(np.isfinite(shown), z, np.nan), initial=0.0), shown.shape[0])
    return levels, np.transpose([_at_levels(levels, z[:, i], shown[:, i]) for i in range(shown.shape[1])])


def _at_levels(levels: Array, z: Array, values: Array) -> Array:
    """A column's values at the depths `levels` (n,), NaN beyond what was seen."""
    known = np.isfinite(z) & np.isfinite(values)
    if known.sum() < 2:
        return np.full(levels.size, np.nan)
    order = np.argsort(z[known])
    return np.interp(levels, z[known][order], values[known][order], left=np.nan, right=np.nan)


COLUMN_PANELS = (draw_history, draw_profile, draw_beta, draw_front, draw_theta)
