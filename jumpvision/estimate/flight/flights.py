"""Flights: lift-off and landing with their uncertainties, the height and restitution they imply."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.base.schema import StageWarning

from ..estimate import Estimate, scatter_factor

NAN = float("nan")
SINGULAR = 1e-3  # of its least variance: an eigenvalue of a covariance that is none


@dataclass(frozen=True)
class Flights:
    """Lift-off and landing times [s] and their standard uncertainties, shape (number of flights,), in order.

    NaN stands for an edge outside the record (in the air when it begins or ends). `len()` is n_jumps.
    covariance: of a flight's lift-off and landing [s^2]; shared (n, m): covariance of its time with those of the m next
    [s^2], by the impacts, parabolas and ground that they share. curvature [m/s^2]: of the track in
    flight, fitted freely, with its standard uncertainty. kinds: what each flight begins and ends with. doubts: what is
    wrong with the record as a whole, of kind "scale" or "noise".
    """

    lift_off: Array
    lift_off_sigma: Array
    landing: Array
    landing_sigma: Array
    covariance: Array = field(default_factory=lambda: np.zeros(0))
    shared: Array = field(default_factory=lambda: np.zeros((0, 0)))
    curvature: Array = field(default_factory=lambda: np.zeros(0))
    curvature_sigma: Array = field(default_factory=lambda: np.zeros(0))
    kinds: tuple[tuple[str, str], ...] = ()
    doubts: tuple[StageWarning, ...] = ()

    def __post_init__(self) -> None:
        n = self.lift_off.size
        for name, empty in (("covariance", np.zeros(n)), ("shared", np.zeros((n, 0)))):
            if len(getattr(self, name)) != n:
                object.__setattr__(self, name, empty)

    def __len__(self) -> int:
        return int(self.lift_off.size)

    @property
    def time(self) -> Array:
        """Flight times [s]."""
        return self.landing - self.lift_off

    @property
    def time_sigma(self) -> Array:
        """Of the flight times [s], with the correlation of their ends."""
        both = self.lift_off_sigma**2 + self.landing_sigma**2 - 2.0 * self.covariance
        return np.asarray(np.sqrt(np.maximum(both, 0.0)))

    def only(self, keep: NDArray[np.bool_]) -> Flights:
        """Those of a mask (n,); what neighbours shared is then unknown, and taken as nothing, where one is left out."""
        at = np.flatnonzero(keep)
        shared = self.shared[at].copy()
        for lag in range(1, shared.shape[1] + 1):
            follows = np.zeros(at.size, bool)
            follows[: at.size - lag] = (at[lag:] - at[:-lag] == lag) if at.size > lag else False
            shared[~follows, lag - 1] = 0.0
        arrays = {f.name: getattr(self, f.name) for f in fields(self) if f.name not in ("shared", "kinds", "doubts")}
        rows = {k: a[at] if len(a) else a for k, a in arrays.items()}
        kinds = tuple(self.kinds[i] for i in at) if self.kinds else ()
        return Flights(**rows, shared=shared, kinds=kinds, doubts=self.doubts)


def flights_of(rows: list[tuple[float, ...]]) -> Flights:
    """Of rows lift_off, its sigma, landing, its sigma."""
    table = np.array(rows, dtype=float).reshape(-1, 4)
    up, up_sigma, down, down_sigma = table.T.copy()
    return Flights(up, up_sigma, down, down_sigma)


def final_flight(flights: Flights, *, after: float) -> int | None:
    """Index of the longest complete flight that ends later than `after` [s] (forcing stops); None without one."""
    time = np.where(flights.landing > after, flights.time, np.nan)
    return None if not np.isfinite(time).any() else int(np.nanargmax(time))


def flight_height(time: float, sigma: float, *, gravity: float, gravity_sigma: float = 0.0) -> Estimate:
    """g t_f^2 / 8 [m], gravity [m/s^2] along the rail: the apex above a lift-off and a landing at the same height."""
    height = gravity * time**2 / 8.0
    reason = "" if math.isfinite(height) else "no complete flight"
    estimate = Estimate(height, gravity * time / 4.0 * sigma, "m", 1, 0.0, reason)
    return estimate.with_common(time**2 / 8.0 * gravity_sigma)  # one gravity for all jumps


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
    time, shared = flights.time[free], flights.shared[free]
    cov = np.diag(flights.time_sigma[free] ** 2)
    for lag in range(1, min(shared.shape[1], free.size - 1) + 1):
        at = np.arange(free.size - lag)
        cov[at, at + lag] = cov[at + lag, at] = shared[: free.size - lag, lag - 1]
    slope, sigma, chi2 = _slope(np.log(time), cov / np.outer(time, time))
    e = math.exp(slope)
    return Estimate(e, e * sigma, "", free.size, chi2)


def _slope(y: Array, cov: Array) -> tuple[float, float, float]:
    """(slope, its sigma with the scatter factor, chi^2) of y (n,) over 0, 1, ... with covariance (n, n)."""
    a = np.stack([np.ones(y.size), np.arange(y.size)], axis=1)
    if np.linalg.eigvalsh(cov)[0] <= SINGULAR * float(
        np.diag(cov).min()
    ):  # what flights further apart share is missing
        cov = np.diag(np.diag(cov))
    inverse = np.linalg.inv(cov)
    of_slope = np.linalg.inv(a.T @ inverse @ a)
    p = of_slope @ (a.T @ inverse @ y)
    off = y - a @ p
    chi2 = float(off @ inverse @ off)
    return float(p[1]), scatter_factor(chi2, y.size - 2) * math.sqrt(float(of_slope[1, 1])), chi2
