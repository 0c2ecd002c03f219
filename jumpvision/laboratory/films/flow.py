"""The flow that the grain film shows: prescribed, so that every measured number has a known answer.

Coordinates: r [m] distance from the foot's axis, h [m] depth below the foot's lower face, z [m] intrusion depth of the
face below the undisturbed surface. Grains move straight down, and only while the foot goes deeper than ever before.
Speed / foot speed:
  1                       inside the jammed truncated cone (radius R at the face, side slope theta, height mu z)
  a^d S(r / w)            at the depth d below the cone's surface (below the face beside the cone), a = sin(beta)^(1/Dz)
  S(r / w) exp(h / 3 mm)  beside the foot above its face (h < 0)
with the lateral cut-off S(x) = exp(-x^6), whose width w(z) is such that a full disc foot carries the momentum
`m_a(z) v_foot` of the jumps, m_a = C phi rho V(mu z), eq. (33). The film's half foot at the wall carries half of it:
    rho phi pi int int v r dr dh = (C phi rho / 2) V(mu z) v_foot.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numba as nb
import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array

ABOVE = 0.003  # m, how far above the face grains beside the foot are dragged along


class Cone(NamedTuple):
    """The jammed cone: how fast it grows with depth, the slope of its side [rad], the scale of its added mass."""

    mu: float = 2.0
    theta: float = math.pi / 3
    C: float = 2.7


@dataclass(frozen=True)
class Flow:
    """R, layer Dz [m]; theta, beta [rad]; mu, C; z_range: depths [m] for which w is needed."""

    R: float
    mu: float
    theta: float
    C: float
    beta: float
    layer: float
    z_range: tuple[float, float]

    @property
    def fade(self) -> float:
        """Length over which the speed below the cone falls by e [m]."""
        return -self.layer / math.log(math.sin(self.beta))

    def cone_depth(self, r: ArrayLike, z: float) -> Array:
        """Depth of the cone's surface below the face [m] at the radii r [m]; 0 beside the foot."""
        h = min(self.mu * z, self.R * math.tan(self.theta))
        return np.clip((self.R - np.asarray(r, dtype=float)) * math.tan(self.theta), 0.0, h)

    def cone_volume(self, z: float) -> float:
        """Volume V(mu z) of the jammed truncated cone of a full disc foot [m^3]."""
        h = min(self.mu * z, self.R * math.tan(self.theta))
        t = math.tan(self.theta)
        return math.pi * h * (self.R**2 - self.R * h / t + h * h / (3 * t * t))

    def moving_volume(self, z: float, w: float, *, reach: float, depth: float = math.inf) -> float:
        """int int (v / v_foot) 2 pi r dr dh [m^3] over r < reach, 0 < h < depth."""
        r = (np.arange(4000) + 0.5) / 4000 * reach
        top = np.minimum(self.cone_depth(r, z), depth)
        tail = np.exp(-((r / w) ** 6)) * self.fade * -np.expm1(-(depth - top) / self.fade)
        return float(np.sum((top + tail) * 2 * math.pi * r) * reach / 4000)

    @cached_property
    def widths(self) -> tuple[Array, Array]:
        """Depths z and cut-off widths w(z) [m] that give the momentum; ValueError where none does."""
        zs = np.linspace(*self.z_range, 60)
        ws = np.empty_like(zs)
        for i, z in enumerate(zs):
            want = self.C * self.cone_volume(z)
            lo, hi = 1e-3, 5 * self.R
            if not self.moving_volume(z, lo, reach=2 * hi) < want < self.moving_volume(z, hi, reach=2 * hi):
                raise ValueError(f"z_range: no cut-off width carries C = {self.C} cones at z = {z:.4f} m")
            for _ in range(50):
                w = 0.5 * (lo + hi)
                lo, hi = (w, hi) if self.moving_volume(z, w, reach=8 * self.R) < want else (lo, w)
            ws[i] = 0.5 * (lo + hi)
        return zs, ws

    def width(self, z: float) -> float:
        """w(z) [m]."""
        return float(np.interp(z, *self.widths))

    def speed(self, r: ArrayLike, h: ArrayLike, z: float) -> Array:
        """Speed / foot speed at r, h [m]."""
        r, h = (np.array(a, dtype=float) for a in np.broadcast_arrays(np.abs(r), h))
        w = self.width(z)
        out = np.empty(r.size)
        _speeds(r.ravel(), h.ravel(), z, w, self.constants, out)
        return out.reshape(r.shape)

    @property
    def constants(self) -> tuple[float, float, float, float]:
        """R, mu, tan(theta) and `fade`, as the compiled functions take them."""
        return self.R, self.mu, math.tan(self.theta), self.fade

    def advect(self, r: Array, y: Array, z0: float, z1: float, *, max_step: float = 5e-5) -> None:
        """Move grains at r, height y [m, up from the undisturbed surface] in place while the face sinks z0 to z1."""
        steps = math.ceil((z1 - z0) / max_step)
        if steps > 0:
            zs, ws = self.widths
            _advect(np.abs(r), y, z0, (z1 - z0) / steps, steps, zs, ws, self.constants)

    def front(self, z: float, share: float) -> float:
        """Thickness below the face, on the axis, that moves at `share` of the foot's speed or more [m]."""
        return float(self.cone_depth(0.0, z)) - self.fade * math.log(share)

    def truth(
        self, z: float, speed: float, *, bed_density: float, left: float, right: float, bottom: float
    ) -> dict[str, float]:
        """Momentum and added mass of a half foot, whole and in a window reaching left, right and bottom [m] from the
        middle of the face (mean of the two half-planes), for a foot at depth z with downward speed [m/s]."""
        w = self.width(z)
        whole = 0.5 * bed_density * self.moving_volume(z, w, reach=8 * self.R)
        seen = 0.25 * bed_density * sum(self.moving_volume(z, w, reach=x, depth=bottom) for x in (left, right))
        return {
            "added_mass_kg": whole,
            "added_mass_in_view_kg": seen,
            "momentum_kg_m_s": whole * speed,
            "momentum_in_view_kg_m_s": seen * speed,
        }


@nb.njit(cache=True)
def _share(r, h, z, w, constants):  # type: ignore[no-untyped-def]
    R, mu, tan_theta, fade = constants
    x = r / w
    cut = math.exp(-(x * x * x * x * x * x))
    if h < 0.0:
        return cut * math.exp(h / ABOVE)
    d = h
    if r < R:
        d = h - min(min(mu * z, R * tan_theta), (R - r) * tan_theta)
        if d <= 0.0:
            return 1.0
    return cut * math.exp(-d / fade)


@nb.njit(cache=True)
def _speeds(r, h, z, w, constants, out):  # type: ignore[no-untyped-def]
    for i in range(len(r)):
        out[i] = _share(r[i], h[i], z, w, constants)


@nb.njit(cache=True)
def _between(z, zs, ws):  # type: ignore[no-untyped-def]
    """np.interp, to the same bits: numba takes a second to compile that."""
    low, high = 0, len(zs) - 1
    if not zs[low] < z < zs[high]:
        return ws[low] if z <= zs[low] else ws[high]
    while high - low > 1:
        middle = (low + high) // 2
        if zs[middle] <= z:
            low = middle
        else:
            high = middle
    return (ws[high] - ws[low]) / (zs[high] - zs[low]) * (z - zs[low]) + ws[low]


@nb.njit(cache=True)
def _advect(r, y, z0, dz, steps, zs, ws, constants):  # type: ignore[no-untyped-def]
    """dy/dz = -share, by the midpoint rule."""
    for s in range(steps):
        z = z0 + s * dz
        w0 = _between(z, zs, ws)
        w1 = _between(z + 0.5 * dz, zs, ws)
        for i in range(len(r)):
            half = y[i] - 0.5 * dz * _share(r[i], -y[i] - z, z, w0, constants)
            y[i] -= dz * _share(r[i], -half - z - 0.5 * dz, z + 0.5 * dz, w1, constants)
