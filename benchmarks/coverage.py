"""Whether 90 % intervals hold the truth where the apparatus errs alike in every jump, with and without films.

`python -m benchmarks.coverage [--campaigns N] [--named N] [--undeclared] [--workers N] [--rows FILE]` prints the tables
of `docs/benchmarks.md`; with --rows it takes up where it stopped. Of the campaigns the first --named are questioned as
a user would; the others are told which mechanism is missing and fitted with it, which takes a tenth of the time and
asks for the same intervals. --undeclared: the analysis is not told of the camera's errors (scale, clock), nor of films:
coverage must then fall below the bar, which shows that it can.
"""

from __future__ import annotations

import argparse
import functools
import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jumpvision.base.arrays import Z90
from jumpvision.engine.document.measured import motions_alone
from jumpvision.engine.fitting import Fit, Problem
from jumpvision.engine.order import Findings, Order, fit_baseline
from jumpvision.engine.priors import Measured
from jumpvision.engine.search import best_starts, race
from jumpvision.engine.system import Parameter
from jumpvision.experiment.campaign import films
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.jumps import Jump, Shared
from jumpvision.jumper.question.learning import Learned
from jumpvision.jumper.question.words import diagnosis_of
from jumpvision.laboratory.blind import campaign
from jumpvision.laboratory.game import score

from .diagnosis import jumps_of
from .noise import questioned
from .rows import Row, gather, interval, share
from .shared_world import World, physical, shifted, stated, world

LOW, HIGH, LEAST = 0.86, 0.94, 0.80  # bars: coverage of all named parameters, and of each one at least
PLANTED, FLAGGED, FALSE = 5.0, 0.95, 0.02  # sigma of a planted contradiction; bars
STATED = ("spring_stiffness", "gravity", "scale[0]", "offset[0]", "rate[0]")  # of the apparatus, in every campaign


@dataclass(frozen=True)
class Case:
    """Campaign `number`; undeclared: the analysis does not know what may be wrong; naming: nor what is missing."""

    number: int
    undeclared: bool
    naming: bool = True

    @property
    def key(self) -> str:
        return f"{'undeclared' if self.undeclared else 'declared'}{'' if self.naming else ' told'} #{self.number}"


@dataclass(frozen=True)
class Question:
    """A campaign as the analysis is asked about it."""

    case: Case
    jumps: list[Jump]
    fit: dict[str, Any]
    priors: dict[str, float]
    hidden: tuple[str, ...]

    @functools.cached_property
    def learned(self) -> Learned:
        """The jumps with what the analysis is told of their apparatus, and the noise that it learns."""
        shared = Shared() if self.case.undeclared else Shared(**stated())
        return questioned([replace(j, shared=shared) for j in self.jumps], self.fit, self.priors)

    def answer(self, film: Measured | None, near: Fit | None = None) -> Answer:
        """The campaign questioned, with a film of it or without. near: where a fit with a known cause may begin."""
        learned = self.learned
        beside = [] if film is None else [film]
        problem = Problem(learned.system, learned.noise, learned.scatter, beside)
        rng, stops = np.random.default_rng([182, self.case.number]), [j.stop for j in self.jumps]
        if not self.case.naming:
            again = near and problem.fit(near.mechanisms, near.named)
            return Answer(learned, problem, again or told(problem, self.hidden, rng))
        d = Order(problem, rng, by=("kind",), stops=stops).all()
        return Answer(learned, problem, d.naming.best.fit if d.naming and d.naming.named else d.baseline, d)


def told(problem: Problem, hidden: tuple[str, ...], rng: np.random.Generator) -> Fit:
    """The model with what is hidden, fitted from the best of ordinary strengths, as naming would begin."""
    base, candidates = fit_baseline(problem, rng), problem.system.candidates
    tries = []
    for factors in itertools.product((-1.0, 0.3, 1.0, 4.0), repeat=len(hidden)):
        values = dict(base.named)
        for m, factor in zip(hidden, factors):
            strength = candidates[m].parameters[0]
            values[strength.name] = float(
                np.clip(candidates[m].null + factor * strength.scale, strength.low, strength.high)
            )
        tries.append(values)
    plain = [{p.name: p.start for m in hidden for p in candidates[m].parameters}]
    return race(problem, best_starts(problem, hidden, tries + plain, 3))[0]


@dataclass(frozen=True)
class Answer:
    """The fit that a diagnosis stands by, and the problem that it answers; findings: where causes were sought."""

    learned: Learned
    problem: Problem
    best: Fit
    findings: Findings | None = None

    @property
    def system(self) -> Jumper:
        return self.learned.system

    @property
    def contradicts(self) -> bool:
        """Whether the confirmation says that film and jumps contradict each other."""
        alone = motions_alone(self.best, self.problem)
        rows = films.confirmation(alone, self.system, [], self.problem.measured)
        return any(r.contradicts for r in rows)


# ----------------------------------------------------------------------------------------------------------------- rows
def run(case: Case) -> Row:
    """One campaign: intervals without and with its film; a contradiction planted in the film, and none."""
    w = world(case.number)
    rng = np.random.default_rng([183, case.number])
    question = Question(case, *jumps_of(w.setting, campaign(w.setting, rng)), w.setting.hidden)
    out: Row = {"kind": w.kind, "hidden": list(w.setting.hidden), "common": w.common}
    alone = question.answer(None)
    out["alone"] = scored(alone, w)
    if case.undeclared:
        return out
    filmed = question.answer(w.film, alone.best)
    out |= {"filmed": scored(filmed, w), "flagged": filmed.contradicts}
    if planted := contradiction(alone.best, w.film, rng):
        name, off = planted
        out |= {"planted": name, "found": question.answer(off, alone.best).contradicts}
    return out


def contradiction(alone: Fit, film: Measured, rng: np.random.Generator) -> tuple[str, Measured] | None:
    """(parameter, the film with it off by PLANTED sigma of film minus jumps); None where the jumps say none of them."""
    for name in rng.permutation([n for n in film.names if n in alone.named]).tolist():
        by = PLANTED * math.hypot(film.sigma(name), alone.sigma(name))
        for sign in rng.permutation([-1.0, 1.0]):
            off = shifted(film, name, float(sign) * by)
            if physical(name, float(off.values[film.names.index(name)])):
                return name, off
    return None


def scored(answer: Answer, w: World) -> Row:
    """The outcome, and whether every 90 % interval holds the truth: of parameters as they are printed, of right names
    and of those beside wrong or missing ones; of the baseline's fitted ones; of what is stated of the
    apparatus."""
    d, fit = answer.findings, answer.best
    if d is None:
        outcome, names = "right", list(w.setting.hidden)
    else:
        data = diagnosis_of(d, answer.learned)
        outcome, names = score(data.values, w.setting.hidden, w.setting.parameters)["outcome"], data.named
    right = set(names) & set(w.setting.hidden)
    own = {p.name for m in right if m in fit.mechanisms for p in answer.system.candidates[m].parameters}
    named = {p.name: ends(fit, p) for p in fit.parameters if p.name in own}
    others = {p.name: p for p in fit.parameters if p.name not in named and p.name in w.true}
    rest = {n: ends(fit, p) for n, p in others.items()}
    fitted = {n: e for n, e in rest.items() if n in w.setting.protocol.model.get("fit", {})}
    printed = [held(n, e, w) for n, e in named.items() if n in w.true]
    return {
        "outcome": outcome if d else "told", "named": names,
        "named parameters": printed if outcome == "right" else [],
        "partly named": printed if outcome != "right" else [],
        "fitted parameters": [held(n, e, w) for n, e in fitted.items()],
        "stated parameters": [held(n, e, w) for n, e in rest.items() if n in STATED],
        "chi2_per_dof": fit.chi2 / answer.problem.n,
    }  # fmt: skip


def ends(fit: Fit, p: Parameter) -> tuple[float, float]:
    """The ends of a parameter's 90 % interval, within its range."""
    value, half = fit.named[p.name], Z90 * fit.sigma(p.name)
    return max(value - half, p.low), min(value + half, p.high)


def held(name: str, ends: tuple[float, float], w: World) -> Row:
    """An interval, its truth, and whether it holds it."""
    return {"name": name, "low": ends[0], "high": ends[1], "true": w.true[name],
            "holds": ends[0] <= w.true[name] <= ends[1]}  # fmt: skip


# --------------------------------------------------------------------------------------------------------------- tables
def report(rows: Sequence[Row]) -> str:
    """Coverage over all and of each parameter, names, contradictions; what is beyond the bars; what failed."""
    good = [r for r in rows if "failed" not in r]
    lines = ["| 90 % intervals of | without films | with films |", "|---|---|---|"]
    for group, title in (
        ("named parameters", "all named parameters (bar 86-94 %)"),
        ("partly named", "those beside a wrong or missing name"),
        ("fitted parameters", "all fitted ones of the baseline"),
        ("stated parameters", "what is stated of the apparatus"),
    ):
        alone, filmed = (intervals_of(good, k, group) for k in ("alone", "filmed"))
        lines.append(f"| {title} | {cover(alone)} | {cover(filmed)} |")
        for name in sorted({i["name"] for i in alone + filmed}):
            mine = ([i for i in found if i["name"] == name] for found in (alone, filmed))
            lines.append(f"| &emsp;`{name}` (bar 80 %) | {' | '.join(cover(m) for m in mine)} |")
    lines += ["", "| names | campaigns | right or twin | wrong or in part | missed |", "|---|---|---|---|---|"]
    for key, title in (("alone", "without films"), ("filmed", "with films")):
        said = [r[key]["outcome"] for r in good if key in r and r[key]["outcome"] != "told"]
        right, missed = sum(o in ("right", "twin") for o in said), said.count("missed")
        lines.append(f"| {title} | {len(said)} | {share(right, len(said))} | {len(said) - right - missed} | {missed} |")
    planted, none = [r["found"] for r in good if "found" in r], [r["flagged"] for r in good if "flagged" in r]
    lines += ["", "| film and jumps | campaigns | called a contradiction |", "|---|---|---|"]
    lines.append(
        f"| a contradiction of 5 sigma planted (bar 95 %) | {len(planted)} | {share(sum(planted), len(planted))} |"
    )
    lines.append(f"| none planted (bar 2 %) | {len(none)} | {share(sum(none), len(none))} |")
    return "\n".join(
        [*lines, "", *verdict(good), *[f"* failed: {r['key']}: {r['failed']}" for r in rows if "failed" in r]]
    )


def intervals_of(rows: Sequence[Row], key: str, group: str) -> list[Row]:
    """Every interval of a group, of the diagnoses without (alone) or with films (filmed)."""
    return [i for r in rows if key in r for i in r[key][group]]


def cover(intervals: Sequence[Row]) -> str:
    """`88.1 % (84.2-91.3) of 201`; the interval takes them as independent, which those of one campaign are not."""
    n = len(intervals)
    return f"{share(sum(i['holds'] for i in intervals), n)} of {n}"


def verdict(rows: Sequence[Row]) -> list[str]:
    """Coverages and shares beyond their bars, said to be so where the 95 % interval leaves no doubt."""
    out = []
    for key in ("alone", "filmed"):
        every = intervals_of(rows, key, "named parameters")
        names = sorted({i["name"] for i in every})
        for title, low, high, mine in [("all named", LOW, HIGH, every)] + [
            (n, LEAST, 1.0, [i for i in every if i["name"] == n]) for n in names
        ]:
            out += beyond(f"{key}, {title}", sum(i["holds"] for i in mine), len(mine), low, high)
    planted, none = [r["found"] for r in rows if "found" in r], [r["flagged"] for r in rows if "flagged" in r]
    out += beyond("contradiction planted", sum(planted), len(planted), FLAGGED, 1.0)
    return out + beyond("none planted", sum(none), len(none), 0.0, FALSE)


def beyond(title: str, count: int, n: int, low: float, high: float) -> list[str]:
    """A line where a share lies outside its bar; `surely`: its whole interval does."""
    if n == 0 or low <= count / n <= high:
        return []
    least, most = interval(count, n)
    surely = ": surely" if most < low or least > high else ""
    return [f"* {title}: {share(count, n)} of {n}, bar {100 * low:g}-{100 * high:g} %{surely}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=150)
    parser.add_argument("--named", type=int, default=12, help="campaigns whose cause is sought too")
    parser.add_argument("--undeclared", action="store_true", help="the analysis is not told what may be wrong")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rows", help="file of one JSON line a campaign; those already there are not made again")
    args = parser.parse_args()
    cases = [Case(i, args.undeclared, i < args.named) for i in range(args.campaigns)]
    print(report(gather(cases, run, args.rows, args.workers)))


if __name__ == "__main__":
    main()
