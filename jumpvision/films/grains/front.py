"""Thickness of the jammed plug below the foot and its growth mu with intrusion (docs/physics.md section 4)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import FROM_MAD, Array
from jumpvision.estimate.estimate import Line, checked, checked_sigma, least_squares_fit, line_or_alike, scatter_factor

LOCAL = (
    0.5  # the profile below this share of its largest speed is not used: only the neighbourhood of the front matters
)
REJECT = 6.0  # robust sigmas from the median of five neighbours beyond which a frame is left out of mu
LARGEST = 50.0  # of an exponent: a step of the solver may leave what can be
NAN = float("nan")


@dataclass(frozen=True)
class Front:
    """thickness [m] below the foot's face at >= threshold of the largest speed; maximum: that speed [m/s].

    Sigmas hold the scatter factor; chi2 over n - 3 degrees of freedom. reason: why the values are NaN.
    """

    thickness: float
    sigma: float
    maximum: float
    maximum_sigma: float
    n: int
    chi2: float
    reason: str = ""


def jammed_thickness(z: ArrayLike, speed: ArrayLike, sigma: ArrayLike, *, threshold: float) -> Front:
    """Depth where the speed of the central column falls through threshold times its largest value.

    z [m]: depth below the foot's face, increasing, shape (n,). speed, sigma [m/s]: downward grain speed and its
    standard uncertainty; NaN = no vector. threshold: share of the largest speed, 0.9 in the thesis.

    Fitted is a plateau followed by an exponential, V for z < z0 and V exp(-(z - z0)/L) below, over the depths above
    which the smoothed speed exceeds half its maximum: the largest speed is the plateau of all vectors, not the noisiest
    one, and the crossing z0 + L ln(1/threshold) falls between vectors. Where the data show no plateau (z0 above the
    first vector) the exponential starts at the face and its value there is the largest speed.

    A front that falls through the flank within fewer than 3 vectors has no exponential: there the crossing is
    interpolated between the two vectors beside it, below the median of the plateau, and known to their distance over
    sqrt(12) besides the vectors' own errors.
    """
    z, speed, sigma = checked("jammed_thickness", z=z, speed=speed, sigma=sigma)
    checked_sigma("jammed_thickness", sigma)
    if not 0.0 < threshold < 1.0:
        raise ValueError(f"jammed_thickness: threshold = {threshold!r} must be in (0, 1), e.g. 0.9")
    good = np.isfinite(z) & np.isfinite(speed) & np.isfinite(sigma) & (z >= 0.0)
    z, speed, sigma = z[good], speed[good], sigma[good]
    if z.size < 5:
        return _none(z.size, f"{z.size} good vectors below the face, the front needs 5")
    if np.any(np.diff(z) <= 0.0):
        raise ValueError("jammed_thickness: z must increase (depth below the foot's face)")
    smooth = np.array([np.median(speed[max(0, i - 2) : i + 3]) for i in range(z.size)])
    top = float(smooth.max())
    if top < 3.0 * float(np.median(sigma)):
        return _none(z.size, "no moving grains: largest speed below 3 sigma")
    below = np.flatnonzero(smooth < LOCAL * top)
    below = below[below > int(np.argmax(smooth))]
    end = int(below[0]) if below.size else z.size
    fallen = np.flatnonzero(smooth < threshold * top)
    if below.size and end - int(fallen[fallen > int(np.argmax(smooth))][0]) < 3:  # vectors that an exponential needs
        return _interpolated(z, speed, sigma, threshold)
    if end < 5:
        return _none(end, f"{end} vectors above half the largest speed, the front needs 5")
    zl, vl, el = z[:end], speed[:end], sigma[:end]

    def share(p: Array) -> Array:
        return np.asarray(np.exp(np.minimum(-np.maximum(zl - p[1], 0.0) / p[2], LARGEST)) / el)

    def jacobian(p: Array) -> Array:
        part, beyond = share(p), np.maximum(zl - p[1], 0.0)
        steep = p[0] * part / p[2]
        return np.stack([-part, -steep * (beyond > 0.0), -steep * beyond / p[2]], axis=1)

    best, step = None, float(np.median(np.diff(zl)))
    fall = max(float(zl[-1] - zl[0]), step)
    for z0 in np.linspace(zl[0], zl[-1] - step, 9):  # the corner makes chi2 multimodal: several starts
        fit = least_squares_fit(
            lambda p: vl / el - p[0] * share(p),
            [top, z0, max(0.7 * (zl[-1] - z0), step)],
            scale=[float(np.median(el)), step, fall],
            jacobian=jacobian,
        )
        if fit is not None and fit[0][2] > 0.0 and fit[0][1] > zl[0] and (best is None or fit[2] < best[2]):
            best = fit
    if best is None:  # a corner above the first vector leaves V and z0 inseparable: falling from the face on
        best = _from_the_face(zl, vl, el, top, fall)
    if best is None:
        return _none(end, "the front could not be fitted")
    (v, z0, length), cov, chi2 = best
    # a profile with a larger chi2 per degree of freedom is no plateau and exponential
    if chi2 > 4.0 * (end - 3):
        return _interpolated(z, speed, sigma, threshold)
    fall_log = -math.log(threshold)
    thickness = z0 + length * fall_log
    if not 0.0 <= thickness <= zl[-1]:
        return _none(end, "the speed does not fall through the threshold inside the measured column")
    factor = scatter_factor(chi2, end - 3)
    row = np.array([0.0, 1.0, fall_log])
    return Front(
        float(thickness),
        factor * math.sqrt(float(row @ cov @ row)),
        float(v),
        factor * math.sqrt(float(cov[0, 0])),
        end,
        chi2,
    )


def fit_mu(intrusion: ArrayLike, thickness: ArrayLike, sigma: ArrayLike) -> Line:
    """mu = slope of the jammed thickness below the foot's face against the intrusion depth z; the intercept is free.

    intrusion [m]: depth of the face below the undisturbed surface. thickness, sigma [m]: from jammed_thickness, NaN
    frames are left out. Frames that stray from their neighbours in depth do not count. Where the front itself scatters
    from frame to frame by more than the sigmas, each frame counts alike (`line_or_alike`). (Depth of the front from the
    surface instead of from the face would give 1 + mu.)
    """
    intrusion, thickness, sigma = checked("fit_mu", intrusion=intrusion, thickness=thickness, sigma=sigma)
    return line_or_alike(intrusion, np.where(_strays(intrusion, thickness, sigma), NAN, thickness), sigma)


def _strays(x: Array, y: Array, sigma: Array) -> NDArray[np.bool_]:
    """Points farther than REJECT robust sigmas from the median of five neighbours along x, the median slope taken out.

    A front that runs on in a jump is no stray: its neighbours go with it.
    """
    out, good = np.zeros(x.size, bool), np.flatnonzero(np.isfinite(x) & np.isfinite(y) & np.isfinite(sigma))
    good = good[np.argsort(x[good], kind="stable")]
    i, j = np.triu_indices(good.size, 1)
    run = x[good[j]] - x[good[i]]
    if good.size < 5 or not (run > 0.0).any():
        return out
    slope = np.median((y[good[j]] - y[good[i]])[run > 0.0] / run[run > 0.0])
    left = y[good] - slope * x[good]
    near = np.array([np.median(left[max(0, k - 2) : k + 3]) for k in range(good.size)])
    off = np.abs(left - near)
    out[good] = off > REJECT * np.hypot(sigma[good], FROM_MAD * float(np.median(off)))
    return out


def _from_the_face(z: Array, v: Array, e: Array, top: float, fall: float) -> tuple[Array, Array, float] | None:
    def share(p: Array) -> Array:
        return np.asarray(np.exp(np.minimum(-z / p[1], LARGEST)) / e)

    def jacobian(p: Array) -> Array:
        return np.stack([-share(p), -p[0] * share(p) * z / p[1] ** 2], axis=1)

    fit = least_squares_fit(
        lambda p: v / e - p[0] * share(p), [top, fall], scale=[float(np.median(e)), fall], jacobian=jacobian
    )
    if fit is None or fit[0][1] <= 0.0:
        return None
    (v0, length), cov2, chi2 = fit
    cov = np.zeros((3, 3))
    cov[np.ix_([0, 2], [0, 2])] = cov2
    return np.array([v0, 0.0, length]), cov, chi2


def _interpolated(z: Array, v: Array, e: Array, threshold: float) -> Front:
    """Where the speed first falls below threshold times its plateau, linearly between two vectors."""
    # vectors above 0.95 of the greatest speed are the plateau of a sharp front
    plateau = max(3, int(np.sum(v > 0.95 * v.max())))
    top, top_sigma = float(np.median(v[:plateau])), float(np.median(e[:plateau])) * math.sqrt(0.5 * math.pi / plateau)
    below = np.flatnonzero(v < threshold * top)
    if below.size == 0 or below[0] == 0:
        return _none(z.size, "the speed does not fall through the threshold inside the measured column")
    k = int(below[0])
    step, fall = z[k] - z[k - 1], v[k - 1] - v[k]
    part = (v[k - 1] - threshold * top) / fall
    noise = math.hypot((1.0 - part) * e[k - 1], part * e[k], threshold * top_sigma) / fall
    place = step * math.hypot(noise, 12.0**-0.5)
    return Front(float(z[k - 1] + part * step), float(place), top, top_sigma, plateau + 2, 0.0)


def _none(n: int, reason: str) -> Front:
    return Front(NAN, NAN, NAN, NAN, n, NAN, reason)
