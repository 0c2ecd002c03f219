"""Campaigns of many experiments: cold and repeated runs, parallel efficiency, overhead of a stage, memory."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import threading
import time
from dataclasses import replace
from pathlib import Path

sys.path.insert(0, "tests")

from fault_lab import write_campaign

COMMAND = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main())", "run"]
MANY, FEW = 1000, 100


def timed(campaign: Path, results: Path, *options: str) -> tuple[float, float, float]:
    """(wall [s], processor of all its processes [s], greatest memory of the command's own process [MB]) of a run."""
    before = os.times()
    began, peak = time.perf_counter(), 0.0
    run = subprocess.Popen(
        [*COMMAND, str(campaign), "--results", str(results), *options],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )

    def watch() -> None:
        nonlocal peak
        while run.poll() is None:
            try:
                peak = max(peak, int(Path(f"/proc/{run.pid}/statm").read_text().split()[1]) * 4096 / 1e6)
            except (OSError, IndexError):
                return
            time.sleep(0.05)

    thread = threading.Thread(target=watch)
    thread.start()
    if run.wait() != 0:
        raise RuntimeError(f"{campaign}: exit code {run.returncode}")
    thread.join()
    after = os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return time.perf_counter() - began, used, peak


def overhead(campaign: Path, results: Path) -> float:
    """Processor time of a run of cached experiments in one process, a stage [ms]: what the pipeline adds."""
    from jumpvision.experiment.inputs.experiment import open_campaign
    from jumpvision.experiment.workflow.many import run_campaign
    from jumpvision.experiment.workflow.run import Plan

    plan = Plan(results, results / ".cache")
    found = open_campaign(campaign)
    run_campaign(replace(found, experiments=found.experiments[:1]), plan, workers=1, done=lambda o: None)  # the imports
    began = time.process_time()
    outcomes = run_campaign(found, plan, workers=1, done=lambda o: None)
    return (time.process_time() - began) / sum(len(o.steps) for o in outcomes) * 1e3


def main() -> None:
    """Print a markdown table. Processor time beside wall time, because other work on the machine delays only one."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        many, few = (write_campaign(folder / str(n), n, rate=200.0) for n in (MANY, FEW))
        two = timed(many, folder / "m", "--workers", "2", "--no-pictures")
        again = timed(many, folder / "m", "--workers", "2", "--no-pictures")
        one = timed(many, folder / "m1", "--workers", "1", "--no-pictures")
        runs = {
            f"{MANY} tracks, two workers, no pictures": two,
            "the same again: nothing recomputed": again,
            f"{MANY} tracks, one worker, no pictures": one,
            f"{FEW} tracks, two workers, no pictures": timed(few, folder / "f", "--workers", "2", "--no-pictures"),
            f"{FEW} tracks, two workers, with pictures": timed(few, folder / "fp", "--workers", "2"),
        }
        added = overhead(few, folder / "f")
    print("| what | wall [s] | processor [s] | memory of the command itself [MB] |\n|---|---|---|---|")
    for what, (wall, used, peak) in runs.items():
        print(f"| {what} | {wall:.1f} | {used:.1f} | {peak:.0f} |")
    print(f"\nParallel efficiency of two workers: {100 * one[0] / two[0] / 2:.0f} %.")
    print(f"\nThe pipeline adds {added:.2f} ms a stage (hashes, checksums, reading back, copying, provenance).")


if __name__ == "__main__":
    main()
