"""Figures of experiments and campaigns; most are stages, cached like every other result."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from jumpvision.engine.document.diagnosis import Diagnosis
    from jumpvision.engine.order import Findings
    from jumpvision.jumper.question.jumper import Jumper

DRAWN = "pictures", "grains", "flows", "bed", "logs", "overlays"
PICTURES = tuple(f"jumpvision.report.figures.{module}" for module in DRAWN)  # whose import registers figures as stages


def diagnosis_png(found: Findings, system: Jumper, data: Diagnosis) -> bytes:
    """diagnosis.png; what draws it is imported when it is drawn, as most runs find theirs in the cache."""
    from .diagnosis import diagnosis_picture

    return diagnosis_picture(found, system, data)
