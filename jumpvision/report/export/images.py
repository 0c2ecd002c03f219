"""Fields as VTK image data (XML, https://docs.vtk.org/en/latest/vtk_file_formats/vtkxml_file_format.html): a .vti file
for each time and a .pvd that lists them, for ParaView, VisIt, PyVista."""

from __future__ import annotations

import base64
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

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
    return each_field(found, out, write_film)


def write_film(data: xr.Dataset, folder: Path, stem: str) -> None:
    rows = []
    for k, image in enumerate(planes(data, f"{stem}.nc")):
        name = f"{stem}_{k:04d}.vti"
        (folder / name).write_text("".join(_image(*image)), encoding="ascii")
        rows.append(f'<DataSet timestep="{image.t!r}" file="{name}"/>\n')
    listed = ["<Collection>\n", *rows, "</Collection>\n</VTKFile>\n"]
    (folder / f"{stem}.pvd").write_text(HEAD.format("Collection") + "".join(listed), encoding="ascii")


class Plane(NamedTuple):
    """One time [s] of a field on an even grid: x (nx,), y (ny,) rising; arrays (y, x), or (y, x, 3) of a vector."""

    x: NDArray[np.float64]
    y: NDArray[np.float64]
    t: float
    arrays: dict[str, AnyArray]


def planes(data: xr.Dataset, name: str) -> Iterator[Plane]:
    """The times of a field over (y, x, t), with its velocity as a vector. Raises InputError, which names it."""
    names = [str(n) for n, v in data.data_vars.items() if set(v.dims) == {"x", "y", "t"}]
    x, y = data.x.values.astype(float), data.y.values.astype(float)
    if min(x.size, y.size) < 2 or not (_even(x) and _even(y)):
        raise InputError([f"{name}: its places are not evenly spaced, as an image's are; csv takes any"])
    for k, t in enumerate(data.t.values.astype(float).tolist()):
        plane = data[names].isel(t=k).transpose("y", "x").sortby(["y", "x"])
        arrays = {n: np.asarray(plane[n].values) for n in names}
        if {"u", "v"} <= arrays.keys():
            u, v = arrays["u"], arrays["v"]
            arrays = {"velocity": np.stack([u, v, np.zeros_like(u)], axis=-1), **arrays}
        yield Plane(np.sort(x), np.sort(y), t, arrays)


def spacing(places: NDArray[np.float64]) -> float:
    """Distance of places on an even grid."""
    return float(places[-1] - places[0]) / (places.size - 1)


LEGACY = {"f8": "double", "f4": "float", "i8": "long", "i4": "int", "i2": "short", "i1": "char", "u1": "unsigned_char"}


def write_legacy(data: xr.Dataset, file: Path) -> list[Path]:
    """The older format of VTK, binary: FILE.vtk, of several times FILE_0000.vtk ... and FILE.vtk.series with the times,
    as ParaView reads them (https://docs.vtk.org/en/latest/vtk_file_formats/vtk_legacy_file_format.html)."""
    images, made = list(planes(data, file.name)), []
    for k, image in enumerate(images):
        made.append(file if len(images) == 1 else file.with_name(f"{file.stem}_{k:04d}{file.suffix}"))
        made[-1].write_bytes(b"".join(_legacy(image, file.stem)))
    if len(images) > 1:
        times = [{"name": f.name, "time": image.t} for f, image in zip(made, images)]
        made.append(file.with_name(file.name + ".series"))
        made[-1].write_text(json.dumps({"file-series-version": "1.0", "files": times}, indent=1), encoding="utf-8")
    return made


def _legacy(image: Plane, title: str) -> Iterator[bytes]:
    """Big-endian, x running fastest."""
    nx, ny = image.x.size, image.y.size
    head = f"# vtk DataFile Version 3.0\n{title.encode('ascii', 'replace').decode()[:200]}\nBINARY\n"
    head += f"DATASET STRUCTURED_POINTS\nDIMENSIONS {nx} {ny} 1\nORIGIN {image.x[0]!s} {image.y[0]!s} 0\n"
    head += f"SPACING {spacing(image.x)!r} {spacing(image.y)!r} 1\nFIELD FieldData 1\nTIME 1 1 double\n"
    yield head.encode() + np.array([image.t], ">f8").tobytes() + f"\nPOINT_DATA {nx * ny}\n".encode()
    for name, values in image.arrays.items():
        flat = values.astype("u1") if values.dtype == bool else values
        kind = LEGACY[flat.dtype.str[1:]]
        said = f"VECTORS {name} {kind}\n" if flat.ndim == 3 else f"SCALARS {name} {kind} 1\nLOOKUP_TABLE default\n"
        yield said.encode() + np.ascontiguousarray(flat, flat.dtype.newbyteorder(">")).tobytes() + b"\n"


def _even(places: NDArray[np.float64]) -> bool:
    steps = np.diff(places)
    return bool(np.allclose(steps, steps.mean(), rtol=1e-6, atol=0.0))


def _image(x: AnyArray, y: AnyArray, t: float, arrays: dict[str, AnyArray]) -> Iterator[str]:
    """One picture; arrays (y, x) or (y, x, 3), x running fastest as VTK counts its points."""
    extent = f"0 {x.size - 1} 0 {y.size - 1} 0 0"
    dx, dy = spacing(x), spacing(y)
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
