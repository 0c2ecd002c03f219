"""Where arrays are computed: NumPy, or a GPU through CuPy or PyTorch, under the names of the array API standard."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

BACKENDS = ("numpy", "cupy", "torch")


class Backend(NamedTuple):
    """xp: array namespace (data-apis.org/array-api); put: NumPy array to it; get: its array to NumPy."""

    xp: Any
    put: Callable[[NDArray[Any]], Any]
    get: Callable[[Any], NDArray[Any]]


NUMPY = Backend(np, np.asarray, np.asarray)


@cache
def backend(name: str) -> Backend:
    """One of BACKENDS; PyTorch computes on its GPU, or on the CPU where there is none.

    Raises ValueError where the name is unknown or the package is not installed.
    """
    if name not in BACKENDS:
        raise ValueError(f"backend = {name!r}: must be one of {', '.join(BACKENDS)}")
    if name == "numpy":
        return NUMPY
    try:
        xp, library = importlib.import_module(f"array_api_compat.{name}"), importlib.import_module(name)
    except ImportError as e:
        raise ValueError(f'backend = "{name}": {e}; install {name} and array-api-compat, or take "numpy"') from None
    if name == "cupy":
        return Backend(xp, library.asarray, library.asnumpy)
    device = "cuda" if library.cuda.is_available() else "cpu"
    return Backend(xp, lambda a: library.as_tensor(a, device=device), lambda t: np.asarray(t.cpu()))
