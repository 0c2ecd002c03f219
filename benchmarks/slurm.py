"""`run --profile slurm` on a real SLURM: nodes, a job and the controller fail in mid-run, and nothing may be lost.

Needs root and Debian's slurmctld, slurmd, slurm-client and munge, for a cluster of two nodes on this machine
(benchmarks/slurm.sh). `python -m benchmarks.slurm [EXPERIMENTS]`: 40 by default, 200 take 20 minutes on two cores.
"""

from __future__ import annotations

import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from tests.worlds.small import leftovers, results_of, run_here, write_campaign

ROOT = Path(__file__).parents[1]
SCRIPT = ROOT / "benchmarks" / "slurm.sh"
TOOLS = ("slurmctld", "slurmd", "munged", "sbatch", "squeue", "scontrol")
N = int(sys.argv[1]) if len(sys.argv) > 1 else 40  # experiments
GROUP, MEMORY = 10, 700  # experiments a SLURM job, MB of one; the hungry one needs more than MEMORY, less than twice it
ENVIRONMENT = os.environ | {
    "PATH": f"{Path(sys.executable).parent}:/usr/sbin:{os.environ.get('PATH', '')}",
    "PYTHONPATH": str(ROOT),
}


SELF = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main())"]


def lacking() -> str:
    """Why there can be no cluster here."""
    absent = [t for t in (*TOOLS, "snakemake") if shutil.which(t, path=ENVIRONMENT["PATH"]) is None]
    if absent:
        return f"{', '.join(absent)} not installed (apt-get install slurmctld slurmd slurm-client munge; pip: workflow)"
    if os.getuid() != 0:
        return "only root starts SLURM's daemons"
    return "/etc/slurm/slurm.conf is somebody's own" if Path("/etc/slurm/slurm.conf").exists() else ""


@contextmanager
def cluster(folder: Path) -> Iterator[Callable[..., None]]:
    """A cluster of two nodes that takes commands."""

    def script(command: str, *more: str) -> None:
        subprocess.run(["bash", SCRIPT, command, folder, *more], check=True, env=ENVIRONMENT, timeout=120)

    try:
        script("start")
        yield script
    finally:
        script("stop")


def said(*call: str) -> str:
    return subprocess.run(call, capture_output=True, text=True, env=ENVIRONMENT, timeout=60).stdout


def profile_here(folder: Path) -> Path:
    """The shipped profile, as its comments tell a user to change it: this cluster's memory, groups and disk."""
    text = (ROOT / "pipelines" / "profiles" / "slurm" / "config.yaml").read_text()
    for old, new in (
        (r"experiments=\d+", f"experiments={GROUP}"),
        (r"mem_mb=4000\*", f"mem_mb={MEMORY}*"),
        (r"latency-wait: \d+", "latency-wait: 20"),
    ):
        text, changed = re.subn(old, new, text)
        assert changed == 1, old
    # there is no accounting here, and nobody wants to wait 40 s for the first look
    text += "slurm-status-command: squeue\nslurm-init-seconds-before-status-checks: 5\n"
    folder.mkdir()
    (folder / "config.yaml").write_text(text)
    return folder


def make_hungry(experiment: Path) -> None:
    """A contact log of 3 million rows: reading it takes some hundred MB more than the others need."""
    t = np.linspace(0.0, 0.75, 3_000_000)
    rows = np.char.add(np.char.mod("%.9f,", t), np.where((t > 0.25) & (t < 0.55), "0", "1"))
    (experiment / "contact.csv").write_text("time_s,contact\n" + "\n".join(rows) + "\n")
    with (experiment / "experiment.toml").open("a") as f:
        f.write('[contact_log]\nfile = "contact.csv"\n')


def started(call: list[object], log: Path) -> subprocess.Popen[str]:
    out = log.open("a")
    return subprocess.Popen(
        list(map(str, call)), stdout=out, stderr=out, text=True, env=ENVIRONMENT, start_new_session=True
    )


def down_with_its_job() -> None:
    """A node is lost, and comes back."""
    said("scontrol", "update", "NodeName=node2", "State=DOWN", "Reason=lost")
    time.sleep(5.0)
    said("scontrol", "update", "NodeName=node2", "State=RESUME")


def killed_and_given_again(run: subprocess.Popen[str], call: list[object], log: Path) -> str:
    """What the command says that is killed, and of the same given again, which ends well."""
    assert run.poll() is None, log.read_text()[-3000:]
    os.killpg(run.pid, signal.SIGKILL)
    run.wait()
    again = started(call, log)
    try:
        assert again.wait(timeout=2000) == 0, log.read_text()[-3000:]
    finally:
        if again.poll() is None:
            os.killpg(again.pid, signal.SIGKILL)
    return log.read_text()


def done(results: Path) -> int:
    return len(list(results.glob("*/provenance.json")))


def until(reached: Callable[[], bool], run: subprocess.Popen[str], seconds: float = 900.0) -> None:
    end = time.monotonic() + seconds
    while not reached() and run.poll() is None:
        assert time.monotonic() < end, "the cluster stands still\n" + said("squeue")
        time.sleep(0.5)


def lose_nothing(tmp_path: Path, command: Callable[..., None]) -> None:
    """A node drained, one lost with its job, a job over its memory, the controller killed, the command itself killed:
    the same command again ends with the results of an ordinary run on this machine, to the last bit."""
    campaign = write_campaign(tmp_path / "campaign", N)
    make_hungry(campaign / "jump-0003")
    assert run_here(campaign, tmp_path / "here") == 0
    results, log = tmp_path / "there", tmp_path / "log.txt"
    call = [*SELF, "run", campaign]
    call += ["--results", results, "--profile", profile_here(tmp_path / "profile"), "--no-pictures", "--workers", "100"]

    run = started(call, log)
    try:
        until(lambda: done(results) >= N // 10, run)
        said("scontrol", "update", "NodeName=node1", "State=DRAIN", "Reason=a test")
        until(lambda: done(results) >= N // 5, run)
        assert "drain" in said("sinfo", "-h", "-N", "-n", "node1", "-o", "%T")
        said("scontrol", "update", "NodeName=node1", "State=RESUME")
        until(lambda: done(results) >= 3 * N // 10, run)
        command("controller", "5")
        until(lambda: done(results) >= 4 * N // 10, run)
        down_with_its_job()
        until(lambda: done(results) >= N // 2, run)
        text = killed_and_given_again(run, call, log)
    finally:
        if run.poll() is None:
            os.killpg(run.pid, signal.SIGKILL)
    jobs = len(set(re.findall(r"SLURM jobid (\d+)", text)))
    print(f"{N} experiments in {jobs} SLURM jobs; tried again: {text.count('Trying to restart job')}")
    assert jobs < N // 2  # grouped, and not each tried again and again
    here, there = results_of(tmp_path / "here"), results_of(results)
    assert here.keys() == there.keys()
    assert [n for n in here if here[n] != there[n]] == []
    assert not (results / ".workflow").exists() and leftovers(results) == []
    logs = Path("/etc/slurm/slurm.conf").resolve().parent
    assert any("exceeded memory limit" in f.read_text() for f in logs.glob("node*.log"))  # it was killed for that


if __name__ == "__main__":
    if why := lacking():
        sys.exit(why)
    with tempfile.TemporaryDirectory() as place, cluster(Path(place) / "cluster") as given:
        lose_nothing(Path(place), given)
