"""What is questioned: measured motions, a model that predicts them, and the mechanisms that may be missing from it.

The engine knows nothing of jumpers: a pendulum or a falling ball is questioned in the same way (`System`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from typing import Any, Protocol, Self, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

from .noise.noise import Noise


class Indexed(str):
    """Name of a parameter that several have, each its own: `of` what it is, `number` whose; it reads `of[number]`."""

    of: str
    number: int

    def __new__(cls, of: str, number: int) -> Self:
        name = super().__new__(cls, f"{of}[{number}]")
        name.of, name.number = of, number
        return name

    def __reduce__(self) -> tuple[type[Self], tuple[str, int]]:
        return type(self), (self.of, self.number)


@dataclass(frozen=True)
class Parameter:
    """A number that a fit may change.

    start: first value. low, high: physical range. sigma: standard uncertainty of a Gaussian prior about `start` (inf:
    none, any value in the range alike). scale: a change that matters, for steps of derivatives. log: positive, and
    changed by factors in a fit, where it multiplies others.
    """

    name: str
    start: float
    low: float
    high: float
    scale: float
    sigma: float = math.inf
    unit: str = ""
    log: bool = False

    def at_end(self, value: float) -> bool:
        """Whether a value lies at an end of the range (a factor at 1e-4 of its scale is as good as 0)."""
        least = max(self.low, 1e-4 * self.scale) if self.log else self.low
        return value <= least + 1e-9 * self.scale or value >= self.high - 1e-9 * self.scale

    @property
    def width(self) -> float:
        """Width of the prior as of a uniform one: the range, or sqrt(2 pi) sigma."""
        return min(self.high - self.low, math.sqrt(2 * math.pi) * self.sigma)


@dataclass(frozen=True)
class Candidate:
    """A mechanism that may be missing. The first parameter is its strength, absent at `null`; the rest is its shape.

    shapes: sets of shape parameters at which its effect is tried first (their order: that of the parameters).
    replaces: a term that it takes the place of (then there is no strength at which it is absent).
    drops: parameters that are nobody's when that term is gone. goes_with: mechanisms of one cause with it, always tried
    as a pair. price: ln of how many like it were looked at before it was chosen. begin: values at which
    it was found to fit, the shared parameters' among them. dear: it is tried alone only where the residuals ask for it.
    own: parameters without which it is another, simpler cause: it is not named where they may be nil.
    """

    parameters: tuple[Parameter, ...]
    null: float = 0.0
    shapes: tuple[tuple[float, ...], ...] = ((),)
    replaces: str = ""
    drops: tuple[str, ...] = ()
    goes_with: tuple[str, ...] = ()
    price: float = 0.0
    begin: Mapping[str, float] | None = None
    dear: bool = False
    own: tuple[str, ...] = ()


@dataclass(frozen=True)
class Block:
    """Readings of an observation that one instrument made: their noise, and what is known of its zero.

    zero: standard deviation of the zero level of a record [unit of y]; inf: unknown, 0: none.
    """

    readings: slice
    noise: Noise
    zero: float = math.inf


ASIDE = 1e6  # factor on the noise of a recording that counts for nothing


@dataclass(frozen=True)
class Circumstances:
    """When, by whom and with what a motion was recorded.

    order: place in the series of recordings; time: when it was recorded [s] since any fixed instant; session: the day,
    person or set-up it belongs to; labels: anything else that is known of it, numbers or words. source: where order and
    time come from, in words ("[experiment] recorded", "the number in the name").
    """

    order: float | None = None
    time: float | None = None
    session: str | None = None
    labels: Mapping[str, float | str] = field(default_factory=dict)
    source: str = ""


@dataclass(frozen=True)
class Observation:
    """One measured motion: y (n,) at the times t (n,) [s], increasing (within each block).

    group: trials of one condition made alike. condition: what is held out together. spread: (n,) factor >= 1 on the
    noise, where repeated trials scatter by more than it. labels: anything to report by (kind, frequency, ...).
    parts: (n,) name of the part of the motion each sample belongs to (for "where"). blocks: where several instruments
    read the motion, their readings one after the other; () is one of the common noise, its zero unknown.
    circumstances: when, by whom and with what it was recorded. measured: its height as its track was measured, with the
    standard uncertainty [unit of y]; None where it has none.
    """

    name: str
    t: Array
    y: Array
    group: str
    condition: str
    labels: Mapping[str, Any] = field(default_factory=dict)
    spread: Array | None = None
    parts: NDArray[np.str_] | None = None
    blocks: tuple[Block, ...] = ()
    circumstances: Circumstances = field(default_factory=Circumstances)
    measured: tuple[float, float] | None = None

    @property
    def independent(self) -> int:
        """Readings, less one for each unknown zero; none of a recording that is set aside."""
        if self.spread is not None and self.spread.min() >= ASIDE:
            return 0
        return self.t.size - sum(math.isinf(b.zero) for b in self.blocks) if self.blocks else self.t.size - 1


def by_condition(observations: Sequence[Observation]) -> list[list[int]]:
    """Places of the observations of each condition."""
    out: dict[str, list[int]] = {}
    for i, o in enumerate(observations):
        out.setdefault(o.condition, []).append(i)
    return list(out.values())


class System(Protocol):
    """Motions, the baseline's free parameters and the vocabulary of mechanisms."""

    @property
    def observations(self) -> Sequence[Observation]: ...
    @property
    def baseline(self) -> tuple[Parameter, ...]: ...
    @property
    def candidates(self) -> Mapping[str, Candidate]: ...

    def predict(self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: Sequence[int]) -> list[Array]:
        """y of the observations `which` with these mechanisms beside the baseline's; NaN where it cannot be said."""
        ...

    def scatter(
        self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: Sequence[int]
    ) -> Mapping[str, list[Array]]:
        """What may differ from trial to trial of one condition: d(y)/d(it), by name; {} when nothing does."""
        ...


@runtime_checkable
class Costly(System, Protocol):
    """A system whose every run costs: it gives derivatives by what it has learned, and is asked of few motions."""

    @property
    def rough(self) -> bool:
        """Whether its predictions move in steps, or with noise of their own."""
        ...

    def derivatives(
        self, mechanisms: tuple[str, ...], free: Sequence[Parameter], values: Mapping[str, float], which: Sequence[int]
    ) -> list[Array]:
        """d(y)/d(parameter) (n, k) of the observations `which`, after `predict` at the same values."""
        ...

    def scouts(self, which: Sequence[int]) -> Sequence[int]:
        """The few of these observations over which first values are compared."""
        ...

    def carefully(self, fine: bool = False) -> AbstractContextManager[None]:
        """Within it derivatives are of their own point, or handed on once from close by. fine: over the usual short
        steps, where the system is rough too."""
        ...


def parameters(system: System, mechanisms: Sequence[str]) -> tuple[Parameter, ...]:
    """The free parameters of the baseline with these mechanisms; one that several share is there once."""
    gone = {n for m in mechanisms for n in system.candidates[m].drops}
    out = {p.name: p for p in system.baseline if p.name not in gone}
    for m in mechanisms:
        for p in system.candidates[m].parameters:
            out[p.name] = p
    return tuple(out.values())


def patterns_of(system: System) -> Mapping[str, Any]:
    """Ways in which numbers may vary (`vary.patterns.Pattern`) among the candidates of a system, by name."""
    return getattr(system, "patterns", {})


def at_a_time(system: System) -> int:
    """Questions that a system answers at a time: its `workers`, or one."""
    return getattr(system, "workers", 1)


def predict_each(
    system: System, mechanisms: tuple[str, ...], sets: Sequence[Mapping[str, float]], which: Sequence[int]
) -> list[list[Array]]:
    """What a system predicts with several sets of values: at once where it can (its `predict_each`)."""
    own = getattr(system, "predict_each", None)
    return own(mechanisms, sets, which) if own else [system.predict(mechanisms, s, which) for s in sets]


@dataclass(frozen=True)
class Part:
    """Some observations of a system, as a system."""

    whole: System
    kept: tuple[int, ...]

    @property
    def workers(self) -> int:
        return at_a_time(self.whole)

    @property
    def observations(self) -> Sequence[Observation]:
        return [self.whole.observations[i] for i in self.kept]

    @property
    def baseline(self) -> tuple[Parameter, ...]:
        return self.whole.baseline

    @property
    def candidates(self) -> Mapping[str, Candidate]:
        return self.whole.candidates

    def predict(self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: Sequence[int]) -> list[Array]:
        return self.whole.predict(mechanisms, values, [self.kept[i] for i in which])

    def predict_each(
        self, mechanisms: tuple[str, ...], sets: Sequence[Mapping[str, float]], which: Sequence[int]
    ) -> list[list[Array]]:
        return predict_each(self.whole, mechanisms, sets, [self.kept[i] for i in which])

    def scatter(
        self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: Sequence[int]
    ) -> Mapping[str, list[Array]]:
        return self.whole.scatter(mechanisms, values, [self.kept[i] for i in which])


@dataclass(frozen=True)
class CostlyPart(Part):
    """Some observations of a system whose runs are dear."""

    whole: Costly

    @property
    def rough(self) -> bool:
        return self.whole.rough

    def derivatives(
        self, mechanisms: tuple[str, ...], free: Sequence[Parameter], values: Mapping[str, float], which: Sequence[int]
    ) -> list[Array]:
        return self.whole.derivatives(mechanisms, free, values, [self.kept[i] for i in which])

    def scouts(self, which: Sequence[int]) -> Sequence[int]:
        return self.whole.scouts(which)

    def carefully(self, fine: bool = False) -> AbstractContextManager[None]:
        return self.whole.carefully(fine)
