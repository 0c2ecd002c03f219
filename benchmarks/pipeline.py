"""Whole commands on the samples: a cold run, a second run, start-up; seconds of this machine and their ratios."""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

ROOT = Path(__file__).parents[1]
COMMAND = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main())"]


def seconds(*arguments: str, repeat: int = 1) -> float:
    """Median wall time of a command [s]."""
    times = []
    for _ in range(repeat):
        began = time.perf_counter()
        subprocess.run([*COMMAND, *arguments], check=True, capture_output=True, cwd=ROOT)
        times.append(time.perf_counter() - began)
    return sorted(times)[repeat // 2]


def main() -> None:
    """Print a markdown table."""
    with tempfile.TemporaryDirectory() as folder:
        out = ["--results", str(Path(folder) / "sand")]
        campaign = ["run", "data_samples/loose_sand", *out]
        rows = [
            ("`jumpvision --help`", seconds("--help", repeat=7)),
            ("Python alone (`python -c pass`)", _bare()),
            ("loose-sand campaign, 25 experiments with one filmed, two workers", seconds(*campaign)),
            ("the same again: nothing recomputed", seconds(*campaign, repeat=3)),
        ]
    print("| command | wall time [s] |\n|---|---|")
    for name, value in rows:
        print(f"| {name} | {value:.2f} |")


def _bare() -> float:
    times = []
    for _ in range(7):
        began = time.perf_counter()
        subprocess.run([sys.executable, "-c", "pass"], check=True)
        times.append(time.perf_counter() - began)
    return sorted(times)[3]


if __name__ == "__main__":
    main()
