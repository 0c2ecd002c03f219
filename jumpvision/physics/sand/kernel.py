"""How the jumper's equations are compiled: plain IEEE arithmetic on arrays that the caller owns.

Division by zero gives inf and is not checked, and no reference is counted: a small function costs 5-10 ns instead of
50. A kernel must therefore not make arrays.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import njit

# `_nrt` is numba's name for its reference counting, an option that its documentation does not list
OPTIONS: dict[str, Any] = {"error_model": "numpy", "_nrt": False, "fastmath": {"contract", "arcp"}}


def kernel(f: Callable[..., Any]) -> Any:
    """The function compiled, to be called from compiled code."""
    return njit(**OPTIONS)(f)
