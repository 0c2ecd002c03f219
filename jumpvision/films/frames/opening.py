"""One door to every film format: the suffix names the reader, which is imported only then."""

from __future__ import annotations

import contextlib
import importlib
import math
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

from jumpvision.base.arrays import Image
from jumpvision.base.storage import irregular

from .base import Film, FrameError, is_mosaic
from .pictures import SUFFIXES, ImageFilm, image_names

READERS: dict[str, tuple[str, str]] = {  # suffix: module of this folder, its Film
    **dict.fromkeys((".avi", ".mp4", ".m4v", ".mkv", ".mov", ".webm"), ("video", "VideoFilm")),
    **dict.fromkeys(SUFFIXES, ("pictures", "ImageFilm")),
    **dict.fromkeys((".tif", ".tiff"), ("tiff", "TiffFilm")),
    **dict.fromkeys((".mraw", ".cih", ".cihx"), ("mraw", "MrawFilm")),
    ".cine": ("cine", "CineFilm"),
    ".seq": ("seq", "SeqFilm"),
    ".npy": ("arrays", "NpyFilm"),
    **dict.fromkeys((".h5", ".hdf5"), ("arrays", "Hdf5Film")),
}


def open_frames(
    path: str | os.PathLike[str],
    *,
    frame_rate: float | None = None,
    start: float = 0.0,
    pattern_root: str | os.PathLike[str] | None = None,
    seen: Callable[[Image], None] | None = None,
    axes: str = "",
) -> Film:
    """The film at `path`: a film file, a folder of images, a glob pattern of images or a single image.

    frame_rate: declared frames per second [Hz]; used where the file has no time stamps of its own, else compared with
    them. start: common clock [s] at the start of the first exposure. pattern_root: folder that a relative path or
    pattern starts from (default: the working folder). seen: called with every frame, in order, where opening the film
    means to decode it anyway; the film's `shown` then says whether these were exactly its frames. axes: how the data
    set of an HDF5 film counts, one of AXES. Raises FrameError when the film cannot be read at all.
    """
    if frame_rate is not None and not (math.isfinite(frame_rate) and frame_rate > 0):
        raise FrameError(f"{path}: frame_rate = {frame_rate!r}; must be > 0 Hz")
    if not math.isfinite(start):
        raise FrameError(f"{path}: start = {start!r}; must be a finite number of seconds")
    full = Path(pattern_root or "") / path
    if full.is_dir() or (not full.exists() and any(c in full.name for c in "*?[")):
        return _with_pixel_warnings(ImageFilm(full, names=image_names(full), frame_rate=frame_rate, start=start))
    if not full.exists():
        raise FrameError(f"{full}: no such file; name a film, a folder of images or a pattern such as frames/*.png")
    if problem := irregular(full):
        raise FrameError(f"{full}: {problem}")
    if full.suffix.lower() not in READERS:
        allowed = " ".join(sorted(READERS))
        raise FrameError(f"{full}: unknown film format '{full.suffix}'; allowed: {allowed}; convert it to one of these")
    if full.stat().st_size == 0:
        raise FrameError(f"{full}: the file is empty (0 bytes); copy it from the camera again")
    module, name = READERS[full.suffix.lower()]
    reader = getattr(importlib.import_module(f"{__package__}.{module}"), name)
    if axes and not reader.counts_axes:
        raise FrameError(f"{full}: axes = '{axes}': only of an HDF5 film; leave it out")
    asked: dict[str, Any] = {"seen": seen} if seen is not None and reader.decodes_on_opening else {}
    asked |= {"axes": axes} if axes else {}
    film: Film = reader(full, frame_rate=frame_rate, start=start, **asked)
    return _with_pixel_warnings(film)


def _with_pixel_warnings(film: Film) -> Film:
    """Add warnings of a colour mosaic and of a copy that was cut off, by the first and last frame."""
    with contextlib.suppress(FrameError):  # a frame that cannot be read is an error when it is asked for
        first = film[0]
        if is_mosaic(first):
            film.warnings += (
                f"{film.path}: its grey pixels are a colour camera's mosaic (Bayer), in which neighbours see other "
                "colours: edges lie half a pixel off; export it in colour, or as grey made from colour",
            )
        if film.bare and len(film) > 1 and first.any() and not film[-1].any():
            film.warnings += (
                f"{film.path}: the last frame is all 0: was its copy cut off? Copy it again, or leave out what is dark "
                "(exclude_frames)",
            )
    return film
