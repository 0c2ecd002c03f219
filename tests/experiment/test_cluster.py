"""A campaign handed to Snakemake: real jobs on this machine, one killed in mid-run. (About 20 s.)"""

from __future__ import annotations

import contextlib
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from jumpvision.cli import main
from tests.worlds.small import results_of, run_here, write_campaign

SNAKEMAKE = shutil.which("snakemake", path=f"{Path(sys.executable).parent}{os.pathsep}{os.environ.get('PATH', '')}")
needs_snakemake = pytest.mark.skipif(
    SNAKEMAKE is None or not sys.platform.startswith("linux"),
    reason="needs Snakemake (pip install 'jumpvision[workflow]') and /proc",
)


def running_about(folder: Path) -> dict[int, bytes]:
    """Processes that are called with something in the folder, by their calls."""
    found = {}
    for entry in Path("/proc").glob("[0-9]*"):
        with contextlib.suppress(OSError):
            call = (entry / "cmdline").read_bytes()
            if bytes(folder) in call:
                found[int(entry.name)] = call
    return found


def jobs_at_work(campaign: Path) -> list[int]:
    """Processes that are a `jumpvision run` of an experiment of this campaign."""
    return [pid for pid, call in running_about(campaign).items() if b"--no-report" in call.split(b"\0")]


@pytest.mark.long
@needs_snakemake
def test_a_worker_is_killed_and_nothing_is_lost(tmp_path):
    """Two jobs at a time; the first is killed, tried again, and the tables are those of an ordinary run. One experiment
    has a bad log: its reason is in the table, and it is not tried again."""
    campaign = write_campaign(tmp_path / "a campaign", 3)
    (campaign / "jump-0001").rename(campaign / "a {name} 'quoted'")
    log = campaign / "jump-0002" / "rod_track.csv"
    log.write_text(log.read_text().replace("0.100000,", "oops,", 1))
    assert run_here(campaign, tmp_path / "here") == 1
    call = [sys.executable, "-c", "import sys; from jumpvision.cli import main; sys.exit(main())", "run", campaign]
    call += ["--results", tmp_path / "there", "--profile", "local", "--workers", "2", "--no-pictures"]
    run = subprocess.Popen(list(map(str, call)), stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        end = time.monotonic() + 120
        while not (jobs := jobs_at_work(campaign)) and run.poll() is None and time.monotonic() < end:
            time.sleep(0.02)
        assert jobs
        os.kill(max(jobs), signal.SIGKILL)
        err = run.communicate(timeout=300)[1]
    finally:
        run.kill()
    assert run.returncode == 1, err
    assert "Trying to restart job" in err
    assert err.count("error: ") == 1 and "oops" in err
    assert not (tmp_path / "there" / ".workflow").exists()
    here, there = results_of(tmp_path / "here"), results_of(tmp_path / "there")
    for name in ("jump-0000/fits.json", "a {name} 'quoted'/summary.json", "a {name} 'quoted'/rod.csv", "jumps.csv"):
        assert there[name] == here[name], name


def test_a_profile_that_is_not_there_is_refused(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("jumpvision.experiment.workflow.cluster.shutil.which", lambda _: "snakemake")
    campaign = write_campaign(tmp_path / "campaign", 2)
    call = ["run", str(campaign), "--results", str(tmp_path / "r"), "--profile"]
    assert main([*call, "cloud"]) == 2
    assert "allowed: local, slurm" in capsys.readouterr().err
    assert main(["run", str(campaign / "jump-0000"), "--results", str(tmp_path / "r"), "--profile", "local"]) == 2
    assert "one experiment" in capsys.readouterr().err
    assert not (tmp_path / "r").exists()
