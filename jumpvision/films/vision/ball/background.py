"""The scene behind the ball, seen while the ball is elsewhere, and frames as the tracker sees them, without it.

At the ball's edge a pixel is I = B (1 - share) + A share, with B the scene behind and A the ball's grey. A textured B
pulls every position towards its own pattern, the same in all frames, which no frame-to-frame scatter can tell. With B
known, the share itself is (I - B)/(A - B).
"""

from __future__ import annotations

import math
import tempfile
import threading
from array import array
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from jumpvision.base.arrays import Array, Float32, Image
from jumpvision.base.threads import shared
from jumpvision.films.frames.base import Frames

HELD = 2**23  # bytes of windows in memory; beyond, all of them lie in a file without a name
SAMPLED = 41  # frames of which the still scene is the median
CLEAR = 4.0  # px between the ball's edge and a pixel that counts as scene


LEAST_VIEWS = (
    20  # views of a pixel before its mean is used: its noise is then below 5 % of a single frame's, in variance
)


def still_scene(frames: Frames) -> Float32:
    """Return the median grey of each pixel over SAMPLED frames, evenly spaced."""
    n = len(frames)
    which = np.unique(np.linspace(0, n - 1, min(SAMPLED, n)).astype(int))
    stack = np.stack([np.asarray(frames[int(i)]) for i in which])
    if stack.dtype not in (np.uint8, np.uint16):
        known = np.where(np.isfinite(stack), stack, np.nan).astype(np.float32)
        blind = np.isnan(known).all(axis=0)
        known[:, blind] = 0.0
        return np.where(blind, np.nan, np.nanmedian(known, axis=0)).astype(np.float32)
    out: Float32 = np.zeros(stack.shape[1:], np.float32)
    _medians(len(out), stack, 8 * stack.dtype.itemsize, out)
    return out


@shared()
def _medians(first, last, stack, bits, out):  # type: ignore[no-untyped-def]
    """Of rows first to last - 1 of a stack (n, rows, columns) of whole grey levels, bit by bit from the highest: the
    middle value is the largest that no more than half of the others are below."""
    n, columns = len(stack), out.shape[1]
    value, below = np.zeros(columns, np.int32), np.zeros(columns, np.int32)
    for row in range(first, last):
        for rank in ((n - 1) // 2, n // 2):
            value[:] = 0
            for bit in range(bits - 1, -1, -1):
                below[:] = 0
                for i in range(n):
                    for c in range(columns):
                        below[c] += np.int32(stack[i, row, c]) < value[c] + (1 << bit)
                for c in range(columns):
                    if below[c] <= rank:
                        value[c] += 1 << bit
            for c in range(columns):
                out[row, c] += 0.5 * value[c]


class Background:
    """scene: (row, column) [grey], NaN where never seen; level: its median; ball: grey of the ball inside its edge.
    Where the scene has the ball's own grey the frame's own stays."""

    def __init__(self, scene: Array, level: float, ball: float):
        self.scene, self.level, self.ball = scene, level, ball
        contrast = ball - scene
        with np.errstate(invalid="ignore", divide="ignore"):
            # where the scene is nearly as bright as the ball, the ball's share of a pixel cannot be had
            usable = np.isfinite(contrast) & (contrast / (ball - level) > 0.3)
            self.gain = np.where(usable, (ball - level) / contrast, 1.0)
            self.offset = np.where(usable, level - scene * self.gain, 0.0)

    def removed(self, image: Image, row: int = 0, column: int = 0) -> Array:
        """An image (or the part of one that starts at row, column) with the even scene `level` behind the ball;
        unchanged where the scene is not known."""
        at = np.s_[row : row + image.shape[0], column : column + image.shape[1]]
        out: Array = image * self.gain[at]
        out += self.offset[at]
        return out


class SceneSum:
    """The scene behind one or several balls of a film whose camera and light stand still, from its views one by one."""

    def __init__(self) -> None:
        self._total: Image | None = None
        self._hidden: NDArray[np.int64] = np.zeros((0, 0), dtype=np.int64)
        self._views = 0
        self._greys: list[float] = []

    def add(self, image: Image, balls: Iterable[tuple[float, float, float]], grey: float) -> None:
        """One view: image (row, column), x, y, diameter [px] of every ball in it, and the grey of the first."""
        if self._total is None:
            kind = np.uint32 if image.dtype.kind == "u" and image.dtype.itemsize <= 2 else np.float64  # of MOST views
            self._total, self._hidden = np.zeros(image.shape, kind), np.zeros(image.shape, dtype=np.int64)
        add_image(self._total, image)
        self._views += 1
        for x, y, diameter in balls:
            _hide(self._total, self._hidden, image, x, y, 0.5 * diameter + CLEAR)
        self._greys.append(grey)

    @property
    def covered(self) -> bool:
        """Whether every pixel has been seen often enough."""
        return self._views >= LEAST_VIEWS and int(self._hidden.max()) <= self._views - LEAST_VIEWS

    def background(self) -> Background | None:
        """None where too little of the scene is ever seen to be of use."""
        if self._total is None or not self._greys or self._views < LEAST_VIEWS:
            return None
        scene = self._total / float(self._views)
        at = np.nonzero(self._hidden)
        seen = self._views - self._hidden[at]
        scene[at] = np.where(seen >= LEAST_VIEWS, self._total[at] / np.maximum(seen, 1), np.nan)
        known = scene[~np.isnan(scene)]
        if not known.size:
            return None
        level, ball = float(np.median(known)), float(np.median(self._greys))
        return Background(scene, level, ball) if ball != level else None


@njit(cache=True, nogil=True)
def add_image(total, image):  # type: ignore[no-untyped-def]
    """total += image, at the speed of memory."""
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            total[y, x] += image[y, x]


@njit(cache=True)
def _hide(total, hidden, image, x, y, reach):  # type: ignore[no-untyped-def]
    """Takes the pixels within reach of (x, y) out of total again and counts them as hidden."""
    for row in range(max(0, math.ceil(y - reach)), min(image.shape[0], math.floor(y + reach) + 1)):
        for column in range(max(0, math.ceil(x - reach)), min(image.shape[1], math.floor(x + reach) + 1)):
            if (column - x) ** 2 + (row - y) ** 2 <= reach * reach:
                total[row, column] -= image[row, column]
                hidden[row, column] += 1


class Window(NamedTuple):
    """pixels: (row, column) part of a frame, its first at (x0, y0)."""

    pixels: Image
    x0: int
    y0: int


class Kept(Sequence["Window | None"]):
    """Windows about one ball, of one type of numbers, in the order of the frames; None where none was kept. A film's
    lie in a file, so that memory does not grow with it. Two threads may ask at once."""

    def __init__(self) -> None:
        self._file = tempfile.SpooledTemporaryFile(HELD)  # noqa: SIM115  gone with this
        self._where = array("q")  # of each its first byte (-1: none), height, width, x0, y0
        self._end, self._type = 0, np.dtype(np.uint8)
        self._turn = threading.Lock()

    def __del__(self) -> None:
        self._file.close()

    def append(self, window: Window | None) -> None:
        """The window of the next frame; none is kept where there is no room for it."""
        self._where.extend(self._kept(window) or (-1, 0, 0, 0, 0))

    def _kept(self, window: Window | None) -> tuple[int, int, int, int, int] | None:
        """Where it is kept, if it is."""
        begin = self._end
        if window is None or not self._wrote(window.pixels.tobytes()):
            return None
        self._type = window.pixels.dtype
        self._end += window.pixels.nbytes
        height, width = window.pixels.shape
        return begin, height, width, window.x0, window.y0

    def _wrote(self, data: bytes) -> bool:
        try:
            with self._turn:
                self._file.seek(self._end)
                self._file.write(data)
        except OSError:  # a full disk: the frame is read again
            return False
        return True

    def __len__(self) -> int:
        return len(self._where) // 5

    def __getitem__(self, i: Any) -> Any:
        if not -len(self) <= i < len(self):
            raise IndexError(i)
        begin, height, width, x0, y0 = self._where[5 * (i % len(self)) : 5 * (i % len(self)) + 5]
        if begin < 0:
            return None
        with self._turn:
            self._file.seek(begin)
            data = bytearray(self._file.read(height * width * self._type.itemsize))  # an array of bytes is read-only
        return Window(np.frombuffer(data, self._type).reshape(height, width), x0, y0)


class View:
    """A frame (row, column) of grey levels, whole or as the window that was kept of it.

    whole: gives the frame where the window does not reach. scene: taken out of every part (values are floats then).
    """

    def __init__(
        self,
        shape: tuple[int, int],
        *,
        whole: Callable[[], Image],
        window: Window | None = None,
        scene: Background | None = None,
    ):
        self.shape = shape
        self._window, self._whole, self._scene = window, whole, scene

    @classmethod
    def of(cls, image: Image) -> View:
        """The view of a whole image."""
        return cls((image.shape[0], image.shape[1]), whole=lambda: image, window=Window(image, 0, 0))

    def part(self, y0: int, y1: int, x0: int, x1: int) -> Image:
        """Rows y0 to y1 and columns x0 to x1 (end excluded), as far as they are inside the frame; not a copy."""
        y0, x0 = max(0, y0), max(0, x0)
        y1, x1 = max(y0, min(y1, self.shape[0])), max(x0, min(x1, self.shape[1]))
        w = self._window
        if w is None or not (
            w.y0 <= y0 and w.x0 <= x0 and y1 <= w.y0 + w.pixels.shape[0] and x1 <= w.x0 + w.pixels.shape[1]
        ):
            w = self._window = Window(np.asarray(self._whole()), 0, 0)
        pixels = w.pixels[y0 - w.y0 : y1 - w.y0, x0 - w.x0 : x1 - w.x0]
        return pixels if self._scene is None else self._scene.removed(pixels, y0, x0)

    def everything(self) -> Image:
        """The whole frame."""
        return self.part(0, self.shape[0], 0, self.shape[1])
