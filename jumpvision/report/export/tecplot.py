"""Fields as Tecplot text (ASCII .dat), a zone for each time; PIVlab, Dantec and LaVision write the like."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from .results import Results, each_field

if TYPE_CHECKING:
    import xarray as xr


def write_tecplot(found: list[Results], out: Path) -> list[str]:
    """NAME.dat of every field over (y, x, t), point by point, x running fastest; names of the files that are none.

    Tecplot knows no NaN: a missing value is 0, and the last column, `known`, is 0 where a value of the row is missing.
    """
    return each_field(found, out, write_film)


def write_film(data: xr.Dataset, folder: Path, stem: str) -> None:
    names = [str(n) for n, v in data.data_vars.items() if set(v.dims) == {"x", "y", "t"}]
    labels = ", ".join(f'"{_label(data, n)}"' for n in names)
    x, y = np.meshgrid(data.x.values.astype(float), data.y.values.astype(float))
    with (folder / f"{stem}.dat").open("w", encoding="utf-8", newline="\n") as out:
        out.write(f'TITLE = "{stem}"\nVARIABLES = "x", "y", {labels}, "known"\n')
        for k, t in enumerate(data.t.values.astype(float).tolist()):
            plane = data[names].isel(t=k).transpose("y", "x")
            values = np.column_stack([np.asarray(plane[n].values, float).ravel() for n in names])
            known = np.isfinite(values).all(axis=1)
            rows = np.column_stack([x.ravel(), y.ravel(), np.where(np.isfinite(values), values, 0.0), known])
            size = f"I={data.sizes['x']}, J={data.sizes['y']}, F=POINT"
            out.write(f'ZONE T="{t!r} s", STRANDID=1, SOLUTIONTIME={t!r}, {size}\n')
            out.writelines(" ".join(map(repr, row)) + "\n" for row in rows.tolist())


def _label(data: xr.Dataset, name: str) -> str:
    unit = str(data[name].attrs.get("units", ""))
    return f"{name} [{unit}]" if unit else name
