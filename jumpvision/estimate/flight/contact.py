"""Flights from a contact sensor: a switch that bounces, its edges between two samples."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..estimate import checked, checked_times
from .flights import NAN, Flights, flights_of


def contact_flights(t: ArrayLike, contact: ArrayLike, *, debounce: float) -> Flights:
    """Flights from a contact signal, 1 on the ground and 0 in the air, sampled at t [s]; NaN samples are left out.

    debounce [s]: gaps in contact shorter than this are contact (so a bouncing switch closes at its first and opens at
    its last touch), and then contacts shorter than this are flight. Each edge lies in the middle between two samples,
    with the uncertainty of a uniform distribution over them, interval/sqrt(12).
    """
    t, contact = checked("contact_flights", t=t, contact=contact)
    good = np.isfinite(t) & np.isfinite(contact)
    checked_times("contact_flights", np.where(good, t, np.nan))
    t, contact = t[good], contact[good]
    bad = np.flatnonzero((contact != 0.0) & (contact != 1.0))
    if bad.size:
        raise ValueError(f"contact_flights: contact[{bad[0]}] = {contact[bad[0]]:g} must be 0 (air) or 1 (ground)")
    touch = contact == 1.0
    if touch.size == 0:
        return flights_of([])
    edges = 0.5 * (t[1:] + t[:-1])
    for value in (False, True):
        for i, j in runs(touch == value):
            if i > 0 and j < touch.size and edges[j - 1] - edges[i - 1] < debounce:
                touch[i:j] = not value
    wait = np.diff(t) / math.sqrt(12.0)
    rows: list[tuple[float, ...]] = []
    for i, j in runs(~touch):
        up = (edges[i - 1], wait[i - 1]) if i > 0 else (NAN, NAN)
        down = (edges[j - 1], wait[j - 1]) if j < t.size else (NAN, NAN)
        rows.append((*up, *down))
    return flights_of(rows)


def runs(flag: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """(first, one past the last) index of every run of True."""
    change = np.flatnonzero(np.diff(np.concatenate(([0], flag.astype(np.int8), [0]))))
    return [(int(i), int(j)) for i, j in zip(change[::2], change[1::2])]
