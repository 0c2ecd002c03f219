"""One field or table as one file, by the end of its name: `jv.export`."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import pandas as pd
import xarray as xr

from jumpvision.base.schema import InputError

from .images import write_film as write_vti
from .images import write_legacy
from .tables import write_rows


def write_field(data: xr.Dataset, file: Path) -> list[Path]:
    """A field over (y, x), and t where there are several times, as `file`; the files. Raises InputError."""
    writer = WRITERS.get(file.suffix)
    if writer is None:
        raise InputError([f"jv.export {file}: '{file.suffix}' is no format of fields; allowed: {', '.join(WRITERS)}"])
    if not {"x", "y"} <= set(data.dims):
        raise InputError([f"jv.export {file}: a data set over {tuple(data.dims)}; a field lies over y, x (and t)"])
    file.parent.mkdir(parents=True, exist_ok=True)
    return writer(data, file)


def write_table(table: pd.DataFrame, file: Path) -> list[Path]:
    """A table as CSV."""
    if file.suffix != ".csv":
        raise InputError([f"jv.export {file}: '{file.suffix}' is no format of tables; give a name that ends in .csv"])
    file.parent.mkdir(parents=True, exist_ok=True)
    table.to_csv(file, index=False, lineterminator="\n")
    return [file]


def _over_time(data: xr.Dataset) -> xr.Dataset:
    """A single field as one of a series."""
    if "t" in data.dims:
        return data
    return (data if "t" in data.coords else data.assign_coords(t=0.0)).expand_dims("t")


def _vtk(data: xr.Dataset, file: Path) -> list[Path]:
    return write_legacy(_over_time(data), file)


def _pvd(data: xr.Dataset, file: Path) -> list[Path]:
    write_vti(_over_time(data), file.parent, file.stem)
    return [file, *sorted(file.parent.glob(f"{file.stem}_[0-9][0-9][0-9][0-9].vti"))]


def _csv(data: xr.Dataset, file: Path) -> list[Path]:
    dims = [d for d in ("t", "y", "x") if d in data.dims]
    write_rows(data, dims, [str(n) for n, v in data.data_vars.items() if set(v.dims) == set(dims)], file)
    return [file]


def _netcdf(data: xr.Dataset, file: Path) -> list[Path]:
    data.to_netcdf(file, engine="netcdf4")
    return [file]


WRITERS: Mapping[str, Callable[[xr.Dataset, Path], list[Path]]] = {
    ".vtk": _vtk,
    ".pvd": _pvd,
    ".csv": _csv,
    ".nc": _netcdf,
}
