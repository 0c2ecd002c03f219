"""What varied, as a diagnosis records it, of 24 jumps in their order: for its words, its figure and what mends it."""

from __future__ import annotations

from dataclasses import replace

from jumpvision.base.arrays import Z90
from jumpvision.engine.document.values import Pattern, Varies

NAMES = tuple(f"jump-{k}" for k in range(1, 25))


def varies(parameter, kind, value, declared=1.0, sigma=0.001, **more) -> Varies:
    """Of 24 jumps, in their order."""
    given = {"of": None, "recordings": (), "unit": "1", "p_value": 1e-9, "established": True} | more
    given.setdefault("at", dict(zip(NAMES, map(float, range(1, 25)))))
    low, high = value - Z90 * sigma, value + Z90 * sigma
    return Varies(parameter, Pattern(kind), value=value, declared=declared, low=low, high=high, **given)


FREQUENCIES = dict(zip(NAMES, [5.0, 6.0, 7.0, 8.0, 9.0, 10.0, 11.0, 12.0] * 3))
FAST = tuple(n for n, f in FREQUENCIES.items() if f > 8.0)
DAYS = dict(zip(NAMES, ["day 1"] * 12 + ["day 2"] * 12))
DRIFT = varies("spring_stiffness", "drift", 3036.0, 3300.0, 20.0, of="order", unit="N/m",
               source="`recorded` in experiment.toml")  # fmt: skip
ODD = varies("amplitude", "odd", 1.15, recordings=("jump-15",))
FASTER = varies("frequency", "odd", 1.10, recordings=("jump-15",))
DAY = varies("scale", "step", 1.04, of="session", recordings=NAMES[12:], at=DAYS)
SOFT = varies("amplitude", "function", 0.84, sigma=0.01, of="frequency", recordings=FAST, at=FREQUENCIES)
LOST = varies("lost_frames", "odd", 1.0, 0.0, 0.01, unit="frames", recordings=NAMES[:16:2])
SCATTER = replace(varies("alpha", "scatter", 4.08, 80.0, unit="N s^2/m^2"), low=3.2, high=5.6)
