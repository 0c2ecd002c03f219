"""Strokes of a slow intrusion: where the foot intrudes, withdraws or pauses, and what each intrusion starts from."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
SLOW = 0.25  # share of the typical intrusion speed below which the foot counts as paused


@dataclass(frozen=True)
class Fresh:
    """The samples of a log in which the foot enters grains that it had not reached before.

    index: their positions in the log, shape (n,). event: number of the last event before each, -1 before the first.
    event_depth [m], event_pause [s] (NaN after a withdrawal), event_kind ("reintrusion" | "stop_go"): shape (events,).
    """

    index: NDArray[np.intp]
    event: NDArray[np.intp]
    event_depth: Array
    event_pause: Array
    event_kind: tuple[str, ...]


def directions(t: Array, depth: Array, *, window: float) -> NDArray[np.int8]:
    """+1 intruding, -1 withdrawing, 0 paused, shape (n,); t [s] increasing, depth [m] positive down.

    The speed is a slope over `window` [s]; a rest shorter than that is the turning point of a stroke, not a pause.
    """
    half = max(1, round(0.5 * window / float(np.median(np.diff(t)))))
    lo, hi = np.maximum(np.arange(t.size) - half, 0), np.minimum(np.arange(t.size) + half, t.size - 1)
    speed = (depth[hi] - depth[lo]) / (t[hi] - t[lo])
    down = speed[speed > 0.05 * np.abs(speed).max()]
    state = np.zeros(t.size, dtype=np.int8)
    if down.size:
        state[np.abs(speed) > SLOW * float(np.median(down))] = 1
        state *= np.sign(speed).astype(np.int8)
    cuts = np.flatnonzero(np.diff(state)) + 1
    for i, j in zip([0, *cuts], [*cuts, t.size]):
        if state[i] == 0 and i > 0 and j < t.size and t[j] - t[i] < window:
            middle = (i + j) // 2
            state[i:middle], state[middle:j] = state[i - 1], state[j]
    return state


def fresh_samples(t: Array, depth: Array, *, window: float, rise: float) -> Fresh:
    """The samples that go deeper than all before them, and the events (pauses, withdrawals) between them.

    rise [m]: depth after an event that is left out, while the force builds up again.
    """
    state = directions(t, depth, window=window)
    cuts = np.flatnonzero(np.diff(state)) + 1
    index: list[NDArray[np.intp]] = []
    event: list[NDArray[np.intp]] = []
    depths: list[float] = []
    pauses: list[float] = []
    kinds: list[str] = []
    deepest, pause, withdrawn, begun = -np.inf, 0.0, False, False
    for i, j in zip([0, *cuts], [*cuts, t.size]):
        if state[i] < 0:
            withdrawn = True
        elif state[i] == 0:
            pause += float(t[min(j, t.size - 1)] - t[i]) + (1.0 - 2.0 * SLOW) * window  # lost in the smoothing
        else:
            before = np.maximum.accumulate(np.r_[deepest + (rise if begun else 0.0), depth[i : j - 1]])
            stopping = (t[i:j] > t[j - 1] - window) & (j < t.size)  # the force relaxes as soon as the foot slows
            new = np.arange(i, j)[(depth[i:j] > before) & ~stopping]
            if new.size:
                if begun:
                    depths.append(deepest)
                    pauses.append(np.nan if withdrawn else pause)
                    kinds.append("reintrusion" if withdrawn else "stop_go")
                index.append(new)
                event.append(np.full(new.size, len(depths) - 1))
                pause, withdrawn, begun = 0.0, False, True
        deepest = max(deepest, float(depth[i:j].max()))
    empty = np.zeros(0, dtype=np.intp)
    return Fresh(
        np.concatenate(index) if index else empty,
        np.concatenate(event) if event else empty,
        np.array(depths),
        np.array(pauses),
        tuple(kinds),
    )
