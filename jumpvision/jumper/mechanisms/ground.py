"""Forces of the ground that know no cone: static resistance, overshoots, drag, an old footprint (thesis ch. III)."""

from __future__ import annotations

from .record import Body, Mechanism, Parameter, Prior, Robot

SAND = ("granular",)


def stiffness(m: Robot) -> float:
    """k or k1 of the model [N/m], the usual one where it has neither."""
    given = [x for x in (m.parameters.k, m.parameters.k1) if x is not None]
    return float(given[0]) if given else 2000.0


def resistance(m: Robot) -> Prior:
    """Of a resistance of the size of the model's own."""
    k = stiffness(m)
    return Prior(k, 0.05 * k, 20 * k, 0.1 * k)


def _below(m: Robot) -> Prior:
    k = stiffness(m)
    return Prior(k, 0.0, 20 * k, 0.1 * k)


def _overshoot(m: Robot) -> Prior:
    k = stiffness(m)
    return Prior(0.0, 0.0, 20 * k, 0.2 * k, log=True)


K = Parameter(
    "k",
    "N/m",
    "penetration resistance of the linear static force",
    resistance,
    lo=0,
    open_lo=True,
    by_area=True,
    stiffness=True,
)
K1 = Parameter(
    "k1",
    "N/m",
    "penetration resistance near the surface",
    resistance,
    lo=0,
    open_lo=True,
    by_area=True,
    stiffness=True,
)
K2 = Parameter("k2", "N/m", "penetration resistance below delta", _below, lo=0, by_area=True, stiffness=True)
DELTA = Parameter("delta", "m", "depth where k1 becomes k2", lambda m: Prior(0.012, 0.001, 0.08, 0.002), lo=0)
ALPHA = Parameter(
    "alpha", "kg/m", "inertial drag coefficient", lambda m: Prior(0.0, 0.0, 1000.0, 20.0), lo=0, by_area=True
)
S = Parameter("s", "N/m", "overshoot on re-intrusion per depth of the hole", _overshoot, lo=0, by_area=True)
S_P = Parameter("s_p", "N/m", "overshoot after a pause per depth of the pause", _overshoot, lo=0, by_area=True)
LAM = Parameter(
    "lam",
    "m",
    "length over which an overshoot decays (lambda)",
    lambda m: Prior(m.parameters.lam or 0.008, 0.0005, 0.1, 0.002, log=True, grid=(0.002, 0.008, 0.03)),
    lo=0,
    open_lo=True,
)
CARRY = Parameter(
    "carry",
    "",
    "share of what is left of an overshoot that the next pause adds to its own",
    lambda m: Prior(0.0, 0.0, 1.0, 0.1),
    default=0.0,
    lo=0,
    hi=1,
)
FACTOR = Parameter(
    "factor", "", "k1 under an earlier footprint / k1", lambda m: Prior(1.0, 0.1, 10.0, 0.2), lo=0, open_lo=True
)


LINEAR_PENETRATION = Mechanism(
    "linear_penetration",
    Body.STATIC,
    (K,),
    "static force k z",
    "a resistance in proportion to depth",
    "thesis eq. (15)",
    "k z",
    "k * z",
    grounds=SAND,
)
TWO_RESISTANCE = Mechanism(
    "two_resistance",
    Body.STATIC,
    (K1, K2, DELTA),
    "static force with a bend at delta",
    "a resistance that bends with depth",
    "thesis chapter III, force model 2",
    "k1 min(z, delta) + k2 max(z - delta, 0)",
    "k1 * minimum(z, delta) + k2 * maximum(z - delta, 0)",
    grounds=SAND,
)
INERTIAL_DRAG = Mechanism(
    "inertial_drag",
    Body.DRAG,
    (ALPHA,),
    "drag alpha v^2, constant alpha",
    "the drag of the grains that are pushed aside",
    "thesis eq. (15)",
    "alpha v^2",
    "alpha * v**2",
    grounds=SAND,
)
REINTRUSION_OVERSHOOT = Mechanism(
    "reintrusion_overshoot",
    Body.OVERSHOOT,
    (S, LAM),
    "extra force on landing in an existing hole",
    "the extra force on landing in an old hole",
    "thesis chapter III, force model 3",
    "s z_g exp(-(z - z_g)/lam)",
    "s * z_g * exp(-(z - z_g) / lam)",
    grounds=SAND,
)
STOP_GO_OVERSHOOT = Mechanism(
    "stop_go_overshoot",
    Body.OVERSHOOT,
    (S_P, LAM, CARRY),
    "extra force after a pause while intruding; repeated pauses compound by `carry`",
    "the extra force after a pause in the sand",
    "thesis chapter III, re-intrusion after a pause; Fig 69",
    "s_p (z_stop + carry z_left) exp(-(z - z_stop)/lam)",
    "s_p * (z_stop + carry * z_left) * exp(-(z - z_stop) / lam)",
    grounds=SAND,
    assumed={"carry": 0.0},
)
COMPACTION = Mechanism(
    "compaction",
    Body.BED,
    (FACTOR,),
    "k1 (or k) raised under an earlier footprint",
    "sand compacted by an earlier footprint",
    "thesis chapter III",
    grounds=SAND,
    scales=("k", "k1"),
)
