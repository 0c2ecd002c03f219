"""Tables that a person writes: CSV files whose columns carry their units, as `length [mm]`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pandas as pd

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError

Units = Mapping[str, float]  # factor to SI by unit
LENGTH: Units = {"m": 1.0, "cm": 1e-2, "mm": 1e-3}


def read_columns(path: Path, wanted: Mapping[str, Units]) -> tuple[dict[str, Array], pd.DataFrame]:
    """The wanted columns in SI units, (n,) finite numbers each, and the whole table; lines after # are comments.

    InputError that names the file, the column and what is allowed.
    """
    try:
        data = pd.read_csv(path, comment="#", skipinitialspace=True)
    except (OSError, ValueError) as e:
        raise InputError([f"{path}: {e}"]) from None
    found: dict[str, Array] = {}
    problems = []
    for name, units in wanted.items():
        column = next((c for c in data.columns if str(c).split("[")[0].strip() == name), None)
        if column is None:
            problems.append(f"{path}: column {name} is missing; write it with its unit: {name} [{next(iter(units))}]")
            continue
        unit = str(column).partition("[")[2].strip().rstrip("]").strip()
        if unit not in units:
            problems.append(f"{path}: column {name}: unit {unit!r} must be one of {', '.join(units)}, as {name} [UNIT]")
            continue
        values = pd.to_numeric(data[column], errors="coerce").to_numpy(dtype=float)
        if bad := np.flatnonzero(~np.isfinite(values)).tolist():
            problems.append(f"{path}: column {name}, row {bad[0] + 1}: must be a finite number")
        found[name] = values * units[unit]
    if problems:
        raise InputError(problems)
    return found, data
