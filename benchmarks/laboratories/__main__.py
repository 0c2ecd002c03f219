"""The benchmark's commands; see the package's docstring."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from benchmarks.hidden_physics.entries import Task
from benchmarks.hidden_physics.worlds import numbers
from benchmarks.rows import Numbered as Case
from benchmarks.rows import Row, gather, share
from jumpvision.engine.discovery import Laws
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.fitting import Problem
from jumpvision.engine.order import Order, silent
from jumpvision.jumper.question.discovered import JumperForms
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.learning import learn_noise
from jumpvision.jumper.question.words import diagnosis_of

from .judge import answer_of, covers, holds, misnamed, outcome
from .truths import CASES, INSTRUMENTS, KINDS, SCATTERING, SEED, Truth, sealed, truth
from .worlds import MS10, World, apart, made

TELLABLE = 20.0  # chi^2 that every rival number leaves: it can be told which one varies
BINS = (1.0, 2.0, 4.0, 8.0)  # sizes over the detectable one


def asked(task: Task) -> Diagnosis:
    """`jumpvision diagnose` on the jumps, the whole order."""
    learned = learn_noise(Jumper(task.jumps, task.ranges, task.priors, workers=1))
    system, stops = learned.system, [j.stop for j in task.jumps]
    problem = Problem(system, learned.noise, learned.scatter)
    laws = lambda p: Laws(p, JumperForms(p.system), silent)  # noqa: E731
    found = Order(problem, np.random.default_rng(1), by=("kind",), stops=stops, laws=laws).all()
    return diagnosis_of(found, learned)


def run(case: Case) -> Row:
    """One campaign made and asked; it is judged when the table is made."""
    t = truth(case.number, case.seed)
    world = made(t, case.seed)
    began = time.process_time()
    answer = answer_of(asked(world.task))
    used = time.process_time() - began
    return {
        "number": case.number, "seed": case.seed, "size": world.size, "mean": mean(world), "apart": apart(world),
        "answer": answer, "processor_s": used,
    }  # fmt: skip


def mean(w: World) -> float:
    """True mean of the number that scatters, in its own unit."""
    if w.truth.part != "scatter":
        return 0.0
    p = w.setting.protocol
    own = {"start": MS10, "spring": p.robot.spring_stiffness}
    return own.get(w.truth.kind) or float(p.parameters[{"bed": "k1"}.get(w.truth.kind, w.truth.kind)])


# -------------------------------------------------------------------------------------------------------------- table
@dataclass(frozen=True)
class Judged:
    truth: Truth
    row: Row
    outcome: str

    @property
    def misnamed(self) -> bool:
        return "answer" in self.row and misnamed(self.truth, self.row["answer"])

    @property
    def tellable(self) -> bool:
        """Whether every other number that could vary so would leave a misfit; always for faults without a size."""
        return min(self.row.get("apart", {}).values(), default=np.inf) >= TELLABLE


def judged(rows: Sequence[Row]) -> list[Judged]:
    out = []
    for r in rows:
        seed, number = (int(x) for x in r["key"].split(" #"))
        t = truth(number, seed)
        out.append(Judged(t, r, outcome(t, r["answer"], seed) if "answer" in r else "failed"))
    return out


def shuffled(rows: Sequence[Row]) -> list[Row]:
    """Every answer given to another campaign of the same part: a table that can fail must fail here."""
    out: list[Row] = []
    for part in dict.fromkeys(truth(r["number"]).part for r in rows if "answer" in r):
        mine = [r for r in rows if "answer" in r and truth(r["number"]).part == part]
        turn = np.random.default_rng(0).permutation(len(mine))  # a cycle: nobody keeps his own
        for k, n in zip(turn, np.roll(turn, 1)):
            out.append({**mine[k], "answer": mine[n]["answer"]})
    return out


FAULTS = ("more", "place", "other", "force", "nothing named", "missed", "failed")


def report(rows: Sequence[Row]) -> str:
    """The tables, worst row first; bars; failures."""
    every = judged(rows)
    part = {p: [j for j in every if j.truth.part == p] for p in ("fault", "both", "scatter", "plain")}
    columns = ("hidden", "campaigns", "right", "right, more beside", "wrong recordings", "another number", "a force",
               "nothing named", "missed", "failed", "misnamed as a force")  # fmt: skip
    lines = [f"| {' | '.join(columns)} |", "|---" * len(columns) + "|"]
    kinds = {k: [j for j in part["fault"] if j.truth.kind == k] for k in KINDS}
    lines += in_order({k: v for k, v in kinds.items() if v})
    lines += ["", *bars(part), ""]
    sized = [j for j in part["fault"] if j.truth.factor]
    groups = {f"size {a:g} to {b:g}": [j for j in sized if a <= j.truth.factor < b] for a, b in pairwise(BINS)}
    groups |= {f"noise: {n}": [j for j in part["fault"] if j.truth.instrument == n] for n in INSTRUMENTS}
    groups |= {"no rival number explains it": [j for j in sized if j.tellable],
               "a rival nearly does": [j for j in sized if not j.tellable]}  # fmt: skip
    groups |= {f"on {g} ground": [j for j in part["fault"] if j.truth.ground == g] for g in ("granular", "hard")}
    groups |= {f"trials: {n}": [j for j in part["fault"] if j.truth.trials == n] for n in (1, 2)}
    lines += [f"* {n}: right {right(v)}" for n, v in groups.items() if v]
    offered = [j for j in part["fault"] if (x := j.row.get("answer")) and x["law"]]
    lines.append(f"* a law offered for a fault: {share(len(offered), len(part['fault']))}")
    held = [x for j in sized if "answer" in j.row and (x := holds(j.truth, j.row["answer"], j.row["size"])) is not None]
    lines.append(f"* 90 % intervals of what varies hold the truth: {share(sum(held), len(held))} of {len(held)}")
    lines += scatters(part["scatter"])
    seconds = [j.row["processor_s"] for j in every if "processor_s" in j.row]
    if seconds:
        lines.append(f"* processor time a question: median {np.median(seconds):.0f} s, greatest {max(seconds):.0f} s")
    return "\n".join([*lines, *[f"* failed: {r['key']}: {r['failed']}" for r in rows if "failed" in r]])


def in_order(kinds: dict[str, list[Judged]]) -> list[str]:
    """A line a kind, worst first."""
    table = []
    for kind, some in kinds.items():
        count = [sum(j.outcome == o for j in some) for o in FAULTS]
        good = sum(j.outcome == "right" for j in some) / len(some)
        wrong = sum(j.misnamed for j in some)
        table.append((good, f"| {kind} | {len(some)} | {right(some)} | {' | '.join(map(str, count))} | {wrong} |"))
    return [text for _, text in sorted(table)]


def right(some: Sequence[Judged]) -> str:
    return f"{share(sum(j.outcome == 'right' for j in some), len(some))} of {len(some)}"


def bars(part: dict[str, list[Judged]]) -> list[str]:
    """What was asked for beside what was measured."""
    alarms = [j for j in part["scatter"] if j.outcome in ("alarm", "failed")]
    wrong = [j for j in part["fault"] if j.misnamed]
    asked_for = {
        "kind, parameter and recordings right: >= 85 %": right(part["fault"]),
        "misnamed as a force: <= 3 %": share(len(wrong), len(part["fault"])),
        "with a force beside, both: >= 75 %": right(part["both"]),
        "real scatter, alarms: <= 4 %": f"{share(len(alarms), len(part['scatter']))} of {len(part['scatter'])}",
        "plain causes: >= 95 %": right(part["plain"]),
    }
    lines = ["| bar | measured |", "|---|---|", *[f"| {k} | {v} |" for k, v in asked_for.items()]]
    for name in ("both", "scatter", "plain"):
        found = [j.outcome for j in part[name]]
        lines.append(f"| {name}: " + ", ".join(f"{o} {found.count(o)}" for o in dict.fromkeys(found)) + " | |")
    return lines


def scatters(some: Sequence[Judged]) -> list[str]:
    """Of every parameter that scattered: alarms, statements, intervals."""
    lines = []
    for kind in SCATTERING:
        mine = [j for j in some if j.truth.kind == kind]
        held = [covers(j.truth, j.row["answer"], j.row["mean"]) for j in mine if "answer" in j.row]
        stated = [h for h in held if h is not None]
        if mine:
            lines.append(
                f"* {kind} scatters: {sum(j.outcome == 'alarm' for j in mine)} alarms of {len(mine)}, stated in "
                f"{len(stated)}, interval holds it in {share(sum(stated), len(stated))}, called adequate "
                f"{sum(j.row['answer']['adequate'] for j in mine if 'answer' in j.row)}"
            )
    return lines


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.laboratories", description=__doc__)
    parser.add_argument("what", choices=("seal", "run", "score"))
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--cases", default=f"0:{CASES}", help="A:B")
    parser.add_argument("--only", default="", help="parts or kinds that contain this text")
    parser.add_argument("--rows", help="file of one JSON line a campaign; those already there are not made again")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--shuffled", action="store_true", help="answers dealt out anew: the table must fail")
    args = parser.parse_args()
    if args.what == "seal":
        print(f"{sealed(args.seed)}  {CASES} truths")
        return
    wanted = [Case(i, args.seed) for i in numbers(args.cases) if asked_for(truth(i, args.seed), args.only)]
    if args.what == "run":
        print(report(gather(wanted, run, args.rows, args.workers)))
        return
    keys = {c.key for c in wanted}
    rows = [json.loads(text) for text in Path(args.rows).read_text(encoding="utf-8").splitlines()]
    rows = [r for r in rows if r["key"] in keys]
    print(report(shuffled(rows) if args.shuffled else rows))


def asked_for(t: Truth, text: str) -> bool:
    return text in f"{t.part} {t.kind}"


if __name__ == "__main__":
    main()
