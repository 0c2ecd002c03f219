"""A jump as a nonlinear programme: phases of free duration, Radau collocation in each, a command of parabolas.

Unknowns: the duration of every phase, the states at its collocation points, and the command X_c, whose acceleration is
constant on an interval. A mode holds through its phase by inequalities, and changes where the event does
(docs/physics.md section 3): the foot yields at push = F_p, stops at v_f = 0, leaves at push = 0. So the set-valued
ground needs no smoothing. All unknowns and rows are scaled to about 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import casadi as ca
import numpy as np

from jumpvision.base.arrays import Array

from .jumper import AIR, INTRUDE, STUCK, Dynamics, Jumper, Memory, State

if TYPE_CHECKING:
    from .jumper import Value

OBJECTIVES = ("effort", "height", "power", "energy")
SCALE = {
    "y": 0.01,
    "w": 0.5,
    "X": 0.01,
    "V": 0.5,
    "x_f": 0.01,
    "v_f": 0.5,
    "x_c": 0.01,
    "v_c": 0.5,
    "a_c": 50.0,
    "T": 0.05,
    "low": 0.01,
    "peak": 10.0,
    "work": 10.0,
}
DEGREE = 3  # collocation points of an interval (Radau, of order 2 DEGREE - 1)
INTERVALS = {STUCK: 8, INTRUDE: 9, AIR: 6}
SHORTEST = 2e-3  # s, of a phase
MARGIN = 0.1  # of the weight by which a resting foot keeps from lifting or yielding before the end of its phase
SPAN = 0.05  # s, of a push-off: makes an integral of order 1
SMOOTH = 1e-4  # weight of the command's acceleration: picks one command among those of equal objective


@dataclass(frozen=True)
class Limits:
    """What a plan must keep beside its model: of the motor, and the time of the apex; infinite: not asked for."""

    max_force: float = math.inf  # N
    max_speed: float = math.inf  # m/s
    stroke: float = math.inf  # m
    max_power: float = math.inf  # W, F_m X_m'
    by: float = math.inf  # s

    def bounds(self) -> dict[str, tuple[float, float]]:
        """(low, high) of the rows of each limit that is finite."""
        table = {
            "force": (-self.max_force, self.max_force),
            "speed": (-self.max_speed, self.max_speed),
            "stroke": (0.0, self.stroke),
            "power": (-math.inf, self.max_power),
            "time": (0.0, self.by),
        }
        return {name: pair for name, pair in table.items() if pair[1] < math.inf}


@dataclass
class Row:
    """Bounds of one block of constraints; name: a limit, or '' for the jump's own equations."""

    name: str
    low: float
    high: float
    scale: float
    size: int


@dataclass
class Unknown:
    """Where a block of unknowns lies: its kind (a key of SCALE), phase and place in the phase (0 begin, 1 end)."""

    kind: str
    phase: int
    place: float


@dataclass(frozen=True)
class Guess:
    """A motion to start from: (begin, end) of each phase [s] and the values of the states and command at any times."""

    phases: Sequence[tuple[float, float]]
    sample: Callable[[Array], Mapping[str, Array]]


@dataclass
class Programme:
    """The programme's symbols; `build` fills it. apex [m] over rest, apex_time [s] and the objective's parts."""

    jumper: Jumper
    sequence: tuple[str, ...]
    objective: str
    rest: tuple[float, float]  # x_r, x_f [m] at rest
    limits: Limits  # those that are finite have rows, whose bounds may change from solve to solve
    finer: int = 1  # times as many intervals
    unknowns: list[Unknown] = field(default_factory=list)
    symbols: list[ca.SX] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    values: list[Value] = field(default_factory=list)

    def unknown(self, kind: str, phase: int, place: float) -> ca.SX:
        """A new scalar unknown in SI units."""
        self.unknowns.append(Unknown(kind, phase, place))
        self.symbols.append(ca.SX.sym(f"{kind}{phase}"))
        return SCALE[kind] * self.symbols[-1]

    def row(self, value: Value, low: float, high: float, scale: float, name: str = "") -> None:
        """low <= value <= high, in units of scale."""
        self.rows.append(Row(name, low, high, scale, 1))
        self.values.append(value / scale)

    @property
    def weight(self) -> float:
        """Of the robot [N]."""
        return (self.jumper.model.M + self.jumper.model.m_f) * self.jumper.model.g

    def intervals(self, mode: str) -> int:
        """Intervals of a phase."""
        # intervals on hard ground: one contact holds a whole push-off
        usual = 16 if mode == STUCK and self.jumper.model.ground == "hard" else INTERVALS[mode]
        return self.finer * usual

    def build(self) -> dict[str, Value]:
        """The programme {x, f, g} for `casadi.nlpsol`."""
        j = self.jumper
        self.low = self.unknown("low", 0, 0.0)
        self.peak: Value = self.unknown("peak", 0, 0.0) if self.objective == "power" else 0.0
        self.command: tuple[Value, Value] = (0.0, 0.0)
        self.totals: dict[str, Value] = dict.fromkeys(("heat", "smooth", "work"), 0.0)
        memory = Memory(floor=-self.rest[1])
        state = State(y=self.rest[0], w=0.0, X=0.0, V=0.0, x_f=self.rest[1], v_f=0.0)
        time: Value = 0.0
        apex: Value | None = None
        apex_time: Value
        for i, (mode, following) in enumerate(zip(self.sequence, (*self.sequence[1:], None))):
            duration, end = self._phase(i, mode, state, memory)
            time = time + duration
            state = state.then(end)
            e = j.equations(mode, end, (*self.command, 0.0), memory)
            if mode == AIR and following == AIR:
                apex, apex_time = self._turn(state, e), time
            elif following is not None:
                state, memory = self._change(mode, following, state, e, memory)
        self._stop(e)
        if apex is None:
            apex, apex_time = self._ballistic(state, time)
        else:
            self.row(e.push - self.weight, 0.0, 0.0, self.weight)
            self.row(e.rod_rate, 0.0, 0.0, SCALE["w"])
        self.apex, self.apex_time = apex, apex_time
        self.row(apex, -math.inf, math.inf, SCALE["y"], "apex")
        if self.limits.by < math.inf:
            self.row(apex_time, 0.0, self.limits.by, SCALE["T"], "time")
        return {"x": ca.vertcat(*self.symbols), "f": self._cost(), "g": ca.vertcat(*self.values)}

    def _phase(self, i: int, mode: str, state: State, memory: Memory) -> tuple[ca.SX, State]:
        """Duration [s] and states at the end of phase i, with its collocation equations and inequalities as rows."""
        tau = ca.collocation_points(DEGREE, "radau")
        C, _, B = (np.asarray(a, float) for a in ca.collocation_coeff(tau))
        names, n = self.jumper.states(mode), self.intervals(mode)
        duration = self.unknown("T", i, 0.0)
        h = duration / n
        at = ca.vertcat(*state.of(names))
        for k in range(n):
            (x_c, v_c), a_c = self.command, self.unknown("a_c", i, (k + 0.5) / n)
            points = [ca.vertcat(*(self.unknown(s, i, (k + c) / n) for s in names)) for c in tau]
            rates = []
            for c, b, point in zip(tau, B.ravel(), points):
                u, place = c * h, (k + c) / n
                command = (x_c + u * v_c + 0.5 * u * u * a_c, v_c + u * a_c, a_c)
                e = self.jumper.equations(mode, State(**dict(zip(names, ca.vertsplit(point)))), command, memory)
                rates.append(ca.vertcat(*e.rates))
                self._hold(mode, e, memory, place, k == n - 1)
                self._limit(e)
                self._spend(e, h * b, i, place)
            defects = ca.horzcat(at, *points) @ C - h * ca.horzcat(*rates)
            for r, s in enumerate(names):
                for col in range(DEGREE):
                    self.row(defects[r, col], 0.0, 0.0, SCALE[s])
            self.totals["smooth"] += h * (a_c / SCALE["a_c"]) ** 2
            at = points[-1]
            self.command = self.unknown("x_c", i, (k + 1) / n), self.unknown("v_c", i, (k + 1) / n)
            self.row(self.command[0] - x_c - h * v_c - 0.5 * h * h * a_c, 0.0, 0.0, SCALE["x_c"])
            self.row(self.command[1] - v_c - h * a_c, 0.0, 0.0, SCALE["v_c"])
        return duration, State(**dict(zip(names, ca.vertsplit(at))))

    def _spend(self, e: Dynamics, dt: ca.SX, phase: int, place: float) -> None:
        """Adds a point of weight dt [s] to the integrals of the objectives."""
        power = e.force * e.V
        self.totals["heat"] += dt * (e.force / self.weight) ** 2
        if self.objective == "power":
            self.row(power - self.peak, -math.inf, 0.0, SCALE["peak"])
        if self.objective == "energy":
            spent = self.unknown("work", phase, place)
            self.row(spent - power, 0.0, math.inf, SCALE["work"])
            self.totals["work"] += dt * spent

    def _cost(self) -> Value:
        """The objective, of order 1, with a little effort and smoothness where it leaves the command open."""
        heat, smooth = self.totals["heat"] / SPAN, self.totals["smooth"] / SPAN
        if self.objective == "effort":
            return heat + SMOOTH * smooth
        parts = {
            "power": self.peak / SCALE["peak"],
            "energy": self.totals["work"] / (0.02 * self.weight),
            "height": -self.apex / SCALE["y"],
        }
        return parts[self.objective] + SMOOTH * (heat + smooth)

    def _hold(self, mode: str, e: Dynamics, memory: Memory, place: float, late: bool) -> None:
        """The inequalities under which a mode lasts; its end is `_change`'s. late: in the last interval."""
        if mode == INTRUDE:
            # m/s in the middle: a foot that nearly stops meets forces that the model has not
            self.row(e.foot_rate, -math.inf, -0.05 * 4.0 * place * (1.0 - place), 0.5)
        if place == 1.0:
            return
        if mode == STUCK and self.jumper.massless:
            self.row(-e.rod, 0.0 if late else MARGIN * abs(self.rest[0]), math.inf, 0.01)
        elif mode == STUCK:
            self.row(e.push, 0.0 if late else MARGIN * self.weight, math.inf, self.weight)
            if self.jumper.model.ground == "granular":
                spare = self.jumper.yield_force(memory) - e.push
                self.row(spare, MARGIN * self.weight if memory.moved and not late else 0.0, math.inf, self.weight)
        elif mode == AIR:
            self.row(e.foot + memory.floor, 0.0, math.inf, 0.01)

    def _limit(self, e: Dynamics) -> None:
        """The motor's limits."""
        asked = self.limits.bounds()
        values = {
            "force": (e.force, self.weight),
            "speed": (e.V, 0.5),
            "stroke": (e.X - self.low, 0.01),
            "power": (e.force * e.V, 10.0),
        }
        for name, (value, scale) in values.items():
            if name in asked:
                self.row(value, *asked[name], scale, name)

    def _change(self, mode: str, following: str, state: State, e: Dynamics, memory: Memory) -> tuple[State, Memory]:
        """The event between two phases: its condition as a row, and state and memory behind it."""
        j = self.jumper
        m = j.model
        if mode == STUCK and following == INTRUDE:
            self.row(e.push - j.yield_force(memory), 0.0, 0.0, self.weight)
            return state._replace(x_f=-memory.floor, v_f=0.0), memory
        if mode == INTRUDE and following == STUCK:
            self.row(state.v_f, 0.0, 0.0, 0.5)
            floor = -state.x_f
            return state, Memory(floor, memory.hole, floor, j.left(floor, memory), True, memory.landed)
        if mode == STUCK and following == AIR:
            self.row(e.rod, 0.0, 0.0, 0.01) if j.massless else self.row(e.push, 0.0, 0.0, self.weight)
            left = Memory(memory.floor, memory.floor, moved=memory.moved, landed=True)
            return state._replace(x_f=-memory.floor, v_f=0.0), left
        if mode == AIR and following == INTRUDE:
            self.row(state.x_f + memory.floor, 0.0, 0.0, 0.01)
            return state._replace(v_f=state.v_f * m.m_f / j.foot_inertia(memory.floor)), memory
        if mode == AIR and following == STUCK and m.ground == "hard":
            self.row(e.foot if not j.massless else e.rod, 0.0, 0.0, 0.01)
            loss = m.parameters.e or 0.0 if "landing_loss" in m else 0.0
            return state._replace(w=state.w + (math.sqrt(1.0 - loss) - 1.0) * e.rod_rate), memory
        raise ValueError(f"phases: {mode} cannot be followed by {following} on {m.ground} ground")

    def _stop(self, e: Dynamics) -> None:
        """The command ends where it began, at rest, and the motor on it."""
        self.row(self.command[0], 0.0, 0.0, SCALE["x_c"])
        self.row(self.command[1], 0.0, 0.0, SCALE["v_c"])
        if self.jumper.drive.kp > 0 or self.jumper.lags:
            sag = self.jumper.sag() if self.sequence[-1] == AIR else 0.0
            self.row(e.X - sag, 0.0, 0.0, SCALE["X"])
        if self.jumper.drive.kp > 0:
            self.row(e.V, 0.0, 0.0, SCALE["V"])

    def _turn(self, state: State, e: Dynamics) -> Value:
        """Apex of the rod over rest [m] where the mass centre turns, with the motor at its place of rest: the rod's own
        height would count what the motor only pulls it up."""
        com, rate = self._whole(state)
        self.row(rate, 0.0, 0.0, SCALE["w"])
        self.row(e.X - self.jumper.sag(), 0.0, 0.0, SCALE["X"])
        return com - self.jumper.model.m_m / self.total * e.X - self.rest[0]

    @property
    def total(self) -> float:
        """Mass of the robot [kg]."""
        return self.jumper.model.M + self.jumper.model.m_f

    def _whole(self, state: State) -> tuple[Value, Value]:
        """Height and rate of the whole robot's mass centre."""
        if self.jumper.massless:
            return state.y, state.w
        m = self.jumper.model
        return (m.M * state.y + m.m_f * state.x_f) / self.total, (m.M * state.w + m.m_f * state.v_f) / self.total

    def _ballistic(self, state: State, time: Value) -> tuple[Value, Value]:
        """Apex of the rod over rest [m] and its time: free flight of the mass centre, spring and motor settled."""
        m, total = self.jumper.model, self.total
        y, w = self._whole(state)
        self.row(w, 0.0, math.inf, 0.5)
        drag = self.jumper.damping / total
        g = m.g + m.hold / total
        left: Value
        rise: Value
        if drag:
            left = ca.log(1.0 + drag * w / g) / drag
            rise = w / drag - g / drag * left
        else:
            left, rise = w / g, w * w / (2.0 * g)
        X = self.command[0] + self.jumper.sag()
        return y + rise - m.m_m / total * X - self.rest[0], time + left
