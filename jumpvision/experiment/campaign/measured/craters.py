"""The craters of a campaign: their volume change against volume fraction, and the critical packing where it is zero."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, cast

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.record import plain
from jumpvision.base.storage import write_aside
from jumpvision.estimate.crater import TWO_HALVES, ZeroCrossing, critical_fraction
from jumpvision.estimate.estimate import independent
from jumpvision.experiment import files
from jumpvision.experiment.results.values import CraterShape
from jumpvision.experiment.workflow.run import Outcome


@dataclass(frozen=True)
class Crater:
    """One crater, as its row of craters.csv; None where unknown."""

    experiment: str
    volume_m3: float | None
    sigma_m3: float | None
    sigma_common_m3: float | None
    noise_sigma_m3: float | None
    volume_fraction: float | None
    sigma_volume_fraction: float | None
    sigma_common_volume_fraction: float | None
    depth_m: float | None
    rim_height_m: float | None
    radius_m: float | None


COLUMNS = tuple(f.name for f in fields(Crater))


def measured_in(outcomes: Sequence[Outcome]) -> list[Crater]:
    """Those that a run has measured."""
    return craters_of({o.name: o.results for o in outcomes if o.made(CraterShape)})


def craters_of(results: Mapping[str, Path]) -> list[Crater]:
    """Those of experiments that have one; results: folder of results by name."""
    found = {n: CraterShape.load(f).values for n, f in results.items()}
    return [Crater(name, *(cast(Any, values).get(c) for c in COLUMNS[1:])) for name, values in found.items()]


def zero_crossing(craters: Sequence[Crater]) -> ZeroCrossing:
    """phi_c of the craters. Two halves of one crater say little about its own asymmetry, so that of all is pooled.

    What all beds or all craters share by their cameras does not average out: another scale of the crater's camera
    multiplies all volumes and leaves their zero; another of the bed's multiplies all phi, and so phi_c.
    """
    known = [c for c in craters if c.volume_fraction is not None]

    def column(name: str, unknown: float) -> Array:
        values = (getattr(c, name) for c in known)
        return np.array([unknown if v is None else v for v in values], float)

    v, total, noise, phi, dphi = (
        column(c, math.nan)
        for c in ("volume_m3", "sigma_m3", "noise_sigma_m3", "volume_fraction", "sigma_volume_fraction")
    )
    alike, alike_phi = (column(c, 0.0) for c in ("sigma_common_m3", "sigma_common_volume_fraction"))
    own, own_phi = independent(total, alike), independent(dphi, alike_phi)
    uneven = np.mean(np.maximum(own**2 - noise**2, 0.0)) / TWO_HALVES**2 if known else 0.0
    found = critical_fraction(phi, own_phi, v, np.sqrt(noise**2 + uneven))
    return found.with_common(found.value * float(np.mean(alike_phi / phi)) if known else 0.0)


def write_craters(craters: Sequence[Crater], found: ZeroCrossing, results: Path) -> list[Path]:
    """craters.csv and, in fits.json of the campaign, phi_c with its 95 % interval; the files written."""
    if not craters:
        return []
    text = io.StringIO()
    table = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    table.writeheader()
    table.writerows(map(asdict, craters))
    write_aside(results / files.CRATERS, text.getvalue())
    entry = {
        "value": found.value,
        "sigma": found.sigma,
        "sigma_common": found.sigma_common,
        "unit": "",
        "n": found.n,
        "chi2": found.chi2,
        "low95": found.low95,
        "high95": found.high95,
        "slope_m3": found.slope,
        "reason": found.reason,
    }
    write_aside(results / files.FITS, json.dumps(plain({"phi_c": entry}), indent=1) + "\n")
    return [results / files.CRATERS, results / files.FITS]
