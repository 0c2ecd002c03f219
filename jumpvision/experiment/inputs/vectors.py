"""Velocity fields that other programs computed, as they stand: pivpy (.nc), PIVlab (.mat) and text (`vector_text`).

Nothing is converted here: numbers keep the file's units and axes, and what a file does not say is None.
"""

from __future__ import annotations

import re
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import AnyArray, Array
from jumpvision.base.schema import InputError

from .vector_field import FOOT, FORMATS, Vectors, mask_zero_vectors
from .vector_text import GOOD_PIVLAB, stacked

if TYPE_CHECKING:
    import xarray as xr

TEXT = (".txt", ".vec")


def read_vectors(path: Path, measured: Collection[float] = ()) -> Vectors:
    """The field of one file, or the fields of the numbered text files of a folder or pattern, in order of number.

    measured: values of the file's flag (chc, flags, vector type) that say measured; else those of the program that
    wrote it: 0 of OpenPIV, 1 of PIVlab (2: replaced) and Insight, 1 to 4 of DaVis (5: interpolated).
    Raises InputError naming file, what is wrong with it and the remedy.
    """
    found = mask_zero_vectors(_read(path, measured), str(path))
    if not found.valid.any():
        raise InputError(
            [f"{path}: no vector is measured by its flags; if they mean something else, give measured = [1] or [0]"]
        )
    return found


def _read(path: Path, measured: Collection[float]) -> Vectors:
    if any(c in path.name for c in "*?["):
        files = sorted(path.parent.glob(path.name), key=_by_number)
    else:
        within = [f for f in path.iterdir() if f.suffix.lower() in TEXT] if path.is_dir() else [path]
        files = sorted(within, key=_by_number)
    if not files:
        raise InputError([f"{path}: no .txt or .vec files in this folder; name the field: {FORMATS}"])
    suffixes = {f.suffix.lower() for f in files}
    if len(suffixes) == 1 and suffixes <= {*TEXT}:
        return stacked(files, measured)
    if len(files) > 1:
        raise InputError([f"{path}: {len(files)} files; one file a field only of .txt or .vec; give one .nc or .mat"])
    reader = {".nc": _netcdf, ".mat": _matlab}.get(files[0].suffix.lower())
    if reader is None:
        raise InputError([f"{files[0]}: '{files[0].suffix}' is no known vector file; allowed: {FORMATS}"])
    return reader(files[0], measured)


def _by_number(file: Path) -> tuple[list[Any], str]:
    """field_2 before field_10."""
    parts = re.split(r"(\d+)", file.name)
    return [int(p) if i % 2 else p for i, p in enumerate(parts)], file.name


def _netcdf(file: Path, measured: Collection[float]) -> Vectors:
    """pivpy schema 1, of which piv.nc is one; older files may have other orders of the dimensions."""
    import xarray as xr

    try:
        with xr.open_dataset(file, engine="netcdf4", decode_times=False) as d:
            data = d.load()
    except OSError as e:
        raise InputError([f"{file}: not a NetCDF file ({e.strerror or e}); export it again"]) from None
    return vectors_of(data, str(file), measured)


def vectors_of(data: xr.Dataset, file: str, measured: Collection[float] = ()) -> Vectors:
    """The field of a data set of pivpy's schema, x, y, u, v and what else of it is there; file: its name in errors."""
    lacking = [k for k in ("x", "y", "u", "v") if k not in data]
    if lacking or not {"x", "y"} <= set(data.u.dims):
        raise InputError([f"{file}: {', '.join(lacking) or 'dims x, y'} missing; pivpy's schema has u, v (y, x, t)"])
    if "t" not in data.u.dims:
        data = data.expand_dims("t", axis=-1)
    data = data.transpose("y", "x", "t", ...)
    u, v = data.u.values.astype(float), data.v.values.astype(float)
    valid = np.isfinite(u) & np.isfinite(v)
    if "chc" in data:
        valid &= _measured(file, data, measured)
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


def _measured(file: str, data: xr.Dataset, measured: Collection[float]) -> NDArray[np.bool_]:
    """Which vectors were measured, (y, x, t), by chc: pivpy's schema says 1, but its readers hand on what the program
    wrote, and put zeros for vectors that are missing in text."""
    chc = data.chc.values
    if measured:
        return np.isin(chc, list(measured))
    if "reason" in data:  # our own
        return chc > 0
    born = {Path(str(f)).suffix.lower() for f in np.atleast_1d(data.attrs.get("files", []))}
    if not {*np.unique(chc[np.isfinite(chc)])} <= {0.0, 1.0}:
        peaks = not born & {".mat", *TEXT}  # DaVis: number of the correlation's peak
        return (chc >= 1.0) & (chc <= 4.0) if peaks else chc == 1.0
    if ".txt" not in born:
        return chc == 1.0
    moves = (np.nan_to_num(data.u.values) != 0.0) | (np.nan_to_num(data.v.values) != 0.0)
    if not moves[chc == 0.0].any():
        return moves & (chc == 1.0)
    if moves[chc == 1.0].any():
        raise InputError(
            [
                f"{file}: chc is 0 and 1, both of vectors that move, read from OpenPIV, whose flags are 0 where good: "
                "give measured = [0], or [1] if it is pivpy's own"
            ]
        )
    return moves & (chc == 0.0)


def _matlab(file: Path, measured: Collection[float]) -> Vectors:
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
        np.isin(kinds, list(measured or GOOD_PIVLAB)) & np.isfinite(u) & np.isfinite(v),
        length,
        speed,
        None if calv is None else "+y" if calv < 0.0 else "-y",  # PIVlab turns an axis by the sign of its factor
        mirrored=calu is not None and calu < 0.0,
    )


def _cells(value: AnyArray) -> list[Array]:
    return [np.asarray(f, float) for f in value.ravel()] if value.dtype == object else [np.asarray(value, float)]
