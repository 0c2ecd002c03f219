"""Results as a NetCDF file: dims named as the axes, a unit on every variable, robot and versions beside them."""

from __future__ import annotations

import json
import os
import platform
import uuid
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from .. import __version__
from ..records import plain
from .axes import AXES
from .machine import Machine

FILE = "sweep.nc"
RESULTS = {  # name: unit, meaning (PHYSICS.md section 1)
    "com_height_m": ("m", "greatest rise of the centre of mass above rest"),
    "flight_height_m": ("m", "g t_f^2 / 8 of the longest flight that ends after the forcing"),
    "jump_height_m": ("m", "greatest rod height after the motor stops, minus rest"),
    "n_jumps": ("1", "flights up to and including the first that ends after the forcing"),
    "lift_off_s": ("s", "first lift-off after the start of the law"),
    "peak_power_W": ("W", "greatest internal power F_m X_m' while the law runs, without impulses"),
    "peak_force_N": ("N", "greatest motor force F_m = m_m (a_m + g) while the law runs, without impulses"),
    "peak_motor_speed": ("m/s", "greatest |X_m'|"),
}
CLASSES = ("none", "single", "stutter", "multi_jump")

Variable = tuple[tuple[str, ...], NDArray[Any], str, str]  # dims, values, unit, meaning


def jump_class(n_jumps: NDArray[Any]) -> NDArray[np.int8]:
    """0 no jump, 1 single, 2 stutter (two jumps), 3 multi-jump: indices into CLASSES (thesis Figs 27, 28)."""
    return np.clip(np.nan_to_num(n_jumps), 0, 3).astype(np.int8)


def dataset(
    machine: Machine,
    coords: Mapping[str, Any],
    dims: tuple[str, ...],
    results: Mapping[str, NDArray[Any]],
    extra: Mapping[str, Variable] | None = None,
    *,
    attrs: Mapping[str, Any],
) -> xr.Dataset:
    """`results` of jumps over `dims` with `extra` variables. coords: by name, values or (dim, values)."""
    variables: dict[str, Any] = {}
    for name, (unit, meaning) in RESULTS.items():
        values = np.asarray(results[name])
        if name == "n_jumps":
            values = np.nan_to_num(values, nan=-1).astype(np.int64)
        variables[name] = (dims, values, {"units": unit, "long_name": meaning})
    flags = {"units": "1", "flag_values": np.arange(4, dtype=np.int8), "flag_meanings": " ".join(CLASSES)}
    variables["jump_class"] = (dims, jump_class(results["n_jumps"]), {**flags, "long_name": "kind of jump"})
    for name, (over, values, unit, meaning) in (extra or {}).items():
        variables[name] = (over, values, {"units": unit, "long_name": meaning})
    units: dict[str, Any] = {}
    for name, values in coords.items():
        over, values = values if isinstance(values, tuple) else ((name,) if np.ndim(values) else (), values)
        axis = AXES.get(name)
        meta = {"units": axis.unit or "1", "long_name": axis.meaning} if axis else {}
        units[name] = (over, values, meta)
    return xr.Dataset(variables, coords=units, attrs={**provenance(machine), **attrs})


def provenance(machine: Machine) -> dict[str, Any]:
    """Attributes of a file: the robot, its constants and model, and the versions."""
    packages = {p: version(p) for p in ("numpy", "scipy", "numba", "xarray")}
    return {
        "ground": machine.model.ground,
        "robot": machine.name,
        "constants": json.dumps(plain(dict(machine.values))),  # SI; an axis replaces its constant
        "model": str(machine.model),
        **({"laws": json.dumps(machine.laws.plain()), "laws_source": machine.laws.source} if machine.laws else {}),
        "versions": json.dumps({"jumpvision": __version__, "python": platform.python_version(), **packages}),
    }


def write(data: xr.Dataset, folder: Path, file: str = FILE) -> Path:
    """The file in the folder, written aside and renamed."""
    folder.mkdir(parents=True, exist_ok=True)
    aside = folder / f".{file}-{os.getpid()}-{uuid.uuid4().hex[:8]}.tmp"
    packed = {n: {"zlib": True, "complevel": 1} for n, v in data.data_vars.items() if v.size > 1000}
    try:
        data.to_netcdf(aside, engine="netcdf4", encoding=packed)
        os.replace(aside, folder / file)
    finally:
        aside.unlink(missing_ok=True)
    return folder / file
