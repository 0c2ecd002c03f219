"""The jumper as a system that can be questioned: tracks of the rod, the model of each jump, the vocabulary."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.physics.forcing import Forcing, Segments, Spline
from jumpvision.physics.jump import Motion, simulate
from jumpvision.physics.loop import Loop
from jumpvision.physics.model import BED, ROBOT, Model
from jumpvision.physics.tracks import Tracks
from jumpvision.schema import InputError

from .noise import (
    Noise,
    Stretch,
    coefficients,
    estimate,
    frame_of,
    of_rounded,
    powers,
    rounding_step,
    spread_of,
    step_apart,
)
from .system import Observation, Parameter
from .vocabulary import candidates

Array = NDArray[np.float64]

RTOL, ATOL = 1e-8, 1e-10  # of the simulations: far below what a derivative's step changes
C_THESIS = 2.7  # scale of the added mass, where nothing in the data says it
LANDINGS = 2  # after the motor stopped; later bounces tell of chaos more than of the model
PARTS = ("pre_load", "intrusion", "push_off", "flight", "landing", "re_intrusion")
SCATTER = ("start", "bed")  # what may differ from trial to trial
STIFFNESS = ("k", "k1", "k2", "sigma_cone")


@dataclass(frozen=True)
class Jump:
    """One measured jump: rod height above rest y (n,) [m] at t (n,) [s], what drove it, the model questioned.

    stop: when the motor stops [s]. labels: kind, frequency, phi, ... to report by. law: the command is what drives.
    sigma: (n,) noise that the track itself states [m], if any. spread: factor on the campaign's noise.
    """

    name: str
    model: Model
    forcing: Forcing | Loop
    stop: float
    t: Array
    y: Array
    group: str
    condition: str
    law: bool
    labels: Mapping[str, Any] = field(default_factory=dict)
    sigma: Array | None = None
    spread: float = 1.0


class Jumper:
    """System of jumps that share a robot and a model (`volume_fraction` may differ).

    fit: parameters of the model, or of the robot, that the baseline may re-fit -> (low, high); sigma: standard
    uncertainties of given ones, used as priors. Raises InputError for a name that the model has not.
    """

    def __init__(
        self,
        jumps: Sequence[Jump],
        fit: Mapping[str, tuple[float, float]],
        sigma: Mapping[str, float],
        workers: int = 2,
    ) -> None:
        self.jumps = list(jumps)
        self.model = self.jumps[0].model
        self.workers, self.pool = workers, ThreadPoolExecutor(workers)
        self.baseline = tuple(self._free(n, fit.get(n), sigma.get(n)) for n in dict.fromkeys([*fit, *sigma]))
        drives = all(j.law for j in self.jumps)
        self.candidates = candidates(self.model, command_drives=drives, priors=sigma)
        self.observations: list[Observation] = []
        motions = [self._motion(j, j.model, j.t) for j in self.jumps]
        coarse = _coarse(self.jumps)
        for jump, motion in zip(self.jumps, motions):
            self.observations.append(_observation(jump, motion, coarse))
        # trials made alike are simulated once
        keys = [_key(j, o.t) for j, o in zip(self.jumps, self.observations)]
        self.like = [keys.index(k) for k in keys]
        own = [_own(j.model) for j in self.jumps]
        self.same_model = [own.index(o) for o in own]
        self.tracks = Tracks(
            [j.forcing for j in self.jumps], [j.stop for j in self.jumps], [o.t for o in self.observations]
        )

    def _free(self, name: str, limits: tuple[float, float] | None, sigma: float | None) -> Parameter:
        owner: Any = self.model if name in ROBOT else self.model.parameters
        meta = type(owner).__dataclass_fields__[name].metadata
        value = getattr(owner, name)
        if value is None and limits is None:
            raise InputError([f"[model.sigma] {name}: a prior on a value that the model does not give; give {name}"])
        value = 0.5 * sum(limits) if value is None and limits else float(value)
        least = meta.get("lo")
        spread = sigma or math.inf
        if limits is None:
            assert sigma is not None
            limits = (value - 8 * sigma, value + 8 * sigma)
            limits = (max(limits[0], float(least)) if least is not None else limits[0], limits[1])
        scale = min(0.1 * (limits[1] - limits[0]), spread if math.isfinite(spread) else math.inf)
        return Parameter(name, value, limits[0], limits[1], scale, spread, meta["unit"])

    def build(self, mechanisms: tuple[str, ...], values: Mapping[str, float]) -> Model:
        """The model of the first jump with these mechanisms and values. Raises InputError where it cannot be."""
        base = self.model
        values = {n: v for n, v in values.items() if n not in SCATTER}
        terms = list(base.terms)
        for name in mechanisms:
            gone = self.candidates[name].replaces
            terms = [name if t == gone else t for t in terms] if gone else [*terms, name]
        extra = {k: v for k, v in values.items() if k not in ROBOT}
        if "depth_drag" in terms and "C" not in extra and base.parameters.C is None:
            extra["C"] = C_THESIS  # only the product b C shows without the added mass
        robot: dict[str, Any] = {k: v for k, v in values.items() if k in ROBOT}
        return replace(base, terms=tuple(terms), parameters=replace(base.parameters, **extra), **robot)

    def predict(self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: Sequence[int]) -> list[Array]:
        """Heights above rest as the camera reports them [m]; NaN for a model that cannot be."""
        try:
            model = self.build(mechanisms, values)
        except InputError:
            return [np.full(self.observations[i].t.size, np.nan) for i in which]
        runs = sorted({self.like[i] for i in which})
        used = {k: of_jump(model, self.jumps[k].model, values) for k in {self.same_model[i] for i in runs}}
        out = np.full(self.tracks.t.size, np.nan)
        shift = model.time_shift - values.get("start", 0.0)

        def follow(some: Sequence[int]) -> None:
            models = [used[self.same_model[i]] for i in some]
            self.tracks.heights(some, models, shift, out, rtol=RTOL, atol=ATOL)

        try:
            list(self.pool.map(follow, [part for k in range(self.workers) if (part := runs[k :: self.workers])]))
        except ValueError:
            out[:] = np.nan
        out *= model.camera_factor
        return [out[self.tracks.places[self.like[i]]] for i in which]

    def scatter(
        self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: Sequence[int]
    ) -> dict[str, list[Array]]:
        """`start`: when the motor starts [s]; `bed`: stiffness of the sand, as a factor."""
        at = self.predict(mechanisms, values, which)
        steps = {"start": 1e-5, **({"bed": 1e-3} if self.model.ground == "granular" else {})}
        out = {}
        for name, step in steps.items():
            moved = self.predict(mechanisms, {**values, name: step}, which)
            out[name] = [(b - a) / step for a, b in zip(at, moved)]
        return out

    def height(self, jump: Jump, t: Array, mechanisms: tuple[str, ...], values: Mapping[str, float]) -> Array:
        """The same for one jump, measured or not, at the frames t (n,) [s]."""
        try:
            model = of_jump(self.build(mechanisms, values), jump.model, values)
            motion = self._motion(jump, model, t + model.time_shift - values.get("start", 0.0))
        except (RuntimeError, ValueError):  # InputError among them
            return np.full(t.size, np.nan)
        return (motion.rod[-t.size :] - motion.rest) * model.camera_factor

    @staticmethod
    def _motion(jump: Jump, model: Model, t: Array) -> Motion:
        lead = [jump.forcing.start] if t[0] > jump.forcing.start else []
        return simulate(model, jump.forcing, t=np.concatenate([lead, t]), rtol=RTOL, atol=ATOL, stop=jump.stop)


def content(forcing: Forcing | Loop) -> bytes:
    """Everything of a forcing, to tell whether two are the same."""
    if isinstance(forcing, Spline):
        return forcing.knots.tobytes() + forcing.c.tobytes()
    return forcing.rows.tobytes() if isinstance(forcing, Segments) else repr(forcing).encode()


def _key(jump: Jump, t: Array) -> tuple[Any, ...]:
    return (content(jump.forcing), jump.stop, _own(jump.model), t.tobytes())


def _own(model: Model) -> tuple[Any, ...]:
    return tuple(getattr(model, n) for n in (*ROBOT, *BED))


def of_jump(model: Model, own: Model, values: Mapping[str, float]) -> Model:
    """The model with a jump's own bed and robot where they are not fitted; both were checked, so it is not again."""
    names = [n for n in (*ROBOT, *BED) if n not in values]
    differ = [n for n in names if getattr(model, n) != getattr(own, n)]
    stiffer = 1.0 + values.get("bed", 0.0)
    if not differ and stiffer == 1.0:
        return model
    out = copy.copy(model)
    for n in differ:
        object.__setattr__(out, n, getattr(own, n))
    if stiffer != 1.0:
        k = {n: v * stiffer for n in STIFFNESS if (v := getattr(model.parameters, n)) is not None}
        object.__setattr__(out, "parameters", replace(model.parameters, **k))
    return out


DITHER = 1.0  # rounding steps: readings at rest that scatter by more leave nothing of the rounding


def _coarse(jumps: Sequence[Jump]) -> float:
    """Rounding step [m] of the tracks that their noise does not dither; 0 where there is none."""
    step = max(rounding_step(j.y) for j in jumps)
    rest = [r for j in jumps if (r := j.y[j.t < j.forcing.start]).size >= 6]
    return 0.0 if rest and math.sqrt(np.mean([r.var() for r in rest])) > DITHER * step else step


def _observation(jump: Jump, motion: Motion, coarse: float) -> Observation:
    """The part of the track that is questioned: to the LANDINGS-th landing after the motor's stop.

    coarse: rounding step [m] by which the motion must have moved between two samples.
    """
    landed = motion.flights[:, 1]
    landed = landed[landed > jump.stop]
    end = landed[LANDINGS - 1] if landed.size >= LANDINGS else np.inf
    keep = np.flatnonzero(jump.t <= end)
    if coarse > 0:
        keep = keep[step_apart(motion.rod[-jump.t.size :][keep], coarse)]
    parts = parts_of(motion, jump)[-jump.t.size :][keep]
    return Observation(
        jump.name, jump.t[keep], jump.y[keep], jump.group, jump.condition, labels=dict(jump.labels), parts=parts,
        spread=np.full(keep.size, jump.spread) if jump.spread != 1.0 else None,
    )  # fmt: skip


def parts_of(motion: Motion, jump: Jump) -> NDArray[np.str_]:
    """Part of the jump that each output time belongs to, as the baseline has it."""
    t = motion.t
    out = np.full(t.size, "pre_load", dtype="U12")
    air, intruding = motion.mode == 0, motion.mode == 2
    lifts, lands = motion.flights[:, 0], motion.flights[:, 1]
    flown = np.searchsorted(lands[np.isfinite(lands)], t, side="right")  # landings so far
    started = np.zeros(t.size, bool)
    digs = motion.events["time"][motion.events["kind"] == "intrude"]
    started = t >= (digs[0] if digs.size else np.inf)
    out[started] = "push_off"
    out[started & intruding] = "intrusion"
    last = np.zeros(t.size)
    if lands.size and np.isfinite(lands).any():
        ends = lands[np.isfinite(lands)]
        last = np.where(flown > 0, ends[np.maximum(flown - 1, 0)], -np.inf)
        after = flown > 0
        out[after] = "push_off"
        out[after & (t - last < 0.03)] = "landing"
        out[after & intruding] = "re_intrusion"
    out[air] = "flight"
    if lifts.size == 0:
        out[t < jump.forcing.start] = "pre_load"
    return out


def learn_noise(system: Jumper) -> tuple[Noise, dict[str, float]]:
    """(noise of the tracks, scatter from trial to trial), from where no model is needed or a rough one will do.

    From differences of trials made alike: what scatter could do to them (`Jumper.scatter` of the model as given) is
    fitted to each. With few trials, from rest and flight, and no scatter is known.
    Raises ValueError where there is too little of all that.
    """
    jumps = system.jumps
    step = max(rounding_step(j.y) for j in jumps)
    frame = frame_of([j.t for j in jumps])
    pairs = differences(system)
    if sum(x.t.size for x in pairs) < ENOUGH_REPEATED:
        return estimate([*pairs, *quiet(jumps)], frame, floor=step / math.sqrt(12.0)), {}
    noise = estimate(pairs, frame)
    if step > 0:
        noise = replace(noise, s=of_rounded(noise.s, step))
    found = [coefficients(noise, x) for x in pairs]
    names = list(system.scatter((), {p.name: p.start for p in system.baseline}, [0]))
    scatter = {n: spread_of([(c[k + 1], v[k + 1]) for c, v in found]) for k, n in enumerate(names)}
    return noise, scatter


def differences(system: Jumper) -> list[Stretch]:
    """n - 1 independent differences of n trials of a group (Helmert), each with the variance of one trial.

    Design: the zero level, then what scatters, until the motor has stopped (later it depends too much on the model).
    """
    jumps = system.jumps
    start = {p.name: p.start for p in system.baseline}
    groups: dict[str, list[int]] = {}
    for i, j in enumerate(jumps):
        if j.spread == 1.0:  # of the campaign's common noise
            groups.setdefault(j.group, []).append(i)
    out = []
    for trials in groups.values():
        first = jumps[trials[0]]
        for k in range(1, len(trials)):
            tracks = [_at(first.t, jumps[i]) for i in trials[: k + 1]]
            good = np.all(np.isfinite(tracks), axis=0) & (first.t < first.stop + 0.05)
            if good.sum() < 12:
                continue
            t = first.t[good]
            y = (tracks[k] - np.mean(tracks[:k], axis=0))[good] / math.sqrt(1.0 + 1.0 / k)
            effects = [system.height(first, t, (), {**start, n: h}) for n, h in (("start", 1e-5), ("bed", 1e-3))]
            at = system.height(first, t, (), start)
            columns = [(e - at) / h for e, h in zip(effects, (1e-5, 1e-3))]
            usable = columns[: 2 if system.model.ground == "granular" else 1]
            out.append(Stretch(t, y, np.column_stack([np.ones(t.size), *(np.nan_to_num(c) for c in usable)])))
    return out


def quiet(jumps: Sequence[Jump]) -> list[Stretch]:
    """Stretches of single tracks whose course needs no model: rest and flight."""
    rounded = any(rounding_step(j.y) > 0 for j in jumps)
    out: list[Stretch] = []
    for j in (j for j in jumps if j.spread == 1.0):
        rest = j.t < j.forcing.start
        if rest.sum() >= 6 and not rounded:
            out.append(Stretch(j.t[rest], j.y[rest], np.ones((int(rest.sum()), 1))))
        out += _flights(j)
    return out


def _at(t: Array, jump: Jump) -> Array:
    """A trial's heights at the frames t of another, NaN where it has no frame within 1e-6 s."""
    i = np.clip(np.searchsorted(jump.t, t - 1e-6), 0, jump.t.size - 1)
    return np.where(np.abs(jump.t[i] - t) < 2e-6, jump.y[i], np.nan)


ENOUGH_REPEATED = 400  # samples of differences that are worth more than rest and flight
FALL = 0.3  # of g: how near to free fall a stretch must be to be called a flight


def _flights(jump: Jump) -> list[Stretch]:
    """The longest flight after the motor stopped, found in the track itself by its curvature -g.

    Its course: a polynomial of degree 4 and the ring of the foot on its spring.
    """
    m = jump.model
    after = np.flatnonzero(jump.t > jump.stop)
    if after.size < 16:
        return []
    t, y = jump.t[after], jump.y[after]
    top = int(np.argmax(y))
    best: Stretch | None = None
    for half in range(8, 60, 2):
        window = slice(max(top - half, 0), min(top + half + 1, t.size))
        if t[window].size < 16:
            continue
        curve = 2.0 * np.polyfit(t[window] - t[top], y[window], 2)[0]
        if abs(curve / m.g + 1.0) > FALL:
            break
        inner = slice(window.start + 2, window.stop - 2)
        design = powers(t[inner], 4)
        if m.m_f > 0:
            ring = math.sqrt(m.k_s * (1.0 / m.m_f + 1.0 / m.M))
            decay = np.exp(-0.5 * m.c_s * (1.0 / m.m_f + 1.0 / m.M) * (t[inner] - t[inner][0]))
            phase = ring * t[inner]
            design = np.column_stack([design, decay * np.cos(phase), decay * np.sin(phase)])
        if t[inner].size > design.shape[1] + 4:
            best = Stretch(t[inner], y[inner], design)
    return [best] if best is not None else []
