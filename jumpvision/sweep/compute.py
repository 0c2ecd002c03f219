"""Jumps at every point of a grid of axes: in chunks, each over the cores, with progress and the time it will take."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Mapping

import numba
import numpy as np
from numpy.typing import NDArray

from ..physics.hard import RESULTS
from ..physics.points import BY_AREA, hard_points, resolve, simulated_points
from ..progress import watch
from ..schema import InputError
from .axes import option
from .machine import Machine

Array = NDArray[np.float64]
Say = Callable[[str], None]

CHUNK = 200_000  # points of an exact sweep in memory at once
SMALL = 2000  # points of an integrated one
RTOL, ATOL = 1e-6, 1e-9  # as the stage `simulate`
SLOW = 5.0  # s, from where the time is announced


def grid_results(machine: Machine, given: Mapping[str, Array], *, workers: int, say: Say) -> dict[str, NDArray]:
    """Results over the grid of `given`: shape the sizes of its 1-D entries, in order. InputError for what cannot be."""
    no_effect(machine, given)
    shape = tuple(a.size for a in given.values() if a.ndim)
    total = math.prod(shape)
    out = {name: np.empty(total) for name in RESULTS}

    def values(lo: int, hi: int) -> dict[str, Array]:
        at = iter(np.unravel_index(np.arange(lo, hi), shape) if shape else ())
        point = {n: a[next(at)] if a.ndim else np.full(hi - lo, float(a)) for n, a in given.items()}
        full = resolve(machine.values, point)
        if machine.laws:
            full |= machine.laws.points(full["phi"], machine.model.foot_radius or math.nan)
        return {n: np.ascontiguousarray(np.broadcast_to(v, (hi - lo,))) for n, v in full.items()}

    threads = numba.get_num_threads()
    try:
        values(0, 1)
        numba.set_num_threads(min(workers, threads))
        step = CHUNK if machine.exact else SMALL
        edges = [(lo, min(lo + step, total)) for lo in range(0, total, step)]
        began = time.perf_counter()
        for done, (lo, hi) in enumerate(watch(edges, "jumps, chunks")):
            v = values(lo, hi)
            found = hard_points(v) if machine.exact else simulated_points(machine.model, v, rtol=RTOL, atol=ATOL)
            for name, column in found.items():
                out[name][lo:hi] = column
            if done == 0:
                _announce(began, hi, total, say)
    except InputError:
        raise
    except ValueError as e:
        raise InputError([f"sweep {machine.model.ground}: {e}"]) from None
    finally:
        numba.set_num_threads(threads)
    return {n: v.reshape(shape) for n, v in out.items()}


def no_effect(machine: Machine, given: Mapping[str, Array]) -> None:
    """InputError for axes of the bed that the model's terms do not see: their map would be constant."""
    model = machine.model
    cone = {"added_mass", "depth_drag", "rft_cone"} & set(model.terms)
    inert = {
        "phi": not machine.laws and (model.volume_fraction is None or not cone - {"rft_cone"}),
        "foot_radius": model.foot_radius is None or not (cone or any(getattr(model.parameters, n) for n in BY_AREA)),
    }
    problems = [
        f"{option(n)}: has no effect in a model of {', '.join(model.terms) or 'hard ground'}; give [bed] "
        "volume_fraction, [robot] foot_radius and a model with depth_drag or added_mass, or --laws, or leave it out"
        for n, useless in inert.items()
        if n in given and useless
    ]
    if problems:
        raise InputError(problems)


def _announce(began: float, done: int, total: int, say: Say) -> None:
    left = (time.perf_counter() - began) / done * (total - done)
    if left > SLOW:
        say(f"{total} jumps: about {left:.0f} s")
