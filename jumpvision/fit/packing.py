"""Growth of the jammed cone from the packing alone (PHYSICS.md section 2, thesis eqs. 29 and 30)."""

from __future__ import annotations

import math
from dataclasses import dataclass

BETA_JAMMED = math.asin(math.sqrt(2.0 / 3.0))  # rad: regular tetrahedra of frictionless spheres, 54.74 deg


@dataclass(frozen=True)
class Packing:
    """Contact angles [rad] against the horizontal and growth rate mu = d z_jammed / d z of the jammed front."""

    beta_jammed: float
    beta_unjammed: float
    beta: float
    mu: float


def cone_growth(volume_fraction: float, critical: float) -> Packing:
    """mu = (1 - sin beta)/(phi_c/phi - 1), beta the mean of the jammed and the unjammed contact angle (eq. 30).

    volume_fraction: phi of the bed, below critical = phi_c (0.605 for poppy seeds): a bed at or above phi_c does not
    consolidate and eq. (30) has no value. ValueError then, and below phi_c sqrt(2/3), without unjammed angle.
    """
    low = critical * math.sin(BETA_JAMMED)
    if not (0.0 < critical < 1.0 and low <= volume_fraction < critical):
        raise ValueError(
            f"cone_growth: volume_fraction = {volume_fraction:g} must be in [{low:.3f}, {critical:g}) "
            f"for critical = {critical:g}: eq. (30) describes a bed looser than its critical packing"
        )
    ratio = critical / volume_fraction
    unjammed = math.asin(min(1.0, ratio * math.sin(BETA_JAMMED)))
    beta = 0.5 * (BETA_JAMMED + unjammed)
    return Packing(BETA_JAMMED, unjammed, beta, (1.0 - math.sin(beta)) / (ratio - 1.0))
