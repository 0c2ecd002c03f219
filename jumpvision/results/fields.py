"""Results that are fields, in NetCDF: velocities of the grains, their strain, the column under the foot."""

from __future__ import annotations

import itertools
import math
import shutil
import tempfile
import weakref
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Self

from .record import Record, RecordError

if TYPE_CHECKING:
    import xarray as xr


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
