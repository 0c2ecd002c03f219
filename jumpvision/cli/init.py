"""First folders: an experiment.toml (`init`, or by eye: `open`), or a campaign of the virtual laboratory (`synth`)."""

from __future__ import annotations

from contextlib import closing
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from .app import DONE, app, option

if TYPE_CHECKING:
    from jumpvision.experiment.init.measure import Picks


_which = partial(option, group="Which recording is what, where names do not say")
_eye = partial(option, group="Chosen by eye; --pick opens the workbench for these")


@Parameter(name="*", show_default=False)
@dataclass(frozen=True)
class Which:
    """Recordings by their role."""

    rod: Annotated[str | None, _which("Film of the ball on the rod.")] = None
    grain: Annotated[str | None, _which("Film of the grains under the foot.")] = None
    bed: Annotated[str | None, _which("Picture, or series, of the bed.")] = None
    crater: Annotated[str | None, _which("Picture of the laser line.")] = None


@Parameter(name="*", show_default=False)
@dataclass(frozen=True)
class Eye:
    """Positions in px, as COLUMN,ROW; lengths in mm."""

    ball: Annotated[str | None, _eye("COLUMN,ROW of the ball in the rod film's first frame.")] = None
    ball_diameter_mm: Annotated[float | None, _eye("Diameter of the ball: gives the rod film's scale to 1 %.")] = None
    marks: Annotated[str | None, _eye("X0,Y0,X1,Y1: two points of known distance.")] = None
    distance_mm: Annotated[float | None, _eye("Distance of the two marks.")] = None
    marks_in: Annotated[str, _eye("The film or picture with the marks: rod, grain, bed or crater.")] = "rod"
    foot: Annotated[str | None, _eye("COLUMN,ROW of the foot's lower face on its axis, grain film's first frame.")] = (
        None
    )
    roi: Annotated[str | None, _eye("X0,Y0,X1,Y1: corners of the part of the grain film to match.")] = None
    floor: Annotated[float | None, _eye("ROW of the bed's floor in the bed picture.")] = None
    rod_rate: Annotated[float | None, _eye("Frame rate that the rod film was recorded at [Hz].")] = None
    grain_rate: Annotated[float | None, _eye("Frame rate that the grain film was recorded at [Hz].")] = None


SECTIONS = {"rod": "rod_video", "grain": "grain_video", "bed": "bed_image", "crater": "crater_image"}


@app.command
def init(
    folder: Path,
    /,
    *,
    ground: str = "",
    which: Which = Which(),
    eye: Eye = Eye(),
    pick: bool = False,
    json: bool = False,
) -> int:
    """Write a commented experiment.toml from the recordings in a folder; of sub-folders one each, and campaign.toml.

    What exists is never written over: experiment.new.toml is written beside it.

    Example: jumpvision init my_jump --ball-diameter-mm 9.5

    Parameters
    ----------
    folder
        The recordings of one experiment, or a folder of such folders.
    ground
        hard or granular; default: by the recordings and the folder's name.
    pick
        Then open the workbench (jumpvision open) on the folder, to click ball, marks, foot and floor.
    json
        Machine-readable result on stdout.
    """
    from jumpvision.base.schema import InputError
    from jumpvision.experiment.init.text import NEW, Choices, init, still_open

    from . import terminal as show

    if ground not in ("", "hard", "granular"):
        raise InputError([f"--ground {ground}: must be hard or granular"])
    files = {SECTIONS[k]: f for k in SECTIONS if (f := getattr(which, k))}
    written = init(folder, Choices(files, _picks(eye), ground))
    show.result({"written": [str(f) for f in written]}, [{"written": str(f)} for f in written], as_json=json)
    for f in written:
        if f.name == NEW:
            show.line(
                f"{f.with_name('experiment.toml')} exists and was left alone: take over what you need from {f.name}"
            )
    for f in written:
        if lacking := still_open(f):
            show.line(f"{f}: to be filled in: {'; '.join(lacking)}")
    show.line(f"fill in the open lines, then: jumpvision check {folder}")
    return open_path(folder) if pick else DONE


def _picks(eye: Eye) -> dict[str, Picks]:
    """Picks by section from the options. InputError for every one that cannot be read."""
    from jumpvision.base.schema import InputError, closest
    from jumpvision.experiment.init.measure import Picks

    if eye.marks_in not in SECTIONS:
        raise InputError([f"--marks-in {eye.marks_in}: unknown{closest(eye.marks_in, SECTIONS)}"])
    points, problems = {}, []
    for name, n in (("ball", 2), ("marks", 4), ("foot", 2), ("roi", 4)):
        if (text := getattr(eye, name)) is None:
            continue
        try:
            points[name] = tuple(float(v) for v in text.split(","))
        except ValueError:
            points[name] = ()
        if len(points[name]) != n:
            form = "X0,Y0,X1,Y1" if n == 4 else "COLUMN,ROW"
            problems.append(f"--{name} {text}: must be {form} in px, e.g. {','.join(['120'] * n)}")
    if problems:
        raise InputError(problems)
    given: dict[str, dict[str, object]] = {s: {} for s in SECTIONS.values()}
    given["rod_video"] |= {"ball": points.get("ball"), "ball_diameter": eye.ball_diameter_mm, "rate": eye.rod_rate}
    given["grain_video"] |= {"foot": points.get("foot"), "roi": points.get("roi"), "rate": eye.grain_rate}
    given["bed_image"] |= {"floor": eye.floor}
    given[SECTIONS[eye.marks_in]] |= {"marks": points.get("marks"), "distance": eye.distance_mm}
    return {s: Picks(**values) for s, values in given.items()}  # type: ignore[arg-type]


@app.command
def synth(kind: str, out: Path, /, *, seed: int = 20140630, ground: str = "granular") -> int:
    """Virtual laboratory: write experiment folders whose truth is known (truth.json), or play the hidden-effect game.

    Example: jumpvision synth samples my_samples

    Parameters
    ----------
    kind
        hard_ground, loose_sand, grain_films, samples (all three), intrusion; blind writes a campaign with a hidden
        effect, reveal tells it and scores results/OUT/diagnosis.json. Campaigns of your own: docs/laboratory.md.
    out
        Folder to write into; what is there already is not overwritten.
    seed
        Of the random numbers; the same seed gives the same recordings.
    ground
        Of a blind campaign: hard or granular.
    """
    from . import terminal as show

    if kind == "reveal":
        from jumpvision.laboratory.game import reveal

        score = reveal(out)
        show.result(score, [{"what": k, "value": v} for k, v in score.items()], as_json=False)
        return DONE
    show.line(f"writing {kind} to {out} ...")
    if kind == "blind":
        from jumpvision.laboratory.game import write_blind

        with show.progress():
            write_blind(out, seed=seed, ground=ground)
        folders = [out]
    else:
        from jumpvision.laboratory.samples import write_samples

        folders = write_samples(kind, out, seed=seed)
    show.line(f"wrote {', '.join(str(f) for f in folders)}")
    return DONE


@app.command(name="open")
def open_path(path: Path, /, *, simulator: str = "", port: int = 0, browser: bool = True) -> int:
    """The workbench: a page in the browser to look at films, set scale and marks, track, correct and run.

    Everything stays on this machine; files are written only when the page's button says so. Ctrl-C stops it.

    Example: jumpvision open my_jump

    Parameters
    ----------
    path
        A film, the folder of one experiment, or a folder of such folders.
    simulator
        MODULE:NAME (or FILE.py:NAME) of your own Study, drawn over the film; as in diagnose.
    port
        Of http://127.0.0.1; default: a free one.
    browser
        Open the page in the browser.
    """
    from jumpvision.browser.workbench.server import Server

    from . import terminal as show

    with closing(Server(path, port, simulator)) as server:
        show.served(server, browser=browser)
    return DONE
