"""Other people's machines: a run that is odd, a number that drifts, a wrong unit, a law, a listed cause, or nothing.

Campaigns of ten recordings: a pendulum, a cart on a spring, a drive of two masses with an elastic joint, a hopper in
MuJoCo. The truth is integrated by scipy (DOP853 at 1e-10, contact located), the study's function steps with
Runge-Kutta, or is MuJoCo. Noise is Student's t of 5 degrees of freedom, its size stated. A fault's size is 1 to 8 times
(log-uniform) the one that a chi^2 test of all readings at 2 % shows with 90 % power, beside all that the study fits to
the recordings alike.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.integrate import solve_ivp

import jumpvision as jv

MACHINES = ("pendulum", "cart", "drive", *(["hopper"] if importlib.util.find_spec("mujoco") else []))
FAULTS = ("odd",) * 3 + ("drift",) * 3 + ("unit",) * 2 + ("law",) * 2 + ("dry",) * 2 + ("nothing",) * 2
RUNS, POWER = 10, 2.05 + 1.28  # sigmas of chi^2: level and power
UNITS = {"start": 180 / math.pi, "force": 1 / 9.81, "torque": 1e3, "height": 100.0}  # entered so many times too large
VARY = {"pendulum": ("W", "viscous"), "cart": ("m", "k", "c"), "drive": ("k", "b", "J2"), "hopper": ("k", "damping")}
DRIFT = {"pendulum": ("W", "viscous"), "cart": ("k", "c"), "drive": ("k", "b"), "hopper": ("k", "damping")}
TRUE = {
    "pendulum": {"W": 48.0, "viscous": 0.35, "law": 0.0, "dry": 0.0},
    "cart": {"m": 1.3, "k": 95.0, "c": 0.8, "law": 0.0, "dry": 0.0},
    "drive": {"J2": 0.02, "k": 30.0, "b": 0.05, "law": 0.0, "dry": 0.0},
    "hopper": {"k": 1900.0, "damping": 9.0, "law": 0.0, "dry": 0.0},
}
LAW = {"pendulum": 0.3, "cart": 200.0, "drive": 0.01, "hopper": 0.03}  # a size to begin with
DRY = {"pendulum": 0.05, "cart": 0.02, "drive": 0.2, "hopper": 0.1}  # speed over which dry friction turns
NOISE = {
    "pendulum": {"angle": 1e-3},
    "cart": {"x": 2e-4},
    "drive": {"motor": 1e-3, "load": 1e-3},
    "hopper": {"z": 1e-3},
}
J1, MASS = 0.01, 1.0
XML = """<mujoco><option timestep="5e-4" integrator="RK4"/><worldbody><body><joint name="z" type="slide" axis="0 0 1"/>
<geom size="0.05" mass="1.0" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""


# ------------------------------------------------------------------------------------------------------------ the truth
def times(machine: str) -> np.ndarray:
    return np.arange(0.0, 1.6, 0.01) if machine == "hopper" else np.arange(0.0, 3.0, 0.02)


def inputs(machine: str, rng: np.random.Generator) -> dict:
    """What each recording was done with."""
    t = times(machine)
    if machine == "pendulum":
        return {"start": rng.uniform(0.3, 1.2)}
    if machine == "hopper":
        return {"height": rng.uniform(0.1, 0.5)}
    f, size = rng.uniform(0.6, 2.5), {"cart": 6.0, "drive": 0.4}[machine] * rng.uniform(0.6, 1.4)
    return {{"cart": "force", "drive": "torque"}[machine]: size * np.sin(2 * math.pi * f * t)}


def truth(machine: str, p: dict, given: dict) -> dict[str, np.ndarray]:
    """Channels at the times, by DOP853."""
    t = times(machine)
    series = {n: x for n, x in given.items() if np.ndim(x)}
    u = (lambda s: np.interp(s, t, next(iter(series.values())))) if series else None

    def dry(v: float) -> float:
        return p["dry"] * v / math.hypot(v, DRY[machine])

    def run(rates: Callable, y0: Sequence[float]) -> np.ndarray:
        return solve_ivp(rates, (0, t[-1]), y0, "DOP853", t, rtol=1e-10, atol=1e-12, max_step=0.01).y

    if machine == "pendulum":
        drag = lambda v: p["viscous"] * v + p["law"] * abs(v) * v + dry(v)  # noqa: E731
        y = run(lambda _, s: [s[1], -p["W"] * math.sin(s[0]) - drag(s[1])], [given["start"], 0.0])
        return {"angle": y[0]}
    if machine == "cart":
        y = run(lambda s, x: [x[1], (u(s) - p["k"] * x[0] - p["c"] * x[1] - p["law"] * x[0] ** 3 - dry(x[1])) / p["m"]],
                [0.0, 0.0])  # fmt: skip
        return {"x": y[0]}
    if machine == "drive":

        def rates(s: float, x: np.ndarray) -> list[float]:
            joint = p["k"] * (x[0] - x[2])
            drag = p["b"] * x[3] + p["law"] * abs(x[3]) * x[3] + dry(x[3])
            return [x[1], (u(s) - joint - 0.02 * x[1]) / J1, x[3], (joint - drag) / p["J2"]]

        y = run(rates, [0.0] * 4)
        return {"motor": y[0], "load": y[2]}
    return {"z": hops(p, given["height"], t)}


def hops(p: dict, height: float, t: np.ndarray) -> np.ndarray:
    """A mass on a leg without mass that pushes below z = 0; each change of contact located by scipy."""
    now, state, out = 0.0, np.array([height, 0.0]), np.empty(t.size)
    air = True
    while now < t[-1]:

        def rates(_: float, s: np.ndarray, air: bool = air) -> list[float]:
            leg = 0.0 if air else -p["k"] * s[0] - p["damping"] * s[1]
            return [
                s[1],
                -9.81 + (leg - p["law"] * abs(s[1]) * s[1] - p["dry"] * s[1] / math.hypot(s[1], DRY["hopper"])) / MASS,
            ]

        def change(_: float, s: np.ndarray) -> float:
            return s[0]

        change.terminal, change.direction = True, (-1.0 if air else 1.0)  # type: ignore[attr-defined]
        solved = solve_ivp(rates, (now, t[-1] + 1e-9), state, "DOP853", rtol=1e-10, atol=1e-12, events=change,
                           dense_output=True)  # fmt: skip
        here = (t >= now) & (t <= solved.t[-1])
        if here.any():
            out[here] = solved.sol(t[here])[0]
        now, state, air = solved.t[-1], solved.y[:, -1].copy(), not air
        if solved.status != 1:
            break
    return out


# ------------------------------------------------------------------------------------------------------------ the study
@njit(cache=True)
def _swings(n: int, dt: float, w: float, b: float, start: float) -> np.ndarray:
    out, x, v = np.empty(n), start, 0.0
    h = dt / 4
    for i in range(n):
        out[i] = x
        for _ in range(4):
            a1 = -w * np.sin(x) - b * v
            x2, v2 = x + 0.5 * h * v, v + 0.5 * h * a1
            a2 = -w * np.sin(x2) - b * v2
            x3, v3 = x + 0.5 * h * v2, v + 0.5 * h * a2
            a3 = -w * np.sin(x3) - b * v3
            x4, v4 = x + h * v3, v + h * a3
            a4 = -w * np.sin(x4) - b * v4
            x += h / 6 * (v + 2 * v2 + 2 * v3 + v4)
            v += h / 6 * (a1 + 2 * a2 + 2 * a3 + a4)
    return out


def stepped(rates: Callable, y0: Sequence[float], u: np.ndarray, dt: float, parts: int = 4) -> np.ndarray:
    """Runge-Kutta of a user's own script; u: straight between samples."""
    y, out, h = np.array(y0, float), [], dt / parts
    for i in range(u.size):
        out.append(y.copy())
        slope = (u[min(i + 1, u.size - 1)] - u[i]) / dt
        for k in range(parts):
            a, m, b = (u[i] + slope * (k + f) * h for f in (0.0, 0.5, 1.0))
            k1 = rates(y, a)
            k2 = rates(y + 0.5 * h * k1, m)
            k3 = rates(y + 0.5 * h * k2, m)
            y = y + h / 6 * (k1 + 2 * k2 + 2 * k3 + rates(y + h * k3, b))
    return np.array(out)


def friction(machine: str, most: float, scale: float) -> jv.Mechanism:
    """The one cause that every study lists."""
    law = f"-dry * v / sqrt(v * v + {DRY[machine]} * {DRY[machine]})"
    return jv.Mechanism("dry", [jv.Parameter("dry", 0.0, (0, most), scale=scale)], law=law)


def study(machine: str) -> jv.Study:
    """As a user writes it: one cause is listed, and where laws act."""
    channels = [jv.Channel(n, "m" if n in "xz" else "rad", noise=s) for n, s in NOISE[machine].items()]
    if machine == "pendulum":

        def swing(p: dict, r: jv.Recording, force: Callable[..., float]) -> np.ndarray:
            def rates(y: np.ndarray, _: float) -> np.ndarray:
                pull = force(x=y[0], v=y[1])
                return np.array([y[1], -p["W"] * math.sin(y[0]) - p["viscous"] * y[1] + pull])

            if force(x=0.3, v=1.0) == 0.0:
                return _swings(r.t.size, 0.02, p["W"], p["viscous"], r.inputs["start"])
            return stepped(rates, [r.inputs["start"], 0.0], np.zeros(r.t.size), 0.02)[:, 0]

        parameters = [jv.Parameter("W", 50.0, (30, 80), unit="1/s^2"), jv.Parameter("viscous", 0.3, (0, 3), unit="1/s")]
        listed = friction(machine, 5, 0.1)
        return jv.Study(swing, parameters, [listed], channels, symbols={"x": 0.5, "v": 3.0}, force=2.0)
    if machine == "cart":

        def cart(p: dict, r: jv.Recording, force: Callable[..., float]) -> np.ndarray:
            def rates(y: np.ndarray, u: float) -> np.ndarray:
                return np.array([y[1], (u - p["k"] * y[0] - p["c"] * y[1] + force(x=y[0], v=y[1])) / p["m"]])

            return stepped(rates, [0.0, 0.0], r.inputs["force"], 0.02, 2)[:, 0]

        parameters = [jv.Parameter("m", 1.3, sigma=0.01, unit="kg"), jv.Parameter("k", 90.0, (40, 200), unit="N/m"),
                      jv.Parameter("c", 1.0, (0, 5), unit="N s/m")]  # fmt: skip
        listed = friction(machine, 5, 0.1)
        return jv.Study(cart, parameters, [listed], channels, symbols={"x": 0.1, "v": 0.6}, force=2.0)
    if machine == "drive":

        def drive(p: dict, r: jv.Recording, force: Callable[..., float]) -> dict:
            def rates(y: np.ndarray, u: float) -> np.ndarray:
                joint = p["k"] * (y[0] - y[2])
                load = joint - p["b"] * y[3] + force(x=y[2], v=y[3])
                return np.array([y[1], (u - joint - 0.02 * y[1]) / J1, y[3], load / p["J2"]])

            y = stepped(rates, [0.0] * 4, r.inputs["torque"], 0.02, 3)
            return {"motor": y[:, 0], "load": y[:, 2]}

        parameters = [jv.Parameter("J2", 0.02, sigma=0.001, unit="kg m^2"),
                      jv.Parameter("k", 28.0, (10, 80), unit="N m/rad"),
                      jv.Parameter("b", 0.04, (0, 0.5), unit="N m s/rad")]  # fmt: skip
        listed = friction(machine, 0.5, 0.01)
        return jv.Study(drive, parameters, [listed], channels, symbols={"x": 1.0, "v": 5.0}, force=0.2)
    import mujoco

    model = mujoco.MjModel.from_xml_string(XML)

    def hopper(p: dict, r: jv.Recording, force: Callable[..., float]) -> np.ndarray:
        data, out = mujoco.MjData(model), np.empty(r.t.size)
        data.qpos[0] = r.inputs["height"]

        def leg(_: object, d: object) -> None:  # at every stage of a step
            z, v = d.qpos[0], d.qvel[0]
            d.qfrc_applied[0] = (-p["k"] * z - p["damping"] * v if z < 0 else 0.0) + force(x=z, v=v)

        mujoco.set_mjcb_control(leg)
        for i in range(r.t.size):
            out[i] = data.qpos[0]
            for _ in range(20):
                mujoco.mj_step(model, data)
        mujoco.set_mjcb_control(None)
        return out

    parameters = [
        jv.Parameter("k", 1800.0, (1000, 4000), unit="N/m"),
        jv.Parameter("damping", 8.0, (0, 40), unit="N s/m"),
    ]
    listed = friction(machine, 3, 0.05)
    return jv.Study(hopper, parameters, [listed], channels, symbols={"x": 0.3, "v": 2.0}, force=1.0)


# -------------------------------------------------------------------------------------------------------- the campaigns
@dataclass(frozen=True)
class World:
    """recordings: of `machine`; fault: of FAULTS; what: number, input or law; run: which stands apart."""

    machine: str
    fault: str
    recordings: tuple[jv.Recording, ...]
    what: str
    run: int


def shape(fault: str, run: int) -> np.ndarray:
    """How a number changes over the recordings, 1 where most."""
    if fault == "odd":
        return np.eye(RUNS)[run]
    return np.linspace(0.0, 1.0, RUNS) if fault == "drift" else np.ones(RUNS)


def detectable(machine: str, fault: str, what: str, run: int, given: Sequence[dict]) -> float:
    """The change whose non-centrality, beside what all recordings share, is POWER sigmas of chi^2; linear."""
    p, sigma = TRUE[machine], NOISE[machine]

    def white(q: dict, which: int) -> np.ndarray:
        return np.concatenate([y / sigma[n] for n, y in truth(machine, q, given[which]).items()])

    base = [white(p, i) for i in range(RUNS)]

    def change(name: str, step: float, scale: np.ndarray) -> np.ndarray:
        return (
            np.concatenate([scale[i] * (white({**p, name: p[name] + step}, i) - base[i]) for i in range(RUNS)]) / step
        )

    j = np.stack([change(n, 1e-4 * p[n], np.ones(RUNS)) for n in VARY[machine]], axis=1)
    effect = change(what, 1e-4 * p[what] or 1e-3 * LAW[machine], shape(fault, run))
    left = effect - j @ np.linalg.lstsq(j, effect, rcond=None)[0]
    return math.sqrt(POWER * math.sqrt(2.0 * left.size) / float(left @ left))


def world(number: int, seed: int) -> World:
    """Campaign `number`: the same whenever it is asked for."""
    rng = np.random.default_rng([seed, number])
    machine, fault = MACHINES[number % len(MACHINES)], FAULTS[number // len(MACHINES)]
    given = [inputs(machine, rng) for _ in range(RUNS)]
    run, factor, sign = int(rng.integers(RUNS)), float(np.exp(rng.uniform(0.0, math.log(8.0)))), rng.choice([-1.0, 1.0])
    p, scale, change = TRUE[machine], shape(fault, run), 0.0
    what = next(iter(given[0])) if fault == "unit" else fault
    if fault in ("odd", "drift"):
        what = str(rng.choice((VARY if fault == "odd" else DRIFT)[machine]))
        change = max(sign * factor * detectable(machine, fault, what, run, given), -0.6 * p[what])
    elif fault in ("law", "dry"):
        change = factor * detectable(machine, fault, what, run, given)
    out = []
    for i in range(RUNS):
        y = truth(machine, {**p, what: p[what] + change * scale[i]} if change else p, given[i])
        noisy = {n: x + NOISE[machine][n] * rng.standard_t(5, x.size) / math.sqrt(5 / 3) for n, x in y.items()}
        entered = dict(given[i])
        if fault == "unit" and i == run:
            entered[what] = entered[what] * UNITS[what]
        out.append(jv.Recording(f"run {i}", times(machine), noisy, entered, order=i))
    return World(machine, fault, tuple(out), what, run)
