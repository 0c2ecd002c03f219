"""Fields as VTK image data (XML, https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html): a .vti file
for each time and a .pvd that lists them, for ParaView, VisIt, PyVista."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import AnyArray
from jumpvision.base.schema import InputError

from .results import Results, each_field

if TYPE_CHECKING:
    import xarray as xr

KINDS = {"f8": "Float64", "f4": "Float32", "i8": "Int64", "i4": "Int32", "i2": "Int16", "i1": "Int8", "u1": "UInt8"}
HEAD = '<?xml version="1.0"?>\n<VTKFile type="{}" version="1.0" byte_order="LittleEndian" header_type="UInt64">\n'


def write_images(found: list[Results], out: Path) -> list[str]:
    """NAME_0000.vti ... and NAME.pvd of every field over (y, x, t); names of the files that are none."""
    return each_field(found, out, _write_film)


def _write_film(data: xr.Dataset, folder: Path, stem: str) -> None:
    times, rows = data.t.values.astype(float), []
    names = [str(n) for n, v in data.data_vars.items() if set(v.dims) == {"x", "y", "t"}]
    x, y = data.x.values.astype(float), data.y.values.astype(float)
    if min(x.size, y.size) < 2 or not (_even(x) and _even(y)):
        raise InputError([f"{stem}.nc: its places are not evenly spaced, as an image's are; --to csv takes any"])
    for k, t in enumerate(times):
        plane = data[names].isel(t=k).transpose("y", "x").sortby(["y", "x"])
        arrays = {n: np.asarray(plane[n].values) for n in names}
        if {"u", "v"} <= arrays.keys():
            u, v = arrays["u"], arrays["v"]
            arrays = {"velocity": np.stack([u, v, np.zeros_like(u)], axis=-1), **arrays}
        name = f"{stem}_{k:04d}.vti"
        (folder / name).write_text("".join(_image(np.sort(x), np.sort(y), float(t), arrays)), encoding="ascii")
        rows.append(f'<DataSet timestep="{float(t)!r}" file="{name}"/>\n')
    listed = ["<Collection>\n", *rows, "</Collection>\n</VTKFile>\n"]
    (folder / f"{stem}.pvd").write_text(HEAD.format("Collection") + "".join(listed), encoding="ascii")


def _even(places: NDArray[np.float64]) -> bool:
    steps = np.diff(places)
    return bool(np.allclose(steps, steps.mean(), rtol=1e-6, atol=0.0))


def _image(x: AnyArray, y: AnyArray, t: float, arrays: dict[str, AnyArray]) -> Iterator[str]:
    """One picture; arrays (y, x) or (y, x, 3), x running fastest as VTK counts its points."""
    extent = f"0 {x.size - 1} 0 {y.size - 1} 0 0"
    dx, dy = float(x[-1] - x[0]) / (x.size - 1), float(y[-1] - y[0]) / (y.size - 1)
    yield HEAD.format("ImageData")
    yield f'<ImageData WholeExtent="{extent}" Origin="{float(x[0])!r} {float(y[0])!r} 0" Spacing="{dx!r} {dy!r} 1">\n'
    yield "<FieldData>\n" + _array("TimeValue", np.array([t]), ' NumberOfTuples="1"') + "</FieldData>\n"
    yield f'<Piece Extent="{extent}">\n<PointData>\n'
    for name, values in arrays.items():
        yield _array(name, values, f' NumberOfComponents="{values.shape[2]}"' if values.ndim == 3 else "")
    yield "</PointData>\n</Piece>\n</ImageData>\n</VTKFile>\n"


def _array(name: str, values: AnyArray, more: str) -> str:
    """Base64 of the number of bytes and the bytes, little-endian."""
    flat = np.ascontiguousarray(values, values.dtype.newbyteorder("<") if values.dtype != bool else "u1")
    kind, data = KINDS[flat.dtype.str[1:]], flat.tobytes()
    text = base64.b64encode(len(data).to_bytes(8, "little") + data).decode()
    return f'<DataArray type="{kind}" Name="{name}"{more} format="binary">{text}</DataArray>\n'
