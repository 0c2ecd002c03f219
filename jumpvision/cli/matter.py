"""Commands on the matter under a foot alone: discs in two dimensions."""

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
    """Numbers of the bed and the foot; those not given are the usual ones of studies.discs.DiscBed."""

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
    from jumpvision.studies.discs import checked, measured, run_beds, write_discs

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
        from jumpvision.report.figures.matter import disc_picture

        files.append(results / "dem.png")
        write_bytes_aside(files[-1], disc_picture(runs, bed, numbers))
    told = asdict(numbers)
    rows = [{"what": name, "value": value} for name, value in told.items()]
    show.result(told | {"files": [str(f) for f in files]}, rows, as_json=output.json)
    show.line(f"results in {results}: {', '.join(f.name for f in files)}")
    return DONE
