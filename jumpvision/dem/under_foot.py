"""A bed of discs that a foot has entered before, and its motion while the foot goes its way: arrays in, arrays out."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from jumpvision.dem.discs import Box, Discs, Law, Plate
from jumpvision.dem.motion import Motion, simulate, time_step
from jumpvision.dem.packing import pack

Array = NDArray[np.float64]

ENTRY = 0.08  # m/s, mean; discs thrown ahead of the foot slide on by v^2/(2 coulomb) = 0.3 mm
REST = 0.01  # s, between the entry and the path


def discs_under_foot(
    t: Array, foot_y: Array, times: Array, *, half_width: float, bed: tuple[float, float], diameter: float,
    fraction: float, rng: np.random.Generator, coulomb: float = 10.0, friction: float = 0.0,
    deepest: float | None = None,
) -> tuple[Discs, Motion]:  # fmt: skip
    """Discs of two sizes "on a carpet" at the times (T,) [s], the first the start, under a foot that goes t, foot_y.

    half_width [m] of the foot, whose face is at foot_y [m] (up, 0 at the surface); bed: half width and depth [m];
    diameter [m]: mean; fraction: of the area; coulomb [m/s^2]: sliding friction on the carpet;
    friction: coefficient between grains, also with foot and walls. The foot enters slowly to the height
    `deepest` [m] (default foot_y[0]), goes back to foot_y[0] and leaves a hole. ValueError where the discs do not fit.
    """
    half, depth = bed
    box = Box(-half, half, -depth, 0.0)
    d = pack(box, fraction, diameter=diameter, density=1.0, rng=rng)
    law = Law.bouncing(0.5, 1e-4, 0.5 * float(d.mass.min()), coulomb=coulomb, friction=friction)
    box, plate, h = Box(-half, half, -depth), Plate(half_width, 0.02), time_step(d, law)
    first = float(foot_y[0])
    lowest = first if deepest is None else min(deepest, first)
    begin, at = float(times[0]), d
    ways = [(0.0, lowest), (lowest, first)] if lowest < first else [(0.0, first)]
    spans = [max(abs(b - a) / ENTRY, 1e-3) for a, b in ways]
    clock = begin - REST - sum(spans)
    s = np.linspace(0.0, 1.0, 50)
    for (a, b), span in zip(ways, spans):
        path = a + (b - a) * s**2 * (3.0 - 2.0 * s)
        m = simulate(at, law, box, times=[clock, clock + span], dt=h, foot=plate, foot_t=clock + span * s, foot_y=path)
        at, clock = m.last(d), clock + span
    rest = [begin - REST, begin]
    at = simulate(at, law, box, times=rest, dt=h, foot=plate, foot_t=rest, foot_y=[first, first]).last(d)
    fine = np.linspace(begin, float(times[-1]), max(math.ceil((times[-1] - begin) / 5e-4), 4))
    path = np.interp(fine, t, foot_y)
    return d, simulate(at, law, box, times=times, dt=h, foot=plate, foot_t=fine, foot_y=path)
