"""One run of a user's study with its first values, in a process of its own."""

from __future__ import annotations

import multiprocessing

from jumpvision.base.arrays import Array

from .processes import Ask, Process, result_of_study
from .study import Recording


def first_run(source: str, recording: Recording, limit: float) -> Array:
    """(n, channels) that the study MODULE:NAME gives for a recording with its first values, in another process; limit:
    seconds that it may take. Raises InputError."""
    process = Process(multiprocessing.get_context("spawn"), (source, [recording]))
    try:
        study = result_of_study(source, process.answer(None))
        own = {p.name: p.start(recording) if callable(p.start) else p.start for p in study.parameters if p.each}
        found = result_of_study(source, process.answer(Ask(0, 0, study.first | own), limit))
    finally:
        process.end()
    return recording.of_channels(found, study.channels, "simulated values")
