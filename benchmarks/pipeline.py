"""The README's commands in a fresh environment: how long a newcomer waits, cold and again; start-up, a run of nothing.

`python -m benchmarks.pipeline [RUNS]`: medians of RUNS (default 3); needs a package index, and some minutes.
"""

from __future__ import annotations

import os
import re
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

from benchmarks.run import reference

ROOT = Path(__file__).parents[1]
OURS = ("PYTHONPATH", "NUMBA_CACHE_DIR", "PYTHONDONTWRITEBYTECODE")  # a newcomer has none of them
ALONE = {n: v for n, v in os.environ.items() if n not in OURS}
VERDICT = re.compile(r"The simulation (over|under)-predicts.* because it lacks")  # behind a line's progress, too


class Waited(NamedTuple):
    """Wall times [s] to the first line that names the cause, to the verdict with its gain on held-out jumps, and to
    the end."""

    named: float
    verdict: float
    whole: float


def waited(*command: str | Path) -> Waited:
    """A command from start to end."""
    began, said = time.perf_counter(), []
    process = subprocess.Popen(
        command, cwd=ROOT, env=ALONE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    assert process.stdout is not None
    for line in process.stdout:
        if VERDICT.search(line):
            said.append(time.perf_counter() - began)
    if process.wait():
        raise SystemExit(f"{' '.join(map(str, command))} failed")
    nothing = float("nan")
    return Waited(*(said[0], said[-1]) if said else (nothing, nothing), time.perf_counter() - began)


def fresh(folder: Path) -> tuple[Path, float]:
    """(the `jumpvision` of an environment installed by the README's command, seconds that took)."""
    began = time.perf_counter()
    subprocess.run([sys.executable, "-m", "venv", folder], check=True)
    pip = [folder / "bin" / "pip", "install", "-q", "--no-compile", "."]
    subprocess.run(pip, check=True, cwd=ROOT, stderr=subprocess.DEVNULL)
    return folder / "bin" / "jumpvision", time.perf_counter() - began


def median(runs: list[Waited]) -> Waited:
    return Waited(*map(statistics.median, zip(*runs)))


def main(runs: int = 3) -> None:
    """Print a markdown table."""
    cold, warm, again, installed, starts = [], [], [], [], []
    for k in range(runs):
        with tempfile.TemporaryDirectory() as folder:
            ours, seconds = fresh(Path(folder) / "env")
            installed.append(seconds)
            run = [ours, "run", "data_samples/loose_sand", "--results"]
            cold.append(waited(*run, Path(folder) / "cold"))
            warm.append(waited(*run, Path(folder) / "warm"))
            again.append(waited(*run, Path(folder) / "warm"))
            starts.append(statistics.median(waited(ours, "--help").whole for _ in range(7)))
            print(f"run {k + 1} of {runs}: load {os.getloadavg()[0]:.1f}", file=sys.stderr)
    print("| loose-sand campaign, 25 experiments with one filmed | cause named [s] | and its gain [s] | all [s] |")
    print("|---|---|---|---|")
    for name, of in (("first run in a fresh environment", cold), ("second, compiled", warm), ("nothing new", again)):
        m = median(of)
        print(f"| {name} | {m.named:.1f} | {m.verdict:.1f} | {m.whole:.1f} |")
    print(
        f"\nInstallation {statistics.median(installed):.0f} s, `jumpvision --help` {statistics.median(starts):.2f} s. "
        f"R, 2e7 turns of a loop that counts: {reference():.2f} s."
    )


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
