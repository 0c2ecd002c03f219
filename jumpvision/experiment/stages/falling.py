"""Free flight beside gravity: the curvature of a track tells its scale and its frame rate."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import StageWarning
from jumpvision.estimate.estimate import Estimate
from jumpvision.estimate.flight import Flights, track_flights
from jumpvision.estimate.flight.segments import LIKE
from jumpvision.estimate.flight.track import TOLD
from jumpvision.estimate.mean import weighted_mean
from jumpvision.experiment.inputs.sections import Robot
from jumpvision.jumper.physics.oscillator import foot_frequency, foot_ripple

from .crosschecks import FEWEST, GAP, SHORTEST, Motion, lasting, swing_of
from .rod import hanging_foot

ENOUGH = 4e-3  # s between samples that tell a curvature
ENDS = 0.1  # of a flight, at both ends, in which spring and ground may act
SIGMAS = 6.0  # noise that is correlated by 0.5 makes 6 of them 3.5
SAME = 0.03  # of gravity, by which curvatures may differ: friction and air
OTHERS = (0.7, 0.8, 0.9, 1.1, 1.2, 1.3)  # of gravity, at which flights are looked for where few fall at it
MANY, ENOUGH_OF_IT = 0.2, 0.25  # of the time after the motor stops, in flight
SHARP = 0.01  # of gravity: an uncertainty of a curvature that outdoes that of flights found in the track


def falling(motion: Motion, robot: Robot, name: str, *, after: float, hard: bool) -> Iterator[StageWarning]:
    """The curvature of free flight beside gravity: scale, frame rate or tilt. after [s]: when the motor rests. A short
    one may be a swing."""
    foot, swing = hanging_foot(robot), swing_of(robot, hard=hard)
    good = np.isfinite(motion.t) & np.isfinite(motion.height) & (motion.t > after)
    if good.sum() < FEWEST or _at_gravity(motion, robot, after, swing):
        return
    every = max(1, round(ENOUGH / float(np.median(np.diff(motion.t[good])))))
    found = track_flights(
        motion.t[good][::every],
        motion.height[good][::every],
        None if motion.sigma is None else motion.sigma[good][::every],
        gravity=robot.gravity,
        gravity_sigma=robot.sigma.gravity,
        shortest=SHORTEST,
        max_gap=GAP,
        ripple=foot_ripple(*foot) if foot else 0.0,
    )
    for doubt in found.doubts:
        if doubt.kind == "scale" and np.nanmax(found.time, initial=0.0) > swing:
            yield StageWarning("scale", f"[{name}] {doubt}", name, doubt.values)


def _at_gravity(motion: Motion, robot: Robot, after: float, swing: float) -> bool:
    """Whether flights that are found to a sample, one longer than a swing [s], fall at gravity, so near that two sigmas
    off `track_flights` would not doubt it either: to fit where they end takes ten times as long."""
    late = motion.flights.only(motion.flights.lift_off > after)
    if not np.nanmax(late.time, initial=0.0) > swing:
        return False
    found, g = curvature(motion, late, hanging_foot(robot), after), robot.gravity
    return abs(found.value - g) + 2.0 * found.sigma < TOLD * LIKE * g


def falls_otherwise(motion: Motion, name: str, after: float) -> Iterator[StageWarning]:
    """A track that is hardly ever in flight at gravity, and much at another: a flight is found by its curvature. after
    [s]: when the motor rests."""
    late = replace(motion, height=np.where(motion.t > after, motion.height, math.nan))
    span = float(motion.t[-1]) - max(after, float(motion.t[0]))
    if np.isfinite(late.height).sum() < FEWEST or (own := lasting(late.flights)) > ENOUGH_OF_IT * span:
        return
    most, q = max((lasting(replace(late, gravity=q * motion.gravity).flights), q) for q in OTHERS)
    if most > max(MANY * span, 3.0 * own):
        yield StageWarning(
            "scale",
            f"[{name}] falls at about {q * motion.gravity:.2g} m/s^2 for {most:.3g} s, at {motion.gravity:.3g} for "
            f"{own:.3g} s: scale, frame rate or tilt",
            name,
            {"falls_m_s2": q * motion.gravity, "falls_s": most, "gravity_s": own},
        )


def flown(motion: Motion, said: Flights, robot: Robot, name: str, after: float) -> tuple[bool, list[StageWarning]]:
    """(whether the heights of the track, section `name`, fall at gravity in the flights that the contact log says, when
    the motor rests, `after` [s]; what to doubt where not). Nothing is known where neither."""
    found = curvature(motion, said, hanging_foot(robot), after)
    off = abs(found.value / robot.gravity - 1.0)
    sigma = found.sigma / robot.gravity
    if off < SAME and sigma < SHARP:
        return True, []
    if not off > max(SIGMAS * math.hypot(sigma, robot.sigma.gravity / robot.gravity), SAME):
        return False, []
    text = (
        f"[{name}] in {found.n} flights of the contact log the height is accelerated by {-found.value:.3g} ± "
        f"{found.sigma:.2g} m/s^2, not -{robot.gravity:.3g}: scale, frame rate or tilt, or the clock of [contact_log]?"
    )
    return False, [StageWarning("scale", text, name, {"seen_m_s2": found.value, "gravity_m_s2": robot.gravity})]


def curvature(motion: Motion, said: Flights, foot: tuple[float, float, float, float] | None, after: float) -> Estimate:
    """Acceleration downward [m/s^2] in the three longest flights after `after` [s]: a parabola, and the swing of a foot
    k, m_f, M, g."""
    rows: list[tuple[float, float]] = []
    for k in np.argsort(-np.nan_to_num(said.time)):
        up, down = said.lift_off[k], said.landing[k]
        if len(rows) == 3 or not (said.time[k] > SHORTEST and up > after):
            continue
        trim = ENDS * (down - up)
        inside = np.isfinite(motion.height) & (motion.t > up + trim) & (motion.t < down - trim)
        s, h = motion.t[inside] - 0.5 * (up + down), motion.height[inside]
        if s.size >= 10:
            rows.append(_parabola(s, h, 2.0 * math.pi * foot_frequency(*foot[:3]) if foot else None))
    if not rows:
        return Estimate(math.nan, math.nan, "m/s^2", 0, math.nan, "no flight")
    values, sigmas = np.array(rows).T
    return weighted_mean(values, sigmas, "m/s^2")


def _parabola(s: Array, h: Array, swing: float | None) -> tuple[float, float]:
    """(downward acceleration [m/s^2], its standard uncertainty) of heights h (n,) [m] at s [s]; swing [rad/s]."""
    columns = [np.ones(s.size), s, -0.5 * s * s]
    if swing is not None:
        columns += [np.cos(swing * s), np.sin(swing * s)]
    a = np.stack(columns, axis=1)
    p = np.linalg.lstsq(a, h, rcond=None)[0]
    variance = float(np.sum((h - a @ p) ** 2)) / max(s.size - a.shape[1], 1) * np.linalg.pinv(a.T @ a)[2, 2]
    return float(p[2]), math.sqrt(variance)
