"""What the values of fits.json and intrusion.json, and mechanisms, are called on a page; units that they have there."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import NamedTuple

from jumpvision.base.arrays import measured
from jumpvision.estimate.estimate import Estimate
from jumpvision.jumper.mechanisms.registry import MECHANISMS
from jumpvision.report.style import FOOT

HALF, WHOLE = FOOT["half"], FOOT["full"]

UNITS = {  # unit in the file: unit on the page, factor
    "degree": ("°", 1.0),
    "degree/mm": ("°/mm", 1.0),
    "m": ("mm", 1e3),
    "m3": ("cm³", 1e6),
    "m/s^2": ("m/s²", 1.0),
    "N/m^3": ("N/m³", 1.0),
}
QUANTITIES: Mapping[str, str] = {
    "n_jumps": "flights of the jump",
    "lift_off_s": "first lift-off",
    "flight_time_s": "longest flight after the forcing",
    "flight_height_m": "height by that flight, g t²/8",
    "restitution": "restitution of the bounces",
    "jump_height_m": "jump height above rest",
    "apex_time_s": "time of the apex",
    "motor_rise_m": "rise while the motor runs",
    "zeta": "damping ratio ζ",
    "frequency_hz": "ring-down frequency",
    "omega0": "natural frequency ω₀",
    "decay_viscous_share": "share of the loss: viscous",
    "decay_quadratic_share": "share of the loss: quadratic",
    "decay_coulomb_share": "share of the loss: dry friction",
    "decay_viscous_rate": "viscous decay",
    "decay_quadratic_rate": "quadratic decay",
    "decay_coulomb_rate": "decay by dry friction",
    "decay_viscous_p_value": "p of viscous damping alone",
    "decay_quadratic_p_value": "p of quadratic damping alone",
    "decay_coulomb_p_value": "p of dry friction alone",
    "decay_viscous_chance": "probability that damping is viscous",
    "decay_quadratic_chance": "probability that damping is quadratic",
    "decay_coulomb_chance": "probability that damping is dry friction",
    "ring_amplitude_m": "amplitude of the ring-down",
    "ring_phase_rad": "phase of the ring-down",
    "ring_offset_m": "height that it rings about",
    "ring_start_s": "ring-down from",
    "ring_stop_s": "ring-down to",
    "actuator_ratio": "encoder / command",
    "actuator_lag_s": "lag of the motor behind its command",
    "actuator_tau_s": "time constant of the motor's lag",
    "peak_power_W": "peak motor power",
    "peak_speed_m_s": "peak motor speed",
    "peak_force_N": "peak motor force",
    "motor_work_J": "work of the motor",
    "beta_deg": "angle β of the jammed front",
    "beta_deg_per_mm_layer": "change of β for 1 mm of layer",
    "beta_theory_deg": "β that the packing implies",
    "log_a": "logarithm of the column's decay, ln a",
    "theta_deg": "angle θ of the cone's side",
    "theta_bands_deg": "angle of the bands of shear",
    "theta_outline_deg": "angle of the cone's outline",
    "mu": "growth μ of the jammed front with depth",
    "mu_intercept_m": "thickness of the jammed front at the surface",
    "mu_per_mm_of_axis": "change of μ for 1 mm of the axis",
    "mu_theory": "μ that the packing implies",
    "mu_cone": "μ of the cone fitted to the added mass",
    "theta_cone_deg": "θ of the cone fitted to the added mass",
    "mu_over_tan_theta": "narrowing of the cone, μ / tan θ",
    "added_mass_kg": f"greatest added mass ({HALF})",
    "cone_slope_kg_m": f"added mass per depth at the surface ({HALF})",
    "C": "scale C of the added mass",
    "jammed_share": "share of the added mass in the jammed cone",
    "k": "resistance k",
    "k1": "resistance k₁ above the bend",
    "k2": "resistance k₂ below the bend",
    "delta": "depth δ of the bend",
    "sigma_cone": "stress per depth on the cone, σ",
    "s": "overshoot on re-intrusion per depth, s",
    "s_p": "overshoot after a pause per depth, sₚ",
    "s_p_per_decade": "growth of sₚ in ten times the pause",
    "lam": "length λ over which an overshoot decays",
    "ripple_N": "amplitude of the oscillations below the bend",
    "ripple_spacing_m": "spacing of these oscillations",
    "spring_stiffness": "stiffness of the spring",
    "spring_hysteresis_N": "half width of the spring's loop",
    "volume_m3": "volume change of the crater",
}


SYMBOLS = dict(
    zip(["alpha", "beta", "delta", "lam", "mu", "phi", "sigma", "tau", "theta", "zeta"], "αβδλμφστθζ", strict=True)
)
SYMBOL = re.compile(rf"(?<![\w-])({'|'.join(SYMBOLS)})(?![\w-])")
POWER = re.compile(r"(\d)e([+-]?)0*(\d+)\b")
RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def typeset(text: str) -> str:
    """Greek names as letters, powers raised, minus signs, degrees: a table's text as a page shows it."""
    text = SYMBOL.sub(lambda m: SYMBOLS[m[1]], text)
    text = POWER.sub(lambda m: f"{m[1]} × 10{(m[2].strip('+') + m[3]).translate(RAISED)}", text)
    text = re.sub(r"(?<=[A-Za-z])\^(-?\d)", lambda m: m[1].translate(RAISED), text)
    return re.sub(r"(?<![\w)])-(?=\d)", "−", text).replace("[deg]", "[°]")


PREFIXED = {  # unit: units that a person takes for smaller values, with their factors
    "kg": (("kg", 1.0), ("g", 1e3), ("mg", 1e6)),
    "m": (("m", 1.0), ("mm", 1e3), ("μm", 1e6)),
    "s": (("s", 1.0), ("ms", 1e3), ("μs", 1e6)),
    "N": (("N", 1.0), ("mN", 1e3)),
}


def small(value: float, unit: str) -> str:
    """A strength with three significant figures, in the unit that makes it neither tiny nor huge."""
    choices = PREFIXED.get(unit, ((unit, 1.0),))
    unit, factor = next((c for c in choices if abs(value) * c[1] >= 1.0), choices[-1])
    shown = f"{value * factor:.3g}"
    if "e+" in shown and float(shown) < 1e6:
        shown = f"{float(shown):.0f}"
    return typeset(f"{shown} {unit}".strip())


class FitRow(NamedTuple):
    """A fit as a row of a table reads it."""

    name: str
    value: str
    unit: str
    n: str


def fit_rows(fits: Mapping[str, Estimate], *, whole: bool = False) -> list[FitRow]:
    """fits.json as table rows; fits without a value are left out. whole: the film shows a whole disc, not half."""
    return [fit_row(k, e, whole) for k, e in fits.items() if e.known]


def fit_row(name: str, e: Estimate, whole: bool) -> FitRow:
    """One fit in words, a person's unit and the digits of its uncertainty; a count and a probability as such."""
    unit, factor = shown_in(name, e.unit)
    if name == "n_jumps":
        value = f"{e.value:.0f}"
    elif name.endswith("_p_value"):
        value = f"{e.value:.2g}" if e.value >= 1e-4 else "< 0.0001"
    elif name.endswith("_chance"):
        value = f"{e.value:.2f}"
    else:
        value = measured(e.value, e.sigma, factor)
    words = QUANTITIES.get(name, name.replace("_", " "))
    return FitRow(
        words.replace(HALF, WHOLE) if whole else words, value.replace("-", "−"), unit, str(e.n) if e.n else ""
    )


def shown_in(name: str, unit: str) -> tuple[str, float]:
    """(unit on the page, factor): masses in g, lags in ms, lengths in mm."""
    if name == "added_mass_kg":
        return "g", 1e3
    if name in ("actuator_lag_s", "actuator_tau_s"):
        return "ms", 1e3
    return UNITS.get(unit, (unit, 1.0))


def mechanism_words(name: str) -> str:
    """What a model lacks without a mechanism, without its article; one of the user's own by its name."""
    known = MECHANISMS.get(name)
    if known is None:
        return name.replace("_", " ")
    return known.lacks.removeprefix("the ").removeprefix("a ").removeprefix("right ")
