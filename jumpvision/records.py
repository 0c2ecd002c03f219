"""What the stages hand on: one class a result file, with its columns, units and reading and writing.

A record holds its data in the form users know: `.table` (pandas), `.field` (xarray) or `.values` (plain dict).
"""

from __future__ import annotations

import json
import math
from abc import ABC, abstractmethod
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


class RecordError(ValueError):
    """A result file does not hold what its record declares."""


class Record(ABC):
    """A result with a file name; `save` writes the file into a folder, `load` reads it back unchanged."""

    file: ClassVar[str]

    @abstractmethod
    def save(self, folder: Path) -> None:
        """Write the file into `folder`."""

    @classmethod
    @abstractmethod
    def load(cls, folder: Path) -> Self:
        """Read it back from `folder`."""


@dataclass(frozen=True)
class Table(Record):
    """A CSV table; floats are written so that they read back bit for bit."""

    table: pd.DataFrame
    columns: ClassVar[tuple[str, ...]]

    def __post_init__(self) -> None:
        missing = [c for c in self.columns if c not in self.table.columns]
        if missing:
            raise RecordError(f"{self.file}: columns missing: {missing}")

    def save(self, folder: Path) -> None:
        self.table.to_csv(folder / self.file, index=False, lineterminator="\n")

    @classmethod
    def load(cls, folder: Path) -> Self:
        import pandas as pd

        return cls(pd.read_csv(folder / cls.file, float_precision="round_trip", keep_default_na=True))


@dataclass(frozen=True)
class Field(Record):
    """A NetCDF data set over (y, x, t); x right, y up, SI unless the scale is unknown (see the units attributes)."""

    field: xr.Dataset

    def save(self, folder: Path) -> None:
        encoding = {v: {"zlib": True, "complevel": 1} for v, d in self.field.data_vars.items() if d.ndim == 3}
        self.field.to_netcdf(folder / self.file, engine="netcdf4", encoding=encoding)

    @classmethod
    def load(cls, folder: Path) -> Self:
        import xarray as xr

        with xr.open_dataset(folder / cls.file, engine="netcdf4", decode_times=False) as d:
            return cls(d.load())


@dataclass(frozen=True)
class Values(Record):
    """A JSON object; NaN is written as null."""

    values: dict[str, Any]

    def save(self, folder: Path) -> None:
        (folder / self.file).write_text(json.dumps(plain(self.values), indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, folder: Path) -> Self:
        return cls(json.loads((folder / cls.file).read_text(encoding="utf-8")))


@dataclass(frozen=True)
class Track(Table):
    """Rod marker, one row a frame; times at mid-exposure; a flagged row holds NaN. others: the same of further balls,
    in track_2.csv, track_3.csv ..."""

    others: tuple[pd.DataFrame, ...] = ()

    file = "track.csv"
    columns = ("frame", "time_s", "x_px", "y_px", "sigma_px", "height_m", "sigma_m", "flag")

    def save(self, folder: Path) -> None:
        super().save(folder)
        for k, table in enumerate(self.others, 2):
            table.to_csv(folder / f"track_{k}.csv", index=False, lineterminator="\n")

    @classmethod
    def load(cls, folder: Path) -> Self:
        import pandas as pd

        first = super().load(folder).table
        files = sorted(folder.glob("track_[0-9]*.csv"), key=lambda f: int(f.stem[6:]))
        return cls(first, tuple(pd.read_csv(f, float_precision="round_trip") for f in files))

    @property
    def good(self) -> pd.DataFrame:
        """The rows without a flag."""
        flag = self.table.flag
        return self.table[flag.isna() | (flag.astype(str) == "")]


class RodMotion(Table):
    """Height of the rod [m] against time, zero at rest, only where it is known."""

    file = "rod.csv"
    columns = ("time_s", "height_m", "sigma_m")

    @property
    def arrays(self) -> tuple[Any, Any, Any]:
        """time [s], height [m], sigma [m] as numpy arrays."""
        return tuple(self.table[c].to_numpy(float) for c in self.columns)


class BedHeight(Values):
    """Bed height [m], volume fraction and the surface profile, each with its standard uncertainty."""

    file = "bed.json"


class Piv(Field):
    """Velocity field (pivpy schema 1) with uncertainties and a reason for every invalid vector."""

    file = "piv.nc"


class Flow(Field):
    """Shear rate, vorticity, divergence over (y, x, t); momentum, added mass and foot motion over t."""

    file = "flow.nc"


class Column(Field):
    """Speed profile under the foot over (y, t), its jammed front and exponential decay over t."""

    file = "column.nc"


class Fits(Values):
    """Every fit: {name: {value, sigma, unit, n, chi2}}."""

    file = "fits.json"


class Simulation(Table):
    """The simulated jump at the measured times: x_r, x_f, x_m [m] absolute (x up), forces [N]."""

    file = "simulation.csv"
    columns = ("time_s", "rod_m", "foot_m", "motor_m", "ground_N", "spring_N")


class Summary(Values):
    """One experiment in a few numbers; null where unknown."""

    file = "summary.json"


def plain(value: Any) -> Any:
    """numpy and NaN as what JSON can hold: lists, numbers, null."""
    if isinstance(value, dict):
        return {str(k): plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [plain(v) for v in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
