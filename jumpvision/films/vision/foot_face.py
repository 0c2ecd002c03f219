"""Row of the foot's lower face in a side-wall film, to a fraction of a pixel, also where the body has a texture."""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.films.calibration import FACE_OF_FOOT, GRAINS_AT_FACE

from .foot_body import MAX_SIGMA, Body


@dataclass(frozen=True)
class FootTrack:
    """Lower face of the foot in each frame; NaN where lost."""

    row: Array  # (n,) [px], down, pixel centres at integers: the face is the edge between body and grains
    sigma: Array  # (n,) [px], standard uncertainty without the error of the face's place on the body (below)
    flag: NDArray[np.str_]  # (n,) empty when good, else the reason
    offset_sigma: float  # [px], standard uncertainty of that place, shared by all rows of a textured body


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
    if math.isinf(offset_sigma):  # the edge in frame 0: what the grains lack at the face is in no term of its fit
        shift, offset_sigma = 0.0, math.hypot(FACE_OF_FOOT.value, body.offset_sigma)
    return FootTrack(np.array(rows) + shift, np.array(sigmas), np.array(flags, dtype=np.str_), offset_sigma)


ABOVE, BELOW = 12, 8  # rows about the expected face that are laid over each other
BLOCK = 16  # columns that share a grain
# px below the expected face, px of blur, by how much of itself the grains' scatter grows in a row: what is tried
PLACES, WIDTHS, GROWTHS = np.arange(-5.4, 5.41, 0.05), np.arange(0.45, 1.36, 0.15), np.arange(-0.25, 0.66, 0.15)


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
        Phi times that of the grains (`place`). Taken over all blocks of columns together: a single one is as uneven as
        its few grains, and those that change most deep below the face change less at it. Sigma: of the place, and the
        jackknife over the blocks.
        """
        if self.n < 6:  # frames that tell a scatter
            return 0.0, math.inf
        variance = np.maximum(np.asarray(self.squares) / self.n - (np.asarray(self.sum) / self.n) ** 2, 0.0)
        blocks = variance.shape[1] // BLOCK
        variance = variance[:, : blocks * BLOCK].reshape(len(self.u), blocks, BLOCK).mean(2)
        # the grey below the face must change twice as much as above it: less is no end of a body
        changing = np.sum(variance[-4:].mean(0) > 2.0**2 * variance[:3].mean(0))
        if changing < max(4, blocks // 4):  # a jackknife over fewer says little
            return 0.0, math.inf
        centre, sigma = place(self.u, _spread(variance))
        others = np.array([place(self.u, _spread(np.delete(variance, k, axis=1)))[0] for k in range(blocks)])
        sigma = math.hypot(sigma, math.sqrt((blocks - 1) / blocks * float(np.sum((others - centre) ** 2))))
        return (centre, sigma) if sigma < MAX_SIGMA else (0.0, math.inf)


def _spread(variance: Array) -> Array:
    """Standard deviation of the grains over the frames (rows,), from the variance (rows, blocks)."""
    whole = variance.mean(1)
    return np.sqrt(np.maximum(whole - whole[:3].mean(), 0.0))


def place(u: Array, spread: Array) -> tuple[float, float]:
    """Face [rows u, one apart] and its standard uncertainty, from the grains' standard deviation on these rows.

    Model: g (1 + s d) Phi(d / b) at the depth d below the face; no growth s above it. Of round grains that end at a
    face there is less right below it than deeper, so half of the scatter deep below it lies 0.3 px too deep; blur and
    growth are known beforehand as GRAINS_AT_FACE has it, and the mean over all of both and of g is taken. The best
    model's misfit widens it where it is more than such a model leaves.
    """
    (blur, by), (growth, grows), rough = GRAINS_AT_FACE.value
    f, b, s = (a.ravel() for a in np.meshgrid(PLACES, WIDTHS, GROWTHS, indexing="ij"))
    rows = np.searchsorted(u, f - 2.5)[:, None] + np.arange(5)
    d = u[rows] - f[:, None]
    model = scipy.special.ndtr(d / b[:, None]) * (1.0 + s[:, None] * np.maximum(d, 0.0))
    power = (model**2).sum(1)
    g = (model * spread[rows]).sum(1) / power
    deep = float(spread[-4:].mean())
    quiet = spread[rows[:, :1] - np.arange(1, 5)]  # rows of the body alone, which count as one
    chi2 = ((spread[rows] - g[:, None] * model) ** 2).sum(1) + (quiet**2).mean(1)
    chi2 /= (rough * deep) ** 2
    logarithm = -0.5 * (chi2 + (np.log(b / blur) / by) ** 2 + ((s - growth) / grows) ** 2 + np.log(power))
    logarithm[g < 0.2 * deep] = -np.inf  # what changes so little beside the grains is no end of a body
    best = int(np.argmax(logarithm))
    if not PLACES[0] < f[best] < PLACES[-1]:
        return float(f[best]), math.inf
    likely = np.exp(logarithm - logarithm[best])
    centre = float(np.average(f, weights=likely))
    sigma = math.sqrt(float(np.average((f - centre) ** 2, weights=likely)))
    return centre, sigma * math.sqrt(max(1.0, float(chi2[best]) / (rows.shape[1] - 2)))
