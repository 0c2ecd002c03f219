"""Panels of the picture of the fits: the jammed cone under the foot (thesis Figs 52b, 57)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..fit.cone_fit import mass_curve
from .style import ACCENT, GREEN, MEASURED, MODEL, QUIET


def draw_profile(axis: Any, fits: dict[str, Any], of: dict[str, Any]) -> None:
    """Speed below the foot at the frame with the fastest foot, and the exponential a^(z+b)."""
    c = of["column"].field
    i = (
        int(np.nanargmax(np.where(np.isfinite(c.beta_deg), c.max_speed, np.nan)))
        if np.isfinite(c.beta_deg).any()
        else 0
    )
    z = c.depth.values[:, i]
    top = float(c.max_speed[i])
    axis.errorbar(
        z * 1e3, c.speed.values[:, i] / top, c.speed_sigma.values[:, i] / top, fmt=".", ms=3, lw=0.6, color=MEASURED
    )
    line = np.linspace(0, np.nanmax(z), 200)
    axis.plot(
        line * 1e3, np.minimum(np.exp(float(c.log_a[i]) * (line + float(c.b[i]))), 1.0), color=MODEL, label="$a^{z+b}$"
    )
    axis.axhline(float(c.attrs["front"]), color=QUIET, lw=0.8, ls="--")
    axis.set_xlim(0)
    axis.set(
        title=f"central column, t = {float(c.t[i]):.3f} s", xlabel="z below the foot [mm]", ylabel="speed / largest"
    )
    axis.legend()


def draw_beta(axis: Any, fits: dict[str, Any], of: dict[str, Any]) -> None:
    """beta against the foot's depth."""
    c = of["column"].field
    axis.errorbar(c.foot_depth * 1e3, c.beta_deg, c.beta_deg_sigma, fmt=".", lw=0.7, color=MEASURED)
    b = fits.get("beta_deg")
    if b and b["value"] is not None:
        axis.axhline(b["value"], color=MODEL)
    axis.set(title="β = asin(a^Δz)", xlabel="foot depth [mm]", ylabel="β [deg]")


def draw_front(axis: Any, fits: dict[str, Any], of: dict[str, Any]) -> None:
    """Thickness of the jammed layer against the foot's depth; the slope is mu."""
    c = of["column"].field
    x = c.foot_depth.values * 1e3
    axis.errorbar(x, c.jammed_thickness * 1e3, c.jammed_thickness_sigma * 1e3, fmt=".", lw=0.7, color=MEASURED)
    mu, cut = fits.get("mu"), fits.get("mu_intercept_m")
    if mu and cut and mu["value"] is not None and np.isfinite(x).any():
        line = np.array([np.nanmin(x), np.nanmax(x)])
        axis.plot(
            line,
            mu["value"] * line + cut["value"] * 1e3,
            color=MODEL,
            label=f"μ = {mu['value']:.2f} ± {mu['sigma']:.2f}",
        )
        axis.legend()
    axis.set(title="jammed front", xlabel="foot depth [mm]", ylabel="thickness [mm]")


def draw_theta(axis: Any, fits: dict[str, Any], of: dict[str, Any]) -> None:
    """Angle of the cone's side and of the bands of shear against the foot's depth."""
    c = of["column"].field
    for name, color, mark, label in (
        ("theta_bands_deg", QUIET, "x", "bands of shear"), ("theta_deg", MEASURED, ".", "side of the cone"),
    ):  # fmt: skip
        axis.errorbar(c.foot_depth * 1e3, c[name], c[f"{name}_sigma"], fmt=mark, lw=0.7, ms=4, color=color, label=label)
    theta = fits.get("theta_deg")
    if theta and theta["value"] is not None:
        axis.axhline(theta["value"], color=MODEL)
        axis.legend()
    axis.set(title="θ of the cone", xlabel="foot depth [mm]", ylabel="θ [deg]", ylim=(30, 90))


def draw_cone(axis: Any, fits: dict[str, Any], of: dict[str, Any]) -> None:
    """Added mass against depth and the saturating cone (33)."""
    f = of["flow"].field
    z = f.foot_depth.values
    axis.errorbar(z * 1e3, f.added_mass * 1e3, f.added_mass_sigma * 1e3, fmt=".", lw=0.7, color=MEASURED)
    line = np.linspace(0.0, np.nanmax(z[np.isfinite(f.added_mass.values)]), 100)
    slope, narrowing = fits["cone_slope_kg_m"]["value"], fits["mu_over_tan_theta"]["value"]
    c, R = fits["C"], of["column"].field.attrs["foot_radius_m"]
    label = f"C = {c['value']:.2f} ± {c['sigma']:.2f}" if c["value"] is not None else "cone"
    axis.plot(line * 1e3, mass_curve(line, slope, narrowing, R) * 1e3, color=GREEN, label=label)
    axis.legend()
    axis.set(title="added mass and cone", xlabel="foot depth [mm]", ylabel="m_a [g]")


def draw_sides(axis: Any, column: Any, i: int) -> None:
    """Ridges of the shear rate, outline and its straight sides, over a map of frame i in mm (Fig. 52b)."""
    c = column.isel(t=i)
    face = float(c.depth[0] + c.y[0])
    for name, color, mark in (("ridge", "white", "."), ("outline", ACCENT, "_")):
        for way in ("left", "right"):
            axis.plot(c[f"{name}_{way}"] * 1e3, c.y * 1e3, mark, color=color, ms=3)
    theta, radius = np.radians(float(c.theta_deg)), float(c.cone_radius)
    if np.isfinite(theta):
        depth = np.array([0.0, min(float(c.jammed_thickness), radius * np.tan(theta))])
        for sign in (-1.0, 1.0):
            axis.plot(sign * (radius - depth / np.tan(theta)) * 1e3, (face - depth) * 1e3, color=GREEN, lw=1.2)
        axis.set_title(f"θ = {float(c.theta_deg):.1f}°, bands {float(c.theta_bands_deg):.1f}°", fontsize=9)


COLUMN_PANELS = (draw_profile, draw_beta, draw_front, draw_theta)
