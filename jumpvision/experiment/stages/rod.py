"""Rod: how the rod moved, from our track of the film or from a table tracked elsewhere."""

from __future__ import annotations

import math

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.base.schema import StageWarning
from jumpvision.estimate.estimate import independent
from jumpvision.estimate.height import at_rest
from jumpvision.estimate.mean import difference_noise
from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.parameters import SimulateParams
from jumpvision.experiment.inputs.sections import (
    Actuation,
    MotorLog,
    NotApplicable,
    Robot,
    RodTrack,
    lacking,
    need,
)
from jumpvision.experiment.results.tables import RodMotion, Track
from jumpvision.experiment.workflow.stage import stage
from jumpvision.jumper.physics.forcing import Forcing, delayed, first_motion, sinusoid

from .recordings import with_common
from .track import with_rest_zero


@stage(version=3, any_of=("track", "table"))
def rod(track: Track | None, table: RodTrack | None, actuation: Actuation | None) -> RodMotion:
    """Height of the rod [m] against time [s], zero at rest, from the track or [rod_track].

    The film's good frames where there is a film, else the table; at rest is before the motor starts.
    """
    if track is not None:
        if not track.good.empty and track.good.height_m.isna().all():
            raise NotApplicable(
                ["rod needs [rod_video] scale: the track is in px alone; give scale (metres per pixel)"]
            )
        kept = [c for c in track.table if c in RodMotion.columns + RodMotion.further]
        return RodMotion(track.good[kept].reset_index(drop=True))
    assert table is not None
    return RodMotion(with_common(with_rest_zero(from_table(table), actuation), table.scale_sigma))


def from_table(table: RodTrack) -> pd.DataFrame:
    """A track made elsewhere, sigma_m its noise, estimated from third differences where it is not given.

    A table of ours has sigma_common_m too, which its sigma_m holds.
    """
    d = read_log(table, "time_s", "height_m", optional=("sigma_m", "sigma_common_m"), at_least=8)
    height = d.height_m.to_numpy()
    sigma = d.sigma_m.to_numpy() if "sigma_m" in d else np.full(len(d), noise_of(height))
    if (sigma <= 0).any():
        i = int(np.flatnonzero(sigma <= 0)[0])
        raise ValueError(f"{table.path}: row {i + 1}, sigma_m = {sigma[i]:g}: must be above 0 m")
    motion = pd.DataFrame({"time_s": d.time_s, "height_m": height, "sigma_m": sigma})
    if "sigma_m" not in d or "sigma_common_m" not in d:
        return motion
    common = d.sigma_common_m.to_numpy()
    if (bad := np.flatnonzero((common < 0) | (common > sigma))).size:
        raise ValueError(
            f"{table.path}: row {bad[0] + 1}, sigma_common_m = {common[bad[0]]:g}: must be a part of sigma_m = "
            f"{sigma[bad[0]]:g}, in [0, sigma_m] m"
        )
    return motion.assign(sigma_m=independent(sigma, common), sigma_common_m=common)


def noise_of(height: NDArray[np.float64]) -> float:
    """Noise [m] of a track that states none: that of its third differences, at least that of its rounding."""
    steps = np.diff(np.unique(height))
    rounding = float(steps.min()) / np.sqrt(12.0) if steps.size else 0.0
    return max(difference_noise(height), rounding, np.finfo(float).tiny)


def needs_of_law(law: Actuation | None) -> list[str]:
    """What the command of a motor that moves is made of."""
    return lacking(law, "frequency", "amplitude") if law is not None and law.moves else []


def commanded(law: Actuation) -> Forcing:
    """The law of [actuation]."""
    frequency, amplitude = need(law, "frequency", "amplitude")
    if law.delay:
        return delayed(frequency, amplitude, law.start_phase, law.delay, law.start)
    return sinusoid(frequency, amplitude, law.start_phase, law.cycles, law.start)


def read_motor(log: MotorLog, law: Actuation | None) -> tuple[Array, Array]:
    """time [s] and X_m [m] of the encoder, zero at rest before the motor starts."""
    return motor_in(read_log(log, "time_s", "position_m", at_least=8), law)


def motor_in(d: pd.DataFrame, law: Actuation | None) -> tuple[Array, Array]:
    """The same of a log that has been read."""
    time, position = d.time_s.to_numpy(), d.position_m.to_numpy()
    before = at_rest(time, law.start) if law else np.arange(time.size) < 5
    return time, position - (np.median(position[before]) if before.any() else position[0])


def motor_runs(law: Actuation | None, log: MotorLog | None) -> tuple[float, float] | None:
    """When the motor starts and stops [s], by its law or else by its log; None where neither tells it."""
    if law is not None and law.moves:
        return law.start, law.stop
    if log is None or (law is not None and law.kind == "none"):
        return None
    (time, position), step = read_motor(log, law), SimulateParams().encoder_step
    return float(time[first_motion(position, step / math.sqrt(12.0))]), last_motion(time, position, step)


def last_motion(time: Array, position: Array, step: float) -> float:
    """When the motor comes to rest [s]: after it the log stays near its end, but for its loop's give."""
    end = np.median(position[time >= time[-1] - 0.1]) if time[-1] - time[0] > 0.2 else np.median(position[-5:])
    # a landing shakes a motor that its feedback loop holds by some 2 % of its travel
    near = max(2 * step, 0.02 * float(np.ptp(position)))
    moving = np.flatnonzero(np.abs(position - end) > near)
    return float(time[min(moving[-1] + 1, time.size - 1)]) if moving.size else float(time[0])


def position_at(t: Array, law: Actuation | None, log: MotorLog | None) -> Array | None:
    """X_m [m] at the times t (n,) [s], from the log where there is one, else from the law; None without both."""
    if log is not None:
        return np.interp(t, *read_motor(log, law))
    if law is not None and law.kind == "none":
        return np.zeros_like(t)
    if law is not None and law.moves:
        return commanded(law)(t)[0]
    return None


def total_mass(robot: Robot | None) -> float | None:
    """Mass of motor and rod [kg], where both are known."""
    return robot.motor_mass + robot.rod_mass if robot and robot.motor_mass and robot.rod_mass else None


def hanging_foot(robot: Robot | None) -> tuple[float, float, float, float] | None:
    """k, m_f, M, g of a robot with a foot, where they are known."""
    mass = total_mass(robot)
    if robot is None or mass is None or not (robot.foot_mass and robot.spring_stiffness):
        return None
    return robot.spring_stiffness, robot.foot_mass, mass, robot.gravity


OTHER_SPRING = 1.2  # ratio of frequencies that no foot, damping or hidden cause makes: a stiffness off by 1.44


def other_spring(frequency: float, k: float, mass: float) -> StageWarning | None:
    """What to doubt where a ring-down [Hz] is none of this spring [N/m] under this mass [kg]; None where it may be."""
    expected = math.sqrt(k / mass) / (2.0 * math.pi)
    if 1.0 / OTHER_SPRING < frequency / expected < OTHER_SPRING:
        return None
    return StageWarning(
        "differs",
        f"rings at {frequency:.3g} Hz, spring_stiffness = {k:g} N/m under {mass:g} kg at {expected:.3g} Hz: the spring "
        f"would have {mass * (2.0 * math.pi * frequency) ** 2:.4g} N/m; check units and masses",
        "robot",
        {"seen_hz": frequency, "declared_hz": expected},
    )
