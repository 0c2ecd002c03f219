"""A user's own study, simulated for the ball that is followed, with its first values: nothing is fitted here."""

from __future__ import annotations

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.engine.study.first import first_run
from jumpvision.experiment.campaign.recordings import recording_of
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.sections import SECTIONS, Header

from .draft import Composed

LIMIT = 60.0  # s that a run may take: somebody waits


def height(source: str, made: Composed, t: Array, y: Array) -> Array:
    """Height above rest (n,) [m] at the times t by the study MODULE:NAME, which another process imports.

    y (n,) [m]: the height that was followed, NaN where lost. It is given what `jumpvision diagnose --simulator` gives.
    """
    out = first_run(source, recording_of(_experiment(made), t, y, None), LIMIT)
    if out.shape[1] > 1:
        raise InputError([f"--simulator {source}: has {out.shape[1]} channels; a followed ball is the height alone"])
    return out[:, 0]


def _experiment(made: Composed) -> Experiment:
    """As it would be opened, were the draft written."""
    sections = {n: made.section(cls) for n, cls in SECTIONS.items() if n in made.table}
    header = Header(**{k: made.table[k] for k in ("name", "ground", "group") if k in made.table})
    return Experiment(
        made.folder, header.name or made.folder.resolve().name, header, sections, made.table.get("params", {})
    )
