"""`jv.flow` and `jv.statistics` of velocity fields, without a folder: what `jv.piv` gives, or a file."""

from __future__ import annotations

import os
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

from jumpvision.base.parameters import of_keywords
from jumpvision.base.schema import InputError, read
from jumpvision.experiment.inputs.parameters import FlowParams, StatisticsParams
from jumpvision.experiment.inputs.recordings import PivField
from jumpvision.experiment.inputs.vector_field import FORMATS, mask_zero_vectors
from jumpvision.experiment.inputs.vectors import vectors_of
from jumpvision.experiment.results.fields import Field, Flow, Piv

from .flow import derivatives
from .statistics import statistics as mean_flow
from .vectors import foreign_field

OURS = {"window_px", "step_px", "delta_t", "origin_column_px"}  # attributes of a field that jumpvision has made
ABOUT = ("length", "speed", "up", "measured", "scale", "frame_rate", "sigma", "window", "gap", "stride")


def flow(field: xr.Dataset | str | os.PathLike[str], *, half_width: int = 1, **about: Any) -> xr.Dataset:
    """Vorticity, divergence, shear rate and swirl of a velocity field, each with its sigma [1/s].

    field: what `jv.piv` gives, over (y, x) or over t too; any data set with u, v over x, y (y up); or the path of a
    field of another program: pivpy .nc, OpenPIV .txt, PIVlab .mat or .txt, DaVis .txt, Insight .vec, or a pattern of
    such files. half_width: planes through (2 half_width + 1)^2 vectors. about: what a field of another program does not
    say, by the keys of [piv_field], such as length="px", speed="px/frame", frame_rate=500, scale=1e-4, sigma=0.1.

    Data set over the dimensions of u, NaN where the neighbours do not tell. Raises InputError.
    """
    p = of_keywords(FlowParams, {"half_width": half_width})
    one = field_of("jv.flow", field, about)
    return as_given(derivatives(one, p.half_width), field)


def statistics(
    fields: xr.Dataset | str | os.PathLike[str] | Iterable[xr.Dataset | str | os.PathLike[str]],
    *,
    first: float | None = None,
    last: float | None = None,
    **about: Any,
) -> xr.Dataset:
    """Mean velocity and vorticity, fluctuations and Reynolds stresses of a steady flow, with their sigmas.

    fields: a field over t as `jv.piv` gives it of a stack, the file of one, or a sequence of two or more fields or
    files with the same vectors. first, last [s]: times outside are left out. about: as in `jv.flow`.

    Data set over (y, x) as in statistics.nc: u, v, vorticity, uu, vv, uv, u_rms, v_rms, tke, n. Raises InputError.
    """
    within = {k: t for k, t in (("first", first), ("last", last)) if t is not None}
    p = of_keywords(StatisticsParams, within)
    if isinstance(fields, xr.Dataset | Field | str | os.PathLike):
        piv = field_of("jv.statistics", fields, about)
    else:
        piv = in_turn([field_of("jv.statistics", f, about) for f in fields])
    found: xr.Dataset = mean_flow(piv, Flow(derivatives(piv, FlowParams().half_width)), p=p).field
    return found


def field_of(name: str, given: Any, about: dict[str, Any]) -> Piv:
    """The record, over (y, x, t), of a field that `jv.piv`, another program or an array made. name: of the function."""
    if isinstance(given, Field):
        given = given.field
    if wrong := [k for k in about if k not in ABOUT]:
        raise InputError([f"{name} {k}: unknown; a field of another program is described by {ABOUT}" for k in wrong])
    if isinstance(given, str | os.PathLike):
        path = Path(given)
        if path.suffix == ".nc" and path.is_file():
            with xr.open_dataset(path, engine="netcdf4", decode_times=False) as data:
                return _of_dataset(name, data.load(), str(path), about)
        return foreign_field(_section(name, path, about), None)
    if not isinstance(given, xr.Dataset):
        kind = type(given).__name__
        text = f"{name}: a {kind}; give what jv.piv gives, an xarray data set of u, v over x, y, or a file ({FORMATS})"
        raise InputError([text])
    return _of_dataset(name, given, f"{name}: data set", about)


def _of_dataset(name: str, data: xr.Dataset, where: str, about: dict[str, Any]) -> Piv:
    if set(data.attrs) >= OURS:
        return Piv((data if "t" in data.dims else data.expand_dims("t")).transpose("y", "x", "t"))
    raw = mask_zero_vectors(vectors_of(data, where, about.get("measured", ())), where)
    return foreign_field(_section(name, Path(where), about), None, raw)


def _section(name: str, path: Path, about: dict[str, Any]) -> PivField:
    """[piv_field] of a file, from keywords."""
    table = {k: list(v) if isinstance(v, tuple) else v for k, v in about.items()}
    made, problems = read(PivField, {"file": path.name, **table}, name)
    if problems:
        raise InputError(problems)
    return replace(made, path=path)


def in_turn(fields: list[Piv]) -> Piv:
    """One field over t of several; numbered where their times do not increase. Raises InputError where they differ."""
    if not fields:
        raise InputError(["jv.statistics: no field"])
    first = fields[0].field
    for k, f in enumerate(fields):
        if not all(first[c].equals(f.field[c]) for c in ("x", "y")):
            raise InputError([f"jv.statistics: field {k} has its vectors elsewhere than field 0; match all alike"])
    whole = xr.concat([f.field for f in fields], dim="t", combine_attrs="override", data_vars="minimal")
    if not (np.diff(whole.t.values) > 0.0).all():
        whole = whole.assign_coords(t=np.arange(whole.sizes["t"], dtype=float))
    return Piv(whole)


def as_given(found: xr.Dataset, given: Any) -> xr.Dataset:
    """With the dimensions of the field that was given, in its order: over (y, x) alone where it had no t."""
    if not isinstance(given, xr.Dataset):
        return found
    return found.transpose(*given.u.dims) if "t" in given.dims else found.isel(t=0)
