"""Results for other programs: the command export."""

from __future__ import annotations

import os
import shutil
from pathlib import Path
from typing import Literal

from .app import DONE, app


@app.command
def export(path: Path, /, *, to: Literal["csv", "vtk", "ro-crate"], out: Path, json: bool = False) -> int:
    """Results for other programs: CSV of tables and fields, VTK of fields, RO-Crate.

    Example: jumpvision export results/loose_sand --to csv --out loose_sand_csv

    Parameters
    ----------
    path
        A folder of results; or the folder of an experiment or campaign whose results lie in their default place.
    to
        csv, vtk (a .vti file for each time, and .pvd lists), or ro-crate: everything (needs jumpvision[ro-crate]).
    out
        A folder that is not there yet: it appears when all is written.
    """
    from jumpvision.base.schema import InputError
    from jumpvision.base.storage import aside_folder, sweep_leftovers
    from jumpvision.experiment.campaign.folder import results_of
    from jumpvision.experiment.inputs.experiment import EXPERIMENT, folder_of, is_campaign
    from jumpvision.report.export.crate import write_crate
    from jumpvision.report.export.images import write_images
    from jumpvision.report.export.results import results_in
    from jumpvision.report.export.tables import write_tables

    from . import terminal

    folder = folder_of(path)
    if (folder / EXPERIMENT).exists() or (folder.is_dir() and is_campaign(folder)):
        folder = results_of(folder)
    if out.exists() and (not out.is_dir() or any(out.iterdir())):
        raise InputError([f"--out {out}: is there already; name a new folder, or remove it"])
    found = results_in(folder)
    parent = out.absolute().parent
    parent.mkdir(parents=True, exist_ok=True)
    sweep_leftovers(parent, parent)
    aside = aside_folder(parent)
    try:
        writers = {"csv": write_tables, "vtk": write_images, "ro-crate": write_crate}
        notes = writers[to](found, aside)
        if out.exists():
            out.rmdir()
        os.rename(aside, out)
    finally:
        shutil.rmtree(aside, ignore_errors=True)
    files = sorted(str(f) for f in out.rglob("*") if f.is_file())
    terminal.result({"out": str(out), "files": files, "notes": notes}, [], as_json=json)
    if notes:
        terminal.line(f"note: {'; '.join(notes)}" if to == "ro-crate" else f"left out: {', '.join(notes)}")
    terminal.line(f"{len(files)} files in {out}")
    return DONE
