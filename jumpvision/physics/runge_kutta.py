"""One step of the Dormand-Prince 5(4) pair with its dense output, for the jumper's equations of motion.

Dormand and Prince, J. Comput. Appl. Math. 6 (1980) 19; the fourth-order interpolant is Shampine's, Math. Comp. 46
(1986) 135.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit
from numpy.typing import NDArray

from jumpvision.physics.granular import N_STATE, VF, W, rhs

Array = NDArray[np.float64]

ORDER = 5
NODES = np.array([0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0])
STAGES = np.array(
    [
        [0, 0, 0, 0, 0, 0],
        [1 / 5, 0, 0, 0, 0, 0],
        [3 / 40, 9 / 40, 0, 0, 0, 0],
        [44 / 45, -56 / 15, 32 / 9, 0, 0, 0],
        [19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729, 0, 0],
        [9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656, 0],
        [35 / 384, 0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84],
    ]
)
ERROR = np.array([-71 / 57600, 0, 71 / 16695, -71 / 1920, 17253 / 339200, -22 / 525, 1 / 40])
DENSE = np.array(
    [
        [1, -8048581381 / 2820520608, 8663915743 / 2820520608, -12715105075 / 11282082432],
        [0, 0, 0, 0],
        [0, 131558114200 / 32700410799, -68118460800 / 10900136933, 87487479700 / 32700410799],
        [0, -1754552775 / 470086768, 14199869525 / 1410260304, -10690763975 / 1880347072],
        [0, 127303824393 / 49829197408, -318862633887 / 49829197408, 701980252875 / 199316789632],
        [0, -282668133 / 205662961, 2019193451 / 616988883, -1453857185 / 822651844],
        [0, 40617522 / 29380423, -110615467 / 29380423, 69997945 / 29380423],
    ]
)


@njit
def step(
    t: float,
    s: Array,
    h: float,
    mode: int,
    slip: int,
    memory: Array,
    kind: int,
    row: Array,
    p: Any,
    slopes: Array,
    s1: Array,
    rtol: float,
    atol: Array,
) -> float:
    """Writes s1 = s(t + h); returns the error over its tolerance (<= 1: accept).

    slopes: (7, N_STATE); slopes[0] = ds/dt at t on entry, the others are filled; slopes[6] = ds/dt at t + h.
    """
    for i in range(1, 7):
        for j in range(N_STATE):
            total = 0.0
            for m in range(i):
                total += STAGES[i, m] * slopes[m, j]
            s1[j] = s[j] + h * total
        rhs(t + NODES[i] * h, s1, mode, slip, memory, kind, row, p, slopes[i])
    worst = 0.0
    for j in range(N_STATE):
        total = 0.0
        for m in range(7):
            total += ERROR[m] * slopes[m, j]
        size = max(abs(s[j]), abs(s1[j]))
        error = abs(h * total) / (atol[j] + rtol * size)
        if not math.isfinite(error):
            return math.inf
        worst = max(worst, error)
    return worst


@njit
def dense(slopes: Array, h: float, q: Array) -> None:
    """Writes the coefficients q (N_STATE, 4) of s(t + theta h) = s + q[:, 0] theta + ... + q[:, 3] theta^4."""
    for j in range(N_STATE):
        for n in range(4):
            total = 0.0
            for m in range(7):
                total += slopes[m, j] * DENSE[m, n]
            q[j, n] = h * total


@njit
def between(s: Array, q: Array, theta: float, out: Array) -> None:
    """Writes the state at the share theta of the step that began at s."""
    for j in range(N_STATE):
        out[j] = s[j] + theta * (q[j, 0] + theta * (q[j, 1] + theta * (q[j, 2] + theta * q[j, 3])))


def tolerances(atol: float, rate: float) -> Array:
    """Absolute tolerance of each state: atol [m] for positions, atol times the spring's rate [1/s] for velocities."""
    out = np.full(N_STATE, atol)
    out[[W, VF]] *= rate
    return out
