"""Damaged files: 500,000 random cases over every kind of file that is read, each kind in processes of its own.

`python -m benchmarks.fuzz [cases] [first seed]`; a mend is judged on seeds that did not find the fault.
`python -m benchmarks.fuzz contradictions [first seed] [draws]`: slips planted into healthy folders.
`python -m benchmarks.fuzz healthy`: what is said of the samples, and of real recordings (JUMPVISION_REAL_DATA).
`python -m benchmarks.fuzz kills [number]`: runs killed at random moments.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

sys.path.insert(0, "tests")

import fuzz_files

TOTAL = 500_000


def main(total: int = TOTAL, first: int = 0) -> None:
    """Print a markdown table; the findings, if any, below it."""
    print("| file | cases | refused with a clear error | read | ms a case | crash, hang, other error |")
    print("|---|---|---|---|---|---|")
    said: list[str] = []
    with tempfile.TemporaryDirectory() as folder:
        names = list(fuzz_files.samples(Path(folder) / "good"))
        count = -(-total // len(names))
        for name in names:
            began = time.perf_counter()
            refused, findings = fuzz_files.fuzz(Path(folder) / "good", name, first, first + count)
            ms = (time.perf_counter() - began) / count * 1e3
            print(f"| {name} | {count} | {refused} | {count - refused - len(findings)} | {ms:.1f} | {len(findings)} |")
            sys.stdout.flush()
            said += findings
    for text in said:
        print(f"\n- {text}")


def kills(number: int = 100) -> None:
    """A campaign with films, pictures, a diagnosis and two workers, killed at random moments and run again."""
    with tempfile.TemporaryDirectory() as folder:
        call = [sys.executable, "tests/fault_lab.py", "whole", folder, str(number)]
        found = json.loads(subprocess.run(call, stdout=subprocess.PIPE, text=True, check=True).stdout)
    print(
        f"Killed at {found['moments']} random moments, {found['killed']} of them at work, and run again: "
        f"{len(found['different'])} results differ, {len(found['torn'])} torn files, {len(found['left'])} left over."
    )
    for text in (*found["different"], *found["torn"], *found["left"]):
        print(f"- {text}")


if __name__ == "__main__":
    if sys.argv[1:2] == ["contradictions"]:
        from benchmarks.contradictions import table

        table(*map(int, sys.argv[2:]))
    elif sys.argv[1:2] == ["healthy"]:
        from benchmarks.contradictions import healthy

        healthy()
    elif sys.argv[1:2] == ["kills"]:
        kills(*map(int, sys.argv[2:]))
    else:
        main(*map(int, sys.argv[1:]))
