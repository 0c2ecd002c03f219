"""When pages are written: only where something changed, one after the other, so that memory does not grow with them."""

from __future__ import annotations

import hashlib
import json
import shlex
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from importlib.resources import files as resources
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from jumpvision import __version__
from jumpvision.base.record import plain
from jumpvision.experiment import files
from jumpvision.experiment.campaign.truth import coverage_words, truth_of
from jumpvision.experiment.inputs.experiment import Campaign, Experiment
from jumpvision.experiment.workflow.run import Outcome

if TYPE_CHECKING:
    from jumpvision.engine.document.diagnosis import Diagnosis
    from jumpvision.experiment.results.summary import JumpRow

MADE_FROM = '<meta name="made-from" content="{}">'  # at the head of a page: the digest of what it was made from


def write_report(
    campaign: Campaign,
    outcomes: list[Outcome],
    rows: list[JumpRow],
    results: Path,
    *,
    single: bool,
    warned: Sequence[Mapping[str, object]] = (),
    diagnosis: Diagnosis | None = None,
    no_diagnosis: str = "",
) -> Path:
    """Write the pages and return the path of the one to open: of the campaign, or of the only experiment.

    warned: what is to be doubted of a campaign, as in campaign.json. no_diagnosis: as in `Run`.
    """
    draws = draw_command(campaign, results)
    keys = write_pages(campaign, outcomes, results, single=single)
    if single:
        return outcomes[0].results / files.REPORT
    true = [dict(truth_of(campaign.path)), coverage_words(campaign, outcomes)]
    whole = (json.dumps(plain(x)) for x in (diagnosis and diagnosis.values, dict(campaign.excluded), true))
    each = (json.dumps(plain(r.cells())) for r in rows)
    said = [f"{w['experiment']}: {w['message']}" for w in warned] + [
        f"{o.name}: {n}" for o in outcomes for n in o.notes
    ]
    key = digest_of(chain(keys, said, (draws, no_diagnosis), each, whole))
    if not made_from(results / files.REPORT, key):
        from .page import write_campaign

        mark = MADE_FROM.format(key)
        write_campaign(campaign, outcomes, rows, results, diagnosis, said, mark, draws=draws, no_diagnosis=no_diagnosis)
    return results / files.REPORT


def draw_command(campaign: Campaign, results: Path) -> str:
    """Return the command that draws the pictures of all pages."""
    return shlex.join(["jumpvision", "report", str(campaign.path), "--results", str(results)])


def write_pages(campaign: Campaign, outcomes: Iterable[Outcome], results: Path, *, single: bool = False) -> list[str]:
    """Write the pages of these experiments that are not up to date; return the digest of each.

    A page that cannot be written is an error of its outcome.
    """
    experiments = {e.name: e for e in campaign.experiments}
    back, draws = "" if single else f"../{files.REPORT}", draw_command(campaign, results)
    keys = []
    for o in outcomes:
        if not o.results.is_dir():
            continue
        try:
            keys.append(_experiment(o, experiments.get(o.name), back=back, draws=draws))
        except OSError as e:
            o.errors.append(f"{o.results / files.REPORT}: {e.strerror or e}; free or change it and run again")
    return keys


def _experiment(outcome: Outcome, experiment: Experiment | None, *, back: str, draws: str) -> str:
    """The page of one experiment, unless the one there was made from the same results; the digest of these."""
    provenance = outcome.results / files.PROVENANCE
    receipt = provenance.read_text(encoding="utf-8") if provenance.exists() else ""
    key = digest_of([back, draws, *outcome.errors, *outcome.said, *outcome.not_run, receipt])
    if not made_from(outcome.results / files.REPORT, key):
        from .page import write_experiment

        write_experiment(outcome, experiment, back, receipt, MADE_FROM.format(key), draws=draws)
    return key


def digest_of(texts: Iterable[str]) -> str:
    """Digest of what a page is made from, with the code that makes it; one text is in memory at a time."""
    found = hashlib.sha256(_code().encode())
    for text in texts:
        found.update(b"\0" + text.encode())
    return found.hexdigest()[:24]


CODE = ("figures", "pages", "pages/static", "pages/templates")


@cache
def _code() -> str:
    """Digest of the files that draw and write pages."""
    folders = [resources("jumpvision.report"), *map(resources("jumpvision.report").joinpath, CODE)]
    own = [f for folder in folders for f in folder.iterdir() if f.is_file()]
    return hashlib.sha256(__version__.encode() + b"".join(f.read_bytes() for f in sorted(own, key=str))).hexdigest()


def made_from(page: Path, key: str) -> bool:
    """Whether the page that is there says so at its head."""
    if not page.exists():
        return False
    with page.open(encoding="utf-8", errors="replace") as f:
        return MADE_FROM.format(key) in f.read(400)
