"""Any simulator in question: foreign simulators with hidden causes and nulls, the runs they take, a real servo axis.

`python -m benchmarks.any_simulator [CAMPAIGNS]`; the axis with JUMPVISION_REAL_DATA. Truth by scipy's DOP853.
"""

from __future__ import annotations

import math
import os
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path

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


# -- the real servo axis --
@njit
def axis(q: float, v: float, t: Array, force: Array, p: Array) -> Array:
    """Position of the published model and of what may be missing from it; dry friction holds where it can."""
    out, h = np.empty(t.size), 0.5 * (t[1] - t[0])
    for i in range(t.size):
        out[i] = q
        z = (q - MIDDLE) / MIDDLE
        late = force[i] - p[10] * (force[i] - force[i - 1]) / (t[1] - t[0]) if i else force[i]
        f = late - p[3] - p[8] * t[i] - p[9] * z
        along = 1.0 + p[5] * (math.cos(p[6]) * z + math.sin(p[6]) * (1.5 * z * z - 0.5))
        for _ in range(2):
            speed = abs(v)
            dry = max(along * (p[2] + p[7] * math.exp(-speed / 0.02)), 0.0)
            viscous = along * (p[1] + (p[4] if v > 0 else -p[4]) + p[11] * speed)
            new = v + h * (f - viscous * v) / p[0]
            v = math.copysign(max(abs(new) - h * dry / p[0], 0.0), new)
            q += h * v
    return out


MIDDLE = 0.123  # m, of the travel
AXIS = ("M", "Fv", "Fc", "offset", "asymmetry", "along", "phase", "stribeck", "drift", "spring", "lag", "by_speed")


def servo() -> jv.Study:
    """The published model. What is along the axis scales all friction, as the preload of a screw does: by Legendre's
    first polynomial (phase 0), its second (pi/2) or between. Whoever chose these forms had seen what others leave on
    the halves: no blind forecast of them."""
    return jv.Study(
        lambda p, r: axis(
            r.inputs["q"], r.inputs["v"], r.inputs["t"], r.inputs["force"], np.array([p.get(n, 0.0) for n in AXIS])
        )[::10],
        [
            jv.Parameter("M", 95.1, (80, 110), unit="kg", scale=1.0),
            jv.Parameter("Fv", 203.5, (100, 300), unit="N s/m", scale=5.0),
            jv.Parameter("Fc", 20.4, (10, 40), unit="N", scale=0.5),
            jv.Parameter("offset", -3.16, (-8, 8), unit="N", scale=0.1),
        ],
        [
            cause("viscous_asymmetry", "asymmetry", (-80, 80), 5.0, "N s/m"),
            jv.Mechanism(
                "friction_by_position",
                [
                    jv.Parameter("along", 0.0, (-0.2, 0.2), scale=0.01),
                    jv.Parameter("phase", 0.8, (-1.6, 3.2), unit="rad", scale=0.2),
                ],
                shapes=[(0.0,), (0.8,), (1.6,), (2.4,)],
            ),
            cause("stribeck", "stribeck", (-8, 20), 1.0, "N"),
            cause("viscous_friction_by_speed", "by_speed", (-800, 800), 50.0, "N s^2/m^2"),
            cause("offset_drift", "drift", (-0.1, 0.1), 0.005, "N/s"),
            cause("spring", "spring", (-5, 5), 0.1, "N"),
            cause("drive_lag", "lag", (0, 0.01), 0.001, "s"),
        ],
        [jv.Channel("position", "m", process=True)],
    )


def strokes(folder: Path) -> list[jv.Recording]:
    """The two periods of the record, one motion twice; start as measured, its speed by a cubic through 20 samples."""
    from scipy.io import loadmat

    file = loadmat(folder / "DATA_EMPS.mat")
    t, q = file["t"].ravel(), file["qm"].ravel()
    force = float(file["gtau"][0, 0]) * file["vir"].ravel()
    out = []
    for k, (a, b) in enumerate(((0, PERIOD), (PERIOD, t.size))):
        first = slice(a, a + 20)
        v = np.polyfit(t[first] - t[a], q[first], 3)[2]
        given = {"q": q[a], "v": v, "t": t[a:b].copy(), "force": force[a:b].copy()}
        name = f"half {k + 1}"
        out.append(jv.Recording(name, t[a:b:10], q[a:b:10], given, group="strokes", condition=name))
    return out


PERIOD = 12480  # samples, of the reference


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


def real_axis(halves: list[jv.Recording]) -> None:
    """The structure by the whole record; each half simulated with the parameters that the other half gives it."""
    study = servo()
    d = jv.diagnose(halves, study)
    walk = d.noise
    channel = jv.Channel("position", "m", noise=walk.sigma_m, correlation=walk.correlation)
    print(f"\nServo axis\n\n{d}\n\n{d.status}; {walk.sources}; {d.runs.made if d.runs else 0} runs")
    print("\n| structure | half 1 by half 2 [mm] | half 2 by half 1 [mm] | both [mm] |\n|---|---|---|---|")
    for what, named in (("published", ()), ("diagnosed", d.named)):
        more = [p for m in study.mechanisms if m.name in named for p in m.parameters]
        fixed = jv.Study(study.simulate, [*study.parameters, *more], [], [channel])
        errors = []
        for here, other in (halves, halves[::-1]):
            fitted = jv.diagnose([other], fixed).fitted or {}
            values = {n: x.value for n, x in fitted.items()}
            errors.append(1e3 * float(np.sqrt(np.mean((study.simulate(values, here) - here.values) ** 2))))
        both = math.sqrt((errors[0] ** 2 + errors[1] ** 2) / 2)
        print(f"| {what} | {errors[0]:.2f} | {errors[1]:.2f} | {both:.2f} |", flush=True)


def main() -> None:
    n = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    campaigns("Pendulum (8 recordings, 6 candidates)", pendulum(), swings, PENDULUM, n)
    if real := os.environ.get("JUMPVISION_REAL_DATA"):
        real_axis(strokes(Path(real) / "emps"))


if __name__ == "__main__":
    main()
