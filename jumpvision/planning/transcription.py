"""A jump as a nonlinear programme: phases of free duration, Radau collocation in each, a command of parabolas.

Unknowns: the duration of every phase, the states at its collocation points, and the command X_c, whose acceleration is
constant on an interval. A mode holds through its phase by inequalities, and changes where the event does
(PHYSICS.md section 1): the foot yields at push = F_p, stops at v_f = 0, leaves at push = 0. So the set-valued ground
needs no smoothing. All unknowns and rows are scaled to about 1.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray

from jumpvision.planning.jumper import AIR, INTRUDE, STUCK, Jumper, Memory

Array = NDArray[np.float64]

OBJECTIVES = ("effort", "height", "power", "energy")
SCALE = {"y": 0.01, "w": 0.5, "X": 0.01, "V": 0.5, "x_f": 0.01, "v_f": 0.5, "x_c": 0.01, "v_c": 0.5, "a_c": 50.0,
         "T": 0.05, "low": 0.01, "peak": 10.0, "work": 10.0}  # fmt: skip
DEGREE = 3  # collocation points of an interval (Radau, of order 2 DEGREE - 1)
INTERVALS = {STUCK: 8, INTRUDE: 9, AIR: 6}
ON_HARD = 16  # intervals of a contact with hard ground, which holds a whole push-off
SLOWEST = 0.05  # m/s in the middle of an intrusion: a foot that nearly stops meets forces that the model has not
SHORTEST = 2e-3  # s, of a phase
MARGIN = 0.1  # of the weight by which a resting foot keeps from lifting or yielding before the end of its phase
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
        table = {"force": (-self.max_force, self.max_force), "speed": (-self.max_speed, self.max_speed),
                 "stroke": (0.0, self.stroke), "power": (-math.inf, self.max_power),
                 "time": (0.0, self.by)}  # fmt: skip
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
    unknowns: list[Unknown] = field(default_factory=list)
    symbols: list[Any] = field(default_factory=list)
    rows: list[Row] = field(default_factory=list)
    values: list[Any] = field(default_factory=list)

    def unknown(self, kind: str, phase: int, place: float) -> Any:
        """A new scalar unknown in SI units."""
        self.unknowns.append(Unknown(kind, phase, place))
        self.symbols.append(ca.SX.sym(f"{kind}{phase}"))
        return SCALE[kind] * self.symbols[-1]

    def row(self, value: Any, low: float, high: float, scale: float, name: str = "") -> None:
        """low <= value <= high, in units of scale."""
        self.rows.append(Row(name, low, high, scale, 1))
        self.values.append(value / scale)

    def intervals(self, mode: str) -> int:
        """Intervals of a phase."""
        return ON_HARD if mode == STUCK and self.jumper.model.ground == "hard" else INTERVALS[mode]

    def build(self) -> dict[str, Any]:
        """The programme {x, f, g} for `casadi.nlpsol`."""
        j, m = self.jumper, self.jumper.model
        weight, span = (m.M + m.m_f) * m.g, 0.05
        tau = ca.collocation_points(DEGREE, "radau")
        C, _, B = (np.asarray(a, float) for a in ca.collocation_coeff(tau))
        low, peak = self.unknown("low", 0, 0.0), self.unknown("peak", 0, 0.0) if self.objective == "power" else None
        memory = Memory(floor=-self.rest[1])
        state: dict[str, Any] = dict.fromkeys(("w", "V", "v_f"), 0.0) | {
            "y": self.rest[0],
            "X": 0.0,
            "x_f": self.rest[1],
        }
        x_c, v_c, time, heat, smooth, work, apex = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, None
        for i, mode in enumerate(self.sequence):
            names, last = j.states(mode), i == len(self.sequence) - 1
            following = None if last else self.sequence[i + 1]
            duration = self.unknown("T", i, 0.0)
            n = self.intervals(mode)
            h = duration / n
            at = ca.vertcat(*(state[s] for s in names))
            for k in range(n):
                a_c = self.unknown("a_c", i, (k + 0.5) / n)
                points = [ca.vertcat(*(self.unknown(s, i, (k + c) / n) for s in names)) for c in tau]
                rates = []
                for c, b, point in zip(tau, B.ravel(), points):
                    u = c * h
                    command = (x_c + u * v_c + 0.5 * u * u * a_c, v_c + u * a_c, a_c)
                    now = dict(zip(names, ca.vertsplit(point)))
                    e = j.equations(mode, now, command, memory)
                    rates.append(ca.vertcat(*e["rates"]))
                    self._hold(mode, e, memory, weight, (k + c) / n, k == n - 1)
                    self._limit(e, low, weight)
                    power = e["force"] * e["V"]
                    if peak is not None:
                        self.row(power - peak, -math.inf, 0.0, SCALE["peak"])
                    if self.objective == "energy":
                        spent = self.unknown("work", i, (k + c) / n)
                        self.row(spent - power, 0.0, math.inf, SCALE["work"])
                        work += h * b * spent
                    heat += h * b * (e["force"] / weight) ** 2
                defects = ca.horzcat(at, *points) @ C - h * ca.horzcat(*rates)
                for r, s in enumerate(names):
                    for col in range(DEGREE):
                        self.row(defects[r, col], 0.0, 0.0, SCALE[s])
                smooth += h * (a_c / SCALE["a_c"]) ** 2
                at = points[-1]
                x, v = self.unknown("x_c", i, (k + 1) / n), self.unknown("v_c", i, (k + 1) / n)
                self.row(x - x_c - h * v_c - 0.5 * h * h * a_c, 0.0, 0.0, SCALE["x_c"])
                self.row(v - v_c - h * a_c, 0.0, 0.0, SCALE["v_c"])
                x_c, v_c = x, v
            time = time + duration
            state = state | dict(zip(names, ca.vertsplit(at)))
            e = j.equations(mode, {s: state[s] for s in names}, (x_c, v_c, 0.0), memory)
            if mode == AIR and following == AIR:
                self.row(e["rod_rate"], 0.0, 0.0, 0.5)
                apex, apex_time = e["rod"] - self.rest[0], time
            elif not last:
                state, memory = self._change(mode, str(following), state, e, memory, weight)
        end = e
        self._stop(end, x_c, v_c)
        if apex is None:
            apex, apex_time = self._ballistic(state, x_c, time)
        else:
            self.row(end["rod"] - self.rest[0], 0.0, 0.0, 0.01)
            self.row(end["rod_rate"], 0.0, 0.0, 0.5)
        self.row(apex, -math.inf, math.inf, 0.01, "apex")
        if self.limits.by < math.inf:
            self.row(apex_time, 0.0, self.limits.by, 0.05, "time")
        cost = {"effort": heat / span, "power": peak, "energy": work, "height": -apex / 0.01}[self.objective]
        if self.objective != "effort":
            cost = cost / {"power": SCALE["peak"], "energy": weight * 0.02, "height": 1.0}[self.objective]
            cost += SMOOTH * heat / span
        self.apex, self.apex_time = apex, apex_time
        return {"x": ca.vertcat(*self.symbols), "f": cost + SMOOTH * smooth / span, "g": ca.vertcat(*self.values)}

    def _hold(self, mode: str, e: Mapping[str, Any], memory: Memory, weight: float, place: float, late: bool) -> None:
        """The inequalities under which a mode lasts; its end is `_change`'s. late: in the last interval."""
        if mode == INTRUDE:
            self.row(e["foot_rate"], -math.inf, -SLOWEST * 4.0 * place * (1.0 - place), 0.5)
        if place == 1.0:
            return
        if mode == STUCK and self.jumper.massless:
            self.row(-e["rod"], 0.0 if late else MARGIN * abs(self.rest[0]), math.inf, 0.01)
        elif mode == STUCK:
            self.row(e["push"], 0.0 if late else MARGIN * weight, math.inf, weight)
            if self.jumper.model.ground == "granular":
                spare = self.jumper.static_force(memory.floor, memory) - e["push"]
                self.row(spare, MARGIN * weight if memory.moved and not late else 0.0, math.inf, weight)
        elif mode == AIR:
            self.row(e["foot"] + memory.floor, 0.0, math.inf, 0.01)

    def _limit(self, e: Mapping[str, Any], low: Any, weight: float) -> None:
        """The motor's limits."""
        asked = self.limits.bounds()
        values = {"force": (e["force"], weight), "speed": (e["V"], 0.5), "stroke": (e["X"] - low, 0.01),
                  "power": (e["force"] * e["V"], 10.0)}  # fmt: skip
        for name, (value, scale) in values.items():
            if name in asked:
                self.row(value, *asked[name], scale, name)

    def _change(
        self, mode: str, following: str, state: dict[str, Any], e: Mapping[str, Any], memory: Memory, weight: float
    ) -> tuple[dict[str, Any], Memory]:
        """The event between two phases: its condition as a row, and state and memory behind it."""
        j = self.jumper
        m = j.model
        if mode == STUCK and following == INTRUDE:
            self.row(e["push"] - j.static_force(memory.floor, memory), 0.0, 0.0, weight)
            return state | {"x_f": -memory.floor, "v_f": 0.0}, memory
        if mode == INTRUDE and following == STUCK:
            self.row(state["v_f"], 0.0, 0.0, 0.5)
            floor = -state["x_f"]
            return state, Memory(floor, memory.hole, floor, True, memory.landed)
        if mode == STUCK and following == AIR:
            self.row(e["rod"], 0.0, 0.0, 0.01) if j.massless else self.row(e["push"], 0.0, 0.0, weight)
            return state | {"x_f": -memory.floor, "v_f": 0.0}, Memory(
                memory.floor, memory.floor, 0.0, memory.moved, True
            )
        if mode == AIR and following == INTRUDE:
            self.row(state["x_f"] + memory.floor, 0.0, 0.0, 0.01)
            return state | {"v_f": state["v_f"] * m.m_f / j.foot_inertia(memory.floor)}, memory
        if mode == AIR and following == STUCK and m.ground == "hard":
            self.row(e["foot"] if not j.massless else e["rod"], 0.0, 0.0, 0.01)
            loss = m.parameters.e or 0.0 if "landing_loss" in m else 0.0
            return state | {"w": state["w"] + (math.sqrt(1.0 - loss) - 1.0) * e["rod_rate"]}, memory
        raise ValueError(f"phases: {mode} cannot be followed by {following} on {m.ground} ground")

    def _stop(self, e: Mapping[str, Any], x_c: Any, v_c: Any) -> None:
        """The command ends where it began, at rest, and the motor on it."""
        self.row(x_c, 0.0, 0.0, SCALE["x_c"])
        self.row(v_c, 0.0, 0.0, SCALE["v_c"])
        if self.jumper.drive.kp > 0 or "motor_lag" in self.jumper.model:
            sag = self.jumper.sag() if self.sequence[-1] == AIR else 0.0
            self.row(e["X"] - sag, 0.0, 0.0, SCALE["X"])
        if self.jumper.drive.kp > 0:
            self.row(e["V"], 0.0, 0.0, SCALE["V"])

    def _ballistic(self, state: Mapping[str, Any], x_c: Any, time: Any) -> tuple[Any, Any]:
        """Apex of the rod over rest [m] and its time: free flight of the mass centre, spring and motor settled."""
        m = self.jumper.model
        total = m.M + m.m_f
        y, w = state["y"], state["w"]
        if not self.jumper.massless:
            y, w = (m.M * y + m.m_f * state["x_f"]) / total, (m.M * w + m.m_f * state["v_f"]) / total
        self.row(w, 0.0, math.inf, 0.5)
        drag = m.parameters.c_v / total if "viscous_friction" in m and m.parameters.c_v else 0.0
        if drag:
            left = ca.log(1.0 + drag * w / m.g) / drag
            rise = w / drag - m.g / drag * left
        else:
            left, rise = w / m.g, w * w / (2.0 * m.g)
        X = x_c + self.jumper.sag()
        return y + rise - m.m_m / total * X - self.rest[0], time + left
