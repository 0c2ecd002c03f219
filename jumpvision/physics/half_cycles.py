"""Laws of two half cycles: each with its own frequency, and a pause between them (thesis section 2.5.3, Fig 36)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.physics.hard import sine_rows

Array = NDArray[np.float64]


def half_cycle_rows(
    frequency: ArrayLike, frequency2: ArrayLike, amplitude: ArrayLike, phase: ArrayLike, delay: ArrayLike
) -> Array:
    """Rows of a forcing.Segments, shape (..., 3, 6): half a cycle, a pause of `delay` seconds, half a cycle.

    frequency, frequency2 [Hz] of the first and second half, amplitude [m], phase [rad] at the start, delay >= 0 [s];
    the arguments broadcast. X_m = A [sin(angle) - sin(phase)], angle running over phase..phase + pi..phase + 2 pi; with
    cos(phase) != 0 and two frequencies the velocity steps between the halves. Without a pause the second half stands
    in two rows. ValueError for a bad argument.
    """
    sine_rows(frequency, amplitude, phase, 1.0)  # refuses what no law may hold
    f1, f2, amp, ph, wait = np.broadcast_arrays(
        *(np.asarray(v, float) for v in (frequency, frequency2, amplitude, phase, delay))
    )
    if not (np.isfinite(f2).all() and (f2 > 0.0).all()):
        raise ValueError(f"frequency2 = {f2[~(f2 > 0.0)].flat[:1]} must be a finite number > 0 Hz")
    if not (np.isfinite(wait).all() and (wait >= 0.0).all()):
        raise ValueError(f"delay = {wait[~(wait >= 0.0)].flat[:1]} must be a finite number >= 0 s")
    w1, w2, base, half = 2 * np.pi * f1, 2 * np.pi * f2, -amp * np.sin(ph), 0.5 / f1
    paused = wait > 0.0
    middle = np.where(paused, half + wait, half + 0.25 / f2)
    end = half + wait + 0.5 / f2
    zero = np.zeros(f1.shape)
    first = (zero, half, base, amp, w1, ph)
    pause = (
        half, middle, np.where(paused, base + amp * np.sin(ph + np.pi), base), np.where(paused, 0.0, amp),
        np.where(paused, 0.0, w2), np.where(paused, 0.0, ph + np.pi),
    )  # fmt: skip
    second = (middle, end, base, amp, w2, np.where(paused, ph + np.pi, ph + 1.5 * np.pi))
    return np.stack([np.stack(row, axis=-1) for row in (first, pause, second)], axis=-2)
