"""Exact hard-ground jumps beside their peers, in one run: agreement, cost of a jump, maps of up to a million jumps.

    python benchmarks/hard.py [--sets 2000] [--side 1000] [--seed 1] [--repeats 5]

Peers: scipy's DOP853 with event location, and heyoka's Taylor integrator where it is installed (it finds every root of
its own polynomials, so it misses no contact either). Costs are CPU time, the least of the repeats, and ratios are of
the same run; the times themselves depend on the machine. All stop at the first landing of a free flight. A peer's arcs
are strung together in Python; heyoka's time within its integrator is given apart, the least a compiled loop around it
could take. Peers give contact times only; ours is a jump within a map: heights, peaks of force and power, and checks.
"""

from __future__ import annotations

import argparse
import functools
import math
import time
import tracemalloc
from collections.abc import Callable

import numpy as np
from numba import get_num_threads
from numpy.typing import NDArray
from scipy.integrate import solve_ivp

from jumpvision.jumper.physics.forcing import sinusoid
from jumpvision.jumper.physics.hard.jump import hard_jump, hard_map, hard_sweep

THESIS = {
    "motor_mass": 1.003,
    "rod_mass": 0.175,
    "stiffness": 5760.6,
    "damping": 1.368,
    "gravity": 0.276 * 9.81,
    "landing_loss": 0.0,
}
F0 = math.sqrt(5760.6 / 1.178) / (2 * math.pi)


Law = tuple[float, float, float, int]  # frequency, amplitude, phase, cycles
Robot = dict[str, float]
Peer = Callable[[Law, float, Robot, bool], NDArray]
Advance = Callable[[float, float, float, float, bool, bool], tuple[float, float, float, bool]]


def flights(law: Law, t_end: float, robot: Robot, once: bool, advance: Advance) -> NDArray:
    """Lift-off and landing times [s], shape (m, 2); advance(t, end, x, v, on, grounded) -> t, x, v, contact reached.

    once: stop where hard_map does, at the first landing of a flight that began after the forcing.
    """
    f, amplitude, phase, cycles = law
    q = robot["motor_mass"] / (robot["motor_mass"] + robot["rod_mass"])
    x, v, t, grounded = -robot["gravity"] * robot["motor_mass"] / (q * robot["stiffness"]), 0.0, 0.0, True
    events: list[float] = []
    for on, end in ((True, cycles / f), (False, t_end)):
        v -= q * amplitude * 2 * math.pi * f * math.cos(phase) * (1 if on else -1)
        while t < end:
            t, x, v, contact = advance(t, end, x, v, on, grounded)
            if contact:
                events.append(t)
                x, v, grounded = 0.0, (v if grounded else v * math.sqrt(1 - robot["landing_loss"])), not grounded
                if once and grounded and events[-2] >= cycles / f:
                    return np.array(events).reshape(-1, 2)
    return np.array(events + [math.nan] * (len(events) % 2)).reshape(-1, 2)


def scipy_jump(law: Law, t_end: float, robot: Robot, once: bool, rtol: float, stride: float) -> NDArray:
    """flights by DOP853; stride: longest step in periods, small enough not to step over a contact."""
    f, amplitude, phase, _ = law
    w, mass = 2 * math.pi * f, robot["motor_mass"] + robot["rod_mass"]
    q, k, c, g = robot["motor_mass"] / mass, robot["stiffness"] / mass, robot["damping"] / mass, robot["gravity"]
    step = stride / max(f, math.sqrt(k) / (2 * math.pi))

    def rate(t: float, s: NDArray, on: bool, grounded: bool) -> tuple[float, float]:
        a = -g + (q * amplitude * w * w * math.sin(w * t + phase) if on else 0.0)
        return s[1], a - (k * s[0] + c * s[1] if grounded else 0.0)

    def contact(t: float, s: NDArray, on: bool, grounded: bool) -> float:
        return float(s[0])

    def advance(t: float, end: float, x: float, v: float, on: bool, grounded: bool) -> tuple[float, float, float, bool]:
        contact.direction, contact.terminal = 1 if grounded else -1, True  # type: ignore[attr-defined]
        longest = step if on or grounded else math.inf
        sol = solve_ivp(
            rate,
            (t, end),
            (x, v),
            "DOP853",
            args=(on, grounded),
            events=contact,
            rtol=rtol,
            atol=rtol * 1e-3,
            max_step=longest,
        )
        return float(sol.t[-1]), float(sol.y[0, -1]), float(sol.y[1, -1]), sol.status == 1

    return flights(law, t_end, robot, once, advance)


def heyoka_jump(inside: list[float]) -> Peer:
    """flights by heyoka at its default tolerance, machine epsilon; its two systems are compiled once, here.

    inside: every call of the integrator appends its seconds; the rest of the cost of a jump is Python.
    """
    import heyoka as hy

    x, v = hy.make_vars("x", "v")
    k, c, g, push, w, phase = (hy.par[i] for i in range(6))
    air = -g + push * hy.sin(w * hy.time + phase)
    systems = {}
    for grounded, rate, way in (
        (True, air - k * x - c * v, hy.event_direction.positive),
        (False, air, hy.event_direction.negative),
    ):
        event = hy.t_event(x, direction=way)
        systems[grounded] = hy.taylor_adaptive([(x, v), (v, rate)], [-1.0, 0.0], pars=[1.0] * 6, t_events=[event])

    def jump(law: Law, t_end: float, robot: Robot, once: bool) -> NDArray:
        f, amplitude, phase, _ = law
        w, mass = 2 * math.pi * f, robot["motor_mass"] + robot["rod_mass"]
        constants = [robot["stiffness"] / mass, robot["damping"] / mass, robot["gravity"]]

        def advance(
            t: float, end: float, x: float, v: float, on: bool, grounded: bool
        ) -> tuple[float, float, float, bool]:
            ta = systems[grounded]
            ta.reset_cooldowns()
            # from x = 0 itself heyoka misses an event within its first step: start it on the right side of it
            ta.time, ta.state[:] = t, (x if x != 0.0 else (-1e-16 if grounded else 1e-16), v)
            ta.pars[:] = [*constants, robot["motor_mass"] / mass * amplitude * w * w if on else 0.0, w, phase]
            start = time.perf_counter()
            outcome = ta.propagate_until(end)[0]
            inside.append(time.perf_counter() - start)
            return ta.time, ta.state[0], ta.state[1], outcome != hy.taylor_outcome.time_limit

        return flights(law, t_end, robot, once, advance)

    return jump


def random_set(rng: np.random.Generator) -> tuple[Robot, Law]:
    """A robot and a law; a third of them slow, with many hops."""
    mass, share, f0, g = (
        10 ** rng.uniform(-1, 1.5),
        rng.uniform(0.05, 0.5),
        10 ** rng.uniform(0.3, 1.5),
        rng.uniform(1, 10),
    )
    k = mass * (2 * math.pi * f0) ** 2
    robot = {
        "motor_mass": mass * (1 - share),
        "rod_mass": mass * share,
        "stiffness": k,
        "damping": float(2 * rng.choice([0.0, 0.0083, 0.1, 0.6, 1.5]) * math.sqrt(k * mass)),
        "gravity": g,
        "landing_loss": float(rng.choice([0.0, 0.33])),
    }
    f = f0 * (rng.uniform(0.15, 0.4) if rng.random() < 1 / 3 else rng.uniform(0.4, 1.6))
    return robot, (f, mass * g / k / rng.uniform(0.03, 0.4), rng.uniform(0, 2 * math.pi), int(rng.integers(1, 4)))


def agreement(name: str, n: int, seed: int, peer: Peer) -> None:
    """Flights of n random jumps against a peer's."""
    rng, differ, hops, worst_t, worst_h = np.random.default_rng(seed), 0, 0, 0.0, 0.0
    for _ in range(n):
        robot, law = random_set(rng)
        t_end = law[3] / law[0] + 3 * math.sqrt(law[1] / robot["gravity"])
        jump = hard_jump(**robot, forcing=sinusoid(*law), t=None, t_end=t_end)
        ours, theirs = np.c_[jump.lift_off, jump.landing], peer(law, t_end, robot, False)
        if ours.shape != theirs.shape:
            differ += 1
            print(f"  {len(ours)} flights, {name} {len(theirs)}: {robot} {law}")
            continue
        hops = max(hops, len(ours))
        worst_t = max(worst_t, np.nanmax(np.abs(ours - theirs), initial=0.0))
        height = robot["gravity"] / 8 * np.abs(np.diff(ours) ** 2 - np.diff(theirs) ** 2)
        worst_h = max(worst_h, np.nanmax(height, initial=0.0))
    print(f"{n} random jumps against {name}, up to {hops} flights: {differ} with another number of flights, the others")
    print(f"agree to {worst_t:.1e} s in event times and {worst_h:.1e} m in flight heights")


def timed_map(side: int, repeats: int) -> tuple[list[float], list[float], float]:
    """Wall and CPU seconds of every repeat of a side x side map, and the greatest memory it holds [MB]."""
    f, phase = np.linspace(0.4, 1.8, side) * F0, np.linspace(0, 2 * np.pi, side)
    walls, cpus = [], []
    for _ in range(repeats):
        start, cpu = time.perf_counter(), time.process_time()
        hard_map(f, phase, amplitude=4e-3, cycles=1, **THESIS)
        walls.append(time.perf_counter() - start)
        cpus.append(time.process_time() - cpu)
    tracemalloc.start()
    hard_map(f, phase, amplitude=4e-3, cycles=1, **THESIS)
    peak = tracemalloc.get_traced_memory()[1] / 1e6
    tracemalloc.stop()
    return walls, cpus, peak


def peer_cost(laws: list[Law], peer: Peer, repeats: int) -> tuple[float, NDArray]:
    """CPU seconds a jump of the thesis' robot, the least of the repeats, and the flight heights [m]."""
    costs = []
    for _ in range(repeats):
        cpu, heights = time.process_time(), []
        for law in laws:
            both = peer(law, 1.2, THESIS, True)
            late = both[both[:, 1] > 1 / law[0]]
            heights.append(THESIS["gravity"] / 8 * np.max(np.diff(late), initial=0.0) ** 2)
        costs.append((time.process_time() - cpu) / len(laws))
    return min(costs), np.array(heights)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sets", type=int, default=2000)
    parser.add_argument("--side", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--repeats", type=int, default=5)
    args = parser.parse_args()

    start = time.perf_counter()
    hard_map([8.0], [1.0], amplitude=4e-3, cycles=1, **THESIS)
    hard_jump(**THESIS, forcing=sinusoid(8.0, 4e-3, 1.0), t=[0.0], t_end=1.0)
    print(
        f"First calls (compilation, or its cache): {time.perf_counter() - start:.1f} s; {get_num_threads()} threads.\n"
    )

    print("| map | wall [s]: least, median | CPU [s]: least, median | CPU a jump [us] | memory [MB] |")
    print("|---|---|---|---|---|")
    each = math.inf
    for side in sorted({max(args.side // 10, 1), max(args.side * 3 // 10, 1), args.side}):
        walls, cpus, peak = timed_map(side, args.repeats)
        each = min(cpus) / side**2
        print(f"| {side} x {side} | {min(walls):.3f}, {np.median(walls):.3f} ", end="")
        print(f"| {min(cpus):.3f}, {np.median(cpus):.3f} | {each * 1e6:.2f} | {peak:.1f} |")

    peers: dict[str, Peer] = {
        "scipy DOP853 rtol 1e-6": functools.partial(scipy_jump, rtol=1e-6, stride=math.inf),
        "scipy DOP853 rtol 1e-9": functools.partial(scipy_jump, rtol=1e-9, stride=math.inf),
    }
    inside: list[float] = []
    try:
        peers["heyoka"] = heyoka_jump(inside)
    except ImportError:
        print("\nheyoka is not installed: scipy only.")
    rng = np.random.default_rng(args.seed)
    laws = [(rng.uniform(0.4, 1.8) * F0, 4e-3, rng.uniform(0, 2 * math.pi), 1) for _ in range(200)]
    exact = hard_sweep(np.stack([sinusoid(*law).rows for law in laws]), **THESIS)["flight_height_m"]
    strict = functools.partial(scipy_jump, rtol=1e-12, stride=0.01)
    truth = peer_cost(laws, strict, 1)[1]  # nearest to the truth of what is not ours
    print("\n| solver | CPU a jump [us] | to ours | flight height off DOP853 at 1e-12 [m]: median, greatest |")
    print("|---|---|---|---|")
    off = np.abs(exact - truth)
    print(f"| jumpvision | {each * 1e6:.2f} | 1 | {np.median(off):.1e}, {np.max(off):.1e} |")
    for name, peer in peers.items():
        cost, heights = peer_cost(laws, peer, args.repeats)
        off = np.abs(heights - truth)
        print(f"| {name} | {cost * 1e6:.1f} | {cost / each:.0f} | {np.median(off):.1e}, {np.max(off):.1e} |")
        if name == "heyoka":
            inner = sum(inside) / (len(laws) * args.repeats)
            print(f"| heyoka, its integrator alone | {inner * 1e6:.1f} | {inner / each:.0f} | as above |")
    print()

    if "heyoka" in peers:
        agreement("heyoka", args.sets, args.seed, peers["heyoka"])
    # a hundredth of a period: with a tenth, DOP853 steps over contacts of milliseconds in 1 of 1000 of these jumps
    agreement("scipy DOP853 rtol 1e-12", args.sets // 10, args.seed, strict)


if __name__ == "__main__":
    main()
