"""Figures of experiments and campaigns; most are stages, cached like every other result."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

from jumpvision.experiment.campaign.folder import as_campaign
from jumpvision.experiment.inputs.experiment import Campaign, Experiment

if TYPE_CHECKING:
    from jumpvision.engine.document.diagnosis import Diagnosis
    from jumpvision.engine.order import Findings
    from jumpvision.jumper.question.jumper import Jumper

DRAWN = "pictures", "grains", "flows", "bed", "logs", "overlays"
PICTURES = tuple(f"jumpvision.report.figures.{module}" for module in DRAWN)  # whose import registers figures as stages

# What an experiment's page shows as a picture or a film: what has a frame of a film in it, and maps. All else is drawn
# when the page is written, and for print by `jumpvision figures`.
ON_PAGES = (
    *("track.png", "bed.png", "crater.png", "piv.png", "flow.png"),
    *("validation.png", "statistics.png", "profiles.png"),
    *("track.webm", "piv.webm", "cone.webm"),
)


def drawn_by_run(opened: Experiment | Campaign) -> Mapping[str, tuple[str, ...]]:
    """The pictures that are drawn before a run ends, by experiment: of a single one. A campaign's page shows frames of
    one experiment that it draws itself; the pages of its experiments wait for `jumpvision report`."""
    return {opened.name: ON_PAGES} if isinstance(opened, Experiment) else {}


def drawn_by_report(opened: Experiment | Campaign) -> Mapping[str, tuple[str, ...]]:
    """What the pages of all experiments show, by experiment."""
    return {e.name: ON_PAGES for e in as_campaign(opened).experiments}


def diagnosis_png(found: Findings, system: Jumper, data: Diagnosis) -> bytes:
    """diagnosis.png; what draws it is imported when it is drawn, as most runs find theirs in the cache."""
    from .diagnosis import diagnosis_picture

    return diagnosis_picture(found, system, data)
