"""Parameters of every stage: default, unit, meaning and range, in one place and cheap to import.

Those of films becoming numbers stand with the functions that take them, in `films.parameters`.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

import jumpvision.films.parameters  # noqa: F401  they are in PARAMS too
from jumpvision.base.parameters import PARAMS as PARAMS
from jumpvision.base.parameters import Params as Params
from jumpvision.base.parameters import of_keywords as of_keywords
from jumpvision.base.schema import param


@dataclass(frozen=True)
class OverlayParams(Params):
    """Film of the track to check by eye."""

    stage: ClassVar[str] = "overlay"

    every: int | None = param(
        None,
        "frames",
        "track.webm shows every n-th frame with the ball found; 0: no film; default: at most 300",
        lo=0,
        hi=10000,
    )


@dataclass(frozen=True)
class FlowParams(Params):
    """Derivatives and the momentum integral."""

    stage: ClassVar[str] = "flow"

    half_width: int = param(1, "vectors", "derivatives are planes over (2 half_width + 1)^2 vectors", lo=1, hi=10)
    initial_depth: float = param(0.0, "m", "foot depth below the undisturbed surface in the first frame", lo=0, hi=1)
    min_speed: float = param(0.05, "m/s", "added mass is left out below this foot speed", lo=0, hi=100)


@dataclass(frozen=True)
class StatisticsParams(Params):
    """Means and fluctuations of a steady flow."""

    stage: ClassVar[str] = "statistics"

    first: float = param(-1e9, "s", "times before are left out (the flow begins)")
    last: float = param(1e9, "s", "times after are left out")


@dataclass(frozen=True)
class ProfilesParams(Params):
    """Lines through the mean flow."""

    stage: ClassVar[str] = "profiles"

    lines: tuple[tuple[float, ...], ...] = param(
        (), "m", "[[x1, y1, x2, y2], ...]: from where to where, in the field's axes (px where it has no scale)"
    )

    def check(self) -> list[str]:
        """Two ends, apart."""
        bad = [k for k, x in enumerate(self.lines) if len(x) != 4 or x[:2] == x[2:]]
        return [f"lines[{k}] = {list(self.lines[k])}: must be [x1, y1, x2, y2], two ends apart" for k in bad]


@dataclass(frozen=True)
class ColumnParams(Params):
    """The central column under the foot and its exponential decay."""

    stage: ClassVar[str] = "column"

    half_width: float = param(0.005, "m", "half width of the central column", lo=0, hi=1, open_lo=True)
    front: float = param(0.9, "", "share of the largest speed that counts as jammed", lo=0.5, hi=0.99)
    floor: float = param(0.1, "", "share of the largest speed below which the decay is not fitted", lo=0.0, hi=0.4)
    clear: float = param(0.002, "m", "vectors so close below the foot's face are left out", lo=0, hi=0.1)
    layer: float = param(0.008, "m", "layer thickness Dz in beta = asin(a^Dz)", lo=0, hi=0.1, open_lo=True)


@dataclass(frozen=True)
class IntrusionParams(Params):
    """Slow intrusion: how the log is cut into strokes, and the cone that its curve is compared with."""

    stage: ClassVar[str] = "intrusion"

    window: float = param(0.05, "s", "speeds are slopes over this time; shorter pauses are not seen", lo=1e-4, hi=10)
    rise: float = param(5e-4, "m", "depth left out after a pause while the force builds up again", lo=0, hi=0.1)
    significance: float = param(0.01, "", "chance below which one slope is refused for two", lo=1e-3, hi=0.5)
    theta: float = param(1.0471975512, "rad", "angle of the fitted cone's mantle", lo=0.1, hi=1.5)


@dataclass(frozen=True)
class FitParams(Params):
    """Fits to tracks, contact logs and velocity fields."""

    stage: ClassVar[str] = "fit"

    critical_fraction: float = param(0.605, "", "critical volume fraction phi_c for the theory values", lo=0.5, hi=0.7)
    debounce: float = param(0.003, "s", "contact flickers shorter than this are ignored", lo=0, hi=0.1)
    shortest_flight: float = param(0.03, "s", "shorter ballistic intervals are not counted as jumps", lo=0, hi=10)
    max_gap: float = param(0.05, "s", "a longer gap in the track ends a flight", lo=0, hi=10, open_lo=True)
    ring_method: str = param(
        "waveform", "", "damping from the whole waveform, or the published peaks", choices=("waveform", "peaks")
    )
    settle: float = param(0.1, "s", "pause after the last landing before the ring-down is fitted", lo=0, hi=10)


@dataclass(frozen=True)
class GeometryParams(Params):
    """Walls, floor and air of the bed."""

    stage: ClassVar[str] = "geometry"

    wall_ratio: float = param(5.0, "", "bed over foot diameter above which the walls do not matter", lo=1, hi=100)
    bottom_constant: float = param(
        7.7e-4, "m^1.5/N^0.5", "C in zeta_b = C sqrt(F_0/r); default from the thesis' 9 cm", lo=0, hi=1, open_lo=True
    )
    bottom_stress: float | None = param(
        None, "Pa", "A over foot area of the floor's force A((1 - exp(rate (zeta_b - h)))^2 - 1)", lo=0, open_lo=True
    )
    bottom_rate: float | None = param(
        None, "1/m", "rate of that force, h the height above the floor", lo=0, open_lo=True
    )
    stiffness: float = param(
        4.6e5,
        "N/m^3",
        "static resistance over foot area and depth, where no model gives it",
        lo=0,
        hi=1e9,
        open_lo=True,
    )
    air_viscosity: float = param(1.82e-5, "Pa s", "of the air", lo=0, hi=1, open_lo=True)
    air_density: float = param(1.2, "kg/m^3", "of the air", lo=0, hi=1e4, open_lo=True)


@dataclass(frozen=True)
class SimulateParams(Params):
    """Integration of the model."""

    stage: ClassVar[str] = "simulate"

    tolerance: float = param(1e-7, "", "relative tolerance of the integrator", lo=1e-12, hi=1e-2)
    driver: str = param(
        "auto", "", "what drives the motor: log, law, or the law where both agree", choices=("auto", "log", "law")
    )
    encoder_step: float = param(6.25e-6, "m", "resolution of the motor log", lo=0, hi=1e-2, open_lo=True)
