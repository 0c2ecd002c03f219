"""Experiments that a study could be asked next: recordings not yet made, over the inputs that its user may choose."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from jumpvision.engine.fitting import Problem

from .study import Recording, Study
from .system import Studied


def unmade(study: Study, recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings like the first one, their inputs over the ranges that may be chosen, nothing measured yet."""
    # nine offers over all inputs: every one is simulated by every likely model, with its derivatives
    like, places = recordings[0], max(2, round(9 ** (1 / len(study.inputs))))
    grids = [np.linspace(low, high, places).tolist() for low, high in study.inputs.values()]
    out = []
    for values in itertools.product(*grids):
        chosen = dict(zip(study.inputs, values))
        name = ", ".join(f"{n} = {x:.4g}" for n, x in chosen.items())
        blank = np.zeros((like.t.size, len(study.channels)))
        inputs, labels = {**like.inputs, **chosen}, {**like.labels, **chosen}
        new = replace(like, name=name, values=blank, inputs=inputs, labels=labels, sigma=None)
        out.append(replace(new, group=name, condition=name))
    return out


def offer(system: Studied, problem: Problem) -> tuple[Problem, list[int]]:
    """(the recordings with those that could be made beside them, places of these). The system's runs know them all."""
    wider = Studied(system.study, system.runs.recordings, system.readings, system.runs, system.probed)
    return problem.asked_of(wider), list(range(len(system.recordings), len(wider.recordings)))
