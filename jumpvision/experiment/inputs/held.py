"""What a file of logs holds: channels, each with its values, unit and times where the file has them."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from jumpvision.base.arrays import AnyArray, Array
from jumpvision.base.schema import StageWarning


@dataclass(frozen=True)
class Channel:
    """values (n,), numbers or texts, as the file has them. unit: what the file says, "" where it says none. clock (n,)
    [s]: times of the values, where the file gives them or their rate, since `began`, a date (None: the file says none).
    untimed: why a file that gives a rate has no times all the same, and the remedy. note: on the clock."""

    name: str
    values: AnyArray
    unit: str = ""
    clock: Array | None = None
    began: np.datetime64 | None = None
    untimed: str = ""
    note: str = ""


class Held(NamedTuple):
    """Names of all channels in a file, and those that were asked for, by the name they were asked by."""

    names: list[str]
    channels: Mapping[str, Channel]


def tell(message: str, kind: str = "missing", recording: str = "", values: Mapping[str, float] = {}) -> None:
    """What to know about a file that is read all the same."""
    warnings.warn(StageWarning(kind, message, recording, values), stacklevel=3)
