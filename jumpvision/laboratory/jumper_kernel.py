"""The compiled steps of the laboratory's jumper: RK4 at a fixed step, modes of the foot switched between steps.

State: y = x_r + (m_m/M) X_m, w = y', foot x_f, v_f, motor X_m and its rate V. With a motor that follows its law X_m and
V are the law's; with a lag X_m is a state; with a feedback loop both are.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

AIR, STUCK, INTRUDING = 0, 1, 2


ROUNDING = 1e-9  # of the weight: a foot at rest on the yield surface is not pushed by rounding, which a bed that
# remembers a pause would not forget


@nb.njit(cache=True)
def _command(t, first, cmd):  # type: ignore[no-untyped-def]
    """X_m, its rate and acceleration as commanded; first: sin(phase). Asked once for each time of a step, as its sines
    take two fifths of the time of a jump."""
    A, w, phase, start, half, delay, stop, _, samples, rate = cmd
    moving = True
    if t < start:
        return 0.0, 0.0, 0.0
    if samples.size > 0:
        i = int((t - start) * rate)
        if i >= samples.size - 1:
            return samples[-1], 0.0, 0.0
        slope = (samples[i + 1] - samples[i]) * rate
        before = samples[i - 1] if i > 0 else samples[0]
        bend = (samples[i + 1] - 2.0 * samples[i] + before) * rate * rate  # of the motion that they stand for
        return samples[i] + slope * (t - start - i / rate), slope, bend
    if t >= stop:
        u, moving = stop - delay - start, False
    elif t < half:
        u = t - start
    elif t < half + delay:
        u, moving = half - start, False
    else:
        u = t - delay - start
    sin = math.sin(w * u + phase)
    X = A * (sin - first)
    if not moving:
        return X, 0.0, 0.0
    return X, A * w * math.cos(w * u + phase), -A * w * w * sin


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
def penetration(z, stiffer, q):  # type: ignore[no-untyped-def]
    """Static force F_p(z) [N]; stiffer: k1 / that of the undisturbed bed."""
    if z <= 0.0:
        return 0.0
    k1 = stiffer * q.k1
    if not q.rft:
        return k1 * min(z, q.delta) + q.k2 * max(z - q.delta, 0.0)
    area = math.pi * q.R**2
    flat = _cone(z, q)[0] / q.mu if q.mu > 0.0 else area * z  # int A_flat dz
    cone = (area * z - flat) * math.sqrt(1.0 + q.tan_theta**2)  # 1/cos(theta)
    return k1 / area * flat + q.sigma_cone * cone


@nb.njit(cache=True)
def _resistance(z, over, q):  # type: ignore[no-untyped-def]
    """F_p with the overshoots of re-intrusion and stop-go; over = (s z_g, z_g, that at z_stop, z_stop, k1's factor)."""
    extra = 0.0
    if over[0] > 0.0:
        extra += over[0] * math.exp(-(z - over[1]) / q.lam)
    if over[2] > 0.0:
        extra += over[2] * math.exp(-(z - over[3]) / q.lam)
    return penetration(z, over[4], q) + extra


@nb.njit(cache=True)
def _rod(asked, y, w, X, V, loop, q):  # type: ignore[no-untyped-def]
    """x_r, v_r, v_m and X_m, X_m' from the state; asked: the command."""
    command, rate, _ = asked
    if loop.kp > 0.0:
        rate = V
    elif q.tau > 0.0:
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
def _rail(x_r, q):  # type: ignore[no-untyped-def]
    """Viscous friction coefficient of the rail [N s/m]."""
    return q.c_v + q.c_x * abs(x_r)


@nb.njit(cache=True)
def _acceleration(asked, t, X, V, x_r, v_m, F_s, cmd, loop, q):  # type: ignore[no-untyped-def]
    """X_m'' under the feedback loop: motor m_m a_m = -m_m g + F_m - c_v v_m, rod m_r a_r = -m_r g - F_m + F_s.

    F_m = kp (command - X_m) + kd (command' - X_m') + m_m g, cut at max_force; at the end of the travel or of the
    speed it does not push on.
    """
    command, rate, _ = asked
    _, _, _, _, half, delay, _, dwell, _, _ = cmd
    gain = loop.kp * (dwell if half <= t < half + delay else 1.0)
    F_m = gain * (command - X) + loop.kd * (rate - V) + q.m_m * q.g
    F_m = min(max(F_m, -loop.max_force), loop.max_force)
    m_r = q.M - q.m_m
    a = F_m * q.M / (q.m_m * m_r) - _rail(x_r, q) * v_m / q.m_m - F_s / m_r
    if a > 0.0 and (loop.max_speed <= V or loop.high <= X):
        return 0.0
    if a < 0.0 and (-loop.max_speed >= V or loop.low >= X):
        return 0.0
    return a


@nb.njit(cache=True)
def _slopes(asked, t, y, w, x_f, v_f, X, V, mode, over, cmd, loop, q):  # type: ignore[no-untyped-def]
    """Time derivatives of y, w = y', x_f, v_f, X_m, X_m' in a mode; Coulomb friction is put in after the step."""
    x_r, v_r, v_m, _, rate = _rod(asked, y, w, X, V, loop, q)
    F_s = _spring(x_r, v_r, x_f, v_f, mode, q)
    a_X = _acceleration(asked, t, X, V, x_r, v_m, F_s, cmd, loop, q) if loop.kp > 0.0 else 0.0
    a_y = -q.g + (F_s - _rail(x_r, q) * v_m) / q.M
    a_f = 0.0
    if mode == AIR and q.m_f > 0.0:
        a_f = -q.g - F_s / q.m_f
    elif mode == INTRUDING:
        z = -x_f
        volume, growth = _cone(z, q)
        drag = (q.alpha + q.b * q.drag_inertia * growth) * v_f * v_f + q.d_zv * z * abs(v_f)
        a_f = (_resistance(z, over, q) + drag - F_s - q.m_f * q.g) / (q.m_f + q.inertia * volume)
    if mode == STUCK:
        v_f = 0.0
    return w, a_y, v_f, a_f, rate, a_X


@nb.njit(cache=True)
def _step(r, h, asked, t, y, w, x_f, v_f, X, V, mode, over, cmd, loop, q):  # type: ignore[no-untyped-def]
    """The slopes a time h on, along the slopes r; asked: the command then."""
    return _slopes(
        asked,
        t + h,
        y + h * r[0],
        w + h * r[1],
        x_f + h * r[2],
        v_f + h * r[3],
        X + h * r[4],
        V + h * r[5],
        mode,
        over,
        cmd,
        loop,
        q,
    )


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
        if penetration(mid, 1.0, q) < (q.M + q.m_f) * q.g:
            lo = mid
        else:
            hi = mid
    return extension, 0.5 * (lo + hi)


@nb.njit(cache=True)
def integrate(q, cmd, loop, dt, every, n):  # type: ignore[no-untyped-def]
    out = np.empty((9, n))
    contact = np.empty(n, np.bool_)
    lift_offs = np.empty(100000)
    landings = np.empty(100000)
    n_lift, n_land = 0, 0
    extension, z_g = _settled(q)
    x_f, v_f, X, V, w = -z_g, 0.0, 0.0, 0.0, 0.0
    y = x_f + extension
    mode: int = np.int64(STUCK)  # type: ignore[assignment]  # of a literal: functions compiled twice
    over = (0.0, 0.0, 0.0, 0.0, 1.0)
    first = math.sin(cmd[2])
    for i in range((n - 1) * every + 1):
        t = i * dt
        asked = _command(t, first, cmd)
        if i % every == 0:
            j = i // every
            x_r, v_r, v_m, X_now, rate = _rod(asked, y, w, X, V, loop, q)
            F_s = _spring(x_r, v_r, x_f, v_f, mode, q)
            _, command_rate, acc = asked
            if q.tau > 0.0:
                acc = (command_rate - rate) / q.tau
            if loop.kp > 0.0:
                acc = _acceleration(asked, t, X, V, x_r, v_m, F_s, cmd, loop, q) - q.F_c * np.sign(v_m) / q.m_m
            rail = -_rail(x_r, q) * v_m - q.F_c * np.sign(v_m)
            a_r = -q.g + (F_s + rail - q.m_m * acc) / q.M
            push = F_s + q.m_f * q.g
            slopes = _slopes(asked, t, y, w, x_f, v_f, X, V, mode, over, cmd, loop, q)
            row = (x_r, v_r, x_f, v_f, X_now, rate, q.m_m * (a_r + acc + q.g) - rail)
            for m in range(7):
                out[m, j] = row[m]
            out[7, j] = 0.0 if mode == AIR else push + q.m_f * slopes[3]
            out[8, j] = q.inertia * _cone(-x_f, q)[0] if mode == INTRUDING else 0.0
            contact[j] = mode != AIR

        h = 0.5 * dt
        halfway, at_end = _command(t + h, first, cmd), _command(t + dt, first, cmd)
        a = _slopes(asked, t, y, w, x_f, v_f, X, V, mode, over, cmd, loop, q)
        b = _step(a, h, halfway, t, y, w, x_f, v_f, X, V, mode, over, cmd, loop, q)
        c = _step(b, h, halfway, t, y, w, x_f, v_f, X, V, mode, over, cmd, loop, q)
        d = _step(c, dt, at_end, t, y, w, x_f, v_f, X, V, mode, over, cmd, loop, q)
        s = dt / 6.0
        y += s * (a[0] + 2.0 * b[0] + 2.0 * c[0] + d[0])
        w += s * (a[1] + 2.0 * b[1] + 2.0 * c[1] + d[1])
        x_f += s * (a[2] + 2.0 * b[2] + 2.0 * c[2] + d[2])
        v_f += s * (a[3] + 2.0 * b[3] + 2.0 * c[3] + d[3])
        X += s * (a[4] + 2.0 * b[4] + 2.0 * c[4] + d[4])
        if loop.kp > 0.0:  # the limits act between motor and rod: y and y' keep
            V += s * (a[5] + 2.0 * b[5] + 2.0 * c[5] + d[5])
            V = min(max(V, -loop.max_speed), loop.max_speed)
            if (loop.high < X and V > 0.0) or (loop.low > X and V < 0.0):
                V = 0.0
            X = min(max(X, loop.low), loop.high)
        t += dt

        x_r, v_r, v_m, X_now, rate = _rod(at_end, y, w, X, V, loop, q)
        if q.F_c > 0.0:  # set-valued friction: at most F_c dt of momentum, never through v_m = 0
            share = q.m_m / q.M if loop.kp > 0.0 else 1.0  # of v_m's change that y' takes
            kick = min(share * abs(v_m), q.F_c * dt / q.M) * np.sign(v_m)
            w -= kick
            V -= kick / share
            y -= 0.5 * dt * kick
            x_r, v_r, v_m, X_now, rate = _rod(at_end, y, w, X, V, loop, q)

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
                left = over[2] * math.exp(-(z_g - over[3]) / q.lam) if over[2] > 0.0 else 0.0
                over = (over[0], over[1], q.s_p * z_g + q.carry * left, z_g, over[4])
        else:
            push = _spring(x_r, v_r, x_f, 0.0, mode, q) + q.m_f * q.g
            if push < 0.0:
                mode = AIR
                over = (q.s * z_g, z_g, 0.0, 0.0, q.factor)
                lift_offs[n_lift] = t
                n_lift += 1
            elif not q.hard and push > _resistance(z_g, over, q) + ROUNDING * q.M * q.g:
                mode = INTRUDING
        if n_lift == len(lift_offs):
            raise ValueError("the foot chatters without end: 100000 flights")
    return out, contact, lift_offs[:n_lift].copy(), landings[:n_land].copy()
