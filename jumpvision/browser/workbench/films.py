"""A film as a browser shows it: frames as JPEG at the size of the screen, those that come next made ahead."""

from __future__ import annotations

import threading
import time
from collections import OrderedDict
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.schema import InputError
from jumpvision.experiment.init.recognise import opened
from jumpvision.films.frames import Film

KEPT = 256 * 2**20  # bytes of encoded frames
AHEAD = 48  # frames made ahead of the one that was asked for
BEHIND = 32  # frames made together with one that lies before the last one read, where such a read is SLOW
SLOW = 0.03  # s: a film that is decoded again from a key frame
QUIET = 0.08  # s without a question, after which frames are made ahead
QUALITY = 85  # of a JPEG
WIDTHS = (64, 4096)  # px that may be asked for
DARKEST, BRIGHTEST = 0.1, 99.9  # percentiles of grey that become black and white


def stretched(image: NDArray[Any]) -> NDArray[Any]:
    """0 to 255, from its darkest to its brightest 0.5 %; black where a value is missing."""
    low, high = np.nanpercentile(image, (0.5, 99.5))
    return np.asarray(np.clip((np.nan_to_num(image) - low) * (255.0 / max(high - low, 1e-6)), 0, 255))


class Shown:
    """One film, opened once; any thread may ask."""

    def __init__(self, path: Path, film: Film | None = None):
        timed = True
        if film is None:
            film, timed = opened(path)
        self.film, self.timed, self.path = film, timed, path
        self._reading, self._keeping = threading.Lock(), threading.Lock()
        self._kept: OrderedDict[tuple[int, int], bytes] = OrderedDict()
        self._size, self._wanted, self._closed = 0, (0, 0), False
        self._last, self._slow = -1, False  # frame read last; whether reading back is slow
        self._wake = threading.Event()
        self._low, self._high = self._range()
        threading.Thread(target=self._prepare, daemon=True).start()

    def __len__(self) -> int:
        return len(self.film)

    def grey(self, i: int) -> NDArray[Any]:
        """Frame i as recorded. InputError for one that is not there."""
        if not 0 <= i < len(self.film):
            raise InputError([f"{self.path}: frame = {i}: must be in [0, {len(self.film) - 1}]"])
        with self._reading:
            return self._read(i)

    def _read(self, i: int) -> NDArray[Any]:
        back, began = i < self._last, time.perf_counter()
        image = self.film[i]
        self._slow = self._slow or (back and time.perf_counter() - began > SLOW)
        self._last = i
        return image

    def jpeg(self, i: int, width: int) -> bytes:
        """Frame i, no wider than `width` [px]; its neighbours ahead are made next."""
        if not WIDTHS[0] <= width <= WIDTHS[1]:
            raise InputError([f"{self.path}: width = {width}: must be in [{WIDTHS[0]}, {WIDTHS[1]}] px"])
        found = self._jpeg(i, width)
        self._wanted = (i, width)
        self._wake.set()
        return found

    def close(self) -> None:
        self._closed = True
        self._wake.set()
        with self._reading:
            self.film.close()

    def _jpeg(self, i: int, width: int) -> bytes:
        with self._keeping:
            if (i, width) in self._kept:
                self._kept.move_to_end((i, width))
                return self._kept[i, width]
        if self._slow and 0 < i < self._last:  # a hand that goes back: those before it are decoded on the way
            with self._reading:
                for k in range(max(0, i - BEHIND), i):
                    if (k, width) not in self._kept:
                        self._keep(k, width, self._encoded(self._read(k), width))
        made = self._encoded(self.grey(i), width)
        self._keep(i, width, made)
        return made

    def _keep(self, i: int, width: int, made: bytes) -> None:
        with self._keeping:
            if (i, width) not in self._kept:
                self._kept[i, width] = made
                self._size += len(made)
            while self._size > KEPT:
                self._size -= len(self._kept.popitem(last=False)[1])

    def _encoded(self, image: NDArray[Any], width: int) -> bytes:
        rows, columns = image.shape
        if columns > width:
            image = cv2.resize(image, (width, max(1, round(rows * width / columns))), interpolation=cv2.INTER_AREA)
        k = 255.0 / max(self._high - self._low, 1e-12)
        if image.dtype.kind == "f":
            grey = np.clip((np.nan_to_num(image) - self._low) * k, 0, 255).astype(np.uint8)
        else:
            grey = cv2.convertScaleAbs(cv2.subtract(image, np.full_like(image, round(self._low))), alpha=k)
        return cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1].tobytes()

    def _range(self) -> tuple[float, float]:
        """Grey values that are shown black and white, the same in all frames."""
        n = len(self.film)
        seen = [np.nanpercentile(self.grey(i)[::2, ::2], (DARKEST, BRIGHTEST)) for i in sorted({0, n // 2, n - 1})]
        return float(min(s[0] for s in seen)), float(max(s[1] for s in seen))

    def _prepare(self) -> None:
        """Makes frames ahead of the one asked for last; gives way as soon as another is asked for."""
        while True:
            self._wake.wait()
            self._wake.clear()
            if not self._closed and self._wake.wait(QUIET):
                continue  # a hand is moving: what it asks for comes first
            if self._closed:
                return
            first, width = self._wanted
            for i in range(first + 1, min(first + AHEAD, len(self.film))):
                if self._closed or self._wake.is_set():
                    break
                self._jpeg(i, width)
