"""Image pairs: how and where they are matched, the vectors of one, and slow motion from pairs further apart."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array

SMOOTHING = ("none", "adaptive")
TIMES = {"default": 3, "fast": 2, "sharp": 8}  # Gauss-Newton steps: each gives back some of what the window averages


@dataclass(frozen=True)
class Settings:
    """How a pair is matched; the keywords of `piv_pair` and `piv_film`. ValueError says what does not fit."""

    window: int  # px, side of the matched window (even sizes one more), under a Gaussian weight
    step: int  # px, distance of the vectors
    passes: tuple[int, ...]  # px, windows of the correlations that give other starts, large to small; the first must
    # exceed twice the largest displacement
    min_correlation: float  # matches below it are replaced
    min_texture: float  # grey, standard deviation below which a window is empty
    outlier: float  # limit of the normalised median test, about 2
    smooth: str = "adaptive"  # see `scales`, or "none"
    preset: str = "default"  # or "fast": spline on whole pixels, two steps; "sharp": eight steps

    def __post_init__(self) -> None:
        for name, value, low in (("window", self.window, 7), ("step", self.step, 1)):
            if value < low:
                raise ValueError(f"{name} = {value}: must be at least {low}")
        if not self.passes or min(self.passes) < 8:
            raise ValueError(
                f"passes = {self.passes}: must be window sizes of at least 8 px, large to small, as (64, 32)"
            )
        if self.smooth not in SMOOTHING:
            raise ValueError(f"smooth = {self.smooth!r}: must be one of {', '.join(SMOOTHING)}")
        if self.preset not in TIMES:
            raise ValueError(f"preset = {self.preset!r}: must be one of {', '.join(TIMES)}")


VALID, MASKED, NO_TEXTURE, LOW_CORRELATION, SECOND_PEAK, INTERPOLATED, EDGE_PEAK, NOT_CONVERGED = range(8)

REASONS: dict[int, str] = {
    VALID: "valid",
    MASKED: "masked: less than half of the window is usable",
    NO_TEXTURE: "no texture in the window",
    LOW_CORRELATION: "low correlation or uncertainty above 2 px, replaced by interpolation",
    SECOND_PEAK: "outlier, replaced by the second correlation peak or by a match started from its neighbours",
    INTERPOLATED: "outlier (normalised median), replaced by interpolation",
    EDGE_PEAK: "correlation peak at the edge of the search, replaced by interpolation",
    NOT_CONVERGED: "the match did not converge, replaced by interpolation",
}
MATCHED = (VALID, LOW_CORRELATION, SECOND_PEAK, INTERPOLATED, EDGE_PEAK, NOT_CONVERGED)  # windows with texture
MEASURED = (VALID, SECOND_PEAK)  # codes whose u, v are matches of the images and not an interpolation


@dataclass(frozen=True)
class VectorField:
    """Displacement between two frames, image axes: x = column to the right, y = row DOWN, pixel centres at integers.

    The material at (x, y) half-way in time between the frames moves by (u, v) px from the first frame to the second.
    Where `reason` is a replacement, u and v are the robust mean of the measured neighbours and u_sigma, v_sigma their
    scatter; without enough neighbours, and where masked or without texture, they are NaN.
    """

    x: Array  # (nx,) [px]
    y: Array  # (ny,) [px]
    u: Array  # (ny, nx) [px/frame pair], to the right
    v: Array  # (ny, nx) [px/frame pair], down
    u_sigma: Array  # (ny, nx) [px], standard uncertainty
    v_sigma: Array
    correlation: Array  # (ny, nx) normalised correlation of the matched windows, -1..1
    reason: NDArray[np.int8]  # (ny, nx) key of REASONS
    u_raw: Array  # (ny, nx) before replacement
    v_raw: Array
    matched: Array  # (4, ny, nx) [px] u, v and their sigmas unsmoothed: for means and fits
    gradient: Array  # (2, 2, ny, nx) [1], [[u_x, u_y], [v_x, v_y]] fitted inside the window, NaN where not measured
    gradient_sigma: Array  # (2, 2, ny, nx) [1], standard uncertainty
    period: float = 0.0  # px, that sigma holds where the pattern repeats and displacements are known but for it


def coded_apart(f: VectorField, coded: float) -> VectorField:
    """A field whose frames a codec has put `coded` [px] apart from where they belong."""
    if not coded:
        return f
    matched = np.concatenate([f.matched[:2], np.hypot(f.matched[2:], coded)])
    return replace(f, u_sigma=np.hypot(f.u_sigma, coded), v_sigma=np.hypot(f.v_sigma, coded), matched=matched)


FURTHEST = 2.0  # px: a longer displacement gains little and loses grains
FURTHEST_CODED = 8.0  # px: where a codec has moved the frames, every longer displacement gains


def combined(fields: list[tuple[float, VectorField]], furthest: float = FURTHEST) -> VectorField:
    """Displacement per shortest baseline from fields (baseline, field) of one mid-time, the shortest first.

    Every longer one that is measured, moves by no more than `furthest` [px] and agrees with those before it takes part
    with the weight of its variance (their errors come from different frames). What is left of the disagreement widens
    sigma as in Birge's ratio. Gradients are those of the longest that takes part; all else is that of the shortest.
    """
    if len(fields) == 1:
        return fields[0][1]
    base = fields[0][1]
    as_matched, use = _together(fields, [f.matched for _, f in fields], furthest)
    best, _ = _together(fields, [np.stack([f.u, f.v, f.u_sigma, f.v_sigma]) for _, f in fields], furthest)
    gradient, gradient_sigma = base.gradient.copy(), base.gradient_sigma.copy()
    for taken, (baseline, f) in zip(use, fields[1:]):
        n = baseline / fields[0][0]
        gradient[:, :, taken], gradient_sigma[:, :, taken] = (
            f.gradient[:, :, taken] / n,
            f.gradient_sigma[:, :, taken] / n,
        )
    u, v, su, sv = best
    return replace(
        base, u=u, v=v, u_sigma=su, v_sigma=sv, matched=as_matched, gradient=gradient, gradient_sigma=gradient_sigma
    )


def _together(
    fields: list[tuple[float, VectorField]], of: list[Array], furthest: float
) -> tuple[Array, list[NDArray[np.bool_]]]:
    """The same of u, v and their sigmas (4, ny, nx) of each field; also where each of the longer ones took part."""
    (unit, base), *longer = fields
    d, s = of[0][:2], of[0][2:]
    weight = np.where(np.isin(base.reason, MEASURED), 1 / s**2, np.nan)
    total, mean, chi2, count = weight.copy(), d.copy(), np.zeros_like(d), np.ones(d.shape[1:])
    parts = []
    for (baseline, f), values in zip(longer, of[1:]):
        u, sigma = values[:2] * (unit / baseline), values[2:] * (unit / baseline)
        apart = (u - mean) ** 2 / (sigma**2 + 1 / total)
        # two baselines agree within 3 standard uncertainties
        use = np.isin(f.reason, MEASURED) & (np.hypot(f.u, f.v) <= furthest) & (apart.max(0) <= 3.0**2)
        w = np.where(use, 1 / sigma**2, 0.0)
        mean, chi2 = np.where(use, (total * mean + w * u) / (total + w), mean), chi2 + np.where(use, apart, 0.0)
        total, count = total + w, count + use
        parts.append(use)
    birge = np.sqrt(np.maximum(1.0, chi2.sum(0) / np.maximum(2 * (count - 1), 1)))
    several = count > 1
    return np.concatenate([np.where(several, mean, d), np.where(several, birge / np.sqrt(total), s)]), parts
