"""Any simulator in question: foreign simulators with hidden causes and nulls, the runs they take, a real servo axis.

`python -m benchmarks.any_simulator [CAMPAIGNS]`; the axis with JUMPVISION_REAL_DATA. Truth by scipy's DOP853.
"""

from __future__ import annotations

import math
import sys
import time
from collections.abc import Callable, Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import jumpvision as jv

Array = NDArray[np.float64]


def cause(name: str, parameter: str, limits: tuple[float, float], scale: float, unit: str = "") -> jv.Mechanism:
    """A mechanism with one strength, absent at 0."""
    return jv.Mechanism(name, [jv.Parameter(parameter, 0.0, limits, unit=unit, scale=scale)])


# -- a pendulum with a user's own integrator --
@njit
def swing(start: float, n: int, w2: float, c: float, q: float, f: float, k: float) -> Array:
    """Angle every 20 ms by leapfrog."""
    a, w, h, out = start, 0.0, 1e-3, np.empty(n)
    for i in range(n):
        out[i] = a
        for _ in range(20):
            a += 0.5 * h * w
            w -= h * (w2 * math.sin(a) + c * w + q * abs(w) * w + f * math.tanh(w / 0.02) + k * a**3)
            a += 0.5 * h * w
    return out


def pendulum() -> jv.Study:
    """Six candidates; two of them are the instrument's."""
    names = ("W", "viscous", "quadratic", "dry", "cubic")
    return jv.Study(
        lambda p, r: swing(r.inputs["start"], r.t.size, *(p[n] for n in names)),
        [jv.Parameter("W", 50.0, (30, 90), unit="1/s^2")],
        [
            cause("viscous_friction", "viscous", (0, 3), 0.1),
            cause("quadratic_drag", "quadratic", (0, 3), 0.1),
            cause("dry_friction", "dry", (0, 3), 0.1),
            cause("hardening", "cubic", (-20, 20), 1.0),
        ],
        [jv.Channel("angle", "rad", noise=1e-3, consider=("scale", "delay"))],
    )


def swings(hidden: dict[str, float], rng: np.random.Generator) -> list[jv.Recording]:
    """Eight swings of another integrator."""
    c, q, f, k = (hidden.get(n, 0.0) for n in ("viscous_friction", "quadratic_drag", "dry_friction", "hardening"))
    t, out = np.arange(0.0, 2.0, 0.02), []
    for i in range(8):
        start = 0.2 + 0.1 * i

        def rate(_: float, s: Array) -> list[float]:
            a, w = s
            return [w, -60 * np.sin(a) - c * w - q * abs(w) * w - f * np.tanh(w / 0.02) - k * a**3]

        y = solve_ivp(rate, (0, 2), [start, 0.0], "DOP853", t, rtol=1e-9, atol=1e-11, max_step=5e-3).y[0]
        y = np.interp(t - hidden.get("angle_delay", 0.0), t, y) * hidden.get("angle_scale", 1.0)
        out.append(jv.Recording(f"swing {i}", t, y + 1e-3 * rng.standard_normal(t.size), {"start": start}))
    return out


PENDULUM = ("viscous_friction", 0.05), ("quadratic_drag", 0.01), ("dry_friction", 0.1), ("hardening", 1.0)


Draw = Callable[[dict[str, float], np.random.Generator], list[jv.Recording]]


def campaigns(name: str, study: jv.Study, draw: Draw, hidden: Sequence[tuple[str, float]], n: int) -> None:
    """n campaigns with a hidden cause and n without; a row each, those that failed first."""
    rows = []
    for k in range(2 * n):
        what = dict([hidden[k % len(hidden)]]) if k < n else {}
        began = time.perf_counter()
        d = jv.diagnose(draw(what, np.random.default_rng(100 + k)), study)
        right = set(d.named) == set(what)
        twin = not right and any(set(what) <= set(t) for t in d.indistinguishable) and len(d.named) == 1
        took, runs = time.perf_counter() - began, d.runs.made if d.runs else 0
        rows.append(
            (right, twin, bool(what), f"{what or 'nothing'}", " + ".join(d.named) or "-", d.p_value, runs, took)
        )
    print(f"\n{name}\n\n| right | hidden | named | p | runs | s |\n|---|---|---|---|---|---|")
    for right, twin, _, what, named, p, runs, took in sorted(rows, key=lambda r: r[0]):
        print(f"| {'yes' if right else 'twin' if twin else 'NO'} | {what} | {named} | {p:.2g} | {runs} | {took:.0f} |")
    good, false = sum(r[0] or r[1] for r in rows if r[2]), sum(not r[0] for r in rows if not r[2])
    print(f"\nright or declared twin {good} of {n}; something named or discrepant without a cause: {false} of {n}")


def main() -> None:
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    campaigns("Pendulum (8 recordings, 6 candidates)", pendulum(), swings, PENDULUM, n)


if __name__ == "__main__":
    main()
