"""Results as CSV: tables as they are, the values of JSON files as rows, fields as one row for each place and time."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jumpvision.experiment.results.fields import opened

from .results import Results, each_file

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

ENTRY = ["name", "value", "sigma", "sigma_common", "unit", "n", "chi2"]  # of a fit; others follow as they come


def write_tables(found: list[Results], out: Path) -> list[str]:
    """CSV files in a folder for each experiment; names of the files that hold no numbers."""
    return each_file(found, out, {".csv": _copy, ".json": _write_values, ".nc": _write_field})


def _copy(file: Path, folder: Path) -> None:
    shutil.copyfile(file, folder / file.name)


def _write_values(file: Path, folder: Path) -> None:
    """NAME.csv with the single values, NAME_PART.csv for each list of a JSON file."""
    import pandas as pd

    target, single = folder / f"{file.stem}.csv", list[Mapping[str, object]]()
    for name, value in _parts("", json.loads(file.read_text(encoding="utf-8"))):
        if isinstance(value, pd.DataFrame):
            _csv(value, target.with_name(re.sub(r"[^\w.-]", "_", f"{target.stem}_{name}") + ".csv"))
        else:
            single.append({"name": name, **value})
    columns = [*ENTRY, *dict.fromkeys(k for row in single for k in row if k not in ENTRY)]
    _csv(pd.DataFrame(single, columns=[c for c in columns if any(c in row for row in single)]), target)


def _parts(name: str, value: Any) -> Iterator[tuple[str, Any]]:
    """(name, a row) of each single value, (name, a table) of each list, or of lists that are equally long."""
    import pandas as pd

    lists = isinstance(value, Mapping) and value and all(isinstance(v, list) for v in value.values())
    if isinstance(value, Mapping) and "value" in value:
        yield name, value
    elif lists and len({len(v) for v in value.values()}) == 1:
        yield name, pd.DataFrame(value)
    elif isinstance(value, Mapping):
        for key, inner in value.items():
            yield from _parts(f"{name}.{key}" if name else str(key), inner)
    elif isinstance(value, list) and value:
        rows = all(isinstance(v, Mapping) for v in value)
        yield name, pd.DataFrame(value if rows else {"value": value})
    else:
        yield name, {"value": value}


def _write_field(file: Path, folder: Path) -> None:
    """NAME_DIMS.csv of the variables over the same dimensions, one time after the other; units in the header."""
    import pandas as pd

    with opened(file) as data:
        groups: dict[tuple[str, ...], list[str]] = {}
        for name, values in data.data_vars.items():
            groups.setdefault(tuple(map(str, values.dims)), []).append(str(name))
        for dims, names in groups.items():
            write_rows(data, dims, names, folder / ("_".join([file.stem, *dims]) + ".csv"))
        said = {str(k): v for k, v in data.attrs.items()}
        _csv(pd.DataFrame({"name": said.keys(), "value": said.values()}), folder / f"{file.stem}_attributes.csv")


def write_rows(data: xr.Dataset, dims: Sequence[str], names: Sequence[str], target: Path) -> None:
    """The variables over these dimensions as CSV, a row a place and time; units in the header."""
    with target.open("w", encoding="utf-8", newline="\n") as out:
        out.write(",".join(_header(data, c) for c in (*dims, *names)) + "\n")
        for piece in _times(data[list(names)], tuple(dims)):
            table = piece.to_dataframe(dim_order=list(dims)).reset_index() if dims else _scalars(piece)
            table[[*dims, *names]].to_csv(out, header=False, index=False, lineterminator="\n")


def _times(data: xr.Dataset, dims: tuple[str, ...]) -> Iterator[xr.Dataset]:
    """The data set time by time, so that a long film never lies in memory as a whole."""
    if "t" not in dims:
        yield data
        return
    for k in range(data.sizes["t"]):
        yield data.isel(t=[k]).load()


def _scalars(data: xr.Dataset) -> pd.DataFrame:
    import pandas as pd

    return pd.DataFrame({str(n): [v.item()] for n, v in data.data_vars.items()})


def _header(data: xr.Dataset, name: str) -> str:
    """u_m_s: the name with its unit, as columns are called here."""
    unit = str(data[name].attrs.get("units", "")) if name in data.variables else ""
    return name if unit in ("", "1") else f"{name}_{re.sub(r'[^A-Za-z0-9]+', '_', unit).strip('_')}"


def _csv(table: pd.DataFrame, target: Path) -> None:
    table.to_csv(target, index=False, lineterminator="\n")
