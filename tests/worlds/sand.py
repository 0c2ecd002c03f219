"""Robots and beds on sand: the thesis' (Aguilar) robot, a model with every law, random ones."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.model import Model

ROBOT = {
    "motor_mass": 1.125, "rod_mass": 0.175, "foot_mass": 0.04, "spring_stiffness": 3300.0, "spring_damping": 1.2,
    "gravity": 9.81, "foot_radius": 0.0381, "volume_fraction": 0.57, "grain_density": 1000.0,
}  # fmt: skip
EVERYTHING = Model(
    "granular",
    ("two_resistance", "inertial_drag", "depth_drag", "added_mass", "reintrusion_overshoot", "stop_go_overshoot",
     "compaction"),
    ModelParameters(k1=2e3, k2=2e3, delta=0.01, alpha=1.0, b=1.0, C=1.0, s=1.0, s_p=1.0, lam=0.01, factor=1.0),
    **ROBOT,
)  # fmt: skip


def random_values(rng: np.random.Generator, n: int) -> dict[str, NDArray]:
    """Random robots and beds, heavy feet, strong drag and soft ground among them."""
    ranges = {
        "k1": (500, 20000), "k2": (300, 20000), "delta": (0, 0.03), "alpha": (0, 300), "b": (0.5, 40), "C": (0, 6),
        "mu": (1, 4), "theta": (0.3, 1.4), "s": (0, 4000), "s_p": (0, 4000), "lam": (5e-4, 2e-2), "factor": (0.5, 2),
        "motor_mass": (0.3, 3), "rod_mass": (0.05, 1), "foot_mass": (0.003, 0.5), "spring_stiffness": (500, 20000),
        "spring_damping": (0, 10), "gravity": (1, 20),
    }  # fmt: skip
    return {name: rng.uniform(*bounds, n) for name, bounds in ranges.items()}
