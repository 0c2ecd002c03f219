"""Results as MATLAB files (MAT 5), for MATLAB, Octave, Julia: one NAME.mat a result."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from jumpvision.base.arrays import AnyArray
from jumpvision.base.schema import InputError
from jumpvision.experiment.results.fields import opened

from .results import Results, each_file

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

LONGEST = 63  # characters of a name in MATLAB


def write_matlab(found: list[Results], out: Path) -> list[str]:
    """NAME.mat in a folder for each experiment; names of the files that hold no numbers.

    Of a table each column, of a field each variable with its dimensions in the order of `NAME_dims` and its unit in
    `NAME_units`, of a JSON file each key: structs within, null as NaN.
    """
    return each_file(found, out, {".csv": _write_table, ".json": _write_values, ".nc": _write_field})


def _write_table(file: Path, folder: Path) -> None:
    import pandas as pd

    table = pd.read_csv(file)
    _save(folder / f"{file.stem}.mat", {str(c): _column(table[c]) for c in table.columns})


def _write_values(file: Path, folder: Path) -> None:
    values = json.loads(file.read_text(encoding="utf-8"))
    _save(folder / f"{file.stem}.mat", {k: _plain(v) for k, v in values.items()})


def _column(values: pd.Series) -> AnyArray:
    """A column (n, 1): numbers as they are, text as a cell array."""
    if values.dtype.kind in "fiub":
        return values.to_numpy().reshape(-1, 1)
    return np.array(values.fillna("").astype(str), dtype=object).reshape(-1, 1)


def _write_field(file: Path, folder: Path) -> None:

    with opened(file) as data:
        write_variables(data, folder / f"{file.stem}.mat")


def write_variables(data: xr.Dataset, target: Path) -> None:
    """One variable after the other, so that only one lies in memory."""
    from scipy.io import savemat

    with target.open("wb") as out:
        for name in [*map(str, data.coords), *map(str, data.data_vars)]:
            values = data[name].copy(deep=False).load()
            if values.nbytes > 2**31 - 1:  # most bytes of a variable in MAT 5
                size = f"{values.nbytes / 2**30:.1f} GiB, a MAT file holds 2 a variable"
                raise InputError([f"{target}: {name} has {size}; csv or vtk hold it"])
            about = {f"{name}_dims": ",".join(map(str, values.dims)), f"{name}_units": values.attrs.get("units", "")}
            savemat(out, _named({name: values.values, **about}), long_field_names=True, oned_as="column")
        said = {f"attribute_{k}": _plain(v) for k, v in data.attrs.items()}
        savemat(out, _named(said), long_field_names=True, oned_as="column")


def _save(target: Path, values: Mapping[str, object]) -> None:
    from scipy.io import savemat

    savemat(target, _named(values), long_field_names=True, oned_as="column")


def _plain(value: object) -> object:
    """What MAT knows: null becomes NaN, a list of numbers an array, other lists cells, an object a struct."""
    if value is None:
        return np.nan
    if isinstance(value, dict):
        return _named({k: _plain(v) for k, v in value.items()}) or np.array([])
    if isinstance(value, list):
        if all(isinstance(v, int | float) or v is None for v in value):
            return np.array([np.nan if v is None else v for v in value], float).reshape(-1, 1)
        cells = np.empty((len(value), 1), dtype=object)
        for k, v in enumerate(value):
            cells[k, 0] = _plain(v)
        return cells
    return value


def _named(values: Mapping[str, object]) -> dict[str, object]:
    """The same under names that MATLAB takes: letters, digits and _, a letter first, no two alike."""
    out: dict[str, object] = {}
    for name, value in values.items():
        plain = re.sub(r"\W", "_", str(name), flags=re.ASCII)
        plain = (plain if plain[:1].isalpha() else f"x{plain}")[:LONGEST]
        number = 2
        while plain in out:
            plain, number = f"{plain[: LONGEST - 4]}_{number}", number + 1
        out[plain] = value
    return out
