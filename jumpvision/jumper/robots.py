"""The robots of the thesis (Aguilar), chapter II on hard ground and III on sand, as sections of an experiment.toml."""

from __future__ import annotations

import math
from typing import Any

MOTOR = {"kp": 20000.0, "kd": 120.0, "max_force": 100.0, "max_speed": 3.0, "stroke": 0.05}

THESIS_ROBOT: dict[str, dict[str, Any]] = {  # docs/physics.md sections 2 and 3
    "hard": {
        "robot": {
            "motor_mass": 1.003,
            "rod_mass": 0.175,
            "spring_stiffness": 5760.6,
            "spring_damping": 1.368,
            "gravity": 0.276 * 9.81,
        },
        "actuation": {"kind": "stutter", "frequency": 8.2, "amplitude": 4e-3},
        "motor": MOTOR,
        "bed": {},
        "model": {"terms": ()},
    },
    "granular": {
        "robot": {
            "motor_mass": 1.125,
            "rod_mass": 0.175,
            "foot_mass": 0.04,
            "spring_stiffness": 3300.0,
            "spring_damping": 1.2,
            "foot_radius": 0.0381,
            "gravity": 9.81,
        },
        "actuation": {"kind": "stutter", "frequency": 5.0, "amplitude": 0.01875},
        "motor": MOTOR,
        "bed": {"volume_fraction": 0.57, "grain_density": 1000.0},
        # the set of docs/physics.md section 7: the bend is without effect at k1 = k2
        "model": {
            "terms": ("two_resistance", "depth_drag", "added_mass"),
            "k1": 2100.0,
            "k2": 2100.0,
            "delta": 0.01,
            "C": 2.7,
            "mu": 2.0,
            "theta": math.pi / 3,
            "b": 17.2,
        },
    },
}
