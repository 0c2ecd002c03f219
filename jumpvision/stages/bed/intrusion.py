"""Intrusion: force against depth of a slow intrusion, its two resistances and what pauses and withdrawals add."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from jumpvision.base.arrays import Array
from jumpvision.estimate.estimate import Estimate, checked
from jumpvision.estimate.strokes import Fresh, deep_ripple, fresh_samples, overshoot_law
from jumpvision.estimate.two_slope import Penetration, fit_penetration, in_bins
from jumpvision.inputs.logs import read_log
from jumpvision.inputs.parameters import IntrusionParams, of_keywords
from jumpvision.inputs.sections import IntrusionLog, Robot
from jumpvision.mechanisms.cone import rft_cone
from jumpvision.results.values import Fits, Intrusion
from jumpvision.workflow.stage import stage

LAWS = {"reintrusion": "s", "stop_go": "s_p"}
LEAST = 40  # samples in fresh grains that a curve needs


@stage(version=1)
def intrusion(log: IntrusionLog, robot: Robot | None, *, p: IntrusionParams) -> Intrusion:
    """Slow intrusion of [intrusion_log]: two resistances, overshoots after pauses and withdrawals, oscillations.

    `fits` {name: {value, sigma, ...}}, the averaged `profile`, the `events` and the cone's prediction `cone`.
    """
    d = read_log(log, "time_s", "depth_m", "force_N", at_least=LEAST)
    time, depth, force = (d[n].to_numpy() for n in ("time_s", "depth_m", "force_N"))
    curve, fresh = curve_of(time, depth, force, str(log.path), p)
    surface = 0.0 if curve.contact.reason else curve.contact.value
    fits = curve_fits(curve, surface) | event_fits(curve, fresh, surface)
    below = curve.bins.z - surface
    jammed = cone(curve, robot, np.maximum(below, 0.0), p)
    return Intrusion(
        {
            "fits": {k: e.entry() for k, e in fits.items()},
            "p_one_slope": curve.p_value,
            "delta_ci95_m": [curve.delta_low, curve.delta_high],
            "noise": {
                "white_N": curve.noise.white,
                "correlated_N": curve.noise.correlated,
                "length_m": curve.noise.length,
            },
            "profile": {
                "depth_m": below,
                "force_N": curve.bins.F - curve.offset.value,
                "event": curve.bins.event,
                "fitted_N": curve.fitted - curve.offset.value,
                "first_N": curve.virgin - curve.offset.value,
            },
            "events": [
                {"kind": kind, "depth_m": z - surface, "pause_s": pause, "overshoot_N": o, "sigma_N": math.sqrt(v)}
                for kind, z, pause, o, v in zip(
                    fresh.event_kind,
                    fresh.event_depth,
                    fresh.event_pause,
                    curve.overshoot,
                    np.diag(curve.overshoot_covariance),
                )
            ],
            "cone": jammed._asdict() if jammed else None,
        }
    )


def curve_of(time_s: Array, depth: Array, force: Array, where: str, p: IntrusionParams) -> tuple[Penetration, Fresh]:
    """The curve of a slow intrusion and its samples in fresh grains; arrays (n,), where: for messages."""
    fresh = fresh_samples(time_s, depth, window=p.window, rise=p.rise)
    if fresh.index.size < LEAST:
        raise ValueError(
            f"{where}: depth_m: {fresh.index.size} samples go deeper than those before; {LEAST} are needed "
            "(depth is positive downwards; was the foot pushed in?)"
        )
    bins = in_bins(depth, force, fresh)
    curve = fit_penetration(bins, rng=np.random.default_rng(0), significance=p.significance)
    if not curve.k1.value > 3.0 * curve.k1.sigma:
        raise ValueError(
            f"{where}: force_N does not rise with depth_m: {curve.k1.value:.3g} ± {curve.k1.sigma:.2g} N/m; "
            "depth must be positive downwards and force positive against the intrusion"
        )
    return curve, fresh


def of_arrays(depth_m: Any, force_N: Any, *, time_s: Any = None, **parameters: Any) -> pd.DataFrame:
    """What a slow intrusion tells: a row a fit, as in intrusion.json.

    depth_m (n,) down, force_N (n,) against the intrusion, time_s (n,), by which pauses are found; default: equally
    spaced, ten samples in `window`.
    parameters: those of [params.intrusion] but mu and theta. Rows: k1, k2 [N/m], delta [m], contact_depth_m, weight_N,
    ripples, and lam, s, s_p where there were pauses or withdrawals; a fit that the data do not allow has its `reason`.
    Raises InputError for a parameter, ValueError for arrays of different lengths or a force that does not rise.
    """
    p = of_keywords(IntrusionParams, parameters, folder=("mu", "theta"))
    if time_s is None:
        time_s = np.arange(np.size(depth_m)) * p.window / 10.0
    time, depth, force = checked("intrusion", time_s=time_s, depth_m=depth_m, force_N=force_N)
    curve, fresh = curve_of(time, depth, force, "intrusion", p)
    surface = 0.0 if curve.contact.reason else curve.contact.value
    return Fits(curve_fits(curve, surface) | event_fits(curve, fresh, surface)).table


def curve_fits(curve: Penetration, surface: float) -> dict[str, Estimate]:
    """k1, k2, delta, the contact point, the weight that the load cell carries, ripples below the bend."""
    out = {
        "k1": curve.k1,
        "k2": curve.k2,
        "delta": curve.delta,
        "contact_depth_m": curve.contact,
        "weight_N": curve.offset,
    }
    if not curve.delta.reason:
        ripple = deep_ripple(curve.bins.z, curve.residual, surface=surface, bend=surface + curve.delta.value)
        out |= {"ripple_variance_N2": ripple.variance, "ripple_N": ripple.amplitude}
        if not ripple.amplitude.reason:
            out["ripple_spacing_m"] = Estimate(ripple.spacing, math.nan, "m", ripple.variance.n, math.nan)
    return out


def event_fits(curve: Penetration, fresh: Fresh, surface: float) -> dict[str, Estimate]:
    """lam and, by the kind of event, s or s_p with the tests of their law."""
    if curve.lam.reason:
        return {}
    out = {"lam": curve.lam}
    kinds = np.array(fresh.event_kind)
    for kind, name in LAWS.items():
        mine = np.flatnonzero(kinds == kind)
        law = overshoot_law(
            fresh.event_depth[mine] - surface,
            curve.overshoot[mine],
            curve.overshoot_covariance[np.ix_(mine, mine)],
            lam=curve.lam.value,
            pause=fresh.event_pause[mine],
        )
        out |= {name if k == "s" else f"{name}_{k}": e for k, e in law.items()}
    return out


class ConeForce(NamedTuple):
    """F_p of the jammed cone [N] at the depths of the profile, and what it rests on, under the names of the file."""

    sigma_cone: float
    mu: float
    theta_rad: float
    foot_radius_m: float
    complete_depth_m: float
    force_N: Array


def cone(curve: Penetration, robot: Robot | None, depth: Any, p: IntrusionParams) -> ConeForce | None:
    """F_p of the jammed cone by resistive force theory (26): k1 of this curve, the mantle's stress from k2.

    A complete cone presses with sigma pi R^2 / cos(theta) per metre, so sigma = k2 cos(theta)/(pi R^2) [N/m^3].
    """
    if robot is None or robot.foot_radius is None:
        return None
    R, k2 = robot.foot_radius, curve.k1.value if curve.k2.reason else curve.k2.value
    sigma = k2 * math.cos(p.theta) / (math.pi * R * R)
    force = rft_cone(np, depth, curve.k1.value, sigma, p.mu, p.theta, R)
    return ConeForce(sigma, p.mu, p.theta, R, complete_depth_m=R * math.tan(p.theta) / p.mu, force_N=force)
