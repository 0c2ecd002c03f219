"""Windows of a film that are looked at a second time: in a file, so that memory does not grow with the film."""

from __future__ import annotations

import tempfile
import threading
from array import array
from collections.abc import Sequence
from typing import Any

import numpy as np

from .background import Window

HELD = 2**23  # bytes of windows in memory; beyond, all of them lie in a file without a name


class Kept(Sequence["Window | None"]):
    """Windows about one ball, of one type of numbers, in the order of the frames; None where none was kept. Two threads
    may ask at once."""

    def __init__(self) -> None:
        self._file = tempfile.SpooledTemporaryFile(HELD)  # noqa: SIM115  gone with this
        self._where = array("q")  # of each its first byte (-1: none), height, width, x0, y0
        self._end, self._type = 0, np.dtype(np.uint8)
        self._turn = threading.Lock()

    def append(self, window: Window | None) -> None:
        """The window of the next frame; none is kept where there is no room for it."""
        self._where.extend(self._kept(window) or (-1, 0, 0, 0, 0))

    def put(self, i: int, window: Window | None) -> None:
        """Another window of frame i; the one before stays where there is no room for it."""
        if where := self._kept(window):
            self._where[5 * i : 5 * i + 5] = array("q", where)

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
