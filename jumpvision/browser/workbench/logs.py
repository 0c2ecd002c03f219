"""Logs as lines under the film: every extreme kept, so that a step of a switch is not drawn away."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.sections import ContactLog, MotorLog, RodTrack

from .draft import Composed

POINTS = 2000  # of a line on the screen
LOGS = ((MotorLog, "position_m"), (ContactLog, "contact"), (RodTrack, "height_m"))


@dataclass(frozen=True)
class Trace:
    """A log on the common clock: t [s] with its `start` in it. problem: why it cannot be read."""

    section: str
    column: str
    start: float
    t: list[float]
    y: list[float]
    problem: str = ""


def traces(composed: Composed) -> list[Trace]:
    """The logs that the experiment names."""
    out = []
    for cls, column in LOGS:
        log = composed.section(cls)
        if log is None:
            continue
        try:
            table = read_log(log, "time_s", column)
        except (ValueError, OSError) as e:
            out.append(Trace(cls.name, column, log.start, [], [], str(e)))
            continue
        t, y = thinned(table.time_s.to_numpy(float), table[column].to_numpy(float))
        out.append(Trace(cls.name, column, log.start, t.tolist(), y.tolist()))
    return out


def thinned(t: Array, y: Array, points: int = POINTS) -> tuple[Array, Array]:
    """At most `points` of the points (n,): of each stretch its lowest and its highest."""
    if len(t) <= points:
        return t, y
    edges = np.linspace(0, len(t), points // 2 + 1).astype(int)
    kept = np.array([a + k for a, b in pairwise(edges) for k in (y[a:b].argmin(), y[a:b].argmax())])
    kept = np.unique(kept)
    return t[kept], y[kept]
