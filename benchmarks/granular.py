"""The granular jumper beside scipy at equal accuracy, batches on one and two cores, and random jumps.

    python -m benchmarks.granular [--jumps 10000] [--sets 100000] [--laws 10] [--repeats 5] [--seed 1]

The peer is scipy.integrate.solve_ivp (DOP853 with terminal events) on the equations in x_r, v_r, x_f, v_f written out
plainly; its rtol is the loosest of a ladder whose error against a solution at 1e-12 does not exceed ours. Costs are
CPU time, the least of the repeats, in the same process; times depend on the machine, ratios less.
"""

from __future__ import annotations

import argparse
import dataclasses
import math
import time
from collections.abc import Callable

import numba
import numpy as np
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from jumpvision.base.threads import at_most
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.batch import jump_batch
from jumpvision.jumper.physics.energy import energy_ledger
from jumpvision.jumper.physics.forcing import Segments, sinusoid
from jumpvision.jumper.physics.hard.jump import sine_rows
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import equilibrium, simulate
from tests.worlds.sand import EVERYTHING, ROBOT, random_values

P = ModelParameters(k1=2100.0, k2=1500.0, delta=0.009, C=2.7, mu=2.0, b=17.2, alpha=73.0)
CONE = Model("granular", ("two_resistance", "depth_drag", "added_mass"), P, **ROBOT)
MODELS = {"cone": CONE, "alpha v^2": Model("granular", ("two_resistance", "inertial_drag"), P, **ROBOT)}
A, END = 0.01875, 1.0
AIR, REST, INTRUDE = range(3)
SLACK = 1e-8  # N beyond a threshold of force, so that a mode begins with an acceleration of definite sign


def scipy_track(model: Model, law: Segments, t: NDArray, rtol: float) -> NDArray:
    """Rod height at t (n,) by solve_ivp, mode by mode."""
    p, R, rho = model.parameters, ROBOT["foot_radius"], ROBOT["volume_fraction"] * ROBOT["grain_density"]
    M, m_f, k, c, g = model.M, model.m_f, model.k_s, model.c_s, model.g
    tan, ratio = math.tan(p.theta), model.m_m / model.M
    C, b = (p.C, p.b) if "added_mass" in model else (0.0, 0.0)
    alpha = p.alpha if "inertial_drag" in model else 0.0
    row = law.rows[0]

    def cone(z: float) -> tuple[float, float]:
        r = max(R - p.mu * z / tan, 0.0)
        return C * rho * math.pi * (R**3 - r**3) * tan / 3, C * rho * p.mu * math.pi * r * r

    def static(z: float) -> float:
        return p.k1 * min(z, p.delta) + p.k2 * max(z - p.delta, 0.0)

    def spring(s: NDArray) -> float:
        return -k * (s[0] - s[2]) - c * (s[1] - s[3])

    def rate(t: float, s: NDArray, mode: int, on: bool, deep: float) -> tuple[float, float, float, float]:
        push = -row[3] * row[4] ** 2 * math.sin(row[4] * (t - row[0]) + row[5]) if on else 0.0
        F = spring(s)
        a_r = -g + F / M - ratio * push
        if mode == AIR:
            return s[1], a_r, s[3], -g - F / m_f
        if mode == REST:
            return s[1], a_r, 0.0, 0.0
        m_a, slope = cone(-s[2])
        return s[1], a_r, s[3], (static(-s[2]) + (alpha + b * slope) * s[3] ** 2 - F - m_f * g) / (m_f + m_a)

    def landing(t: float, s: NDArray, mode: int, on: bool, deep: float) -> float:
        return float(s[2] + deep)

    def halt(t: float, s: NDArray, mode: int, on: bool, deep: float) -> float:
        return float(s[3])

    def lift(t: float, s: NDArray, mode: int, on: bool, deep: float) -> float:
        return spring(s) + m_f * g + SLACK

    def give(t: float, s: NDArray, mode: int, on: bool, deep: float) -> float:
        return static(deep) - spring(s) - m_f * g + SLACK

    for event, way in ((landing, -1), (halt, 1), (lift, -1), (give, -1)):
        event.terminal, event.direction = True, way  # type: ignore[attr-defined]
    watched = {AIR: [landing], REST: [lift, give], INTRUDE: [halt]}
    rod, foot = equilibrium(model)
    s, now, deep, mode = np.array([rod, 0.0, foot, 0.0]), float(t[0]), -foot, REST
    held = False  # on the ground after a hop too short to be resolved
    out = np.empty(t.size)
    for on, stop in ((True, law.stop), (False, float(t[-1]))):
        s[1] -= ratio * row[3] * row[4] * math.cos(row[5]) * (1 if on else -1)
        while now < stop:
            if mode == REST and not held:  # an impulse or the end of an intrusion may leave it pulled up or pushed down
                push = spring(s) + m_f * g
                mode = AIR if push < -SLACK else INTRUDE if push > static(deep) + SLACK else REST
            sol = solve_ivp(rate, (now, stop), s, "DOP853", dense_output=True, events=watched[mode],
                            args=(mode, on, deep), rtol=rtol, atol=1e-2 * rtol, max_step=5e-3)  # fmt: skip
            inside = (t >= now) & (t <= sol.t[-1])
            if inside.any():
                out[inside] = sol.sol(t[inside])[0]
            now, s = float(sol.t[-1]), sol.y[:, -1].copy()
            if sol.status != 1:
                continue
            held = mode == AIR and s[3] > -1e-9
            if held:
                s[2], s[3], mode = -deep, 0.0, REST
            elif mode == AIR:
                s[2], s[3], mode = -deep, s[3] * m_f / (m_f + cone(deep)[0]), INTRUDE
            elif mode == INTRUDE:
                deep, s[3], mode = -s[2], 0.0, REST
            else:
                mode = AIR if sol.t_events[0].size else INTRUDE
    return out


def cost(work: Callable[[], object], repeats: int) -> float:
    """CPU seconds of the best run."""
    best = math.inf
    for _ in range(repeats):
        began = time.process_time()
        work()
        best = min(best, time.process_time() - began)
    return best


def against_scipy(model: Model, count: int, repeats: int, seed: int) -> str:
    """A row: cost of ours with and without a track, error, the peer's at equal error, ratio."""
    rng = np.random.default_rng(seed)
    laws = [sinusoid(rng.uniform(5, 10), A, rng.choice([0.5, 1.5]) * math.pi) for _ in range(count)]
    t = np.linspace(0.0, END, 101)
    truth = [scipy_track(model, law, t, 1e-12) for law in laws]

    def error(tracks: list[NDArray]) -> float:
        return float(np.median([np.abs(a - b).max() for a, b in zip(tracks, truth)]))

    def ours(times: NDArray) -> list[NDArray]:
        return [simulate(model, law, t=times, rtol=1e-7, atol=1e-9).rod for law in laws]

    off = error(ours(t))
    single = cost(lambda: [ours(t[[0, -1]]) for _ in range(20)], repeats) / 20 / count
    rows = np.tile(np.stack([law.rows for law in laws]), (200, 1, 1))
    with at_most(1):
        batch = cost(lambda: jump_batch(model, rows, tail=0.8), repeats) / len(rows)
    for rtol in (1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-10):
        tracks: list[NDArray] = []
        peer = cost(lambda rtol=rtol, tracks=tracks: tracks.extend(scipy_track(model, x, t, rtol) for x in laws), 1)
        if error(tracks) <= off:
            break
    return (
        f"| {batch * 1e6:.0f} | {single * 1e6:.0f} | {off:.1e} | {peer / count * 1e6:.0f} (rtol {rtol:g}, error "
        f"{error(tracks):.1e}) | {peer / count / batch:.0f} | {peer / count / single:.0f} |"
    )


MORE = {"motor_lag": {"tau": 0.002}, "coulomb_friction": {"F_c": 0.2}, "viscous_friction": {"c_v": 0.2}}


def one_more(model: Model, count: int, repeats: int, seed: int) -> str:
    """Rows: cost of a jump in a batch with one term more of the rail or the motor, over that without."""
    rng = np.random.default_rng(seed)
    rows = np.stack([sinusoid(rng.uniform(5, 10), A, rng.choice([0.5, 1.5]) * math.pi).rows for _ in range(count)])
    out = []
    with at_most(1):
        plain = cost(lambda: jump_batch(model, rows, tail=0.8), repeats)
        for term, values in MORE.items():
            more = dataclasses.replace(
                model, terms=(*model.terms, term), parameters=dataclasses.replace(model.parameters, **values)
            )
            out.append(f"| {term} | {cost(lambda more=more: jump_batch(more, rows, tail=0.8), repeats) / plain:.2f} |")
    return "\n".join(out)


def random_jumps(model: Model, n: int, seed: int) -> dict[str, NDArray]:
    """jump_batch of random values and laws, heavy use of impulses, one to four cycles."""
    rng = np.random.default_rng(seed)
    laws = sine_rows(rng.uniform(2, 20, n), rng.uniform(1e-3, 0.03, n), rng.uniform(0, 2 * math.pi, n),
                     rng.integers(1, 5, n).astype(float))  # fmt: skip
    return jump_batch(model, laws, **random_values(rng, n))


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    for name, default in (("jumps", 10_000), ("sets", 100_000), ("laws", 10), ("repeats", 5), ("seed", 1)):
        parser.add_argument(f"--{name}", type=int, default=default)
    args = parser.parse_args()
    print("One jump of 1 s, five to six hops, rtol 1e-7, CPU time on one core.\n")
    print(
        "| model | ours in a batch [us] | by `simulate` [us] | error [m] | scipy DOP853 [us] | ratio | to `simulate` |"
    )
    print("|---|---|---|---|---|---|---|")
    for name, model in MODELS.items():
        print(f"| {name} {against_scipy(model, args.laws, args.repeats, args.seed)}", flush=True)
    print("\nA jump of the cone with one term more, over one without, in a batch.\n\n| term | ratio |\n|---|---|")
    print(one_more(CONE, 2000, args.repeats, args.seed), flush=True)
    rng = np.random.default_rng(args.seed)
    rows = sine_rows(rng.uniform(5, 10, args.jumps), A, 1.5 * math.pi, 1.0)
    print(f"\nA batch of {args.jumps} single jumps (cone, k1 varied), 0.6 s after the motor, wall time.\n")
    print("| threads | wall [s] | wall a jump [us] |\n|---|---|---|")
    values = {"k1": rng.uniform(1500, 2500, args.jumps)}
    for threads in sorted({1, numba.config.NUMBA_NUM_THREADS}):
        walls = []
        with at_most(threads):
            for _ in range(args.repeats):
                began = time.perf_counter()
                jump_batch(CONE, rows, **values)
                walls.append(time.perf_counter() - began)
        print(f"| {threads} | {min(walls):.2f} | {min(walls) / args.jumps * 1e6:.0f} |", flush=True)
    began = time.perf_counter()
    found = random_jumps(EVERYTHING, args.sets, args.seed)
    took = time.perf_counter() - began
    names, counts = np.unique(found["failure"], return_counts=True)
    said = ", ".join(f"{n or 'followed'}: {c}" for n, c in zip(names, counts))
    print(f"\n{args.sets} random parameter sets in {took:.0f} s: {said}.")
    ok = found["failure"] == ""
    print(f"All heights finite where followed: {bool(np.isfinite(found['com_height_m'][ok]).all())}.")
    worst = 0.0
    for frequency in np.linspace(5, 10, 20):
        books = energy_ledger(EVERYTHING, sinusoid(float(frequency), A, 0.3 + float(frequency)), end=0.8)
        worst = max(worst, abs(books.residual) / books.turnover)
    print(f"\nThe energy ledger of 20 jumps with all terms closes to {worst:.1e} of its turnover (rtol 1e-9).")


if __name__ == "__main__":
    main()
