"""The laws of a model as machine code that the integrator calls: a few functions, from the trees of its mechanisms.

The integrator itself is compiled once for all models and names no mechanism; a law that is new costs some milliseconds.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Sequence
from dataclasses import dataclass

from jumpvision.engine.laws.compiled import Module, Routine, module
from jumpvision.engine.laws.derivative import derivative, kinks
from jumpvision.engine.laws.tree import (
    ONE,
    ZERO,
    Node,
    Step,
    add,
    jumps_in,
    mul,
    negative,
    number,
    smooth,
    symbol,
    total,
    where,
    with_symbols,
)
from jumpvision.jumper.mechanisms.record import BED, Body, Mechanism

GROUND = ("z", "v", "z_g", "z_stop", "z_left", "contact_s", "time_s", "u")
RAIL = ("v_m", "x_m", "x_r", "time_s", "u")
SPRING = ("stretch", "stretch_rate", "u")
MOTOR = ("X_c", "V_c", "A_c", "X", "time_s")
ALL = ("z", "v", "z_g", "z_stop", "z_left", "contact_s", "v_m", "x_m", "x_r", "stretch", "stretch_rate", "time_s", "u")
WHEN = ("intrudes", "sliding", "pulling")
"""What the energy ledger asks for behind ALL: 1.0 while the laws of the ground act; v_m [m/s] and the rate of extension
[m/s] while those of rail and spring do, else 0. A law that jumps at v_m = 0 is asked on the side that it is on."""
NUMBERS = 96  # constants of a model's laws with what is made of them: all built-in laws together have 32
BENDS = 4  # depths at which laws of the ground bend, of those that act together
LOSSES = 24  # laws of a model that take energy
REST = 1e-30  # m/s, of a direction without a speed
LAG = "motor_lag"  # by itself it is followed in closed form (`granular.lagged`)
_OF_GROUND = (Body.STATIC, Body.OVERSHOOT, Body.DRAG, Body.FOOT)
_OF_RAIL = (Body.CARRIAGE, Body.RAIL)


@dataclass(frozen=True)
class Laws:
    """What the integrator must know of the laws of some mechanisms.

    addresses: field of a packed model -> routine, 0 where there is none. lost: whose energies the routine `losses`
    gives, in its order. ages: whether what the ground carries changes while nothing moves.
    """

    module: Module
    addresses: dict[str, int]
    lost: tuple[str, ...]
    ages: bool


_compiled_laws: dict[tuple[bool, tuple[Hashable, ...]], Laws] = {}


def laws_of(mechanisms: Sequence[Mechanism], sand: bool) -> Laws:
    """Of a model with these mechanisms, on a bed or on hard ground. ValueError where there are too many."""
    key = sand, tuple(m.key for m in mechanisms)
    if key not in _compiled_laws:
        _compiled_laws[key] = _compiled(mechanisms, sand)
    return _compiled_laws[key]


def tree(m: Mechanism) -> Node:
    """The law of a mechanism as the integrator has it."""
    assert m.expression is not None
    # m/s: a sign is x / hypot(x, 1e-3) in a law of the spring, for nothing holds the spring at rest
    return smooth(m.expression.root, 0.0, 1e-3) if m.acts_on is Body.SPRING else m.expression.root


def steady(m: Mechanism) -> bool:
    """Whether a law of the rail is one number while the carriage slides one way."""
    return not {*m.symbols} & {*RAIL[1:]} and derivative(tree(m), "v_m") == ZERO


def elastic(m: Mechanism) -> bool:
    """Whether a law of the spring depends on its extension alone, and so gives back all that it takes."""
    return m.acts_on is Body.SPRING and not {*m.symbols} & {"stretch_rate", "u"}


def _on(mechanisms: Iterable[Mechanism], *bodies: Body) -> list[Mechanism]:
    return [m for body in bodies for m in mechanisms if m.acts_on is body and m.expression]


def static(mechanisms: Sequence[Mechanism]) -> Node:
    """F_p(z), its parameters as they are under an earlier footprint where there is one."""
    stiffer: dict[str, Node] = {}
    for m in mechanisms:
        for n in m.scales if m.acts_on is Body.BED else ():
            factor = where(Node(Step.GT, (symbol("z_g"), ZERO)), symbol(m.names[0]), ONE)
            stiffer[n] = mul(factor, stiffer.get(n, symbol(n)))
    return total(with_symbols(tree(m), stiffer) for m in _on(mechanisms, Body.STATIC))


def left_over(mechanisms: Sequence[Mechanism]) -> Node | None:
    """z_left at the next pause: what is left of the overshoot that has it, with a strength of 1. None: nothing has."""
    laws = [m for m in _on(mechanisms, Body.OVERSHOOT) if "z_left" in m.symbols]
    return total(with_symbols(tree(m), {m.names[0]: ONE}) for m in laws) if laws else None


def _losses(mechanisms: Sequence[Mechanism]) -> dict[str, Node]:
    """Power [W] that each law takes out of the jumper; grains that join at the foot's speed bring half their energy."""
    speed, half = negative(symbol("v")), number(0.5)
    cube = mul(mul(symbol("v"), symbol("v")), symbol("v"))
    ground: dict[str, Node] = {}
    for m in _on(mechanisms, Body.STATIC):
        ground[m.name] = mul(static(mechanisms), speed)
    for m in _on(mechanisms, *_OF_GROUND[1:]):
        ground[m.name] = mul(tree(m), speed)
    for m in _on(mechanisms, Body.INERTIA):
        ground[m.name] = mul(mul(half, derivative(tree(m), "z")), cube)
    out = {n: where(Node(Step.GT, (symbol("intrudes"), ZERO)), power, ZERO) for n, power in ground.items()}
    out |= {m.name: negative(mul(tree(m), symbol("sliding"))) for m in _on(mechanisms, *_OF_RAIL)}
    springs = [m for m in _on(mechanisms, Body.SPRING) if not elastic(m)]
    return out | {m.name: negative(mul(tree(m), symbol("pulling"))) for m in springs}


def motor_of(mechanisms: Sequence[Mechanism]) -> tuple[Node, Node]:
    """Rate and acceleration of the motor on the rod by its laws, in MOTOR's symbols."""
    rate = add(symbol("V_c"), total(map(tree, _on(mechanisms, Body.MOTOR))))
    along = {"X_c": symbol("V_c"), "V_c": symbol("A_c"), "X": rate, "time_s": ONE}
    return rate, total(mul(derivative(rate, n), by) for n, by in along.items())


def _routines(mechanisms: Sequence[Mechanism], sand: bool, constants: Sequence[str]) -> dict[str, Routine]:
    out: dict[str, Routine] = {}
    if sand:
        force = add(static(mechanisms), total(map(tree, _on(mechanisms, *_OF_GROUND[1:]))))
        mass = total(map(tree, _on(mechanisms, Body.INERTIA)))
        out["ground"] = Routine(GROUND, (force, mass))
        depths = dict.fromkeys((*kinks(force, "z", constants), *kinks(mass, "z", constants)))
        if depths:  # without those beyond BENDS a step is as long as its error allows
            out["kinks"] = Routine((), tuple(depths)[:BENDS], True)
        if left := left_over(mechanisms):
            out["left"] = Routine(("z", "z_stop", "z_left"), (left,))
    if rail := _on(mechanisms, *_OF_RAIL):
        out["rail"] = Routine(RAIL, (total(map(tree, rail)),))
    if springs := _on(mechanisms, Body.SPRING):
        force = total(map(tree, springs))
        out["spring"] = Routine(SPRING, (force,))
        out["spring_slope"] = Routine(SPRING, (derivative(force, "stretch"),))
    motors = _on(mechanisms, Body.MOTOR)
    if motors and [m.name for m in motors] != [LAG]:
        out["drive"] = Routine(MOTOR, motor_of(mechanisms))
    if rates := [m.rate.root for m in mechanisms if m.rate]:
        out["inner"] = Routine(ALL, tuple(rates))
    if losses := _losses(mechanisms):
        out["losses"] = Routine((*ALL, *WHEN), tuple(losses.values()), True)
    return out


ROUTINES = ("prepare", "ground", "kinks", "left", "rail", "spring", "spring_slope", "drive", "inner", "losses")


def _compiled(mechanisms: Sequence[Mechanism], sand: bool) -> Laws:
    acting = [m for m in mechanisms if m.expression or m.acts_on is Body.BED]
    constants = tuple(dict.fromkeys([*(n for m in acting for n in m.names), *BED]))
    lost = tuple(_losses(mechanisms))
    if len(lost) > LOSSES:
        raise ValueError(f"{len(lost)} laws act in this model; at most {LOSSES}: take some out")
    code = module(constants, _routines(mechanisms, sand, constants))
    if code.size > NUMBERS:
        raise ValueError(f"the laws of this model hold more than {NUMBERS} numbers; write shorter ones")
    ages = any({*m.symbols} & {"contact_s", "time_s", "u"} for m in _on(mechanisms, Body.FOOT))
    return Laws(code, {n: code.address.get(n, 0) for n in ROUTINES}, lost, ages)


def dry(m: Mechanism) -> bool:
    """Whether a law of the rail holds the carriage: it jumps where that rests."""
    return m.acts_on in _OF_RAIL and jumps_in(tree(m), "v_m")
