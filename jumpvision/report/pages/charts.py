"""Interactive figures as data for static/plot.js, and those of a campaign: heights, the diagnosis of its model."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

Chart = dict[str, Any]

MOST = 3000  # points of a series in a page: two a pixel
DIGITS = 5  # significant figures


def numbers(values: Any, factor: float = 1.0, digits: int = DIGITS) -> list[float | None]:
    """Values times factor with so many significant figures; None where they are not finite."""
    array = np.asarray(values, float) * factor
    return [float(f"{v:.{digits}g}") if np.isfinite(v) else None for v in array]


def axis(label: str, unit: str = "", **more: Any) -> dict[str, Any]:
    """One axis; more: log, zero (it is in the picture), names (of categories at 0, 1, 2 ...)."""
    return {"label": label, "unit": unit, **more}


def series(name: str, role: str, x: Any, y: Any, s: Any = None, *, kind: str = "points", **more: Any) -> dict[str, Any]:
    """A series of numbers as they are; s may be None."""
    out = {"name": name, "role": role, "kind": kind, "x": numbers(x), "y": numbers(y), **more}
    return out if s is None else {**out, "s": numbers(s, digits=2)}


def panel(title: str, x: Any, y: Any, drawn: Sequence[dict[str, Any]], **more: Any) -> dict[str, Any]:
    """One panel."""
    return {"title": title, "x": x, "y": y, "series": list(drawn), **more}


def chart(title: str, panels: Sequence[dict[str, Any]], note: str = "", *, stacked: bool = False) -> Chart:
    """One figure; stacked panels share x."""
    return {"title": title, "note": note, "panels": list(panels), "stacked": stacked}


def column(rows: Sequence[Mapping[str, Any]], name: str, factor: float = 1.0) -> Any:
    """One column of a table as an array; NaN where unknown."""
    return np.array([np.nan if r.get(name) is None else r[name] for r in rows], float) * factor


def names(rows: Sequence[Mapping[str, Any]]) -> list[str]:
    """The experiments' names."""
    return [str(r["experiment"]) for r in rows]


def json_of(file: Path) -> dict[str, Any]:
    """A JSON object; {} where the file is not there."""
    return dict(json.loads(file.read_text(encoding="utf-8"))) if file.exists() else {}


def fits_of(results: Path) -> dict[str, Any]:
    """fits.json."""
    return json_of(results / "fits.json")


KINDS = {"single": ("measured", "circle"), "stutter": ("model", "square"), "delayed_stutter": ("green", "triangle")}
ALONG = {
    "frequency_hz": ("frequency", "Hz", 1.0),
    "delay_s": ("delay", "ms", 1e3),
    "volume_fraction": ("volume fraction", "", 1.0),
}


def heights_chart(rows: Sequence[Mapping[str, Any]], diagnosis: Mapping[str, Any] | None = None) -> Chart | None:
    """Jump heights by kind along what varies most, measured, simulated and, where the diagnosis has one, extended."""
    known = [r for r in rows if r.get("jump_height_m") is not None]
    if not known:
        return None
    counts = {k: len({round(r[k], 2) for r in known if r.get(k) is not None}) for k in ALONG}
    along = max(counts, key=lambda k: counts[k])
    known = [r for r in known if r.get(along) is not None]
    if not known:
        return None
    label, unit, factor = ALONG[along]
    asked = {h["experiment"]: h for h in (diagnosis or {}).get("heights", [])}  # apexes after the motor's stop
    extended = {name: h["extended_m"] for name, h in asked.items()}
    left, right = [], []
    legend: list[dict[str, Any]] = []
    for kind in sorted({str(r["kind"]) for r in known}):
        role, mark = KINDS.get(kind, ("accent", "circle"))
        word = kind.replace("_", " ")
        legend.append({"name": word, "role": role, "mark": mark})
        mine = sorted((r for r in known if str(r["kind"]) == kind), key=lambda r: r[along])
        look: dict[str, Any] = {"mark": mark, "label": names(mine)}
        x, measured = column(mine, along, factor), column(mine, "jump_height_m", 1e3)
        model = column(mine, "simulated_height_m", 1e3)
        better, reached = (
            np.array([asked.get(r["experiment"], {}).get(k) or np.nan for r in mine], float) * 1e3
            for k in ("extended_m", "measured_m")
        )
        styles: dict[str, dict[str, Any]] = {"model": {"hollow": True, "size": 5}, "extended model": {"size": 3}}
        for (name, how), heights, jumped in zip(styles.items(), (model, better), (measured, reached)):
            if np.isfinite(heights).any():
                right.append(series(f"{word}, {name}", role, heights, jumped, tags=[word, name], **how, **look))
        if np.isfinite(model).any():
            left.append(
                series(f"{word}, model", role, x, model, tags=[word, "model"], hollow=True, size=5, joined=True, **look)
            )
        left.append(
            series(
                f"{word}, measured", role, x, measured, column(mine, "sigma_m", 1e3), tags=[word, "measured"], **look
            )
        )
    heights = axis("jump height", "mm", zero=True)
    panels = [panel(f"against {label}", axis(label, unit), heights, left, share=1.5)]
    if right:
        panels.append(
            panel(
                "measured against model",
                axis("model", "mm", zero=True),
                axis("measured", "mm", zero=True),
                right,
                equal=True,
            )
        )
    words = "Filled: measured, bars ±2σ; open: the model." if right else "Bars are ±2σ."
    if any(extended.values()):
        words += " Small on the right: the extended model, both apexes after the motor's stop."
    legend += [{"name": "measured", "role": "ink"}, {"name": "model", "role": "ink", "hollow": True}] if right else []
    legend += [{"name": "extended model", "role": "ink", "size": 3}] if any(extended.values()) else []
    return chart("Jump heights", panels, words) | {"legend": legend}


def diagnosis_charts(d: Mapping[str, Any] | None) -> list[Chart]:
    """Where the simulation fails, which cause, and what the extension gains."""
    if not d:
        return []
    panels = []
    if d["where"]:
        panels.append(where_panel(d["where"]))
    if d["causes"]:
        causes = d["causes"]
        panels.append(
            panel(
                "probability of each mechanism",
                axis("probability", range=[0.0, 1.0]),
                axis("mechanism", names=[c["mechanism"].replace("_", " ") for c in causes]),
                [
                    series(
                        "probability",
                        "green",
                        [c["probability"] for c in causes],
                        range(len(causes)),
                        kind="bars",
                        label=[parameters(c) for c in causes],
                    )
                ],
            )
        )
    if g := d["gain"]:
        low, high = g["ratio_ci95"]
        what = ["track", "height"]
        before, after = ([g[f"rmse_{w}_{k}_m"] * 1e3 for w in what] for k in ("before", "after"))
        panels.append(
            panel(
                f"jumps held out: track {g['ratio']:.3g}× better ({low:.3g} to {high:.3g})",
                axis("rms error", "mm", log=True),
                axis("of", names=what),
                [
                    series("baseline", "model", before, range(2), kind="bars"),
                    series("extended", "green", after, range(2), kind="bars"),
                ],
            )
        )
    note = "A dot marks a residual beyond chance (p < 0.02)." if d["where"] else ""
    return [chart("Where it fails, why, and what is gained", panels, note)] if panels else []


def where_panel(cells: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Mean residual by kind and part of the jump, as a map."""
    kinds = sorted({str(c.get("kind")) for c in cells})
    parts = list(dict.fromkeys(str(c["phase_of_jump"]) for c in cells))
    z: list[list[float | None]] = [[None] * len(parts) for _ in kinds]
    dots = []
    for c in cells:
        j, i = kinds.index(str(c.get("kind"))), parts.index(str(c["phase_of_jump"]))
        z[j][i] = numbers([c["mean_residual_m"]], 1e3, 3)[0]
        if c["p_value"] < 0.02:
            dots.append([i, j])
    top = max((abs(v) for row in z for v in row if v is not None), default=1.0) or 1.0
    drawn = {
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
        axis("part of the jump", names=[p.replace("_", " ") for p in parts]),
        axis("kind", names=[k.replace("_", " ") for k in kinds]),
        [drawn],
        height=90 + 44 * len(kinds),
        share=1.3,
    )


def parameters(cause: Mapping[str, Any]) -> str:
    """The parameters of a cause in words, each with its 90 % interval."""
    return ", ".join(
        f"{n} = {p['value']:.4g} ({p['low']:.4g} to {p['high']:.4g}) {p['unit'].removesuffix('1') or ''}".rstrip()
        for n, p in cause["parameters"].items()
    )
