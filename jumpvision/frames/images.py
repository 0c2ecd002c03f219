"""Image sequences: a folder, a glob pattern or a single image, in natural order (2 before 10)."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jumpvision.frames.base import Film, FrameError, Image, clock
from jumpvision.frames.imagefile import SUFFIXES, image_size, read_image


class ImageFilm(Film):
    """Images as the frames of a film; all of one size and depth. Times come from the declared frame rate and, where
    the files are numbered with gaps, from their numbers: a missing image leaves a gap in time, it shifts nothing."""

    def __init__(
        self, path: Path, *, files: Sequence[Path] | None = None, frame_rate: float | None, start: float
    ) -> None:
        self._files = list(files or [path])
        sizes = [image_size(file) for file in self._files]  # before a pixel is decoded: a damaged size is refused here
        first = read_image(self._files[0])
        for file, size in zip(self._files, sizes):
            if size != first.shape:
                raise FrameError(
                    f"{file}: {size[0]} x {size[1]} pixels, but {self._files[0].name} has {first.shape[0]} x "
                    f"{first.shape[1]}; a film needs one size; leave it out or give a pattern that does"
                )
        positions, warnings = numbered(path, self._files)
        super().__init__(
            path,
            shape=(first.shape[0], first.shape[1]),
            dtype=first.dtype,
            clock=clock(path, len(self._files), start=start, frame_rate=frame_rate, positions=positions),
            warnings=warnings,
            meta={"format": "images", "bit_depth": 8 * first.dtype.itemsize},
        )

    def _read(self, i: int) -> Image:
        file = self._files[i]
        image = read_image(file)
        if image.shape != self.shape or image.dtype != self.dtype:
            raise FrameError(
                f"{file}: {image.shape} {image.dtype}, but the film has {self.shape} {self.dtype}; "
                "save all images of a film alike"
            )
        return image

    def close(self) -> None:
        self._files = []


def natural(path: Path) -> list[str | int]:
    return [int(part) if part.isdecimal() else part for part in re.split(r"([0-9]+)", path.name.lower())]


def image_files(path: Path) -> list[Path]:
    """The images of a folder or pattern in natural order. Raises FrameError for none or a mixed folder."""
    if path.is_dir():
        files = [
            f for f in path.iterdir() if f.suffix.lower() in SUFFIXES and not f.name.startswith(".") and f.is_file()
        ]
        kinds = Counter(f.suffix.lower() for f in files)
        if len(kinds) > 1:
            found = ", ".join(f"{n} {kind}" for kind, n in sorted(kinds.items()))
            raise FrameError(
                f"{path}: the folder mixes {found} images; give a pattern such as {path.name}/*{min(kinds)}"
            )
    else:
        files = [f for f in path.parent.glob(path.name) if f.is_file()]
        for file in files:
            if file.suffix.lower() not in SUFFIXES:
                raise FrameError(
                    f"{file}: no image, but matches {path.name}; allowed: {' '.join(SUFFIXES)}; narrow the pattern"
                )
    if not files:
        raise FrameError(f"{path}: no image here; allowed: {' '.join(SUFFIXES)}")
    return sorted(files, key=lambda f: (natural(f), f.name))


def numbered(path: Path, files: Sequence[Path]) -> tuple[NDArray[np.float64] | None, list[str]]:
    """(frame numbers from 0 or None, warnings): gaps in the last number of names that agree in all else."""
    parts = [re.fullmatch(r"(.*?)([0-9]+)([^0-9]*)", f.stem) for f in files]
    if len(files) < 3 or not all(parts) or len({(p[1], p[3]) for p in parts if p}) > 1:
        return None, []
    numbers = np.array([float(p[2]) for p in parts if p])
    gaps = np.diff(numbers)
    step = float(np.median(gaps))
    if step <= 0 or (gaps == step).all():
        return None, []
    if (gaps % step).any() or (gaps <= 0).any():
        return None, [f"{path}: the images are numbered unevenly; they are timed as if none were missing"]
    k = int(np.argmax(gaps != step))
    missing = int((gaps / step - 1).sum())
    return (numbers - numbers[0]) / step, [
        f"{path}: {missing} images are missing by their numbers, first after {files[k].name}; their times are left free"
    ]
