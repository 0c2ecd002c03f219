"""Peak memory of a whole run against the length of its films: `python -m benchmarks.memory [frames ...]`.

Each film, of grains and of a ball, is a folder of small pictures, run with pictures and page in a process of its own;
the peak is the largest resident size.
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
[rod_video]
file = "ball"
frame_rate = 500.0
scale = 5e-4
ball_diameter = 0.009
[actuation]
kind = "none"
[params.piv]
step = 16
preset = "fast"
"""


def film(folder: Path, n: int) -> None:
    """A drifting random texture, one picture a frame (pages of a mapped file would count as memory)."""
    rng = np.random.default_rng(1)
    texture = rng.integers(0, 255, (SIZE, 4 * SIZE), dtype=np.uint8)
    texture = ((texture.astype(int) + np.roll(texture, 1, 0) + np.roll(texture, 1, 1)) // 3).astype(np.uint8)
    for name in ("grains", "ball"):
        (folder / name).mkdir()
    for k in range(n):
        cv2.imwrite(str(folder / "grains" / f"{k:06d}.png"), np.roll(texture, k % 100, axis=1)[:, :SIZE])
        ball = np.full((SIZE, SIZE), 30, np.uint8)
        cv2.circle(ball, (SIZE // 2, round(SIZE / 2 + 12 * np.sin(k / 40))), 9, 220, -1, cv2.LINE_AA)
        cv2.imwrite(str(folder / "ball" / f"{k:06d}.png"), cv2.GaussianBlur(ball, (0, 0), 1.0))
    (folder / "experiment.toml").write_text(TOML, encoding="utf-8")


def peak(n: int) -> float:
    """[MB] of the process that runs all on films of n frames."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        film(folder, n)
        code = f"from benchmarks.memory import work; work({name!r})"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        return float(done.stdout.split()[-1])


def work(folder: str) -> None:
    from jumpvision.cli import main

    sys.argv = ["jumpvision", "run", folder, "--results", folder + "/results", "--workers", "1"]
    main()
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


def main(*lengths: str) -> None:
    print("| frames | peak memory of a run [MB] |\n|---|---|")
    for n in [int(q) for q in lengths] or LENGTHS:
        print(f"| {n} | {peak(n):.0f} |", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
