"""The figure of a comparison: measured, simulated, their difference and its significance over frequency and phase."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from .style import MEASURED, MODEL, QUIET, SIGNED

LABEL = {"frequency": "frequency [Hz]", "phase": "phase [rad]", "amplitude": "amplitude [m]", "delay": "delay [s]"}
SIGNIFICANT = 4.0  # |z| of the darkest colour, at least


def comparison(data: xr.Dataset, Figure: Any) -> Any:
    """Four maps where frequency and phase vary, else heights, differences and z along what varies."""
    varies = [n for n in ("frequency", "phase", "amplitude", "delay") if np.unique(data[n]).size > 1]
    return maps(data, Figure) if varies[:2] == ["frequency", "phase"] else lines(data, Figure, (varies or ["trial"])[0])


def heading(data: xr.Dataset) -> str:
    """What the numbers say as a whole."""
    a = data.attrs
    p = f"p = {a['p_value']:.2g}" if a["p_value"] > 1e-4 else "p < 0.0001"
    out = int(data.stands_out.sum())
    return (
        f"{a['campaign']}: χ² = {a['chi2']:.4g} of {a['conditions']} conditions, {p}; "
        f"{out or 'no'} condition{'s stand' if out != 1 else ' stands'} out"
    )


def maps(data: xr.Dataset, Figure: Any) -> Any:
    """Coloured points, a ring around those that stand out; behind the simulated ones the model's map."""
    figure = Figure(figsize=(9.4, 6.6), layout="constrained")
    axes = figure.subplots(2, 2, sharex=True, sharey=True)
    x, y = data.phase / np.pi, data.frequency
    height = np.concatenate([data.measured_height_m, data.simulated_height_m]) * 1e3
    low, high = min(0.0, float(height.min())), float(height.max())
    off = float(np.abs(data.difference_m).max()) * 1e3
    z = max(SIGNIFICANT, float(np.abs(data.z).max()))
    panels = (
        ("measured jump height", data.measured_height_m * 1e3, low, high, None, "mm"),
        ("simulated", data.simulated_height_m * 1e3, low, high, None, "mm"),
        ("measured − simulated", data.difference_m * 1e3, -off, off, SIGNED, "mm"),
        ("z = difference / its uncertainty", data.z, -z, z, SIGNED, ""),
    )
    for axis, (title, values, lo, hi, colours, unit) in zip(axes.flat, panels):
        if title == "simulated" and "simulated_map_m" in data:
            axis.pcolormesh(data.map_phase / np.pi, data.map_frequency, data.simulated_map_m * 1e3, vmin=lo, vmax=hi,
                            shading="nearest", rasterized=True)  # fmt: skip
        seen = axis.scatter(x, y, c=values, vmin=lo, vmax=hi, cmap=colours, s=70, linewidths=0.8,
                            edgecolors="white" if colours is None else QUIET)  # fmt: skip
        figure.colorbar(seen, ax=axis, label=unit)
        axis.set(title=title, facecolor="#eeeeee" if colours is None else "white")
        if colours is not None:
            odd = data.stands_out.values == 1
            axis.scatter(x[odd], y[odd], s=150, facecolors="none", edgecolors="black", linewidths=1.2)
    for axis in axes[1]:
        axis.set_xlabel("phase [π] (ring: stands out)")
    for axis in axes[:, 0]:
        axis.set_ylabel("frequency [Hz]")
    figure.suptitle(heading(data), fontsize=9, x=0.01, ha="left")
    return figure


def lines(data: xr.Dataset, Figure: Any, name: str) -> Any:
    """Heights with their uncertainties, and z, along one coordinate."""
    figure = Figure(figsize=(7.4, 5.4), layout="constrained")
    top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    x = data[name] if name in data.coords else data.z * 0.0 + np.arange(data.sizes["condition"])
    data = data.isel(condition=np.argsort(x.values, kind="stable"))
    x = np.sort(x.values)
    top.errorbar(x, data.simulated_height_m * 1e3, data.model_sigma_m * 1e3, fmt="s", ms=9, mfc="none", color=MODEL,
                 capsize=4, label="simulated")  # fmt: skip
    top.errorbar(x, data.measured_height_m * 1e3, data.measured_sigma_m * 1e3, fmt="o", ms=4, color=MEASURED, capsize=2,
                 label="measured")  # fmt: skip
    top.set(title=heading(data), ylabel="jump height [mm]")
    top.legend()
    odd = data.stands_out.values == 1
    bottom.axhline(0.0, color=QUIET, lw=0.8)
    bottom.vlines(x, 0.0, data.z, color=QUIET, lw=0.8)
    bottom.plot(x[~odd], data.z[~odd], "o", ms=4, color=MEASURED)
    bottom.plot(x[odd], data.z[odd], "D", ms=5, color="black", label="stands out")
    high = max(SIGNIFICANT, 1.1 * float(np.abs(data.z).max()))
    bottom.set(ylabel="z", ylim=(-high, high), xlabel=LABEL.get(name, "condition"))
    if odd.any():
        bottom.legend()
    return figure
