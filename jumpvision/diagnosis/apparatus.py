"""What all recordings of one apparatus have wrong together, as parameters of the baseline with the priors stated.

A scale, a clock or a lens that is off by what is stated for it is no discrepancy, and does not average out over jumps.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from .jumps import Jump
from .system import Parameter

Array = NDArray[np.float64]

KINDS = {"scale": (1.0, "1"), "offset": (0.0, "s"), "rate": (0.0, "1"), "lens": (0.0, "1")}  # declared value, unit
REACH = 8.0  # sigmas that a fit may go


def groups(jumps: Sequence[Jump]) -> list[int]:
    """Number of each jump's apparatus, in the order of appearance."""
    names = list(dict.fromkeys(j.shared.apparatus for j in jumps))
    return [names.index(j.shared.apparatus) for j in jumps]


def called(kind: str, apparatus: int) -> str:
    """Name of a common error as a parameter, `scale[0]`."""
    return f"{kind}[{apparatus}]"


def common(jumps: Sequence[Jump]) -> tuple[Parameter, ...]:
    """A parameter for every common error that is stated, of every apparatus."""
    out: dict[str, Parameter] = {}
    for j, k in zip(jumps, groups(jumps)):
        sigmas = {"scale": j.shared.scale, "offset": j.shared.offset, "rate": j.shared.rate,
                  "lens": 0.0 if j.shared.lens is None else 1.0}  # fmt: skip
        for kind, sigma in sigmas.items():
            if sigma > 0:
                value, unit = KINDS[kind]
                ends = value - REACH * sigma, value + REACH * sigma
                out[called(kind, k)] = Parameter(called(kind, k), value, *ends, sigma, sigma, unit)
    return tuple(out.values())


def is_common(name: str) -> bool:
    """Whether a parameter is one of an apparatus, not of the model."""
    return name.split("[")[0] in KINDS and name.endswith("]")


def value(values: Mapping[str, float], kind: str, apparatus: int) -> float:
    """A common error's value, the declared one where it is taken as exact."""
    return values.get(called(kind, apparatus), KINDS[kind][0])
