"""A worked case: delayed jumps tell that the bed remembers a pause, slow intrusions confirm it, a plan makes use of it.

A campaign of the laboratory is written, the model that forgets is diagnosed, a stop-go jump is planned with the
extended and with the old model, and both are performed in the laboratory.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from jumpvision.cli import main
from jumpvision.laboratory import write
from jumpvision.laboratory.campaign import write_campaign
from jumpvision.laboratory.intrusions import Arm, Grains, Move, log
from jumpvision.laboratory.jumper import Motor, Robot, Samples, motion_of
from jumpvision.laboratory.protocol import Jump, MotorLog, Protocol, Records, RodTrack, jumps_of

TRUTH = {"k1": 2100.0, "k2": 2100.0, "delta": 0.01, "b": 17.2, "C": 2.7, "mu": 2.0, "theta": math.pi / 3}
MEMORY = {"s_p": 1000.0, "lam": 0.005}  # what the model in question does not have
TERMS = ["two_resistance", "depth_drag", "added_mass"]
ROBOT = Robot(1.125, 0.175, 0.04, 3300.0, 1.2, 0.0381, 9.81)
MOTOR = {"kp": 20000.0, "kd": 120.0, "max_force": 100.0, "max_speed": 3.0, "stroke": 0.05}
PHI, DENSITY, APEX, FAST = 0.57, 1000.0, 0.06, 10_000.0  # 1, kg/m^3, m, 1/s
LOOP = Motor(**MOTOR)


def _lines(values: Mapping[str, object]) -> str:
    return "\n".join(f"{n} = {json.dumps(v)}" for n, v in values.items())


def jumps(kind: str, **more: Any) -> tuple[Jump, ...]:
    return jumps_of(kind, [7.0, 9.0], volume_fraction=[PHI], trials=2, **more)


PROTOCOL = Protocol(
    ROBOT,
    (*jumps("single"), *jumps("delayed_stutter", delay=[0.1, 0.25], dwell_gain=0.06)),
    Records(rod_track=RodTrack(noise=5e-5), motor_log=MotorLog()),
    terms=(*TERMS, "stop_go_overshoot"),
    parameters=TRUTH | MEMORY,
    duration=0.85,
    motor=LOOP,
    model={"terms": TERMS, **TRUTH, "fit": {"b": [5.0, 40.0]}},
)
PAUSES: list[Move] = [m for k in range(1, 6) for m in (("to", 0.01 * k), ("pause", 1.0))]
PAUSES.append(("to", 0.06))


def write_delayed(out: Path, seed: int = 3) -> None:
    """The recordings of PROTOCOL: 12 jumps and 3 slow intrusions with five pauses each."""
    write_campaign(out, PROTOCOL, seed=seed)
    bed = Grains(*(TRUTH[n] for n in ("k1", "k2", "delta")), s=0.0, **MEMORY, fluctuation=0.1)
    for k in range(3):
        folder = out / f"stop_go-{k + 1}"
        folder.mkdir()
        rng = np.random.default_rng([seed, 100, k])
        write.table(folder / "intrusion.csv", log(PAUSES, bed, Arm(), start=-0.006, rng=rng))
        tables = {"bed": {"volume_fraction": PHI}, "intrusion_log": {"file": "intrusion.csv"}}
        write.toml(folder / "experiment.toml", {"group": "stop_go", **tables})


def performed(plan: Path) -> float:
    """Height [m] over rest after the command of a plan.csv, in the laboratory, on the bed as it is.

    The controller plays it at 10 kHz, by cubics: straight lines between its rows shake the motor once a millisecond.
    """
    table = pd.read_csv(plan)
    t = np.arange(0.0, table.time_s.iloc[-1], 1.0 / FAST)
    command = CubicSpline(table.time_s, table.command_m, bc_type="clamped")(t)
    moved = motion_of(
        ROBOT, Samples(command, FAST, 0.1), [*TERMS, "stop_go_overshoot"], TRUTH | MEMORY, ground="granular",
        duration=0.1 + t[-1] + 0.5, bed_density=PHI * DENSITY, motor=LOOP,
    )  # fmt: skip
    return moved.jump_height


def planned(model: Path | None, motion: str, results: Path) -> dict[str, Any]:
    """plan.json of a jump to APEX with a model, or with the one that forgets."""
    call = ["plan", "--ground", "granular", "--apex", str(APEX), "--motion", motion, "--results", str(results)]
    main([*call, "--no-pictures", *(["--model", str(model)] if model else [])])
    out: dict[str, Any] = json.loads((results / "plan.json").read_text())
    return out


def case(folder: Path) -> dict[str, Any]:
    """Everything in turn: what was found, what intrusions say of it, and what the plans came to."""
    folder.mkdir(parents=True, exist_ok=True)
    write_delayed(folder / "delayed")
    main(["run", str(folder / "delayed"), "--workers", "1", "--no-pictures"])
    results = folder / "results" / "delayed"
    found = json.loads((results / "diagnosis.json").read_text())
    model = results / "model.toml"
    forgets = folder / "forgets.toml"
    memory = f"[model]\nterms = {json.dumps([*TERMS, 'stop_go_overshoot'])}\ns_p = 0.0\nlam = 0.005\n{_lines(TRUTH)}\n"
    forgets.write_text(memory)
    plans = {}
    for name, file in (("remembers", model), ("forgets", forgets)):
        numbers = planned(file, "stop-go", folder / f"plan-{name}")
        solved = numbers["status"] == "solved"
        plans[name] = numbers | {"performed_m": performed(folder / f"plan-{name}" / "plan.csv") if solved else None}
    return {"diagnosis": found, "plans": plans}
