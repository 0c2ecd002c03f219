"""Faults at length: 100 kills at random moments; two containers on one folder; disks that are full or read-only.

`python -m benchmarks.faults [kills] [pairs of containers]`
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
KILLS, CONTAINERS = 100, 50

DISK = """
import os, subprocess, sys
from pathlib import Path
sys.path.insert(0, "tests")
from fault_lab import leftovers, results_of, run_here, write_campaign

work = Path(sys.argv[1])
campaign = write_campaign(work / "campaign", 2, rate=200.0)
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


CONTAINER = ["unshare", "-pfu", "--mount-proc", "sh", "-c", 'hostname "$0" && exec "$@"']
RUN = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main(sys.argv[1:]))", "run"]


def containers(times: int) -> dict[str, int]:
    """Two runs at once into one results folder, each with processes, numbers and a host name of its own."""
    sys.path.insert(0, str(ROOT / "tests"))
    from fault_lab import leftovers, results_of, run_here, write_campaign

    failed = different = left = 0
    with tempfile.TemporaryDirectory() as folder:
        campaign = write_campaign(Path(folder) / "campaign", 2, rate=200.0)
        run_here(campaign, Path(folder) / "alone")
        alone = results_of(Path(folder) / "alone")
        for k in range(times):
            results = Path(folder) / f"both-{k}"
            call = [*RUN, str(campaign), "--results", str(results), "--workers", "1", "--no-pictures"]
            quiet = {"cwd": ROOT, "stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
            runs = [subprocess.Popen([*CONTAINER, name, *call], **quiet) for name in ("node-a", "node-b")]
            codes = [r.wait() for r in runs]
            failed += any(codes)
            different += results_of(results) != alone
            left += len(leftovers(results))
            shutil.rmtree(results)
    return {"pairs": times, "failed": failed, "different": different, "left": left}


def main(kills: int = KILLS, pairs: int = CONTAINERS) -> None:
    """Print markdown."""
    with tempfile.TemporaryDirectory() as folder:
        call = [sys.executable, "tests/fault_lab.py", "kill", folder, str(kills)]
        done = subprocess.run(call, cwd=ROOT, capture_output=True, text=True, check=True)
    found = json.loads(done.stdout)
    print(
        f"Killed (SIGKILL) at {found['moments']} random moments of a run, {found['killed']} of them while at work, and "
        f"resumed: {len(found['different'])} results differ from an undisturbed run, {len(found['torn'])} torn files, "
        f"{len(found['left'])} temporary files left."
    )
    if shutil.which("unshare") is None:
        print("\nContainers and disks of a given size: left out, they need `unshare`.")
        return
    both = containers(pairs)
    print(
        f"\nTwo containers at once on one folder, {both['pairs']} times: {both['failed']} with a run that failed, "
        f"{both['different']} with results that differ from a run alone, {both['left']} temporary files left."
    )
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
    main(*map(int, sys.argv[1:]))
