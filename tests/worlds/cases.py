"""Jumps that the tests of the jumper share: a robot on sand and one on hard ground, beds of few and of all laws."""

from __future__ import annotations

import math

from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.forcing import delayed, sinusoid
from jumpvision.jumper.physics.model import Model

from .sand import ROBOT as SAND

HARD = {
    "motor_mass": 1.003, "rod_mass": 0.175, "foot_mass": 0.0, "spring_stiffness": 5760.6, "spring_damping": 1.368,
    "gravity": 0.276 * 9.81,
}  # fmt: skip
BED = {"k1": 2100.0, "k2": 1500.0, "delta": 0.009}
STUTTER, CONE = 0.5 * math.pi, {"C": 2.7, "mu": 2.0}  # rad; the cone's values
CASES = {  # laws of the bed, their values, command: frequency [Hz], amplitude [m], phase [rad], delay [s]
    "plain": (("two_resistance", "inertial_drag"), {"alpha": 73.0}, (7.0, 0.01875, STUTTER, 0.0)),
    "single": (("two_resistance", "depth_drag"), CONE | {"b": 17.2}, (9.0, 0.01875, 3.0 * STUTTER, 0.0)),
    "cone": (("two_resistance", "depth_drag", "added_mass"), CONE | {"b": 17.2}, (7.0, 0.01875, STUTTER, 0.0)),
    "velocity step": (
        ("two_resistance", "inertial_drag", "added_mass"), CONE | {"alpha": 73.0}, (6.25, 0.01875, math.pi + 0.4, 0.0)
    ),
    "everything": (
        ("two_resistance", "depth_drag", "added_mass", "inertial_drag", "reintrusion_overshoot", "stop_go_overshoot",
         "compaction", "viscous_friction", "spring_hardening"),
        CONE | {"b": 8.0, "alpha": 20.0, "s": 800.0, "s_p": 600.0, "lam": 0.004, "factor": 1.3, "c_v": 0.8, "k_3": 4e6},
        (7.0, 0.01875, STUTTER, 0.1),
    ),
    "hard, foot with mass": ((), {}, (7.0, 0.01, STUTTER, 0.0)),
}  # fmt: skip


def case(name):
    terms, values, (frequency, amplitude, phase, delay) = CASES[name]
    ground = "hard" if name.startswith("hard") else "granular"
    law = delayed(frequency, amplitude, phase, delay) if delay else sinusoid(frequency, amplitude, phase)
    return Model(ground, terms, ModelParameters(**BED, **values), **SAND), law
