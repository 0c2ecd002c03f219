"""When a film was recorded, by its own header: Phantom, Photron, NorPix, and containers that tell their making."""

from __future__ import annotations

import contextlib
import struct
from collections.abc import Callable
from datetime import UTC, datetime
from pathlib import Path

from .mraw import partners, read_header

TRIGGER = 36  # place of a cine's trigger time in its first header: uint32 2^-32 s, uint32 s
EARLIEST = 631152000.0  # s, 1990: a camera whose clock was never set counts from an earlier day


def recorded_at(path: Path) -> float | None:
    """Seconds since 1970 by the clock of camera or program; None where the file does not say, or cannot be read."""
    reader = READERS.get(path.suffix.lower())
    if reader is None or not path.is_file():
        return None
    found = None
    with contextlib.suppress(OSError, ValueError, struct.error):  # opening the film says what is wrong with it
        found = reader(path)
    return found if found is not None and found > EARLIEST else None


def _cine(path: Path) -> float:
    fraction, whole = struct.unpack("<II", _bytes(path, TRIGGER, 8))
    return float(whole + fraction / 2.0**32)


def _seq(path: Path) -> float:
    """The stamp behind the first picture."""
    head = _bytes(path, 0, 1024)
    begin = 8192 if struct.unpack_from("<i", head, 28)[0] >= 5 else 1024
    seconds, ms = struct.unpack("<IH", _bytes(path, begin + struct.unpack_from("<I", head, 564)[0], 6))
    return float(seconds + 1e-3 * ms)


def _mraw(path: Path) -> float:
    """Date and time of the text or XML header, to the minute or the second."""
    header = read_header(partners(path)[1])
    day, clock = header["date"].replace("-", "/"), header["time"]
    form = "%Y/%m/%d %H:%M:%S" if clock.count(":") == 2 else "%Y/%m/%d %H:%M"
    return datetime.strptime(f"{day} {clock}", form).replace(tzinfo=UTC).timestamp()


def _container(path: Path) -> float | None:
    import av

    with av.open(str(path)) as container:
        said = container.metadata.get("creation_time")
    return datetime.fromisoformat(said).timestamp() if said else None


def _bytes(path: Path, at: int, n: int) -> bytes:
    with path.open("rb") as file:
        file.seek(at)
        return file.read(n)


READERS: dict[str, Callable[[Path], float | None]] = {
    ".cine": _cine,
    ".seq": _seq,
    **dict.fromkeys((".mraw", ".cih", ".cihx"), _mraw),
    **dict.fromkeys((".mp4", ".m4v", ".mov", ".mkv", ".webm"), _container),
}
