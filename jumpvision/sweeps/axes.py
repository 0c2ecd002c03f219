"""The axes of a sweep: what each option means, its unit and range, LO:HI:N as an array; laws of the bed from a file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError, closest
from jumpvision.experiment.inputs.model import tables_of
from jumpvision.jumper.physics.packing import Laws, laws_from

MOST_POINTS = 100_000_000  # of one sweep: 6 GB of results
SAND = ("granular",)


@dataclass(frozen=True)
class Axis:
    """One option: unit, meaning and range in files and calls; its label and the unit it is shown in, factor x SI."""

    name: str
    unit: str
    meaning: str
    label: str
    shown: str = ""
    factor: float = 1.0
    lo: float = 0.0
    hi: float = math.inf
    open_lo: bool = True
    grounds: tuple[str, ...] = ("hard", "granular")

    @property
    def allowed(self) -> str:
        unit = f" {self.unit}" if self.unit else ""
        if math.isinf(self.lo):
            return f"a finite number{unit and ' in' + unit}"
        if math.isinf(self.hi):
            return f"{'>' if self.open_lo else '>='} {self.lo:g}{unit}"
        return f"in {'(' if self.open_lo else '['}{self.lo:g}, {self.hi:g}]{unit}"

    def text(self, value: float, digits: int) -> str:
        """frequency 8.2 Hz."""
        return f"{self.label} {value * self.factor:.{digits}g} {self.shown}".rstrip()

    def holds(self, value: float) -> bool:
        low = value > self.lo if self.open_lo else value >= self.lo
        return math.isfinite(value) and low and value <= self.hi


_DECLARED = (
    Axis("frequency", "Hz", "forcing frequency (of the first half cycle, with frequency2)", "frequency", "Hz"),
    Axis("phase", "rad", "start phase of the law", "phase", "π", 1 / math.pi, lo=-math.inf),
    Axis("amplitude", "m", "forcing amplitude A", "amplitude", "mm", 1e3),
    Axis("delay", "s", "pause between the half cycles", "delay", "ms", 1e3, open_lo=False),
    Axis(
        "dwell_gain",
        "",
        "position gain in the pause / normal gain; below 1 the [motor] loop drives",
        "dwell gain",
        hi=1.0,
        open_lo=False,
        grounds=SAND,
    ),
    Axis("frequency2", "Hz", "frequency of the second half cycle", "second frequency", "Hz"),
    Axis("cycles", "", "number of forcing cycles", "cycles"),
    Axis("alpha", "", "M g/(k A); sets the amplitude, or gravity where the amplitude is given", "α"),
    Axis("gravity", "m/s^2", "gravity along the rail", "gravity", "m/s²"),
    Axis("rod_mass", "kg", "mass of the rod; the total mass is kept unless motor_mass is given", "rod mass", "kg"),
    Axis("motor_mass", "kg", "mass of the motor", "motor mass", "kg"),
    Axis("stiffness", "N/m", "stiffness of the spring", "stiffness", "kN/m", 1e-3),
    Axis("zeta", "", "damping ratio c / (2 sqrt(k M))", "ζ", open_lo=False),
    Axis("phi", "", "volume fraction of the bed", "volume fraction φ", lo=0.3, hi=0.8, open_lo=False, grounds=SAND),
    Axis("foot_radius", "m", "radius of the foot", "foot radius", "mm", 1e3, grounds=SAND),
)
AXES = {axis.name: axis for axis in _DECLARED}


def option(name: str) -> str:
    """Return an axis as its option: rod_mass is --rod-mass."""
    return "--" + name.replace("_", "-")


Value = str | float | tuple[float, float, int] | ArrayLike  # of an axis: see `read_axes`


def read_axes(ground: str, given: Mapping[str, Value]) -> dict[str, Array]:
    """Return the axes in their order: shape () for one value, (n,) for several. InputError names every problem.

    An axis is one number, an array of values, a tuple (low, high, number) of equal steps, or "LOW:HIGH:NUMBER". A tuple
    is always the latter; give three values of one's own as an array or a list.
    """
    out, problems = {}, []
    for name, value in given.items():
        if name not in AXES:
            problems.append(f"{option(name)}: no axis of a sweep{closest(name, AXES)}")
            continue
        values, why = _values(AXES[name], value)
        if ground not in AXES[name].grounds:
            why = f"has no meaning on {ground} ground; leave it out"
        if why or values is None:
            problems.append(f"{option(name)} {_text(value)}: {why}")
        else:
            out[name] = values
    if not problems and (total := math.prod(a.size for a in out.values())) > MOST_POINTS:
        asked = " ".join(f"{option(n)} {_text(given[n])}" for n in given)
        problems.append(f"{asked}: {total:g} points; at most {MOST_POINTS}: use fewer")
    if problems:
        raise InputError(problems)
    return out


def _text(value: Value) -> str:
    """Return a value as its option has it: LOW:HIGH:NUMBER, or a number."""
    return ":".join(map(str, value)) if isinstance(value, tuple) else str(value)


def _values(axis: Axis, value: Value) -> tuple[Array | None, str]:
    """Values of an axis, or why there are none."""
    form = (
        f"must be one value or LO:HI:N with a whole number N, in {axis.unit or 'no unit'} ({axis.meaning}); "
        f"e.g. {option(axis.name)} 1:2:50"
    )
    try:
        if isinstance(value, str | tuple):
            parts = value.split(":") if isinstance(value, str) else [str(x) for x in value]
            if len(parts) not in (1, 3):
                return None, form
            ends, count = [float(p) for p in parts[:2]], int(parts[2]) if len(parts) == 3 else 1
        else:
            values = np.asarray(value, float)
            ends, count = values.ravel().tolist(), 0
    except (TypeError, ValueError):
        return None, form
    if bad := [e for e in ends if not axis.holds(e)]:
        return None, f"{bad[0]:g} must be {axis.allowed} ({axis.meaning})"
    if count == 0:
        return (
            (values, "") if values.size and values.ndim < 2 else (None, "must be one value or an array (n,) of values")
        )
    if len(parts) == 1:
        return np.asarray(ends[0]), ""
    if count < 2 or count > MOST_POINTS or not ends[0] < ends[1]:
        return None, f"must be LO:HI:N with LO < HI and 2 <= N <= {MOST_POINTS}; for one value give the value"
    return np.linspace(ends[0], ends[1], count), ""


def read_laws(file: Path) -> Laws:
    """Read the laws of a file. Raises InputError with every problem."""
    table = tables_of(file)
    model = table.get("model")
    table = model["laws"] if isinstance(model, dict) and isinstance(model.get("laws"), dict) else table
    laws, problems = laws_from({"source": file.name, **table}, str(file))
    if laws is None:
        raise InputError(problems)
    return laws
