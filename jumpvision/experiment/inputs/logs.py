"""Logs of the laboratory (CSV, TDMS, LVM, MAT, bags): read whole, checked by value, refused with row and remedy."""

from __future__ import annotations

import itertools
import re
import time
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

from jumpvision.base.schema import InputError, closest
from jumpvision.base.storage import irregular, settled, stamp
from jumpvision.base.units import factor, is_unit
from jumpvision.estimate.readings import Doubt, only_readings

from .channels import BAGS, READERS
from .held import Channel, Held, tell
from .recordings import LogSection
from .tracker import is_tracker, tracker

if TYPE_CHECKING:
    import pandas as pd

    from jumpvision.base.arrays import Array

PACKED = {".gz", ".bz2", ".xz", ".zip", ".zst", ".tar"}
LARGEST = 200e6  # bytes of a log, as text some 2 GB in memory
SMALL = 4e6  # bytes of one that is kept for the next stage that asks for it
PLAIN = "commas between the values, decimal points within them, one line of header"
UNIT = re.compile(r"(.*\S)\s*(?:\[\s*([^\[\]]+?)\s*\]|\(\s*([^()\d][^()]*?)\s*\))")  # Position [mm], Position (mm)


def read_log(
    log: Path | LogSection, *columns: str, optional: tuple[str, ...] = (), at_least: int = 2, ordered: bool = True
) -> pd.DataFrame:
    """The named columns as floats, in file order; the first must be a strictly increasing time where `ordered`.

    A section says what they are called in the file, in which unit, and when its time begins. Raises InputError naming
    file, row (1 = first row under the header), column, value and remedy.
    """
    import pandas as pd

    path, start = (log, 0.0) if isinstance(log, Path) else (log.path, getattr(log, "start", 0.0))
    called = () if isinstance(log, Path) else tuple(log.called.items())
    asked = path, columns, optional, called, getattr(log, "rate", None), start, at_least, ordered
    large = path.suffix.lower() != ".csv" or irregular(path) or not 0 < path.stat().st_size < SMALL
    if large or not _ended(path) or is_tracker(path):  # these may say each time what to know of them
        table, doubts = _read(*asked)
    else:
        at = stamp(path)
        table, doubts = _kept(*asked, at) if settled(at, time.time()) else _read(*asked)
    for column, doubt in doubts:
        tell(f"{path}: {column} {doubt.text}", "reading", getattr(log, "name", "") or "", doubt.values)
    return pd.DataFrame(table)


Read = tuple[dict[str, "Array"], list[tuple[str, Doubt]]]


@lru_cache(8)  # the stages of an experiment ask for its logs some eight times
def _kept(*asked: Any) -> Read:
    """`_read`; last of all what tells that a file is the same."""
    return _read(*asked[:-1])


def _read(
    path: Path,
    columns: tuple[str, ...],
    optional: tuple[str, ...],
    called: tuple[tuple[str, str], ...],
    rate: float | None,
    start: float,
    at_least: int,
    ordered: bool,
) -> Read:
    """As `read_log`, the time from `start` [s]; and what in which column is no reading, which is left out."""
    import numpy as np
    import pandas as pd

    raw = _cells(path, columns, optional, dict(called), rate)
    rows = {c: len(channel.values) for c, channel in raw.items()}
    if len(set(rows.values())) > 1:
        lengths = ", ".join(f"{raw[c].name} has {n}" for c, n in rows.items())
        raise InputError([f"{path}: channels of one log must have as many values: {lengths}"])
    if rows[columns[0]] < at_least:
        raise InputError([f"{path}: {rows[columns[0]]} rows; at least {at_least} are needed"])
    saved = " of the channels saved as CSV" if path.suffix.lower() in READERS else ""  # no editor opens those
    problems, out = [], {}
    for c, channel in raw.items():
        cells = pd.Series(channel.values)
        text = cells.str.strip() if cells.dtype == object else cells
        values = pd.to_numeric(text, errors="coerce").to_numpy(float, copy=True)
        good = np.isfinite(values)
        values[good] = text.to_numpy()[good].astype(float)  # exact, as pandas before 3 is not
        bad = np.flatnonzero(~good)
        if bad.size:
            more = f" (and {bad.size - 1} rows more)" if bad.size > 1 else ""
            problems.append(
                f"{path}: row {bad[0] + 1}, {channel.name} = '{cells.iloc[bad[0]]}'{more}: must be a finite number; "
                f"correct the value or delete the row{saved}"
            )
        out[c] = values * _factor(path, c, channel)
    time = out[columns[0]]
    back = np.flatnonzero(np.diff(time) <= 0)
    if ordered and back.size and not problems:
        i = int(back[0])
        what = "repeats" if time[i + 1] == time[i] else "goes back"
        problems.append(
            f"{path}: row {i + 2}, {columns[0]} = {time[i + 1]:g} after {time[i]:g}: time {what}; "
            f"it must increase from row to row: sort the rows and remove duplicates{saved}"
        )
    if problems:
        raise InputError(problems)
    return _readings(out | {columns[0]: time + start}, columns, timed=ordered)


def _readings(out: dict[str, Array], columns: tuple[str, ...], *, timed: bool) -> Read:
    """The columns in the rows that hold readings. A displacement set by hand stands still: only the force is asked."""
    if columns[0] == "frame" or len(columns) < 2:  # places given by hand
        return out, []
    asked = {c: x for c, x in out.items() if c != columns[0] and not c.startswith("sigma")}
    found = only_readings(asked, out[columns[1 if timed else 0]])
    return {c: found.columns[c] if c in found.columns else x[found.kept] for c, x in out.items()}, found.doubts


def columns_in(log: LogSection) -> list[str]:
    """The columns of a file by their own names, and those that its section finds in it."""
    return [*log.called, *_held(log.path, (), ()).names]


def _cells(
    path: Path,
    columns: tuple[str, ...],
    optional: tuple[str, ...],
    called: Mapping[str, str],
    rate: float | None,
) -> dict[str, Channel]:
    """The columns as the file has them; of the optional ones those that are there. rate [1/s]: of the rows, over what
    the file says of it."""
    wanted = {c: called.get(c, c) for c in (*columns, *optional)}
    held = _held(path, [n for name in wanted.values() for n in (name, _split(name)[0])], columns)
    found, missing = {}, []
    for c, name in wanted.items():
        channel = held.channels.get(name) or held.channels.get(_split(name)[0])
        if channel is not None:
            found[c] = replace(channel, unit=_split(name)[1] or _split(channel.name)[1] or channel.unit)
        elif c in columns or c in called:
            missing.append(c)
    time = columns[0]
    if rate is not None and time in found:
        raise InputError([f"{path}: rate = {rate:g} beside the column of times {found[time].name}: leave rate out"])
    if missing[:1] == [time] and time not in called and (clock := _clock(path, found, rate)) is not None:
        found = {time: Channel(missing.pop(0), clock), **found}
    if missing:
        said = f"the header is '{','.join(held.names)[:200]}'"
        if len(held.names) == 1 and re.search(r"[;\t]", held.names[0]):
            raise InputError([f"{path}: {said}: must have {PLAIN}; save it so"])
        words = {c: f"{c} = '{called[c]}'" if c in called else c for c in missing}
        raise InputError(
            [f"{path}: column {words[c]} missing; {said}{closest(wanted[c], held.names)}" for c in missing]
        )
    return found


def _clock(path: Path, found: Mapping[str, Channel], rate: float | None) -> Array | None:
    """Times of a log without a column of times: by `rate`, else those that the file gives its channels, one and the
    same for all. None where it gives none."""
    import numpy as np

    if rate is not None and found:
        return np.arange(len(next(iter(found.values())).values)) / rate
    if reason := next((c.untimed for c in found.values() if c.untimed), ""):
        raise InputError([f"{path}: {reason}"])
    timed = [c for c in found.values() if c.clock is not None]
    for other in timed[1:]:
        if not _alike(timed[0], other):
            raise InputError(
                [
                    f"{path}: {timed[0].name} and {other.name} have clocks of their own: {_told(timed[0])}, but "
                    f"{_told(other)}; bring them to one clock (resample in LabVIEW), or save the times as a channel"
                ]
            )
    if timed and timed[0].note:
        tell(f"{path}: {timed[0].note}")
    return timed[0].clock if timed else None


def _alike(one: Channel, other: Channel) -> bool:
    """Whether the values of two channels were taken at the same times, to a hundredth of a step."""
    import numpy as np

    a, b = np.asarray(one.clock), np.asarray(other.clock)
    late = 0.0
    if one.began is not None and other.began is not None:
        late = float((other.began - one.began) / np.timedelta64(1, "us")) * 1e-6
    step = (a[-1] - a[0]) / (len(a) - 1) if len(a) > 1 else 0.0
    return a.shape == b.shape and bool(np.abs(b + late - a).max(initial=0.0) <= 0.01 * abs(step))


def _told(channel: Channel) -> str:
    """When a channel begins and how fast it goes, in words."""
    import numpy as np

    clock = np.asarray(channel.clock)
    rate = f"{len(clock)} values, one a {(clock[-1] - clock[0]) / (len(clock) - 1):.6g} s" if len(clock) > 1 else "one"
    since = "" if channel.began is None else f", since {channel.began}"
    return f"{rate}, first at {clock[0] if len(clock) else 0.0:g} s{since}"


def _split(name: str) -> tuple[str, str]:
    """Return name and unit of `Position [mm]` or `Position (mm)`; "" where it states none."""
    both = UNIT.fullmatch(name)
    stated = both is not None and (both[2] or is_unit(both[3]))  # in round brackets may stand any word
    return (both[1], both[2] or both[3]) if both is not None and stated else (name, "")


def _factor(path: Path, column: str, channel: Channel) -> float:
    """From the channel's unit to that of its column, which its name ends in; 1 where none is stated."""
    _, mark, unit = column.rpartition("_")
    if not channel.unit or not mark or channel.unit == unit:
        return 1.0
    try:
        return factor(channel.unit, unit)
    except ValueError as e:
        named = channel.name if channel.name.endswith(")") else _split(channel.name)[0]
        raise InputError(
            [
                f"{path}: {channel.name} is in '{channel.unit[:60]}', which is no {unit} ({e}); name another, or "
                f"its true unit: columns.{column} = '{named} [{unit}]'"
            ]
        ) from None


def _held(path: Path, asked: Collection[str], columns: tuple[str, ...]) -> Held:
    """Names of all channels of a file, and those asked for."""
    if path.suffix.lower() in PACKED:
        raise InputError([f"{path}: compressed; unpack it, and name the table itself"])
    if problem := irregular(path):
        raise InputError([f"{path}: {problem}"])
    if path.suffix.lower() not in BAGS and (size := path.stat().st_size) > LARGEST:
        raise InputError(
            [f"{path}: {size / 1e9:.1f} GB; logs of at most {LARGEST / 1e9:g} GB are read: keep the part that matters"]
        )
    reader = READERS.get(path.suffix.lower())
    if path.suffix.lower() in (".txt", ".csv") and is_tracker(path):
        reader = tracker
    return reader(path, asked) if reader else _table(path, asked, columns)


def _table(path: Path, asked: Collection[str], columns: tuple[str, ...]) -> Held:
    """A CSV table as text; a row that does not fit the header is refused."""
    import pandas as pd

    try:
        # the header is read as a row: given one, pandas takes the first value of rows that are longer for a label
        raw = pd.read_csv(
            path,
            header=None,
            skiprows=count_preamble_lines(path),
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
        if opened := re.search(r"EOF inside string starting at row (\d+)", text):
            text = f"line {int(opened[1]) + 1}: a quotation mark opens a cell that never ends: close or remove it"
        raise InputError(
            [f"{path}: not a CSV table ({text}); expected the header {','.join(columns)}, and {PLAIN}"]
        ) from None
    _refuse_swallowed(path, raw)
    _doubt_end(path, raw)
    header = [str(c).strip() for c in raw.iloc[0]]
    if twice := [n for n in dict.fromkeys(asked) if header.count(n) > 1]:
        raise InputError([f"{path}: column {n} is there {header.count(n)} times; rename or remove one" for n in twice])
    rows = raw[1:].reset_index(drop=True)
    return Held(header, {n: Channel(n, rows[header.index(n)].to_numpy()) for n in asked if n in header})


def count_preamble_lines(path: Path) -> int:
    """Count the lines before the header: comments (#), and Excel's line with the separator."""
    with path.open(encoding="utf-8-sig", errors="replace") as file:
        return sum(1 for _ in itertools.takewhile(lambda line: line.startswith(("#", "sep=")), file))


def _refuse_swallowed(path: Path, raw: pd.DataFrame) -> None:
    """InputError where a quotation mark that is not closed runs on to the next, in another row: the rows between are
    one cell."""
    if b'"' not in path.read_bytes():
        return
    for column in raw:
        for row in raw.index[raw[column].str.contains("[\r\n]", regex=True)][:1]:
            cell = raw[column][row]
            where = f"row {row}" if row else "the header"
            raise InputError(
                [
                    f"{path}: {where}: a quotation mark opens the cell '{cell.splitlines()[0][:40]}' and closes it "
                    f"{len(cell.splitlines()) - 1} lines on: close it where it ends, or remove it"
                ]
            )


def _doubt_end(path: Path, raw: pd.DataFrame) -> None:
    """A word where the last row may be cut within its number: no newline ends it, and all others are longer."""
    if _ended(path) or len(raw) < 4:
        return
    cells = raw.iloc[1:, -1].str.strip().str.len()
    if cells.iloc[-1] < cells.iloc[:-1].min():
        tell(
            f"{path}: its last row ends in '{raw.iloc[-1, -1]}', without a newline and shorter than all others: was "
            "the file cut off? Delete the row then"
        )


def _ended(path: Path) -> bool:
    """Whether a newline ends a file."""
    with path.open("rb") as file:
        file.seek(max(file.seek(0, 2) - 1, 0))
        return file.read() in (b"\r", b"\n")
