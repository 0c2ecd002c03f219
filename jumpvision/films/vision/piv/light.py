"""The light of a film before it is matched: its background taken away, its contrast made alike everywhere."""

from __future__ import annotations

import functools
import math
import warnings
from collections.abc import Iterable, Iterator, Sequence
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from jumpvision.base.arrays import Array, Image
from jumpvision.base.schema import StageWarning
from jumpvision.films.frames.base import Frames
from jumpvision.films.parameters import PivParams

from .pair import MATCHED, MEASURED, VectorField


class Light(NamedTuple):
    """What is done to frame i. common: (H, W) subtracted, of either exposure; tile: of CLAHE [px], 0: none."""

    common: tuple[NDArray[np.float32], ...]
    tile: int

    def __call__(self, image: Image, i: int) -> Image:
        if self.common:
            image = image.astype(np.float32) - self.common[i % len(self.common)]
        return equalised(image, self.tile) if self.tile else image


def light_of(frames: Frames, stride: int, p: PivParams) -> Light:
    """What [params.piv] asks for; a background of double exposures (stride 2) is that of A and of B."""
    wanted = p.background != "none"
    return Light(tuple(common(frames, p.background, k, stride) for k in range(stride)) if wanted else (), p.clahe)


SPARSE = 1.5  # times further from one extreme than from the other the mean lies, where particles leave the ground free
FEW = 32  # frames; of fewer each leaves so much of its particles in the mean that vectors suffer
# share of what leaves its place in a film that is still there after a third of it, above which it is in the background,
# too: drawn grains and particles, seeds 4200, 4700; from it on the mean covers 59 % and less, the minimum 42 %
STAYED = {"mean": 0.4, "minimum": 0.65}
KEPT = (
    'background = "{}": what moves has hardly left its place within a third of the {} frames, so some of it is '
    'subtracted and displacements come out too small; take a longer film, or background = "none"'
)
AGREED = 49  # px, some seven grains: side of the neighbourhoods in which parts of the film are compared


def common(frames: Frames, how: str, first: int, stride: int) -> NDArray[np.float32]:
    """Ground (H, W) by minimum or mean of 64 frames or fewer, evenly from `first` on, `stride` apart; see `ground`.

    Of sparse particles the mean of FEW frames is their median. Of dark ones on a bright ground the minimum is the
    maximum, which is told.
    """
    every = np.arange(first, len(frames), stride)
    if every.size < 3:
        raise ValueError(f'[params.piv] background = "{how}": needs 3 frames or pairs, found {every.size}; take "none"')
    shown = every[np.unique(np.linspace(0, every.size - 1, min(every.size, 64)).round().astype(int))]
    if stayed(*(frames[int(shown[k])] for k in np.linspace(0, shown.size - 1, 4).round().astype(int))) > STAYED[how]:
        warnings.warn(StageWarning("light", KEPT.format(how, shown.size)), stacklevel=2)
    third = shown.size // 3
    parts = [_held(frames, q) for q in (shown[:third], shown[third:-third], shown[-third:])]
    low, mean, high = (
        np.min([q.low for q in parts], axis=0),
        np.asarray(sum(q.total for q in parts) / np.float32(shown.size), np.float32),
        np.max([q.high for q in parts], axis=0),
    )
    below, above = float(np.nanmean(mean - low)), float(np.nanmean(high - mean))
    if how == "minimum" and below > SPARSE * above:
        said = 'background = "minimum": the particles are darker than the ground, so what is subtracted is the maximum'
        warnings.warn(StageWarning("light", said), stacklevel=2)
        return ground(high, parts[0].high, parts[2].high)
    if how == "minimum":
        return ground(low, parts[0].low, parts[2].low)
    if shown.size < FEW and max(below, above) > SPARSE * min(below, above):
        held = np.array([frames[int(i)] for i in shown], np.float32)
        return ground(*(np.median(q, axis=0) for q in (held, held[:third], held[-third:])))
    return ground(mean, *(parts[k].total / np.float32(third) for k in (0, 2)))


def stayed(*four: Image) -> float:
    """Return the share that stays for a frame of what moves between the first and the last of four evenly timed frames
    (H, W); what stands does not count."""
    high = [_high(f.astype(np.float32)) for f in four]

    def alike(a: int, b: int) -> float:
        size = math.sqrt(float(np.sum(high[a] ** 2)) * float(np.sum(high[b] ** 2)))
        return float(np.sum(high[a] * high[b])) / size if size else 1.0

    far = alike(0, 3)
    near = (alike(0, 1) + alike(1, 2) + alike(2, 3)) / 3
    return (near - far) / (1 - far) if far < 1 else 0.0


STANDS = 0.04  # share of the light that stands still: displacements come out smaller by it
STANDING = (
    "{:.0%} of the light stands still where the rest moves by {:.2g} px: particles on the glass, or a background; "
    "displacements come out too small by about that share: clean it, or subtract it with a long film (background)"
)


class MeanMotion:
    """Mean displacement of the fields of a film, gathered as they pass."""

    def __init__(self) -> None:
        self.x = self.y = np.zeros(0)
        self.period = 0.0  # px, of a pattern that repeats
        self.textured = 0  # windows with texture
        self._sum, self._count = np.zeros((2, 1, 1)), np.zeros((1, 1))

    def watch(self, fields: Iterable[VectorField]) -> Iterator[VectorField]:
        """Give the fields on, their measured vectors added."""
        for f in fields:
            good = np.isin(f.reason, MEASURED)
            self.textured += int(np.isin(f.reason, MATCHED).sum())
            self.x, self.y, self.period = f.x, f.y, max(self.period, f.period)
            self._sum, self._count = self._sum + np.where(good, (f.u, f.v), 0.0), self._count + good
            yield f

    @property
    def share(self) -> float:
        """Return the share of the windows with texture that were matched."""
        return float(self._count.sum()) / self.textured if self.textured else 1.0

    @property
    def mean(self) -> Array:
        """(2, ny, nx) [px a pair], 0 where never measured."""
        return self._sum / np.maximum(self._count, 1)


def three_of(n: int, stride: int, gap: int) -> list[int]:
    """Return the numbers of the first, second and last frame of n that are steps of `gap` apart; none of pairs."""
    return [0, gap, (n - 1) // gap * gap] if stride == 1 and n > 2 * gap else []


FEW_MATCHED = 0.3  # share of the windows below which vectors are hardly more than chance
UNMATCHED = (
    "{:.0%} of the windows with texture were matched; the others are interpolated between these and say nothing: "
    "do the frames show the same scene, close enough in time?"
)
REPEATING = (
    "the pattern repeats every {:.3g} px: displacements are known but for that; the smallest is given, with a sigma "
    "that holds the period. Mark the pattern, or film it faster"
)


def doubts_of(frames: Sequence[Image], motion: MeanMotion, n: int, gap: int) -> list[str]:
    """Tell what makes the displacements of a film of n frames doubtful. frames (H, W): as `three_of` names them."""
    repeating = [REPEATING.format(motion.period)] if motion.period else []
    if motion.share < FEW_MATCHED:
        repeating.append(UNMATCHED.format(motion.share))
    return [*repeating, *filter(None, [standing(frames, motion, n, gap)])]


def standing(frames: Sequence[Image], motion: MeanMotion, n: int, gap: int) -> str:
    """Tell of light that stands still while the rest of a film of n frames moves; "" where none does.

    frames (H, W): as `three_of` names them. Of what stands the last frame is as like the first as the second, carried
    back, is; of what moves only as like as the second, carried on: the same grains and other noise.
    """
    if not frames:
        return ""
    moved, x, y, apart = motion.mean, motion.x, motion.y, (n - 1) // gap
    a, second, b = (_high(f.astype(np.float32)) for f in frames)
    power = float(np.mean(a * second))
    size = next((k for k in range(1, 17) if np.mean(a[:, k:] * second[:, :-k]) < 0.1 * power), 17)
    there = np.nan_to_num(apart * np.hypot(*moved)) > 0.5 * size  # px
    rows, columns = (np.interp(np.arange(n), at, np.arange(at.size)) for n, at in zip(a.shape, (y, x)))
    use = there[np.ix_(np.rint(rows).astype(int), np.rint(columns).astype(int))]
    pixels = int(use.sum())
    if size > 16 or pixels < (32 * size) ** 2:
        return ""
    place = np.meshgrid(rows, columns, indexing="ij")
    step = [map_coordinates(d, place, np.float32, order=1) for d in moved]
    column, row = np.meshgrid(*(np.arange(n, dtype=np.float32) for n in a.shape[::-1]))

    def carried(steps: int) -> Image:
        """The second frame, `steps` of them later."""
        return map_coordinates(second, [row - steps * step[1], column - steps * step[0]], np.float32, order=1)

    on, back = (carried(k)[use] for k in (apart - 1, -1))
    a, b = a[use], b[use]
    share = float(np.sum(a * (b - on)) / max(float(np.sum(a * (back - on))), 1e-9))
    if share < max(STANDS, 3.0 * size / math.sqrt(pixels)):  # what grains are alike by chance
        return ""
    return STANDING.format(share, apart * float(np.median(np.hypot(*moved)[there])))


def _high(f: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a frame (H, W) without its smooth light; 0 where it is not known."""
    known = np.isfinite(f)
    return np.where(known, f - _around(f, known), np.float32(0))


class _Held(NamedTuple):
    """Of some frames (H, W)."""

    low: NDArray[np.float32]
    total: NDArray[np.float32]
    high: NDArray[np.float32]


def _held(frames: Frames, chosen: NDArray[np.int64]) -> _Held:
    total = frames[int(chosen[0])].astype(np.float32)
    low, high = total.copy(), total.copy()
    for i in chosen[1:]:
        frame = frames[int(i)]
        low, high, total = np.minimum(low, frame), np.maximum(high, frame), total + frame
    return _Held(low, total, high)


def ground(whole: NDArray[np.float32], first: NDArray[np.float32], last: NDArray[np.float32]) -> NDArray[np.float32]:
    """Of the background (H, W) of all frames what is smooth over AGREED px, and of the rest the share in which the
    backgrounds of their first and last third agree: the other share are grains, which would stand still in all frames.
    """

    known = np.isfinite(whole + first + last)
    around = functools.partial(_around, known=known)
    smooth = around(whole)
    alike = around((first - around(first)) * (last - around(last)))
    power = around((whole - smooth) ** 2)
    share = np.clip(alike / np.maximum(power, np.float32(1e-6)), 0, 1)
    return np.asarray(smooth + share * (whole - smooth), np.float32)


def _around(f: NDArray[np.floating], known: NDArray[np.bool_]) -> NDArray[np.float32]:
    """Means of what is known (H, W) over AGREED px."""
    there = np.maximum(cv2.blur(known.astype(np.float32), (AGREED, AGREED)), np.float32(1e-6))
    return np.asarray(cv2.blur(np.where(known, f, 0).astype(np.float32), (AGREED, AGREED)) / there, np.float32)


def equalised(image: Image, tile: int) -> NDArray[np.float32]:
    """A frame (H, W) by contrast-limited adaptive histogram equalisation in tiles of that side [px]; 0 to 255."""
    grey = image.astype(np.float32)
    low, high = float(np.nanmin(grey)), float(np.nanmax(grey))
    whole = np.nan_to_num((grey - low) * (65535.0 / max(high - low, 1e-6))).astype(np.uint16)
    rows, columns = (max(1, round(n / tile)) for n in image.shape)
    # cut at three times the mean of a tile's histogram
    even = cv2.createCLAHE(clipLimit=3.0, tileGridSize=(columns, rows)).apply(whole)
    return np.asarray(np.where(np.isfinite(grey), even * np.float32(255.0 / 65535.0), np.nan), np.float32)
