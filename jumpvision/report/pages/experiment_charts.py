"""The interactive figures of one experiment, from its result files."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from jumpvision.experiment.inputs.sections import Actuation
from jumpvision.experiment.results.fields import Column, Flow
from jumpvision.experiment.results.tables import RodMotion, Simulation
from jumpvision.experiment.results.values import Intrusion

from .charts import MOST, Chart, Rule, Series, axis, chart, fits_of, panel, series
from .quantities import HALF, WHOLE


def experiment_charts(results: Path, law: Actuation | None = None) -> list[Chart]:
    """Figures of one experiment from its result files. law: its [actuation]."""
    made = (jump_chart(results, law), grains_chart(results), intrusion_chart(results))
    return [c for c in made if c is not None]


def jump_chart(results: Path, law: Actuation | None = None) -> Chart | None:
    """Height of the rod, measured and simulated, and their difference, against time."""
    if not (results / RodMotion.file).exists():
        return None
    whole = RodMotion.load(results).table
    every = -(-len(whole) // MOST)
    rod = RodMotion(whole.iloc[::every])
    t, h, sigma = (rod.table[c] for c in RodMotion.columns)
    spans = [(law.start, law.stop, "motor")] if law is not None and law.moves else []
    x, y = axis("time", "s"), axis("height above rest", "mm")
    measured = [series("measured", "measured", t, h * 1e3, sigma * 1e3, size=2), *apex_of(results)]
    note = "Bars and bands are ±2σ." + (f" Every {every}th frame is shown." if every > 1 else "")
    if not (results / Simulation.file).exists():
        return chart("Height of the rod", [panel("rod", x, y, measured, spans=spans)], note)
    both = rod.beside(Simulation.load(results))
    panels = [
        panel("rod", x, y, [series("model", "model", t, both.model * 1e3, kind="line"), *measured], spans=spans),
        panel(
            "measured − model",
            x,
            axis("difference", "mm"),
            [series("difference", "measured", t, both.difference * 1e3, sigma * 1e3, kind="line")],
            spans=spans,
            rules=[{"y": 0}],
            height=170,
        ),
    ]
    return chart("The jump", panels, note, stacked=True)


def apex_of(results: Path) -> list[Series]:
    """The apex that the jump height is of, where the fit found one."""
    fits = fits_of(results)
    height, time = fits.determined("jump_height_m"), fits.get("apex_time_s")
    if height is None or time is None or not np.isfinite(time.value):
        return []
    at = [time.value], [height.value * 1e3], [height.sigma * 1e3]
    return [series("apex", "ink", *at, hollow=True, size=7)]


def whole_disc(results: Path) -> bool:
    """Whether the grain film shows a whole foot and not half of one at the wall."""
    import xarray as xr

    if not (results / Flow.file).exists():
        return False
    with xr.open_dataset(results / Flow.file, decode_times=False) as f:
        return f.attrs.get("disc") == "full"


def grains_chart(results: Path) -> Chart | None:
    """Momentum of the grains against time; added mass and jammed front against depth."""
    import xarray as xr

    from jumpvision.films.grains.cone import mass_curve

    if not (results / Flow.file).exists():
        return None
    fits = fits_of(results)
    with xr.open_dataset(results / Flow.file, decode_times=False) as f:
        t, depth = f.t.values, f.foot_depth.values * 1e3
        p, p_sigma, mass, mass_sigma = (
            f[k].values for k in ("momentum", "momentum_sigma", "added_mass", "added_mass_sigma")
        )
    if not np.isfinite(p).any():
        return None
    foot = WHOLE if whole_disc(results) else HALF
    panels = [
        panel(
            f"momentum of the grains, downwards ({foot})",
            axis("time", "ms"),
            axis("P", "g m/s"),
            [series("momentum", "measured", t * 1e3, p * 1e3, p_sigma * 1e3, kind="line")],
        )
    ]
    sinks = np.gradient(depth) > 0.0 if depth.size > 1 else np.ones(depth.size, bool)
    shown = [
        series(name, role, depth[which], mass[which] * 1e3, mass_sigma[which] * 1e3, size=3, hollow=role == "quiet")
        for name, role, which in (("measured", "measured", sinks), ("foot rises", "quiet", ~sinks))
        if np.isfinite(mass[which]).any()
    ]
    radius = float("nan")
    if (results / Column.file).exists():
        column = Column.load(results)
        radius, c = column.geometry.foot_radius_m, column.field
        front, front_sigma = c.jammed_thickness.values * 1e3, c.jammed_thickness_sigma.values * 1e3
    else:
        front = front_sigma = np.full(t.size, np.nan)
    slope, narrowing = fits.determined("cone_slope_kg_m"), fits.determined("mu_over_tan_theta")
    if slope and narrowing and np.isfinite(radius) and np.isfinite(mass).any():
        line = np.linspace(0.0, np.nanmax(depth[np.isfinite(mass)]), 80)
        shown.append(
            series(
                "cone", "green", line, mass_curve(line * 1e-3, slope.value, narrowing.value, radius) * 1e3, kind="line"
            )
        )
    panels.append(
        panel(
            f"mass that moves with the foot ({foot})",
            axis("depth of the foot", "mm"),
            axis("mₐ", "g", zero=True),
            shown,
        )
    )
    if np.isfinite(front).any():
        shown = [series("measured", "measured", depth, front, front_sigma, size=3)]
        mu, cut = fits.determined("mu"), fits.determined("mu_intercept_m")
        if mu and cut:
            ends = np.array([np.nanmin(depth), np.nanmax(depth)])
            shown.append(series("slope μ", "model", ends, mu.value * ends + cut.value * 1e3, kind="line"))
        panels.append(
            panel(
                "jammed front below the foot",
                axis("depth of the foot", "mm"),
                axis("thickness", "mm", zero=True),
                shown,
            )
        )
    return chart("The grains", panels, "Bars and bands are ±2σ. P/v is singular where the foot stops: left out there.")


def intrusion_chart(results: Path) -> Chart | None:
    """Force against depth with the fit and the cone, and what the fit leaves over."""
    if not (results / Intrusion.file).exists():
        return None
    intrusion = Intrusion.load(results)
    v, profile = intrusion.values, intrusion.values["profile"]
    every = -(-len(profile["depth_m"]) // MOST)
    z, force, fitted = (np.array(profile[k], float)[::every] for k in ("depth_m", "force_N", "fitted_N"))
    z = z * 1e3
    shown = [series("measured", "measured", z, force, size=2), series("fit", "model", z, fitted, kind="line")]
    if v["cone"]:
        shown.append(series("RFT cone", "green", z, np.array(v["cone"]["force_N"])[::every], kind="line", dash=True))
    delta = intrusion.fits.determined("delta")
    rules: list[Rule] = [{"x": delta.value * 1e3}] if delta else []
    depth, left = axis("depth below the surface", "mm"), force - fitted
    panels = [
        panel("force against depth", depth, axis("force", "N", zero=True), shown, rules=rules),
        panel(
            "measured − fit",
            depth,
            axis("force", "N"),
            [series("difference", "measured", z, left, kind="line")],
            rules=[{"y": 0}],
            height=170,
        ),
    ]
    kinds = {"reintrusion": ("re-intrusion", "measured"), "stop_go": ("stop-go", "accent")}
    over = [
        series(word, role, *np.array([(e["depth_m"] * 1e3, e["overshoot_N"], e["sigma_N"]) for e in mine]).T)
        for kind, (word, role) in kinds.items()
        if (mine := [e for e in v["events"] if e["kind"] == kind])
    ]
    if over:
        panels.append(panel("overshoot after a pause or a withdrawal", depth, axis("force", "N", zero=True), over))
    return chart("Slow intrusion", panels, "Dashed: the depth δ of the bend." if rules else "", stacked=True)
