"""Films of jumps beside each other (thesis Fig 52), and discs under their feet, read as the films are (Fig 53b, c)."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from jumpvision.base.arrays import Array
from jumpvision.base.progress import WORKERS, in_parts, setting
from jumpvision.base.record import plain
from jumpvision.base.schema import InputError
from jumpvision.base.storage import write_aside
from jumpvision.experiment.inputs.experiment import Experiment, open_experiment
from jumpvision.experiment.inputs.parameters import FlowParams
from jumpvision.experiment.inputs.sections import Bed, GrainVideo, PivField, Robot
from jumpvision.experiment.results.fields import Flow, Piv
from jumpvision.experiment.results.values import BedHeight
from jumpvision.experiment.stages.bed.height import packing
from jumpvision.experiment.stages.grains.flow import Sums, under_the_foot
from jumpvision.experiment.workflow.entries import versions
from jumpvision.experiment.workflow.stage import results_stages
from jumpvision.experiment.workflow.workspace import Workspace
from jumpvision.laboratory.dem.motion import Friction, discs_under_foot

from .disc_field import field_of_discs
from .discs import DiscBed

LARGE = 0.1  # of the film's greatest momentum: frames from there on tell the scale factor
WIDER, DEEPER = 1.25, 1.5  # the bed beyond the picture: what its walls throw back comes late
CSV = "dem.csv"
SERIES = ("momentum", "added_mass")


@dataclass(frozen=True)
class Film:
    """What a film shows of a jump: its field, what stage flow reads of it over t, the foot, the bed's rho phi.

    radius [m] of the foot; density: rho phi [kg/m^3]; disc: "half" or "full".
    """

    name: str
    kind: str
    piv: Piv
    flow: xr.Dataset
    radius: float
    density: float
    source: GrainVideo | PivField
    p: FlowParams


def film_of(folder: Path, results: Path) -> Film:
    """The film of an experiment, matched where that is not in the cache of `results`. InputError names what lacks."""
    results_stages()  # are imported
    e = open_experiment(folder)
    robot, bed, actuation = (e.sections.get(n) for n in ("robot", "bed", "actuation"))
    source = e.sections.get("piv_field") or e.sections.get("grain_video")
    workspace = Workspace(e, results / e.name, results / ".cache")
    phi = _phi(e, workspace)
    radius = robot.foot_radius if robot else None
    lacking = [] if source is not None else ["[grain_video] or [piv_field]"]
    lacking += [] if radius else ["[robot] foot_radius"]
    lacking += [] if phi else ["[bed] volume_fraction, or solid_volume, length, width and a [bed_image]"]
    if lacking or source is None or radius is None or phi is None:
        raise InputError([f"dem --experiment {folder}: {', '.join(lacking)} missing; a film of the grains needs it"])
    piv, flow = workspace.make(Piv), workspace.make(Flow).field.load()
    if "momentum" not in flow or not np.isfinite(flow.momentum).any():
        raise InputError([f"dem --experiment {folder}: no foot in its film; give foot_row, axis_column and scale"])
    kind = actuation.kind if actuation else ""
    p = FlowParams(**e.params.get("flow", {}))
    return Film(e.name, kind, piv, flow, radius, (bed or Bed()).grain_density * phi, source, p)


def _phi(e: Experiment, workspace: Workspace) -> float | None:
    """Volume fraction as given or as the picture of the bed shows it."""
    measured = workspace.make(BedHeight) if "bed_image" in e.sections else None
    return packing(e.sections.get("bed"), measured)[0]


def path_of(film: Film) -> tuple[Array, Array]:
    """Times (n + 1,) [s] between the film's fields, and the height of the foot's face there [m], 0 at the surface."""
    t = film.flow.t.values
    y = -film.flow.foot_depth.values
    known = np.isfinite(y)
    middle = 0.5 * (t[1:] + t[:-1])
    edges = np.concatenate([[2.0 * t[0] - middle[0]], middle, [2.0 * t[-1] - middle[-1]]])
    return edges, np.interp(edges, t[known], y[known])


def hole_of(film: Film) -> float:
    """Depth [m] of the hole in which the film begins: where the foot first has grains to push; 0 where it lies on them.

    A foot that is still in the air has momentum over speed, but hardly any: below LARGE of the greatest added mass.
    """
    depth, mass = film.flow.foot_depth.values, film.flow.added_mass.values
    pushing = np.flatnonzero(mass > LARGE * np.nanmax(mass))
    return float(depth[pushing[0]]) if pushing.size and pushing[0] > 0 else float(depth[np.isfinite(depth)][0])


def read_discs(seed: int, film: Film, bed: DiscBed) -> xr.Dataset:
    """One bed under the film's foot: momentum and added mass over the film's t by the code that reads the film.

    The hole in which the film begins is dug before. Their field lies on the film's own grid, smoothed as by its
    windows; rho phi is the film's too.
    """
    grid, (times, face) = film.piv.geometry, path_of(film)
    left, right, bottom, _ = grid.edges
    at = face[0]  # heights of the field count from the face in the first frame
    discs, motion = discs_under_foot(
        times,
        face,
        times,
        half_width=film.radius,
        bed=(WIDER * max(-left, right), -DEEPER * (bottom + at)),
        diameter=bed.diameter,
        fraction=bed.filled,
        rng=np.random.default_rng(seed),
        friction=Friction(bed.carpet, bed.friction),
        deepest=-hole_of(film),
    )
    x, y = np.sort(film.piv.field.x.values), np.sort(film.piv.field.y.values)
    width = grid.window_px * grid.scale_m_per_px / math.sqrt(12.0)  # of a Gaussian as wide as the film's windows
    found = field_of_discs(times, motion.x, motion.y, discs.mass, motion.foot_y, grid_x=x, grid_y=y + at, width=width)
    sums = Sums(found.geometry, film.source.foot, film.density)
    robot = Robot(foot_radius=film.radius)
    read = under_the_foot(found, sums, film.source, robot, film.p)
    return xr.Dataset({n: ("t", values, {"units": u}) for n, (values, u) in read.items()}, coords={"t": film.flow.t})


@dataclass(frozen=True)
class Beside:
    """A film and its beds of discs in numbers; kg m/s, sigmas of the mean over the beds (None: one bed). Without beds
    the film alone.

    scale: film over discs, the factor of the least squares over frames of large momentum; left: rms of what it leaves,
    over the film's peak.
    """

    experiment: str
    kind: str
    beds: int
    peak_film: float
    peak_discs: float | None = None
    scale: float | None = None
    scale_sigma: float | None = None
    left: float | None = None


def compared(film: Film, runs: Sequence[xr.Dataset]) -> Beside:
    """The scale factor between a film's momentum and that of its discs."""
    seen = film.flow.momentum.values
    peak = float(np.nanmax(seen))
    if not runs:
        return Beside(film.name, film.kind, 0, peak)
    discs = np.stack([r.momentum.values for r in runs])
    use = np.isfinite(seen) & np.isfinite(discs).all(axis=0) & (np.abs(seen) > LARGE * np.nanmax(seen))
    if use.sum() < 3:
        why = f"film and discs share momentum in {use.sum()} frames; three are needed"
        raise InputError([f"dem --experiment {film.name}: {why}"])
    scales = (discs[:, use] @ seen[use]) / np.sum(discs[:, use] ** 2, axis=1)
    mean = discs.mean(axis=0)
    scale = float(mean[use] @ seen[use] / np.sum(mean[use] ** 2))
    left = float(np.sqrt(np.mean((seen - scale * mean)[use] ** 2)) / peak)
    sigma = float(scales.std(ddof=1) / math.sqrt(len(runs))) if len(runs) > 1 else None
    return Beside(film.name, film.kind, len(runs), peak, float(np.nanmax(mean)), scale, sigma, left)


def run_beside(films: Sequence[Film], bed: DiscBed, beds: int, seed: int, workers: int) -> list[list[xr.Dataset]]:
    """By film the beds of the seeds seed, seed + 1 ..., one a process."""
    with setting(WORKERS, workers):
        return [list(in_parts(read_discs, range(seed, seed + beds), film, bed)) for film in films]


def table_of(film: Film, runs: Sequence[xr.Dataset]) -> pd.DataFrame:
    """A row a field of the film: the film's values with sigma; of the beds, if any, the mean with their scatter."""
    out = {"experiment": film.name, "time_s": film.flow.t.values, "foot_depth_m": film.flow.foot_depth.values}
    for name, unit in zip(SERIES, ("kg_m_s", "kg")):
        out[f"{name}_film_{unit}"] = film.flow[name].values
        out[f"{name}_film_sigma_{unit}"] = film.flow[f"{name}_sigma"].values
        if not runs:
            continue
        beds = np.stack([r[name].values for r in runs])
        scatter = beds.std(axis=0, ddof=1) if len(runs) > 1 else np.full(beds.shape[1], np.nan)
        out[f"{name}_discs_{unit}"], out[f"{name}_discs_scatter_{unit}"] = beds.mean(axis=0), scatter
    return pd.DataFrame(out)


def write_beside(
    films: Sequence[Film], runs: Sequence[Sequence[xr.Dataset]], bed: DiscBed, folder: Path, command: str
) -> list[Path]:
    """dem.csv and dem.json, each in one step."""
    files = [folder / CSV, folder / "dem.json"]
    rows = pd.concat([table_of(f, r) for f, r in zip(films, runs)], ignore_index=True)
    write_aside(files[0], rows.to_csv(index=False, lineterminator="\n"))
    facts = {"command": command, "versions": versions(), "bed": asdict(bed)}
    numbers = [asdict(compared(f, r)) for f, r in zip(films, runs)]
    write_aside(files[1], json.dumps(plain(facts | {"films": numbers}), indent=1) + "\n")
    return files
