"""Interlaced films: each frame holds two half pictures, every other row, half a frame apart in time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from jumpvision.base.arrays import Image
from jumpvision.films.frames.base import Film, is_mosaic

COMBED = 1.3  # mean square of what differs between neighbouring rows over that between rows of one half picture
MOVED = 6.0  # of the frames' usual difference: pixels that something moves over

INTERLACED = (
    "the film is interlaced: every frame shows two instants, and was followed as it stands. Make each half picture a "
    "frame, at twice the frame rate: ffmpeg -i FILM -vf bwdif=mode=send_field -c:v ffv1 NEW.mkv (if what moves then "
    "jumps back and forth, bwdif=mode=send_field:parity=bff)"
)


def is_interlaced(frames: Sequence[Image] | Film) -> bool:
    """Return True if what moves in the frames (H, W) combs as in an interlaced film.

    Neighbouring rows then differ more than rows of one half picture, which are farther apart, and more than where
    nothing moves.
    """
    n = len(frames)
    if n < 2 or len(np.asarray(frames[0])) < 8 or is_mosaic(np.asarray(frames[0])):  # its rows alternate by colour
        return False
    at = np.unique(np.linspace(0, n - 2, min(8, n - 1)).astype(int))  # eight places of the film
    thin = slice(None, None, max(1, np.asarray(frames[0]).shape[1] // 640))
    combs: list[tuple[float, float, float]] = []  # in what moves: neighbours, half picture; neighbours elsewhere
    for k in at:
        a, b = (np.asarray(frames[int(k + j)])[:, thin].astype(np.float32) for j in (0, 1))
        change = np.abs(a - b)[2:-2]
        moved = change > MOVED * max(1.0, *(float(np.median(change[k::2])) for k in (0, 1)))
        if moved.sum() < 30 or moved.all():  # too few to tell
            continue
        near, far = _squared_differences(a)
        combs.append((float(near[moved].mean()), float(far[moved].mean()), float(near[~moved].mean())))
    if not combs:
        return False
    inside, across, still = np.mean(combs, axis=0)  # what goes slowly combs little, and weighs little here
    return bool(inside >= max(COMBED * across, 2.0 * still))  # and twice what combs where nothing moves


def _squared_differences(image: Image) -> tuple[Image, Image]:
    """Squares of second differences (H - 4, W) to the next rows, and to the next rows of the same half picture."""
    middle = 2.0 * image[2:-2]
    return (image[1:-3] - middle + image[3:-1]) ** 2, (image[:-4] - middle + image[4:]) ** 2
