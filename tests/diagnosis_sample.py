"""A whole diagnosis for tests that read only parts of one."""

from __future__ import annotations

import math
from typing import Any

from jumpvision.base.arrays import Z90
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.document.values import Baseline, Cause, Confirmation, Model, Noise, Parameter


def parameter(value: float, sigma: float, unit: str = "1") -> Parameter:
    """A fitted parameter with its 90 % interval."""
    return Parameter(value, value - Z90 * sigma, value + Z90 * sigma, unit)


def confirmation(quantity: str, film: tuple[float, float], jumps: tuple[float, float], **more: Any) -> Confirmation:
    """A quantity as (value, sigma) by a film and by the jumps."""
    z = (film[0] - jumps[0]) / math.hypot(film[1], jumps[1])
    given = {"unit": "1", "source": "film stutter-7.0Hz-film", "verdict": "agree", **more}
    return Confirmation(quantity, by_jumps=jumps[0], by_jumps_sigma=jumps[1], by_film=film[0], by_film_sigma=film[1],
                        z=z, **given)  # fmt: skip


def causes(named: tuple[str, ...], parameters: dict[str, Parameter]) -> tuple[Cause, ...]:
    """One for each mechanism of a model, as the diagnosis lists them."""
    return tuple(Cause(m, tuple(n for n in named if n != m), 0.9, (0.8, 0.95), 100.0, parameters) for m in named)


def diagnosis(**parts: Any) -> Diagnosis:
    """A discrepant model of which nothing more is said than these parts."""
    nothing: dict[str, Any] = {
        "verdict": "discrepant",
        "p_value": 0.0,
        "baseline": Baseline(("inertial_drag",), {"alpha": 80.0}, 0.01, 0.009, 900.0),
        "status": "undetermined",
        "left_over": None,
        "extended_model": Model(("inertial_drag",), {"alpha": 80.0}),
        "noise": Noise(5e-5, 0.0, None, 0.0, 950, {}, {}, {}, (), ()),
        "extrapolation": {},
        "sentence": "Said.",
    }
    rows = ("where", "heights", "causes", "named", "indistinguishable", "common", "energy", "confirmation",
            "detectable", "selection")  # fmt: skip
    nothing |= dict.fromkeys(rows, ())
    nothing |= dict.fromkeys(("closest", "gain", "next_experiment", "confirmed", "priors"))
    return Diagnosis(**nothing | parts)
