"""One run of a user's study with its first values, in a process of its own."""

from __future__ import annotations

import multiprocessing

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError

from .processes import Ask, Failure, Process
from .study import Recording


def first_run(source: str, recording: Recording, limit: float) -> Array:
    """(n, channels) that the study MODULE:NAME gives for a recording with its first values, in another process; limit:
    seconds that it may take. Raises InputError."""
    process = Process(multiprocessing.get_context("spawn"), (source, [recording]))
    try:
        study = process.described(source)
        own = {p.name: p.start(recording) if callable(p.start) else p.start for p in study.parameters if p.each}
        process.begin(0, Ask(0, 0, study.first | own))
        late = not process.connection.poll(limit)
        found = Failure(f"took longer than {limit:g} s (limit)") if late else process.result()
    finally:
        process.end()
    if isinstance(found, Failure):
        raise InputError([f"--simulator {source}: {found.why}"])
    return recording.of_channels(found, study.channels, "simulated values")
