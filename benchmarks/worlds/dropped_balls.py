"""Mass and size of eleven real balls that were dropped (JUMPVISION_REAL_DATA/desilva_ball_drops)."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

AIR = 1.2  # kg/m^3
OUNCE = 0.0283495  # kg
ROWS = {  # as the workbook calls them -> as balls.txt does
    "Baseball": "baseball", "Blue Basketball": "bluebasketball", "Green Basketball": "greenbasketball",
    "Volleyball": "volleyball", "Bowling Ball": "bowlingball", "Golf Ball": "golfball", "Tennis Ball": "tennisball",
    "Whiffle Ball 1": "wiffleball1", "Whiffle Ball 2": "wiffleball2", "Yellow Whiffle Ball": "yellowWiffle",
    "Orange Whiffle Ball": "orangeWiffle",
}  # fmt: skip
VOLLEYBALL = (9.5, 66.0)  # oz, cm: the middle of what its rules allow; the file has question marks


@dataclass(frozen=True)
class Ball:
    """mass [kg], radius [m]; holes: whether the shell has holes."""

    mass: float
    radius: float
    holes: bool

    @property
    def terms(self) -> NDArray[np.float64]:
        """rho A / (2 m) [1/m], r/m [m/kg], weight of the displaced air over the ball's."""
        area, volume = math.pi * self.radius**2, 4.0 / 3.0 * math.pi * self.radius**3
        return np.array([0.5 * AIR * area, self.radius, AIR * volume]) / self.mass


def balls(folder: Path) -> dict[str, Ball]:
    """Every ball by the workbook's name."""
    rows = [line.split() for line in (folder / "balls.txt").read_text().splitlines()[1:] if line.strip()]
    given = {r[0]: VOLLEYBALL if "?" in r[1] else (float(r[1]), float(r[2])) for r in rows}
    return {
        name: Ball(given[row][0] * OUNCE, 0.01 * given[row][1] / (2 * math.pi), "iffle" in row)
        for name, row in ROWS.items()
    }
