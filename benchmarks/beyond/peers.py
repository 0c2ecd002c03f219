"""Peers from the registry that look for the hidden law: PySINDy (weak form, ensemble), gplearn (genetic programs).

They are helped as far as their form allows. The declared model is fitted first, and what the track has beyond it is
smoothed by a quintic spline at the stated noise: the small rest needs far less smoothing than the track, and the force
on the foot comes out three to ten times better than from the smoothed track itself. The known part of every force is
subtracted; the intervals of intrusion, rest and flight are those of the fitted model. They get the terms that the
worlds are made of, exponents and lengths on a grid (the true ones lie between), and for each body on which a law may
act they may answer apart. Every answer is then put through the whole simulation: its coefficients are fitted again
with the robot and the ground, and the one that fits the campaign best is taken. No peer knows memory, or instruments.
(PySR is left out: it needs Julia, which the registry of Python packages does not hold.)
"""

from __future__ import annotations

import importlib.util
import time
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import UnivariateSpline

from . import motion as mo
from .fit import STEP, Fit, Seen, fit
from .motion import Array, Jumper, Law
from .worlds import DURATION, jumper_of, times

DT = 1e-3  # s: of the reconstructed states
MARGIN = 3  # samples that an interval loses at both ends
LENGTH = {mo.FOOT: 21, mo.CARRIAGE: 41, mo.SPRING: 41}  # samples of a window
GRID = {  # of the table that is simulated: first argument from, to, number; second likewise
    mo.FOOT: (0.0, 0.06, 121, 0.0, 1.6, 321),
    mo.CARRIAGE: (-0.1, 0.1, 201, -3.0, 3.0, 601),
    mo.SPRING: (-0.05, 0.03, 161, -4.0, 4.0, 801),
}
SYMBOLS = {mo.FOOT: ("z", "abs(v)"), mo.CARRIAGE: ("x_m", "v_m"), mo.SPRING: ("stretch", "stretch_rate")}
ACTS_ON = {mo.FOOT: "foot", mo.CARRIAGE: "carriage", mo.SPRING: "spring"}
THRESHOLDS = (0.1, 0.3)  # of a coefficient, a term being scaled to 1 N
DECLARED = "drag of the cone"  # a term whose coefficient is fitted with the ground
RIDGE = 3e-3  # of STLSQ: exponents on a grid are nearly collinear; the squares of a term add up to some 0.03
UNIT = (0.02, 0.5)  # m, m/s: of the arguments of a program
LEAST = 4  # windows
MOST = 6  # terms that are put through the simulation


class Window(NamedTuple):
    """Consecutive samples (n,): momentum P [N s] whose rate is the hidden force [N], and the law's two arguments."""

    P: Array
    q: Array
    u: Array
    force: Array


class Term(NamedTuple):
    """A term of the library in words and as a function of the body's two arguments, both at least 1-D."""

    words: str
    of: Callable[[Array, Array], Array]


@dataclass(frozen=True)
class Peer:
    """A peer's answer; values: refitted robot and ground; law: as the simulation has it."""

    words: str
    acts_on: str
    values: dict[str, float]
    law: Law
    chi2: float
    seconds: float


def installed(name: str) -> bool:
    """Whether a peer can be asked."""
    return importlib.util.find_spec(name) is not None


# -------------------------------------------------------------------------------------------------------------- library
def library(body: int, known: Jumper) -> list[Term]:
    """The terms of the worlds and some more, exponents and lengths on a grid; DECLARED is of the known ground."""
    out: list[Term] = []

    def add(words: str, of: Callable[..., Array], *numbers: float) -> None:
        out.append(Term(words.format(*numbers), lambda q, u: of(q, u, *numbers)))

    if body == mo.FOOT:
        add(DECLARED, lambda z, u: cone(known, z)[1] * u * u)
        for p in (0.5, 1.0, 1.5, 2.0):
            add("abs(v)**{0:g}", lambda z, u, p: np.abs(u) ** p, p)
        for q in (0.5, 1.0, 1.5, 2.0):
            add("z**{0:g} * abs(v)", lambda z, u, q: np.maximum(z, 0.0) ** q * np.abs(u), q)
        for length in (0.005, 0.01, 0.02, 0.04):
            add("exp(-z / {0:g})", lambda z, u, a: np.exp(-z / a), length)
        for v0 in (0.1, 0.3):
            add("abs(v) / (abs(v) + {0:g})", lambda z, u, v0: np.abs(u) / (np.abs(u) + v0), v0)
        add("z", lambda z, u: z)
        add("z**2", lambda z, u: z * z)
        add("1", lambda z, u: np.ones(np.broadcast(z, u).shape))
    elif body == mo.CARRIAGE:
        add("v_m", lambda x, v: v)
        add("v_m * abs(v_m)", lambda x, v: v * np.abs(v))
        add("sign(v_m)", lambda x, v: np.tanh(v / mo.STILL))
        for v0 in (0.02, 0.1):
            add("v_m / (abs(v_m) + {0:g})", lambda x, v, v0: v / (np.abs(v) + v0), v0)
        for power in (1, 2):
            add("x_m**{0:g} * v_m", lambda x, v, power: x**power * v, power)
        for length in (0.02, 0.04, 0.06):
            add("exp(x_m / {0:g}) * v_m", lambda x, v, a: np.exp(x / a) * v, length)
        for centre in (0.005, 0.015, 0.025):
            add("exp(-((x_m - {0:g}) / 0.014)**2) * v_m", lambda x, v, c: np.exp(-(((x - c) / 0.014) ** 2)) * v, centre)
    else:
        add("stretch", lambda e, v: e)
        add("stretch**3", lambda e, v: e**3)
        add("stretch_rate", lambda e, v: v)
        add("abs(stretch) * stretch_rate", lambda e, v: np.abs(e) * v)
        add("abs(stretch) * sign(stretch_rate)", lambda e, v: np.abs(e) * np.tanh(v / mo.STILL))
        add("sign(stretch_rate)", lambda e, v: np.tanh(v / mo.STILL))
        add("1", lambda e, v: np.ones(np.broadcast(e, v).shape))
    return out


def bodies(ground: str) -> tuple[int, ...]:
    """On which a law may act."""
    return (mo.CARRIAGE, mo.SPRING) if ground == "hard" else (mo.FOOT, mo.CARRIAGE, mo.SPRING)


# --------------------------------------------------------------------------------------------------------------- states
def windows(s: Seen, base: Fit) -> dict[int, list[Window]]:
    """Reconstructed windows of every body: states from the tracks beyond the fitted model, forces known by the declared
    one, which has not absorbed the law."""
    j, known = jumper_of(s.ground, {**s.values, **base.values}), jumper_of(s.ground, s.values)
    out: dict[int, list[Window]] = {body: [] for body in bodies(s.ground)}
    t = np.arange(0.0, DURATION - 0.02, DT)
    for shot, y in zip(s.shots, s.tracks):
        m = mo.follow(j, shot.command, Law(), t, step=STEP)
        rest = y - np.interp(times(), t, m.rod - m.rod[0])
        spline = UnivariateSpline(times(), rest, k=5, s=rest.size * s.noise**2)
        beyond = [spline.derivative(n)(t) if n else spline(t) for n in (0, 1, 2)]
        for body in out:
            state = _on_foot(j, known, m, beyond) if body == mo.FOOT else _on_rod(known, m, beyond, body)
            modes = {mo.FOOT: (mo.INTRUDING,), mo.SPRING: (mo.REST,)}.get(
                body, (mo.REST, mo.AIR) if j.hard else (mo.REST,)
            )
            for k in _pieces(m.mode, modes, LENGTH[body]):
                P = state[0][k] + cumulative_trapezoid(state[1][k], dx=DT, initial=0.0)
                out[body].append(Window(P, state[2][k], state[3][k], np.gradient(P, DT)))
    return out


def _on_foot(j: Jumper, known: Jumper, m: mo.Motion, beyond: Sequence[Array]) -> tuple[Array, Array, Array, Array]:
    """(m v_f, what is known of minus the force that changes it, z, u)."""
    spring = -(j.k * (m.rod - m.foot) + j.c * (m.rod_rate - m.foot_rate)) + j.M * beyond[2]
    stretched = -np.interp(m.t - j.c / j.k, m.t, j.M * beyond[2]) / j.k  # a spring with a little damping lags by c/k
    z = -(m.foot + beyond[0] - stretched)
    u = -(m.foot_rate + beyond[1] - np.gradient(stretched, DT))
    mass, growth = cone(known, z)
    resist = known.k1 * z + known.b * growth * u * u
    return -(known.m_f + mass) * u, growth * u * u + spring + known.m_f * known.g - resist, z, u


def cone(j: Jumper, z: Array) -> tuple[Array, Array]:
    """Mass of the declared cone [kg] and its rate with depth [kg/m]."""
    h = np.clip(1.0 - j.mu * z / (j.R * j.tan_theta), 0.0, 1.0)
    return j.cone * np.pi * j.R**3 * j.tan_theta / 3.0 * (1.0 - h**3), j.cone * j.mu * np.pi * j.R**2 * h**2


def _on_rod(j: Jumper, m: mo.Motion, beyond: Sequence[Array], body: int) -> tuple[Array, Array, Array, Array]:
    """(M y', likewise, the body's arguments); the foot is where the fitted model has it."""
    x, v = m.rod + beyond[0], m.rod_rate + beyond[1]
    spring = -j.k * (x - m.foot) - j.c * (v - m.foot_rate)
    if j.hard:
        spring = np.where(m.mode == mo.AIR, 0.0, -j.k * x - j.c * v)
    w = v + j.m_m / j.M * m.motor_rate
    q, u = (x + m.motor, v + m.motor_rate) if body == mo.CARRIAGE else (x - m.foot, v - m.foot_rate)
    return j.M * w, j.M * j.g - spring, q, u


def _pieces(mode: Array, wanted: Sequence[int], length: int) -> Iterable[slice]:
    """Windows of `length` samples, half overlapping, each within one interval of one wanted mode."""
    edges = np.flatnonzero(np.diff(mode)) + 1
    for a, b in zip(np.append(0, edges), np.append(edges, mode.size)):
        if int(mode[a]) in wanted:
            for i in range(a + MARGIN, b - MARGIN - length + 1, length // 2):
                yield slice(i, i + length)


# ----------------------------------------------------------------------------------------------------------- simulation
def tabled(body: int, of: Callable[[Array, Array], Array]) -> Array:
    """A law over GRID."""
    a, b, n, c, d, k = GRID[body]
    T = np.broadcast_to(of(np.linspace(a, b, n)[:, None], np.linspace(c, d, k)[None, :]), (n, k))
    return np.ascontiguousarray(np.nan_to_num(np.clip(T, -1e6, 1e6)))


def as_law(body: int, table: Array) -> Law:
    """The table as `motion` needs it."""
    a, b, n, c, d, k = GRID[body]
    return Law(body, mo.TABLE, grid=(a, (b - a) / (n - 1), c, (d - c) / (k - 1)), table=table)


def through_simulation(
    s: Seen, values: Mapping[str, float], body: int, tables: Sequence[Array], start: Sequence[float]
) -> tuple[Fit, Law]:
    """Coefficients of the tables, robot and ground, fitted to the tracks; values: of the last two, to start from."""
    own = {f"c{i}": float(c) for i, c in enumerate(start)}

    def law(v: Mapping[str, float]) -> Law:
        return as_law(body, np.asarray(sum(v[n] * T for n, T in zip(own, tables))))

    found = fit(s, law, own, start=values, rounds=5)
    return found, law(found.values)


# ---------------------------------------------------------------------------------------------------------------- peers
class Candidate(NamedTuple):
    """What a peer may answer: terms on a body with their coefficients, and how its law reads once these are fitted."""

    body: int
    tables: list[Array]
    start: list[float]
    words: list[str]


def chosen(s: Seen, candidates: Sequence[Candidate], began: float) -> Peer | None:
    """The candidate that fits a quarter of the campaign best, through the simulation, then fitted to all of it."""
    few = replace(s, shots=s.shots[::4], tracks=s.tracks[::4])
    tried = []
    for c in candidates:
        with suppress(np.linalg.LinAlgError):  # a law beside which the robot cannot be followed
            tried.append((through_simulation(few, {}, c.body, c.tables, c.start)[0], c))
    for first, best in sorted(tried, key=lambda x: x[0].chi2):
        start = [first.values[f"c{i}"] for i in range(len(best.tables))]
        with suppress(np.linalg.LinAlgError):
            result, law = through_simulation(s, first.values, best.body, best.tables, start)
            words = " + ".join(f"{result.values[f'c{i}']:.4g} * {w}" for i, w in enumerate(best.words))
            seconds = time.perf_counter() - began
            return Peer(words, ACTS_ON[best.body], result.values, law, result.chi2, seconds)
    return None


def sindy(s: Seen, base: Fit, data: Mapping[int, list[Window]]) -> Peer | None:
    """PySINDy: weak form; ensembles of bagged STLSQ models and forward regression (FROLS) of one term and of three."""
    import pysindy as ps

    began, out = time.perf_counter(), {}
    np.random.seed(1)  # noqa: NPY002 pysindy draws its test domains and bags from the global generator
    for body, found in data.items():
        if len(found) < LEAST:
            continue
        terms = library(body, jumper_of(s.ground, s.values))
        stlsq = [ps.STLSQ(threshold=threshold, alpha=RIDGE) for threshold in THRESHOLDS]
        frols = [ps.FROLS(max_iter=n, alpha=1e-6) for n in (1, 3)]
        for optimizer in (*(ps.EnsembleOptimizer(o, bagging=True, n_models=20) for o in stlsq), *frols):
            picked = [(terms[k], c) for k, c in _sparse(found, terms, optimizer) if terms[k].words != DECLARED]
            if picked:
                words = [t.words for t, _ in picked]
                tables = [tabled(body, t.of) for t, _ in picked]
                out[body, *sorted(words)] = Candidate(body, tables, [c for _, c in picked], words)
    return chosen(s, list(out.values()), began)


def _sparse(found: Sequence[Window], terms: Sequence[Term], optimizer: Any) -> list[tuple[int, float]]:
    """Terms that are chosen, the largest MOST of them, with their coefficients."""
    import pysindy as ps

    q, u = (np.concatenate([getattr(w, n) for w in found]) for n in ("q", "u"))
    size = [float(np.sqrt(np.mean(t.of(q, u) ** 2))) for t in terms]

    def column(t: Term, a: float) -> Callable[..., Array]:  # pysindy counts arguments: three, with the momentum
        return lambda P, q, u: t.of(np.asarray(q), np.asarray(u)) / a + 0.0 * P

    functions = [column(t, a) for t, a in zip(terms, size)]
    made = ps.CustomLibrary(functions, function_names=[lambda P, q, u: "f"] * len(terms))
    grid = DT * np.arange(found[0].P.size)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        weak = ps.WeakPDELibrary(made, spatiotemporal_grid=grid, K=8, H_xt=[0.45 * grid[-1]])
        model = ps.SINDy(optimizer=optimizer, feature_library=weak)
        model.fit([np.column_stack([w.P - w.P[0], w.q, w.u]) for w in found], t=[grid] * len(found))
    c = np.asarray(model.coefficients()[0])
    return [(int(k), float(c[k] / size[k])) for k in np.argsort(-np.abs(c)) if abs(c[k]) > 0][:MOST]


def genetic(s: Seen, base: Fit, data: Mapping[int, list[Window]]) -> Peer | None:
    """gplearn: symbolic regression of the force on the body's two arguments, its size by the simulation."""
    from gplearn.functions import make_function
    from gplearn.genetic import SymbolicRegressor

    began, out = time.perf_counter(), []
    own = [make_function(function=_power, name="power", arity=2)]
    own += [make_function(function=_exponential, name="expo", arity=1)]
    for body, found in data.items():
        if len(found) < LEAST:
            continue
        q, u, force = (np.concatenate([getattr(w, n) for w in found]) for n in ("q", "u", "force"))
        keep = np.random.default_rng(1).permutation(force.size)[:3000]
        keep = keep[np.abs(force[keep] - np.median(force)) < 6.0 * np.std(force)]
        model = SymbolicRegressor(
            population_size=600,
            generations=12,
            function_set=("add", "sub", "mul", "div", "sqrt", "abs", *own),
            parsimony_coefficient=1e-3 * float(np.var(force[keep])),
            metric="mse",
            const_range=(-3.0, 3.0),
            random_state=1,
        )
        with warnings.catch_warnings(), np.errstate(all="ignore"):
            warnings.simplefilter("ignore")
            model.fit(np.column_stack([q / UNIT[0], u / UNIT[1]])[keep], force[keep])
            table = tabled(body, partial(_evaluated, model))
        inside = str(model._program)
        for name, symbol, unit in zip(("X0", "X1"), SYMBOLS[body], UNIT):
            inside = inside.replace(name, f"({symbol} / {unit:g})")
        if np.ptp(table) > 0:
            out.append(Candidate(body, [table], [1.0], [inside]))
    return chosen(s, out, began)


def _evaluated(model: Any, q: Array, u: Array) -> Array:
    """A program of gplearn on arrays that broadcast."""
    a, b = np.broadcast_arrays(q, u)
    values = model.predict(np.column_stack([a.ravel() / UNIT[0], b.ravel() / UNIT[1]]))
    return np.asarray(values, float).reshape(a.shape)


def _power(a: Array, b: Array) -> Array:
    """|a|^b, b within -2..3, 0 where it is not finite."""
    with np.errstate(all="ignore"):
        return np.nan_to_num(np.abs(a) ** np.clip(b, -2.0, 3.0), posinf=0.0, neginf=0.0)


def _exponential(a: Array) -> Array:
    return np.exp(np.clip(a, -20.0, 5.0))
