"""The campaign in one picture: measured and simulated jump heights."""

from __future__ import annotations

from typing import Any

from .style import ACCENT, GREEN, MEASURED, MODEL, QUIET

MARKS = {"single": ("o", MEASURED), "stutter": ("s", MODEL), "delayed_stutter": ("^", GREEN)}


def heights(rows: list[dict[str, Any]], Figure: Any) -> Any:
    """Jump height against frequency by kind, measured (filled, ±2σ) and simulated (open)."""
    known = [r for r in rows if r.get("jump_height_m") is not None and r.get("frequency_hz") is not None]
    figure = Figure(figsize=(8.6, 3.8), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(1.7, 1))
    for kind in sorted({str(r["kind"]) for r in known}):
        mark, color = MARKS.get(kind, ("D", ACCENT))
        mine = [r for r in known if str(r["kind"]) == kind]
        f = [r["frequency_hz"] for r in mine]
        h = [r["jump_height_m"] * 1e3 for r in mine]
        s = [2e3 * (r.get("sigma_m") or 0.0) for r in mine]
        left.errorbar(f, h, s, fmt=mark, ms=5, color=color, label=kind.replace("_", " "))
        modelled = [r for r in mine if r.get("simulated_height_m") is not None]
        if modelled:
            model = [r["simulated_height_m"] * 1e3 for r in modelled]
            left.plot([r["frequency_hz"] for r in modelled], model, mark, ms=6, mfc="none", color=color, alpha=0.8)
            right.plot(model, [r["jump_height_m"] * 1e3 for r in modelled], mark, ms=5, color=color)
    left.set(title="jump height (filled measured, open model)", xlabel="frequency [Hz]", ylabel="height [mm]")
    left.legend()
    top = max(left.get_ylim()[1], right.get_xlim()[1])
    right.plot([0, top], [0, top], color=QUIET, lw=0.8, ls="--")
    right.set(title="measured against model", xlabel="model [mm]", ylabel="measured [mm]")
    return figure
