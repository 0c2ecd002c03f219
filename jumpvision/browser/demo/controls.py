"""What the page is made from: the robot on each ground, knobs with their ranges, jump types, colours of the map."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

from jumpvision.experiment.inputs.sections import PHASES
from jumpvision.jumper.physics.model import OF_BED
from jumpvision.jumper.robots import THESIS_ROBOT

GROUNDS = ("hard", "granular")
BED_TERMS: tuple[str, ...] = THESIS_ROBOT["granular"]["model"]["terms"]


@dataclass(frozen=True)
class Knob:
    """One number of the motor's law. lo, hi, step: as shown, in `unit`: the value in SI units times `factor`."""

    key: str
    label: str
    unit: str
    lo: float
    hi: float
    step: float
    factor: float = 1.0


KNOBS = (
    Knob("frequency", "frequency", "Hz", 1.0, 24.0, 0.05),
    Knob("phase", "phase", "π rad", 0.0, 2.0, 0.01, 1.0 / math.pi),
    Knob("amplitude", "amplitude", "mm", 0.5, 30.0, 0.05, 1e3),
    Knob("delay", "delay between the halves", "ms", 0.0, 800.0, 5.0, 1e3),
)

JUMPS = {  # ground -> jump type -> frequency where it jumps high [Hz], delay [s]
    "hard": {"single": (17.1, 0.0), "stutter": (8.2, 0.0), "delayed_stutter": (11.0, 0.05)},
    "granular": {"single": (9.0, 0.0), "stutter": (5.0, 0.0), "delayed_stutter": (7.0, 0.1)},
}


def presets(ground: str) -> dict[str, dict[str, float]]:
    """Give what a jump type sets, by jump type: phase [rad], frequency [Hz], delay [s]."""
    return {kind: {"phase": PHASES[kind], "frequency": f, "delay": delay} for kind, (f, delay) in JUMPS[ground].items()}


def default_jump(ground: str) -> dict[str, Any]:
    """Give the stutter jump of the thesis' robot, SI units: `robot`, with its `bed` by the laws' symbols, and `law`."""
    tables = THESIS_ROBOT[ground]
    robot = {"foot_mass": 0.0, **tables["robot"]}
    if ground == "granular":
        symbols = {symbol: {**robot, **tables["bed"]}[key] for symbol, key in OF_BED.items()}
        robot["bed"] = {**symbols, **{k: x for k, x in tables["model"].items() if k != "terms"}}
    return {"robot": robot, "law": {"amplitude": tables["actuation"]["amplitude"], **presets(ground)["stutter"]}}


def page() -> dict[str, Any]:
    """Give all of this as JSON; `colours` is the map's, 256 of them."""
    import matplotlib

    colours = matplotlib.colormaps["viridis"]
    return {
        "grounds": {g: {"jump": default_jump(g), "presets": presets(g)} for g in GROUNDS},
        "knobs": [asdict(k) for k in KNOBS],
        "colours": [[round(255 * c) for c in colours(i)[:3]] for i in range(256)],
    }
