"""Results that are a few numbers, in JSON: the bed, intrusions, springs, every fit, the summary."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Generic, Required, Self, TypeAlias, TypedDict, TypeVar

from jumpvision.base.record import Record, plain
from jumpvision.base.schema import WarningRecord
from jumpvision.experiment import files

if TYPE_CHECKING:
    import numpy as np
    import pandas as pd
    from numpy.typing import NDArray

    from jumpvision.estimate.estimate import Estimate


V = TypeVar("V")
Column: TypeAlias = "NDArray[np.number] | Sequence[float | None]"  # (n,); None for NaN in a file


@dataclass(frozen=True)
class Values(Record, Generic[V]):
    """A JSON object; NaN is written as null. V: what is in it, by key."""

    values: V

    def save(self, folder: Path) -> None:
        (folder / self.file).write_text(json.dumps(plain(self.values), indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, folder: Path) -> Self:
        return cls(json.loads((folder / cls.file).read_text(encoding="utf-8")))


class DoubtValues(TypedDict):
    """doubts.json."""

    warnings: list[WarningRecord]


class Doubts(Values[DoubtValues]):
    """What is suspicious in an experiment's recordings and in what is declared."""

    file = "doubts.json"


class BedProfile(TypedDict):
    """The surface, a value a column of the picture: as seen [px], and in metres over the floor."""

    column_px: Column
    row_px: Column
    sigma_px: Column
    x_m: Column
    height_m: Column


class BedValues(TypedDict, total=False):
    """bed.json, of the picture that counts; the volume fraction None where it is not known."""

    height_m: Required[float]
    sigma_m: Required[float]
    sigma_common_m: Required[float]
    volume_fraction: Required[float | None]
    sigma_volume_fraction: Required[float | None]
    sigma_common_volume_fraction: Required[float | None]
    tilt_rad: Required[float]
    roughness_m: Required[float]
    columns: Required[int]
    picture: Required[int]
    profile: Required[BedProfile]
    series: dict[str, Column]  # of every picture: heights, packings, changes since the first


class BedHeight(Values[BedValues]):
    """Bed height [m], volume fraction and the surface profile, each with its standard uncertainty."""

    file = "bed.json"


class LaserLine(TypedDict):
    """Where the laser line was seen [px], of every column."""

    column_px: Column
    row_px: Column
    sigma_px: Column


class CraterProfile(TypedDict):
    """Height [m] against distance from the axis [m], below zero on the left of it; None where nothing was seen."""

    r_m: Column
    height_m: Column
    sigma_m: Column


class CraterValues(TypedDict, total=False):
    """crater.json; the bed's volume fraction None where it is not known, the line only where there was one."""

    volume_m3: Required[float]
    sigma_m3: Required[float]
    sigma_common_m3: Required[float]
    noise_sigma_m3: Required[float]
    half_difference_m3: Required[float | None]
    depth_m: Required[float]
    rim_height_m: Required[float]
    radius_m: Required[float]
    axis_m: Required[Sequence[float]]
    volume_fraction: Required[float | None]
    sigma_volume_fraction: Required[float | None]
    sigma_common_volume_fraction: Required[float | None]
    profile: Required[CraterProfile]
    line: LaserLine


class CraterShape(Values[CraterValues]):
    """Volume change of a crater [m^3] (negative: compacted), its depth and profile, and the bed's volume fraction."""

    file = "crater.json"


class Checked(TypedDict):
    """A check of the bed: a value against its limit (both in `unit`), and what it means in words."""

    check: str
    value: float
    limit: float
    unit: str
    ok: bool
    text: str


class DropTerms(TypedDict):
    """Terms of a law of the pressure drop a metre of bed: of the speed [Pa s/m^2] and of its square [Pa s^2/m^3]."""

    viscous: float
    inertial: float


class Fluidisation(TypedDict, total=False):
    """Air through the bed after Ergun and after Wu; of the fan what its curve and the bed's height allow."""

    onset_ergun_m_s: Required[float]
    onset_wu_m_s: Required[float]
    bed_weight_Pa_m: Required[float]
    bed_weight_Pa: Required[float | None]
    tortuosity: Required[float]
    laws: Required[dict[str, DropTerms]]
    fan_speed_m_s: float | None  # None beyond the end of the curve
    fan_pressure_Pa: float
    fluidised: bool


class GeometryValues(TypedDict):
    """geometry.json; None where the folder does not say."""

    findings: list[Checked]
    bed_height_m: float | None
    volume_fraction: float | None
    fluidisation: Fluidisation | None


class Geometry(Values[GeometryValues]):
    """Walls, floor and fluidisation of the bed: findings with value, limit and meaning; speeds, pressures."""

    file = "geometry.json"


Entry = dict[str, float | str | int | None]  # of a fit: value, sigma, sigma_common, unit, n, chi2, reason


@dataclass(frozen=True)
class Fits(Record):
    """Every fit by name, as an Estimate: fits["mu"].value, .sigma; .sigma_common: that experiments share."""

    estimates: Mapping[str, Estimate]

    file = files.FITS

    def __getitem__(self, name: str) -> Estimate:
        return self.estimates[name]

    def get(self, name: str) -> Estimate | None:
        """The fit of this name; None where the data did not ask for it."""
        return self.estimates.get(name)

    def determined(self, name: str) -> Estimate | None:
        """The fit of this name; None too where the data do not allow it."""
        found = self.estimates.get(name)
        return found if found is not None and found.known else None

    @property
    def values(self) -> dict[str, Entry]:
        """As in the file: {name: {value, sigma, sigma_common, unit, n, chi2}}, null with its reason."""
        return {k: e.entry() for k, e in self.estimates.items()}

    @property
    def table(self) -> pd.DataFrame:
        """One row a fit: value, sigma, sigma_common, unit, n, chi2."""
        from jumpvision.estimate.estimate import table_of

        return table_of(self.estimates)

    def save(self, folder: Path) -> None:
        (folder / self.file).write_text(json.dumps(self.values, indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, folder: Path) -> Self:
        return cls.of(json.loads((folder / cls.file).read_text(encoding="utf-8")))

    @classmethod
    def of(cls, entries: Mapping[str, Entry]) -> Self:
        """From what a file holds."""
        from jumpvision.estimate.estimate import Estimate

        return cls({k: Estimate.of_entry(e) for k, e in entries.items()})


class IntrusionProfile(TypedDict):
    """Means over bins of depth below the surface; event: that which a bin follows, -1 for none."""

    depth_m: Column
    force_N: Column
    event: Column
    fitted_N: Column
    first_N: Column


class IntrusionEvent(TypedDict):
    """A pause or a withdrawal, and the overshoot after it."""

    kind: str
    depth_m: float
    pause_s: float
    overshoot_N: float
    sigma_N: float


class ConeValues(TypedDict):
    """The cone of resistive force theory as fitted: its parameters, and its force over the bins with its parts."""

    k1: float
    sigma_cone: float
    mu: float
    theta_rad: float
    foot_radius_m: float
    complete_depth_m: float
    log_odds: float
    force_N: Column
    flat_N: Column
    mantle_N: Column


class IntrusionValues(TypedDict):
    """intrusion.json; delta_ci95_m: of the bend, null where there is none; the cone None without the foot's radius."""

    fits: dict[str, Entry]
    p_one_slope: float
    delta_ci95_m: list[float]
    noise: dict[str, float]
    profile: IntrusionProfile
    events: list[IntrusionEvent]
    first_intrusion: str
    cone: ConeValues | None


class Intrusion(Values[IntrusionValues]):
    """Force against depth of a slow intrusion: fits, averaged profile, events, the cone's prediction."""

    file = "intrusion.json"

    @property
    def fits(self) -> Fits:
        """Its fits, which stand in fits.json too."""
        return Fits.of(self.values["fits"])


class SpringProfile(TypedDict):
    """Every sample; direction: 1 while the displacement grows, -1 while it falls, 0 about a turning point."""

    displacement_m: Column
    force_N: Column
    direction: Column
    fitted_N: Column


class SpringValues(TypedDict):
    """spring.json."""

    fits: dict[str, Entry]
    profile: SpringProfile


class SpringTest(Values[SpringValues]):
    """Force against displacement of the spring: stiffness, hysteresis, curvature, and the record with its line."""

    file = "spring.json"

    @property
    def fits(self) -> Fits:
        """Its fits, which stand in fits.json too."""
        return Fits.of(self.values["fits"])
