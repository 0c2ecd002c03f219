"""One compiled time step of discs in one pass; friction by sliding springs on demand (Cundall and Strack 1979).

The discs stand in rows of cells; bands of them, as many as their number says, are worked on by the threads there are.
A step reads one state and writes another, so bands need not wait for each other within it; a contact between two bands
is worked out in both. A disc's forces are added up in the order of its partners: the same bits in any number of
threads.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from .neighbours import FAST, HALF, LIGHT, LOWER, OWN, RADIUS, SPIN, UX, UY, VX, VY, X, Y


@nb.njit(**FAST, forceinline=True)
def kick(vx, vy, ax, ay, damp, gain, slip):  # type: ignore[no-untyped-def]
    """Velocity after half a step of constant acceleration against the ground's drag, exact for either drag alone.

    damp = exp(-c h/2), gain = (1 - damp)/c for the rate c of viscous drag; slip = Coulomb deceleration * h/2 or None: a
    disc that the friction can stop within the half step stands still, so one pushed by less than it does not creep.
    """
    vx, vy = damp * vx + gain * ax, damp * vy + gain * ay
    if slip is not None:
        square = vx * vx + vy * vy
        left = 1.0 - slip / math.sqrt(square) if square > slip * slip else 0.0
        vx, vy = left * vx, left * vy
    return vx, vy


@nb.njit(**FAST)
def within(p, one, other, square, among, count, hits):  # type: ignore[no-untyped-def]
    """Writes the numbers of the pairs (among those numbers, or all: None) nearer than the root of `square` to hits; how
    many."""
    x, y, n = p[X], p[Y], np.uintp(0)
    for a in range(np.uintp(count)):
        c = np.uintp(among[a]) if among is not None else a
        i, j = np.uintp(one[c]), np.uintp(other[c])
        dx, dy = x[i] - x[j], y[i] - y[j]
        hits[n] = c
        n += np.uintp(dx * dx + dy * dy < square[c])  # no branch: a guess would often be wrong
    return n


@nb.njit(**FAST)
def contacts(  # type: ignore[no-untyped-def]
    p, size, f, low, high, n_free, side, one, other, where, hits, count, slide, seen, clock, law, rough, past, push
):
    """Adds the forces and moments of the pairs that touch of OWN or LOWER to the discs low to high - 1."""
    k, gamma = law[0], law[1]
    mu, kt, gt = rough
    foot_x, foot_y, rubbed = 0.0, 0.0, 0.0
    for h in range(np.uintp(count)):
        c = np.uintp(hits[h])
        i, j = (np.uintp(one[c]), np.uintp(other[c])) if side == OWN else (np.uintp(other[c]), np.uintp(one[c]))
        dx, dy = p[X, i] - p[X, j], p[Y, i] - p[Y, j]
        d2 = dx * dx + dy * dy
        d, s, both = math.sqrt(d2), size[RADIUS, i] + size[RADIUS, j], size[LIGHT, i] + size[LIGHT, j]
        approach = (p[VX, i] - p[VX, j]) * dx + (p[VY, i] - p[VY, j]) * dy
        inverse = 1.0 / (d2 * both)  # one division for 1/d^2 and m_eff/d^2
        force = (k * (s * d - d2) * both - gamma * approach) * inverse
        jx, jy = force * dx, force * dy
        on_i, on_j = 0.0, 0.0
        if mu > 0.0:
            q, part = np.uintp(where[c]), size[RADIUS, i] / s
            stretch = slide[q] if seen[q] == clock - 1 else 0.0
            tx, ty, turned, power, slide[q] = rub(
                mu, kt, gt, p, i, j, stretch, dx, dy, d, part, d2 * inverse, force * d, past
            )
            seen[q] = clock
            jx, jy, rubbed = jx + tx, jy + ty, rubbed + power
            on_i, on_j = part * turned, (1.0 - part) * turned
        if side == OWN:
            f[0, i] += jx
            f[1, i] += jy
            f[2, i] -= on_i
        if j < high and j >= low:
            f[0, j] -= jx
            f[1, j] -= jy
            f[2, j] -= on_j
        elif j >= n_free:
            foot_x, foot_y = foot_x + jx, foot_y + jy
    if side == OWN:
        push[0], push[1], push[4] = push[0] + foot_x, push[1] + foot_y, push[4] + rubbed


@nb.njit(**FAST)
def faces(p, size, f, walls, count, law, box, plate, rough, held, past, push):  # type: ignore[no-untyped-def]
    """Adds the forces and moments of walls and plate to the discs near them."""
    k, gamma = law[0], law[1]
    mu, kt, gt = rough
    left, right, bottom, top = box
    half_width, thick, face, rising, rose = plate
    for a in range(np.uintp(count)):
        i = np.uintp(walls[a])
        x, y, wx, wy, r, m = p[X, i], p[Y, i], p[VX, i], p[VY, i], size[RADIUS, i], 1.0 / size[LIGHT, i]
        side, floor, moment, rubbed = 0.0, 0.0, 0.0, 0.0
        if x - r < left:
            side = flat(left - x + r, -wx, m, k, gamma)
        elif x + r > right:
            side = -flat(x + r - right, wx, m, k, gamma)
        if y - r < bottom:
            floor = flat(bottom - y + r, -wy, m, k, gamma)
        elif y + r > top:
            floor = -flat(y + r - top, wy, m, k, gamma)
        if mu > 0.0:
            across, along = side, floor
            held[0, i] = held[0, i] if across != 0.0 else 0.0
            held[1, i] = held[1, i] if along != 0.0 else 0.0
            if across != 0.0:
                lever, away = min(x - left, right - x), 1.0 if x - left < right - x else -1.0
                _, ty, moment, rubbed, held[0, i] = skid(
                    mu, kt, gt, p, i, held[0, i], away, 0.0, lever, 0.0, 0.0, m, across, past
                )
                floor += ty
            if along != 0.0:
                lever, away = min(y - bottom, top - y), 1.0 if y - bottom < top - y else -1.0
                tx, _, turned, power, held[1, i] = skid(
                    mu, kt, gt, p, i, held[1, i], 0.0, away, lever, 0.0, 0.0, m, along, past
                )
                side, moment, rubbed = side + tx, moment + turned, rubbed + power
        push[2], push[3] = push[2] + side, push[3] + floor
        gap = 0.0
        if y + r > face and y - r < face + thick and x + r > -half_width and x - r < half_width:
            dx = x - min(max(x, -half_width), half_width)
            dy = y - min(max(y, face), face + thick)
            d2 = dx * dx + dy * dy
            if 0.0 < d2 < r * r:
                gap = math.sqrt(d2)
                nx, ny = dx / gap, dy / gap
                force = flat(r - gap, -(wx * nx + (wy - rising) * ny), m, k, gamma)
                jx, jy = force * nx, force * ny
                if mu > 0.0:
                    tx, ty, turned, power, held[2, i] = skid(
                        mu, kt, gt, p, i, held[2, i], nx, ny, gap, rising, rose, m, force, past
                    )
                    jx, jy, moment, rubbed = jx + tx, jy + ty, moment + turned, rubbed + power
                side, floor = side + jx, floor + jy
                push[0], push[1] = push[0] + jx, push[1] + jy
        if mu > 0.0 and gap == 0.0:
            held[2, i] = 0.0
        f[0, i] += side
        f[1, i] += floor
        f[2, i] -= moment
        push[4] += rubbed


@nb.njit(**FAST)
def moved(old, new, size, f, low, high, law, h, begun, move, turns):  # type: ignore[no-untyped-def]
    """The state `new` of the discs low to high - 1 by the forces and moments f (3, n), which it sets to 0.

    `begun`: the half kick that ends a step, `move`: half kick and drift of the next, `turns`: also of the spin. Returns
    the greatest speed^2 (with `move`).
    """
    viscous, coulomb, gravity = law[2], law[3], law[4]
    damp = math.exp(-0.5 * viscous * h)
    gain = (1.0 - damp) / viscous if viscous > 0.0 else 0.5 * h
    if turns:
        for i in range(np.uintp(low), np.uintp(high)):
            spin, half, r = old[SPIN, i], old[HALF, i], size[RADIUS, i]
            turn = h * f[2, i] * size[LIGHT, i] / (r * r)  # half a step of the moment over m r^2/2
            f[2, i] = 0.0
            if begun:
                half += turn
                spin = half
            if move:
                spin = half + 2.0 * turn
                half += turn
            new[SPIN, i], new[HALF, i] = spin, half
    if coulomb > 0.0:
        return glided(old, new, size, f, low, high, gravity, damp, gain, 0.5 * h * coulomb, h, begun, move)
    return glided(old, new, size, f, low, high, gravity, damp, gain, None, h, begun, move)


@nb.njit(**FAST)
def glided(old, new, size, f, low, high, gravity, damp, gain, slip, h, begun, move):  # type: ignore[no-untyped-def]
    """Places and velocities of `moved`; damp, gain, slip: of `kick`. It has no branch without slip, and is done for
    several discs at a time; numbers >= 0 stand in the order of their bits, whose greatest is found so too."""
    fastest = np.int64(0)
    for i in range(np.uintp(low), np.uintp(high)):
        x, y, vx, vy, wx, wy = old[X, i], old[Y, i], old[UX, i], old[UY, i], old[VX, i], old[VY, i]
        ax, ay = f[0, i] * size[LIGHT, i], f[1, i] * size[LIGHT, i] - gravity
        f[0, i], f[1, i] = 0.0, 0.0
        if begun:
            vx, vy = kick(vx, vy, ax, ay, damp, gain, slip)
            wx, wy = vx, vy
        if move:
            ux, uy = kick(vx, vy, ax, ay, damp, gain, slip)
            x, y = x + h * ux, y + h * uy
            wx, wy = 2.0 * ux - vx, 2.0 * uy - vy  # foreseen for the end of the step
            vx, vy = ux, uy
            square = np.float64(ux * ux + uy * uy)
            fastest = max(fastest, square.view(np.int64))
        new[X, i], new[Y, i], new[VX, i], new[VY, i], new[UX, i], new[UY, i] = x, y, wx, wy, vx, vy
    found = np.int64(fastest)
    return found.view(np.float64)


@nb.njit(**FAST)
def step(  # type: ignore[no-untyped-def]
    old,
    new,
    size,
    f,
    low,
    high,
    n_free,
    lists,
    close,
    found,
    fresh,
    law,
    box,
    plate,
    h,
    begun,
    move,
    push,
    rough,
    held,
    clock,
):
    """Forces on the discs low to high - 1 in the state `old` (STATE, n), and the state `new` of these, as `moved` says.

    size (2, n): radius and inverse mass. f (3, n): zeros. lists of `listed`, close and found of `picked`; fresh:
    whether the pairs that may touch soon are to be found anew. law: k, gamma,
    viscous rate, Coulomb deceleration, gravity; box: left, right, bottom, top; plate: half width, height, height of its
    face, its velocity up now and over the step before. push (5,) receives the force on the discs from the foot (x, y)
    and from the walls (x, y), and the power of friction. rough: mu, k_t, gamma_t; held (3, n): stretch of the springs
    at walls and plate. clock: number of the step, for the springs. Returns the greatest speed^2.
    """
    one, other, where, square, wide, walls, soon, hits = close
    past = h if begun else 0.0  # s that went by since the springs' stretch was last brought up to date
    push[:] = 0.0
    for side in (LOWER, OWN):  # in the order of the partners
        if fresh:
            found[3 + side] = within(old, one[side], other[side], wide[side], None, found[side], soon[side])
        count = within(old, one[side], other[side], square[side], soon[side], found[3 + side], hits[side])
        contacts(
            old,
            size,
            f,
            np.uintp(low),
            np.uintp(high),
            np.uintp(n_free),
            side,
            one[side],
            other[side],
            where[side],
            hits[side],
            count,
            lists[3][side],
            lists[4][side],
            clock,
            law,
            rough,
            past,
            push,
        )
    faces(old, size, f, walls, found[2], law, box, plate, rough, held, past, push)
    return moved(old, new, size, f, low, high, law, h, begun, move, rough[0] > 0.0)


@nb.njit(**FAST, forceinline=True)
def flat(overlap, closing, mass, k, gamma):  # type: ignore[no-untyped-def]
    """Force away from a wall or a flat face of infinite mass; closing: speed towards it [m/s]."""
    return k * overlap + gamma * mass * closing


STIFFNESS, DAMPING = 2.0 / 7.0, 0.5  # k_t/k, gamma_t/gamma


@nb.njit(**FAST, forceinline=True)
def spring(stretch, slip, damping, most, kt):  # type: ignore[no-untyped-def]
    """Force F_t [N] and stretch [m] at the slip velocity [m/s]; damping [kg/s]; most: mu |F_n| [N]."""
    force = -kt * stretch - damping * slip
    if abs(force) > most:
        force = math.copysign(most, force)
        stretch = -(force + damping * slip) / kt
    return force, stretch


@nb.njit(**FAST, forceinline=True)
def rub(mu, kt, gt, p, i, j, stretch, dx, dy, d, part, mass, load, past):  # type: ignore[no-untyped-def]
    """Force on disc i at its contact with disc j, x and y, the moment d F_t, the power, and the stretch of the spring.

    part: r_i/(r_i + r_j), the share of the moment on i; load: normal force [N]; past [s]: the last step (0: none).
    """
    wx, wy = p[VX, i] - p[VX, j], p[VY, i] - p[VY, j]
    ux, uy = p[UX, i] - p[UX, j], p[UY, i] - p[UY, j]
    now = part * p[SPIN, i] + (1.0 - part) * p[SPIN, j]
    half = part * p[HALF, i] + (1.0 - part) * p[HALF, j]
    inverse = 1.0 / d
    middle = d - 0.5 * past * (dx * ux + dy * uy) * inverse
    slip = (dx * wy - dy * wx) * inverse - d * now
    stretch += past * ((dx * uy - dy * ux) / middle - middle * half)
    force, stretch = spring(stretch, slip, gt * mass, mu * abs(load), kt)
    return -force * dy * inverse, force * dx * inverse, d * force, force * slip, stretch


@nb.njit(**FAST)
def skid(mu, kt, gt, p, i, stretch, nx, ny, lever, rising, rose, mass, load, past):  # type: ignore[no-untyped-def]
    """The same at a flat face of infinite mass, at `lever` [m] from the disc's centre, of normal nx, ny; the face moves
    up at `rising` now, `rose` over the last step [m/s]."""
    wx, wy, ux, uy = p[VX, i], p[VY, i] - rising, p[UX, i], p[UY, i] - rose
    slip = nx * wy - ny * wx - lever * p[SPIN, i]
    middle = lever - 0.5 * past * (nx * ux + ny * uy)
    stretch += past * (nx * uy - ny * ux - middle * p[HALF, i])
    force, stretch = spring(stretch, slip, gt * mass, mu * abs(load), kt)
    return -force * ny, force * nx, lever * force, force * slip, stretch
