"""Intrusion: force against depth of a slow intrusion, its resistances, its cone, what pauses and withdrawals add."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array
from jumpvision.base.parameters import of_keywords
from jumpvision.estimate.estimate import Estimate, checked
from jumpvision.estimate.penetration import (
    LAWS,
    TWO,
    Family,
    Fitted,
    begins_in_air,
    chance_of_one_slope,
    fit_family,
    in_bins,
    one_slope,
)
from jumpvision.estimate.readings import looked
from jumpvision.estimate.strokes import deep_ripple, fresh_samples, proportionality
from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.parameters import IntrusionParams
from jumpvision.experiment.inputs.sections import IntrusionLog, Robot
from jumpvision.experiment.results.values import ConeValues, Fits, Intrusion
from jumpvision.experiment.workflow.stage import stage
from jumpvision.jumper.mechanisms.cone import cone_volume, flat_volume

LEAST = 40  # samples in fresh grains that a curve needs
GROWTH = 0.3, 6.0  # mu of any cone


@stage(version=3)
def intrusion(log: IntrusionLog, robot: Robot | None, *, p: IntrusionParams) -> Intrusion:
    """Slow intrusion of [intrusion_log]: two resistances, the RFT cone, overshoots after pauses and withdrawals.

    `fits` {name: {value, sigma, ...}}, the averaged `profile`, the `events` and the fitted cone in its parts, `cone`.
    """
    d = read_log(log, "time_s", "depth_m", "force_N", at_least=LEAST)
    time, depth, force = (d[n].to_numpy() for n in ("time_s", "depth_m", "force_N"))
    radius = robot.foot_radius if robot else None
    found = curves_of(time, depth, force, str(log.path), p, radius)
    two, likelier = found.slopes, found.likelier
    b, m = two.model.bins, likelier.model
    overshoot, covariance = likelier.events()
    below = b.z - likelier.surface
    return Intrusion(
        {
            "fits": {k: e.entry() for k, e in found.fits.items()},
            "p_one_slope": found.p_one_slope,
            "delta_ci95_m": list(two.shape_interval()) if two.model.family.shaped else [math.nan, math.nan],
            "noise": {
                "white_N": likelier.noise.white,
                "correlated_N": likelier.noise.correlated,
                "length_m": likelier.noise.length,
            },
            "profile": {
                "depth_m": below,
                "force_N": b.F - likelier.b[0],
                "event": b.event,
                "fitted_N": two.curve,
                "first_N": two.parts.sum(axis=1),
            },
            "events": [
                {"kind": kind, "depth_m": z - likelier.surface, "pause_s": pause, "overshoot_N": o, "sigma_N": s}
                for kind, z, pause, o, s in zip(
                    b.event_kind, b.event_depth, b.event_pause, overshoot, np.sqrt(np.diag(covariance))
                )
            ],
            "first_intrusion": "cone" if m is not two.model else "slopes",
            "cone": found.cone_entry(p.theta, radius),
        }
    )


@dataclass(frozen=True)
class Curves:
    """The slopes of a log, one or two, and its cone; p_one_slope: see `chance_of_one_slope`."""

    slopes: Fitted
    cone: Fitted | None
    p_one_slope: float
    fits: dict[str, Estimate]

    @property
    def likelier(self) -> Fitted:
        """The likelier of the two, which tells the overshoots."""
        return self.cone if self.cone and self.cone.drawn.log > self.slopes.drawn.log else self.slopes

    def cone_entry(self, theta: float, radius: float | None) -> ConeValues | None:
        """The fitted cone over the bins, in its parts, and its parameters."""
        if self.cone is None or radius is None:
            return None
        flat, mantle = self.cone.parts.T
        return {
            "k1": self.fits["k1_cone"].value,
            "sigma_cone": self.fits["sigma_cone"].value,
            "mu": self.fits["mu_cone"].value,
            "theta_rad": theta,
            "foot_radius_m": radius,
            "complete_depth_m": radius * math.tan(theta) / self.fits["mu_cone"].value,
            "log_odds": self.cone.drawn.log - self.slopes.drawn.log,
            "force_N": flat + mantle,
            "flat_N": flat,
            "mantle_N": mantle,
        }


def cone_family(R: float, theta: float) -> Family:
    """F_p of the jammed cone by resistive force theory (26) of a foot of radius R [m]; shape: R tan(theta)/mu."""
    area, whole = math.pi * R * R, R * math.tan(theta)

    def columns(z: Array, complete: float) -> Array:
        cone = {"z": z, "mu": whole / complete, "theta": theta, "R": R}
        return np.stack([flat_volume(np, **cone) / area, cone_volume(np, **cone)], axis=1)

    ends = whole / GROWTH[1], whole / GROWTH[0]
    return Family(("k1", "sigma_cone"), ("N/m", "N/m^3"), (0.0, area / math.cos(theta)), columns, range=ends)


def curves_of(
    time_s: Array, depth: Array, force: Array, where: str, p: IntrusionParams, radius: float | None
) -> Curves:
    """The curves of a slow intrusion; arrays (n,), where: for messages, radius [m] of the foot."""
    fresh = fresh_samples(time_s, depth, window=p.window, rise=p.rise)
    if fresh.index.size < LEAST:
        raise ValueError(
            f"{where}: depth_m: {fresh.index.size} samples go deeper than those before; {LEAST} are needed "
            "(depth is positive downwards; was the foot pushed in?)"
        )
    bins, rng = in_bins(depth, force, fresh), np.random.default_rng(0)
    if not rises(bins.z, bins.F):
        raise ValueError(
            f"{where}: force_N does not rise with depth_m; depth must be positive downwards and force positive against "
            "the intrusion"
        )
    air = begins_in_air(bins)
    two = fit_family(bins, TWO, air, rng)
    p_value = chance_of_one_slope(two, rng)
    slopes = two if p_value < p.significance else one_slope(two, rng)
    cone = fit_family(bins, cone_family(radius, p.theta), air, rng) if radius else None
    made = Curves(slopes, cone, p_value, {})
    made.fits.update(curve_fits(slopes, p_value) | event_fits(made.likelier))
    if cone and radius:
        made.fits.update(cone_fits(cone, radius * math.tan(p.theta)))
    return made


def rises(z: Array, F: Array) -> bool:
    """Whether the last quarter of the depths has a greater force than the first, beyond the scatter of both."""
    first, last = F[z < np.quantile(z, 0.25)], F[z > np.quantile(z, 0.75)]
    return bool(last.mean() - first.mean() > 3.0 * math.hypot(first.std(), last.std()) / math.sqrt(first.size))


def of_arrays(
    depth_m: ArrayLike,
    force_N: ArrayLike,
    *,
    time_s: ArrayLike | None = None,
    foot_radius: float | None = None,
    **parameters: Any,
) -> pd.DataFrame:
    """What a slow intrusion tells: a row a fit, as in intrusion.json.

    depth_m (n,) down, force_N (n,) against the intrusion, time_s (n,), by which pauses are found; default: equally
    spaced, ten samples in `window`. foot_radius [m]: for k1_cone, sigma_cone and mu_cone.
    parameters: those of [params.intrusion]. Rows: k1, k2 [N/m], delta [m], contact_depth_m, weight_N,
    ripples, and lam, s, s_p where there were pauses or withdrawals; a fit that the data do not allow has its `reason`.
    Raises InputError for a parameter, ValueError for arrays of different lengths or a force that does not rise.
    """
    p = of_keywords(IntrusionParams, parameters, foot_radius=foot_radius)
    if time_s is None:
        time_s = np.arange(np.size(depth_m)) * p.window / 10.0
    time, depth, force = checked("intrusion", time_s=time_s, depth_m=depth_m, force_N=force_N)
    seen = looked("intrusion", depth_m=depth, force_N=force)
    return Fits(
        curves_of(time[seen.kept], seen.columns["depth_m"], seen.columns["force_N"], "intrusion", p, foot_radius).fits
    ).table


def curve_fits(curve: Fitted, p_value: float) -> dict[str, Estimate]:
    """k1, k2, delta, the contact point, the weight that the load cell carries, ripples below the bend."""
    fits, n = curve.fits, curve.model.bins.z.size

    def without(unit: str, reason: str) -> Estimate:
        return Estimate(math.nan, math.nan, unit, n, curve.chi2, reason)

    one = f"one slope suffices (p = {p_value:.2g})"
    touching = without("m", "the log begins in contact: depth 0 is taken as the surface")
    out = {
        "k1": fits["k1"],
        "k2": fits.get("k2", without("N/m", one)),
        "delta": fits.get("shape", without("m", one)),
        "contact_depth_m": fits.get("contact_depth_m", touching),
        "weight_N": fits["weight_N"],
    }
    if out["delta"].known:
        bend = curve.surface + out["delta"].value
        ripple = deep_ripple(curve.model.bins.z, curve.residual, surface=curve.surface, bend=bend)
        out |= {"ripple_variance_N2": ripple.variance, "ripple_N": ripple.amplitude}
        if not ripple.amplitude.reason:
            out["ripple_spacing_m"] = Estimate(ripple.spacing, math.nan, "m", ripple.variance.n, math.nan)
    return out


def cone_fits(cone: Fitted, whole: float) -> dict[str, Estimate]:
    """k1_cone, sigma_cone, mu_cone; whole: R tan(theta) [m], the height of the complete cone."""
    shapes = np.array([cone.model.at(q).shape for q in cone.drawn.q])
    mu = cone.number(whole / shapes, None, "")
    return {"k1_cone": cone.fits["k1"], "sigma_cone": cone.fits["sigma_cone"], "mu_cone": mu}


def event_fits(curve: Fitted) -> dict[str, Estimate]:
    """lam and, by the kind of event, s or s_p with the tests of their law."""
    b = curve.model.bins
    if not b.event_depth.size:
        return {}
    out = {n: e for n, e in curve.fits.items() if n == "lam" or n.startswith(tuple(LAWS.values()))}
    overshoot, covariance = curve.events()
    kinds, z = np.array(b.event_kind), b.event_depth - curve.surface
    left = np.zeros(z.size)
    if curve.model.carry:
        left[1:] = curve.place.carry * overshoot[:-1] * np.exp(-np.diff(z) / curve.place.lam)
    for kind, name in LAWS.items():
        mine = np.flatnonzero(kinds == kind)
        if not mine.size:
            continue
        law = proportionality(z[mine], overshoot[mine], covariance[np.ix_(mine, mine)], left[mine])
        if f"{name}_per_decade" in out:
            law.pop("exponent", None)  # it would be that of the pauses, too
            law.pop("intercept", None)
        out |= {f"{name}_{k}": e for k, e in law.items()}
        if "compounding" in curve.fits:
            out[f"{name}_compounding"] = curve.fits["compounding"]
    return out
