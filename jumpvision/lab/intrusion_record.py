"""A slow intrusion of a protocol as a recording: the arm's log and its truth."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from . import write
from .intrusion import Arm, Grains, Move, log
from .jumper_kernel import penetration
from .mechanisms import STATIC, Robot, truth_of
from .protocol_keys import IntrusionLog

# how a parameter given for the robot's foot goes with the radius of another: forces with the area, lengths with it
POWERS = {"k": 2, "k1": 2, "k2": 2, "s": 2, "s_p": 2, "saw": 2, "delta": 1, "crater_volume": 3}


def scaled(parameters: Mapping[str, float], size: float) -> dict[str, float]:
    """Parameters of a foot `size` times as wide as the robot's."""
    return {n: v * size ** POWERS.get(n, 0) for n, v in parameters.items()}


def write_intrusion_log(
    folder: Path,
    moves: Sequence[Move],
    record: IntrusionLog,
    terms: Sequence[str],
    parameters: Mapping[str, float],
    rng: np.random.Generator,
    *,
    robot: Robot,
    size: float,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """intrusion.csv: its section and its truth. parameters: those of this foot, `size` times the robot's radius."""
    static = [t for t in terms if t in STATIC]
    foot = robot._replace(foot_radius=robot.foot_radius * size)
    q = truth_of(foot, static, parameters, ground="granular")
    overshoots = {"s": "reintrusion_overshoot", "s_p": "stop_go_overshoot"}
    extra = {n: parameters[n] if term in terms else 0.0 for n, term in overshoots.items()}
    lam = {"lam": parameters["lam"]} if any(extra.values()) else {}
    grains = Grains(
        static=lambda z: float(penetration(z, 1.0, q)), delta=q.delta, saw=parameters.get("saw", 0.0),
        fluctuation=record.fluctuation * size**2, grain_length=record.grain_length, **extra, **lam,
    )  # fmt: skip
    surface = float(np.round(rng.normal(0.0, record.surface), 5))
    arm = Arm(speed=record.speed, rate=record.rate, weight=record.weight, surface=surface, noise=record.noise,
              step=record.step)  # fmt: skip
    write.table(folder / "intrusion.csv", log(moves, grains, arm, start=-record.start, rng=rng))
    known = {n: parameters[n] for n in ("k", "k1", "k2", "delta") if n in parameters}
    if "linear_penetration" in static:
        known["k1"] = known.pop("k")
    held = {n: v for n, v in extra.items() if v}
    fits = known | held | lam | {"contact_depth_m": surface, "weight_N": record.weight}
    return {"intrusion_log": {"file": "intrusion.csv"}}, {"fits": fits, "saw_N": grains.saw}
