"""The interactive figures of what an experiment was made with: its motor, spring, air, ring-down, and grain column."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from jumpvision.base.arrays import measured
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.sections import Actuation, Fan, MotorLog
from jumpvision.experiment.results.fields import Column
from jumpvision.experiment.results.tables import RodMotion
from jumpvision.experiment.results.values import Geometry, SpringTest
from jumpvision.report.figures.bed import air_of
from jumpvision.report.figures.logs import hysteresis_words, played, with_sigma, work_words
from jumpvision.report.figures.pictures import fastest, history, ringing

from .charts import MOST, Chart, Panel, Series, axis, chart, fits_of, numbers, panel, series


def apparatus_charts(results: Path, experiment: Experiment | None) -> list[Chart]:
    """The figures that there are, from result files and the motor's log."""
    of_jump = [motor_chart(results, experiment), ring_chart(results), column_chart(results)]
    made = [*of_jump, spring_chart(results), air_chart(results, experiment)]
    return [c for c in made if c is not None]


def motor_chart(results: Path, experiment: Experiment | None) -> Chart | None:
    """Encoder and command, their difference, and the work of the motor's force, against time."""
    fits = fits_of(results)
    log, law = (experiment.section(s) for s in (MotorLog, Actuation)) if experiment else (None, None)
    if not isinstance(log, MotorLog) or not isinstance(law, Actuation) or not fits.determined("actuator_ratio"):
        return None
    m = played(fits, log, law)
    t, command, position = (v[:: -(-m.t.size // MOST)] for v in (m.t, m.command * 1e3, m.position * 1e3))
    x, spans = axis("time", "s"), [(law.start, law.stop, "motor runs")]
    plain = [(law.start, law.stop, "")]
    ratio, lag = with_sigma(fits["actuator_ratio"]), with_sigma(fits["actuator_lag_s"], 1e3)
    panels = [
        panel(
            f"encoder over command: ratio {ratio}, lag {lag} ms",
            x,
            axis("motor on the rod", "mm"),
            [
                series("command", "model", t, command, kind="line"),
                series("encoder", "measured", t, position, size=1.5),
            ],
            spans=spans,
        ),
        panel(
            "encoder − command",
            x,
            axis("difference", "mm"),
            [series("difference", "measured", t, position - command, kind="line")],
            spans=plain,
            rules=[{"y": 0}],
            height=170,
        ),
    ]
    if m.work is not None:
        so_far = series("work so far", "measured", t, m.work[:: -(-m.t.size // MOST)], kind="line")
        panels.append(
            panel(
                work_words(fits, ", "),
                x,
                axis("work", "J"),
                [so_far],
                spans=plain,
                rules=[{"y": fits["motor_work_J"].value}],
                height=170,
            )
        )
    return chart("The motor", panels, stacked=True)


def ring_chart(results: Path) -> Chart | None:
    """The ring-down after the last landing and its damped cosine."""
    fits = fits_of(results)
    if not fits.get("ring_start_s") or not (results / RodMotion.file).exists():
        return None
    (t, h), (line, wave) = ringing(fits, RodMotion.load(results))
    title = f"{fits['frequency_hz'].value:.3f} Hz, ζ = {fits['zeta'].value:.4f}"
    shown = [
        series("fit", "model", line, wave * 1e3, kind="line"),
        series("measured", "measured", t, h * 1e3, size=2),
    ]
    return chart("Ring-down", [panel(title, axis("time", "s"), axis("height about rest", "mm"), shown, height=220)])


def column_chart(results: Path) -> Chart | None:
    """The central column of a grain film: speeds over depth and time, the exponential, beta and theta."""
    if not (results / Column.file).exists():
        return None
    column, fits = Column.load(results), fits_of(results)
    c, depth = column.field, axis("depth of the foot", "mm")
    foot = c.foot_depth.values * 1e3
    panels: list[Panel] = []
    levels, shares = history(column)
    if np.isfinite(shares).any() and levels[-1] > 0.0:
        seen = np.flatnonzero(np.isfinite(shares).any(axis=0))
        part = slice(seen[0], seen[-1] + 1)
        speeds: Series = {
            "name": "speed / largest",
            "kind": "map",
            "role": "ink",
            "x": numbers(c.t.values[part], 1e3),
            "y": numbers(-levels[::-1], 1e3),
            "z": [numbers(row, digits=3) for row in shares[::-1, part]],
            "limits": [0.0, 1.0],
        }
        front = series("jammed front", "ink", c.t.values[part] * 1e3, -c.jammed_thickness.values[part] * 1e3, size=2)
        y = axis("place below the foot", "mm")
        panels.append(panel("speed of the central column / largest", axis("time", "ms"), y, [speeds, front], share=1.5))
        i = fastest(column)
        z, top = c.depth.values[:, i], float(c.max_speed[i])
        line = np.linspace(0.0, np.nanmax(z), 100)
        share = np.minimum(np.exp(float(c.log_a[i]) * (line + float(c.b[i]))), 1.0)
        panels.append(
            panel(
                f"at {float(c.t[i]) * 1e3:.0f} ms",
                axis("depth below the foot", "mm", zero=True),
                axis("speed / largest", zero=True),
                [
                    series("exponential", "model", line * 1e3, share, kind="line"),
                    series(
                        "measured",
                        "measured",
                        z * 1e3,
                        c.speed.values[:, i] / top,
                        c.speed_sigma.values[:, i] / top,
                        size=2.5,
                    ),
                ],
                rules=[{"y": float(column.geometry.front)}],
            )
        )
    for name, symbol, others in (("beta_deg", "β", ()), ("theta_deg", "θ", (("theta_bands_deg", "bands of shear"),))):
        shown = [
            series(word, role, foot, c[key].values, c[f"{key}_sigma"].values, size=3, hollow=role == "quiet")
            for key, word, role in ((name, "measured", "measured"), *((k, w, "quiet") for k, w in others))
            if np.isfinite(c[key].values).any()
        ]
        mean = fits.determined(name)
        words = f"{symbol}: {measured(mean.value, mean.sigma)}°" if mean else symbol
        if shown:
            look = axis(symbol, "°", range=[30.0, 90.0]) if symbol == "θ" else axis(symbol, "°")
            panels.append(panel(words, depth, look, shown, rules=[{"y": mean.value}] if mean else []))
    note = "Bars are ±2σ; dashed: means, and the share of the speed above which grains count as jammed."
    return chart("The central column and the cone", panels, note) if panels else None


def spring_chart(results: Path) -> Chart | None:
    """Force against displacement with the lines, and what they leave over."""
    if not (results / SpringTest.file).exists():
        return None
    p, fits = SpringTest.load(results).values["profile"], fits_of(results)
    x, force, fitted = (np.array(p[k], float) for k in ("displacement_m", "force_N", "fitted_N"))
    x = x * 1e3
    left, direction = force - fitted, np.array(p["direction"])
    whole, rest = [], []
    for sign, name, role in (
        (1, "growing displacement", "measured"),
        (-1, "falling displacement", "model"),
        (0, "turning points, left out", "quiet"),
    ):
        mine = np.flatnonzero(direction == sign)
        mine = mine[np.argsort(x[mine], kind="stable")][:: max(1, -(-mine.size // MOST))]
        if mine.size:
            whole.append(series(name, role, x[mine], force[mine], size=2.5))
        if mine.size and sign:
            whole.append(series(f"its line, {name.split()[0]}", role, x[mine], fitted[mine], kind="line"))
            rest.append(series(name, role, x[mine], left[mine], size=2.5))
    along = axis("displacement", "mm")
    title = f"k = {with_sigma(fits['spring_stiffness'])} N/m" if fits.determined("spring_stiffness") else "force"
    panels = [
        panel(title, along, axis("force", "N"), whole),
        panel(hysteresis_words(fits), along, axis("measured − line", "N"), rest, rules=[{"y": 0}], height=170),
    ]
    return chart("The spring", panels, stacked=True)


def air_chart(results: Path, experiment: Experiment | None) -> Chart | None:
    """Pressure that the bed needs and the fan gives, against air speed."""
    if not (results / Geometry.file).exists():
        return None
    a = air_of(Geometry.load(results), experiment.section(Fan) if experiment else None)
    if a is None:
        return None
    every = slice(None, None, 6)  # smooth: 50 points are a curve
    looks = (("quiet", False), ("measured", False), ("measured", True))  # of Ergun, Wu, and Wu with the duct
    shown = [
        series(name, role, a.speed[every], pressure[every] / 1e3, kind="line", dash=dash)
        for (name, pressure), (role, dash) in zip(a.lines.items(), looks)
    ]
    onsets = np.array([*a.onsets.values()]).T
    shown.append(series("onset", "ink", onsets[0], onsets[1] / 1e3, size=3.5))
    if a.fan:
        shown.append(series("fan", "model", a.fan[0], np.array(a.fan[1]) / 1e3, joined=True, size=3))
    if a.works:
        shown.append(series("works here", "accent", [a.works[0]], [a.works[1] / 1e3], size=6))
    y = axis("pressure", "kPa", range=[0.0, a.top / 1e3])
    drawn = panel(a.title, axis("superficial air speed", "m/s"), y, shown, rules=[{"y": a.weight / 1e3}], height=240)
    return chart("Fluidisation", [drawn], "Dashed across: the weight of the bed.")
