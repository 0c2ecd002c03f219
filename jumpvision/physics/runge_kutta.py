"""One step of the Dormand-Prince 5(4) pair with its dense output, for the jumper's equations of motion.

Dormand and Prince, J. Comput. Appl. Math. 6 (1980) 19; the fourth-order interpolant is Shampine's, Math. Comp. 46
(1986) 135. At a tolerance of 1e-7 the eighth-order pair needs as many evaluations: strong drag limits the step, not
the order.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.physics.granular import rhs
from jumpvision.physics.kernel import kernel

Array = NDArray[np.float64]

ORDER = 5
N_SLOPES = 7
NODES = (0.0, 1 / 5, 3 / 10, 4 / 5, 8 / 9, 1.0, 1.0)
# one name a stage: constants that the compiler sees
A1 = (1 / 5,)
A2 = (3 / 40, 9 / 40)
A3 = (44 / 45, -56 / 15, 32 / 9)
A4 = (19372 / 6561, -25360 / 2187, 64448 / 6561, -212 / 729)
A5 = (9017 / 3168, -355 / 33, 46732 / 5247, 49 / 176, -5103 / 18656)
A6 = (35 / 384, 0.0, 500 / 1113, 125 / 192, -2187 / 6784, 11 / 84)
ERROR = (-71 / 57600, 0.0, 71 / 16695, -71 / 1920, 17253 / 339200, -22 / 525, 1 / 40)
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


@kernel
def step(
    t: float, s: Array, h: float, mode: int, slip: int, memory: Array, kind: int, row: Array, p: Any, k: Array,
    s1: Array, rtol: float, atol: Array,
) -> float:  # fmt: skip
    """Writes s1 = s(t + h); returns the error over its tolerance (<= 1: accept).

    k: (N_SLOPES, n); k[0] = ds/dt at t on entry, the others are filled; k[6] = ds/dt at t + h.
    """
    n = s.size
    for j in range(n):
        s1[j] = s[j] + h * A1[0] * k[0, j]
    rhs(t + NODES[1] * h, s1, mode, slip, memory, kind, row, p, k, 1)
    for j in range(n):
        s1[j] = s[j] + h * (A2[0] * k[0, j] + A2[1] * k[1, j])
    rhs(t + NODES[2] * h, s1, mode, slip, memory, kind, row, p, k, 2)
    for j in range(n):
        s1[j] = s[j] + h * (A3[0] * k[0, j] + A3[1] * k[1, j] + A3[2] * k[2, j])
    rhs(t + NODES[3] * h, s1, mode, slip, memory, kind, row, p, k, 3)
    for j in range(n):
        s1[j] = s[j] + h * (A4[0] * k[0, j] + A4[1] * k[1, j] + A4[2] * k[2, j] + A4[3] * k[3, j])
    rhs(t + NODES[4] * h, s1, mode, slip, memory, kind, row, p, k, 4)
    for j in range(n):
        s1[j] = s[j] + h * (A5[0] * k[0, j] + A5[1] * k[1, j] + A5[2] * k[2, j] + A5[3] * k[3, j] + A5[4] * k[4, j])
    rhs(t + NODES[5] * h, s1, mode, slip, memory, kind, row, p, k, 5)
    for j in range(n):
        s1[j] = s[j] + h * (A6[0] * k[0, j] + A6[2] * k[2, j] + A6[3] * k[3, j] + A6[4] * k[4, j] + A6[5] * k[5, j])
    rhs(t + NODES[6] * h, s1, mode, slip, memory, kind, row, p, k, 6)
    worst = 0.0
    for j in range(n):
        total = ERROR[0] * k[0, j] + ERROR[2] * k[2, j] + ERROR[3] * k[3, j]
        total += ERROR[4] * k[4, j] + ERROR[5] * k[5, j] + ERROR[6] * k[6, j]
        error = abs(h * total) / (atol[j] + rtol * max(abs(s[j]), abs(s1[j])))
        if not math.isfinite(error):
            return math.inf
        worst = max(worst, error)
    return worst


@kernel
def dense(k: Array, h: float, q: Array) -> None:
    """Writes the coefficients q (n, 4) of s(t + theta h) = s + q[:, 0] theta + ... + q[:, 3] theta^4."""
    for j in range(q.shape[0]):
        for n in range(4):
            total = 0.0
            for m in range(N_SLOPES):
                total += k[m, j] * DENSE[m, n]
            q[j, n] = h * total


@kernel
def between(s: Array, q: Array, theta: float, out: Array) -> None:
    """Writes the state at the share theta of the step that began at s."""
    for j in range(s.size):
        out[j] = s[j] + theta * (q[j, 0] + theta * (q[j, 1] + theta * (q[j, 2] + theta * q[j, 3])))


@kernel
def middle(s: Array, s1: Array, k: Array, h: float, out: Array) -> None:
    """Writes the state halfway from its values and slopes at both ends (cubic Hermite; third order, for signs)."""
    for j in range(s.size):
        out[j] = 0.5 * (s[j] + s1[j]) + 0.125 * h * (k[0, j] - k[N_SLOPES - 1, j])
