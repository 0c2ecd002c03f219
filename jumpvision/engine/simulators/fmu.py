"""A functional mock-up unit (FMI 1 to 3) as the function of a study."""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError, closest
from jumpvision.engine.study.study import Recording

from .values import track_of, value_of


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
        tracks = {place: track_of(name, p, r) for place, name in self.drive.items()}
        every = np.unique(np.concatenate([t for t, _ in tracks.values()])) if tracks else np.empty(0)
        columns = {place: np.interp(every, t, x) for place, (t, x) in tracks.items()}
        given = np.array([*zip(every, *columns.values())], [(n, float) for n in ("time", *columns)]) if tracks else None
        dt = float(np.min(np.diff(r.t)))
        step = dt / math.ceil(dt / self.step - 1e-9) if self.step else dt
        result = simulate(
            folder,
            model_description=description,
            start_time=float(r.t[0]),
            stop_time=float(r.t[-1]) + step,
            output_interval=step,
            step_size=step,
            start_values={place: value_of(name, p, r) for place, name in self.model.items()},
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
    time of the recording, or (times, values). step [s]: longest step between outputs, default the recording's shortest;
    between outputs values are straight lines. Times are the recording's. Raises InputError for a variable that there is
    not.

    Example: jv.from_fmu("axis.fmu", {"angle": "load.phi"}, model={"load.J": "inertia"}, drive={"tau": "torque"})
    """
    made = Fmu(str(file), dict(channels), model or {}, drive or {}, step)
    _, description, _ = _unpacked(made.file)
    known = [v.name for v in description.modelVariables]
    asked = [*made.channels.values(), *made.model, *made.drive]
    if missing := [n for n in asked if n not in known]:
        raise InputError([f"{file}: no variable {n!r} ({len(known)} are there){closest(n, known)}" for n in missing])
    return made


@functools.lru_cache(maxsize=8)
def _unpacked(file: str) -> tuple[str, Any, Any]:
    """Where the unit lies unpacked as long as this process lives, its description, what simulates it."""
    try:
        import fmpy
    except ImportError as e:
        raise InputError(["from_fmu needs FMPy; install it with: pip install 'jumpvision[fmu]'"]) from e
    import atexit
    import shutil

    try:
        description = fmpy.read_model_description(file)
        folder = fmpy.extract(file)
    except Exception as e:  # FMPy raises many kinds
        raise InputError([f"{file}: no FMU that can be read ({e}); export it again"]) from None
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder, description, fmpy.simulate_fmu
