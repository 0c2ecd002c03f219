"""A sweep from options to a data set: which analysis, which axes, which robot."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from jumpvision.base.arrays import Array
from jumpvision.physics.oscillator import natural_frequency

from .compute import Say
from .machine import Machine

Rows = list[dict[str, Any]]


@dataclass(frozen=True)
class Study:
    """A robot, single values in place of its constants (in machine.values already), and the ranges that were asked."""

    machine: Machine
    ranges: Mapping[str, Array]
    values: Mapping[str, Array]  # single values as typed
    workers: int
    say: Say

    def axis(self, name: str, usual: ArrayLike) -> Array:
        """The asked range, or single value, of an axis, else the usual one."""
        asked = self.ranges.get(name, self.values.get(name))
        return np.atleast_1d(np.asarray(usual if asked is None else asked, float))

    @property
    def robot(self) -> dict[str, Any]:
        """Keyword arguments of hard_sweep and its kin."""
        names = ("motor_mass", "rod_mass", "stiffness", "damping", "gravity", "landing_loss")
        return {n: float(self.machine.values[n]) for n in names}

    @property
    def grounded(self) -> dict[str, Any]:
        """robot without landing_loss, for what stops at the first lift-off."""
        return {n: v for n, v in self.robot.items() if n != "landing_loss"}

    @property
    def mass(self) -> float:
        return float(self.robot["motor_mass"] + self.robot["rod_mass"])

    @property
    def f0(self) -> float:
        """Natural frequency [Hz]."""
        return float(natural_frequency(self.robot["stiffness"], self.mass))

    @property
    def zeta(self) -> float:
        return float(self.robot["damping"] / (2.0 * np.sqrt(self.robot["stiffness"] * self.mass)))

    @property
    def rod_share(self) -> float:
        return float(self.robot["rod_mass"] / self.mass)

    def number(self, quantity: str, ours: str, thesis: str = "", rk4: str = "") -> dict[str, str]:
        """A row of the table; the columns thesis and RK4 (docs/physics.md section 7) are of the thesis' robot."""
        known = self.machine.thesis
        return {"quantity": quantity, "thesis": thesis if known else "", "RK4": rk4 if known else "", "ours": ours}


Analysis = Callable[[Study], tuple[xr.Dataset, Rows]]
