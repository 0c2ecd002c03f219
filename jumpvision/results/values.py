"""Results that are a few numbers, in JSON: the bed, intrusions, springs, every fit, the summary."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from . import Record, plain

if TYPE_CHECKING:
    import pandas as pd


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


class CraterShape(Values):
    """Volume change of a crater [m^3] (negative: compacted), its depth and profile, and the bed's volume fraction."""

    file = "crater.json"


class Geometry(Values):
    """Walls, floor and fluidisation of the bed: findings with value, limit and meaning; speeds, pressures."""

    file = "geometry.json"


class Intrusion(Values):
    """Force against depth of a slow intrusion: fits, averaged profile, events, the cone's prediction."""

    file = "intrusion.json"


class SpringTest(Values):
    """Force against displacement of the spring: stiffness, hysteresis, curvature, and the record with its line."""

    file = "spring.json"


class Fits(Values):
    """Every fit: {name: {value, sigma, sigma_common, unit, n, chi2}}, sigma_common the part that experiments share."""

    file = "fits.json"

    @property
    def table(self) -> pd.DataFrame:
        """One row a fit: value, sigma, sigma_common, unit, n, chi2."""
        import pandas as pd

        return pd.DataFrame.from_dict(self.values, orient="index")


class Summary(Values):
    """One experiment in a few numbers; null where unknown."""

    file = "summary.json"
