"""Rod heights of many jumps, simulated again and again while only the model changes: what a fit asks for.

What does not depend on the model (pieces of the forcing, times) is laid out once; the rest is one compiled call.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.physics import compiled
from jumpvision.physics.forcing import Forcing
from jumpvision.physics.jump import limit_loop, pack, pieces
from jumpvision.physics.loop import Loop
from jumpvision.physics.model import Model

Array = NDArray[np.float64]


class Tracks:
    """Jumps with these forcings, motors that stop at these times [s] and outputs at these times (n_i,) [s]."""

    def __init__(self, forcings: Sequence[Forcing | Loop], stops: Sequence[float], times: Sequence[Array]) -> None:
        self.forcings = list(forcings)
        laid = [pieces(f, s, math.inf) for f, s in zip(forcings, stops)]
        wide = max(rows.shape[1] for _, rows, _ in laid)  # a loop's rows have its gain behind
        self.rows = np.concatenate([np.pad(rows, ((0, 0), (0, wide - rows.shape[1]))) for _, rows, _ in laid])
        self.edges = np.concatenate([edges for _, _, edges in laid])
        self.t = np.concatenate(times).astype(float)
        before = [float(f(f.start - 1.0)[0][0]) for f in forcings]  # where the motor stands before the forcing
        self.about = np.zeros(len(laid), compiled.TRACK)
        self.about["kind"], self.about["stop"], self.about["before"] = [k for k, _, _ in laid], stops, before
        for name, sizes in (("row", [r.shape[0] for _, r, _ in laid]), ("time", [t.size for t in times])):
            self.about[name + "_end"] = ends = np.cumsum(sizes)
            self.about[name] = ends - sizes
        self.places = [slice(a["time"], a["time_end"]) for a in self.about]

    def heights(
        self, which: Sequence[int], models: Sequence[Model], t: Array, out: Array, *, rtol: float, atol: float
    ) -> None:
        """Writes x_r above rest [m] at the times t [s] of the jumps `which`, models[k] that of which[k].

        t, out: as long as all times together, `places` says whose is what; NaN where a motion cannot be followed. rtol,
        atol as in `jump.simulate`. Lets other threads run.
        """
        packed: dict[int, NDArray[Any]] = {}
        constants = np.concatenate([packed.setdefault(id(m), pack(m)) for m in models])
        for k, i in enumerate(which):
            forcing = self.forcings[i]
            if isinstance(forcing, Loop):
                limit_loop(constants[k : k + 1], forcing, models[k])
        compiled.tracks_solver()(
            constants, np.asarray(which, np.int64), self.about, self.rows, self.edges, t, rtol, atol, out
        )
