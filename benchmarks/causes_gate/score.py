"""Evidence of sets of causes, linear about a point: columns, one score, a beam.

ln Z = -1/2 (y'y - y'U (I + U'U)^-1 U'y) - 1/2 ln det(I + U'U), U the columns of a set times the widths of their priors.
"""
from __future__ import annotations
import math, sys, pickle, time
from dataclasses import dataclass, field
import numpy as np
from scipy.special import log_ndtr, logsumexp

MOST, BEAM, SURE = 4, 8, 0.95
WIDTHS = (5.0, 0.7, 0.1)  # of a mechanism's strength, in changes that matter
SPREADS = (1.0, 0.1, 0.01)  # of a number's change, in plausible spreads
AMPLITUDES = {"bump": (0.03, 0.1, 0.3, 1.0, 3.0), "time": (0.5, 2.0, 8.0, 32.0, 128.0)}
FAMILIES = 6  # mechanism, number, lost frames, command, slip, something not listed (a template, or none)

@dataclass(frozen=True)
class Cause:
    """What a set is made of. key: what is told; part: which of its members; columns: of the Gram matrix; sign: of a
    strength that has one. fixed: it changes y by its column. prior: ln of its share before the data; more: the same
    where the set already has its key."""
    key: tuple
    part: tuple
    columns: tuple
    widths: tuple
    prior: float
    more: float = math.nan
    sign: int = 0
    fixed: bool = False

class Columns:
    """All causes of a campaign and the products of their columns."""
    def __init__(self, d, keep=(12, 4, 6), library_in_unlisted=False):
        self.d = d; sizes = d["sizes"]; N = self.N = len(sizes); ends = np.cumsum([0, *sizes])
        cut = lambda x: [x[a:b] for a, b in zip(ends[:-1], ends[1:])]
        y = d["y"].astype(float).copy()
        inset_eff, inset_bases = self._inset(y)
        free = [k for k, b in enumerate(d["base"]) if not b[6] and k not in self.used]
        J = d["J"][:, free].astype(float)
        globals_ = [("mechanism", e) for e in d["effects"]] + [("template", e) for e in d["templates"]]
        self.ng, self.nb = len(globals_), len(d["bumps"])
        cols = [e["column"] for _, e in globals_] + [b["column"] for b in d["bumps"]] + inset_eff
        Gl = np.stack(cols, 1).astype(float) if cols else np.zeros((len(y), 0))
        numbers = self.numbers = list(d["numbers"])
        Nu = np.stack([d["numbers"][n]["column"] for n in numbers], 1).astype(float)
        shared = cut(np.column_stack([y, J, Gl, Nu]))
        self.kJ, a = J.shape[1], len(numbers)
        offs = self._few(d["offsets"], shared, keep)
        self.offs = offs
        self.local = [np.column_stack([s, *[o[3].astype(float) for o in offs[i]]]) if offs[i] else s for i, s in enumerate(shared)]
        self.D = np.array([x[4] for x in d["designs"]])  # (P, N)
        self.rows, self.pull, self.free = d["rows"][:, free], d["pull"], free
        self.prec = self.rows.T @ self.rows + np.diag([12.0 / (d["base"][k][3] - d["base"][k][2]) ** 2 for k in free]) if free else np.zeros((0, 0))
        self.n = sum(sizes)
        self.iG = 1 + self.kJ; self.iN = self.iG + Gl.shape[1]; self.iO = self.iN + a
        self.plain = [m.T @ m for m in self.local]
        self.causes = self._causes(globals_)
        s = np.exp(np.linspace(-2.5, 2.5, 11) * 0.5 * max(d["log_power"], 1e-3)); w = -0.5 * np.linspace(-2.5, 2.5, 11) ** 2
        self.s, self.lw = s, w - logsumexp(w)

    def _inset(self, y):
        """Columns of what the fit holds already; y as if it did not."""
        self.used, cols = set(), []
        self.inset = []
        d = self.d
        for m in d["inset"]:
            if m["name"] in d.get("patterns_in", ()): ks = m["columns"]; null = 0.0
            else: ks, null = m["columns"], m["null"]
            for j, k in enumerate(ks):
                if k in self.used: continue
                self.used.add(k); cols.append(d["J"][:, k].astype(float))
                if j == 0 or m["name"] in d.get("patterns_in", ()):
                    y += cols[-1] * (d["base"][k][5] - null)
            self.inset.append((m, len(cols)))
        return cols, None

    def _few(self, offsets, shared, keep):
        """The offsets that take most from a recording, by kind."""
        every = {(i, k): [] for i in range(self.N) for k in ("lost", "command", "slip")}
        k = self.d["J"].shape[1] if False else 0
        for o in offsets:
            yi = shared[o[1]][:, 0]; v = o[3].astype(float); every[o[1], o[0]].append((2 * v @ yi - v @ v, o))
        out = []
        for i in range(self.N):
            mine = []
            for kind, most in zip(("lost", "command", "slip"), keep):
                mine += [o for _, o in sorted(every[i, kind], key=lambda x: -x[0])[:most]]
            out.append(mine)
        return out

    def gram(self, each):
        """Products over patterns and offsets from those of the recordings; the baseline's parameters taken off."""
        g = np.stack([x[:self.iO, :self.iO] for x in each]); top = g[:, :self.iN, :self.iN].sum(0)
        a, P = self.iO - self.iN, len(self.D)
        base, nO = self.iN, sum(map(len, self.offs)); p = base + a * P + nO
        G = np.zeros((p, p)); G[:base, :base] = top
        for x in range(a):
            sx = slice(base + x * P, base + (x + 1) * P)
            G[sx, :base] = self.D @ g[:, self.iN + x, :base]; G[:base, sx] = G[sx, :base].T
            for z in range(x, a):
                sz = slice(base + z * P, base + (z + 1) * P)
                block = (self.D * g[:, self.iN + x, self.iN + z]) @ self.D.T
                G[sx, sz] = block; G[sz, sx] = block.T
        at = base + a * P
        for i, o in enumerate(self.offs):
            m = len(o); so = slice(at, at + m); gi = each[i]
            G[so, :base] = gi[self.iO:, :base]; G[:base, so] = G[so, :base].T
            for x in range(a):
                sx = slice(base + x * P, base + (x + 1) * P)
                G[so, sx] = np.outer(gi[self.iO:, self.iN + x], self.D[:, i]); G[sx, so] = G[so, sx].T
            G[so, so] = gi[self.iO:, self.iO:]; at += m
        return G

    def without_base(self, G):
        """Less what the baseline's parameters can do; and -1/2 ln det of them."""
        k = self.kJ
        if not k: return G, 0.0
        A = G[1:1 + k, 1:1 + k] + self.prec; b = G[1:1 + k].copy(); b[:, 0] += self.rows.T @ self.pull
        L = np.linalg.cholesky(A + 1e-9 * np.diag(np.diag(A))); Z = np.linalg.solve(L, b)
        out = G - Z.T @ Z; out[0, 0] += self.pull @ self.pull
        return out, -float(np.log(np.diag(L)).sum())

    def _causes(self, globals_):
        d = self.d; out = []; lf = -math.log(FAMILIES)
        names = {}
        for kind, e in globals_: names.setdefault((kind, e["name"]), []).append(e)
        vocabulary = len(d["vocabulary"]); templates = len({n for k, n in names if k == "template"})
        for j, (kind, e) in enumerate(globals_):
            price = lf - math.log(vocabulary if kind == "mechanism" else 2 * templates) - math.log(len(names[kind, e["name"]]))
            sign = 1 if e["low"] >= 0 else -1 if e["high"] <= 0 else 0
            w = e["scale"] if not math.isfinite(e["sigma"]) else min(e["scale"], e["sigma"])
            out.append(Cause((kind, e["name"]), e["shape"], (self.iG + j,), tuple(w * x for x in WIDTHS), price, sign=sign))
        at = self.iG + self.ng + self.nb
        pats = d.get("patterns_in", ())
        for m, end in self.inset:
            ks = range(at + (end - len(m["columns"])), at + end)
            if m["name"] in pats: continue  # numbers have columns of their own
            scale = [p[3] if not math.isfinite(p[4]) else min(p[3], p[4]) for p in m["parameters"]]
            sign = 1 if m["parameters"][0][1] - m["null"] >= 0 else -1 if m["parameters"][0][2] - m["null"] <= 0 else 0
            kind = "mechanism" if m["name"] in d["vocabulary"] else "template"
            price = lf - math.log(vocabulary if kind == "mechanism" else 2 * max(templates, 1))
            out.append(Cause((kind, m["name"]), ("fitted",), tuple(ks), tuple(tuple([scale[0] * x, *scale[1:]]) if len(ks) > 1 else scale[0] * x for x in WIDTHS), price, sign=sign))
        P = len(self.D); kinds = {}
        for x in d["designs"]: kinds[x[0], x[1]] = kinds.get((x[0], x[1]), 0) + 1
        nk = len(kinds) + 1
        for a, n in enumerate(self.numbers):
            v = d["numbers"][n]; lr = -math.log(10.0) if v["rare"] else 0.0
            first = lf - math.log(len(self.numbers)) + lr
            for q, x in enumerate(d["designs"]):
                price = first - math.log(nk) - math.log(kinds[x[0], x[1]])
                more = -math.log(kinds[x[0], x[1]]) if x[0] == "odd" else math.nan
                out.append(Cause(("number", n, x[0], x[1]), (x[2], x[3]), (self.iN + a * P + q,), tuple(v["spread"] * w for w in SPREADS), price, more))
            odd = [self.iN + a * P + q for q, x in enumerate(d["designs"]) if x[0] == "odd"]
            out.append(Cause(("number", n, "scatter", None), (), tuple(odd), tuple(v["spread"] * w for w in (1.0, 0.3, 0.1, 0.03, 0.01)), first - math.log(nk)))
        j = self.iN + len(self.numbers) * P
        count = {}
        for o in d["offsets"]: count[o[0], o[1]] = d["instants"] if o[0] == "lost" else count.get((o[0], o[1]), 0) + 1
        for i, offs in enumerate(self.offs):
            for o in offs:
                member = -math.log(self.N) - math.log(count[o[0], o[1]])
                key = ("lost",) if o[0] == "lost" else ("command",) if o[0] == "command" else ("slip", o[2][0])
                out.append(Cause(key, (i, o[2]), (j,), (), lf + member, member, fixed=True)); j += 1
        return out

@dataclass
class State:
    causes: tuple = ()  # (index of cause, width)
    score: float = -math.inf
    q: float = 0.0

class Search:
    """The beam over sets of causes under one covariance of what is not listed."""
    def __init__(self, c: Columns, G, const, log_prior):
        self.c, self.G, self.const, self.log_prior = c, G, const, log_prior
        self.singles = [k for k, x in enumerate(c.causes) if len(x.columns) == 1 and not x.fixed]
        self.blocks = [k for k, x in enumerate(c.causes) if len(x.columns) > 1]
        self.fixed = [k for k, x in enumerate(c.causes) if x.fixed]
        C = c.causes
        self.col = np.array([C[k].columns[0] for k in self.singles]); self.W = np.array([C[k].widths for k in self.singles])
        self.sign = np.array([C[k].sign for k in self.singles])
        self.fcol = np.array([C[k].columns[0] for k in self.fixed], int)
        self.prior = np.array([x.prior for x in C]); self.more = np.array([x.more for x in C])
        self.keys = [x.key for x in C]
        ids = {}; self.kid = np.array([ids.setdefault(k, len(ids)) for k in self.keys])
        self.seen = {}

    def noise(self, q):
        c = self.c
        return logsumexp(c.lw - 0.5 * q / c.s ** 2 - c.n * np.log(c.s))

    def prior_of(self, chosen):
        """ln prior of a set of causes."""
        groups, total = set(), 0.0
        for k in chosen:
            if self.kid[k] in groups: total += self.more[k]
            else: groups.add(self.kid[k]); total += self.prior[k]
        size = len(groups) + (self.log_prior is not None and self.log_prior < 0)
        return total - math.log(MOST + 1) + math.lgamma(size + 1) + (self.log_prior or 0.0), size

    def view(self, causes):
        """What is left of the products beside a set: residual row b, diagonal, q, and ln det and signs of the set."""
        C, G = self.c.causes, self.G
        cols, w, fixed = [], [], []
        for k, width in causes:
            x = C[k]
            if x.fixed: fixed.append(x.columns[0])
            else:
                cols += x.columns; w += list(np.broadcast_to(np.asarray(x.widths[width], float), len(x.columns)))
        row = G[0] - G[fixed].sum(0) if fixed else G[0].copy()
        if fixed: q = G[0, 0] - 2 * G[0, fixed].sum() + G[np.ix_(fixed, fixed)].sum(); row[0] = q
        else: q = G[0, 0]
        diag = np.diag(G).copy()
        if not cols: return row, diag, q, 0.0, 0.0, None
        w = np.array(w); A = np.eye(len(w)) + w[:, None] * G[np.ix_(cols, cols)] * w
        L = np.linalg.cholesky(A); Z = np.linalg.solve(L, w[:, None] * G[cols]); z0 = np.linalg.solve(L, w * row[cols])
        mean = np.linalg.solve(L.T, z0); cov = np.linalg.inv(A)
        lnsign = 0.0; j = 0
        for k, width in causes:
            x = C[k]
            if x.fixed: continue
            if x.sign: lnsign += math.log(2) + float(log_ndtr(x.sign * mean[j] / math.sqrt(cov[j, j])))
            j += len(x.columns)
        return row - z0 @ Z, diag - (Z * Z).sum(0), q - z0 @ z0, float(np.log(np.diag(L)).sum()), lnsign, Z

    def extended(self, s):
        """The sets of one cause more, the best of them: (score, causes)."""
        c, C = self.c, self.c.causes
        row, diag, q, logdet, lnsign, Z = self.view(s.causes)
        have = {self.kid[k] for k, _ in s.causes}; inside = {k for k, _ in s.causes}
        p0, size = self.prior_of([k for k, _ in s.causes])
        mine = np.isin(self.kid, list(have)); growing = mine & np.isfinite(self.more)
        if getattr(self, 'path', False) and len(s.causes) >= size + 3: growing = np.zeros_like(growing)
        cost = np.where(growing, self.more, np.where(mine, -np.inf, self.prior + math.log(size + 1)))
        if size >= getattr(self, "most", MOST): cost = np.where(growing, cost, -np.inf)
        if inside: cost[list(inside)] = -np.inf
        heads = p0 - logdet + lnsign + self.const
        if math.isfinite(s.score): heads += s.score - (self.noise(q) + heads)  # what the widths of the others leave of their evidence
        out = []
        d, b = np.maximum(diag[self.col], 0)[:, None], row[self.col][:, None]
        f = 1 + self.W ** 2 * d
        dq = self.W ** 2 * b * b / f
        ls = -0.5 * np.log(f) + np.where(self.sign[:, None] != 0, math.log(2) + log_ndtr(self.sign[:, None] * self.W * b / np.sqrt(f)), 0.0)
        rough = 0.5 * dq + ls; best = rough.argmax(1); top = rough.max(1)
        mean = top + np.log(np.exp(rough - top[:, None]).mean(1))
        total = mean + cost[self.singles]
        for j in np.argsort(-total)[:3 * BEAM]:
            if not np.isfinite(total[j]): break
            v = heads + self.noise(q - dq[j, best[j]]) + (mean[j] - 0.5 * dq[j, best[j]]) + cost[self.singles[j]]
            out.append((v, (*s.causes, (self.singles[j], int(best[j])))))
        if len(self.fcol):
            dq = 2 * row[self.fcol] - diag[self.fcol]; total = 0.5 * dq + cost[self.fixed]
            for j in np.argsort(-total)[:BEAM]:
                if np.isfinite(total[j]): out.append((heads + self.noise(q - dq[j]) + cost[self.fixed[j]], (*s.causes, (self.fixed[j], 0))))
        for k in self.blocks:
            if getattr(self, 'path', False) and C[k].key[-2:-1] == ('scatter',): continue
            if not np.isfinite(cost[k]): continue
            cols = list(C[k].columns); g = self.G[np.ix_(cols, cols)]
            if Z is not None: g = g - Z[:, cols].T @ Z[:, cols]
            got = []
            for w in C[k].widths:
                w = np.broadcast_to(np.asarray(w, float), len(cols)); A = np.eye(len(cols)) + w[:, None] * g * w
                L = np.linalg.cholesky(A + 1e-9 * np.eye(len(cols))); z = np.linalg.solve(L, w * row[cols])
                sg = 0.0
                if C[k].sign: m = np.linalg.solve(L.T, z); sg = math.log(2) + float(log_ndtr(C[k].sign * m[0] / math.sqrt(np.linalg.inv(A)[0, 0])))
                got.append(self.noise(q - z @ z) - float(np.log(np.diag(L)).sum()) + sg)
            i = int(np.argmax(got)); out.append((heads + cost[k] + logsumexp(got) - math.log(len(got)), (*s.causes, (k, i))))
        return out

    def run(self):
        start = State((), self.noise(self.G[0, 0]) + self.const + self.prior_of([])[0])
        self.seen[frozenset()] = (start.score, ())
        front = [start]
        for step in range(14):
            new = {}
            for s in front:
                for v, causes in self.extended(s):
                    key = frozenset(k for k, _ in causes)
                    if key not in self.seen and (key not in new or v > new[key][0]): new[key] = (v, causes)
            if not new: break
            self.seen |= new
            best = max(v for v, _ in self.seen.values())
            front = [State(c, v) for v, c in sorted(new.values(), key=lambda x: -x[0])[:BEAM]]
            if step >= 1 and front[0].score < best - 30.0: break
        return self.seen

def kernels(c, which):
    """(name, Gram, const, ln prior) of nothing that is not listed, and of every kernel and amplitude."""
    plain = c.gram(c.plain); out = []
    G, k = c.without_base(plain); out.append(("listed", 0.0, G, k, 0.0))
    lf = -math.log(FAMILIES) - math.log(2)
    bodies = {}
    for j, b in enumerate(c.d["bumps"]): bodies.setdefault(b["body"], []).append(c.iG + c.ng + j)
    if "library" in which:  # what is not listed resembles all that is
        bodies["library"] = list(range(c.iG, c.iG + c.ng + c.nb))
    names = [b for b in bodies if "bump" in which or b == "library"] + [f"time{r}" for r in range(len(c.d["bases"])) if f"time{r}" in which]
    for name in names:
        amps = AMPLITUDES["bump" if name in bodies else "time"]
        for a in amps:
            price = lf - math.log(len(names)) - math.log(len(amps))
            if name in bodies:
                cols = bodies[name]; scale = np.array([c.scale_of(j) for j in cols]) * a
                A = np.eye(len(cols)) + scale[:, None] * plain[np.ix_(cols, cols)] * scale
                L = np.linalg.cholesky(A); Z = np.linalg.solve(L, scale[:, None] * plain[cols]); H = plain - Z.T @ Z; ld = -float(np.log(np.diag(L)).sum())
            else:
                each, ld = [], 0.0
                for m, phi in zip(c.local, c.d["bases"][int(name[4:])]):
                    phi = phi.astype(float) * a; A = np.eye(phi.shape[1]) + phi.T @ phi; L = np.linalg.cholesky(A); Z = np.linalg.solve(L, phi.T @ m)
                    each.append(m.T @ m - Z.T @ Z); ld -= float(np.log(np.diag(L)).sum())
                H = c.gram(each)
            H, k = c.without_base(H)
            out.append((name, a, H, k + ld, price))
    return out

def scale_of(self, j):
    """A change that matters, of a global column."""
    k = j - self.iG
    if k < self.ng: return ([*self.d["effects"], *self.d["templates"]][k])["scale"]
    b = self.d["bumps"][k - self.ng]
    return b.get("scale", 1.0)
Columns.scale_of = scale_of

def asked(d, which=("bump", "time0", "time1", "time2"), **kw):
    """(ln posterior, kernel, amplitude, causes) of all sets that were looked at."""
    c = Columns(d, **kw); out = []
    for name, a, G, const, price in kernels(c, which):
        seen = Search(c, G, const, price).run()
        out += [(v, name, a, causes) for v, causes in seen.values()]
    return c, sorted(out, key=lambda x: -x[0])

def told(c, sets, kinds=True):
    """Summary: probability of every cause, of a kernel, and what is named."""
    lp = np.array([s[0] for s in sets]); p = np.exp(lp - logsumexp(lp))
    incl, kern = {}, {}
    for s, w in zip(sets, p):
        for k in {c.causes[k].key for k, _ in s[3]}: incl[k] = incl.get(k, 0.0) + w
        kern[s[1]] = kern.get(s[1], 0.0) + w
    return p, incl, kern

def show(c, sets, most=5):
    p, incl, kern = told(c, sets)
    txt = [f"  {w:.3f} {s[0] - sets[0][0]:8.1f} {s[1]}@{s[2]:g} " + "; ".join(f"{c.causes[k].key} {str(c.causes[k].part)[:40]}" for k, _ in s[3]) for s, w in list(zip(sets, p))[:most]]
    txt.append("  incl " + ", ".join(f"{k}: {v:.2f}" for k, v in sorted(incl.items(), key=lambda x: -x[1])[:6] if v > .02) + " | " + ", ".join(f"{k} {v:.2f}" for k, v in sorted(kern.items(), key=lambda x: -x[1])[:4]))
    return "\n".join(txt)

if __name__ == "__main__":
    for f in sys.argv[1:]:
        d = pickle.load(open(f, "rb")); t = time.time(); c, sets = asked(d); w = d["what"]
        print(f.split("/")[-1], w.kind, w.named, w.fault and (w.fault.words[:2], w.fault.kinds, sorted(w.fault.apart)[:6], w.fault.of), w.law, f"{time.time() - t:.1f} s, rows {c.n}, causes {len(c.causes)}, chi2/n {c.plain and sum(g[0,0] for g in c.plain) / c.n:.2f}")
        print(show(c, sets), flush=True)
