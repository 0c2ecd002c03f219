"""Parameters of every stage: default, unit, meaning and range, in one place and cheap to import."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, TypeVar

from jumpvision.base.schema import InputError, Toml, param, read


@dataclass(frozen=True)
class Params:
    """Parameters of one stage; `stage` is its name, and that of its table [params.<stage>]."""

    stage: ClassVar[str]

    def __init_subclass__(cls) -> None:
        PARAMS[cls.stage] = cls


PARAMS: dict[str, type[Params]] = {}
"""Stage -> its parameters, in the order below."""
P = TypeVar("P", bound=Params)


def of_keywords(cls: type[P], given: Toml, *, folder: tuple[str, ...] = (), **above_0: float | None) -> P:
    """Parameters of a stage from keywords of its function of arrays.

    folder: those that only a folder's stage heeds; above_0: further numbers, None or finite and > 0. Raises InputError.
    """
    table = {k: list(v) if isinstance(v, tuple) else v for k, v in given.items()}
    made, problems = read(cls, table, f"jv.{cls.stage}")
    apart = [n for n in folder if n in given]
    problems += [f"jv.{cls.stage} {n}: not for arrays; it needs a folder (docs/notebook.md)" for n in apart]
    for key, value in above_0.items():
        if value is not None and not 0.0 < value < math.inf:
            problems.append(f"jv.{cls.stage} {key} = {value!r}: must be a finite number > 0")
    if problems:
        raise InputError(problems)
    found: P = made
    return found


@dataclass(frozen=True)
class TrackParams(Params):
    """How the ball is found in each frame."""

    stage: ClassVar[str] = "track"

    polarity: str = param("bright", "", "ball against the background", choices=("bright", "dark"))
    method: str = param(
        "disc",
        "",
        "disc fit, the published threshold and centroid, or template: what is at the seed, be it no plain disc",
        choices=("disc", "threshold", "template"),
    )
    search: float = param(1.5, "ball diameters", "half width of the moving search window", lo=0.6, hi=20.0)
    background: str = param(
        "static", "", "remove the still scene behind the ball, or leave it", choices=("static", "none")
    )
    seed: tuple[float, ...] = param((), "px", "column, row of the ball in the first frame; default: found by search")
    markers: tuple[tuple[float, ...], ...] = param(
        (), "px", "[[column, row], ...] of further balls in the first frame: track_2.csv, track_3.csv ..."
    )
    diameter: float | None = param(None, "px", "ball diameter; default: from [rod_video]", lo=3, hi=2000)
    exposure_correction: str = param(
        "apply",
        "",
        "acceleration during the exposure shifts a height by a T^2/24: leave it, say where it matters, or take it out",
        choices=("none", "report", "apply"),
    )

    def check(self) -> list[str]:
        """A seed is a point, and so is every marker; several balls cannot be told apart without the first's."""
        problems = [f"seed = {list(self.seed)}: must be [column, row]"] if len(self.seed) not in (0, 2) else []
        if any(len(m) != 2 for m in self.markers):
            problems.append(f"markers = {[list(m) for m in self.markers]}: must be [[column, row], ...]")
        if self.method == "template" and not self.seed:
            problems.append('method = "template" follows what is at the seed: give seed = [column, row], first frame')
        if self.markers and not self.seed:
            problems.append("markers are given without a seed: give seed = [column, row] of the ball on the rod, too")
        return problems


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
class BedParams(Params):
    """How the bed surface is found."""

    stage: ClassVar[str] = "bed"

    method: str = param(
        "edge", "", "edge fit in each column, or the published threshold", choices=("edge", "threshold")
    )
    reference_height: float | None = param(
        None,
        "m",
        "bed height at reference_fraction, if V_s is unknown; default: that of a series' first picture",
        lo=0,
        hi=10,
    )
    reference_fraction: float | None = param(None, "", "volume fraction at reference_height", lo=0.3, hi=0.8)


@dataclass(frozen=True)
class PivParams(Params):
    """Windows of the grain matching and validation of its vectors."""

    stage: ClassVar[str] = "piv"

    preset: str = param(
        "default",
        "",
        "fast: about two thirds of the time, 0.003 px more error for particles below 4 px; sharp: twice the time, "
        "keeps waves that are a quarter shorter",
        choices=("default", "fast", "sharp"),
    )
    window: int = param(24, "px", "side of the matched window: a few grains", lo=8, hi=256)
    step: int = param(8, "px", "distance between vectors", lo=1, hi=256)
    gap: int = param(1, "frames", "frames between the two images of a pair", lo=1, hi=100)
    baseline: int = param(
        1,
        "frames",
        "slow flow: pairs 3, 9, ... times as far apart as gap, up to this, are combined with each",
        lo=1,
        hi=100,
    )
    ensemble: int = param(
        1, "pairs", "steady flow: so many consecutive pairs are matched together and give one field", lo=1, hi=64
    )
    passes: tuple[int, ...] = param(
        (64, 32),
        "px",
        "correlation windows where the start fails; the first exceeds twice the largest displacement",
        lo=8,
        hi=1024,
    )
    min_correlation: float = param(0.3, "", "matches below this correlation are replaced", lo=0, hi=1)
    min_texture: float = param(1.0, "grey levels", "windows with less contrast are left out", lo=0, hi=1e4)
    outlier: float = param(2.0, "", "normalised median test: largest residual kept", lo=0.5, hi=20)
    background: str = param(
        "none",
        "",
        "what all frames have in common is subtracted before matching: its minimum or its mean",
        choices=("none", "minimum", "mean"),
    )
    clahe: int = param(
        0, "px", "uneven light: contrast-limited histogram equalisation in tiles of this side; 0: none", lo=0, hi=1024
    )
    smooth: str = param(
        "adaptive",
        "",
        "adaptive: draw vectors together where they differ only by their noise; u_matched and v_matched keep them as "
        "they were, for means and fits",
        choices=("none", "adaptive"),
    )
    backend: str = param(
        "numpy",
        "",
        "where the correlation passes are computed; a GPU needs CuPy or PyTorch",
        choices=("numpy", "cupy", "torch"),
    )
    foot_rows: int = param(16, "px", "rows of the foot's body used to follow its lower face", lo=4, hi=500)

    def check(self) -> list[str]:
        """At least one pass."""
        return [] if self.passes else ["passes = []: must name window sizes, large to small, as [64, 32]"]


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
class PathsParams(Params):
    """Paths of grains through the velocity field."""

    stage: ClassVar[str] = "paths"

    spacing: float = param(0.0, "px", "between the points where paths start; 0: no paths", lo=0, hi=1e4)
    start: int = param(0, "fields", "the field that they start with", lo=0, hi=10**9)


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
class CraterParams(Params):
    """The crater's volume change."""

    stage: ClassVar[str] = "crater"

    radius: float | None = param(
        None, "m", "beyond it the surface is undisturbed; default: found", lo=0, hi=10, open_lo=True
    )


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
