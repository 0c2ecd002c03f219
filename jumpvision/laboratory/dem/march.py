"""The march of threads: each takes a band that is next, sorts, lists or steps its discs, and waits for the others."""

from __future__ import annotations

import math

import numba as nb

from .atomic import added, idle, read, swapped, written
from .contacts import step
from .neighbours import CLOSE, FAST, HALF, NEXT, RADIUS, SPIN, UX, UY, VX, VY, X, Y, cells, listed, picked

PHASE, KIND, TASKS, STEP, BUFFER, FRESH, FULL, CLOCK = range(8)
DONE, CLAIM = 16, 32
"""What the threads of a march share: number of the phase (< 0: over), its kind and tasks, step, which of two lists
holds, whether `close` (2) or what may touch soon (1) is to be found anew, whether a list was too short, number of the
steps so far; apart from these, for each change takes the line of the cache from all others, tasks done of the phase and
from CLAIM on the phase that each band is next to be taken for."""
SORT, LIST, MARCH = range(3)
TRAVEL, SINCE, SOON = range(3)  # m, of the fastest since lists, `close` and what may touch soon were made
NEVER = -2  # a phase


@nb.njit(**FAST)
def march(  # type: ignore[no-untyped-def]
    me,
    sync,
    about,
    state,
    size,
    f,
    edges,
    n_free,
    law,
    box,
    plate,
    h,
    path,
    speed,
    skin,
    binned,
    lists,
    close,
    results,
    rough,
    held,
):
    """Advance by len(path) - 1 steps in place, together with all threads that call this with the same arrays.

    me: band that the thread begins with. sync: int64 as above; about (3,): TRAVEL, SINCE, SOON. state (2, STATE, n): of
    even and of odd steps. edges (bands + 1,): of the bands. path, speed (steps + 1,): height and velocity up of the
    foot at each step; plate: half width and height of the plate (a width < 0 is no plate); the driven discs move by the
    same path. binned: arrays of `cells` and the numbers of its columns and rows; lists: twice those of `listed`, by
    band (bands, 2, pairs), close: those of `picked` by band. results (bands, 16): greatest speed^2, push and impulse of
    the foot (x, y) and of the walls (x, y) on the free discs and work of friction, by the trapezoidal rule.
    """
    cell, first, inside, counts = binned
    bands, steps, reach = len(edges) - 1, len(path) - 1, CLOSE * skin
    while True:
        phase = read(sync, PHASE)
        if phase < 0:
            return
        for turn in range(bands):
            b = (me + turn) % bands  # the same ones in every step, as far as the others keep up
            if not swapped(sync, CLAIM + b, phase, phase + 1):  # another thread has it
                continue
            s, now, clock, low, high = sync[STEP], sync[BUFFER], sync[CLOCK], edges[b], edges[b + 1]
            old, new = state[s % 2], state[(s + 1) % 2]
            begin, end, partner, slide, seen = lists[now]
            mine = begin, end, partner[b], slide[b], seen[b]
            if sync[KIND] == SORT:
                counts[0], counts[1] = cells(old[X], old[Y], size[RADIUS], skin, cell, first, inside)
            elif sync[KIND] == LIST:
                begin, end, partner, slide, seen = lists[1 - now]
                free = begin, end, partner[b], slide[b], seen[b]
                if not listed(
                    old, size, skin, low, high, cell, first, inside, counts[0], counts[1], free, mine, clock - 1
                ):
                    written(sync, FULL, 1)
            else:
                rose = (path[s] - path[s - 1]) / h if s > 0 else 0.0
                foot = plate[0], plate[1], path[s], speed[s], rose
                one, other, where, square, wide, walls, soon, hits, found = close
                shorter = one[b], other[b], where[b], square[b], wide[b], walls[b], soon[b], hits[b]
                if sync[FRESH] == 2:
                    picked(old, size, reach, low, high, begin, end, mine[2], box, foot, shorter, found[b], held)
                results[b, 0] = step(
                    old,
                    new,
                    size,
                    f,
                    low,
                    high,
                    n_free,
                    mine,
                    shorter,
                    found[b],
                    sync[FRESH] > 0,
                    law,
                    box,
                    foot,
                    h,
                    s > 0,
                    s < steps,
                    results[b, 1:6],
                    rough,
                    held,
                    clock,
                )
                for c in range(5):
                    results[b, 6 + c] += (0.5 if s == 0 or s == steps else 1.0) * h * results[b, 1 + c]
            if added(sync, DONE, 1) + 1 == sync[TASKS]:
                written(sync, PHASE, following(phase, sync, about, state, n_free, bands, h, path, speed, skin, results))
        waited = 0
        while read(sync, PHASE) == phase:
            waited += 1
            if waited % SPINS == 0:
                idle()


SPINS = 200_000  # reads, tenths of a millisecond, that a thread waits for the others before it offers its core


@nb.njit(cache=True, nogil=True)
def following(phase, sync, about, state, n_free, bands, h, path, speed, skin, results):  # type: ignore[no-untyped-def]
    """Lays out the next phase, when all is done of this one; its number."""
    s, steps = sync[STEP], len(path) - 1
    sync[DONE] = 0
    if sync[KIND] == SORT:
        sync[KIND], sync[TASKS] = LIST, bands
    elif sync[KIND] == LIST:
        if sync[FULL]:
            return -1
        sync[KIND], sync[FRESH], sync[BUFFER] = MARCH, 2, 1 - sync[BUFFER]
        about[:] = 0.0
    else:
        sync[STEP], sync[FRESH] = s + 1, 0
        sync[CLOCK] += 1
        if s == steps:
            return -1
        old, new, up = state[s % 2], state[(s + 1) % 2], path[s + 1] - path[s]
        for j in range(n_free, old.shape[1]):
            new[X, j], new[Y, j], new[VX, j], new[VY, j] = old[X, j], old[Y, j] + up, 0.0, speed[s + 1]
            new[UX, j], new[UY, j], new[SPIN, j], new[HALF, j] = 0.0, up / h, 0.0, 0.0
        fastest = 0.0
        for b in range(bands):
            fastest = max(fastest, results[b, 0])
        way = h * max(math.sqrt(fastest), abs(speed[s]), abs(speed[s + 1]), abs(up) / h)
        about += way
        if 2.0 * about[TRAVEL] > skin:
            sync[KIND], sync[TASKS] = SORT, 1
        elif 2.0 * about[SINCE] > CLOSE * skin:
            sync[FRESH], about[SINCE], about[SOON] = 2, 0.0, 0.0
        elif 2.0 * about[SOON] > NEXT * CLOSE * skin:
            sync[FRESH], about[SOON] = 1, 0.0
    for b in range(bands):
        sync[CLAIM + b] = phase + 1 if b < sync[TASKS] else NEVER
    return phase + 1
