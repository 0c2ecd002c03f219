"""Interlaced films: each frame holds two half pictures (fields), every other row, half a frame apart in time."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Image
from jumpvision.films.frames.base import Film

ORDERS = ("together", "top", "bottom")  # as they come; the upper, the lower rows first
COMBED = 1.3  # mean square of what differs between neighbouring rows over that between rows of one field
MOVED = 6.0  # of the frames' usual difference: pixels that something moves over

INTERLACED = 'the film is interlaced: every frame shows two instants; give {} = "{}" to follow both'


def field(image: Image, lower: bool) -> Image:
    """One field of a frame (H, W) at its full height, the rows between by the mean of their neighbours."""
    first = int(lower)
    mine = image[first::2].astype(np.float32)
    out = np.empty(image.shape, np.float32)
    out[first::2] = mine
    gaps = out[1 - first :: 2]
    between = 0.5 * (mine[:-1] + mine[1:])
    gaps[:first] = mine[0]  # a row above the first of its own
    gaps[first : first + len(between)] = between
    gaps[first + len(between) :] = mine[-1]
    return out if image.dtype.kind == "f" else np.rint(out).astype(image.dtype)


class Fields(Film):
    """The fields of an interlaced film as frames, twice as many, one after the other; lower: the lower rows first."""

    shown = False

    def __init__(self, film: Film, *, lower: bool):
        self.__dict__.update(film.__dict__)  # its shape, warnings and meta are those of the film
        step = np.diff(film.time, append=np.nan)
        usual = float(np.nanmedian(step)) if len(film) > 1 else 0.0
        half = 0.5 * np.where(np.isfinite(step) & (step < 1.5 * usual), step, usual)
        self.time = np.stack([film.time, film.time + half], axis=1).ravel()
        self._film, self._lower, self._last = film, lower, (-1, np.empty((0, 0)))

    def _read(self, i: int) -> Image:
        if self._last[0] != i // 2:
            self._last = i // 2, self._film[i // 2]
        return field(self._last[1], self._lower != bool(i % 2))

    def close(self) -> None:
        self._film.close()


def order_of(frames: Sequence[Image] | Film) -> str:
    """ "top" or "bottom" where frames are interlaced, by the field that is first; "" where they are not, or none moves.

    In what moves, rows of an interlaced frame comb: neighbours differ more than rows of one field, which are farther
    apart, and more than where nothing moves. Of the two orders it is the one by which the fields that meet from one
    frame to the next comb less, where one of them clearly does; what moves by more than itself between fields combs by
    both, and then the one by which it goes less far.
    """
    n = len(frames)
    if n < 2 or len(np.asarray(frames[0])) < 8:
        return ""
    at = np.unique(np.linspace(0, n - 2, min(8, n - 1)).astype(int))  # eight places of the film
    thin = slice(None, None, max(1, np.asarray(frames[0]).shape[1] // 640))
    pairs = [[np.asarray(frames[int(k + j)])[:, thin].astype(np.float32) for j in (0, 1)] for k in at]
    moving: list[tuple[Image, Image, NDArray[np.bool_]]] = []
    combs: list[tuple[float, float, float]] = []  # in what moves: between neighbours, in a field; neighbours elsewhere
    for a, b in pairs:
        change = np.abs(a - b)[2:-2]
        moved = change > MOVED * max(1.0, *(float(np.median(change[k::2])) for k in (0, 1)))
        if moved.sum() < 30 or moved.all():  # too few to tell
            continue
        near, far = _combs(a)
        combs.append((float(near[moved].mean()), float(far[moved].mean()), float(near[~moved].mean())))
        moving.append((a, b, moved))
    if not combs:
        return ""
    inside, across, still = np.mean(combs, axis=0)  # what goes slowly combs little, and weighs little here
    if inside < max(COMBED * across, 2.0 * still):  # and twice what combs where nothing moves
        return ""
    scene = np.median([f for pair in pairs for f in pair], axis=0)
    meets, ways = [], []  # by the upper over the lower rows first: combing; how far what moves goes between fields
    for a, b, moved in moving:
        woven = [a.copy(), a.copy()]
        for k in (0, 1):  # the second field of a and the first of b
            woven[k][k::2] = b[k::2]
        upper, lower = (float(_combs(w)[0][moved].sum()) + 1e-9 for w in woven)
        meets.append(math.log(upper / lower))
        places = [_middle(f - scene, k) for f in (a, b) for k in (0, 1)]
        ways.append((np.hypot(*(places[1] - places[2])), np.hypot(*(places[0] - places[3]))))
    fast = [near > COMBED * far for near, far, _ in combs]
    # logarithm of how much the fields that meet comb by both orders: less does not tell them
    if abs(clear := float(np.median(np.array(meets)[fast]))) > 0.22:
        return "top" if clear < 0.0 else "bottom"
    way = np.array(ways)[fast]
    if not np.isfinite(way).all(axis=1).any():
        return ""
    top, bottom = np.nanmedian(way, axis=0)
    return "" if top == bottom else "top" if top < bottom else "bottom"


def _middle(off: Image, first: int) -> Image:
    """(row, column) of what stands out from the scene in one field; NaN where nothing does."""
    size = np.abs(off[first::2])
    size = np.where(size > MOVED * max(1.0, float(np.median(size))), size, 0.0)
    total = float(size.sum())
    if not total:
        return np.full(2, np.nan)
    rows, columns = size.sum(axis=1), size.sum(axis=0)
    return np.array([2.0 * (rows @ np.arange(rows.size)) + first, columns @ np.arange(columns.size)]) / total


def _combs(image: Image) -> tuple[Image, Image]:
    """Squares of second differences (H - 4, W) to the next rows, and to the next rows of the same field."""
    middle = 2.0 * image[2:-2]
    return (image[1:-3] - middle + image[3:-1]) ** 2, (image[:-4] - middle + image[4:]) ** 2
