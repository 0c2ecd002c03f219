"""What the page shows to be set: the sliders of each ground and the jump types, with their words and ranges.

A slider's range is what is worth trying; what is allowed at all is declared with the key itself (`sections`,
`mechanisms`) and checked when the jump is asked for.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from jumpvision.inputs.sections import PHASES, Actuation, Bed, Robot
from jumpvision.mechanisms.registry import ModelParameters
from jumpvision.studies.machine import THESIS

SECTIONS: dict[str, Any] = {"robot": Robot, "actuation": Actuation, "bed": Bed, "model": ModelParameters}
GROUNDS = ("hard", "granular")
SAND = {  # name of a law of the bed: its terms
    "cone": ("two_resistance", "depth_drag", "added_mass"),
    "drag": ("two_resistance", "inertial_drag"),
}


@dataclass(frozen=True)
class Slider:
    """One number of an experiment.toml. shown = value in SI units * factor, in `unit`; range and step as shown."""

    section: str
    key: str
    label: str
    unit: str
    lo: float
    hi: float
    step: float
    factor: float = 1.0
    group: str = "Motor"
    only: str = ""  # "hard", "granular", or a law of SAND: where it is shown

    @property
    def meaning(self) -> str:
        if self.key == "frequency2":
            return "frequency of the second half cycle"
        return str(SECTIONS[self.section].__dataclass_fields__[self.key].metadata["meaning"])


def _motor(key: str, label: str, unit: str, lo: float, hi: float, step: float, factor: float = 1.0) -> Slider:
    return Slider("actuation", key, label, unit, lo, hi, step, factor)


def _robot(key: str, label: str, unit: str, lo: float, hi: float, step: float) -> Slider:
    return Slider("robot", key, label, unit, lo, hi, step, group="Robot")


def _bed(
    key: str,
    label: str,
    unit: str,
    lo: float,
    hi: float,
    step: float,
    factor: float = 1.0,
    only: str = "",
    section: str = "model",
) -> Slider:
    return Slider(section, key, label, unit, lo, hi, step, factor, "Ground", only)


SLIDERS = (
    _motor("frequency", "frequency f", "Hz", 1.0, 24.0, 0.05),
    _motor("phase", "phase", "π rad", 0.0, 2.0, 0.01, 1.0 / math.pi),
    _motor("amplitude", "amplitude A", "mm", 0.5, 30.0, 0.05, 1e3),
    _motor("cycles", "cycles", "", 1.0, 10.0, 1.0),
    _motor("delay", "delay", "ms", 0.0, 800.0, 5.0, 1e3),
    _motor("frequency2", "second half f₂", "Hz", 1.0, 24.0, 0.05),
    _robot("motor_mass", "motor mass", "kg", 0.1, 3.0, 0.005),
    _robot("rod_mass", "rod mass", "kg", 0.01, 1.0, 0.005),
    _robot("foot_mass", "foot mass", "kg", 0.0, 0.3, 0.005),
    _robot("spring_stiffness", "stiffness k", "N/m", 500.0, 12000.0, 10.0),
    _robot("spring_damping", "damping c", "N s/m", 0.0, 40.0, 0.05),
    _robot("gravity", "gravity g", "m/s²", 0.5, 20.0, 0.01),
    _bed("e", "landing loss e", "", 0.0, 0.95, 0.01, only="hard"),
    _bed("k1", "resistance k₁", "N/m", 300.0, 8000.0, 10.0, only="granular"),
    _bed("k2", "resistance k₂", "N/m", 300.0, 8000.0, 10.0, only="granular"),
    _bed("delta", "bend at depth δ", "mm", 0.0, 50.0, 0.5, 1e3, only="granular"),
    _bed("alpha", "drag α", "kg/m", 0.0, 300.0, 1.0, only="drag"),
    _bed("C", "cone mass C", "", 0.0, 8.0, 0.05, only="cone"),
    _bed("mu", "cone growth μ", "", 0.2, 5.0, 0.05, only="cone"),
    _bed("theta", "cone angle θ", "°", 30.0, 80.0, 0.5, 180.0 / math.pi, only="cone"),
    _bed("b", "drag scale b", "", 0.0, 40.0, 0.1, only="cone"),
    _bed("volume_fraction", "volume fraction φ", "", 0.5, 0.66, 0.001, only="cone", section="bed"),
    Slider("robot", "foot_radius", "foot radius R", "mm", 10.0, 80.0, 0.1, 1e3, "Ground", "cone"),
)

PRESETS: dict[str, dict[str, dict[str, Any]]] = {  # ground -> jump type -> [actuation]; f where each jumps high
    ground: {
        kind: {"kind": kind, "phase": PHASES[kind], "frequency": f, "cycles": 1.0, "delay": delay}
        for kind, f, delay in kinds
    }
    for ground, kinds in {
        "hard": (("single", 17.1, 0.0), ("stutter", 8.2, 0.0), ("delayed_stutter", 11.0, 0.05)),
        "granular": (("single", 9.0, 0.0), ("stutter", 5.0, 0.0), ("delayed_stutter", 7.0, 0.1)),
    }.items()
}


def defaults(ground: str) -> dict[str, dict[str, Any]]:
    """The sections of the thesis' robot on this ground, with a value for every slider shown."""
    tables = {name: dict(table) for name, table in THESIS[ground].items()}
    stutter = PRESETS[ground]["stutter"]
    tables["actuation"] |= stutter | {"frequency": THESIS[ground]["actuation"]["frequency"]}
    tables["robot"].setdefault("foot_mass", 0.0)
    if ground == "hard":
        tables["model"] = {"terms": ("landing_loss",), "e": 0.0}
    else:
        tables["model"] |= {"alpha": 73.0}
    return tables


def page() -> dict[str, Any]:
    """All that the page is built from, as JSON; `colours` is the map's, 256 of them."""
    import matplotlib

    colours = matplotlib.colormaps["viridis"]
    return {
        "grounds": {g: {"defaults": defaults(g), "presets": PRESETS[g]} for g in GROUNDS},
        "sand": SAND,
        "sliders": [asdict(s) | {"meaning": s.meaning} for s in SLIDERS],
        "colours": [[round(255 * c) for c in colours(i)[:3]] for i in range(256)],
    }
