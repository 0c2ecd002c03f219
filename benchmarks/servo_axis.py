"""A real servo axis (JUMPVISION_REAL_DATA/emps): what the published model lacks, and what others make of the record.

`python -m benchmarks.servo_axis`. 24.8 s of one motion made twice; position simulated from the logged force alone. The
structure is that of the whole record; each half (12.48 s and 12.36 s, the first and the second time) is simulated from
its measured start with parameters from the other half. PySINDy and mujoco.sysid, where installed, are given the same.
"""

from __future__ import annotations

import importlib.util
import math
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

import jumpvision as jv

from .any_simulator import cause

Array = NDArray[np.float64]


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
        [jv.Channel("position", "m", process=True, consider=())],
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
        given = {"q": q[a], "v": v, "t": t[a:b].copy(), "force": force[a:b].copy(), "position": q[a:b].copy()}
        name = f"half {k + 1}"
        out.append(jv.Recording(name, t[a:b:10], q[a:b:10], given, group="strokes", condition=name))
    return out


PERIOD = 12480  # samples, of the reference


def real_axis(halves: list[jv.Recording]) -> None:
    """The structure by the whole record; each half simulated with the parameters that the other half gives it."""
    study = servo()
    d = jv.diagnose(halves, study)
    walk = d.noise
    channel = jv.Channel("position", "m", noise=walk.sigma_m, correlation=walk.correlation, consider=())
    print(f"\nServo axis\n\n{d}\n\n{d.status}; {walk.sources}; {d.runs.made if d.runs else 0} runs")
    print("\n| model | half 1 by half 2 [mm] | half 2 by half 1 [mm] | both [mm] |\n|---|---|---|---|")
    rows: list[tuple[str, Callable[[jv.Recording, jv.Recording], Array]]] = [
        ("published structure", lambda of, by: by_study(of, by, study, (), channel)),
        ("diagnosed structure", lambda of, by: by_study(of, by, study, d.named, channel)),
    ]
    if sysid():
        rows.append(("mujoco.sysid: mass, damping, friction loss, offset", by_mujoco))
    if importlib.util.find_spec("pysindy"):
        rows.append(("PySINDy", by_pysindy))
    for what, predict in rows:
        error = [rms(predict(of, by) - of.values) for of, by in (halves, halves[::-1])]
        print(f"| {what} | {error[0]:.2f} | {error[1]:.2f} | {math.hypot(*error) / math.sqrt(2):.2f} |", flush=True)
    whole = {n: x.value for n, x in (d.fitted or {}).items()}
    one = one_record(halves)
    print(
        f"\nall 24.8 s at once, parameters of the whole record: {rms(study.simulate(whole, one) - one.values):.2f} mm"
    )


def rms(x: Array) -> float:
    """[mm]"""
    return 1e3 * float(np.sqrt(np.mean(x * x)))


def by_study(of: jv.Recording, by: jv.Recording, study: jv.Study, named: tuple[str, ...], channel: jv.Channel) -> Array:
    """A half by the parameters of the other one."""
    more = [p for m in study.mechanisms if m.name in named for p in m.parameters]
    fixed = jv.Study(study.simulate, [*study.parameters, *more], [], [channel])
    fitted = jv.diagnose([by], fixed).fitted or {}
    return np.asarray(study.simulate({n: x.value for n, x in fitted.items()}, of))


def one_record(halves: list[jv.Recording]) -> jv.Recording:
    """Both halves as one."""
    a, b = halves
    given = {"q": a.inputs["q"], "v": a.inputs["v"]}
    given |= {n: np.concatenate([a.inputs[n], b.inputs[n]]) for n in ("t", "force")}
    return jv.Recording("whole", np.concatenate([a.t, b.t]), np.concatenate([a.values, b.values]), given)


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


def main() -> None:
    if real := os.environ.get("JUMPVISION_REAL_DATA"):
        real_axis(strokes(Path(real) / "emps"))
    else:
        print("JUMPVISION_REAL_DATA is not set: the folder that holds emps/DATA_EMPS.mat")


if __name__ == "__main__":
    main()
