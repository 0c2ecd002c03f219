"""Which causes recordings could show and distinguish, before they are made: a table from derivatives alone.

Of every mechanism, and of every number that may drift in the order of the recordings, the strength from which it would
show, and what it could not be distinguished from (`identify`).
"""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from jumpvision.engine.document.diagnosis import strength
from jumpvision.engine.document.values import Pattern as Kind
from jumpvision.engine.fitting import Problem
from jumpvision.engine.vary.apart import variables
from jumpvision.engine.vary.patterns import Pattern, Weighed
from jumpvision.engine.vary.variables import Varying

from .identify import Shown, information, limits_of_causes

if TYPE_CHECKING:
    import pandas as pd

DRIFT = "drift of "
SHARE = 0.1  # of a number's spread: where a drift begins


@dataclass(frozen=True)
class Isolable:
    """causes: mechanisms, and drifts of numbers, each with what shows of it. recordings: how many; called: what they
    are, in words. remedy: where else to look, in words. left_out: what was not asked, and why."""

    causes: Sequence[Shown]
    recordings: int
    called: str = "recordings"
    remedy: str = ""
    left_out: Sequence[str] = ()

    @property
    def rows(self) -> list[dict[str, str]]:
        """As a table: cause, shows from, not distinguishable from."""
        return [
            {
                "cause": c.mechanism,
                "shows from": f"{c.parameter} {strength(c.from_)} {'' if c.unit == '1' else c.unit}".rstrip()
                if np.isfinite(c.from_)
                else "no value in its range would show",
                "not distinguishable from": ", ".join(c.twins) or "-",
            }
            for c in self.causes
        ]

    @property
    def table(self) -> pd.DataFrame:
        """The same for pandas."""
        import pandas as pd

        return pd.DataFrame(self.rows).set_index("cause")

    @property
    def sentence(self) -> str:
        """The table in a sentence."""
        blind = [c.mechanism for c in self.causes if not np.isfinite(c.from_)]
        twins = sum(bool(c.twins) for c in self.causes)
        said = (
            f"{self.recordings} {self.called} could show {len(self.causes) - len(blind)} of {len(self.causes)} causes"
        )
        if twins:
            said += (
                f"; {twins} of them cannot be distinguished from another by these: that needs another sensor, a test of"
            )
            said += f" its own or other motions{self.remedy}"
        return said + (f"; no value in their range would show: {', '.join(blind)}" if blind else "") + "."

    def __repr__(self) -> str:
        return f"{self.sentence}\n{self.table.to_string()}"

    def _repr_html_(self) -> str:
        return f"<p>{html.escape(self.sentence)}</p>{self.table.to_html()}"


def isolable(problem: Problem) -> Sequence[Shown]:
    """What the recordings of a problem can show of its mechanisms, and of drifts of its numbers."""
    system = problem.system
    assert isinstance(system, Varying)
    drifts = _drifts(system) if len(problem.all) > 1 else []
    info = information(problem.asked_of(system.varying(drifts)))
    numbers = {w.pattern.name: w.pattern.variable.name for w in drifts}
    return [_named(c, numbers) for c in limits_of_causes(info, problem.all)]


def _drifts(system: Varying) -> list[Weighed]:
    """Of every number, a straight line over the recordings in their order."""
    line = np.linspace(0.0, 1.0, len(system.observations))[:, None]
    every = [v for v in variables(system).values() if not v.whole]
    patterns = [Pattern((v,), Kind.DRIFT, "order", line) for v in every]
    return [Weighed(p, np.array([SHARE * p.variable.spread]), np.eye(1), 0.0, 0.0) for p in patterns]


def _named(c: Shown, drifts: Mapping[str, str]) -> Shown:
    """A drift by the name of its number, in shares of it. drifts: names of numbers by those of their patterns."""

    def said(name: str) -> str:
        return f"{DRIFT}{drifts[name]}" if name in drifts else name

    parameter = "change" if c.mechanism in drifts else c.parameter
    return replace(c, mechanism=said(c.mechanism), parameter=parameter, twins=tuple(map(said, c.twins)))
