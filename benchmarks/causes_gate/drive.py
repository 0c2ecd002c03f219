import sys; sys.path.insert(0, "GATE")
from live import *
from today import *
import watch; watch.all_of()
from jumpvision.engine.discovery import Laws
from jumpvision.engine.order import Order, silent
from jumpvision.jumper.question.discovered import JumperForms
from jumpvision.jumper.question.words import diagnosis_of
def named_only(task):
    """Today's naming, without what it is worth."""
    learned = learn_noise(Jumper(task.jumps, task.ranges, task.priors, workers=1)); problem = Problem(learned.system, learned.noise, learned.scatter)
    order = Order(problem, np.random.default_rng(1), by=("kind",), stops=[j.stop for j in task.jumps], laws=lambda p: Laws(p, JumperForms(p.system), silent))
    return diagnosis_of(order.explain(order.look()), learned)
rows = HERE / "today.jsonl"; (HERE / "live").mkdir(exist_ok=True)
ORDER = sys.argv[1] if len(sys.argv) > 1 else "both"
import os
mixed = [x for x in __import__("today").mixed()]
WANTED = sys.argv[1].split(',')
rank = {x: i for i, x in enumerate(mixed)}
for c, number, half in [x for x in sorted(plan(), key=lambda x: rank[x]) if f'{x[2]}-{x[0]}-{x[1]}' in WANTED]:
    key = f"{half}-{c}-{number}"; raw, to = HERE / "raw" / f"{key}.pkl", HERE / "live" / f"{key}.pkl"
    done = {(r["campaign"], r["number"], r["half"]) for r in map(json.loads, rows.read_text().splitlines())}
    try:
        task, what = pickle.loads(raw.read_bytes()) if raw.exists() else made(c, number, SEEDS[half])
        raw.write_bytes(pickle.dumps((task, what)))
        if not to.exists():
            t = time.process_time(); out = diagnose(task); out["what"] = what; out["s"] = time.process_time() - t
            to.write_bytes(pickle.dumps(out, protocol=4))
            print("live", key, what.kind, what.named, what.fault and (what.fault.words[:2], what.fault.kinds, sorted(what.fault.apart)[:6], what.fault.of), what.law, round(out["s"]), "s", flush=True); print("\n".join(out["log"]), flush=True)
        bare = HERE / "live" / f"{key}-bare.pkl"
        if c == "laws" and not bare.exists():
            import columns; kept = columns.TEMPLATES; columns.TEMPLATES = ()
            try: t = time.process_time(); out = diagnose(task); out["what"] = what; out["s"] = time.process_time() - t; bare.write_bytes(pickle.dumps(out, protocol=4)); print("bare", key, round(out["s"])); print("\n".join(out["log"]), flush=True)
            finally: columns.TEMPLATES = kept
    except Exception: print(key, traceback.format_exc()[-900:], flush=True)

for c, number, half in sorted(plan(), key=lambda x: (x[0] == 'laws', rank[x])):
    key = f"{half}-{c}-{number}"; raw, to = HERE / "raw" / f"{key}.pkl", HERE / "live" / f"{key}.pkl"
    done = {(r["campaign"], r["number"], r["half"]) for r in map(json.loads, rows.read_text().splitlines())}
    task, what = pickle.loads(raw.read_bytes()) if raw.exists() else (None, None)
    if (c, number, half) in done or not to.exists(): continue
    row = {"campaign": c, "number": number, "half": half, "seed": SEEDS[half]}; began = time.process_time()
    try:
        watch.COUNT.clear()
        d = named_only(task); row["rules"] = dict(watch.COUNT)
        row |= row_of(d, what); row["verdict"] = judge(row, what)
    except Exception as e: row |= {"verdict": "failed", "sentence": repr(e)[:200], "trace": traceback.format_exc()[-600:]}
    row["s"] = time.process_time() - began
    with rows.open("a") as f: print(json.dumps(row, default=str), file=f)
    print("today", key, row.get("hidden"), row["verdict"], round(row["s"]), row.get("sentence", "")[:100], flush=True)
