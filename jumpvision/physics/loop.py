"""The motor's feedback loop: a command and a force that follows it, in place of a motor that is where its law says."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.physics.forcing import Segments, Spline

Array = NDArray[np.float64]

RANGE = 20001  # times at which the range of a command is looked for


@dataclass(frozen=True)
class Loop:
    """F_m = kp G (X_c - X_m) + kd (X_c' - X_m') + m_m g, within +-max_force [N].

    X_c is the command, X_m the encoder's reading (motor relative to the rod): the loop sees nothing of rod or ground.
    The feed-forward m_m g carries the motor's weight, so that the robot rests without a sag at X_m = X_c. G is
    dwell_gain while the command pauses between two motions, else 1; kd is not lowered. Motor and rod move as
    m_m (a_r + X_m'') = -m_m g + F_m and m_r a_r = -m_r g - F_m + F_s. A velocity step of the command is a step of the
    force here, not an impulse. At +-max_speed [m/s] the motor X_m' keeps its speed, and at an end of its travel of
    `stroke` [m] it is stopped without rebound, as long as the loop presses it on; both act between motor and rod. The
    ends lie evenly about the range of the command, the position at rest between them.
    """

    command: Segments | Spline
    kp: float  # N/m
    kd: float  # N s/m
    max_force: float = math.inf  # N
    dwell_gain: float = 1.0
    max_speed: float = math.inf  # m/s
    stroke: float = math.inf  # m

    def __post_init__(self) -> None:
        if not (0 < self.kp < math.inf and 0 <= self.kd < math.inf):
            raise ValueError(f"Loop kp = {self.kp!r}, kd = {self.kd!r}: need kp > 0 N/m and kd >= 0 N s/m, finite")
        if not (self.max_force > 0 and 0 <= self.dwell_gain <= 1):
            raise ValueError(
                f"Loop max_force = {self.max_force!r}, dwell_gain = {self.dwell_gain!r}: need max_force > 0 N and "
                "0 <= dwell_gain <= 1"
            )
        if not (self.max_speed > 0 and self.stroke > 0):
            raise ValueError(f"Loop max_speed = {self.max_speed!r}, stroke = {self.stroke!r}: both must be > 0")

    @property
    def start(self) -> float:
        return self.command.start

    @property
    def stop(self) -> float:
        return self.command.stop

    @functools.cached_property
    def ends(self) -> tuple[float, float]:
        """Ends of the travel of X_m [m]."""
        if math.isinf(self.stroke):
            return -math.inf, math.inf
        x = self.command(np.linspace(self.start, self.stop, RANGE))[0]
        rest = float(self.command(self.start - 1.0)[0][0])
        low = min(max(0.5 * float(x.min() + x.max() - self.stroke), rest - self.stroke), rest)
        return low, low + self.stroke

    def __call__(self, t: ArrayLike) -> tuple[Array, Array]:
        """X_c [m] and X_c' [m/s] at the times t [s], shape (n,)."""
        return self.command(t)

    def gains(self, rows: Array) -> Array:
        """G of the pieces (n, 6) of a sinusoidal command that ends at rest: dwell_gain where it pauses."""
        out = np.ones(len(rows))
        moves = np.flatnonzero(rows[:, 3] != 0.0)
        if isinstance(self.command, Segments) and moves.size:
            between = np.arange(moves[0], moves[-1])
            out[between[rows[between, 3] == 0.0]] = self.dwell_gain
        return out
