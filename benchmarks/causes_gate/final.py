"""From the linearised campaign to what is named: kernels of what is not listed, posterior, twins, the row that is judged."""
import sys, pickle, json, time, math; sys.path.insert(0, "GATE")
import numpy as np
from scipy.special import logsumexp
import score as sc
OPT = {"which": "bumps+time", "library": True, "survive": True, "top": 3}

def small(d, phi=None, cols=None, scale=None):
    """(q, const) of a fit's residuals with all its parameters flat, beside a covariance."""
    y, J = d["y"].astype(float), d["J"].astype(float); M = np.column_stack([y, J]); ld = 0.0
    if phi is not None:
        out = np.zeros((M.shape[1],) * 2); at = 0
        for p, n in zip(phi, d["sizes"]):
            m = M[at:at + n]; at += n; A = np.eye(p.shape[1]) + p.T @ p; L = np.linalg.cholesky(A); Z = np.linalg.solve(L, p.T @ m)
            out += m.T @ m - Z.T @ Z; ld -= float(np.log(np.diag(L)).sum())
    elif cols is not None:
        B = cols * scale; A = np.eye(B.shape[1]) + B.T @ B; L = np.linalg.cholesky(A); Z = np.linalg.solve(L, B.T @ M); out = M.T @ M - Z.T @ Z; ld = -float(np.log(np.diag(L)).sum())
    else: out = M.T @ M
    k = J.shape[1]; live = np.diag(out)[1:] > 1e-12; A = out[1:, 1:][np.ix_(live, live)]; b = out[1:, 0][live]
    s = np.sqrt(np.diag(A)); A = A / np.outer(s, s) + 1e-9 * np.eye(len(s)); q = out[0, 0] - (b / s) @ np.linalg.solve(A, b / s)
    return q, ld - 0.5 * np.linalg.slogdet(A)[1]

def options(d):
    """Kernels: name, amplitudes -> how it is made."""
    bodies = {}
    for b in d["bumps"]: bodies.setdefault(b["body"], []).append(b)
    out = {n: ("bump", [(np.stack([b["column"] for b in bs], 1).astype(float), np.array([b["scale"] for b in bs]))]) for n, bs in bodies.items()}
    if OPT["which"] == "time": out = {}
    for r in range(len(d["bases"])): out[f"time{r}"] = ("time", r)
    return out

def chosen(d):
    """[(ln Z about the fit, name, amplitude)], the best amplitude of every kernel, best first."""
    got = []
    for name, (kind, what) in options(d).items():
        best = None
        for a in sc.AMPLITUDES[kind]:
            q, k = small(d, phi=[p.astype(float) * a for p in d["bases"][what]]) if kind == "time" else small(d, cols=what[0][0], scale=a * what[0][1])
            v = -0.5 * q + k
            if best is None or v > best[0]: best = (v, name, a)
        got.append(best)
    return sorted(got, reverse=True)

def covered(c, name, a, n_kernels, bodies):
    """(Gram, const, ln prior) under one kernel."""
    lf = -math.log(sc.FAMILIES) - math.log(2) - math.log(n_kernels) - math.log(5)
    plain = c.plain_gram
    if name in bodies:
        cols = bodies[name]; scale = np.array([c.scale_of(j) for j in cols]) * a
        if OPT["library"]:
            g = list(range(c.iG, c.iG + c.ng)); norm = np.sqrt(np.diag(plain)[g]); ref = np.sqrt((np.diag(plain)[cols] * scale ** 2).mean())
            cols = cols + g; scale = np.concatenate([scale, [sc.WIDTHS[0] * c.scale_of(j) for j in g]])
        A = np.eye(len(cols)) + scale[:, None] * plain[np.ix_(cols, cols)] * scale
        L = np.linalg.cholesky(A); Z = np.linalg.solve(L, scale[:, None] * plain[cols]); H = plain - Z.T @ Z; ld = -float(np.log(np.diag(L)).sum())
    else:
        each, ld = [], 0.0
        for m, phi in zip(c.local, c.d["bases"][int(name[4:])]):
            phi = phi.astype(float) * a; A = np.eye(phi.shape[1]) + phi.T @ phi; L = np.linalg.cholesky(A); Z = np.linalg.solve(L, phi.T @ m)
            each.append(m.T @ m - Z.T @ Z); ld -= float(np.log(np.diag(L)).sum())
        H = c.gram(each)
        if OPT["library"]:
            g = list(range(c.iG, c.iG + c.ng)); norm = np.sqrt(np.diag(plain)[g])
            ref = math.sqrt(c.n) * a; scale = ref / np.maximum(norm, 1e-300) / math.sqrt(len(g))
            A = np.eye(len(g)) + scale[:, None] * H[np.ix_(g, g)] * scale; L = np.linalg.cholesky(A); Z = np.linalg.solve(L, scale[:, None] * H[g]); H = H - Z.T @ Z; ld -= float(np.log(np.diag(L)).sum())
    G, k = c.without_base(H)
    return G, k + ld, lf

def posterior(out):
    """[(ln posterior, kernel, set of causes, columns)] pooled over the two points."""
    d1, d0 = out["d"], out["first"]; same = not out["state"]
    pool = []
    for d, last in ((d1, True),) if same else ((d1, True), (d0, False)):
        c = sc.Columns(d); c.plain_gram = c.gram(c.plain); bodies = {}
        for j, b in enumerate(d["bumps"]): bodies.setdefault(b["body"], []).append(c.iG + c.ng + j)
        G, k = c.without_base(c.plain_gram)
        ks = [("listed", 0.0, G, k, 0.0)]
        ch = chosen(d); nk = len(ch)
        for v, name, a in ch[:OPT["top"]]: ks.append((name, a, *covered(c, name, a, nk, bodies)))
        for name, a, G, k, price in ks:
            s = sc.Search(c, G, k, price)
            if last:
                for v, causes in s.run().values():
                    if causes or same: pool.append((v, f"{name}", causes, c))
            else:
                none = sc.State((), s.noise(G[0, 0]) + k + s.prior_of([])[0]); pool.append((none.score, name, (), c))
                # a number that scatters is a covariance, as what is not listed is: no fit of its own
                pool += [(v, name, causes, c) for v, causes in s.extended(none) if c.causes[causes[0][0]].key[-2:-1] == ("scatter",)] if name == "listed" else []
            if not last and OPT["survive"] and name != "listed" and name == ch[0][1]:  # beside what is not listed, about the baseline
                out["about base"] = sorted(((v, frozenset(what_told(c.causes[i]) for i, _ in causes)) for v, causes in s.run().values()), key=lambda x: -x[0])
    own = {}
    for v, t in out.get("own", ()): own[t] = max(v, own.get(t, -np.inf))
    for t, v in own.items():  # sets that have been fitted: about their own fit
        mine = [i for i, p in enumerate(pool) if p[1] == "listed" and not isinstance(p[2], frozenset) and frozenset(what_told(p[3].causes[k]) for k, _ in p[2]) == t]
        if mine:
            shift = v - max(pool[i][0] for i in mine)
            for i in mine: pool[i] = (pool[i][0] + shift, *pool[i][1:])
        else: pool.append((v, "listed", t, pool[0][3]))  # not among those looked at linearly
    return sorted(pool, key=lambda x: -x[0])

BODY = {"foot": "foot", "rail": "carriage", "spring": "spring", "shutter": "film_time", "clock": "film_time", "lens": "film_height"}
SAME = {"scale": ("mechanism", "camera_scale"), "clock_offset": ("mechanism", "time_offset"), "spring_stiffness": ("mechanism", "spring_stiffness"),
        "spring_damping": ("mechanism", "spring_damping"), "clock_rate": ("law", "film_time"), "motor_mass": ("mechanism", "payload"), "gravity": ("mechanism", "gravity")}
def what_told(x):
    """How a cause is told: what is the same under two names is one."""
    k = x.key
    if k[0] == "template": return ("law", BODY[k[1].split("_")[0]])
    if k[0] == "number" and k[2] == "common" and k[1] in SAME: return SAME[k[1]]
    if k[0] == "number" and k[2] in ("drift", "step") and k[3] in ("order", "time"): return (*k[:3], "order")
    if k[0] == "number" and k[2] == "odd": return (*k[:3], x.part[0])
    if k[0] in ("slip", "command"): return (*k, x.part[0])
    return k

def decide(out):
    pool = posterior(out); lp = np.array([p[0] for p in pool]); w = np.exp(lp - logsumexp(lp))
    sets = [causes if isinstance(causes, frozenset) else frozenset(what_told(c.causes[k]) for k, _ in causes) for _, _, causes, c in pool]; kern = [p[1] for p in pool]
    incl, kp = {}, {}
    for s, p, k in zip(sets, w, kern):
        kp[k] = kp.get(k, 0) + p
        for t in s: incl[t] = incl.get(t, 0) + p
    empty = sum(p for s, p, k in zip(sets, w, kern) if not s and k == "listed")
    nl = 1 - kp.get("listed", 0)
    best = sets[0]; causes, c = pool[0][2], pool[0][3]
    named, either = [], []
    def survives(t):
        if nl < 0.5 or not OPT["survive"]: return True
        for k in kp:
            if k == "listed": continue
            mine = [(p, s) for p, s, kk in zip(lp, sets, kern) if kk == k]; top = max(p for p, _ in mine); z = np.array([math.exp(p - top) for p, _ in mine])
            if sum(z[i] for i, (_, s) in enumerate(mine) if t in s) < 0.95 * z.sum(): return False
        if about := out.get("about base"):
            z = np.exp(np.array([v for v, _ in about]) - about[0][0])
            if sum(z[i] for i, (_, s) in enumerate(about) if t in s) < 0.95 * z.sum(): return False
        return True
    for t in best:
        if incl[t] >= sc.SURE:
            if survives(t): named.append(t)
        else:
            rest = best - {t}; alts = {t: incl[t]}
            for s, p in zip(sets[:400], w[:400]):
                if t not in s and rest <= s and len(s) == len(best): alts[next(iter(s - rest))] = incl[next(iter(s - rest))]
            top = sorted(alts, key=lambda x: -alts[x])[:4]
            tot = sum(p for s, p in zip(sets, w) if s & set(top))
            if tot >= sc.SURE and (nl < 0.5 or any(survives(t) for t in top)): either.append(top)
    return {"named": named, "either": either, "empty": empty, "nl": nl, "kern": kp, "incl": {t: p for t, p in sorted(incl.items(), key=lambda x: -x[1])[:8]}, "best": best, "pool": pool, "w": w}

def row_of(r, out):
    """The row that benchmarks.causes.judge reads."""
    names = out["d"]["names"]; row = {"named": [], "twins": [], "varies": [], "law": "", "acts_on": "", "after": None, "adequate": r["empty"] > 0.05, "status": "undetermined"}
    recs = {}
    top = r["pool"][0][2]
    if isinstance(top, frozenset):
        for t in top: recs[t] = [((t[3],), None)] if t[0] == "number" and t[2] == "odd" else [()]
        top = ()
    for k, _ in top:
        x = r["pool"][0][3].causes[k]
        recs.setdefault(what_told(x), []).append(x.part)
    def tell(t, twins=()):
        if t[0] == "mechanism": row["named"].append(t[1])
        elif t[0] == "law": row["law"], row["acts_on"] = "template", t[1]
        else:
            param = t[1] if t[0] in ("number", "slip") else {"lost": "lost_frames", "command": "command of another recording"}[t[0]]
            kind = t[2] if t[0] == "number" else "odd"; of = t[3] if t[0] == "number" and kind != "odd" else None
            who = [names[p[0]] for p in recs[t]] if t[0] != "number" else [names[i] for p in recs[t] for i in p[0]] if recs[t][0] else []
            row["varies"].append({"parameter": param, "kind": kind, "of": of, "recordings": who, "established": True})
    for t in r["named"]: tell(t)
    for top in r["either"]:
        mech = [t[1] for t in top if t[0] == "mechanism"]
        if top[0][0] == "mechanism": row["named"].append(top[0][1]); row["twins"].append(mech)
        elif len({t[:2] for t in top}) == 1 and top[0][0] == "law": tell(top[0])
    # one entry of a number that several recordings have each for itself
    odd = {}
    for v in [v for v in row["varies"] if v["kind"] == "odd"]:
        odd.setdefault(v["parameter"], v)
        if odd[v["parameter"]] is not v: odd[v["parameter"]]["recordings"] += v["recordings"]; row["varies"].remove(v)
    return row

if __name__ == "__main__":
    sys.path.insert(0, ".")
    from pathlib import Path
    from benchmarks.causes.judge import judge
    files = [Path(f) for f in sys.argv[1:] if f.endswith(".pkl")]
    for o in sys.argv[1:]:
        if "=" in o: k, v = o.split("="); OPT[k] = type(OPT[k])(eval(v)) if not isinstance(OPT[k], str) else v
    for f in files:
        out = pickle.load(open(f, "rb")); what = out["what"]; t = time.process_time()
        try: r = decide(out); row = row_of(r, out); v = judge(row, what)
        except Exception as e:
            import traceback; print(f.stem, traceback.format_exc()[-500:]); continue
        print(f"{f.stem} [{what.kind} {what.named} {what.fault and (what.fault.words[:1], what.fault.kinds, sorted(what.fault.apart)[:3], what.fault.of)} {what.law}] -> {v} named {r['named']} either {r['either']} empty {r['empty']:.2g} nl {r['nl']:.2f} {time.process_time()-t:.0f} s", flush=True)
        p, k, s, c = r["pool"][0][0], r["pool"][0][1], r["pool"][0][2], r["pool"][0][3]
        for (v, k, s, c), w in list(zip(r["pool"], r["w"]))[:3]: print(f"      {w:.3f} {v - p:7.1f} {k} " + "; ".join(f"{c.causes[i].key} {str(c.causes[i].part)[:30]}" for i, _ in s))
