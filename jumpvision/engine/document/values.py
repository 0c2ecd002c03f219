"""What a diagnosis is made of: models, causes, gain, noise, confirmations; the values in diagnosis.json.

Fields have the names of the file's keys, in their order. A number that is not known is NaN here and null there.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from enum import StrEnum

from jumpvision.base.arrays import Z90, Array
from jumpvision.base.numbers import between, said


class Verdict(StrEnum):
    """Whether a simulation agrees with what was measured, within its noise."""

    ADEQUATE = "adequate"
    DISCREPANT = "discrepant"


class Status(StrEnum):
    """How much of what a model gets wrong the named mechanisms explain: all of it (they pass the test that the baseline
    failed), a part of it, or nothing is established."""

    COMPLETE = "complete"
    PARTIAL = "partial"
    UNDETERMINED = "undetermined"


class Pattern(StrEnum):
    """How a number that was taken for constant differs between recordings: a few stand apart, two levels before and
    after, a straight line, a function of what is known of them, or without any order."""

    ODD = "odd"
    STEP = "step"
    DRIFT = "drift"
    FUNCTION = "function"
    SCATTER = "scatter"


class Agreement(StrEnum):
    """Whether a quantity is the same by the motions and by another measurement."""

    AGREE = "agree"
    CONTRADICT = "contradict"


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
        known = math.isfinite(self.sigma) and self.sigma > 0.0 and self.value != 0.0
        figures = max(4, 2 + math.ceil(math.log10(abs(self.value) / self.sigma))) if known else 4
        spec = f".{figures}g"  # two of sigma's at least: the ends of an interval are not one number
        return f"{said(self.value, spec)}{between(self.low, self.high, spec)} {unit}".rstrip()


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
    """Residuals of one kind of jump in one part of it: measured minus simulated [unit of y], z of a shift of the whole
    cell beside what the parameters can do, and the probability of as large a z in any cell by noise alone."""

    kind: str
    phase_of_jump: str
    mean_residual_m: float
    z_score: float
    p_value: float
    samples: int


@dataclass(frozen=True)
class Height:
    """Height of one jump [m], from the motor's stop on: as measured, by the baseline, by the extended model.

    measured_m, sigma_m: those of `jumps.csv`; NaN where it has none.
    """

    experiment: str
    kind: str
    frequency: float | None
    delay: float | None
    volume_fraction: float | None
    measured_m: float
    sigma_m: float
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
class Varies:
    """A number that was taken for constant and is not.

    of: what it goes with ("order", "time", "session", "frequency", "amplitude", "delay", "volume_fraction", a label);
    None where some stand apart or it has no order. recordings: those that stand apart; of a step those after it.
    value: of those (odd, step), at the last one (drift, function), the standard deviation (scatter), with its 90 %
    interval; declared: of the others. each: value and sigma of every recording by itself, for the picture. also:
    numbers of the same recordings that would do as well.
    """

    parameter: str
    kind: Pattern
    of: str | None
    recordings: tuple[str, ...]
    value: float
    low: float
    high: float
    unit: str
    declared: float
    p_value: float
    established: bool = True
    each: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    at: Mapping[str, float | str] = field(default_factory=dict)
    source: str = ""
    also: tuple[str, ...] = ()


@dataclass(frozen=True)
class Suggested:
    """A line that would mend it, written only where the user accepts it. file: relative to the campaign."""

    file: str
    section: str
    key: str
    value: float | str | bool
    why: str

    @property
    def line(self) -> str:
        """As TOML has it."""
        value = (
            json.dumps(self.value, ensure_ascii=False) if isinstance(self.value, (str, bool)) else f"{self.value:.6g}"
        )
        return f"{self.key} = {value}" if not self.section else f"[{self.section}] {self.key} = {value}"


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
    the baseline gets wrong (its excess of chi^2); widened: factor on the intervals for it. look_at: recordings with the
    largest misfit; where: what part of it lies in one recording, time and state, in words."""

    chi2_per_dof: float
    share: float
    widened: float
    look_at: tuple[str, ...] = field(default=(), metadata=OPTIONAL)
    where: str = field(default="", metadata=OPTIONAL)


@dataclass(frozen=True)
class Detectable:
    """value: of a mechanism's strength, that would have shown with 90 % power; NaN where none in its range would."""

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


class DoubtKind(StrEnum):
    NO_EFFECT = "no effect"
    CANNOT_TELL = "cannot tell"
    STEPPED = "stepped"
    TWO_FITS = "two fits"
    WRONG_JACOBIAN = "wrong jacobian"


@dataclass(frozen=True)
class Doubt:
    """What a simulator or its recordings do not allow to be told of parameters or mechanisms `names`, in words."""

    kind: DoubtKind
    names: tuple[str, ...]
    words: str


class ByFit(StrEnum):
    """How errors were weighed: as noise of the readings, as a random walk of the simulation, or, beside that, as
    independent errors of the simulation."""

    NOISE = "noise"
    PROCESS = "process"
    OUTPUT_ERROR = "output error"


@dataclass(frozen=True)
class Simulated:
    """A model run open loop over all recordings: rms of measured minus simulated, by channel, in the channel's unit.

    mechanisms: beside the baseline. by: how its fit weighed errors. parameters: of that fit.
    """

    mechanisms: tuple[str, ...]
    by: ByFit
    chi2_per_dof: float
    rms: Mapping[str, float]
    parameters: Mapping[str, Parameter]


@dataclass(frozen=True)
class Prediction:
    """The model to predict new recordings with: of those tried, and of all that were listed together, the one with the
    least error on recordings held out. It says nothing of causes.

    mechanisms: beside the baseline. parameters: of the model, the baseline's too. ratio: held-out error of the baseline
    over its own.
    """

    mechanisms: tuple[str, ...]
    parameters: Mapping[str, Parameter]
    ratio: float


@dataclass(frozen=True)
class Closest:
    """The likeliest model where none passes the test."""

    mechanisms: tuple[str, ...]
    probability: float
    parameters: Mapping[str, Parameter]
    rmse_track_m: float
    gain: Gain | None


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
    any closed motion within the range seen, None for an instrument; part_passive: whether the ground, rail or spring
    that it belongs to still gives none with it. beside: mechanisms that it stands beside.
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
    part_passive: bool | None = field(default=None, metadata=OPTIONAL)


@dataclass(frozen=True)
class NextExperiment:
    """The experiment that best tells two explanations apart: a jump, or the inputs of a user's own simulator."""

    kind: str
    frequency: float | None
    delay: float | None
    separates: tuple[str, ...]
    expected_log10_odds: float
    inputs: Mapping[str, float] | None = field(default=None, metadata=OPTIONAL)

    @property
    def words(self) -> str:
        """What is to be done."""
        if self.inputs:
            return ", ".join(f"{n} = {said(x, '.4g')}" for n, x in self.inputs.items())
        at = f" at {self.frequency} Hz" if math.isfinite(self.frequency or math.nan) else ""
        return self.kind + at + (f", delay {self.delay} s" if self.delay and math.isfinite(self.delay) else "")


@dataclass(frozen=True)
class NoiseSource:
    """Hold the noise by one kind of evidence. sigma_m: standard deviation [unit of y]; log_sigma: standard
    uncertainty of its logarithm; n: samples beyond the coefficients of their courses (tracks, for what they state)."""

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
    verdict: Agreement
    experiment: str | None = field(default=None, metadata=OPTIONAL)
    depth_m: float | None = field(default=None, metadata=OPTIONAL)

    @property
    def contradicts(self) -> bool:
        return self.verdict == Agreement.CONTRADICT


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
