"""The laboratory's files: lossless films, pictures, tables, TOML and JSON. The same input gives the same bytes."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, is_dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from av.codec.context import Flags
from numpy.typing import NDArray

Value = str | float | Sequence["Value"] | Mapping[str, "Value"]  # what TOML holds
Table = dict[str, Value]


@dataclass(frozen=True)
class Recording:
    """What a recording leaves in its folder's texts: tables of experiment.toml by name, entries of truth.json, and
    the numbers that summary.json should say."""

    tables: dict[str, Table]
    truth: Mapping[str, object] = field(default_factory=dict)
    summary: Mapping[str, float] = field(default_factory=dict)


def film(path: Path, frames: NDArray[np.uint8], *, rate: float) -> None:
    """frames (frame, row, column) as 8-bit grey FFV1 (lossless); the container by the suffix (.avi, .mkv)."""
    with av.open(str(path), "w", options={"fflags": "+bitexact"}) as container:
        stream = container.add_stream(
            "ffv1",
            rate=Fraction(rate).limit_denominator(1000),
            options={"level": "3", "coder": "1", "context": "1", "slices": "4", "slicecrc": "1"},
        )
        stream.height, stream.width = frames.shape[1:]
        stream.pix_fmt = "gray"
        stream.codec_context.flags |= Flags.bitexact
        for image in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format="gray")))
        container.mux(stream.encode())


def movie(
    path: Path, frames: NDArray[Any], *, rate: float, numbers: NDArray[np.int64] | None = None, bits: int = 8
) -> None:
    """frames (frame, row, column), uint8 or uint16 with `bits` bits, by the path: .avi and .mkv (FFV1, lossless), .tif
    (a stack), .mraw (Photron, with its .cihx) or a folder of PNG images without suffix.

    numbers: which frames these are where some were lost; video time stamps and image names keep the gaps, the other
    formats have no place for them. Raises ValueError for another suffix.
    """
    numbers = np.arange(len(frames)) if numbers is None else numbers
    suffix = path.suffix.lower()
    if suffix in (".avi", ".mkv"):
        _video(path, frames, rate, numbers)
    elif suffix in (".tif", ".tiff"):
        if not cv2.imwritemulti(str(path), list(frames), [cv2.IMWRITE_TIFF_COMPRESSION, 1]):
            raise OSError(f"{path}: cannot be written")
    elif suffix == ".mraw":
        mraw(path, frames, rate=rate, bits=bits)
    elif not suffix:
        path.mkdir()
        for number, image in zip(numbers, frames):
            picture(path / f"{path.name}_{number:06d}.png", image)
    else:
        raise ValueError(f"{path.name}: films are written as .avi, .mkv, .tif, .mraw or a folder")


def _video(path: Path, frames: NDArray[Any], rate: float, numbers: NDArray[np.int64]) -> None:
    if frames.dtype == np.uint8 and len(numbers) == numbers[-1] + 1:
        film(path, frames, rate=rate)
        return
    kind = "gray" if frames.dtype == np.uint8 else "gray16le"
    with av.open(str(path), "w", options={"fflags": "+bitexact"}) as container:
        fraction = Fraction(rate).limit_denominator(1000)
        stream = container.add_stream("ffv1", rate=fraction, options={"level": "3", "slices": "4", "slicecrc": "1"})
        stream.height, stream.width = frames.shape[1:]
        stream.pix_fmt = kind
        stream.codec_context.time_base = 1 / fraction
        stream.codec_context.flags |= Flags.bitexact
        for number, image in zip(numbers, frames):
            frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(image), format=kind)
            frame.pts, frame.time_base = int(number), 1 / fraction
            container.mux(stream.encode(frame))
        container.mux(stream.encode())


def mraw(path: Path, frames: NDArray[Any], *, rate: float, bits: int) -> None:
    """A Photron film: pixels of 8, 12 (two in three bytes, high bits first) or 16 bits, and the XML header beside."""
    if bits == 12:
        first, second = (frames.reshape(-1)[i::2].astype(np.uint16) for i in (0, 1))
        if len(first) != len(second):
            raise ValueError(f"{path.name}: 12-bit frames need an even number of pixels")
        packed = np.stack([first >> 4, (first & 15) << 4 | second >> 8, second & 255], axis=1).astype(np.uint8)
        path.write_bytes(packed.tobytes())
    else:
        path.write_bytes(np.ascontiguousarray(frames, "<u2" if bits == 16 else np.uint8).tobytes())
    height, width = frames.shape[1:]
    path.with_suffix(".cihx").write_text(
        f"""<?xml version="1.0" encoding="UTF-8"?>
<cih>
<fileInfo><date>2014/6/30</date></fileInfo>
<imageFileInfo><fileFormat>Mraw</fileFormat></imageFileInfo>
<deviceInfo><deviceName>jumpvision laboratory</deviceName></deviceInfo>
<recordInfo><recordRate>{rate:.12g}</recordRate></recordInfo>
<frameInfo><totalFrame>{len(frames)}</totalFrame><skipFrame>1</skipFrame></frameInfo>
<imageDataInfo>
<resolution><width>{width}</width><height>{height}</height></resolution>
<colorInfo><type>Mono</type><bit>{bits}</bit></colorInfo>
<effectiveBit><depth>{bits}</depth><side>Lower</side></effectiveBit>
</imageDataInfo>
</cih>
""",
        encoding="utf-8",
        newline="\n",
    )


def picture(path: Path, image: NDArray[Any]) -> None:
    """image (row, column) as PNG."""
    if not cv2.imwrite(str(path), image, [cv2.IMWRITE_PNG_COMPRESSION, 9]):
        raise OSError(f"{path}: cannot be written")


FORMATS = {"time_s": "%.6f", "height_m": "%.7f", "position_m": "%.8f", "force_N": "%.3f", "contact": "%d"}


def table(path: Path, columns: Mapping[str, NDArray[np.float64]]) -> None:
    """Columns of equal length as CSV with a header."""
    np.savetxt(
        path,
        np.column_stack(list(columns.values())),
        fmt=[FORMATS.get(name, "%.6g") for name in columns],
        delimiter=",",
        header=",".join(columns),
        comments="",
        newline="\n",
    )


def toml(path: Path, content: Mapping[str, Value], *, comment: str = "") -> None:
    """Keys first, then tables by name ("model.fit" for a nested one)."""
    lines = [f"# {line}" for line in comment.splitlines()]
    tables = {k: v for k, v in content.items() if isinstance(v, Mapping)}
    lines += [f"{k} = {_value(v)}" for k, v in content.items() if k not in tables]
    for name, entries in tables.items():
        lines += ["", f"[{name}]", *(f"{k} = {_value(v)}" for k, v in entries.items())]
    path.write_text("\n".join(lines).lstrip("\n") + "\n", encoding="utf-8", newline="\n")


def _value(v: object) -> str:
    if isinstance(v, bool):
        return str(v).lower()
    if isinstance(v, str):
        return json.dumps(v)
    if isinstance(v, (list, tuple)):
        return "[" + ", ".join(_value(x) for x in v) + "]"
    return repr(v)


def truth(path: Path, *parts: object) -> None:
    """The entries of mappings and records, nested, of arrays and numbers, as one JSON, floats to 9 digits."""
    text = json.dumps(_plain(joined(*parts)), indent=1, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def joined(*parts: object) -> Mapping[str, object]:
    """The entries of mappings and records, one after the other; a record leaves out what is None by default."""
    out: dict[str, object] = {}
    for part in parts:
        if isinstance(part, Mapping):
            out |= part
        elif is_dataclass(part):
            values = ((f, getattr(part, f.name)) for f in fields(part))
            out |= {f.name: v for f, v in values if v is not None or f.default is not None}
    return out


def _plain(v: object) -> object:
    if isinstance(v, Mapping) or is_dataclass(v):
        return {k: _plain(x) for k, x in joined(v).items()}
    if isinstance(v, np.ndarray):
        return _plain(v.tolist())
    if isinstance(v, (list, tuple)):
        return [_plain(x) for x in v]
    if isinstance(v, (float, np.floating)):
        return float(f"{v:.9g}")
    if isinstance(v, np.integer):
        return int(v)
    return v
