"""How strongly both frames are smoothed before they are matched: lightly against noise, more against aliasing.

Detail finer than two pixels comes out of the camera as coarser detail that does not move with the grains. A wider
Gaussian takes it off, and texture with it. Where noise sets the error (grains of 5 px and more, or any noise above a
grey level) the light one is better by 8-30 %, on sharp texture without noise the strong one by up to a half. The grey
of one frame cannot tell noise from aliasing; the vectors can: the true field is the same under both, so the field that
is rougher has the larger errors.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jumpvision.vision.piv.field import MEASURED, VectorField

Array = NDArray[np.float64]

LIGHT, STRONG = 0.8, 1.1  # px, standard deviation of the Gaussian
BLOCK, ENOUGH = 32, 256  # px, side of the blocks whose spectra are averaged (Welch 1967), and how many tell enough
FINE = 0.3  # cycles/px, above which detail lies within the reach of aliasing
CORNER = 0.4  # cycles/px along both axes: white noise, as the camera's optics let little else through
SHARP = 0.45  # share of fine detail that asks for a trial: particles of 4 px have 0.13, of 3 px 0.39, of 2.5 px 0.55
GAIN = 0.95  # of the roughness: less is chance


def sharp(image: NDArray[np.generic], mask: NDArray[np.bool_] | None) -> bool:
    """Whether more than SHARP of the power of the gradient lies above FINE, the level of white noise taken off.

    image (H, W), mask (H, W) True = usable; blocks with unusable or NaN pixels are left out. False without any block.
    """
    rows, columns = (n // BLOCK for n in image.shape)
    grey = image[: rows * BLOCK, : columns * BLOCK].astype(np.float32)
    if mask is not None:
        grey[~mask[: grey.shape[0], : grey.shape[1]]] = np.nan
    blocks = grey.reshape(rows, BLOCK, columns, BLOCK).swapaxes(1, 2).reshape(-1, BLOCK, BLOCK)
    blocks = blocks[np.isfinite(blocks).all((1, 2))]
    if not len(blocks):
        return False
    blocks = blocks[:: -(-len(blocks) // ENOUGH)]
    hann = 0.5 - 0.5 * np.cos(2 * np.pi * (np.arange(BLOCK) + 0.5) / BLOCK)
    waves = np.fft.fft2((blocks - blocks.mean((1, 2), keepdims=True)) * np.outer(hann, hann).astype(np.float32))
    k = np.abs(np.fft.fftfreq(BLOCK))
    power, far = (np.abs(waves) ** 2).mean(0), np.hypot(k, k[:, None])
    corner = np.minimum(k, k[:, None]) > CORNER
    slope = (power - power[corner].mean()) * far**2
    inside = far <= 0.5
    return bool(slope[inside & (far > FINE)].sum() > SHARP * slope[inside].sum())


def roughness(f: VectorField, reach: int) -> float:
    """Median [px^2] of the squared second differences of the measured vectors, `reach` vectors apart; NaN if none.

    Vectors a window apart have errors of their own; nearer ones share the texture that is aliased.
    """
    known = np.isin(f.reason, MEASURED)
    along_y = [np.where(known, g, np.nan) for g in (f.u_raw, f.v_raw)]
    fields = [*along_y, *(q.T for q in along_y)]
    bends = np.concatenate([(q[2 * reach :] - 2 * q[reach:-reach] + q[: -2 * reach]).ravel() for q in fields])
    bends = bends[np.isfinite(bends)]
    return float(np.median(bends**2)) if bends.size else np.nan
