"""The figure of a sweep, maps or lines over its axes, and of a comparison with measurements."""

from __future__ import annotations

from collections.abc import Callable, Hashable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import xarray as xr

from jumpvision.base.record import RecordError
from jumpvision.base.schema import InputError
from jumpvision.experiment.results.fields import attributes_of
from jumpvision.report.figures.pictures import png_of
from jumpvision.report.style import MEASURED, QUIET, NewFigure, kind_of, spoken

from .axes import AXES
from .comparison import FILE as COMPARISON
from .comparison import Comparison
from .sweep import FILE, origin_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# name: title, factor, unit on the figure
SHOWN = {
    "com_height_m": ("height of the centre of mass", 1e3, "mm"),
    "n_jumps": ("number of jumps", 1.0, ""),
    "peak_power_W": ("peak motor power", 1.0, "W"),
    "peak_force_N": ("peak motor force", 1.0, "N"),
    "flight_height_m": ("flight height", 1e3, "mm"),
    "jump_height_m": ("jump height of the rod", 1e3, "mm"),
}
COUNTED = 8  # from here numbers of jumps share a colour


def read_sweep(file: Path) -> xr.Dataset:
    """Read the data set of a sweep.nc or comparison.nc. Raises InputError for any other file."""
    try:
        with xr.open_dataset(file, engine="netcdf4") as data:
            data = data.load()
    except (OSError, ValueError) as e:
        raise InputError([f"{file}: not a NetCDF file that can be read ({e})"]) from None
    try:
        origin_of(data)
    except RecordError as e:
        raise InputError([f"{file}: {e}; give the sweep.nc or comparison.nc of `jumpvision sweep`"]) from None
    return data


def picture(data: xr.Dataset) -> bytes:
    """Return the figure as PNG."""
    return png_of(sweep_figure, data)


def sweep_figure(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Draw the figure of a data set: a comparison's, else a map's."""
    return comparison(data, Figure) if origin_of(data).analysis == "comparison" else grid(data, Figure)


def of_folder(source: Path) -> dict[str, Callable[[NewFigure], Figure]]:
    """Return the function that draws a NetCDF file's figure, or every one's in a folder of results, by name."""
    files = [source] if source.is_file() else [f for n in (FILE, COMPARISON) for f in (source / n, *_kept(source, n))]
    return {f.stem: partial(sweep_figure, read_sweep(f)) for f in files if f.exists()}


def _kept(folder: Path, name: str) -> list[Path]:
    """Those that another has taken the name of."""
    return sorted(folder.glob(f"{Path(name).stem}-*.nc"))


def grid(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """By the number of axes: bars of a single jump, lines, maps, or maps in rows of a third axis."""
    # more points than an axis has pixels are not drawn
    data = data.isel({d: slice(None, None, -(-data.sizes[d] // 600)) for d in data.com_height_m.dims[:2]})
    dims = data.com_height_m.dims
    if len(dims) in (1, 2):
        figure = Figure(figsize=(10.4, 6.4), layout="constrained")
        for axis, name in zip(figure.subplots(2, 3).flat, SHOWN):
            if len(dims) == 1:
                one_line(axis, data[name].where(data.n_jumps >= 0))
            else:
                one_map(figure, axis, data[name], data)
            if len(dims) == 2 and name == "com_height_m":
                regions(axis, data)
    elif len(dims) == 0:
        figure = Figure(figsize=(6.4, 2.6), layout="constrained")
        axis = figure.subplots()
        names = ["com_height_m", "flight_height_m", "jump_height_m"]
        axis.barh([SHOWN[n][0] for n in names], [float(data[n]) * 1e3 for n in names], color=MEASURED)
        axis.set(title="one jump", xlabel="height [mm]")
    else:
        figure = panels(data, Figure)
    figure.suptitle(_what(data, dims), fontsize=8, color=QUIET, x=0.01, ha="left")
    return figure


def _what(data: xr.Dataset, dims: Sequence[Hashable]) -> str:
    """Hold the robot and the values that all jumps share."""
    origin = origin_of(data)
    constants = origin.values
    law = [n for n in ("frequency", "phase", "amplitude", "cycles", "delay") if n not in dims]
    if "alpha" in data.coords and "amplitude" in law and "amplitude" not in data.coords:
        law.remove("amplitude")
    said = [(n, float(data[n]) if n in data.coords else constants[n]) for n in law]
    said += [(str(n), float(v)) for n, v in data.coords.items() if not v.ndim and n not in law]
    words = [AXES[n].text(v, 4) for n, v in said if v or n != "delay"]
    dotted = "; dotted: natural frequency" if origin.ground == "hard" and origin.f0_Hz and "frequency" in dims else ""
    return f"{origin.robot}: {', '.join(words)}{dotted if len(dims) > 1 else ''}"


def label(name: str) -> str:
    """An axis with its unit."""
    a = AXES[name]
    return f"{a.label} [{a.shown}]" if a.shown else a.label


def one_map(figure: Figure, axis: Axes, values: xr.DataArray, data: xr.Dataset) -> None:
    """One quantity over two axes, the first of them upwards; f_0 where frequency is one of them."""
    import matplotlib as mpl

    up, right = (str(d) for d in values.dims)
    title, factor, unit = SHOWN[str(values.name)]
    x, y = (data[n].values * AXES[n].factor for n in (right, up))
    z = values.values * factor
    more: dict[str, Any] = {}
    if values.name == "n_jumps":
        z = np.where(z < 0, np.nan, np.minimum(z, COUNTED))
        top = int(max(np.nanmax(z), 2)) if np.isfinite(z).any() else 2
        more = {"norm": mpl.colors.BoundaryNorm(np.arange(-0.5, top + 1), 256)}
    elif np.isfinite(z).any():
        # a few singular points (impulses, long flights of fast jumps) must not hide the rest
        more = {"vmin": min(0.0, float(np.nanmin(z))), "vmax": float(np.nanpercentile(z, 99.5))}
    seen = axis.pcolormesh(x, y, z, shading="nearest", rasterized=True, **more)
    bar = figure.colorbar(seen, ax=axis, extend="max" if "vmax" in more and np.nanmax(z) > more["vmax"] else "neither")
    bar.ax.set_ylabel(unit)
    if values.name == "n_jumps":
        ticks = np.arange(0, top + 1)
        bar.set_ticks(list(ticks), labels=[f"{t:d}" if t < COUNTED else f"≥ {t:d}" for t in ticks])
    origin = origin_of(data)
    if "frequency" in values.dims and origin.f0_Hz is not None and origin.ground == "hard":
        (axis.axhline if up == "frequency" else axis.axvline)(origin.f0_Hz, color="white", lw=0.8, ls=":")
    axis.set(title=title, xlabel=label(right), ylabel=label(up))
    axis.grid(False)


def regions(axis: Axes, data: xr.Dataset) -> None:
    """Outlines and names of the regions of single, stutter and multi-jumps."""
    up, right = (str(d) for d in data.jump_class.dims)
    x, y = (data[n].values * AXES[n].factor for n in (right, up))
    kind = data.jump_class.values
    for edge in (0.5, 1.5, 2.5):
        if (kind < edge).any() and (kind > edge).any():
            axis.contour(x, y, kind, levels=[edge], colors="white", linewidths=0.6)
    for i, name in ((1, "S"), (2, "stutter"), (3, "MJ")):
        here = np.argwhere(kind == i)
        if len(here) > 0.02 * kind.size:
            place = here[np.argmin(np.abs(here - np.median(here, axis=0)).sum(axis=1))]
            axis.text(x[place[1]], y[place[0]], name, color="white", fontsize=7, ha="center", va="bottom")


def one_line(axis: Axes, values: xr.DataArray) -> None:
    """One quantity over one axis."""
    title, factor, unit = SHOWN[str(values.name)]
    (dim,) = map(str, values.dims)
    counted = values.name == "n_jumps"
    style = "steps-mid" if counted else "default"
    axis.plot(values[dim] * AXES[dim].factor, values * factor, color=MEASURED, drawstyle=style)
    if counted:
        axis.locator_params("y", integer=True, min_n_ticks=1)
    axis.set(xlabel=label(dim), ylabel=f"{title} [{unit}]" if unit else title)


def panels(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Maps of the height over the first two axes at six values of the third; further axes at their middle."""
    height = data.com_height_m
    rest = {d: data.sizes[d] // 2 for d in height.dims[3:]}
    height = height.isel(rest)
    third = str(height.dims[2])
    at = np.unique(np.linspace(0, data.sizes[third] - 1, 6).round().astype(int))
    figure = Figure(figsize=(10.4, 6.4), layout="constrained")
    axes = figure.subplots(2, 3, sharex=True, sharey=True).flat
    for axis, i in zip(axes, at):
        one_map(figure, axis, height.isel({third: i}), data)
        axis.set_title(f"height at {AXES[third].text(float(data[third][i]), 4)}")
    for axis in list(axes)[: 6 - len(at)]:
        axis.set_visible(False)
    return figure


def heading(data: xr.Dataset) -> str:
    """Return the heading of a comparison: chi^2 of all conditions and how many stand out."""
    whole = attributes_of(Comparison, data)
    p = f"p = {whole.p_value:.2g}" if whole.p_value > 1e-4 else "p < 0.0001"
    out = int(data.stands_out.sum())
    return (
        f"{whole.campaign}: χ² = {whole.chi2:.4g} of {whole.conditions} conditions, {p}; "
        f"{out or 'no'} condition{'s stand' if out != 1 else ' stands'} out"
    )


def comparison(data: xr.Dataset, Figure: NewFigure) -> Figure:
    """Measured heights against those of each model, and their differences over frequency, by kind; with 2 sigma."""
    figure = Figure(figsize=(9.4, 4.6), layout="constrained")
    left, right = figure.subplots(1, 2)
    models = data.model_name.values.tolist()
    for kind, one in data.groupby("kind"):
        color, mark = kind_of(kind)
        measured, sigma = 1e3 * one.measured_height_m, 2e3 * one.measured_sigma_m
        for m, model in enumerate(models):  # the declared model, whose uncertainty is known, is filled
            height, model_sigma = 1e3 * one.model_height_m[m], 2e3 * one.model_sigma_m * (m == 0)
            style = {"fmt": mark, "ms": 4, "color": color, "mfc": "none" if m else color, "capsize": 2}
            left.errorbar(height, measured, sigma, model_sigma, label=f"{spoken(str(kind))}, {model}", **style)
            right.errorbar(one.frequency, measured - height, np.hypot(sigma, model_sigma), **style)
    odd = data.isel(condition=data.stands_out.values == 1)
    ring = {"marker": "o", "s": 100, "facecolors": "none", "edgecolors": "black"}
    if odd.sizes["condition"]:
        left.scatter(1e3 * odd.simulated_height_m, 1e3 * odd.measured_height_m, label="stands out", **ring)
        right.scatter(odd.frequency, 1e3 * odd.difference_m, **ring)
    left.axline((0.0, 0.0), slope=1.0, color=QUIET, lw=0.8)
    right.axhline(0.0, color=QUIET, lw=0.8)
    left.set(xlabel="simulated jump height [mm]", ylabel="measured jump height [mm]")
    right.set(xlabel="frequency [Hz]", ylabel="measured − simulated [mm]")
    figure.suptitle(heading(data), fontsize=9, x=0.01, ha="left")
    figure.legend(loc="outside lower center", ncols=3, fontsize=7)
    return figure
