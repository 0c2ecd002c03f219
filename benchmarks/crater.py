"""Laser line: our noise-weighted Gaussian beside a centre of mass and a ridge after Steger (1998), on drawn lines."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.signal import savgol_filter

from jumpvision.films.vision.laser_line import laser_line
from jumpvision.laboratory.films.bed import laser_picture
from jumpvision.laboratory.films.optics import record

Array = NDArray[np.float64]
NX, ROWS, PICTURES = 500, 160, 3
KINDS: dict[str, dict[str, float]] = {
    "no speckle": {},
    "speckle 3 %": {"speckle": 0.03},
    "speckle 5 %": {"speckle": 0.05},
    "speckle 15 %": {"speckle": 0.15},
    "5 %, line 1.2 px": {"speckle": 0.05, "width": 1.2},
    "5 %, line 3.5 px": {"speckle": 0.05, "width": 3.5},
    "5 %, clipped crest": {"speckle": 0.05, "lamp": 1.6},
    "5 %, a third of the light": {"speckle": 0.05, "lamp": 0.33},
}


def draw(seed: int, *, speckle: float = 0.0, width: float = 2.0, lamp: float = 1.0) -> tuple[NDArray[np.uint8], Array]:
    """(picture, true rows): a bowl with a rim on a slope, crest, width and background changing along it."""
    rng = np.random.default_rng(seed)
    x = np.arange(NX, dtype=float)
    r = np.abs(x - NX / 2 + rng.uniform(-9, 9))
    line = 70 + rng.uniform(-0.5, 0.5) + 40 * np.exp(-((r / 70) ** 2)) - 8 * np.exp(-(((r - 115) / 30) ** 2)) + 0.01 * x
    dark = 20.0 + 15.0 * (x / NX)[None, :] + 15.0 * (np.arange(ROWS) / ROWS)[:, None]
    mean = laser_picture(
        line, rows=ROWS, width=width * (1 + 0.2 * np.sin(x / 60)), peak=lamp * 180 * (1 + 0.25 * np.sin(x / 85 + 1)),
        background=dark, speckle=speckle, speckle_size=1.5, rng=rng,
    )  # fmt: skip
    return record(mean, electrons_per_grey=60.0, read_noise=1.5, rng=rng), line


def centre_of_mass(image: Array, width: float) -> Array:
    """Mean row of the grey values above the background, three widths about the brightest row."""
    reach = int(np.ceil(3 * width))
    top = np.argmax(gaussian_filter(image, 1.5), axis=0)
    rows = np.clip(top + np.arange(-reach, reach + 1)[:, None], 0, len(image) - 1)
    y = image[rows, np.arange(image.shape[1])]
    y = np.clip(y - np.linspace(y[:2].mean(axis=0), y[-2:].mean(axis=0), len(y)), 0.0, None)
    return np.asarray((y * rows).sum(axis=0) / y.sum(axis=0))


def ridge(image: Array, width: float) -> Array:
    """Zero of the slope across the ridge by the Taylor polynomial at its brightest pixel, carried to the column."""
    s = width / np.sqrt(3.0)
    gx, gy, gxx, gxy, gyy = (gaussian_filter(image, s, order=o) for o in ((0, 1), (1, 0), (0, 2), (1, 1), (2, 0)))
    top = np.argmax(gaussian_filter(image, s), axis=0)
    at = top, np.arange(image.shape[1])
    hessian = np.moveaxis(np.array([[gxx[at], gxy[at]], [gxy[at], gyy[at]]]), -1, 0)
    value, vector = np.linalg.eigh(hessian)
    n = vector[:, :, 0]
    t = -(gx[at] * n[:, 0] + gy[at] * n[:, 1]) / value[:, 0]
    # from the point (t n_x, t n_y) along the ridge (-n_y, n_x) to the middle of the column
    return np.asarray(top + t * n[:, 1] + t * n[:, 0] ** 2 / n[:, 1])


def bound(*, speckle: float = 0.0, width: float = 2.0, lamp: float = 1.0) -> float:
    """Cramér-Rao bound of a row of `draw` [px], rms over its columns: what no method that takes each column for itself
    and knows neither width, crest nor background can beat.

    Gaussian noise of the covariance that the picture has: photons, read-out and rounding of each pixel for itself, and
    speckle, contrast^2 I_r I_s exp(-(r - s)^2 / (2 0.75^2)) averaged over the pixels. Clipped pixels say nothing.
    """
    x, rows = np.arange(NX, dtype=float)[::10], np.arange(-22, 23, dtype=float)
    fine = (np.arange(4 * rows.size) + 0.5) / 4 + rows[0] - 0.5
    shared = np.exp(-0.5 * (np.subtract.outer(fine, fine) / 0.75) ** 2)
    across = np.exp(-0.5 * (np.subtract.outer(fine[:4], fine[:4]) / 0.75) ** 2).mean()  # over the pixel's width
    variance = []
    for at in x:
        w, a = width * (1 + 0.2 * np.sin(at / 60)), lamp * 180 * (1 + 0.25 * np.sin(at / 85 + 1))
        b = 27.5 + 15.0 * at / NX
        r = (at * 0.37) % 1.0 - 0.5
        light = a * np.exp(-0.5 * ((fine - r) / w) ** 2)

        def pixel(v: Array) -> Array:
            return np.asarray(v.reshape(rows.size, 4).mean(axis=1))

        mean = pixel(light) + b
        two = speckle**2 * across * shared * light[:, None] * light[None, :]
        noise = two.reshape(rows.size, 4, rows.size, 4).mean(axis=(1, 3)) + np.diag(mean / 60 + 1.5**2 + 1 / 12)
        u = (fine - r) / w
        jac = np.stack([pixel(light * u / w), pixel(light * u**2), pixel(light), np.ones(rows.size), rows / 22], axis=1)
        seen = mean < 255.0
        j = jac[seen]
        variance.append(np.linalg.inv(j.T @ np.linalg.solve(noise[np.ix_(seen, seen)], j))[0, 0])
    return float(np.sqrt(np.mean(variance)))


def main() -> None:
    """A table: rms error of a row and the time of a picture, by method, beside the bound."""
    methods: dict[str, Callable[[Any, float], Array]] = {
        "ours": lambda a, w: laser_line(a, saturation=255.0).row,
        "centre of mass": lambda a, w: centre_of_mass(a.astype(float), w),
        "ridge": lambda a, w: ridge(a.astype(float), w),
    }
    laser_line(draw(0)[0])  # compiled
    print(
        f"rms error of a row [px] over {PICTURES} pictures of {NX} columns, and how often sigma covers ours;\n"
        "the bound is that of Cramér and Rao for a column by itself, the smoothed rows are ours under a parabola "
        "over 9 columns\n"
    )
    print(
        f"| line | {' | '.join(methods)} | bound | ours, smoothed | sigma covers |\n|---|{'---|' * (len(methods) + 3)}"
    )
    seconds = dict.fromkeys(methods, 0.0)
    for kind, options in KINDS.items():
        error: dict[str, list[Array]] = {m: [] for m in methods}
        z = []
        for seed in range(PICTURES):
            picture, line = draw(seed, **options)
            for name, method in methods.items():
                began = time.perf_counter()
                error[name].append(method(picture, options.get("width", 2.0)) - line)
                seconds[name] += time.perf_counter() - began
            z.append(error["ours"][-1] / laser_line(picture, saturation=255.0).sigma)
        rms = {m: float(np.sqrt(np.nanmean(np.concatenate(e) ** 2))) for m, e in error.items()}
        smooth = [savgol_filter(np.where(np.isfinite(e), e, 0.0), 9, 2) for e in error["ours"]]
        along = float(np.sqrt(np.mean(np.concatenate(smooth) ** 2)))
        cover = float(np.mean(np.abs(np.concatenate(z)) < 1.0))
        print(
            f"| {kind} | "
            + " | ".join(f"{rms[m]:.3f}" for m in methods)
            + f" | {bound(**options):.3f} | {along:.3f} | {100 * cover:.0f} % |"
        )
    each = PICTURES * len(KINDS)
    print(f"| time of a picture [ms] | {' | '.join(f'{1e3 * seconds[m] / each:.0f}' for m in methods)} | | | |")


if __name__ == "__main__":
    main()
