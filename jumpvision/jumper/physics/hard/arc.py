"""One smooth arc of the hard-ground jumper in closed form: the linear flow between two events.

x = x_r [m] is the height of the rod above the relaxed spring, X = X_m the motor's position relative to it. With
q = m_m/M (docs/physics.md section 2), grounded: x'' + 2 gamma x' + w0^2 x = u, in the air: x'' = u; u = -g - q X''.
On an arc X = d0 + d1 s + d2 s^2 + d3 s^3 + A sin(omega s + phase), s [s] from the arc's start, so that
x = p0 + p1 s + p2 s^2 + p3 s^3 + Ps sin(omega s + phase) + Pc cos(omega s + phase) + exp(-gamma s) (a C(s) + b S(s)).

An arc is a tuple of floats, in the order of the names below (a tuple stays in registers).
"""

from __future__ import annotations

import cmath
import math

import numba as nb

from jumpvision.base.arrays import Array
from jumpvision.jumper.physics.forcing import INLINE, KERNEL, sincos

Arc = tuple[float, ...]

AIR, UNDER, OVER, RESONANT = 0.0, 1.0, 2.0, 3.0
ARC_SIZE = 20
KIND, W2, GAMMA, OMEGA_D, P0, P1, P2, P3, PS, PC, HA, HB, D0, D1, D2, D3, AMP, OMEGA, PHASE, JERK = range(ARC_SIZE)

# Nearer to resonance than this (|i omega - lambda| / w0: springs almost undamped) the particular solution grows as the
# inverse and cancels against the homogeneous one; the RESONANT form has no such difference.
RESONANCE = 1e-3

# all INLINE: an arc handed over in memory costs more than its evaluation


@nb.njit(**INLINE)
def make_arc(
    grounded: bool,
    piece: Array | tuple[float, ...],
    tau: float,
    length: float,
    turn: tuple[float, float],
    x: float,
    v: float,
    q: float,
    g: float,
    w2: float,
    gam: float,
) -> Arc:
    """The arc that leaves (x [m], v [m/s]) at time tau into a forcing piece and lasts at most `length` [s].

    piece: (9,) columns t0, t1, d0, d1, d2, d3, A, omega, phase; turn: sin and cos of omega tau + phase. w2 = k/M,
    gam = c/(2 M).
    JERK bounds |x'''| on the arc: the homogeneous part by its energy, which only falls, the rest by its amplitude.
    """
    d3 = piece[5]
    d2 = piece[4] + 3.0 * d3 * tau
    d1 = piece[3] + (2.0 * piece[4] + 3.0 * d3 * tau) * tau
    d0 = piece[2] + (piece[3] + (piece[4] + d3 * tau) * tau) * tau
    amp, om = piece[6], piece[7]
    ph = piece[8] + om * tau
    sin, cos = turn
    if not grounded:
        qa = q * amp
        jerk = 6.0 * abs(q * d3) + abs(qa) * om**3
        return (
            AIR,
            0.0,
            0.0,
            1.0,
            x + qa * sin,
            v + qa * om * cos,
            -0.5 * g - q * d2,
            -q * d3,
            -qa,
            0.0,
            0.0,
            0.0,
            d0,
            d1,
            d2,
            d3,
            amp,
            om,
            ph,
            jerk,
        )
    kind, om_d = UNDER, math.sqrt(abs(w2 - gam * gam))
    if w2 <= gam * gam:
        kind = OVER
    p1 = -6.0 * q * d3 / w2
    p0 = (-g - 2.0 * q * d2 - 2.0 * gam * p1) / w2
    push = q * amp * om * om
    if push != 0.0 and kind == UNDER and gam * gam + (om - om_d) * (om - om_d) < RESONANCE * RESONANCE * w2:
        kind, ps, pc = RESONANT, push, 0.0
        xh, vh = x - p0, v - p1
        w0 = math.sqrt(w2)
        grown = abs(push) * length  # bounds v and w0 x of the forced part
        jerk = abs(push) * (om + 2.0 * gam) + (4.0 * gam * gam + 2.0 * gam * w0 + w2) * grown
    else:
        real, imag = w2 - om * om, 2.0 * gam * om
        den = real * real + imag * imag
        ps, pc = 0.0, 0.0
        if push != 0.0:
            ps, pc = push * real / den, -push * imag / den
        xh = x - p0 - ps * sin - pc * cos
        vh = v - p1 - om * (ps * cos - pc * sin)
        jerk = math.sqrt(ps * ps + pc * pc) * om**3
    ah = -2.0 * gam * vh - w2 * xh
    jh = -2.0 * gam * ah - w2 * vh
    jerk += math.sqrt(jh * jh + w2 * ah * ah)
    return (kind, w2, gam, om_d, p0, p1, 0.0, 0.0, ps, pc, xh, vh + gam * xh, d0, d1, d2, d3, amp, om, ph, jerk)


@nb.njit(**KERNEL)
def _resonant(arc: Arc, s: float) -> tuple[float, float]:
    """x and v of the response from rest to PS sin(omega s + phase), with no difference of nearly equal numbers.

    With lambda = -gamma + i Omega and eta = v + gamma x + i Omega x: eta = int exp(lambda (s - r)) u(r) dr.
    """
    lam, iom = complex(-arc[GAMMA], arc[OMEGA_D]), complex(0.0, arc[OMEGA])
    turn, grow = cmath.exp(complex(0.0, arc[PHASE])), cmath.exp(lam * s)
    z = (iom - lam) * s
    near = grow * s
    if z != 0.0:  # times (exp(z) - 1) / z
        rise, half = math.expm1(z.real), math.sin(0.5 * z.imag)
        cos = 1.0 - 2.0 * half * half
        near *= complex(rise * cos - 2.0 * half * half, (rise + 1.0) * math.sin(z.imag)) / z
    far = (cmath.exp(-iom * s) - grow) / (-iom - lam)
    eta = arc[PS] / 2j * (turn * near - turn.conjugate() * far)
    x = eta.imag / arc[OMEGA_D]
    return x, eta.real - arc[GAMMA] * x


@nb.njit(**INLINE)
def _particular(arc: Arc, s: float, sin: float, cos: float) -> tuple[float, float]:
    om = arc[OMEGA]
    x = ((arc[P3] * s + arc[P2]) * s + arc[P1]) * s + arc[P0] + (arc[PS] * sin + arc[PC] * cos)
    v = (3.0 * arc[P3] * s + 2.0 * arc[P2]) * s + arc[P1] + om * (arc[PS] * cos - arc[PC] * sin)
    return x, v


@nb.njit(**INLINE)
def rod(arc: Arc, s: float, sin: float, cos: float) -> tuple[float, float]:
    """x [m] and x' [m/s] at s; sin and cos of omega s + phase."""
    gam = arc[GAMMA]
    if arc[KIND] == RESONANT:
        x, v = _particular(arc, s, 0.0, 0.0)
        xr, vr = _resonant(arc, s)
        x, v = x + xr, v + vr
    else:
        x, v = _particular(arc, s, sin, cos)
    if arc[KIND] == AIR:
        return x, v
    if arc[KIND] == OVER:  # C = cosh, S = sinh / kappa, written without large exponentials
        kappa = arc[OMEGA_D]
        slow = math.exp(-arc[W2] / (gam + kappa) * s)
        fade = -math.expm1(-2.0 * kappa * s)
        c, sn = slow * (1.0 - 0.5 * fade), slow * (0.5 * fade / kappa if kappa > 0.0 else s)
    else:
        decay = math.exp(-gam * s)
        sn, c = sincos(arc[OMEGA_D] * s)
        c, sn = decay * c, decay * (sn / arc[OMEGA_D])
    # (a C + b S)' with b = v + gamma a, C' = -gamma C - Omega^2 S, S' = C - gamma S
    x += arc[HA] * c + arc[HB] * sn
    return x, v + (arc[HB] - gam * arc[HA]) * c - (gam * arc[HB] + (arc[W2] - gam * gam) * arc[HA]) * sn


@nb.njit(**INLINE)
def motor_at(arc: Arc, s: float, sin: float, cos: float) -> tuple[float, float, float, float]:
    """X, X', X'', X''' of the motor at s; sin and cos of omega s + phase."""
    om, w = arc[OMEGA], arc[AMP]
    mx = ((arc[D3] * s + arc[D2]) * s + arc[D1]) * s + arc[D0] + w * sin
    mv = (3.0 * arc[D3] * s + 2.0 * arc[D2]) * s + arc[D1] + w * om * cos
    ma = 6.0 * arc[D3] * s + 2.0 * arc[D2] - w * om * om * sin
    return mx, mv, ma, 6.0 * arc[D3] - w * om * om * om * cos


@nb.njit(**INLINE)
def acceleration(arc: Arc, x: float, v: float, ma: float, q: float, g: float) -> float:
    """x'' from the equation of motion; ma = X''."""
    return -g - q * ma - 2.0 * arc[GAMMA] * v - arc[W2] * x


@nb.njit(**INLINE)
def evaluate(arc: Arc, s: float, q: float, g: float) -> tuple[float, float, float, float, float, float, float]:
    """x, x', x'' of the rod and X, X', X'', X''' of the motor at s."""
    sin, cos = sincos(arc[OMEGA] * s + arc[PHASE]) if arc[AMP] != 0.0 else (0.0, 0.0)
    mx, mv, ma, mj = motor_at(arc, s, sin, cos)
    x, v = rod(arc, s, sin, cos)
    return x, v, acceleration(arc, x, v, ma, q, g), mx, mv, ma, mj
