"""Where the motor's work goes in a jump, as the re-fitted baseline has it and as the extended model has it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from ..diagnosis.diagnose import Diagnosis
from ..diagnosis.fitting import Fit
from ..diagnosis.jumper import Jumper, of_jump
from ..physics.ledger import energy_ledger


def ledgers(d: Diagnosis, system: Jumper) -> list[dict[str, Any]]:
    """Ledgers [J] from rest to the measured apex, of the jump of each kind that the baseline misses most."""
    worst: dict[str, int] = {}
    miss = [float(np.mean(r * r)) for r in d.baseline.residuals]
    for i, o in enumerate(system.observations):
        kind = str(o.labels.get("kind"))
        if kind not in worst or miss[i] > miss[worst[kind]]:
            worst[kind] = i
    fits = {"baseline": d.baseline}
    if d.naming and d.naming.named:
        fits["extended"] = d.naming.best.fit
    return [
        {"experiment": system.jumps[i].name, "kind": kind, "model": name, **entries}
        for kind, i in sorted(worst.items())
        for name, fit in fits.items()
        if (entries := _ledger(system, i, fit)) is not None
    ]


def _ledger(system: Jumper, i: int, fit: Fit) -> Mapping[str, Any] | None:
    jump = system.jumps[i]
    late = np.flatnonzero(jump.t >= jump.stop)
    if not late.size:
        return None
    apex = float(jump.t[late[np.argmax(jump.y[late])]])
    model = of_jump(system.build(fit.mechanisms, fit.named), jump.model, fit.named)
    try:
        found = energy_ledger(model, jump.forcing, end=apex)
    except RuntimeError:
        return None
    return {
        "to_s": apex,
        "motor_J": found.motor + found.impulse,
        "potential_J": found.potential,
        "kinetic_J": found.kinetic,
        "spring_J": found.spring,
        "losses_J": found.losses,
    }
