"""The laboratory's files: lossless films, pictures, tables, TOML and JSON. The same input gives the same bytes."""

from __future__ import annotations

import json
from collections.abc import Mapping
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np
from av.codec.context import Flags
from numpy.typing import NDArray


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


def picture(path: Path, image: NDArray[np.uint8]) -> None:
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


def toml(path: Path, content: Mapping[str, Any], *, comment: str = "") -> None:
    """Keys first, then tables by name ("model.fit" for a nested one)."""
    lines = [f"# {line}" for line in comment.splitlines()]
    tables = {k: v for k, v in content.items() if isinstance(v, Mapping)}
    lines += [f"{k} = {_value(v)}" for k, v in content.items() if k not in tables]
    for name, entries in tables.items():
        lines += ["", f"[{name}]", *(f"{k} = {_value(v)}" for k, v in entries.items())]
    path.write_text("\n".join(lines).lstrip("\n") + "\n", encoding="utf-8", newline="\n")


def _value(v: Any) -> str:
    if isinstance(v, bool):
        return str(v).lower()
    if isinstance(v, str):
        return json.dumps(v)
    if isinstance(v, (list, tuple)):
        return "[" + ", ".join(_value(x) for x in v) + "]"
    return repr(v)


def truth(path: Path, content: Mapping[str, Any]) -> None:
    """Nested mappings, arrays and numbers as JSON, floats to 9 digits."""
    text = json.dumps(_plain(content), indent=1, allow_nan=False)
    path.write_text(text + "\n", encoding="utf-8", newline="\n")


def _plain(v: Any) -> Any:
    if isinstance(v, Mapping):
        return {k: _plain(x) for k, x in v.items()}
    if isinstance(v, np.ndarray):
        return _plain(v.tolist())
    if isinstance(v, (list, tuple)):
        return [_plain(x) for x in v]
    if isinstance(v, (float, np.floating)):
        return float(f"{v:.9g}")
    if isinstance(v, np.integer):
        return int(v)
    return v
