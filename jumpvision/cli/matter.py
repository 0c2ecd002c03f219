"""Commands on the matter under a foot alone: discs in two dimensions, resistive forces on any shape in three."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from .app import DONE, app, cores, option

if TYPE_CHECKING:
    from jumpvision.thesis.studies.sand.discs import DiscBed

_bed, _foot, _grains = (partial(option, group=f"The {of}") for of in ("bed", "foot", "grains"))
_way = partial(option, group="Motion: LO:HI:N, or one value")


@Parameter(name="*", show_default=False)
@dataclass(frozen=True)
class DiscOptions:
    """Numbers of the bed and the foot; those not given are the usual ones of studies.sand.discs.DiscBed."""

    bed: Annotated[str | None, _bed("How the discs lie: random (usual), hexagonal, square.")] = None
    fraction: Annotated[float | None, _bed("Of the area; usual: 0.72, hexagonal 0.85, square 0.75.")] = None
    sizes: Annotated[str | None, _bed("Of a random bed: bi (usual, ratio 1.4), mono, poly.")] = None
    diameter: Annotated[float | None, _bed("Of a grain [m], mean; usual 0.001.")] = None
    half_width: Annotated[float | None, _bed("Of the bed [m]; usual 0.05.")] = None
    depth: Annotated[float | None, _bed("Of the bed [m]; usual 0.07.")] = None
    carpet: Annotated[float | None, _bed("Deceleration of a sliding disc [m/s^2]; usual 10.")] = None
    friction: Annotated[float | None, _bed("Coefficient between grains; usual 0.")] = None
    restitution: Annotated[float | None, _bed("Of a collision; usual 0.5.")] = None
    density: Annotated[float | None, _bed("Of a disc [kg/m^2]; usual 1.")] = None
    foot: Annotated[float | None, _foot("Half width of the foot [m]; usual 0.015.")] = None
    stroke: Annotated[float | None, _foot("How deep it goes [m]; usual 0.008.")] = None
    speed: Annotated[float | None, _foot("Its speed [m/s]; usual 0.4.")] = None


@Parameter(name="*")
@dataclass(frozen=True)
class MatterOutput:
    """Where results go, and how much of the machine is used."""

    results: Annotated[Path | None, Parameter(help="Folder for the files; default: results/COMMAND.")] = None
    workers: Annotated[int | None, Parameter(help="Processes; default: the cores.")] = None
    json: Annotated[bool, Parameter(negative="", help="Machine-readable result on stdout.")] = False
    pictures: Annotated[bool, Parameter(help="Draw the figure.")] = True


@app.command
def dem(
    *,
    beds: int = 2,
    seed: int = 0,
    experiment: tuple[Path, ...] = (),
    options: DiscOptions = DiscOptions(),
    output: MatterOutput = MatterOutput(),
) -> int:
    """Discs under a flat foot (thesis Fig 53): what jams below it, its sides, its mass: dem.nc, dem.json, dem.png.

    Example: jumpvision dem --bed hexagonal --beds 1

    Parameters
    ----------
    experiment
        Folders of jumps with a film of the grains, one after another: the foot goes as filmed, and the discs' momentum
        and added mass are read as the film's are: dem.csv, dem.json, dem.png.
    beds
        Random beds alike, one a process; their scatter is the uncertainty. A lattice has one. 0: films alone.
    seed
        Of the first random bed.
    """
    from dataclasses import asdict

    from jumpvision.base.schema import InputError
    from jumpvision.base.storage import write_bytes_aside
    from jumpvision.thesis.studies.sand.discs import checked, measured, run_beds, write_discs

    from . import terminal as show

    bed = checked({n: v for n, v in asdict(options).items() if v is not None})
    least = 0 if experiment else 1
    if not least <= beds <= 1000 or seed < 0:
        raise InputError([f"dem: beds = {beds} must be in [{least}, 1000] and seed = {seed} at least 0"])
    if experiment:
        return _beside(experiment, bed, {n for n, v in asdict(options).items() if v is not None}, beds, seed, output)
    count = beds if bed.bed == "random" else 1
    show.line(f"{count} {'beds' if count > 1 else 'bed'} of discs ({bed.bed}, area fraction {bed.filled:g}) ...")
    with show.progress():
        runs = run_beds(bed, count, seed, output.workers or cores())
    results = output.results or Path("results/dem")
    files = write_discs(runs, bed, results, "jumpvision " + shlex.join(sys.argv[1:]))
    numbers = measured(runs)
    if output.pictures:
        from jumpvision.thesis.figures.matter import disc_picture

        files.append(results / "dem.png")
        write_bytes_aside(files[-1], disc_picture(runs, bed, numbers))
    rows = [{"what": name, "value": value} for name, value in asdict(numbers).items()]
    show.written(asdict(numbers), rows, files, as_json=output.json)
    return DONE


def _beside(
    folders: tuple[Path, ...], bed: DiscBed, given: set[str], beds: int, seed: int, output: MatterOutput
) -> int:
    """Discs under the feet of films."""
    from dataclasses import asdict

    from jumpvision.base.schema import InputError
    from jumpvision.base.storage import write_bytes_aside
    from jumpvision.thesis.studies.sand import beside

    from . import terminal as show

    fixed = sorted(given & {"half_width", "depth", "foot", "stroke", "speed", "density", "restitution", "sizes"})
    why = "with --experiment it follows from the film, or is fixed; leave it out"
    problems = [f"dem --{n.replace('_', '-')}: {why}" for n in fixed]
    if bed.bed != "random":
        problems.append(f"dem --bed {bed.bed}: with --experiment the bed is random, of two sizes; leave it out")
    if problems:
        raise InputError(problems)
    results = output.results or Path("results/dem")
    with show.progress():
        films = [beside.film_of(f, results) for f in folders]
        runs = beside.run_beside(films, bed, beds, seed, output.workers or cores())
    files = beside.write_beside(films, runs, bed, results, "jumpvision " + shlex.join(sys.argv[1:]))
    rows = [asdict(beside.compared(f, r)) for f, r in zip(films, runs)]
    if output.pictures:
        from jumpvision.thesis.figures.matter import beside_picture

        files.append(results / "dem.png")
        write_bytes_aside(files[-1], beside_picture(films, runs))
    show.written({"films": rows}, rows, files, as_json=output.json)
    return DONE


@Parameter(name="*", show_default=False)
@dataclass(frozen=True)
class FootOptions:
    """Numbers of the foot and the grains; those not given are the usual ones of studies.sand.feet.Foot."""

    shape: Annotated[str | None, _foot("disc (usual), cone (tip down), sphere, box.")] = None
    radius: Annotated[float | None, _foot("Of disc, cone, sphere [m]; usual 0.0381.")] = None
    height: Annotated[float | None, _foot("Of disc, cone, box [m]; usual 0.01.")] = None
    length: Annotated[float | None, _foot("Of the box along the tilt [m]; usual 0.06.")] = None
    width: Annotated[float | None, _foot("Of the box across [m]; usual 0.06.")] = None
    unit: Annotated[str | None, _foot("Of the STL file: mm (usual), m, cm, in.")] = None
    law: Annotated[str | None, _grains("3d (usual; Agarwal 2023) or 2d (Li 2013).")] = None
    scale: Annotated[float | None, _grains("Stress per depth of a plate going down [N/m^3]; usual 4.6e5.")] = None
    friction: Annotated[float | None, _grains("Of the foot's surface, law 3d; usual 0.4.")] = None
    density: Annotated[float | None, _grains("Of the bed [kg/m^3], for the inertia; usual 570.")] = None
    inertia: Annotated[float | None, _grains("Factor of density v_n^2; usual 1.1.")] = None
    rise: Annotated[float | None, _grains("Of the surface at the foot [m]; usual 0.")] = None
    speed: Annotated[float | None, _foot("Of the foot [m/s]; usual 0, slow.")] = None


@app.command
def rft(
    *,
    stl: Annotated[Path | None, _foot("The foot as an STL file, z up, its axis x = y = 0.")] = None,
    table: Annotated[Path | None, _grains("CSV of measured stresses (docs/rft.md) in place of law and scale.")] = None,
    depth: Annotated[str, _way("Of the lowest point [m]; usual 0:0.06:31.")] = "0:0.06:31",
    tilt: Annotated[str, _way("About y [deg]; usual 0.")] = "0",
    attack: Annotated[str, _way("Of the motion below the horizontal [deg]; usual 90, straight down.")] = "90",
    options: FootOptions = FootOptions(),
    output: MatterOutput = MatterOutput(),
) -> int:
    """Force and torque of grains on a foot of any shape by resistive force theory: rft.csv, rft.json, rft.png.

    model.toml is the foot, at the first tilt, as the ground of simulate, sweep and plan (--model).

    Example: jumpvision rft --stl foot.stl --unit mm --tilt 0:30:4 --scale 4.6e5
    """
    from dataclasses import asdict

    from jumpvision.base.storage import write_bytes_aside
    from jumpvision.thesis.studies.sand import feet

    from . import terminal as show

    foot = feet.checked({n: v for n, v in asdict(options).items() if v is not None})
    axes = [
        feet.axis("depth", depth, -1.0, 10.0, "m"),
        feet.axis("tilt", tilt, -90.0, 90.0, "deg"),
        feet.axis("attack", attack, -90.0, 90.0, "deg"),
    ]
    stresses = feet.read_table(table) if table else None
    triangles, grains = feet.body(foot, stl), feet.grains_of(foot, stresses)
    with show.progress():
        found = feet.forces(foot, triangles, grains, *axes)
    results, numbers = output.results or Path("results/rft"), feet.numbers(triangles, found, grains)
    facts = feet.facts_of(foot, table, stl, numbers, "jumpvision " + shlex.join(sys.argv[1:]))
    files = feet.write_forces(found, facts, [f for f in (stl, table) if f], results)
    files.append(results / "model.toml")
    law = feet.profile_of(foot, triangles, grains, float(axes[1][0]))
    write_bytes_aside(files[-1], feet.ground_law(law, grains, str(facts["command"])).encode())
    if output.pictures:
        from jumpvision.thesis.figures.matter import foot_picture

        files.append(results / "rft.png")
        write_bytes_aside(files[-1], foot_picture(triangles, found, foot))
    rows = [{"what": name, "value": value} for name, value in asdict(numbers).items()]
    show.written(asdict(numbers), rows, files, as_json=output.json)
    return DONE
