"""The axes of a sweep: what each option means, its unit and range, LO:HI:N as an array; laws of the bed from a file."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.experiment.inputs.model import tables_of
from jumpvision.jumper.physics.packing import Laws, laws_from

MOST = 100_000_000  # points of one sweep
SAND = ("granular",)


@dataclass(frozen=True)
class Axis:
    """One option: unit, meaning and range in files and calls; its name and the unit it is shown in, factor x SI."""

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


AXES = {
    "frequency": Axis("Hz", "forcing frequency (of the first half cycle, with frequency2)", "frequency", "Hz"),
    "phase": Axis("rad", "start phase of the law", "phase", "π", 1 / math.pi, lo=-math.inf),
    "amplitude": Axis("m", "forcing amplitude A", "amplitude", "mm", 1e3),
    "delay": Axis("s", "pause between the half cycles", "delay", "ms", 1e3, open_lo=False),
    "dwell_gain": Axis(
        "",
        "position gain in the pause / normal gain; below 1 the [motor] loop drives",
        "dwell gain",
        hi=1.0,
        open_lo=False,
        grounds=SAND,
    ),
    "frequency2": Axis("Hz", "frequency of the second half cycle", "second frequency", "Hz"),
    "cycles": Axis("", "number of forcing cycles", "cycles"),
    "alpha": Axis("", "M g/(k A); sets the amplitude, or gravity where the amplitude is given", "α"),
    "gravity": Axis("m/s^2", "gravity along the rail", "gravity", "m/s²"),
    "rod_mass": Axis("kg", "mass of the rod; the total mass is kept unless motor_mass is given", "rod mass", "kg"),
    "motor_mass": Axis("kg", "mass of the motor", "motor mass", "kg"),
    "stiffness": Axis("N/m", "stiffness of the spring", "stiffness", "kN/m", 1e-3),
    "zeta": Axis("", "damping ratio c / (2 sqrt(k M))", "ζ", open_lo=False),
    "phi": Axis("", "volume fraction of the bed", "volume fraction φ", lo=0.3, hi=0.8, open_lo=False, grounds=SAND),
    "apex": Axis("m", "height that a plan is made for", "planned height", "mm", 1e3, grounds=SAND),
    "foot_radius": Axis("m", "radius of the foot", "foot radius", "mm", 1e3, grounds=SAND),
}


def option(name: str) -> str:
    """How a person types an axis: rod_mass is --rod-mass."""
    return "--" + name.replace("_", "-")


def read_axes(ground: str, given: Mapping[str, str]) -> dict[str, Array]:
    """Options as typed to arrays, in their order: shape () for a value, (n,) for LO:HI:N. InputError names them all."""
    out, problems = {}, []
    for name, text in given.items():
        axis, at = AXES[name], f"{option(name)} {text}"
        if ground not in axis.grounds:
            problems.append(f"{at}: has no meaning on {ground} ground; leave it out")
            continue
        parts = text.split(":")
        try:
            if len(parts) not in (1, 3):
                raise ValueError
            ends = [float(p) for p in parts[:2]]
            count = int(parts[2]) if len(parts) == 3 else 1
        except ValueError:
            problems.append(
                f"{at}: must be one value or LO:HI:N with a whole number N, in {axis.unit or 'no unit'} "
                f"({axis.meaning}); e.g. {option(name)} 1:2:50"
            )
            continue
        bad = [e for e in ends if not axis.holds(e)]
        if bad:
            problems.append(f"{at}: {bad[0]:g} must be {axis.allowed} ({axis.meaning})")
        elif len(parts) == 1:
            out[name] = np.asarray(ends[0])
        elif count < 2 or count > MOST or not ends[0] < ends[1]:
            problems.append(f"{at}: must be LO:HI:N with LO < HI and 2 <= N <= {MOST}; for one value give the value")
        else:
            out[name] = np.linspace(ends[0], ends[1], count)
    if not problems and (total := math.prod(a.size for a in out.values())) > MOST:
        problems.append(
            f"{' '.join(f'{option(n)} {given[n]}' for n in given)}: {total:g} points; at most {MOST}: use fewer"
        )
    if problems:
        raise InputError(problems)
    return out


__all__ = ["EXAMPLE", "Laws", "read_laws"]

EXAMPLE = Path(__file__).with_name("example_laws.toml")


def read_laws(file: Path) -> Laws:
    """The laws of a file. InputError with every problem."""
    table = tables_of(file)
    model = table.get("model")
    table = model["laws"] if isinstance(model, dict) and isinstance(model.get("laws"), dict) else table
    laws, problems = laws_from({"source": file.name, **table}, str(file))
    if laws is None:
        raise InputError(problems)
    return laws
