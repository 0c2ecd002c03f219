"""The contest's commands; see the package's docstring."""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.diagnosis import jumps_of
from benchmarks.rows import Row, gather, share
from jumpvision.engine.fitting import Problem
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.learning import learn_noise
from jumpvision.laboratory.blind import Setting

from .claims import claims
from .entries import Answer, Task, entry
from .worlds import CASES, KINDS, SEED, Truth, made, numbers, sealed, truth

PLAIN = 100.0  # non-centrality of a cause beside the others: it must be found


@dataclass(frozen=True)
class Case:
    """One campaign for one entry."""

    entry: str
    number: int
    seed: int

    @property
    def key(self) -> str:
        return f"{self.entry} {self.seed} #{self.number}"


def run(case: Case) -> Row:
    """One campaign made, answered and scored."""
    hidden = truth(case.number, case.seed)
    setting, recorded = made(hidden, case.seed)
    task = Task(*jumps_of(setting, recorded))
    began = time.process_time()
    answer = entry(case.entry)(task)
    used = time.process_time() - began
    true = {**setting.protocol.parameters, **setting.parameters}
    covers = {n: low <= true[n] <= high for n, (low, high) in answer.parameters.items() if n in true}
    return {
        "number": case.number, "kind": hidden.kind, "ground": hidden.ground, "noise": hidden.noise,
        "hidden": hidden.outside or "+".join(sorted(hidden.hidden)), "named": "+".join(sorted(answer.named)),
        "outcome": outcome(answer, hidden), "partial": answer.partial, "twins": answer.twins, "covers": covers,
        "probability": {m: [p, m in hidden.hidden] for m, p in answer.probability.items()},
        "described": answer.described, "processor_s": used, "plain": plain(task, setting),
        **claims(answer, hidden, setting, case.seed),
    }  # fmt: skip


def outcome(answer: Answer, hidden: Truth) -> str:
    """right, twin, partly (a part of it, said to be one), part unsaid, wrong, missed, false alarm."""
    named, true = set(answer.named), set(hidden.hidden)
    if not true and not hidden.outside:
        return "right" if answer.adequate else "false alarm"
    if answer.adequate:
        return "missed"
    if hidden.outside:
        return "wrong" if named else "right"
    if named == true:
        return "right"
    alike = [set(t) for t in answer.twins]
    stands = {n: n in true or any(n in t and t & (true - named) for t in alike) for n in named}
    found = {h: h in named or any(h in t and t & named for t in alike) for h in true}
    if all(stands.values()) and all(found.values()) and len(named) == len(true):
        return "twin"
    if not all(stands.values()):
        return "wrong"
    return "partly" if answer.partial or not named else "part unsaid"


def plain(task: Task, setting: Setting) -> dict[str, float]:
    """Non-centrality of every cause beside the others: chi^2 of the true set without it, less that of the true set.

    Both are fitted from the truth by the analysis' own model; used only to tell what could be asked.
    """
    learned = learn_noise(Jumper(task.jumps, task.ranges, task.priors, workers=1))
    problem, causes = Problem(learned.system, learned.noise, learned.scatter), setting.hidden
    if not causes or not set(causes) <= set(learned.system.candidates):
        return {}
    start = {**setting.protocol.parameters, **setting.parameters}
    whole = problem.fit(causes, start)
    rest = {m: problem.fit(tuple(c for c in causes if c != m), start) for m in causes}
    return {m: f.chi2 - whole.chi2 if f and whole else float("nan") for m, f in rest.items()}


def report(rows: Sequence[Row]) -> str:
    """The table, worst row first; failures, coverage, probabilities, times."""
    lines = ["| hidden | campaigns | right or twin | partly, said so | part, unsaid | wrong | missed | failed |",
             "|---|---|---|---|---|---|---|---|"]  # fmt: skip
    table = []
    for kind in KINDS:
        mine = [r for r in rows if r.get("kind") == kind or ("failed" in r and kind_of(r) == kind)]
        strong = [r for r in mine if r.get("plain") and min(r["plain"].values()) >= PLAIN]
        weak = [r for r in mine if r not in strong]
        split = kind in ("one", "two", "three", "four", "single trial", "instrument")
        for name, some in (
            ((f"{kind}, each plain", strong), (f"{kind}, one or more faint", weak)) if split else ((kind, mine),)
        ):
            if some:
                table.append(line(name, some))
    lines += [text for _, text in sorted(table)]
    good = [r for r in rows if "failed" not in r]
    for n in (1, 2, 3, 4):
        held = [
            v for r in good if r["outcome"] == "right" and r["hidden"].count("+") == n - 1 for v in r["covers"].values()
        ]
        lines.append(f"* 90 % intervals, {n} cause(s) rightly named: {share(sum(held), len(held))} of {len(held)}")
    pairs = [(p, t) for r in good for p, t in r["probability"].values()]
    for k in range(10):
        some = [(p, t) for p, t in pairs if k / 10 <= p < (k + 1) / 10 + (k == 9)]
        if some:
            said = np.mean([p for p, _ in some])
            lines.append(
                f"* stated probability {said:.3f}: true in {share(sum(t for _, t in some), len(some))} of {len(some)}"
            )
    gains = [r["gain"] for r in good if "gain" in r]
    held = [low <= true <= high for low, high, true in gains]
    lines.append(f"* 95 % interval of the gain holds it: {share(sum(held), len(held))} of {len(held)}")
    seen = [found for r in good for _, found in r.get("power", {}).values()]
    lines.append(f"* strengths said to be detectable in 90 %, seen: {share(sum(seen), len(seen))} of {len(seen)}")
    seconds = [r["processor_s"] for r in good]
    if seconds:
        lines.append(f"* processor time: median {np.median(seconds):.0f} s, greatest {max(seconds):.0f} s")
    return "\n".join([*lines, *[f"* failed: {r['key']}: {r['failed']}" for r in rows if "failed" in r]])


def kind_of(row: Row) -> str:
    return KINDS[int(row["key"].split("#")[1]) % len(KINDS)]


def line(name: str, rows: Sequence[Row]) -> tuple[float, str]:
    """(share of right answers, the line)."""
    said = [r.get("outcome", "failed") for r in rows]
    right = sum(o in ("right", "twin") for o in said)
    wrong = said.count("wrong") + said.count("false alarm")
    counts = (said.count("partly"), said.count("part unsaid"), wrong, said.count("missed"), said.count("failed"))
    return right / len(rows), f"| {name} | {len(rows)} | {share(right, len(rows))} | {' | '.join(map(str, counts))} |"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.hidden_physics", description=__doc__)
    parser.add_argument("what", choices=("seal", "run", "score"))
    parser.add_argument("entry", nargs="?", default="ours")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--cases", default=f"0:{CASES}", help="A:B")
    parser.add_argument("--only", default="", help="kinds that contain this text")
    parser.add_argument("--rows", help="file of one JSON line a campaign; those already there are not made again")
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    if args.what == "seal":
        print(f"{sealed(args.seed)}  {CASES} truths")
        return
    wanted = [Case(args.entry, i, args.seed) for i in numbers(args.cases) if args.only in KINDS[i % len(KINDS)]]
    if args.what == "run":
        print(report(gather(wanted, run, args.rows, args.workers)))
        return
    keys = {c.key for c in wanted}
    rows = (json.loads(text) for text in Path(args.rows).read_text(encoding="utf-8").splitlines())
    print(report([r for r in rows if r["key"] in keys]))


if __name__ == "__main__":
    main()
