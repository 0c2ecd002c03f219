"""One pass of decoding over a film container, strict: a damaged frame is an error, not a patched picture."""

from __future__ import annotations

import zlib
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Image
from jumpvision.films.resample import resample

from .base import FrameError, check_image, luma

if TYPE_CHECKING:
    from av.container import InputContainer
    from av.packet import Packet
    from av.video.format import VideoFormat
    from av.video.frame import VideoFrame
    from av.video.stream import VideoStream

TRAILER = 8  # bytes: 3 of slice size, 1 of error status, 4 of checksum
REVERSED = bytes(int(f"{k:08b}"[::-1], 2) for k in range(256))


def checksums_hold(packet: bytes) -> bool:
    """Whether a packet is made of FFV1 slices (RFC 9043, section 4.9) with right checksums; False if it has none.

    The CRC-32 over a slice and its checksum is zero. Unlike zlib's it takes the highest bit first and starts from zero:
    bits are reversed byte by byte, and zlib's inversions undone.
    """
    end = len(packet)
    while end >= TRAILER:
        begin = end - TRAILER - int.from_bytes(packet[end - 8 : end - 5], "big")
        if begin < 0 or zlib.crc32(packet[begin:end].translate(REVERSED), 0xFFFFFFFF) != 0xFFFFFFFF:
            return False
        end = begin
    return end == 0


MAX_PIXELS = 2**28
# a text may call itself a film and name other files, or addresses (concat, HLS, DASH, SDP): none of these
CONTAINERS = (
    "avi,matroska,webm,mov,mp4,m4a,3gp,3g2,mj2,mpeg,mpegts,mpegvideo,h264,hevc,ivf,mxf,asf,flv,ogg,nut,rawvideo"
)
STRICT = {"err_detect": "explode+crccheck"}


class Step(NamedTuple):
    """packet: the one just given to the decoder (None: end of film); frames: what came out; failed: it was refused."""

    packet: Packet[VideoStream] | None
    frames: list[VideoFrame]
    failed: bool


def open_video(path: Path, threads: str) -> tuple[InputContainer, VideoStream]:
    """(av container, its first video stream, ready to decode with "AUTO" (frames in parallel) or "SLICE" threads)."""
    import av

    # titles and comments in another encoding must not stop a film; from PyAV 19 on they never do
    tolerant: dict[str, Any] = {"metadata_errors": "ignore"} if int(av.__version__.split(".")[0]) < 19 else {}
    try:
        container = av.open(str(path), options={"format_whitelist": CONTAINERS}, **tolerant)
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


def decode_steps(container: InputContainer, stream: VideoStream) -> Iterator[Step]:
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


# Luma in every second value of the one plane: which value it starts at.
INTERLEAVED = {"yuyv422": 0, "yvyu422": 0, "uyvy422": 1, "ya8": 0, "ya16le": 0, "ya16be": 0}
# Two-plane formats that keep their bits on the high side of 16.
HIGH_SIDE = {"p010": 6, "p210": 6, "p410": 6, "p012": 4, "p212": 4, "p412": 4}


def grey_type(pixels: VideoFormat) -> tuple[np.dtype[np.generic], int]:
    """(dtype, bits) of the grey image of a frame in the given av.VideoFormat."""
    bits = 8 if pixels.has_palette else int(pixels.components[0].bits)
    if pixels.name.startswith("grayf32"):
        return np.dtype(np.float32), 32
    return (np.dtype(np.uint8), bits) if bits <= 8 else (np.dtype(np.uint16), min(bits, 16))


def grey(frame: VideoFrame) -> Image:
    """(height, width) of a frame: the luma plane as stored (studio range is not stretched), or luma of RGB.

    Formats of neither kind (Bayer, one-bit) are first taken to RGB by FFmpeg.
    """
    pixels = frame.format
    dtype, bits = grey_type(pixels)
    if pixels.has_palette:
        index, colours = frame.to_ndarray()  # colours: (256, 4) of opacity, red, green, blue
        return luma(colours[:, 1], colours[:, 2], colours[:, 3])[index]
    if pixels.is_rgb and pixels.name.startswith("gbr") and "f" not in pixels.name:
        green, blue, red = (plane(frame, k, stored(pixels, dtype), 1) for k in range(3))
        return luma(red.astype(dtype), green.astype(dtype), blue.astype(dtype))
    if pixels.is_rgb or pixels.is_bayer or pixels.is_bit_stream or not pixels.components[0].is_luma:
        rgb = frame.to_ndarray(format="rgb24" if bits <= 8 else "rgb48le")
        return luma(rgb[:, :, 0], rgb[:, :, 1], rgb[:, :, 2])
    if pixels.name in INTERLEAVED:
        return plane(frame, 0, stored(pixels, dtype), 2)[:, INTERLEAVED[pixels.name] :: 2].astype(dtype)
    image = plane(frame, 0, stored(pixels, dtype), 1).astype(dtype)
    shift = HIGH_SIDE.get(pixels.name[:4], 0)
    return image >> shift if shift else image


def pixel_aspect(stream: VideoStream) -> Fraction:
    """Return a pixel's width over its height; 1 where the file gives none, or one that no camera has."""
    aspect = Fraction(stream.sample_aspect_ratio or 1)
    return aspect if Fraction(1, 4) <= aspect <= 4 else Fraction(1)


def square_shape(shape: tuple[int, int], aspect: Fraction) -> tuple[int, int]:
    """Return (rows, columns) of a picture in square pixels: more columns for wide pixels, more rows for high ones."""
    return round(shape[0] * max(1.0 / float(aspect), 1.0)), round(shape[1] * max(float(aspect), 1.0))


def to_square_pixels(image: Image, aspect: Fraction) -> Image:
    """Return the picture in square pixels, see `square_shape`."""
    shape = square_shape((image.shape[0], image.shape[1]), aspect)
    if shape == image.shape:
        return image
    rows, columns = np.indices(shape, np.float32)
    wide, high = max(float(aspect), 1.0), max(1.0 / float(aspect), 1.0)
    return resample(image, (columns + 0.5) / wide - 0.5, (rows + 0.5) / high - 0.5)


def stored(pixels: VideoFormat, dtype: np.dtype[np.generic]) -> np.dtype[np.generic]:
    return dtype.newbyteorder(">" if pixels.is_big_endian and dtype.itemsize > 1 else "<")


def plane(frame: Any, k: int, dtype: np.dtype[np.generic], per_pixel: int) -> NDArray[np.generic]:
    """Plane k as (height, width * per_pixel) values, without the padding of its lines."""
    source = frame.planes[k]
    if source.line_size < 0:  # rows from the bottom; the buffer then starts at the last one
        raise FrameError(f"{frame.format.name} pixels with the bottom row first are not supported; convert with ffmpeg")
    lines = np.frombuffer(source, dtype).reshape(-1, source.line_size // dtype.itemsize)
    return lines[: frame.height, : frame.width * per_pixel]
