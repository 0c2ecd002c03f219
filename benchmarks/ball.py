"""Ball trackers beside each other: `python benchmarks/ball.py [--frames N]` prints a markdown table.

Films are rendered here by area sampling (8 x 8 a pixel, Gaussian blur 0.6 px, 8 bits); the truth is what was drawn.
Peers: trackpy (`pip install jumpvision[bench]`) and the published half-height threshold centroid. Set
JUMPVISION_REAL_DATA to add the scatter about a parabola of a real falling ball.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from jumpvision.films.arrays.track import track as of_arrays
from jumpvision.films.vision.ball.film import track_ball

BACK, CONTRAST, PSF, FINE = 30.0, 150.0, 0.6, 8
Positions = tuple[NDArray[np.float64], NDArray[np.float64]]


def disc_image(shape: tuple[int, int], x: float, y: float, d: float) -> NDArray[np.float64]:
    """Part of each pixel that is ball, blurred."""
    yy, xx = (np.indices((shape[0] * FINE, shape[1] * FINE)) + 0.5) / FINE - 0.5
    inside = np.clip((d / 2 - np.hypot(xx - x, yy - y)) * FINE + 0.5, 0.0, 1.0)
    return gaussian_filter(inside, PSF * FINE).reshape(shape[0], FINE, shape[1], FINE).mean((1, 3))


def cramer_rao(shape: tuple[int, int], d: float, noise: float) -> float:
    """Least standard error of a coordinate [px], from differences of the renderer at four sub-pixel positions."""
    information = []
    for k in range(4):
        x, y = shape[1] / 2 + 0.23 * k, shape[0] / 2 + 0.41 * k
        slope = CONTRAST * (disc_image(shape, x + 0.02, y, d) - disc_image(shape, x - 0.02, y, d)) / 0.04
        information.append(np.sum(slope**2) / (noise**2 + 1 / 12))
    return float(np.mean(information) ** -0.5)


def ours(images: list[NDArray[np.uint8]], d: float, method: str) -> tuple[Positions, NDArray[np.float64]]:
    t = track_ball(
        images,
        diameter=d,
        polarity="bright",
        method=method,
        search=1.5,
        seed=None,
        streak=False,
        exposure_fraction=0.0,
    )
    return (t.x, t.y), t.sigma


def by_trackpy(images: list[NDArray[np.uint8]], d: float) -> tuple[Positions, NDArray[np.float64]]:
    try:
        import trackpy
    except ImportError:
        sys.exit("benchmarks/ball.py compares with trackpy: pip install 'jumpvision[bench]'")
    trackpy.quiet()
    size = 2 * int(0.6 * d) + 3  # odd, a little larger than the ball
    found = [trackpy.locate(i, size, minmass=100, topn=1, max_iterations=100, engine="numba") for i in images]
    x, y = ([f[c].iloc[0] if len(f) else np.nan for f in found] for c in ("x", "y"))
    return (np.array(x), np.array(y)), np.full(len(images), np.nan)


METHODS: dict[str, Callable[[list[NDArray[np.uint8]], float], tuple[Positions, NDArray[np.float64]]]] = {
    "disc": lambda images, d: ours(images, d, "disc"),
    "threshold": lambda images, d: ours(images, d, "threshold"),
    "trackpy": by_trackpy,
}


def rendered(n: int) -> None:
    rng = np.random.default_rng(2)
    print(
        "| diameter px | noise grey | method | RMS error px | over Cramer-Rao | coverage of 1 sigma | lost "
        "| frames/s of processor time |"
    )
    print("|---|---|---|---|---|---|---|---|")
    for d in (10.0, 19.0, 40.0):
        shape = (int(2 * d + 18), int(2 * d + 25))
        xs, ys = shape[1] / 2 + rng.uniform(-1, 1, n), shape[0] / 2 + rng.uniform(-1, 1, n)
        clean = [BACK + CONTRAST * disc_image(shape, x, y, d) for x, y in zip(xs, ys)]
        for noise in (2.0, 5.0, 15.0):
            images = [np.clip(np.rint(c + rng.normal(0, noise, shape)), 0, 255).astype(np.uint8) for c in clean]
            bound = cramer_rao(shape, d, noise)
            for name, method in METHODS.items():
                method(images[:2], d)  # compiled before the clock starts
                start = time.process_time()
                (x, y), sigma = method(images, d)
                speed = n / (time.process_time() - start)
                error = np.concatenate([x - xs, y - ys])
                rms = np.sqrt(np.nanmean(error**2))
                stated = np.concatenate([sigma, sigma])
                known = np.isfinite(stated)
                inside = f"{np.mean(np.abs(error[known]) < stated[known]):.0%}" if known.any() else "none stated"
                lost = int(np.isnan(x).sum())
                row = f"{d:g} | {noise:g} | {name} | {rms:.4f} | {rms / bound:.2f} | {inside} | {lost} | {speed:.0f}"
                print(f"| {row} |")


def photron(folder: str) -> NDArray[np.uint16]:
    """The real film (15, 384, 384) of 12 bits: a dark ball of 126 px that falls."""
    raw = np.fromfile(os.path.join(folder, "photron_ball_12bit", "ball_12bit.mraw"), np.uint8).astype(np.uint16)
    b = raw.reshape(-1, 3)
    return np.stack([b[:, 0] << 4 | b[:, 1] >> 4, (b[:, 1] & 15) << 8 | b[:, 2]], 1).reshape(15, 384, 384)


def real(folder: str) -> None:
    frames = photron(folder)
    print("\nReal back-lit ball, 126 px, falling 2.65 px a frame: RMS about a parabola [px]\n")
    print("| method | x | y | stated sigma, last frame |\n|---|---|---|---|")
    k = np.arange(len(frames))
    for method in ("disc", "threshold"):
        t = track_ball(
            frames,
            diameter=126.3,
            polarity="dark",
            method=method,
            search=1.0,
            seed=None,
            streak=False,
            exposure_fraction=0.6,
        )
        scatter = [np.std(v - np.polyval(np.polyfit(k, v, 2), k)) for v in (t.x, t.y)]
        print(f"| {method} | {scatter[0]:.4f} | {scatter[1]:.4f} | {t.sigma[-1]:.4f} |")


CODECS = ("none", "lens", "jpeg 50", "MJPG", "mp4v")
LENS = 0.3  # px: shrinking alone leaves a rim sharper than a pixel, which no lens shows


def plain_centroid(images: list[NDArray[np.uint8]], level: float) -> Positions:
    """Mean place of the pixels of the ball's side of a level, which is bright here."""
    places = [np.nonzero(i > level) for i in images]
    return np.array([p[1].mean() for p in places]), np.array([p[0].mean() for p in places])


SHRUNK, OFFSETS = (3, 4, 6, 8), ((0, 0), (1, 2), (2, 1), (2, 2))  # times; px of the film, by which pixels are laid anew


def compressed(folder: str) -> None:
    """The real film, ball made bright, shrunk to four sizes by four grids of pixels each, through codecs: scatter by
    third differences, which a smooth motion leaves none; errors by the four grids."""
    frames = photron(folder)
    print(
        "\nThe same film, shrunk, through codecs: RMS of third differences over sqrt(20) [px], four grids of pixels\n"
    )
    print(
        "| codec | ball px | jv.track | plain centroid | trackpy | jv.track over trackpy |\n|---|---|---|---|---|---|"
    )
    for codec in CODECS:
        for times in SHRUNK:
            d, scatter = 126.3 / times, []
            film = frames.astype(np.float32)
            if codec == "lens":
                film = np.array([cv2.GaussianBlur(f, (0, 0), LENS * times) for f in film])
            for down, right in OFFSETS:
                n = (384 - max(down, right)) // times
                part = film[:, down : down + n * times, right : right + n * times]
                small = part.reshape(15, n, times, n, times).mean(axis=(2, 4)) / 16.0
                images = [np.clip(np.rint(255.0 - f), 0, 255).astype(np.uint8) for f in small]
                images = through(codec, images, 50.0)
                level = 0.5 * (float(np.percentile(images[0], 2)) + float(np.percentile(images[0], 98)))
                t = of_arrays(np.array(images), diameter=d)
                tracks = (t.x_px.to_numpy(), t.y_px.to_numpy()), plain_centroid(images, level), by_trackpy(images, d)[0]
                scatter.append([np.sqrt(np.nanmean([np.diff(v, 3) ** 2 for v in xy]) / 20.0) for xy in tracks])
            rms, ratio = np.sqrt(np.mean(np.square(scatter), axis=0)), np.log([r[0] / r[2] for r in scatter])
            middle, error = np.exp(np.mean(ratio)), np.std(ratio, ddof=1) / np.sqrt(len(ratio))
            numbers = " | ".join(f"{r:.4f}" for r in rms)
            print(f"| {codec} | {d:.0f} | {numbers} | {middle:.2f} ± {middle * error:.2f} |", flush=True)


def through(codec: str, images: list[NDArray[np.uint8]], fps: float) -> list[NDArray[np.uint8]]:
    """The images as a file of the codec gives them back."""
    if codec in ("none", "lens"):
        return images
    if codec.startswith("jpeg"):
        how = [cv2.IMWRITE_JPEG_QUALITY, int(codec.split()[1])]
        return [np.asarray(cv2.imdecode(cv2.imencode(".jpg", i, how)[1], 0)) for i in images]
    with tempfile.TemporaryDirectory() as folder:
        path = os.path.join(folder, "film.avi")
        film = cv2.VideoWriter(path, cv2.VideoWriter_fourcc(*codec), fps, images[0].shape[::-1])  # type: ignore[attr-defined]
        for i in images:
            film.write(cv2.cvtColor(i, cv2.COLOR_GRAY2BGR))
        film.release()
        back, out = cv2.VideoCapture(path), []
        while (got := back.read())[0]:
            out.append(cv2.cvtColor(got[1], cv2.COLOR_BGR2GRAY))
    return out


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=int, default=200, help="frames of each film")
    rendered(parser.parse_args().frames)
    if os.environ.get("JUMPVISION_REAL_DATA"):
        real(os.environ["JUMPVISION_REAL_DATA"])
        compressed(os.environ["JUMPVISION_REAL_DATA"])
