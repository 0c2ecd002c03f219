"""What one wrong number makes of a track: a model run with the declared numbers and with another one of them; the track
on another scale, or another clock.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from jumpvision.base.arrays import Array

from .push import first_motion

FEWEST = 30  # samples of a track to compare
PROMISING = 0.5  # of the misfit, at the nearest of FACTORS, from where the best is looked for
FACTORS = np.geomspace(1.0 / 12.0, 12.0, 17)  # of a number; refined between
PACES = np.geomspace(0.25, 4.0, 71)  # of the track's clock
SHIFTS = np.linspace(-0.03, 0.03, 31)  # s, of its first motion
COARSE = 150  # samples on which PACES and SHIFTS are compared: all of a track would take 8 times as long

Motion = tuple[Array, Array]  # s, m
AS_DECLARED: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True)
class Played:
    """A track h (n,) [m], zero at rest, at t [s], and what a model makes of numbers in place of the declared ones, from
    begin until `until` [s]."""

    t: Array
    h: Array
    begin: float
    until: float
    model: Callable[[Mapping[str, float]], Motion]

    @property
    def early(self) -> Motion:
        """The part of the track that is compared as it is."""
        near = self.t < self.until
        return self.t[near], self.h[near]

    @property
    def size(self) -> float:
        """Of the motion [m]."""
        return float(np.ptp(self.early[1]))

    def misfit(self, numbers: Mapping[str, float] = AS_DECLARED) -> float:
        """rms [m] between track and model; inf where it has no solution."""
        t, h = self.early
        try:
            return rms(h - np.interp(t, *self.model(numbers)))
        except (ValueError, RuntimeError):
            return math.inf

    def scaled(self) -> tuple[float, float]:
        """(misfit [m], factor on the heights at which it is least)."""
        t, h = self.early
        y = np.interp(t, *self.model(AS_DECLARED))
        q = float(h @ y / max(float(h @ h), 1e-30))
        return rms(q * h - y), q

    def other(self, name: str, value: float) -> tuple[float, float]:
        """(misfit [m], factor on a number, whose declared value is given, at which it is least)."""
        from scipy.optimize import minimize_scalar

        def at(log_q: float) -> float:
            return self.misfit({name: value * math.exp(log_q)})

        logs = np.log(FACTORS)
        coarse = [at(q) for q in logs]
        k = int(np.argmin(coarse))
        if not coarse[k] < PROMISING * at(0.0):
            return coarse[k], float(FACTORS[k])
        step = logs[1] - logs[0]
        fine = minimize_scalar(at, bounds=(logs[k] - step, logs[k] + step), method="bounded", options={"xatol": 3e-3})
        return float(fine.fun), math.exp(float(fine.x))

    def paced(self) -> tuple[float, float]:
        """(misfit [m], factor on the track's times from its first motion on at which it is least)."""
        from scipy.optimize import minimize

        clock, y = self.model(AS_DECLARED)
        here, there = first_motion(self.t, self.h), first_motion(clock, y)

        def at(pace_shift: Array) -> float:
            tau = there + pace_shift[0] * (self.t - here) + pace_shift[1]
            near = (tau > self.begin) & (tau < self.until)
            if near.sum() < FEWEST:
                return math.inf
            apart = self.h[near] - np.interp(tau[near], clock, y)
            return rms(apart - np.median(apart))  # rest was sought before the motor starts by a wrong clock

        begun = self._nearest(here, there, clock, y)
        fine = minimize(at, begun, method="Nelder-Mead", options={"xatol": 1e-4, "fatol": 1e-7})
        return float(fine.fun), float(fine.x[0])

    def _nearest(self, here: float, there: float, clock: Array, y: Array) -> Array:
        """The best of PACES and SHIFTS (2,), by every n-th sample of the track, which first moves at `here` [s]; the
        model, y at `clock`, at `there`."""
        every = max(1, self.t.size // COARSE)
        t, h = self.t[::every] - here, self.h[::every]
        tried = []
        for pace in PACES:
            tau = there + pace * t + SHIFTS[:, None]
            near = (tau > self.begin) & (tau < self.until)
            n = np.maximum(near.sum(axis=1), 1)
            apart = near * (h - np.interp(tau, clock, y))
            variance = (apart**2).sum(axis=1) / n - (apart.sum(axis=1) / n) ** 2
            variance[n * every < FEWEST] = math.inf
            k = int(np.argmin(variance))
            tried.append((float(variance[k]), float(pace), float(SHIFTS[k])))
        return np.array(min(tried)[1:])


def rms(x: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(x**2)))
