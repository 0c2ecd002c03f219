"""A model of the jumper: mechanisms with parameters over robot, ground and bed; the models the thesis tried in turn."""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterable
from dataclasses import KW_ONLY, dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array
from jumpvision.base.schema import REQUIRED, InputError, check_value, closest, param, type_of
from jumpvision.engine.laws import python
from jumpvision.engine.laws.derivative import derivative
from jumpvision.engine.laws.expression import Expression
from jumpvision.engine.laws.tree import Node
from jumpvision.jumper.mechanisms.record import FORCES, STATE, Body, Mechanism
from jumpvision.jumper.mechanisms.registry import MECHANISMS, STATIC, ModelParameters

GROUNDS = ("hard", "granular")

OF_BED = {"R": "foot_radius", "phi": "volume_fraction", "rho": "grain_density"}
"""Symbol of a law -> field of a Model."""


@dataclass(frozen=True)
class Model:
    """Robot, ground and mechanisms. Raises InputError (a ValueError) with every problem found.

    terms: identifiers of docs/physics.md section 6, and of `own`; on granular ground exactly one static force among
    them. parameters: with those of `own` (`own.parameters_with`). The robot's values are those assumed; mechanisms that
    act on Body.ROBOT correct them (properties m_m, m_f, k_s, c_s, g). own: mechanisms of the user's own.
    """

    ground: str = param(REQUIRED, "", "ground", choices=GROUNDS)
    terms: tuple[str, ...] = param((), "", "mechanisms")
    parameters: ModelParameters = field(default_factory=ModelParameters)
    _: KW_ONLY
    motor_mass: float = param(REQUIRED, "kg", "mass of the motor and its carriage", lo=0, open_lo=True)
    rod_mass: float = param(REQUIRED, "kg", "mass of the thrust rod", lo=0, open_lo=True)
    foot_mass: float = param(REQUIRED, "kg", "mass of the foot", lo=0)
    spring_stiffness: float = param(REQUIRED, "N/m", "stiffness of the spring", lo=0, open_lo=True)
    spring_damping: float = param(REQUIRED, "N s/m", "damping of the spring", lo=0)
    gravity: float = param(REQUIRED, "m/s^2", "gravity along the rail", lo=0, open_lo=True)
    foot_radius: float | None = param(None, "m", "radius of the foot", lo=0, open_lo=True)
    volume_fraction: float | None = param(None, "", "volume fraction of the bed", lo=0, hi=1, open_lo=True)
    grain_density: float | None = param(None, "kg/m^3", "density of a grain", lo=0, open_lo=True)
    own: tuple[Mechanism, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "terms", tuple(self.terms))
        if problems := list(self._problems()):
            raise InputError(problems)

    def __contains__(self, mechanism: str) -> bool:
        return mechanism in self.terms

    def mechanism(self, name: str) -> Mechanism:
        """The record of one of its terms. Raises KeyError for a name that it does not know."""
        return MECHANISMS.get(name) or {m.name: m for m in self.own}[name]

    def _problems(self) -> Iterable[str]:
        records, every = ("parameters", "own"), {**MECHANISMS, **{m.name: m for m in self.own}}
        parameters = type(self.parameters).__dataclass_fields__
        yield from _range_problems(self, "model", [f.name for f in dataclasses.fields(self) if f.name not in records])
        known = [t for t in self.terms if t in every]
        for t in self.terms:
            if t not in every:
                yield f"model terms: unknown mechanism '{t}'{closest(t, every)}"
            elif self.ground in GROUNDS and self.ground not in every[t].grounds:
                yield f"model terms: '{t}' does not act on {self.ground} ground; remove it"
        for t in sorted({t for t in known if self.terms.count(t) > 1}):
            yield f"model terms: '{t}' is listed twice; list it once"
        static = [t for t in known if every[t].acts_on is Body.STATIC]
        if self.ground == "granular" and len(set(static)) != 1:
            found = ", ".join(static) or "none"
            yield f"model terms: granular ground needs exactly one static force of {', '.join(STATIC)}; found {found}"
        needed = {n: t for t in reversed(known) for n in every[t].names}
        missing = [n for n in needed if getattr(self.parameters, n) is None]
        for n in missing:
            about = parameters[n].metadata["meaning"]
            yield f"model {n}: missing; '{needed[n]}' needs it ({about})"
        given = [n for n in parameters if n not in missing]
        if wrong := list(_range_problems(self.parameters, "model", [n for n in given if n in needed])):
            yield from wrong
            return
        symbols = {n for t in known for n in every[t].asked}
        if len(self.rates) > 1:
            yield "model terms: two mechanisms have an internal state; one at a time is followed: remove one"
        lacking = [own for n, own in OF_BED.items() if n in symbols and getattr(self, own) is None]
        yield from (f"model {n}: missing; the cone needs it" for n in lacking)
        if missing or lacking:
            return
        for name, value in (("m_m", "motor_mass"), ("k_s", "spring_stiffness"), ("g", "gravity")):
            if getattr(self, name) <= 0:
                yield f"model {value}: {getattr(self, name):g} after correction by a mechanism; must be > 0"
        if self.m_f < 0 or (self.ground == "granular" and self.m_f == 0):
            least = "> 0 on granular ground" if self.ground == "granular" else ">= 0"
            yield f"model foot_mass: {self.m_f:g} kg; must be {least}: give the foot's mass"
        if self.c_s < 0:
            yield f"model spring_damping: {self.c_s:g} N s/m after correction; must be >= 0"
        if self.acting(Body.INERTIA) and self.lacks_drag:
            yield (
                f"model alpha, b: alpha + (b - 1/2) dm_a/dz = {self.spare_drag:g} kg/m < 0 at the surface would "
                "create energy; give 'depth_drag' with b >= 0.5, or 'inertial_drag' with a larger alpha"
            )

    # The robot as the mechanisms correct it, in the symbols of docs/physics.md.
    @property
    def m_m(self) -> float:
        """Mass of the motor with its payload [kg]."""
        return self._corrected("motor_mass")

    @property
    def m_f(self) -> float:
        """Mass of the foot [kg]."""
        return self._corrected("foot_mass")

    @property
    def M(self) -> float:
        """Mass of motor and rod [kg]."""
        return self.m_m + self.rod_mass

    @property
    def k_s(self) -> float:
        """Stiffness of the spring [N/m]."""
        return self._corrected("spring_stiffness")

    @property
    def c_s(self) -> float:
        """Damping of the spring [N s/m]."""
        return self._corrected("spring_damping")

    @property
    def g(self) -> float:
        """Gravity along the rail [m/s^2]."""
        return self._corrected("gravity")

    def shown(self, t: Array) -> Array:
        """When the frames stamped t (n,) [s] were really taken [s]."""
        return sum((self.force(m, time_s=t) for m in self.acting(Body.TIME)), t)

    def filmed(self, height: Array, t: Array) -> Array:
        """Heights above rest (n,) [m] as a camera reports them in the frames stamped t (n,) [s]."""
        laws = self.acting(Body.HEIGHT)
        rate = _rate(height, t) if any("h_rate" in m.asked for m in laws) else None
        return sum((self.force(m, h=height, h_rate=rate, time_s=t) for m in laws), height)

    @property
    def rates(self) -> list[Expression]:
        """Of the internal states of its terms."""
        return [m.rate for m in self.acting(*Body) if m.rate]

    @property
    def beds(self) -> set[str]:
        """What of BED the laws of its terms ask for."""
        asked = {n for t in self.terms for n in self.mechanism(t).asked}
        return {n for symbol, n in OF_BED.items() if symbol in asked and n in BED}

    @property
    def hold(self) -> float:
        """Dry friction of the rail [N], what it can hold the carriage by where it stands at rest."""
        at_rest = {"v_m": 1.0, "x_m": 0.0, "x_r": 0.0, "time_s": 0.0, "u": 0.0}
        return sum((abs(self.force(m, **at_rest)) for m in self.acting(Body.RAIL)), 0.0)

    @property
    def exact(self) -> bool:
        """Whether the closed-form flow of hard ground holds."""
        linear = (Body.ROBOT, Body.LANDING, Body.HEIGHT, Body.TIME)
        plain = len(self.acting(*linear)) == len(self.terms)
        return self.ground == "hard" and self.m_f == 0.0 and plain

    @property
    def spare_drag(self) -> float:
        """alpha + (b - 1/2) dm_a/dz at the surface [kg/m]: linear in dm_a/dz, which falls to 0 with depth."""
        drag, grown = self._at_surface
        return drag - 0.5 * grown

    @property
    def lacks_drag(self) -> Any:
        """Whether a mass that grows with depth would create energy, beyond rounding."""
        drag, grown = self._at_surface
        return drag - 0.5 * grown < -1e-12 * abs(drag)

    @property
    def _at_surface(self) -> tuple[Any, Any]:
        """Drag over v^2, and growth of the mass with depth [kg/m], where the foot enters the bed."""
        drags = [m.expression.root for m in self.acting(Body.DRAG) if m.expression]
        masses = [m.expression.root for m in self.acting(Body.INERTIA) if m.expression]
        for z in (0.0, 1e-6):  # m: a root of depth has no slope at 0
            with np.errstate(all="ignore"):
                drag = sum((self.value(x, z=z, v=1.0) for x in drags), 0.0)
                grown = sum((self.value(derivative(x, "z"), z=z) for x in masses), 0.0)
            if np.isfinite(grown).all():
                break
        return drag, grown

    def acting(self, *bodies: Body) -> tuple[Mechanism, ...]:
        """Its mechanisms that act on these, in the order of its terms."""
        own = {m.name: m for m in self.own if m.acts_on in bodies and m.name in self.terms}
        if not own:
            return _acting(self.terms, bodies)
        return tuple(m for t in self.terms if (m := own.get(t) or MECHANISMS.get(t)) and m.acts_on in bodies)

    def _corrected(self, name: str) -> float:
        value: float = getattr(self, name)
        for m in self.acting(Body.ROBOT):
            if m.corrects == name:
                value = value + self.symbol(m.names[0])
        return value

    def symbol(self, name: str) -> float:
        """Value of a parameter or of R, phi, rho by its symbol in a force law."""
        return getattr(self, OF_BED[name]) if name in OF_BED else getattr(self.parameters, name)

    def value(self, law: Node, xp: Any = np, **symbols: Any) -> Any:
        """Of a law's tree; symbols win over the model's own values. AttributeError names a symbol that lacks."""
        return python.value(law, xp, {n: symbols[n] if n in symbols else self.symbol(n) for n in law.symbols})

    def force(self, mechanism: Mechanism, xp: Any = np, **symbols: Any) -> Any:
        """The law of a mechanism in the unit of its body; of an inertia its force -m(z) a [N], positive up.

        symbols win over the model's own values. AttributeError names a symbol that lacks.
        """
        assert mechanism.expression is not None
        out = self.value(mechanism.expression.root, xp, **symbols)
        return -out * symbols["a"] if mechanism.acts_on is Body.INERTIA else out

    def forces(self, **state: ArrayLike) -> dict[str, NDArray[np.float64]]:
        """{mechanism: force [N], positive up} of every force law of the model on a measured track.

        state: the symbols of `record.STATE` that the laws ask for (and a, of an inertia), arrays (n,) or numbers. Laws
        of the ground hold while the foot intrudes: mask the rest. ValueError names a symbol that lacks.
        """
        arrays: dict[str, Array] = {n: np.asarray(x, float) for n, x in state.items()}
        out = {}
        for m in self.acting(*FORCES):
            for n in (*m.symbols, *(("a",) if m.acts_on is Body.INERTIA else ())):
                if n in STATE and n not in OF_BED and n not in arrays:
                    raise ValueError(f"forces: '{m.name}' needs {n}; give {n} = array")
            out[m.name] = np.asarray(self.force(m, **arrays))
        return out

    def __str__(self) -> str:
        def sum_of(sign: str, *bodies: Body) -> str:
            return "".join(f" {sign} {m.equation}" for m in self.acting(*bodies))

        lines = [
            f"{self.ground} ground",
            f"  M y'' = -M g + F_s{sum_of('-', Body.CARRIAGE, Body.RAIL)}",
            f"  F_s = -k stretch - c stretch'{sum_of('-', Body.SPRING)},  stretch = x_r - x_f",
        ]
        if self.ground == "granular":
            inertia = f"(m_f{added})" if (added := sum_of("+", Body.INERTIA)) else "m_f"
            lines.append(f"  {inertia} a_f = -(F_s + m_f g) + F_p{sum_of('+', Body.DRAG, Body.FOOT)}")
            lines.append(f"  F_p = {self.acting(Body.STATIC)[0].equation}{sum_of('+', Body.OVERSHOOT)}")
        lines.append(
            f"  m_m = {self.m_m:g} kg, m_r = {self.rod_mass:g} kg, m_f = {self.m_f:g} kg, k = {self.k_s:g} N/m, "
            f"c = {self.c_s:g} N s/m, g = {self.g:g} m/s^2"
        )
        fields = type(self.parameters).__dataclass_fields__
        for t in self.terms:
            values = ", ".join(
                f"{n} = {getattr(self.parameters, n):g} {fields[n].metadata['unit']}".strip()
                for n in self.mechanism(t).names
            )
            lines.append(f"  {t}: {values}")
        return "\n".join(lines)


BED = ("volume_fraction", "grain_density")
ROBOT = tuple(f.name for f in dataclasses.fields(Model) if f.name not in ("ground", "terms", "parameters", "own", *BED))
"""The numbers of a Model beside its parameters, by whose they are."""


@functools.lru_cache(1024)  # asked for dozens of times a simulation
def _acting(terms: tuple[str, ...], bodies: tuple[Body, ...]) -> tuple[Mechanism, ...]:
    return tuple(m for t in terms if (m := MECHANISMS.get(t)) and m.acts_on in bodies)


def _rate(height: Array, t: Array) -> Array:
    """Rate [m/s] of heights (n,) [m] in frames at t (n,) [s], of one film or of several, each after the other."""
    films = np.split(np.arange(t.size), np.flatnonzero(np.diff(t) <= 0.0) + 1)
    rates = [np.gradient(height[f], t[f]) if f.size > 1 else np.zeros(f.size) for f in films]
    return np.concatenate(rates)


def _range_problems(record: Any, where: str, names: Iterable[str]) -> Iterable[str]:
    for n in names:
        cls: type = type(record)
        value, f = getattr(record, n), record.__dataclass_fields__[n]
        hint, optional = type_of(cls, n)
        if value is None and optional:
            continue
        _, problem = check_value(value, hint, f.metadata)
        if problem:
            yield f"{where} {n} = {value!r}: {problem}"
