"""What varies, from findings to the record: numbers with their units, recordings by their names."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence

import numpy as np

from jumpvision.base.arrays import Z90, Array
from jumpvision.engine.naming import CLEAR
from jumpvision.engine.order import Findings
from jumpvision.engine.system import Observation
from jumpvision.engine.vary.explain import Varied
from jumpvision.engine.vary.patterns import Pattern, Scatter
from jumpvision.engine.vary.variables import Variable

from . import values as record
from .varies import COMMAND, IN_ORDER, RECORDING


def varies_of(d: Findings) -> tuple[record.Varies, ...]:
    """Every number that varies, the surest first."""
    if not d.varies or d.problem is None:
        return ()
    observations = d.problem.system.observations
    fitted = d.best.named
    out = [v for x in d.varies.patterns for v in _pattern(x, observations, fitted, d.varies.commands)]
    out += [_aside(i, d, observations) for i in d.varies.commands if i not in d.varies.aside]
    if d.varies.scatter:
        out.append(_scatter(d.varies.scatter, observations, fitted))
    for i in d.varies.aside:
        if (w := d.varies.slips.get(i)) is None:
            out.append(_aside(i, d, observations))
        else:
            far = Varied(w.pattern, w.coefficients, w.covariance, d.detection.p_value, None)
            out += _pattern(far, observations, fitted)
    return tuple(out)


def title(p: Pattern, observations: Sequence[Observation]) -> str:
    """Of a pattern among causes, for a reader."""
    what = " and ".join(dict.fromkeys(v.name for v in p.variables))
    if p.kind is record.Pattern.ODD:
        names = [observations[i].name for i in p.members]
        return f"{what} of {', '.join(names[:3])}{' and others' if len(names) > 3 else ''}"
    return f"{what} with {p.of or 'recording'}"


def _pattern(
    x: Varied, observations: Sequence[Observation], fitted: Mapping[str, float], but: Collection[int] = ()
) -> Iterator[record.Varies]:
    """One entry a number; of recordings with values of their own, one each, `but` these."""
    p = x.pattern
    base = float(x.coefficients[-1]) if p.about_own else 0.0
    changes = [_change(x, k) for k in range(p.design.shape[1] - p.about_own)]
    clear = [k for k, (change, sigma) in enumerate(changes) if abs(change) >= CLEAR * sigma]
    for k, (change, sigma) in enumerate(changes):
        if p.kind is record.Pattern.ODD and clear and k not in clear:
            continue  # one of several, that does not stand apart by itself
        column, v = p.design[:, k], p.variables[k]
        members = tuple(np.flatnonzero(column).tolist()) if p.kind is record.Pattern.ODD else p.members
        if p.kind is record.Pattern.ODD and set(members) <= set(but):
            continue
        if p.kind is record.Pattern.FUNCTION and not members and math.isfinite(p.break_at):
            members = tuple(np.flatnonzero(column > 0).tolist())
        own, each = x.each, {}
        if own and own.variable.name == v.name:
            each = _values(p.changes(x.coefficients)[v.name] + own.change, own.sigma, v, observations, fitted)
        ends = sorted(_value(v, change + s * Z90 * sigma, fitted) for s in (-1.0, 1.0))
        yield record.Varies(
            parameter=v.name,
            kind=p.kind,
            of=p.of,
            recordings=tuple(observations[i].name for i in members),
            value=_value(v, change, fitted),
            low=ends[0],
            high=ends[1],
            unit=v.unit or "1",
            declared=_value(v, base, fitted),
            p_value=x.p_value,
            each=each,
            at=_at(p, observations),
            source=observations[0].circumstances.source if p.of in IN_ORDER else "",
            also=p.also,
        )


def _value(v: Variable, change: float, fitted: Mapping[str, float]) -> float:
    """The number itself; what was fitted to all where it was."""
    level = fitted.get(v.name, v.declared)
    return level * (1.0 + change) if v.relative else level + change


def _size(v: Variable, fitted: Mapping[str, float]) -> float:
    """Of the number, a change of 1."""
    return abs(fitted.get(v.name, v.declared)) if v.relative else 1.0


def _values(
    changes: Array, sigma: Array, v: Variable, observations: Sequence[Observation], fitted: Mapping[str, float]
) -> dict[str, tuple[float, float]]:
    size = _size(v, fitted)
    each = zip(observations, changes, sigma)  # a recording that tells nothing of it is known to the spread before
    return {o.name: (_value(v, float(c), fitted), float(min(s, v.spread)) * size) for o, c, s in each}


def _at(p: Pattern, observations: Sequence[Observation]) -> dict[str, float | str]:
    if p.at is not None:
        return {o.name: float(a) for o, a in zip(observations, p.at) if math.isfinite(a)}
    if p.of == "session":
        return {o.name: o.circumstances.session for o in observations if o.circumstances.session}
    return {o.name: x for o in observations if (x := o.circumstances.labels.get(p.of or "")) is not None}


def _scatter(s: Scatter, observations: Sequence[Observation], fitted: Mapping[str, float]) -> record.Varies:
    v = s.variable
    size = _size(v, fitted)
    return record.Varies(
        parameter=v.name,
        kind=record.Pattern.SCATTER,
        of=None,
        recordings=(),
        value=s.value * size,
        low=s.low * size,
        high=s.high * size,
        unit=v.unit or "1",
        declared=fitted.get(v.name, v.declared),
        p_value=min(1.0, math.exp(-min(max(s.gained, 0.0), 700.0))),  # of odds as large by noise alone
        each=_values(s.apart.change, s.apart.sigma, v, observations, fitted),
    )


def _change(x: Varied, k: int) -> tuple[float, float]:
    """Of the k-th number where it is largest, with its standard uncertainty."""
    p = x.pattern
    at = np.zeros(p.design.shape[1])
    at[k] = p.design[int(np.argmax(np.abs(p.design[:, k]))), k]
    at[-1] += 1.0 if p.about_own else 0.0
    return float(at @ x.coefficients), math.sqrt(max(float(at @ x.covariance @ at), 0.0))


def _aside(i: int, d: Findings, observations: Sequence[Observation]) -> record.Varies:
    """A recording that no number explains, or that was driven as another should have been."""
    like, name, nan = d.varies.commands.get(i) if d.varies else None, observations[i].name, math.nan
    parameter, at = (RECORDING, {}) if like is None else (COMMAND, {name: observations[like].name})
    p = d.detection.p_value
    return record.Varies(parameter, record.Pattern.ODD, None, (name,), nan, nan, nan, "1", nan, p, at=at)
