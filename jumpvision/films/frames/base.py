"""What every film reader gives and needs: frames by number, their times, faults of the file, colour to grey."""

from __future__ import annotations

import operator
import os
from abc import ABC, abstractmethod
from collections.abc import Iterator
from pathlib import Path
from types import TracebackType
from typing import NamedTuple, Protocol, Required, Self, TypedDict

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Image

MEGAPIXELS = 200.0  # a picture of the largest sensors has 150; it takes 8 times as many bytes as floats
LARGEST = "JUMPVISION_MEGAPIXELS"  # environment variable over it


class FrameError(ValueError):
    """A film that cannot be read: names the file, what is wrong, what is allowed and the remedy."""


class Truncated(str):
    """A warning that says that the end of the film is missing."""


class Frames(Protocol):
    """A film, or a list of pictures: frames by number."""

    def __len__(self) -> int: ...
    def __getitem__(self, i: int, /) -> Image: ...


class Clock(NamedTuple):
    """time: (n,) [s], increasing; source: "file" or "declared"; warnings: texts."""

    time: NDArray[np.float64]
    source: str
    warnings: list[str]


class Known(TypedDict, total=False):
    """What a film's file says of itself; bit_depth of a grey value, exposure_s [s], recorded_rate_hz [Hz];
    bits_per_pixel that it has of each frame between key frames, where its codec loses some and predicts frames from
    others; profile: of that codec."""

    format: Required[str]
    bit_depth: Required[int]
    exposure_s: float
    recorded_rate_hz: float
    camera: str
    codec: str
    bits_per_pixel: float
    profile: str
    pixels: str
    data_set: str
    first_frame: int
    skip_frames: float


class Film(ABC):
    """Frames of one film, read one at a time (use as a context manager).

    film[i]: image (height, width), grey, uint8, uint16 or float32 as recorded, a new array each time; rows run down.
    time: (n,) [s] on the common clock, increasing; time_source: "file" or "declared". warnings: what the user should
    know (rates that disagree, frames lost). meta: format, bit_depth and, where the file knows them, exposure_s [s],
    recorded_rate_hz [Hz], camera. Raises FrameError when a frame cannot be read, IndexError beyond the film.
    """

    decodes_on_opening = False  # and takes `seen`
    counts_axes = False  # takes `axes`
    bare = False  # pixels lie in the file as they are: but for their look frames may be what a disk fills up with
    shown = False  # whether `open_frames(seen=...)` was given all frames of this film

    def __init__(
        self,
        path: Path,
        *,
        shape: tuple[int, int],
        dtype: np.dtype[np.generic],
        clock: Clock,
        warnings: list[str],
        meta: Known,
    ) -> None:
        self.path = path
        self.shape = shape
        self.dtype = dtype
        self.time = clock.time
        self.time_source = clock.source
        self.warnings = (*warnings, *clock.warnings)
        self.meta = meta

    @property
    def truncated(self) -> bool:
        """Whether frames that the file's header promises are missing at its end."""
        return any(isinstance(w, Truncated) for w in self.warnings)

    @property
    def rate(self) -> float:
        """Frames a second, by the median of the times between them; 1 of a single frame."""
        return 1.0 / float(np.median(np.diff(self.time))) if len(self) > 1 else 1.0

    @property
    def exposure(self) -> float:
        """Return the exposure of a frame by the file [s]; 0 where none is given, or longer than a frame lasts."""
        exposure = self.meta.get("exposure_s", 0.0)
        return exposure if exposure * self.rate <= 1.0 + 1e-6 else 0.0

    @abstractmethod
    def _read(self, i: int) -> Image:
        """Frame i, 0 <= i < len(self)."""

    @abstractmethod
    def close(self) -> None:
        """Gives the file back; no frame can be read afterwards."""

    def __len__(self) -> int:
        return len(self.time)

    def __getitem__(self, i: int) -> Image:
        i, n = operator.index(i), len(self)
        if not -n <= i < n:
            raise IndexError(f"{self.path}: frame {i} does not exist; the film has frames 0 to {n - 1}")
        return self._read(i % n)

    def __iter__(self) -> Iterator[Image]:
        return (self._read(i) for i in range(len(self)))

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()


def clock(
    path: Path,
    n: int,
    *,
    start: float,
    frame_rate: float | None,
    stamps: NDArray[np.float64] | None = None,
    positions: NDArray[np.float64] | None = None,
    exact: bool = False,
) -> Clock:
    """Times of n frames [s]: `start` plus the file's `stamps` (from its first frame) [s], else positions / frame_rate.

    frame_rate: declared [Hz] or None. positions: (n,) frame numbers where some are missing, default 0 .. n-1. exact:
    the stamps lie on an even grid, they are not rounded.
    The file's stamps win over a declared rate unless they do not increase. Raises FrameError when there is no clock.
    """
    warnings = []
    remedy = "give frame_rate = ... (Hz)"
    if stamps is not None:
        step = np.diff(stamps)
        if np.isfinite(stamps).all() and (step > 0).all():
            if frame_rate is not None and n > 1:
                recorded = (n - 1) / float(stamps[-1] - stamps[0])
                if differs(frame_rate, stamps):
                    warnings.append(
                        f"{path}: frame_rate = {frame_rate:g} Hz is declared, but the file's own time stamps give "
                        f"{recorded:g} Hz; the file's are used (a film saved at playback rate: clock = 'declared')"
                    )
            return Clock(start + stamps, "file", warnings + uneven(path, stamps, exact))
        bad = int(np.argmax(~(step > 0))) + 1 if n > 1 else 0
        problem = f"{path}: the file's time stamps do not increase at frame {bad}"
        if frame_rate is None:
            raise FrameError(f"{problem}; {remedy} to time the frames evenly instead")
        warnings.append(f"{problem}; the declared {frame_rate:g} Hz is used instead")
    if frame_rate is None:
        if n > 1:
            raise FrameError(f"{path}: this format has no time stamps of its own; {remedy}")
        return Clock(np.array([start]), "declared", warnings)
    if positions is None:
        positions = np.arange(n, dtype=np.float64)
    return Clock(start + positions / frame_rate, "declared", warnings)


def uneven(path: Path, stamps: NDArray[np.float64], exact: bool = False) -> list[str]:
    """Words for (n,) increasing stamps [s] that are uneven: frames missing, a clock that leaps, a varying rate."""
    steps = np.diff(stamps)
    if steps.size < 3:
        return []
    usual = float(np.median(steps))
    # rounded, as Matroska's are
    in_ms = not exact and bool(np.allclose(stamps * 1e3, np.rint(stamps * 1e3), atol=1e-6))
    # cameras jitter by less than 0.3 of the time between frames
    allowed = max(0.3 * usual, 1.01e-3 if in_ms else 0.0)
    odd = np.flatnonzero(np.abs(steps - usual) > allowed)
    if not odd.size:
        return []
    k, share = int(odd[0]), odd.size / steps.size
    # ten thousand steps are no pause of a recording, in which the rest of the film would be lost
    if (far := np.flatnonzero(steps > 1e4 * usual)).size:
        j = int(far[0])
        return [
            f"{path}: the time stamps leap by {steps[j]:.3g} s after frame {j} (usually {usual:.3g} s): damaged? Give "
            "clock = 'declared' with frame_rate, or leave the frames out (exclude_frames)"
        ]
    whole = np.rint(steps[odd] / usual)
    # where more than half of the steps are odd, the rate varies
    if share < 0.5 and (whole >= 2).all() and (np.abs(steps[odd] - whole * usual) < allowed).all():
        n = int((whole - 1).sum())
        return [
            f"{path}: {n} frame{'s are' if n > 1 else ' is'} missing by the time stamps, first after frame {k}; "
            "the others keep their own times"
        ]
    return [
        f"{path}: the time between frames varies, from {steps.min():.3g} to {steps.max():.3g} s (usually {usual:.3g} "
        "s); each frame has its own time"
    ]


def differs(rate: float, stamps: NDArray[np.float64]) -> bool:
    """Whether a rate [Hz] disagrees with (n >= 2,) stamps [s]. Their mean step is exact where stamps are coarse or
    jitter, their median step where frames are lost; a rate that fits either agrees."""
    step = np.diff(stamps)
    # a larger relative difference of declared and recorded frame rate is worth a warning
    return all(not abs(rate * typical - 1) <= 1e-3 for typical in (float(step.mean()), float(np.median(step))))


def lost(path: Path, whole: int, promised: int) -> list[str]:
    """Return the warning for a film with fewer or more `whole` frames than its header promised."""
    if whole == promised:
        return []
    if whole > promised:
        return [f"{path}: holds {whole} frames, its header only {promised}; the rest is left out"]
    missing = promised - whole
    return [
        Truncated(f"{path}: truncated; the header promises {promised} frames, {whole} are whole, {missing} are lost")
    ]


def check_image(path: Path, height: int, width: int) -> None:
    """Refuses sizes that no camera has, before memory is taken for them."""
    if not (0 < height <= 2**16 and 0 < width <= 2**16):
        raise FrameError(f"{path}: frames of {height} x {width} pixels; allowed: 1 to 65536 each way (damaged header?)")
    most = float(os.environ.get(LARGEST, MEGAPIXELS))
    if height * width > 1e6 * most:
        raise FrameError(
            f"{path}: frames of {height} x {width} pixels; allowed: {most:g} million (damaged header?); crop it, or "
            f"set the environment variable {LARGEST} to more"
        )


def native(image: NDArray[np.generic], where: Path | str) -> Image:
    """The image (or stack) as uint8, uint16 or float32 in machine byte order; bool becomes 0 and 1.

    Other floats become float32. Raises FrameError for wider or signed integers: no value may change unseen.
    """
    kind = native_type(image.dtype, where)
    return np.ascontiguousarray(image, dtype=kind)


def native_type(dtype: np.dtype[np.generic], where: Path | str) -> np.dtype[np.generic]:
    if dtype.kind == "b":
        return np.dtype(np.uint8)
    if dtype.kind == "f":
        return np.dtype(np.float32)
    if dtype.kind == "u" and dtype.itemsize <= 2:
        return np.dtype(f"u{dtype.itemsize}")
    raise FrameError(f"{where}: pixels of type {dtype}; allowed: uint8, uint16, float; convert them before")


def luma(red: Image, green: Image, blue: Image) -> Image:
    """Grey of a colour image by Rec. 601, 0.299 R + 0.587 G + 0.114 B, at its own depth; exact where R = G = B."""
    if red.dtype.kind == "f":
        grey = 0.299 * red.astype(np.float64) + 0.587 * green + 0.114 * blue
        return np.where((red == green) & (green == blue), red, grey).astype(np.float32)
    wide = 299 * red.astype(np.uint32) + 587 * green.astype(np.uint32) + 114 * blue.astype(np.uint32)
    return ((wide + 500) // 1000).astype(red.dtype)


def single_channel(image: NDArray[np.generic], where: Path | str, *, order: str = "rgb") -> Image:
    """Grey (height, width) from (height, width) or (height, width, 1 | 3 | 4), the fourth (opacity) left out."""
    if image.ndim == 2:
        return native(image, where)
    if image.ndim != 3 or image.shape[2] not in (1, 3, 4):
        channels = image.shape[2] if image.ndim == 3 else f"an array of shape {image.shape}"
        raise FrameError(f"{where}: {channels} channels; allowed: 1 (grey), 3 (colour) or 4 (colour and opacity)")
    image = native(image, where)
    if image.shape[2] == 1:
        return np.ascontiguousarray(image[:, :, 0])
    r, g, b = (order.index(c) for c in "rgb")
    return luma(image[:, :, r], image[:, :, g], image[:, :, b])


def is_mosaic(image: Image) -> bool:
    """Return True if a grey picture (h, w) is a colour camera's raw one: the pixels of its 2 x 2 cells that see green
    (Bayer 1976) differ from the two others everywhere alike, by more than chance and more than a hundredth of the
    light. Grey cameras of all kinds stay below 0.2 %."""
    rows, columns = (n // 2 * 2 for n in image.shape)
    a = np.asarray(image[:rows, :columns], np.float32)
    green = 0.5 * (a[::2, ::2] + a[1::2, 1::2] - a[::2, 1::2] - a[1::2, ::2])
    if green.size < 64:
        return False
    return bool(abs(green.mean()) > max(0.01 * a.mean(), 6.0 * green.std() / np.sqrt(green.size)))


def upright(image: Image, orientation: int) -> Image:
    """The image as an EXIF orientation wants it shown (Exif 2.3, tag 274): 3 is upside down, 6 lies on its side."""
    turned = np.transpose(image) if orientation > 4 else image
    if orientation in (3, 4, 7, 8):
        turned = turned[::-1]
    if orientation in (2, 3, 6, 7):
        turned = turned[:, ::-1]
    return np.ascontiguousarray(turned)
