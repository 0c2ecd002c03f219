"""[mechanism.NAME]: a mechanism of the user's own, its law in one line of text, as a record like the built-in ones."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, make_dataclass, replace
from typing import Any, TypeGuard

import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.schema import closest, param
from jumpvision.engine.laws.dimension import check_dimension, dimension
from jumpvision.engine.laws.expression import Expression, LawError
from jumpvision.engine.laws.tree import ARGUMENTS, in_order

from .record import LONG_AGO, STATE, Body, Mechanism, Parameter, Prior, Robot
from .record import bare as bare
from .record import own_name as own_name
from .registry import MECHANISMS, PARAMETERS, ModelParameters

PLACES = {
    "static": Body.STATIC,
    "foot": Body.FOOT,
    "foot_mass": Body.INERTIA,
    "carriage": Body.CARRIAGE,
    "spring": Body.SPRING,
    "motor": Body.MOTOR,
    "film_height": Body.HEIGHT,
    "film_time": Body.TIME,
}
"""What a law may act on, as files have it."""
OF_GROUND = (Body.STATIC, Body.FOOT, Body.INERTIA)
KEYS = ("acts_on", "law", "let", "words", "source", "parameters", "state", "state_unit", "seen")
OF_PARAMETER = ("unit", "start", "range", "sigma", "words")


@dataclass(frozen=True)
class Given:
    """A prior that is the same for every model."""

    prior: Prior

    def __call__(self, model: Robot | None) -> Prior:
        return self.prior


def mechanism(
    name: str,
    acts_on: str,
    law: str,
    parameters: Sequence[Parameter],
    *,
    let: Mapping[str, str] | None = None,
    words: str = "",
    source: str = "yours",
    state: str = "",
    state_unit: str = "",
    seen: Mapping[str, tuple[float, float]] | None = None,
) -> Mechanism:
    """The record of a law in text. parameters: under the names that the law uses, priors and all; SI.

    A parameter in which the law is absent at 0 comes first, as its strength. Raises LawError with the remedy: unknown
    symbol, wrong dimension, not finite at rest, no strength.
    """
    body = PLACES[acts_on]
    m = Mechanism(
        name,
        body,
        tuple(replace(p, name=own_name(name, p.name)) for p in parameters),
        words or f"{acts_on.replace('_', ' ')}: {law}",
        words or f"the law {law} on the {acts_on.replace('_', ' ')}",
        source,
        equation=law,
        law=law,
        let=let or {},
        state=state,
        state_unit=state_unit,
        own=True,
        grounds=("granular",) if body in OF_GROUND else ("hard", "granular"),
        seen=seen or {},
    )
    assert m.expression is not None
    check_dimension(m.expression.root, m.units, body.unit)
    _at_rest(m.expression, m.parameters)
    if m.rate:
        check_dimension(m.rate.root, m.units, f"{state_unit} s^-1".strip())
        _at_rest(m.rate, m.parameters)
    strength = next((p for p in m.parameters if _absent(m.expression, m.parameters, p)), None)
    if strength is None:
        raise LawError("has no parameter that switches it off: multiply it by one, as in q * (...)")
    return replace(m, parameters=tuple(sorted(m.parameters, key=lambda p: p is not strength)))


def acts_on(m: Mechanism) -> str:
    """What a mechanism of the user's own acts on, as files have it."""
    return next(name for name, body in PLACES.items() if body is m.acts_on)


def _rest(law: Expression) -> dict[str, float]:
    return {s: {"contact_s": LONG_AGO, "R": 0.02, "phi": 0.6, "rho": 1e3}.get(s, 0.0) for s in law.symbols}


def _usual(p: Parameter) -> float:
    q = p.prior(None)
    return q.start or 0.5 * (q.low + q.high)


def _at_rest(law: Expression, parameters: Sequence[Parameter]) -> None:
    """Raises LawError where the law is no number at rest."""
    at = _rest(law) | {p.name: _usual(p) for p in parameters}
    with np.errstate(all="ignore"):
        if np.isfinite(law(np, **{n: np.float64(v) for n, v in at.items()})):
            return
        for n in in_order([law.root]):
            value = Expression("", n)(np, **{k: np.float64(v) for k, v in at.items()})
            if not np.isfinite(value):
                zero = sorted(m for m in n.symbols if m in STATE and at.get(m) == 0.0)
                raise LawError(
                    f"is not finite at rest, where {' = '.join([*zero, '0']) if zero else 'all is still'} "
                    "(a division by zero, its power or logarithm): add a scale, as in v / (abs(v) + v_0)"
                )


def _absent(law: Expression, parameters: Sequence[Parameter], off: Parameter) -> bool:
    """Whether the law is 0 wherever this parameter is."""
    rng = np.random.default_rng(0)
    at: dict[str, ArrayLike] = {s: rng.uniform(-0.5, 0.5, 50) for s in law.symbols}
    at |= {p.name: _usual(p) for p in parameters} | {off.name: 0.0}
    with np.errstate(all="ignore"):
        values = np.asarray(law(np, **at), float)
    return bool(np.all((values == 0.0) | np.isnan(values)) and np.any(values == 0.0))


def read_own(tables: object, where: str) -> tuple[dict[str, Mechanism], list[str]]:
    """(mechanisms by name, problems) of the [mechanism.*] tables. where: file and section, to name."""
    if not isinstance(tables, Mapping):
        return {}, [f"{where} = {tables!r}: must be tables, written [mechanism.NAME]"]
    out, problems = {}, []
    for name, table in tables.items():
        here = f"{where[:-1]}.{name}]"
        m, more = _read_one(name, table, here)
        problems += more
        if m:
            out[name] = m
    return out, problems


def _read_one(name: str, table: object, where: str) -> tuple[Mechanism | None, list[str]]:
    if not name.isidentifier():
        return None, [f"{where}: '{name}' is no name; use letters, digits and _"]
    if name in MECHANISMS or name in PARAMETERS or name in STATE:
        return None, [f"{where}: '{name}' is built in; give it another name, e.g. {name}_own"]
    if not isinstance(table, Mapping):
        return None, [f"{where} = {table!r}: must be a table"]
    problems = [f"{where} {k}: unknown key{closest(k, KEYS)}" for k in table if k not in KEYS]
    place: Any = table.get("acts_on")
    if place not in PLACES:
        said = "missing" if place is None else f"{place!r} is no body"
        problems.append(f"{where} acts_on: {said}; give one of {', '.join(PLACES)}")
    texts = {k: table.get(k, "") for k in ("law", "words", "source", "state", "state_unit")}
    problems += [f"{where} {k} = {v!r}: must be text in quotes" for k, v in texts.items() if not isinstance(v, str)]
    let = table.get("let", {})
    if not isinstance(let, Mapping) or not all(isinstance(x, str) for x in let.values()):
        problems.append(f'{where} let = {let!r}: must be a table of texts, as {{ depth = "maximum(z, 0)" }}')
    if texts["law"] == "":
        problems.append(f'{where} law: missing; give it in one line, e.g. law = "-q * v"')
    parameters, more = _parameters(table.get("parameters", {}), f"{where[:-1]}.parameters]")
    problems += more
    seen: dict[str, tuple[float, float]] = {}
    for s, ends in (table.get("seen") or {}).items() if isinstance(table.get("seen", {}), Mapping) else ():
        if problem := _pair(ends):
            problems.append(f"{where} seen.{s} = {ends!r}: {problem}")
        else:
            seen[s] = (float(ends[0]), float(ends[1]))
    if problems:
        return None, problems
    for p in parameters:
        if p.name in STATE or p.name in ARGUMENTS:
            problems.append(f"{where} parameters.{p.name}: is a symbol of every law already; give it another name")
    if problems:
        return None, problems
    try:
        return mechanism(
            name,
            place,
            texts["law"],
            parameters,
            let=let,
            words=texts["words"],
            source=texts["source"] or "yours",
            state=texts["state"],
            state_unit=texts["state_unit"],
            seen=seen,
        ), []
    except LawError as e:
        return None, [f"{where} law = {texts['law']!r}: {e}"]


def _parameters(table: object, where: str) -> tuple[list[Parameter], list[str]]:
    if not isinstance(table, Mapping):
        return [], [f"{where} = {table!r}: must be tables, written {where[:-1]}.NAME]"]
    out, problems = [], []
    for name, values in table.items():
        here = f"{where[:-1]}.{name}]"
        if not isinstance(values, Mapping):
            problems.append(f"{here} = {values!r}: must be a table with unit, start and range")
            continue
        wrong = [f"{here} {k}: unknown key{closest(k, OF_PARAMETER)}" for k in values if k not in OF_PARAMETER]
        start: Any
        start, unit, sigma = values.get("start"), values.get("unit", ""), values.get("sigma", math.inf)
        if not _is_number(start):
            wrong.append(f"{here} start = {start!r}: must be a number")
        if not isinstance(unit, str):
            wrong.append(f'{here} unit = {unit!r}: must be text, as "N s/m"')
        else:
            try:
                dimension(unit)
            except LawError as e:
                wrong.append(f"{here} unit: {e}")
        if not (_is_number(sigma, finite=False) and sigma > 0):
            wrong.append(f"{here} sigma = {sigma!r}: must be a number > 0")
        ends = values.get("range", [start, start])
        if problem := _pair(ends, equal="range" not in values):
            wrong.append(f"{here} range = {ends!r}: {problem}")
        elif not wrong and not ends[0] <= start <= ends[1]:
            wrong.append(f"{here} start = {start!r}: must lie in range = {list(ends)!r}")
        problems += wrong
        if not wrong:
            low, high = map(float, ends)
            out.append(
                parameter(name, float(start), low, high, unit, sigma=float(sigma), words=str(values.get("words", "")))
            )
    return out, problems


def parameter(
    name: str,
    start: float,
    low: float,
    high: float,
    unit: str,
    *,
    sigma: float = math.inf,
    words: str = "",
    scale: float | None = None,
    grid: tuple[float, ...] = (),
) -> Parameter:
    """A parameter of one's own. low = high: a constant of the law, never fitted."""
    step = scale or 0.02 * (high - low) or 1.0
    prior = Given(Prior(start, low, high, step, sigma, grid=grid))
    return Parameter(name, unit, words or name, prior, default=start, lo=low, hi=high)


def _is_number(x: object, finite: bool = True) -> TypeGuard[float]:
    return isinstance(x, int | float) and not isinstance(x, bool) and (math.isfinite(x) or not finite)


def _pair(ends: object, equal: bool = False) -> str:
    """What is wrong with [low, high]; "" where nothing is."""
    if not (isinstance(ends, list | tuple) and len(ends) == 2 and all(_is_number(x) for x in ends)):
        return "must be [low, high], two numbers"
    return "" if ends[0] < ends[1] or (equal and ends[0] == ends[1]) else "low must be below high"


def parameters_with(own: Sequence[Mechanism]) -> type[ModelParameters]:
    """The record of parameters with those of one's own beside the built-in ones."""
    return _with(tuple(p for m in own for p in m.parameters)) if own else ModelParameters


@functools.cache
def _with(parameters: tuple[Parameter, ...]) -> type[ModelParameters]:
    fields = [(p.name, float, param(p.default, p.unit, p.meaning, lo=p.lo, hi=p.hi)) for p in parameters]
    return make_dataclass(
        "ModelParameters",
        fields,
        bases=(ModelParameters,),
        frozen=True,
        namespace={"__reduce__": lambda self: (_again, (parameters, dict(self.__dict__)))},
    )


def _again(parameters: tuple[Parameter, ...], values: dict[str, float]) -> ModelParameters:
    return _with(parameters)(**values)
