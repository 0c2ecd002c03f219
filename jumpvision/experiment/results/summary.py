"""One experiment in a few numbers: summary.json, and its row of jumps.csv. Which key holds what stands here alone."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, NamedTuple, Self

from jumpvision.base.record import Record, plain
from jumpvision.base.schema import Toml, WarningRecord
from jumpvision.experiment import files

Cell = str | float | int | None


class Uncertain(NamedTuple):
    """A value, its standard uncertainty, and the part of that which other experiments share; None where unknown."""

    value: float | None = None
    sigma: float | None = None
    common: float | None = None

    @property
    def numbers(self) -> tuple[float, float, float]:
        """The same, NaN where unknown."""
        value, sigma, common = (math.nan if x is None else x for x in self)
        return value, sigma, common


def _at(*keys: str) -> Any:
    """A field, None where unknown, under these keys of the file."""
    return field(default=Uncertain() if len(keys) > 1 else None, metadata={"keys": keys})


def _measured(key: str) -> Any:
    return _at(key, f"{key}_sigma", f"{key}_sigma_common")


@dataclass(frozen=True)
class Summary(Record):
    """One experiment in a few numbers; None, in the file null, where unknown. SI units but for beta [deg].

    True where it is of an experiment, False for UNKNOWN.
    """

    experiment: str = field(metadata={"keys": ("experiment",)})
    kind: str | None = _at("kind")
    jump_height: Uncertain = _at("jump_height_m", "sigma_m", "sigma_common_m")
    n_jumps: int | None = _at("n_jumps")
    volume_fraction: Uncertain = _at("volume_fraction", "sigma_volume_fraction", "sigma_common_volume_fraction")
    flight_height: Uncertain = _measured("flight_height_m")
    flight_time: Uncertain = _measured("flight_time_s")
    lift_off: Uncertain = _measured("lift_off_s")
    mu: Uncertain = _measured("mu")
    beta: Uncertain = _measured("beta_deg")
    added_mass: Uncertain = _measured("added_mass_kg")
    frequency: Uncertain = _measured("frequency_hz")  # of the ring-down
    zeta: Uncertain = _measured("zeta")
    motor_rise: Uncertain = _measured("motor_rise_m")
    spring_stiffness: Uncertain = _measured("spring_stiffness_N_m")
    simulated_height: float | None = _at("simulated_height_m")
    warnings: tuple[WarningRecord, ...] = field(default=(), metadata={"keys": ("warnings",)})

    file = files.SUMMARY

    def __bool__(self) -> bool:
        return bool(self.experiment)

    @property
    def values(self) -> dict[str, Any]:
        """As in the file: a `Cell` each, but for the list of warnings."""
        out: dict[str, Any] = {}
        for name, keys in KEYS.items():
            value = getattr(self, name)
            out |= zip(keys, value if isinstance(value, Uncertain) else (value,))
        return out

    @classmethod
    def of(cls, values: Toml) -> Self:
        """From what a file holds."""
        read: dict[str, Any] = {}
        for name, keys in KEYS.items():
            value = [values.get(k) for k in keys]
            read[name] = Uncertain(*value) if len(value) > 1 else value[0]
        return cls(**{**read, "warnings": tuple(read["warnings"] or ())})

    def save(self, folder: Path) -> None:
        (folder / self.file).write_text(json.dumps(plain(self.values), indent=1) + "\n", encoding="utf-8")

    @classmethod
    def load(cls, folder: Path) -> Self:
        return cls.of(json.loads((folder / cls.file).read_text(encoding="utf-8")))


KEYS: Mapping[str, tuple[str, ...]] = {f.name: f.metadata["keys"] for f in fields(Summary)}
JUMP_COLUMNS = (
    *(k for name in ("jump_height", "simulated_height", "flight_height") for k in KEYS[name]),
    *(KEYS[name][0] for name in ("flight_time", "lift_off", "n_jumps")),
    *(k for name in ("mu", "beta", "added_mass") for k in KEYS[name]),
    *KEYS["volume_fraction"][1:],
)
UNKNOWN = Summary("")  # of an experiment whose stage has not run


@dataclass(frozen=True)
class JumpRow:
    """A row of jumps.csv. frequency [Hz] and delay [s] of the motor; warnings: how many; problem: why no numbers."""

    experiment: str
    group: str | None = None
    kind: str | None = None
    frequency: float | None = None
    delay: float | None = None
    summary: Summary = UNKNOWN
    warnings: int = 0
    problem: str | None = None
    excluded: bool = False

    def cells(self) -> dict[str, Cell]:
        """As in the file; one that was not asked for has its reason alone."""
        if self.excluded:
            return {"experiment": self.experiment, "problem": self.problem}
        known = self.summary.values
        return {
            "experiment": self.experiment,
            "group": self.group,
            "kind": self.kind,
            "frequency_hz": self.frequency,
            "delay_s": self.delay,
            "volume_fraction": known["volume_fraction"],
            **{c: known[c] for c in JUMP_COLUMNS},
            "warnings": self.warnings,
            "problem": self.problem,
        }
