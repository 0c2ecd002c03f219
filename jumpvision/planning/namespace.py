"""The array namespace that the force laws ask for, over CasADi's symbols."""

from __future__ import annotations

from typing import Any

import casadi

__all__ = ["exp", "maximum", "minimum", "tan", "where"]

exp, tan, maximum, minimum = casadi.exp, casadi.tan, casadi.fmax, casadi.fmin


def where(condition: Any, a: Any, b: Any) -> Any:
    """a where the condition holds, else b; both are always computed."""
    return casadi.if_else(condition, a, b)
