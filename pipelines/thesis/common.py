"""What the scripts share: robots and force models, options, the table of numbers beside the dissertation's."""

import argparse
import csv
import sys
from collections.abc import Iterable, Mapping
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from scipy.interpolate import PchipInterpolator
from scipy.optimize import minimize_scalar

import jumpvision as jv
from jumpvision.jumper.physics.hard.jump import HardRobot
from jumpvision.jumper.robots import THESIS_ROBOT

matplotlib.use("Agg")
HARD, SAND = (THESIS_ROBOT[ground]["robot"] for ground in ("hard", "granular"))  # values of [robot] [SI]
HOPPER = HardRobot(*(HARD[n] for n in ("motor_mass", "rod_mass", "spring_stiffness", "spring_damping", "gravity")))
STUTTER, SINGLE = 0.5 * np.pi, 1.5 * np.pi  # rad, start phases of the two kinds of jump
HERE = Path(__file__).parent
LAWS = HERE / "example_laws.toml"  # of the bed's parameters against its volume fraction
AMPLITUDE = 0.01875  # m, of the law on sand
DWELL = 0.06  # of the motor's gain, to which it is lowered in the pause, where it damps the spring (section 2.2.1)
KINDS = {  # phase [rad], delay [s]
    "single": {"phase": SINGLE, "delay": 0.0},
    "stutter": {"phase": STUTTER, "delay": 0.0},
    "delayed stutter": {"phase": STUTTER, "delay": 0.75},
}
FORCES = {  # of section 3.3: terms over the static force of the bed
    "static": (),
    "constant drag": ("inertial_drag",),
    "drag and overshoot": ("inertial_drag", "reintrusion_overshoot"),
    "depth drag": ("depth_drag",),
    "drag and added mass": ("inertial_drag", "added_mass"),
    "cone": ("depth_drag", "added_mass"),
}
DRAGS = np.r_[0.0, np.geomspace(5.0, 1000.0, 18)]  # kg/m, tried for alpha

Number = float | str | Iterable[float] | None


def arguments(about: str | None) -> argparse.Namespace:
    """Read the options of a script: out, the folder for its files, and small, for few points in seconds."""
    parser = argparse.ArgumentParser(description=about)
    parser.add_argument("--out", type=Path, default=Path("results/thesis"), help="folder for NAME.png and NAME.csv")
    parser.add_argument("--small", action="store_true", help="few points, in seconds")
    return parser.parse_args()


def compare(numbers: Mapping[str, tuple[Number, Number]]) -> list[list[str]]:
    """Print a table of `quantity: (ours, dissertation)`, and return its rows; None: the dissertation has no number."""
    rows = [[name, *map(written, pair)] for name, pair in numbers.items()]
    table = [["quantity", "ours", "dissertation"], *rows]
    widths = [max(map(len, column)) for column in zip(*table)]
    for row in table:
        print("  ".join(cell.ljust(width) for cell, width in zip(row, widths)).rstrip())
    return rows


def written(number: Number) -> str:
    """Five digits of every number."""
    if number is None or isinstance(number, str):
        return number or ""
    return " ".join(f"{x:.5g}" for x in np.atleast_1d(np.asarray(number, float)))


def save(figure: Figure, rows: Iterable[Iterable[str]], out: Path) -> None:
    """Write the figure and the rows of `compare` as NAME.png and NAME.csv, NAME being the script's."""
    name = Path(sys.argv[0]).stem
    out.mkdir(parents=True, exist_ok=True)
    figure.savefig(out / f"{name}.png", dpi=150)
    with (out / f"{name}.csv").open("w", newline="", encoding="utf-8") as file:
        csv.writer(file).writerows([["quantity", "ours", "dissertation"], *rows])


def peak(x: ArrayLike, y: ArrayLike) -> tuple[float, float]:
    """Return where equal samples y (n,) over x (n,) are greatest, and the value, by the parabola through three."""
    x, y = np.asarray(x, float), np.where(np.isnan(y), -np.inf, y)
    i = int(np.argmax(y))
    if not 0 < i < len(y) - 1 or not np.isfinite(y[i - 1 : i + 2]).all():
        return float(x[i]), float(y[i])
    left, right = y[i] - y[i - 1], y[i] - y[i + 1]
    shift = 0.5 * (left - right) / (left + right) if left + right > 0.0 else 0.0
    return float(x[i] + shift * (x[1] - x[0])), float(y[i] + 0.25 * shift * (left - right))


def first_crossing(x: ArrayLike, y: ArrayLike) -> float:
    """Return the first x (n,) at which y (n,) changes sign, linear in between; NaN where it does not."""
    x, y = np.asarray(x, float), np.asarray(y, float)
    at = np.flatnonzero(np.sign(y[1:]) != np.sign(y[:-1]))
    if not at.size:
        return float("nan")
    i = at[0]
    return float(x[i] + (x[i + 1] - x[i]) * y[i] / (y[i] - y[i + 1]))


def forces(name, memory=False, **values):
    """Values of [model] for one of FORCES; memory: the bed remembers a pause of the foot; values of its parameters."""
    values |= {"s_p": 3000.0, "lam": 0.01} if memory else {}
    values |= {"s": 400.0, "lam": 0.01} if "reintrusion_overshoot" in FORCES[name] else {}
    return {"terms": ("two_resistance", *FORCES[name], *(["stop_go_overshoot"] if memory else [])), **values}


def heights(kind, model, laws=LAWS, **axes):
    """Jump heights [mm] of a kind over axes, with values of [model]; laws None: the bed of the printed set."""
    law = {"amplitude": AMPLITUDE, **KINDS[kind], **axes}
    return 1e3 * jv.sweep("granular", robot=SAND, model=model, laws=laws, **law).jump_height_m


def drag_of_singles(measured, memory=False, **given):
    """Fit the constant drag [kg/m] to single jumps `measured` [mm]; return it, the rms left, heights with all DRAGS."""
    tried = np.array([heights("single", forces("constant drag", memory, alpha=a), **given) for a in DRAGS])
    off = PchipInterpolator(DRAGS, tried - np.asarray(measured), axis=0)
    best = minimize_scalar(lambda a: np.sqrt(np.mean(off(a) ** 2)), bounds=(5.0, 500.0), method="bounded")
    return float(best.x), float(best.fun), tried
