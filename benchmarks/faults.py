"""Faults at length: 50 kills at random moments; a disk that is full, and one that becomes read-only, for real."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
KILLS = 50

DISK = """
import os, subprocess, sys
from pathlib import Path
sys.path.insert(0, "tests")
from fault_lab import leftovers, results_of, run_here, write_campaign

work = Path(sys.argv[1])
campaign = write_campaign(work / "campaign", 2)
assert run_here(campaign, work / "calm") == 0
calm = results_of(work / "calm")
disk = work / "disk"
disk.mkdir()

def mount(*options):
    subprocess.run(["mount", *options, str(disk)], check=True)

for size in (4, 16, 32, 48, 64, 96, 128):
    mount("-t", "tmpfs", "-o", f"size={size}k", "tmpfs")
    full = run_here(campaign, disk / "results")
    mount("-o", "remount,size=10m")
    again = run_here(campaign, disk / "results")
    print("FULL", size, full, again, results_of(disk / "results") == calm, len(leftovers(disk)), flush=True)
    subprocess.run(["umount", str(disk)], check=True)
mount("-t", "tmpfs", "-o", "size=10m", "tmpfs")
mount("-o", "remount,ro")
locked = run_here(campaign, disk / "results")
mount("-o", "remount,rw")
print("RO", 0, locked, run_here(campaign, disk / "results"), results_of(disk / "results") == calm, 0, flush=True)
"""


def main() -> None:
    """Print markdown."""
    with tempfile.TemporaryDirectory() as folder:
        call = [sys.executable, "tests/fault_lab.py", "kill", folder, str(KILLS)]
        done = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    print(
        f"Killed (SIGKILL) at {found['moments']} random moments of a run, {found['killed']} of them while at work, and "
        f"resumed: {len(found['different'])} results differ from an undisturbed run, {len(found['torn'])} torn files, "
        f"{len(found['left'])} temporary files left."
    )
    if shutil.which("unshare") is None:
        print("\nDisks of a given size: left out, they need `unshare`.")
        return
    with tempfile.TemporaryDirectory() as folder:
        call = ["unshare", "-rm", sys.executable, "-c", DISK, folder]
        done = subprocess.run(call, cwd=ROOT, capture_output=True, text=True)
    if done.returncode:
        print(f"\nDisks of a given size: left out, they need the right to mount ({done.stderr.strip()[-200:]}).")
        return
    print("\n| disk | exit code | after making room | same results | temporary files left | traceback |")
    print("|---|---|---|---|---|---|")
    trace = "yes" if "Traceback" in done.stderr else "no"
    for line in done.stdout.splitlines():
        if line.startswith(("FULL", "RO")):
            kind, size, first, again, same, left = line.split()
            name = f"{size} kB" if kind == "FULL" else "read-only"
            print(f"| {name} | {first} | {again} | {same} | {left} | {trace} |")


if __name__ == "__main__":
    main()
