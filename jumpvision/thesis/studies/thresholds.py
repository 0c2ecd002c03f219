"""What a jump needs: the least amplitude (thesis Fig 24), the time to lift off (Fig 26), the power of the motor."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from jumpvision.base.arrays import Array
from jumpvision.base.progress import watch
from jumpvision.jumper.physics.hard.analysis import (
    SINGLE,
    STUTTER,
    Search,
    crossing,
    easiest_frequency,
    inertial_peak,
    minimum_amplitude,
)
from jumpvision.jumper.physics.hard.jump import HardRobot, hard_sweep, sine_rows
from jumpvision.jumper.physics.hard.loop import LoopGains, easiest_looped
from jumpvision.jumper.physics.oscillator import damping_of

from .compute import RESULTS, Variable, dataset
from .study import Found, Row, Sweep, study

ENCODER_STEP = 6.25e-6  # m, docs/physics.md section 2
LARGEST = 0.02  # m, greatest amplitude tried
# near resonance A_min is flat: (f/f_0 - 1)^2 / (2 zeta^2) of itself, so 2e-11 m place f_100 to 2e-5
SEARCH = Search(0.5, 1.6, points=16, rounds=4)
FINE = {"largest": 2e-3, "resolution": 2e-11}  # m
CUTS = np.array([1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0])
STIFFNESSES = np.array([5e4, 1e5, 2e5])  # N/m, of loops that hold the motor
DAMPINGS = np.array([0.0083, 0.03, 0.06, 0.1, 0.15, 0.2])


PHASES = [0.0, 0.5 * np.pi, 0.75 * np.pi, np.pi]


@dataclass(frozen=True)
class LeastAmplitude:
    """Step of the amplitudes tried [m], and which jump the results are of."""

    resolution_m: float
    results: str


@study(
    "minimum-amplitude",
    "hard",
    source="Fig 24",
    ranges={"frequency": np.arange(3.0, 16.01, 0.125), "phase": PHASES, "cycles": [1.0, 5.0]},
)
def least_amplitude(s: Sweep) -> Found:
    """Least amplitude that lifts off, over frequency, phase and cycles, in both lift-off windows."""
    f, phase, cycles = (s.axis(n) for n in ("frequency", "phase", "cycles"))
    windows = ("end of the forcing", "one natural period later")
    least = np.stack(
        [
            [
                minimum_amplitude(
                    f, phase, robot=s.robot, cycles=n, wait=wait, largest=LARGEST, resolution=ENCODER_STEP
                ).T
                for wait in (0.0, 1.0 / s.robot.f0)
            ]
            for n in watch(cycles, "cycle numbers")
        ]
    )
    known = np.isfinite(least)
    jumps = hard_sweep(
        sine_rows(f, np.where(known, least + ENCODER_STEP, LARGEST), phase[:, None], cycles[:, None, None, None]),
        **s.robot._asdict(),
    )
    results = {n: np.where(known, v, np.nan) for n, v in jumps.items()}
    data = dataset(
        s,
        {"cycles": cycles, "window": list(windows), "phase": phase, "frequency": f},
        ("cycles", "window", "phase", "frequency"),
        results,
        {
            "minimum_amplitude_m": (
                ("cycles", "window", "phase", "frequency"),
                least,
                "m",
                "least amplitude that lifts off within the window, to half an encoder step",
            ),
            "frequency_ratio": (("frequency",), f / s.robot.f0, "1", "frequency / f_0"),
        },
        f0_Hz=s.robot.f0,
        facts=LeastAmplitude(ENCODER_STEP, results="of the jump one encoder step above the least amplitude"),
    )
    rows = []
    for n in cycles:
        for p in phase:
            found = [_fine_best(s, n, p, f, wait) for wait in (0.0, 1.0 / s.robot.f0)]
            thesis = "nearly 1" if n == 5 else "depends on the phase" if n == 1 else ""
            rk4 = "0.74, 1.19" if n == 1 and abs(p - 0.5 * np.pi) < 1e-6 else ""
            name = f"f_opt/f_0 of A_min, N = {n:g}, phase {p / np.pi:.3g} pi (both windows)"
            rows.append(s.number(name, ", ".join(f"{x:.3f}" for x in found), thesis, rk4))
    return data, rows


def _fine_best(s: Sweep, cycles: float, phase: float, f: np.ndarray, wait: float) -> float:
    """f/f_0 of the least A_min in the range of f, where the encoder's step would hide it."""
    fine = np.linspace(f[0], f[-1], 400)
    least = minimum_amplitude(fine, [phase], cycles=cycles, wait=wait, largest=LARGEST, resolution=1e-8, robot=s.robot)[
        :, 0
    ]
    return float(fine[np.nanargmin(least)] / s.robot.f0) if np.isfinite(least).any() else np.nan


@dataclass(frozen=True)
class LiftOffTime:
    """Greatest number of forcing cycles waited for."""

    cycles: float


@study(
    "lift-off-time",
    "hard",
    source="Fig 26",
    ranges={
        "frequency": lambda s: np.linspace(0.27, 1.51, 150) * s.robot.f0,
        "amplitude": np.geomspace(1e-5, 6e-3, 100),
        "phase": [0.5 * np.pi, 1.5 * np.pi],
    },
    values=("cycles",),
)
def lift_off_time(s: Sweep) -> Found:
    """Cycles to lift-off over (f, A), the easiest frequency f_N against the cut-off N, the motor's loop, and damping.

    The loop's stiffness kp lies in series with the spring: of STIFFNESSES, and the robot's own where --set motor.kp or
    an experiment gives it, each with the robot's kd.
    """
    f, amp, phase = (s.axis(n) for n in ("frequency", "amplitude", "phase"))
    most = float(s.values.get("cycles", 100.0))
    parts = [hard_sweep(sine_rows(f[:, None], amp, p, most), **s.robot._asdict()) for p in watch(phase, "phases")]
    results = {n: np.stack([p[n] for p in parts]) for n in RESULTS}
    cycles = results["lift_off_s"] * f[:, None]
    cycles = np.where(cycles <= most, cycles, np.nan)
    cuts = CUTS[most >= CUTS]
    at_cut = np.array(
        [
            [easiest_frequency(p, robot=s.robot, cycles=n, search=SEARCH, **FINE) for p in phase]
            for n in watch(cuts, "cut-offs N")
        ]
    )
    damped = np.array(
        [
            [
                easiest_frequency(
                    p,
                    robot=s.robot._replace(damping=float(damping_of(z, s.robot.stiffness, s.robot.mass))),
                    cycles=cuts[-1],
                    search=SEARCH,
                    **FINE,
                )[0]
                for p in phase
            ]
            for z in watch(DAMPINGS, "damping ratios")
        ]
    )
    loops = [LoopGains(float(kp), s.setup.values.get("kd", 0.0)) for kp in _stiffnesses(s)]
    looped = np.array(
        [
            [[easiest_looped(p, robot=s.robot, loop=x, cycles=n, search=SEARCH)[0] for p in phase] for n in cuts]
            for x in watch(loops, "stiffnesses of the loop")
        ]
    )
    extra = {
        "lift_off_cycles": (
            ("phase", "frequency", "amplitude"),
            cycles,
            "1",
            f"cycles until the first lift-off, NaN where {most:g} cycles do not do it",
        ),
        "frequency_ratio": (("frequency",), f / s.robot.f0, "1", "frequency / f_0"),
        "easiest_frequency_ratio": (("cut_off", "phase"), at_cut[..., 0], "1", "f_N / f_0"),
        "easiest_amplitude_m": (("cut_off", "phase"), at_cut[..., 1], "m", "least amplitude for N cycles"),
        "easiest_ratio_looped": (
            ("loop_stiffness", "cut_off", "phase"),
            looped,
            "1",
            "f_N / f_0 where the motor's loop, of stiffness kp, holds it",
        ),
        "easiest_ratio_damped": (("damping_ratio", "phase"), damped, "1", f"f_N / f_0 at N = {cuts[-1]:g}"),
        "inertial_peak_ratio": (("damping_ratio",), inertial_peak(DAMPINGS), "1", "1/sqrt(1 - 2 zeta^2)"),
    }
    data = dataset(
        s,
        {
            "phase": phase,
            "frequency": f,
            "amplitude": amp,
            "cut_off": cuts,
            "loop_stiffness": [x.kp for x in loops],
            "damping_ratio": DAMPINGS,
        },
        ("phase", "frequency", "amplitude"),
        results,
        extra,
        f0_Hz=s.robot.f0,
        facts=LiftOffTime(most),
    )
    rows: list[Row] = []
    for n in (1.0, 2.0, 5.0, 100.0):
        for k, p in enumerate(phase):
            if n in cuts:
                ours = f"{at_cut[list(cuts).index(n), k, 0]:.5f}"
                thesis = {100.0: "below 1 exp, 1 sim", 2.0: "1 down to about N = 2"}.get(n, "")
                rows.append(s.number(f"f_{n:g}/f_0, phase {p / np.pi:.3g} pi", ours, thesis))
    own = cuts[-1] == 100.0 and len(loops) == len(STIFFNESSES)
    rows.append(
        s.number(
            f"f_{cuts[-1]:g}/f_0 with the motor's loop, kp {', '.join(f'{x.kp:.3g}' for x in loops)} N/m",
            ", ".join(f"{x:.3f}" for x in looped[:, -1].mean(axis=1)),
            "below 1 exp",
            "0.960, 0.980, 0.990" if own else "",
        )
    )
    rows.append(
        s.number(
            f"least f_N/f_0 at N = {cuts[-1]:g} over zeta {DAMPINGS[0]:g} to {DAMPINGS[-1]:g}",
            f"{damped.min():.5f}",
            "damping suspected to lower it",
            "never below 1",
        )
    )
    return data, rows


def _stiffnesses(s: Sweep) -> Array:
    """Of the loops [N/m]; the thesis tells no gains of its robot's."""
    own = [] if s.setup.thesis or "kp" not in s.setup.values else [s.setup.values["kp"]]
    return np.unique(np.r_[STIFFNESSES, own])


@dataclass(frozen=True)
class Catapult:
    """What a spring gives that a catch holds pressed by `travel_m` below rest and lets go: its rise and its load."""

    travel_m: float
    height_m: float
    catch_force_N: float


def catapult(robot: HardRobot, travel: float) -> Catapult:
    """The motor loads the spring as slowly as it likes and stands still on the rod: x = -travel at rest, released.

    A damped oscillator until the spring is relaxed, then free flight; height_m: of the centre of mass above rest, NaN
    without a lift-off.
    """
    w, z = 2.0 * math.pi * robot.f0, robot.zeta
    turn, relaxed = w * math.sqrt(1.0 - z * z), robot.gravity / w**2

    def x(t: float) -> float:
        return -travel * math.exp(-z * w * t) * (math.cos(turn * t) + z * w / turn * math.sin(turn * t))

    height, top = math.nan, math.pi / turn
    if x(top) > relaxed:
        t = brentq(lambda t: x(t) - relaxed, 0.0, top, xtol=1e-12)
        v = travel * w * w / turn * math.exp(-z * w * t) * math.sin(turn * t)
        height = relaxed + v * v / (2.0 * robot.gravity)
    return Catapult(travel, height, robot.stiffness * (travel + relaxed))


PAIR = np.array([STUTTER, SINGLE])[:, None, None]
NEAR = np.geomspace(0.8, 1.25, 25)  # of an amplitude, where the next frequency of the grid has its own


def _peak(robot: HardRobot, f: Array, a: Array) -> Array:
    """Peak power of the motor [W] at frequencies f (jump, frequency, ...) and amplitudes a, broadcast."""
    phase = PAIR.reshape(2, *[1] * (f.ndim - 1))
    return hard_sweep(sine_rows(f, a, phase, 1.0), **robot._asdict())["peak_power_W"]


def best_limited(robot: HardRobot, f: Array, a: Array, power: Array) -> dict[str, Array]:
    """The highest jump at each power [W] over f (jump, frequency, power or 1) and amplitudes a (..., amplitude, rising)
    up to the last: RESULTS with frequency_Hz and amplitude_m, (jump, power), NaN where none lifts off."""
    needed = _peak(robot, f[..., None], a)
    # the amplitude that takes the whole power, between those of a: the best jump does, or has them all
    between = np.vectorize(np.interp, signature="(),(n),(n)->()")
    takes = np.exp(between(np.log(power), np.log(np.maximum.accumulate(needed, axis=-1)), np.log(a)))
    takes = np.minimum(takes, a[..., -1])
    # a kink between two amplitudes may pass the limit by 1e-4; power grows at least as the amplitude
    takes *= np.minimum(power / _peak(robot, f, takes), 1.0)
    found = hard_sweep(sine_rows(f, takes, PAIR, 1.0), **robot._asdict())  # (jump, frequency, power)
    found |= {"frequency_Hz": np.broadcast_to(f, takes.shape), "amplitude_m": takes}
    allowed = np.isfinite(found["lift_off_s"]) & (needed[..., 0] <= power)  # else the motor only pulls the rod up
    reach = np.where(allowed, found["com_height_m"], -1.0)
    best, none = np.argmax(reach, axis=1)[:, None], reach.max(axis=1) < 0.0
    return {n: np.where(none, np.nan, np.take_along_axis(v, best, 1)[:, 0]) for n, v in found.items()}


@study("power-limit", "hard", source="1.2.2, 2.5.2", values=("amplitude",))
def power_limit(s: Sweep) -> Found:
    """Best heights of stutter and squat (single) jumps under a limit of the motor's power, beside a catapult."""
    amplitude = float(s.setup.values["amplitude"])
    step, a = 0.005 * s.robot.f0, amplitude * np.geomspace(0.05, 1.0, 160)
    f = np.tile(np.arange(0.2 * s.robot.f0, 3.0 * s.robot.f0 + 0.5 * step, step)[:, None], (2, 1, 1))
    power = np.geomspace(0.01, 1.0, 100) * float(_peak(s.robot, f[..., None], a).max())
    coarse = best_limited(s.robot, f, a, power)
    # the limit and the full stroke meet between two frequencies of the grid: there a jump of either loses height
    none = np.isnan(coarse["frequency_Hz"])  # lifts off; nor does what is tried in its place
    about, most = np.where(none, s.robot.f0, coarse["frequency_Hz"]), np.where(none, a[0], coarse["amplitude_m"])
    f = about[:, None] + step * np.linspace(-1.0, 1.0, 41)[:, None]
    own = best_limited(s.robot, f, np.minimum(most[:, None, :, None] * NEAR, amplitude), power)
    extra: dict[str, Variable] = {
        "frequency_ratio": (
            ("jump", "power"),
            own["frequency_Hz"] / s.robot.f0,
            "1",
            "of the best jump's frequency to f_0",
        ),
        "amplitude_m": (
            ("jump", "power"),
            own["amplitude_m"],
            "m",
            "of the best jump",
        ),
    }
    shot = catapult(s.robot, 2.0 * amplitude)
    data = dataset(
        s,
        {"jump": ["stutter", "single"], "power": power},
        ("jump", "power"),
        {n: own[n] for n in RESULTS},
        extra,
        facts=shot,
    )
    stutter, single = own["com_height_m"]
    from_on = float(crossing(power, np.nan_to_num(stutter / single, nan=0.0), rising=True))
    most = own["peak_power_W"][:, -1]
    half = float(np.interp(0.5 * most[0], power, stutter - single))
    table = [
        s.number("power of the best stutter, single [W]", f"{most[0]:.2f}, {most[1]:.2f}"),
        s.number(
            "stutter the higher one from a limit of [W]",
            f"{from_on:.2f}" if np.isfinite(from_on) else "none",
            "preferable where power is limited",
        ),
        s.number("stutter - single at half the power of the best stutter [mm]", f"{1e3 * half:.1f}"),
        s.number(
            "best stutter, single; catapult of the same travel [mm]",
            f"{1e3 * stutter[-1]:.1f}, {1e3 * single[-1]:.1f}; {1e3 * shot.height_m:.1f}",
            "catapult and countermovement above the squat jump",
        ),
    ]
    return data, table
