"""Animals of one shape and many sizes, scaled from human values: thesis Fig 35."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.experiment.inputs.logs import LENGTH, read_columns
from jumpvision.jumper.physics.hard.analysis import SINGLE, STUTTER, animal_alpha, best_by_alpha
from jumpvision.jumper.physics.hard.jump import HardRobot

from .compute import RESULTS, Variable, dataset
from .scaling import SEARCH, TYPES
from .study import Found, Sweep, study

SHIPPED = Path(__file__).with_name("animals.csv")
HUMAN = {
    "mass": 78.0,
    "stiffness": 28500.0,
    "damping": 950.0,
    "amplitude": 0.5,
    "length": 1.8,
}  # docs/physics.md section 2


@dataclass(frozen=True)
class Animals:
    """The human's numbers in words, its damping ratio and the share of its mass that stays on the rod."""

    human: str
    zeta: float
    rod_share: float


class Measured(NamedTuple):
    """Jumps of real animals and robots: names, which of both, body lengths [m] and heights [m], (n,)."""

    names: list[str]
    kinds: list[str]
    length: Array
    height: Array


def read_animals(path: Path) -> Measured:
    """A CSV with columns animal, length and height, the last two with units; a column kind tells robots (else animals).

    InputError where it is none.
    """
    found, data = read_columns(path, {"length": LENGTH, "height": LENGTH})
    names = next((data[c] for c in data.columns if str(c).strip() == "animal"), None)
    if names is None or names.isna().any():
        raise InputError([f"{path}: column animal: missing, or empty in a row; give every row a name"])
    for name, values in found.items():
        if bad := np.flatnonzero(values <= 0).tolist():
            raise InputError([f"{path}: column {name}, row {bad[0] + 1}: must be > 0"])
    kinds = [str(k).strip() for k in data["kind"]] if "kind" in data else ["animal"] * len(names)
    if wrong := sorted({*kinds} - {"animal", "robot"}):
        raise InputError([f"{path}: column kind: {', '.join(wrong)}; must be animal or robot"])
    return Measured([str(n).strip() for n in names], kinds, found["length"], found["height"])


@study("animals", "hard", source="Fig 35", table=True)
def animals(s: Sweep) -> Found:
    """Heights of isometric animals relative to body length, from human values; rod share of the robot.

    Beside them jumps of animals from the literature, SHIPPED, or those of a table of the user's.
    """
    seen = read_animals(s.table or SHIPPED)
    length = np.geomspace(1e-3, 5.0, 90)
    g = 9.81
    zeta = HUMAN["damping"] / (2 * np.sqrt(HUMAN["stiffness"] * HUMAN["mass"]))
    given = {"mass": HUMAN["mass"], "stiffness": HUMAN["stiffness"], "gravity": g}
    a = animal_alpha(np.append(length, HUMAN["length"]), **given, amplitude=HUMAN["amplitude"], body=HUMAN["length"])
    robot = HardRobot(HUMAN["mass"], 0.0, HUMAN["stiffness"], HUMAN["damping"], g)
    share = s.robot.rod_share
    phases = np.array([[STUTTER], [SINGLE]])
    # the boxes of the best frequency of small animals (small alpha) are wide
    best = best_by_alpha(a, phases, share, zeta, robot=robot, search=SEARCH._replace(lowest=0.05, points=240))
    human = best["com_height_m"][:, -1]
    relative = best["com_height_m"] / best["amplitude_m"] * HUMAN["amplitude"] / HUMAN["length"]
    # geometric scaling: an animal's own height, power and force from the dimensionless jump
    size = length / HUMAN["length"]
    stretch = HUMAN["amplitude"] * size / best["amplitude_m"][:, :-1]
    own = {n: best[n][:, :-1] for n in RESULTS}
    rate = 1.0 / size  # of f_0: k as l, m as l^3
    for n in ("com_height_m", "flight_height_m", "jump_height_m"):
        own[n] = own[n] * stretch
    own["lift_off_s"] = own["lift_off_s"] / rate
    own["peak_force_N"] = own["peak_force_N"] * stretch * size  # k A
    own["peak_power_W"] = own["peak_power_W"] * stretch**2 * size * rate  # k A^2 w_0
    own["peak_motor_speed"] = own["peak_motor_speed"] * stretch * rate
    at = np.log(np.clip(seen.length, length[0], length[-1]))
    share_of = [seen.height / seen.length / np.exp(np.interp(at, np.log(length), np.log(r[:-1]))) for r in relative]
    extra: dict[str, Variable] = {
        "animal_length_m": (("animal",), seen.length, "m", "body length"),
        "animal_height_m": (("animal",), seen.height, "m", "jump height as given"),
        "share_of_simulated": (("jump", "animal"), np.array(share_of), "1", "height over the simulated one's"),
        "alpha": (("length",), a[:-1], "1", "eq. (14)"),
        "relative_height": (("jump", "length"), relative[:, :-1], "1", "com_height / body length"),
        "frequency_ratio": (("jump", "length"), best["frequency_ratio"][:, :-1], "1", "best frequency / f_0"),
    }
    data = dataset(
        s,
        {
            "jump": list(TYPES),
            "length": length,
            "animal": np.array(seen.names, dtype=str),
            "kind": ("animal", np.array(seen.kinds, dtype=str)),
        },
        ("jump", "length"),
        own,
        extra,
        facts=Animals(str(HUMAN), zeta=zeta, rod_share=share),
    )
    rows = [
        s.number("human alpha, zeta", f"{a[-1]:.3f}, {zeta:.2f}", "about 0.05, 0.32"),
        s.number("human: stutter, single height [m]", f"{human[0]:.2f}, {human[1]:.2f}", "2, 5", "2.1, 5.2"),
    ]
    lower, upper = share_of
    within = (lower >= 1.0) & (upper <= 1.0)
    for kind in dict.fromkeys(seen.kinds):
        of = np.array(seen.kinds) == kind
        rows.append(s.number(f"{kind}s between stutter and single", f"{within[of].sum()} of {of.sum()}", "most"))
    for i, name in enumerate(seen.names):
        stutter, single = share_of[0][i], share_of[1][i]
        times = f"{seen.height[i] / seen.length[i]:.3g} body lengths"
        ours = f"{times}; {stutter:.2g} of the stutter, {single:.2g} of the single"
        rows.append(s.number(f"{name}: height", ours))
    return data, rows
