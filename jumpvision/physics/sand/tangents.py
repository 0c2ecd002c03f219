"""The namespace `scalar` where an angle is carried as its tangent, found once a model instead of thrice a step."""

from __future__ import annotations

from .kernel import kernel
from .scalar import exp, maximum, minimum, where

__all__ = ["exp", "maximum", "minimum", "tan", "where"]


@kernel
def tan(tangent: float) -> float:
    return tangent
