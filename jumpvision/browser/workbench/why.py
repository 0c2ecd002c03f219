"""Why a jump stands out, of what its results hold: the model's residual, the frame where it is greatest, the logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jumpvision.base.record import plain
from jumpvision.base.schema import InputError
from jumpvision.engine.document.diagnosis import Diagnosis, chance
from jumpvision.engine.document.varies import clauses
from jumpvision.experiment.campaign.folder import results_of
from jumpvision.experiment.inputs.experiment import CAMPAIGN, EXPERIMENT
from jumpvision.experiment.inputs.model import read_toml
from jumpvision.experiment.results.tables import RodMotion, Simulation, Track
from jumpvision.jumper.question.words import words_of
from jumpvision.report.pages.quantities import typeset
from jumpvision.report.pages.verdict import mechanism_said

from .draft import Draft, composed
from .earlier import places_of
from .glance import loaded
from .logs import Trace, thinned, traces

POINTS = 1200  # of the line


@dataclass(frozen=True)
class Why:
    """t [s] and y [m]: measured minus simulated, or the height where nothing was simulated. at [s], greatest [m]: where
    it is largest; frame of the rod's film there, None without a film. causes, says: of the diagnosis, a line each: why,
    and how far."""

    experiment: str
    simulated: bool
    t: list[float]
    y: list[float]
    at: float
    greatest: float
    frame: int | None
    causes: list[str]
    says: list[str]
    logs: Sequence[Trace]


def why(name: str, folder: Path, whole: Path) -> Why:
    """Of one experiment. InputError where no run has measured its rod."""
    results = places_of(folder, whole)[0]
    rod, model, track = loaded(RodMotion, results), loaded(Simulation, results), loaded(Track, results)
    if rod is None:
        raise InputError([f"{results}: no {RodMotion.file}: run {name} first"])
    t, height, _ = rod.arrays
    y = height if model is None else rod.beside(model).difference
    good = np.flatnonzero(np.isfinite(y))
    if not good.size:
        raise InputError([f"{results / RodMotion.file}: no height in it"])
    k = int(good[np.argmax(np.abs(y[good]))])
    frame = None
    if track is not None:
        frame = int(track.table.frame.iloc[int(np.argmin(np.abs(track.table.time_s.to_numpy(float) - t[k])))])
    line_t, line_y = thinned(t[good], y[good], POINTS)
    d = loaded(Diagnosis, results_of(whole))
    return Why(
        name,
        model is not None,
        plain(line_t),
        plain(line_y),
        float(t[k]),
        float(y[k]),
        frame,
        causes(d, name),
        said(d, name),
        logs(folder),
    )


def causes(d: Diagnosis | None, name: str) -> list[str]:
    """What a diagnosis says is lacking in the simulation of all jumps, and what is odd about this one."""
    if d is None:
        return []
    own = clauses([v for v in d.varies if v.established and name in v.recordings], words_of(d))
    named = next((c for c in d.models if d.names(c)), None)
    if named is None:
        none = "the model is adequate" if d.adequate else "no cause is named" if not own else ""
        return [*own, *([f"diagnosis: {none}"] if none else [])]
    lacks = " and ".join(mechanism_said(d, m) for m in named.mechanisms)
    return [*own, f"the model lacks: {lacks} (probability {chance(named.probability)}; {typeset(named.words)})"]


def said(d: Diagnosis | None, name: str) -> list[str]:
    """What a diagnosis knows of this jump: how far its models miss the height, and where jumps of its kind differ."""
    height = next((h for h in d.heights if h.experiment == name), None) if d else None
    if d is None or height is None:
        return []
    missed = {"model": height.simulated_m, "extended model": height.extended_m}
    out = [f"{who}: height {1e3 * (h - height.measured_m):+.2f} mm" for who, h in missed.items() if np.isfinite(h)]
    cells = [c for c in d.where if c.kind == height.kind]
    if cells:
        c = max(cells, key=lambda c: abs(c.mean_residual_m))
        words = c.phase_of_jump.replace("_", " ")
        out.append(f"jumps of its kind: measured - simulated is largest in {words}, {1e3 * c.mean_residual_m:+.2f} mm")
    return out


def logs(folder: Path) -> Sequence[Trace]:
    """The logs that its experiment.toml names."""
    file = folder / EXPERIMENT
    if not file.exists():
        return []
    above = folder.resolve().parent / CAMPAIGN
    inherited = read_toml(above)[0] if above.exists() else {}
    return traces(composed(folder, file.read_text(encoding="utf-8-sig"), inherited, {}, Draft()))
