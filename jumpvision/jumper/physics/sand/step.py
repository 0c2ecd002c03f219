"""One step of the jumper: DOP853 with its dense output, or the closed form where the flow is linear.

Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, II.5 and II.6: order 8 with errors estimated at
third and fifth order, and a dense output of order 7 from three more stages.
"""

from __future__ import annotations

import math

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.jumper.physics.forcing import sincos

from .granular import (
    AIR,
    FLOOR,
    INTRUDE,
    N_ARC,
    SINE,
    VF,
    XF,
    W,
    Y,
    is_still,
    motors,
    rail_friction,
    rhs,
    settling,
    yield_force,
)
from .kernel import inlined, kernel
from .packed import Packed

ORDER = 8
N_SLOPES, END = 16, 12  # END: the slope at the end of a step; behind it what the dense output needs
N_DENSE = 7
# row by row: the stages, the weights, the errors of third and fifth order, the stages and weights of the dense output
NUMBERS = """
0.05260015195876773 0.0197250569845379 0.0591751709536137 0.02958758547680685 0 0.08876275643042054 0.2413651341592667
0 -0.8845494793282861 0.924834003261792 0.037037037037037035 0 0 0.17082860872947386 0.12546768756682242 0.037109375 0
0 0.17025221101954405 0.06021653898045596 -0.017578125 0.03709200011850479 0 0 0.17038392571223998 0.10726203044637328
-0.015319437748624402 0.008273789163814023 0.6241109587160757 0 0 -3.3608926294469414 -0.868219346841726
27.59209969944671 20.154067550477894 -43.48988418106996 0.47766253643826434 0 0 -2.4881146199716677 -0.590290826836843
21.230051448181193 15.279233632882423 -33.28821096898486 -0.020331201708508627 -0.9371424300859873 0 0
5.186372428844064 1.0914373489967295 -8.149787010746927 -18.52006565999696 22.739487099350505 2.4936055526796523
-3.0467644718982196 2.273310147516538 0 0 -10.53449546673725 -2.0008720582248625 -17.9589318631188 27.94888452941996
-2.8589982771350235 -8.87285693353063 12.360567175794303 0.6433927460157636
0.054293734116568765 0 0 0 0 4.450312892752409 1.8915178993145003 -5.801203960010585 0.3111643669578199
-0.1521609496625161 0.20136540080403034 0.04471061572777259
-0.18980075407240762 0 0 0 0 4.450312892752409 1.8915178993145003 -5.801203960010585 -0.4226823213237919
-0.1521609496625161 0.20136540080403034 0.02265179219836082 0
0.01312004499419488 0 0 0 0 -1.2251564463762044 -0.4957589496572502 1.6643771824549864 -0.35032884874997366
0.3341791187130175 0.08192320648511571 -0.022355307863886294 0
0.056167502283047954 0 0 0 0 0 0.25350021021662483 -0.2462390374708025 -0.12419142326381637 0.15329179827876568
0.00820105229563469 0.007567897660545699 -0.008298 0.03183464816350214 0 0 0 0 0.028300909672366776
0.053541988307438566 -0.05492374857139099 0 0 -0.00010834732869724932 0.0003825710908356584 -0.00034046500868740456
0.1413124436746325 -0.42889630158379194 0 0 0 0 -4.697621415361164 7.683421196062599 4.06898981839711
0.3567271874552811 0 0 0 -0.0013990241651590145 2.9475147891527724 -9.15095847217987
-8.428938276109013 0 0 0 0 0.5667149535193777 -3.0689499459498917 2.38466765651207 2.117034582445028
-0.871391583777973 2.2404374302607883 0.6315787787694688 -0.08899033645133331 18.148505520854727 -9.194632392478356
-4.436036387594894 10.427508642579134 0 0 0 0 242.28349177525817 165.20045171727028 -374.5467547226902
-22.113666853125306 7.733432668472264 -30.674084731089398 -9.332130526430229 15.697238121770845 -31.139403219565178
-9.35292435884448 35.81684148639408 19.985053242002433 0 0 0 0 -387.0373087493518 -189.17813819516758
527.8081592054236 -11.57390253995963 6.8812326946963 -1.0006050966910838 0.7777137798053443 -2.778205752353508
-60.19669523126412 84.32040550667716 11.99229113618279 -25.69393346270375 0 0 0 0 -154.18974869023643
-231.5293791760455 357.6391179106141 93.40532418362432 -37.45832313645163 104.0996495089623 29.8402934266605
-43.53345659001114 96.32455395918828 -39.17726167561544 -149.72683625798564
"""
FIFTH, THIRD, DENSE = N_SLOPES, N_SLOPES + 1, N_SLOPES + 2  # rows of WEIGHTS behind those of the stages
WEIGHTS = np.zeros((DENSE + N_DENSE - 3, N_SLOPES))
_numbers, _at = np.array(NUMBERS.split(), float), 0
for _row, _n in [*((i, i) for i in range(1, END + 1)), (THIRD, 13), (FIFTH, 13), (13, 13), (14, 14), (15, 15)]:
    WEIGHTS[_row, :_n], _at = _numbers[_at : _at + _n], _at + _n
WEIGHTS[DENSE:] = _numbers[_at:].reshape(-1, N_SLOPES)
NODES = WEIGHTS[:N_SLOPES].sum(axis=1)
FIRST = np.array([np.flatnonzero(w[1:]).min(initial=N_SLOPES) + 1 for w in WEIGHTS])  # non-zero behind the first slope
LAST = np.array([np.flatnonzero(w).max(initial=0) + 1 for w in WEIGHTS])


@kernel
def combine(row: int, h: float, k: Array, out: Array) -> None:
    """Write h sum_m WEIGHTS[row, m] k[m] to out (n,); weights between the first and FIRST are zero."""
    for j in range(out.size):
        out[j] = h * WEIGHTS[row, 0] * k[0, j]
    for m in range(FIRST[row], LAST[row]):
        w = h * WEIGHTS[row, m]
        for j in range(out.size):
            out[j] += w * k[m, j]


@kernel
def step(
    t: float,
    s: Array,
    h: float,
    mode: int,
    slip: int,
    p: Packed,
    k: Array,
    s1: Array,
    rtol: float,
    atol: Array,
) -> float:
    """Writes s1 = s(t + h); returns the error over its tolerance (<= 1: accept).

    k: (N_SLOPES, n); k[0] = ds/dt at t on entry, those up to END are filled; k[END] = ds/dt at t + h.
    """
    motors(t, h, NODES, p)
    for i in range(1, END + 1):
        combine(i, h, k, s1)
        for j in range(s.size):
            s1[j] += s[j]
        rhs(t + NODES[i] * h, s1, mode, slip, p, k, i)
    five, three = k[END + 1], k[END + 2]  # of the dense output, and free
    combine(FIFTH, h, k, five)
    combine(THIRD, h, k, three)
    fifth, third = 0.0, 0.0
    for j in range(s.size):
        most = 1.0 / (atol[j] + rtol * max(abs(s[j]), abs(s1[j])))
        fifth, third = max(fifth, abs(five[j]) * most), max(third, abs(three[j]) * most)
        if not math.isfinite(five[j]):
            return math.inf
    return fifth * fifth / math.sqrt(fifth * fifth + 0.01 * third * third) if fifth > 0.0 else 0.0


@kernel
def dense(
    t: float,
    s: Array,
    h: float,
    mode: int,
    slip: int,
    p: Packed,
    k: Array,
    s1: Array,
    work: Array,
    q: Array,
) -> None:
    """Writes the coefficients q (N_DENSE, n) of `between` for the last `step`, from s to s1, and to work."""
    for i in range(END + 1, N_SLOPES):
        combine(i, h, k, work)
        for j in range(s.size):
            work[j] += s[j]
        rhs(t + NODES[i] * h, work, mode, slip, p, k, i)
    for j in range(s.size):
        rise, begin, end = s1[j] - s[j], h * k[0, j], h * k[END, j]
        q[0, j], q[1, j], q[2, j] = rise, begin - rise, 2.0 * rise - begin - end
    for i in range(3, N_DENSE):
        combine(DENSE + i - 3, h, k, q[i])


@kernel
def between(s: Array, q: Array, theta: float, out: Array) -> None:
    """Writes the state at the share theta of the step that began at s."""
    rest = 1.0 - theta
    for j in range(s.size):
        total = q[3, j] + theta * (q[4, j] + rest * (q[5, j] + theta * q[6, j]))
        out[j] = s[j] + theta * (q[0, j] + rest * (q[1, j] + theta * (q[2, j] + rest * total)))


@kernel
def middle(s: Array, s1: Array, k: Array, h: float, out: Array) -> None:
    """Writes the state halfway from its values and slopes at both ends (cubic Hermite; third order, for signs)."""
    for j in range(s.size):
        out[j] = 0.5 * (s[j] + s1[j]) + 0.125 * h * (k[0, j] - k[END, j])


# An arc: start, cosine and sine part of the oscillation, its decay and frequency, four numbers of the particular
# solution (level, sine, cosine; or a cubic) and what follows a lag's transient in it, height and rate of the mass
# centre, its acceleration downwards, share of the foot in the mass, its place at rest; amplitude of the oscillation at
# the start, and an eighth of the greatest second derivative of a guard that it moves
T0, COS, SIN, HALF, OMEGA, P0, P1, P2, P3, LATE, Z, U, PULL, SHARE, FOOT, SWING, BOW = range(N_ARC)


@kernel
def oscillator(mode: int, p: Packed) -> tuple[float, float]:
    """k/m [1/s^2] and c/m [1/s] of the oscillation in q."""
    inverse = 1.0 / p.M + (1.0 / p.m_f if mode == AIR and p.massless == 0 else 0.0)
    return p.k_s * inverse, p.c_s * inverse


@kernel
def longest_step(mode: int, slip: int, p: Packed) -> float:
    """Step [s] to look for events with, or 0 where the closed form does not hold."""
    if mode == INTRUDE or p.linear == 0 or slip == 0:
        return 0.0
    stiff, damp = oscillator(mode, p)
    if damp * damp >= 3.9 * stiff:
        return 0.0
    if p.kind == SINE:
        share = p.row[4] * p.row[4] / stiff
        # both parts so small: the form divides by zero
        if p.row[3] != 0.0 and abs(1.0 - share) + damp * math.sqrt(share / stiff) < 1e-6:
            return 0.0
    return 2.0 * math.pi / math.sqrt(stiff) / 8  # events are looked for twice a step, and between by a parabola


@inlined
def particular(t: float, p: Packed) -> tuple[float, float]:
    """The solution q(t), q'(t) that moves as the motor does."""
    left, fall = 0.0, 0.0
    if settling(t, p):
        left = p.arc[LATE] * math.exp(-(t - p.row[7]) / p.tau)
        fall = left / p.tau
    if p.kind == SINE:
        if p.row[3] == 0.0:
            return p.arc[P0] + left, -fall
        sin, cos = sincos(p.row[4] * (t - p.row[0]) + p.row[5])
        return p.arc[P0] + p.arc[P1] * sin + p.arc[P2] * cos + left, p.row[4] * (
            p.arc[P1] * cos - p.arc[P2] * sin
        ) - fall
    h = t - p.row[0]
    value = ((p.arc[P3] * h + p.arc[P2]) * h + p.arc[P1]) * h + p.arc[P0]
    return value + left, (3.0 * p.arc[P3] * h + 2.0 * p.arc[P2]) * h + p.arc[P1] - fall


@kernel
def begin(t: float, s: Array, mode: int, slip: int, p: Packed) -> None:
    """Writes the arc p.arc that starts from the state s at t; dry friction of the rail is a constant force on it."""
    p.arc[T0], p.arc[FOOT], p.arc[BOW] = t, s[XF], math.inf
    rail = rail_friction(t, s, s[Y], 0.0, 0.0, slip, p) / p.M
    if p.massless == 1 and mode == AIR:
        p.arc[Z], p.arc[U], p.arc[PULL] = s[Y], s[W], p.g - rail
        return
    stiff, damp = oscillator(mode, p)
    ratio = p.m_m / p.M
    fall = (p.g if mode != AIR else 0.0) - rail
    if p.kind == SINE:
        p.arc[P0], p.arc[P1], p.arc[P2] = ratio * p.row[2] - fall / stiff, 0.0, 0.0
        if p.row[3] != 0.0:
            rate, gap, loss = p.row[4], stiff - p.row[4] * p.row[4], damp * p.row[4]
            scale = ratio * p.row[3] / (gap * gap + loss * loss)
            p.arc[P1], p.arc[P2] = scale * (stiff * gap + loss * loss), -scale * loss * rate * rate
    else:
        p.arc[P3], p.arc[P2] = ratio * p.row[2], ratio * p.row[3]
        p.arc[P1] = ratio * p.row[4] - 6.0 * p.arc[P3] / stiff
        p.arc[P0] = ratio * p.row[5] + (ratio * damp * p.row[4] - damp * p.arc[P1] - 2.0 * p.arc[P2] - fall) / stiff
    if p.tau > 0.0:
        fast = 1.0 / p.tau
        p.arc[LATE] = ratio * p.row[6] * (stiff - damp * fast) / (fast * (fast - damp) + stiff)
    q, v = particular(t, p)
    p.arc[HALF] = 0.5 * damp
    p.arc[OMEGA] = math.sqrt(stiff - 0.25 * damp * damp)
    p.arc[COS] = s[Y] - s[XF] - q
    p.arc[SIN] = (s[W] - s[VF] - v + p.arc[HALF] * p.arc[COS]) / p.arc[OMEGA]
    p.arc[SHARE] = share = p.m_f / (p.M + p.m_f)
    p.arc[PULL] = p.g - (1.0 - share) * rail
    p.arc[Z], p.arc[U] = (1.0 - share) * s[Y] + share * s[XF], (1.0 - share) * s[W] + share * s[VF]
    p.arc[SWING] = swing = math.sqrt(p.arc[COS] * p.arc[COS] + p.arc[SIN] * p.arc[SIN])
    if p.massless == 1 or p.dry == 1 or p.ages == 1 or p.tau > 0.0:
        return  # a guard that more than this moves
    if mode != AIR:  # that of the spring's force, M (q'' + g)
        p.arc[BOW] = 0.125 * p.M * stiff * stiff * swing
        if p.kind == SINE and p.row[3] != 0.0:
            p.arc[BOW] += 0.125 * p.M * p.row[4] ** 4 * math.sqrt(p.arc[P1] * p.arc[P1] + p.arc[P2] * p.arc[P2])
        return
    bend = stiff * swing
    if p.kind == SINE and p.row[3] != 0.0:
        bend += p.row[4] * p.row[4] * math.sqrt(p.arc[P1] * p.arc[P1] + p.arc[P2] * p.arc[P2])
    elif p.kind != SINE and (p.row[2] != 0.0 or p.row[3] != 0.0):
        bend += 2.0 * abs(p.arc[P2]) + 6.0 * abs(p.arc[P3]) * (p.row[1] - p.row[0])
    p.arc[BOW] = 0.125 * (abs(p.arc[PULL]) + (1.0 - share) * bend)


@kernel
def flow(t: float, mode: int, p: Packed, out: Array) -> None:
    """Writes the state at t on the arc, exact to rounding."""
    h = t - p.arc[T0]
    if p.massless == 1 and mode == AIR:
        out[Y], out[W] = p.arc[Z] + (p.arc[U] - 0.5 * p.arc[PULL] * h) * h, p.arc[U] - p.arc[PULL] * h
        out[XF], out[VF] = p.arc[FOOT], 0.0
        return
    q, v = particular(t, p)
    half, omega = p.arc[HALF], p.arc[OMEGA]
    fade = math.exp(-half * h)
    sin, cos = sincos(omega * h)
    sin, cos = fade * sin, fade * cos
    q += p.arc[COS] * cos + p.arc[SIN] * sin
    v += (omega * p.arc[SIN] - half * p.arc[COS]) * cos - (omega * p.arc[COS] + half * p.arc[SIN]) * sin
    if mode == AIR:
        share = p.arc[SHARE]
        z, u = p.arc[Z] + (p.arc[U] - 0.5 * p.arc[PULL] * h) * h, p.arc[U] - p.arc[PULL] * h
        out[Y], out[W] = z + share * q, u + share * v
        out[XF], out[VF] = z - (1.0 - share) * q, u - (1.0 - share) * v
    else:
        out[XF], out[VF] = p.arc[FOOT], 0.0
        out[Y], out[W] = p.arc[FOOT] + q, v


@kernel
def clear_until(t: float, s: Array, mode: int, p: Packed, best: float, com: float) -> float:
    """Time until which no guard falls, for sure, and the rod stays below its peak or below `best`; on the ground also
    the centre of mass below `com` (t: unknown).

    With the motor still, q stays within a fading amplitude of its level: in flight the free fall of the mass centre
    then bounds foot and rod, on the ground the foot is pushed as q turns. So a long flight or stay need not be looked
    at step by step; with dry friction, which turns with the carriage, it is.
    """
    if p.massless == 1 or p.dry == 1 or not is_still(t, p):
        return t
    h, share, g = t - p.arc[T0], p.arc[SHARE], p.g
    swing = p.arc[SWING] * math.exp(-p.arc[HALF] * h)
    position = p.ratio * (p.row[2] if p.kind == SINE else p.row[5])
    if mode != AIR:
        stretch = p.arc[P0] + swing
        if p.arc[FOOT] + stretch - position > best or p.arc[FOOT] + (1.0 - share) * stretch > com or p.ages == 1:
            return t
        return t + stay(h, swing, math.inf if p.sand == 0 else yield_force(t, s, p), p)
    least = (1.0 - share) * (p.arc[P0] + swing) - p.memory[FLOOR]  # of the mass centre: the foot is in the air for sure
    z = p.arc[Z] + (p.arc[U] - 0.5 * g * h) * h
    if z <= least:
        return t
    landing = (p.arc[U] + math.sqrt(p.arc[U] * p.arc[U] + 2.0 * g * (p.arc[Z] - least))) / g
    apex = p.arc[U] / g
    crest = z if h > apex else p.arc[Z] + 0.5 * p.arc[U] * apex
    if crest + share * (p.arc[P0] + swing) - position <= best:
        return p.arc[T0] + landing
    window = apex - math.sqrt(4.0 * share * swing / g)  # where the rod may be at its highest
    return p.arc[T0] + window if h < window < landing else t


@kernel
def stay(h: float, swing: float, most: float, p: Packed) -> float:
    """Time [s] from h after the arc's start for which the push on the foot at rest, weight + amplitude cos(angle) were
    there no damping, lies between 0 and `most` [N] for sure."""
    half, omega, turn = p.arc[HALF], p.arc[OMEGA], 2.0 * math.pi
    weight, amplitude, wait = (p.M + p.m_f) * p.g, p.M * (omega * omega + half * half) * swing, math.inf
    if amplitude < min(weight, most - weight):
        return wait
    a, b = half * half - omega * omega, 2.0 * half * omega  # the push goes as q'', q times the square of a root
    angle = omega * h - math.atan2(a * p.arc[SIN] + b * p.arc[COS], a * p.arc[COS] - b * p.arc[SIN])
    angle -= turn * math.floor(angle / turn)
    if amplitude >= weight:  # leaves the ground at `low`
        low = math.acos(-weight / amplitude)
        if low <= angle <= turn - low:
            return 0.0
        wait = low - angle if angle < low else low + turn - angle
    if amplitude >= most - weight:  # yields at -high
        high = math.acos(min(max((most - weight) / amplitude, -1.0), 1.0))
        if not high < angle < turn - high:
            return 0.0
        wait = min(wait, turn - high - angle)
    return wait / omega
