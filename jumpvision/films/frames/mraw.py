"""Photron films: raw pixels in .mraw, the header beside it in .cih (text) or .cihx (XML)."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from jumpvision.base.arrays import Image

from .base import Film, FrameError, Known, check_image, clock, lost
from .packed import frame_bytes, pixel_type, read_pixels

# What is needed, by its name in the text header and its place in the XML header.
FIELDS = {
    "width": ("Image Width", "imageDataInfo/resolution/width"),
    "height": ("Image Height", "imageDataInfo/resolution/height"),
    "frames": ("Total Frame", "frameInfo/totalFrame"),
    "skip": ("Save Step", "frameInfo/skipFrame"),
    "rate": ("Record Rate(fps)", "recordInfo/recordRate"),
    "shutter": ("Shutter Speed(s)", "recordInfo/shutterSpeed"),
    "shutter_ns": ("Shutter Speed(ns)", "recordInfo/shutterSpeedNsec"),
    "bits": ("Color Bit", "imageDataInfo/colorInfo/bit"),
    "color": ("Color Type", "imageDataInfo/colorInfo/type"),
    "depth": ("EffectiveBit Depth", "imageDataInfo/effectiveBit/depth"),
    "side": ("EffectiveBit Side", "imageDataInfo/effectiveBit/side"),
    "format": ("File Format", "imageFileInfo/fileFormat"),
    "camera": ("Camera Type", "deviceInfo/deviceName"),
    "date": ("Date", "fileInfo/date"),
    "time": ("Time", "fileInfo/time"),
}


class MrawFilm(Film):
    """A Photron film, named by its .mraw or by its header.

    Only every `skipFrame`-th recorded frame may have been saved: the time step is skipFrame / recordRate. Values that
    the header puts on the high side of 16 bits are shifted down, so that they fill bit_depth bits.
    """

    bare = True

    def __init__(self, path: Path, *, frame_rate: float | None, start: float) -> None:
        raw, header = partners(path)
        h = read_header(header)
        if h["format"] and h["format"].lower() != "mraw":
            raise FrameError(f"{header}: describes a '{h['format']}' film, not .mraw; name that film's own file")
        if h["color"].lower() not in ("", "mono", "raw"):
            raise FrameError(f"{header}: Color Type '{h['color']}'; allowed: Mono or Raw; export the film as grey")
        height, width, promised, bits = (whole_number(header, h, k) for k in ("height", "width", "frames", "bits"))
        check_image(header, height, width)
        if bits not in (8, 10, 12, 16):
            raise FrameError(f"{header}: Color Bit = {bits}; allowed: 8, 10, 12 or 16 for grey film")
        depth = whole_number(header, h, "depth") if h["depth"] else bits
        self._shift = max(bits - depth, 0) if bits == 16 and h["side"].lower() == "higher" else 0
        self._bits = bits
        self._nbytes = frame_bytes(header, height, width, bits)
        size = raw.stat().st_size
        n = min(promised, size // self._nbytes)
        if n < 1:
            raise FrameError(
                f"{raw}: no whole frame; {size} bytes, one frame of {header.name} has {self._nbytes}; copy it again"
            )
        warnings = lost(raw, size // self._nbytes, promised)
        skip = number(header, h, "skip") if h["skip"] else 1.0
        rate = number(header, h, "rate") if h["rate"] else 0.0
        skip = max(skip, 1.0)
        if skip > 1 and rate > 0:
            warnings.append(
                f"{raw}: only every {skip:g}th frame was saved: {rate:g} Hz recorded, {rate / skip:g} Hz in the file"
            )
        stamps = np.arange(n, dtype=np.float64) * (skip / rate) if rate > 0 else None
        meta: Known = {"format": "mraw", "bit_depth": min(depth, bits), "camera": h["camera"]}
        if rate > 0:
            meta |= {"recorded_rate_hz": rate, "skip_frames": skip}
        exposure = shutter(header, h)
        if exposure > 0:
            meta["exposure_s"] = exposure
        super().__init__(
            raw,
            shape=(height, width),
            dtype=pixel_type(bits),
            clock=clock(raw, n, start=start, frame_rate=frame_rate, stamps=stamps),
            warnings=warnings,
            meta=meta,
        )
        self._file = raw.open("rb")

    def _read(self, i: int) -> Image:
        image = read_pixels(self._file, i * self._nbytes, *self.shape, self._bits)
        return image >> self._shift if self._shift else image

    def close(self) -> None:
        self._file.close()


def partners(path: Path) -> tuple[Path, Path]:
    """(.mraw, header) of the film that `path`, one of the two, belongs to; .cihx is preferred to .cih."""
    found = {p.suffix.lower(): p for p in sorted(path.parent.iterdir()) if p.stem == path.stem}
    found[path.suffix.lower()] = path
    header = path if path.suffix.lower() != ".mraw" else found.get(".cihx", found.get(".cih"))
    if header is None:
        raise FrameError(f"{path}: its header {path.stem}.cihx (or .cih) is missing; copy it beside the film")
    if ".mraw" not in found:
        raise FrameError(f"{path}: its pixels {path.stem}.mraw are missing; copy them beside the header")
    return found[".mraw"], header


def read_header(path: Path) -> dict[str, str]:
    """The entries of FIELDS as text, "" where absent."""
    with path.open("rb") as file:
        data = file.read(2**24)  # bytes; real headers have some ten thousand
    if path.suffix.lower() == ".cihx":
        # The XML stands between binary blocks; cut it out, which also leaves no place for entity declarations.
        begin, end = data.find(b"<cih>"), data.find(b"</cih>")
        if begin < 0 or end < begin:
            raise FrameError(
                f"{path}: no <cih> ... </cih> in the header (damaged?); export it again from the camera software"
            )
        try:
            root = ET.fromstring(data[begin : end + 6].decode("utf-8", errors="replace"))
        except ET.ParseError as error:
            raise FrameError(
                f"{path}: damaged XML header: {error}; export it again from the camera software"
            ) from error
        return {key: (root.findtext(place) or "").strip() for key, (_, place) in FIELDS.items()}
    lines = re.findall(r"^\s*([^:\r\n]+?)\s*:[ \t]*([^\r\n]*)", data.decode("utf-8", errors="replace"), re.MULTILINE)
    text = {key: value.strip() for key, value in reversed(lines)}
    return {key: text.get(name, "") for key, (name, _) in FIELDS.items()}


def number(path: Path, header: Mapping[str, str], key: str) -> float:
    """A header entry >= 0; `1/50000` is understood."""
    match = re.fullmatch(r"(?:1\s*/\s*)?([0-9]+(?:\.[0-9]*)?(?:[eE][-+]?[0-9]+)?)", header[key])
    value = float(match[1]) if match else -1.0
    if not 0 <= value < 1e15:
        raise FrameError(
            f"{path}: {' or '.join(FIELDS[key])} = '{header[key]}'; must be a number >= 0 (damaged header?)"
        )
    return 1 / value if "/" in header[key] and value else value


def whole_number(path: Path, header: Mapping[str, str], key: str) -> int:
    value = number(path, header, key)
    if value != int(value) or value < 1:
        raise FrameError(f"{path}: {' or '.join(FIELDS[key])} = '{header[key]}'; must be a whole number >= 1")
    return int(value)


def shutter(path: Path, header: Mapping[str, str]) -> float:
    """Exposure [s], 0 where unknown. XML gives nanoseconds or 1/exposure [1/s]; text gives seconds, also as 1/n."""
    if header["shutter_ns"]:
        return number(path, header, "shutter_ns") * 1e-9
    value = number(path, header, "shutter") if header["shutter"] else 0.0
    return 1 / value if path.suffix.lower() == ".cihx" and value else value
