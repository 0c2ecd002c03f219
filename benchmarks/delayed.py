"""A worked case: delayed jumps tell that the bed remembers a pause, slow intrusions confirm it, a plan makes use of it.

`python -m benchmarks.delayed FOLDER` writes a campaign of the laboratory, questions the model that forgets, plans
a stop-go jump with the extended and with the old model, performs both in the laboratory, and prints what came of it.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from scipy.interpolate import CubicSpline

from jumpvision.cli import main
from jumpvision.laboratory.jumper import Motor, Robot, Samples, motion_of

TRUTH = {"k1": 2100.0, "k2": 2100.0, "delta": 0.01, "b": 17.2, "C": 2.7, "mu": 2.0, "theta": math.pi / 3}
MEMORY = {"s_p": 1000.0, "lam": 0.005}  # what the model in question does not have
TERMS = ["two_resistance", "depth_drag", "added_mass"]
ROBOT = Robot(1.125, 0.175, 0.04, 3300.0, 1.2, 0.0381, 9.81)
MOTOR = {"kp": 20000.0, "kd": 120.0, "max_force": 100.0, "max_speed": 3.0, "stroke": 0.05}
PHI, DENSITY, APEX, FAST = 0.57, 1000.0, 0.06, 10_000.0  # 1, kg/m^3, m, 1/s
LOOP = Motor(**MOTOR)


def _lines(values: Mapping[str, object]) -> str:
    return "\n".join(f"{n} = {json.dumps(v)}" for n, v in values.items())


PROTOCOL = f"""
name = "Delayed jumps"
ground = "granular"
duration = 0.85
[robot]
{_lines(ROBOT._asdict())}
[motor]
{_lines(MOTOR)}
[bed]
grain_density = {DENSITY}
[truth]
terms = {json.dumps([*TERMS, "stop_go_overshoot"])}
{_lines(TRUTH | MEMORY)}
[[jumps]]
kind = "single"
frequency = [7.0, 9.0]
amplitude = 0.01875
volume_fraction = {PHI}
trials = 2
[[jumps]]
kind = "delayed_stutter"
frequency = [7.0, 9.0]
amplitude = 0.01875
delay = [0.1, 0.25]
dwell_gain = 0.06
volume_fraction = {PHI}
trials = 2
[[intrusions]]
kind = "stop_go"
stops = 5
volume_fraction = {PHI}
pause = 1.0
trials = 3
[record]
rod_track = {{ noise = 5e-5 }}
motor_log = {{}}
intrusion_log = {{ noise = 0.05, fluctuation = 0.1 }}
[model]
terms = {json.dumps(TERMS)}
{_lines(TRUTH)}
[model.fit]
b = [5.0, 40.0]
"""


def write_campaign(out: Path, seed: int = 3) -> None:
    """The recordings of PROTOCOL: 12 jumps and 3 slow intrusions with five pauses each."""
    text = out.with_suffix(".toml")
    text.write_text(PROTOCOL)
    assert main(["synth", str(text), str(out), "--seed", str(seed), "--workers", "1"]) == 0


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
    write_campaign(folder / "delayed")
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


if __name__ == "__main__":
    told = case(Path(sys.argv[1]))
    d = told["diagnosis"]
    print("named:", d["named"], d["status"])
    for cause in d["causes"]:
        if cause["mechanism"] in d["named"]:
            print(cause["mechanism"], {n: (p["value"], p["low"], p["high"]) for n, p in cause["parameters"].items()})
    for row in d.get("confirmation", []):
        print({n: row[n] for n in ("quantity", "by_jumps", "by_film", "z", "verdict")})
    print("| planned with a model that | planned [mm] | jumped [mm] |\n|---|---|---|")
    for name, p in told["plans"].items():
        jumped = "-" if p["performed_m"] is None else f"{1e3 * p['performed_m']:.1f}"
        print(f"| {name} | {1e3 * p['apex_m']:.1f} ({p['status']}) | {jumped} |")
