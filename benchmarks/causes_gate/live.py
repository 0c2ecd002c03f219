"""The loop: linearise, search, refit the best, linearise there, until the best set stays."""
import sys, pickle, time, json, traceback
sys.path.insert(0, "GATE")
from columns import *
import score as sc
from jumpvision.engine.vary.apart import variables as _v
from jumpvision.engine.vary.odd import set_aside
from jumpvision.engine.vary.patterns import Pattern, Weighed
from jumpvision.engine.system import parameters
KIND = {"odd": Kind.ODD, "step": Kind.STEP, "drift": Kind.DRIFT, "function": Kind.FUNCTION, "common": Kind.STEP}

def means(c, G, causes):
    """Coefficients of the linear columns of a set, in order."""
    C = c.causes; cols, w, fixed = [], [], []
    for k, width in causes:
        if C[k].fixed: fixed.append(C[k].columns[0])
        else: cols += C[k].columns; w += list(np.broadcast_to(np.asarray(C[k].widths[width], float), len(C[k].columns)))
    if not cols: return []
    row = G[0] - G[fixed].sum(0) if fixed else G[0]
    w = np.array(w); A = np.eye(len(w)) + w[:, None] * G[np.ix_(cols, cols)] * w
    return list(w * np.linalg.solve(A, w * row[cols]))

from final import what_told
def told(c, causes): return frozenset(what_told(c.causes[k]) for k, _ in causes)

def refit(problem, about, c, G, causes, iterations=10):
    """The nonlinear fit of a set (what cannot be refitted stays linear); (problem with its system, fit over all)."""
    C = c.causes; s0 = problem.system; m = iter(means(c, G, causes)); d = c.d
    mech, weighed, start, aside, templates = [], [], {b[0]: b[5] for b in d["base"]}, set(), []
    vs = _v(s0)
    for k, _ in causes:
        x = C[k]
        if x.fixed: aside.add(x.part[0]); continue
        b = [next(m) for _ in x.columns]
        if x.key[0] in ("mechanism", "template"):
            name = x.key[1]; mech.append(name)
            if x.key[0] == "template": templates.append(name)
            cand = None
            if x.part != ("fitted",): start_shape = x.part
            else: start_shape = None
            start[("mech", name)] = (b[0], start_shape)
        elif x.key[2] != "scatter":
            q = [j for j in range(len(d["designs"])) if c.iN + [*d["numbers"]].index(x.key[1]) * len(d["designs"]) + j == x.columns[0]][0]
            kind, of, members, br, col = d["designs"][q]
            v = vs[x.key[1]]
            weighed.append(Weighed(Pattern((v,), KIND[kind], of, np.asarray(col)[:, None], members, break_at=float("nan") if br is None else float(br)), np.array([b[0]]), np.eye(1), 0.0, 0.0))
    s = s0
    if templates: s = s.considering([f for n, f in forms(s.model).items() if n in templates])
    if weighed: s = s.varying(weighed)
    names = (*mech, *[w.pattern.name for w in weighed])
    p = problem.asked_of(s); first = {}
    for par in parameters(s, names): first[par.name] = start.get(par.name, par.start)
    for n in mech:
        cand = s.candidates[n]; (strength, shape) = start["mech", n]
        first[cand.parameters[0].name] = float(np.clip(cand.null + strength, cand.parameters[0].low, cand.parameters[0].high))
        if shape is not None:
            for par, v in zip(cand.parameters[1:], shape): first[par.name] = v
    for w in weighed: first[coefficient(w.pattern.name, 0)] = float(w.coefficients[0])
    q = p.asked_of(set_aside(s, sorted(aside))) if aside else p
    f = q.fit(names, first, iterations=iterations)
    if f is None: return None
    return p, at(p, names, f.values), aside

def own_evidence(d, c, causes, ff, se):
    """ln prior x evidence of a set linearised about its own fit, over all widths."""
    C = c.causes; y = np.concatenate(ff.residuals).astype(float); J = np.concatenate(ff.jacobian).astype(float); ends = np.cumsum([0, *d["sizes"]])
    names = [q.name for q in ff.parameters]; order = [*ff.mechanisms]; blocks, used = [], set()
    mech = [x for x in causes if not C[x[0]].fixed and C[x[0]].key[0] != "number"]; num = [x for x in causes if not C[x[0]].fixed and C[x[0]].key[0] == "number" and C[x[0]].key[2] != "scatter"]
    for (k, _), m in zip([*mech, *num], order):
        cand = ff_system.candidates[m]; cols = [names.index(q.name) for q in cand.parameters if names.index(q.name) not in used]; used |= set(cols)
        first = cand.parameters[0]; null = cand.null if C[k].key[0] != "number" else 0.0
        y += J[:, cols[0]] * (ff.values[cols[0]] - null)
        more = [q.scale if not math.isfinite(q.sigma) else min(q.scale, q.sigma) for q in cand.parameters if names.index(q.name) in cols][1:]
        w0 = C[k].widths; w0 = [float(np.ravel(w)[0]) for w in w0]
        sign = C[k].sign
        blocks.append((cols, [np.array([w, *more]) for w in w0], sign))
    for k, _ in causes:
        if C[k].fixed:
            i, what = C[k].part; o = next(o for o in c.offs[i] if o[2] == what); y[ends[i]:ends[i + 1]] -= o[3]
    free = [j for j, q in enumerate(ff.parameters) if j not in used and not q.at_end(ff.values[j])]
    M = np.column_stack([y, J[:, free], *[J[:, b[0]] for b in blocks]]); G = M.T @ M; k = len(free)
    rows = ff.known.rows[:, free]; pull = ff.known.pull(ff.values); G[0, 0] += pull @ pull
    A = G[1:1 + k, 1:1 + k] + rows.T @ rows + np.diag([12.0 / (ff.parameters[j].high - ff.parameters[j].low) ** 2 for j in free]); b = G[1:1 + k].copy(); b[:, 0] += rows.T @ pull
    const = 0.0
    if k: L = np.linalg.cholesky(A + 1e-9 * np.diag(np.diag(A))); Z = np.linalg.solve(L, b); G = G - Z.T @ Z; const = -float(np.log(np.diag(L)).sum())
    import itertools
    H, r = G[1 + k:, 1 + k:], G[0, 1 + k:]; got = []
    for combo in itertools.product(*[b[1] for b in blocks]):
        w = np.concatenate(combo) if combo else np.zeros(0)
        if not w.size: got.append(se.noise(G[0, 0])); continue
        A = np.eye(w.size) + w[:, None] * H * w; L = np.linalg.cholesky(A); z = np.linalg.solve(L, w * r); mean = np.linalg.solve(L.T, z); cov = np.linalg.inv(A); sg, j = 0.0, 0
        for cols, ws, sign in blocks:
            if sign: sg += math.log(2) + float(sc.log_ndtr(sign * mean[j] / math.sqrt(cov[j, j])))
            j += len(cols)
        got.append(se.noise(G[0, 0] - z @ z) - float(np.log(np.diag(L)).sum()) + sg)
    return float(sc.logsumexp(got) - math.log(len(got))) + const + se.prior_of([k for k, _ in causes])[0]

def key_of(c, causes): return frozenset((c.causes[k].key, c.causes[k].part if c.causes[k].key[0] not in ("mechanism", "template") else ()) for k, _ in causes)

def prior_nats(c, causes):
    return sc.Search(c, np.zeros((1, 1)) if False else c._G, 0.0, 0.0).prior_of([k for k, _ in causes])[0]

def diagnose(task, verbose=False, refits=4, rounds=11):
    problem, learned = prepared(task)
    about, p = base_fit(problem, np.random.default_rng(1)), problem
    start = about; own, exchanged, current = {}, set(), None
    state, log = frozenset(), []; stages = []
    for r in range(rounds):
        d = linearised(p, about, with_bumps=False); c = sc.Columns(d)
        G, k = c.without_base(c.gram(c.plain)); se = sc.Search(c, G, k, 0.0); se.most = min(r + 1, sc.MOST); se.path = True
        seen = sorted(se.run().values(), key=lambda x: -x[0])
        best = key_of(c, seen[0][1])
        stages.append((state, d))
        log.append(f"    round {r}: chi2/n {sum(x @ x for x in about.residuals) / problem.n:.2f} at {[x[0][1:] if len(x[0])>1 else x[0] for x in state]}: best {seen[0][0]-se.seen[frozenset()][0]:.0f} nats over none {[(x[0][1:] , x[1]) for x in best]}")
        if verbose: print(log[-1], flush=True)
        def fitted(plan_, most, near):
            """The sets of a plan about their own fits, the best first."""
            global ff_system
            tried, results = set(), []
            for v, causes in plan_:
                kk = key_of(c, causes)
                if kk in tried or len(tried) >= most or not kk: continue
                if v < near: break
                tried.add(kk)
                try: got = refit(problem, about, c, G, causes)
                except Exception as e:
                    print("refit", repr(e)[:150]); continue
                if got is None: continue
                pp, ff, aside = got; ff_system = pp.system
                results.append((own_evidence(d, c, causes, ff, se), kk, pp, ff)); own[kk] = results[-1][0], told(c, causes)
            return sorted(results, key=lambda x: -x[0])
        if current is None: current = se.seen[frozenset()][0]
        reach = max(0.25 * (seen[0][0] - se.seen[frozenset()][0]), 12)
        results = fitted([x for x in seen if x[1] and key_of(c, x[1]) != state][:40], refits, seen[0][0] - reach) if best != state else []
        if not results or results[0][0] <= current:  # what could stand in the place of each of its members, or need not
            mine = next((cs for _, cs in seen if key_of(c, cs) == state), None)
            if not mine or state in exchanged: break
            exchanged.add(state); plan_ = [mine]
            for x in mine:
                rest = sc.State(tuple(y for y in mine if y != x)); have = {told(c, [x])}
                if rest.causes: plan_.append(rest.causes)
                if c.causes[x[0]].fixed: continue
                for v, cs in sorted(se.extended(rest), key=lambda z: -z[0]):
                    if told(c, cs[-1:]) not in have and len(have) < 4: have.add(told(c, cs[-1:])); plan_.append(cs)
                if c.causes[x[0]].key[0] == "template":  # two of the list in the place of one law that is not
                    se.most = sc.MOST
                    of_list = lambda cs: c.causes[cs[-1][0]].key[0] == "mechanism"
                    for _, one in [z for z in sorted(se.extended(rest), key=lambda z: -z[0]) if of_list(z[1])][:3]:
                        plan_ += [z[1] for z in sorted(se.extended(sc.State(one)), key=lambda z: -z[0]) if of_list(z[1])][:1]
            results = fitted([(0.0, cs) for cs in plan_], 99, -1.0)
            if not results or results[0][0] <= current + 0.1 or results[0][1] == state: break
        current, state, p, about = results[0]
    if stages[-1][0] != state: d = linearised(p, about, with_bumps=False)
    d["bumps"] = bumps(p, about)
    first = stages[0][1]
    if stages[0][0] != state: first["bumps"] = bumps(problem, start)
    return {"d": d, "state": state, "first": first, "log": log, "own": list(own.values())}

if __name__ == "__main__":
    from today import *
    (HERE / "live").mkdir(exist_ok=True)
    for key in sys.argv[1:]:
        raw = HERE / "raw" / f"{key}.pkl"; to = HERE / "live" / f"{key}.pkl"
        if to.exists(): continue
        t = time.process_time()
        task, what = pickle.loads(raw.read_bytes())
        print(key, what.kind, what.named, what.fault and (what.fault.words[:2], what.fault.kinds, sorted(what.fault.apart)[:6], what.fault.of), what.law, flush=True)
        try:
            out = diagnose(task, True); out["what"] = what; out["s"] = time.process_time() - t
            to.write_bytes(pickle.dumps(out, protocol=4)); print("   ", round(out["s"], 1), "s", flush=True)
        except Exception: print(traceback.format_exc()[-900:], flush=True)
