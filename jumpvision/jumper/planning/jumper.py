"""The jumper's equations of motion in symbols, one mode at a time, from the laws of its mechanisms.

State [y, w(, X(, V))(, x_f, v_f)] as in `physics.sand.granular`: y = x_r + (m_m/M) X_m the centre of mass of motor and
rod, w its rate; X, V the motor's position and rate where a feedback loop drives it, X alone where it lags its command;
the foot where it moves by itself. Modes: STUCK (foot at rest on the ground), INTRUDE, AIR.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, NamedTuple

from jumpvision.base.schema import InputError
from jumpvision.engine.laws.derivative import derivative
from jumpvision.engine.laws.tree import Node, smooth
from jumpvision.jumper.mechanisms.record import FORCES, Body, Mechanism
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import equilibrium
from jumpvision.jumper.physics.sand.laws import REST, left_over, motor_of, static

if TYPE_CHECKING:
    import casadi as ca

    Value = float | ca.SX  # a number, or a symbol of CasADi

STUCK, INTRUDE, AIR = "stuck", "intrude", "air"
SLIP = 0.01  # m/s, over which the rail's Coulomb friction changes its sign


@dataclass(frozen=True)
class Drive:
    """Gains of the motor's feedback loop; kp = 0: none, the motor is where its command says."""

    kp: float = 0.0  # N/m
    kd: float = 0.0  # N s/m


@dataclass(frozen=True)
class Memory:
    """What the ground remembers: depths [m] of the hole's floor, of the last lift-off and the last pause (0: none)."""

    floor: Value
    hole: Value = 0.0
    pause: Value = 0.0
    left: Value = 0.0  # m, of the overshoots before the last pause (`record.STATE`'s z_left)
    moved: bool = False  # the foot has intruded before
    landed: bool = False  # the foot has left the ground before


class State(NamedTuple):
    """One state by the names of the equations, SI; CasADi's symbols or numbers, None what a mode does not have.

    y, w: the centre of mass of motor and rod and its rate; X, V: the motor on the rod; x_f, v_f: the foot.
    """

    y: Value
    w: Value
    X: Any = None
    V: Any = None
    x_f: Any = None
    v_f: Any = None

    def of(self, names: Iterable[str]) -> list[Value]:
        """The states of these names, in their order."""
        return [getattr(self, n) for n in names]

    def then(self, later: State) -> State:
        """The later state, and of this what that does not have."""
        return State(*(a if b is None else b for a, b in zip(self, later)))


class Dynamics(NamedTuple):
    """What the equations of motion give in one state; SI, up positive."""

    rates: list[Value]  # of the states, in their order
    rod: Value
    rod_rate: Value
    foot: Value
    foot_rate: Value
    X: Value  # of the motor on the rod
    V: Value
    force: Value  # F_m
    push: Value  # on the ground


@dataclass(frozen=True)
class Jumper:
    """A model with its motor. xp: namespace of the laws' values, numpy or `engine.laws.symbolic.NAMESPACE`.

    Its laws have signs smooth over SLIP, and sizes over round_off [m, m/s] where it is given: a solver asks for
    derivatives.
    """

    model: Model
    drive: Drive
    xp: Any
    round_off: float = 0.0

    @property
    def massless(self) -> bool:
        return self.model.m_f == 0.0

    def states(self, mode: str) -> tuple[str, ...]:
        """Names of the states in a mode."""
        motor = ("X", "V") if self.drive.kp > 0 else ("X",) if self.lags else ()
        foot = ("x_f", "v_f") if mode == INTRUDE or (mode == AIR and not self.massless) else ()
        return ("y", "w", *motor, *foot)

    def sag(self) -> float:
        """X_m - command [m] of the loop in free flight, where its feed-forward m_m g carries nothing."""
        return self.model.m_m * self.model.g / self.drive.kp if self.drive.kp > 0 else 0.0

    @property
    def mechanisms(self) -> list[Mechanism]:
        """Of the model's terms."""
        return [self.model.mechanism(t) for t in self.model.terms]

    @property
    def lags(self) -> bool:
        """Whether a law says how the motor follows its command."""
        return bool(self.model.acting(Body.MOTOR))

    def tree(self, m: Mechanism) -> Node:
        """The law of a mechanism with derivatives."""
        assert m.expression is not None
        return smooth(m.expression.root, self.round_off, SLIP)

    def sum_of(self, *bodies: Body, **symbols: Value) -> Value:
        """Of the laws on these bodies, in their unit; symbols win over the model's parameters."""
        return sum((self.model.value(self.tree(m), self.xp, **symbols) for m in self.model.acting(*bodies)), 0.0)

    def __post_init__(self) -> None:
        if drives := self.model.acting(Body.DRIVE):
            raise InputError([f"model terms: '{drives[0].name}' is not planned with; leave it out of the model"])
        for m in self.model.acting(*FORCES, Body.MOTOR):
            if unknown := sorted({"contact_s", "time_s", "u"} & m.asked):
                raise InputError(
                    [
                        f"plan: the law of '{m.name}' depends on {', '.join(unknown)}, which a plan does not follow; "
                        "leave it out of the model to be planned with"
                    ]
                )

    @cached_property
    def rest(self) -> float:
        """x_r of the robot at rest [m]."""
        return equilibrium(self.model)[0]

    def rail(self, v_m: Value, x_r: Value, X: Value) -> Value:
        """Force of the rail on the carriage [N]; where it jumps at rest, smooth over SLIP for its set-valued law.

        The re-simulation has that.
        """
        return self.sum_of(Body.CARRIAGE, Body.RAIL, v_m=v_m, x_r=x_r, x_m=x_r + X - self.rest)

    @cached_property
    def damping(self) -> float:
        """Of the laws of the rail in proportion to the carriage's speed [N s/m]."""
        slopes = [derivative(self.tree(m), "v_m") for m in self.model.acting(Body.CARRIAGE)]
        return -sum(self.model.value(x) for x in slopes if not x.symbols & {*Body.CARRIAGE.symbols})

    def static_force(self, z: Value, memory: Memory) -> Value:
        """F_p(z) [N] with its overshoots, also the yield threshold."""
        hole = memory.hole if memory.landed else 0.0
        force = self.model.value(self._static, self.xp, z=z, z_g=hole)
        return force + self.sum_of(Body.OVERSHOOT, z=z, z_g=hole, z_stop=memory.pause, z_left=memory.left)

    @cached_property
    def _static(self) -> Node:
        return smooth(static(self.mechanisms), self.round_off, SLIP)

    def left(self, z: Value, memory: Memory) -> Value:
        """`z_left` of a pause at z [m]."""
        law = left_over(self.mechanisms)
        given = {"z": z, "z_stop": memory.pause, "z_left": memory.left}
        return self.model.value(law, self.xp, **given) if law else 0.0

    def yield_force(self, memory: Memory) -> Value:
        """What the ground carries at the floor before the foot moves [N]: own laws too, as motion begins."""
        given = {"z": memory.floor, "v": -REST, "z_g": memory.hole, "z_stop": memory.pause, "z_left": memory.left}
        return self.static_force(memory.floor, memory) + self.sum_of(Body.FOOT, **given)

    def foot_inertia(self, z: Value) -> Value:
        """m_f + m_a(z) [kg]."""
        return self.model.m_f + self.sum_of(Body.INERTIA, z=z)

    def equations(self, mode: str, s: State, command: tuple[Value, Value, Value], memory: Memory) -> Dynamics:
        """Rates of the states, positions, motor force and push; command: X_c [m], X_c' [m/s], X_c'' [m/s^2]."""
        m, d = self.model, self.drive
        x_c, v_c, a_c = command
        if d.kp > 0:
            X, V = s.X, s.V
        elif self.lags:
            X, V = s.X, v_c + self.sum_of(Body.MOTOR, X=s.X, X_c=x_c, V_c=v_c)
        else:
            X, V = x_c, v_c
        ratio = m.m_m / m.M
        x_r, v_r = s.y - ratio * X, s.w - ratio * V
        v_m = v_r + V
        free = mode == AIR and self.massless
        x_f = x_r if free else -memory.floor if s.x_f is None else s.x_f
        v_f = v_r if free else 0.0 if s.v_f is None else s.v_f
        stretch = x_r - x_f
        force = (
            0.0
            if free
            else -m.k_s * stretch
            - m.c_s * (v_r - v_f)
            + self.sum_of(Body.SPRING, stretch=stretch, stretch_rate=v_r - v_f)
        )
        rail = self.rail(v_m, x_r, X)
        w_rate = -m.g + (force + rail) / m.M
        if d.kp > 0:
            effort = d.kp * (x_c - X) + d.kd * (v_c - V) + m.m_m * m.g
            a = effort * m.M / (m.m_m * m.rod_mass) + rail / m.m_m - force / m.rod_mass
        else:
            a = self._acceleration(s.X, command) if self.lags else a_c
            effort = m.m_m * (w_rate + m.rod_mass / m.M * a + m.g) - rail
        rates = State(y=s.w, w=w_rate, X=V, V=a, x_f=v_f, v_f=0.0)
        push = force + m.m_f * m.g
        if mode == AIR and not free:
            rates = rates._replace(v_f=-push / m.m_f)
        elif mode == INTRUDE:
            z = -x_f
            resist = self.static_force(z, memory)
            # a solver's iterates leave the ground, where a law such as exp(-z / l) overflows
            given = {"z_g": memory.hole, "z_stop": memory.pause, "z_left": memory.left}
            resist += self.sum_of(Body.DRAG, Body.FOOT, z=self.xp.maximum(z, 0.0), v=v_f, **given)
            rates = rates._replace(v_f=(resist - push) / self.foot_inertia(z))
        return Dynamics(
            rates=rates.of(self.states(mode)),
            rod=x_r,
            rod_rate=v_r,
            foot=x_f,
            foot_rate=v_f,
            X=X,
            V=V,
            force=effort,
            push=push,
        )

    def _acceleration(self, X: Value, command: tuple[Value, Value, Value]) -> Value:
        """X_m'' of a motor that follows its command by laws."""
        given = dict(zip(("X_c", "V_c", "A_c"), command))
        return self.model.value(motor_of(self.mechanisms)[1], self.xp, X=X, **given)
