"""What lies in a folder of results: the files that its runs declare, each still what it was."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from jumpvision.base.schema import InputError, Toml
from jumpvision.base.storage import sha256
from jumpvision.experiment import files
from jumpvision.experiment.results.fields import opened
from jumpvision.experiment.workflow.provenance import read_provenance

if TYPE_CHECKING:
    import xarray as xr


@dataclass(frozen=True)
class Results:
    """Of one experiment, or (name "") the tables of a campaign. outputs: SHA-256 by file name."""

    name: str
    folder: Path
    outputs: Mapping[str, str]
    provenance: Toml

    @property
    def files(self) -> list[Path]:
        return [self.folder / f for f in self.outputs]


def results_in(folder: Path) -> list[Results]:
    """The results of an experiment, or of a campaign and its experiments.

    Raises InputError where there are none, or where a file is not what its run has written.
    """
    found = []
    if (folder / files.PROVENANCE).is_file():
        found = [_of_experiment(folder, folder.absolute().name)]
    elif (folder / files.CAMPAIGN).is_file():
        try:
            campaign = json.loads((folder / files.CAMPAIGN).read_text(encoding="utf-8"))
            tables, names = dict(campaign["tables"]), list(campaign["experiments"])
        except (OSError, ValueError, TypeError, KeyError, RecursionError):
            raise InputError([f"{folder / files.CAMPAIGN}: damaged; run the campaign again"]) from None
        found = [Results("", folder, tables, {"command": campaign.get("command", "")})]
        found += [_of_experiment(folder / n, n) for n in names if (folder / n).is_dir()]
    if not any(r.outputs for r in found):
        raise InputError([f"{folder}: no results there; give a folder that jumpvision run has written to"])
    changed = [f for r in found for f in r.files if not f.is_file() or sha256(f) != r.outputs[f.name]]
    if changed:
        raise InputError([f"{f}: not what its run has written; run again, then export" for f in changed])
    return found


def _of_experiment(folder: Path, name: str) -> Results:
    provenance = read_provenance(folder)
    if not provenance:
        raise InputError([f"{folder / files.PROVENANCE}: missing or damaged; run again, then export"])
    return Results(name, folder, provenance["outputs"], provenance)


def folder_for(one: Results, found: list[Results], out: Path) -> Path:
    """The folder of one experiment's files: of its name, or the export itself where it is the only one."""
    folder = out / one.name if len(found) > 1 else out
    folder.mkdir(exist_ok=True)
    return folder


Write = Callable[[Path, Path], None]  # (file, folder that it is written into)


def each_file(found: list[Results], out: Path, writers: Mapping[str, Write]) -> list[str]:
    """Every file by the writer of its suffix, in a folder for each experiment; names of the files that have none."""
    left = set()
    for r in found:
        folder = folder_for(r, found, out)
        for file in r.files:
            if write := writers.get(file.suffix):
                write(file, folder)
            else:
                left.add(file.name)
    return sorted(left)


def each_field(found: list[Results], out: Path, write: Callable[[xr.Dataset, Path, str], None]) -> list[str]:
    """write(data, folder, name) of every field over (y, x, t); names of the files that are none. InputError: none."""

    left, made = [], 0
    for r in found:
        for file in r.files:
            if file.suffix == ".nc":
                with opened(file) as data:
                    if {"x", "y", "t"} <= set(data.dims):
                        write(data, folder_for(r, found, out), file.stem)
                        made += 1
                        continue
            left.append(file.name)
    if not made:
        raise InputError(["no field over (y, x, t) in these results (piv.nc, flow.nc); --to csv takes tables"])
    return sorted(set(left))
