"""What is written down of a mechanism, once: everything else in the package derives from its record.

A law is one line of text (`engine.laws.expression`) in the symbols that the body it acts on offers, and in the
mechanism's parameters. It gives a force [N], positive up, or what its `Body` says. From its one tree come the values on
measured tracks, the code inside the integrator, the planner's symbols, the page's JavaScript. Laws of the ground act on
the foot while it intrudes (v < 0, z >= 0); the caller says when that is.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Hashable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cached_property
from typing import Any, Protocol

from jumpvision.base.arrays import Array
from jumpvision.engine.laws.expression import Expression, parse

_BED = {
    "R": ("m", "radius of the foot"),
    "phi": ("", "volume fraction of the bed"),
    "rho": ("kg/m^3", "density of a grain"),
}
_Z = {"z": ("m", "depth of the foot below the undisturbed surface, -x_f")}
_V = {"v": ("m/s", "velocity of the foot, positive up")}
_HOLES = {
    "z_g": ("m", "depth of the hole at the last lift-off, 0 before the first"),
    "z_stop": ("m", "depth of the last pause of the intrusion, 0 before the first"),
    "z_left": ("m", "overshoot of the pauses before, as it was left at the last one, over s_p; 0 before the second"),
}
_CONTACT = {"contact_s": ("s", "time since the foot last came down on the bed; 1e6 s before the first time")}
_TIME = {"time_s": ("s", "time as the recordings have it")}
_U = {"u": ("", "internal state, 0 at rest, with the rate that the mechanism states")}
_RAIL = {
    "v_m": ("m/s", "velocity of the carriage, v_r + X_m'"),
    "x_m": ("m", "position of the carriage on the rail, x_r + X_m, from where it stands at rest"),
    "x_r": ("m", "position of the rod, 0 where the spring is relaxed over the undisturbed surface"),
}
_SPRING = {
    "stretch": ("m", "extension of the spring, x_r - x_f"),
    "stretch_rate": ("m/s", "rate of extension of the spring, v_r - v_f"),
}
_MOTOR = {
    "X": ("m", "position of the motor on the rod, X_m"),
    "X_c": ("m", "its command"),
    "V_c": ("m/s", "rate of its command"),
}
_HEIGHT = {"h": ("m", "height of the rod above its rest"), "h_rate": ("m/s", "its rate, as the frames have it")}
_FORCE_OF_BED = {"a": ("m/s^2", "acceleration of the foot, positive up")}

Symbols = Mapping[str, tuple[str, str]]
STATE: Symbols = {
    **_Z, **_V, **_FORCE_OF_BED, **_HOLES, **_RAIL, **_SPRING, **_CONTACT, **_TIME, **_HEIGHT, **_U, **_BED, **_MOTOR
}  # fmt: skip
"""Symbol -> (unit, meaning) of what is not a model parameter."""
BED = tuple(_BED)
INNER = (*_Z, *_V, *_HOLES, *_CONTACT, *_RAIL, *_SPRING, *_TIME, *_U, *_BED)
"""What the rate of an internal state may ask for: all that a motion has."""
LONG_AGO = 1e6  # s, contact_s before the first contact: no memory that matters lasts eleven days


class Body(Enum):
    """What a mechanism acts on, and as what: how its law enters the equations of motion."""

    __hash__ = object.__hash__  # laws are looked up by it for every prediction, and Enum's own is written in Python

    STATIC = "the static force F_p(z) of the ground, also its yield threshold: exactly one on granular ground"
    OVERSHOOT = "force of the ground that adds to F_p, also to its yield threshold"
    DRAG = "force on the intruding foot in proportion to v^2"
    FOOT = "any other force on the intruding foot; as motion begins, also of the yield threshold"
    INERTIA = "mass m(z) that moves with the intruding foot: its force is -m(z) a"
    BED = "the bed under an earlier footprint: its first parameter multiplies those named in `scales`"
    CARRIAGE = "force of the rail on the carriage; where it jumps at v_m = 0, the rail holds any force between"
    RAIL = "dry friction of the rail: at v_m = 0 any force up to its size at speed"
    SPRING = "force of the spring on the rod"
    ROBOT = "a value of the robot that is other than assumed: its parameter is added to `corrects`"
    LANDING = "the touchdown on hard ground"
    DRIVE = "the command's or the log's motion: its operator makes of it that of the carriage"
    MOTOR = "how the motor follows its command: rate of the motor beside that of the command"
    HEIGHT = "what is added to the true height in the reported one"
    TIME = "what is added to a frame's stamp for the time that it shows"

    @property
    def symbols(self) -> Symbols:
        """What its laws may ask for beside their parameters: symbol -> (unit, meaning)."""
        return _OFFERED.get(self, ({}, ""))[0]

    @property
    def unit(self) -> str:
        """Of its laws."""
        return _OFFERED.get(self, ({}, ""))[1]


_GROUND = {**_Z, **_HOLES, **_BED}
_ON_RAIL = {**_RAIL, **_TIME, **_U}
_OFFERED: dict[Body, tuple[Symbols, str]] = {
    Body.STATIC: ({**_Z, **_BED}, "N"),
    Body.OVERSHOOT: (_GROUND, "N"),
    Body.DRAG: ({**_Z, **_V, **_BED}, "N"),
    Body.FOOT: ({**_GROUND, **_V, **_CONTACT, **_TIME, **_U}, "N"),
    Body.INERTIA: ({**_Z, **_BED}, "kg"),
    Body.CARRIAGE: (_ON_RAIL, "N"),
    Body.RAIL: (_ON_RAIL, "N"),
    Body.SPRING: ({**_SPRING, **_U}, "N"),
    Body.MOTOR: ({**_MOTOR, **_TIME}, "m/s"),
    Body.HEIGHT: ({**_HEIGHT, **_TIME}, "m"),
    Body.TIME: (_TIME, "s"),
}
FORCES = (
    Body.STATIC, Body.OVERSHOOT, Body.DRAG, Body.FOOT, Body.INERTIA, Body.CARRIAGE, Body.RAIL, Body.SPRING
)  # fmt: skip
"""The bodies whose laws give forces of the equations of motion."""


class Robot(Protocol):
    """What the size of a prior follows from, of a model (`physics.model.Model`)."""

    @property
    def parameters(self) -> Any: ...  # `registry.ModelParameters`, which is made of these records
    @property
    def M(self) -> float: ...
    @property
    def m_m(self) -> float: ...
    @property
    def m_f(self) -> float: ...
    @property
    def k_s(self) -> float: ...
    @property
    def c_s(self) -> float: ...
    @property
    def g(self) -> float: ...


@dataclass(frozen=True)
class Reach:
    """What the size of a prior of the drive follows from: the furthest [m] and fastest [m/s] that motors are sent."""

    stroke: float
    speed: float


@dataclass(frozen=True)
class Prior:
    """How a diagnosis tries a parameter: `engine.system.Parameter`.

    grid: values of a shape parameter at which its mechanism is tried first; (): `start`.
    """

    start: float
    low: float
    high: float
    scale: float
    sigma: float = math.inf
    log: bool = False
    grid: tuple[float, ...] = ()


@dataclass(frozen=True)
class Parameter:
    """A key of [model]: its unit ("" = none), meaning, allowed range and default (None: must be given).

    prior: of a model (`physics.model.Model`), of a DRIVE of its `Reach`. by_area: a force that grows with the area of
    the foot. stiffness: of the bed, by which beds made alike may differ as a whole.
    """

    name: str
    unit: str
    meaning: str
    prior: Callable[[Any], Prior]
    default: float | None = None
    lo: float = -math.inf
    hi: float = math.inf
    open_lo: bool = False
    by_area: bool = False
    stiffness: bool = False


@dataclass(frozen=True)
class Mechanism:
    """A cause by its name in model files and diagnoses.

    parameters: of a mechanism with a law the first is its strength, 0 where it is absent (not of a STATIC one).
    law: its text, in the symbols of `acts_on` and the parameters; let: names of parts of it -> their texts; state: rate
    of its internal state u, which has the unit state_unit. own: it is the user's own (`own`): its parameters are named
    with its own name before the one that the law uses. seen: range of the law's symbols that data covered.
    meaning: what it adds; lacks: the same in plain words, after "because the model lacks ..."; equation: how its term
    reads in a printed model; source: where it comes from. goes_with: mechanisms of one cause with it. assumed:
    parameters that jumps cannot tell, with their value where the model gives none. possible: whether a diagnosis may
    ask for it, of the model. of_command: it is how the motor follows its command, so it acts where that drives and not
    where the encoder does. operator: of a DRIVE, (knots, cubics, parameters) to (knots, cubics).
    Raises LawError for a law in symbols that the body does not offer, naming those that it does.
    """

    name: str
    acts_on: Body
    parameters: tuple[Parameter, ...]
    meaning: str
    lacks: str
    source: str
    equation: str = ""
    law: str = ""
    let: Mapping[str, str] = field(default_factory=dict)
    state: str = ""
    state_unit: str = ""
    own: bool = False
    grounds: tuple[str, ...] = ("hard", "granular")
    corrects: str = ""
    scales: tuple[str, ...] = ()
    goes_with: tuple[str, ...] = ()
    assumed: Mapping[str, float] = field(default_factory=dict)
    possible: Callable[[Any], bool] = field(default=lambda model: True, repr=False, compare=False)
    of_command: bool = False
    operator: Callable[..., tuple[Array, Array]] | None = field(default=None, repr=False, compare=False)
    seen: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        _ = self.expression, self.rate  # read, or refused

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Its parameters by name."""
        return tuple(p.name for p in self.parameters)

    @cached_property
    def expression(self) -> Expression | None:
        """Its law."""
        return self._parsed(self.law, tuple(self.acts_on.symbols)) if self.law else None

    @cached_property
    def rate(self) -> Expression | None:
        """Of its internal state u."""
        return self._parsed(self.state, INNER) if self.state else None

    def _parsed(self, text: str, offered: tuple[str, ...]) -> Expression:
        names = {s: s for s in offered if s != "u" or self.state}
        return parse(text, names | {bare(self, n): n for n in self.names}, self.let)

    @property
    def units(self) -> dict[str, str]:
        """Of all that its law and its state may be written in."""
        return (
            {n: unit for n, (unit, _) in STATE.items()}
            | {"u": self.state_unit}
            | {p.name: p.unit for p in self.parameters}
        )

    @property
    def symbols(self) -> tuple[str, ...]:
        """Names that its law is written in; () without a law."""
        return self.expression.symbols if self.expression else ()

    @property
    def asked(self) -> frozenset[str]:
        """Names that its law and the rate of its state are written in."""
        return frozenset((*self.symbols, *(self.rate.symbols if self.rate else ())))

    @cached_property
    def key(self) -> tuple[Hashable, ...]:
        """What its compiled law follows from."""
        trees = (x.root if x else None for x in (self.expression, self.rate))
        return (self.name, self.acts_on, self.names, self.scales, *trees)


def own_name(mechanism: str, parameter: str) -> str:
    """Name of a parameter beside those of the built-in mechanisms: `creep_q` of q of creep."""
    return re.sub(r"\W+", "_", f"{mechanism}_{parameter}")


def bare(m: Mechanism, parameter: str) -> str:
    """The name that the law of a mechanism itself uses for a parameter."""
    return parameter.removeprefix(own_name(m.name, "")) if m.own else parameter
