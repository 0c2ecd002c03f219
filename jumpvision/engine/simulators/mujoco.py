"""A MuJoCo model as the function of a study."""

from __future__ import annotations

import functools
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.base.extras import require_extra
from jumpvision.base.schema import InputError, closest
from jumpvision.engine.study.study import Recording

from .values import track_of, value_of

PLACE = re.compile(r"(\w+)\.([^.]+)(?:\.(\w+?))?(?:\[(\d+)\])?")  # joint.z.damping, body.foot.xpos[2], sensor.height
TINY = 1e-9  # of a step: a drive is read within it, and times that differ by less are one


@dataclass(frozen=True)
class MujocoModel:
    """`simulate` of a study, see `from_mujoco`; it can be sent to other processes."""

    xml: str
    channels: Mapping[str, str]
    model: Mapping[str, str]
    start: Mapping[str, str]
    drive: Mapping[str, str]
    law: str
    symbols: Mapping[str, str]

    @property
    def version(self) -> str:
        """All that its numbers depend on, for the key of runs that are kept."""
        text = self.xml if "<" in self.xml else Path(self.xml).read_text(encoding="utf-8")
        return repr((text, self.channels, self.model, self.start, self.drive, self.law, self.symbols))

    def __call__(
        self, p: Mapping[str, float], r: Recording, force: Callable[..., float] | None = None
    ) -> dict[str, Array]:
        mujoco, spec = _mujoco(), _spec(self.xml, tuple(self.model))
        for place, name in self.model.items():
            _set(_element(spec, place), place, value_of(name, p, r))
        model = spec.compile()
        # MuJoCo counts a delay in steps and begins at zero: here the drives' own times are late, and sensors read later
        lags = {place: _delay(model, place) for place in (*self.channels.values(), *self.drive, self.law) if place}
        if lags.get(self.law):
            raise InputError([f"law: {self.law!r} has a delay of {lags[self.law]:g} s; a law acts at once"])
        _remove_delays(model)
        exact, lag = mujoco.mjtDyn.mjDYN_FILTEREXACT, mujoco.mjtDyn.mjDYN_FILTER
        if model.opt.integrator == mujoco.mjtIntegrator.mjINT_RK4:  # whose stages do not see the exact lag's change
            model.actuator_dyntype[model.actuator_dyntype == exact] = lag
        data = mujoco.MjData(model)
        read = {c: _reader(data, place) for c, place in self.channels.items()}
        late = {c: lags[place] for c, place in self.channels.items() if lags[place]}
        state = {s: _reader(data, place) for s, place in self.symbols.items()}
        tracks = {place: track_of(name, p, r) for place, name in self.drive.items()}
        drives = [(_writer(data, place), t + lags[place], x) for place, (t, x) in tracks.items()]
        acts = _writer(data, self.law) if self.law else None
        for place, name in self.start.items():
            _writer(data, place)(value_of(name, p, r))
        longest, begun = model.opt.timestep, 0.0
        ends, samples = _step_ends(r.t, [t[1:][np.diff(t) == 0] for _, t, _ in drives], TINY * longest)

        def control(_: Any, now: Any) -> None:  # at every stage of a step: neither drive nor law lags by half of one
            # a jump of a drive lies between two steps: the last stage of the one before does not see it yet
            h = model.opt.timestep
            at = r.t[0] + begun + min(max(now.time - begun, TINY * h), h - TINY * h)
            for write, t, x in drives:
                write(float(np.interp(at, t, x)))
            if acts is not None and force is not None:
                acts(force(**{s: get() for s, get in state.items()}))

        out = np.empty((ends.size, len(read)))
        trace: list[tuple[float, list[float]]] = []
        said: list[str] = []
        mujoco.set_mju_user_warning(said.append)  # else it writes a file into the working folder
        mujoco.set_mjcb_control(control)
        try:
            for i, dt in enumerate(np.diff(ends, prepend=ends[0])):
                steps = math.ceil(dt / longest - 1e-9)
                model.opt.timestep = dt / steps if steps else longest  # a step ends at every sample and jump
                for _ in range(steps):
                    begun = data.time
                    mujoco.mj_step(model, data)
                    trace.append((begun, [read[c]() for c in late]))  # sensors are those of the beginning of the step
                mujoco.mj_forward(model, data)
                out[i] = [get() for get in read.values()]
                if unstable := [w for w in said if "unstable" in w]:  # MuJoCo starts anew then and goes on
                    raise RuntimeError(f"{unstable[0]} Shorten the timestep of the XML")
        finally:
            mujoco.set_mjcb_control(None)
            mujoco.set_mju_user_warning(None)
        found = dict(zip(read, out[samples].T))
        trace.append((data.time, [read[c]() for c in late]))
        times, values = np.array([t for t, _ in trace]), np.array([v for _, v in trace])
        return found | {c: np.interp(r.t - r.t[0] - late[c], times, values[:, k]) for k, c in enumerate(late)}


def from_mujoco(
    xml: str | Path,
    channels: Mapping[str, str],
    *,
    model: Mapping[str, str] | None = None,
    start: Mapping[str, str] | None = None,
    drive: Mapping[str, str] | None = None,
    law: tuple[str, Mapping[str, str]] = ("", {}),
) -> MujocoModel:
    """A MuJoCo model as the `simulate` of a Study. Needs jumpvision[mujoco].

    xml: the model, as text or a file. A place is KIND.NAME.FIELD or KIND.NAME.FIELD[i] of MuJoCo's own names, in its
    units; FIELD of a sensor may be left out. channels: {channel: place in the data}. model, start, drive: {place:
    name}, of a parameter of the study or an input of the recording. model: fields of the XML's elements, set before it
    is compiled ("joint.hip.damping", "body.foot.mass"; an element must have a name). start: data at recording.t[0]
    ("joint.hip.qpos"). drive: data over time ("actuator.motor.ctrl"; a number, one a time of the recording, or (times,
    values)). law: where the study's laws act, and what its symbols are: ("joint.hip.qfrc_applied", {"v":
    "joint.hip.qvel"}).

    Every sample and every jump of a drive (two rows of one time) is the end of a step; none is longer than the XML's
    timestep. `integrator="RK4"` in the XML is to be preferred: MuJoCo's default lags half a step in free flight. Delays
    of actuators and sensors are taken in continuous time, whatever the XML's nsample; before the start they held what
    they hold at the start. `dampratio` becomes a gain as the XML is compiled, by that run's masses: a fit of a mass
    changes the servo's damping with it, unless the XML gives kv. Raises InputError for a place that there is not and
    for a sensor among the symbols of a law, which RK4 does not compute anew within a step; RuntimeError in a run that
    becomes unstable.

    Example: jv.from_mujoco("arm.xml", {"angle": "joint.hip.qpos"}, model={"joint.hip.damping": "b"})
    """
    if sensed := [place for place in law[1].values() if place.startswith("sensor.")]:
        raise InputError([f"law: {p!r}: a law reads the state, as joint.NAME.qvel, body.NAME.xpos[2]" for p in sensed])
    made = MujocoModel(str(xml), dict(channels), model or {}, start or {}, drive or {}, law[0], dict(law[1]))
    spec = _spec(made.xml, tuple(made.model))
    for place in made.model:
        _set(_element(spec, place), place, None)
    compiled = spec.compile()
    data = _mujoco().MjData(compiled)
    for place in (*channels.values(), *made.start, *made.drive, *filter(None, [made.law]), *made.symbols.values()):
        _reader(data, place)()
    return made


def _mujoco() -> Any:
    with require_extra("mujoco", "from_mujoco", "mujoco"):
        import mujoco
    return mujoco


@functools.lru_cache(maxsize=8)
def _spec(xml: str, places: tuple[str, ...]) -> Any:
    """The model before it is compiled, for runs that all set the same places."""
    load = _mujoco().MjSpec.from_string if "<" in xml else _mujoco().MjSpec.from_file
    try:
        return load(xml)
    except ValueError as e:
        raise InputError([f"the MuJoCo model {xml[:60]!r} cannot be read: {e}"]) from None


def _step_ends(t: Array, jumps: Sequence[Array], least: float) -> tuple[Array, NDArray[np.intp]]:
    """Return where steps end, at all times t (n,) [s] and the jumps between them, and which of these are t's."""
    ends = np.unique(np.concatenate([t, *jumps]))
    ends = ends[(ends >= t[0]) & (ends <= t[-1]) & (np.diff(ends, append=math.inf) > least)]
    return ends, np.searchsorted(ends, t - least)


def _delay(model: Any, place: str) -> float:
    """Return the delay [s] of the actuator or sensor at a place; 0 at another place."""
    kind, name, field, _ = _parts(place)
    if (kind, field) not in (("actuator", "ctrl"), ("sensor", "data")) or not hasattr(model, "actuator_delay"):
        return 0.0  # MuJoCo before 3.5 has no delays
    return float(getattr(model, f"{kind}_delay")[getattr(model, kind)(name).id])


def _remove_delays(model: Any) -> None:
    """Take all delays out of a compiled model; sensors with a period still hold their values."""
    if hasattr(model, "actuator_delay"):
        model.actuator_history[:, 0] = 0
        model.sensor_history[model.sensor_interval[:, 0] <= 0, 0] = 0
        model.sensor_delay[:] = 0.0


def _parts(place: str) -> tuple[str, str, str, int]:
    match = PLACE.fullmatch(place)
    if not match:
        raise InputError([f"{place!r}: a place is KIND.NAME.FIELD or KIND.NAME.FIELD[i], as 'joint.hip.qpos'"])
    kind, name, field, index = match.groups()
    return kind, name, field or ("data" if kind == "sensor" else ""), int(index or 0)


def _element(spec: Any, place: str) -> Any:
    """An element of the XML."""
    kind, name, _, _ = _parts(place)
    if kind == "option":
        return spec.option
    find = getattr(spec, kind, None)
    if not callable(find):
        raise InputError([f"{place!r}: MuJoCo has no {kind!r} with a name"])
    element = find(name)
    if element is None:
        names = [e.name for e in getattr(spec, {"body": "bodies"}.get(kind, f"{kind}s")) if e.name]
        raise InputError(
            [f"{place!r}: the model has no {kind} called {name!r} ({', '.join(names) or 'none has a name'})"]
        )
    return element


def _set(element: Any, place: str, value: float | None) -> None:
    """A field of an element; None: only whether there is one."""
    kind, name, field, index = _parts(place)
    field = name if kind == "option" else field
    old = getattr(element, field, None)
    if old is None or not np.size(old) > index:
        raise InputError([f"{place!r}: {kind} has no {field}[{index}]{closest(field, _fields(element))}"])
    if kind == "body" and field in ("mass", "inertia") and not element.explicitinertial:
        raise InputError([f"{place!r}: its geoms give this body its mass; set geom.NAME.mass, or give it <inertial>"])
    if value is not None and np.ndim(old):
        old[index] = value
    elif value is not None:
        setattr(element, field, value)


def _fields(element: Any) -> Sequence[str]:
    return [n for n in dir(element) if not n.startswith("_")]


def _array(data: Any, place: str) -> tuple[Array, int]:
    kind, name, field, index = _parts(place)
    try:
        element = getattr(data, kind)(name)
    except (AttributeError, KeyError, TypeError) as e:
        raise InputError([f"{place!r}: {str(e).strip() or 'not in the data of the model'}"]) from None
    values = np.asarray(getattr(element, field, None))
    if values.dtype == object or not values.size > index:
        near = closest(field, _fields(element))
        raise InputError([f"{place!r}: the data of a {kind} have no {field}[{index}]{near}"])
    return values.reshape(-1), index


def _reader(data: Any, place: str) -> Callable[[], float]:
    values, k = _array(data, place)
    return lambda: float(values[k])


def _writer(data: Any, place: str) -> Callable[[float], None]:
    values, k = _array(data, place)

    def write(value: float) -> None:
        values[k] = value

    return write
