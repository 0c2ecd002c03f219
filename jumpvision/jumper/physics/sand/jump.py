"""Simulation of a jump on granular or hard ground: model and forcing in, motion out; many tracks for a fit."""

from __future__ import annotations

import functools
import math
from collections.abc import Hashable, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array
from jumpvision.jumper.mechanisms.record import STATE, Body
from jumpvision.jumper.mechanisms.registry import MECHANISMS
from jumpvision.jumper.physics.drive import drive_of, played
from jumpvision.jumper.physics.forcing import Forcing, Loop, Segments
from jumpvision.jumper.physics.model import ROBOT, Model

from . import compiled, events, granular, run, within
from .laws import LAG, Laws, dry, laws_of, steady

MODES = ("air", "rest", "intrude")
OUTPUTS = ("rod", "foot", "motor", "rod_velocity", "foot_velocity", "ground_force", "spring_force")
SINKS = "model k2, sigma_cone: the bed cannot carry the robot's weight; give larger values"
MOST_PLAYED = 2000  # motions of drives that are kept, some 10 kB each
EVENT = np.dtype([("time", float), ("kind", "U10")])


@dataclass(frozen=True)
class Motion:
    """One simulated jump. Arrays (n,), positions positive up, the foot's zero at the undisturbed surface.

    Heights as in docs/physics.md section 1: `jump_height` greatest rod height after the motor stops minus rest,
    `driven_height` the same while it runs, `com_height` greatest rise of the centre of mass, `flight_height` g t_f^2/8
    of the longest flight that ends after the forcing (NaN: none landed).
    """

    t: Array  # s
    rod: Array  # m, x_r
    foot: Array  # m, x_f
    motor: Array  # m, x_m = x_r + X_m
    rod_velocity: Array  # m/s
    foot_velocity: Array  # m/s
    ground_force: Array  # N on the foot, positive up
    spring_force: Array  # N on the rod, positive up
    mode: NDArray[np.int64]  # index into MODES
    events: NDArray[np.void]  # EVENT: time [s], kind
    flights: Array  # (m, 2) lift-off and landing [s]; landing NaN when the run ends in the air
    rest: float  # m, x_r at rest before the forcing
    depth_max: float  # m, deepest point of the foot
    jump_height: float  # m
    driven_height: float  # m
    com_height: float  # m
    flight_height: float  # m


def simulate(
    model: Model, forcing: Forcing | Loop, *, t: ArrayLike, rtol: float, atol: float, stop: float | None = None
) -> Motion:
    """The motion of a robot settled at rest at t[0], driven by `forcing`.

    t: (n,) output times [s], increasing, from rest: t[0] <= forcing.start; the run ends at t[-1].
    rtol: relative tolerance of a step; atol [m]: absolute one of positions, of velocities times the spring's rate,
    of the foot's times that of foot and spring.
    stop: when the motor stops [s], for the heights; default forcing.stop (give it for a log longer than the motion).
    `camera_scale` and `time_offset` change what a film reports, not the motion: `filmed_height`.
    Raises ValueError for times that are not as above, and RuntimeError when no solution can be followed.
    """
    t = np.atleast_1d(np.asarray(t, float))
    if t.size < 2 or not np.all(np.isfinite(t)) or np.any(np.diff(t) <= 0):
        raise ValueError("simulate t: must be at least two finite, increasing times; give an increasing array")
    if t[0] > forcing.start:
        raise ValueError(f"simulate t[0] = {t[0]:g} s: must be <= the start of the forcing, {forcing.start:g} s")
    if not (0 < rtol < 1 and 0 < atol < 1):
        raise ValueError(f"simulate rtol = {rtol!r}, atol = {atol!r}: must be in (0, 1); give e.g. 1e-7 and 1e-9")
    stop = forcing.stop if stop is None else float(stop)
    return follow(model, played(model, forcing), t, rtol, atol, stop)[0]


def follow(
    model: Model, forcing: Forcing | Loop, t: Array, rtol: float, atol: float, stop: float, works: bool = False
) -> tuple[Motion, Array, Array]:
    """`simulate` with the states [`granular`] at the end and at rest; works: with the energies behind them."""
    constants = pack(model)
    if isinstance(forcing, Loop):
        limit_loop(constants, forcing, model)
    led = works or constants["led"][0] or constants["inner"][0]
    n = granular.N_MOTION if led else granular.X
    if works:
        n = granular.LOST + int(constants["lost"][0]) + 1
    kind, rows, edges = pieces(forcing, stop, max(float(t[-1]), forcing.start))
    position = float(forcing(forcing.start - 1.0)[0][0])  # before the forcing
    driven = int(np.searchsorted(t, forcing.start))
    out = np.empty((t.size, within.N_OUT))
    modes, log = np.full(t.size, granular.STUCK), np.empty((run.MAX_EVENTS, 2))
    space = run.workspace(n, len(rows))
    status = compiled.solver()(
        constants,
        kind,
        rows,
        edges,
        position,
        stop,
        t[driven:],
        out[driven:],
        modes[driven:],
        log,
        rtol,
        atol,
        np.empty(0),
        space,
    )
    if status == run.CANNOT_CARRY:
        raise ValueError(SINKS)
    if status != run.OK:
        what = "more events than a jump can have" if status == run.TOO_MANY_EVENTS else "the step became too small"
        raise RuntimeError(f"simulate: {what}; check the parameters of the model:\n{model}")
    p = constants[0]
    rest, foot = float(p["height"]), -float(p["deep"])
    out[:driven] = rest, foot, rest + position, 0.0, 0.0, (model.M + model.m_f) * model.g, model.M * model.g
    start = np.zeros(n)
    start[granular.Y], start[granular.XF] = rest + model.m_m / model.M * position, foot
    named = np.array([(when, events.KINDS[int(k)]) for when, k in log[: p["events"]]], dtype=EVENT)
    flights = _flights(named)
    landed = (flights[:, 1] - flights[:, 0])[flights[:, 1] > stop]
    column: dict[str, Array] = dict(zip(OUTPUTS, np.ascontiguousarray(out.T)))
    motion = Motion(
        t=t,
        **column,
        mode=modes,
        events=named,
        flights=flights,
        rest=rest,
        depth_max=float(p["memory"][granular.FLOOR]),
        jump_height=_finite(p["rod_after"] - rest),
        driven_height=_finite(p["rod_before"] - rest),
        com_height=float(p["com"] - p["lowest"]),
        flight_height=model.g * float(landed.max()) ** 2 / 8 if landed.size else math.nan,
    )
    return motion, space.s, start


def _finite(height: float) -> float:
    return float(height) if math.isfinite(height) else math.nan


def arguments(motion: Motion, body: Body) -> dict[str, Array]:
    """What a law on this body was asked for along a motion, by symbol: (k,) where it acted, k <= n."""
    t, down = motion.t, motion.mode == MODES.index("intrude")
    table = {
        Body.FOOT: {"z": -motion.foot[down], "v": motion.foot_velocity[down]},
        Body.INERTIA: {"z": -motion.foot[down]},
        Body.CARRIAGE: {
            "x_m": motion.motor - motion.motor[0],
            "x_r": motion.rod,
            "v_m": np.gradient(motion.motor, t),
        },
        Body.SPRING: {
            "stretch": motion.rod - motion.foot,
            "stretch_rate": motion.rod_velocity - motion.foot_velocity,
        },
        Body.HEIGHT: {"h": motion.rod - motion.rest, "h_rate": motion.rod_velocity},
        Body.MOTOR: {"X": motion.motor - motion.rod},
        Body.TIME: {"time_s": t},
    }
    return table[body]


def beyond_seen(model: Model, motion: Motion) -> list[str]:
    """Where a law was asked for outside the range that the data it was found in covered, in words with the numbers."""
    out = []
    for m in model.acting(*Body):
        for n, x in arguments(motion, m.acts_on).items() if m.seen else ():
            if n not in m.seen or not x.size:
                continue
            (low, high), least, most = m.seen[n], float(x.min()), float(x.max())
            room = 0.05 * (high - low)  # so far beyond the range seen a law is used without a word
            if least < low - room or most > high + room:
                out.append(
                    f"'{m.name}' is used at {n} of {least:.3g} to {most:.3g} {STATE[n][0]}; it was found between "
                    f"{low:.3g} and {high:.3g}, and nothing is known of it outside"
                )
    return out


def filmed_height(model: Model, forcing: Forcing, *, t: ArrayLike, rtol: float, atol: float) -> Array:
    """Rod height above rest as a camera reports it [m] at frames stamped t (n,) [s], increasing.

    `time_offset`: the frame stamped t shows t + dt; `camera_scale`: heights are multiplied by scale.
    """
    frames = np.atleast_1d(np.asarray(t, float))
    true = model.shown(frames)
    lead = [forcing.start] if true[0] > forcing.start else []
    tail = [] if true.size + len(lead) > 1 else [true[-1] + 1e-3]
    motion = simulate(model, forcing, t=np.concatenate([lead, true, tail]), rtol=rtol, atol=atol)
    heights = motion.rod[len(lead) : len(lead) + true.size] - motion.rest
    return model.filmed(heights, frames)


def laws(model: Model) -> Laws:
    """The laws of a model, compiled."""
    sand = model.ground == "granular"
    return laws_of([model.mechanism(t) for t in model.terms], sand) if model.own else _listed(model.terms, sand)


@functools.lru_cache(256)  # asked for by every model of a fit
def _listed(terms: tuple[str, ...], sand: bool) -> Laws:
    return laws_of([MECHANISMS[t] for t in terms], sand)


def pack(model: Model, n: int = 1) -> NDArray[np.void]:
    """The model as records of `granular.CONSTANTS`, shape (n,); numbers of the model may be arrays (n,)."""
    out, own = np.zeros(n, granular.CONSTANTS), laws(model)
    for name, address in own.addresses.items():
        out[name] = address
    out["sand"], out["massless"] = model.ground == "granular", np.equal(model.m_f, 0.0)
    out["ages"], out["lost"], out["led"] = own.ages, len(own.lost), own.addresses["drive"] != 0
    robot = {name: getattr(model, name) for name in ("m_m", "M", "m_f", "k_s", "c_s", "g")}
    for name, value in robot.items():
        out[name] = value
    out["ratio"], out["per_M"] = robot["m_m"] / robot["M"], 1.0 / np.asarray(robot["M"])
    out["m_r"], out["slack"] = model.rod_mass, 1e-9 * robot["M"] * robot["g"]
    out["e"] = model.symbol("e") if model.acting(Body.LANDING) else 0.0
    out["tau"] = model.symbol("tau") if LAG in model and not own.addresses["drive"] else 0.0
    for k, name in enumerate(own.module.constants):
        value = model.symbol(name)
        out["number"][:, k] = 0.0 if value is None else value
    out["linear"] = 1
    for m in model.acting(Body.SPRING, Body.CARRIAGE, Body.RAIL):
        acts = np.not_equal(model.symbol(m.names[0]), 0.0)
        if dry(m):
            out["dry"] |= acts
        if m.acts_on is Body.SPRING or not steady(m):
            out["linear"] &= ~acts
    return out


def pack_each(models: Sequence[Model]) -> NDArray[np.void]:
    """The models as records of `granular.CONSTANTS`, shape (n,): on the beds of one campaign they often differ in those
    alone, and are then packed once."""
    out = np.empty(len(models), granular.CONSTANTS)
    raw = out.view(np.uint8).reshape(len(models), -1)  # as bytes: numpy copies records field by field
    first: dict[tuple[Hashable, ...] | int, int] = {}
    for k, m in enumerate(models):
        if (at := first.setdefault(id(m), k)) < k:
            raw[k] = raw[at]
            continue
        same = id(m) if m.own else (m.ground, m.terms, id(m.parameters), *(getattr(m, n) for n in ROBOT))
        at = first.setdefault(same, k)
        raw[k] = pack(m).view(np.uint8) if at == k else raw[at]
        constants = laws(m).module.constants if at != k else ()
        for symbol in ("phi", "rho") if at != k else ():
            out["number"][k, constants.index(symbol)] = m.symbol(symbol) or 0.0
    return out


def limit_loop(constants: NDArray[np.void], loop: Loop, model: Model) -> None:
    """Writes a feedback loop's gains and limits into packed constants. ValueError where it would act twice."""
    if motors := [m.name for m in model.acting(Body.MOTOR)]:
        raise ValueError(
            f"simulate: {motors[0]} stands for the delay of a feedback loop, which would act twice beside the loop "
            f"itself; remove {motors[0]} from the model, or drive it by the command alone"
        )
    constants["led"] = 1
    for name in ("kp", "kd", "max_force", "max_speed"):
        constants[name] = getattr(loop, name)
    constants["low"], constants["high"] = loop.ends


def equilibrium(model: Model) -> tuple[float, float]:
    """x_r, x_f [m] of the robot at rest: M g on the spring, (M + m_f) g on the ground."""
    height, deep = compiled.equilibrium()(pack(model))
    if math.isnan(deep):
        raise ValueError(SINKS)
    return height, -deep


def pieces(forcing: Forcing | Loop, stop: float, end: float) -> tuple[int, Array, Array]:
    """Kind, rows (n, 6) and edges (n + 1,) of the forcing from its start to `end` with the motor at rest after it.

    An edge lies at `stop` also where the law goes on. A loop's rows have a seventh column, its gain.
    """
    if isinstance(forcing, Loop):
        kind, rows, edges = pieces(forcing.command, stop, end)
        _, every, _ = pieces(forcing.command, stop, max(end, forcing.stop))  # a pause is one though the run ends in it
        return kind, np.column_stack([rows, forcing.gains(every)[: len(rows)]]), edges
    if isinstance(forcing, Segments):
        kind, rows = granular.SINE, forcing.rows
        still = [forcing.stop, np.inf, float(forcing(forcing.stop)[0][0]), 0.0, 0.0, 0.0]
    else:
        kind, rows = granular.CUBIC, np.column_stack([forcing.knots[:-1], forcing.knots[1:], forcing.c.T])
        still = [forcing.stop, np.inf, 0.0, 0.0, 0.0, float(forcing(forcing.stop)[0][0])]
    rows = np.vstack([rows[rows[:, 1] > rows[:, 0]], still])
    inner = np.union1d(rows[1:, 0], [stop])
    edges = np.concatenate([[forcing.start], inner[(inner > forcing.start) & (inner < end)], [end]])
    return kind, np.ascontiguousarray(rows[np.searchsorted(rows[:, 0], edges[:-1], side="right") - 1]), edges


def _flights(named: NDArray[np.void]) -> Array:
    rows: list[list[float]] = []
    for time, kind in named:
        if kind == "lift_off":
            rows.append([time, math.nan])
        elif kind == "landing" and rows:
            rows[-1][1] = time
    return np.array(rows).reshape(-1, 2)


class Laid(NamedTuple):
    """A forcing as the integrator has it (see `pieces`), and where the motor stands before it [m]."""

    forcing: Forcing | Loop
    kind: int
    rows: Array
    edges: Array
    before: float


def laid(forcing: Forcing | Loop, stop: float) -> Laid:
    """A forcing of a motor that stops at this time [s]."""
    return Laid(forcing, *pieces(forcing, stop, math.inf), float(forcing(forcing.start - 1.0)[0][0]))


class Tracks:
    """Jumps with these forcings, motors that stop at these times [s] and outputs at these times (n_i,) [s]."""

    def __init__(
        self, forcings: Sequence[Forcing | Loop | Laid], stops: Sequence[float], times: Sequence[Array]
    ) -> None:
        each = [f if isinstance(f, Laid) else laid(f, s) for f, s in zip(forcings, stops)]
        self.laid, self.forcings = each, [x.forcing for x in each]
        self.played: dict[tuple[int, tuple[Hashable, ...]], Laid] = {}  # by jump and drive
        wide = max(x.rows.shape[1] for x in each)  # a loop's rows have its gain behind
        self.rows = np.concatenate([np.pad(x.rows, ((0, 0), (0, wide - x.rows.shape[1]))) for x in each])
        self.edges = np.concatenate([x.edges for x in each])
        self.t = np.concatenate(times).astype(float)
        self.about = np.zeros(len(each), compiled.TRACK)
        self.about["kind"], self.about["stop"] = [x.kind for x in each], stops
        self.about["before"] = [x.before for x in each]
        for name, sizes in (("row", [x.rows.shape[0] for x in each]), ("time", [t.size for t in times])):
            self.about[name + "_end"] = ends = np.cumsum(sizes)
            self.about[name] = ends - sizes
        self.places = [slice(a["time"], a["time_end"]) for a in self.about]

    def heights(
        self,
        which: Sequence[int],
        lanes: Sequence[int],
        models: Sequence[Model],
        t: Array,
        out: Array,
        *,
        rtol: float,
        atol: float,
    ) -> None:
        """Writes x_r above rest [m] at the times t [s] of the jumps `which`, models[k] that of which[k] in lanes[k].

        t, out: a row a lane, as long as all times together, `places` says whose is what; NaN where a motion cannot be
        followed. rtol, atol as in `jump.simulate`. Lets other threads run.
        """
        driven = any(m.acting(Body.DRIVE) for m in models)
        tracks, which = self._driven(which, models) if driven else (self, which)
        constants = pack_each(models)
        for k, i in enumerate(which):
            forcing = tracks.forcings[i]
            if isinstance(forcing, Loop):
                limit_loop(constants[k : k + 1], forcing, models[k])
        laid = tracks.about, tracks.rows, tracks.edges
        compiled.tracks_solver()(constants, np.asarray(which), np.asarray(lanes), *laid, t, rtol, atol, out)

    def _driven(self, which: Sequence[int], models: Sequence[Model]) -> tuple[Tracks, Sequence[int]]:
        """These jumps as their drives move them: each with each of its drives is a track of its own, at the jump's
        times."""
        asked = [(i, drive_of(m)) for i, m in zip(which, models)]
        each = dict(zip(asked, models))
        known = self.played  # other threads may begin another one
        stops = [float(self.about["stop"][i]) for i, _ in each]
        motions = {
            a: known[a] if a in known else laid(played(m, self.forcings[a[0]]), stop)
            for (a, m), stop in zip(each.items(), stops)
        }
        out = Tracks(list(motions.values()), stops, [self.t[self.places[i]] for i, _ in each])
        out.about[["time", "time_end"]] = self.about[["time", "time_end"]][[i for i, _ in each]]
        number = {a: k for k, a in enumerate(each)}
        self.played = motions if len(known) > MOST_PLAYED else {**known, **motions}
        return out, [number[a] for a in asked]
