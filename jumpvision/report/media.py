"""Pictures and films inside a page: data addresses, small previews, films that are too long left beside it."""

from __future__ import annotations

import base64
from pathlib import Path
from typing import Any

LARGEST = 6_000_000  # bytes of a film inside a page; the films made here stay under 3 MB
PREVIEW = 640  # px wide


def inline(data: bytes, kind: str = "image/png") -> str:
    """A file as a data address."""
    return f"data:{kind};base64," + base64.b64encode(data).decode()


def film(file: Path) -> str:
    """Source of a film: inside the page, or the file's name where it is longer than a page should hold."""
    return inline(file.read_bytes(), "video/webm") if file.stat().st_size <= LARGEST else file.name


def poster(file: Path) -> str:
    """What a film shows before it is played, and in print: its most colourful frame, where most is drawn over it."""
    import av
    import numpy as np

    best, most = None, -1.0
    with av.open(file) as film:
        for frame in film.decode(video=0):
            picture = frame.to_ndarray(format="bgr24")
            colour = float(np.ptp(picture[::4, ::4].astype(np.int16), axis=2).mean())
            if colour > most:
                best, most = picture, colour
    return small(best) if best is not None else ""


def preview(file: Path) -> str:
    """A picture made small."""
    import cv2
    import numpy as np

    picture = cv2.imdecode(np.frombuffer(file.read_bytes(), np.uint8), cv2.IMREAD_COLOR)
    if picture is None:
        raise ValueError(f"{file}: not a picture")
    return small(picture)


def small(picture: Any) -> str:
    """A picture (row, column, BGR) as WebP."""
    import cv2

    height = round(picture.shape[0] * PREVIEW / picture.shape[1])
    made = cv2.resize(picture, (PREVIEW, height), interpolation=cv2.INTER_AREA)
    return inline(cv2.imencode(".webp", made, [cv2.IMWRITE_WEBP_QUALITY, 82])[1].tobytes(), "image/webp")
