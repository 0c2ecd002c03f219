"""A ball whose own picture tells too little (compressed, blurred, of two tones): the fit of a capsule that is known.

A disc that moves during the exposure covers a capsule. Its diameter, blur and streak are taken from the rows before and
from the path, as priors; place and light are fitted. Where that does not come to rest, the candidate's own centre is
the measurement.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from . import disc
from .background import View
from .measure import DIAMETER_SEEN, DIGITS, Found, Start, _levels, span
from .reasons import GOOD, Flag, Reason
from .unknowns import BX, GY, NAMES, WX, A, B, R, S, X, Y

LEARNED, GUESSED = 0.05, 0.15  # of the diameter: its scatter where rows before told it, and where the outline did
LIGHT = 0.1  # of the contrast: lighting across the ball
AWAY = 0.35  # diameters from the candidate: a fit that ends farther is of something else
CENTROID = 0.04  # diameters: scatter of a candidate's centre in compressed films, benchmarks/clips_coded.py
SHAPE, OTHER = 0.15, 0.4  # by how much of what its outline is off; diameters: an outline of something else
MISFIT = 0.02  # of the squared contrast: variance of a pixel about the shape
MOVED = 0.1  # diameters an exposure from which on a streak is fitted


class Outline(NamedTuple):
    """A candidate: centre x, y, diameter d, streak wx, wy [px]."""

    x: float
    y: float
    d: float
    wx: float
    wy: float


def fit_stiff(
    view: View, spot: Outline, d: float, streak: tuple[float, float], sign: float, known: disc.Memory | None
) -> Found:
    """Fit the ball of diameter d [px] at a candidate that moves by `streak` in the exposure. known: of rows before."""
    x, y = spot.x, spot.y
    (wx, wy), height, width = streak, *view.shape
    length = math.hypot(wx, wy)
    reach = 0.5 * d
    inside = reach + 0.5 * abs(wx) < x < width - 1 - reach - 0.5 * abs(wx)
    if not (inside and reach + 0.5 * abs(wy) < y < height - 1 - reach - 0.5 * abs(wy)):
        return Found(Flag(Reason.AT_BORDER), x, y)
    # the outline's centre is the ball's as far as it has its size and length
    other = math.hypot(spot.d - d, max(0.0, math.hypot(spot.wx, spot.wy) - length)) / d
    plain = Found(GOOD, x, y, math.hypot(CENTROID, SHAPE * other) * d, d)
    if other > OTHER:
        plain = Found(Flag(Reason.OTHER_DIAMETER, (spot.d, d)), x, y)
    (x0, x1), (y0, y1) = span(x, wx, d, width), span(y, wy, d, height)
    part = view.part(y0, y1, x0, x1)
    crop = np.ascontiguousarray(part, dtype=np.float64)
    if min(crop.shape) < 4:
        return Found(Flag(Reason.OUTSIDE))
    levels = _levels(crop, x - x0, y - y0, Start(x, y, d, wx, wy, True))
    if levels is None:
        return Found(Flag(Reason.NOT_FINITE))
    p = np.zeros(len(NAMES))
    p[X], p[Y], p[R], p[S], p[B], p[A] = x - x0, y - y0, 0.5 * d, max(0.8, 0.06 * d), *levels
    if known is not None:
        p[S] = known.last[S]
    contrast = sign * (p[A] - p[B])
    if not contrast > 0.0:
        return Found(Flag(Reason.NO_CONTRAST), x, y)
    moves = length > MOVED * d
    p[WX:] = (wx, wy) if moves else (0.0, 0.0)
    var = np.full(len(NAMES), np.inf)
    var[R] = ((GUESSED if known is None else LEARNED) * p[R]) ** 2
    var[S] = (0.3 * p[S]) ** 2
    var[BX : GY + 1] = (LIGHT * contrast) ** 2
    var[WX:] = (0.5 + 0.3 * length) ** 2
    floor = DIGITS if part.dtype.kind in "ui" else (1e-4 * contrast) ** 2
    # what neither a codec nor another face keeps from being this shape; no pixel may be left out for it
    noise = np.full(3, max(MISFIT * contrast**2, floor))
    if known is not None:
        noise = np.maximum(noise, 2.0 * known.noise)
    fit = disc.fit_disc(crop, p, streak=moves, noise=noise, mean=p.copy(), var=var)
    if not fit.converged:
        return plain
    p = fit.p
    if fit.chi2 > 1.0:
        return Found(Flag(Reason.POOR_FIT, (fit.chi2,)), p[X] + x0, p[Y] + y0)
    if known is not None and abs(2.0 * p[R] - d) > DIAMETER_SEEN * d:
        return Found(Flag(Reason.OTHER_DIAMETER, (2.0 * p[R], d)), p[X] + x0, p[Y] + y0)
    if math.hypot(p[X] + x0 - x, p[Y] + y0 - y) > AWAY * d + 0.25 * length:
        return plain
    rim = float(np.nanmean(fit.shifts**2))  # px^2: what the shape leaves of the rim, of 16 sectors
    sigma = math.sqrt(max(fit.cov[X, X], fit.cov[Y, Y]) * fit.chi2 + rim * 2.0 / 16.0)
    q = p.copy()
    q[X], q[Y] = p[X] + x0, p[Y] + y0
    return Found(GOOD, float(q[X]), float(q[Y]), sigma, 2.0 * float(q[R]), fit.chi2, p=q)
