"""Solving a transcribed jump: IPOPT with exact derivatives, warm from an earlier solution or cold from a guess.

The guess is a sinusoidal thrust that the simulator carries out, cut at its events into the plan's phases.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.jumper.physics.forcing import Forcing, Loop, Segments, Spline, sinusoid
from jumpvision.jumper.physics.sand.jump import simulate

from .jumper import AIR, INTRUDE, STUCK, Jumper
from .transcription import SCALE, SHORTEST, Guess, Limits, Programme

END = {
    STUCK: {AIR: "lift_off", INTRUDE: "intrude"},
    INTRUDE: {STUCK: "stop"},
    AIR: {STUCK: "landing", INTRUDE: "landing"},
}
STEP = 5e-4  # s
ONE_THRUST = ((1, 1.0, (0.8, 1.2, 0.6, 1.6)), (1, 1.6, (0.8, 1.2, 1.6)))  # cycles, size, paces (of the spring's)
PUMPED = ((2, 0.3, (0.8, 1.0, 1.2)), (3, 0.3, (0.8, 1.0)))


def starts(jumper: Jumper, apex: float, stroke: float) -> Iterator[Segments]:
    """Commands to start from, 24, the likeliest first: one thrust with or without a pull, then two or three in a row.

    X_c = A [sin(2 pi f t + phase) - sin(phase)]; the first amplitude gives about the apex [m]. On hard ground, and
    under a power limit, the highest jumps pump the spring over some cycles, which no start from one thrust finds.
    """
    m = jumper.model
    rate = math.sqrt(m.k_s / m.M)
    usual = min(0.7 * math.sqrt(2.0 * m.g * apex) / rate, 0.45 * stroke)
    for cycles, size, paces in ONE_THRUST[:1] + PUMPED + ONE_THRUST[1:]:
        for pace in paces:
            for phase in (1.5 * math.pi, 0.5 * math.pi):  # rad: a single thrust, and a pull before it
                yield sinusoid(pace * rate / (2 * math.pi), min(size * usual, 0.5 * stroke), phase, cycles)


def falling(gravity: float, apex: float = 0.05) -> float:  # m, of a jump
    """Time [s] in which a jump is surely over under weak gravity: three of its falls."""
    return 3.0 * math.sqrt(2.0 * apex / gravity)


def guessed(jumper: Jumper, sequence: tuple[str, ...], command: Forcing) -> Guess:
    """The guess that a command makes: its simulated motion, cut at the events into the phases of the sequence.

    An event that does not come in order gives its phase the shortest duration.
    """
    d, m = jumper.drive, jumper.model
    swing = 2 * math.pi * math.sqrt(m.M / m.k_s)
    t = np.arange(0.0, command.stop + max(3 * swing, falling(m.g)), STEP)
    motion = simulate(m, Loop(command, d.kp, d.kd) if d.kp > 0 else command, t=t, rtol=1e-7, atol=1e-9)
    X = motion.motor - motion.rod
    speed, ratio = np.gradient(X, t), m.m_m / m.M

    def sample(at: Array) -> Mapping[str, Array]:
        x_c, v_c = command(at)
        a_c = (command(at + STEP)[1] - command(np.maximum(at - STEP, 0.0))[1]) / (2 * STEP)
        x, v, rod, rod_rate, x_f, v_f = (
            np.interp(at, t, a) for a in (X, speed, motion.rod, motion.rod_velocity, motion.foot, motion.foot_velocity)
        )
        return {
            "y": rod + ratio * x,
            "w": rod_rate + ratio * v,
            "X": x,
            "V": v,
            "x_f": x_f,
            "v_f": v_f,
            "x_c": x_c,
            "v_c": v_c,
            "a_c": a_c,
        }

    phases: list[tuple[float, float]] = []
    now, first = 0.0, 0
    for mode, following in zip(sequence, (*sequence[1:], None)):
        end = now + SHORTEST
        if following is None:
            end = max(command.stop, now + 0.5 * swing)
        elif mode == AIR and following == AIR:
            falls = np.flatnonzero((t > now) & (motion.rod_velocity <= 0))
            end = max(float(t[falls[0]]) if falls.size else 0.0, end)
        else:
            for n in range(first, len(motion.events)):
                if motion.events[n]["kind"] == END[mode][following]:
                    end, first = max(float(motion.events[n]["time"]), end), n + 1
                    break
        phases.append((now, end))
        now = end
    return Guess(phases, sample)


LONGEST = 3.0  # of a phase, in periods of the spring
WIDEST = 1.0  # m, travel where no stroke is given
OPTIONS: dict[str, Any] = {
    "print_time": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.tol": 1e-7,
    "ipopt.max_iter": 250,
    "ipopt.mu_strategy": "adaptive",
    "ipopt.mumps_pivot_order": 6,  # QAMD: 10 % less time an iteration than the automatic choice, and fewer iterations
    "ipopt.acceptable_tol": 1e-5,
    "ipopt.acceptable_iter": 8,
}
WARM = {
    "ipopt.warm_start_init_point": "yes",
    "ipopt.warm_start_bound_push": 1e-7,
    "ipopt.warm_start_mult_bound_push": 1e-7,
    "ipopt.warm_start_slack_bound_push": 1e-7,
}
# least effort: a small barrier at once; the adaptive one took 118 iterations at worst, this 25
SMALL = {"ipopt.mu_init": 1e-5, "ipopt.mu_strategy": "monotone"}


@dataclass(frozen=True)
class Solution:
    """A solved programme. command: X_c from 0 on; phases: mode and end [s]; apex [m] and its time [s] as planned."""

    solved: bool
    status: str
    x: Array
    multipliers: tuple[Array, Array]
    command: Spline
    durations: Array
    apex: float
    apex_time: float
    active: tuple[str, ...]
    iterations: int
    seconds: float
    cost: float  # of the objective


class Solver:
    """A programme built once, to be solved for any apex and limits. build_s: time that took [s]."""

    def __init__(self, programme: Programme):
        began = time.perf_counter()
        self.programme = programme
        nlp = programme.build()
        self._cold = ca.nlpsol("plan", "ipopt", nlp, OPTIONS)
        shared = {
            "grad_f": self._cold.get_function("nlp_grad_f"),
            "jac_g": self._cold.get_function("nlp_jac_g"),
            "hess_lag": self._cold.get_function("nlp_hess_l"),
        }
        small = SMALL if programme.objective == "effort" else {}
        self._warm = ca.nlpsol("plan", "ipopt", nlp, OPTIONS | WARM | small | shared)
        self._apex = ca.Function("apex", [nlp["x"]], [programme.apex, programme.apex_time])
        kinds = [u.kind for u in programme.unknowns]
        self.scale = np.array([SCALE[k] for k in kinds])
        self.places = {k: np.flatnonzero([kind == k for kind in kinds]) for k in SCALE}
        self.names = np.array([r.name for r in programme.rows])
        self.build_s = time.perf_counter() - began

    def solve(
        self, apex: float | None, limits: Limits, *, guess: Guess | None = None, warm: Solution | None = None
    ) -> Solution:
        """The plan for an apex [m] (None: whatever the objective makes of it)."""
        began = time.perf_counter()
        bounds = self._bounds(apex, limits)
        if warm is not None:
            r = self._warm(x0=warm.x, lam_x0=warm.multipliers[0], lam_g0=warm.multipliers[1], **bounds)
            stats = self._warm.stats()
        else:
            assert guess is not None
            r = self._cold(x0=self.pack(guess), **bounds)
            stats = self._cold.stats()
        return self._solution(r, bounds, limits, stats, time.perf_counter() - began)

    def pack(self, guess: Guess) -> Array:
        """The guess as unknowns."""
        out = np.zeros(len(self.scale))
        unknowns = self.programme.unknowns
        begin, end = np.array(guess.phases).T
        which = np.array([u.phase for u in unknowns])
        at = begin[which] + (end - begin)[which] * np.array([u.place for u in unknowns])
        values = guess.sample(at)
        for kind, i in self.places.items():
            if kind in values:
                out[i] = values[kind][i]
        out[self.places["T"]] = end - begin
        out[self.places["low"]] = float(np.min(values["X"]))
        out[self.places["peak"]] = 50.0
        out[self.places["work"]] = 1.0
        return out / self.scale

    def _bounds(self, apex: float | None, limits: Limits) -> dict[str, Array]:
        p = self.programme
        swing = 2 * math.pi * math.sqrt(p.jumper.model.M / p.jumper.model.k_s)
        lbx, ubx = np.full(len(self.scale), -math.inf), np.full(len(self.scale), math.inf)
        stroke = min(limits.stroke, WIDEST)
        for kind, least, most in (("T", SHORTEST, LONGEST * swing), ("low", -stroke, 0.0), ("work", 0.0, math.inf)):
            lbx[self.places[kind]], ubx[self.places[kind]] = least, most
        flights = [i for i in self.places["T"] if p.sequence[p.unknowns[i].phase] == AIR]
        ubx[flights] = max(LONGEST * swing, falling(p.jumper.model.g, WIDEST if apex is None else apex))
        table = limits.bounds() | {"apex": (-math.inf, math.inf) if apex is None else (apex, apex)}
        low = np.array([table[r.name][0] if r.name else r.low for r in p.rows])
        high = np.array([table[r.name][1] if r.name else r.high for r in p.rows])
        scale = np.array([r.scale for r in p.rows])
        return {"lbx": lbx / self.scale, "ubx": ubx / self.scale, "lbg": low / scale, "ubg": high / scale}

    def _solution(
        self, r: dict[str, ca.DM], bounds: dict[str, Array], limits: Limits, stats: dict[str, Any], seconds: float
    ) -> Solution:
        x, g = np.asarray(r["x"]).ravel(), np.asarray(r["g"]).ravel()
        v = x * self.scale
        T = v[self.places["T"]]
        intervals = [self.programme.intervals(mode) for mode in self.programme.sequence]
        steps = np.concatenate([np.full(n, duration / n) for n, duration in zip(intervals, T)])
        knots = np.concatenate([[0.0], np.cumsum(steps)])
        x_c = np.concatenate([[0.0], v[self.places["x_c"]]])
        v_c = np.concatenate([[0.0], v[self.places["v_c"]]])
        a_c = v[self.places["a_c"]]
        command = Spline(knots, np.array([np.zeros_like(a_c), 0.5 * a_c, v_c[:-1], x_c[:-1]]))
        active = []
        for name in limits.bounds():
            rows = self.names == name
            low, high = bounds["lbg"][rows], bounds["ubg"][rows]
            near = 1e-3 * high  # within a thousandth of a limit it is called active
            if (g[rows] > high - near).any() or (name != "stroke" and (g[rows] < low + near).any()):
                active.append(name)
        apex, apex_time = (float(value) for value in self._apex(x))
        return Solution(
            bool(stats["success"]),
            str(stats["return_status"]),
            x,
            (np.asarray(r["lam_x"]).ravel(), np.asarray(r["lam_g"]).ravel()),
            command,
            T,
            apex,
            apex_time,
            tuple(active),
            int(stats["iter_count"]),
            seconds,
            float(r["f"]),
        )
