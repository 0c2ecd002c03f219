"""diagnosis.json as a type: what a simulation gets wrong, where, why, and what mends it (docs/files.md section 4).

Fields have the names of the file's keys, in their order. A number that is not known is NaN here and null there.
"""

from __future__ import annotations

import html
import json
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self

from jumpvision.base.numbers import said, times
from jumpvision.base.record import Record, RecordError, plain

from . import FILE
from . import values as record
from .values import OPTIONAL
from .words import say

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr
    from cattrs import Converter

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
    verdict: record.Verdict
    p_value: float
    baseline: record.Baseline
    where: tuple[record.Cell, ...]
    heights: tuple[record.Height, ...]
    causes: tuple[record.Cause, ...]
    named: tuple[str, ...]
    status: record.Status
    left_over: record.LeftOver | None
    detectable: tuple[record.Detectable, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    closest: record.Closest | None
    unexplained: None = None  # the key stays for one release
    extended_model: record.Model
    gain: record.Gain | None
    selection: tuple[record.Selection, ...]
    extrapolation: Mapping[str, record.Gain]
    next_experiment: record.NextExperiment | None
    priors: record.Priors | None
    noise: record.Noise
    common: tuple[record.CommonError, ...]
    energy: tuple[record.Energies, ...]
    confirmation: tuple[record.Confirmation, ...]
    without_films: record.WithoutFilms | None = field(default=None, metadata=OPTIONAL)
    discovered: record.Discovered | None = None
    varies: tuple[record.Varies, ...] = ()
    suggested: tuple[record.Suggested, ...] = ()
    unit: str | None = field(default=None, metadata=OPTIONAL)
    fitted: Mapping[str, record.Parameter] | None = field(default=None, metadata=OPTIONAL)
    correlations: Mapping[str, Mapping[str, float]] | None = field(default=None, metadata=OPTIONAL)
    lacks: Mapping[str, str] | None = field(default=None, metadata=OPTIONAL)
    runs: record.Runs | None = field(default=None, metadata=OPTIONAL)
    doubts: tuple[record.Doubt, ...] = field(default=(), metadata=OPTIONAL)
    simulated: tuple[record.Simulated, ...] = field(default=(), metadata=OPTIONAL)
    prediction: record.Prediction | None = field(default=None, metadata=OPTIONAL)
    sentence: str
    confirmed: str | None
    traces: ClassVar[tuple[record.Trace, ...]] = ()
    search: ClassVar[tuple[tuple[str, int, float], ...]] = ()  # a step, runs and seconds before it

    @property
    def adequate(self) -> bool:
        return self.verdict == record.Verdict.ADEQUATE

    @property
    def models(self) -> tuple[record.Cause, ...]:
        """The causes without those that name a model again by another of its mechanisms, with all its parameters."""
        first: dict[frozenset[str], record.Cause] = {}
        for c in self.causes:
            same = first.setdefault(key := frozenset(c.mechanisms), c)
            first[key] = replace(same, parameters={**same.parameters, **c.parameters})
        return tuple(first.values())

    @property
    def could_hide(self) -> str:
        """Strengths up to which mechanisms that are not named would not have shown with 90 % power; "" where none."""
        each = ", ".join(f"{d.mechanism} {at}" for d in self.detectable if (at := hidden_up_to(d)))
        return say("hidden", each=each) if each else ""

    def names(self, cause: record.Cause) -> bool:
        """Whether this is the model that the diagnosis names."""
        return bool(self.named) and set(cause.mechanisms) == set(self.named)

    @property
    def table(self) -> pd.DataFrame:
        """The models that were tried, likeliest first: mechanisms, probability, held-out gain of log-likelihood, named,
        parameters with their 90 % intervals."""
        import pandas as pd

        columns = ["model", "probability", "delta_score", "named", "parameters (90 %)"]
        rows = [(_model(c), c.probability, c.delta_score, self.names(c), c.words) for c in self.models]
        return pd.DataFrame(rows, columns=columns)

    @property
    def samples(self) -> pd.DataFrame:
        """Every sample of a user's recordings: recording, channel, time_s, measured, simulated, extended."""
        import pandas as pd

        columns = ["recording", "channel", "time_s", "measured", "simulated", "extended"]
        each = [(x.recording, x.channel, x.t, x.measured, x.simulated, x.extended) for x in self.traces]
        tables = [pd.DataFrame(dict(zip(columns, e))) for e in each]
        return pd.concat(tables, ignore_index=True) if each else pd.DataFrame(columns=columns)

    @property
    def field(self) -> xr.Dataset:
        """The same as an xarray data set over (recording, channel, time_s); NaN where a recording has no sample."""
        found: xr.Dataset = self.samples.set_index(["recording", "channel", "time_s"]).to_xarray()
        return found

    def explain(self, mechanism: str) -> str:
        """What is known of one mechanism, in words."""

        def called(m: str) -> str:
            return (self.lacks or {}).get(m, m.replace("_", " "))

        what = called(mechanism)
        if self.adequate:
            least = next((hidden_up_to(d) for d in self.detectable if d.mechanism == mechanism), "")
            return say("not needed", what=what, p=self.p_value, shown=say("shown", least=least) if least else "")
        c = next((c for c in self.causes if c.mechanism == mechanism), None)
        if c is None:
            return say("not listed", what=what, known=", ".join(c.mechanism for c in self.causes) or "none")
        beside = " and ".join((self.lacks or {}).get(m, m) for m in c.others)
        twins = next((t for t in self.indistinguishable if mechanism in t), ())
        others = " or ".join(called(t) for t in twins if t != mechanism)
        return say(
            "tried",
            what=what,
            named="named" if mechanism in self.named else "not named",
            c=c,
            words=c.words or "no parameter of its own",
            beside=f" beside {beside}" if beside else "",
            others=say("not told from", others=others) if others else "",
        )

    def __repr__(self) -> str:
        lines = [f"  {chance(c.probability)}  {_model(c)}: {c.words}" for c in self.models[:6]]
        if self.fitted and not self.adequate:
            lines += [f"  {n} = {p}" for n, p in self.fitted.items()][:12]
        lines += self._predicting
        return "\n".join([self.sentence, *(x if len(x) <= WIDE else x[: WIDE - 3] + "..." for x in lines)])

    @property
    def _predicting(self) -> list[str]:
        """In words what predicts new recordings, where it is not what is named."""
        best = self.prediction
        if best is None or set(best.mechanisms) == set(self.named) or self.discovered:
            return []
        model = f"the model with {' + '.join(best.mechanisms)}" if best.mechanisms else "the model as it is"
        by = say("predicts by", by=times(best.ratio, ".1f")) if best.mechanisms else ""
        return [say("predicts", model=model, by=by)]

    def _repr_html_(self) -> str:
        from jumpvision.base import notebook as reprs

        rows = [
            {"model": _model(c), "probability": chance(c.probability), "parameters (90 %)": c.words}
            for c in self.models[:6]
        ]
        body = f"<p>{html.escape(self.sentence)}</p>{reprs.table(rows)}"
        return reprs.page(f"Diagnosis: {self.verdict}", body, getattr(self, "pictures", list)())

    @property
    def values(self) -> dict[str, object]:
        """What the file holds: numbers, texts, lists and dicts."""
        return dict(plain(converter().unstructure(self)))

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
            return converter().structure(values, cls)
        except KeyError as e:
            raise RecordError(f"{cls.file}: {e.args[0]!r} is missing") from None


@cache
def converter() -> Converter:
    """Between records and the file's dicts: a number that is not known is null there, an optional key may lack."""
    import cattrs
    from cattrs.gen import make_dict_structure_fn, make_dict_unstructure_fn, override

    made = cattrs.Converter(detailed_validation=False)
    made.register_structure_hook(float, lambda x, _: math.nan if x is None else x)
    for kind in (type(None), float | str, float | str | bool):
        made.register_structure_hook(kind, lambda x, of: None if of is type(None) else x)

    def renamed(kind: type) -> dict[str, Any]:
        return {f.name: override(rename=f.metadata["key"]) for f in fields(kind) if "key" in f.metadata}

    def written(kind: type) -> Callable[[Any], dict[str, Any]]:
        whole: Callable[[Any], dict[str, Any]] = make_dict_unstructure_fn(kind, made, **renamed(kind))
        optional = {f.name for f in fields(kind) if f.metadata == OPTIONAL}
        return lambda x: {k: v for k, v in whole(x).items() if v is not None or k not in optional}

    made.register_unstructure_hook_factory(is_dataclass, written)
    made.register_structure_hook_factory(is_dataclass, lambda k: make_dict_structure_fn(k, made, **renamed(k)))
    return made


def _model(c: record.Cause) -> str:
    return " + ".join(c.mechanisms)


def chance(p: float) -> str:
    """A probability to three digits; what would round to none is said to be small."""
    return "< 0.001" if p < 5e-4 else said(p, ".3f")


def hidden_up_to(d: record.Detectable) -> str:
    """The parameter and the value from which it would have shown; "" where none in its range would."""
    unit = "" if d.unit == "1" else f" {d.unit}"
    return f"{d.parameter} = {strength(d.value)}{unit}" if math.isfinite(d.value) else ""


def strength(value: float) -> str:
    """Three significant figures; of a factor near 1 those of what it differs by."""
    near = abs(value - 1.0) < 0.1
    return f"1 {'+' if value > 1.0 else '-'} {abs(value - 1.0):.3g}" if near and value != 1.0 else f"{value:.3g}"
