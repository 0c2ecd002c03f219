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

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError, closest
from jumpvision.engine.study.study import Recording

from .values import series_of, value_of

PLACE = re.compile(r"(\w+)\.([^.]+)(?:\.(\w+?))?(?:\[(\d+)\])?")  # joint.z.damping, body.foot.xpos[2], sensor.height


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
        data = mujoco.MjData(model)
        read = {c: _reader(data, place) for c, place in self.channels.items()}
        state = {s: _reader(data, place) for s, place in self.symbols.items()}
        drives = [(_writer(data, place), series_of(name, p, r)) for place, name in self.drive.items()]
        acts = _writer(data, self.law) if self.law else None
        for place, name in self.start.items():
            _writer(data, place)(value_of(name, p, r))

        def control(_: Any, now: Any) -> None:  # at every stage of a step: neither drive nor law lags by half of one
            for write, at in drives:
                write(at(r.t[0] + now.time))
            if acts is not None and force is not None:
                acts(force(**{s: get() for s, get in state.items()}))

        longest, out = model.opt.timestep, np.empty((r.t.size, len(read)))
        said: list[str] = []
        mujoco.set_mju_user_warning(said.append)  # else it writes a file into the working folder
        mujoco.set_mjcb_control(control)
        try:
            for i, dt in enumerate(np.diff(r.t, prepend=r.t[0])):
                steps = math.ceil(dt / longest - 1e-9)
                model.opt.timestep = dt / steps if steps else longest  # a step ends at every sample
                for _ in range(steps):
                    mujoco.mj_step(model, data)
                mujoco.mj_forward(model, data)
                out[i] = [get() for get in read.values()]
                if unstable := [w for w in said if "unstable" in w]:  # MuJoCo starts anew then and goes on
                    raise RuntimeError(f"{unstable[0]} Shorten the timestep of the XML")
        finally:
            mujoco.set_mjcb_control(None)
            mujoco.set_mju_user_warning(None)
        return dict(zip(read, out.T))


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

    Every sample is the end of a step; none is longer than the XML's timestep. `integrator="RK4"` in the XML is to be
    preferred: MuJoCo's default lags half a step in free flight. Raises InputError for a place that there is not, and
    RuntimeError in a run that becomes unstable.

    Example: jv.from_mujoco("arm.xml", {"angle": "joint.hip.qpos"}, model={"joint.hip.damping": "b"})
    """
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
    try:
        import mujoco
    except ImportError as e:
        raise InputError(["from_mujoco needs MuJoCo; install it with: pip install 'jumpvision[mujoco]'"]) from e
    return mujoco


@functools.lru_cache(maxsize=8)
def _spec(xml: str, places: tuple[str, ...]) -> Any:
    """The model before it is compiled, for runs that all set the same places."""
    load = _mujoco().MjSpec.from_string if "<" in xml else _mujoco().MjSpec.from_file
    try:
        return load(xml)
    except ValueError as e:
        raise InputError([f"the MuJoCo model {xml[:60]!r} cannot be read: {e}"]) from None


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
