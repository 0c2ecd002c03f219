"""One frame as the tracker sees it: parts of it on demand, without the still scene where that is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .background import Background


@dataclass(frozen=True)
class Window:
    """pixels: (row, column) part of a frame, its first at (x0, y0)."""

    pixels: NDArray[Any]
    x0: int
    y0: int


class View:
    """A frame (row, column) of grey levels, whole or as the window that was kept of it.

    whole: gives the frame where the window does not reach. scene: taken out of every part (values are floats then).
    """

    def __init__(
        self,
        shape: tuple[int, int],
        *,
        whole: Callable[[], NDArray[Any]],
        window: Window | None = None,
        scene: Background | None = None,
    ):
        self.shape = shape
        self._window, self._whole, self._scene = window, whole, scene

    @classmethod
    def of(cls, image: NDArray[Any]) -> View:
        """The view of a whole image."""
        return cls((image.shape[0], image.shape[1]), whole=lambda: image, window=Window(image, 0, 0))

    def part(self, y0: int, y1: int, x0: int, x1: int) -> NDArray[Any]:
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

    def everything(self) -> NDArray[Any]:
        """The whole frame."""
        return self.part(0, self.shape[0], 0, self.shape[1])
