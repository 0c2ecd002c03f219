"""Analyses against alpha = M g/(k A): thesis Figs 32, 33(e) and 36."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import AnyArray
from jumpvision.base.progress import watch
from jumpvision.jumper.physics.hard.analysis import (
    KEY,
    SINGLE,
    STUTTER,
    Search,
    best_by_alpha,
    best_two_frequencies,
    crossing,
    energy_after_one_cycle,
    minimum_amplitude,
    stutter_by_fall_and_push,
    stutter_by_half_fall,
    stutter_by_three_parts,
)
from jumpvision.jumper.physics.hard.jump import hard_sweep, sine_rows
from jumpvision.jumper.physics.oscillator import amplitude_of

from .compute import RESULTS, Variable, dataset
from .study import Found, Sweep, study

ALPHAS = np.geomspace(0.02, 1.5, 120)
SHARES = np.array([0.02, 0.05, 0.1, 0.149, 0.2, 0.25, 0.3, 0.35, 0.4])
DAMPINGS = np.array([0.0, 0.0083, 0.02, 0.04, 0.06, 0.08, 0.1, 0.11, 0.12, 0.13, 0.135, 0.14, 0.145, 0.15, 0.17, 0.2])
SEARCH = Search(0.15, 4.0, points=120, rounds=2)
PAIR = Search(0.1, 1.4, points=120, rounds=2)
TYPES = ("stutter", "single")


def _both(
    s: Sweep, alpha: ArrayLike, share: ArrayLike, zeta: ArrayLike, search: Search = SEARCH, key: str = KEY
) -> dict[str, AnyArray]:
    """best_by_alpha with the two jump types as first axis."""
    shape = np.broadcast_shapes(np.shape(alpha), np.shape(share), np.shape(zeta))
    phases = np.array([STUTTER, SINGLE]).reshape(2, *[1] * len(shape))
    return best_by_alpha(alpha, phases, share, zeta, robot=s.robot, search=search, key=key)


def _region(s: Sweep, alpha: ArrayLike, share: ArrayLike, zeta: ArrayLike) -> tuple[AnyArray, AnyArray]:
    """From and to which alpha the stutter jump is the higher one at the lower peak power; NaN where nowhere."""
    best = _both(s, alpha, share, zeta, SEARCH._replace(points=60))
    height, power = (best[k][0] / best[k][1] for k in ("com_height_m", "peak_power_W"))
    low, falls = crossing(alpha, height, rising=True), crossing(alpha, height, rising=False)
    high = np.fmin(crossing(alpha, power, rising=True), np.where(falls > low, falls, np.nan))
    return low, np.where(np.isfinite(low), high, np.nan)


def _scaled(best: dict[str, AnyArray], dims: tuple[str, ...]) -> dict[str, Variable]:
    return {
        "height_ratio": (dims, best["com_height_m"] / best["amplitude_m"], "1", "com_height / A"),
        "frequency_ratio": (dims, best["frequency_ratio"], "1", "best frequency / f_0"),
        "amplitude_m": (dims, best["amplitude_m"], "m", "A = M g/(k alpha)"),
    }


@dataclass(frozen=True)
class Alpha:
    """M g / (k A) of the robot with its own amplitude."""

    alpha_of_robot: float


@study("alpha", "hard", source="Fig 32", ranges={"alpha": ALPHAS}, values=("amplitude",))
def alpha(s: Sweep) -> Found:
    """Best height, frequency and power of both types; the ideal region of the stutter jump; the best phases."""
    a = s.axis("alpha")
    best = _both(s, a, s.robot.rod_share, s.robot.zeta)
    flight = _both(s, a, s.robot.rod_share, s.robot.zeta, key="flight_height_m")
    h = best["com_height_m"] / best["amplitude_m"]
    p = best["peak_power_W"]
    coarse = ALPHAS[::3]
    by_share = [_region(s, coarse, x, s.robot.zeta) for x in watch(SHARES, "rod masses")]
    by_zeta = [_region(s, coarse, s.robot.rod_share, z) for z in watch(DAMPINGS, "damping ratios")]
    few, phase, height, flights = _phases(s)
    extra = _scaled(best, ("jump", "alpha")) | {
        "power_scaled": (
            ("jump", "alpha"),
            p / (s.robot.stiffness * best["amplitude_m"] ** 2 * 2 * np.pi * s.robot.f0),
            "1",
            "peak power / (k A^2 w_0)",
        ),
        **{
            f"region_{end}_by_{name}": ((dim,), np.array([x[k] for x in found]), "1", words)
            for name, dim, found in (("rod", "rod_share", by_share), ("zeta", "damping_ratio", by_zeta))
            for k, (end, words) in enumerate(
                (
                    ("low", "stutter higher than single from this alpha"),
                    ("high", "and at lower peak power up to this alpha"),
                )
            )
        },
        "phase_height_ratio": (("some_alpha", "some_phase"), height, "1", "com_height / A, best over frequency"),
        "phase_n_jumps": (("some_alpha", "some_phase"), flights, "1", "n_jumps of those"),
    }
    data = dataset(
        s,
        {
            "jump": list(TYPES),
            "alpha": a,
            "rod_share": SHARES,
            "damping_ratio": DAMPINGS,
            "some_alpha": few,
            "some_phase": phase,
        },
        ("jump", "alpha"),
        best,
        extra,
        f0_Hz=s.robot.f0,
        facts=Alpha(s.robot.mass * s.robot.gravity / (s.robot.stiffness * s.setup.values["amplitude"])),
    )
    up, of_flight = crossing(a, h[0] / h[1], rising=True), flight["flight_height_m"]
    flights = crossing(a, of_flight[0] / of_flight[1], rising=True)
    power = crossing(a, p[0] / p[1], rising=True)
    efficient = crossing(a, h[0] / h[1] * p[1] / p[0], rising=False)
    high = _both(s, np.array([0.9]), s.robot.rod_share, s.robot.zeta)["frequency_ratio"][:, 0]
    beyond = _both(s, np.array([1.2]), s.robot.rod_share, s.robot.zeta)["frequency_ratio"][0, 0]
    rows = [
        s.number(
            "alpha where stutter height passes single (COM, flight time)",
            f"{up:.3f}, {flights:.3f}",
            "0.09",
            "0.12, 0.108",
        ),
        s.number("alpha where stutter power passes single", f"{power:.3f}", "0.28", "0.276"),
        s.number(
            "stutter height/power above single's",
            f"below alpha {efficient:.3f}",
            "at every alpha",
            "only below alpha 0.69",
        ),
        s.number(
            "f_opt/f_0 at alpha 0.9: stutter, single; stutter beyond",
            f"{high[0]:.3f}, {high[1]:.3f}; {beyond:.3f}",
            "about 1.2; 1.2",
            "1.18 and 1.20; 1.20",
        ),
    ]
    closed = [z for z, x in zip(DAMPINGS, by_zeta) if np.isnan(x[0])]
    rows.append(
        s.number(
            "damping ratio from where the stutter is nowhere the higher one",
            f"{closed[0]:g}" if closed else "none",
            "region narrows, then shifts down",
        )
    )
    for own, name in ((STUTTER, "pi/2"), (SINGLE, "3 pi/2")):
        k = int(np.argmin(np.abs(phase - own)))
        peak = (height[:, k] >= height[:, k - 1]) & (height[:, k] >= height[:, k + 1])
        off = ", ".join(f"{x:.3g}" for x in few[~peak])
        rows.append(
            s.number(
                f"height best over f has a maximum over phase at {name}",
                f"at {peak.sum()} of {few.size} alphas" + (f"; not at {off}" if off else ""),
                "at every alpha",
            )
        )
    return data, rows


def _phases(s: Sweep) -> tuple[AnyArray, AnyArray, AnyArray, AnyArray]:
    """alpha, phase [rad], and over both the greatest com_height / A over frequency and its number of flights."""
    few, phase = np.geomspace(ALPHAS[0], ALPHAS[-1], 18), np.linspace(0.0, 2.0 * np.pi, 121)
    f = np.linspace(0.15, 3.0, 360) * s.robot.f0
    height, flights = np.empty((few.size, phase.size)), np.empty((few.size, phase.size), np.int64)
    for i, x in enumerate(watch(few, "alphas over all phases")):
        amp = amplitude_of(x, s.robot.stiffness, s.robot.mass, s.robot.gravity)
        jumps = hard_sweep(sine_rows(f[:, None], amp, phase, 1.0), **s.robot._asdict())
        best = np.argmax(jumps["com_height_m"], axis=0)[None]
        height[i] = np.take_along_axis(jumps["com_height_m"], best, axis=0)[0] / amp
        flights[i] = np.take_along_axis(jumps["n_jumps"], best, axis=0)[0]
    return few, phase, height, flights


@study(
    "height-amplitude",
    "hard",
    source="Fig 32(a,b)",
    ranges={
        "frequency": lambda s: np.linspace(0.2, 3.0, 141) * s.robot.f0,
        "amplitude": np.linspace(2.5e-4, 8e-3, 120),
    },
)
def height_amplitude(s: Sweep) -> Found:
    """Height / A over frequency and amplitude of both types, the best frequency and the least amplitude to lift off."""
    f, amplitude = s.axis("frequency"), s.axis("amplitude")
    phase = np.array([STUTTER, SINGLE])
    rows_of = sine_rows(f[None, :, None], amplitude, phase[:, None, None], 1.0)
    found = hard_sweep(rows_of, **s.robot._asdict())
    ratio = found["com_height_m"] / amplitude
    best = f[np.argmax(found["com_height_m"], axis=1)]
    least = np.stack(
        [
            minimum_amplitude(
                f, [p], robot=s.robot, cycles=1.0, wait=1.0 / s.robot.f0, largest=amplitude[-1], resolution=1e-8
            )[:, 0]
            for p in phase
        ]
    )
    extra: dict[str, Variable] = {
        "height_ratio": (("jump", "frequency", "amplitude"), ratio, "1", "com_height / A"),
        "best_frequency_Hz": (("jump", "amplitude"), best, "Hz", "of the highest jump"),
        "minimum_amplitude_m": (
            ("jump", "frequency"),
            least,
            "m",
            "least amplitude that lifts off until one natural period after the forcing",
        ),
        "alpha": (("amplitude",), s.robot.mass * s.robot.gravity / (s.robot.stiffness * amplitude), "1", "M g/(k A)"),
    }
    data = dataset(
        s,
        {"jump": list(TYPES), "frequency": f, "amplitude": amplitude},
        ("jump", "frequency", "amplitude"),
        found,
        extra,
        f0_Hz=s.robot.f0,
    )
    i, j = (int(np.argmin(np.abs(amplitude - a))) for a in (s.setup.values["amplitude"], amplitude[-1]))
    rows = [
        s.number(
            f"{name}: best f/f_0 at A {1e3 * amplitude[i]:.2f} and {1e3 * amplitude[j]:.2f} mm; greatest height / A",
            f"{best[k, i] / s.robot.f0:.2f}, {best[k, j] / s.robot.f0:.2f}; {np.nanmax(ratio[k]):.1f}",
            "rises with A" if name == "single" else "",
        )
        for k, name in enumerate(TYPES)
    ]
    return data, rows


@study("estimates", "hard", source="Fig 33(e)", ranges={"alpha": ALPHAS})
def estimates(s: Sweep) -> Found:
    """The analytic estimates of the best stutter frequency against simulation without and with damping and rod."""
    a = s.axis("alpha")
    kinds = ("no damping, no rod", "this robot")
    best = best_by_alpha(
        a,
        STUTTER,
        np.array([[0.0], [s.robot.rod_share]]),
        np.array([[0.0], [s.robot.zeta]]),
        robot=s.robot,
        search=SEARCH,
    )
    ratio = np.linspace(0.6, 2.0, 140001)
    peak = float(ratio[np.argmax(energy_after_one_cycle(ratio))])
    found = {"8": stutter_by_half_fall(a), "10": stutter_by_fall_and_push(a), "12": stutter_by_three_parts(a)}
    extra: dict[str, Variable] = _scaled(best, ("kind", "alpha"))
    for n, v in found.items():
        extra[f"estimate_{n}"] = (("alpha",), v, "1", f"f_opt / f_0 of eq. ({n})")
    extra["estimate_13"] = ((), np.asarray(peak), "1", "f_opt / f_0 of eq. (13), for alpha >= 0.9")
    data = dataset(s, {"kind": list(kinds), "alpha": a}, ("kind", "alpha"), best, extra, f0_Hz=s.robot.f0)
    sim, low = best["frequency_ratio"][0], a < 0.9
    rows = [
        s.number(
            f"rms error of eq. ({n}) against simulation, alpha < 0.9",
            f"{np.sqrt(np.nanmean((v - sim)[low] ** 2)):.3f} f_0",
            {"8": "not accurate", "10": "more accurate", "12": "most accurate"}[n],
        )
        for n, v in found.items()
    ]
    rows.append(s.number("argmax of eq. (13)", f"{peak:.3f}", "1.2", "1.194"))
    if (~low).any():
        rows.append(
            s.number(
                "simulated f_opt/f_0, alpha >= 0.9 (no damping, no rod)",
                f"{sim[~low].min():.3f} to {sim[~low].max():.3f}",
                "1.2",
            )
        )
    return data, rows


@study("two-frequency", "hard", source="Fig 36", ranges={"alpha": np.geomspace(0.02, 1.5, 40)})
def two_frequency(s: Sweep) -> Found:
    """A stutter jump of two half cycles with frequencies of their own, beside the one-frequency jumps."""
    a = s.axis("alpha")
    best = [
        best_two_frequencies(a[i : i + 4], robot=s.robot, search=PAIR, highest2=40.0, points2=24)
        for i in watch(range(0, a.size, 4), "alphas, in fours")
    ]
    two = {n: np.concatenate([b[n] for b in best]) for n in best[0]}
    one = _both(s, a, s.robot.rod_share, s.robot.zeta)
    results = {n: np.concatenate([two[n][None], one[n]]) for n in (*RESULTS, "frequency_ratio", "amplitude_m")}
    second = np.concatenate([two["frequency2_ratio"][None], one["frequency_ratio"]])
    extra = _scaled(results, ("jump", "alpha")) | {
        "frequency2_ratio": (("jump", "alpha"), second, "1", "best frequency of the second half cycle / f_0"),
        "efficiency": (
            ("jump", "alpha"),
            s.robot.mass * s.robot.gravity * results["com_height_m"] * 2 * np.pi * s.robot.f0 / results["peak_power_W"],
            "1",
            "M g com_height w_0 / peak power",
        ),
    }
    data = dataset(
        s, {"jump": ["two frequencies", *TYPES], "alpha": a}, ("jump", "alpha"), results, extra, f0_Hz=s.robot.f0
    )
    h, p = results["com_height_m"], results["peak_power_W"]
    always = bool(np.all(h[0] >= h[1:].max(axis=0) * (1 - 1e-6)))
    joined = a[(np.abs(h[0] / h[1] - 1) < 0.01)]
    rows = [
        s.number("two frequencies jump higher than both others", "always" if always else "not always", "always"),
        s.number(
            "height over the better of the others, least alpha, at alpha 0.14",
            ", ".join(f"{np.interp(x, a, h[0] / h[1:].max(axis=0)):.2f}" for x in (a[0], 0.14)),
        ),
        s.number(
            "f_1 below the stutter's, f_2 above the single's",
            f"{np.mean(two['frequency_ratio'] < one['frequency_ratio'][0]):.0%}, "
            f"{np.mean(two['frequency2_ratio'] > one['frequency_ratio'][1]):.0%} of the alphas",
            "yes",
        ),
        s.number(
            "peak power over the greater of the others (least over alpha)",
            f"{np.min(p[0] / p[1:].max(axis=0)):.2f}",
            "above 1",
        ),
        s.number(
            "alpha from where it gains less than 1 % over the stutter",
            f"{joined[0]:.2f}" if joined.size else "none",
            "0.9",
        ),
    ]
    return data, rows
