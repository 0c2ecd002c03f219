"""Velocity fields as text, one file a field: OpenPIV, PIVlab, DaVis (often with decimal commas), Insight (.vec)."""

from __future__ import annotations

import re
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

import numpy as np

from jumpvision.base.arrays import AnyArray, Array
from jumpvision.base.schema import InputError

from .held import tell
from .vector_field import FORMATS, Vectors

LABEL = re.compile(r"([A-Za-z][A-Za-z ]*?)\s*\[([^\]]*)\]")  # PIVlab: x [px],y [px],u [px/frame],...
GOOD_OPENPIV, GOOD_PIVLAB, GOOD_INSIGHT = (0.0,), (1.0,), (1.0,)  # flags of what was measured: others are replaced


def stacked(files: list[Path], measured: Collection[float]) -> Vectors:
    """The fields of text files on one grid, one after another. measured: see `read_vectors`."""
    fields = [_text(f, measured) for f in files]
    first = fields[0]
    for file, f in zip(files, fields):
        if (
            f.x.shape != first.x.shape
            or f.y.shape != first.y.shape
            or not (np.allclose(f.x, first.x) and np.allclose(f.y, first.y))
        ):
            raise InputError([f"{file}: its grid is not that of {files[0].name}; all fields of a film need one grid"])
        if (f.length, f.speed, f.pair) != (first.length, first.speed, first.pair):
            raise InputError(
                [f"{file}: units [{f.length}], [{f.speed}], but [{first.length}], [{first.speed}] in {files[0].name}"]
            )
    u, v, valid = (np.concatenate([getattr(f, k) for f in fields], axis=-1) for k in ("u", "v", "valid"))
    return replace(first, u=u, v=v, valid=valid)


def _text(file: Path, measured: Collection[float]) -> Vectors:
    """One field as text, by its first line."""
    data = file.read_bytes()
    head = data[:10].lstrip(b"\xef\xbb\xbf")
    named = head.startswith((b"#DaVis", b"TITLE"))  # of these the head may hold a path in a local code page
    try:
        lines = data.decode("latin-1" if named else "utf-8-sig").splitlines()
    except UnicodeDecodeError as e:
        raise InputError([f"{file}: not text (byte {e.start}); allowed: {FORMATS}"]) from None
    if data and data[-1:] not in b"\r\n":  # every program ends its lines
        tell(f"{file}: line {len(lines)}: does not end: the file was cut off within it")
    if named:
        return _davis(file, lines) if head.startswith(b"#DaVis") else _insight(file, lines, measured)
    return _columns(file, lines, measured)


def _columns(file: Path, lines: list[str], measured: Collection[float]) -> Vectors:
    """PIVlab where the header has units in brackets, else OpenPIV's columns x y u v flags mask."""
    begin = next((i for i, line in enumerate(lines) if _numbers(line) is not None), len(lines))
    labels = next((LABEL.findall(line) for line in reversed(lines[:begin]) if len(LABEL.findall(line)) >= 4), [])
    table = _table(file, lines, begin)
    x, y, planes = _grid(file, table)
    if not labels:
        return _openpiv(file, x, y, planes, measured)
    u, v = planes[..., 2], planes[..., 3]
    names = [name.strip().lower() for name, _ in labels]
    if names[:4] != ["x", "y", "u", "v"]:
        raise InputError([f"{file}: columns {', '.join(names[:4])}; the first four must be x, y, u, v"])
    valid = np.ones(u.shape, bool)
    if "vector type" in names[: table.shape[1]]:
        valid = np.isin(planes[..., names.index("vector type")], list(measured or GOOD_PIVLAB))
    # PIVlab keeps the rows of the picture: where y counts up it falls from row to row
    return _of(x, y, u, v, valid, labels[0][1], labels[2][1], _falls(y) or "-y")


def _openpiv(file: Path, x: Array, y: Array, planes: Array, measured: Collection[float]) -> Vectors:
    """transform_coordinates turns y and v upwards and leaves the picture's top row first. Rows that ascend are those of
    the picture, or were sorted: the file does not say."""
    flags, mask = planes[..., 4:5], planes[..., 5:6]
    if mask.shape[-1] == 0 and not np.isin(flags, (0.0, 1.0, 2.0)).all():
        flags = flags[..., :0]  # OpenPIV before 0.23 may write the signal to noise ratio there: no verdict
    valid = np.isin(flags, list(measured or GOOD_OPENPIV)).all(axis=-1) & (mask == 0.0).all(axis=-1)
    return _of(x, y, planes[..., 2], planes[..., 3], valid, None, None, _falls(y))


def _davis(file: Path, lines: list[str]) -> Vectors:
    """DaVis 8 and 10: `#DaVis 8.1.6 2D-vector 32 64 64 "position" "mm" "position" "mm" "velocity" "m/s"`, then x y u v;
    vectors that are masked or were not found are zero."""
    kind = re.search(r"(\S+-vector)\s+\d+\s+(\d+)\s+(\d+)", lines[0])
    units = re.findall(r'"([^"]*)"\s*"([^"]*)"', lines[0])
    if kind is None or kind[1] != "2D-vector" or len(units) < 3:
        raise InputError([f"{file}: line 1: '{lines[0][:60]}': must be that of 2D vectors with units; export them so"])
    table = _table(file, [line.replace(",", ".") for line in lines], 1)
    x, y, planes = _grid(file, table, int(kind[2]) * int(kind[3]))
    u, v = planes[..., 2], planes[..., 3]
    return _of(x, y, u, v, (u != 0.0) | (v != 0.0), units[0][1], units[2][1], _falls(y))


def _insight(file: Path, lines: list[str], measured: Collection[float]) -> Vectors:
    """TSI Insight: a Tecplot header with units, then x, y, u, v, CHC: 1 measured, below 0 not, above from elsewhere."""
    head = lines[0]
    units = dict(re.findall(r'"([XYUV]) ([^"]+)"', head))
    size = re.search(r"ZONE I=(\d+), J=(\d+)", head)
    if set(units) != set("XYUV") or size is None or '"CHC"' not in head:
        raise InputError([f"{file}: line 1 names no X, Y, U, V with units, CHC and ZONE; export the vectors again"])
    x, y, planes = _grid(file, _table(file, lines, 1), int(size[1]) * int(size[2]))
    pair = re.search(r'MicrosecondsPerDeltaT="([\d.]+)"', head)
    good = np.isin(planes[..., 4], list(measured or GOOD_INSIGHT))
    found = _of(x, y, planes[..., 2], planes[..., 3], good, units["X"], units["U"], _falls(y))
    return replace(found, pair=1e-6 * float(pair[1]) if pair and float(pair[1]) > 0.0 else None)


def _of(
    x: Array, y: Array, u: Array, v: Array, valid: AnyArray, length: str | None, speed: str | None, up: str | None
) -> Vectors:
    ok = valid & np.isfinite(u) & np.isfinite(v)
    return Vectors(x, y, u[..., None], v[..., None], ok[..., None], length, speed, up)


def _falls(y: Array) -> str | None:
    """Up where y falls from the file's first row to its last: rows come from the picture's top in every program."""
    return "+y" if y[0] > y[-1] else None


def _table(file: Path, lines: list[str], begin: int) -> Array:
    """The rows of numbers from line `begin` on."""
    rows: list[list[float]] = []
    for i, line in enumerate(lines[begin:], begin + 1):
        if line.strip():
            values = _numbers(line)
            if values is None or len(values) != (len(rows[0]) if rows else len(values)) or len(values) < 4:
                raise InputError(
                    [f"{file}: line {i}: '{line[:60]}': must hold the same numbers as the lines above (x y u v ...)"]
                )
            rows.append(values)
    if not rows:
        raise InputError([f"{file}: no rows of numbers; expected x y u v [flags mask] (OpenPIV) or a PIVlab table"])
    return np.array(rows)


def _numbers(line: str) -> list[float] | None:
    try:
        values = [float(p) for p in re.split(r"[,;\s]+", line.strip()) if p]
    except ValueError:
        return None
    return values or None


def _grid(file: Path, table: Array, promised: int | None = None) -> tuple[Array, Array, Array]:
    """x, y and the columns as (ny, nx, columns); rows from the first y of the file on, whichever runs faster. promised:
    rows that the header names."""
    if promised is not None and len(table) != promised:
        raise InputError([f"{file}: {len(table)} rows, {promised} by its header: cut off; export it again"])
    x, y = np.unique(table[:, 0]), np.unique(table[:, 1])
    if x.size < 2 or y.size < 2 or x.size * y.size != len(table) or not np.isfinite(table[:, :2]).all():
        raise InputError(
            [
                f"{file}: {len(table)} rows, {x.size} different x, {y.size} different y: must be a whole grid, one row "
                "a vector; export all vectors, missing ones as NaN, and coordinates with enough digits"
            ]
        )
    if table[0, 1] > table[-1, 1]:
        y = y[::-1]
    row = np.searchsorted(y if y[0] < y[-1] else -y, table[:, 1] if y[0] < y[-1] else -table[:, 1])
    out = np.full((y.size, x.size, table.shape[1]), np.nan)
    out[row, np.searchsorted(x, table[:, 0])] = table
    return x, y, out
