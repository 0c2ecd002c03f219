"""The actuator against its command over frequency (thesis Fig 19c)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..show import measured
from .style import MEASURED, MODEL, QUIET


def actuator(rows: list[dict[str, Any]], fit: dict[str, Any], Figure: Any) -> Any:
    """Amplitude ratio with the -3 dB level and the bandwidth, and lag, both with 2 sigma."""
    figure = Figure(figsize=(8.6, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    f = np.array([r["frequency_hz"] for r in rows])
    for axis, name, factor in ((left, "actuator_ratio", 1.0), (right, "actuator_lag_s", 1e3)):
        value, sigma = (np.array([r[k] for r in rows]) * factor for k in (name, f"{name}_sigma"))
        axis.errorbar(f, value, 2 * sigma, fmt="o", ms=4, lw=0.8, color=MEASURED)
        axis.set(xlabel="frequency [Hz]")
    gain, cut = fit["gain"]["value"], fit["bandwidth_hz"]
    if gain is not None:
        left.axhline(gain / np.sqrt(2), color=QUIET, lw=0.8, ls="--", label="−3 dB")
    if cut["value"] is not None:
        left.axvspan(*fit["bandwidth_ci95_hz"], color=MODEL, alpha=0.2, lw=0)
        left.axvline(cut["value"], color=MODEL, lw=0.8, label=f"{measured(cut['value'], cut['sigma'])} Hz")
    left.set(title="encoder / command", ylabel="amplitude ratio")
    left.legend()
    right.set(title="lag behind the command", ylabel="lag [ms]")
    return figure
