"""Runs that are killed: `python -m benchmarks.kills [MOMENTS] [--whole]` kills a run so many times at random moments.

Each is resumed to its end and compared with an undisturbed run: nothing may be torn, different or left over. --whole:
with films, two workers, diagnosis, pictures and report.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from jumpvision.laboratory.blind import Nuisance, draw
from jumpvision.laboratory.campaign import write_campaign as write_drawn
from tests.worlds.small import SAMPLES, grain_film, leftovers, results_of, write_campaign

RUN = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main(sys.argv[1:]))", "run"]


def write_whole_campaign(root: Path) -> Path:
    """Four jumps to be diagnosed, a filmed one, and a long grain film."""
    setting = draw(np.random.default_rng(3), ground="hard", hidden=[], nuisance=Nuisance(1e-4, 0.0, 0.0))
    write_drawn(root, replace(setting.protocol, jumps=setting.protocol.jumps[:4]), seed=1, sealed=True)
    shutil.copytree(SAMPLES / "hard_ground", root / "filmed")
    grain_film(root / "grains", 600)
    return root


def kill_at_random(work: Path, moments: int, *, whole: bool = False, seed: int = 0) -> dict[str, object]:
    """Kill a run at `moments` random moments of its course, resume each to its end, compare with an undisturbed run.

    whole: with films, two workers, diagnosis, pictures and report. In turns all processes and the command alone are
    killed. Returns killed (runs that were still at work), different (results that differ after resuming), left
    (temporary files after resuming) and torn (JSON result files that could not be read right after a kill).
    """
    campaign = write_whole_campaign(work / "campaign") if whole else write_campaign(work / "campaign", 2)
    options = ["--workers", "2"] if whole else ["--workers", "1", "--no-pictures"]
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}

    def begun(results: Path) -> subprocess.Popen[bytes]:
        return subprocess.Popen([*RUN, str(campaign), "--results", str(results), *options], **quiet)

    duration = 0.0
    for _ in range(2):  # the first compiles
        shutil.rmtree(work / "calm", ignore_errors=True)
        began = time.perf_counter()
        if code := begun(work / "calm").wait():
            raise RuntimeError(f"the undisturbed run ended with {code}")
        duration = time.perf_counter() - began
    calm = results_of(work / "calm")
    rng = np.random.default_rng(seed)
    killed, torn, different, left = 0, [], [], []
    for k in range(moments):
        results = work / f"run-{k}"
        run = begun(results)
        time.sleep(float(rng.uniform(0, duration)))
        killed += run.poll() is None
        with contextlib.suppress(ProcessLookupError):  # it ended between the moment drawn and the signal
            (os.kill if k % 2 else os.killpg)(run.pid, signal.SIGKILL)
        run.wait()
        for f in results.rglob("*.json"):
            if ".cache/writing-" not in f.as_posix():
                try:
                    json.loads(f.read_text())
                except ValueError:
                    torn.append(str(f))
        code = begun(results).wait()
        again = results_of(results)
        different += [f"run {k}: exit code {code}"] if code else []
        different += [f"run {k}: {n}" for n in calm.keys() | again.keys() if calm.get(n) != again.get(n)]
        left += [str(f) for f in leftovers(results)]
        shutil.rmtree(results)
    return {"moments": moments, "killed": killed, "torn": torn, "different": different, "left": left}


def main() -> int:
    """0 where nothing was lost."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("moments", type=int, nargs="?", default=20)
    parser.add_argument("--whole", action="store_true")
    a = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        found = kill_at_random(Path(folder), a.moments, whole=a.whole)
    print(json.dumps(found))
    return int(any(found[k] for k in ("torn", "different", "left")))


if __name__ == "__main__":
    sys.exit(main())
