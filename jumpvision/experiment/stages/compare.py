"""Compare every pair of values that one experiment gives of one quantity: measured, declared or simulated."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from typing import NamedTuple

from jumpvision.base.schema import StageWarning


class Value(NamedTuple):
    """A value of a quantity with its standard uncertainty, by `source`, a section or a result; None: not known.

    apart: by how much it may differ from the others by right, in its unit (a model, a spring that sags). recording: the
    section to doubt.
    """

    quantity: str
    source: str
    value: float | None
    sigma: float | None = 0.0
    apart: float = 0.0
    recording: str = ""


class Quantity(NamedTuple):
    """unit; sigmas, share and factor by which two values must differ, all of them, to contradict; remedy."""

    unit: str
    sigmas: float
    share: float
    factor: float
    remedy: str


QUANTITIES = {  # shares and factors: what no error of a model, a foot or a landing makes
    "jump height": Quantity("m", 5.0, 0.1, 1.0, "is the top of the jump in the picture; scale, or contact log?"),
    "height by the model": Quantity("m", 5.0, 0.0, 5.0, "check units, scale and masses"),
    "volume fraction": Quantity("", 3.0, 0.0, 1.0, "leave it out to use what is measured"),
    "spring stiffness": Quantity("N/m", 3.0, 0.0, 1.0, "which of them is it?"),
    "height of the bed": Quantity("m", 0.0, 0.2, 1.0, "scale, floor_row, or [bed] solid_volume, length and width?"),
    "motor amplitude": Quantity("m", 0.0, 0.0, 1.3, "is it the log of this experiment?"),  # no loop makes so much
    "motor frequency": Quantity("Hz", 0.0, 0.0, 1.1, "is it the log of this experiment?"),
    "rest": Quantity("m", 5.0, 0.0, 1.0, "was the camera touched, or did the robot land elsewhere?"),
}


def contradictions(values: Iterable[Value]) -> Iterator[StageWarning]:
    """Tell of every two values of one quantity that differ by more than their uncertainties and what is allowed."""
    known = [v for v in values if v.value is not None and math.isfinite(v.value)]
    for a, b in itertools.combinations(known, 2):
        if a.quantity != b.quantity:
            continue
        q, (x, y) = QUANTITIES[a.quantity], (a.value or 0.0, b.value or 0.0)
        allowed = q.sigmas * math.hypot(a.sigma or 0.0, b.sigma or 0.0) + a.apart + b.apart
        ratio = x / y if y else math.inf
        if abs(x - y) <= max(allowed, q.share * max(abs(x), abs(y))) or 1.0 / q.factor < ratio < q.factor:
            continue
        prefix = is_prefix(ratio)
        remedy = "is one of them in another unit, as mm?" if prefix else q.remedy
        text = f"{a.quantity}: {_said(a, q.unit)}, {_said(b, q.unit)} ({ratio:.3g} times): {remedy}"
        numbers = {f"{k}_{q.unit.replace('/', '_')}".rstrip("_"): v for k, v in (("first", x), ("second", y))}
        yield StageWarning("unit" if prefix else "differs", text, a.recording or b.recording, numbers)


def is_prefix(ratio: float) -> bool:
    """Return True for a ratio that a wrong prefix of a unit makes."""
    return 300.0 < abs(ratio) < 3000.0 or 300.0 < 1.0 / max(abs(ratio), 1e-12) < 3000.0


def _said(v: Value, unit: str) -> str:
    sigma = f" ± {v.sigma:.2g}" if v.sigma else ""
    return f"{v.source} gives {v.value:.4g}{sigma} {unit}".rstrip()
