"""Velocity fields that other programs computed: pivpy (.nc), OpenPIV (.txt) and PIVlab (.txt, .mat), as they stand.

Nothing is converted here: numbers keep the file's units and axes, and what a file does not say is None.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import AnyArray, Array
from jumpvision.base.schema import InputError

FORMATS = "pivpy .nc, OpenPIV .txt, PIVlab .txt or .mat"
FOOT = ("foot_y", "foot_y_sigma", "foot_v", "foot_v_sigma")


@dataclass(frozen=True)
class Vectors:
    """x (nx,), y (ny,) in `length` units, u, v in `speed` units and valid: shape (ny, nx, nt), rows along y.

    up: "+y" where y and v count upwards, "-y" downwards. mirrored: x counts to the left. time [s]: mid-time of each
    field. window: side of the matched window over the distance of the vectors. u_sigma, v_sigma: standard
    uncertainties, in `speed` units. foot: FOOT over the fields, in SI and y up. None, or {}: the file does not say.
    """

    x: Array
    y: Array
    u: Array
    v: Array
    valid: NDArray[np.bool_]
    length: str | None
    speed: str | None
    up: str | None
    mirrored: bool = False
    time: Array | None = None
    window: float | None = None
    u_sigma: Array | None = None
    v_sigma: Array | None = None
    foot: Mapping[str, Array] = field(default_factory=dict)


def read_vectors(path: Path) -> Vectors:
    """The field of one file, or the fields of the numbered text files of a folder or pattern, in order of number.

    Raises InputError naming file, what is wrong with it and the remedy.
    """
    if any(c in path.name for c in "*?["):
        files = sorted(path.parent.glob(path.name), key=_by_number)
    else:
        files = sorted(path.glob("*.txt"), key=_by_number) if path.is_dir() else [path]
    if not files:
        raise InputError([f"{path}: no .txt files in this folder; name the field: {FORMATS}"])
    suffixes = {f.suffix.lower() for f in files}
    if suffixes == {".txt"}:
        return _stacked(files)
    if len(files) > 1:
        raise InputError([f"{path}: {len(files)} files; only .txt has one file a field. Give one .nc or .mat"])
    reader = {".nc": _netcdf, ".mat": _matlab}.get(files[0].suffix.lower())
    if reader is None:
        raise InputError([f"{files[0]}: '{files[0].suffix}' is no known vector file; allowed: {FORMATS}"])
    return reader(files[0])


def _by_number(file: Path) -> tuple[list[Any], str]:
    """field_2 before field_10."""
    parts = re.split(r"(\d+)", file.name)
    return [int(p) if i % 2 else p for i, p in enumerate(parts)], file.name


def _stacked(files: list[Path]) -> Vectors:
    fields = [_text(f) for f in files]
    first = fields[0]
    for file, f in zip(files, fields):
        if (
            f.x.shape != first.x.shape
            or f.y.shape != first.y.shape
            or not (np.allclose(f.x, first.x) and np.allclose(f.y, first.y))
        ):
            raise InputError([f"{file}: its grid is not that of {files[0].name}; all fields of a film need one grid"])
        if (f.length, f.speed) != (first.length, first.speed):
            raise InputError(
                [f"{file}: units [{f.length}], [{f.speed}], but [{first.length}], [{first.speed}] in {files[0].name}"]
            )
    u, v, valid = (np.concatenate([getattr(f, k) for f in fields], axis=-1) for k in ("u", "v", "valid"))
    return Vectors(first.x, first.y, u, v, valid, first.length, first.speed, first.up)


LABEL = re.compile(r"([A-Za-z][A-Za-z ]*?)\s*\[([^\]]*)\]")  # PIVlab: x [px],y [px],u [px/frame],...


def _text(file: Path) -> Vectors:
    """One field as text: PIVlab where the header has units in brackets, else OpenPIV's columns x y u v flags mask."""
    try:
        lines = file.read_text(encoding="utf-8-sig").splitlines()
    except UnicodeDecodeError as e:
        raise InputError([f"{file}: not text (byte {e.start}); allowed: {FORMATS}"]) from None
    begin = next((i for i, line in enumerate(lines) if _numbers(line) is not None), len(lines))
    labels = next((LABEL.findall(line) for line in reversed(lines[:begin]) if len(LABEL.findall(line)) >= 4), [])
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
    table = np.array(rows)
    x, y, planes = _grid(file, table)
    u, v = planes[..., 2], planes[..., 3]
    if labels:
        names = [name.strip().lower() for name, _ in labels]
        known = "vector type" in names[: table.shape[1]]
        valid = planes[..., names.index("vector type")] == 1 if known else np.ones(u.shape, bool)
        if names[:4] != ["x", "y", "u", "v"]:
            raise InputError([f"{file}: columns {', '.join(names[:4])}; the first four must be x, y, u, v"])
        length, speed, up = labels[0][1], labels[2][1], None
    else:
        flags = planes[..., 4:6]
        if flags.shape[-1] == 1 and not np.isin(flags, (0.0, 1.0, 2.0)).all():
            flags = flags[..., :0]  # OpenPIV before 0.23 may write the signal to noise ratio there: no verdict
        valid, length, speed = (flags == 0.0).all(axis=-1), None, None
        # transform_coordinates turns y and v upwards and leaves the picture's top row first
        up = "+y" if table[0, 1] > table[-1, 1] else "-y"
    ok = valid & np.isfinite(u) & np.isfinite(v)
    return Vectors(x, y, u[..., None], v[..., None], ok[..., None], length, speed, up)


def _numbers(line: str) -> list[float] | None:
    try:
        values = [float(p) for p in re.split(r"[,;\s]+", line.strip()) if p]
    except ValueError:
        return None
    return values or None


def _grid(file: Path, table: Array) -> tuple[Array, Array, Array]:
    """x, y and the columns as (ny, nx, columns); rows from the first y of the file on, whichever runs faster."""
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


def _netcdf(file: Path) -> Vectors:
    """pivpy schema 1, of which piv.nc is one; older files may have other orders of the dimensions."""
    import xarray as xr

    try:
        with xr.open_dataset(file, engine="netcdf4", decode_times=False) as d:
            data = d.load()
    except OSError as e:
        raise InputError([f"{file}: not a NetCDF file ({e.strerror or e}); export it again"]) from None
    lacking = [k for k in ("x", "y", "u", "v") if k not in data]
    if lacking or not {"x", "y"} <= set(data.u.dims):
        raise InputError([f"{file}: {', '.join(lacking) or 'dims x, y'} missing; pivpy's schema has u, v (y, x, t)"])
    if "t" not in data.u.dims:
        data = data.expand_dims("t", axis=-1)
    data = data.transpose("y", "x", "t", ...)
    u, v = data.u.values.astype(float), data.v.values.astype(float)
    valid = np.isfinite(u) & np.isfinite(v)
    if "chc" in data:
        valid &= data.chc.values > 0
    y = data.y.values.astype(float)
    says_up = data.y.attrs.get("long_name") == "up" or (y.size > 1 and y[0] > y[-1])
    seconds = data.t.attrs.get("units") in ("s", "sec", "seconds") if "t" in data.coords else False
    a = data.attrs
    with_sigma = "u_sigma" in data and "v_sigma" in data
    return Vectors(
        data.x.values.astype(float),
        y,
        u,
        v,
        valid,
        data.x.attrs.get("units"),
        data.u.attrs.get("units"),
        "+y" if says_up else None,
        time=data.t.values.astype(float) if seconds else None,
        window=float(a["window_px"] / a["step_px"]) if "window_px" in a and "step_px" in a else None,
        u_sigma=data.u_sigma.values if with_sigma else None,
        v_sigma=data.v_sigma.values if with_sigma else None,
        foot={k: data[k].values for k in FOOT} if all(k in data for k in FOOT) else {},
    )


def _matlab(file: Path) -> Vectors:
    """PIVlab's export of its results; cells hold one field each. typevector: 0 masked, 1 measured, 2 replaced."""
    from scipy.io import loadmat

    try:
        data = loadmat(file)
    except NotImplementedError:
        remedy = "d = load(file); save('field.mat', '-struct', 'd', '-v7')"
        raise InputError([f"{file}: a MATLAB 7.3 file, which is not read; in MATLAB: {remedy}"]) from None
    except Exception as e:  # scipy raises many kinds for what is no MATLAB file
        raise InputError([f"{file}: not a MATLAB file ({e}); allowed: {FORMATS}"]) from None
    if "resultslist" in data:
        raise InputError([f"{file}: a PIVlab session; export its results (Export, MAT file) and name that file"])
    kind = "filtered" if "u_filtered" in data and any(f.size for f in _cells(data["u_filtered"])) else "original"
    lacking = [k for k in ("x", "y", f"u_{kind}", f"v_{kind}", f"typevector_{kind}") if k not in data]
    if lacking:
        held = ", ".join(sorted(k for k in data if not k.startswith("__")))
        raise InputError([f"{file}: {', '.join(lacking)} missing; it holds {held}. Export the results with PIVlab"])
    frames = [_cells(data[k]) for k in (f"u_{kind}", f"v_{kind}", f"typevector_{kind}")]
    xs, ys = _cells(data["x"]), _cells(data["y"])
    there = [i for i, f in enumerate(frames[0]) if f.size]
    grid = {f.shape for cells in frames for i, f in enumerate(cells) if i in there}
    if not there or len(grid) != 1 or any(cells[there[0]].shape not in grid for cells in (xs, ys)):
        raise InputError([f"{file}: u_{kind}, v_{kind}, x, y must be grids of one shape; found {sorted(grid)}"])
    if there != list(range(len(there))):
        raise InputError([f"{file}: field {there[-1]} is there but an earlier one is empty: analyse all frames"])
    u, v, kinds = (np.stack([f[i] for i in there], axis=-1) for f in frames)
    units = str(np.squeeze(data["units"])) if "units" in data else ""
    both = re.findall(r"\[([^\]]*)\]", units)
    length, speed = both[:2] if len(both) >= 2 else (None, None)
    calu, calv = (float(np.squeeze(data[k])) if k in data else None for k in ("calu", "calv"))
    return Vectors(
        xs[there[0]][0].astype(float),
        ys[there[0]][:, 0].astype(float),
        u,
        v,
        (kinds == 1) & np.isfinite(u) & np.isfinite(v),
        length,
        speed,
        None if calv is None else "+y" if calv < 0.0 else "-y",  # PIVlab turns an axis by the sign of its factor
        mirrored=calu is not None and calu < 0.0,
    )


def _cells(value: AnyArray) -> list[Array]:
    return [np.asarray(f, float) for f in value.ravel()] if value.dtype == object else [np.asarray(value, float)]
