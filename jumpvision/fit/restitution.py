"""Restitution from successive bounces: the flight times shrink by it each time."""

from __future__ import annotations

import math

import numpy as np

from jumpvision.fit.estimate import Estimate
from jumpvision.fit.flight import Flights
from jumpvision.fit.line import fit_line

NAN = math.nan


def restitution(flights: Flights, *, after: float) -> Estimate:
    """e = speed after / before a bounce, from log t_i = log t_0 + i log e over the complete flights that end later than
    `after` [s] (the forcing stops), from the longest on. sigma from the edges' and, where larger, the scatter.

    NaN with a reason below two such flights. Landing and lift-off at the same height are assumed, no forcing between.
    """
    free = np.flatnonzero(np.isfinite(flights.time) & (flights.landing > after))
    if free.size:
        free = free[int(np.argmax(flights.time[free])) :]
    ends = np.flatnonzero(np.diff(free) > 1)
    free = free[: ends[0] + 1] if ends.size else free
    if free.size < 2:
        return Estimate(NAN, NAN, "", free.size, NAN, f"{free.size} free flights, two are needed")
    time, sigma = flights.time[free], flights.time_sigma[free]
    line = fit_line(np.arange(free.size), np.log(time), sigma / time)
    e = math.exp(line.slope)
    return Estimate(e, e * line.slope_sigma, "", free.size, line.chi2)
