"""Planning a jump: solve, simulate the plan with its events, correct the target by the miss, or say what is reached;
and how far its apex may lie off, because robot and model are known only within their uncertainties."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError, closest
from jumpvision.engine.laws.symbolic import NAMESPACE
from jumpvision.jumper.physics.forcing import Forcing, Loop, Spline, as_played
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import Motion, beyond_seen, equilibrium, simulate

from .jumper import AIR, INTRUDE, STUCK, Drive, Jumper
from .solve import Solution, Solver, falling, guessed, starts
from .transcription import OBJECTIVES, Guess, Limits, Programme

MOTIONS: dict[str, dict[str, tuple[str, ...]]] = {
    "single": {"hard": (STUCK, AIR), "granular": (STUCK, INTRUDE, STUCK, AIR)},
    "hop": {"hard": (STUCK, AIR, STUCK, AIR), "granular": (STUCK, AIR, INTRUDE, STUCK, AIR)},
    "stop-go": {"granular": (STUCK, INTRUDE, STUCK, INTRUDE, STUCK, AIR)},
    "stick": {"hard": (STUCK, AIR, AIR, STUCK), "granular": (STUCK, INTRUDE, STUCK, AIR, AIR, INTRUDE, STUCK)},
}
"""Sequences of phases by name and ground. hop: a preliminary hop; stick: lands and stands still."""
NEEDS = {("hop", "granular"): "reintrusion_overshoot", ("stop-go", "granular"): "stop_go_overshoot"}
FINER = (1, 2, 3)  # times the usual intervals, until a plan is kept to


@dataclass(frozen=True)
class Plan:
    """A planned jump. status: solved; infeasible (then the rest is the highest jump found); failed.

    apex [m] of the target, or of the plan itself where none was given; motion: the re-simulation; active: limits met.
    """

    status: str
    apex: float
    planned_apex: float
    command: Spline
    motion: Motion
    resimulated_apex: float
    active: tuple[str, ...]
    durations: Array
    build_s: float
    solve_s: float  # of the solution that counts, without corrections
    total_s: float


@dataclass
class Planner:
    """Plans for one jumper: programmes are built once an objective and kept.

    say: is told what goes on. Raises InputError for a motion or a model that cannot be planned.
    """

    model: Model
    drive: Drive
    limits: Limits
    objective: str = "effort"
    motion: str = "single"
    say: Callable[[str], None] = lambda text: None
    _finer: int = 1
    _solvers: dict[tuple[str, int], Solver] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.objective not in OBJECTIVES:
            found = closest(self.objective, OBJECTIVES)
            raise InputError([f"objective = '{self.objective}'{found}: must be one of {', '.join(OBJECTIVES)}"])
        if self.motion not in MOTIONS:
            found = closest(self.motion, MOTIONS)
            raise InputError([f"motion = '{self.motion}'{found}: must be one of {', '.join(MOTIONS)}"])
        if self.model.ground not in MOTIONS[self.motion]:
            raise InputError([f"motion = '{self.motion}': not on {self.model.ground} ground; choose another motion"])
        if (need := NEEDS.get((self.motion, self.model.ground))) and need not in self.model:
            raise InputError([f"motion = '{self.motion}': the model has no '{need}'; add it with its parameters"])
        if self.drive.kp > 0 and "motor_lag" in self.model:
            raise InputError(
                [
                    "model terms: 'motor_lag' cannot act together with [motor] kp (both say how the motor "
                    "follows its command); set kp = 0 or remove the term"
                ]
            )
        # sizes are rounded off below 1e-4 m and m/s, for roots of them have no derivative at 0
        self.jumper = Jumper(self.model, self.drive, NAMESPACE, 1e-4)
        self.sequence = MOTIONS[self.motion][self.model.ground]

    def solver(self, objective: str) -> Solver:
        """The built programme of an objective."""
        which = objective, self._finer
        if which not in self._solvers:
            rest = equilibrium(self.model)
            programme = Programme(self.jumper, self.sequence, objective, rest, self.limits, self._finer)
            self._solvers[which] = Solver(programme)
        return self._solvers[which]

    def plan(self, apex: float) -> Plan:
        """The jump to an apex [m] over rest, on finer intervals where its re-simulation leaves it.

        Between the points of a coarse mesh a foot may lift off unasked; under weak gravity little is enough for that.
        """
        near: Plan | None = None
        try:
            for self._finer in FINER:
                plan = self._planned(apex)
                if plan.status != "solved":
                    return near or plan
                if not self._astray(plan):
                    if not self._unasked(plan):
                        return plan
                    near = near or plan
                self.say("the re-simulated motion leaves the plan")
        finally:
            self._finer = 1
        return near or replace(plan, status="failed")

    def _astray(self, plan: Plan) -> bool:
        """Whether the re-simulation misses the apex, or does not stand still after a landing that sticks, as planned
        or as its samples are played."""
        after = 0.0
        if self.motion == "stick":
            both = plan.motion, self.resimulate(as_played(plan.command))[0]
            after = max(float(np.ptp(m.rod[m.t > plan.command.stop])) for m in both)
        # a re-simulation may miss the apex, or move after a landing that sticks, by 2 % of it
        return max(abs(plan.resimulated_apex - plan.apex), after) > 0.02 * plan.apex

    def _unasked(self, plan: Plan) -> bool:
        """Whether the foot of a landing that is to stick lifts off, however little, before the plan has it so: what
        plays the plan lands at another time than the re-simulation that was corrected for it."""
        if self.motion != "stick":
            return False
        first = next(float(e["time"]) for e in plan.motion.events if e["kind"] == "lift_off")
        # 2 % before the planned time is too early
        return first < 0.98 * float(plan.durations[: self.sequence.index(AIR)].sum())

    def _planned(self, apex: float) -> Plan:
        began = time.perf_counter()
        solver = self.solver(self.objective)
        best: Solution | None = None
        solution = self.search(apex)
        if solution is None:
            best = self.reach(apex)
            if best is None or best.apex < apex:
                tried = best or solver.solve(apex, self.limits, guess=self._guess(self._likeliest(apex)))
                return self._plan("infeasible" if best else "failed", apex, tried, began)
            solution = self._descend(apex, best)
            if solution is None:
                solution, solver = self.solver("height").solve(apex, self.limits, warm=best), self.solver("height")
                self.say(f"the least {self.objective} was not found; kept a plan that reaches the apex")
            if not solution.solved:
                return self._plan("failed", apex, best, began)
        return self.corrected(apex, solution, solver, began)

    def clear(self, height: float, seconds: float) -> Plan:
        """The jump whose foot is above an obstacle of this height [m] for this time [s], within 0.2 ms.

        Its apex is sought: by free flight (the square of the time grows by 8/g times the apex) until jumps too low and
        too high are known, then between these, by turns at the chord and at the middle.
        """
        g = self.model.g
        apex = height + g * seconds**2 / 8.0
        low: tuple[float, float] | None = None
        high: tuple[float, float] | None = None
        for n in range(16):
            plan = self.plan(apex)
            found = above(plan.motion, height)
            if plan.status != "solved" or abs(found - seconds) < 2e-4:
                return plan
            low, high = ((apex, found), high) if found < seconds else (low, (apex, found))
            if low is None or high is None:
                # twice what free flight asks, to have it between two
                apex += 2.0 * g * (seconds**2 - found**2) / 8.0
            else:
                share = (seconds - low[1]) / (high[1] - low[1]) if n % 2 else 0.5
                apex = low[0] + share * (high[0] - low[0])
        return replace(plan, status="failed")

    def _likeliest(self, apex: float) -> Forcing:
        return next(starts(self.jumper, apex, self.limits.stroke))

    def search(self, apex: float) -> Solution | None:
        """The first of three starts that leads to a plan."""
        for _, command in zip(range(3), starts(self.jumper, apex, self.limits.stroke)):
            trial = self.solver(self.objective).solve(apex, self.limits, guess=self._guess(command))
            self.say(f"{self.objective}: {trial.status}, {trial.iterations} iterations, {trial.seconds:.2f} s")
            if trial.solved:
                return trial
        return None

    def highest(self, count: int | None = None) -> Plan:
        """The highest jump found from `count` starts (default: all)."""
        began = time.perf_counter()
        best = self.reach(math.inf, count)
        if best is None:
            raise InputError(["limits: no jump was found under them; widen the limits"])
        return self._plan("solved", best.apex, best, began)

    def reach(self, enough: float, count: int | None = None) -> Solution | None:
        """The highest apex from all starts, or the first above `enough` [m]; None where no start gives a jump."""
        solver, best = self.solver("height"), None
        likely = min(enough, 0.05)
        for n, command in enumerate(starts(self.jumper, likely, self.limits.stroke)):
            if n == count:
                break
            r = solver.solve(None, self.limits, guess=self._guess(command))
            if r.solved and (best is None or r.apex > best.apex):
                best = r
                self.say(f"highest apex: {1e3 * r.apex:.1f} mm from start {n + 1}")
                if best.apex >= enough:
                    break
        return best

    def resimulate(self, command: Spline, model: Model | None = None) -> tuple[Motion, float]:
        """The motion under a command by the simulator, and its apex over rest [m]; model: another than the plan's."""
        d = self.drive
        forcing = Loop(command, d.kp, d.kd, self.limits.max_force) if d.kp > 0 else command
        t = np.linspace(0.0, command.stop + max(0.6, falling(self.model.g)), 1201)
        motion = simulate(model or self.model, forcing, t=t, rtol=1e-8, atol=1e-10)
        return motion, self._risen(motion) if self.motion == "stick" else motion.jump_height

    def _risen(self, motion: Motion) -> float:
        """Apex [m] of the rod over rest by the rise of the mass centre, the motor at its place of rest in flight."""
        m = self.model
        total = m.M + m.m_f
        hangs = m.m_f * (motion.rod[0] - motion.foot[0])  # the rest of the spring's squeeze: the foot hangs relaxed
        return motion.com_height - (hangs + m.m_m * self.jumper.sag()) / total

    def _guess(self, command: Forcing) -> Guess:
        return guessed(self.jumper, self.sequence, command)

    def _descend(self, apex: float, best: Solution) -> Solution | None:
        """From the highest jump down to the apex, in steps where one does not do."""
        for steps in (1, 4):
            at = best
            for target in best.apex + (apex - best.apex) * np.linspace(0.0, 1.0, steps + 1)[1:]:
                at = self.solver(self.objective).solve(float(target), self.limits, guess=self._guess(at.command))
                if not at.solved:
                    break
            if at.solved:
                return at
        return None

    def corrected(self, apex: float, solution: Solution, solver: Solver, began: float) -> Plan:
        """Moves the target by what the re-simulated apex misses it."""
        seconds, target = solution.seconds, apex
        plan = self._plan("solved", apex, solution, began)
        for _ in range(4):
            miss = apex - plan.resimulated_apex
            if abs(miss) < 5e-6:  # m, between target and re-simulated apex: the corrections end
                break
            target += miss
            solution = solver.solve(target, self.limits, warm=solution)
            if not solution.solved:
                break
            other = self._plan("solved", apex, solution, began)
            if abs(apex - other.resimulated_apex) >= abs(miss):
                break
            plan = other
        self.say(f"re-simulated apex {1e3 * plan.resimulated_apex:.3f} mm")
        for said in beyond_seen(self.model, plan.motion):
            self.say(f"warning: {said}")
        return replace(plan, solve_s=seconds)

    def _plan(self, status: str, apex: float, s: Solution, began: float) -> Plan:
        motion, found = self.resimulate(s.command)
        return Plan(
            status,
            apex,
            s.apex,
            s.command,
            motion,
            found,
            s.active,
            s.durations,
            sum(solver.build_s for solver in self._solvers.values()),
            s.seconds,
            time.perf_counter() - began,
        )


def above(motion: Motion, height: float) -> float:
    """The longest time [s] that the foot of a motion is above a height [m] over the ground."""
    t, over = motion.t, motion.foot - height
    high = np.concatenate([[False], over > 0.0, [False]])
    rises, falls = np.flatnonzero(~high[:-1] & high[1:]), np.flatnonzero(high[:-1] & ~high[1:])

    def crossing(i: int) -> float:
        """Between samples i - 1 and i; the end of the motion where there is none."""
        if not 0 < i < t.size:
            return float(t[min(i, t.size - 1)])
        return float(t[i - 1] - over[i - 1] * (t[i] - t[i - 1]) / (over[i] - over[i - 1]))

    return max((crossing(int(b)) - crossing(int(a)) for a, b in zip(rises, falls)), default=0.0)


def perturbed(model: Model, sigma: Mapping[str, float], rng: np.random.Generator) -> Model:
    """The model with the values of `sigma` (name -> standard uncertainty) drawn from normal distributions.

    Names are those of `Model` (the robot's) or of its parameters. A draw that cannot be (a negative mass) is repeated.
    """
    own = {n for n in sigma if n in Model.__dataclass_fields__}
    for _ in range(1000):
        near = {n: float(rng.normal(getattr(model if n in own else model.parameters, n), s)) for n, s in sigma.items()}
        robot: dict[str, Any] = {n: v for n, v in near.items() if n in own}
        try:
            parameters = replace(model.parameters, **{n: v for n, v in near.items() if n not in own})
            return replace(model, parameters=parameters, **robot)
        except InputError:
            continue
    raise InputError([f"sigma of {', '.join(sigma)}: hardly any draw is a possible model; give smaller uncertainties"])


def apexes(
    planner: Planner, command: Spline, sigma: Mapping[str, float], *, draws: int, rng: np.random.Generator
) -> Array:
    """Apexes [m], (draws,), of one command on models drawn from the uncertainties."""
    return np.array([planner.resimulate(command, perturbed(planner.model, sigma, rng))[1] for _ in range(draws)])
