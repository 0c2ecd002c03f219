"""What the stages hand on: one class a result file, with its columns, units and reading and writing.

A record holds its data in the form users know: `.table` (pandas), `.field` (xarray) or `.values` (plain dict).
"""

from __future__ import annotations

import itertools
import json
import math
import shutil
import tempfile
import weakref
from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

from jumpvision.base import notebook as reprs

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr


class RecordError(ValueError):
    """A result file does not hold what its record declares."""


class Record(ABC):
    """A result with a file name; `save` writes the file into a folder, `load` reads it back unchanged."""

    file: ClassVar[str]
    _repr_html_ = reprs.record

    @abstractmethod
    def save(self, folder: Path) -> None:
        """Write the file into `folder`."""

    @classmethod
    @abstractmethod
    def load(cls, folder: Path) -> Self:
        """Read it back from `folder`."""


def _read_csv(file: Path) -> pd.DataFrame:
    """The table of a file, bit for bit: by default from pandas 3.1 on, which warns of the word that older ones need."""
    import pandas as pd

    exact = tuple(int(n) for n in pd.__version__.split(".")[:2]) >= (3, 1)
    return pd.read_csv(file) if exact else pd.read_csv(file, float_precision="round_trip")


@dataclass(frozen=True)
class Table(Record):
    """A CSV table; floats are written so that they read back bit for bit."""

    table: pd.DataFrame
    columns: ClassVar[tuple[str, ...]]

    further: ClassVar[tuple[str, ...]] = ()  # columns that are not in every file

    def __post_init__(self) -> None:
        missing = [c for c in self.columns if c not in self.table.columns]
        if missing:
            raise RecordError(f"{self.file}: columns missing: {missing}")

    def save(self, folder: Path) -> None:
        self.table.to_csv(folder / self.file, index=False, lineterminator="\n")

    @classmethod
    def load(cls, folder: Path) -> Self:
        return cls(_read_csv(folder / cls.file))


@dataclass(frozen=True)
class Field(Record):
    """A NetCDF data set over (y, x, t); x right, y up, SI unless the scale is unknown (see the units attributes)."""

    field: xr.Dataset
    written: Path | None = None  # the file that `field` reads from when asked, where it was written piece by piece

    def save(self, folder: Path) -> None:
        if self.written is not None:
            shutil.copyfile(self.written, folder / self.file)
            return
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
    further = ("sigma_common_m", "exposure_shift_m", "lens_m")
    columns = ("frame", "time_s", "x_px", "y_px", "sigma_px", "height_m", "sigma_m", "flag")

    def save(self, folder: Path) -> None:
        super().save(folder)
        for k, table in enumerate(self.others, 2):
            table.to_csv(folder / f"track_{k}.csv", index=False, lineterminator="\n")

    @classmethod
    def load(cls, folder: Path) -> Self:
        first = super().load(folder).table
        files = sorted(folder.glob("track_[0-9]*.csv"), key=lambda f: int(f.stem[6:]))
        return cls(first, tuple(_read_csv(f) for f in files))

    @property
    def good(self) -> pd.DataFrame:
        """The rows without a flag."""
        flag = self.table.flag
        return self.table[flag.isna() | (flag.astype(str) == "")]


class RodMotion(Table):
    """Height of the rod [m] against time, zero at rest, only where it is known.

    sigma_m is all of a height's standard uncertainty, sigma_common_m the part that other recordings share; lens_m the
    signed change of the height by one standard uncertainty of the lens' k1, where that is stated.
    """

    file = "rod.csv"
    columns = ("time_s", "height_m", "sigma_m")
    further = ("sigma_common_m", "lens_m")

    @property
    def arrays(self) -> tuple[Any, Any, Any]:
        """time [s], height [m] and the independent part of sigma [m], by which fits weight, as numpy arrays."""
        from jumpvision.estimate.estimate import independent

        time, height, sigma = (self.table[c].to_numpy(float) for c in self.columns)
        return time, height, independent(sigma, self.common)

    @property
    def common(self) -> Any:
        """The part of sigma [m] that other recordings share, (n,); zeros in a file from before it was stated."""
        return self._further("sigma_common_m")

    @property
    def lens(self) -> Any:
        """Signed change of each height [m] by one standard uncertainty of k1, (n,); zeros where it is exact."""
        return self._further("lens_m")

    @property
    def scale_share(self) -> float:
        """Relative standard uncertainty of all heights above rest (scale and tilt), from the one farthest from rest."""
        import numpy as np

        from jumpvision.estimate.estimate import independent

        height = np.abs(self.table.height_m.to_numpy(float))
        far = int(np.argmax(height))
        by_scale = independent(self.common, np.abs(self.lens))[far]
        return float(by_scale / height[far]) if height[far] > 0.0 else 0.0

    def _further(self, column: str) -> Any:
        import numpy as np

        return self.table[column].to_numpy(float) if column in self.table else np.zeros(len(self.table))


class BedHeight(Values):
    """Bed height [m], volume fraction and the surface profile, each with its standard uncertainty."""

    file = "bed.json"


class CraterShape(Values):
    """Volume change of a crater [m^3] (negative: compacted), its depth and profile, and the bed's volume fraction."""

    file = "crater.json"


class Geometry(Values):
    """Walls, floor and fluidisation of the bed: findings with value, limit and meaning; speeds, pressures."""

    file = "geometry.json"


class Piv(Field):
    """Velocity field (pivpy schema 1) with uncertainties and a reason for every invalid vector.

    `field` is read from its file where it is used, so a long film never lies in memory as a whole.
    """

    file = "piv.nc"

    @classmethod
    def load(cls, folder: Path) -> Self:
        import xarray as xr

        return cls(
            xr.open_dataset(folder / cls.file, engine="netcdf4", decode_times=False, cache=False), folder / cls.file
        )

    @classmethod
    def write(cls, head: xr.Dataset, planes: Iterator[xr.Dataset]) -> Self:
        """A field of many times, taken one at a time: head has x, y, t and what is small, planes (y, x) the rest.

        The file lies in the folder for temporary files until the record's field is no longer used.
        """
        import xarray as xr

        folder = Path(tempfile.mkdtemp(prefix="jumpvision-"))
        try:
            _append(folder / cls.file, head, planes)
            field = xr.open_dataset(folder / cls.file, engine="netcdf4", decode_times=False, cache=False)
        except BaseException:
            shutil.rmtree(folder)
            raise
        weakref.finalize(field, shutil.rmtree, folder, ignore_errors=True)
        return cls(field, folder / cls.file)


AXES = "y", "x", "t"
TOGETHER = 16  # times that are compressed and written at once


def _append(file: Path, head: xr.Dataset, planes: Iterator[xr.Dataset]) -> None:
    """Write head and then the planes, TOGETHER of them in memory at a time, along t."""
    import netCDF4
    import xarray as xr

    head.to_netcdf(file, engine="netcdf4")
    done, size = 0, (head.sizes["y"], head.sizes["x"], min(TOGETHER, head.sizes["t"]))
    with netCDF4.Dataset(file, "a") as out:
        while block := list(itertools.islice(planes, TOGETHER)):
            cube = xr.concat(block, "t", combine_attrs="override").transpose(*AXES)
            for key, values in cube.data_vars.items():
                name = str(key)
                if name not in out.variables:
                    empty = math.nan if values.dtype.kind == "f" else False
                    made = out.createVariable(
                        name,
                        values.dtype.str,
                        AXES,
                        zlib=True,
                        complevel=1,
                        chunksizes=size,
                        fill_value=empty,
                        chunk_cache=math.prod(size) * values.dtype.itemsize,  # a chunk is written once: no more is kept
                    )
                    made.setncatts(values.attrs)
                out.variables[name][:, :, done : done + len(block)] = values.values
            done += len(block)
    if done != head.sizes["t"]:
        raise RecordError(f"{file.name}: {done} of {head.sizes['t']} times came")


class Flow(Field):
    """Shear rate, vorticity, divergence over (y, x, t); momentum, added mass and foot motion over t."""

    file = "flow.nc"


class Column(Field):
    """Speed profile under the foot over (y, t), its jammed front and exponential decay over t."""

    file = "column.nc"


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
