"""Analyses of the motion: the map (thesis Figs 27, 28), scatter, the driven hopper, power traces (Figs 29-31, 33)."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr

from jumpvision.base.progress import watch
from jumpvision.jumper.physics.energy import powers
from jumpvision.jumper.physics.forcing import sinusoid
from jumpvision.jumper.physics.hard.analysis import SINGLE, STUTTER
from jumpvision.jumper.physics.hard.hopper import PHASE, apexes, distinct, scattered
from jumpvision.jumper.physics.hard.jump import HardRobot, hard_jump, hard_map, hard_sweep, sine_rows
from jumpvision.jumper.physics.model import GROUNDS
from jumpvision.jumper.physics.oscillator import best_jump

from .compute import RESULTS, Variable, dataset, grid_results
from .study import Found, Row, Sweep, study

RINGING = 1e-5  # m: a third of the 30 um that the tracking of the thesis could see
TRIALS = 24
BOUNCE_LOSS = 0.33  # docs/physics.md section 2: restitution 0.8 for the whole bounce
DIFFERENT = 2e-5  # m, apexes nearer than this are one


GRID = {"frequency": (0.2, 1.8, 320), "phase": (0.0, 2.0 * np.pi, 241)}  # f_0 and rad: where no range is asked for
SLOW_GRID = {"frequency": (0.35, 1.5, 40), "phase": (0.0, 2.0 * np.pi, 25)}  # where a jump takes half a millisecond


@study("map", *GROUNDS, source="Figs 27, 28", any_axes=True)
def grid(s: Sweep) -> Found:
    """Jumps over any axes; frequency and phase where none is asked for, with the best jumps of both types."""
    if not s.ranges:
        usual = GRID if s.setup.exact else SLOW_GRID
        ranges = {n: np.linspace(*x) * (s.robot.f0 if n == "frequency" else 1.0) for n, x in usual.items()}
        s = dataclasses.replace(s, ranges={n: x for n, x in ranges.items() if n not in s.values})
    given = {**s.values, **s.ranges}
    results = grid_results(s.setup, given, workers=s.workers, say=s.say)
    data = dataset(s, given, tuple(s.ranges), results, f0_Hz=s.robot.f0)
    failed = int(np.isnan(results["com_height_m"]).sum())
    if failed:
        s.say(f"warning: {failed} of {data.com_height_m.size} motions could not be followed; they are NaN")
    law = s.setup.values
    whole = not s.values and law["cycles"] == 1 and not law["delay"] and set(s.ranges) == {"frequency", "phase"}
    return data, best_jumps(s) if s.setup.exact and whole else _best_point(s, data)


def _best_point(s: Sweep, data: xr.Dataset) -> list[Row]:
    """The highest jump of a grid, by its coordinates."""
    height = data.com_height_m
    if height.size < 2 or not bool(np.isfinite(height).any()):
        return (
            [s.number(n, f"{float(data[n]):.5g} {RESULTS[n][0]}".removesuffix(" 1")) for n in RESULTS]
            if height.size == 1
            else []
        )
    at = height.isel(height.argmax(...))
    where = ", ".join(f"{n} {float(at[n]):.4g}" for n in height.dims)
    return [s.number("greatest COM height", f"{float(at) * 1e3:.2f} mm at {where}")]


def best_jumps(s: Sweep) -> list[Row]:
    """The best stutter and single jump of the robot at its amplitude, against docs/physics.md section 7."""
    amp, f0, robot = s.setup.values["amplitude"], s.robot.f0, s.robot

    def at_phase(f: np.ndarray) -> dict[str, np.ndarray]:
        return hard_sweep(sine_rows(f, amp, np.array([[STUTTER], [SINGLE]]), 1.0), **robot._asdict())

    at, best = best_jump(
        lambda x: at_phase(x[0] * f0),
        np.full((2, 1), 0.3),
        np.full((2, 1), 2.5),
        points=400,
        rounds=2,
        key="com_height_m",
    )
    r, h = at[:, 0], best["com_height_m"]
    fine = np.linspace(0.3, 2.5, 4401)
    near = fine[at_phase(np.tile(fine * f0, (2, 1)))["com_height_m"][1] > 0.99 * h[1]]
    used = at_phase(np.array([[0.78], [1.4]]) * f0)  # the frequencies of the experiment
    power, speed, force = (best[k] for k in ("peak_power_W", "peak_motor_speed", "peak_force_N"))
    p78, v78 = used["peak_power_W"][:, 0], used["peak_motor_speed"][:, 0]
    return [
        s.number(
            "stutter (pi/2): best f/f_0",
            f"{r[0]:.4f} ({r[0] * f0:.2f} Hz)",
            "0.72 sim (7.98 Hz), 0.78 exp",
            "0.7375 (8.21 Hz)",
        ),
        s.number(
            "single (3 pi/2): best f/f_0, within 1 %",
            f"{r[1]:.3f}, {near[0]:.2f} to {near[-1]:.2f}",
            "1.4 exp (edge of the sweep)",
            "1.54, 1.39 to 1.71",
        ),
        s.number(
            "best COM heights: stutter, single [mm]",
            f"{h[0] * 1e3:.2f}, {h[1] * 1e3:.2f}",
            "about 35 (8.75 A)",
            "41.0, 38.1",
        ),
        s.number("the same as flight heights [mm]", ", ".join(f"{x * 1e3:.2f}" for x in best["flight_height_m"])),
        s.number(
            "single / stutter peak power, at the optima; at 1.4 and 0.78 f_0",
            f"{power[1] / power[0]:.3f}; {p78[1] / p78[0]:.3f}",
            "1.66",
            "1.52; 1.31",
        ),
        s.number(
            "single / stutter peak motor speed, likewise",
            f"{speed[1] / speed[0]:.3f}; {v78[1] / v78[0]:.3f}",
            "2.0",
            "2.09; 1.79",
        ),
        s.number("stutter / single peak force", f"{force[0] / force[1]:.3f}", "1.25", "1.33"),
    ]


@dataclass(frozen=True)
class Scatter:
    """What differs between trials: rms of the spring's ringing at the start [m]; how many trials a point."""

    ringing_m: float
    trials: int


@study(
    "scatter",
    "hard",
    source="text of Fig 27",
    ranges={"frequency": lambda s: np.linspace(0.2, 1.4, 121) * s.robot.f0, "phase": np.linspace(0.0, 2.0 * np.pi, 97)},
    values=("amplitude", "cycles", "alpha"),
)
def scatter(s: Sweep) -> Found:
    """Standard deviation of the heights over trials that start from a faintly ringing spring."""
    f, phase = s.axis("frequency"), s.axis("phase")
    law = {"amplitude": float(s.setup.values["amplitude"]), "cycles": float(s.setup.values["cycles"])}
    clean = hard_map(f, phase, **law, **s.robot._asdict())
    rng = np.random.default_rng(20140630)
    spread = {n: np.empty((f.size, phase.size)) for n in ("com_height_m", "flight_height_m", "jump_height_m")}
    changed = np.empty((f.size, phase.size))
    for lo in watch(range(0, f.size, 20), "frequencies, in twenties"):
        trials = scattered(f[lo : lo + 20], phase, ringing=RINGING, trials=TRIALS, rng=rng, robot=s.robot, **law)
        for n in spread:
            spread[n][lo : lo + 20] = trials[n].std(axis=2, ddof=1)
        changed[lo : lo + 20] = np.mean(trials["n_jumps"] != clean["n_jumps"][lo : lo + 20, :, None], axis=2)
    extra: dict[str, Variable] = {
        f"{n.removesuffix('_m')}_std_m": (("frequency", "phase"), v, "m", f"standard deviation of {n} over the trials")
        for n, v in spread.items()
    }
    extra["other_n_jumps"] = (("frequency", "phase"), changed, "1", "share of trials with another number of jumps")
    data = dataset(
        s,
        {"frequency": f, "phase": phase},
        ("frequency", "phase"),
        clean,
        extra,
        f0_Hz=s.robot.f0,
        facts=Scatter(RINGING, TRIALS),
    )
    std, height = spread["flight_height_m"], clean["flight_height_m"]
    rows = []
    for name, where, thesis in (
        ("above", f > 4.0, "below 0.5 mm, about 1 %"),
        ("below", f < 4.0, "larger at some phases"),
    ):
        if where.any():
            up = where[:, None] & (height > 1e-3)
            share = f"; {np.median(std[up] / height[up]):.2%} of h" if up.any() else ""
            ours = f"median {np.median(std[where]) * 1e3:.3f} mm{share}; largest {std[where].max() * 1e3:.2f} mm"
            rows.append(s.number(f"std of flight height {name} 4 Hz, ringing {RINGING * 1e6:g} um", ours, thesis))
    return data, rows


@dataclass(frozen=True)
class Bifurcation:
    """Amplitude of the drive [m], loss of momentum at landing, and which jump the results are of."""

    amplitude_m: float
    landing_loss: float
    results: str


@study(
    "bifurcation",
    "hard",
    source="section 2.4.1",
    ranges={
        "frequency": lambda s: np.linspace(0.4, 2.2, 361) * s.robot.f0,
        "amplitude": np.linspace(0.1e-3, 2.5e-3, 33),  # of the map; one value: of the curves
    },
)
def bifurcation(s: Sweep) -> Found:
    """Apex heights of the driven hopper's long-run motion, frequency going up and then down; a map over amplitude."""
    f = s.axis("frequency")
    # 1 mm: alpha 0.55 for the thesis' robot
    amp = float(s.values.get("amplitude", 1e-3))
    robot = s.robot._replace(landing_loss=s.robot.landing_loss or BOUNCE_LOSS)
    long, short = {"settle": 80, "keep": 40}, {"settle": 40, "keep": 60}
    apex, _ = (np.stack(x) for x in zip(*_both_ways(f, amp, long, robot)))
    amps = s.ranges.get("amplitude", s.usual("amplitude"))
    fewer = np.linspace(f[0], f[-1], min(f.size, 181))
    kinds = np.zeros((2, amps.size, fewer.size), np.int64)
    mean = np.zeros((2, amps.size, fewer.size))
    for i, a in enumerate(watch(amps, "amplitudes, up and down")):
        for j, (heights, count) in enumerate(_both_ways(fewer, float(a), short, robot)):
            kinds[j, i] = distinct(heights, tolerance=DIFFERENT)
            total = np.nansum(heights, axis=1)
            mean[j, i] = np.where(count > 0, total / np.maximum(count, 1), 0.0)
    jumps = hard_sweep(sine_rows(f, amp, PHASE, float(long["settle"] + long["keep"])), **robot._asdict())
    extra: dict[str, Variable] = {
        "apex_height_m": (("direction", "frequency", "hop"), apex, "m", "apex of the centre of mass above rest"),
        "distinct_apexes": (
            ("direction", "frequency"),
            np.stack([distinct(x, tolerance=DIFFERENT) for x in apex]),
            "1",
            "different apex heights in the long run",
        ),
        "map_distinct_apexes": (("direction", "map_amplitude", "map_frequency"), kinds, "1", "different apex heights"),
        "map_mean_apex_m": (("direction", "map_amplitude", "map_frequency"), mean, "m", "mean apex; 0 without hops"),
        "frequency_ratio": (("frequency",), f / s.robot.f0, "1", "frequency / f_0"),
    }
    data = dataset(
        s,
        {"frequency": f, "direction": ["up", "down"], "map_amplitude": amps, "map_frequency": fewer},
        ("frequency",),
        jumps,
        extra,
        f0_Hz=s.robot.f0,
        facts=Bifurcation(amp, landing_loss=robot.landing_loss, results="of the jump from rest"),
    )
    n = data.distinct_apexes.values
    hops = np.nan_to_num(np.nanmax(np.nan_to_num(apex, nan=-1.0), axis=2), nan=-1.0) > 0.0
    regular = (kinds <= 2).all(axis=0)
    apart = regular & (np.abs(mean[0] - mean[1]) > 0.1 * np.maximum(mean.max(axis=0), DIFFERENT * 10))
    rows = [
        s.number(
            f"share of f with 1, 2, 3-8, more apexes (A = {amp * 1e3:g} mm, e = {robot.landing_loss:g})",
            ", ".join(f"{np.mean((n >= lo) & (n <= hi)):.0%}" for lo, hi in ((1, 1), (2, 2), (3, 8), (9, 999))),
            "bifurcations, hysteresis, chaos",
        ),
        s.number(
            "hops begin at f/f_0 going up; end going down",
            ", ".join(f"{f[h][0] / s.robot.f0:.3f}" if h.any() else "none" for h in hops),
        ),
        s.number("share of the (f, A) map, both ways regular, that differs by > 10 %", f"{np.mean(apart):.0%}"),
    ]
    return data, rows


def _both_ways(f: np.ndarray, amp: float, cycles: dict[str, int], robot: HardRobot) -> tuple[Any, Any]:
    up = apexes(f, robot=robot, amplitude=amp, **cycles)
    down, count = apexes(f[::-1], robot=robot, amplitude=amp, **cycles)
    return up, (down[::-1], count[::-1])


def best_ratios(s: Sweep) -> list[float]:
    """f/f_0 of the best stutter and the best single jump, rounded as in the table of the map."""
    return [float(str(row["ours"]).split()[0].rstrip(",")) for row in best_jumps(s)[:2]]


@dataclass(frozen=True)
class Traces:
    """Amplitude of the laws [m]."""

    amplitude_m: float


@study(
    "traces",
    "hard",
    source="Figs 29, 30, 31, 33(a-d)",
    ranges={"frequency": lambda s: best_ratios(s)[0] * s.robot.f0, "phase": STUTTER},
    values=("amplitude", "alpha"),
)
def traces(s: Sweep) -> Found:
    """Position, velocity, force and the three powers of chosen jumps; impulses apart."""
    amp, f0 = float(s.setup.values["amplitude"]), s.robot.f0
    best = best_ratios(s)
    cases = [
        ("impulse, phase pi", 1.0, np.pi),
        ("slow stutter", 0.54, STUTTER),
        ("thesis' best stutter", 0.72, STUTTER),
        ("best stutter", best[0], STUTTER),
        ("fast stutter", 1.0, STUTTER),
        ("best single", best[1], SINGLE),
    ]
    if {"frequency", "phase"} & {*s.ranges, *s.values}:
        asked, phase = s.axis("frequency") / f0, s.axis("phase")
        cases = [(f"{r:.3g} f_0, {p / np.pi:.3g} pi", r, p) for r in asked for p in phase]
    ratio, phase = np.array([c[1] for c in cases]), np.array([c[2] for c in cases])
    results = hard_sweep(sine_rows(ratio * f0, amp, phase, 1.0), **s.robot._asdict())
    end = float(np.max(1.0 / (ratio * f0))) + 0.25  # s, shown after the slowest law
    t = np.linspace(0.0, end, 3001)
    columns: dict[str, list[np.ndarray]] = {}
    impulses = []
    for r, p in zip(ratio, phase):
        law = sinusoid(r * f0, amp, p)
        motion = hard_jump(**s.robot._asdict(), forcing=law, t=t, t_end=max(end, law.stop))
        found = powers(motion, law, motor_mass=s.robot.motor_mass, rod_mass=s.robot.rod_mass, gravity=s.robot.gravity)
        found |= {
            "rod_position": motion.rod,
            "motor_position": motion.motor,
            "relative_position": law(t)[0],
            "rod_velocity": motion.rod_velocity,
            "spring_force": motion.spring_force,
        }
        for n, v in found.items():
            columns.setdefault(n, []).append(v)
        impulses.append(motion.impulse_work_J)
    units = {"position": "m", "velocity": "m/s", "force": "N", "power": "W"}
    extra: dict[str, Variable] = {
        n: (("case", "time"), np.stack(v), units[n.rsplit("_", 1)[1]], n.replace("_", " ")) for n, v in columns.items()
    }
    extra["impulse_work_J"] = (("case", "edge"), np.array(impulses), "J", "work of the velocity steps of the law")
    data = dataset(
        s,
        {
            "case": [c[0] for c in cases],
            "case_frequency": ("case", ratio * f0),
            "case_phase": ("case", phase),
            "time": ("time", t),
            "edge": ["start", "end"],
        },
        ("case",),
        results,
        extra,
        f0_Hz=f0,
        facts=Traces(amp),
    )
    rows = [
        s.number(
            f"{c[0]} ({c[1]:.3f} f_0): COM height; peak internal, external, absolute power; impulses",
            f"{results['com_height_m'][i] * 1e3:.1f} mm; {results['peak_power_W'][i]:.2f}, "
            + ", ".join(
                f"{columns[n][i][t <= 1 / (c[1] * f0)].max():.2f}" for n in ("external_power", "absolute_power")
            )
            + f" W; {impulses[i][0]:.3f}, {impulses[i][1]:.3f} J",
        )
        for i, c in enumerate(cases)
    ]
    return data, rows
