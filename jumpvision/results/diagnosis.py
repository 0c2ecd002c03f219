"""diagnosis.json as a type: what a simulation gets wrong, where, why, and what mends it (docs/files.md section 4).

Fields have the names of the file's keys, in their order. A number that is not known is NaN here and null there.
"""

from __future__ import annotations

import html
import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, is_dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Self, get_args, get_origin, get_type_hints

from jumpvision.base import notebook as reprs
from jumpvision.base.arrays import Z90, Array

from . import Record, RecordError, plain

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

WIDE = 140  # characters of a line in a plain repr

OPTIONAL = {"optional": True}  # a key that the file has only where there is something to say


@dataclass(frozen=True)
class Parameter:
    """A parameter of a mechanism; low, high: its 90 % interval, within its range. unit: "1" where it has none."""

    value: float
    low: float
    high: float
    unit: str

    @property
    def sigma(self) -> float:
        """Standard uncertainty, from the wider half of the interval: the range may cut the other."""
        return float(max(self.value - self.low, self.high - self.value)) / Z90

    def __str__(self) -> str:
        unit = "" if self.unit == "1" else self.unit
        return f"{self.value:.4g} ({self.low:.4g} to {self.high:.4g}) {unit}".rstrip()


@dataclass(frozen=True)
class Model:
    """Terms of a model and every parameter that they need, with what of the robot was re-fitted."""

    terms: tuple[str, ...]
    parameters: Mapping[str, float]


@dataclass(frozen=True)
class Baseline(Model):
    """The model in question, re-fitted: root mean square of simulated minus measured heights and tracks [m]."""

    rmse_height_m: float
    rmse_track_m: float
    chi2_per_dof: float


@dataclass(frozen=True)
class Cell:
    """Residuals of one kind of jump in one part of it: measured minus simulated [m], z of a shift of the whole cell,
    and the probability of as large a z in any cell by noise alone."""

    kind: str
    phase_of_jump: str
    mean_residual_m: float
    z_score: float
    p_value: float
    samples: int


@dataclass(frozen=True)
class Height:
    """Height of one jump [m], after the motor's stop: measured, by the baseline, by the extended model."""

    experiment: str
    kind: str
    frequency: float | None
    delay: float | None
    volume_fraction: float | None
    measured_m: float
    simulated_m: float
    extended_m: float


@dataclass(frozen=True)
class Cause:
    """A mechanism that may be missing, in the likeliest model that has it. others: the mechanisms beside it there.

    probability: under the stated priors; probability_range: least and greatest with the ranges of all strengths 3 times
    narrower or wider.
    delta_score: log-likelihood of held-out conditions, over that of the baseline.
    """

    mechanism: str
    others: tuple[str, ...] = field(metadata={"key": "with"})
    probability: float
    probability_range: tuple[float, ...]
    delta_score: float
    parameters: Mapping[str, Parameter]

    @property
    def mechanisms(self) -> tuple[str, ...]:
        """All that the model has beside the baseline's terms."""
        return (self.mechanism, *self.others)

    @property
    def words(self) -> str:
        """The parameters, each with its 90 % interval."""
        return ", ".join(f"{name} = {p}" for name, p in self.parameters.items())


@dataclass(frozen=True)
class Gain:
    """Root mean square errors [m] of jumps that were held out, before and after the extension; their ratio."""

    holdout: tuple[str, ...]
    rmse_height_before_m: float
    rmse_height_after_m: float
    rmse_track_before_m: float
    rmse_track_after_m: float
    ratio: float
    ratio_ci95: tuple[float, float]
    claimed: bool


@dataclass(frozen=True)
class LeftOver:
    """What the extended model (the baseline, where nothing is named) leaves: chi^2 per degree of freedom, share of what
    the baseline gets wrong (its excess of chi^2); widened: factor on the intervals for it."""

    chi2_per_dof: float
    share: float
    widened: float


@dataclass(frozen=True)
class Detectable:
    """The strength of a mechanism that would have shown with 90 % power; NaN where none within its range would."""

    mechanism: str
    parameter: str
    value: float
    unit: str


@dataclass(frozen=True)
class Selection:
    """A set of mechanisms, and in how many folds of the gain it was chosen."""

    mechanisms: tuple[str, ...]
    times: int


@dataclass(frozen=True)
class Prior:
    """What was taken of a parameter before the data: uniform from low to high, normal of sigma about mean within."""

    low: float
    high: float
    mean: float
    sigma: float
    unit: str


@dataclass(frozen=True)
class Priors:
    """causes: probability of each number of causes from 0 on, every set of one number alike; parameters by name."""

    causes: tuple[float, ...]
    parameters: Mapping[str, Prior]


@dataclass(frozen=True)
class Closest:
    """The likeliest model where none passes the test."""

    mechanisms: tuple[str, ...]
    probability: float
    parameters: Mapping[str, Parameter]
    rmse_track_m: float
    gain: Gain | None


@dataclass(frozen=True)
class Coefficient:
    """Strength of a generic force."""

    value: float
    sigma: float
    unit: str


@dataclass(frozen=True)
class Unexplained:
    """Generic forces that describe what no mechanism explains; as it stands here, that none does."""

    terms: tuple[str, ...] = ()
    coefficients: Mapping[str, Coefficient] | None = field(default=None, metadata=OPTIONAL)
    r2: float = 0.0
    where: str = "no generic force describes it"
    beside: tuple[str, ...] | None = field(default=None, metadata=OPTIONAL)
    stability: Mapping[str, float] | None = field(default=None, metadata=OPTIONAL)


@dataclass(frozen=True)
class Estimated:
    """A value with its standard uncertainty, 0 for a constant."""

    value: float
    sigma: float
    unit: str


@dataclass(frozen=True)
class Discovered:
    """A law that no vocabulary lists, in one line as [mechanism.NAME] has it (docs/diagnosis.md).

    acts_on: as there. state: the rate of its internal state u, None without one. seen: range of its arguments that the
    jumps covered. r2: share of what the baseline gets wrong that it explains; ceiling_r2: what any smooth force of the
    same position and rate would explain, None where it is no force of both. passive: whether it gives no energy over
    any closed motion within the range seen; None for an instrument. beside: mechanisms that it stands beside.
    stability: how often each form of law wins when trials are drawn again. rivals: forms that predict as well.
    """

    law: str
    acts_on: str
    parameters: Mapping[str, Estimated]
    seen: Mapping[str, tuple[float, ...]]
    r2: float
    passive: bool | None
    ceiling_r2: float | None
    beside: tuple[str, ...]
    stability: Mapping[str, float]
    rivals: tuple[str, ...]
    state: str | None = field(default=None, metadata=OPTIONAL)


@dataclass(frozen=True)
class NextExperiment:
    """The jump that best tells two explanations apart."""

    kind: str
    frequency: float
    delay: float
    separates: tuple[str, ...]
    expected_log10_odds: float


@dataclass(frozen=True)
class NoiseSource:
    """What one kind of evidence says of the noise; log_sigma: standard uncertainty of its logarithm."""

    sigma_m: float
    log_sigma: float
    n: int


@dataclass(frozen=True)
class Tails:
    """Degrees of freedom of the Student's t that errors follow."""

    student_degrees: float


@dataclass(frozen=True)
class Outlier:
    """A single reading that stands off by so many robust sigmas."""

    experiment: str
    time_s: float
    sigmas: float


@dataclass(frozen=True)
class Noise:
    """The noise of a frame and where it was learned. tracks: factor of those that differ; tails: None where normal."""

    sigma_m: float
    correlation: float
    tails: Tails | None
    drift_m: float
    samples: int
    sources: Mapping[str, NoiseSource | None]
    scatter: Mapping[str, float]
    tracks: Mapping[str, float]
    outliers: tuple[Outlier, ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True)
class CommonError:
    """What an apparatus has wrong in all its recordings: as stated before, and as the jumps have it."""

    quantity: str
    declared: float
    stated_sigma: float
    value: float
    sigma: float
    unit: str


@dataclass(frozen=True)
class Energies:
    """Energies [J] of a jump from rest to its apex by one model: the motor's work and where it went."""

    experiment: str
    kind: str
    model: str
    to_s: float
    motor_J: float
    potential_J: float
    kinetic_J: float
    spring_J: float
    losses_J: Mapping[str, float]


@dataclass(frozen=True)
class Confirmation:
    """A quantity by the jumps alone and by a film or test; z: their difference over the sigma of both.

    experiment, depth_m: of an added mass, the film and the depth of the foot.
    """

    quantity: str
    unit: str
    source: str
    by_jumps: float
    by_jumps_sigma: float
    by_film: float
    by_film_sigma: float
    z: float
    verdict: str
    experiment: str | None = field(default=None, metadata=OPTIONAL)
    depth_m: float | None = field(default=None, metadata=OPTIONAL)

    @property
    def contradicts(self) -> bool:
        return self.verdict == "contradict"


@dataclass(frozen=True)
class WithoutFilms:
    """What the jumps alone say where films or tests contradict them."""

    parameters: Mapping[str, float]
    chi2: float


@dataclass(frozen=True)
class Runs:
    """Runs of a user's simulator: made, taken from those kept; seconds that they took; those that gave nothing."""

    made: int
    kept: int
    seconds: float
    failures: tuple[str, ...]


@dataclass(frozen=True)
class Trace:
    """One channel of one recording: measured, simulated and extended values (n,) [unit] at t (n,) [s]."""

    recording: str
    channel: str
    unit: str
    t: Array
    measured: Array
    simulated: Array
    extended: Array


@dataclass(frozen=True, kw_only=True, repr=False)
class Diagnosis(Record):
    """What a campaign's model gets wrong, or that it is adequate. named: the mechanisms that explain it.

    status: "partial" where they leave significant misfit, "undetermined" where the data establish none; left_over: what
    they leave, None where nothing was sought. indistinguishable: mechanisms that would do as well.
    extended_model: the baseline, re-fitted, where nothing is named. `values` is diagnosis.json as a dict.

    Of a user's own simulator also: unit, of every number whose key ends in _m ("noise": several channels, in units of
    their noise); fitted, the parameters of the extended model; lacks, the mechanisms in words; runs; traces (not in the
    file), measured and simulated values.
    """

    file = "diagnosis.json"

    schema: int = 2
    verdict: str
    p_value: float
    baseline: Baseline
    where: tuple[Cell, ...]
    heights: tuple[Height, ...]
    causes: tuple[Cause, ...]
    named: tuple[str, ...]
    status: str
    left_over: LeftOver | None
    detectable: tuple[Detectable, ...]
    indistinguishable: tuple[tuple[str, ...], ...]
    closest: Closest | None
    unexplained: Unexplained | None
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
    unit: str | None = field(default=None, metadata=OPTIONAL)
    fitted: Mapping[str, Parameter] | None = field(default=None, metadata=OPTIONAL)
    lacks: Mapping[str, str] | None = field(default=None, metadata=OPTIONAL)
    runs: Runs | None = field(default=None, metadata=OPTIONAL)
    sentence: str
    confirmed: str | None
    traces: ClassVar[tuple[Trace, ...]] = ()

    @property
    def adequate(self) -> bool:
        return self.verdict == "adequate"

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
        known = [d for d in self.detectable if math.isfinite(d.value)]
        said = ", ".join(
            f"{d.mechanism} {d.parameter} = {d.value:.3g}{'' if d.unit == '1' else ' ' + d.unit}" for d in known
        )
        return f"Would have shown with 90 % power from: {said}." if known else ""

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
            return f"{what}: not asked for; the simulation agrees with the recordings (p = {self.p_value:.2g})."
        if tried is None:
            known = ", ".join(c.mechanism for c in self.causes)
            return f"{what}: no model with it has a probability worth telling; told are {known or 'none'}."
        beside = f" beside {' and '.join(lacks.get(m, m) for m in tried.others)}" if tried.others else ""
        text = f"{what}: {'named' if mechanism in self.named else 'not named'}, probability {tried.probability:.3g}; "
        text += f"{tried.words or 'no parameter of its own'}{beside}; "
        text += f"log-likelihood of recordings held out {tried.delta_score:+.3g} over the model in question"
        others = [lacks.get(t, t.replace("_", " ")) for t in twins if t != mechanism]
        return text + (f"; the data cannot tell it from {' or '.join(others)}." if others else ".")

    def __repr__(self) -> str:
        lines = [self.sentence]
        lines += [f"  {c.probability:6.3f}  {' + '.join(c.mechanisms)}: {c.words}" for c in self.models[:6]]
        if self.fitted and not self.adequate:
            lines += [f"  {n} = {p}" for n, p in self.fitted.items()][:12]
        return "\n".join([lines[0], *(x if len(x) <= WIDE else x[: WIDE - 3] + "..." for x in lines[1:])])

    def _repr_html_(self) -> str:
        rows = [
            {"model": " + ".join(c.mechanisms), "probability": f"{c.probability:.3f}", "parameters (90 %)": c.words}
            for c in self.models[:6]
        ]
        body = f"<p>{html.escape(self.sentence)}</p>{reprs.table(rows)}"
        return reprs.page(f"Diagnosis: {self.verdict}", body, getattr(self, "pictures", list)())

    @property
    def values(self) -> dict[str, Any]:
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
    def from_values(cls, values: Mapping[str, Any]) -> Self:
        """The inverse of `values`. Raises RecordError where a key is missing."""
        try:
            found: Self = _read(cls, values)
        except KeyError as e:
            raise RecordError(f"{cls.file}: {e.args[0]!r} is missing") from None
        return found


def _key(f: Any) -> str:
    """The file's key of a field."""
    return str(f.metadata.get("key", f.name))


def _json(value: Any) -> Any:
    """A record of records as dicts and lists."""
    if is_dataclass(value):
        known = {_key(f): (f, getattr(value, f.name)) for f in fields(value)}
        return {k: _json(v) for k, (f, v) in known.items() if v is not None or not f.metadata.get("optional")}
    if isinstance(value, Mapping):
        return {k: _json(v) for k, v in value.items()}
    return [_json(v) for v in value] if isinstance(value, tuple) else value


def _read(kind: Any, value: Any) -> Any:
    """A value of the file as the type that a field declares."""
    if value is None:
        return math.nan if kind is float else None
    inner = [k for k in get_args(kind) if k is not type(None)]
    if is_dataclass(kind):
        types = get_type_hints(kind)
        given = {f.name: _key(f) for f in fields(kind) if _key(f) in value or not f.metadata.get("optional")}
        return kind(**{name: _read(types[name], value[key]) for name, key in given.items()})  # type: ignore[operator]
    if get_origin(kind) is tuple:
        return tuple(_read(inner[0], v) for v in value)
    if get_origin(kind) is Mapping:
        return {k: _read(inner[1], v) for k, v in value.items()}
    return _read(inner[0], value) if inner else value
