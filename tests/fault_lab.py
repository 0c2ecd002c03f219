"""What the tests and the benchmark of faults share: a small campaign of tables, a run of it in a forked process."""

from __future__ import annotations

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

CAMPAIGN = 'ground = "hard"\n[robot]\nmotor_mass = 1.003\nrod_mass = 0.175\nspring_stiffness = 5760.6\n'
EXPERIMENT = """[actuation]
kind = "stutter"
frequency = {frequency}
amplitude = 0.004
phase = 1.57
start = 0.1
[rod_track]
file = "rod_track.csv"
"""


def grain_film(folder: Path, frames: int) -> Path:
    """An experiment with a film of grains that move by 0.7 px a frame, over a frame of 48 x 48 px."""
    from scipy import ndimage

    rng = np.random.default_rng(4)
    wide = ndimage.gaussian_filter(rng.standard_normal((48, 60)), 1.5)
    wide = 120 + 60 * wide / wide.std()
    few = [ndimage.shift(wide, (0.0, -0.7 * i), order=3)[:, :48] for i in range(12)]
    folder.mkdir(parents=True)
    np.save(folder / "grains.npy", np.clip(few, 0, 255).astype(np.uint8)[np.arange(frames) % 12])
    (folder / "experiment.toml").write_text(
        '[grain_video]\nfile = "grains.npy"\nframe_rate = 500.0\nscale = 1e-4\n[params.piv]\nwindow = 16\nstep = 8\n'
    )
    return folder


def write_campaign(root: Path, n: int, *, seed: int = 1, rate: float = 100.0) -> Path:
    """n experiments, each a flight with noise of 20 um in a table; no films, no [model]. At 200 Hz their fits take five
    times as long: for who measures that, or kills it at work."""
    root.mkdir(parents=True)
    (root / "campaign.toml").write_text(CAMPAIGN, encoding="utf-8")
    rng = np.random.default_rng(seed)
    for i in range(n):
        folder = root / f"jump-{i:04d}"
        folder.mkdir()
        frequency, speed = rng.uniform(6, 12), rng.uniform(0.4, 0.6)
        (folder / "experiment.toml").write_text(EXPERIMENT.format(frequency=frequency), encoding="utf-8")
        t = np.arange(0, 0.75, 1.0 / rate)  # little after the landing: a ring-down to be fitted takes long
        flight = t - 0.1 - 1 / frequency
        height = np.where(flight > 0, np.maximum(speed * flight - 1.35 * flight**2, 0), 0) + rng.normal(0, 2e-5, t.size)
        rows = np.column_stack([t, height])
        np.savetxt(folder / "rod_track.csv", rows, "%.6f", ",", header="time_s,height_m", comments="")
    return root


def results_of(folder: Path) -> dict[str, bytes]:
    """Every result file by its path; of provenance.json and campaign.json what does not change from run to run."""
    found = {}
    for f in sorted(folder.rglob("*")):
        name = f.relative_to(folder).as_posix()
        if f.is_file() and not name.startswith(".cache/") and f.name != "report.html":
            found[name] = f.read_bytes()
            if f.name == "campaign.json":
                found[name] = json.dumps(json.loads(found[name])["tables"]).encode()
            if f.name == "provenance.json":
                data = json.loads(found[name])
                found[name] = json.dumps({k: data[k] for k in ("inputs", "outputs", "parameters")}).encode()
    return found


def leftovers(folder: Path) -> list[Path]:
    """Temporary files and unfinished cache entries."""
    return [f for f in folder.rglob("*") if f.name.startswith("writing-") or f.name.endswith(".tmp")]


def run_here(campaign: Path, results: Path, *options: str) -> int:
    """`jumpvision run` in this process, with one worker and without pictures; its exit code."""
    from jumpvision.cli import main

    return main(["run", str(campaign), "--results", str(results), "--workers", "1", "--no-pictures", *options])


def run_and_kill(campaign: Path, results: Path, after: float) -> bool:
    """The same in a forked process that gets SIGKILL after `after` seconds; whether it was still at work."""
    child = os.fork()
    if child == 0:
        try:
            for fd in (1, 2):
                os.dup2(os.open(os.devnull, os.O_WRONLY), fd)
            run_here(campaign, results)
        finally:
            os._exit(0)
    time.sleep(after)
    os.kill(child, signal.SIGKILL)
    return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) == -signal.SIGKILL


def at_once(work: Path, runs: int, *, n: int = 2) -> dict[str, object]:
    """Several runs of one campaign into one results folder at the same time, compared with a run alone."""
    campaign = write_campaign(work / "campaign", n)
    run_here(campaign, work / "alone")
    children = []
    for _ in range(runs):
        children.append(os.fork())
        if children[-1] == 0:
            code = 99
            try:
                code = run_here(campaign, work / "together")
            finally:
                os._exit(code)
    codes = [os.waitstatus_to_exitcode(os.waitpid(c, 0)[1]) for c in children]
    same = results_of(work / "together") == results_of(work / "alone")
    return {"codes": codes, "same": same, "left": [str(f) for f in leftovers(work / "together")]}


def kill_at_random(work: Path, moments: int, *, n: int = 2, seed: int = 0) -> dict[str, object]:
    """Kill a run at `moments` random moments of its course, resume each to its end and compare with an undisturbed run.

    Returns killed (runs that were still at work), different (results that differ after resuming), left (temporary
    files after resuming) and torn (JSON result files that could not be read right after a kill).
    """
    campaign = write_campaign(work / "campaign", n)
    run_here(campaign, work / "calm")  # imports and first-use costs
    calm = results_of(work / "calm")
    shutil.rmtree(work / "calm")
    began = time.perf_counter()
    run_here(campaign, work / "calm")
    duration = time.perf_counter() - began
    rng = np.random.default_rng(seed)
    killed, torn, different, left = 0, [], [], []
    for k in range(moments):
        results = work / f"run-{k}"
        killed += run_and_kill(campaign, results, float(rng.uniform(0, duration)))
        for f in results.rglob("*.json"):
            if ".cache/writing-" not in f.as_posix():
                try:
                    json.loads(f.read_text())
                except ValueError:
                    torn.append(str(f))
        code = run_here(campaign, results)
        again = results_of(results)
        different += [f"run {k}: exit code {code}"] if code else []
        different += [f"run {k}: {n}" for n in calm.keys() | again.keys() if calm.get(n) != again.get(n)]
        left += [str(f) for f in leftovers(results)]
        shutil.rmtree(results)
    return {"moments": moments, "killed": killed, "torn": torn, "different": different, "left": left}


RUN = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main(sys.argv[1:]))", "run"]


def write_whole_campaign(root: Path) -> Path:
    """Four jumps to be diagnosed, a filmed one, and a long grain film."""
    from jumpvision.laboratory.blind import Nuisance, draw
    from jumpvision.laboratory.campaign import write_campaign

    setting = draw(np.random.default_rng(3), ground="hard", hidden=[], nuisance=Nuisance(1e-4, 0.0, 0.0))
    write_campaign(root, replace(setting.protocol, jumps=setting.protocol.jumps[:4]), seed=1, sealed=True)
    shutil.copytree(Path(__file__).parents[1] / "data_samples" / "hard_ground", root / "filmed")
    grain_film(root / "grains", 600)
    return root


def kill_whole(work: Path, moments: int, *, seed: int = 0) -> dict[str, object]:
    """As `kill_at_random`, of a run with films, two workers, diagnosis, pictures and report; in turns the command alone
    is killed, and all its processes."""
    campaign = write_whole_campaign(work / "campaign")
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL, "start_new_session": True}

    def begun(results: Path) -> subprocess.Popen[bytes]:
        return subprocess.Popen([*RUN, str(campaign), "--results", str(results), "--workers", "2"], **quiet)

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
        print(k, killed, len(torn), different[-3:], len(left), flush=True)
    return {"moments": moments, "killed": killed, "torn": torn, "different": different, "left": left}


if __name__ == "__main__":  # a process without threads of its own, which may fork
    import contextlib

    with contextlib.redirect_stdout(sys.stderr):
        found = {"kill": kill_at_random, "whole": kill_whole, "together": at_once}[sys.argv[1]](
            Path(sys.argv[2]), int(sys.argv[3])
        )
    print(json.dumps(found))
