"""A campaign's experiments run by Snakemake, on this machine or a cluster, as a profile says."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

from jumpvision.base.schema import InputError
from jumpvision.base.storage import write_aside

from .run import Plan, pipelines

SELF = [sys.executable, "-m", "jumpvision"]
RULES = ["--rerun-incomplete", "--keep-going", "--scheduler", "greedy", "--nolock"]  # the cache needs no lock


def run_jobs(campaign: Path, plan: Plan, profile: str, *, options: list[str], jobs: int | None) -> None:
    """Run pipelines/Snakefile on a campaign, until all of its experiments are in the cache or failed for a reason.

    profile: a name in pipelines/profiles, or a folder with config.yaml. options: of each `jumpvision run`. jobs: at a
    time; None: as the profile says. Raises InputError where Snakemake is not there, or a job did not end well.
    """
    beside = Path(sys.executable).with_name("snakemake")
    program, shipped = beside if beside.exists() else shutil.which("snakemake"), pipelines() / "profiles"
    folder = next((f for f in (Path(profile), shipped / profile) if (f / "config.yaml").is_file()), None)
    if program is None:
        raise InputError(["--profile needs Snakemake; install it with: pip install 'jumpvision[workflow]'"])
    if folder is None:
        known = ", ".join(sorted(f.name for f in shipped.iterdir()))
        raise InputError([f"--profile {profile}: no such profile; allowed: {known}, or a folder with config.yaml"])
    work, places = plan.results.absolute() / ".workflow", {"results": plan.results, "cache": plan.cache}
    given = {n: str(place.absolute()) for n, place in {"campaign": campaign, **places}.items()}
    write_aside(work / "config.json", json.dumps({**given, "options": options}))
    call = [program, "--snakefile", pipelines() / "Snakefile", "--profile", folder.absolute(), "--directory", work]
    call += ["--configfile", work / "config.json", *RULES, *(["--jobs", str(jobs)] if jobs else [])]
    with subprocess.Popen([*map(str, call)], stdout=sys.stderr) as snakemake:  # interrupted, it ends by itself
        code = snakemake.wait()
    if code:
        raise InputError(
            [
                f"--profile {profile}: snakemake ended with exit code {code}: a job was killed or did not start, see "
                f"above and {work / 'log'}; the same command goes on, without --profile the rest is done here"
            ]
        )
    shutil.rmtree(work)
