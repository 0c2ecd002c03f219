"""diagnosis.json as a type: what a simulation gets wrong, where, why, and what mends it (docs/files.md section 4).

Fields have the names of the file's keys, in their order. A number that is not known is NaN here and null there.
"""

from __future__ import annotations

import html
import json
import math
from collections.abc import Mapping
from dataclasses import Field, dataclass, field, fields, is_dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self, get_args, get_origin, get_type_hints

from jumpvision.base.numbers import said, times
from jumpvision.base.record import Record, RecordError, plain

from . import FILE
from .values import (
    OPTIONAL,
    Baseline,
    Cause,
    Cell,
    Closest,
    CommonError,
    Confirmation,
    Detectable,
    Discovered,
    Doubt,
    Energies,
    Gain,
    Height,
    LeftOver,
    Model,
    NextExperiment,
    Noise,
    Parameter,
    Prediction,
    Priors,
    Runs,
    Selection,
    Simulated,
    Status,
    Suggested,
    Trace,
    Varies,
    Verdict,
    WithoutFilms,
)

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

WIDE = 140  # characters of a line in a plain repr


@dataclass(frozen=True, kw_only=True, repr=False)
class Diagnosis(Record):
    """What a campaign's model gets wrong, or that it is adequate. named: the mechanisms that explain it.

    status: "partial" where they leave significant misfit, "undetermined" where the data establish none; left_over: what
    they leave, None where nothing was sought. indistinguishable: mechanisms that would do as well.
    extended_model: the baseline, re-fitted, where nothing is named. `values` is diagnosis.json as a dict.

    Of a user's own simulator also: unit, of every number whose key ends in _m ("noise": several channels, in units of
    their noise); fitted, the parameters of the extended model; correlations of their errors; lacks, the mechanisms in
    words; runs; doubts: parameters without effect, that cannot be told, to which the simulator answers in steps;
    simulated: open-loop error of every model named; prediction: the model to predict new recordings with;
    traces, search (not in the file), measured and simulated values; the steps of the search.
    """

    file = FILE

    schema: int = 3
    verdict: Verdict
    p_value: float
    baseline: Baseline
    where: tuple[Cell, ...]
    heights: tuple[Height, ...]
    causes: tuple[Cause, ...]
    named: tuple[str, ...]
    status: Status
    left_over: LeftOver | None
    detectable: tuple[Detectable, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    closest: Closest | None
    unexplained: None = None  # the key stays for one release
    extended_model: Model
    gain: Gain | None
    selection: tuple[Selection, ...]
    extrapolation: Mapping[str, Gain]
    next_experiment: NextExperiment | None
    priors: Priors | None
    noise: Noise
    common: tuple[CommonError, ...]
    energy: tuple[Energies, ...]
    confirmation: tuple[Confirmation, ...]
    without_films: WithoutFilms | None = field(default=None, metadata=OPTIONAL)
    discovered: Discovered | None = None
    varies: tuple[Varies, ...] = ()
    suggested: tuple[Suggested, ...] = ()
    unit: str | None = field(default=None, metadata=OPTIONAL)
    fitted: Mapping[str, Parameter] | None = field(default=None, metadata=OPTIONAL)
    correlations: Mapping[str, Mapping[str, float]] | None = field(default=None, metadata=OPTIONAL)
    lacks: Mapping[str, str] | None = field(default=None, metadata=OPTIONAL)
    runs: Runs | None = field(default=None, metadata=OPTIONAL)
    doubts: tuple[Doubt, ...] = field(default=(), metadata=OPTIONAL)
    simulated: tuple[Simulated, ...] = field(default=(), metadata=OPTIONAL)
    prediction: Prediction | None = field(default=None, metadata=OPTIONAL)
    sentence: str
    confirmed: str | None
    traces: ClassVar[tuple[Trace, ...]] = ()
    search: ClassVar[tuple[tuple[str, int, float], ...]] = ()  # a step, runs and seconds before it

    @property
    def adequate(self) -> bool:
        return self.verdict == Verdict.ADEQUATE

    @property
    def models(self) -> tuple[Cause, ...]:
        """The causes without those that name a model again by another of its mechanisms, with all its parameters."""
        first: dict[frozenset[str], Cause] = {}
        for c in self.causes:
            same = first.setdefault(key := frozenset(c.mechanisms), c)
            first[key] = replace(same, parameters={**same.parameters, **c.parameters})
        return tuple(first.values())

    @property
    def could_hide(self) -> str:
        """Strengths up to which mechanisms that are not named would not have shown with 90 % power; "" where none."""
        said = ", ".join(f"{d.mechanism} {at}" for d in self.detectable if (at := hidden_up_to(d)))
        return f"Would have shown with 90 % power from: {said}." if said else ""

    def names(self, cause: Cause) -> bool:
        """Whether this is the model that the diagnosis names."""
        return bool(self.named) and set(cause.mechanisms) == set(self.named)

    @property
    def table(self) -> pd.DataFrame:
        """The models that were tried, likeliest first: mechanisms, probability, held-out gain of log-likelihood, named,
        parameters with their 90 % intervals."""
        import pandas as pd

        rows = [
            {
                "model": " + ".join(c.mechanisms),
                "probability": c.probability,
                "delta_score": c.delta_score,
                "named": self.names(c),
                "parameters (90 %)": c.words,
            }
            for c in self.models
        ]
        return pd.DataFrame(rows, columns=["model", "probability", "delta_score", "named", "parameters (90 %)"])

    @property
    def samples(self) -> pd.DataFrame:
        """Every sample of a user's recordings: recording, channel, time_s, measured, simulated, extended."""
        import pandas as pd

        keys = ("measured", "simulated", "extended")
        each = [
            {"recording": x.recording, "channel": x.channel, "time_s": x.t, **{k: getattr(x, k) for k in keys}}
            for x in self.traces
        ]
        empty = pd.DataFrame(columns=["recording", "channel", "time_s", *keys])
        return pd.concat([pd.DataFrame(e) for e in each], ignore_index=True) if each else empty

    @property
    def field(self) -> xr.Dataset:
        """The same as an xarray data set over (recording, channel, time_s); NaN where a recording has no sample."""
        found: xr.Dataset = self.samples.set_index(["recording", "channel", "time_s"]).to_xarray()
        return found

    def explain(self, mechanism: str) -> str:
        """What is known of one mechanism, in words."""
        lacks = self.lacks or {}
        what = lacks.get(mechanism, mechanism.replace("_", " "))
        tried = next((c for c in self.causes if c.mechanism == mechanism), None)
        twins = next((t for t in self.indistinguishable if mechanism in t), ())
        if self.adequate:
            shown = next((hidden_up_to(d) for d in self.detectable if d.mechanism == mechanism), "")
            p = said(self.p_value, ".2g")
            agrees = f"{what}: not needed; the simulation agrees with the recordings (p = {p})"
            return agrees + (f"; it would have shown with 90 % power from {shown}." if shown else ".")
        if tried is None:
            known = ", ".join(c.mechanism for c in self.causes)
            return f"{what}: no model with it is likely enough to be listed; listed are {known or 'none'}."
        beside = f" beside {' and '.join(lacks.get(m, m) for m in tried.others)}" if tried.others else ""
        text = f"{what}: {'named' if mechanism in self.named else 'not named'}, probability {said(tried.probability)}; "
        text += f"{tried.words or 'no parameter of its own'}{beside}; "
        text += f"log-likelihood of recordings held out {said(tried.delta_score, '+.3g')} over the model under test"
        others = [lacks.get(t, t.replace("_", " ")) for t in twins if t != mechanism]
        return text + (f"; the data cannot distinguish it from {' or '.join(others)}." if others else ".")

    def __repr__(self) -> str:
        lines = [self.sentence]
        lines += [f"  {chance(c.probability)}  {' + '.join(c.mechanisms)}: {c.words}" for c in self.models[:6]]
        if self.fitted and not self.adequate:
            lines += [f"  {n} = {p}" for n, p in self.fitted.items()][:12]
        lines += self._predicting
        return "\n".join([lines[0], *(x if len(x) <= WIDE else x[: WIDE - 3] + "..." for x in lines[1:])])

    @property
    def _predicting(self) -> list[str]:
        """In words what predicts new recordings, where it is not what is named."""
        best = self.prediction
        if best is None or set(best.mechanisms) == set(self.named) or self.discovered:
            return []
        model = f"the model with {' + '.join(best.mechanisms)}" if best.mechanisms else "the model as it is"
        by = f": the error on recordings held out falls {times(best.ratio, '.1f')}" if best.mechanisms else ""
        return [f"  to predict new recordings, not as a cause: {model}{by} (.prediction)"]

    def _repr_html_(self) -> str:
        from jumpvision.base import notebook as reprs

        rows = [
            {"model": " + ".join(c.mechanisms), "probability": chance(c.probability), "parameters (90 %)": c.words}
            for c in self.models[:6]
        ]
        body = f"<p>{html.escape(self.sentence)}</p>{reprs.table(rows)}"
        return reprs.page(f"Diagnosis: {self.verdict}", body, getattr(self, "pictures", list)())

    @property
    def values(self) -> dict[str, object]:
        """What the file holds: numbers, texts, lists and dicts."""
        return dict(plain(_json(self)))

    @property
    def text(self) -> str:
        """The file."""
        return json.dumps(self.values, indent=1) + "\n"

    def save(self, folder: Path) -> None:
        (folder / self.file).write_text(self.text, encoding="utf-8")

    @classmethod
    def load(cls, folder: Path) -> Self:
        return cls.from_values(json.loads((folder / cls.file).read_text(encoding="utf-8")))

    @classmethod
    def from_values(cls, values: Mapping[str, object]) -> Self:
        """The inverse of `values`. Raises RecordError where a key is missing."""
        try:
            found: Self = _read(cls, values)
        except KeyError as e:
            raise RecordError(f"{cls.file}: {e.args[0]!r} is missing") from None
        return found


def _key(f: Field[object]) -> str:
    """The file's key of a field."""
    return str(f.metadata.get("key", f.name))


def _json(value: object) -> object:
    """A record of records as dicts and lists."""
    if is_dataclass(value):
        known = {_key(f): (f, getattr(value, f.name)) for f in fields(value)}
        return {k: _json(v) for k, (f, v) in known.items() if v is not None or not f.metadata.get("optional")}
    if isinstance(value, Mapping):
        return {k: _json(v) for k, v in value.items()}
    return [_json(v) for v in value] if isinstance(value, tuple) else str(value) if isinstance(value, str) else value


def _read(kind: Any, value: Any) -> Any:
    """A value of the file as the type that a field declares."""
    if value is None or kind is type(None):
        return math.nan if kind is float else None
    inner = [k for k in get_args(kind) if k is not type(None)]
    if is_dataclass(kind):
        types = get_type_hints(kind)
        given = {f.name: _key(f) for f in fields(kind) if _key(f) in value or not f.metadata.get("optional")}
        return kind(**{name: _read(types[name], value[key]) for name, key in given.items()})  # type: ignore[operator]
    if isinstance(kind, type) and issubclass(kind, StrEnum):
        return kind(value)
    if get_origin(kind) is tuple:
        return tuple(_read(inner[0], v) for v in value)
    if get_origin(kind) is Mapping:
        return {k: _read(inner[1], v) for k, v in value.items()}
    return _read(inner[0], value) if inner else value


def chance(p: float) -> str:
    """A probability to three digits; what would round to none is said to be small."""
    return "< 0.001" if p < 5e-4 else said(p, ".3f")


def hidden_up_to(d: Detectable) -> str:
    """The parameter and the value from which it would have shown; "" where none in its range would."""
    unit = "" if d.unit == "1" else f" {d.unit}"
    return f"{d.parameter} = {strength(d.value)}{unit}" if math.isfinite(d.value) else ""


def strength(value: float) -> str:
    """Three significant figures; of a factor near 1 those of what it differs by."""
    near = abs(value - 1.0) < 0.1
    return f"1 {'+' if value > 1.0 else '-'} {abs(value - 1.0):.3g}" if near and value != 1.0 else f"{value:.3g}"
