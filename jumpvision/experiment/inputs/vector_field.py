"""A velocity field as the file of another program holds it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError

from .held import tell

FORMATS = "pivpy .nc, OpenPIV .txt, PIVlab .txt or .mat, DaVis .txt, Insight .vec"
FOOT = ("foot_y", "foot_y_sigma", "foot_v", "foot_v_sigma")


@dataclass(frozen=True)
class Vectors:
    """x (nx,), y (ny,) in `length` units, u, v in `speed` units and valid: shape (ny, nx, nt), rows along y.

    up: "+y" where y and v count upwards, "-y" downwards. mirrored: x counts to the left. time [s]: mid-time of each
    field. pair [s]: from the first image of a pair to the second. window: side of the matched window over the distance
    of the vectors. u_sigma, v_sigma: standard uncertainties, in `speed` units. foot: FOOT over the fields, in SI and y
    up. None, or {}: the file does not say.
    """

    x: Array
    y: Array
    u: Array
    v: Array
    valid: NDArray[np.bool_]
    length: str | None
    speed: str | None
    up: str | None
    mirrored: bool = False
    time: Array | None = None
    pair: float | None = None
    window: float | None = None
    u_sigma: Array | None = None
    v_sigma: Array | None = None
    foot: Mapping[str, Array] = field(default_factory=dict)


def mask_zero_vectors(found: Vectors, where: str) -> Vectors:
    """Mark every vector of exactly (0, 0) invalid: programs write it where nothing was measured.

    where: the file's name in the warning. Raises InputError where no vector moves.
    """
    zero = (found.u == 0.0) & (found.v == 0.0)
    if not np.any(np.isfinite(found.u + found.v) & ~zero):
        raise InputError(
            [
                f"{where}: u and v are 0 or missing everywhere; a motion must be there. If it was read from OpenPIV's "
                "text by pivpy, which takes its mask for the other way round, name that text itself"
            ]
        )
    if n := int(np.sum(zero & found.valid)):
        tell(
            f"{where}: {n} of {found.valid.sum()} measured vectors are exactly 0 in u and v and are left out, as "
            "programs write zeros where nothing was measured; export those as NaN or flagged (OpenPIV: save(mask=...))"
        )
    return replace(found, valid=found.valid & ~zero)
