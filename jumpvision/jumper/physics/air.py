"""The bed: air through its grains, and whether it is large enough for its foot (thesis section 3.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array


@dataclass(frozen=True)
class Drop:
    """Pressure drop over height dP/L = viscous v + inertial v^2 [Pa/m], v the superficial air speed [m/s]."""

    viscous: float
    inertial: float

    def __call__(self, v: ArrayLike) -> Array:
        v = np.asarray(v, dtype=float)
        return self.viscous * v + self.inertial * v**2

    def speed(self, gradient: float) -> float:
        """The air speed [m/s] at which dP/L = gradient [Pa/m]."""
        a, b = self.viscous, self.inertial
        return 2.0 * gradient / (a + math.sqrt(a * a + 4.0 * b * gradient))


def ergun(volume_fraction: float, diameter: float, *, viscosity: float, density: float) -> Drop:
    """Ergun 1952 (thesis eq. 16): 150 mu (1 - e)^2/(d^2 e^3) and 1.75 (1 - e) rho/(e^3 d); porosity e = 1 - phi.

    diameter [m] of a grain; viscosity [Pa s] and density [kg/m^3] of the air.
    """
    e = _porosity(volume_fraction)
    return Drop(150.0 * viscosity * (1.0 - e) ** 2 / (diameter**2 * e**3), 1.75 * (1.0 - e) / e**3 * density / diameter)


def wu(volume_fraction: float, diameter: float, *, viscosity: float, density: float) -> Drop:
    """Wu et al. 2008 (thesis eq. 17), without empirical constants; arguments as `ergun`.

    72 mu tau (1 - e)^2/(d^2 e^3) and 3 tau (1 - e) rho (3/2 + 1/beta^4 - 5/(2 beta^2))/(4 d e^3), with the pore to
    throat ratio beta = 1/(1 - sqrt(1 - e)) and the tortuosity tau.
    """
    e = _porosity(volume_fraction)
    tau, beta = tortuosity(e), 1.0 / (1.0 - math.sqrt(1.0 - e))
    shape = 1.5 + beta**-4 - 2.5 * beta**-2
    return Drop(
        72.0 * viscosity * tau * (1.0 - e) ** 2 / (diameter**2 * e**3),
        3.0 * tau * (1.0 - e) * density * shape / (4.0 * diameter * e**3),
    )


def tortuosity(porosity: float) -> float:
    """Length of the air's path over the height of the bed (Yu and Li 2004, Chin. Phys. Lett. 21, 1569), >= 1.

    tau = [1 + s/2 + s sqrt((1/s - 1)^2 + 1/4)/(1 - s)]/2 with s = sqrt(1 - porosity).
    """
    s = math.sqrt(1.0 - porosity)
    return 0.5 * (1.0 + 0.5 * s + s * math.sqrt((1.0 / s - 1.0) ** 2 + 0.25) / (1.0 - s)) if s else 1.0


def bed_weight(volume_fraction: float, grain_density: float, gravity: float) -> float:
    """Weight of the bed over its area and height, rho phi g [Pa/m]: the pressure gradient that lifts the grains."""
    return grain_density * volume_fraction * gravity


def operating_point(
    drop: Drop, height: float, weight: float, speed: ArrayLike, pressure: ArrayLike, *, loss: float = 0.0
) -> tuple[float, float, bool]:
    """(air speed [m/s], pressure [Pa], fluidised) where the fan's curve crosses what bed and duct need.

    height [m] and weight [Pa/m] of the bed: it needs height times `drop`, and never more than its weight, which is
    where the grains are lifted. loss [Pa s^2/m^2]: of duct and distributor, per speed squared. speed, pressure: the
    fan's curve, shape (n,), speed increasing [m/s through the bed's area], straight between the points and not
    continued beyond them. NaN where the curves do not cross within it.
    """
    v, p = np.asarray(speed, float), np.asarray(pressure, float)

    def spare(at: float) -> float:
        need = min(height * float(drop(at)), height * weight) + loss * at**2
        return float(np.interp(at, v, p)) - need

    left = np.array([spare(float(a)) for a in v])
    k = np.flatnonzero((left[:-1] >= 0.0) & (left[1:] < 0.0))
    onset = drop.speed(weight)
    if k.size == 0:
        return math.nan, math.nan, bool(left.min() >= 0.0 and v[-1] >= onset)
    at = float(scipy.optimize.brentq(spare, v[k[-1]], v[k[-1] + 1]))
    return at, float(np.interp(at, v, p)), at >= onset


def bottom_height(force: float, radius: float, constant: float) -> float:
    """zeta_b = C sqrt(F_0/r) [m]: height above the floor from which a plate feels it (thesis section 3.1).

    force = F_0 [N]: what the plate of this radius [m] would feel at the floor's depth if there were none; constant = C
    [m^(3/2) N^(-1/2)].
    """
    return constant * math.sqrt(force / radius)


def bottom_force(height: ArrayLike, zeta: float, force: float, rate: float) -> Array:
    """What a floor adds [N] to the force on a plate at a height (...) [m] above it (Stone et al. 2004, thesis 3.2.1).

    force ((1 - exp(rate (zeta - height)))^2 - 1): nothing far away, least (-force) at zeta [m], steep below it. The
    thesis calls `force` the plate's area; it is a force [N], which grows with the area. rate [1/m].
    """
    return np.asarray(force * (np.expm1(rate * (zeta - np.asarray(height, float))) ** 2 - 1.0))


def _porosity(volume_fraction: float) -> float:
    if not 0.0 < volume_fraction < 1.0:
        raise ValueError(f"volume_fraction = {volume_fraction!r} must be in (0, 1)")
    return 1.0 - volume_fraction


@dataclass(frozen=True)
class Finding:
    """One check: a value against its limit (both in `unit`), and what it means in words."""

    check: str
    value: float
    limit: float
    unit: str
    ok: bool
    text: str


def side_walls(length: float, width: float, radius: float, *, ratio: float) -> list[Finding]:
    """Bed over foot diameter D/d against `ratio` (Seguin et al.: no effect above about 5), and foot to wall [m].

    length, width of the bed and radius of the foot [m]; the foot stands in the middle.
    """
    shorter, diameter = min(length, width), 2.0 * radius
    room = 0.5 * (shorter - diameter)
    least = 0.5 * (ratio - 1.0) * diameter
    return [
        Finding(
            "bed/foot diameter",
            shorter / diameter,
            ratio,
            "",
            shorter / diameter > ratio,
            f"the bed is {shorter / diameter:.2f} foot diameters wide; above {ratio:g} the walls do not matter",
        ),
        Finding(
            "foot to wall",
            room,
            least,
            "m",
            room > least,
            f"{room * 1e3:.0f} mm from the foot's rim to the nearest wall; {least * 1e3:.0f} mm are wanted",
        ),
    ]


def floor(
    height: float,
    force_at_floor: float,
    radius: float,
    depth: float,
    *,
    constant: float,
    law: tuple[float, float] | None = None,
) -> Finding:
    """Depth at which the floor begins to be felt, height - zeta_b, against the depth [m] that the foot reaches.

    height of the bed [m]; force_at_floor = F_0 [N], the unbounded static force at that depth; constant as in
    `bottom_height`. law: stress [Pa] and rate [1/m] of `bottom_force`, whose value at the depth is told.
    """
    zeta = bottom_height(force_at_floor, radius, constant)
    free = height - zeta
    at_floor = ""
    if law is not None:
        stress, rate = law
        added = float(bottom_force(height - depth, zeta, stress * math.pi * radius**2, rate))
        at_floor = f", where the floor adds {added:.2g} N"
    return Finding(
        "depth before the floor is felt",
        free,
        depth,
        "m",
        free > depth,
        f"the floor is felt from {max(free, 0.0) * 1e3:.0f} mm depth on (zeta_b = {zeta * 1e3:.0f} mm above it); the "
        f"foot reaches about {depth * 1e3:.0f} mm{at_floor}",
    )


def pulse(speed: float, onset: float) -> Finding:
    """Whether air pulses stay below the onset of fluidisation, both speeds in m/s; above, they loosen the bed again."""
    return Finding(
        "air pulses' speed",
        speed,
        onset,
        "m/s",
        speed < onset,
        f"pulses of {speed:.3f} m/s pack the bed; from {onset:.3f} m/s on they would fluidise it and start anew",
    )
