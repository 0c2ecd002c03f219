"""One pass of decoding over a film container, strict: a damaged frame is an error, not a patched picture."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from jumpvision.frames.base import FrameError, check_image

MAX_PIXELS = 2**28
STRICT = {"err_detect": "explode+crccheck"}


class Step(NamedTuple):
    """packet: the one just given to the decoder (None: end of film); frames: what came out; failed: it was refused."""

    packet: Any
    frames: list[Any]
    failed: bool


def open_video(path: Path, threads: str) -> tuple[Any, Any]:
    """(av container, its first video stream, ready to decode with "AUTO" (frames in parallel) or "SLICE" threads)."""
    import av

    # titles and comments in another encoding must not stop a film; from PyAV 19 on they never do
    tolerant: dict[str, Any] = {"metadata_errors": "ignore"} if int(av.__version__.split(".")[0]) < 19 else {}
    try:
        container = av.open(str(path), **tolerant)
    except (av.FFmpegError, ValueError, OSError) as error:
        raise FrameError(f"{path}: not a film, or its header is lost: {error}; copy it again") from error
    try:
        if not container.streams.video or container.streams.video[0].codec_context is None:
            raise FrameError(f"{path}: no video in it that can be decoded; convert it with ffmpeg")
        stream = container.streams.video[0]
        context = stream.codec_context
        check_image(path, context.height, context.width)
        if context.width * context.height > MAX_PIXELS:
            raise FrameError(f"{path}: frames of {context.height} x {context.width} pixels (damaged header?)")
        context.options = STRICT
        context.thread_type = threads
    except BaseException:
        container.close()
        raise
    return container, stream


def decode_steps(container: Any, stream: Any) -> Iterator[Step]:
    """The film packet by packet from where the container stands, frames in the order of display."""
    import av

    packets = container.demux(stream)
    while True:
        try:
            packet = next(packets, None)
        except (av.FFmpegError, ValueError, OSError):  # nothing can be read beyond
            packet = None
        if packet is not None and packet.size == 0:  # an empty packet: the one that ends the film, or a dropped frame
            continue
        try:
            yield Step(packet, stream.codec_context.decode(packet), False)
        except (av.FFmpegError, ValueError):
            yield Step(packet, [], True)
        if packet is None:
            return
