"""Displacements in films that x264 has compressed, against truth: slope, rms error, sigma and how often it covers.

    python -m benchmarks.compressed 12000     # first seed; about 5 minutes on two idle cores

Two renderers that share nothing: Gaussian particles, and opaque shaded discs on 4 x 4 sub-pixels; moved by 0.05 to
1 px a frame, noise of 2 grey levels, crf 18, 23, 28; window 32 px, vectors every 16 px. Films of 9 frames, and of 21
with and without `piv.baseline = 9`.
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from pathlib import Path

import av
import numpy as np
from numpy.typing import NDArray

import jumpvision as jv

Array = NDArray[np.float64]
SHAPE, SUB = (192, 256), 4
SIZES, CRF = (0.05, 0.1, 0.2, 0.5, 1.0), (18, 23, 28)


def particles(x: Array, y: Array, rng: np.random.Generator) -> Array:
    """2,500 spots of 3 px at x, y."""
    light = rng.uniform(60, 160, x.size)
    down, along = (np.exp(-((np.arange(n)[:, None] - p) ** 2) / (2 * 1.2**2)) for n, p in zip(SHAPE, (y, x)))
    return np.asarray(30 + (down * light) @ along.T)


def grains(x: Array, y: Array, rng: np.random.Generator) -> Array:
    """Discs of 5 to 9 px, darker to their rims, each over those before it; only the first 1,600."""
    h, w = (SUB * n for n in SHAPE)
    picture = np.full((h, w), 25.0)
    radius, light = SUB * rng.uniform(2.5, 4.5, 1600), rng.uniform(50, 200, 1600)
    for a, b, r, grey in zip(SUB * (x + 0.5), SUB * (y + 0.5), radius, light):
        rows, columns = (slice(max(int(c - r), 0), max(min(int(c + r) + 2, n), 0)) for c, n in ((b, h), (a, w)))
        part = picture[rows, columns]
        j, i = np.ogrid[rows, columns]
        off = ((j + 0.5 - b) ** 2 + (i + 0.5 - a) ** 2) / r**2
        part[off < 1] = (grey * (1 - 0.4 * off))[off < 1]
    return np.asarray(picture.reshape(SHAPE[0], SUB, SHAPE[1], SUB).mean((1, 3)))


def film(path: Path, draw: str, way: Array, crf: int, frames: int, seed: int) -> None:
    """Write an mp4 of what moves by `way` [px a frame]."""
    rng = np.random.default_rng(seed)
    x, y = (rng.uniform(-12, n + 12, 2500) for n in SHAPE[::-1])
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=50)
        stream.height, stream.width = SHAPE
        stream.pix_fmt, stream.options = "yuv420p", {"crf": str(crf)}
        for k in np.arange(frames) - (frames - 1) / 2:
            picture = DRAWN[draw](x + k * way[0], y + k * way[1], np.random.default_rng(seed + 1))
            noisy = np.clip(np.rint(picture + rng.normal(0, 2, SHAPE)), 0, 235).astype(np.uint8)
            image = av.VideoFrame.from_ndarray(noisy, format="gray").reformat(format="yuv420p")
            container.mux(stream.encode(image))
        container.mux(stream.encode())


DRAWN = {"particles": particles, "grains": grains}


def main(first: int) -> None:
    print("| film | crf | films | slope at 0.05 and 0.1 px | rms error, px | sigma, px | within 1, 2, 3 sigma, % |")
    print("|---" * 7 + "|")
    for frames, baseline in ((9, 1), (21, 1), (21, 9)):
        for crf in CRF:
            slopes, rows = [], []
            for draw in DRAWN:
                for size in SIZES:
                    seed = first + round(100 * size) + crf + frames
                    angle = np.random.default_rng(seed).uniform(0.2, 1.37)
                    way = size * np.array([np.cos(angle), np.sin(angle)])
                    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
                        warnings.simplefilter("ignore")  # that it is compressed
                        path = Path(folder) / "film.mp4"
                        film(path, draw, way, crf, frames, seed)
                        f = jv.piv(str(path), window=32, step=16, baseline=baseline, frame_rate=1.0)
                    off = np.stack([f.u.values - way[0], -f.v.values - way[1]])
                    sigma = np.stack([f.u_sigma.values, f.v_sigma.values])
                    seen = np.isfinite(off)
                    covers = [100 * np.mean((np.abs(off) < k * sigma)[seen]) for k in (1, 2, 3)]
                    rows.append([np.mean(off[seen] ** 2), np.median(sigma[seen]) ** 2, *covers])
                    if size < 0.15:
                        slopes.append(1 + float(np.nanmean(np.tensordot(way, off, 1)) / size**2))
            error, sigma_rms, *inside = np.mean(rows, axis=0)
            print(
                f"| {frames} frames, baseline {baseline} | {crf} | {len(rows)} | {min(slopes):.2f}-{max(slopes):.2f} | "
                f"{error**0.5:.3f} | {sigma_rms**0.5:.3f} | {', '.join(f'{c:.0f}' for c in inside)} |",
                flush=True,
            )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 12000)
