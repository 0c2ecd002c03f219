"""What hard-ground jumps are compared with: alpha = M g/(k A), half cycles, least amplitudes, time to lift off."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import AnyArray, Array
from jumpvision.jumper.physics.oscillator import Numbers, amplitude_of, best_jump, damping_of, natural_frequency

from .jump import HardRobot, hard_sweep, sine_rows


def half_cycle_rows(
    frequency: ArrayLike, frequency2: ArrayLike, amplitude: ArrayLike, phase: ArrayLike, delay: ArrayLike
) -> Array:
    """Rows of a forcing.Segments, shape (..., 3, 6): half a cycle, a pause of `delay` seconds, half a cycle.

    frequency, frequency2 [Hz] of the first and second half, amplitude [m], phase [rad] at the start, delay >= 0 [s];
    the arguments broadcast. X_m = A [sin(angle) - sin(phase)], angle running over phase..phase + pi..phase + 2 pi; with
    cos(phase) != 0 and two frequencies the velocity steps between the halves. Without a pause the second half stands
    in two rows. ValueError for a bad argument.
    """
    sine_rows(frequency, amplitude, phase, 1.0)  # refuses what no law may hold
    f1, f2, amp, ph, wait = np.broadcast_arrays(
        *(np.asarray(v, float) for v in (frequency, frequency2, amplitude, phase, delay))
    )
    if not (np.isfinite(f2).all() and (f2 > 0.0).all()):
        raise ValueError(f"frequency2 = {f2[~(f2 > 0.0)].flat[:1]} must be a finite number > 0 Hz")
    if not (np.isfinite(wait).all() and (wait >= 0.0).all()):
        raise ValueError(f"delay = {wait[~(wait >= 0.0)].flat[:1]} must be a finite number >= 0 s")
    w1, w2, base, half = 2 * np.pi * f1, 2 * np.pi * f2, -amp * np.sin(ph), 0.5 / f1
    paused = wait > 0.0
    middle = np.where(paused, half + wait, half + 0.25 / f2)
    end = half + wait + 0.5 / f2
    zero = np.zeros(f1.shape)
    first = (zero, half, base, amp, w1, ph)
    pause = (
        half,
        middle,
        np.where(paused, base + amp * np.sin(ph + np.pi), base),
        np.where(paused, 0.0, amp),
        np.where(paused, 0.0, w2),
        np.where(paused, 0.0, ph + np.pi),
    )
    second = (middle, end, base, amp, w2, np.where(paused, ph + np.pi, ph + 1.5 * np.pi))
    return np.stack([np.stack(row, axis=-1) for row in (first, pause, second)], axis=-2)


STUTTER, SINGLE = 0.5 * np.pi, 1.5 * np.pi  # rad
KEY = "com_height_m"


class Search(NamedTuple):
    """Frequencies searched, lowest <= f/f_0 <= highest, on a grid of `points` and `rounds` finer ones (best_jump)."""

    lowest: float
    highest: float
    points: int
    rounds: int


def _swept(rows: Array, robot: HardRobot, rod_share: Numbers, zeta: Numbers) -> dict[str, AnyArray]:
    """hard_sweep of the robot with this share of its mass in the rod, and this damping ratio."""
    return hard_sweep(
        rows,
        motor_mass=robot.mass * (1.0 - np.asarray(rod_share)),
        rod_mass=robot.mass * np.asarray(rod_share),
        stiffness=robot.stiffness,
        damping=damping_of(zeta, robot.stiffness, robot.mass),
        gravity=robot.gravity,
        landing_loss=robot.landing_loss,
    )


def best_by_alpha(
    alpha: ArrayLike,
    phase: ArrayLike,
    rod_share: ArrayLike,
    zeta: ArrayLike,
    *,
    robot: HardRobot,
    search: Search,
    key: str = KEY,
) -> dict[str, AnyArray]:
    """The one-cycle jump of greatest `key` over the frequencies of the search.

    alpha, phase [rad], rod_share m_r/M and zeta broadcast to (...); the latter two in place of the robot's own, whose
    total mass is kept. Returns hard_sweep's results, frequency_ratio and amplitude_m, each (...).
    """
    mass, stiffness, gravity = robot.mass, robot.stiffness, robot.gravity
    a, ph, share, z = np.broadcast_arrays(*(np.asarray(v, float) for v in (alpha, phase, rod_share, zeta)))
    amp, f0 = amplitude_of(a, stiffness, mass, gravity), natural_frequency(stiffness, mass)

    def jumps(at: list[Array]) -> dict[str, AnyArray]:
        return _swept(sine_rows(at[0] * f0, amp[..., None], ph[..., None], 1.0), robot, share[..., None], z[..., None])

    shape = (*a.shape, 1)
    at, best = best_jump(
        jumps,
        np.full(shape, search.lowest),
        np.full(shape, search.highest),
        points=search.points,
        rounds=search.rounds,
        key=key,
    )
    return best | {"frequency_ratio": at[..., 0], "amplitude_m": amp}


def best_two_frequencies(
    alpha: ArrayLike, *, robot: HardRobot, search: Search, highest2: float, points2: int
) -> dict[str, AnyArray]:
    """The highest stutter jump (phase pi/2) whose two half cycles have frequencies of their own (thesis Fig 36).

    Arguments as in best_by_alpha, alpha (n,). The first frequency is searched as `search` says, for every second
    frequency of a search in highest/2..highest2 (in f_0) on grids of `points2`, equal in log: the height is a narrow
    ridge in the first and flat in the second, so one grid over both would miss it.
    Returns the results with frequency_ratio and frequency2_ratio, (n,).
    """
    a = np.asarray(alpha, float)
    mass, stiffness, gravity = robot.mass, robot.stiffness, robot.gravity
    amp, f0 = amplitude_of(a, stiffness, mass, gravity), natural_frequency(stiffness, mass)

    def of_second(at: list[Array]) -> dict[str, AnyArray]:
        second = np.exp(at[0])

        def of_first(at: list[Array]) -> dict[str, AnyArray]:
            rows = half_cycle_rows(at[0] * f0, second[..., None] * f0, amp[:, None, None], STUTTER, 0.0)
            return _swept(rows, robot, robot.rod_share, robot.zeta)

        shape = (*second.shape, 1)
        first, best = best_jump(
            of_first,
            np.full(shape, search.lowest),
            np.full(shape, search.highest),
            points=search.points,
            rounds=search.rounds,
            key=KEY,
        )
        return best | {"frequency_ratio": first[..., 0]}

    low, high = np.full((*a.shape, 1), np.log(0.5 * search.highest)), np.full((*a.shape, 1), np.log(highest2))
    at, best = best_jump(of_second, low, high, points=points2, rounds=search.rounds, key=KEY)
    return best | {"frequency2_ratio": np.exp(at[..., 0]), "amplitude_m": amp}


def crossing(alpha: ArrayLike, ratio: ArrayLike, *, rising: bool) -> Array:
    """The first alpha where ratio (..., n) passes 1 in the given direction, linear in log alpha; NaN where never.

    alpha: (n,), increasing, > 0.
    """
    x, y = np.log(np.asarray(alpha, float)), np.asarray(ratio, float) - 1.0
    if not rising:
        y = -y
    passes = (y[..., :-1] < 0.0) & (y[..., 1:] >= 0.0)
    i = np.argmax(passes, axis=-1)
    y0, y1 = (np.take_along_axis(v, i[..., None], axis=-1)[..., 0] for v in (y[..., :-1], y[..., 1:]))
    with np.errstate(divide="ignore", invalid="ignore"):
        at = np.exp(x[i] + (x[i + 1] - x[i]) * y0 / (y0 - y1))
    return np.where(passes.any(axis=-1), at, np.nan)


def animal_alpha(
    length: ArrayLike, *, mass: float, stiffness: float, gravity: float, amplitude: float, body: float
) -> Array:
    """Eq. (14): alpha of an animal of body length `length` [m], isometric to one of length `body` with these values.

    Mass as length^3, stiffness and stroke amplitude as length: alpha as length.
    """
    return mass * gravity / (stiffness * amplitude) * np.asarray(length, float) / body


def minimum_amplitude(
    frequencies: ArrayLike,
    phases: ArrayLike,
    *,
    robot: HardRobot,
    cycles: float,
    wait: float,
    largest: float,
    resolution: float,
) -> Array:
    """Least amplitude A [m] whose sinusoidal law lifts the settled robot off the ground, by bisection (thesis Fig 24).

    frequencies (nf,) [Hz], phases (np,) [rad].
    wait [s]: lift-off counts until the law's end plus this: 0, or one natural period.
    largest [m]: greatest amplitude tried. resolution [m]: width of the last bracket (encoder step: 6.25e-6).
    Returns (nf, np), the middle of the bracket, so right to resolution / 2; NaN where `largest` does not lift off.
    Until lift-off the flow is linear in A: there is one threshold. ValueError for a bad argument (see hard_sweep).
    """
    for name, value in (("largest", largest), ("resolution", resolution)):
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name} = {value} must be > 0 m")
    if not 0.0 <= wait < math.inf:
        raise ValueError(f"wait = {wait} must be >= 0 s")
    f, phase = np.broadcast_arrays(np.asarray(frequencies, float)[:, None], np.asarray(phases, float)[None, :])

    def lifts(amplitude: Array) -> NDArray[np.bool_]:
        jumps = hard_sweep(sine_rows(f, amplitude, phase, cycles), **robot._asdict())
        return np.asarray(jumps["lift_off_s"] <= cycles / f + wait)  # NaN, no lift-off, compares false

    low, high = np.zeros(f.shape), np.full(f.shape, largest)
    possible = lifts(high)
    for _ in range(max(0, math.ceil(math.log2(largest / resolution)))):
        middle = 0.5 * (low + high)
        up = lifts(middle)
        low, high = np.where(up, low, middle), np.where(up, middle, high)
    return np.where(possible, 0.5 * (low + high), np.nan)


def stutter_by_half_fall(alpha: ArrayLike) -> Array:
    """Eq. (8): r where the fall from 2 A takes half a cycle. alpha > 0."""
    return 0.5 * np.pi * np.sqrt(np.asarray(alpha, float))


def stutter_by_fall_and_push(alpha: ArrayLike) -> Array:
    """Eq. (10): r where the fall and half a natural period make one cycle. alpha > 0."""
    return 1.0 / (0.5 + 1.0 / (np.pi * np.sqrt(np.asarray(alpha, float))))


def stutter_by_three_parts(alpha: ArrayLike) -> Array:
    """Eq. (12): r where the time to the first lift-off, the fall and half a natural period make one cycle.

    The smaller root of a r^2 - b r + c = 0 in the form that stays regular where a = 0, at alpha = 4/(pi^2 + 2).
    NaN where there is no root; alpha > 0.
    """
    alpha = np.asarray(alpha, float)
    first = np.sqrt(alpha / 18.0)
    a, b, c = 0.25 - (2.0 - alpha) / (2.0 * alpha * np.pi**2), 1.0 - first, 1.0 + alpha / 16.0 - 2.0 * first
    disc = b * b - 4.0 * a * c
    return 2.0 * c / (b + np.sqrt(np.where(disc >= 0.0, disc, np.nan)))


def energy_after_one_cycle(ratio: ArrayLike) -> Array:
    """Eq. (13): r^4 / (1 - r^2)^2 (1 - cos(2 pi / r)), the energy (to a factor) that one grounded cycle leaves.

    Written without its removable singularity at r = 1; greatest at r = 1.194. ratio > 0.
    """
    r = np.asarray(ratio, float)
    return 2.0 * (np.pi * r * np.sinc(1.0 - 1.0 / r) / (1.0 + r)) ** 2


def easiest_frequency(
    phase: float,
    *,
    robot: HardRobot,
    cycles: float,
    search: Search,
    largest: float,
    resolution: float,
) -> tuple[float, float]:
    """f_N / f_0 and the amplitude [m] there: the least that lifts off within N = `cycles` cycles (no wait after them).

    phase [rad]; largest, resolution [m]: see minimum_amplitude. The resolution must be far below the differences of
    A_min that matter: near resonance A_min is flat.
    """

    def jumps(at: list[Array]) -> dict[str, AnyArray]:
        given = {"cycles": cycles, "wait": 0.0, "largest": largest, "resolution": resolution}
        return {"amplitude": -minimum_amplitude(at[0] * robot.f0, [phase], robot=robot, **given)[:, 0]}

    at, best = best_jump(
        jumps, [search.lowest], [search.highest], points=search.points, rounds=search.rounds, key="amplitude"
    )
    return float(at[0]), -float(best["amplitude"])


def inertial_peak(zeta: ArrayLike) -> Array:
    """f/f_0 where the steady response to inertial forcing is greatest: 1/sqrt(1 - 2 zeta^2), above f_0."""
    return 1.0 / np.sqrt(1.0 - 2.0 * np.asarray(zeta, float) ** 2)
