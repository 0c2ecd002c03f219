"""Which experiments of a campaign stand out, and why: the rows of a table that come first. For people only."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

import numpy as np

from jumpvision.base.arrays import Z95
from jumpvision.experiment.inputs.experiment import Campaign
from jumpvision.experiment.workflow.run import Outcome

from .truth import deviations

if TYPE_CHECKING:
    from jumpvision.engine.document.diagnosis import Diagnosis
    from jumpvision.engine.document.values import Height

FAR = 4.0  # robust standard deviations: of 100 jumps of Gaussian errors one in 160 campaigns would have one
MAD = 1.4826  # standard deviation of Gaussian errors over the median of their sizes


def odd(campaign: Campaign, outcomes: Sequence[Outcome], diagnosis: Diagnosis | None) -> dict[str, str]:
    """Why an experiment stands out, by name, of those that do: it failed, was warned of, has no height where others
    do, its truth lies outside 95 %, a number of it varies, or the (extended) model misses it as no other."""
    measured = any(o.summary.values.get("jump_height_m") is not None for o in outcomes)
    why: dict[str, list[str]] = {o.name: [] for o in outcomes}
    for o in outcomes:
        if o.errors:
            why[o.name].append("failed")
        elif measured and o.summary.values.get("jump_height_m") is None:
            why[o.name].append("no height")
        if n := len(o.warnings):
            why[o.name].append(f"{n} warning{'s' * (n > 1)}")
    for name, z in deviations(campaign, outcomes):
        if abs(z) > Z95:
            experiment, _, what = name.partition(" ")
            why[experiment].append(f"truth of {what} {abs(z):.1f} sigma off")
    if diagnosis:
        for name, text in by_model(diagnosis):
            why.setdefault(name, []).append(text)
    return {name: "; ".join(texts) for name, texts in why.items() if texts}


def by_model(d: Diagnosis) -> Iterable[tuple[str, str]]:
    """Experiments that a diagnosis sets apart, and why."""
    for v in d.varies:
        if v.established and v.kind == "odd":
            yield from ((name, f"its {v.parameter} differs") for name in v.recordings)
    for h, miss in far_off(d.heights):
        yield h.experiment, f"model misses it by {1e3 * miss:+.2f} mm"


def far_off(heights: Sequence[Height]) -> list[tuple[Height, float]]:
    """Jumps whose height the extended model misses by FAR robust standard deviations of all misses, with simulated
    minus measured [m]."""
    miss = np.array([h.extended_m - h.measured_m for h in heights])
    known = miss[np.isfinite(miss)]
    if known.size < 4:  # of fewer no usual miss is known
        return []
    middle = np.median(known)
    usual = MAD * float(np.median(np.abs(known - middle)))
    return [(h, float(m)) for h, m in zip(heights, miss) if abs(m - middle) > FAR * usual]
