"""The page of a sweep: its maps or lines to point at, and the figure of its analysis."""

from __future__ import annotations

from pathlib import Path
from typing import Unpack

import numpy as np
import xarray as xr

from jumpvision import __version__
from jumpvision.base.arrays import Array
from jumpvision.base.storage import write_aside
from jumpvision.experiment import files
from jumpvision.experiment.results.fields import attributes_of
from jumpvision.report.pages.charts import (
    Axis,
    AxisLook,
    Chart,
    Panel,
    Series,
    axis,
    chart,
    numbers,
    panel,
    series,
)
from jumpvision.report.pages.page import script, style, template
from jumpvision.report.pages.words import drawing
from jumpvision.thesis.figures.sweeps import SHOWN, read_sweep, sweep_figure
from jumpvision.thesis.studies.axes import AXES
from jumpvision.thesis.studies.comparison import Drawn, compare
from jumpvision.thesis.studies.compute import origin_of
from jumpvision.thesis.studies.motions import grid


def write_sweep(file: Path) -> Path:
    """report.html beside a sweep.nc or comparison.nc; its path."""
    data = read_sweep(file)
    sentence, facts = words(data)
    text = template("sweep.html.j2").render(
        style=style(),
        script=script(),
        title=f"{file.stem}: {origin_of(data).analysis}",
        version=__version__,
        sentence=sentence,
        facts=facts,
        charts=charts_of(data),
        figure=drawing(sweep_figure, data),
        attributes={k: str(v) for k, v in data.attrs.items()},
    )
    page = file.with_name(files.REPORT if "-" not in file.stem else f"{file.stem}.html")
    write_aside(page, text)
    return page


def words(data: xr.Dataset) -> tuple[str, list[tuple[str, str, str]]]:
    """(sentence, numbers): where the highest jump of a map lies; else what the analysis is."""
    origin = origin_of(data)
    if origin.analysis != grid.name or not np.isfinite(data.com_height_m).any():
        return f"{origin.ground} ground: {origin.analysis.replace('-', ' ')}".capitalize() + ".", []
    best = data.isel(data.com_height_m.argmax(...)) if data.com_height_m.dims else data
    at = ", ".join(axis_value(str(d), float(best[d])) for d in data.com_height_m.dims)
    height = f"{1e3 * float(best.com_height_m):.4g}"
    text = f"{origin.robot.capitalize()}: the highest of "
    text += f"{data.com_height_m.size} jumps raises the centre of mass {height} mm" + (f", at {at}." if at else ".")
    facts = [(height, "mm", "highest centre of mass")]
    facts += [
        (f"{float(best[n]) * SHOWN[n][1]:.4g}", SHOWN[n][2], f"{SHOWN[n][0]}, there")
        for n in ("peak_power_W", "n_jumps")
    ]
    return text, facts


def axis_value(name: str, value: float) -> str:
    """frequency 8.2 Hz."""
    return AXES[name].text(value, 3)


def charts_of(data: xr.Dataset) -> list[Chart]:
    """Maps over two axes, lines over one; none for other analyses, which have their figure."""
    analysis = origin_of(data).analysis
    if analysis == compare.name:
        return [comparison(data)]
    if analysis != grid.name:
        return []
    dims = [str(d) for d in data.com_height_m.dims]
    if len(dims) == 1:
        x = data[dims[0]].values * AXES[dims[0]].factor
        shown = [(n, *SHOWN[n]) for n in SHOWN if n in data]
        panels = [
            panel(title, axis_of(dims[0]), axis(title, unit), [series(title, "measured", x, data[n] * k, kind="line")])
            for n, title, k, unit in shown
        ]
        return [chart("Along the axis", panels)]
    if len(dims) == 2:
        return [chart("Maps", [map_panel(data, n, dims) for n in SHOWN if n in data])]
    return []


def map_panel(data: xr.Dataset, name: str, dims: list[str]) -> Panel:
    """One quantity over two axes, the first upwards; thinned to 120 points an axis."""
    title, factor, unit = SHOWN[name]
    thin = {d: slice(None, None, -(-data.sizes[d] // 120)) for d in dims}
    part = data[[name]].isel(thin)
    z = part[name].transpose(*dims).values * factor
    z = np.where(z < 0, np.nan, z) if name == "n_jumps" else z
    seen = z[np.isfinite(z)]
    limits = [min(0.0, float(seen.min())), float(np.percentile(seen, 99.5)) or 1.0] if seen.size else [0.0, 1.0]
    x, y = (part[d].values * AXES[d].factor for d in dims[::-1])
    drawn: Series = {
        "name": title,
        "kind": "map",
        "role": "ink",
        "x": numbers(x),
        "y": numbers(y),
        "z": [numbers(row, digits=4) for row in z],
        "limits": numbers(limits),
        "unit": unit,
    }
    edges = [edges_of(x), edges_of(y)]
    return panel(
        f"{title} [{unit}]" if unit else title,
        axis_of(dims[1], range=edges[0]),
        axis_of(dims[0], range=edges[1]),
        [drawn],
        height=300,
        share=1.25,
    )


def edges_of(x: Array) -> list[float]:
    """Ends of the cells about evenly spaced centres."""
    half = 0.5 * (x[-1] - x[0]) / (len(x) - 1) if len(x) > 1 else 0.5
    return [float(x[0] - half), float(x[-1] + half)]


def axis_of(name: str, **look: Unpack[AxisLook]) -> Axis:
    """An axis of a sweep."""
    return axis(AXES[name].label, AXES[name].shown, **look)


ROLES = ("measured", "model", "fit", "ink")


def comparison(data: xr.Dataset) -> Chart:
    """Measured and simulated heights of every condition along an axis, each model's curve, and what is left."""
    over = attributes_of(Drawn, data).over
    heights: list[Series] = []
    residuals: list[Series] = []
    for k, name in enumerate(data.series_name.values.tolist()):
        one = data.isel(condition=data.condition_series.values == k).sortby(over)
        role, x = ROLES[k % len(ROLES)], one[over].values * AXES[over].factor
        said = [point(one.isel(condition=i)) for i in range(one.sizes["condition"])]
        for m, model in enumerate(data.model_name.values.tolist()):
            at = data.curve_at[k].values * AXES[over].factor
            curve = series(f"{name}: {model}", role, at, 1e3 * data.curve_m[k, m], kind="line", dash=m > 0)
            own = 1e3 * one.model_height_m[m]
            heights += [curve, series(f"{name}: {model}, own motor", role, x, own, hollow=True, size=6 - m, label=said)]
            left = 1e3 * (one.measured_height_m - one.model_height_m[m])
            sigma = 1e3 * np.hypot(one.measured_sigma_m, one.model_sigma_m)
            residuals.append(series(f"{name}: less {model}", role, x, left, sigma, hollow=m > 0, label=said))
        height, sigma = 1e3 * one.measured_height_m, 1e3 * one.measured_sigma_m
        heights.append(series(f"{name}: measured", role, x, height, sigma, label=said))
    panels = [
        panel("jump height", axis_of(over), axis("height", "mm", zero=True), heights, height=320),
        panel("measured − simulated", axis_of(over), axis("difference", "mm"), residuals, rules=[{"y": 0}]),
    ]
    return chart("Measured against simulated", panels, "Bars are ±2σ.", stacked=True)


def point(one: xr.Dataset) -> str:
    """What a measured point is, in words."""
    height, sigma = 1e3 * float(one.measured_height_m), 1e3 * float(one.measured_sigma_m)
    text = f"{one.group.item() or 'one condition'}: {height:.4g} ± {sigma:.2g} mm of {int(one.trials)}"
    text += f", simulated {1e3 * float(one.simulated_height_m):.4g} mm, z {float(one.z):+.1f}"
    spread = 1e3 * float(one.trial_spread_m)
    return text + (f", trials scatter by {spread:.2g} mm" if np.isfinite(spread) else "")
