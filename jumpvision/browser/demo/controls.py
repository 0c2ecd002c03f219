"""What the page shows to be set: the sliders of each ground and the jump types, with their ranges (words: words.json).

A slider's range is what is worth trying; what is allowed at all is declared with the key itself (`sections`,
`mechanisms`) and checked when the jump is asked for.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from importlib.resources import files
from typing import Any

from jumpvision.experiment.inputs.sections import PHASES, Actuation, Bed, Robot
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.thesis.studies.setup import THESIS

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
    unit: str
    lo: float
    hi: float
    step: float
    factor: float = 1.0
    group: str = "Motor"
    only: str = ""  # "hard", "granular", or a law of SAND: where it is shown

    @property
    def allowed(self) -> dict[str, float | bool | None]:
        """The declared range of the key, SI units: least and most (null: none), open where `least` itself is out."""
        key = "frequency" if self.key == "frequency2" else self.key
        declared = SECTIONS[self.section].__dataclass_fields__[key].metadata
        least, most = (x if x is not None and math.isfinite(x) else None for x in (declared["lo"], declared["hi"]))
        return {"least": least, "most": most, "open": declared["open_lo"]}


def _motor(key: str, unit: str, lo: float, hi: float, step: float, factor: float = 1.0) -> Slider:
    return Slider("actuation", key, unit, lo, hi, step, factor)


def _robot(key: str, unit: str, lo: float, hi: float, step: float) -> Slider:
    return Slider("robot", key, unit, lo, hi, step, group="Robot")


def _bed(
    key: str,
    unit: str,
    lo: float,
    hi: float,
    step: float,
    factor: float = 1.0,
    only: str = "",
    section: str = "model",
) -> Slider:
    return Slider(section, key, unit, lo, hi, step, factor, "Ground", only)


SLIDERS = (
    _motor("frequency", "Hz", 1.0, 24.0, 0.05),
    _motor("phase", "π rad", 0.0, 2.0, 0.01, 1.0 / math.pi),
    _motor("amplitude", "mm", 0.5, 30.0, 0.05, 1e3),
    _motor("cycles", "", 1.0, 10.0, 1.0),
    _motor("delay", "ms", 0.0, 800.0, 5.0, 1e3),
    _motor("frequency2", "Hz", 1.0, 24.0, 0.05),
    _robot("motor_mass", "kg", 0.1, 3.0, 0.005),
    _robot("rod_mass", "kg", 0.01, 1.0, 0.005),
    _robot("foot_mass", "kg", 0.0, 0.3, 0.005),
    _robot("spring_stiffness", "N/m", 500.0, 12000.0, 10.0),
    _robot("spring_damping", "N s/m", 0.0, 40.0, 0.05),
    _robot("gravity", "m/s²", 0.5, 20.0, 0.01),
    _bed("e", "", 0.0, 0.95, 0.01, only="hard"),
    _bed("k1", "N/m", 300.0, 8000.0, 10.0, only="granular"),
    _bed("k2", "N/m", 300.0, 8000.0, 10.0, only="granular"),
    _bed("delta", "mm", 0.0, 50.0, 0.5, 1e3, only="granular"),
    _bed("alpha", "kg/m", 0.0, 300.0, 1.0, only="drag"),
    _bed("C", "", 0.0, 8.0, 0.05, only="cone"),
    _bed("mu", "", 0.2, 5.0, 0.05, only="cone"),
    _bed("theta", "°", 30.0, 80.0, 0.5, 180.0 / math.pi, only="cone"),
    _bed("b", "", 0.0, 40.0, 0.1, only="cone"),
    _bed("volume_fraction", "", 0.5, 0.66, 0.001, only="cone", section="bed"),
    Slider("robot", "foot_radius", "mm", 10.0, 80.0, 0.1, 1e3, "Ground", "cone"),
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

    words = files(__package__).joinpath("static", "words.json").read_text("utf-8")
    colours = matplotlib.colormaps["viridis"]
    return {
        "grounds": {g: {"defaults": defaults(g), "presets": PRESETS[g]} for g in GROUNDS},
        "sand": SAND,
        "sliders": [asdict(s) | {"allowed": s.allowed} for s in SLIDERS],
        "words": json.loads(words),
        "colours": [[round(255 * c) for c in colours(i)[:3]] for i in range(256)],
    }
