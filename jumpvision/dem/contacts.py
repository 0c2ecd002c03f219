"""One compiled time step of discs in one pass; friction by sliding springs on demand (Cundall and Strack 1979)."""

from __future__ import annotations

import math

import numba as nb
import numpy as np


@nb.njit(cache=True)
def neighbours(p, n_free, reach, start, partner):  # type: ignore[no-untyped-def]
    """List for each free disc i the discs j > i nearer than r_i + r_j + reach in partner[start[i]:start[i + 1]].

    Returns the number of pairs; above len(partner) the list did not fit and holds nothing of use. start (n_free + 1,).
    """
    n = len(p)
    r_max, left, right, low, high = 0.0, np.inf, -np.inf, np.inf, -np.inf
    for i in range(n):
        r_max = max(r_max, p[i, 4])
        left, right = min(left, p[i, 0]), max(right, p[i, 0])
        low, high = min(low, p[i, 1]), max(high, p[i, 1])
    size = max(2.0 * r_max + reach, math.sqrt((right - left) * (high - low) / n), 1e-300)  # about n cells at most
    nx, ny = int((right - left) / size) + 1, int((high - low) / size) + 1
    cell = np.empty(n, np.int64)
    first = np.zeros(nx * ny + 1, np.int64)
    for i in range(n):
        cell[i] = int((p[i, 1] - low) / size) * nx + int((p[i, 0] - left) / size)
        first[cell[i] + 1] += 1
    for c in range(nx * ny):
        first[c + 1] += first[c]
    slot = first[:-1].copy()
    inside = np.empty(n, np.int64)
    for i in range(n):
        inside[slot[cell[i]]] = i
        slot[cell[i]] += 1
    count = 0
    for i in range(n_free):
        start[i] = count
        cx, cy = cell[i] % nx, cell[i] // nx
        for row in range(max(cy - 1, 0), min(cy + 2, ny)):
            a, b = first[row * nx + max(cx - 1, 0)], first[row * nx + min(cx + 1, nx - 1) + 1]
            for q in range(a, b):
                j = inside[q]
                if j > i:
                    s = p[i, 4] + p[j, 4] + reach
                    if (p[i, 0] - p[j, 0]) ** 2 + (p[i, 1] - p[j, 1]) ** 2 < s * s:
                        if count < len(partner):
                            partner[count] = j
                        count += 1
    start[n_free] = count
    return count


@nb.njit(cache=True, inline="always")
def kick(vx, vy, ax, ay, damp, gain, slip):  # type: ignore[no-untyped-def]
    """Velocity after half a step of constant acceleration against the ground's drag, exact for either drag alone.

    damp = exp(-c h/2), gain = (1 - damp)/c for the rate c of viscous drag; slip = Coulomb deceleration * h/2: a disc
    that the friction can stop within the half step stands still, so one pushed by less than it does not creep.
    """
    vx, vy = damp * vx + gain * ax, damp * vy + gain * ay
    if slip > 0.0:
        square = vx * vx + vy * vy
        left = 1.0 - slip / math.sqrt(square) if square > slip * slip else 0.0
        vx, vy = left * vx, left * vy
    return vx, vy


@nb.njit(cache=True, inline="always")
def flat(overlap, closing, mass, k, gamma):  # type: ignore[no-untyped-def]
    """Force away from a wall or a flat face of infinite mass; closing: speed towards it [m/s]."""
    return k * overlap + gamma * mass * closing


@nb.njit(cache=True, fastmath={"contract", "nsz", "arcp"})
def step(  # type: ignore[no-untyped-def]
    p, v, f, start, partner, n_free, law, box, plate, h, begun, move, push, slide, rough
):
    """Forces at the places in p; `begun`: the half kick that ends a step, `move`: half kick and drift of the next.

    v (n_free, 2): velocity half a step before (begun) or at this time, afterwards half a step on (move) or at this
    time. f (n, 2): zeros. law: k, gamma, viscous rate, Coulomb deceleration, gravity; box: left, right, bottom, top;
    plate: half width, height, height of its face, its velocity up now and over the step before. push (5,) receives the
    force on the free discs from the foot (x, y) and from the walls (x, y), and the power of friction. slide (pairs,):
    stretch of the contacts' tangential springs; rough: None or as in `friction`. Returns the greatest speed^2 (with
    `move`).
    """
    k, gamma, viscous, coulomb, gravity = law
    left, right, bottom, top = box
    half_width, thick, face, rising, rose = plate
    damp = math.exp(-0.5 * viscous * h)
    gain = (1.0 - damp) / viscous if viscous > 0.0 else 0.5 * h
    slip = 0.5 * h * coulomb
    foot_x, foot_y, wall_x, wall_y, fastest, rubbed = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    if rough is not None:
        mu, kt, gt, spin, torque, held = rough
    past = h if begun else 0.0  # s that went by since the springs' stretch was last brought up to date
    for i in range(n_free):
        x, y, wx, wy, r, light = p[i, 0], p[i, 1], p[i, 2], p[i, 3], p[i, 4], p[i, 5]
        fx, fy = f[i, 0], f[i, 1]
        for q in range(start[i], start[i + 1]):
            j = partner[q]
            dx, dy, s = x - p[j, 0], y - p[j, 1], r + p[j, 4]
            d2 = dx * dx + dy * dy
            if d2 < s * s:
                d = math.sqrt(d2)
                both = light + p[j, 5]
                one = 1.0 / (d2 * both)  # one division for 1/d^2 and m_eff/d^2
                approach = (wx - p[j, 2]) * dx + (wy - p[j, 3]) * dy
                force = (k * (s * d - d2) * both - gamma * approach) * one
                fx += force * dx
                fy += force * dy
                f[j, 0] -= force * dx
                f[j, 1] -= force * dy
                if rough is not None:
                    free = j < n_free
                    tx, ty, power = rub(
                        mu,
                        kt,
                        gt,
                        spin,
                        torque,
                        slide,
                        q,
                        i,
                        j if free else -1,
                        dx,
                        dy,
                        d,
                        r / s,
                        wx - p[j, 2],
                        wy - p[j, 3],
                        v[i, 0] - (v[j, 0] if free else 0.0),
                        v[i, 1] - (v[j, 1] if free else rose),
                        1.0 / both,
                        force * d,
                        past,
                    )
                    fx, fy, rubbed = fx + tx, fy + ty, rubbed + power
                    f[j, 0] -= tx
                    f[j, 1] -= ty
            elif rough is not None:
                slide[q] = 0.0
        f[i, 0], f[i, 1] = 0.0, 0.0
        m = 1.0 / light
        side, floor = 0.0, 0.0
        if x - r < left:
            side = flat(left - x + r, -wx, m, k, gamma)
        elif x + r > right:
            side = -flat(x + r - right, wx, m, k, gamma)
        if y - r < bottom:
            floor = flat(bottom - y + r, -wy, m, k, gamma)
        elif y + r > top:
            floor = -flat(y + r - top, wy, m, k, gamma)
        if rough is not None:
            held[i, 0] = 0.0 if side == 0.0 else held[i, 0]
            held[i, 1] = 0.0 if floor == 0.0 else held[i, 1]
            normal = floor
            if side != 0.0:
                lever, away = min(x - left, right - x), 1.0 if x - left < right - x else -1.0
                _, ty, power = skid(
                    mu, kt, gt, spin, torque, held, i, 0, away, 0.0, lever, wx, wy, v[i, 0], v[i, 1], m, side, past
                )
                floor, rubbed = floor + ty, rubbed + power
            if normal != 0.0:
                lever, away = min(y - bottom, top - y), 1.0 if y - bottom < top - y else -1.0
                tx, _, power = skid(
                    mu, kt, gt, spin, torque, held, i, 1, 0.0, away, lever, wx, wy, v[i, 0], v[i, 1], m, normal, past
                )
                side, rubbed = side + tx, rubbed + power
        fx, wall_x = fx + side, wall_x + side
        fy, wall_y = fy + floor, wall_y + floor
        gap, nx, ny, force = 0.0, 0.0, 1.0, 0.0
        if y + r > face and y - r < face + thick and x + r > -half_width and x - r < half_width:
            dx = x - min(max(x, -half_width), half_width)
            dy = y - min(max(y, face), face + thick)
            d2 = dx * dx + dy * dy
            if 0.0 < d2 < r * r:
                gap = math.sqrt(d2)
                nx, ny = dx / gap, dy / gap
                force = flat(r - gap, -(wx * nx + (wy - rising) * ny), m, k, gamma)
                fx, foot_x = fx + force * nx, foot_x + force * nx
                fy, foot_y = fy + force * ny, foot_y + force * ny
        if rough is not None:
            if gap > 0.0:
                tx, ty, power = skid(
                    mu,
                    kt,
                    gt,
                    spin,
                    torque,
                    held,
                    i,
                    2,
                    nx,
                    ny,
                    gap,
                    wx,
                    wy - rising,
                    v[i, 0],
                    v[i, 1] - rose,
                    m,
                    force,
                    past,
                )
                fx, foot_x, fy, foot_y, rubbed = fx + tx, foot_x + tx, fy + ty, foot_y + ty, rubbed + power
            else:
                held[i, 2] = 0.0
            turn(spin, torque, i, r, light, h, begun, move)
        ax, ay = fx * light, fy * light - gravity
        vx, vy = v[i, 0], v[i, 1]
        if begun:
            vx, vy = kick(vx, vy, ax, ay, damp, gain, slip)
            p[i, 2], p[i, 3] = vx, vy
        if move:
            ux, uy = kick(vx, vy, ax, ay, damp, gain, slip)
            p[i, 0], p[i, 1] = x + h * ux, y + h * uy
            p[i, 2], p[i, 3] = 2.0 * ux - vx, 2.0 * uy - vy  # foreseen for the end of the step
            vx, vy = ux, uy
            fastest = max(fastest, ux * ux + uy * uy)
        v[i, 0], v[i, 1] = vx, vy
    for j in range(n_free, len(p)):
        foot_x, foot_y = foot_x - f[j, 0], foot_y - f[j, 1]
        f[j, 0], f[j, 1] = 0.0, 0.0
    push[0], push[1], push[2], push[3], push[4] = foot_x, foot_y, wall_x, wall_y, rubbed
    return fastest


@nb.njit(cache=True, nogil=True)
def march(  # type: ignore[no-untyped-def]
    p, v, f, n_free, law, box, plate, h, path, speed, skin, start, partner, slide, impulse, rough
):
    """Advance by len(path) - 1 steps in place; velocities p[:, 2:4] are those of the last time.

    path, speed (steps + 1,): height and velocity up of the foot at each step; plate: half width and height of the
    plate (a width < 0 is no plate); the driven discs move by the same path. f (n, 2) zeros. start, partner, slide: the
    list left by the march before (start zeros: none); returns the new partner and slide. impulse (5,) receives that of
    the foot (x, y) and of the walls (x, y) on the free discs and the work of friction, by the trapezoidal rule.
    """
    push = np.empty(5)
    steps, travel, fresh = len(path) - 1, 0.0, False
    for s in range(steps + 1):
        if not fresh or 2.0 * travel > skin:
            old = start.copy(), partner
            if rough is not None:
                partner = partner.copy()
            count = neighbours(p, n_free, skin, start, partner)
            if count > len(partner):
                partner = np.empty(int(1.3 * count) + 16, np.int64)
                neighbours(p, n_free, skin, start, partner)
            if rough is not None:
                slide = carried(old[0], old[1], slide, start, partner)
            travel, fresh = 0.0, True
        rose = (path[s] - path[s - 1]) / h if s > 0 else 0.0
        now = (plate[0], plate[1], path[s], speed[s], rose)
        fastest = step(p, v, f, start, partner, n_free, law, box, now, h, s > 0, s < steps, push, slide, rough)
        impulse += (0.5 if s in (0, steps) else 1.0) * h * push
        if s < steps:
            for j in range(n_free, len(p)):
                p[j, 1] += path[s + 1] - path[s]
                p[j, 3] = speed[s + 1]
            rate = max(abs(speed[s]), abs(speed[s + 1]), abs(path[s + 1] - path[s]) / h)
            travel += h * max(math.sqrt(fastest), rate)
    return partner, slide


STIFFNESS, DAMPING = 2.0 / 7.0, 0.5  # k_t/k, gamma_t/gamma


@nb.njit(cache=True, inline="always")
def spring(stretch, slip, damping, most, kt):  # type: ignore[no-untyped-def]
    """Force F_t [N] and stretch [m] at the slip velocity [m/s]; damping [kg/s]; most: mu |F_n| [N]."""
    force = -kt * stretch - damping * slip
    if abs(force) > most:
        force = math.copysign(most, force)
        stretch = -(force + damping * slip) / kt
    return force, stretch


@nb.njit(cache=True, inline="always")
def rub(  # type: ignore[no-untyped-def]
    mu, kt, gt, spin, torque, slide, q, i, j, dx, dy, d, part, wx, wy, ux, uy, mass, normal, past
):
    """Force on disc i along its contact q with disc j (-1: driven, does not turn), and its power; adds the torques.

    part: r_i/(r_i + r_j); wx, wy and ux, uy: relative velocity now and over the last step of length past [s] (0: none).
    """
    now, half = part * spin[i, 0], part * spin[i, 1]
    if j >= 0:
        now += (1.0 - part) * spin[j, 0]
        half += (1.0 - part) * spin[j, 1]
    middle = d - 0.5 * past * (dx * ux + dy * uy) / d
    slip = (dx * wy - dy * wx) / d - d * now
    stretch = slide[q] + past * ((dx * uy - dy * ux) / middle - middle * half)
    force, slide[q] = spring(stretch, slip, gt * mass, mu * abs(normal), kt)
    torque[i] -= part * d * force
    if j >= 0:
        torque[j] -= (1.0 - part) * d * force
    return -force * dy / d, force * dx / d, force * slip


@nb.njit(cache=True, inline="always")
def skid(  # type: ignore[no-untyped-def]
    mu, kt, gt, spin, torque, held, i, k, nx, ny, lever, wx, wy, ux, uy, mass, normal, past
):
    """The same at the flat face k of infinite mass, at `lever` [m] from the disc's centre, of normal nx, ny."""
    slip = nx * wy - ny * wx - lever * spin[i, 0]
    middle = lever - 0.5 * past * (nx * ux + ny * uy)
    stretch = held[i, k] + past * (nx * uy - ny * ux - middle * spin[i, 1])
    force, held[i, k] = spring(stretch, slip, gt * mass, mu * abs(normal), kt)
    torque[i] -= lever * force
    return -force * ny, force * nx, force * slip


@nb.njit(cache=True, inline="always")
def turn(spin, torque, i, r, light, h, begun, move):  # type: ignore[no-untyped-def]
    """Half kicks of the spin of disc i by its complete torque, as those of its velocity in `contacts.step`."""
    gain = h * torque[i] * light / (r * r)  # half a step of torque over m r^2/2
    torque[i] = 0.0
    w = spin[i, 1]
    if begun:
        w += gain
        spin[i, 0] = w
    if move:
        spin[i, 0] = w + 2.0 * gain
        w += gain
    spin[i, 1] = w


@nb.njit(cache=True)
def carried(old_start, old_partner, old_slide, start, partner):  # type: ignore[no-untyped-def]
    """Stretches (len(partner),) of the pairs of a new list, from those of the old one; 0 for pairs that are new."""
    slide = np.zeros(len(partner))
    for i in range(len(start) - 1):
        for a in range(old_start[i], old_start[i + 1]):
            if old_slide[a] != 0.0:
                for b in range(start[i], start[i + 1]):
                    if partner[b] == old_partner[a]:
                        slide[b] = old_slide[a]
                        break
    return slide
