"""CSV logs of the laboratory: read whole, checked value by value, refused with file, row, column and remedy."""

from __future__ import annotations

import re
from pathlib import Path
from typing import TYPE_CHECKING

from jumpvision.base.schema import InputError, closest
from jumpvision.base.storage import irregular

if TYPE_CHECKING:
    import pandas as pd

PACKED = {".gz", ".bz2", ".xz", ".zip", ".zst", ".tar"}
LARGEST = 200e6  # bytes of a log, as text some 2 GB in memory


def read_log(
    path: Path, *columns: str, optional: tuple[str, ...] = (), at_least: int = 2, ordered: bool = True
) -> pd.DataFrame:
    """The named columns as floats, in file order; the first must be a strictly increasing time where `ordered`.

    Raises InputError naming file, row (1 = first row under the header), column, value and remedy.
    """
    import numpy as np
    import pandas as pd

    raw = _cells(path, columns, optional)
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


def _cells(path: Path, columns: tuple[str, ...], optional: tuple[str, ...]) -> pd.DataFrame:
    """The table as text, a column for each name of the header; a row that does not fit the header is refused."""
    import pandas as pd

    if path.suffix.lower() in PACKED:
        raise InputError([f"{path}: compressed; unpack it, and name the table itself"])
    if problem := irregular(path):
        raise InputError([f"{path}: {problem}"])
    if (size := path.stat().st_size) > LARGEST:
        raise InputError(
            [f"{path}: {size / 1e9:.1f} GB; logs of at most {LARGEST / 1e9:g} GB are read: keep the part that matters"]
        )
    try:
        # the header is read as a row: given one, pandas takes the first value of rows that are longer for a label
        raw = pd.read_csv(
            path,
            header=None,
            dtype=str,
            skipinitialspace=True,
            encoding="utf-8-sig",
            keep_default_na=False,
            compression=None,
        )
    except (pd.errors.ParserError, pd.errors.EmptyDataError, UnicodeDecodeError) as e:
        text = str(e).strip().splitlines()[-1]
        if longer := re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", text):
            text = f"line {longer[2]} has {longer[3]} values, the header {longer[1]}"
        raise InputError([f"{path}: not a CSV table ({text}); expected the header {','.join(columns)}"]) from None
    header = [str(c).strip() for c in raw.iloc[0]]
    missing = [c for c in columns if c not in header]
    if missing:
        said = f"the header is '{','.join(header)}'"
        raise InputError([f"{path}: column {c} missing; {said}{closest(c, header)}" for c in missing])
    if twice := [c for c in (*columns, *optional) if header.count(c) > 1]:
        raise InputError([f"{path}: column {c} is there {header.count(c)} times; rename or remove one" for c in twice])
    return raw[1:].reset_index(drop=True).set_axis(header, axis=1)
