"""Fits of a study beside plain `scipy.optimize.least_squares` from the same start, by the study's own chi^2.

`python -m benchmarks.least_squares [SEEDS ...]`. Twelve small problems; none may end worse than scipy does.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import jumpvision as jv
from jumpvision.engine.order import fit_baseline
from jumpvision.engine.study.processes import How
from jumpvision.engine.study.question import problem_of, studied
from jumpvision.engine.study.runs import Runs

Array = NDArray[np.float64]
Model = Callable[[Array, dict[str, float]], Array]
SLACK = 1e-4  # of chi^2: what a fit may stop short of the minimum


@dataclass(frozen=True)
class Case:
    """A model of t, its free parameters (start, low, high) and their true values, noise."""

    model: Model
    t: Array
    free: dict[str, tuple[float, float, float]]
    true: dict[str, float]
    noise: float


def oscillator(t: Array, p: dict[str, float]) -> Array:
    """By solve_ivp at its own tolerance: rough at small steps."""
    rate = lambda _, s: [s[1], -p["k"] * s[0] - p["c"] * s[1] - p["q"] * abs(s[1]) * s[1]]  # noqa: E731
    return np.asarray(solve_ivp(rate, (0, t[-1]), [1.0, 0.0], t_eval=t, rtol=1e-5, atol=1e-7).y[0])


def pol(t: Array, p: dict[str, float]) -> Array:
    rate = lambda _, s: [s[1], p["mu"] * (1 - s[0] ** 2) * s[1] - p["k"] * s[0]]  # noqa: E731
    return np.asarray(solve_ivp(rate, (0, t[-1]), [1.0, 0.0], t_eval=t, rtol=1e-7, atol=1e-9).y[0])


def marched(t: Array, p: dict[str, float]) -> Array:
    """A fall with drag from an instant that is known to steps of 0.2 ms only."""
    out, v, n, h = np.empty(t.size), 0.0, 0, 2e-4
    for i, at in enumerate(t):
        while n < int((at - p["begin"]) / h):
            v += h * (9.81 - p["drag"] * v * v)
            n += 1
        out[i] = v
    return out


def stuck(t: Array, p: dict[str, float]) -> Array:
    """A driven mass with dry friction that holds."""
    out, v, h = np.empty(t.size), 0.0, float(t[1] - t[0]) / 5
    for i in range(t.size):
        out[i] = v
        for k in range(5):
            pushed = v + h * (3.0 * math.sin(4.0 * (t[i] + k * h)) - p["viscous"] * v) / p["mass"]
            v = math.copysign(max(abs(pushed) - h * p["dry"] / p["mass"], 0.0), pushed)
    return out


LINE = np.linspace(0.0, 2.0, 80)
LONG = np.linspace(0.0, 10.0, 150)
CASES = {
    "exponential": Case(
        lambda t, p: p["a"] * np.exp(-p["r"] * t), LINE, {"a": (1, 0, 9), "r": (0.1, 0, 9)}, {"a": 3, "r": 1.4}, 0.02
    ),
    "two exponentials": Case(
        lambda t, p: p["a"] * np.exp(-p["r"] * t) + p["b"] * np.exp(-p["s"] * t),
        LINE,
        {"a": (1, 0, 9), "r": (0.5, 0, 20), "b": (1, 0, 9), "s": (2, 0, 20)},
        {"a": 2, "r": 0.7, "b": 1.5, "s": 5},
        0.01,
    ),
    "damped cosine": Case(
        lambda t, p: p["a"] * np.exp(-p["z"] * t) * np.cos(p["w"] * t),
        LINE,
        {"a": (1, 0, 4), "z": (0.3, 0, 3), "w": (6.0, 3, 12)},
        {"a": 1.5, "z": 0.8, "w": 7.0},
        0.01,
    ),
    "saturation": Case(
        lambda t, p: p["v"] * t / (p["k"] + t),
        LINE + 0.05,
        {"v": (1, 0, 9), "k": (1, 0.01, 9)},
        {"v": 2, "k": 0.3},
        0.02,
    ),
    "growth": Case(
        lambda t, p: p["top"] / (1 + np.exp(-p["r"] * (t - p["mid"]))),
        LONG,
        {"top": (1, 0, 9), "r": (0.5, 0, 9), "mid": (2, 0, 10)},
        {"top": 3, "r": 1.2, "mid": 5},
        0.03,
    ),
    "peak": Case(
        lambda t, p: p["h"] * np.exp(-0.5 * ((t - p["at"]) / p["wide"]) ** 2) + p["base"],
        LONG,
        {"h": (1, 0, 9), "at": (4, 0, 10), "wide": (1.5, 0.1, 5), "base": (0, -2, 2)},
        {"h": 2, "at": 5.5, "wide": 0.8, "base": 0.3},
        0.03,
    ),
    "valley": Case(
        lambda t, p: 10 * (p["y"] - p["x"] ** 2) * (t < 1) + (1 - p["x"]) * t,
        LINE,
        {"x": (-1.2, -3, 3), "y": (1, -3, 3)},
        {"x": 1.3, "y": 1.69},
        0.05,
    ),
    "product": Case(
        lambda t, p: p["a"] * p["b"] * t, LINE, {"a": (1, 0.1, 5), "b": (1, 0.1, 5)}, {"a": 2, "b": 1.5}, 0.02
    ),
    "oscillator": Case(
        oscillator, LONG, {"k": (4.5, 2, 9), "c": (0.1, 0, 2), "q": (0.1, 0, 2)}, {"k": 5, "c": 0.2, "q": 0.3}, 0.005
    ),
    "van der Pol": Case(pol, LONG, {"mu": (0.8, 0, 4), "k": (1.1, 0.5, 3)}, {"mu": 1.2, "k": 1.3}, 0.02),
    "stepped fall": Case(
        marched,
        np.linspace(0.1, 1.0, 60),
        {"drag": (0.2, 0, 3), "begin": (0.02, 0, 0.09)},
        {"drag": 0.7, "begin": 0.0537},
        0.01,
    ),
    "dry friction": Case(
        stuck,
        np.linspace(0.0, 6.0, 200),
        {"mass": (1.2, 0.3, 4), "viscous": (0.2, 0, 3), "dry": (0.4, 0, 2.5)},
        {"mass": 0.8, "viscous": 0.5, "dry": 1.1},
        0.01,
    ),
}


def beside(case: Case, seed: int) -> tuple[float, float, int]:
    """(chi^2 of the study's fit, of scipy's from the same start, runs of the study's)."""
    rng = np.random.default_rng(seed)
    y = case.model(case.t, case.true) + case.noise * rng.standard_normal(case.t.size)
    half = case.t.size // 2
    pieces = [(f"part {k}", part) for k, part in enumerate((np.arange(half), np.arange(half, case.t.size)))]
    recordings = [jv.Recording(name, case.t[part], y[part], {"part": part}) for name, part in pieces]
    study = jv.Study(
        lambda p, r: case.model(case.t, p)[r.inputs["part"]],
        [jv.Parameter(n, start, (low, high)) for n, (start, low, high) in case.free.items()],
        [],
        [jv.Channel(noise=case.noise)],
    )
    runs = Runs(study, recordings, How())
    problem = problem_of(studied(study, recordings, runs))
    ours, made = fit_baseline(problem, np.random.default_rng(1)).chi2, runs.count.made
    names = list(case.free)

    def residual(x: Array) -> Array:
        found = problem.residuals((), dict(zip(names, x.tolist())))
        return np.full(problem.n, 1e6) if found is None else np.concatenate(found)

    start, low, high = np.array([*case.free.values()], float).T
    theirs = 2.0 * float(least_squares(residual, start, bounds=(low, high), x_scale=0.1 * (high - low)).cost)
    return ours, theirs, made


def worse(ours: float, theirs: float) -> bool:
    return ours > theirs * (1.0 + SLACK) + 1e-2


def main() -> None:
    seeds = [int(x) for x in sys.argv[1:]] or [1]
    rows = [(name, seed, *beside(case, seed)) for name, case in CASES.items() for seed in seeds]
    print("| problem | seed | chi^2 here | scipy | runs here | |\n|---|---|---|---|---|---|")
    for name, seed, ours, theirs, made in sorted(rows, key=lambda r: r[3] - r[2]):
        print(f"| {name} | {seed} | {ours:.3f} | {theirs:.3f} | {made} | {'WORSE' if worse(ours, theirs) else ''} |")
    print(f"\nworse than scipy: {sum(worse(o, s) for _, _, o, s, _ in rows)} of {len(rows)}")


if __name__ == "__main__":
    main()
