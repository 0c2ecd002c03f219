"""Figures of lift-off: least amplitudes (thesis Fig 24) and the time it takes (Fig 26)."""

from __future__ import annotations

from typing import Any

import numpy as np
import xarray as xr

from .style import MEASURED, MODEL, QUIET

STYLES = ((MEASURED, "-"), (MODEL, "--"))


def phase_name(phase: float) -> str:
    """0.75 π as text."""
    return f"phase {phase / np.pi:.3g} π"


def least_amplitude(data: xr.Dataset, Figure: Any) -> Any:
    """A_min(f): a panel a phase and number of cycles, both windows."""
    rows, columns = data.sizes["phase"], data.sizes["cycles"]
    figure = Figure(figsize=(3.9 * columns + 0.6, 1.75 * rows + 0.6), layout="constrained")
    axes = figure.subplots(rows, columns, sharex=True, sharey="col", squeeze=False)
    for i, j in np.ndindex(rows, columns):
        axis = axes[i, j]
        for k, (color, style) in enumerate(STYLES):
            least = data.minimum_amplitude_m.isel(phase=i, cycles=j, window=k)
            axis.plot(data.frequency_ratio, least * 1e3, style, color=color, label=str(data.window.values[k]))
            if k == 0:
                axis.fill_between(data.frequency_ratio, least * 1e3, 1e3, color=MEASURED, alpha=0.12, lw=0)
        axis.axvline(1.0, color=QUIET, lw=0.8, ls=":")
        n = float(data.cycles[j])
        axis.set_title(f"{phase_name(float(data.phase[i]))}, N = {n:g}")
        top = float(np.nanpercentile(data.minimum_amplitude_m.isel(cycles=j), 90)) * 1e3
        axis.set_ylim(0, top)
        if j == 0:
            axis.set_ylabel("amplitude [mm]")
        if i == rows - 1:
            axis.set_xlabel("f / f₀")
    axes[0, 0].legend(title="lift-off until", title_fontsize=8, fontsize=8)
    return figure


def time(data: xr.Dataset, Figure: Any) -> Any:
    """Cycles to lift-off over (f, A), the easiest frequency against N, and against damping."""
    import matplotlib as mpl

    phases = min(data.sizes["phase"], 2)
    figure = Figure(figsize=(9.6, 6.6), layout="constrained")
    axes = figure.subplots(2, 2)
    most = float(data.attrs["cycles"])
    for i in range(phases):
        axis = axes[0, i]
        seen = axis.pcolormesh(
            data.frequency_ratio, data.amplitude * 1e3, data.lift_off_cycles.isel(phase=i).T, shading="nearest",
            norm=mpl.colors.LogNorm(0.1, most), rasterized=True,
        )  # fmt: skip
        axis.axvline(1.0, color=QUIET, lw=0.8, ls=":")
        axis.set(title=f"cycles to lift-off, {phase_name(float(data.phase[i]))}", xlabel="f / f₀", ylabel="A [mm]",
                 facecolor="#dddddd")  # fmt: skip
        if float(data.amplitude.max() / data.amplitude.min()) > 30:
            axis.set_yscale("log")
        axis.grid(False)
        figure.colorbar(seen, ax=axis, label="cycles (grey: never)")
    if phases == 1:
        axes[0, 1].set_visible(False)
    left, right = axes[1]
    for i, (color, style) in zip(range(phases), STYLES):
        name = phase_name(float(data.phase[i]))
        left.plot(
            data.cut_off, data.easiest_frequency_ratio.isel(phase=i), style, marker="o", ms=4, color=color, label=name
        )
        off = data.easiest_ratio_damped.isel(phase=i) - 1.0
        right.plot(data.damping_ratio, off, style, marker="o", ms=4, color=color, label=name)
    left.axhline(1.0, color=QUIET, lw=0.8, ls=":")
    left.set(title="easiest frequency against the cut-off N", xlabel="cycles N", ylabel="f_N / f₀", xscale="log")
    left.legend()
    z = np.linspace(float(data.damping_ratio[0]), float(data.damping_ratio[-1]), 100)
    right.plot(z, 1 / np.sqrt(1 - 2 * z**2) - 1, color=QUIET, lw=0.9, label="1/√(1 − 2ζ²): inertial forcing")
    right.plot(z, np.sqrt(1 - 2 * z**2) - 1, color=QUIET, lw=0.9, ls=":", label="√(1 − 2ζ²): as suspected")
    right.set(title=f"viscous damping never lowers it (N = {float(data.cut_off[-1]):g})", xlabel="damping ratio ζ",
              ylabel="f_N / f₀ − 1")  # fmt: skip
    right.legend()
    return figure
