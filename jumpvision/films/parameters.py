"""What a user may set where films become numbers: default, unit, meaning and range, in one place, cheap to import."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from jumpvision.base.parameters import Params
from jumpvision.base.schema import param

LARGEST_PASS = 1024  # px, side of a correlation window: larger ones fill the memory
SMALLEST_BALL = 6.0  # px: below it neither the fit nor the search has enough rim


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
    diameter: float | None = param(None, "px", "ball diameter; default: from [rod_video]", lo=SMALLEST_BALL, hi=2000)
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
class BedParams(Params):
    """How the bed surface is found."""

    stage: ClassVar[str] = "bed"

    method: str = param(
        "edge", "", "edge fit in each column, or the published threshold", choices=("edge", "threshold")
    )
    threshold: float | None = param(
        None, "grey levels", 'of method "threshold": darker pixels are grains; default: Otsu\'s', lo=0, hi=1e6
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
        hi=LARGEST_PASS,
    )
    min_correlation: float = param(0.3, "", "matches below this correlation are replaced", lo=0, hi=1)
    min_texture: float = param(1.0, "grey levels", "windows with less contrast are left out", lo=0, hi=1e4)
    outlier: float = param(2.0, "", "normalised median test: largest residual kept", lo=0.5, hi=20)
    background: str = param(
        "none",
        "",
        "what all frames have in common is subtracted before matching: its minimum (of dark particles the maximum) or "
        "its mean (of sparse particles in few frames the median)",
        choices=("none", "minimum", "mean"),
    )
    clahe: int = param(
        0, "px", "uneven light: contrast-limited histogram equalisation in tiles of this side; 0: none", lo=0, hi=1024
    )
    smooth: str = param(
        "adaptive",
        "",
        "adaptive: smooth vectors where they differ only by their noise; u_matched and v_matched keep the unsmoothed "
        "ones, for means and fits",
        choices=("none", "adaptive"),
    )
    foot_rows: int = param(16, "px", "rows of the foot's body used to follow its lower face", lo=4, hi=500)

    def check(self) -> list[str]:
        """At least one pass."""
        return [] if self.passes else ["passes = []: must name window sizes, large to small, as [64, 32]"]


@dataclass(frozen=True)
class CraterParams(Params):
    """The crater's volume change."""

    stage: ClassVar[str] = "crater"

    radius: float | None = param(
        None, "m", "beyond it the surface is undisturbed; default: found", lo=0, hi=10, open_lo=True
    )
    contrast: float = param(
        0.2, "", "a column whose contrast is below this share of the typical one has no laser line", lo=0, hi=1
    )
