"""CSV logs of the laboratory: read whole, checked value by value, refused with file, row, column and remedy."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from jumpvision.base.schema import InputError, closest

if TYPE_CHECKING:
    import pandas as pd


def read_log(
    path: Path, *columns: str, optional: tuple[str, ...] = (), at_least: int = 2, ordered: bool = True
) -> pd.DataFrame:
    """The named columns as floats, in file order; the first must be a strictly increasing time where `ordered`.

    Raises InputError naming file, row (1 = first row under the header), column, value and remedy.
    """
    import numpy as np
    import pandas as pd

    try:
        raw = pd.read_csv(path, dtype=str, skipinitialspace=True, encoding="utf-8-sig", keep_default_na=False)
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as e:
        text = str(e).strip().splitlines()[-1]
        raise InputError([f"{path}: not a CSV table ({text}); expected the header {','.join(columns)}"]) from None
    raw.columns = [str(c).strip() for c in raw.columns]
    missing = [c for c in columns if c not in raw.columns]
    if missing:
        raise InputError(
            [
                f"{path}: column {c} missing; the header is '{','.join(raw.columns)}'{closest(c, raw.columns)}"
                for c in missing
            ]
        )
    if len(raw) < at_least:
        raise InputError([f"{path}: {len(raw)} rows; at least {at_least} are needed"])
    problems, out = [], {}
    for c in (*columns, *(c for c in optional if c in raw.columns)):
        values = pd.to_numeric(raw[c].str.strip(), errors="coerce").to_numpy(float)
        bad = np.flatnonzero(~np.isfinite(values))
        if bad.size:
            more = f" (and {bad.size - 1} rows more)" if bad.size > 1 else ""
            problems.append(
                f"{path}: row {bad[0] + 1}, {c} = '{raw[c].iloc[bad[0]]}'{more}: must be a finite number; "
                "mend the value or delete the row"
            )
        out[c] = values
    time = out[columns[0]]
    back = np.flatnonzero(np.diff(time) <= 0)
    if ordered and back.size and not problems:
        i = int(back[0])
        what = "repeats" if time[i + 1] == time[i] else "goes back"
        problems.append(
            f"{path}: row {i + 2}, {columns[0]} = {time[i + 1]:g} after {time[i]:g}: time {what}; "
            "it must increase from row to row: sort the rows and remove duplicates"
        )
    if problems:
        raise InputError(problems)
    return pd.DataFrame(out)
