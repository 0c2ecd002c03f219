"""What is written down of a mechanism, once: everything else in the package derives from its record.

A law is a plain function of its symbols with the array namespace `xp` first; the others are measured quantities
(STATE) or the mechanism's parameters. It returns a force [N], positive up, of the shape of its arrays, and uses
arithmetic and `where, exp, tan, minimum, maximum` of `xp` alone, so that the same function serves measured tracks
(numpy), the compiled integrator and symbols (CasADi). Laws of the ground act on the foot while it intrudes (v < 0,
z >= 0); the caller says when that is.
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from enum import Enum
from functools import cache, cached_property
from typing import Any, TypeVar

from jumpvision.engine.laws.expression import Expression

STATE: dict[str, tuple[str, str]] = {
    "z": ("m", "depth of the foot below the undisturbed surface, -x_f"),
    "v": ("m/s", "velocity of the foot, positive up"),
    "a": ("m/s^2", "acceleration of the foot, positive up"),
    "z_g": ("m", "depth of the hole at the last lift-off, 0 before the first"),
    "z_stop": ("m", "depth of the last pause of the intrusion, 0 before the first"),
    "z_left": ("m", "overshoot of the pauses before, as it was left at the last one, over s_p; 0 before the second"),
    "v_m": ("m/s", "velocity of the carriage, v_r + X_m'"),
    "stretch": ("m", "extension of the spring, x_r - x_f"),
    "stretch_rate": ("m/s", "rate of extension of the spring, v_r - v_f"),
    "R": ("m", "radius of the foot"),
    "contact_s": ("s", "time since the foot last came down on the bed; 1e6 s before the first time"),
    "x_m": ("m", "position of the carriage on the rail, x_r + X_m, from where it stands at rest"),
    "x_r": ("m", "position of the rod, 0 where the spring is relaxed over the undisturbed surface"),
    "time_s": ("s", "time as the recordings have it"),
    "h": ("m", "height of the rod above its rest"),
    "u": ("", "internal state, 0 at rest, with the rate that the mechanism states"),
    "phi": ("", "volume fraction of the bed"),
    "rho": ("kg/m^3", "density of a grain"),
}
"""Symbol -> (unit, meaning) of what is not a model parameter."""


class Body(Enum):
    """What a mechanism acts on, and as what: how its law enters the equations of motion."""

    STATIC = "the static force F_p(z) of the ground, also its yield threshold: exactly one on granular ground"
    OVERSHOOT = "force of the ground that adds to F_p, also to its yield threshold"
    DRAG = "force on the intruding foot in proportion to v^2"
    FOOT = "any other force on the intruding foot"
    INERTIA = "mass that moves with the intruding foot: the law is -m(z) a"
    BED = "the bed under an earlier footprint: its first parameter multiplies those named in `scales`"
    CARRIAGE = "force of the rail on the carriage, continuous in v_m"
    RAIL = "dry friction of the rail: at v_m = 0 any force up to its size at speed"
    SPRING = "force of the spring on the rod"
    ROBOT = "a value of the robot that is other than assumed: its parameter is added to `corrects`"
    LANDING = "the touchdown on hard ground"
    MOTOR = "how the motor follows its command"
    HEIGHT = "reported over true height: its parameter is the factor"
    TIME = "the time that a frame shows: its parameter is added to the stamp"


F = TypeVar("F", bound=Callable[..., Any])
COMPILED: list[Callable[..., Any]] = []
"""Functions that compiled code calls (`physics.sand.kernel`)."""


def law(function: F) -> F:
    """A law, or a function that laws call: as it is, and known to compiled code."""
    COMPILED.append(function)
    return function


@dataclass(frozen=True)
class Prior:
    """How a diagnosis tries a parameter: `diagnosis.system.Parameter`.

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

    prior: of a model (`physics.model.Model`). by_area: a force that grows with the area of the foot. stiffness: of the
    bed, by which beds made alike may differ as a whole.
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
    written: of a mechanism of the user's own, its law as text (`own`): of HEIGHT and TIME what is added [m], [s], of
    INERTIA the mass [kg]; rate: of its internal state u [1/s]. seen: range of the law's symbols that data covered.
    meaning: what it adds; lacks: the same in plain words, after "because the model lacks ..."; equation: how its term
    reads in a printed model; source: where it comes from. slope: of an INERTIA dm/dz [kg/m], of a SPRING -dF/dstretch
    [N/m]; bend: depth [m] of its kink, on which the solver ends a step; energy: what a SPRING has stored [J] (None: its
    work is lost). goes_with: mechanisms of one cause with it. assumed: parameters that jumps cannot tell, with their
    value where the model gives none. possible: whether a diagnosis may ask for it, of the model and whether the command
    drives it.
    """

    name: str
    acts_on: Body
    parameters: tuple[Parameter, ...]
    meaning: str
    lacks: str
    source: str
    equation: str = ""
    law: Callable[..., Any] | None = None
    slope: Callable[..., Any] | None = None
    bend: Callable[..., Any] | None = None
    energy: Callable[..., Any] | None = None
    grounds: tuple[str, ...] = ("hard", "granular")
    corrects: str = ""
    scales: tuple[str, ...] = ()
    goes_with: tuple[str, ...] = ()
    assumed: Mapping[str, float] = field(default_factory=dict)
    possible: Callable[[Any, bool], bool] = field(default=lambda model, command_drives: True, repr=False, compare=False)
    written: Expression | None = None
    rate: Expression | None = None
    seen: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Its parameters by name."""
        return tuple(p.name for p in self.parameters)

    @property
    def symbols(self) -> tuple[str, ...]:
        """Names that its law is written in, less the array namespace; () without a law."""
        return symbols(self.law) if self.law else ()


@cache
def symbols(function: Callable[..., Any]) -> tuple[str, ...]:
    """Names that a law is written in, less the array namespace."""
    if own := getattr(function, "symbols", None):
        return tuple(own)
    return tuple(inspect.signature(function).parameters)[1:]
