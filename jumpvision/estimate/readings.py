"""Find the values of a record that are no readings: held, clipped, leaping to and fro, turned over at a period.

What repeats is judged against the steps of the record itself: where it moves by many steps of its resolution, a step of
zero is as rare as one of the resolution. What leaps is judged against the second differences about it.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from jumpvision.base.arrays import MAD, Array
from jumpvision.base.schema import StageWarning

MIN_ROWS = 20  # of a record: fewer tell no noise
LEAP = 20.0  # second differences about it (their median): Gaussian noise reaches 8
FAST = 3.0  # steps of the resolution from which a record moves: noise below it may stand still
AROUND = 41  # rows over which second differences are learned
WIDEST_SPIKE = 3  # rows
MIN_HELD = 3  # stretches that end in a leap, and their share of all leaps: a motor that starts and stops makes fewer
HELD = 0.1
MIN_MIXED, MIXED = 10, 0.05  # rows that leap, and their share of those between, from which there are two sources
FULL_TURNS = (2.0 * math.pi, math.pi, 360.0, 180.0, 1.0)  # rad, degrees, turns
DEPTH = "depth_m"  # to which a foot is pushed, step by step as many do
CHANCE = 1e-6  # that a stretch of equal values comes by noise


@dataclass(frozen=True)
class Doubt:
    """What is no reading. rows: how many; row: the first, from 1; text: after the name of the record."""

    text: str
    rows: int
    row: int

    @property
    def values(self) -> dict[str, float]:
        """Return its numbers, for a warning."""
        return {"rows": float(self.rows), "row": float(self.row)}


class Readings(NamedTuple):
    """values (n,), turns undone; kept (n,): what is a reading; doubts: what is not, and what was done."""

    values: Array
    kept: NDArray[np.bool_]
    doubts: list[Doubt]


def readings(x: Array, driven: Array | None = None, *, is_set: bool = False) -> Readings:
    """Look through a record x (n,) in the order taken, NaN left out. driven (n,): what x is the answer to (a depth of a
    force), which tells a value that stands still from a rest; None: it is not known. is_set: x is set step by step, and
    may stand still."""
    good = np.flatnonzero(np.isfinite(x))
    values, kept, doubts = x.copy(), np.ones(x.size, bool), list[Doubt]()
    if good.size < MIN_ROWS or np.unique(x[good]).size < 4:  # a switch, or a constant
        return Readings(values, kept, doubts)
    v = x[good]
    step = resolution(v)
    v, said = turned(v, step)
    values[good], doubts = v, doubts + said
    for look in (leaping, clipped) if is_set else (leaping, held, clipped):
        on = kept[good]
        left, said = look(v[on], step, None if driven is None else driven[good[on]])
        at = good[on]
        kept[at[left]] = False
        doubts += [Doubt(d.text, d.rows, int(at[d.row - 1]) + 1) for d in said]
    return Readings(values, kept, doubts)


def resolution(v: Array) -> float:
    """Return the step of the values (n,) where all are its multiples, 0 where they are not."""
    levels = np.unique(v)
    gaps = np.diff(levels)
    gaps = gaps[gaps > 1e-9 * (levels[-1] - levels[0])]
    step = float(gaps.min())
    part = gaps / step
    return step if np.mean(np.abs(part - np.rint(part)) < 0.02 * np.maximum(1.0, part / 50)) > 0.99 else 0.0


def bends(v: Array) -> Array:
    """Return the median second difference about each row (n,): the least of rows 1, 2 and 3 apart, as sources may."""
    out = np.full(v.size, np.inf)
    for lag in (1, 2, 3):
        second = np.abs(v[2 * lag :] - 2.0 * v[lag:-lag] + v[: -2 * lag])
        around = scipy.ndimage.median_filter(second, min(AROUND, second.size), mode="mirror")
        out = np.fmin(out, np.pad(around, lag, mode="edge"))
    return out


def turned(v: Array, step: float) -> tuple[Array, list[Doubt]]:
    """Undo turns: leaps from one end of the range to the other, all of one period that is a turn or a counter's."""
    d = np.diff(v)
    near = np.fmax(np.r_[0.0, np.abs(d[:-1])], np.r_[np.abs(d[1:]), 0.0])
    leap = np.flatnonzero((np.abs(d) > 0.5 * np.ptp(v)) & (np.abs(d) > 5.0 * np.median(np.abs(d))))
    if not leap.size or leap.size > 0.2 * d.size:
        return v, []
    calm = leap[near[leap] < 0.2 * np.abs(d[leap])]
    if not calm.size:
        return v, []
    way = np.array([np.median(np.delete(d[max(0, i - 3) : i + 4], min(i, 3))) for i in calm])
    sizes = np.abs(d[calm] - way)
    period, spread = float(np.median(sizes)), float(np.max(near[calm])) + 0.01 * float(np.median(sizes))
    lost = leap.size % 2 == 0 and np.all(np.diff(leap)[::2] <= WIDEST_SPIKE)  # packets that leap there and back
    counts = [step * 2.0**k for k in range(8, 33)] if step and not lost else []
    turn = next((p for p in (*FULL_TURNS, *counts) if abs(p - period) < spread and np.ptp(v) < p + spread), None)
    if turn is None or np.ptp(sizes) > 2.0 * spread:
        return v, []
    flat = v - turn * np.r_[0.0, np.cumsum(np.rint(d / turn))]
    said = f"leaps by {turn:.6g} {leap.size} times, first in row {leap[0] + 2}: a turn or a counter; it is undone"
    return flat, [Doubt(said, leap.size, int(leap[0]) + 2)]


Left = tuple[NDArray[np.bool_], list[Doubt]]


def leaping(v: Array, step: float, driven: Array | None) -> Left:
    """Find values out of line with both sides, which agree with each other: single ones are left out, many are told."""
    least = LEAP * np.fmax(bends(v), step)
    out = np.zeros(v.size, bool)
    for width in range(1, WIDEST_SPIKE + 1):
        i = np.arange(2, v.size - width - 1)  # first row of a spike
        before, after = v[i - 1], v[i + width]
        far = np.full(i.size, np.inf)
        for k in range(width):
            share = (k + 1.0) / (width + 1.0)
            lines = (
                before + (k + 1.0) * (before - v[i - 2]),
                before + share * (after - before),
                after + (width - k) * (after - v[i + width + 1]),
            )
            low, high = np.min(lines, axis=0), np.max(lines, axis=0)
            far = np.fmin(far, np.fmax(v[i + k] - high, low - v[i + k]))
        alone = (far > least[i]) & (np.abs(after - before) < 0.7 * far)
        for k in range(width):
            out[i[alone] + k] = True
    rows = np.flatnonzero(out)
    if not rows.size:
        return out, []
    row, value = int(rows[0]), float(v[rows[0]])
    said = f"row {row + 1} = {value:.6g} between {v[row - 1]:.6g} and {v[min(row + 1, v.size - 1)]:.6g}"
    if rows.size > max(MIN_MIXED, MIXED * (rows[-1] - rows[0])):
        said = f"leaps to and fro in {rows.size} of {v.size} rows, first {said}: two sources in one record? Keep one"
        return np.zeros(v.size, bool), [Doubt(said, rows.size, row + 1)]
    return out, [Doubt(f"leaps in {rows.size} of {v.size} rows, first {said}: left out", rows.size, row + 1)]


def runs_of(v: Array) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Return (first row, row after the last) of each stretch of two equal values or more."""
    same = np.diff(np.r_[False, np.diff(v) == 0.0, False].astype(np.int8))
    return np.flatnonzero(same == 1), np.flatnonzero(same == -1) + 1


def is_noisy(v: Array, step: float, a: int, b: int) -> bool:
    """Return True where the values about rows a to b - 1 scatter so that a stretch of them comes equal by CHANCE."""
    sides = [s for s in (v[max(0, a - 40) : a], v[b : b + 40]) if s.size >= 15]
    if not sides:
        return False
    # differences of a smooth motion get smaller with their order, those of noise do not
    noise, rest = (
        float(np.median(np.concatenate([np.abs(np.diff(s, k)) for s in sides]))) / MAD / math.sqrt(math.comb(2 * k, k))
        for k in (4, 6)
    )
    if rest < 0.5 * noise or noise <= step:
        return False
    equal = max(step / (3.5 * noise), 1e-300) if step else 1e-3  # chance that two readings are
    return bool((b - a - 1) * math.log(equal) + math.log(v.size) < math.log(CHANCE))


def held(v: Array, step: float, driven: Array | None) -> Left:
    """Find values that stand still and then leap to where they should have been: renewed at a lower rate, or stuck."""
    out = np.zeros(v.size, bool)
    first, end = runs_of(v)
    d = np.abs(np.diff(v))
    moves = max((FAST - 0.5) * step, np.finfo(float).tiny)
    after = end < v.size
    leaps = np.zeros(first.size, bool)
    leaps[after] = d[end[after] - 1] >= moves
    moving = np.r_[d[1:] >= moves, False]
    by_chance = 0.0
    if step:  # steps of normal noise: those of zero from those of one and two
        one, two = (0.5 * np.count_nonzero(moving & (np.rint(d / step) == k)) + 0.5 for k in (1, 2))
        by_chance = one ** (4 / 3) / two ** (1 / 3)
    count = int(leaps.sum())
    if count > max(MIN_HELD + by_chance + 5.0 * math.sqrt(by_chance), HELD * np.count_nonzero(moving)):
        period = int(np.median((end - first)[leaps]))
        for a, b in zip(first, end):
            out[a:b] = (np.arange(b - a) % period) != 0
        row = int(first[leaps][0]) + 1
        said = f"is renewed every {period} rows and held between, from row {row} on: held values are left out"
        return out, [Doubt(said, int(out.sum()), row)]
    top, bottom = float(v.max()), float(v.min())
    stuck = []
    loudest = max(0.5 * step / max(float(np.std(np.diff(v))), step), 1e-300) if step else 1e-3
    enough = end - first - 1 > (math.log(v.size) - math.log(CHANCE)) / -math.log(loudest)  # whatever the noise there
    for a, b in zip(first[enough], end[enough]):
        rest = v[a] == 0.0 and (a == 0 or b == v.size)  # a sensor without load
        if b - a > 2 and not rest and v[a] not in (top, bottom) and is_noisy(v, step, int(a), int(b)):
            out[a + 1 : b] = True
            stuck.append((int(a), int(b)))
    if not stuck:
        return out, []
    a, b = max(stuck, key=lambda s: s[1] - s[0])
    said = f"stands still in {out.sum()} of {v.size} rows, longest at {v[a]:.6g} in rows {a + 1} to {b}: left out"
    return out, [Doubt(said, int(out.sum()), a + 1)]


def clipped(v: Array, step: float, driven: Array | None) -> Left:
    """Find values that pile up at the least or the greatest one, more than noise or the resolution lets them."""
    out, doubts = np.zeros(v.size, bool), list[Doubt]()
    for name, end in (("greatest", float(v.max())), ("least", float(v.min()))):
        at = v == end
        n = int(at.sum())
        if n < MIN_HELD or end == 0.0 or n > 0.9 * v.size:
            continue
        below = (
            [int(np.sum(np.abs(v - end - s * k * step) < 0.5 * step)) for s in (-1, 1) for k in (1, 2, 3)]
            if step
            else [1]
        )
        first, last = runs_of(v)
        on = v[first] == end if first.size else np.zeros(0, bool)
        if not on.any() or n < 4.0 * max(below):
            continue
        a, b = max(zip(first[on], last[on]), key=lambda s: s[1] - s[0])
        moves = driven is not None and abs(driven[b - 1] - driven[a]) > 0.02 * np.ptp(driven)
        if not moves and not is_noisy(v, step, int(a), int(b)):
            continue
        out |= at
        row = int(np.argmax(at)) + 1
        said = f"stands at its {name} value {end:.6g} in {n} of {v.size} rows, from row {row} on: clipped; left out"
        doubts.append(Doubt(said, n, row))
    return out, doubts


class Table(NamedTuple):
    """columns: in the rows that hold readings, turns undone; kept (n,): those rows; doubts: by column."""

    columns: dict[str, Array]
    kept: NDArray[np.bool_]
    doubts: list[tuple[str, Doubt]]


def only_readings(columns: Mapping[str, Array], drive: Array | None = None) -> Table:
    """Look through the columns (n,) of one record. drive (n,): what the others answer to, as a force to a depth."""
    found = {c: readings(x, None if x is drive else drive, is_set=c == DEPTH) for c, x in columns.items()}
    doubts = [(c, d) for c, r in found.items() for d in r.doubts]
    out, each = {c: r.values for c, r in found.items()}, [r.kept for r in found.values()]
    kept = np.all(each, axis=0)
    if kept.sum() < 0.5 * min(k.sum() for k in each):  # renewed in turn: none is fresh when the other is
        at, kept = np.arange(kept.size), each[0]
        out = {c: np.interp(at, at[r.kept], r.values[r.kept]) for c, r in found.items()}
    return Table({c: x[kept] for c, x in out.items()}, kept, doubts)


def looked(caller: str, **columns: Array) -> Table:
    """Look by `only_readings` through a function's arguments, the first the drive; what is no reading is told."""
    found = only_readings(columns, next(iter(columns.values())))
    for name, doubt in found.doubts:
        warnings.warn(StageWarning("reading", f"{caller}: {name} {doubt.text}", "", doubt.values), stacklevel=3)
    return found
