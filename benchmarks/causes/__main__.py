"""The command; see the package's docstring."""

from __future__ import annotations

import argparse
import json
import os
import time
import traceback
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
from scipy.stats import binomtest

import jumpvision as jv
from tests.worlds import faults, hidden, laboratories
from tests.worlds.jumps import Task, diagnose_jumps, jumps_of

from . import laws, machines
from .judge import Fault, Hidden, Row, fault_of, judge, row_of

CAMPAIGNS = {  # and how many a seed has
    "none": 60, "forces": 180, "tails": 60, "laboratories": 120, "both": 24, "scatter": 60,
    "laws": len(laws.NAMES) + 30, "machines": len(machines.MACHINES) * len(machines.FAULTS),
}  # fmt: skip
FORCES = [k for k, kind in enumerate(hidden.KINDS) if kind not in ("none", "outside")]
FIRST = {"laboratories": 0, "both": 120, "scatter": 144}  # of faults.truth


def of_hidden(t: hidden.Truth, seed: int, law: str = "") -> tuple[Task, Hidden]:
    setting, recorded = hidden.made(t, seed)
    true = {n: v for n, v in {**setting.protocol.parameters, **setting.parameters}.items() if isinstance(v, float)}
    return Task(*jumps_of(setting, recorded)), Hidden(t.outside or t.kind, t.hidden, law=law, noise=t.noise, true=true)


def made(campaign: str, number: int, seed: int) -> tuple[Task | machines.World, Hidden]:
    """Return case `number` of a campaign and what it hides."""
    if campaign == "machines":
        m = machines.world(number, seed)
        names, run = tuple(r.name for r in m.recordings), frozenset({f"run {m.run}"})
        what = {
            "odd": Hidden("odd", fault=Fault((m.what,), (), names, run)),
            "unit": Hidden("unit", fault=Fault((m.what,), (), names, run)),
            "drift": Hidden("drift", fault=Fault((m.what,), ("drift", "step", "function"), names)),
            "law": Hidden("law", law="any"), "dry": Hidden("dry", ("dry",)), "nothing": Hidden("nothing"),
        }  # fmt: skip
        return m, what[m.fault]
    if campaign == "laws" and number < len(laws.NAMES):
        w = laws.world(number, seed)
        return laws.task_of(w), Hidden(w.family, law=w.form.acts_on, noise=w.noise)
    if campaign == "laws":
        t = hidden.truth(8 * (number - len(laws.NAMES)) + hidden.KINDS.index("outside"), seed)
        acts_on = {
            "softening": "spring",
            "adhesion": "foot",
            "perspective": "film_height",
            "rolling_shutter": "film_time",
        }
        return of_hidden(t, seed, acts_on.get(t.outside, "carriage"))
    if campaign in FIRST:
        f = faults.truth(FIRST[campaign] + number, seed)
        named = (f.force,) if f.force else ()
        return laboratories.made(f, seed).task, Hidden(f.kind, named, fault_of(f), scatter=f.part == "scatter")
    if campaign == "forces":
        turn, kind = divmod(number, len(FORCES))
        return of_hidden(hidden.truth(8 * turn + FORCES[kind], seed), seed)
    t = hidden.truth(8 * (number // 2) + number % 2 if campaign == "tails" else 8 * number, seed)
    return of_hidden(replace(t, instrument=("t3", "outliers")[number // 2 % 2]) if campaign == "tails" else t, seed)


def run(seed: int, case: tuple[str, int]) -> Row:
    """Return the row of one case: its answer judged, or how it failed."""
    campaign, number = case
    began = time.process_time()
    row: Row = {"campaign": campaign, "number": number, "seed": seed}
    try:
        task, what = made(campaign, number, seed)
        began = time.process_time()
        if isinstance(task, machines.World):
            d = jv.diagnose(list(task.recordings), machines.study(task.machine), budget=20_000)
        else:
            d = diagnose_jumps(task)
        row |= row_of(d, what)
        row["verdict"] = judge(row, what)
    except Exception as e:  # a benchmark's table must show what broke, whatever it was
        where = traceback.extract_tb(e.__traceback__)[-1]
        said = f"{type(e).__name__}: {str(e)[:160]} ({Path(where.filename).name}:{where.lineno})"
        row |= {"verdict": "failed", "kind": "failed", "hidden": "-", "sentence": said}
    return row | {"processor_s": time.process_time() - began}


def share(count: int, n: int) -> str:
    """Return `x of n: percentage (95 % interval)`."""
    low, high = binomtest(count, n).proportion_ci(0.95)
    return f"{count} of {n}: {100 * count / n:.0f} % ({100 * low:.0f} to {100 * high:.0f})"


def report(rows: Sequence[Row]) -> str:
    """Return the tables, worst kind first, then what is not right."""
    lines = ["| campaign: hidden | right | else |", "|---|---|---|"]
    groups: dict[tuple[str, str], list[Row]] = {}
    for r in rows:
        groups.setdefault((r["campaign"], "all"), []).append(r)
        groups.setdefault((r["campaign"], r["kind"]), []).append(r)
    good = {k: sum(r["verdict"] == "right" for r in some) for k, some in groups.items()}
    for k, some in sorted(groups.items(), key=lambda x: (x[0][0], x[0][1] != "all", good[x[0]] / len(x[1]))):
        other = Counter(r["verdict"] for r in some if r["verdict"] != "right")
        lines.append(
            f"| {': '.join(k)} | {share(good[k], len(some))} | {', '.join(f'{v} {n}' for v, n in other.items())} |"
        )
    held = [v for r in rows if r["verdict"] == "right" for v in r["covers"].values()]
    chances = np.array([p for r in rows for p in r.get("probability", {}).values()]).reshape(-1, 2)
    lines += ["", "| of all | |", "|---|---|"]
    if held:
        lines.append(f"| 90 % intervals of what is named hold the truth | {share(sum(held), len(held))} |")
    for low, high in ((0.0, 0.1), (0.1, 0.5), (0.5, 0.95), (0.95, 1.01)):
        some = chances[(chances[:, 0] >= low) & (chances[:, 0] < high)]
        if len(some):
            lines.append(
                f"| stated probability {some[:, 0].mean():.3f}: true in | {share(int(some[:, 1].sum()), len(some))} |"
            )
    used = [r["processor_s"] for r in rows]
    lines += [f"| processor time of a case, median; greatest [s] | {np.median(used):.1f}; {max(used):.0f} |", ""]
    lines += [f"* {r['campaign']} {r['number']}, {r['hidden']}: {r['verdict']}; {r['sentence'][:160]}"
              for r in rows if r["verdict"] != "right"]  # fmt: skip
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.causes", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("campaign", nargs="+", choices=CAMPAIGNS)
    parser.add_argument("--seed", type=int, default=31001)
    parser.add_argument("--cases", default=":", help="A:B of each campaign")
    parser.add_argument("--rows", help="file of one JSON line a case; those already there are not made again")
    parser.add_argument("--workers", type=int, default=2)
    args = parser.parse_args()
    first, _, last = args.cases.partition(":")
    wanted = [(c, n) for c in args.campaign for n in range(CAMPAIGNS[c])[int(first or 0) : int(last) if last else None]]
    file = Path(args.rows or os.devnull)
    rows = [json.loads(x) for x in file.read_text(encoding="utf-8").splitlines()] if args.rows and file.exists() else []
    rows = [r for r in rows if r["seed"] == args.seed and (r["campaign"], r["number"]) in wanted]
    done = {(r["campaign"], r["number"]) for r in rows}
    with file.open("a", encoding="utf-8") as kept, ProcessPoolExecutor(args.workers) as pool:
        jobs = [pool.submit(partial(run, args.seed), case) for case in wanted if case not in done]
        for job in as_completed(jobs):
            rows.append(job.result())
            print(json.dumps(rows[-1], default=float), file=kept, flush=True)
    print(report(sorted(rows, key=lambda r: (r["campaign"], r["number"]))))


if __name__ == "__main__":
    main()
