"""LabVIEW measurement files (.lvm): text in segments, each with a header of its own or all under the first.

Layout: "Specification for the LabVIEW Measurement File (.lvm)", National Instruments, 2019.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError

from .held import Channel, Held, tell

END, SPECIAL = "***End_of_Header***", ("***Start_Special***", "***End_Special***")
CLOCKWORK = 1e-5  # relative error of a step that is no worse than a quartz's: rounded less, it is taken as it stands
FORMS = "as a LabVIEW measurement file (.lvm) with one column of X values, or as TDMS"


@dataclass(frozen=True)
class Segment:
    """One stretch of rows. told: its header, cells by key. line: of its first row in the file; rows: cells as text."""

    header: Mapping[str, list[str]]
    names: list[str]
    line: int
    rows: list[list[str]]


@dataclass(frozen=True)
class Layout:
    """What the head of the file says of all its segments."""

    separator: str
    decimal: str  # "" where it is not said
    x_columns: str  # no, one, multi


def lvm(path: Path, asked: Collection[str]) -> Held:
    """Channels by their names; `X_Value` is the column of X values, where there is one for all."""
    text = _text(path)
    lines = text.splitlines()
    if not lines or not lines[0].startswith("LabVIEW Measurement"):
        raise InputError([f"{path}: not a LabVIEW measurement file (its first line says so); save it again {FORMS}"])
    head, begin = _header(lines, 1)
    one = {k: v[0].lower() if v else "" for k, v in head.items()}
    layout = Layout(
        "," if one.get("Separator") == "comma" else "\t", one.get("Decimal_Separator", ""), one.get("X_Columns", "one")
    )
    segments = list(_segments(path, lines, begin, layout))
    if text[-1] not in "\r\n":
        tell(f"{path}: line {len(lines)}: does not end: the file was cut off within it")
    if not segments:
        raise InputError([f"{path}: no rows after its headers: the measurement was cut off; copy it again"])
    names = segments[0].names
    if other := next((s for s in segments if s.names != names), None):
        raise InputError(
            [f"{path}: line {other.line - 1}: {', '.join(other.names)}, but {', '.join(names)} before: split the file"]
        )
    places = _places(names, layout)
    own = [_named(c, layout) for c in names]
    if twice := [n for n in asked if own.count(n) > 1]:
        raise InputError([f"{path}: channel {n} is there more than once; rename or remove one" for n in twice])
    return Held(list(places), {n: _channel(n, places[n], segments, layout) for n in asked if n in places})


def _text(path: Path) -> str:
    data = path.read_bytes()
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:  # LabVIEW for Windows writes the local code page; only units and comments need it
        return data.decode("latin-1")


def _header(lines: list[str], begin: int) -> tuple[dict[str, list[str]], int]:
    """Cells by key up to the header's end, and the line after it; keys and cells are parted by tabs or commas."""
    header: dict[str, list[str]] = {}
    for i in range(begin, len(lines)):
        if lines[i].startswith(END):
            return header, i + 1
        key, *cells = re.split(r"\t|,(?!\d)", lines[i].rstrip())
        header[key] = [c.strip() for c in cells if c.strip()]
    return header, len(lines)


def _segments(path: Path, lines: list[str], begin: int, layout: Layout) -> Iterator[Segment]:
    i = _after_special(lines, begin)
    while i < len(lines):
        if not lines[i].strip():
            i += 1
            continue
        header, i = _header(lines, i)
        if "Channels" not in header or i >= len(lines):
            raise InputError(
                [f"{path}: line {i}: no header of a segment (Channels, Samples, ... {END}): damaged; copy it again"]
            )
        names = [c.strip() for c in lines[i].split(layout.separator)]
        names = names[: names.index("Comment")] if "Comment" in names else [n for n in names if n]
        i, rows, first = i + 1, [], i + 2
        while i < len(lines) and not lines[i].startswith("Channels" + layout.separator) and not _special(lines[i]):
            cells = [c.strip() for c in lines[i].split(layout.separator)]
            if any(cells[: len(names)]):
                rows.append(_fitted(path, i + 1, cells, names))
            i += 1
        _promised(path, header, names, rows, first)
        if rows:
            yield Segment(header, names, first, rows)
        i = _after_special(lines, i)


def _special(line: str) -> bool:
    return line.startswith(SPECIAL[0])


def _after_special(lines: list[str], i: int) -> int:
    """Past blank lines and blocks that other programs put between the segments."""
    while i < len(lines) and (not lines[i].strip() or _special(lines[i])):
        if _special(lines[i]):
            i = next((k for k in range(i, len(lines)) if lines[k].startswith(SPECIAL[1])), len(lines))
        i += 1
    return i


def _fitted(path: Path, line: int, cells: list[str], names: list[str]) -> list[str]:
    """The cells under the names; short rows end in cells that are left empty. What follows them is a comment."""
    if len(cells) < len(names) and not cells[-1]:
        cells = cells + [""] * (len(names) - len(cells))
    if len(cells) < len(names):
        raise InputError(
            [f"{path}: line {line}: {len(cells)} values under {len(names)} names: cut off; delete it, or copy again"]
        )
    return cells[: len(names)]


def _promised(path: Path, header: Mapping[str, list[str]], names: list[str], rows: list[list[str]], line: int) -> None:
    """A word about rows that the header promises and the file lacks."""
    whole = max((int(n) for n in header.get("Samples", ()) if n.isdigit()), default=0)
    if len(rows) < whole:
        tell(
            f"{path}: line {line}: the header promises {whole} samples, {len(rows)} are there: the file was cut off, "
            "and its last row may be; delete it if it looks so"
        )


def _named(name: str, layout: Layout) -> str:
    """A channel by its name; a column of X values of each channel is no channel."""
    return "" if name == "X_Value" and layout.x_columns != "one" else name


def _places(names: list[str], layout: Layout) -> dict[str, int]:
    """Column by name of channel."""
    return {n: k for k, c in enumerate(names) if (n := _named(c, layout))}


def _channel(name: str, column: int, segments: list[Segment], layout: Layout) -> Channel:
    values = [_without_end(_column(s, column, layout)) for s in segments]
    number = column // 2 if layout.x_columns == "multi" else column - 1  # of the channel in the headers
    header = segments[0].header
    unit = _cell(header, "Y_Unit_Label", number)
    if name == "X_Value" or _cell(header, "X_Dimension", number).lower() not in ("time", ""):
        return Channel(name, np.concatenate(values), "" if name == "X_Value" else unit)
    try:
        clock, note = _clock(segments, column, number, [len(v) for v in values], layout)
    except _Untimed as e:
        return Channel(name, np.concatenate(values), unit, untimed=str(e))
    return Channel(name, np.concatenate(values), unit, clock, _date(header, number), note=note)


def _column(segment: Segment, column: int, layout: Layout) -> Array:
    """Cells of one column as text with decimal points."""
    cells = [row[column] for row in segment.rows]
    decimal = layout.decimal or ("," if any("," in c for c in cells) else ".")
    return np.array([c.replace(",", ".") if decimal == "," else c for c in cells], object)


def _without_end(cells: Array) -> Array:
    """Without what is empty at the end: a channel of fewer samples than the others."""
    full = np.flatnonzero(cells != "")
    return cells[: full[-1] + 1] if full.size else cells[:0]


def _cell(header: Mapping[str, list[str]], key: str, number: int) -> str:
    cells = header.get(key, [])
    return cells[number] if 0 <= number < len(cells) else ""


class _Untimed(Exception):
    """Why the times are not known, and the remedy."""


def _clock(segments: list[Segment], column: int, number: int, rows: list[int], layout: Layout) -> tuple[Array, str]:
    """Times of a channel's values [s] since the first segment began, by X values where there are any, else by the rate;
    and what to know about them."""
    x_column = {"one": 0, "multi": column - 1}.get(layout.x_columns)
    out: list[Array] = []
    note = ""
    for segment, n in zip(segments, rows):
        if x_column is None:
            x, note = _by_rate(segment, number, n)
        else:
            x = np.array([_number(c) for c in _column(segment, x_column, layout)[:n]])
        late = _seconds(_date(segment.header, number), _date(segments[0].header, number))
        # X values that go on from segment to segment count from the first; such as begin anew from their own date
        on = bool(out) and out[-1].size > 0 and x.size > 0 and x[0] > out[-1][-1]
        out.append(x if on else x + late)
    return np.concatenate(out), note


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan


def _by_rate(segment: Segment, number: int, rows: int) -> tuple[Array, str]:
    """Times by X0 and Delta_X of the segment's header, and what to know about them."""
    samples = _cell(segment.header, "Samples", number)
    if samples.isdigit() and 0 < int(samples) < rows:
        raise _Untimed(
            f"line {segment.line}: {rows} rows under one header, written {samples} at a time: when each part began is "
            f"not in the file. Give rate = ... (1/s) if they follow each other without a gap, or save it {FORMS}"
        )
    step, note = _step(_cell(segment.header, "Delta_X", number).replace(",", "."))
    first = _number(_cell(segment.header, "X0", number).replace(",", ".") or "0")
    return first + step * np.arange(rows, dtype=float), note


def _step(text: str) -> tuple[float, str]:
    """The step [s] that a header writes as `text`, and a word where it is rounded: 0.000977 is 1/1024, the one whole
    rate that is written so."""
    step, half = _number(text), _half_digit(text)
    if not step > 0.0:
        raise _Untimed(f"Delta_X = '{text}': must be > 0 s; give rate = ... (1/s), or save it {FORMS}")
    whole = round(1.0 / step)
    if half / step < CLOCKWORK or abs(whole * step - 1.0) < 1e-9:
        return step, ""
    low, high = 1.0 / (step + half), 1.0 / (step - half)
    if math.floor(high) != math.ceil(low):
        raise _Untimed(
            f"Delta_X = {text} s is rounded: any rate from {low:.6g} to {high:.6g} Hz is written so; give rate = ... "
            f"(1/s), or save it {FORMS}"
        )
    rate = math.floor(high)
    note = f"Delta_X = {text} s is rounded: timed by {rate} Hz, the one whole rate that is written so"
    return 1.0 / rate, f"{note}; rate = ... (1/s) overrides it"


def _half_digit(text: str) -> float:
    """Half of one in the last digit of 1.953125E-5."""
    digits, _, power = text.upper().partition("E")
    return 0.5 * 10.0 ** (int(power or 0) - len(digits.partition(".")[2]))


def _date(header: Mapping[str, list[str]], number: int) -> np.datetime64 | None:
    """When the segment began [ns], by its Date 2013/02/19 and Time 09:51:40,7271890640258789063."""
    day, time = _cell(header, "Date", number).replace("/", "-"), _cell(header, "Time", number).replace(",", ".")
    try:
        return np.datetime64(f"{day}T{time[:18]}", "ns")
    except ValueError:
        return None


def _seconds(later: np.datetime64 | None, first: np.datetime64 | None) -> float:
    return 0.0 if later is None or first is None else float((later - first) / np.timedelta64(1, "ns")) * 1e-9
