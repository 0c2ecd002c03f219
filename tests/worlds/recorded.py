"""Folders of recordings for the workbench: a ball that falls, a flow about a vortex, double exposures."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

RATE, SCALE, G = 250.0, 1e-3, 9.81  # of the drawn drop: 1/s, m/px, m/s^2
RULER = (30.0, 20.0, 30.0, 220.0)  # px: the bar in the picture is 200 mm long
FILM = 'schema = 1\n[rod_video]\nfile = "drop.npy"\nframe_rate = 250.0\nscale = 1e-3\n'
PICTURES = 'schema = 1\n[grain_video]\nfile = "piv_*.png"\nframe_rate = 100.0\nscale = 1e-4\n'
ROWS, COLUMNS = 120, 176  # px of the flow; never square
TURN, RADIUS = 0.06, 40.0  # rad a frame and px: of the vortex


def drop(
    folder: Path,
    seed: int = 0,
    n: int = 48,
    size: tuple[int, int] = (240, 200),
    lost: tuple[int, ...] = (),
    experiment: str = "",
) -> np.ndarray:
    """Write drop.npy, a ball of 16 px that falls with g beside a bar, dark in the `lost` frames, and experiment.toml.

    Returns its true column and row, shape (n, 2).
    """
    folder.mkdir(parents=True, exist_ok=True)
    rng, t = np.random.default_rng(seed), np.arange(n) / RATE
    truth = np.column_stack([90.3 + 0.4 * t / SCALE, 30.2 + 0.5 * G * t * t / SCALE])
    y, x = np.mgrid[: size[0], : size[1]]
    film = np.array([30 + 170 / (1 + np.exp(np.clip((np.hypot(x - c, y - r) - 8) / 0.6, -50, 50))) for c, r in truth])
    film[list(lost)] = 30
    film[:, 20:221, 30] = 120
    np.save(folder / "drop.npy", np.clip(film + rng.normal(0, 2, film.shape), 0, 255).astype(np.uint8))
    if experiment:
        (folder / "experiment.toml").write_text(experiment)
    return truth


def vortex(n: int, seed: int = 3) -> list[np.ndarray]:
    """Draw n frames (ROWS, COLUMNS) of particles in a vortex about the middle, anticlockwise as seen."""
    rng, middle = np.random.default_rng(seed), np.array([COLUMNS / 2, ROWS / 2])
    place = rng.uniform([-20, -20], [COLUMNS + 20, ROWS + 20], (1600, 2))
    y, x = np.mgrid[-4:5, -4:5]
    frames = []
    for _ in range(n):
        image = np.full((ROWS + 60, COLUMNS + 60), 20.0)
        for c, r in place + 30:
            i, j = round(r), round(c)
            image[i - 4 : i + 5, j - 4 : j + 5] += 130 * np.exp(-((y + i - r) ** 2 + (x + j - c) ** 2) / 2.6)
        frames.append(np.clip(image[30:-30, 30:-30] + rng.normal(0, 2, (ROWS, COLUMNS)), 0, 255).astype(np.uint8))
        away = place - middle
        a = -TURN * np.exp(-((np.hypot(*away.T) / RADIUS) ** 2))
        turned = [away[:, 0] * np.cos(a) - away[:, 1] * np.sin(a), away[:, 0] * np.sin(a) + away[:, 1] * np.cos(a)]
        place = np.clip(middle + np.column_stack(turned), -25, [COLUMNS + 25, ROWS + 25])
    return frames


def flow_film(folder: Path, n: int, experiment: str = "") -> Path:
    """Write the vortex as piv_000.png to piv_{n - 1}.png."""
    folder.mkdir(parents=True)
    for k, frame in enumerate(vortex(n)):
        cv2.imwrite(str(folder / f"piv_{k:03d}.png"), frame)
    if experiment:
        (folder / "experiment.toml").write_text(experiment)
    return folder


def two_pictures(folder: Path) -> Path:
    """Write the vortex as caseA.png and caseB.png."""
    folder.mkdir(parents=True)
    for name, frame in zip("AB", vortex(2)):
        cv2.imwrite(str(folder / f"case{name}.png"), frame)
    return folder


def double_exposures(folder: Path, n: int) -> Path:
    """Write n pairs, Jet_0000A.png and its B on: one vortex moves from A to B, another one from pair to pair."""
    folder.mkdir(parents=True)
    for k in range(n):
        for name, frame in zip("AB", vortex(2, seed=k)):
            cv2.imwrite(str(folder / f"Jet_{k:04d}{name}.png"), frame)
    return folder
