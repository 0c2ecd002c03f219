"""Lines that a user accepted, written into the experiment.toml of a campaign; comments and all other lines stay."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import fields
from pathlib import Path

from jumpvision.base.storage import write_aside
from jumpvision.engine.document.values import Suggested
from jumpvision.experiment.init.edit import Edits, edited
from jumpvision.experiment.inputs.experiment import EXPERIMENT, Experiment
from jumpvision.experiment.inputs.model import ModelSpec
from jumpvision.experiment.inputs.sections import Actuation, Robot, RodVideo
from jumpvision.jumper.question.suggest import Written

BY = "accepted of jumpvision diagnose: "


def written(experiments: Iterable[Experiment]) -> dict[str, Written]:
    """Where the numbers of each experiment stand that a line may change, by its name."""
    return {e.name: Written(f"{e.path.resolve().name}/{EXPERIMENT}", _numbers(e)) for e in experiments}


def _numbers(e: Experiment) -> dict[tuple[str, str], float]:
    out: dict[tuple[str, str], float] = {}
    for cls in (Actuation, Robot, RodVideo):
        if (section := e.section(cls)) is not None:
            each = {f.name: getattr(section, f.name) for f in fields(section)}
            out |= {(cls.name, n): x for n, x in each.items() if isinstance(x, float)}
    model = e.section(ModelSpec)
    return out | {(ModelSpec.name, n): x for n, x in (model.parameters if model else {}).items()}


def accept(lines: Sequence[Suggested], campaign: Path) -> list[Path]:
    """Write these lines; the files. Each file is whole at any moment, and none is written where one cannot be."""
    edits: dict[Path, dict[str, dict[str, tuple[object, str]]]] = {}
    for x in lines:
        why = "" if x.key == "exclude" else BY + x.why  # the reason is the value itself
        edits.setdefault(campaign / x.file, {}).setdefault(x.section, {})[x.key] = (x.value, why)
    texts = {f: _edited(f, e) for f, e in edits.items()}
    for file, text in texts.items():
        write_aside(file, text)
    return list(texts)


def _edited(file: Path, edits: Edits) -> str:
    """The new text, its line ends and its byte-order mark as they are."""
    text = file.read_bytes().decode("utf-8")
    mark = text[:1] if text.startswith("\ufeff") else ""
    ends = "\r\n" if "\r\n" in text else "\n"
    new = edited(text[len(mark) :].replace("\r\n", "\n"), edits, str(file))
    return mark + new.replace("\n", ends)
