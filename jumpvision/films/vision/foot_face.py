"""Row of the foot's lower face in a side-wall film, to a fraction of a pixel, also where the body has a texture."""

from __future__ import annotations

import io
import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.films.calibration import FACE_OF_FOOT

from .foot_body import Body


@dataclass(frozen=True)
class FootTrack:
    """Lower face of the foot in each frame; NaN where lost."""

    row: Array  # (n,) [px], down, pixel centres at integers: the face is the edge between body and grains
    sigma: Array  # (n,) [px], standard uncertainty without the error of the face's place on the body (below)
    flag: NDArray[np.str_]  # (n,) empty when good, else the reason
    offset_sigma: float  # [px], standard uncertainty of that place, shared by all rows of a textured body

    def as_bytes(self) -> bytes:
        """It, to be kept."""
        out = io.BytesIO()
        np.savez(out, row=self.row, sigma=self.sigma, flag=self.flag, offset=self.offset_sigma)
        return out.getvalue()

    @classmethod
    def of_bytes(cls, data: bytes) -> FootTrack:
        """The track of `as_bytes`."""
        with np.load(io.BytesIO(data)) as kept:
            return cls(kept["row"], kept["sigma"], kept["flag"], float(kept["offset"]))


def track_foot(
    images: Iterable[NDArray[np.generic]], *, row: float, column: float, half_width: float, depth: int, search: float
) -> FootTrack:
    """Follow the lower face of the foot through images (H, W) [grey], one after the other.

    row: [px] the face in frame 0, to 3 px. column, half_width: [px] the body covers |x - column| < half_width.
    depth: [px] height of the body compared, above the face. search: [px] largest change of the motion from one frame to
    the next. The foot moves along the rows only.
    Raises ValueError if the body leaves the image in frame 0 or frames differ in size.
    """
    rows, sigmas, flags = [], [], []
    body: Body | None = None
    stack = Stack()
    shape: tuple[int, ...] = ()
    last, speed, lost = row, 0.0, 0
    for k, image in enumerate(images):
        if body is None:
            shape = image.shape
            body = Body(image, row, column, half_width, depth)
        if image.shape != shape:
            raise ValueError(
                f"frame {k} is {image.shape} px (rows, columns), frame 0 is {shape}: crop them to one size"
            )
        reach = min(search * (1 + lost), max(shape)) if k else 3.0
        found = body.find(image, last + speed * (1 + lost), reach)
        rows.append(found.row)
        sigmas.append(found.sigma)
        flags.append(found.flag)
        if found.flag:
            lost += 1
            continue
        if found.by_texture:
            stack.add(image[:, body.columns], found.row)
        speed = (found.row - last) / (1 + lost) if k else 0.0
        last, lost = found.row, 0
    if body is None:
        return FootTrack(np.array([]), np.array([]), np.array([], dtype=np.str_), math.nan)
    shift, offset_sigma = stack.face() if 2 * stack.n > len(rows) else (0.0, math.inf)
    if math.isinf(offset_sigma):
        shift, offset_sigma = 0.0, body.offset_sigma
    sigma = math.hypot(FACE_OF_FOOT.value, offset_sigma)
    return FootTrack(np.array(rows) + shift, np.array(sigmas), np.array(flags, dtype=np.str_), sigma)


ABOVE, BELOW = 12, 8  # rows about the expected face that are laid over each other
BLOCK = 16  # columns that share a grain


class Stack:
    """Sum and sum of squares over the frames, on rows that move with the body."""

    def __init__(self) -> None:
        self.n = 0
        self.u = np.arange(-ABOVE, BELOW + 1.0)  # rows below the expected face
        self.sum: Array | float = 0.0
        self.squares: Array | float = 0.0

    def add(self, strip: NDArray[np.generic], face: float) -> None:
        """Lay a frame's columns of the body (H, columns) [grey] over the others; left out where the rows do not fit."""
        first = math.floor(face) - ABOVE - 3
        if first < 0 or first + ABOVE + BELOW + 8 > len(strip):
            return
        part = np.asarray(strip[first : first + ABOVE + BELOW + 8], np.float64)
        at = np.asarray(scipy.ndimage.shift(part, (first + ABOVE - face, 0.0), order=1, mode="nearest"))[: len(self.u)]
        self.sum, self.squares, self.n = self.sum + at, self.squares + at * at, self.n + 1

    def face(self) -> tuple[float, float]:
        """Rows by which the face lies below the expected one, and its standard uncertainty; infinite where not seen.

        With I = T (1 - Phi) + G Phi and the body T the same in all frames, the standard deviation over the frames is
        Phi times that of the grains: half of it at the face, whatever the blur. Taken over all blocks of columns below
        which grains change: a single block is as uneven as its few grains and, in a noisy film, far too deep. Sigma:
        jackknife over the blocks.
        """
        if self.n < 6:  # frames that tell a scatter
            return 0.0, math.inf
        variance = np.maximum(np.asarray(self.squares) / self.n - (np.asarray(self.sum) / self.n) ** 2, 0.0)
        blocks = variance.shape[1] // BLOCK
        variance = variance[:, : blocks * BLOCK].reshape(len(self.u), blocks, BLOCK).mean(2)
        # the grey below the face must change three times as much as above it: less is no end of a body
        changing = variance[:, variance[-4:].mean(0) > 3.0**2 * variance[:3].mean(0)]
        n = changing.shape[1]
        if n < max(4, blocks // 4):  # a jackknife over fewer says little
            return 0.0, math.inf
        centre = _face(self.u, changing.mean(1))
        others = np.array([_face(self.u, np.delete(changing, k, axis=1).mean(1)) for k in range(n)])
        if not (math.isfinite(centre) and np.isfinite(others).all()):
            return 0.0, math.inf
        return centre, math.sqrt((n - 1) / n * float(np.sum((others - centre) ** 2)))


def _face(u: Array, variance: Array) -> float:
    """Where the standard deviation over the frames is half of the grains', from the variance on the rows u."""
    body, grains = variance[:3].mean(), variance[-4:].mean()
    return _rise(u, np.sqrt(np.maximum(variance - body, 0.0) / (grains - body)))


def _rise(u: Array, spread: Array) -> float:
    """Where `spread` rises through a half on the way down; NaN where it takes more than 2.5 rows from 1/4 to 3/4.

    Grains that are jammed below the face go with it and change little by little with depth: they hide the end.
    """
    places = []
    for level in (0.25, 0.5, 0.75):
        below = np.flatnonzero(spread < level)
        if below.size == 0 or below[-1] == len(u) - 1:
            return math.nan
        i = int(below[-1])
        places.append(float(u[i] + (level - spread[i]) / (spread[i + 1] - spread[i])))
    return places[1] if places[2] - places[0] < 2.5 else math.nan
