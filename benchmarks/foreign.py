"""A stranger's simulator at the door: what `jv.diagnose` says of it beside the truth and plain least squares.

`python -m benchmarks.foreign [ROW ...] [--draws N] [--seed S]`; the axis and the pendulum with JUMPVISION_REAL_DATA.
A row a case, failures first. Truths are drawn by other integrators than the studies', but for the stepped march, whose
point is that the same function drew the data.
"""

from __future__ import annotations

import argparse
import math
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

import jumpvision as jv

from .any_simulator import cause
from .rows import share

Array = NDArray[np.float64]
Generator = np.random.Generator
Z95 = 1.96


@dataclass(frozen=True)
class Said:
    """Of one draw: whether it is as it must be, and what was said."""

    good: bool
    text: str
    runs: int = 0
    seconds: float = 0.0


def asked(recordings: Sequence[jv.Recording], study: jv.Study) -> tuple[jv.Diagnosis, float]:
    began = time.perf_counter()
    found = jv.diagnose(recordings, study)
    return found, time.perf_counter() - began


def said(good: bool, text: str, found: jv.Diagnosis, seconds: float) -> Said:
    return Said(good, text, found.runs.made if found.runs else 0, seconds)


def fitted(found: jv.Diagnosis, name: str) -> tuple[float, float]:
    """(value, standard uncertainty; NaN where none is stated) of a parameter."""
    p = (found.fitted or {}).get(name)
    return (math.nan, math.nan) if p is None else (p.value, p.sigma)


def doubted(found: jv.Diagnosis, kind: str) -> set[str]:
    """The names about which the record says so."""
    return {n for d in getattr(found, "doubts", ()) if d.kind == kind for n in d.names}


# -- a march in steps of 20 us from an instant of contact that is not known --
STEP, MASS, FALL = 2e-5, 0.4, 3.0  # s, kg, m/s


@njit
def entry(t: Array, contact: float, drag: float, added: float) -> Array:
    """Acceleration of a cone that enters water at `contact`, at the step that is due at each time."""
    out, z, v, n, a = np.empty(t.size), 0.0, FALL, 0, 9.81
    for i in range(t.size):
        due = int((t[i] - contact) / STEP) if t[i] >= contact else -1
        while n < due:
            area = 0.6 * z * z
            heavy = MASS + added * 1000.0 * 0.5 * z**3
            force = drag * 500.0 * area * v * v + added * 1000.0 * 1.5 * z * z * v * v
            a = (MASS * 9.81 - force) / heavy
            v += STEP * a
            z += STEP * v
            n += 1
        out[i] = 9.81 if due < 0 else a
    return out


def entries(rng: Generator, drag: float, added: float) -> list[jv.Recording]:
    t = np.arange(0.0, 0.06, 5e-4)
    out = []
    for k in range(6):
        y = entry(t, 5e-3 + 1e-3 * rng.standard_normal(), drag, added) + 0.3 * rng.standard_normal(t.size)
        out.append(jv.Recording(f"drop {k}", t, y))
    return out


def stepped_study(*, mass: bool) -> jv.Study:
    free = [
        jv.Parameter("drag", 0.5, (0, 4), unit="1"),
        jv.Parameter("contact", 5e-3, sigma=1e-3, unit="s", each=True),
    ]
    more = [cause("added_mass", "added", (0, 2), 0.05)] if mass else []
    return jv.Study(
        lambda p, r: entry(r.t, p["contact"], p["drag"], p.get("added", 0.0)),
        free,
        more,
        [jv.Channel("acceleration", "m/s^2", noise=0.3)],
    )


def stepped(rng: Generator) -> Said:
    """Drag alone: its true value inside the 95 % interval."""
    found, took = asked(entries(rng, 0.70, 0.0), stepped_study(mass=False))
    value, sigma = fitted(found, "drag")
    good = found.adequate and abs(value - 0.70) < Z95 * sigma
    return said(good, f"drag {value:.4f} ± {sigma:.4f} for 0.70, {found.verdict}", found, took)


def stepped_named(rng: Generator) -> Said:
    """Added mass beside it, of the same function: named, both inside their intervals; never complete and wrong."""
    found, took = asked(entries(rng, 0.70, 0.30), stepped_study(mass=True))
    drag, added = fitted(found, "drag"), fitted(found, "added")
    inside = abs(drag[0] - 0.70) < Z95 * drag[1] and abs(added[0] - 0.30) < Z95 * added[1]
    text = f"{found.status}: drag {drag[0]:.3f} ± {drag[1]:.3f}, added {added[0]:.3f} ± {added[1]:.3f} for 0.70, 0.30"
    return said(found.named == ("added_mass",) and found.status == "complete" and inside, text, found, took)


# -- numbers that no recording can tell --
TIME = np.arange(0.0, 2.0, 0.02)


def bound(rng: Generator, force: float = 0.0) -> list[jv.Recording]:
    """A mass on a spring, k/m = 60, let go, by the closed form."""
    out = []
    for k in range(3):
        x0 = 0.05 + 0.03 * k
        y = x0 * np.cos(math.sqrt(60.0) * TIME) + force / 60.0 * (1.0 - np.cos(math.sqrt(60.0) * TIME))
        out.append(jv.Recording(f"run {k}", TIME, y + 2e-4 * rng.standard_normal(TIME.size), {"start": x0}))
    return out


def rung(x: float, rate: float, push: float, damping: float) -> Array:
    """Position by leapfrog, 1 ms."""
    out, v = np.empty(TIME.size), 0.0
    for i in range(TIME.size):
        out[i] = x
        for _ in range(20):
            x += 5e-4 * v
            v += 1e-3 * (push - rate * x - damping * v)
            x += 5e-4 * v
    return out


def ratio(rng: Generator) -> Said:
    """m and k of a simulator that uses k/m alone, from drawn starts: both said to be untold."""
    m = float(rng.uniform(0.6, 2.9))
    study = jv.Study(
        lambda p, r: rung(r.inputs["start"], p["k"] / p["m"], 0.0, 0.0),
        [jv.Parameter("m", m, (0.5, 3), unit="kg"), jv.Parameter("k", float(rng.uniform(30, 240)), (20, 250))],
        [],
        [jv.Channel("x", "m", noise=2e-4)],
    )
    found, took = asked(bound(rng), study)
    value, sigma = fitted(found, "m")
    good = {"m", "k"} <= doubted(found, "cannot tell")
    return said(good, f"m {value:.3f} ± {sigma:.3f} (0.5 to 3)", found, took)


def ignored(rng: Generator) -> Said:
    """A parameter and a mechanism that the function never reads."""
    study = jv.Study(
        lambda p, r: rung(r.inputs["start"], p["W"], 0.0, p["damping"]),
        [jv.Parameter("W", 50.0, (30, 90)), jv.Parameter("dampng", 0.5, (0, 2))],
        [cause("viscous", "damping", (0, 3), 0.1), cause("misspelt", "dry", (0, 3), 0.1)],
        [jv.Channel("x", "m", noise=2e-4)],
    )
    found, took = asked(bound(rng), study)
    none = doubted(found, "no effect")
    good = none == {"dampng", "dry"} and "dampng" not in (found.fitted or {})
    return said(good, f"no effect: {', '.join(sorted(none)) or '-'}; dampng {fitted(found, 'dampng')}", found, took)


def confounded(rng: Generator) -> Said:
    """Mass and gain of the drive, which only the ratio of shows, beside a spring of known rate over mass."""
    pushes = [2.0, 4.0, 6.0]
    study = jv.Study(
        lambda p, r: rung(0.0, 60.0, p["gain"] * r.inputs["push"] / p["mass"], 0.0),
        [
            jv.Parameter("mass", float(rng.uniform(1.2, 3)), (1, 4), unit="kg"),
            jv.Parameter("gain", float(rng.uniform(0.8, 2.5)), (0.5, 3)),
        ],
        [],
        [jv.Channel("x", "m", noise=2e-4)],
    )
    scale = float(rng.uniform(0.5, 1.0))
    closed = (1.0 - np.cos(math.sqrt(60.0) * TIME)) / 60.0
    recordings = [
        jv.Recording(f"push {f}", TIME, scale * f * closed + 2e-4 * rng.standard_normal(TIME.size), {"push": f})
        for f in pushes
    ]
    found, took = asked(recordings, study)
    mass, gain = fitted(found, "mass"), fitted(found, "gain")
    good = {"mass", "gain"} <= doubted(found, "cannot tell")
    return said(good, f"mass {mass[0]:.3f} ± {mass[1]:.3f}, gain {gain[0]:.3f} ± {gain[1]:.3f}", found, took)


# -- a cart by solve_ivp --
def cart_study() -> jv.Study:
    def simulate(p: dict[str, float], r: jv.Recording) -> Array:
        def rate(t: float, s: Array) -> list[float]:
            x, v = s
            push = r.inputs["force"] * math.sin(r.inputs["rate"] * t)
            pull = p["k"] * x + p["viscous"] * v + p["dry"] * math.tanh(v / 0.01) + p["quadratic"] * abs(v) * v
            return [v, (push - pull) / 1.5]

        return np.asarray(
            solve_ivp(rate, (0, r.t[-1]), [r.inputs["start"], 0.0], t_eval=r.t, rtol=1e-6, atol=1e-8).y[0]
        )

    return jv.Study(
        simulate,
        [jv.Parameter("k", 40.0, (20, 80), unit="N/m")],
        [
            cause("viscous_friction", "viscous", (0, 5), 0.1, "N s/m"),
            cause("dry_friction", "dry", (0, 3), 0.05, "N"),
            cause("quadratic_drag", "quadratic", (0, 5), 0.2, "N s^2/m^2"),
        ],
        [jv.Channel("x", "m", noise=5e-4)],
    )


@njit
def carted(t: Array, start: float, force: float, rate: float, c: float, f: float, q: float) -> Array:
    """Runge-Kutta's fourth order, 0.1 ms."""
    out, x, v, h, now = np.empty(t.size), start, 0.0, 1e-4, 0.0
    k = np.zeros((4, 2))
    for i in range(t.size):
        while now < t[i] - 0.5 * h:
            for j in range(4):
                at = 0.0 if j == 0 else h if j == 3 else 0.5 * h
                y, w = (x, v) if j == 0 else (x + at * k[j - 1, 0], v + at * k[j - 1, 1])
                pull = 50.0 * y + c * w + f * math.tanh(w / 0.01) + q * abs(w) * w
                k[j, 0], k[j, 1] = w, (force * math.sin(rate * (now + at)) - pull) / 1.5
            x += h / 6.0 * (k[0, 0] + 2.0 * k[1, 0] + 2.0 * k[2, 0] + k[3, 0])
            v += h / 6.0 * (k[0, 1] + 2.0 * k[1, 1] + 2.0 * k[2, 1] + k[3, 1])
            now += h
        out[i] = x
    return out


def cart(rng: Generator) -> Said:
    """Two causes of three; runs at most 600."""
    t, out = np.arange(0.0, 4.0, 0.02), []
    for k in range(5):
        start, force, rate = 0.1 + 0.05 * k, 1.0 * k, 2.0 + k
        y = carted(t, start, force, rate, 0.3, 0.25, 0.0) + 5e-4 * rng.standard_normal(t.size)
        out.append(jv.Recording(f"run {k}", t, y, {"start": start, "force": force, "rate": rate}))
    found, took = asked(out, cart_study())
    runs = found.runs.made if found.runs else 0
    good = set(found.named) == {"viscous_friction", "dry_friction"} and runs <= 600
    return said(good, f"{' + '.join(found.named) or '-'}, {found.status}", found, took)


# -- a real pendulum --
def pendulum(_: Generator) -> Said:
    """4,223 samples of a real pendulum until it stops, in four pieces, three candidates: at most 60 s."""
    from scipy.io import loadmat

    folder = Path(os.environ["JUMPVISION_REAL_DATA"]) / "kaheman_single_pendulum"
    file = loadmat(folder / "SingleDataFreeSwing_1_Dt_0_0001.mat", simplify_cells=True)["Theta1"]
    t, y = np.asarray(file["time"], float), np.asarray(file["signals"]["values"], float) - math.pi
    keep = slice(0, 56_000, 13)  # until it sticks
    t, y = (t[keep] - t[0])[:4223], y[keep][:4223]

    def simulate(p: dict[str, float], r: jv.Recording) -> Array:
        n, a, w, out = 8, p["angle"], p["speed"], np.empty(r.t.size)
        h = float(np.median(np.diff(r.t))) / n
        for i in range(r.t.size):
            out[i] = a
            for _ in range(n):
                a += 0.5 * h * w
                pull = p["W"] * math.sin(a - p["zero"]) + p["viscous"] * w + p["quadratic"] * abs(w) * w
                w -= h * (pull + p["coulomb"] * math.tanh(w / 5e-3))
                a += 0.5 * h * w
        return out

    def first(r: jv.Recording) -> float:
        return float(np.polyfit(r.t[:40] - r.t[0], r.values[:40], 2)[2])

    def speed(r: jv.Recording) -> float:
        return float(np.polyfit(r.t[:40] - r.t[0], r.values[:40], 2)[1])

    study = jv.Study(
        simulate,
        [
            jv.Parameter("W", 60.0, (30, 90), unit="1/s^2"),
            jv.Parameter("zero", 0.0, (-0.05, 0.05), unit="rad", scale=1e-3),
            jv.Parameter("angle", first, sigma=1e-3, unit="rad", each=True),
            jv.Parameter("speed", speed, sigma=2e-2, unit="rad/s", each=True),
        ],
        [
            cause("viscous_friction", "viscous", (0, 5), 0.05, "1/s"),
            cause("quadratic_drag", "quadratic", (0, 20), 0.2),
            cause("coulomb_friction", "coulomb", (0, 3), 0.02, "1/s^2"),
        ],
        [jv.Channel("angle", "rad", noise=3e-4)],
    )
    pieces = np.array_split(np.arange(t.size), 4)
    found, took = asked([jv.Recording(f"piece {i}", t[k], y[k]) for i, k in enumerate(pieces)], study)
    value, sigma = fitted(found, "coulomb")
    near = f"closest {' + '.join(found.closest.mechanisms)}" if found.closest else ""
    text = f"{found.status}: {' + '.join(found.named) or '-'} {near}, coulomb {value:.3f} ± {sigma:.3f}"
    return said(took <= 60.0, text, found, took)


# -- another function in the place of the study's, beside other mechanisms --
def sprung(x: float, stiff: float, cubic: float, damping: float, dry: float) -> Array:
    out, v = np.empty(TIME.size), 0.0
    for i in range(TIME.size):
        out[i] = x
        for _ in range(20):
            x += 5e-4 * v
            v -= 1e-3 * (stiff * x + cubic * x**3 + damping * v + dry * math.tanh(v / 0.02))
            x += 5e-4 * v
    return out


def function(rng: Generator) -> Said:
    """A stiffening spring as a function of its own: the held-out runs are of that function."""
    study = jv.Study(
        lambda p, r: sprung(r.inputs["start"], p["W"], 0.0, p["damping"], p["dry"]),
        [jv.Parameter("W", 50.0, (30, 90))],
        [
            cause("viscous", "damping", (0, 3), 0.1),
            jv.Mechanism(
                "stiffening",
                [jv.Parameter("cubic", 100.0, (-500, 2000), scale=50.0)],
                function=lambda p, r: sprung(r.inputs["start"], p["W"], p["cubic"], p["damping"], p["dry"]),
            ),
            cause("dry_friction", "dry", (0, 3), 0.1),
        ],
        [jv.Channel("x", "m", noise=2e-4)],
    )
    out = []
    for k in range(5):
        x0 = 0.1 + 0.05 * k
        y = solve_ivp(
            lambda _, s: [s[1], -60.0 * s[0] - 700.0 * s[0] ** 3], (0, 2), [x0, 0.0], t_eval=TIME, rtol=1e-9, atol=1e-12
        ).y[0]
        out.append(jv.Recording(f"run {k}", TIME, y + 2e-4 * rng.standard_normal(TIME.size), {"start": x0}))
    found, took = asked(out, study)
    gain, cubic = found.gain.ratio if found.gain else math.nan, fitted(found, "cubic")
    text = f"{' + '.join(found.named) or '-'}: cubic {cubic[0]:.0f} ± {cubic[1]:.0f} for 700, gain {gain:.3g}"
    return said(found.named == ("stiffening",) and gain > 20.0, text, found, took)


# -- a delay of the command, where only one of the torque is offered --
def follower(t: Array, step: Callable[[float], float], delay: Callable[[str], float], damping: float) -> Array:
    """Angle of a drive, torque = 60 (command - angle), by leapfrog at 1 ms; past values by their index."""
    n, h = round(float(t[-1]) / 1e-3) + 1, 1e-3
    a, w, angles, out = 0.0, 0.0, np.zeros(n + 1), np.empty(n)
    for i in range(n):
        out[i] = angles[i] = a
        lag = delay("torque")
        back = max(i * h - lag, 0.0) / h
        k = min(int(back), i)
        seen = angles[k] + (back - k) * (angles[min(k + 1, i)] - angles[k])
        torque = 60.0 * (step(max(i * h - lag - delay("command"), 0.0)) - seen)
        w += h * (torque - damping * w)
        a += h * w
    return np.asarray(np.interp(t, h * np.arange(n), out))


def delay(rng: Generator) -> Said:
    """Truth: the command is late by 8 ms; offered: the torque is. Misfit is left, or damping is right."""
    t, out = np.arange(0.0, 3.0, 0.02), []

    def command(rate: float) -> Callable[[float], float]:
        return lambda s: 0.5 * math.sin(rate * s) + 0.2 * math.sin(2.7 * rate * s)

    def simulate(p: dict[str, float], r: jv.Recording) -> Array:
        return follower(r.t, command(r.inputs["rate"]), lambda n: p["lag"] if n == "torque" else 0.0, p["damping"])

    study = jv.Study(
        simulate,
        [jv.Parameter("damping", 0.4, (0, 3), unit="1/s")],
        [cause("torque_delay", "lag", (0, 0.03), 1e-3, "s")],
        [jv.Channel("angle", "rad", noise=1e-3)],
    )
    for k in range(3):
        rate = 2.0 + 1.5 * k

        def late(s: float, rate: float = rate) -> float:
            return command(rate)(max(s - 8e-3, 0.0))

        y = solve_ivp(
            lambda s, x, late=late: [x[1], 60.0 * (late(s) - x[0]) - 0.3 * x[1]],
            (0, 3),
            [0.0, 0.0],
            t_eval=t,
            rtol=1e-8,
            atol=1e-10,
        ).y[0]
        out.append(jv.Recording(f"run {k}", t, y + 1e-3 * rng.standard_normal(t.size), {"rate": rate}))
    found, took = asked(out, study)
    value, sigma = fitted(found, "damping")
    good = found.status != "complete" or abs(value - 0.3) < Z95 * sigma
    return said(
        good, f"{found.status}: {' + '.join(found.named) or '-'}, damping {value:.3f} ± {sigma:.3f}", found, took
    )


# -- a real axis --
def servo(_: Generator) -> Said:
    """The published structure over the whole record <= 2.9 mm rms, simulated; a half by the other one, structure and
    walk as diagnosed of both, <= 4 mm."""
    from .servo_axis import by_study, one_record, rms, strokes
    from .servo_axis import servo as axis

    halves, study = strokes(Path(os.environ["JUMPVISION_REAL_DATA"]) / "emps"), axis()
    one, names = one_record(halves), [p.name for p in study.parameters]
    millimetre = [jv.Channel("position", "m", noise=1e-3, consider=())]
    alone = jv.diagnose([one], jv.Study(study.simulate, study.parameters, [], millimetre))
    start = [float(p.start) for p in study.parameters]  # type: ignore[arg-type]

    def residual(x: Array) -> Array:
        return np.asarray(study.simulate(dict(zip(names, x)), one) - one.values)

    plain = rms(least_squares(residual, start, x_scale=[1, 5, 0.5, 0.1]).fun)
    found, took = asked(halves, study)
    walk = jv.Channel("position", "m", noise=found.noise.sigma_m, correlation=found.noise.correlation, consider=())
    ways = (halves, halves[::-1])
    other = [rms(by_study(of, by, study, found.named, walk) - of.values) for of, by in ways]
    whole = 1e3 * alone.simulated[0].rms["position"]
    each = "; ".join(f"{len(s.mechanisms)} causes by {s.by} {1e3 * s.rms['position']:.2f}" for s in found.simulated)
    text = f"published, whole record {whole:.2f} mm (plain least squares {plain:.2f}); {each}; "
    text += f"half by half {other[0]:.2f}, {other[1]:.2f} with {', '.join(found.named)}"
    return said(whole <= 2.9 and max(other) <= 4.0, text, found, took)


ROWS: dict[str, Callable[[Generator], Said]] = {
    "servo": servo,
    "stepped": stepped,
    "stepped_named": stepped_named,
    "ratio": ratio,
    "ignored": ignored,
    "confounded": confounded,
    "cart": cart,
    "pendulum": pendulum,
    "function": function,
    "delay": delay,
}
REAL = ("servo", "pendulum")


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("rows", nargs="*", choices=[[], *ROWS], help="default: all")
    parser.add_argument("--draws", type=int, default=1)
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    real, table = os.environ.get("JUMPVISION_REAL_DATA"), []
    for name in given.rows or ROWS:
        if name in REAL and not real:
            continue
        each: list[Said] = []
        for k in range(1 if name in REAL else given.draws):
            try:
                each.append(ROWS[name](np.random.default_rng([given.seed, k])))
            except Exception as e:  # a table shows what broke, whatever it was
                each.append(Said(False, f"{type(e).__name__}: {str(e)[:120]}"))
        good = sum(s.good for s in each)
        worst = next((s for s in each if not s.good), each[0])
        runs, seconds = int(np.median([s.runs for s in each])), float(np.median([s.seconds for s in each]))
        table.append((good / len(each), name, share(good, len(each)), worst.text, runs, seconds))
        print(table[-1], flush=True)
    print("\n| case | as it must be | first that fails, else first | runs | s |\n|---|---|---|---|---|")
    for _, name, how, text, runs, seconds in sorted(table):
        print(f"| {name} | {how} | {text} | {runs} | {seconds:.0f} |")


if __name__ == "__main__":
    main()
