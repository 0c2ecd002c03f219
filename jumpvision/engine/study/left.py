"""Where what no model explains lies: in which recording, when, and in which state of the outputs."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.base.numbers import said
from jumpvision.engine.fitting import Fit

from .system import Studied, thirds

THIRDS = (1 / 3, 2 / 3)
MOST, TIMES = 0.5, 1.5  # of the excess of chi^2 in a cell, and over its share of the samples, from which it is told


def where_left(system: Studied, fit: Fit) -> str:
    """The cells (a recording; a third of the records; of an output's values or rates) that hold most of the excess of
    chi^2, one for each of the three kinds, in words; "" where none does."""
    excess = np.concatenate([r * r for r in fit.residuals]) - 1.0
    total = float(excess.sum())
    best: dict[str, tuple[float, str]] = {}
    for kind, words, here in _cells(system, fit):
        share, size = float(excess[here].sum()) / total, float(here.mean())
        if share > max(MOST, TIMES * size, best.get(kind, (0.0, ""))[0]):
            best[kind] = share, f"{said(min(share, 1.0), '.2g', 100.0)} % {words}"
    return ", ".join(text for _, text in best.values()) if total > 0.0 else ""


def _cells(system: Studied, fit: Fit) -> Iterator[tuple[str, str, NDArray[np.bool_]]]:
    """(kind, words, which readings) of every cell."""
    observations, every = system.observations, range(len(system.observations))
    of = np.repeat(np.arange(len(observations)), [o.t.size for o in observations])
    for i, o in enumerate(observations if len(observations) > 1 else []):
        yield "recording", f"in {o.name}", of == i
    part = np.concatenate([thirds(o.t) for o in observations])
    for name in dict.fromkeys(part.tolist()):
        yield "time", f"in the {name} of the records", part == name
    predicted = system.predict(fit.mechanisms, fit.named, every)
    for k, (c, unit) in enumerate(zip(system.study.channels, system.units)):
        value, rate = (np.full(of.size, np.nan) for _ in range(2))
        for i, o in enumerate(observations):
            block = system.blocks(i).get(k)
            if block is not None and o.t[block].size > 2:
                at = np.flatnonzero(of == i)[block]
                value[at] = predicted[i][block] * unit
                rate[at] = np.gradient(value[at], o.t[block])
        for what, x, per in ((c.name, value, c.unit), (f"the rate of {c.name}", rate, f"{c.unit or '1'}/s")):
            read = x[np.isfinite(x)]
            if read.size < 9 or not np.ptp(read) > 0.0:
                continue
            low, high = np.quantile(read, THIRDS)
            a, b = said(float(low), ".2g"), said(float(high), ".2g")
            words = (f"below {a}", f"from {a} to {b}", f"above {b}")
            for text, here in zip(words, _thirds(x, low, high)):
                yield "state", f"where {what} is {text}{f' {per}' if per else ''}", here


def _thirds(x: Array, low: float, high: float) -> tuple[NDArray[np.bool_], ...]:
    return x < low, (x >= low) & (x <= high), x > high
