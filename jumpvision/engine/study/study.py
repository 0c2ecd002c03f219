"""What a user hands over to have a simulator questioned: recordings, and a study of the function that simulates them.

    study = Study(simulate, [Parameter("length", 0.2, (0.1, 0.4), unit="m")], [Mechanism("drag", ...)])

`simulate(parameters, recording)` gives the values of every channel at `recording.t`; `parameters` is a dict with every
name of the study, those of absent mechanisms at the value at which they do nothing.
"""

from __future__ import annotations

import dataclasses
import functools
import itertools
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from datetime import datetime
from typing import TYPE_CHECKING, Any, Self

import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array, not_increasing
from jumpvision.base.schema import InputError
from jumpvision.engine.priors import Measured
from jumpvision.engine.series import seconds
from jumpvision.engine.system import Parameter as Free

if TYPE_CHECKING:
    import pandas as pd

    from jumpvision.engine.document.values import Prediction
    from jumpvision.engine.laws.expression import Expression

    from .forms import Form

Simulate = Callable[..., Any]


@dataclass(frozen=True)
class Recording:
    """One measured motion: values of every channel at the times t (n,) [s], increasing.

    values: (n,), (n, channels), or a dict or table by the names of the channels; NaN where a channel was not read.
    inputs: anything the simulator needs (a logged force, a start), by name. labels: by which a misfit is told (kind of
    motion, mass, ...). group: recordings of one condition made alike (default: its own); condition: what is held out
    together (default: the group). sigma: stated noise of every reading, shaped as the values.
    parts: (n,) name of the part of the motion of each sample. order, recorded (a datetime, or seconds), session: its
    place in the series, when it was made, the day or person or set-up it belongs to; with the labels they tell what a
    number goes with that differs between recordings. source: from where the order is known, to be said with it.

    Example: jv.Recording("swing 1", time_s, angle, inputs={"start": 0.3}, group="small")
    """

    name: str
    t: Array
    values: Any
    inputs: Mapping[str, object] = field(default_factory=dict)
    labels: Mapping[str, object] = field(default_factory=dict)
    group: str = ""
    condition: str = ""
    sigma: Any = None
    parts: Any = None
    order: float | None = None
    session: str = ""
    recorded: datetime | float | None = None
    source: str = ""

    def __post_init__(self) -> None:
        try:
            object.__setattr__(self, "t", np.asarray(self.t, float))
        except (TypeError, ValueError):
            raise InputError([f"recording {self.name!r}: t must be numbers [s]"]) from None
        if self.t.ndim != 1 or self.t.size < 4:
            raise InputError(
                [f"recording {self.name!r}: t must be four or more increasing times [s], one axis, not {self.t.shape}"]
            )
        if back := "" if np.all(np.diff(self.t) > 0) else not_increasing(self.t) or "a time is no number":
            raise InputError([f"recording {self.name!r}: t must be increasing times [s]: {back}"])
        for what in ("values", "sigma"):
            self._rows(getattr(self, what), what)
        if not isinstance(self.recorded, datetime | int | float | None):
            raise InputError([f"recording {self.name!r}: recorded = {self.recorded!r}: a datetime, or seconds"])
        if self.parts is not None and np.shape(self.parts) != self.t.shape:
            raise InputError([f"recording {self.name!r}: parts must name each of the {self.t.size} samples"])

    def _rows(self, values: Any, what: str) -> None:
        """Raises InputError where values have not a row for each time."""
        if values is None:
            return
        each = (
            {n: values[n] for n in values}
            if isinstance(values, Mapping) or hasattr(values, "columns")
            else {"": values}
        )
        for n, v in each.items():
            if np.ndim(v) and len(v) != self.t.size:
                of = f" of {n!r}" if n else ""
                raise InputError(
                    [f"recording {self.name!r}: {what}{of} have {len(v)} rows; t has {self.t.size}: one each is needed"]
                )

    @property
    def time(self) -> float | None:
        """When it was recorded [s] since any fixed instant."""
        return seconds(self.recorded) if isinstance(self.recorded, datetime) else self.recorded

    @classmethod
    def of_table(
        cls, table: pd.DataFrame, channels: Sequence[str], *, by: str = "recording", time: str = "time_s", **more: Any
    ) -> list[Self]:
        """The recordings in a long table: a row a sample, the column `by` says of which recording. more: group=,
        condition=, session=, order=, recorded= name columns too; labels= and constants= (inputs) are lists of columns
        of which the first row counts, inputs= of those that are given whole, (n,)."""
        lists = ("labels", "inputs", "constants")
        asked = [by, time, *channels, *(c for k in lists for c in more.get(k, ()))]
        asked += [c for k, c in more.items() if k not in lists]
        if missing := [c for c in dict.fromkeys(asked) if c not in table.columns]:
            has = ", ".join(map(str, table.columns))
            raise InputError([f"table: has no column {', '.join(map(repr, missing))}; it has {has}"])
        out = []
        for name, rows in table.groupby(by, sort=False):
            labels = {c: rows[c].iloc[0] for c in more.get("labels", ())}
            inputs = {c: rows[c].to_numpy() for c in more.get("inputs", ())}
            inputs |= {c: rows[c].iloc[0] for c in more.get("constants", ())}
            like: dict[str, Any] = {
                k: str(rows[c].iloc[0]) for k, c in more.items() if k in ("group", "condition", "session")
            }
            like |= {k: rows[c].iloc[0] for k, c in more.items() if k in ("order", "recorded")}
            out.append(cls(str(name), rows[time].to_numpy(), rows[list(channels)].to_numpy(), inputs, labels, **like))
        return out

    def of_channels(self, values: Any, channels: Sequence[Channel], what: str = "values") -> Array:
        """Values as (n, channels). Raises InputError where their shape is another."""
        names = [c.name for c in channels]
        if hasattr(values, "columns") or isinstance(values, Mapping):
            if missing := [n for n in names if n not in values]:
                raise InputError([f"recording {self.name!r}: {what} lack the channels {', '.join(missing)}"])
            values = np.stack([np.asarray(values[n], float) for n in names], axis=-1)
        array = np.asarray(values, float)
        wanted = (self.t.size, len(names))
        array = array[:, None] if array.ndim == 1 and len(names) == 1 else array
        if array.shape != wanted:
            raise InputError(
                [
                    f"recording {self.name!r}: {what} of shape {np.shape(values)}; expected {wanted}: a row for each "
                    f"of the {self.t.size} times, a column for each channel ({', '.join(names)})"
                ]
            )
        return array


@dataclass(frozen=True)
class Parameter:
    """A number of the simulator that may be re-fitted, or belongs to a mechanism.

    start: first value. range: physically possible values; sigma: how well `start` is known (a Gaussian prior); one of
    the two is needed. scale: a change that matters (default: sigma, or a tenth of the range). log: positive, changed by
    factors. each: every recording has its own (a start angle): it is no property of the model, sigma says how far its
    own start value may be off, and start may be a function of the recording.

    Example: jv.Parameter("W", 50.0, range=(30, 90), unit="1/s^2")
    """

    name: str
    start: float | Callable[[Recording], float] = 0.0
    range: tuple[float, float] | None = None
    sigma: float | None = None
    unit: str = ""
    words: str = ""
    scale: float | None = None
    log: bool = False
    each: bool = False

    def __post_init__(self) -> None:
        if problems := self.problems():
            raise InputError(problems)

    def problems(self) -> list[str]:
        """What is wrong with it."""
        where, out = f"parameter {self.name!r}", []
        if not self.name.isidentifier():
            out.append(f"{where}: a name must be letters, digits and _, as it is a key and a column")
        if self.each:
            return (
                out if self.sigma else [*out, f"{where}: each=True needs sigma, how far a recording's start may be off"]
            )
        if callable(self.start):
            return [*out, f"{where}: start may be a function of the recording only with each=True"]
        if self.range is None and not self.sigma:
            out.append(f"{where}: give range=(low, high) or sigma; a number that is exact belongs in the simulator")
        elif self.range is not None and not self.range[0] < self.range[1]:
            out.append(f"{where}: range = {self.range}: low must be below high")
        elif self.range is not None and not self.range[0] <= self.start <= self.range[1]:
            out.append(f"{where}: start = {self.start:g} lies outside its range {self.range[0]:g} to {self.range[1]:g}")
        if self.log and (self.range is None or self.range[1] <= 0):
            out.append(f"{where}: log=True needs a range of positive numbers")
        return out

    def free(self) -> Free:
        """As a fit takes it."""
        assert not callable(self.start)
        spread = self.sigma or math.inf
        low, high = self.range or (self.start - 8 * spread, self.start + 8 * spread)
        scale = self.scale or min(0.1 * (high - low), spread)
        return Free(self.name, float(self.start), float(low), float(high), scale, spread, self.unit, self.log)


@dataclass(frozen=True)
class Mechanism:
    """A cause that may be missing from the simulator.

    parameters: the first is its strength, absent at `null`; the others its shape. words: what is lacking, as in "it
    lacks ...". shapes: sets of shape parameters at which its effect is tried first. function: another `simulate` that
    takes the place of the study's (then there is no null; it may have no parameter at all). law: a force in one line
    of its parameters and of the study's `symbols`, as in [mechanism.NAME] of a campaign, that `simulate` asks for.

    Example: jv.Mechanism("dry", [jv.Parameter("dry", 0.0, (0, 3))], "dry friction in the bearing")
    """

    name: str
    parameters: Sequence[Parameter] = ()
    words: str = ""
    null: float = 0.0
    shapes: Sequence[Sequence[float]] = ((),)
    function: Simulate | None = None
    law: str = ""

    @property
    def lacks(self) -> str:
        """What is missing, in words."""
        return self.words or self.name.replace("_", " ")

    def problems(self) -> list[str]:
        """What is wrong with it."""
        where = f"mechanism {self.name!r}"
        out = [f"{where}: {p}" for x in self.parameters for p in x.problems()]
        if self.function is None and not self.parameters:
            out.append(f"{where}: needs a parameter (its strength, absent at null) or a function of its own")
        elif self.function is not None and self.law:
            out.append(f"{where}: give a law, or a function of its own, not both")
        elif self.function is None and self.parameters and not out:
            first = self.parameters[0].free()
            if not first.low <= self.null <= first.high:
                out.append(
                    f"{where}: null = {self.null:g}, at which {first.name} does nothing, lies outside its range "
                    f"{first.low:g} to {first.high:g}"
                )
        if any(len(s) not in (0, len(self.parameters) - 1) for s in self.shapes):
            out.append(f"{where}: each of shapes gives the {len(self.parameters) - 1} parameters after the strength")
        return out


@dataclass(frozen=True)
class Channel:
    """One measured quantity, and the law of its instrument: reading = scale * value(t - delay) + zero + noise.

    noise: standard deviation of a reading [unit]; None: learned from repeats (recordings of one `group`) or from how
    smooth the readings are. correlation: of the noise from one sample to the next, where noise is given.
    zero_sigma: how well the zero of a record is known (inf: not at all). scale_sigma, delay_sigma [s]: how well the
    instrument's scale and clock are known, for all recordings alike. consider: of "scale", "delay", "rate" (of its
    clock) and "zero", which may be the cause of a misfit, alike in all recordings; None: all that nothing else here
    tells, where the readings ask for them.
    process: the simulation itself errs by a random walk, as small random forces make it over a long record: learned
    from repeats, each less its own simulation (in place of `noise`).

    Example: jv.Channel("angle", "rad", noise=1e-3)
    """

    name: str = "value"
    unit: str = ""
    noise: float | None = None
    correlation: float = 0.0
    wander: float = 0.0
    zero_sigma: float = 0.0
    scale_sigma: float = 0.0
    delay_sigma: float = 0.0
    consider: Sequence[str] | None = None
    process: bool = False

    def problems(self) -> list[str]:
        """What is wrong with it."""
        where, out = f"channel {self.name!r}", []
        if self.process and self.noise is not None:
            out.append(f"{where}: process=True learns the noise; leave noise out")
        if self.noise is not None and not self.noise > 0:
            out.append(f"{where}: noise = {self.noise!r} must be > 0 [{self.unit or 'its unit'}], or None to learn it")
        if not 0 <= self.correlation < 1:
            out.append(f"{where}: correlation = {self.correlation!r} must be from 0 to below 1")
        if wrong := [c for c in self.consider or () if c not in INSTRUMENT]:
            out.append(f"{where}: consider = {wrong}: must be of {', '.join(INSTRUMENT)}")
        return out

    def name_of(self, law: str) -> str:
        """The parameter of a law of the instrument."""
        return f"{self.name}_{law}"

    @property
    def sigmas(self) -> dict[str, float]:
        """How well scale and delay of its instrument are known, where that is stated."""
        stated = {"scale": self.scale_sigma, "delay": self.delay_sigma}
        return {law: sigma for law, sigma in stated.items() if sigma > 0}

    @property
    def laws(self) -> tuple[str, ...]:
        """The laws of its instrument that may be the cause: those of `consider`, or all of which nothing is stated."""
        if self.consider is not None:
            return tuple(self.consider)
        return tuple(n for n in INSTRUMENT if n not in self.sigmas and not (n == "zero" and self.zero_sigma > 0))


# of the law of an instrument: null, range, a change that matters; unit and words, {} the channel's. Of a delay and a
# zero the range is found from the recordings
INSTRUMENT = {"scale": (1.0, (0.5, 2.0), 0.02), "delay": (0.0, (-0.2, 0.2), 2e-3), "rate": (0.0, (-0.1, 0.1), 1e-3),
              "zero": (0.0, (-1.0, 1.0), 0.02)}  # fmt: skip
READS = {"scale": ("1", "another scale of the {}"), "delay": ("s", "a delay of the {}"),
         "rate": ("1", "another rate of the clock of the {}"), "zero": ("{}", "another zero of the {}")}  # fmt: skip
DELAYS = 2.0  # samples: a change of the clock that matters


@dataclass(frozen=True)
class Study:
    """A simulator in question.

    simulate(parameters, recording) -> values (n,), (n, channels) or a dict by channel. parameters: what the baseline
    may re-fit; mechanisms: what may be missing. batch: simulate takes lists, of parameters and of recordings, and gives
    a list. step: of a derivative, as a share of a parameter's scale: larger where the simulator is rough. version:
    change it when the simulator's numbers change, so that kept runs of the former one are not used.
    symbols: the state by which laws are written, as ("x", "v"); simulate then takes a third argument, the force of all
    laws that are present, which it calls as force(x=..., v=...). With their typical sizes, {"x": 0.3, "v": 2.0}, and a
    typical `force`, a law of no list is searched for where no mechanism explains the misfit. measured: what is known
    of parameters by other means than the recordings: the fit takes it in, and what contradicts the recordings is told.
    inputs: those that the next experiment may choose, with their ranges: the values that would tell most are proposed.
    jacobian: (parameters, recording) -> the outputs' derivatives, a dict by parameter, each shaped as the outputs (else
    `simulate.jacobian`, or that of a JAX function): checked against a difference first, then used in its place.

    Example: jv.Study(simulate, [jv.Parameter("W", 50.0, range=(30, 90))], [dry], [jv.Channel("angle", "rad")])
    """

    simulate: Simulate
    parameters: Sequence[Parameter] = ()
    mechanisms: Sequence[Mechanism] = ()
    channels: Sequence[Channel] = (Channel(),)
    name: str = ""
    batch: bool = False
    step: float = 1e-3
    version: str = ""
    symbols: Sequence[str] | Mapping[str, float] = ()
    force: float = 0.0
    measured: Sequence[Measured] = ()
    inputs: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    jacobian: Simulate | None = None

    def __post_init__(self) -> None:
        problems = [] if callable(self.simulate) else [f"study: simulate = {self.simulate!r} is no function"]
        given: list[Parameter | Mechanism | Channel] = [*self.parameters, *self.mechanisms, *self.channels]
        problems += [t for x in given for t in x.problems()]
        problems += ["study: channels is empty"] if not self.channels else []
        problems += [f"study: inputs: {n} = {x}: give (low, high)" for n, x in self.inputs.items() if not x[0] < x[1]]
        if self.inputs and (own := [p.name for p in self.parameters if p.each]):
            problems.append(f"study: inputs: {own[0]!r} is fitted to each recording, which one not yet made has not")
        sizes = self.symbols if isinstance(self.symbols, Mapping) else {}
        problems += [f"study: symbols: {n} = {x!r}: a typical size is above 0" for n, x in sizes.items() if not x > 0]
        problems += ["study: force: symbols need their typical sizes"] if self.force and not sizes else []
        problems += ["study: symbols: a batch takes no forces; leave batch out"] if self.symbols and self.batch else []
        if self.jacobian is not None and (self.symbols or self.batch):
            problems.append(
                "study: jacobian: it knows no laws, and is of one run; leave out symbols, batch or jacobian"
            )
        problems += [problem for m in self.mechanisms if m.law and (problem := self.law_problem(m))]
        of_channels = [c.name_of(n) for c in self.channels for n in {*self.considered(c), *c.sigmas}]
        shared = [*(p.name for p in self.parameters), *of_channels]
        own = [p.name for m in self.mechanisms for p in m.parameters]
        for what, names in (
            ("parameters", shared),
            ("mechanisms", [m.name for m in self.vocabulary]),
            ("channels", [c.name for c in self.channels]),
        ):
            problems += [f"study: two {what} are called {n!r}" for n in dict.fromkeys(names) if names.count(n) > 1]
        problems += [f"study: {n!r} is a parameter of a mechanism and of the baseline" for n in set(own) & set(shared)]
        fitted = {*own, *(p.name for p in self.parameters if not p.each), *shared[len(self.parameters) :]}
        for name in (n for m in self.measured for n in m.names if n not in fitted):
            problems.append(f"study: measured: {name!r} is no parameter that is fitted to all recordings alike")
        if problems:
            raise InputError(problems)

    def law_of(self, m: Mechanism) -> Expression:
        """The law of a mechanism that has one. Raises LawError."""
        from jumpvision.engine.laws.expression import parse  # most studies have none

        names = [*self.symbols, *(p.name for p in m.parameters)]
        return parse(m.law, dict(zip(names, names)))

    def law_problem(self, m: Mechanism) -> str:
        """What is wrong with the law of a mechanism; "" where nothing is."""
        from jumpvision.engine.laws.expression import LawError

        try:
            self.law_of(m)
        except LawError as e:
            allowed = ", ".join(self.symbols) or "none: give Study(symbols=...)"
            return f"mechanism {m.name!r}: law = {m.law!r}: {e} (symbols of the study: {allowed})"
        return ""

    def arguments(self, parameters: Mapping[str, float], recording: Recording) -> tuple[object, ...]:
        """What the simulator is called with."""
        given = dict(parameters)
        if not self.symbols:
            return given, recording
        own = (m for m in (*self.mechanisms, *(m for _, m in self.forms)) if m.law)
        present = [self.law_of(m) for m in own if given.get(m.parameters[0].name, m.null) != m.null]

        def force(**state: float) -> float:
            if self.forms and (missing := sorted({*self.symbols} - {*state})):
                raise TypeError(f"force() needs {', '.join(missing)}, as the study's symbols are")
            known = {**given, **state}
            with np.errstate(all="ignore"):  # a law that runs off is found by what the simulator gives
                return float(sum(law(np, **{n: known[n] for n in law.symbols}) for law in present))

        return given, recording, force

    @property
    def first(self) -> dict[str, float]:
        """What the simulator is given before any fit, mechanisms at what makes them absent; without what each recording
        has for itself."""
        out = {p.name: float(p.start) for p in self.parameters if not p.each and not callable(p.start)}
        for m in self.mechanisms:
            for k, p in enumerate(m.parameters):
                absent = k == 0 and m.function is None
                out[p.name] = m.null if absent else p.free().start
        return out

    def predict(self, model: Prediction | Mapping[str, Any], recording: Recording) -> Array:
        """(n, channels) the simulator's outputs with `found.prediction`, or with some parameters (numbers, or as in
        `found.fitted`); what is not given is as in `first`."""
        parameters, mechanisms = (model, ()) if isinstance(model, Mapping) else (model.parameters, model.mechanisms)
        other = [m.function for m in self.mechanisms if m.function is not None and m.name in mechanisms]
        simulate = other[0] if other else self.simulate
        own = {p.name: p.start(recording) if callable(p.start) else p.start for p in self.parameters if p.each}
        given: dict[str, Any] = {**self.first, **own, **{n: getattr(x, "value", x) for n, x in parameters.items()}}
        if self.batch:
            return recording.of_channels(next(iter(simulate([given], [recording]))), self.channels)
        return recording.of_channels(simulate(*self.arguments(given, recording)), self.channels)

    @functools.cached_property
    def forms(self) -> tuple[tuple[Form, Mechanism], ...]:
        """Laws of no list that its symbols allow; none without their sizes and a typical force."""
        if not self.force or not isinstance(self.symbols, Mapping):
            return ()
        from .forms import SHARE, forms

        listed = {m.name for m in self.mechanisms}
        each = ((form, as_mechanism(form, SHARE * self.force)) for form in forms(self.symbols))
        return tuple((form, m) for form, m in each if m.name not in listed)

    def has_form(self, parameters: Mapping[str, float]) -> bool:
        """Whether a law of no list acts."""
        return any(parameters.get(m.parameters[0].name, m.null) != m.null for _, m in self.forms)

    @property
    def functions(self) -> tuple[Simulate, ...]:
        """The simulator, and those that take its place, in the order of the mechanisms."""
        return (self.simulate, *(m.function for m in self.mechanisms if m.function is not None))

    def considered(self, c: Channel) -> tuple[str, ...]:
        """The laws of a channel's instrument that may be the cause; by default none that the user has of his own."""
        own = {p.name for p in self.parameters} | {m.name for m in self.mechanisms}
        own |= {p.name for m in self.mechanisms for p in m.parameters}
        return tuple(n for n in c.laws if c.consider is not None or c.name_of(n) not in own)

    @property
    def vocabulary(self) -> tuple[Mechanism, ...]:
        """The mechanisms, and the laws of instruments that may be the cause."""
        out = list(self.mechanisms)
        for c in self.channels:
            for law in self.considered(c):
                null, limits, scale = INSTRUMENT[law]
                unit, words = READS[law]
                p = Parameter(c.name_of(law), null, limits, unit=unit.format(c.unit), scale=scale)
                out.append(Mechanism(c.name_of(law), (p,), words.format(c.name), null=null))
        return tuple(out)

    def without_functions(self) -> Study:
        """The same without its functions, for a process that must not import them."""
        plain = [dataclasses.replace(m, function=None if m.function is None else _elsewhere) for m in self.mechanisms]
        return dataclasses.replace(self, simulate=_elsewhere, mechanisms=tuple(plain), jacobian=None)


def may_have_slopes(study: Study) -> bool:
    """Whether its function may bring derivatives of its own (`jacobian`)."""
    own = study.jacobian or getattr(study.simulate, "jacobian", None) or "jax" in sys.modules
    return bool(own) and not (study.symbols or study.batch)


def as_mechanism(form: Form, size: float) -> Mechanism:
    """A form as a mechanism of a study; size: of a force that matters."""
    from .forms import REACH

    prefix = f"{form.name}_"
    shapes = [Parameter(prefix + s.name, s.start, (s.low, s.high), scale=s.scale) for s in form.shapes]
    strength = Parameter(prefix + "r", 0.0, (-REACH * size, REACH * size), scale=size)
    starts = tuple(itertools.product(*(s.starts for s in form.shapes)))
    words = f"a law of no list, {form.law()}"
    return Mechanism(form.name, (strength, *shapes), words, shapes=starts, law=form.law(prefix))


def _elsewhere(*_: object) -> ArrayLike:
    raise RuntimeError("this simulator runs in another process")
