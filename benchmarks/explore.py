"""The experimenter on hidden effects: campaigns of 8 jumps that leave a doubt, and what the proposed jumps make of it.

`python -m benchmarks.explore [--each N] [--workers N] [--rows FILE]` prints the tables of docs/benchmarks.md. A
campaign of the laboratory hides one effect, strength drawn evenly in its logarithm; it is taken where the verdict is
discrepant and the right cause has less than 95 %. Then one jump after the other is made, the best of the list, or one
at random.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.diagnosis import jumps_of
from benchmarks.rows import Row, gather, share
from jumpvision.engine.detect import detect, directions
from jumpvision.engine.fitting import Problem
from jumpvision.engine.naming import Naming, name
from jumpvision.engine.order import fit_baseline
from jumpvision.engine.worth.design import Held, batch, belief, prospect
from jumpvision.engine.worth.rehearse import log10_odds
from jumpvision.experiment.campaign.explore.offers import Way, every, limits_of, offer
from jumpvision.experiment.inputs.sections import Actuation
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.learning import learn_noise
from jumpvision.laboratory.blind import AMPLITUDE, Recorded, Setting, campaign, choices, draw
from jumpvision.laboratory.jumper import Law
from jumpvision.laboratory.protocol_keys import Jump, JumpSweep
from jumpvision.laboratory.protocol_keys import jumps_of as lab_jumps

LEVEL = 0.95
STEPS = 6  # jumps made at most
DRAWS = 60  # campaigns drawn before a case is given up
EIGHT = {
    "granular": (("single", (5.0, 6.5, 8.0, 9.5), 0.0), ("stutter", (4.5, 5.25, 6.0), 0.0),
                 ("delayed_stutter", (6.5,), 0.1)),
    "hard": (("single", (9.0, 12.0, 15.0, 18.0), 0.0), ("stutter", (6.5, 7.5, 8.5, 9.5), 0.0)),
}  # fmt: skip


@dataclass(frozen=True)
class Case:
    ground: str
    seed: int

    @property
    def key(self) -> str:
        return f"{self.ground}-{self.seed}"


@dataclass
class State:
    """A campaign as far as it is made, and what is believed of it."""

    setting: Setting
    recorded: list[Recorded]
    problem: Problem
    system: Jumper
    naming: Naming
    discrepant: bool
    ranges: dict[str, Any]
    priors: dict[str, float]

    def chance(self, mechanism: str) -> float:
        return self.naming.probability(mechanism)

    @property
    def standing(self) -> set[str]:
        return {m for m in self.naming.probabilities if self.chance(m) >= LEVEL}

    @property
    def right(self) -> bool:
        """The hidden effect stands, and nothing else does."""
        return self.standing == set(self.setting.hidden)

    @property
    def laws(self) -> list[Actuation]:
        return [law_of(r.jump) for r in self.recorded]


def law_of(jump: Jump) -> Actuation:
    m = jump.law
    return Actuation(jump.kind, m.frequency, m.amplitude, m.phase, m.cycles, m.delay, start=m.start)


def questioned(setting: Setting, recorded: list[Recorded]) -> State:
    """What a campaign's diagnosis believes."""
    jumps, ranges, priors = jumps_of(setting, recorded)
    jumps = [replace(j, condition=(c := f"{j.condition} {r.jump.law}"), group=c) for j, r in zip(jumps, recorded)]
    rng = np.random.default_rng(1)
    learned = learn_noise(Jumper(jumps, ranges, priors, workers=1))
    problem = Problem(learned.system, learned.noise, learned.scatter)
    base = fit_baseline(problem, rng)
    found = detect(problem, base, directions(problem, base), rng)
    naming = name(problem, base, found, rng)
    return State(setting, recorded, problem, learned.system, naming, found.discrepant, ranges, priors)


def begun(case: Case) -> tuple[State, int]:
    """(the first campaign of 8 jumps that leaves a doubt, how many were drawn)."""
    for attempt in range(DRAWS):
        rng = np.random.default_rng([case.seed, attempt, 23])
        hidden = [str(rng.choice(choices(case.ground)))]
        setting = draw(rng, ground=case.ground, hidden=hidden)
        sweeps = [JumpSweep(k, f, (AMPLITUDE[case.ground],), delay=(d,)) for k, f, d in EIGHT[case.ground]]
        jumps = lab_jumps(sweeps, start=setting.protocol.header.start, ground=case.ground, part="", first=0)
        setting = replace(setting, protocol=replace(setting.protocol, jumps=jumps))
        state = questioned(setting, campaign(setting, rng))
        if state.discrepant and state.chance(hidden[0]) < LEVEL:
            return state, attempt + 1
    raise ValueError(f"none of {DRAWS} campaigns left a doubt")


def made(state: State, law: Actuation, rng: np.random.Generator) -> State:
    """One jump more, by the laboratory."""
    own = Law(law.frequency or 0.0, law.amplitude or 0.0, law.start_phase, law.start, law.cycles, law.delay)
    first = state.recorded[0].jump
    jump = Jump(len(state.recorded), f"next-{len(state.recorded)}", "next", law.kind, own, first.volume_fraction)
    protocol = replace(state.setting.protocol, jumps=(jump,))
    (new,) = campaign(replace(state.setting, protocol=protocol), rng)
    return questioned(state.setting, [*state.recorded, new])


def log_odds(before: Problem, after: Problem, held: Sequence[Held], right: int) -> float:
    """log10 of the odds that one model gained over the others together, by fits before and after an experiment."""

    def evidence(problem: Problem, h: Held) -> float:
        fit = problem.fit(h.fit.mechanisms, h.fit.named)
        return -math.inf if fit is None else fit.log_evidence

    gained = np.array([evidence(after, h) - evidence(before, h) for h in held])
    weight = np.array([h.weight for h in held])
    rest = np.logaddexp.reduce(np.delete(gained + np.log(weight), right)) - math.log(1.0 - weight[right])
    return float(gained[right] - rest) / math.log(10)


def rehearsals(state: State, wider: Problem, held: Sequence[Held], new: int) -> list[float]:
    """What `explore` expects of an experiment; [] where it says that no model explains the jumps made."""
    if state.naming.status != "complete" and not state.naming.by_chance:
        return []
    return log10_odds(wider, held, range(len(state.recorded)), new, np.random.default_rng(0)).tolist()


def explored(state: State, seed: int, *, at_random: bool) -> dict[str, Any]:
    """Jumps until the right cause stands, or STEPS of them; what was stated of each and what came."""
    rng = np.random.default_rng([seed, 99])
    out: dict[str, Any] = {"made": [], "chances": [], "stated": [], "rehearsed": [], "linear": [], "came": [],
                           "bits": [], "cpu": [], "needed": None, "wrong": False, "standing": []}  # fmt: skip
    limits = limits_of(state.laws, None)
    laws = every(state.laws[:8], limits)
    true = state.setting.hidden
    for step in range(STEPS):
        began = time.process_time()
        held = belief(state.naming.tried)
        wider, places = offer(state.problem, state.system, [Way(law) for law in laws], state.ranges, state.priors)
        if at_random:
            at = int(rng.integers(len(places)))
            stated = None
        else:
            offered = {i: p for i in places if (p := prospect(wider, held, i)) is not None}
            best = batch(offered, dict.fromkeys(offered, 1.0), [h.weight for h in held], 1, np.random.default_rng(0))
            at, stated = places.index(best[0].which), best[0].worth
            rehearsed = rehearsals(state, wider, held, best[0].which)
        out["cpu"].append(time.process_time() - began)
        right = next((i for i, h in enumerate(held) if set(h.fit.mechanisms) == set(true)), None)
        law, before = laws[at], state.problem
        state = made(state, law, np.random.default_rng([seed, step, 7]))
        came = log_odds(before, state.problem, held, right) if right is not None else math.nan
        out["made"].append(
            f"{law.kind} {law.frequency} Hz {1e3 * (law.amplitude or 0):.3g} mm x{law.cycles:g} {law.delay}"
        )
        out["chances"].append(state.chance(true[0]))
        out["standing"].append(sorted(state.standing))
        if stated is not None:
            out["rehearsed"].append(rehearsed)
            out["stated"].append(float(np.mean(rehearsed)) if rehearsed else math.nan)
            out["linear"].append(stated.log10_odds)
            out["bits"].append(stated.bits)
            out["came"].append(came)
        if state.standing - set(true):
            out["wrong"] = True
        if state.right:
            out["needed"] = step + 1
            break
    return out


def run(case: Case) -> Row:
    state, drawn = begun(case)
    (hidden,) = state.setting.hidden
    top = sorted(((state.chance(m), m) for m in state.naming.probabilities), reverse=True)[:3]
    row: Row = {
        "ground": case.ground, "hidden": hidden, "strength": state.setting.strength[0], "drawn": drawn,
        "noise": state.setting.nuisance.noise, "before": state.chance(hidden), "top": top,
        "named": list(state.naming.named), "twins": state.naming.twins,
        "wrong_before": bool(state.standing - {hidden}),
    }  # fmt: skip
    row |= {"design": explored(state, case.seed, at_random=False)}
    row |= {"random": explored(state, case.seed, at_random=True)}
    return row


def table(rows: list[Row]) -> str:
    """The tables of docs/benchmarks.md."""
    good, n = [r for r in rows if "failed" not in r], len(rows)
    lines = [
        f"{n} campaigns, {n - len(good)} failed.",
        "",
        "| the next jumps are | right cause at 95 % within 2 | within 4 | within 6 | median | a wrong one at 95 % |",
        "|---|---|---|---|---|---|",
    ]
    for arm in ("design", "random"):
        needed = [r[arm]["needed"] or math.inf for r in good]
        within = [share(sum(x <= k for x in needed), n) for k in (2, 4, 6)]
        wrong = share(sum(r[arm]["wrong"] for r in good), n)
        needed += [math.inf] * (n - len(good))  # what failed did not find it either
        lines.append(f"| {arm} | {' | '.join(within)} | {np.median(needed):g} | {wrong} |")
    for what in ("stated", "linear"):
        pairs = [(s, c) for r in good for s, c in zip(r["design"][what], r["design"]["came"])]
        unsaid, without = (sum(not math.isfinite(p[k]) for p in pairs) for k in (0, 1))
        lines.append(
            f"\n{what}: {len(pairs)} jumps, {unsaid} not said, {without} without the right model among those weighed"
        )
        pairs = [p for p in pairs if np.all(np.isfinite(p))]
        for top in (3.0, 10.0, math.inf):
            x, y = np.array([p for p in pairs if p[0] <= top]).reshape(-1, 2).T
            if x.size >= 3:
                slope = float(x @ y / (x @ x))
                error = math.sqrt(float(np.sum(x * x * (y - slope * x) ** 2))) / float(x @ x)
                middle = f"means {x.mean():.2f}, {y.mean():.2f} came, medians {np.median(x):.2f}, {np.median(y):.2f}"
                lines.append(f"{what} at most {top:g}: {x.size} jumps, slope {slope:.2f} +- {error:.2f}, {middle}")
    cpu = [c for r in good for c in r["design"]["cpu"]]
    if cpu:
        lines.append(f"\na proposal takes {np.median(cpu):.1f} s of processor (median), {max(cpu):.1f} s at most")
    for r in rows:
        lines.append(f"\n{r['key']}: " + (r["failed"] if "failed" in r else
            f"{r['hidden']} strength {r['strength']:.2f}, noise {1e3 * r['noise']:.2f} mm, before {r['before']:.3f}, "
            f"top {[(m, round(p, 2)) for p, m in r['top']]}, design {r['design']['needed']} "
            f"{np.round(r['design']['chances'], 3).tolist()} random {r['random']['needed']}"))  # fmt: skip
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=20, help="campaigns on each ground")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument(
        "--rows", default=None, help="file for one JSON line a campaign; those there are not made again"
    )
    args = parser.parse_args()
    every_case = [Case(g, s) for s in range(args.each) for g in ("hard", "granular")]
    print(table(gather(every_case, run, args.rows, args.workers)))
