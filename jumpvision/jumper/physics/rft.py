"""Resistive force theory of a body of any shape in grains: triangles, velocity and spin in, force and torque out.

Every triangle below the surface that leads the motion (outward normal n along its velocity v) feels for itself

    t = scale depth a(n, v / |v|) - inertia density (n . v)^2 n,   its tangential part at most friction times the normal

a is a law of stresses per depth and scale: the generic one in three dimensions, a function of the invariants g.v, g.n,
n.v of gravity's direction g (Agarwal, Goldman & Kamrin, PNAS 120, e2214017120, 2023), or any map over the plate's angle
and that of its motion (Li, Zhang & Goldman, Science 339, 1408, 2013). The second term is that of dynamic
RFT (Agarwal, Karsai, Goldman & Kamrin, Science Advances 7, eabe0631, 2021). x, y horizontal, z up, the undisturbed
surface z = 0; SI units.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array

UP = np.array([0.0, 0.0, 1.0])
LEVEL = 1e-9  # share of a unit vector that is rounding

Stress = Callable[[Array, Array], Array]  # normals, directions of motion (n, 3) -> stress per depth and scale (n, 3)
Map = Callable[..., tuple[Array, Array]]  # plate's angle, motion's angle [rad] -> along x, z

# powers of x1 = g.v, x2 = g.n, x3 = n.v in the 20 monomials of f1, f2, f3, and their coefficients
MONOMIALS = "000 100 010 001 200 020 002 110 011 101 300 030 003 120 210 012 021 201 102 111"
COEFFICIENTS = """
    0.00212 -0.02320 -0.20890 -0.43083 -0.00259 0.48872 -0.00415 0.07204 -0.02750 -0.08772
    0.01992 -0.45961 0.40799 -0.10107 -0.06576 0.05664 -0.09269 0.01892 0.01033 0.15120
    -0.06796 -0.10941 0.04725 -0.06914 -0.05835 -0.65880 -0.11985 -0.25739 -0.26834 0.02692
    -0.00736 0.63758 0.08997 0.21069 0.04748 0.20406 0.18589 0.04934 0.13527 -0.33207
    -0.02634 -0.03436 0.45256 0.00835 0.02553 -1.31290 -0.05532 0.06790 -0.16404 0.02287
    0.02927 0.95406 -0.00131 -0.11028 0.01487 -0.02730 0.10911 -0.04097 0.07881 -0.27519
"""
POWERS = np.array([[int(power) for power in word] for word in MONOMIALS.split()])
GENERIC = np.array(COEFFICIENTS.split(), dtype=float).reshape(3, 20)


def facing_down(normal: Array) -> Array:
    """The normals (n, 3), turned about where they point up: a plate of no thickness has two."""
    return np.where(normal[:, 2:] > LEVEL, -normal, normal)


def generic_3d(normal: Array, direction: Array) -> Array:
    """a = f1 n + f2 v + f3 g of Agarwal et al. (2023), (n, 3); a level plate that goes down feels 0.875 upwards."""
    n = facing_down(normal)
    x = np.stack([-direction[:, 2], -n[:, 2], np.sum(n * direction, axis=1)], axis=1)
    f = np.prod(x[:, None, :] ** POWERS, axis=2) @ GENERIC.T
    return f[:, :1] * n + f[:, 1:2] * direction - f[:, 2:] * UP


def generic_2d(plate: Array, motion: Array) -> tuple[Array, Array]:
    """(a_x, a_z) of Li et al. (2013): plate's angle to the horizontal and the motion's below it [rad], of one shape.

    a_x against the motion, a_z upwards; their Fourier coefficients A00 .. D10 of the generic medium.
    """
    both, apart = 2.0 * plate + motion, -2.0 * plate + motion
    a_z = 0.206 + 0.169 * np.cos(2.0 * plate) + 0.212 * np.sin(both) + 0.358 * np.sin(motion) + 0.055 * np.sin(apart)
    a_x = -0.124 * np.cos(both) + 0.253 * np.cos(motion) + 0.007 * np.cos(apart) + 0.088 * np.sin(2.0 * plate)
    return a_x, a_z


def of_plane(stresses: Map) -> Stress:
    """A law of the vertical plane for bodies in space: each plate in the plane of its normal and the vertical.

    The part of its motion across that plane is met by nothing but what it takes from the rest: stresses shrink with the
    share of the motion that lies in the plane. Exact for motion in it, so for all vertical motion.
    """

    def law(normal: Array, direction: Array) -> Array:
        n = facing_down(normal)
        flat = np.hypot(n[:, 0], n[:, 1])
        across = np.where((flat > LEVEL)[:, None], n * [1.0, 1.0, 0.0], direction * [1.0, 1.0, 0.0])
        size = np.linalg.norm(across, axis=1, keepdims=True)
        along = np.where(size > LEVEL, across / np.maximum(size, LEVEL), [1.0, 0.0, 0.0])
        along = np.where(np.sum(along * direction, axis=1, keepdims=True) < 0.0, -along, along)
        x, z = np.sum(along * direction, axis=1), direction[:, 2]
        plate, motion = np.arctan2(np.sum(along * n, axis=1), -n[:, 2]), np.arctan2(-z, x)
        a_x, a_z = stresses(plate, motion)
        return np.asarray(np.hypot(x, z)[:, None] * (a_z[:, None] * UP - a_x[:, None] * along))

    return law


@dataclass(frozen=True)
class Grains:
    """What a body moves in. scale [N/m^3]: of stress per depth; friction: of the body's surface.

    inertia: factor of density [kg/m^3] v_n^2 (0: quasistatic; about 1 in dynamic RFT). rise [m]: of the surface at the
    body above the undisturbed one (the free-surface correction of dynamic RFT). stress: the law.
    """

    scale: float
    friction: float = 0.4
    density: float = 0.0
    inertia: float = 0.0
    rise: float = 0.0
    stress: Stress = generic_3d


class Push(NamedTuple):
    """force (3,) [N] on the body, torque (3,) [N m] about the point asked for, traction (n, 3) [Pa] by triangle."""

    force: Array
    torque: Array
    traction: Array


def push(
    triangles: ArrayLike,
    velocity: ArrayLike,
    spin: ArrayLike = (0.0, 0.0, 0.0),
    *,
    grains: Grains,
    about: ArrayLike = (0.0, 0.0, 0.0),
) -> Push:
    """Force and torque of the grains on a body.

    triangles (n, 3, 3) [m]: corners, anticlockwise from outside; velocity (3,) [m/s] of the point `about` (3,) [m];
    spin (3,) [rad/s]. A triangle counts by its middle: cut those that reach through the surface (`cut`).
    """
    corners, point = np.asarray(triangles, dtype=float), np.asarray(about, dtype=float)
    if corners.ndim != 3 or corners.shape[1:] != (3, 3) or not np.isfinite(corners).all():
        raise ValueError(f"push: triangles have shape {corners.shape}; corners must be finite numbers (n, 3, 3)")
    middle, normal, area = faces(corners)
    v = np.asarray(velocity, dtype=float) + np.cross(np.asarray(spin, dtype=float), middle - point)
    speed = np.linalg.norm(v, axis=1)
    depth = grains.rise - middle[:, 2]
    leads = (depth > 0.0) & (np.sum(v * normal, axis=1) > LEVEL * speed) & (area > 0.0)
    traction = np.zeros_like(middle)
    n, w = normal[leads], v[leads]
    a = grains.stress(n, w / speed[leads, None])
    normal_part = np.sum(a * n, axis=1)
    slide, pressure = a - normal_part[:, None] * n, np.maximum(-normal_part, 0.0)  # grains do not pull
    size, most = np.linalg.norm(slide, axis=1), grains.friction * pressure
    slide *= np.where(size > most, most / np.maximum(size, 1e-300), 1.0)[:, None]
    static = grains.scale * depth[leads, None] * (slide - pressure[:, None] * n)
    normal_speed = np.sum(w * n, axis=1)[:, None]
    traction[leads] = static - grains.inertia * grains.density * normal_speed**2 * n
    force = area[:, None] * traction
    return Push(force.sum(axis=0), np.cross(middle - point, force).sum(axis=0), traction)


class Profile(NamedTuple):
    """Slow force [N] on a body going straight down: scale area sum(share max(z - height, 0)), z of its lowest point.

    height (k,) [m] above the lowest point, increasing; share (k,); area [m^2] of the faces that lead, seen from below.
    off: by how much the merged heights miss the faces' own, over the force at the greatest height. drag [kg/m]: of
    v^2, with all of the body in the grains.
    """

    height: Array
    share: Array
    area: float
    off: float
    drag: float

    def __call__(self, z: ArrayLike) -> Array:
        """Over scale and area, at depths z (...) [m]."""
        return np.asarray(np.maximum(np.asarray(z, float)[..., None] - self.height, 0.0) @ self.share)


def profile(triangles: Array, *, grains: Grains, heights: int) -> Profile:
    """Of faces merged to at most `heights` of them, those of equal height exactly; quasistatic but for the drag."""
    middle, normal, area = faces(triangles)
    above = middle[:, 2] - triangles[..., 2].min()
    deep = np.array([0.0, 0.0, 2.0 * float(np.ptp(triangles[..., 2])) + 1.0 + triangles[..., 2].max()])
    slow = Grains(grains.scale, grains.friction, stress=grains.stress)
    up = push(triangles - deep, -UP, grains=slow).traction[:, 2] / (slow.scale * (deep[2] - middle[:, 2]))
    leads = up > 0.0
    seen = np.maximum(-normal[:, 2], 0.0) * area
    shadow, own = float(seen.sum()), Profile(above[leads], (up * area)[leads] / seen.sum(), 1.0, 0.0, 0.0)
    top = float(own.height.max())
    place = np.round(own.height / max(top, 1e-12), 9)
    if np.unique(place).size > heights:
        place = np.minimum(np.floor(place * heights), heights - 1)
    which, index = np.unique(place, return_inverse=True)
    share = np.asarray(np.bincount(index, own.share, which.size), float)
    merged = Profile(np.bincount(index, own.share * own.height, which.size) / share, share, shadow, 0.0, 0.0)
    z = np.linspace(0.0, max(top, 1e-3), 200)
    off = float(np.abs(merged(z) - own(z)).max() / max(own(z)[-1], 1e-300))
    drag = grains.inertia * grains.density * float(np.sum(area * np.maximum(-normal[:, 2], 0.0) ** 3))
    return merged._replace(off=off, drag=drag)


def faces(triangles: Array) -> tuple[Array, Array, Array]:
    """Middles (n, 3) [m], outward normals (n, 3), areas (n,) [m^2]."""
    a, b, c = triangles[:, 0], triangles[:, 1], triangles[:, 2]
    both = np.cross(b - a, c - a)
    twice = np.linalg.norm(both, axis=1)
    return triangles.mean(axis=1), both / np.maximum(twice, 1e-300)[:, None], 0.5 * twice


def cut(triangles: Array, edge: float) -> Array:
    """The same surface of triangles whose edges are no longer than `edge` [m], halved at their longest."""
    done: list[Array] = []
    left = np.asarray(triangles, dtype=float)
    while left.size:
        sides = np.linalg.norm(left - np.roll(left, -1, axis=1), axis=2)  # of corners i, i + 1
        long = sides.max(axis=1) > edge
        done.append(left[~long])
        left, first = left[long], np.argmax(sides[long], axis=1)
        rows = np.arange(len(left))
        a, b, c = (left[rows, (first + k) % 3] for k in range(3))
        m = 0.5 * (a + b)
        left = np.concatenate([np.stack([a, m, c], axis=1), np.stack([m, b, c], axis=1)])
    return np.concatenate(done)


class Table(NamedTuple):
    """Stresses on a plate: plate [rad] (p,), motion [rad] (m,) increasing, a_x, a_z (p, m) [N/m^3] per depth."""

    plate: Array
    motion: Array
    a_x: Array
    a_z: Array

    def __call__(self, plate: Array, motion: Array) -> tuple[Array, Array]:
        """Between the measured angles linear; beyond them that of the nearest."""
        from scipy.interpolate import RegularGridInterpolator

        at = np.stack([np.clip(plate, *self.plate[[0, -1]]), np.clip(motion, *self.motion[[0, -1]])], axis=-1)
        axes = self.plate, self.motion
        x, z = (RegularGridInterpolator(axes, a)(at) for a in (self.a_x, self.a_z))
        return np.asarray(x), np.asarray(z)


def gridded(plate: Array, motion: Array, a_x: Array, a_z: Array) -> Table:
    """A table from rows (n,) in any order. ValueError where a pair of angles is missing or stands twice."""
    p, i = np.unique(np.round(plate, 9), return_inverse=True)
    m, j = np.unique(np.round(motion, 9), return_inverse=True)
    count: NDArray[np.intp] = np.zeros((p.size, m.size), dtype=np.intp)
    np.add.at(count, (i, j), 1)
    if p.size < 2 or m.size < 2 or np.any(count != 1):
        which = ""
        if bad := np.argwhere(count != 1).tolist():
            row, column = bad[0]
            angles = f"plate {math.degrees(p[row]):g}, motion {math.degrees(m[column]):g} degrees"
            which = f"; {angles} stands {count[row, column]} times"
        raise ValueError(
            f"{p.size} plate angles and {m.size} of motion; every pair is needed once, two of each at least{which}"
        )
    x, z = np.empty(count.shape), np.empty(count.shape)
    x[i, j], z[i, j] = a_x, a_z
    return Table(p, m, x, z)
