"""Order and numbers of pictures by their names: 2 before 10, 0.25 before 0.5, -3 before 2.

The number that counts the frames is the one that varies from name to name: `run3_0007_cam1` is frame 7.
"""

from __future__ import annotations

import os
import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

DIGITS = re.compile(r"([0-9]+)")
DECIMAL = re.compile(r"(?<![0-9])([0-9]+(?:\.[0-9]+)?)(?![0-9])")


class Numbering(NamedTuple):
    """names: of the files, in order. positions: (n,) numbers of the frames, the first 0, None where evenly timed.
    warnings: texts."""

    names: list[str]
    positions: NDArray[np.float64] | None
    warnings: list[str]


def numbering(where: Path, names: Sequence[str]) -> Numbering:
    """The order of pictures by the names of their files, and the gaps in it. where: named in warnings."""
    stems = [os.path.splitext(n)[0] for n in names]
    found = _counters(stems)
    if found is None:
        ordered = sorted(names, key=lambda n: (_natural(n), n))
        several = len(names) > 2 and any(map(DIGITS.search, stems))
        text = f"{where}: the names of the images do not differ in one number alone ({_odd(names, stems)}); "
        return Numbering(ordered, None, [text + "they are timed as if none were missing"] if several else [])
    order = sorted(sorted(range(len(names)), key=names.__getitem__), key=found.__getitem__)
    ordered, numbers = [names[k] for k in order], np.array([found[k] for k in order])
    positions, warnings = _gaps(where, ordered, numbers)
    return Numbering(ordered, positions, warnings)


def _natural(name: str) -> list[str | int]:
    return [int(part) if part.isdecimal() else part for part in DIGITS.split(name.lower())]


def _counters(stems: Sequence[str]) -> Sequence[float] | None:
    """The number of each name that counts the frames; None where there is none, or more than one."""
    return _signed(stems) or _varying(stems, DECIMAL if _decimal(stems) else DIGITS)


def _varying(stems: Sequence[str], number: re.Pattern[str]) -> Sequence[float] | None:
    """The one number in which names that are else alike differ."""
    if len({tuple(number.split(s)[::2]) for s in stems}) > 1:
        return None
    first = number.split(stems[0])[1::2] if stems else []
    columns = np.empty((len(first), len(stems)))  # of 100,000 names one list of texts at a time
    for k, s in enumerate(stems):
        columns[:, k] = [float(x) for x in number.split(s)[1::2]]
    if len(stems) == 1 and first:
        return [float(first[-1])]
    varying = columns[(columns != columns[:, :1]).any(axis=1)] if first else columns
    return varying[0].tolist() if len(varying) == 1 else None


def _signed(stems: Sequence[str]) -> list[float] | None:
    """Numbers of which some are below zero: `frame--3`, `frame--2`, ..., `frame-0`, `frame-1`."""
    if not any("-" in s for s in stems):
        return None
    parts = [re.fullmatch(r"(.*?)([0-9]+)([^0-9]*)", s) for s in stems]
    heads = {p[1] for p in parts if p}
    if not all(parts) or len(heads) != 2 or len({p[3] for p in parts if p}) > 1:
        return None
    short, long = sorted(heads, key=len)
    if long != f"{short}-":
        return None
    return [-float(p[2]) if p[1] == long else float(p[2]) for p in parts if p]


def _decimal(stems: Sequence[str]) -> bool:
    """Whether a point stands before decimals (0.25s, 0.5s, 2s), not between a name and a counter (run1.8, run1.10).

    Decimals are written without zeros at their end, and not all equally long; what stands before a counter's point is
    the same in all names.
    """
    points = (re.findall(r"(?<![0-9.])([0-9]+)\.([0-9]+)(?![0-9.])", s) for s in stems)
    pairs = [p[-1] for p in points if p]
    if not pairs or any(tail.endswith("0") for _, tail in pairs):
        return False
    some_whole = len(pairs) < len(stems)
    same_head = len({head for head, _ in pairs}) == 1
    even = len({len(tail) for _, tail in pairs}) == 1
    return some_whole or not same_head or (pairs[0][0] == "0" and not even)


def _gaps(
    where: Path, names: Sequence[str], numbers: NDArray[np.float64]
) -> tuple[NDArray[np.float64] | None, list[str]]:
    """(frame numbers from 0 or None where there is no gap, warnings)."""
    gaps = np.diff(numbers)
    if gaps.size < 2:
        return None, []
    step = float(gaps.min())  # the numbers of films saved with frames left out go by 2, 5, ...
    if step > 0 and np.allclose(gaps, step, rtol=1e-6):
        return None, []
    if step <= 0 or not np.allclose(gaps / step, np.rint(gaps / step), atol=1e-6):
        return None, [f"{where}: the images are numbered unevenly; they are timed as if none were missing"]
    k = int(np.argmax(gaps > 1.5 * step))
    missing = int(np.rint(gaps / step - 1).sum())
    return np.rint((numbers - numbers[0]) / step), [
        f"{where}: {missing} image{'s are' if missing > 1 else ' is'} missing by the numbers, first after "
        f"{names[k]}; the time is left free"
    ]


def _odd(names: Sequence[str], stems: Sequence[str]) -> str:
    """A name that is unlike most."""
    kinds = [tuple(DIGITS.split(s)[::2]) for s in stems]
    usual = Counter(kinds).most_common(1)[0][0]
    return next((n for n, kind in zip(names, kinds) if kind != usual), names[0])
