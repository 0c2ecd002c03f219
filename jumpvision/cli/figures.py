"""Publication figures: `jumpvision figures`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from ..api import results_of
from .app import DONE, app


@app.command
def figures(
    path: Path,
    /,
    *,
    list_: Annotated[bool, Parameter(name="--list", negative="")] = False,
    only: Annotated[tuple[str, ...], Parameter(negative="")] = (),
    format: Annotated[tuple[str, ...], Parameter(negative="")] = ("pdf",),
    results: Path | None = None,
    out: Path | None = None,
    json: bool = False,
) -> int:
    """The figures of a campaign, an experiment or a sweep for print: PDF, SVG or PNG in one style.

    Example: jumpvision figures results/loose_sand --format pdf,png

    Parameters
    ----------
    path
        A folder of results, a sweep.nc, or the experiment or campaign folder that the results were made from.
    list_
        Say which figures there are, and draw none.
    only
        Names of the figures to draw, e.g. heights,tracks; default: all.
    format
        pdf, svg, png; several as pdf,png.
    results
        Where the results lie if PATH is the folder of recordings; default: results/NAME beside it.
    out
        Folder for the figures; default: figures in the folder of results.
    json
        Machine-readable result on stdout.
    """
    from .. import show
    from ..experiment import is_campaign
    from ..report.figures import available, draw
    from ..schema import InputError

    recordings = path.is_dir() and ((path / "experiment.toml").exists() or is_campaign(path))
    source = (results or results_of(path)) if recordings else path
    if not source.exists():
        raise InputError([f"{source}: no results there; run `jumpvision run {path}` first, or give --results"])
    if list_:
        rows = [{"figure": name, "shows": text} for name, (text, _) in available(source).items()]
        show.result(rows, rows, as_json=json)
        return DONE
    folder = out or (source if source.is_dir() else source.parent) / "figures"
    files = draw(source, folder, _split(only), _split(format))
    rows = [{"file": str(f)} for f in files]
    show.result({"figures": [str(f) for f in files]}, rows, as_json=json)
    return DONE


def _split(texts: tuple[str, ...]) -> tuple[str, ...]:
    """Names given one by one or with commas between them."""
    return tuple(part for text in texts for part in text.split(",") if part)
