"""A real servo axis (JUMPVISION_REAL_DATA/emps): the published model and what it may lack, as a study of the engine.

24.8 s of one motion made twice; position simulated from the logged force alone. Each half (12.48 s and 12.36 s) is
simulated from its measured start with parameters from the other half.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

import jumpvision as jv

Array = NDArray[np.float64]


def cause(name: str, parameter: str, limits: tuple[float, float], scale: float, unit: str = "") -> jv.Mechanism:
    """A mechanism with one strength, absent at 0."""
    return jv.Mechanism(name, [jv.Parameter(parameter, 0.0, limits, unit=unit, scale=scale)])


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


def rms(x: Array) -> float:
    """[mm]"""
    return 1e3 * float(np.sqrt(np.mean(x * x)))


def by_study(of: jv.Recording, by: jv.Recording, study: jv.Study, named: tuple[str, ...], channel: jv.Channel) -> Array:
    """A half by the parameters of the other one."""
    more = [p for m in study.mechanisms if m.name in named for p in m.parameters]
    fixed = jv.Study(study.simulate, [*study.parameters, *more], [], [channel])
    fitted = jv.diagnose([by], fixed).fitted or {}
    return np.asarray(study.simulate({n: x.value for n, x in fitted.items()}, of))
