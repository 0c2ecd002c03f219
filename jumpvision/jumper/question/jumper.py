"""The jumper as a system that can be questioned: tracks of the rod, the model of each jump, the vocabulary."""

from __future__ import annotations

import copy
import itertools
import math
import threading
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.base.threads import at_once
from jumpvision.engine.system import Candidate, Indexed, Observation, Parameter
from jumpvision.engine.vary.apart import variables
from jumpvision.engine.vary.candidates import candidate as pattern_candidate
from jumpvision.engine.vary.candidates import changes_of, coefficients_of
from jumpvision.engine.vary.patterns import Pattern, Weighed
from jumpvision.engine.vary.variables import CLOCK, OFFSET, SCALE, Changes, Variable, added, fault_of, true_times
from jumpvision.jumper.mechanisms.own import parameters_with
from jumpvision.jumper.mechanisms.record import Body, Mechanism, Reach
from jumpvision.jumper.mechanisms.registry import MECHANISMS, PARAMETERS, acting
from jumpvision.jumper.physics.forcing import Forcing, Loop, Segments, Spline
from jumpvision.jumper.physics.model import BED, ROBOT, Model
from jumpvision.jumper.physics.sand.jump import Motion, Tracks, simulate

from .apart import changed, driven, variables_of
from .jumps import Jump, coarseness, common, common_error, groups, observation

RTOL, ATOL = 1e-7, 1e-9  # motions are right to some 5e-8 m, derivatives to 0.3 %; ten times finer takes twice as long
OF_COMMAND = tuple(m.name for m in MECHANISMS.values() if m.of_command)
SCATTER = ("start", "bed")  # what may differ from trial to trial
SCATTERED_AS = {"start": OFFSET}  # in a film another start of the motor is another offset of the clock
BEDS = 6  # values of one parameter that are fitted apart
BY_AREA = tuple(p.name for p in PARAMETERS.values() if p.by_area)
STIFFNESS = tuple(p.name for p in PARAMETERS.values() if p.stiffness)


Alike = tuple[list[int], list[int]]  # of every jump, the first with its motion and model; with its model


class Latest(threading.local):
    """What a thread asked for last, and what was predicted: derivatives begin there."""

    asked: Any = None
    said: list[Array]


class Jumper:
    """System of jumps that share a robot and, on each ground, a model's terms; what is not fitted may differ.

    bases: the model of the first jump on each ground, sand first. A mechanism acts in the jumps on its grounds.
    apart: values of parameters that are fitted and declared with several; each is fitted for itself, as `Indexed`.
    fit: parameters of the model, or of the robot, that the baseline may re-fit -> (low, high); sigma: standard
    uncertainties of given ones, used as priors. Raises InputError for a name that no model has, and for a term that
    acts on both grounds and is in the model of one.
    """

    def __init__(
        self,
        jumps: Sequence[Jump],
        fit: Mapping[str, tuple[float, float]],
        sigma: Mapping[str, float],
        workers: int = 2,
        own: Sequence[Mechanism] = (),
    ) -> None:
        self.jumps = list(jumps)
        grounds = sorted({j.model.ground for j in self.jumps})
        self.bases = {g: knowing(next(j.model for j in self.jumps if j.model.ground == g), own) for g in grounds}
        _agree(self.bases)
        self.scattering: tuple[str, ...] = SCATTER
        self.scattered_as = SCATTERED_AS
        self.patterns: Mapping[str, Pattern] = {}
        self.always: Changes = {}  # of every prediction: about these, jumps scatter
        self.workers = workers
        self.latest = Latest()
        self.apart = self._declared_apart({*fit, *sigma})
        free: list[Parameter] = []
        for n in dict.fromkeys([*fit, *sigma]):
            beds = [replace(self._free(n, fit.get(n), sigma.get(n), x), name=Indexed(n, k)) for k, x in self._beds(n)]
            free += beds or [self._free(n, fit.get(n), sigma.get(n))]
        self.baseline = (*free, *common(self.jumps))
        self.apparatus = groups(self.jumps)
        drives = any(j.law for j in self.jumps)  # a lag acts where the command drives, not where the encoder does
        self.candidates: dict[str, Candidate] = {}
        for model in self.bases.values():
            self.candidates = (
                candidates(model, command_drives=drives, reach=reach_of(self.jumps), priors=sigma, own=own)
                | self.candidates
            )
        for name, c in self.candidates.items() if self.apart else ():
            drops = [*c.drops, *(Indexed(n, k) for n in c.drops for k, _ in self._beds(n))]
            used = tuple(p for p in c.parameters if p.name not in self.apart)  # the others are those of the beds
            self.candidates[name] = replace(c, parameters=used, drops=tuple(drops))
        self.observations: list[Observation] = []
        simulated = [self._motion(j, j.model, j.t) for j in self.jumps]
        coarse = coarseness(self.jumps)
        for jump, motion in zip(self.jumps, simulated):
            self.observations.append(observation(jump, motion, coarse))
        motions = [
            (content(j.forcing), j.stop, o.t.tobytes(), k)
            for j, o, k in zip(self.jumps, self.observations, self.apparatus)
        ]
        self.same_motion = [motions.index(m) for m in motions]
        self.alike: dict[frozenset[str], Alike] = {}
        self.tracks = Tracks(
            [j.forcing for j in self.jumps], [j.stop for j in self.jumps], [o.t for o in self.observations]
        )

    @property
    def model(self) -> Model:
        """The model of the first jump, on sand where there is one."""
        return next(iter(self.bases.values()))

    def weighted(self, factors: Sequence[Array], scattering: Sequence[str] = SCATTER) -> Jumper:
        """The same jumps with a factor on the noise of every reading: by jump, (n,) as its track.

        scattering: what is found to differ from trial to trial; nothing else is asked for then.
        """
        out = copy.copy(self)
        out.scattering = tuple(scattering)
        out.observations = [
            replace(o, spread=f[np.searchsorted(j.t, o.t)]) for o, j, f in zip(self.observations, self.jumps, factors)
        ]
        return out

    def considering(self, own: Sequence[Mechanism]) -> Jumper:
        """The same jumps with these laws beside the vocabulary."""
        out = copy.copy(self)
        out.latest = Latest()
        out.bases = {g: knowing(m, own) for g, m in self.bases.items()}
        out.candidates = {**self.candidates, **{m.name: candidate(m, out.model, {}) for m in own}}
        return out

    @property
    def variables(self) -> dict[str, Variable]:
        """Numbers of the robot, the ground and the drive that jumps may differ in."""
        return variables_of(self.jumps)

    def varying(self, weighed: Sequence[Weighed], log_price: float = 0.0) -> Jumper:
        """The same jumps with these patterns, by which numbers differ between them, beside the vocabulary."""
        out = copy.copy(self)
        out.latest = Latest()
        out.patterns = {**self.patterns, **{w.pattern.name: w.pattern for w in weighed}}
        added = {w.pattern.name: pattern_candidate(w, log_price) for w in weighed}
        out.candidates = {**self.candidates, **added}
        return out

    def scattered(self, name: str, changes: Array) -> Jumper:
        """The same jumps about these changes of a number, by which they differ without order."""
        out = copy.copy(self)
        out.latest = Latest()
        out.scattering, out.always = (*self.scattering, name), {**self.always, name: changes}
        return out

    def at_common(self) -> Jumper:
        """The same jumps with one value for all of what scatters."""
        out = copy.copy(self)
        out.latest, out.always = Latest(), {}
        return out

    def _free(
        self, name: str, limits: tuple[float, float] | None, sigma: float | None, given: float | None = None
    ) -> Parameter:
        held = [m.parameters for m in self.bases.values()]
        given_in = next((p for p in held if getattr(p, name, None) is not None), held[0])
        owner = self.model if name in ROBOT else given_in
        meta = type(owner).__dataclass_fields__[name].metadata
        given = getattr(owner, name) if given is None else given
        if given is None and limits is None:
            raise InputError([f"[model.sigma] {name}: a prior on a value that the model does not give; give {name}"])
        start = 0.5 * sum(limits) if given is None and limits else float(given)
        least = meta.get("lo")
        spread = sigma or math.inf
        if limits is None:
            assert sigma is not None
            limits = (start - 8 * sigma, start + 8 * sigma)
            limits = (max(limits[0], float(least)) if least is not None else limits[0], limits[1])
        scale = min(0.1 * (limits[1] - limits[0]), spread if math.isfinite(spread) else math.inf)
        return Parameter(name, start, limits[0], limits[1], scale, spread, meta["unit"])

    def build(self, mechanisms: tuple[str, ...], values: Mapping[str, float], ground: str = "") -> Model:
        """The first model on a ground with these mechanisms and values; default as `model`. Raises InputError where it
        cannot be."""
        base = self.bases[ground] if ground else self.model
        of_jumps = coefficients_of(self.patterns)
        mechanisms = tuple(m for m in mechanisms if m not in self.patterns)
        values = {n: v for n, v in values.items() if n not in of_jumps} if of_jumps else values
        mechanisms = tuple(m for m in mechanisms if base.ground in base.mechanism(m).grounds)
        own_values = self._of_bed(base, values)
        values = {n: v for n, v in values.items() if n not in SCATTER and not isinstance(n, Indexed)} | own_values
        terms = list(base.terms)
        for name in mechanisms:
            gone = self.candidates[name].replaces
            terms = [name if t == gone else t for t in terms] if gone else [*terms, name]
        extra = {k: v for k, v in values.items() if k not in ROBOT}
        for n, v in ((n, v) for t in terms for n, v in base.mechanism(t).assumed.items()):
            if n not in extra and getattr(base.parameters, n) is None:
                extra[n] = v
        robot: dict[str, Any] = {k: v for k, v in values.items() if k in ROBOT}
        own = tuple(m for m in base.own if m.name in terms)
        return replace(base, terms=tuple(terms), own=own, parameters=replace(base.parameters, **extra), **robot)

    def _declared_apart(self, fitted: set[str]) -> dict[str, list[float]]:
        """Values of the parameters that are fitted and given by several. Raises InputError where that cannot be: of the
        robot, or more than BEDS."""
        out = {}
        for n in sorted(fitted):
            owners = [j.model if n in ROBOT else j.model.parameters for j in self.jumps]
            given = {v for o in owners if (v := getattr(o, n)) is not None}
            if len(given) > (1 if n in ROBOT else BEDS):
                raise InputError(
                    [
                        f"[{'robot' if n in ROBOT else 'model'}] {n}: {len(given)} values in one campaign, from "
                        f"{min(given):g} to {max(given):g}; what [model.fit], [model.sigma] or [robot.sigma] fit has "
                        f"one value in all of it, or at most {BEDS} of the beds: take it out of there, or give fewer"
                    ]
                )
            if len(given) > 1:
                out[n] = sorted(given)
        return out

    def _beds(self, name: str) -> list[tuple[int, float]]:
        return list(enumerate(self.apart.get(name, ())))

    def _of_bed(self, model: Model, values: Mapping[str, float]) -> dict[str, float]:
        """Of the parameters that are fitted for each bed, those of a declared model's."""
        found = ((n, x, k) for n in self.apart for k, x in self._beds(n))
        own = {n: Indexed(n, k) for n, x, k in found if x == getattr(model.parameters, n)}
        return {n: values[at] for n, at in own.items() if at in values}

    @property
    def differing(self) -> tuple[str, ...]:
        """Parameters of the model that are not the same in all experiments."""
        names = type(self.model.parameters).__dataclass_fields__
        given = {n: {getattr(j.model.parameters, n, None) for j in self.jumps} - {None} for n in names}
        return tuple(n for n in names if len(given[n]) > 1)

    def model_of(self, jump: Jump, mechanisms: tuple[str, ...], values: Mapping[str, float]) -> Model:
        """The model of a jump with these mechanisms and values. Raises InputError where it cannot be."""
        return self._own(self.build(mechanisms, values, jump.model.ground), jump, values)

    def _own(self, model: Model, jump: Jump, values: Mapping[str, float]) -> Model:
        """The model with what is a jump's own: its bed, robot and parameters where they are not fitted; nothing
        of how the motor follows its command where its log drives."""
        own = jump.model
        if fitted := self._of_bed(own, values):
            own = copy.copy(own)
            object.__setattr__(own, "parameters", replace(own.parameters, **fitted))
        out = of_jump(model, own, values)
        if not jump.law and any(t in OF_COMMAND for t in out.terms):
            out = copy.copy(out)
            object.__setattr__(out, "terms", tuple(t for t in out.terms if t not in OF_COMMAND))
        return out

    def predict(self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: Sequence[int]) -> list[Array]:
        """Heights above rest as the camera reports them [m]; NaN for a model that cannot be."""
        asked = (mechanisms, dict(values), tuple(which))
        if self.latest.asked != asked:
            self.latest.asked, self.latest.said = asked, self.predict_each(mechanisms, [values], which)[0]
        return self.latest.said

    def predict_each(
        self, mechanisms: tuple[str, ...], sets: Sequence[Mapping[str, float]], which: Sequence[int]
    ) -> list[list[Array]]:
        """`predict` of several sets of values: one call of the solver, which other threads need not wait for."""
        if self.always or any(m in self.patterns for m in mechanisms):
            return [self.predict_apart(mechanisms, s, {}, which) for s in sets]
        t = self.tracks.t
        out, times = np.full((len(sets), t.size), np.nan), np.empty((len(sets), t.size))
        asked: list[tuple[int, int, Model]] = []  # jump, lane, model
        films: list[tuple[Model, list[int]]] = []
        for lane, values in enumerate(sets):
            try:
                models = {g: self.build(mechanisms, values, g) for g in self.bases}
            except InputError:
                films.append((self.model, [*range(len(self.jumps))]))
                continue
            like, same_model = self._alike(models.values())
            runs = sorted({like[i] for i in which})
            own = {k: self.jumps[k] for k in {same_model[i] for i in runs}}
            used = {k: self._own(models[j.model.ground], j, values) for k, j in own.items()}
            asked += [(i, lane, used[same_model[i]]) for i in runs]
            model = models[self.model.ground]  # of the film, which is told alike on both
            films.append((model, like))
            times[lane] = model.shown(t) - values.get("start", 0.0)
            self._to_clocks(times[lane], self.tracks, runs, values)

        def follow(some: Sequence[tuple[int, int, Model]]) -> None:
            runs, lanes, models = zip(*some)
            self.tracks.heights(runs, lanes, models, times, out, rtol=RTOL, atol=ATOL)

        shares = [part for k in range(self.workers) if (part := asked[k :: self.workers])]
        try:
            at_once([partial(follow, part) for part in shares], self.workers)
        except ValueError:
            out[:] = np.nan
        said = []
        for row, values, (model, like) in zip(out, sets, films):
            heights = model.filmed(row, t)
            said.append([self._reported(i, heights[self.tracks.places[like[i]]], values) for i in which])
        return said

    def predict_apart(
        self, mechanisms: tuple[str, ...], values: Mapping[str, float], changes: Changes, which: Sequence[int]
    ) -> list[Array]:
        """`predict` with a change of each jump's own, beside those of the patterns among the mechanisms."""
        own = changes_of(self.patterns, mechanisms, values, len(self.jumps))
        changes = added(self.always, own, changes)
        tracks = driven(self.tracks, self.jumps, changes, which)
        t = tracks.t
        out, times = np.full((1, t.size), np.nan), np.empty((1, t.size))
        try:
            models = {g: self.build(mechanisms, values, g) for g in self.bases}
            each = [self._own(models[j.model.ground], j, values) for j in map(self.jumps.__getitem__, which)]
            each = [changed(m, changes, i) for m, i in zip(each, which)]
        except InputError:
            return [np.full(self.observations[i].t.size, np.nan) for i in which]
        film, clocks = models[self.model.ground], any(n in changes for n in CLOCK)
        times[0] = film.shown(t) - values.get("start", 0.0)
        self._to_clocks(times[0], tracks, which, values)
        for i in which if clocks else ():
            here = tracks.places[i]
            times[0, here] += true_times(t[here], *fault_of(changes, i)) - t[here]

        def follow(places: Sequence[int]) -> None:
            some, lanes = [which[k] for k in places], [0] * len(places)
            tracks.heights(some, lanes, [each[k] for k in places], times, out, rtol=RTOL, atol=ATOL)

        shares = [part for k in range(self.workers) if (part := range(len(which))[k :: self.workers])]
        try:
            at_once([partial(follow, part) for part in shares], self.workers)
        except ValueError:
            out[:] = np.nan
        heights = film.filmed(out[0], t)
        larger = 1.0 + changes.get(SCALE, np.zeros(len(self.jumps)))
        return [larger[i] * self._reported(i, heights[tracks.places[i]], values) for i in which]

    def predict_commanded(
        self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: int, like: int
    ) -> Array:
        """Heights of a jump driven as another one was."""
        other, t = self.jumps[like], self.observations[which].t
        jump = replace(self.jumps[which], forcing=other.forcing, stop=other.stop)
        return self._reported(which, self.height(jump, t, mechanisms, values), values)

    def _alike(self, models: Iterable[Model]) -> Alike:
        """What of the jumps is one: trials made alike are simulated once, whatever of their beds no law asks for."""
        beds = frozenset(n for m in models for n in m.beds)
        if beds not in self.alike:
            names = [n for n in (*ROBOT, *BED) if n not in BED or n in beds]
            own = [
                (j.model.ground, *(getattr(j.model, n) for n in names), j.model.parameters, j.law) for j in self.jumps
            ]
            both = list(zip(self.same_motion, own))
            self.alike[beds] = [both.index(b) for b in both], [own.index(o) for o in own]
        return self.alike[beds]

    def _to_clocks(self, times: Array, tracks: Tracks, runs: Iterable[int], values: Mapping[str, float]) -> None:
        """Adds to the times of these jumps [s] by how much the clock of their apparatus is off."""
        each = range(max(self.apparatus) + 1)
        errors = [(common_error(values, "offset", k), common_error(values, "rate", k)) for k in each]
        for i in runs if any(map(any, errors)) else ():
            here, (offset, rate) = tracks.places[i], errors[self.apparatus[i]]
            times[here] += offset + rate * tracks.t[here]

    def _reported(self, i: int, height: Array, values: Mapping[str, float]) -> Array:
        """True heights of an observation as its apparatus reports them [m]."""
        k, jump, o = self.apparatus[i], self.jumps[i], self.observations[i]
        if (scale := common_error(values, "scale", k)) != 1.0:
            height = height * scale
        if jump.shared.lens is not None:
            height = height + common_error(values, "lens", k) * jump.shared.lens[np.searchsorted(jump.t, o.t)]
        return height

    def scatter(
        self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: Sequence[int]
    ) -> dict[str, list[Array]]:
        """`start`: when the motor starts [s]; `bed`: stiffness of the sand, as a factor."""
        steps = {"start": 1e-5, **({"bed": 1e-3} if "granular" in self.bases else {})}
        steps = {n: h for n, h in steps.items() if n in self.scattering}
        out: dict[str, list[Array]] = {}
        if not self.scattering:
            return out
        at = self.predict(mechanisms, values, which)
        for name in (n for n in self.scattering if n not in SCATTER):
            step = variables(self)[name].step
            moved = self.predict_apart(mechanisms, values, {name: np.full(len(self.jumps), step)}, which)
            out[name] = [(b - a) / step for a, b in zip(at, moved)]
        if not steps:
            return out
        sets = self.predict_each(mechanisms, [{**values, n: h} for n, h in steps.items()], which)
        for (name, step), moved in zip(steps.items(), sets):
            out[name] = [(b - a) / step for a, b in zip(at, moved)]
        return out

    def height(self, jump: Jump, t: Array, mechanisms: tuple[str, ...], values: Mapping[str, float]) -> Array:
        """The same for one jump, measured or not, at the frames t (n,) [s]."""
        try:
            model = self.model_of(jump, mechanisms, values)
            motion = self._motion(jump, model, model.shown(t) - values.get("start", 0.0))
        except (RuntimeError, ValueError):  # InputError among them
            return np.full(t.size, np.nan)
        return model.filmed(motion.rod[-t.size :] - motion.rest, t)

    @staticmethod
    def _motion(jump: Jump, model: Model, t: Array) -> Motion:
        lead = [jump.forcing.start] if t[0] > jump.forcing.start else []
        return simulate(model, jump.forcing, t=np.concatenate([lead, t]), rtol=RTOL, atol=ATOL, stop=jump.stop)


def knowing(model: Model, own: Sequence[Mechanism]) -> Model:
    """The model with these mechanisms of the user's own beside those that it knows, for its terms to name."""
    every: tuple[Mechanism, ...] = tuple({m.name: m for m in (*model.own, *own)}.values())
    given = {n: getattr(model.parameters, n) for n in type(model.parameters).__dataclass_fields__}
    return replace(model, own=every, parameters=parameters_with(every)(**given)) if own else model


def _agree(bases: Mapping[str, Model]) -> None:
    """Raises InputError for a term that acts on both grounds and is in the model of one."""
    for a, b in itertools.permutations(bases.values(), 2):
        if apart := [t for t in a.terms if b.ground in a.mechanism(t).grounds and t not in b.terms]:
            raise InputError(
                [
                    f"[model] terms: {', '.join(apart)}: in the model on {a.ground} ground, not in that on {b.ground} "
                    "ground, though it acts on both; give it in both, or in neither"
                ]
            )


def reach_of(jumps: Sequence[Jump]) -> Reach | None:
    """How far and how fast the motors are sent; None where a feedback loop is simulated, or none moves."""
    stroke = speed = 0.0
    for j in jumps:
        if isinstance(j.forcing, Loop):
            return None
        x, v = j.forcing(np.linspace(j.forcing.start, j.forcing.stop, 2001))  # times at which a motion is looked at
        stroke, speed = max(stroke, float(np.abs(x - x[0]).max())), max(speed, float(np.abs(v).max()))
    return Reach(stroke, speed) if stroke > 0.0 else None


def content(forcing: Forcing | Loop) -> bytes:
    """Everything of a forcing, to tell whether two are the same."""
    if isinstance(forcing, Spline):
        return forcing.knots.tobytes() + forcing.c.tobytes()
    return forcing.rows.tobytes() if isinstance(forcing, Segments) else repr(forcing).encode()


def of_jump(model: Model, own: Model, values: Mapping[str, float]) -> Model:
    """The model with a jump's own bed, robot and parameters where they are not fitted; they were checked, so it is not
    again. Forces of the ground that no model declares, fitted for `model`'s foot, grow with the area of the jump's."""
    names = [n for n in (*ROBOT, *BED) if n not in values]
    differ = [n for n in names if getattr(model, n) != getattr(own, n)]
    given = vars(own.parameters).items()
    others = {n: v for n, v in given if v is not None and n not in values and v != getattr(model.parameters, n)}
    if "foot_radius" in differ and model.foot_radius and own.foot_radius:
        area = (own.foot_radius / model.foot_radius) ** 2
        added = [n for n in BY_AREA if n in values and getattr(own.parameters, n, None) is None]
        others |= {n: area * x for n in added if (x := getattr(model.parameters, n)) is not None}
    stiffer = 1.0 + values.get("bed", 0.0)
    if not differ and not others and stiffer == 1.0:
        return model
    out = copy.copy(model)
    for n in differ:
        object.__setattr__(out, n, getattr(own, n))
    if others:
        object.__setattr__(out, "parameters", replace(model.parameters, **others))
    if stiffer != 1.0:
        k = {n: v * stiffer for n in STIFFNESS if (v := getattr(out.parameters, n)) is not None}
        object.__setattr__(out, "parameters", replace(out.parameters, **k))
    return out


def candidates(
    model: Model,
    *,
    command_drives: bool,
    reach: Reach | None = None,
    priors: Mapping[str, float] | None = None,
    own: Sequence[Mechanism] = (),
) -> dict[str, Candidate]:
    """Every mechanism of the model's ground that is not in it, the static forces last: each in place of its own.

    own: the user's own mechanisms that are considered too. command_drives: the command, not the encoder, drives the
    model (else nothing `of_command`). reach: of the motors (None: their drives are not asked for). priors: standard
    uncertainties of shape parameters that the model's author gave.
    """
    statics = acting(Body.STATIC)
    return {
        m.name: candidate(m, model, priors or {}, reach)
        for m in [*(m for m in MECHANISMS.values() if m not in statics), *own, *statics]
        if model.ground in m.grounds and m.name not in model.terms and m.possible(model)
        if command_drives or not m.of_command
        if reach or m.acts_on is not Body.DRIVE
    }


def candidate(m: Mechanism, model: Model, sigma: Mapping[str, float], reach: Reach | None = None) -> Candidate:
    """A mechanism as a diagnosis tries it. sigma: standard uncertainties of its shape parameters."""
    parameters, grids = [], []
    for p in m.parameters:
        q = p.prior(reach if m.acts_on is Body.DRIVE else model)
        if p.name not in m.assumed and q.low < q.high:  # else a constant
            spread = sigma.get(p.name, q.sigma) if math.isfinite(q.sigma) else q.sigma
            parameters.append(Parameter(p.name, q.start, q.low, q.high, q.scale, spread, p.unit, q.log))
            grids.append(q.grid or (q.start,))
    if m.acts_on is Body.STATIC:
        own = model.acting(Body.STATIC)[0]
        drops = tuple(sorted(set(own.names) - set(m.names)))
        return Candidate(tuple(parameters), replaces=own.name, drops=drops)
    shapes = tuple(itertools.product(*grids[1:]))
    null = 0.0 if m.own else parameters[0].start
    dear = m.acts_on is Body.DRIVE  # every strength of it is another motion of every motor
    return Candidate(tuple(parameters), null=null, shapes=shapes, goes_with=m.goes_with, dear=dear)
