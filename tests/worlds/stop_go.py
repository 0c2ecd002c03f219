"""A worked case: planned stop-go motions on sand that answers a pause, questioned with a model that forgets it.

The thesis (Aguilar, Figs 67-69): a motion that pauses in mid-intrusion was planned for 60 mm and jumped 90 mm. The data
are made by the laboratory's own integrator with the motor's feedback loop; only encoder log and track are written, no
law.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from jumpvision.laboratory import recordings as logs
from jumpvision.laboratory import write
from jumpvision.laboratory.blind import ROBOTS
from jumpvision.laboratory.jumper import Motor, Samples, motion_of

PHI, DENSITY = 0.571, 1000.0  # volume fraction, kg/m^3
MODEL = {"k1": 2100.0, "k2": 2100.0, "delta": 0.012, "b": 17.2, "C": 2.7, "mu": 2.0, "theta": math.pi / 3}
TERMS = ["two_resistance", "depth_drag", "added_mass"]
HIDDEN = {"s_p": 2000.0, "lam": 0.005}  # N/m, m: a foot at rest 10 mm deep meets 20 N more, gone after some 5 mm
MOTIONS = {  # first thrust [m], [s], pause [s], second thrust [m], [s]
    "pause-0.1s": (0.02, 0.1, 0.1, 0.04, 0.07),
    "pause-0.2s": (0.02, 0.1, 0.2, 0.05, 0.08),
    "pause-0.3s": (0.02, 0.1, 0.3, 0.04, 0.07),
    "deep-0.2s": (0.025, 0.06, 0.2, 0.05, 0.08),
}
TRIALS, NOISE = 2, 5e-5  # of each motion; of the track [m]


def thrusts(
    first: float, taken: float, pause: float, second: float, over: float, *, start: float = 0.2, down: float = 0.5
) -> Samples:
    """The motor sinks to the middle of its travel, pushes, waits and pushes again; jerk-limited, 1 kHz."""
    t = np.arange(0.0, down + taken + pause + over + 1e-9, 1e-3)

    def step(begin: float, length: float) -> NDArray[np.float64]:
        u = np.clip((t - begin) / length, 0.0, 1.0)
        return u**3 * (10.0 - 15.0 * u + 6.0 * u * u)

    travel = first * step(down, taken) + second * step(down + taken + pause, over)
    return Samples(travel - 0.5 * (first + second) * step(0.0, down), 1000.0, start)


def write_campaign(out: Path, seed: int = 1) -> None:
    """Experiment folders with motor.csv, rod_track.csv and truth.json; campaign.toml declares no memory of pauses."""
    robot = ROBOTS["granular"]
    out.mkdir(parents=True)
    tables = {
        "robot": robot._asdict(),
        "bed": {"volume_fraction": PHI, "grain_density": DENSITY, "grain_diameter": 0.001},
        "model": {"terms": TERMS, **MODEL},
        "model.fit": {"b": [5.0, 40.0]},
    }
    write.toml(out / "campaign.toml", {"ground": "granular", **tables}, comment="Stop-go motions of the laboratory.")
    rng = np.random.default_rng(seed)
    for name, motion in MOTIONS.items():
        command = thrusts(*motion)
        moved = motion_of(
            robot, command, [*TERMS, "stop_go_overshoot"], MODEL | HIDDEN, ground="granular",
            duration=command.stop + 0.4, bed_density=PHI * DENSITY, dt=1e-5, every=50, motor=Motor(60_000.0, 300.0),
        )  # fmt: skip
        for trial in range(1, TRIALS + 1):
            folder = out / f"{name}-{trial}"
            folder.mkdir()
            write.table(folder / "motor.csv", logs.motor_log(moved, rate=1000.0, force_noise=0.1, rng=rng))
            track = logs.rod_track(moved, rate=200.0, noise=NOISE, zero=0.0, rng=rng)
            write.table(folder / "rod_track.csv", track)
            files = {"motor_log": {"file": "motor.csv"}, "rod_track": {"file": "rod_track.csv"}}
            write.toml(folder / "experiment.toml", {"group": name, **files})
            write.truth(folder / "truth.json", {"summary": {"jump_height_m": moved.jump_height}, "hidden": HIDDEN})
