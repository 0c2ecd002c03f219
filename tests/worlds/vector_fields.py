"""Noise of vectors whose windows overlap."""

import numpy as np


def window_noise(rng, ny, nx, length, sub=8):
    """Unit noise as overlapping windows make it: means of white noise over windows `length` grid steps wide."""
    if length <= 1:
        return rng.normal(0.0, 1.0, (ny, nx))
    w = int(length * sub)
    f = rng.normal(0.0, 1.0, ((ny - 1) * sub + w, (nx - 1) * sub + w))
    c = np.pad(f.cumsum(0).cumsum(1), ((1, 0), (1, 0)))
    return (c[w:, w:] - c[:-w, w:] - c[w:, :-w] + c[:-w, :-w])[::sub, ::sub] / w
