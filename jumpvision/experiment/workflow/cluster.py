"""A campaign handed to Snakemake: one job an experiment, on this machine or a cluster, as the profile says.

Each job is a `jumpvision run EXPERIMENT` with the campaign's cache; what failed says why in its log.
"""

from __future__ import annotations

import hashlib
import json
import shutil
import sys
from collections.abc import Mapping
from pathlib import Path

from jumpvision.base.leash import on_a_leash
from jumpvision.base.schema import InputError
from jumpvision.base.storage import write_aside
from jumpvision.experiment.inputs.experiment import Campaign

from .run import Plan, pipelines

SELF = [sys.executable, "-m", "jumpvision"]
RULES = ["--rerun-incomplete", "--keep-going", "--scheduler", "greedy", "--nolock"]  # the cache needs no lock


def hand_over(
    campaign: Campaign, plan: Plan, profile: str, *, options: list[str], jobs: int | None, frames: Mapping[str, int]
) -> dict[str, list[str]]:
    """Run every experiment under Snakemake; the reasons, by name, of those that failed.

    profile: a name in pipelines/profiles or a folder with config.yaml. options: further options of each run. jobs: at a
    time; None: as the profile says. frames: of the grain films, by experiment; a long one is matched by several jobs.
    Snakemake ends with this process, however that ends; a handing over that was killed is taken up where it stood.
    """
    program, folder = _snakemake(), _profile(profile)
    work = plan.results.absolute() / ".workflow"
    keys = {e.name: hashlib.sha256(e.name.encode()).hexdigest()[:16] for e in campaign.experiments}
    calls = {}
    for e in campaign.experiments:
        results, cache = plan.results.absolute() / e.name, plan.cache.absolute()
        where = [str(e.path.absolute()), "--results", str(results), "--cache", str(cache), "--no-report"]
        calls[keys[e.name]] = [*SELF, "run", *where, "--workers", "1", *options]  # as the Snakefile says: threads 1
    films = {keys[name]: n for name, n in frames.items()}
    write_aside(work / "jobs.json", json.dumps({"calls": calls, "frames": films}))
    call = [program, "--snakefile", str(pipelines() / "Snakefile"), "--profile", str(folder), "--directory", str(work)]
    code = on_a_leash([*call, *RULES, *(["--jobs", str(jobs)] if jobs else [])], sys.stderr)
    reasons: dict[str, list[str]] = {}
    for name, key in keys.items():
        log = work / "log" / f"{key}.txt"
        lines = log.read_text(encoding="utf-8", errors="replace").splitlines() if log.exists() else []
        said = [t.split(": ", 1)[1] for t in lines if t.startswith(("error: ", "jumpvision: "))]
        if said:
            reasons[name] = said
        elif not (work / "done" / key).exists():
            reasons[name] = [f"{name}: its job did not end well (snakemake: exit code {code}); run again"]
    shutil.rmtree(work)
    return reasons


def _snakemake() -> str:
    beside = Path(sys.executable).with_name("snakemake")
    found = str(beside) if beside.exists() else shutil.which("snakemake")
    if found is None:
        raise InputError(["--profile needs Snakemake; install it with: pip install 'jumpvision[workflow]'"])
    return found


def _profile(name: str) -> Path:
    shipped = pipelines() / "profiles"
    for folder in (Path(name), shipped / name):
        if (folder / "config.yaml").is_file():
            return folder.absolute()
    known = ", ".join(sorted(f.name for f in shipped.iterdir()))
    raise InputError([f"--profile {name}: no such profile; allowed: {known}, or a folder with config.yaml"])
