"""Discs, the law between them, their box and the foot that pushes them (docs/physics.md section 5, thesis Fig. 53).

x [m] right, y [m] up; the foot's axis is x = 0. Two dimensions: masses are those of the discs as the caller sets them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array


@dataclass(frozen=True)
class Discs:
    """Centres x, y [m], radius [m], mass [kg] and velocity vx, vy [m/s] of n discs, each of shape (n,).

    spin (n,) [rad/s], anticlockwise: 0 where it is not given.
    """

    x: Array
    y: Array
    radius: Array
    mass: Array
    vx: Array
    vy: Array
    spin: Array = field(default_factory=lambda: np.zeros(()))

    def __post_init__(self) -> None:
        if np.ndim(self.spin) == 0:
            object.__setattr__(self, "spin", np.full(np.shape(self.x), float(self.spin)))
        for name in ("x", "y", "radius", "mass", "vx", "vy", "spin"):
            values = np.asarray(getattr(self, name), dtype=float)
            if values.ndim != 1 or values.shape != np.shape(self.x):
                raise ValueError(f"Discs: {name} has shape {values.shape}, x has {np.shape(self.x)}; all must be (n,)")
            positive = name in ("radius", "mass")
            if not np.all(np.isfinite(values)) or (positive and not np.all(values > 0.0)):
                raise ValueError(f"Discs: {name} must be finite{' and positive' if positive else ''} for every disc")
            object.__setattr__(self, name, values)

    @classmethod
    def at_rest(cls, x: ArrayLike, y: ArrayLike, radius: ArrayLike, *, density: float) -> Discs:
        """Resting discs of mass density pi r^2, density in kg/m^2."""
        x, y, radius = (np.asarray(a, dtype=float) for a in np.broadcast_arrays(x, y, radius))
        return cls(x, y, radius, density * math.pi * radius**2, np.zeros(x.shape), np.zeros(x.shape))


@dataclass(frozen=True)
class Law:
    """Forces on the discs; a term is switched off by 0.

    stiffness k [N/m] and damping gamma [1/s] of a contact (dashpot gamma m_eff); viscous [1/s]: drag -viscous m v and
    coulomb [m/s^2]: sliding friction -coulomb m v/|v|, set-valued at rest ("grains on a carpet"); gravity [m/s^2] down.
    friction: coefficient mu of Coulomb friction in every contact, also with walls and foot; with it the discs turn
    (`friction`). The carpet does not act on the spin.
    """

    stiffness: float
    damping: float = 0.0
    viscous: float = 0.0
    coulomb: float = 0.0
    gravity: float = 0.0
    friction: float = 0.0

    def __post_init__(self) -> None:
        for name in ("stiffness", "damping", "viscous", "coulomb", "friction"):
            value = getattr(self, name)
            if not (math.isfinite(value) and value >= 0.0) or (name == "stiffness" and value == 0.0):
                raise ValueError(
                    f"Law: {name} = {value!r} must be a finite number {'>' if name == 'stiffness' else '>='} 0"
                )

    @classmethod
    def bouncing(cls, restitution: float, duration: float, mass: float, **others: float) -> Law:
        """The law whose contact of reduced mass [kg] lasts `duration` [s] and returns `restitution` of the speed.

        Between the touch and the moment the overlap is zero again the linear contact is half a damped oscillation:
        restitution = exp(-gamma duration/2), duration = pi/sqrt(k/m - gamma^2/4).
        """
        if not (0.0 < restitution <= 1.0 and duration > 0.0 and mass > 0.0):
            raise ValueError(
                f"Law: restitution = {restitution!r} must be in (0, 1], duration = {duration!r} and mass = {mass!r} > 0"
            )
        damping = -2.0 * math.log(restitution) / duration
        return cls(mass * ((math.pi / duration) ** 2 + 0.25 * damping**2), damping, **others)

    def contact_time(self, mass: float) -> float:
        """Duration [s] of a collision of reduced mass [kg]; ValueError where the contact is overdamped."""
        w2 = self.stiffness / mass - 0.25 * self.damping**2
        if not w2 > 0.0:
            critical = 2.0 * math.sqrt(self.stiffness / mass)
            raise ValueError(f"Law: damping = {self.damping:g} 1/s is at or above the critical {critical:g}")
        return math.pi / math.sqrt(w2)


@dataclass(frozen=True)
class Box:
    """Straight walls [m], which act as discs of infinite mass and size; infinite: no wall."""

    left: float = -math.inf
    right: float = math.inf
    bottom: float = -math.inf
    top: float = math.inf


@dataclass(frozen=True)
class Plate:
    """Flat foot: |x| <= half_width, from its lower face up to `height` above it [m]."""

    half_width: float
    height: float


@dataclass(frozen=True)
class Block:
    """Foot of intruder grains: x from the axis, y above the height of the foot's face, radius [m], each (m,).

    A row of grains whose lowest points lie on the face has y = radius.
    """

    x: Array
    y: Array
    radius: Array

    @classmethod
    def row(cls, half_width: float, radius: float, layers: int = 2) -> Block:
        """Touching grains of one size across the foot, in `layers` rows set square."""
        n = max(1, round(half_width / radius))
        x = (np.arange(n) - 0.5 * (n - 1)) * 2.0 * radius
        x, y = np.meshgrid(x, radius * (1.0 + 2.0 * np.arange(layers)))
        return cls(x.ravel(), y.ravel(), np.full(x.size, radius))
