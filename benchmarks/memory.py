"""Peak memory of a whole run against the length of its films: `python -m benchmarks.memory [grains] [frames ...]`.

Each film, of grains and of a ball (`grains`: without it), is a folder of small pictures, run with pictures and page in
a process of its own; the peak is the largest resident size. Of a film of grains also the peak until its velocity fields
are there (`jumpvision piv`). 100,000 frames of grains take half an hour.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

LENGTHS = (2_000, 20_000)
SIZE = 64  # px
TOML = """
[grain_video]
file = "grains"
frame_rate = 500.0
scale = 1e-4
[actuation]
kind = "none"
[params.piv]
step = 16
preset = "fast"
"""
BALL = """
[rod_video]
file = "ball"
frame_rate = 500.0
scale = 5e-4
ball_diameter = 0.009
"""


def film(folder: Path, n: int, ball: bool) -> None:
    """A drifting random texture, one picture a frame (pages of a mapped file would count as memory)."""
    rng = np.random.default_rng(1)
    texture = rng.integers(0, 255, (SIZE, 4 * SIZE), dtype=np.uint8)
    texture = ((texture.astype(int) + np.roll(texture, 1, 0) + np.roll(texture, 1, 1)) // 3).astype(np.uint8)
    for name in ("grains", "ball") if ball else ("grains",):
        (folder / name).mkdir()
    for k in range(n):
        cv2.imwrite(str(folder / "grains" / f"{k:06d}.png"), np.roll(texture, k % 100, axis=1)[:, :SIZE])
        if ball:
            drawn = np.full((SIZE, SIZE), 30, np.uint8)
            cv2.circle(drawn, (SIZE // 2, round(SIZE / 2 + 12 * np.sin(k / 40))), 9, 220, -1, cv2.LINE_AA)
            cv2.imwrite(str(folder / "ball" / f"{k:06d}.png"), cv2.GaussianBlur(drawn, (0, 0), 1.0))
    (folder / "experiment.toml").write_text(TOML + BALL * ball, encoding="utf-8")


def peaks(n: int, ball: bool) -> list[float]:
    """[MB] of the processes that run all on films of n frames: of grains alone `piv`, then the rest."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        film(folder, n, ball)
        return [peak(folder, command) for command in (("run",) if ball else ("piv", "run"))]


def peak(folder: Path, command: str) -> float:
    code = f"from benchmarks.memory import work; work({str(folder)!r}, {command!r})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return float(done.stdout.split()[-1])


def work(folder: str, command: str) -> None:
    from jumpvision.cli import main

    sys.argv = ["jumpvision", command, folder, "--results", folder + "/results", "--workers", "1"]
    main()
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


def main(*asked: str) -> None:
    ball = "grains" not in asked
    lengths = [int(q) for q in asked if q != "grains"] or LENGTHS
    what = "peak memory of a run [MB]" if ball else "peak memory of stage piv [MB] | of the rest of a run [MB]"
    print(f"| frames | {what} |\n|---|{'---|' * (1 if ball else 2)}")
    for n in lengths:
        print(f"| {n} | {' | '.join(f'{p:.0f}' for p in peaks(n, ball))} |", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
