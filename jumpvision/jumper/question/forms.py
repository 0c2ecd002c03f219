"""Laws that no vocabulary lists: forces, masses and instruments built from a few factors, as candidates of a diagnosis.

A form is a strength times a factor of the rate, one of the position and one of memory. Exponents, lengths, speeds and
times are free; so many of them at once that a law stays one that a person would write.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.jumper.mechanisms.own import mechanism
from jumpvision.jumper.mechanisms.own import parameter as drawn
from jumpvision.jumper.mechanisms.record import Mechanism, Parameter
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import arguments

from .jumper import Jumper

DEPTH, SPEED, STRETCH = 0.02, 0.5, 0.02  # m, m/s, m: typical, at which powers are 1
SHARE = 0.1  # of the weight: a force that matters, at the typical depth and speed
POWERS = (0.5, 1.0, 1.5, 2.0)


@dataclass(frozen=True)
class Factor:
    """A factor of a law without dimension, and its parameters. even: it is the same for both directions of motion."""

    text: str
    parameters: tuple[Parameter, ...] = ()

    @property
    def free(self) -> int:
        return sum(1 for p in self.parameters if p.lo < p.hi)


ONE = Factor("")


def _fixed(name: str, value: float, unit: str) -> Parameter:
    return drawn(name, value, value, value, unit)


def _power(symbol: str, scale: str, size: float, unit: str, exponent: str, signed: bool) -> Factor:
    """sign(x) |x / scale|^p, or |x / scale|^p."""
    sign = f"sign({symbol}) * " if signed else ""
    return Factor(
        f"{sign}abs({symbol} / {scale})**{exponent}",
        (drawn(exponent, 1.0, 0.05, 3.5, "", scale=0.3, grid=POWERS), _fixed(scale, size, unit)),
    )


def _saturating(symbol: str, scale: str, sizes: tuple[float, ...], unit: str) -> Factor:
    return Factor(
        f"{symbol} / (abs({symbol}) + {scale})",
        (drawn(scale, sizes[0], sizes[0] / 10.0, 3.0 * sizes[-1], unit, scale=0.3 * sizes[0], grid=sizes),),
    )


def _decaying(symbol: str, scale: str, sizes: tuple[float, ...], unit: str, rising: bool = False) -> Factor:
    text = f"exp(-{symbol} / {scale})"
    return Factor(
        f"(1 - {text})" if rising else text,
        (drawn(scale, sizes[0], sizes[0] / 4.0, 3.0 * sizes[-1], unit, scale=0.3 * sizes[0], grid=sizes),),
    )


V = _power("v", "v_0", SPEED, "m/s", "p", True)
V_SATURATING = _saturating("v", "v_1", (0.05, 0.3), "m/s")
Z = _power("z", "z_0", DEPTH, "m", "n", False)
Z_FADING = _decaying("z", "l", (0.004, 0.012, 0.03), "m")
Z_RISING = _decaying("z", "l", (0.004, 0.012, 0.03), "m", rising=True)
SINCE = _decaying("contact_s", "tau", (0.02, 0.1, 0.4), "s")
RAIL_V = _power("v_m", "v_0", SPEED, "m/s", "p", True)
RAIL_LINEAR_V = Factor("v_m / v_0", (_fixed("v_0", SPEED, "m/s"),))
RAIL_SATURATING = _saturating("v_m", "v_1", (0.05, 0.3), "m/s")
RAIL_DRY = Factor("sign(v_m)")
RAIL_X = _power("x_m", "x_0", DEPTH, "m", "n", False)
RAIL_HEIGHT = _power("x_r", "x_0", DEPTH, "m", "n", False)
RAIL_EXP = Factor(
    "exp(s * x_m / x_0)",
    (drawn("s", 0.5, -10.0, 10.0, "", scale=0.2, grid=(-1.0, -0.3, 0.3, 1.0)), _fixed("x_0", DEPTH, "m")),
)
RAIL_LINEAR = Factor(
    "(1 + s * x_m / x_0)", (drawn("s", 0.5, -20.0, 20.0, "", scale=0.3, grid=(-1.0, 1.0)), _fixed("x_0", DEPTH, "m"))
)
RAIL_PATCH = Factor(
    "exp(-((x_m - x_1) / w)**2)",
    (
        drawn("x_1", 0.01, -0.05, 0.15, "m", scale=0.003, grid=(0.0, 0.01, 0.02, 0.04)),
        drawn("w", 0.01, 0.001, 0.2, "m", scale=0.003, grid=(0.004, 0.012)),
    ),
)
STRETCH_POWER = _power("stretch", "s_0", STRETCH, "m", "n", True)
STRETCH_EVEN = _power("stretch", "s_0", STRETCH, "m", "n", False)
RATE_POWER = _power("stretch_rate", "v_0", SPEED, "m/s", "p", True)
RATE_SIGN = Factor("sign(stretch_rate)")


def force(name: str, acts_on: str, factors: Sequence[Factor], size: float, sign: str = "-") -> Mechanism:
    """The form of these factors; its strength r is the force [N] at the typical depth and speed."""
    text = " * ".join([f"{sign}r", *(f.text for f in factors if f.text)])
    strength = drawn("r", 0.0, -1e3 * size, 1e3 * size, "N", scale=size)
    return mechanism(name, acts_on, text, [strength, *(p for f in factors for p in f.parameters)])


def forms(model: Model) -> dict[str, Mechanism]:
    """Every form that may act on this model's ground, by name."""
    size = SHARE * model.M * model.g
    out: list[Mechanism] = []
    if model.ground == "granular":
        out += _combined("foot", (("v", V), ("sat", V_SATURATING)), _DEPTHS, _MEMORY, size, "-")
        out += _combined("foot", (("", ONE),), _DEPTHS[1:], _MEMORY, size, "")
        out.append(_relaxing("foot_relaxing", "foot", "-r * u", "v - u / tau", "m", size / DEPTH, "N/m"))
        out += [_mass(name, place) for name, place in _DEPTHS[1:]]  # the vocabulary has a constant one
    out += _combined(
        "rail",
        (("v", RAIL_V), ("lin", RAIL_LINEAR_V), ("sat", RAIL_SATURATING), ("dry", RAIL_DRY)),
        _PLACES,
        (("", ONE),),
        size,
        "-",
    )
    spring = SHARE * model.k_s * STRETCH
    out += [
        force("spring_power", "spring", (STRETCH_POWER,), spring),
        force("spring_rate", "spring", (RATE_POWER,), spring),
        force("spring_hysteresis", "spring", (STRETCH_EVEN, RATE_SIGN), spring),
        _relaxing("spring_relaxing", "spring", "-r * u", "stretch_rate - u / tau", "m", 0.02 * model.k_s, "N/m"),
        *_instruments(),
    ]
    return {m.name: m for m in out}


_DEPTHS = (("", ONE), ("z", Z), ("fading", Z_FADING), ("rising", Z_RISING))
_MEMORY = (("", ONE), ("since", SINCE))
_PLACES = (
    ("", ONE),
    ("x", RAIL_X),
    ("height", RAIL_HEIGHT),
    ("exp", RAIL_EXP),
    ("linear", RAIL_LINEAR),
    ("patch", RAIL_PATCH),
)
_BODY = {"foot": "foot", "rail": "carriage"}

Named = Sequence[tuple[str, Factor]]


def _combined(body: str, rates: Named, places: Named, memories: Named, size: float, sign: str) -> list[Mechanism]:
    out = []
    for (a, rate), (b, place), (c, memory) in product(rates, places, memories):
        if rate.free + place.free + memory.free > 2 or (a, b, c) == ("dry", "", ""):
            continue  # the dry friction of the rail is the vocabulary's
        if a == "lin" and place is not RAIL_PATCH:
            continue  # a power has it
        name = "_".join(n for n in (body, a, b, c) if n)
        out.append(force(name, _BODY[body], (rate, place, memory), size, sign))
    return out


def _mass(name: str, place: Factor) -> Mechanism:
    """A mass that moves with the foot; its strength r is the mass [kg] at the typical depth."""
    strength = drawn("r", 0.0, -2.0, 2.0, "kg", scale=0.02)
    text = " * ".join(t for t in ("r", place.text) if t)
    return mechanism(f"foot_mass_{name}", "foot_mass", text, [strength, *place.parameters])


def _relaxing(name: str, acts_on: str, law: str, state: str, state_unit: str, size: float, unit: str) -> Mechanism:
    """A force of an internal state that follows the motion and fades with the time tau."""
    parameters = [
        drawn("r", 0.0, -1e3 * size, 1e3 * size, unit, scale=size),
        drawn("tau", 0.05, 1e-3, 3.0, "s", scale=0.02, grid=(0.01, 0.05, 0.3)),
    ]
    return mechanism(name, acts_on, law, parameters, state=state, state_unit=state_unit)


def _instruments() -> list[Mechanism]:
    height = drawn("h_0", DEPTH, DEPTH, DEPTH, "m")
    rate = drawn("r", 0.0, -0.2, 0.2, "", scale=1e-3)
    bend = drawn("r", 0.0, -0.05, 0.05, "m", scale=1e-4)
    late = drawn("r", 0.0, -0.02, 0.02, "s", scale=1e-5)  # the time from row to row over h_0
    return [
        mechanism("shutter", "film_height", "r * h / h_0 * h_rate", [late, height]),  # rows of a frame one by one
        mechanism("clock_rate", "film_time", "r * time_s", [rate]),
        mechanism(
            "frames_dropped",
            "film_time",
            "where(time_s > t_1, r, 0)",
            [
                drawn("r", 0.0, -0.1, 0.1, "s", scale=1e-3),
                drawn("t_1", 0.3, -0.5, 5.0, "s", scale=0.02, grid=tuple(0.1 * k for k in range(1, 12))),
            ],
        ),
        mechanism(
            "lens",
            "film_height",
            "r * sign(h) * abs(h / h_0)**n",
            [bend, height, drawn("n", 2.0, 1.2, 5.0, "", scale=0.3, grid=(2.0, 3.0))],
        ),
    ]


def seen_by(
    jumper: Jumper, form: Mechanism, mechanisms: tuple[str, ...], values: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    """Range of every argument of a form's body that a model's motions reached."""
    found: dict[str, list[Array]] = {}
    for jump in jumper.jumps:
        model = jumper.model_of(jump, mechanisms, values)
        for n, x in arguments(jumper._motion(jump, model, jump.t), form.acts_on).items():
            found.setdefault(n, []).append(x)
    whole = {n: np.concatenate(parts) for n, parts in found.items()}
    return {n: (float(x.min()), float(x.max())) for n, x in whole.items()}
