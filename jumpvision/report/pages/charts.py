"""Interactive figures as data for static/plot.js, and those of a campaign: heights, the diagnosis of its model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple, NotRequired, TypedDict, Unpack

import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array, measured
from jumpvision.base.numbers import between, times
from jumpvision.engine.detect import LEVEL
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.document.values import Cell, Gain
from jumpvision.estimate.robot import Bandwidth
from jumpvision.experiment.campaign.measured.actuator import Driven
from jumpvision.experiment.results.summary import JumpRow
from jumpvision.experiment.results.values import Fits
from jumpvision.jumper.question.jumps import PARTS
from jumpvision.report.figures.diagnosis import beyond
from jumpvision.report.style import kind_of, spoken

from .quantities import mechanism_words, typeset

Numbers = list[float | None]


class AxisLook(TypedDict, total=False):
    """zero: 0 is in the picture; names: of categories at 0, 1, 2 ...; range: first and last value."""

    log: bool
    zero: bool
    names: list[str]
    range: list[float]


class Axis(AxisLook):
    """One axis."""

    label: str
    unit: str


class SeriesLook(TypedDict, total=False):
    """label: what is shown of a point; tags: entries of the legend that switch it; size [px]."""

    mark: str
    label: list[str]
    tags: list[str]
    hollow: bool
    joined: bool
    dash: bool
    size: float


class Series(SeriesLook):
    """Numbers as they are; s: standard uncertainties of y. kind: points, line, bars, or a map z over x and y."""

    name: str
    role: str
    kind: str
    x: Numbers
    y: Numbers
    s: NotRequired[Numbers]
    z: NotRequired[list[Numbers]]
    signed: NotRequired[bool]
    limits: NotRequired[Numbers]
    unit: NotRequired[str]
    dots: NotRequired[list[tuple[int, int]]]


class Rule(TypedDict, total=False):
    """A line across a panel at x or y."""

    x: float
    y: float


class PanelLook(TypedDict, total=False):
    """share: of the figure's width; height [px]; equal: both axes have one scale; spans: (from, to, word) along x."""

    share: float
    height: int
    equal: bool
    spans: list[tuple[float, float, str]]
    rules: list[Rule]


class Panel(PanelLook):
    """One panel."""

    title: str
    x: Axis
    y: Axis
    series: list[Series]


class Key(SeriesLook):
    """An entry of the legend."""

    name: str
    role: str


class Chart(TypedDict):
    """One figure; stacked panels share x."""

    title: str
    note: str
    panels: list[Panel]
    stacked: bool
    legend: NotRequired[list[Key]]


MOST = 3000  # points of a series in a page: two a pixel


def numbers(values: ArrayLike, factor: float = 1.0, digits: int = 5) -> Numbers:  # significant figures
    """Values times factor with so many significant figures; None where they are not finite."""
    array = np.asarray(values, float) * factor
    rounded = (f"%.{digits}g " * array.size % tuple(array.tolist())).split()
    return [float(v) if known else None for v, known in zip(rounded, np.isfinite(array).tolist())]


def axis(label: str, unit: str = "", **look: Unpack[AxisLook]) -> Axis:
    """One axis."""
    return {"label": label, "unit": unit, **look}


def series(
    name: str,
    role: str,
    x: ArrayLike,
    y: ArrayLike,
    s: ArrayLike | None = None,
    *,
    kind: str = "points",
    **look: Unpack[SeriesLook],
) -> Series:
    """A series of numbers as they are; s may be None."""
    out: Series = {"name": name, "role": role, "kind": kind, "x": numbers(x), "y": numbers(y), **look}
    if s is not None:
        out["s"] = numbers(s, digits=2)
    return out


def panel(title: str, x: Axis, y: Axis, drawn: Sequence[Series], **look: Unpack[PanelLook]) -> Panel:
    """One panel."""
    return {"title": title, "x": x, "y": y, "series": list(drawn), **look}


def chart(title: str, panels: Sequence[Panel], note: str = "", *, stacked: bool = False) -> Chart:
    """One figure."""
    return {"title": title, "note": note, "panels": list(panels), "stacked": stacked}


def numbered(values: Sequence[float | None]) -> Array:
    """An array (n,), NaN where unknown."""
    return np.array(values, float)


def fits_of(results: Path) -> Fits:
    """fits.json; no fits where it is not there."""
    return Fits.load(results) if (results / Fits.file).exists() else Fits({})


class Along(NamedTuple):
    """What heights are drawn along."""

    label: str
    unit: str
    factor: float
    of: Callable[[JumpRow], float | None]


ALONG = (
    Along("frequency", "Hz", 1.0, lambda r: r.frequency),
    Along("delay", "ms", 1e3, lambda r: r.delay),
    Along("volume fraction", "", 1.0, lambda r: r.summary.volume_fraction.value),
)


def heights_chart(rows: Sequence[JumpRow], diagnosis: Diagnosis | None = None) -> Chart | None:
    """Jump heights by kind along what varies most, measured, simulated and, where the diagnosis has one, extended."""
    known = [r for r in rows if r.summary.jump_height.value is not None]
    label, unit, factor, of = max(
        ALONG, key=lambda a: len({round(at, 2) for r in known if (at := a.of(r)) is not None})
    )
    placed = sorted(((at, r) for r in known if (at := of(r)) is not None), key=lambda p: p[0])
    if not placed:
        return None
    asked = {h.experiment: h for h in diagnosis.heights} if diagnosis else {}  # apexes after the motor's stop
    extends = any(np.isfinite(h.extended_m) for h in asked.values())
    left, right = [], []
    legend: list[Key] = []
    for kind in sorted({str(r.kind) for _, r in placed}):
        role, mark = kind_of(kind).role, kind_of(kind).shape
        word = kind.replace("_", " ")
        legend.append({"name": word, "role": role, "mark": mark})
        mine = [r for _, r in placed if str(r.kind) == kind]
        look: SeriesLook = {"mark": mark, "label": [r.experiment for r in mine]}
        x = numbered([of(r) for r in mine]) * factor
        measured, sigma, _ = np.array([r.summary.jump_height.numbers for r in mine]).T * 1e3
        model = numbered([r.summary.simulated_height for r in mine]) * 1e3
        tops = [(h.extended_m, h.measured_m) if (h := asked.get(r.experiment)) else (np.nan, np.nan) for r in mine]
        better, reached = np.array(tops).T * 1e3
        styles: dict[str, SeriesLook] = {"model": {"hollow": True, "size": 5}, "extended model": {"size": 3}}
        for (name, style), heights, jumped in zip(styles.items(), (model, better), (measured, reached)):
            if np.isfinite(heights).any():
                how: SeriesLook = {**look, **style, "tags": [word, name]}
                right.append(series(f"{word}, {name}", role, heights, jumped, **how))
        if np.isfinite(model).any():
            how = {**look, **styles["model"], "tags": [word, "model"], "joined": True}
            left.append(series(f"{word}, model", role, x, model, **how))
        how = {**look, "tags": [word, "measured"]}
        left.append(series(f"{word}, measured", role, x, measured, sigma, **how))
    panels = [panel(f"against {label}", axis(label, unit), axis("jump height", "mm", zero=True), left, share=1.5)]
    if right:
        both = axis("model", "mm", zero=True), axis("measured", "mm", zero=True)
        panels.append(panel("measured against model", *both, right, equal=True))
    words = "Filled: measured, bars ±2σ; open: the model." if right else "Bars are ±2σ."
    if extends:
        words += " Small on the right: the extended model, both apexes after the motor's stop."
    if right:
        legend += [{"name": "measured", "role": "ink"}, {"name": "model", "role": "ink", "hollow": True}]
    if extends:
        legend.append({"name": "extended model", "role": "ink", "size": 3})
    return {**chart("Jump heights", panels, words), "legend": legend}


def actuator_chart(rows: Sequence[Driven], found: Bandwidth) -> Chart:
    """Amplitude ratio with the -3 dB level and the bandwidth, and lag, both against frequency."""
    f, x = [r.frequency for r in rows], axis("frequency", "Hz")
    (ratio, ratio_sigma), (lag, lag_sigma) = (
        np.array([r.fits[name] for r in rows]).T for name in ("actuator_ratio", "actuator_lag_s")
    )
    rules: list[Rule] = [{"y": found.gain.value / np.sqrt(2.0)}] if np.isfinite(found.gain.value) else []
    spans, words = [], "Bars are ±2σ. Dashed: 3 dB below low frequencies."
    if np.isfinite(found.cutoff.value):
        rules.append({"x": found.cutoff.value})
        spans = [(found.low, found.high, "95 %")]
        words += f" Bandwidth {measured(found.cutoff.value, found.cutoff.sigma)} Hz."
    names: SeriesLook = {"label": [r.experiment for r in rows]}
    panels = [
        panel(
            "encoder / command",
            x,
            axis("amplitude ratio"),
            [series("ratio", "measured", f, ratio, ratio_sigma, **names)],
            rules=rules,
            spans=spans,
        ),
        panel(
            "lag behind the command",
            x,
            axis("lag", "ms"),
            [series("lag", "measured", f, lag * 1e3, lag_sigma * 1e3, **names)],
            rules=[{"y": 0}],
        ),
    ]
    return chart("The actuator", panels, words)


def diagnosis_charts(d: Diagnosis | None) -> list[Chart]:
    """Where the simulation fails, which cause, and what the extension gains."""
    if not d:
        return []
    panels = []
    if d.where:
        panels.append(where_panel(d.where))
    if d.causes:
        likely = series(
            "probability",
            "green",
            [c.probability for c in d.causes],
            range(len(d.causes)),
            kind="bars",
            label=[typeset(c.words) for c in d.causes],
        )
        mechanisms = axis("mechanism", names=[mechanism_words(c.mechanism) for c in d.causes])
        panels.append(
            panel("probability of each mechanism", axis("probability", range=[0.0, 1.0]), mechanisms, [likely])
        )
    if d.gain:
        panels.append(gain_panel(d.gain))
    note = marked(d.where) if d.where else ""
    return [chart("Where it fails, why, and what is gained", panels, note)] if panels else []


def marked(cells: Sequence[Cell]) -> str:
    """What the marks of a map of cells mean. The p of a cell is of as large a z in any of them by noise alone."""
    n = sum(c.p_value < LEVEL for c in cells)
    level = f"beyond chance (p < {LEVEL:g} for all {len(cells)} cells together)"
    if beyond(cells):
        return f"A dot marks the {n} of {len(cells)} mean residuals that are {level}."
    return f"{n or 'None'} of {len(cells)} mean residuals {'is' if n < 2 else 'are'} {level}: no cell stands out."


def gain_panel(g: Gain) -> Panel:
    """Errors of jumps held out, by the baseline and by the extended model."""
    before = np.array([g.rmse_track_before_m, g.rmse_height_before_m]) * 1e3
    after = np.array([g.rmse_track_after_m, g.rmse_height_after_m]) * 1e3
    bars = [
        series("baseline", "model", before, range(2), kind="bars"),
        series("extended", "green", after, range(2), kind="bars"),
    ]
    title = f"jumps held out: track {times(g.ratio, mark='×')} better{between(*g.ratio_ci95)}"
    return panel(title, axis("rms error", "mm", log=True), axis("of", names=["track", "height"]), bars)


def where_panel(cells: Sequence[Cell]) -> Panel:
    """Mean residual by kind and part of the jump, as a map."""
    kinds = sorted({c.kind for c in cells})
    there = {c.phase_of_jump for c in cells}
    parts = [p for p in PARTS if p in there] + sorted(there - set(PARTS))
    z: list[Numbers] = [[None] * len(parts) for _ in kinds]
    dots, stand_out = [], beyond(cells)
    for c in cells:
        j, i = kinds.index(c.kind), parts.index(c.phase_of_jump)
        z[j][i] = numbers([round(1e3 * c.mean_residual_m, 3)], digits=3)[0]
        if c in stand_out:
            dots.append((i, j))
    top = max((abs(v) for row in z for v in row if v is not None), default=1.0) or 1.0
    drawn: Series = {
        "name": "mean residual",
        "kind": "map",
        "role": "ink",
        "x": list(range(len(parts))),
        "y": list(range(len(kinds))),
        "z": z,
        "signed": True,
        "limits": [-top, top],
        "unit": "mm",
        "dots": dots,
    }
    return panel(
        "where: mean of measured − simulated [mm]",
        axis("part of the jump", names=[spoken(p) for p in parts]),
        axis("kind", names=[spoken(k) for k in kinds]),
        [drawn],
        height=90 + 44 * len(kinds),
        share=1.3,
    )
