"""Peers on the same recordings in one run: what each foretells of recordings that it was not given.

`python -m benchmarks.peers [CASES ...]`: `servo` (a real axis, JUMPVISION_REAL_DATA/emps: half 2 by half 1), `pendulum`
(a real one, swinging out: its last two pieces by the first two), `balls` (eleven real balls: the second drop of each by
the first), `drive` (two masses with an elastic joint, truth by scipy with a drag of the load that goes with the square
of the speed, 1 mrad of noise; four recordings by six). Every simulation is open loop from the start as measured.

scipy: `least_squares` of the parameters of the user's function; "all": those of every listed cause too; "its closest":
those of the causes that the diagnosis names, or calls closest. GP: Gaussian
process (scikit-learn) of what scipy leaves, over time, simulated values, their rates and the input, at 400 samples, as
a discrepancy in the manner of Kennedy and O'Hagan. PySINDy: thresholded least squares of smoothed derivatives over the
listed terms, integrated. mujoco.sysid: the same structure as a MuJoCo model (needs `mujoco[sysid]`).
"""

from __future__ import annotations

import importlib.util
import math
import os
import sys
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.optimize import least_squares

import jumpvision as jv
from tests.worlds.bodies import drops

from .causes import machines
from .worlds import axis
from .worlds.axis import cause
from .worlds.dropped_balls import balls as real_balls

Array = NDArray[np.float64]
Predict = Callable[[jv.Recording], Array]
SEED, SAMPLES = 3, 400  # of the drive's noise; of a Gaussian process


@dataclass(frozen=True)
class Case:
    """study: as a user writes it; given: recordings that are fitted, held: that are foretold. unit: of the errors, and
    what they are multiplied by for it. terms: of PySINDy, (values (n, m), rates (n, m), input (n,)) -> (n, k) for each
    of the m accelerations; window: samples of its smoothing."""

    study: jv.Study
    given: Sequence[jv.Recording]
    held: Sequence[jv.Recording]
    unit: str
    times: float
    terms: Callable[[Array, Array, Array], Array] | None = None
    window: int = 15
    others: Mapping[str, Predict] = field(default_factory=dict)


def measured(study: jv.Study, r: jv.Recording) -> Array:
    return r.of_channels(r.values, study.channels)


def by_scipy(case: Case, causes: Sequence[str] = ()) -> tuple[Predict, dict[str, float]]:
    study = case.study
    free = [*study.parameters, *(q for m in study.mechanisms for q in m.parameters if m.name in causes)]
    noise = np.array([c.noise or 1e-3 for c in study.channels])

    def residual(x: Array) -> Array:
        p = dict(zip([q.name for q in free], x))
        off = [((study.predict(p, r) - measured(study, r)) / noise).ravel() for r in case.given]
        return np.nan_to_num(np.concatenate(off), nan=1e6, posinf=1e6, neginf=-1e6)

    ends = [q.free() for q in free]
    first = np.array([min(max(q.start, q.low + 1e-6 * (q.high - q.low)), q.high) for q in ends])
    found = least_squares(
        residual, first, x_scale=[q.scale for q in ends], bounds=([q.low for q in ends], [q.high for q in ends])
    )
    p = dict(zip([q.name for q in free], found.x.tolist()))
    return (lambda r: study.predict(p, r)), p


def by_diagnosis(case: Case) -> tuple[Predict, str, Sequence[str]]:
    """(the model to predict with, the causes in words, the closest ones where none is named)"""
    study = replace(case.study, channels=[replace(c, consider=()) for c in case.study.channels])
    d = jv.diagnose(list(case.given), study, budget=20_000)
    best = d.prediction.parameters if d.prediction else d.fitted or {}
    p = {n: x.value for n, x in best.items()}
    near = tuple(d.closest.mechanisms) if d.closest else ()
    words = " + ".join(d.named) or f"nothing ({d.status}), closest {' + '.join(near)}"
    return (lambda r: study.predict(p, r)), words, d.named or near


def by_process(case: Case) -> Predict:
    """scipy's fit, and a Gaussian process of what it leaves."""
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

    plain, _ = by_scipy(case)

    def features(r: jv.Recording) -> Array:
        y = plain(r)
        return np.column_stack([r.t - r.t[0], y, np.gradient(y, r.t, axis=0), drive_of(r)])

    x = np.concatenate([features(r) for r in case.given])
    left = np.concatenate([measured(case.study, r) - plain(r) for r in case.given])
    few = np.random.default_rng(SEED).choice(len(x), min(SAMPLES, len(x)), replace=False)
    middle, size = x.mean(axis=0), x.std(axis=0) + 1e-12
    kernel = ConstantKernel(1.0) * RBF(np.ones(x.shape[1])) + WhiteKernel(0.1)
    models = []
    for k in range(left.shape[1]):
        model = GaussianProcessRegressor(kernel, normalize_y=True).fit((x[few] - middle) / size, left[few, k])
        models.append(model)
    return lambda r: plain(r) + np.stack([m.predict((features(r) - middle) / size) for m in models], axis=1)


def drive_of(r: jv.Recording) -> Array:
    """The input at a recording's times; 0 where it has none."""
    series = [np.asarray(x) for n, x in r.inputs.items() if n in ("force", "torque")]
    if not series:
        return np.zeros(r.t.size)
    return series[0][:: max(series[0].size // r.t.size, 1)][: r.t.size]


def by_sindy(case: Case) -> Predict:
    import pysindy
    from scipy.signal import savgol_filter

    terms = case.terms
    assert terms is not None
    columns, targets = [], []
    for r in case.given:
        y, h = measured(case.study, r), float(np.median(np.diff(r.t)))
        v, a = (savgol_filter(y, case.window, 4, deriv=k, delta=h, axis=0) for k in (1, 2))
        cut = slice(case.window, -case.window)
        columns.append(terms(y, v, drive_of(r))[cut])
        targets.append(a[cut])
    x, a = np.concatenate(columns), np.concatenate(targets)
    size = np.sqrt(np.mean(x**2, axis=0)) + 1e-12
    optimizer = pysindy.STLSQ(threshold=0.02 * float(np.sqrt(np.mean(a**2))), alpha=0.0)
    optimizer.fit(x / size, a)
    c = np.atleast_2d(optimizer.coef_) / size

    def rate(s: Array, u: float) -> Array:
        m = s.size // 2
        return np.concatenate([s[m:], c @ terms(s[None, :m], s[None, m:], np.array([u]))[0]])

    def predict(r: jv.Recording) -> Array:
        y0, u = measured(case.study, r)[0], drive_of(r)
        s, out, h = np.concatenate([y0, np.atleast_1d(speed_of(case, r))]), [], float(np.median(np.diff(r.t)))
        for i in range(r.t.size):
            out.append(s[: y0.size])
            for part in range(4):
                b = u[i] + (u[min(i + 1, u.size - 1)] - u[i]) * (part + 0.5) / 4
                k1 = rate(s, b)
                k2 = rate(s + h / 8 * k1, b)
                k3 = rate(s + h / 8 * k2, b)
                s = s + h / 24 * (k1 + 2 * k2 + 2 * k3 + rate(s + h / 4 * k3, b))
        return np.array(out)

    return predict


def speed_of(case: Case, r: jv.Recording) -> Array | float:
    return r.inputs.get("speed", np.zeros(len(case.study.channels)))  # type: ignore[return-value]


AXIS_XML = """<mujoco><option timestep="0.001" gravity="0 0 0" integrator="implicitfast"/>
<worldbody><body><joint name="x" type="slide" axis="1 0 0" damping="{}" frictionloss="{}"/>
<geom size="0.05" mass="{}" contype="0" conaffinity="0"/></body></worldbody>
<actuator><motor joint="x"/></actuator></mujoco>"""


def by_mujoco(of: jv.Recording, by: jv.Recording) -> Array:
    """A half by mujoco.sysid: the published model's parameters through the whole simulation, by least squares."""
    import mujoco
    from mujoco import rollout, sysid

    first = {"mass": (95.1, 80.0, 110.0), "damping": (203.5, 100.0, 300.0), "loss": (20.4, 10.0, 40.0)}
    first["offset"] = (-3.16, -8.0, 8.0)
    known = sysid.ParameterDict({n: sysid.Parameter(n, *x) for n, x in first.items()})

    def simulated(x: Array, r: jv.Recording) -> Array:
        mass, damping, loss, offset = x
        model = mujoco.MjModel.from_xml_string(AXIS_XML.format(damping, loss, mass))
        start = np.array([[0.0, r.inputs["q"], r.inputs["v"]]])
        states, _ = rollout.rollout(model, mujoco.MjData(model), start, (r.inputs["force"] - offset)[None, :, None])
        return np.concatenate([start[0, 1:2], states[0, :-1, 1]])[::10]

    def residual(x: Array, params: object, **_: object) -> tuple[list[Array], list[Array], list[Array]]:
        y = simulated(np.ravel(x), by)
        return [1e3 * (y - by.values)], [y], [by.values]

    found, _ = sysid.optimize(initial_params=known, residual_fn=residual, optimizer="scipy", verbose=False)
    return simulated(found.as_vector(), of)


def sysid() -> bool:
    """Whether mujoco.sysid is whole: without the packages of mujoco[sysid] it can be imported and is empty."""
    try:
        return hasattr(importlib.import_module("mujoco.sysid"), "ParameterDict")
    except ImportError:
        return False


def by_pysindy(of: jv.Recording, by: jv.Recording) -> Array:
    """A half by PySINDy: terms of q'' by thresholded least squares on smoothed derivatives; Runge-Kutta at 1 ms."""
    import pysindy
    from scipy.signal import savgol_filter

    def forms(x: Array, v: Array, u: Array) -> Array:
        s = np.tanh(v / 2e-3)  # of the sign of motion
        return np.stack([np.ones_like(x), u, v, s, np.abs(v), v * np.abs(v), x, x * v, x * s], axis=-1)

    q, force, cut = by.inputs["position"], by.inputs["force"], slice(50, -50)
    v, a = (savgol_filter(q, 41, 3, deriv=k, delta=1e-3) for k in (1, 2))
    columns = forms(q, v, force)[cut]
    size = np.sqrt(np.mean(columns**2, axis=0))
    optimizer = pysindy.STLSQ(threshold=0.02, alpha=0.0)
    optimizer.fit(columns / size, a[cut, None])
    c = np.ravel(optimizer.coef_) / size

    def rate(s: Array, u: float) -> Array:
        return np.array([s[1], forms(s[0], s[1], u) @ c])

    s, out, h = np.array([of.inputs["q"], of.inputs["v"]]), [], 1e-3
    for u in of.inputs["force"]:
        out.append(s[0])
        k1 = rate(s, u)
        k2 = rate(s + 0.5 * h * k1, u)
        k3 = rate(s + 0.5 * h * k2, u)
        s = s + h / 6 * (k1 + 2 * k2 + 2 * k3 + rate(s + h * k3, u))
    return np.array(out)[::10]


# ------------------------------------------------------------------------------------------------------------ the cases
def servo(real: Path) -> Case:
    halves, study = axis.strokes(real / "emps"), axis.servo()
    of, by = halves[1], halves[0]
    others: dict[str, Predict] = {"PySINDy": lambda r: by_pysindy(r, by)[:, None]}
    if sysid():
        others["mujoco.sysid"] = lambda r: by_mujoco(r, by)[:, None]
    plain = replace(study, channels=[jv.Channel("position", "m", noise=1e-3)])
    return Case(plain, [by], [of], "mm", 1e3, others=others)


@njit
def swings(n: int, h: float, a: float, w: float, p: Array) -> Array:
    out = np.empty(n)
    for i in range(n):
        out[i] = a
        for _ in range(8):
            a += h / 16 * w
            w -= h / 8 * (p[0] * math.sin(a - p[1]) + p[2] * w + p[3] * abs(w) * w + p[4] * math.tanh(w / 5e-3))
            a += h / 16 * w
    return out


def pendulum(real: Path) -> Case:
    from scipy.io import loadmat

    file = loadmat(real / "kaheman_single_pendulum" / "SingleDataFreeSwing_1_Dt_0_0001.mat", simplify_cells=True)
    data = file["Theta1"]
    t, y = np.asarray(data["time"], float), np.asarray(data["signals"]["values"], float) - math.pi
    keep = slice(0, 56_000, 13)  # until it sticks
    t, y = t[keep][:4223], y[keep][:4223]
    names = ("W", "zero", "viscous", "quadratic", "coulomb")
    pieces = []
    for k in np.array_split(np.arange(t.size), 4):
        _, speed, start = np.polyfit(t[k][:40] - t[k][0], y[k][:40], 2)
        pieces.append(jv.Recording(f"piece {len(pieces)}", t[k], y[k], {"start": float(start), "speed": float(speed)}))

    def simulate(p: dict[str, float], r: jv.Recording) -> Array:
        h = float(np.median(np.diff(r.t)))
        return swings(r.t.size, h, r.inputs["start"], r.inputs["speed"], np.array([p[n] for n in names]))

    study = jv.Study(
        simulate,
        [jv.Parameter("W", 60.0, (30, 90)), jv.Parameter("zero", 0.0, (-0.05, 0.05), scale=1e-3)],
        [
            cause("viscous_friction", "viscous", (0, 5), 0.05),
            cause("quadratic_drag", "quadratic", (0, 20), 0.2),
            cause("coulomb_friction", "coulomb", (0, 3), 0.02),
        ],
        [jv.Channel("angle", "rad", noise=3e-3)],
    )

    def terms(x: Array, v: Array, _: Array) -> Array:
        return np.column_stack([np.sin(x), np.ones(len(x)), v, v * np.abs(v), np.tanh(v / 5e-3)])

    return Case(study, pieces[:2], pieces[2:], "mrad", 1e3, terms, 31)


def balls(real: Path) -> Case:
    folder = real / "desilva_ball_drops"
    each, given, held = real_balls(folder), [], []
    for name, tracks in drops(folder).items():
        for kept, (t, y) in zip((given, held), tracks):
            speed, start = np.polyfit(t[:15] - t[0], y[:15] + 9.81 / 2 * (t[:15] - t[0]) ** 2, 1)
            area, radius, _ = each[name].terms
            inputs = {"start": float(start), "speed": float(speed), "area": float(area), "radius": float(radius)}
            kept.append(jv.Recording(f"{name} {len(kept)}", t, y, inputs))

    def simulate(p: dict[str, float], r: jv.Recording) -> Array:
        y, v, out, at = r.inputs["start"], r.inputs["speed"], [], r.t[0]
        sharp, linear = p["drag"] * r.inputs["area"], p["linear"] * r.inputs["radius"]
        for t in r.t:
            h = (t - at) / 4
            for _ in range(4 if h > 0 else 0):
                half = v + h / 2 * (-p["g"] - sharp * v * abs(v) - linear * v)
                y += h * half
                v += h * (-p["g"] - sharp * half * abs(half) - linear * half)
            out.append(y)
            at = t
        return np.array(out)

    study = jv.Study(
        simulate,
        [jv.Parameter("g", 9.81, sigma=0.2, unit="m/s^2")],
        [cause("air_drag", "drag", (0, 3), 0.05), cause("linear_drag", "linear", (0, 0.2), 0.005)],
        [jv.Channel("height", "m", noise=0.104, correlation=0.82)],  # by repeats (`tests/worlds/bodies.py`)
    )

    def terms(x: Array, v: Array, _: Array) -> Array:
        return np.column_stack([np.ones(len(x)), v, v * np.abs(v)])

    return Case(study, given, held, "mm", 1e3, terms, 7)


@njit
def turned(u: Array, h: float, p: Array) -> Array:
    """Angles (n, 2) of motor and load, Runge-Kutta, three steps a sample."""
    y, out = np.zeros(4), np.empty((u.size, 2))
    for i in range(u.size):
        out[i, 0], out[i, 1] = y[0], y[2]
        for k in range(3):
            slopes = np.zeros((4, 4))
            for s in range(4):
                f = 0.0 if s == 0 else 1.0 if s == 3 else 0.5
                z = y + f * h / 3 * slopes[s - 1] if s else y
                torque = u[i] + (u[min(i + 1, u.size - 1)] - u[i]) * (k + f) / 3
                twist = z[0] - z[2]
                joint = p[1] * twist + p[5] * twist**3
                load = joint - p[2] * z[3] - p[3] * abs(z[3]) * z[3] - p[4] * math.tanh(z[3] / 0.2)
                slopes[s] = np.array([z[1], (torque - joint - 0.02 * z[1]) / machines.J1, z[3], load / p[0]])
            y = y + h / 18 * (slopes[0] + 2 * slopes[1] + 2 * slopes[2] + slopes[3])
    return out


DRIVE_XML = """<mujoco><option timestep="0.005" gravity="0 0 0" integrator="RK4"/><worldbody>
<body><joint name="motor" type="hinge" axis="0 0 1" damping="0.02"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 0.01"/>
<body><joint name="twist" type="hinge" axis="0 0 1" stiffness="{k}"/>
<inertial pos="0 0 0" mass="1" diaginertia="1 1 {J2}"/></body></body></worldbody>
<actuator><motor joint="motor"/></actuator></mujoco>"""


def drive(_: Path) -> Case:
    rng, recordings = np.random.default_rng(SEED), []
    true = {**machines.TRUE["drive"], "law": 0.002}
    t = machines.times("drive")
    for k in range(10):
        given = machines.inputs("drive", rng)
        y = machines.truth("drive", true, given)
        noisy = {n: x + 1e-3 * rng.standard_normal(t.size) for n, x in y.items()}
        recordings.append(jv.Recording(f"run {k}", t, noisy, given))
    names = ("J2", "k", "b", "quadratic", "dry", "cubic")

    def simulate(p: dict[str, float], r: jv.Recording) -> Array:
        return turned(r.inputs["torque"], 0.02, np.array([p[n] for n in names]))

    study = jv.Study(
        simulate,
        [
            jv.Parameter("J2", 0.02, sigma=0.001, unit="kg m^2"),
            jv.Parameter("k", 28.0, (10, 80), unit="N m/rad"),
            jv.Parameter("b", 0.04, (0, 0.5), unit="N m s/rad"),
        ],
        [
            cause("quadratic_drag", "quadratic", (0, 0.1), 1e-3),
            cause("dry_friction", "dry", (0, 0.5), 0.01),
            cause("stiffening", "cubic", (-2000, 2000), 50.0),
        ],
        [jv.Channel(n, "rad", noise=1e-3) for n in ("motor", "load")],
    )

    def terms(x: Array, v: Array, u: Array) -> Array:
        twist = x[:, 0] - x[:, 1]
        return np.column_stack(
            [u, twist, twist**3, v[:, 0], v[:, 1], v[:, 1] * np.abs(v[:, 1]), np.tanh(v[:, 1] / 0.2), np.ones(len(x))]
        )

    case = Case(study, recordings[:6], recordings[6:], "mrad", 1e3, terms, 9)
    return replace(case, others={"mujoco.sysid": by_sysid(case)}) if sysid() else case


def by_sysid(case: Case) -> Predict:
    """mujoco.sysid: inertia of the load, stiffness, damping of the load by air (`qfrc` of a damper on the ground)."""
    import mujoco
    from mujoco import rollout
    from mujoco import sysid as peer

    first = {"J2": (0.02, 0.015, 0.025), "k": (28.0, 10.0, 80.0), "b": (0.04, 0.0, 0.5)}

    def run(x: Array, r: jv.Recording) -> Array:
        inertia, k, b = x
        text = DRIVE_XML.format(k=k, J2=inertia).replace(
            "</worldbody>",
            f'</worldbody><tendon><fixed name="load" damping="{b}"><joint joint="motor" coef="1"/>'
            '<joint joint="twist" coef="1"/></fixed></tendon>',
        )
        model = mujoco.MjModel.from_xml_string(text)
        u, parts = np.asarray(r.inputs["torque"]), 4
        fine = np.interp(np.arange((u.size - 1) * parts) + 0.5, np.arange(u.size) * parts, u)
        states, _ = rollout.rollout(model, mujoco.MjData(model), np.zeros((1, 5)), fine[None, :, None])
        motor, twist = (np.concatenate([[0.0], states[0, parts - 1 :: parts, k]]) for k in (1, 2))
        return np.column_stack([motor, motor + twist])

    def residual(x: Array, params: object, **_: object) -> tuple[list[Array], list[Array], list[Array]]:
        said = [run(np.ravel(x), r) for r in case.given]
        there = [measured(case.study, r) for r in case.given]
        return [1e3 * (a - b).ravel() for a, b in zip(said, there)], said, there

    known = peer.ParameterDict({n: peer.Parameter(n, *x) for n, x in first.items()})
    found: list[Array] = []

    def predict(r: jv.Recording) -> Array:
        if not found:
            best, _ = peer.optimize(initial_params=known, residual_fn=residual, optimizer="scipy", verbose=False)
            found.append(np.ravel(best.as_vector()))
        return run(found[0], r)

    return predict


CASES = {"servo": servo, "pendulum": pendulum, "balls": balls, "drive": drive}


def error(case: Case, predict: Predict) -> float:
    """rms over all recordings held out."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        off = np.concatenate([(predict(r) - measured(case.study, r)).ravel() for r in case.held])
    return case.times * float(np.sqrt(np.mean(off**2)))


def rows(case: Case) -> dict[str, float]:
    named: list[str] = []
    near: list[str] = []

    def ours() -> Predict:
        predict, words, causes = by_diagnosis(case)
        named.append(words)
        near.extend(causes)
        return predict

    makers: dict[str, Callable[[], Predict]] = {
        "jumpvision": ours,
        "its closest, by scipy": lambda: by_scipy(case, near)[0],
        "scipy": lambda: by_scipy(case)[0],
        "scipy, all": lambda: by_scipy(case, [m.name for m in case.study.mechanisms])[0],
        "scipy + GP": lambda: by_process(case),
    }
    if case.terms is not None and importlib.util.find_spec("pysindy"):
        makers["PySINDy"] = lambda: by_sindy(case)
    makers |= {n: (lambda f=f: f) for n, f in case.others.items()}
    out = {}
    for name, make in makers.items():
        began = time.perf_counter()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                out[name] = error(case, make())
        except Exception as e:  # a table shows what broke, whatever it was
            print(f"  {name} failed: {type(e).__name__}: {str(e)[:150]}")
            out[name] = math.nan
        print(f"  {name}: {out[name]:.4g} {case.unit}, {time.perf_counter() - began:.0f} s", flush=True)
    print(f"  named: {', '.join(named)}", flush=True)
    return out


def main() -> None:
    real = os.environ.get("JUMPVISION_REAL_DATA", "")
    asked = sys.argv[1:] or list(CASES)
    table = {}
    for name in asked:
        if not real and name != "drive":
            print(f"{name}: JUMPVISION_REAL_DATA is not set")
            continue
        print(name, flush=True)
        case = CASES[name](Path(real))
        table[f"{name} [{case.unit}]"] = rows(case)
    methods = list(dict.fromkeys(m for each in table.values() for m in each))
    print(f"\n| held out, rms | {' | '.join(methods)} |\n|---|{'---|' * len(methods)}")
    worst = sorted(table.items(), key=lambda x: -x[1]["jumpvision"] / np.nanmin([*x[1].values()]))
    for name, each in worst:
        print(f"| {name} | {' | '.join(f'{each.get(m, math.nan):.3g}' for m in methods)} |")


if __name__ == "__main__":
    main()
