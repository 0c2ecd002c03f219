"""The craters of a campaign: their volume change against volume fraction, and the critical packing where it is zero."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from jumpvision.base.storage import write_aside
from jumpvision.estimate.crater import TWO_HALVES, ZeroCrossing, critical_fraction
from jumpvision.estimate.estimate import independent
from jumpvision.results import plain
from jumpvision.results.values import CraterShape

COLUMNS = (
    "volume_m3",
    "sigma_m3",
    "sigma_common_m3",
    "noise_sigma_m3",
    "volume_fraction",
    "sigma_volume_fraction",
    "sigma_common_volume_fraction",
    "depth_m",
    "rim_height_m",
    "radius_m",
)


def craters_table(results: Mapping[str, Path]) -> list[dict[str, Any]]:
    """One row an experiment that has a crater; results: its folder of results by name."""
    rows = []
    for name, folder in results.items():
        if (folder / CraterShape.file).exists():
            values = CraterShape.load(folder).values
            rows.append({"experiment": name, **{c: values.get(c) for c in COLUMNS}})
    return rows


def zero_crossing(rows: list[dict[str, Any]]) -> ZeroCrossing:
    """phi_c of the rows. Two halves of one crater say little about its own asymmetry, so that of all is pooled.

    What all beds or all craters share by their cameras does not average out: another scale of the crater's camera
    multiplies all volumes and leaves their zero; another of the bed's multiplies all phi, and so phi_c.
    """
    known = [r for r in rows if r["volume_fraction"] is not None]
    v, total, noise, phi, dphi = (
        np.array([r[c] if r[c] is not None else math.nan for r in known], float)
        for c in ("volume_m3", "sigma_m3", "noise_sigma_m3", "volume_fraction", "sigma_volume_fraction")
    )
    alike, alike_phi = (
        np.array([r[c] or 0.0 for r in known]) for c in ("sigma_common_m3", "sigma_common_volume_fraction")
    )
    own, own_phi = independent(total, alike), independent(dphi, alike_phi)
    uneven = np.mean(np.maximum(own**2 - noise**2, 0.0)) / TWO_HALVES**2 if known else 0.0
    found = critical_fraction(phi, own_phi, v, np.sqrt(noise**2 + uneven))
    return found.with_common(found.value * float(np.mean(alike_phi / phi)) if known else 0.0)


def write_craters(rows: list[dict[str, Any]], found: ZeroCrossing, results: Path) -> list[Path]:
    """craters.csv and, in fits.json of the campaign, phi_c with its 95 % interval; the files written."""
    if not rows:
        return []
    text = io.StringIO()
    table = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    table.writeheader()
    table.writerows(rows)
    write_aside(results / "craters.csv", text.getvalue())
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
    write_aside(results / "fits.json", json.dumps(plain({"phi_c": entry}), indent=1) + "\n")
    return [results / "craters.csv", results / "fits.json"]
