"""Numbers that were taken for constant over all recordings, and systems that let each recording have its own."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.engine.series import at_times
from jumpvision.engine.system import Observation, System

RARE = 10.0  # odds against a constant of the build, which nobody touches between recordings: its order, not fitted


@dataclass(frozen=True)
class Variable:
    """A number of the model, the drive or the instrument, as far as recordings may differ in it.

    declared: its value; unit. relative: a change is a share of the declared value, else it is in the unit.
    spread: how far a recording may plausibly be off, a standard deviation [as a change]. step: a change small enough
    for derivatives. least: changes below are impossible. whole: changes are whole numbers (frames). drive: it is of
    what drives the motion, which may be far off. rare: a constant of the build, such as a mass.
    """

    name: str
    declared: float
    unit: str
    spread: float
    step: float
    relative: bool = True
    least: float = -math.inf
    whole: bool = False
    drive: bool = False
    rare: bool = False

    @property
    def log_price(self) -> float:
        """Of a number that hardly ever differs between recordings: ln of how many times less likely it is."""
        return math.log(RARE) if self.rare else 0.0


Changes = Mapping[str, Array]  # by the name of a variable: the change in every recording (all of them,)


@runtime_checkable
class Varying(System, Protocol):
    """A system whose recordings may each have their own values of what is else constant."""

    @property
    def variables(self) -> Mapping[str, Variable]:
        """Numbers of the model, the drive and single channels; those of any camera or clock come from `instruments`."""
        ...

    def predict_apart(
        self, mechanisms: tuple[str, ...], values: Mapping[str, float], changes: Changes, which: Sequence[int]
    ) -> list[Array]:
        """`predict` with these changes; NaN where it cannot be said."""
        ...

    def varying(self, weighed: Sequence[Any], log_price: float = 0.0) -> Self:
        """The same with these patterns (vary.patterns.Weighed) as further candidates, at a price beside their own."""
        ...

    def scattered(self, name: str, changes: Array) -> Self:
        """The same about these changes (N,) of this number, by which recordings differ without order: it is among
        `scatter`."""
        ...

    def at_common(self) -> Self:
        """The same with one value for all of what scatters, about which it does."""
        ...


def added(*changes: Changes) -> Changes:
    """The sum of several, number by number; of instants the last that is given."""
    out: dict[str, Array] = {}
    for some in changes:
        for n, c in some.items():
            out[n] = out[n] + c if n in out and n != SINCE else c
    return out


# -- the instrument: of any system, from what it predicts ------------------------------------------------------------
SCALE, OFFSET, RATE, LOST = "scale", "clock_offset", "clock_rate", "lost_frames"
CLOCK = (OFFSET, RATE, LOST)
INSTRUMENT = (SCALE, *CLOCK)
SINCE = "lost_since"  # beside lost frames: when, in every recording [s]


def instruments(observations: Sequence[Observation]) -> dict[str, Variable]:
    """What a camera or a clock may have wrong in a recording."""
    frame = float(np.median([np.median(np.diff(o.t)) for o in observations]))
    return {
        SCALE: Variable(SCALE, 1.0, "1", 0.05, 1e-4, least=-0.9),
        OFFSET: Variable(OFFSET, 0.0, "s", 3.0 * frame, 0.02 * frame, relative=False),
        RATE: Variable(RATE, 1.0, "1", 0.02, 1e-5, least=-0.9),
        LOST: Variable(LOST, 0.0, "frames", 2.0, 0.05, relative=False, whole=True),
    }


def shown(o: Observation, y: Array, faults: Mapping[str, float], since: float) -> Array:
    """What an instrument with these faults shows of a motion y (n,) that the true one reads at o.t.

    faults: changes by the names of `instruments`. A frame stamped t shows t + offset + rate (t - first); frames that
    were lost at `since` [s] leave the later stamps behind by as many.
    """
    if any(faults.get(n) for n in CLOCK):
        y = y.copy()
        for block in [b.readings for b in o.blocks] or [slice(0, o.t.size)]:
            t, here = o.t[block], y[block]
            whole = t.size >= 4 and bool(np.isfinite(here).all())
            y[block] = at_times(t, here, true_times(t, faults, since)) if whole else np.nan
    return (1.0 + faults.get(SCALE, 0.0)) * y


def true_times(t: Array, faults: Mapping[str, float], since: float) -> Array:
    """When frames stamped t (n,) [s] were taken, by a clock with these faults."""
    offset, rate, lost = (faults.get(n, 0.0) for n in CLOCK)
    return np.asarray(t + offset + rate * (t - t[0]) + lost * float(np.median(np.diff(t))) * (t >= since))


def faults_of(changes: Changes) -> Changes:
    """Those of the changes that are the instrument's."""
    return {n: c for n, c in changes.items() if n in (*INSTRUMENT, SINCE)}


def fault_of(changes: Changes, i: int) -> tuple[dict[str, float], float]:
    """Those of recording i by name, and since when frames are lost there [s]."""
    mine = {n: float(c[i]) for n, c in changes.items() if n in INSTRUMENT}
    return mine, float(changes[SINCE][i]) if SINCE in changes else 0.0


def shown_each(
    observations: Sequence[Observation], said: Sequence[Array], faults: Changes, which: Sequence[int]
) -> list[Array]:
    """What the instruments of these recordings show of what is said of them."""
    if not faults:
        return list(said)
    return [shown(observations[i], y, *fault_of(faults, i)) for i, y in zip(which, said)]
