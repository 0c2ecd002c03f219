"""Peak memory of stage piv against the length of the film: `python -m benchmarks.memory [frames ...]`.

Each film is a folder of small pictures, run in a process of its own; the peak is the largest resident size.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
from pathlib import Path

import cv2
import numpy as np

LENGTHS = (100, 1000, 10000)
SIZE = 64  # px


def film(folder: Path, n: int) -> None:
    """A drifting random texture, one picture a frame (pages of a mapped file would count as memory)."""
    rng = np.random.default_rng(1)
    texture = rng.integers(0, 255, (SIZE, 4 * SIZE), dtype=np.uint8)
    texture = ((texture.astype(int) + np.roll(texture, 1, 0) + np.roll(texture, 1, 1)) // 3).astype(np.uint8)
    (folder / "film").mkdir()
    for k in range(n):
        cv2.imwrite(str(folder / "film" / f"{k:06d}.png"), np.roll(texture, k % 100, axis=1)[:, :SIZE])
    (folder / "experiment.toml").write_text(
        '[grain_video]\nfile = "film"\nframe_rate = 500.0\n[params.piv]\nstep = 16\npreset = "fast"\n', encoding="utf-8"
    )


def peak(n: int) -> float:
    """[MB] of the process that runs stage piv on a film of n frames."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        film(folder, n)
        code = f"from benchmarks.memory import work; work({name!r})"
        done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
        return float(done.stdout.split()[-1])


def work(folder: str) -> None:
    from jumpvision.cli import main

    main(["piv", folder, "--results", folder + "/results", "--no-pictures"])
    print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024)


def main(*lengths: str) -> None:
    print("| frames | peak memory of stage piv [MB] |\n|---|---|")
    for n in [int(q) for q in lengths] or LENGTHS:
        print(f"| {n} | {peak(n):.0f} |", flush=True)


if __name__ == "__main__":
    main(*sys.argv[1:])
