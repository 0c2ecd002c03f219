"""The actuator of a campaign: amplitude ratio and lag against frequency, and the bandwidth."""

from __future__ import annotations

import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jumpvision.base.record import plain
from jumpvision.base.storage import write_aside
from jumpvision.estimate.robot import Bandwidth, bandwidth
from jumpvision.experiment import files
from jumpvision.experiment.inputs.experiment import Campaign
from jumpvision.experiment.inputs.sections import MotorLog
from jumpvision.experiment.results.values import Fits
from jumpvision.experiment.workflow.run import Outcome

from .intrusions import Fitted

FITTED = ("actuator_ratio", "actuator_lag_s", "actuator_tau_s", "peak_power_W", "motor_work_J")


@dataclass(frozen=True)
class Driven:
    """An experiment whose encoder log was held against its command of this frequency [Hz] and amplitude [m]."""

    experiment: str
    frequency: float
    amplitude: float
    fits: Mapping[str, Fitted]

    @classmethod
    def of(cls, row: Mapping[str, float | str | None]) -> Driven:
        """From its row of actuator.csv."""
        cells = {k: math.nan if v is None else float(v) for k, v in row.items() if k != "experiment"}
        fits = {n: Fitted(cells[n], cells[f"{n}_sigma"]) for n in FITTED}
        return cls(str(row["experiment"]), cells["frequency_hz"], cells["amplitude_m"], fits)

    @property
    def cells(self) -> dict[str, str | float]:
        """Its row of actuator.csv."""
        row: dict[str, str | float] = {
            "experiment": self.experiment,
            "frequency_hz": self.frequency,
            "amplitude_m": self.amplitude,
        }
        for name, fit in self.fits.items():
            row |= {name: fit.value, f"{name}_sigma": fit.sigma}
        return row


def driven(campaign: Campaign, outcomes: Sequence[Outcome]) -> list[Driven]:
    """Those of a campaign, by frequency."""
    rows = []
    results = {o.name: o.results for o in outcomes if o.made(Fits)}
    for e in campaign.experiments:
        if e.name not in results or e.section(MotorLog) is None:
            continue
        fits = Fits.load(results[e.name])
        if fits.get("actuator_ratio") is None:
            continue
        law = e.sections["actuation"]
        found = ((n, fits.get(n)) for n in FITTED)
        fitted = {n: Fitted(f.value, f.sigma) if f else Fitted(math.nan, math.nan) for n, f in found}
        rows.append(Driven(e.name, law.frequency, law.amplitude, fitted))
    return sorted(rows, key=lambda r: r.frequency)


def actuator_bandwidth(rows: Sequence[Driven]) -> Bandwidth:
    """-3 dB bandwidth with its 95 % interval, gain, time constant and the order of the response fitted."""
    f = np.array([r.frequency for r in rows], dtype=float)
    ratio, sigma = np.array([r.fits["actuator_ratio"] for r in rows], dtype=float).T.copy()
    lag = np.array([r.fits["actuator_lag_s"].value for r in rows], dtype=float)
    return bandwidth(f, ratio, sigma, lag, rng=np.random.default_rng(0))


def write_actuator(campaign: Campaign, outcomes: Sequence[Outcome], results: Path) -> list[Path]:
    """actuator.csv and actuator_bandwidth.json, where two frequencies or more were run."""
    import pandas as pd

    rows = driven(campaign, outcomes)
    if len({r.frequency for r in rows}) < 2:  # a table needs two frequencies
        return []
    text, found = io.StringIO(), actuator_bandwidth(rows)
    pd.DataFrame([r.cells for r in rows]).to_csv(text, index=False, lineterminator="\n")
    write_aside(results / files.ACTUATOR, text.getvalue())
    entries = {"bandwidth_hz": found.cutoff, "gain": found.gain, "tau_s": found.tau}
    data: dict[str, object] = {k: e.entry() | ({"reason": e.reason} if e.reason else {}) for k, e in entries.items()}
    data |= {"bandwidth_ci95_hz": [found.low, found.high], "order": found.order}
    write_aside(results / files.BANDWIDTH, json.dumps(plain(data), indent=1) + "\n")
    return [results / files.ACTUATOR, results / files.BANDWIDTH]
