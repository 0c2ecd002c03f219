"""The laboratory's jumper: PHYSICS section 1 integrated by small fixed steps (RK4), with any set of mechanisms.

Nothing here is shared with `jumpvision.physics`: films and logs made from this motion test the analysis without its own
solver on both sides. SI units, x up. x_r rod, x_f foot, X_m motor relative to the rod; depth z = -x_f.
Integrated is y = x_r + (m_m/M) X_m, whose acceleration needs no X_m'': velocity steps of the law are then the right
impulses on the rod without being put in by hand.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numba as nb
import numpy as np
from numpy.typing import NDArray

from .mechanisms import Law, Robot, truth_of

Array = NDArray[np.float64]

AIR, STUCK, INTRUDING = 0, 1, 2
MIN_FLIGHT = 0.03  # s: shorter flights are the ring-down, not jumps
FIELDS = ("rod", "rod_rate", "foot", "foot_rate", "motor", "motor_rate", "motor_force", "ground_force", "added_mass")


@dataclass(frozen=True)
class Motion:
    """A simulated jump at the times t, shape (n,) [s], on the clock of the law.

    Arrays (n,): rod x_r, foot x_f, motor X_m [m] and their rates [m/s]; motor_force F_m, ground_force F_GM on the foot
    [N]; added_mass [kg]; contact (bool). rest: rod height before the start [m]. lift_offs, flights: start and length of
    every flight [s] (the last may be cut by the end). jump_height as PHYSICS names it, from `motor_stop` on.
    """

    t: Array
    rod: Array
    rod_rate: Array
    foot: Array
    foot_rate: Array
    motor: Array
    motor_rate: Array
    motor_force: Array
    ground_force: Array
    added_mass: Array
    contact: NDArray[np.bool_]
    lift_offs: Array
    flights: Array
    motor_stop: float

    @property
    def rest(self) -> float:
        return float(self.rod[0])

    @property
    def jump_height(self) -> float:
        return float(self.rod[self.t >= self.motor_stop].max() - self.rest)

    @property
    def n_jumps(self) -> int:
        """Flights of at least MIN_FLIGHT."""
        return int(np.sum(self.flights >= MIN_FLIGHT))

    def at(self, name: str, t: Array) -> Array:
        """The array `name` at other times t [s], any shape: linear between samples, held beyond the ends."""
        out = np.interp(np.asarray(t, dtype=float).ravel(), self.t, getattr(self, name))
        return np.asarray(out.reshape(np.shape(t)), dtype=np.float64)


def simulate(
    robot: Robot,
    law: Law | None,
    terms: Sequence[str],
    parameters: Mapping[str, float],
    *,
    ground: str,
    duration: float,
    bed_density: float = 0.0,
    dt: float = 2e-6,
    every: int = 50,
) -> Motion:
    """The jump from settled rest at t = 0 to `duration` [s].

    law: the command, or None for a motor at rest. terms: mechanisms in force (MECHANISMS; those at the camera are
    ignored), with their `parameters` under the names of the contract (SI, rad). ground: "hard" or "granular" (needs a
    static force and a foot with mass). bed_density: phi rho [kg/m^3], for added_mass and depth_drag. dt [s]: the step;
    every: samples are kept each `every` steps. Raises ValueError for an impossible set.
    """
    q = truth_of(robot, terms, parameters, ground=ground, bed_density=bed_density)
    if law is None:
        law = Law(1.0, 0.0, 0.0, 0.0, 0.0)
    half = law.start + (0.5 / law.frequency if law.delay > 0 else law.cycles / law.frequency)
    command = (law.amplitude, 2 * math.pi * law.frequency, law.phase, law.start, half, law.delay, law.stop)
    n = round(duration / (dt * every)) + 1
    out, contact, lift_offs, landings = _integrate(q, command, dt, every, n)
    t: Array = np.arange(n, dtype=np.float64) * (dt * every)
    ends = np.append(landings, t[-1])[: len(lift_offs)]
    return Motion(
        t=t,
        **dict(zip(FIELDS, out)),
        contact=contact,
        lift_offs=lift_offs,
        flights=ends - lift_offs,
        motor_stop=law.stop,
    )


@nb.njit(cache=True)
def _command(t, cmd):  # type: ignore[no-untyped-def]
    """X_m, its rate and acceleration as commanded."""
    A, w, phase, start, half, delay, stop = cmd
    moving = True
    if t < start:
        return 0.0, 0.0, 0.0
    if t >= stop:
        u, moving = stop - delay - start, False
    elif t < half:
        u = t - start
    elif t < half + delay:
        u, moving = half - start, False
    else:
        u = t - delay - start
    X = A * (math.sin(w * u + phase) - math.sin(phase))
    if not moving:
        return X, 0.0, 0.0
    return X, A * w * math.cos(w * u + phase), -A * w * w * math.sin(w * u + phase)


@nb.njit(cache=True)
def _cone(z, q):  # type: ignore[no-untyped-def]
    """Volume of the jammed cone and its rate with depth: eq. (33) without C phi rho."""
    h = q.mu * z
    if z <= 0.0 or q.mu == 0.0:
        return 0.0, q.mu * math.pi * q.R**2
    if h >= q.R * q.tan_theta:
        return math.pi * q.R**3 * q.tan_theta / 3.0, 0.0
    r = q.R - h / q.tan_theta
    volume = h * math.pi * (q.R**2 + h**2 / (3.0 * q.tan_theta**2) - q.R * h / q.tan_theta)
    return volume, q.mu * math.pi * r * r


@nb.njit(cache=True)
def _penetration(z, q):  # type: ignore[no-untyped-def]
    """Static force F_p(z) [N] of the undisturbed bed."""
    if z <= 0.0:
        return 0.0
    if not q.rft:
        return q.k1 * min(z, q.delta) + q.k2 * max(z - q.delta, 0.0)
    area = math.pi * q.R**2
    flat = _cone(z, q)[0] / q.mu if q.mu > 0.0 else area * z  # int A_flat dz
    cone = (area * z - flat) * math.sqrt(1.0 + q.tan_theta**2)  # 1/cos(theta)
    return q.k1 / area * flat + q.sigma_cone * cone


@nb.njit(cache=True)
def _resistance(z, over, q):  # type: ignore[no-untyped-def]
    """F_p with the overshoots of re-intrusion and stop-go; over = (s z_g, z_g, s_p z_stop, z_stop)."""
    extra = 0.0
    if over[0] > 0.0:
        extra += over[0] * math.exp(-(z - over[1]) / q.lam)
    if over[2] > 0.0:
        extra += over[2] * math.exp(-(z - over[3]) / q.lam)
    return _penetration(z, q) + extra


@nb.njit(cache=True)
def _rod(t, y, w, X, cmd, q):  # type: ignore[no-untyped-def]
    """x_r, v_r, v_m and X_m, X_m' from the state."""
    command, rate, _ = _command(t, cmd)
    if q.tau > 0.0:
        rate = (command - X) / q.tau
    else:
        X = command
    ratio = q.m_m / q.M
    v_r = w - ratio * rate
    return y - ratio * X, v_r, v_r + rate, X, rate


@nb.njit(cache=True)
def _spring(x_r, v_r, x_f, v_f, mode, q):  # type: ignore[no-untyped-def]
    if mode == AIR and q.m_f == 0.0:
        return 0.0
    e = x_r - x_f
    return -q.k * e - q.k_3 * e**3 - q.c * (v_r - v_f)


@nb.njit(cache=True)
def _slopes(t, y, w, x_f, v_f, X, mode, over, cmd, q):  # type: ignore[no-untyped-def]
    """Time derivatives of y, w = y', x_f, v_f, X_m in a mode; Coulomb friction is put in after the step."""
    x_r, v_r, v_m, _, rate = _rod(t, y, w, X, cmd, q)
    F_s = _spring(x_r, v_r, x_f, v_f, mode, q)
    a_y = -q.g + (F_s - q.c_v * v_m) / q.M
    a_f = 0.0
    if mode == AIR and q.m_f > 0.0:
        a_f = -q.g - F_s / q.m_f
    elif mode == INTRUDING:
        z = -x_f
        volume, growth = _cone(z, q)
        drag = (q.alpha + q.b * q.drag_inertia * growth) * v_f * v_f
        a_f = (_resistance(z, over, q) + drag - F_s - q.m_f * q.g) / (q.m_f + q.inertia * volume)
    if mode == STUCK:
        v_f = 0.0
    return w, a_y, v_f, a_f, rate


@nb.njit(cache=True)
def _settled(q):  # type: ignore[no-untyped-def]
    """Spring extension and depth at rest, by bisection: k e + k_3 e^3 = -M g, F_p(z_0) = (M + m_f) g."""
    lo, hi = -q.M * q.g / q.k * (1.0 if q.k_3 >= 0.0 else 10.0), 0.0
    for _ in range(80):
        mid = 0.5 * (lo + hi)
        if q.k * mid + q.k_3 * mid**3 < -q.M * q.g:
            lo = mid
        else:
            hi = mid
    extension = 0.5 * (lo + hi)
    if q.hard:
        return extension, 0.0
    lo, hi = 0.0, 1.0
    for _ in range(80):
        mid = 0.5 * (lo + hi)
        if _penetration(mid, q) < (q.M + q.m_f) * q.g:
            lo = mid
        else:
            hi = mid
    return extension, 0.5 * (lo + hi)


@nb.njit(cache=True)
def _integrate(q, cmd, dt, every, n):  # type: ignore[no-untyped-def]
    out = np.empty((9, n))
    contact = np.empty(n, np.bool_)
    lift_offs = np.empty(100000)
    landings = np.empty(100000)
    n_lift, n_land = 0, 0
    extension, z_g = _settled(q)
    x_f, v_f, X, w = -z_g, 0.0, 0.0, 0.0
    y = x_f + extension
    mode = STUCK
    over = (0.0, 0.0, 0.0, 0.0)
    for i in range((n - 1) * every + 1):
        t = i * dt
        if i % every == 0:
            j = i // every
            x_r, v_r, v_m, X_now, rate = _rod(t, y, w, X, cmd, q)
            F_s = _spring(x_r, v_r, x_f, v_f, mode, q)
            _, command_rate, acc = _command(t, cmd)
            if q.tau > 0.0:
                acc = (command_rate - rate) / q.tau
            rail = -q.c_v * v_m - q.F_c * np.sign(v_m)
            a_r = -q.g + (F_s + rail - q.m_m * acc) / q.M
            push = F_s + q.m_f * q.g
            slopes = _slopes(t, y, w, x_f, v_f, X, mode, over, cmd, q)
            row = (x_r, v_r, x_f, v_f, X_now, rate, q.m_m * (a_r + acc + q.g) - rail)
            for m in range(7):
                out[m, j] = row[m]
            out[7, j] = 0.0 if mode == AIR else push + q.m_f * slopes[3]
            out[8, j] = q.inertia * _cone(-x_f, q)[0] if mode == INTRUDING else 0.0
            contact[j] = mode != AIR

        h = 0.5 * dt
        a = _slopes(t, y, w, x_f, v_f, X, mode, over, cmd, q)
        b = _slopes(t + h, y + h * a[0], w + h * a[1], x_f + h * a[2], v_f + h * a[3], X + h * a[4], mode, over, cmd, q)
        c = _slopes(t + h, y + h * b[0], w + h * b[1], x_f + h * b[2], v_f + h * b[3], X + h * b[4], mode, over, cmd, q)
        d = _slopes(
            t + dt, y + dt * c[0], w + dt * c[1], x_f + dt * c[2], v_f + dt * c[3], X + dt * c[4], mode, over, cmd, q
        )
        s = dt / 6.0
        y += s * (a[0] + 2.0 * b[0] + 2.0 * c[0] + d[0])
        w += s * (a[1] + 2.0 * b[1] + 2.0 * c[1] + d[1])
        x_f += s * (a[2] + 2.0 * b[2] + 2.0 * c[2] + d[2])
        v_f += s * (a[3] + 2.0 * b[3] + 2.0 * c[3] + d[3])
        X += s * (a[4] + 2.0 * b[4] + 2.0 * c[4] + d[4])
        t += dt

        x_r, v_r, v_m, X_now, rate = _rod(t, y, w, X, cmd, q)
        if q.F_c > 0.0:  # set-valued friction: at most F_c dt of momentum, never through v_m = 0
            kick = min(abs(v_m), q.F_c * dt / q.M) * np.sign(v_m)
            w -= kick
            y -= 0.5 * dt * kick
            x_r, v_r, v_m, X_now, rate = _rod(t, y, w, X, cmd, q)

        if q.hard and q.m_f == 0.0:  # the foot is the end of a massless spring
            if mode == STUCK and x_r > 0.0:
                mode = AIR
                lift_offs[n_lift] = t
                n_lift += 1
            elif mode == AIR and x_r <= 0.0:
                mode = STUCK
                landings[n_land] = t
                n_land += 1
                w -= (1.0 - q.loss) * v_r
            x_f = max(x_r, 0.0)
            v_f = v_r if mode == AIR else 0.0
        elif mode == AIR:
            if x_f <= -z_g and v_f < 0.0:
                x_f = -z_g
                landings[n_land] = t
                n_land += 1
                w -= (1.0 - q.loss) * v_r
                if q.hard:
                    mode, v_f = STUCK, 0.0
                else:
                    mode = INTRUDING
                    v_f *= q.m_f / (q.m_f + q.inertia * _cone(z_g, q)[0])
        elif mode == INTRUDING:
            if v_f >= 0.0:
                mode, v_f, z_g = STUCK, 0.0, max(z_g, -x_f)
                over = (over[0], over[1], q.s_p * z_g, z_g)
        else:
            push = _spring(x_r, v_r, x_f, 0.0, mode, q) + q.m_f * q.g
            if push < 0.0:
                mode = AIR
                over = (q.s * z_g, z_g, 0.0, 0.0)
                lift_offs[n_lift] = t
                n_lift += 1
            elif not q.hard and push > _resistance(z_g, over, q):
                mode = INTRUDING
        if n_lift == len(lift_offs):
            raise ValueError("the foot chatters without end: 100000 flights")
    return out, contact, lift_offs[:n_lift].copy(), landings[:n_land].copy()
