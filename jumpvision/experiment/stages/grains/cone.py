"""What the grain film says of the jammed cone: front, sides, added mass, and the cone that fits them together."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from jumpvision.estimate.estimate import Estimate, Line, fit_line, independent
from jumpvision.estimate.mean import near_the_median, plain_mean, weighted_mean
from jumpvision.experiment.inputs.sections import Bed
from jumpvision.experiment.results.fields import Column, Flow
from jumpvision.experiment.stages.recordings import scaled
from jumpvision.films.calibration import CONTOUR_OF_CONE
from jumpvision.films.grains.column import beta_sensitivity
from jumpvision.films.grains.cone import Cone, MassCurve, fit_mass_curve, solve_cone
from jumpvision.films.grains.front import fit_mu
from jumpvision.films.grains.momentum import ANGLE, peak_momentum

NAN = math.nan
STRAY = 4.0  # robust sigmas from the median beyond which a frame's angle does not count
APART = 10.0  # deg between side and contour of a frame that contradict each other (prescribed cones: up to 6)
ALIKE = 2.0  # sigmas within which all frames continue the front of those before the cone is complete
AROUND_PEAK = 3  # frames on each side of the largest momentum that the added mass is read from
MOVING_WITH_FOOT = (0.7, 1.3)  # largest grain speed / foot speed while the foot pushes grains ahead of it


def pushing(column: Column) -> NDArray[np.bool_]:
    """Frames in which the foot pushes the grains: the largest grain speed is the foot's."""
    c, least = column.field, column.geometry.min_speed
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = c.max_speed.values / c.foot_speed.values
    return (c.foot_speed.values > least) & (ratio > MOVING_WITH_FOOT[0]) & (ratio < MOVING_WITH_FOOT[1])


def cone_fits(column: Column) -> dict[str, Estimate]:
    """beta and theta: means over the frames in which the foot pushes; mu: slope of jammed thickness over depth.

    Angles and the ratio mu know no scale; the decay per metre does, and beta, by the layer that is given in metres.
    """
    c, g = column.field, column.geometry
    use = pushing(column)
    side, contour = sides(c, use)
    theta = side if not side.reason else contour
    broad = use & broader_than_column(column, theta, "cone" if not side.reason else "outline")
    broad = broad if broad.any() else use  # a plug narrower than the column has no other frames
    out = {
        name: weighted_mean(c[name].values[k], c[f"{name}_sigma"].values[k], unit)
        for name, unit, k in (
            ("beta_deg", "degree", broad),
            ("log_a", "1/m", broad),
            ("theta_bands_deg", "degree", use),
        )
    } | {"theta_outline_deg": contour}
    # where the side cannot be told, the contour stands in for it, with what it may be off
    out["theta_deg"] = theta if theta is side else replace(theta, sigma=math.hypot(theta.sigma, CONTOUR_OF_CONE.value))
    line = front_line(c, use, broad)
    out["mu"] = line.slope_estimate("")
    moved = [
        front_line(c, line.used, line.used, f"jammed_thickness_{way}").slope - line.slope for way in ("left", "right")
    ]
    out["mu_per_mm_of_axis"] = Estimate(
        max(moved, key=abs) * 1e-3 / g.axis_off_m, NAN, "1/mm", line.n, NAN, line.reason
    )
    out["mu_intercept_m"] = Estimate(line.intercept, line.intercept_sigma, "m", line.n, line.chi2, line.reason)
    if not out["log_a"].reason:
        slope = beta_sensitivity(out["log_a"].value, g.layer_m)
        per_mm = Estimate(math.degrees(slope) * 1e-3, NAN, "degree/mm", out["log_a"].n, NAN)
        out["beta_deg_per_mm_layer"] = per_mm
        out["log_a"] = scaled(out["log_a"], g.scale_share)
        # a^(Dz) with a decay known to a share is a^(Dz) with a layer known to that share
        layer = slope * g.layer_m
        out["beta_deg"] = out["beta_deg"].with_common(g.scale_share * abs(math.degrees(layer)))
    out["mu_intercept_m"] = scaled(out["mu_intercept_m"], g.scale_share)
    return out


def sides(c: xr.Dataset, use: NDArray[np.bool_]) -> tuple[Estimate, Estimate]:
    """Mean angles of the side where the grains begin to lag, and of the contour of 0.9, without stray frames.

    A side that contradicts the frame's contour does not count. A side found in less than half of the frames that have
    a contour is none: in a bed whose plug yields gradually no line stands out, and what is left are chance fits. What
    another blur of the field would change in the side, alike in all frames, belongs to its sigma.
    """
    outline = np.where(use, c.theta_outline_deg.values, np.nan)
    # each frame counts alike: grains make the contour's angle change from frame to frame by more than its error
    contour = plain_mean(outline[near_the_median(outline, np.ones(outline.size), reject=STRAY)], "degree")
    angle, sigma = (np.where(use, c[k].values, np.nan) for k in ("theta_deg", "theta_deg_sigma"))
    with np.errstate(invalid="ignore"):
        angle = np.where(np.abs(angle - outline) > APART, np.nan, angle)
    kept = near_the_median(angle, sigma, reject=STRAY)
    mean = weighted_mean(np.where(kept, angle, np.nan), sigma, "degree")
    if mean.reason or np.isfinite(angle).sum() < 0.5 * np.isfinite(outline).sum():
        why = "no line at which the grains begin to lag behind the foot in at least half of the frames"
        return Estimate(NAN, NAN, "degree", mean.n, NAN, why), contour
    shifts = [
        weighted_mean(np.where(kept, c[f"theta_shift_{k}_deg"].values, np.nan), sigma, "degree").value
        for k in ("fitted", "sharper")
    ]
    return replace(mean, sigma=math.hypot(mean.sigma, max(np.abs(shifts)))), contour


def front_line(c: xr.Dataset, use: NDArray[np.bool_], broad: NDArray[np.bool_], name: str = "jammed_thickness") -> Line:
    """mu's line through the `broad` frames; through all in `use` where these continue it.

    A complete cone grows no more, so its frames lower the slope. Where they do not, by more than ALIKE sigmas (that of
    the difference to a line through all is smaller), the plug runs on and the line through all frames is the better.
    """

    def through(frames: NDArray[np.bool_]) -> Line:
        thickness = np.where(frames, c[name].values, np.nan)
        error = np.where(np.isfinite(thickness), c.jammed_thickness_sigma.values, 1.0)
        return fit_mu(c.foot_depth.values, thickness, error)

    some, everything = through(broad), through(use)
    return everything if some.reason or everything.slope >= some.slope - ALIKE * some.slope_sigma else some


def broader_than_column(column: Column, theta: Estimate, side: str) -> NDArray[np.bool_]:
    """Frames in which the cone's flat lower side is broader than the column that measures its thickness.

    Beyond them the column sees the sides and the complete cone, whose thickness grows no more; all where theta is not
    known. side: whose radius at the face, `cone` or `outline`, goes with theta.
    """
    c, g = column.field, column.geometry
    if theta.reason:
        return np.ones(c.sizes["t"], bool)
    radius = float(np.nanmedian(c[f"{side}_radius"].values))
    flat = radius - c.jammed_thickness.values / math.tan(math.radians(theta.value))
    return np.asarray(flat > g.half_width_m + 2.0 * g.blur_m)


def mass_fits(flow: Flow) -> dict[str, Estimate]:
    """Largest grain momentum, and the added mass at that moment from a straight line through the frames around it."""
    f = flow.field
    noise = {k: independent(f[f"{k}_sigma"], f[f"{k}_sigma_common"]) for k in ("momentum", "added_mass")}
    momentum, peak = f.momentum.values, peak_momentum(f.momentum, f.added_mass)
    if peak is None:
        return {}
    largest = Estimate(float(momentum[peak]), float(noise["momentum"][peak]), "kg m/s", 1, 0.0)
    out = {"peak_momentum": largest.with_common(float(f.momentum_sigma_common[peak]))}
    near = slice(max(0, peak - AROUND_PEAK), peak + AROUND_PEAK + 1)
    t, m, s = (a[near] for a in (f.t.values - f.t.values[peak], f.added_mass.values, noise["added_mass"]))
    ok = np.isfinite(m) & (s > 0)
    line = fit_line(t[ok], m[ok], s[ok])
    # border and gap below the face are filled alike in neighbouring frames: their mean is no better than one of them
    sigma = max(line.intercept_sigma, float(np.median(s[ok]))) if ok.any() else NAN
    mass = Estimate(line.intercept, sigma, "kg", line.n, line.chi2, line.reason)
    out["added_mass_kg"] = scaled(mass, flow.share("added_mass"))
    share = f.jammed_share.values[near][ok]
    spread = float(np.std(share, ddof=1) / math.sqrt(share.size)) if share.size > 1 else NAN
    out["jammed_share"] = Estimate(float(np.mean(share)), spread, "", share.size, 0.0)
    for name, unit in (("momentum_per_mm_of_axis", "1/mm"), ("momentum_per_vector_of_window", "")):
        out[name] = Estimate(getattr(flow.geometry, name), NAN, unit, 1, NAN)
    return out


def grown_cone(
    column: Column,
    flow: Flow,
    known: dict[str, Estimate],
    R: float | None,
    phi: float | None,
    section: Bed | None,
    phi_share: float = 0.0,
) -> dict[str, Estimate]:
    """C, mu and theta of the saturating cone (33) from added mass against depth, front and outline together.

    phi_share: relative uncertainty of phi that other experiments share; that of the film's lengths is the flow's.
    """
    f, g, use = flow.field, flow.geometry, pushing(column)
    if not R or phi is None or not np.isfinite(f.added_mass.values[use]).any():
        return {}
    mass = f.added_mass.values[use]
    sigma = independent(f.added_mass_sigma, f.added_mass_sigma_common)[use]
    density = (section or Bed()).grain_density * phi * ANGLE[g.disc] / ANGLE["full"]
    mu, theta = known["mu"], known["theta_deg"]

    def fitted(stretch: float) -> tuple[MassCurve, Cone]:
        """With every length of the film times `stretch`: masses go with its cube, R and the depth at first stay."""
        first = g.initial_depth_m
        depth, cube = first + stretch * (f.foot_depth.values[use] - first), stretch**3
        curve = fit_mass_curve(depth, cube * mass, cube * np.where(sigma > 0.0, sigma, np.nan), R=R)
        return curve, solve_cone(
            curve,
            R=R,
            density=density,
            mu=None if mu.reason else (mu.value, mu.sigma),
            theta=None if theta.reason else (math.radians(theta.value), math.radians(theta.sigma)),
        )

    curve, cone = fitted(1.0)
    wide = np.sqrt(np.diag(cone.covariance) * max(1.0, cone.chi2))  # the scatter factor of one degree of freedom
    slope_sigma, narrow_sigma = np.sqrt(np.diag(curve.covariance))
    # face, border and gap are off alike in all frames: what they change in one they change in slope and C
    alike = float(np.nanmedian(np.where(mass > 0.0, sigma / np.abs(mass), np.nan)))
    wide[0], slope_sigma = math.hypot(wide[0], alike * cone.C), math.hypot(slope_sigma, alike * curve.slope)
    out = {
        "cone_slope_kg_m": Estimate(curve.slope, float(slope_sigma), "kg/m", curve.n, curve.chi2, curve.reason),
        "mu_over_tan_theta": Estimate(curve.narrowing, float(narrow_sigma), "", curve.n, curve.chi2, curve.reason),
        "C": Estimate(cone.C, float(wide[0]), "", curve.n, cone.chi2, cone.reason),
        "mu_cone": Estimate(cone.mu, float(wide[1]), "", curve.n, cone.chi2, cone.reason),
        "theta_cone_deg": Estimate(
            math.degrees(cone.theta), math.degrees(float(wide[2])), "degree", curve.n, cone.chi2, cone.reason
        ),
    }
    for name, (i, j) in {"C_mu": (0, 1), "C_theta": (0, 2), "mu_theta": (1, 2)}.items():
        shared = cone.covariance[i, j] * max(1.0, cone.chi2) / (wide[i] * wide[j])
        out[f"correlation_{name}"] = Estimate(float(shared), NAN, "", curve.n, cone.chi2, cone.reason)
    # density goes with phi, and so does the mass: of the two only the slope at the surface has its error
    out["cone_slope_kg_m"] = scaled(out["cone_slope_kg_m"], phi_share)
    if not g.scale_share:
        return out
    other, moved = fitted(1.0 + g.scale_share)
    changes = {
        "cone_slope_kg_m": other.slope - curve.slope,
        "mu_over_tan_theta": other.narrowing - curve.narrowing,
        "C": moved.C - cone.C,
        "mu_cone": moved.mu - cone.mu,
        "theta_cone_deg": math.degrees(moved.theta - cone.theta),
    }
    return {k: e.with_common(abs(changes[k])) if k in changes else e for k, e in out.items()}
