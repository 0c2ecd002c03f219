"""Every benchmark, with the peers beside ours in the same run: `python -m benchmarks.run` writes docs/benchmarks.md.

Needs `pip install -e '.[bench]'`; a peer that is not installed is left out and said so. About 20 minutes on two cores.
"""

from __future__ import annotations

import os
import platform
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
PARTS = {
    "pipeline": "Whole commands",
    "ball": "Ball tracker",
    "crater": "Laser line",
    "ball_films": "Ball tracker on whole films",
    "piv": "PIV",
    "mei": "PIV: noise and resolution",
    "memory": "PIV memory",
    "hard": "Hard-ground jumper",
    "granular": "Granular jumper",
    "laboratory": "Virtual laboratory",
    "dem": "Discs",
    "closed_loop": "Closed loop: discs, film, analysis",
    "fuzz": "Damaged files",
    "faults": "Faults",
    "campaign": "Campaigns",
    "plan": "Motion planning",
    "diagnosis": "Diagnosis",
    "diagnosis_real": "Diagnosis of real recordings",
    "flights": "Flights in tracks",
    "grain_films": "Grain films: bias and sigma of the cone",
}


def main(*names: str) -> None:
    """Run the named parts (default: all) and write the page; a part that is not named keeps its old text."""
    target = ROOT / "docs" / "benchmarks.md"
    old = target.read_text(encoding="utf-8").split("\n## ") if target.exists() else []
    kept = {text.split("\n", 1)[0]: text.split("\n", 1)[1].strip() for text in old[1:]}
    for name, title in PARTS.items():
        if names and name not in names:
            continue
        print(f"{title} ...", file=sys.stderr, flush=True)
        done = subprocess.run([sys.executable, "-m", f"benchmarks.{name}"], cwd=ROOT, capture_output=True, text=True)
        kept[title] = done.stdout.strip() if done.returncode == 0 else f"failed:\n\n```text\n{done.stderr[-2000:]}\n```"
    head = (
        "# Benchmarks\n\nWritten by `python -m benchmarks.run`. Times are of one machine "
        f"({os.cpu_count()} cores, Python {platform.python_version()}) and vary by up to a factor of three there; the "
        "ratios to the peers, run beside ours in the same process order, are the message.\n"
    )
    parts = [f"\n## {title}\n\n{kept[title]}\n" for title in PARTS.values() if title in kept]
    target.write_text(head + "".join(parts), encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
