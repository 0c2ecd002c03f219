"""Jumps over axes and the analyses of the thesis: `jumpvision sweep`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ..api import results_of
from .app import DONE, app, cores


def _axis(text: str) -> Parameter:
    return Parameter(help=text, group="Axes: LO:HI:N, or one value; SI units")


@Parameter(name="*", show_default=False)
@dataclass(frozen=True)
class SweepAxes:
    """The axes of a sweep, in the order of its dimensions; what they mean is checked in sweep.axes."""

    frequency: Annotated[str | None, _axis("Forcing frequency [Hz].")] = None
    phase: Annotated[str | None, _axis("Start phase [rad]; pi/2 is a stutter jump, 3 pi/2 a single jump.")] = None
    amplitude: Annotated[str | None, _axis("Forcing amplitude A [m].")] = None
    delay: Annotated[str | None, _axis("Pause between the two half cycles [s].")] = None
    frequency2: Annotated[str | None, _axis("Frequency of the second half cycle [Hz].")] = None
    cycles: Annotated[str | None, _axis("Number of forcing cycles.")] = None
    alpha: Annotated[str | None, _axis("M g/(k A): sets the amplitude, or gravity with --amplitude.")] = None
    gravity: Annotated[str | None, _axis("Gravity along the rail [m/s^2].")] = None
    rod_mass: Annotated[str | None, _axis("Mass of the rod [kg]; the total mass is kept.")] = None
    motor_mass: Annotated[str | None, _axis("Mass of the motor [kg].")] = None
    stiffness: Annotated[str | None, _axis("Stiffness of the spring [N/m].")] = None
    zeta: Annotated[str | None, _axis("Damping ratio c / (2 sqrt(k M)).")] = None
    phi: Annotated[str | None, _axis("Volume fraction of the bed (granular).")] = None
    foot_radius: Annotated[str | None, _axis("Radius of the foot [m] (granular).")] = None


@app.command
def sweep(
    ground: str,
    /,
    *,
    axes: SweepAxes = SweepAxes(),
    analysis: str = "map",
    experiment: Path | None = None,
    campaign: Path | None = None,
    model: Path | None = None,
    laws: Path | None = None,
    results: Path | None = None,
    settings: Annotated[tuple[str, ...], Parameter(name="--set", negative="")] = (),
    json: bool = False,
    workers: int | None = None,
    pictures: bool = True,
) -> int:
    """Jumps over any axes, or a named analysis of thesis chapters II and III: sweep.nc and sweep.png (or comparison.*).

    Example: jumpvision sweep hard --frequency 4:18:200 --phase 0:6.283:200

    Parameters
    ----------
    ground
        hard or granular.
    analysis
        map, or on hard ground minimum-amplitude, lift-off-time, alpha, scatter, bifurcation, traces, estimates,
        animals, two-frequency, comparison (of the measured jumps of --campaign with their simulation); on granular
        ground height-phi, jump-types, delay, alpha-fit, force-models, drag-scale, foot-radius,
        drag-fit (b or alpha against packing, to the measured jumps of --campaign).
    experiment
        An experiment.toml, or its folder, that gives robot, law and model; default: the thesis' robot.
    campaign
        Folder of experiments for --analysis comparison or drag-fit.
    model
        A TOML file whose [model] replaces the model, e.g. model.toml.
    laws
        A TOML file of the bed's parameters against volume fraction; named analyses on granular ground default to an
        example (docs/granular.md).
    results
        Folder for the files; default: results/sweep, or results/NAME beside the campaign.
    settings
        Override a value: section.key=value, e.g. robot.gravity=9.81.
    json
        Machine-readable result on stdout.
    workers
        Cores to use; default: all.
    pictures
        Draw the figure.
    """
    from dataclasses import asdict

    from .. import show
    from ..experiment import folder_of
    from ..overrides import parse
    from ..progress import HOOK
    from ..sweep.dataset import write
    from ..sweep.run import run as run_sweep

    given = {name: text for name, text in asdict(axes).items() if text is not None}
    results = results or (results_of(folder_of(campaign)) if campaign else Path("results/sweep"))
    with show.Progress(1) as progress:
        token = HOOK.set(progress.frames)
        try:
            data, rows = run_sweep(
                ground, given, analysis=analysis, experiment=experiment, overrides=parse(settings),
                workers=workers or cores(), say=show.line, model=model, laws=laws, campaign=campaign,
                results=results,
            )  # fmt: skip
        finally:
            HOOK.reset(token)
    stem = analysis if campaign else "sweep"
    files = [write(data, results, f"{stem}.nc")]
    if pictures:
        from ..report.sweeps import picture

        files.append(results / f"{stem}.png")
        files[1].write_bytes(picture(data))
    show.result({"results": str(results), "files": [str(f) for f in files], "numbers": rows}, rows, as_json=json)
    show.line(f"results in {results}: {', '.join(f.name for f in files)}")
    return DONE
