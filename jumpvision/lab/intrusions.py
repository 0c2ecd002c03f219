"""Slow intrusions of a flat foot on a robot arm with known truth: one log, a recording, a campaign of beds and feet."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from . import write
from .arm import Arm, Grains, Move, log
from .jumper import STATIC, Robot, truth_of
from .jumper_kernel import penetration
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
        static=lambda z: float(penetration(z, 1.0, q)),
        delta=q.delta,
        saw=parameters.get("saw", 0.0),
        fluctuation=record.fluctuation * size**2,
        grain_length=record.grain_length,
        **extra,
        **lam,
    )
    surface = float(np.round(rng.normal(0.0, record.surface), 5))
    arm = Arm(
        speed=record.speed,
        rate=record.rate,
        weight=record.weight,
        surface=surface,
        noise=record.noise,
        step=record.step,
    )
    write.table(folder / "intrusion.csv", log(moves, grains, arm, start=-record.start, rng=rng))
    known = {n: parameters[n] for n in ("k", "k1", "k2", "delta") if n in parameters}
    if "linear_penetration" in static:
        known["k1"] = known.pop("k")
    held = {n: v for n, v in extra.items() if v}
    fits = known | held | lam | {"contact_depth_m": surface, "weight_N": record.weight}
    return {"intrusion_log": {"file": "intrusion.csv"}}, {"fits": fits, "saw_N": grains.saw}


RADII = (0.0127, 0.0191, 0.0254, 0.0318, 0.0381)  # m, at the loose packing
PACKINGS = (0.57, 0.58, 0.59, 0.60, 0.61, 0.62, 0.63)
CRITICAL = 0.605
STRESS = 0.46e6  # N/m^3: k1 / foot area at phi 0.57
START = -0.006  # m: the log begins in the air


def grains(radius: float, phi: float) -> Grains:
    """The bed's answer to a foot: k1 bends up at phi_c, the saw begins there; delta is where the cone is complete."""
    area, over = math.pi * radius**2, max(0.0, phi - CRITICAL)
    k1 = STRESS * area * (1.0 + 12.0 * (phi - 0.57) + 60.0 * over)
    return Grains(
        k1=k1,
        k2=0.55 * k1,
        delta=0.4 * radius,
        s=0.15 * k1,
        s_p=0.1 * k1,
        fluctuation=0.002 * k1 * 0.03,
        saw=0.8e-3 * k1 * over / 0.02,
    )


PROTOCOLS: dict[str, list[Move]] = {
    "intrusion": [("to", 0.06)],
    "reintrusion": [m for z in (0.012, 0.024, 0.036, 0.048) for m in (("to", z), ("to", -0.004))] + [("to", 0.06)],
    "stop-go": [m for i in range(5) for m in (("to", 0.01 * (i + 1)), ("pause", (0.3, 3.0)[i % 2]))] + [("to", 0.06)],
}


def intrusion_campaign(folder: Path, *, seed: int = 20140630) -> None:
    """Write the campaign: an experiment a foot, a packing and a protocol, each with truth.json."""
    rng = np.random.default_rng(seed)
    cases = [("intrusion", r, 0.57) for r in RADII] + [("intrusion", 0.0381, phi) for phi in PACKINGS[1:]]
    cases += [(kind, 0.0318, 0.57) for kind in ("reintrusion", "stop-go")]
    folder.mkdir(parents=True)
    write.toml(folder / "campaign.toml", {"ground": "granular"}, comment="Slow intrusions of the virtual laboratory")
    for kind, radius, phi in cases:
        one(folder / f"{kind}-R{radius * 1e3:.1f}mm-phi{phi:.2f}", kind, radius, phi, rng)


def one(folder: Path, kind: str, radius: float, phi: float, rng: np.random.Generator) -> None:
    """One experiment folder."""
    folder.mkdir()
    bed, arm = grains(radius, phi), Arm(surface=float(np.round(rng.normal(0.0, 5e-4), 5)))
    write.table(folder / "intrusion.csv", log(PROTOCOLS[kind], bed, arm, start=START, rng=rng))
    sections: dict[str, Any] = {
        "schema": 1,
        "robot": {"foot_radius": radius},
        "bed": {"volume_fraction": phi},
        "intrusion_log": {"file": "intrusion.csv"},
    }
    write.toml(folder / "experiment.toml", sections)
    write.truth(
        folder / "truth.json",
        {
            "fits": {
                "k1": bed.k1,
                "k2": bed.k2,
                "delta": bed.delta,
                "contact_depth_m": arm.surface,
                "weight_N": arm.weight,
                "lam": bed.lam,
                "s": bed.s,
                "s_p": bed.s_p,
            },
            "saw_N": bed.saw,
        },
    )
