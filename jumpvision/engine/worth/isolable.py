"""Which causes recordings could show and distinguish, before they are made: a table from derivatives alone.

Causes are mechanisms, and drifts of numbers in the order of the recordings. Linear about the declared model: with F the
information (whitened sensitivities, squared and summed) of the fitted parameters b and of the strengths m of all
causes, S = F_mm - F_mb F_bb^-1 F_bm is what the fit cannot mimic. A cause shows from z / sqrt(S_mm) on, beside a rival
j from z / sqrt(S_mm - S_mj^2 / S_jj) on; z is that of the test of a diagnosis with its power.
"""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.engine.detect import LEVEL, POWER
from jumpvision.engine.document.diagnosis import strength
from jumpvision.engine.document.values import Pattern as Kind
from jumpvision.engine.fitting import Problem
from jumpvision.engine.priors import prior_of
from jumpvision.engine.study.processes import How
from jumpvision.engine.study.question import problem_of, recordings_problems, studied
from jumpvision.engine.study.runs import Runs
from jumpvision.engine.study.study import Recording, Study
from jumpvision.engine.system import Parameter
from jumpvision.engine.vary.apart import variables
from jumpvision.engine.vary.patterns import Pattern, Weighed
from jumpvision.engine.vary.variables import Varying

if TYPE_CHECKING:
    import pandas as pd

TWIN_STRENGTH = 3.0  # of the one that shows: a rival from which such an effect is not distinguished is a twin
DRIFT_START = 0.1  # of a number's spread: where the linear drift of a number begins
REMEDY = ": that needs another sensor, a test of its own or other motions"
LEAST_SEEN = 1e-9  # of a sensitivity squared: less than this beside the fit counts as nothing


@dataclass(frozen=True)
class Shown:
    """Hold what recordings show of a cause.

    from_: the strength from which the cause shows with power, NaN where none in its range does. twins: causes not
    distinguished from it at TWIN_STRENGTH times that strength.
    """

    mechanism: str
    parameter: str
    unit: str
    from_: float
    twins: tuple[str, ...]


@dataclass(frozen=True)
class Isolable:
    """causes: mechanisms, and drifts of numbers, each with what shows of it. recordings: how many; called: what they
    are, in words. left_out: what was not asked, and why."""

    causes: Sequence[Shown]
    recordings: int
    called: str = "recordings"
    left_out: Sequence[str] = ()

    @property
    def rows(self) -> list[dict[str, str]]:
        """As a table: cause, shows from, not distinguishable from."""
        out = []
        for c in self.causes:
            at = f"{c.parameter} {strength(c.from_)}" + ("" if c.unit == "1" else f" {c.unit}")
            shows = at if math.isfinite(c.from_) else "no value in its range would show"
            out.append(
                {"cause": c.mechanism, "shows from": shows, "not distinguishable from": ", ".join(c.twins) or "-"}
            )
        return out

    @property
    def table(self) -> pd.DataFrame:
        """The same for pandas."""
        import pandas as pd

        return pd.DataFrame(self.rows).set_index("cause")

    @property
    def sentence(self) -> str:
        """The table in a sentence."""
        blind = [c.mechanism for c in self.causes if not math.isfinite(c.from_)]
        twins, n = sum(bool(c.twins) for c in self.causes), len(self.causes)
        said = f"{self.recordings} {self.called} could show {n - len(blind)} of {n} causes"
        if twins:
            said += (
                f"; {twins} of them cannot be distinguished from another by these: that needs another sensor, a test"
            )
            said += " of its own or other motions"
        return said + (f"; no value in their range would show: {', '.join(blind)}" if blind else "") + "."

    def __repr__(self) -> str:
        return f"{self.sentence}\n{self.table.to_string()}"

    def _repr_html_(self) -> str:
        return f"<p>{html.escape(self.sentence)}</p>{self.table.to_html()}"


def weigh_causes(problem: Problem, called: str = "recordings", left_out: Sequence[str] = ()) -> Isolable:
    """Tabulate what the recordings of a problem can show of its mechanisms, and of drifts of its numbers."""
    assert isinstance(problem.system, Varying)
    line, numbers = np.linspace(0.0, 1.0, len(problem.all))[:, None], variables(problem.system).values()
    drifts = [Pattern((v,), Kind.DRIFT, "order", line) for v in numbers if not v.whole and len(line) > 1]
    begun = [Weighed(p, np.array([DRIFT_START * p.variable.spread]), np.eye(1), 0.0, 0.0) for p in drifts]
    problem = problem.asked_of(problem.system.varying(begun))
    base = problem.system.baseline
    causes = {n: c for n, c in problem.system.candidates.items() if not c.replaces}
    columns = [_slopes(problem, (), base, [p.start for p in base])]
    for n, c in causes.items():
        columns.append(_slopes(problem, (n,), c.parameters, [c.null, *(p.start for p in c.parameters[1:])])[:, :1])
    design, k = np.hstack(columns), len(base)
    whole = design.T @ design
    whole[:k, :k] += prior_of(base, problem.measured).precision + np.diag([12.0 / (p.high - p.low) ** 2 for p in base])
    left = whole[k:, k:] - whole[k:, :k] @ np.linalg.solve(whole[:k, :k], whole[:k, k:])
    seen = np.diag(left) > LEAST_SEEN * np.maximum(np.diag(whole)[k:], 1e-300)
    own = np.where(seen, np.diag(left), 0.0)
    beside = own[:, None] - np.where(np.outer(seen, seen), left, 0.0) ** 2 / np.where(seen, own, np.inf)
    z = float(
        scipy.stats.norm.isf(LEVEL / (4.0 * max(len(causes), 1))) + scipy.stats.norm.ppf(POWER)
    )  # two looks, two signs
    drifting = {p.name: f"drift of {p.variable.name}" for p in drifts}
    names, out = [drifting.get(n, n) for n in causes], []
    for i, (n, c) in enumerate(causes.items()):
        p, need = c.parameters[0], z / math.sqrt(own[i]) if seen[i] else math.inf
        at = next((x for x in (c.null + need, c.null - need) if p.low <= x <= p.high), math.nan)
        twins = [rival for j, rival in enumerate(names) if j != i and beside[i, j] * TWIN_STRENGTH**2 < own[i]]
        out.append(Shown(names[i], "change" if n in drifting else p.name, p.unit or "1", at, tuple(twins)))
    return Isolable(out, len(problem.all), called, left_out)


def _slopes(problem: Problem, names: tuple[str, ...], free: Sequence[Parameter], at: Sequence[float]) -> Array:
    """Return d(whitened prediction)/d(parameter) (n, k) of all recordings, at these values and the declared baseline;
    0 where it cannot be had."""
    frame = problem.frame((), {p.name: p.start for p in problem.system.baseline})
    here = problem.residuals(names, dict(zip((p.name for p in free), at)), frame=frame)
    if here is None:
        return np.zeros((sum(o.t.size for o in problem.system.observations), len(free)))
    return np.vstack(problem.jacobian(names, free, np.array(at, float), here, None, frame))


def weigh_planned(recordings: Sequence[Recording], study: Study, how: How) -> Isolable:
    """Tabulate what recordings of a user's own machine could show, the study as it begins and its causes absent.

    Values may be NaN: then the noise must be stated. Raises InputError for what cannot be asked.
    """
    if problems := recordings_problems(recordings):
        raise InputError(problems)
    planned = [_filled(r, study) for r in recordings]
    runs = Runs(study, planned, how)
    try:
        return weigh_causes(problem_of(studied(study, planned, runs)))
    finally:
        runs.close()


def _filled(r: Recording, study: Study) -> Recording:
    """A recording that is not made yet, with what the study says of it."""
    if np.isfinite(r.of_channels(r.values, study.channels)).any():
        return r
    if unknown := [c.name for c in study.channels if c.noise is None and r.sigma is None]:
        said = f"recording {r.name!r}: it has no readings, and the noise of {', '.join(unknown)} is not stated"
        raise InputError([f"{said}: give Channel({unknown[0]!r}, noise=...)"])
    return replace(r, values=study.predict({}, r))
