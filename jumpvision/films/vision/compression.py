"""What a film that was compressed hides of small motions.

A codec that predicts frames shifts a block of the last frame by quarters of a pixel and writes what is left only as
far as its bits go; of what moves by less it copies the block. A pattern's place is then off by some hundredths of a
pixel, for a whole frame at once, which no scatter within a field can show.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from jumpvision.base.arrays import Image
from jumpvision.films.calibration import CODED_BITS, CODED_OFF, OLD_CODEC
from jumpvision.films.frames.base import Film

BLOCK, INSIDE = 16, 4  # px: of a codec's grid, and the rim of a block that is smoothed over afterwards
LEAST, SURE, PAIRS = 0.05, 3.0, 4  # share of the blocks; standard deviations; pairs of frames
NEW_CODECS, PLAIN = ("h264", "hevc", "vp9", "av1"), "Baseline"
TOLD = 0.005  # px, from which on it is said
CODED = (
    "compressed{}: all displacements of a pair of frames may be off together by {:.2g} px, which their sigmas include; "
    "piv.baseline = 9 divides it by up to 9 where the motion lasts; FFV1, PNG or raw films lose nothing"
)


def coding(film: Film | None, frames: Sequence[Image] | Film) -> tuple[float, str]:
    """(error, words): of a displacement [px] between two frames of a film, by its codec, or by what the frames show
    where no codec is known; what to tell of it, or ""."""
    error, by = (coded_error(film), f" by {film.meta.get('codec')}") if film is not None else (0.0, "")
    if not error:
        error, by = copied_error(frames), ", as blocks that are copied show"
    return error, CODED.format(by, error) if error >= TOLD else ""


def coded_error(film: Film) -> float:
    """Error of a displacement [px] that a film's codec adds, by the bits it spends on a pixel of a frame that it
    predicts; 0 where it loses nothing or keeps every frame for itself."""
    bits = film.meta.get("bits_per_pixel")
    if not bits:
        return 0.0
    # what an old codec or a plain profile writes takes more bits
    new = film.meta.get("codec") in NEW_CODECS and PLAIN not in film.meta.get("profile", "")
    return CODED_OFF.value / (1.0 + bits / (CODED_BITS.value * (1.0 if new else OLD_CODEC.value)))


def copied_error(frames: Sequence[Image] | Film) -> float:
    """The same of frames from nobody knows where: of few bits, where blocks of the codec's grid are copied from one
    to the next, and fewer of those between them; else 0. Of the first frames, PAIRS are looked at."""
    pairs = [(frames[i], frames[i + 1]) for i in range(0, min(len(frames) - 1, 2 * PAIRS), 2)]
    on, off = (np.sum([_copied(a, b, first) for a, b in pairs], axis=0) for first in (0, BLOCK // 2))
    if not (on[1] and off[1]):
        return 0.0
    shares = [float(same / shown) for same, shown in (on, off)]
    scatter = math.hypot(*(math.sqrt(max(p * (1 - p), 1 / n) / n) for p, n in zip(shares, (on[1], off[1]))))
    return CODED_OFF.value if shares[0] - shares[1] > max(LEAST, SURE * scatter) else 0.0


def _copied(a: Image, b: Image, first: int) -> tuple[int, int]:
    """How many blocks' inside is in the next frame to the last digit, and of how many that are not of one grey."""
    inside = BLOCK - 2 * INSIDE
    blocks = []
    for image in (np.asarray(a), np.asarray(b)):
        rows, columns = ((n - first) // BLOCK for n in image.shape)
        part = image[first : first + rows * BLOCK, first : first + columns * BLOCK]
        part = part.reshape(rows, BLOCK, columns, BLOCK)[:, INSIDE:-INSIDE, :, INSIDE:-INSIDE]
        blocks.append(part.swapaxes(1, 2).reshape(rows * columns, inside * inside))
    shown = np.ptp(blocks[0], axis=1) > 0
    same = (blocks[0] == blocks[1]).all(axis=1)
    return int(same[shown].sum()), int(shown.sum())
