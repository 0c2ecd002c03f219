"""Friction between discs that turn: the sliding spring of Cundall and Strack (Geotechnique 29, 47, 1979), compiled.

With n from the other disc to disc i, t = n turned by +90 degrees and levers l_i + l_j = d, in proportion to the radii:
    v_t = (v_i - v_j) . t - l_i w_i - l_j w_j,   xi = integral of v_t over the contact,
    F_t = -k_t xi - gamma_t m_eff v_t, cut to |F_t| <= mu |F_n| (the spring then stretches no farther), on i along t.
k_t = 2/7 k and gamma_t = gamma/2, as LAMMPS' `gran/hooke/history` has them unless told otherwise; its levers are the
radii, which with an overlap make angular momentum. A disc's moment of inertia is m r^2/2. In two dimensions the stretch
is one number that turns with the contact. It grows by the displacement of the last step at mid-way: second order.

rough, the state: mu, k_t, gamma_t, spin (n_free, 2) [rad/s] (foreseen for this time; half a step before, as `v` in
`contacts.step`), torque (n_free,) [N m] zeros, held (n_free, 3) [m]: stretch at side wall, floor or lid, and plate.
"""

from __future__ import annotations

import math

import numba as nb
import numpy as np

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
