"""Pushing overlapping discs apart: the FIRE descent of the overlap energy (Bitzek et al., PRL 97, 170201, 2006)."""

from __future__ import annotations

import math

import numba as nb
import numpy as np

from jumpvision.dem.contacts import neighbours


@nb.njit(cache=True)
def overlaps(p, start, partner, box, f):  # type: ignore[no-untyped-def]
    """Forces f (n, 2) = overlaps along the normals (k = 1) of discs and walls; returns the deepest overlap [m]."""
    n, deepest = len(p), 0.0
    left, right, bottom, top = box
    f[:] = 0.0
    for i in range(n):
        for q in range(start[i], start[i + 1]):
            j = partner[q]
            dx, dy, s = p[i, 0] - p[j, 0], p[i, 1] - p[j, 1], p[i, 4] + p[j, 4]
            d2 = dx * dx + dy * dy
            if 0.0 < d2 < s * s:
                d = math.sqrt(d2)
                deepest = max(deepest, s - d)
                force = (s - d) / d
                f[i, 0] += force * dx
                f[i, 1] += force * dy
                f[j, 0] -= force * dx
                f[j, 1] -= force * dy
        r = p[i, 4]
        across = max(left + r - p[i, 0], 0.0) - max(p[i, 0] + r - right, 0.0)
        along = max(bottom + r - p[i, 1], 0.0) - max(p[i, 1] + r - top, 0.0)
        f[i, 0] += across
        f[i, 1] += along
        deepest = max(deepest, abs(across), abs(along))
    return deepest


@nb.njit(cache=True)
def relax(p, box, skin, tolerance, rounds, partner):  # type: ignore[no-untyped-def]
    """Move the discs p (n, 6) in place until none overlaps by more than `tolerance` [m]; returns the deepest overlap.

    skin [m]: neighbours are listed so much farther than they touch. Unit masses and stiffness: time is in their units.
    """
    n = len(p)
    start, f, v = np.empty(n + 1, np.int64), np.zeros((n, 2)), np.zeros((n, 2))
    listed = p[:, :2] + 2.0 * skin
    dt, mix, downhill, deepest = 0.1, 0.1, 0, np.inf
    for _ in range(rounds):
        moved = 0.0
        for i in range(n):
            moved = max(moved, (p[i, 0] - listed[i, 0]) ** 2 + (p[i, 1] - listed[i, 1]) ** 2)
        if 4.0 * moved > skin * skin:
            count = neighbours(p, n, skin, start, partner)
            if count > len(partner):
                partner = np.empty(2 * count, np.int64)
                neighbours(p, n, skin, start, partner)
            listed[:] = p[:, :2]
        deepest = overlaps(p, start, partner, box, f)
        if deepest <= tolerance:
            break
        power, vv, ff = 0.0, 0.0, 0.0
        for i in range(n):
            for c in range(2):
                power += f[i, c] * v[i, c]
                vv += v[i, c] ** 2
                ff += f[i, c] ** 2
        if power > 0.0:
            turn = mix * math.sqrt(vv / ff)
            for i in range(n):
                for c in range(2):
                    v[i, c] = (1.0 - mix) * v[i, c] + turn * f[i, c]
            downhill += 1
            if downhill > 5:
                dt, mix = min(1.1 * dt, 0.5), 0.99 * mix
        else:
            v[:] = 0.0
            dt, mix, downhill = 0.5 * dt, 0.1, 0
        for i in range(n):
            for c in range(2):
                v[i, c] += dt * f[i, c]
                p[i, c] += dt * v[i, c]
    return deepest
