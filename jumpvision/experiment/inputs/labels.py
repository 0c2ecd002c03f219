"""[labels] of experiment.toml and campaign.toml: anything else that is known of a recording, as numbers or words."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar

from jumpvision.base.schema import Section

Label = float | str


@dataclass(frozen=True)
class Labels(Section):
    """What a recording is known by: a temperature, who made it. Its keys are the user's own."""

    name: ClassVar[str] = "labels"
    values: Mapping[str, Label] = field(default_factory=dict)


def labels_of(table: Mapping[str, object], where: str) -> tuple[Labels | None, list[str]]:
    """(the labels, or None; problems). where: as in `base.schema.read`."""
    problems = [
        f"{where} {key} = {value!r}: must be a finite number or text in quotes (anything known of the recording: "
        'temperature_C = 22.5, operator = "B")'
        for key, value in table.items()
        if not _fits(value)
    ]
    values = {k: v if isinstance(v, str) else float(v) for k, v in table.items() if isinstance(v, str | float | int)}
    return (None, problems) if problems else (Labels(values), [])


def _fits(value: object) -> bool:
    number = isinstance(value, int | float) and not isinstance(value, bool) and abs(value) < math.inf
    return isinstance(value, str) or number
