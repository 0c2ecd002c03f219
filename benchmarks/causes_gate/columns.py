"""A campaign linearised about a fit: whitened residuals and the columns of everything that may be wrong."""
from __future__ import annotations
import math, pickle, sys, time
from dataclasses import replace
import numpy as np
from jumpvision.engine.detect import _effect
from jumpvision.engine.document.values import Pattern as Kind
from jumpvision.engine.fitting import Problem
from jumpvision.engine.noise.readings import shapes
from jumpvision.engine.vary import patterns as pt
from jumpvision.engine.vary.apart import Each, variables
from jumpvision.engine.vary.candidates import coefficient
from jumpvision.engine.vary.variables import LOST, shown
from jumpvision.jumper.question.forms import forms, seen_by
from jumpvision.jumper.question.discovered import surface
from jumpvision.jumper.mechanisms.own import mechanism, parameter as own_parameter
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.learning import learn_noise

TEMPLATES = ("foot_v", "foot_sat", "foot_v_z", "foot_z", "foot_fading", "foot_z_since", "foot_relaxing", "rail_v", "rail_sat", "rail_v_exp",
             "rail_lin_patch", "spring_power", "spring_rate", "spring_hysteresis", "spring_relaxing", "shutter", "clock_rate", "lens")
SLIPS = [f for x in (10.0, 2 * math.pi, 2.0) for f in (x, 1 / x)]
SLIPPING = ("amplitude", "frequency", "motor_mass", "clock_rate")
PLACES, COUNTS = 40, (1, 2)
REACHES = (0.3, 0.1, 0.035)  # of a record

def cat(parts): return np.concatenate(parts).astype(np.float32)

def designs(problem):
    """(kind, of, members, break, column (N,)) of every pattern of a number."""
    obs, n = problem.system.observations, len(problem.all)
    out = [("common", None, (), None, np.ones(n))]
    out += [("odd", None, (i,), None, np.eye(n)[i]) for i in range(n)]
    every = list(pt.abscissae(obs))
    for of, at in every:
        if not np.isfinite(at).all(): continue
        u = pt._unit(at); places = np.unique(at)
        if of in ("order", "time"):
            if of == "time" and pt._same_order(at, obs):
                out += [("drift", of, (), None, u)]; continue
            out += [("drift", of, (), None, u)]
            for a, b in zip(places[1:-2], places[2:-1]):
                later = tuple(np.flatnonzero(at >= b).tolist()); out.append(("step", of, later, (a + b) / 2, (at >= b) * 1.0))
            continue
        out.append(("function", of, (), None, u))
        for x in places[1:-1]:
            for side in (np.maximum(at - x, 0), np.maximum(x - at, 0)): out.append(("function", of, (), float(x), side / side.max()))
        for a, b in zip(places[1:-2], places[2:-1]):
            later = tuple(np.flatnonzero(at >= b).tolist()); out.append(("function", of, later, (a + b) / 2, (at >= b) * 1.0))
    for of, members in pt.groups_of(obs):
        col = np.zeros(n); col[list(members)] = 1
        out.append(("step" if of == "session" else "function", of, tuple(members), None, col))
    return out

def effects_of(p, fit, names, most=99):
    found = []
    for name in names:
        c = p.system.candidates[name]
        if name in fit.mechanisms or c.replaces: continue
        amount, k = 0.02 * c.parameters[0].scale, c.parameters[0]
        for shape in (c.shapes if len(c.shapes) <= most else [c.shapes[int(k)] for k in np.linspace(0, len(c.shapes) - 1, most)]):
            e = _effect(p, fit, name, c, shape, amount)
            if e is None or e[1] == 0: continue
            amount = abs(e[1]); col = np.concatenate(e[0]) / e[1]
            if np.isfinite(col).all() and np.linalg.norm(col) > 0:
                found.append({"name": name, "shape": shape, "column": col.astype(np.float32), "low": k.low - c.null, "high": k.high - c.null, "scale": k.scale, "sigma": k.sigma})
    return found

def linearised(problem, fit, offsets=True, with_bumps=True):
    s = problem.system; obs = s.observations; n = len(obs)
    sizes = [r.size for r in fit.residuals]
    out = {"sizes": sizes, "y": cat(fit.residuals), "J": cat(fit.jacobian), "rows": fit.known.rows, "pull": fit.known.pull(fit.values),
           "base": [(p.name, p.start, p.low, p.high, p.sigma, float(v), p.at_end(v)) for p, v in zip(fit.parameters, fit.values)],
           "mechanisms": fit.mechanisms, "values": fit.named, "log_power": problem.noise.log_power, "drift": problem.noise.drift / problem.noise.s,
           "designs": designs(problem), "conditions": [o.condition for o in obs], "labels": [dict(o.labels) for o in obs], "names": [o.name for o in obs],
           "t": [o.t.astype(np.float32) for o in obs]}
    numbers = {}
    for name, v in variables(s).items():
        if name == LOST: continue
        c = Each(problem, fit, v).columns(fit.values, np.zeros(n), fit.residuals)
        if c is not None and np.isfinite(np.concatenate(c)).all():
            numbers[name] = {"column": cat(c), "spread": v.spread, "rare": v.rare, "declared": v.declared}
    out["numbers"] = numbers
    effects = lambda p, names, most=99: effects_of(p, fit, names, most)
    pats = getattr(s, "patterns", {}); out["patterns_in"] = list(pats)
    out["vocabulary"] = [m for m, c in s.candidates.items() if not c.replaces and m not in pats and m not in TEMPLATES]
    out["effects"] = effects(problem, out["vocabulary"])
    mine = {m: f for m, f in forms(s.model).items() if m in TEMPLATES}
    wide = problem.asked_of(s.considering(list(mine.values())))
    out["templates"] = effects(wide, list(mine), 3)
    out["bumps"] = bumps(problem, fit) if with_bumps else []
    inset, names = [], [p.name for p in fit.parameters]  # mechanisms and patterns of the fit, block by block
    for m in fit.mechanisms:
        c = s.candidates[m]
        inset.append({"name": m, "null": c.null, "columns": [names.index(p.name) for p in c.parameters],
                      "parameters": [(p.name, p.low, p.high, p.scale, p.sigma) for p in c.parameters]})
    out["inset"] = inset
    if offsets:
        pred = s.predict(fit.mechanisms, fit.named, problem.all)
        white = lambda i, d: problem.whitening[i].whitened(d, fit.frame[i]).astype(np.float32)
        off = []  # (kind, recording, what, vector)
        frame = float(np.median([np.median(np.diff(o.t)) for o in obs]))
        for i, o in enumerate(obs):
            y = fit.residuals[i]; best = []
            at_ = np.arange(3, o.t.size - 3)
            for k in COUNTS:
                moved = shown(o, pred[i], {LOST: float(k)}, float(o.t[0])) - pred[i]  # of all frames; from an instant on
                if not np.isfinite(moved).all(): continue
                W = problem.whitening[i].whitened(np.where(np.arange(o.t.size)[:, None] >= at_, moved[:, None], 0.0), fit.frame[i])
                gain = 2 * (W.T @ y) - (W * W).sum(0)
                for j in np.argsort(-gain)[:8]: best.append((gain[j], ("lost", i, (float(o.t[at_[j]]), k), W[:, j].astype(np.float32))))
            off += [x for _, x in best]
        out["instants"] = float(np.mean([2 * o.t.size for o in obs]))
        other = {}
        for j, o in enumerate(obs): other.setdefault(o.condition, j)
        for i, o in enumerate(obs):
            for cond, j in other.items():
                if cond == o.condition: continue
                try: d = s.predict_commanded(fit.mechanisms, fit.named, i, j) - pred[i]
                except Exception: continue
                if np.isfinite(d).all(): off.append(("command", i, cond, white(i, d)))
        for name in SLIPPING:
            if name not in variables(s): continue
            for f in SLIPS:
                try: y = s.predict_apart(fit.mechanisms, fit.named, {name: np.full(n, f - 1.0)}, problem.all)
                except Exception: continue
                for i in range(n):
                    if np.isfinite(y[i]).all(): off.append(("slip", i, (name, f), white(i, y[i] - pred[i])))
        out["offsets"] = off
    out.setdefault("offsets", []); bases = []
    for r in REACHES:
        parts = []
        for i, o in enumerate(obs):
            phi = shapes(o.t, r * float(o.t[-1] - o.t[0]))
            parts.append(problem.whitening[i].levelled(phi).astype(np.float32) * problem.noise.s)  # amplitude in units of the noise
        bases.append(parts)
    out["bases"] = bases
    return out

def bumps(problem, fit):
    effects = lambda p, names: effects_of(p, fit, names)
    """What a smooth force of a body's position and rate, a distortion of height or of time would do, bump by bump."""
    s = problem.system; library = forms(s.model); every = []
    for law in ("foot_v", "rail_v", "spring_power"):
        if law not in library: continue
        m = library[law]; seen = seen_by(s, m, fit.mechanisms, fit.named)
        each = surface(m, seen, size=0.1 * s.model.M * s.model.g)
        every.append((law[:4], each))
    top = max(float(np.max(o.y)) for o in s.observations); end = max(float(o.t[-1]) for o in s.observations); low = min(float(np.min(o.y)) for o in s.observations)
    for body, x, a, b, n in (("film_height", "h", low, top, 6), ("film_time", "time_s", 0.0, end, 10)):
        w = (b - a) / (n - 1); each = []
        for k in range(n):
            c = [own_parameter("a", a + k * w, a + k * w, a + k * w, "m" if x == "h" else "s"), own_parameter("l", 1.2 * w, 1.2 * w, 1.2 * w, "m" if x == "h" else "s")]
            size = 1e-3
            each.append(mechanism(f"{body}_bump_{k}", body, f"r * exp(-(({x} - a) / l)**2)", [own_parameter("r", 0.0, -100 * size, 100 * size, "m" if x == "h" else "s", scale=size), *c]))
        every.append((body, each))
    out = []
    for body, each in every:
        try:
            wide = problem.asked_of(s.considering(each))
            for e in effects(wide, [b.name for b in each]):
                out.append({"body": body, "column": e["column"], "name": e["name"], "scale": e["scale"]})
        except Exception as err: print("bumps", body, repr(err)[:200], flush=True)
    return out

def base_fit(problem, rng):
    """The baseline, each recording weighed by how far it is off: a point to linearise about that no one recording drags."""
    from jumpvision.engine.order import fit_baseline
    s = problem.system; p = problem
    for _ in range(2):
        f = fit_baseline(p, rng)
        r = problem.residuals((), f.named)
        each = np.array([a @ a / max(a.size, 1) for a in r])
        factor = np.sqrt(np.maximum(each / max(np.median(each), 1.0), 1.0))
        if factor.max() < 3: break
        import copy
        s2 = copy.copy(s); s2.observations = [replace(o, spread=(np.ones(o.t.size) if o.spread is None else o.spread) * k) for o, k in zip(s.observations, factor)]
        p = problem.asked_of(s2)
    return at(problem, (), f.values)

def at(problem, mechanisms, values):
    """A fit that stands at these values."""
    from jumpvision.engine.system import parameters
    free = parameters(problem.system, mechanisms)
    return problem.fit(mechanisms, dict(zip([p.name for p in free], values)), iterations=0)

def prepared(task):
    learned = learn_noise(Jumper(task.jumps, task.ranges, task.priors, workers=1))
    return Problem(learned.system, learned.noise, {}), learned

if __name__ == "__main__":
    import json
    from pathlib import Path
    HERE = Path("GATE"); (HERE / "dump").mkdir(exist_ok=True)
    for raw in sorted((HERE / "raw").glob("*.pkl"), key=lambda p: p.stat().st_mtime):
        to = HERE / "dump" / raw.name
        if to.exists() or "machines" in raw.name: continue
        began = time.time()
        try:
            task, what = pickle.loads(raw.read_bytes())
            problem, learned = prepared(task)
            fit = base_fit(problem, np.random.default_rng(1))
            d = linearised(problem, fit); d["learned_scatter"] = dict(learned.scatter); d["what"] = what
            to.write_bytes(pickle.dumps(d, protocol=4))
            print(raw.name, what.kind, what.named, "chi2/n", round(fit.chi2 / problem.n, 2), "rows", d["y"].size, "eff", len(d["effects"]), "tmp", len(d["templates"]), "off", len(d["offsets"]), "des", len(d["designs"]), f"{to.stat().st_size/1e6:.0f} MB", f"{time.time() - began:.1f} s", flush=True)
        except Exception as e:
            import traceback; traceback.print_exc(); print(raw.name, "failed", repr(e)[:200], flush=True)
