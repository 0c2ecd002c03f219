"""Figures of slow intrusions: one log (thesis Figs 48, 50, 55, 69), a campaign against packing and foot (48, 58)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..records import Intrusion
from ..stage import stage
from .pictures import Picture, png
from .style import ACCENT, GREEN, MEASURED, MODEL, QUIET, styled


class IntrusionPicture(Picture):
    file = "intrusion.png"


@stage(version=1, picture=True)
def intrusion_picture(intrusion: Intrusion) -> IntrusionPicture:
    """The figure of one log."""
    with styled() as Figure:
        return IntrusionPicture(png(single(intrusion.values, Figure)))


def single(v: dict[str, Any], Figure: Any) -> Any:
    """Force against depth with the fitted curve and the cone; what is left over; overshoot against depth."""
    p = {k: np.array(a) for k, a in v["profile"].items()}
    z = p["depth_m"] * 1e3
    figure = Figure(figsize=(9.6, 3.6), layout="constrained")
    left, middle, right = figure.subplots(1, 3, width_ratios=(1.5, 1, 1))
    left.plot(z, p["force_N"], ".", ms=3, color=MEASURED, label="measured")
    left.plot(z, p["fitted_N"], color=MODEL, label="fit")
    if v["events"]:
        left.plot(z, p["first_N"], color=MODEL, lw=0.8, ls="--", label="without events")
    if v["cone"]:
        left.plot(z, v["cone"]["force_N"], color=GREEN, lw=1.0, ls=":", label="RFT cone")
    delta = v["fits"]["delta"]
    if delta["value"] is not None:
        left.axvline(delta["value"] * 1e3, color=QUIET, lw=0.8)
        left.set_title(f"δ = {delta['value'] * 1e3:.2f} ± {delta['sigma'] * 1e3:.2f} mm")
    else:
        left.set_title(f"one slope suffices (p = {v['p_one_slope']:.2g})")
    left.set(xlabel="depth below the surface [mm]", ylabel="force [N]")
    left.legend()
    middle.plot(z, p["force_N"] - p["fitted_N"], color=MEASURED, lw=0.8)
    middle.set(title="measured − fit", xlabel="depth below the surface [mm]", ylabel="[N]")
    draw_events(right, v)
    return figure


def draw_events(axis: Any, v: dict[str, Any]) -> None:
    """Overshoot against depth, with the proportional law of each kind."""
    for kind, name, color, mark in (("reintrusion", "s", MEASURED, "o"), ("stop_go", "s_p", ACCENT, "s")):
        mine = [e for e in v["events"] if e["kind"] == kind]
        if not mine:
            continue
        z = np.array([e["depth_m"] for e in mine]) * 1e3
        o, sigma = (np.array([e[k] for e in mine]) for k in ("overshoot_N", "sigma_N"))
        axis.errorbar(z, o, sigma, fmt=mark, ms=4, lw=0.8, color=color, label=kind.replace("_", "-"))
        s = v["fits"].get(name)
        if s and s["value"] is not None:
            axis.plot([0, z.max()], [0, s["value"] * z.max() * 1e-3], color=color, lw=0.8)
    axis.set(title="overshoot", xlabel="depth of the event [mm]", ylabel="[N]")
    if v["events"]:
        axis.legend()
    else:
        axis.text(0.5, 0.5, "no pause or withdrawal", ha="center", transform=axis.transAxes, color=QUIET)


def resistances(rows: list[dict[str, Any]], laws: dict[str, Any], Figure: Any) -> Any:
    """k1, k2 per foot area, delta and ripples against packing; force against depth by foot beside the cone."""
    figure = Figure(figsize=(9.6, 6.4), layout="constrained")
    axes = figure.subplots(2, 2)
    known = [r for r in rows if r["volume_fraction"] is not None]
    for name, color, mark in (("k1", MEASURED, "o"), ("k2", MODEL, "s")):
        mine = [r for r in known if r[name] is not None and r["foot_radius_m"]]
        area = np.array([np.pi * r["foot_radius_m"] ** 2 for r in mine]) * 1e6
        points(axes[0, 0], mine, name, color, mark, 1.0 / area, f"${name[0]}_{name[1]}$")
    axes[0, 0].set(ylabel="resistance / foot area [N/cm³]", xlabel="volume fraction", title="resistances")
    mine = [r for r in known if r["delta"] is not None]
    points(axes[0, 1], mine, "delta", MEASURED, "o", np.full(len(mine), 1e3), "δ")
    axes[0, 1].set(ylabel="δ [mm]", xlabel="volume fraction", title="depth of the bend")
    mine = [r for r in known if r["ripple_N"] is not None]
    points(axes[1, 0], mine, "ripple_N", GREEN, "o", np.ones(len(mine)), "ripple")
    for axis, law in ((axes[0, 0], "phi_c_from_k1"), (axes[1, 0], "phi_c_from_ripple")):
        bend = laws["laws"][law]
        if bend["value"] is not None:
            axis.axvspan(*laws[f"{law}_ci95"], color=QUIET, alpha=0.25, lw=0)
            axis.axvline(bend["value"], color=QUIET, lw=0.8, label=f"bend at {bend['value']:.3f}")
    axes[1, 0].set(ylabel="amplitude [N]", xlabel="volume fraction", title="oscillations below the bend")
    for axis in (axes[0, 0], axes[1, 0]):
        axis.legend()
    draw_feet(axes[1, 1], rows)
    return figure


def points(axis: Any, rows: list[dict[str, Any]], name: str, color: str, mark: str, factor: Any, label: str) -> None:
    """One column of the table against packing, with sigma."""
    if rows:
        phi = [r["volume_fraction"] for r in rows]
        value, sigma = (np.array([r[k] for r in rows]) * factor for k in (name, f"{name}_sigma"))
        axis.errorbar(phi, value, sigma, fmt=mark, ms=4, lw=0.8, color=color, label=label)


def draw_feet(axis: Any, rows: list[dict[str, Any]]) -> None:
    """First intrusions in the loosest bed by foot radius, and the cone's prediction of each."""
    import matplotlib as mpl

    loose = min((r["volume_fraction"] or 0.0 for r in rows), default=0.0)
    longest_last = sorted(rows, key=lambda r: r["profile"]["event"].count(-1))
    feet = {r["foot_radius_m"]: r for r in longest_last if r["cone"] and (r["volume_fraction"] or 0.0) <= loose + 1e-6}
    colors = mpl.colormaps["viridis"](np.linspace(0.0, 0.85, max(len(feet), 1)))
    for color, (radius, row) in zip(colors, sorted(feet.items())):
        first = np.array(row["profile"]["event"]) < 0
        z = np.array(row["profile"]["depth_m"])[first] * 1e3
        axis.plot(z, np.array(row["profile"]["force_N"])[first], color=color, label=f"R = {radius * 1e3:.1f} mm")
        axis.plot(z, np.array(row["cone"]["force_N"])[first], color=color, ls=":", lw=1.0)
    axis.set(title="feet in the loosest bed, dotted: RFT cone", xlabel="depth [mm]", ylabel="force [N]")
    if feet:
        axis.legend()
