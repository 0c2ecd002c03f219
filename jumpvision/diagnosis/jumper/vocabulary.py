"""The mechanisms a jumper's model may lack, as candidates; generic forces for what no mechanism explains."""

from __future__ import annotations

import math
from collections.abc import Mapping

from jumpvision.diagnosis.system import Candidate, Parameter
from jumpvision.mechanisms.laws import STATIC
from jumpvision.mechanisms.parameters import MECHANISMS, ModelParameters
from jumpvision.physics.model import Model

DECAY = ((0.002,), (0.008,), (0.03,))  # m, lambda


def _parameter(
    name: str, start: float, low: float, high: float, scale: float, sigma: float = math.inf, *, log: bool = False
) -> Parameter:
    unit = ModelParameters.__dataclass_fields__[name].metadata["unit"]
    return Parameter(name, start, low, high, scale, sigma, unit, log)


def candidates(
    model: Model, *, command_drives: bool, priors: Mapping[str, float] | None = None
) -> dict[str, Candidate]:
    """Every mechanism of the model's ground that is not in it.

    command_drives: the command, not the encoder, drives the model (else there is no `motor_lag`).
    priors: standard uncertainties of shape parameters that the model's author gave.
    """
    m, given, sand = model, model.parameters, model.ground == "granular"
    stiff = 2000.0 if given.k1 is None else given.k1
    stiff = stiff if given.k is None else given.k
    sigma = dict(priors or {})
    mu = _parameter("mu", given.mu, 0.3, 6.0, 0.2, sigma.get("mu", 0.4), log=True)
    theta = _parameter("theta", given.theta, 0.6, 1.45, 0.05, sigma.get("theta", math.radians(5.0)))
    lam = _parameter("lam", given.lam or 0.008, 0.0005, 0.1, 0.002, log=True)
    share = math.sqrt(m.k_s * m.M)
    out = {
        "inertial_drag": Candidate((_parameter("alpha", 0.0, 0.0, 1000.0, 20.0),)),
        "depth_drag": Candidate(
            (_parameter("b", 0.0, 0.0, 500.0, 5.0, log=True), mu, theta), shapes=((given.mu, given.theta),)
        ),
        "added_mass": Candidate(
            (_parameter("C", 0.0, 0.0, 20.0, 0.5, log=True), mu, theta),
            shapes=((given.mu, given.theta),),
            goes_with=("depth_drag",),
        ),
        "foot_mass": Candidate((_parameter("dm_f", 0.0, -0.95 * m.m_f, 0.5, 0.01),)),
        "reintrusion_overshoot": Candidate(
            (_parameter("s", 0.0, 0.0, 20 * stiff, 0.2 * stiff, log=True), lam), shapes=DECAY
        ),
        "stop_go_overshoot": Candidate(
            (_parameter("s_p", 0.0, 0.0, 20 * stiff, 0.2 * stiff, log=True), lam), shapes=DECAY
        ),
        "compaction": Candidate((_parameter("factor", 1.0, 0.1, 10.0, 0.2),), null=1.0),
        "viscous_friction": Candidate((_parameter("c_v", 0.0, 0.0, share, 0.02 * share),)),
        "coulomb_friction": Candidate((_parameter("F_c", 0.0, 0.0, m.M * m.g, 0.05 * m.M * m.g),)),
        "spring_hardening": Candidate((_parameter("k_3", 0.0, 0.0, 1e4 * m.k_s, 100.0 * m.k_s),)),
        "spring_damping": Candidate((_parameter("dc", 0.0, -m.c_s, share, 0.02 * share),)),
        "spring_stiffness": Candidate((_parameter("dk", 0.0, -0.6 * m.k_s, 1.5 * m.k_s, 0.03 * m.k_s),)),
        "payload": Candidate((_parameter("dm", 0.0, -0.6 * m.m_m, 1.5 * m.m_m, 0.03 * m.M),)),
        "tilt": Candidate((_parameter("dg", 0.0, -0.6 * m.g, 1.5 * m.g, 0.03 * m.g),)),
        "landing_loss": Candidate((_parameter("e", 0.0, 0.0, 0.99, 0.1),)),
        "motor_lag": Candidate((_parameter("tau", 1e-7, 1e-7, 0.05, 2e-3),), null=1e-7),
        "camera_scale": Candidate((_parameter("scale", 1.0, 0.7, 1.4, 0.02),), null=1.0),
        "time_offset": Candidate((_parameter("dt", 0.0, -0.05, 0.05, 2e-3),)),
    }
    if not command_drives:
        del out["motor_lag"]
    if m.m_f <= 0.0:
        out.pop("foot_mass")
    if sand:
        out |= _static(model, mu, theta, stiff)
    return {n: c for n, c in out.items() if m.ground in MECHANISMS[n].grounds and n not in m.terms}


def _static(model: Model, mu: Parameter, theta: Parameter, stiff: float) -> dict[str, Candidate]:
    """The other laws of the static force, each in place of the model's own."""
    own = next(t for t in model.terms if t in STATIC)
    k = _parameter("k", stiff, 0.05 * stiff, 20 * stiff, 0.1 * stiff)
    k1 = _parameter("k1", stiff, 0.05 * stiff, 20 * stiff, 0.1 * stiff)
    k2 = _parameter("k2", stiff, 0.0, 20 * stiff, 0.1 * stiff)
    delta = _parameter("delta", 0.012, 0.001, 0.08, 0.002)
    sigma = _parameter("sigma_cone", 1.3e5, 0.0, 2e6, 2e4)
    parts = {"linear_penetration": (k,), "two_resistance": (k1, k2, delta), "rft_cone": (k1, sigma, mu, theta)}
    old = set(MECHANISMS[own].parameters)
    return {
        t: Candidate(p, replaces=own, drops=tuple(sorted(old - {x.name for x in p})))
        for t, p in parts.items()
        if t != own
    }
