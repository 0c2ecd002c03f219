"""What Python calls of the compiled jumper: one jump with its track, a batch of jumps, the robot at rest."""

from __future__ import annotations

import functools
import hashlib
import math
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numba import njit
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.base.threads import shared
from jumpvision.jumper.physics import forcing
from jumpvision.jumper.physics.hard.jump import RESULTS as HARD_RESULTS

from . import events, granular, kernel, laws, modes, run, step, trial, within
from .packed import Packed

RESULTS = (*HARD_RESULTS, "driven_height_m", "max_depth_m", "status")
COM, FLIGHT, JUMP, N_JUMPS, FIRST, POWER, FORCE, SPEED, DRIVEN, DEPTH, STATUS = range(len(RESULTS))


@njit(error_model="numpy")
def pieces(rows: Array) -> tuple[Array, Array]:
    """Pieces (n, 6) and edges (n + 1,) of a `Segments` law with the motor at rest after it; the last edge is open.

    Rows of a loop have a seventh column, its gain: 1 after the law.
    """
    kept, edges = np.ones((rows.shape[0] + 1, rows.shape[1])), np.empty(rows.shape[0] + 2)
    n = 0
    for row in rows:
        if row[1] > row[0]:
            for i in range(
                row.size
            ):  # assigned whole, the message of its error takes longer to compile than all of this
                kept[n, i] = row[i]
            edges[n] = row[0]
            n += 1
    last = rows[rows.shape[0] - 1]
    x, _ = forcing.segment_xv(last, last[1])
    edges[n], edges[n + 1] = last[1], math.inf
    kept[n, 0], kept[n, 1], kept[n, 2], kept[n, 3], kept[n, 4], kept[n, 5] = last[1], math.inf, x, 0.0, 0.0, 0.0
    return kept[: n + 1], edges[: n + 2]


@njit(error_model="numpy", inline="always")  # once, where it is called: else all is optimised once more
def jump(constants: Sequence[Packed], law: Array, tail: float, rtol: float, atol: float, out: Array) -> None:
    """Writes RESULTS of one jump (out, NaN where there is none); the tail doubles until a flight has landed."""
    p = constants[0]
    out[:] = math.nan
    rows, edges = pieces(law)
    n = edges.size
    start, stop = edges[0], edges[n - 2]
    log, peaks = np.empty((500, 2)), np.empty(6)  # 500 events of a jump
    no_times, no_out, no_modes = np.empty(0), np.empty((0, within.N_OUT)), np.empty(0, np.int64)
    space = run.workspace(run.states(p), rows.shape[0] if p.tau > 0.0 else 0)
    while True:
        edges[n - 1] = stop + tail
        status = _run(
            constants, granular.SINE, rows, edges, 0.0, stop, no_times, no_out, no_modes, log, rtol, atol, peaks, space
        )
        out[STATUS] = status
        if status != run.OK:
            return
        flights, late, longest, first, up = 0, 0, 0.0, math.nan, math.nan
        for i in range(p.events):
            if log[i, 1] == events.LIFT_OFF:
                flights, up = flights + 1, log[i, 0]
                if flights == 1:
                    first = up - start
            elif log[i, 1] == events.LANDING:
                if log[i, 0] > stop:
                    late = late if late > 0 else flights
                    longest = max(longest, log[i, 0] - up)
                up = math.nan
        if late > 0 or math.isnan(up) or tail > 30.0:  # s after the motor stops
            break
        tail *= 2.0
    out[COM] = p.com - p.lowest
    out[FLIGHT] = p.g * longest * longest / 8.0 if late > 0 or math.isnan(up) else math.nan
    out[JUMP], out[DRIVEN] = p.rod_after - p.height, p.rod_before - p.height
    out[N_JUMPS], out[FIRST] = late if late > 0 else flights, first
    out[FORCE], out[POWER], out[SPEED], out[DEPTH] = peaks[0], peaks[1], peaks[2], p.memory[granular.FLOOR]


PARTS = (events, forcing, granular, kernel, laws, modes, run, step, trial, within)


@functools.cache
def digest() -> str:
    """Of all files compiled together: numba's cache sees changes of one file, so this is a part of its key."""
    files = sorted({Path(str(m.__file__)) for m in PARTS} | {Path(__file__)})
    return hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()


def solver() -> Callable[..., int]:
    """What follows a jump, compiled once for all that do."""
    return run.compiled_run(digest())


TRACK = np.dtype(
    [("kind", int), ("stop", float), ("before", float)] + [(n, int) for n in ("row", "row_end", "time", "time_end")]
)
"""A jump of `tracks_solver`: its forcing's kind, when the motor stops [s], where it stands before; its rows and times
from .. end (its edges are one more than the rows of every jump so far)."""


@functools.cache
def tracks_solver() -> Callable[..., None]:
    """solve(constants (k,), which (k,), lane (k,), about (n,) TRACK, rows, edges, t (m, :), rtol, atol, out (m, :))."""
    global _run
    _run = solver()
    return _tracks(digest())


_run: Callable[..., int]  # `solver()`; a global, as what a compiled function closes over is a part of its key


def _tracks(key: str) -> Callable[..., None]:
    @njit(cache=True, nogil=True)
    def solve(constants, which, lane, about, rows, edges, t, rtol, atol, out):  # type: ignore[no-untyped-def]
        key  # noqa: B018
        log, no_peaks = np.empty((run.MAX_EVENTS, 2)), np.empty(0)
        for k in range(which.size):
            i = which[k]
            a, p, own = about[i], constants[k], constants[k : k + 1]
            heights = out[lane[k], a.time : a.time_end]
            times = t[lane[k], a.time : a.time_end]
            first, n = a.row + i, a.row_end - a.row
            start, end = edges[first], times[-1]
            driven = np.searchsorted(times, start)
            heights[:driven] = 0.0
            if driven == times.size:
                continue
            while n > 1 and edges[first + n - 1] >= end:
                n -= 1
            until = edges[first : first + n + 1].copy()
            until[n] = end
            space = run.workspace(run.states(p), n if p.tau > 0.0 else 0)
            full, mode = np.empty((times.size - driven, 1)), np.empty(times.size - driven, np.int64)
            status = _run(
                own,
                a.kind,
                rows[a.row : a.row + n],
                until,
                a.before,
                a.stop,
                times[driven:],
                full,
                mode,
                log,
                rtol,
                atol,
                no_peaks,
                space,
            )
            for i in range(driven, heights.size):
                heights[i] = full[i - driven, 0] - p.height
            if status != run.OK:
                heights[:] = math.nan

    return solve


@functools.cache
def batch_solver() -> Callable[..., None]:
    """solve(n, constants (n,), laws (n, r, 6), tail, rtol, atol, out (n, RESULTS)): `jump` of each, in threads."""
    global _run
    _run = solver()
    return _batch(digest())


def _batch(key: str) -> Callable[..., None]:
    @shared()
    def solve(first, last, constants, laws, tail, rtol, atol, out):  # type: ignore[no-untyped-def]
        key  # noqa: B018
        for i in range(first, last):
            jump(constants[i : i + 1], laws[i], tail, rtol, atol, out[i])

    return solve


@functools.cache
def equilibrium() -> Callable[[NDArray[np.void]], tuple[float, float]]:
    """constants (1,) -> x_r and depth of the foot at rest [m]."""
    return _equilibrium(digest())


def _equilibrium(key: str) -> Callable[[NDArray[np.void]], tuple[float, float]]:
    @njit(cache=True)
    def solve(constants):  # type: ignore[no-untyped-def]
        key  # noqa: B018
        p = constants[0]
        run.at_rest(p)
        return p.height, p.deep

    return solve
