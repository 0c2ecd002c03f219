"""Any simulator in question: foreign simulators with hidden causes and nulls, the runs they take, a real servo axis.

`python -m benchmarks.any_simulator [CAMPAIGNS]`; the axis with JUMPVISION_REAL_DATA. Truth by scipy's DOP853.
"""

from __future__ import annotations

import importlib.util
import math
import sys
import time
from collections.abc import Callable, Sequence

import numpy as np
from numba import njit
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

import jumpvision as jv
from jumpvision.laboratory.dem import discs as jv_discs
from jumpvision.laboratory.dem import motion as dem

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

        at = np.maximum(t - hidden.get("angle_delay", 0.0), 0.0)  # it is let go at 0
        y = solve_ivp(rate, (0, 2), [start, 0.0], "DOP853", rtol=1e-9, atol=1e-11, max_step=5e-3, dense_output=True)
        y = y.sol(at)[0] * hidden.get("angle_scale", 1.0)
        out.append(jv.Recording(f"swing {i}", t, y + 1e-3 * rng.standard_normal(t.size), {"start": start}))
    return out


PENDULUM = ("viscous_friction", 0.05), ("quadratic_drag", 0.01), ("dry_friction", 0.1), ("hardening", 1.0)
PENDULUM += ("angle_scale", 1.01), ("angle_delay", 2e-3)


# -- a hopper in MuJoCo --
BODY = """<mujoco><option timestep="1e-3" integrator="RK4"/><worldbody><body><joint name="z" type="slide" axis="0 0 1"/>
<geom size="0.05" mass="1.0" contype="0" conaffinity="0"/></body></worldbody></mujoco>"""
DROP, EVERY = 0.5, 5e-3  # s: length of a recording, between samples


def hopper() -> jv.Study:
    """A mass on a leg that pushes while it is shorter than at rest; what is missing is asked of leg, air and guide.

    MuJoCo's own "Euler" is half a step late in free flight (2 mm after 0.8 s at 0.5 ms): Runge-Kutta it has to be.
    """
    import mujoco

    model = mujoco.MjModel.from_xml_string(BODY)

    def simulate(p: dict[str, float], r: jv.Recording) -> Array:
        data, out = mujoco.MjData(model), np.empty(r.t.size)
        data.qpos[0] = r.inputs["height"]
        for i in range(r.t.size):
            out[i] = data.qpos[0]
            for _ in range(5):
                v = data.qvel[0]
                z = data.qpos[0] + 0.5 * model.opt.timestep * v  # the force of the middle of the step: second order
                leg = -p["k"] * z - p["damping"] * v + p["stiffening"] * z * z if z < 0 else 0.0
                data.qfrc_applied[0] = leg - p["drag"] * abs(v) * v - p["guide"] * math.tanh(v / 0.01)
                mujoco.mj_step(model, data)
        return out

    return jv.Study(
        simulate,
        [jv.Parameter("k", 1800.0, (1000, 4000), unit="N/m")],
        [
            cause("leg_damping", "damping", (0, 50), 1.0, "N s/m"),
            cause("leg_stiffening", "stiffening", (-2e4, 2e4), 1e3, "N/m^2"),
            cause("air_drag", "drag", (0, 1), 0.02, "N s^2/m^2"),
            cause("guide_friction", "guide", (0, 3), 0.05, "N"),
        ],
        [jv.Channel("height", "m", noise=3e-4, consider=("scale",))],
    )


@njit
def fall(start: float, n: int, d: float, s: float, q: float, f: float) -> Array:
    """Height by Runge-Kutta's fourth order at 10 us."""
    h, steps, out = 1e-5, 500, np.empty(n)
    x = np.array([start, 0.0])
    k = np.zeros((4, 2))
    for i in range(n):
        out[i] = x[0]
        for _ in range(steps):
            for j in range(4):
                y = x + (0.0 if j == 0 else h if j == 3 else 0.5 * h) * k[j - 1]
                leg = -2000.0 * y[0] - d * y[1] + s * y[0] ** 2 if y[0] < 0 else 0.0
                k[j, 0] = y[1]
                k[j, 1] = leg - 9.81 - q * abs(y[1]) * y[1] - f * math.tanh(y[1] / 0.01)
            x = x + h / 6.0 * (k[0] + 2.0 * k[1] + 2.0 * k[2] + k[3])
    return out


def hops(hidden: dict[str, float], rng: np.random.Generator) -> list[jv.Recording]:
    """Five drops onto the leg."""
    what = [hidden.get(n, 0.0) for n in ("leg_damping", "leg_stiffening", "air_drag", "guide_friction")]
    t, out = EVERY * np.arange(round(DROP / EVERY)), []
    for i in range(5):
        start = 0.02 + 0.02 * i
        y = fall(start, t.size, *what) * hidden.get("height_scale", 1.0)
        out.append(jv.Recording(f"drop {i}", t, y + 3e-4 * rng.standard_normal(t.size), {"height": start}))
    return out


HOPPER = ("leg_damping", 1.0), ("leg_stiffening", 3000.0), ("air_drag", 0.05), ("guide_friction", 0.1)
HOPPER += (("height_scale", 1.01),)


# -- the discs of jumpvision.laboratory.dem under a foot --
R, M, ROWS = 2e-3, 1e-3, (3, 2, 3, 2, 3)  # m, kg; discs of a triangular packing from below
DEEP, RISE = 3e-4, 0.03  # m, s: the foot goes down so far in that time, then trembles


def packing() -> jv_discs.Discs:
    """Touching discs between two walls."""
    x, y = [], []
    for k, n in enumerate(ROWS):
        x += [2.0 * R * (i - 0.5 * (n - 1)) for i in range(n)]
        y += [R + math.sqrt(3.0) * R * k] * n
    return jv_discs.Discs.at_rest(x, y, R, density=M / (math.pi * R**2))


TOP = R * (2.0 + math.sqrt(3.0) * (len(ROWS) - 1))  # m, of the packing


def foot(t: Array, size: float, f: float) -> Array:
    """Height of the foot [m]."""
    down = np.clip(t / RISE, 0.0, 1.0)
    after = np.maximum(t - RISE, 0.0)
    return TOP - DEEP * down**3 * (10.0 - 15.0 * down + 6.0 * down**2) - size * np.sin(2 * np.pi * f * after) ** 3


def discs() -> jv.Study:
    """What is missing is asked of contacts, floor and tilt; two channels."""
    bed, box = packing(), jv_discs.Box(-3.0 * R, 3.0 * R, 0.0)

    def simulate(p: dict[str, float], r: jv.Recording) -> dict[str, Array]:
        law = jv_discs.Law(p["k"], p["damping"], p["drag"], p["carpet"], p["tilt"])
        fine = np.linspace(0.0, r.t[-1], 2000)
        path = foot(fine, r.inputs["size"], r.inputs["frequency"])
        plate = jv_discs.Plate(4.0 * R, R)
        m = dem.integrate(bed, law, box, times=r.t, dt=2e-5, foot=plate, foot_t=fine, foot_y=path)
        return {"force": np.nan_to_num(-m.foot_force[:, 1]), "height": m.y.mean(axis=1)}

    return jv.Study(
        simulate,
        [jv.Parameter("k", 800.0, (400, 2000), unit="N/m")],
        [
            cause("contact_damping", "damping", (0, 400), 5.0, "1/s"),
            cause("viscous_drag", "drag", (0, 100), 2.0, "1/s"),
            cause("carpet_friction", "carpet", (0, 5), 0.1, "m/s^2"),
            cause("tilt", "tilt", (-10, 10), 0.3, "m/s^2"),
        ],
        [jv.Channel("force", "N", noise=3e-3, consider=("scale",)), jv.Channel("height", "m", noise=2e-6)],
    )


@njit
def pressed(x: Array, v: Array, face: float, law: Array) -> tuple[Array, float]:
    """(accelerations, force of the foot) of linear contacts with dashpots, carpet and tilt."""
    k, gamma, viscous, carpet, tilt = law
    n, f, push = len(x), np.zeros_like(x), 0.0
    for i in range(n):
        for j in range(i):
            dx, dy = x[i, 0] - x[j, 0], x[i, 1] - x[j, 1]
            d = math.sqrt(dx * dx + dy * dy)
            if d < 2.0 * R:
                nx, ny = dx / d, dy / d
                closing = -((v[i, 0] - v[j, 0]) * nx + (v[i, 1] - v[j, 1]) * ny)
                size = k * (2.0 * R - d) + gamma * 0.5 * M * closing
                f[i, 0] += size * nx
                f[i, 1] += size * ny
                f[j, 0] -= size * nx
                f[j, 1] -= size * ny
        for side in (-1.0, 1.0):
            inside = side * x[i, 0] + R - 3.0 * R
            if inside > 0.0:
                f[i, 0] -= side * (k * inside + gamma * M * side * v[i, 0])
        if x[i, 1] < R:
            f[i, 1] += k * (R - x[i, 1]) - gamma * M * v[i, 1]
        if x[i, 1] + R > face:
            size = k * (x[i, 1] + R - face) + gamma * M * v[i, 1]
            f[i, 1] -= size
            push += size
        speed = math.sqrt(v[i, 0] ** 2 + v[i, 1] ** 2)
        rub = viscous + carpet / max(speed, CREEP)
        f[i, 0] -= M * rub * v[i, 0]
        f[i, 1] -= M * (rub * v[i, 1] + tilt)
    return f / M, push


CREEP = 1e-5  # m/s, below which dry friction falls in the truth


@njit
def trembled(x: Array, path: Array, speed: Array, every: int, h: float, law: Array) -> Array:
    """(samples, 2): mean force of the foot since the sample before, mean height; Runge-Kutta's fourth order.

    path, speed: of the foot at half steps. The dashpot of the foot's contact takes the foot's speed into account.
    """
    v, count = np.zeros_like(x), (len(path) - 1) // (2 * every)
    out, impulse = np.zeros((count + 1, 2)), 0.0
    out[0, 1] = x[:, 1].mean()
    for s in range(count * every):
        at = 2 * s
        a1, f1 = footed(x, v, path[at], speed[at], law)
        x2, v2 = x + 0.5 * h * v, v + 0.5 * h * a1
        a2, f2 = footed(x2, v2, path[at + 1], speed[at + 1], law)
        x3, v3 = x + 0.5 * h * v2, v + 0.5 * h * a2
        a3, f3 = footed(x3, v3, path[at + 1], speed[at + 1], law)
        x4, v4 = x + h * v3, v + h * a3
        a4, f4 = footed(x4, v4, path[at + 2], speed[at + 2], law)
        x, v = x + h / 6.0 * (v + 2.0 * v2 + 2.0 * v3 + v4), v + h / 6.0 * (a1 + 2.0 * a2 + 2.0 * a3 + a4)
        impulse += h / 6.0 * (f1 + 2.0 * f2 + 2.0 * f3 + f4)
        if (s + 1) % every == 0:
            out[(s + 1) // every, 0], out[(s + 1) // every, 1] = impulse / (every * h), x[:, 1].mean()
            impulse = 0.0
    return out


@njit
def footed(x: Array, v: Array, face: float, rising: float, law: Array) -> tuple[Array, float]:
    """`pressed` with the speed of the foot in its dashpots."""
    a, push = pressed(x, v, face, law)
    for i in range(len(x)):
        if x[i, 1] + R > face:
            a[i, 1] += law[1] * rising
            push -= law[1] * M * rising
    return a, push


def trembles(hidden: dict[str, float], rng: np.random.Generator) -> list[jv.Recording]:
    """Five ways of the foot; 2 ms between samples of 0.1 s."""
    names = ("contact_damping", "viscous_drag", "carpet_friction", "tilt")
    law = np.array([1000.0, *(hidden.get(n, 0.0) for n in names)])
    bed, every, h, out = packing(), 200, 1e-5, []
    t = every * h * np.arange(51)
    half = 0.5 * h * np.arange(2 * every * 50 + 1)
    for i in range(5):
        size, f = (5e-5, 1e-4)[i % 2], 15.0 + 10.0 * i
        path = foot(half, size, f)
        y = trembled(np.stack([bed.x, bed.y], axis=1), path, np.gradient(path, half), every, h, law)
        y[:, 0] *= hidden.get("force_scale", 1.0)
        y += np.array([3e-3, 2e-6]) * rng.standard_normal(y.shape)
        y[0, 0] = np.nan  # no force before the start
        out.append(jv.Recording(f"foot {i}", t, y, {"size": size, "frequency": f}))
    return out


DISCS = ("contact_damping", 5.0), ("viscous_drag", 2.0), ("carpet_friction", 0.1), ("tilt", 0.5), ("force_scale", 1.01)


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
    campaigns("Discs under a foot (5 recordings of 2 channels, 5 candidates)", discs(), trembles, DISCS, n)
    if importlib.util.find_spec("mujoco"):
        campaigns("MuJoCo hopper (5 recordings, 5 candidates)", hopper(), hops, HOPPER, n)
    else:
        print("\nMuJoCo is not installed: no hopper")


if __name__ == "__main__":
    main()
