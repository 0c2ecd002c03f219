"""A functional mock-up unit (FMI 1 to 3) as the function of a study."""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.extras import require_extra
from jumpvision.base.schema import InputError, closest
from jumpvision.engine.study.study import Recording

from .values import step_means, track_of, value_of

PARTS = 4  # steps of a driven unit from sample to sample: what is left of holding its inputs falls with their square
REALS = ("Real", "Float32", "Float64")  # FMPy cuts what is given to another type down to a whole number


@dataclass(frozen=True)
class Fmu:
    """`simulate` of a study, see `from_fmu`; it can be sent to other processes."""

    file: str
    channels: Mapping[str, str]
    model: Mapping[str, str]
    drive: Mapping[str, str]
    step: float | None

    @property
    def version(self) -> str:
        """All that its numbers depend on, for the key of runs that are kept."""
        digest = hashlib.sha256(Path(self.file).read_bytes()).hexdigest()
        return repr((digest, self.channels, self.model, self.drive, self.step))

    def __call__(self, p: Mapping[str, float], r: Recording) -> dict[str, Array]:
        folder, description, simulate = _unpacked(self.file)
        dt = float(np.min(np.diff(r.t)))
        unit = description.coSimulation
        parts = PARTS if self.drive and unit is not None and unit.canHandleVariableCommunicationStepSize else 1
        step = dt / (math.ceil(dt / self.step - 1e-9) if self.step else parts)
        n = math.ceil((r.t[-1] - r.t[0]) / step - 1e-9) + 2
        ends = r.t[0] + step * np.arange(n + 1)
        variables = {v.name: v for v in description.modelVariables}
        start = {place: value_of(name, p, r) for place, name in self.model.items()}
        tracks = {place: track_of(name, p, r) for place, name in self.drive.items()}
        every = _times_with_jumps([t for t, _ in tracks.values()]) if unit is None else ends[:-1]
        columns: dict[str, Array] = {}
        for place, (t, x) in tracks.items():
            if variables[place].type not in REALS or variables[place].variability in ("discrete", "tunable"):
                columns[place] = x[np.maximum(np.searchsorted(t, every + 1e-6 * step, side="right") - 1, 0)]
            elif unit is not None:  # an input is held over a step: its mean does not lag by half of one
                columns[place] = step_means(t, x, ends)
            else:
                first = np.diff(every, append=math.inf) == 0.0  # of the two rows of a jump
                columns[place] = np.where(first, np.interp(-every, -t[::-1], x[::-1]), np.interp(every, t, x))
        asked: dict[str, Any] = {**start, **columns}
        for place, value in asked.items():
            if variables[place].type not in REALS and np.any(value != np.round(value)):
                kind, name = variables[place].type, {**self.model, **self.drive}[place]
                raise InputError([f"{self.file}: {place} is of type {kind}: {name!r} must be a whole number there"])
        rows = [*zip(every, *columns.values())]
        given = np.array(rows, [(name, float) for name in ("time", *columns)]) if columns else None
        result = simulate(
            folder,
            model_description=description,
            start_time=float(r.t[0]),
            stop_time=float(r.t[-1]) + step,
            output_interval=step,
            step_size=step,
            start_values=start,
            input=given,
            output=[*self.channels.values()],
        )
        return {c: np.interp(r.t, result["time"], result[place]) for c, place in self.channels.items()}


def from_fmu(
    file: str | Path,
    channels: Mapping[str, str],
    *,
    model: Mapping[str, str] | None = None,
    drive: Mapping[str, str] | None = None,
    step: float | None = None,
) -> Fmu:
    """A functional mock-up unit (OpenModelica, Dymola, Simulink) as the `simulate` of a Study. Needs jumpvision[fmu].

    channels: {channel: variable of the FMU}. model: {variable: name}, values at the start, parameters and states alike,
    of a parameter of the study or an input of the recording; drive: {input variable: name}, over time: a number, one a
    time of the recording, or (times, values); two rows of one time are a jump. step [s]: longest step, default the
    recording's shortest, or a quarter of it in a driven unit that may be stepped so; between steps outputs are straight
    lines. Times are the recording's. A unit for co-simulation holds an input over a step: it is given the mean of the
    step, and the error falls with the square of `step`. Raises InputError for a variable that there is not, or that
    cannot be set so.

    Example: jv.from_fmu("axis.fmu", {"angle": "load.phi"}, model={"load.J": "inertia"}, drive={"tau": "torque"})
    """
    made = Fmu(str(file), dict(channels), model or {}, drive or {}, step)
    _, description, _ = _unpacked(made.file)
    known = [v.name for v in description.modelVariables]
    asked = [*made.channels.values(), *made.model, *made.drive]
    if missing := [n for n in asked if n not in known]:
        raise InputError([f"{file}: no variable {n!r} ({len(known)} are there){closest(n, known)}" for n in missing])
    variables = {v.name: v for v in description.modelVariables}
    no_start = [n for n in made.model if not _takes_start(variables[n], description.fmiVersion)]
    no_input = [n for n in made.drive if (v := variables[n]).causality != "input" and v.variability != "tunable"]
    if no_start or no_input:
        raise InputError(
            [
                *(f"{file}: model: {n} ({variables[n].causality}) takes no value at the start" for n in no_start),
                *(f"{file}: drive: {n} ({variables[n].causality}) is no input of the unit" for n in no_input),
            ]
        )
    return made


def _takes_start(variable: Any, version: str) -> bool:
    """Return True where FMPy can give a variable its value at the start."""
    from fmpy import simulation

    if version == "1.0":
        return bool(simulation.has_start_value(variable))
    return bool(simulation.settable_in_instantiated(variable) or simulation.settable_in_initialization_mode(variable))


def _times_with_jumps(times: Sequence[Array]) -> Array:
    """Merge the times of these series: each once, twice where one of them has a jump."""
    if not times:
        return np.empty(0)
    jumps = [t[1:][np.diff(t) == 0.0] for t in times]
    return np.sort(np.concatenate([np.unique(np.concatenate(times)), np.unique(np.concatenate(jumps))]))


@functools.lru_cache(maxsize=8)
def _unpacked(file: str) -> tuple[str, Any, Any]:
    """Where the unit lies unpacked as long as this process lives, its description, what simulates it."""
    with require_extra("fmpy", "from_fmu", "fmu"):
        import fmpy
    import atexit
    import shutil

    try:
        description = fmpy.read_model_description(file)
        folder = fmpy.extract(file)
    except Exception as e:  # FMPy raises many kinds
        raise InputError([f"{file}: no FMU that can be read ({e}); export it again"]) from None
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder, description, fmpy.simulate_fmu
