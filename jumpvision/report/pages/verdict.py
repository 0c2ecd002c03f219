"""The part of a page that a verdict rests on, the same for jumps and for a user's own simulator."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from jumpvision.base.numbers import said
from jumpvision.engine.document.diagnosis import Diagnosis, chance, strength
from jumpvision.experiment.campaign.truth import Truth, true_parameters
from jumpvision.jumper.mechanisms.registry import PARAMETERS

from .quantities import mechanism_words, small, typeset


@dataclass(frozen=True)
class VerdictShown:
    """Rows of its tables: causes, detectable, beside (what else was measured), suggested (lines that would mend it);
    recordings, others: what is questioned, and by what else was measured; picture, law, varies: as a page holds them.
    synthetic: whether the truth stands beside."""

    causes: list[dict[str, str]]
    detectable: list[dict[str, str]]
    beside: list[dict[str, str]]
    recordings: str = "recordings"
    others: str = "other means"
    picture: str | None = None
    pictured: str = "the diagnosis: heights, residuals, where, causes and gain"
    law: str | None = None
    synthetic: bool = False
    varies: str | None = None
    suggested: list[dict[str, str]] = field(default_factory=list)


def mechanism_said(d: Diagnosis, name: str) -> str:
    """What is lacking without a mechanism, as the study says it or the vocabulary."""
    return (d.lacks or {}).get(name) or mechanism_words(name)


def detectable_shown(d: Diagnosis) -> list[dict[str, str]]:
    """Rows: what is not named, and the strength from which it would have shown."""
    return [
        {
            "mechanism": mechanism_said(d, x.mechanism),
            "from": typeset(strength(x.value)) if x.unit == "1" else small(x.value, x.unit),
        }
        for x in d.detectable
        if math.isfinite(x.value)
    ]


def suggested_shown(d: Diagnosis) -> list[dict[str, str]]:
    """Rows: lines that would mend what varies."""
    return [{"file": s.file, "line": s.line, "why": s.why} for s in d.suggested]


def causes_shown(d: Diagnosis, truth: Truth | None = None) -> list[dict[str, str]]:
    """A row a model that was tried, with its true parameters where it is the named one and they are stated."""
    return [
        {
            "mechanism": " and ".join(mechanism_said(d, m) for m in c.mechanisms),
            "probability": chance(c.probability),
            "gain": typeset(said(c.delta_score)),
            "words": typeset(c.words),
            "meanings": typeset("; ".join(f"{n}: {PARAMETERS[n].meaning}" for n in c.parameters if n in PARAMETERS)),
            "true": typeset(true_parameters(c, truth)) if truth and d.names(c) else "",
        }
        for c in d.models
    ]
