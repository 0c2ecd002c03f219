"""Commands on the matter under a foot alone: discs in two dimensions, resistive forces on any shape in three."""

from __future__ import annotations

import shlex
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from .app import DONE, app, cores


def _of(text: str, group: str) -> Parameter:
    return Parameter(help=text, group=group)


BED, FOOT = "The bed", "The foot"


@Parameter(name="*", show_default=False)
@dataclass(frozen=True)
class DiscOptions:
    """Numbers of the bed and the foot; those not given are the usual ones of studies.sand.discs.DiscBed."""

    bed: Annotated[str | None, _of("How the discs lie: random (usual), hexagonal, square.", BED)] = None
    fraction: Annotated[float | None, _of("Of the area; usual: 0.72, hexagonal 0.85, square 0.75.", BED)] = None
    sizes: Annotated[str | None, _of("Of a random bed: bi (usual, ratio 1.4), mono, poly.", BED)] = None
    diameter: Annotated[float | None, _of("Of a grain [m], mean; usual 0.001.", BED)] = None
    half_width: Annotated[float | None, _of("Of the bed [m]; usual 0.05.", BED)] = None
    depth: Annotated[float | None, _of("Of the bed [m]; usual 0.07.", BED)] = None
    carpet: Annotated[float | None, _of("Deceleration of a sliding disc [m/s^2]; usual 10.", BED)] = None
    friction: Annotated[float | None, _of("Coefficient between grains; usual 0.", BED)] = None
    restitution: Annotated[float | None, _of("Of a collision; usual 0.5.", BED)] = None
    density: Annotated[float | None, _of("Of a disc [kg/m^2]; usual 1.", BED)] = None
    foot: Annotated[float | None, _of("Half width of the foot [m]; usual 0.015.", FOOT)] = None
    stroke: Annotated[float | None, _of("How deep it goes [m]; usual 0.008.", FOOT)] = None
    speed: Annotated[float | None, _of("Its speed [m/s]; usual 0.4.", FOOT)] = None


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
    *, beds: int = 2, seed: int = 0, options: DiscOptions = DiscOptions(), output: MatterOutput = MatterOutput()
) -> int:
    """Discs under a flat foot (thesis Fig 53): what jams below it, its sides, its mass: dem.nc, dem.json, dem.png.

    Example: jumpvision dem --bed hexagonal --beds 1

    Parameters
    ----------
    beds
        Random beds alike, one a process; their scatter is the uncertainty. A lattice has one.
    seed
        Of the first random bed.
    """
    from dataclasses import asdict

    from jumpvision.base.progress import HOOK
    from jumpvision.base.schema import InputError
    from jumpvision.base.storage import write_bytes_aside
    from jumpvision.thesis.studies.sand.discs import checked, measured, run_beds, write_discs

    from . import terminal as show

    bed = checked({n: v for n, v in asdict(options).items() if v is not None})
    if not 1 <= beds <= 1000 or seed < 0:
        raise InputError([f"dem: beds = {beds} must be in [1, 1000] and seed = {seed} at least 0"])
    count = beds if bed.bed == "random" else 1
    show.line(f"{count} {'beds' if count > 1 else 'bed'} of discs ({bed.bed}, area fraction {bed.filled:g}) ...")
    with show.Progress(1) as progress:
        token = HOOK.set(progress.frames)
        try:
            runs = run_beds(bed, count, seed, output.workers or cores())
        finally:
            HOOK.reset(token)
    results = output.results or Path("results/dem")
    files = write_discs(runs, bed, results, "jumpvision " + shlex.join(sys.argv[1:]))
    numbers = measured(runs)
    if output.pictures:
        from jumpvision.thesis.figures.matter import disc_picture

        files.append(results / "dem.png")
        write_bytes_aside(files[-1], disc_picture(runs, bed, numbers))
    told = asdict(numbers)
    rows = [{"what": name, "value": value} for name, value in told.items()]
    show.result(told | {"files": [str(f) for f in files]}, rows, as_json=output.json)
    show.line(f"results in {results}: {', '.join(f.name for f in files)}")
    return DONE


GRAINS, WAY = "The grains", "Motion: LO:HI:N, or one value"


@Parameter(name="*", show_default=False)
@dataclass(frozen=True)
class FootOptions:
    """Numbers of the foot and the grains; those not given are the usual ones of studies.sand.feet.Foot."""

    shape: Annotated[str | None, _of("disc (usual), cone (tip down), sphere, box.", FOOT)] = None
    radius: Annotated[float | None, _of("Of disc, cone, sphere [m]; usual 0.0381.", FOOT)] = None
    height: Annotated[float | None, _of("Of disc, cone, box [m]; usual 0.01.", FOOT)] = None
    length: Annotated[float | None, _of("Of the box along the tilt [m]; usual 0.06.", FOOT)] = None
    width: Annotated[float | None, _of("Of the box across [m]; usual 0.06.", FOOT)] = None
    unit: Annotated[str | None, _of("Of the STL file: mm (usual), m, cm, in.", FOOT)] = None
    law: Annotated[str | None, _of("3d (usual; Agarwal 2023) or 2d (Li 2013).", GRAINS)] = None
    scale: Annotated[float | None, _of("Stress per depth of a plate going down [N/m^3]; usual 4.6e5.", GRAINS)] = None
    friction: Annotated[float | None, _of("Of the foot's surface, law 3d; usual 0.4.", GRAINS)] = None
    density: Annotated[float | None, _of("Of the bed [kg/m^3], for the inertia; usual 570.", GRAINS)] = None
    inertia: Annotated[float | None, _of("Factor of density v_n^2; usual 1.1.", GRAINS)] = None
    rise: Annotated[float | None, _of("Of the surface at the foot [m]; usual 0.", GRAINS)] = None
    speed: Annotated[float | None, _of("Of the foot [m/s]; usual 0, slow.", FOOT)] = None


@app.command
def rft(
    *,
    stl: Annotated[Path | None, _of("The foot as an STL file, z up, its axis x = y = 0.", FOOT)] = None,
    table: Annotated[
        Path | None, _of("CSV of measured stresses (docs/rft.md) in place of law and scale.", GRAINS)
    ] = None,
    depth: Annotated[str, _of("Of the lowest point [m]; usual 0:0.06:31.", WAY)] = "0:0.06:31",
    tilt: Annotated[str, _of("About y [deg]; usual 0.", WAY)] = "0",
    attack: Annotated[str, _of("Of the motion below the horizontal [deg]; usual 90, straight down.", WAY)] = "90",
    options: FootOptions = FootOptions(),
    output: MatterOutput = MatterOutput(),
) -> int:
    """Force and torque of grains on a foot of any shape by resistive force theory: rft.csv, rft.json, rft.png.

    Example: jumpvision rft --stl foot.stl --unit mm --tilt 0:30:4 --scale 4.6e5
    """
    from dataclasses import asdict

    from jumpvision.base.progress import HOOK
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
    with show.Progress(1) as progress:
        token = HOOK.set(progress.frames)
        try:
            found = feet.forces(foot, triangles, grains, *axes)
        finally:
            HOOK.reset(token)
    results, numbers = output.results or Path("results/rft"), feet.numbers(triangles, found, grains)
    told = feet.told_of(foot, table, stl, numbers, "jumpvision " + shlex.join(sys.argv[1:]))
    files = feet.write_forces(found, told, [f for f in (stl, table) if f], results)
    if output.pictures:
        from jumpvision.thesis.figures.matter import foot_picture

        files.append(results / "rft.png")
        write_bytes_aside(files[-1], foot_picture(triangles, found, foot))
    rows = [{"what": name, "value": value} for name, value in asdict(numbers).items()]
    show.result(asdict(numbers) | {"files": [str(f) for f in files]}, rows, as_json=output.json)
    show.line(f"results in {results}: {', '.join(f.name for f in files)}")
    return DONE
