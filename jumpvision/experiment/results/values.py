"""Results that are a few numbers, in JSON: the bed, intrusions, springs, every fit, the summary."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Required, Self, TypedDict, cast

from jumpvision.experiment import files

from . import Record, plain

if TYPE_CHECKING:
    import pandas as pd

    from jumpvision.estimate.estimate import Estimate


@dataclass(frozen=True)
class Values(Record):
    """A JSON object; NaN is written as null."""

    values: dict[str, Any]

    def save(self, folder: Path) -> None:
        (folder / self.file).write_text(json.dumps(plain(self.values), indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, folder: Path) -> Self:
        return cls(json.loads((folder / cls.file).read_text(encoding="utf-8")))


class BedHeight(Values):
    """Bed height [m], volume fraction and the surface profile, each with its standard uncertainty."""

    file = "bed.json"


class LaserLine(TypedDict):
    """Where the laser line was seen [px], of every column."""

    column_px: list[float]
    row_px: list[float | None]
    sigma_px: list[float | None]


class CraterProfile(TypedDict):
    """Height [m] against distance from the axis [m], below zero on the left of it; None where nothing was seen."""

    r_m: list[float]
    height_m: list[float | None]
    sigma_m: list[float | None]


class CraterValues(TypedDict, total=False):
    """crater.json; the bed's volume fraction None where it is not known, the line only where there was one."""

    volume_m3: Required[float]
    sigma_m3: Required[float]
    depth_m: Required[float]
    rim_height_m: Required[float]
    radius_m: Required[float]
    axis_m: Required[list[float]]
    profile: Required[CraterProfile]
    line: LaserLine


class CraterShape(Values):
    """Volume change of a crater [m^3] (negative: compacted), its depth and profile, and the bed's volume fraction."""

    file = "crater.json"

    @property
    def shape(self) -> CraterValues:
        """What pictures show of what the file holds, as its type."""
        return cast(CraterValues, self.values)


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


class Geometry(Values):
    """Walls, floor and fluidisation of the bed: findings with value, limit and meaning; speeds, pressures."""

    file = "geometry.json"

    @property
    def checked(self) -> GeometryValues:
        """What the file holds, as its type."""
        return cast(GeometryValues, self.values)


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

    def known(self, name: str) -> Estimate | None:
        """The same; None too where the data do not allow it."""
        found = self.estimates.get(name)
        return found if found is not None and found.known else None

    @property
    def values(self) -> dict[str, dict[str, float | str | int | None]]:
        """As in the file: {name: {value, sigma, sigma_common, unit, n, chi2}}, null with its reason."""
        return {k: e.entry() for k, e in self.estimates.items()}

    @property
    def table(self) -> pd.DataFrame:
        """One row a fit: value, sigma, sigma_common, unit, n, chi2."""
        import pandas as pd

        return pd.DataFrame.from_dict(self.values, orient="index")

    def save(self, folder: Path) -> None:
        (folder / self.file).write_text(json.dumps(self.values, indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, folder: Path) -> Self:
        return cls.of(json.loads((folder / cls.file).read_text(encoding="utf-8")))

    @classmethod
    def of(cls, entries: Mapping[str, Mapping[str, float | str | int | None]]) -> Self:
        """From what a file holds."""
        from jumpvision.estimate.estimate import Estimate

        return cls({k: Estimate.of_entry(e) for k, e in entries.items()})


class Tested(Values):
    """A test with `fits` of its own, which stand in fits.json too."""

    @property
    def fits(self) -> Fits:
        """Its fits."""
        return Fits.of(self.values["fits"])


class Intrusion(Tested):
    """Force against depth of a slow intrusion: fits, averaged profile, events, the cone's prediction."""

    file = "intrusion.json"


class SpringTest(Tested):
    """Force against displacement of the spring: stiffness, hysteresis, curvature, and the record with its line."""

    file = "spring.json"
