"""Recordings that are there twice. No stage is imported: whoever runs what has not changed asks this, too."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from jumpvision.base.schema import StageWarning
from jumpvision.base.storage import sha256
from jumpvision.experiment.inputs.experiment import Experiment
from jumpvision.experiment.inputs.sections import GrainVideo, IntrusionLog, RodTrack, RodVideo


def repeated(experiments: Iterable[Experiment]) -> dict[str, list[StageWarning]]:
    """Experiments with the same recording of a motion, by name: one was copied, and counts twice."""
    sizes: dict[tuple[str, int], list[tuple[str, Path]]] = {}
    for e in experiments:
        for kind in (RodVideo, RodTrack, GrainVideo, IntrusionLog):
            section = e.section(kind)
            if section is not None and section.path.is_file():
                sizes.setdefault((section.name, section.path.stat().st_size), []).append((e.name, section.path))
    out: dict[str, list[StageWarning]] = {}
    for (section_name, _), files in sizes.items():
        alike: dict[str, list[str]] = {}
        for experiment, path in files if len(files) > 1 else ():
            alike.setdefault(sha256(path), []).append(experiment)
        for names in alike.values():
            for name in names if len(names) > 1 else ():
                others = " and ".join(n for n in names if n != name)
                said = f"[{section_name}] is the recording of {others} too: a copy counts twice; give exclude in one"
                out.setdefault(name, []).append(StageWarning("copy", said, section_name))
    return out
