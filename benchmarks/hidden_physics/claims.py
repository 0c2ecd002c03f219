"""What an answer claims beyond names, put to the test: a gain on conditions held out, strengths that would have shown.

The gain is one on conditions that are drawn anew from the same ranges, each predicted by models that were made without
its neighbours. A strength is hidden in the same campaign, recorded again, beside what was hidden already.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np

from benchmarks.diagnosis import jumps_of
from jumpvision.laboratory.blind import EFFECTS, ONCE, Setting, campaign
from jumpvision.laboratory.protocol import jumps_of as jumps_drawn

from .entries import Answer, Task
from .worlds import Truth

FRESH, HIDDEN = 3, 1  # campaigns for a gain; strengths that are hidden


def claims(answer: Answer, t: Truth, setting: Setting, seed: int) -> dict[str, Any]:
    """gain: [low, high, what it is]; power: mechanism -> [its strength, whether it was seen]."""
    rng = np.random.default_rng([seed, 212, t.number])
    out: dict[str, Any] = {}
    if answer.gain and not t.outside:
        jumps = [j for _ in range(FRESH) for j in jumps_of(*_elsewhere(setting, rng))[0]]
        out["gain"] = [*answer.gain.interval, answer.gain.on(jumps)]
    if answer.again and not t.outside:
        allowed = [
            m for m, (name, x) in answer.detectable.items()
            if math.isfinite(x) and m in EFFECTS and name in EFFECTS[m].drawn and m not in setting.protocol.terms
        ]  # fmt: skip
        for m in rng.permutation(allowed)[:HIDDEN]:
            name, value = answer.detectable[m]
            more = _hiding(setting, m, {**EFFECTS[m].fixed, name: value})
            out.setdefault("power", {})[str(m)] = [value, answer.again(Task(*jumps_of(more, campaign(more, rng))))]
    return out


def _elsewhere(setting: Setting, rng: np.random.Generator) -> Any:
    """The same robot and bed at frequencies between the least and the greatest of each kind, and its recordings."""
    p = setting.protocol
    jumps = tuple(
        jump
        for kind, f, delay in ONCE[p.ground]
        for jump in jumps_drawn(kind, rng.uniform(min(f), max(f), len(f)), (p.jumps[0].law.amplitude,), delay=(delay,))
    )
    new = replace(setting, protocol=replace(p, jumps=jumps))
    return new, campaign(new, rng)


def _hiding(setting: Setting, mechanism: str, values: dict[str, float]) -> Setting:
    """The setting with one mechanism more."""
    p = setting.protocol
    p = replace(p, terms=(*p.terms, mechanism), parameters={**values, **p.parameters} | values)
    return replace(setting, protocol=p)
