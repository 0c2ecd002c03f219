"""Today against the new score, by group."""
import sys, json, pickle; sys.path.insert(0, "GATE"); sys.path.insert(0, ".")
from pathlib import Path
from collections import Counter, defaultdict
import numpy as np
from scipy.stats import binomtest
from final import *
from benchmarks.causes.judge import judge
HERE = Path("GATE")
store = HERE / "new.jsonl"
def sort_of(row, verdict, what, either=()):
    """right; more (with an extra); mis (named what is not); A or B (the truth among them); open (undetermined or partial); missed; alarm."""
    if what.law:
        if verdict in ("right", "poor law"): return "right"
        if verdict == "no law": return "told"
        return {"missed": "missed"}.get(verdict, "mis")
    if verdict == "right": return "right"
    if verdict in ("missed", "false alarm", "unstated"): return {"missed": "missed", "false alarm": "alarm", "unstated": "open"}[verdict]
    if verdict == "part": return "A or B" if either else "open"
    if verdict == "wrong":
        if row.get("twinned"): return "A or B"
        right = set(what.named) & set(row["named"]) or any(what.fault and what.fault.fits(v) for v in row["varies"])
        return "more" if right else "mis"
    return verdict
def twinned(row, what):
    """Whether every number that today's answer names has the truth among its declared twins."""
    f = what.fault
    if not f or not row["varies"] or set(row["named"]) - set(what.named) - f.akin: return False
    for v in (v for v in row["varies"] if v["established"]):
        if f.fits(v): continue
        mine = next((t for t in row["twins"] if any(str(x).startswith(v["parameter"]) for x in t)), [])
        if not any(f.fits({**v, "parameter": str(x).split(" of ")[0]}) for x in mine): return False
    return True
if __name__ == "__main__":
    have = {}
    if store.exists() and "again" not in sys.argv: have = {r["key"]: r for r in map(json.loads, store.read_text().splitlines())}
    for f in sorted((HERE / "live").glob("*.pkl")):
        if f.stem in have: continue
        out = pickle.load(open(f, "rb")); what = out["what"]
        try: r = decide(out); row = rowed(r, out) if False else row_of(r, out); v = judge(row, what)
        except Exception as e: print(f.stem, repr(e)[:200]); continue
        hit = [t for t in r["either"]]
        truth = lambda t: (t[0] == "mechanism" and t[1] in what.named) or (t[0] != "mechanism" and what.fault and what.fault.fits({"parameter": str(t[1] if len(t) > 1 else t[0]), "kind": t[2] if t[0] == "number" else "odd", "of": t[3] if len(t) > 3 and t[2] != "odd" else None}))
        s = sort_of(row, v, what, bool(hit) and all(any(truth(t) for t in g) for g in hit))
        have[f.stem] = {"key": f.stem, "verdict": v, "sort": s, "kind": what.kind, "hidden": [*what.named], "law": what.law, "said": str(r["named"]) + (" either " + str(r["either"]) if r["either"] else ""), "nl": r["nl"], "empty": r["empty"], "s": out["s"], "kern": {k: round(p, 3) for k, p in r["kern"].items() if p > .01}}
        print(f.stem, what.kind, what.named, what.law, "->", s, have[f.stem]["said"][:160], f"nl {r['nl']:.2f}", flush=True)
        store.write_text("\n".join(json.dumps(x, default=str) for x in have.values()))
    today = {}
    for r in map(json.loads, (HERE / "today.jsonl").read_text().splitlines()):
        key = f"{r['half']}-{r['campaign']}-{r['number']}"
        if not (HERE / "raw" / f"{key}.pkl").exists() or r["verdict"] == "failed": continue
        what = pickle.load(open(HERE / "raw" / f"{key}.pkl", "rb"))[1]
        r["twinned"] = twinned(r, what); today[key] = sort_of(r, r["verdict"], what), r["s"]
    for half in ("tune", "judge", ""):
        print(f"--- {half or 'both halves'}: group, new on all; paired: new / today")
        table = defaultdict(lambda: [Counter(), Counter(), Counter()])
        for k, x in have.items():
            g = k.split("-")[1] + ("-bare" if k.endswith("bare") else "")
            if not k.startswith(half): continue
            for name in (g, "all" if not k.endswith("bare") else "all-bare"):
                table[name][0][x["sort"]] += 1
                if k in today: table[name][1][x["sort"]] += 1; table[name][2][today[k][0]] += 1
        for g, (a, b, c) in sorted(table.items()):
            n = sum(a.values()); ok = a["right"] + (a["told"] if "laws" in g else 0); ci = binomtest(ok, n).proportion_ci(0.95)
            print(f"{g:14s} {ok}/{n} ({100*ci.low:.0f}-{100*ci.high:.0f} %) {dict(a)} | paired {dict(b)} / {dict(c)}")
    both = [k for k in have if k in today]
    print("CPU s: new", np.mean([have[k]["s"] for k in both]) if both else "", "today", np.mean([today[k][1] for k in both]) if both else "")
