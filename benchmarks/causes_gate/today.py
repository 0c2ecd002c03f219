"""Today's naming on fresh campaigns: pickles the task and its truth, one JSON line a case with the verdict."""
import json, pickle, sys, time, traceback
from pathlib import Path
import jumpvision as jv
from benchmarks.causes import machines
from benchmarks.causes.__main__ import made
from benchmarks.causes.judge import judge, row_of
from tests.worlds.jumps import diagnose_jumps

HERE = Path("GATE")
SEEDS = {"tune": 73101, "judge": 73202}
def mixed(): return plan(False)
def plan(laws_last=True):
    take = {"none": (4, lambda k: k), "forces": (12, lambda k: k), "laboratories": (10, lambda k: k), "both": (6, lambda k: k),
            "laws": (8, lambda k: 4 * k + 2 if k < 8 else 0), "tails": (4, lambda k: k), "scatter": (2, lambda k: k), "machines": (0, lambda k: 7 * k)}
    every = []
    for c, (n, at) in take.items():
        for k in range(n):
            for h, half in enumerate(SEEDS):
                number = at(k)
                if c == "laboratories": number = k + 10 * h
                if c == "laws": number = (4 * k + 2 * h) if k < 6 else 32 + 5 * k + h
                if c == "machines": number = 7 * k + (2 * k + 3 * h) % 7
                if c == "scatter": number = 2 * h + k
                every.append(((k + 0.5) / n, c, number, half))
    return sorted((x[1:] for x in sorted(every)), key=lambda x: x[0] == 'laws') if laws_last else [x[1:] for x in sorted(every)]
if __name__ == "__main__":
    rows = HERE / "today.jsonl"
    done = {(r["campaign"], r["number"], r["half"]) for r in map(json.loads, rows.read_text().splitlines())} if rows.exists() else set()
    for c, number, half in plan():
        if (c, number, half) in done: continue
        row = {"campaign": c, "number": number, "half": half, "seed": SEEDS[half]}
        try:
            raw = HERE / "raw" / f"{half}-{c}-{number}.pkl"
            task, what = pickle.loads(raw.read_bytes()) if raw.exists() else made(c, number, SEEDS[half])
            raw.write_bytes(pickle.dumps((task, what)))
            began = time.process_time()
            d = jv.diagnose(list(task.recordings), machines.study(task.machine), budget=20_000) if c == "machines" else diagnose_jumps(task)
            row |= row_of(d, what); row["verdict"] = judge(row, what)
        except Exception as e:
            row |= {"verdict": "failed", "sentence": repr(e)[:200], "trace": traceback.format_exc()[-600:]}
        row["s"] = time.process_time() - began
        with rows.open("a") as f: print(json.dumps(row, default=str), file=f)
        print(c, number, half, row.get("hidden"), row["verdict"], round(row["s"]), row.get("sentence", "")[:100], flush=True)
