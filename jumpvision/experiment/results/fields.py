"""Results that are fields, in NetCDF: velocities of the grains, their strain, the column under the foot.

The attributes of a file are known here alone; everyone else asks `record.geometry`.
"""

from __future__ import annotations

import itertools
import math
import shutil
import tempfile
import weakref
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from jumpvision.base.arrays import AnyArray
from jumpvision.base.attributes import as_attributes as as_attributes
from jumpvision.base.attributes import attributes_of as attributes_of
from jumpvision.base.record import Record, RecordError
from jumpvision.films.grains.dataset import as_matched
from jumpvision.films.grains.grid import VectorGrid

if TYPE_CHECKING:
    import xarray as xr

    Plane = xr.Dataset | Mapping[Hashable, xr.Variable]  # over (y, x); variables alone are faster to make


def unit_of(values: xr.DataArray) -> str:
    """The unit that a file states for one of its variables."""
    return str(values.attrs["units"])


def rate_of(field: xr.Dataset) -> str:
    """Return the unit of a rate, 1/s or 1/frame, by that of the velocities."""
    return f"1/{unit_of(field.u).split('/')[1]}"


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

    @classmethod
    def over_time(cls, folder: Path) -> Self:
        """Only what it holds over time alone: no plane is read."""
        import xarray as xr

        with xr.open_dataset(folder / cls.file, engine="netcdf4", decode_times=False) as d:
            return cls(d[[name for name, v in d.data_vars.items() if v.dims == ("t",)]].load())


KEPT = 2**20  # bytes of a variable that stay in memory after they were read


def opened(file: Path) -> xr.Dataset:
    """A field that is read from its file where it is used. By default NetCDF keeps up to 64 MB of every variable."""
    import netCDF4
    import xarray as xr

    before = netCDF4.get_chunk_cache()
    netCDF4.set_chunk_cache(KEPT)
    try:
        return xr.open_dataset(file, engine="netcdf4", decode_times=False, cache=False)
    finally:
        netCDF4.set_chunk_cache(*before)


class LongField(Field):
    """One that is read from its file where it is used, so a long film never lies in memory as a whole."""

    @classmethod
    def load(cls, folder: Path) -> Self:
        return cls(opened(folder / cls.file), folder / cls.file)

    @classmethod
    def write(cls, head: xr.Dataset, planes: Iterator[Plane]) -> Self:
        """A field of many times, taken one at a time: head has x, y, t and what is small, planes (y, x) the rest.

        The file lies in the folder for temporary files until the record's field is no longer used.
        """
        folder = Path(tempfile.mkdtemp(prefix="jumpvision-"))
        try:
            _append(folder / cls.file, head, planes)
            field = opened(folder / cls.file)
        except BaseException:
            shutil.rmtree(folder)
            raise
        weakref.finalize(field, shutil.rmtree, folder, ignore_errors=True)
        return cls(field, folder / cls.file)


class Piv(LongField):
    """Velocity field (pivpy schema 1) with uncertainties and a reason for every invalid vector."""

    file = "piv.nc"

    @property
    def geometry(self) -> VectorGrid:
        """Where the vectors lie."""
        return attributes_of(VectorGrid, self.field)

    @property
    def as_matched(self) -> xr.Dataset:
        """The field with its unsmoothed vectors, for means, fits and derivatives.

        Their noise goes by itself, while what smoothing rounds off does not come back."""
        return as_matched(self.field)

    @property
    def face_sigma(self) -> float:
        """Standard uncertainty of the foot's face that all times share [unit of places]; 0 where not known."""
        return float(self.field.foot_y_sigma.attrs.get("shared_by_all_times", 0.0))


AXES = "y", "x", "t"
TOGETHER = 16  # times that are compressed, written and read at once: a piece of the file; of small fields more
SMALLEST = 1024  # values of a piece: HDF5 keeps a record of every piece in memory
AT_ONCE = 2**17  # values of a variable that are read at once


def together(field: xr.Dataset) -> int:
    """How many times of a field over (y, x, t) lie together in its file."""
    return max(TOGETHER, SMALLEST // (field.sizes["y"] * field.sizes["x"]))


class Planes(Sequence["xr.Dataset"]):
    """The times of a field over (y, x, t), a data set (y, x) each: read as they lie in its file, `together` at once, so
    that each is unpacked once where they are asked for in turn.

    names: of the variables that are read; default: all.
    """

    def __init__(self, field: xr.Dataset, names: Sequence[str] = ()) -> None:
        self.field, self._first, self._together = field[list(names)] if names else field, -1, together(field)
        self._block = self.field

    def __len__(self) -> int:
        return int(self.field.sizes["t"])

    def __getitem__(self, i: Any) -> Any:
        k = range(len(self))[i]
        first = k // self._together * self._together
        if first != self._first:
            self._block, self._first = self.field.isel(t=slice(first, first + self._together)).load(), first
        return self._block.isel(t=k - first)


def by_time(
    field: xr.Dataset, names: Sequence[str], of: Callable[[xr.Dataset], Sequence[xr.DataArray]]
) -> list[AnyArray]:
    """What `of` gives for a field over (y, x, t) with these variables: arrays over its times, (t,) each.

    A long field is read part by part: of each variable about AT_ONCE values are in memory.
    """
    read, n = field[list(names)], field.sizes["t"]
    whole = together(field)
    block = max(1, AT_ONCE // (field.sizes["y"] * field.sizes["x"] * whole)) * whole
    made = [[a.values for a in of(read.isel(t=slice(k, k + block)).load())] for k in range(0, n, block)]
    return [np.concatenate(parts) for parts in zip(*made)]


def _append(file: Path, head: xr.Dataset, planes: Iterator[Plane]) -> None:
    """Write head and then the planes, `together` in memory at a time, along t."""
    import netCDF4

    head.to_netcdf(file, engine="netcdf4")
    done, size = 0, (head.sizes["y"], head.sizes["x"], min(together(head), head.sizes["t"]))
    with netCDF4.Dataset(file, "a") as out:
        while block := list(itertools.islice(planes, together(head))):
            for key, like in block[0].items():
                name = str(key)
                values = np.stack([plane[key].transpose("y", "x").values for plane in block], axis=-1)
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
                    made.setncatts(like.attrs)
                out.variables[name][:, :, done : done + len(block)] = values
            done += len(block)
    if done != head.sizes["t"]:
        raise RecordError(f"{file.name}: {done} of {head.sizes['t']} times came")


@dataclass(frozen=True)
class FlowGeometry:
    """What a flow's values over t rest on, under the names of its file.

    min_speed [m/s]: of the foot, below which there is no added mass. initial_depth_m: of the foot's face in the first
    frame. disc: "half" (foot flush with the wall) or "full". source: what computed the velocities. scale_share:
    relative standard uncertainty of lengths. momentum_per_*: relative change of the greatest momentum for a millimetre
    of the axis, and if the picture ended a vector earlier; None where there is no momentum.
    """

    min_speed: float
    initial_depth_m: float
    disc: str
    source: str
    scale_share: float = 0.0
    momentum_per_mm_of_axis: float | None = None
    momentum_per_vector_of_window: float | None = None


class Flow(LongField):
    """Shear rate, vorticity, divergence over (y, x, t); momentum, added mass and foot motion over t."""

    file = "flow.nc"

    @classmethod
    def of(cls, data: xr.Dataset, geometry: FlowGeometry) -> Self:
        """The record of a data set with its geometry."""
        return cls(data.assign_attrs(as_attributes(geometry)))

    @property
    def geometry(self) -> FlowGeometry:
        """What the values over t rest on."""
        return attributes_of(FlowGeometry, self.field)

    def share(self, name: str) -> float:
        """Relative standard uncertainty that foot_speed, momentum or added_mass shares with other films."""
        return float(self.field[name].attrs["share"])


class Statistics(Field):
    """Mean velocities, their fluctuations and stresses over (y, x), of a steady flow."""

    file = "statistics.nc"

    @property
    def fields(self) -> int:
        """How many fields it is the mean of."""
        return int(self.field.attrs["fields"])


@dataclass(frozen=True)
class ColumnGeometry:
    """Lengths that a column was read with, under the names of its file.

    front: share of the greatest speed that bounds the jammed front. layer_m: thickness that beta is of. half_width_m of
    the column; blur_m: standard deviation of the Gaussian that blurs the field; axis_off_m: by which the axis was moved
    to either side. foot_radius_m: NaN where not known. min_speed [m/s], scale_share: of the flow.
    """

    front: float
    layer_m: float
    half_width_m: float
    blur_m: float
    axis_off_m: float
    foot_radius_m: float
    min_speed: float
    scale_share: float = 0.0


class Column(Field):
    """Speed profile under the foot over (y, t), its jammed front and exponential decay over t."""

    file = "column.nc"

    @classmethod
    def of(cls, data: xr.Dataset, geometry: ColumnGeometry) -> Self:
        """The record of a data set with its geometry."""
        return cls(data.assign_attrs(as_attributes(geometry)))

    @property
    def geometry(self) -> ColumnGeometry:
        """The lengths that it was read with."""
        return attributes_of(ColumnGeometry, self.field)
