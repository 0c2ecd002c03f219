"""A measured jump and its questioned part, what its apparatus has wrong throughout, what films measure of its model."""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.engine.noise.noise import rounding_step, step_apart
from jumpvision.engine.system import Circumstances, Indexed, Observation, Parameter
from jumpvision.jumper.physics.forcing import Forcing, Loop
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import Motion

LANDINGS = 2  # after the motor stopped; later bounces tell of chaos more than of the model
PARTS = ("pre_load", "intrusion", "push_off", "flight", "landing", "re_intrusion")


@dataclass(frozen=True)
class Shared:
    """Errors that all jumps recorded with one apparatus share, as standard uncertainties about what is declared.

    scale: of reported over true height; offset [s], rate: of the clock, a frame stamped t shows t + offset + rate t;
    lens: (n,) change of the reported height [m] by one sigma of the lens.
    """

    apparatus: str = ""
    scale: float = 0.0
    offset: float = 0.0
    rate: float = 0.0
    lens: Array | None = None


@dataclass(frozen=True)
class Jump:
    """One measured jump: rod height above rest y (n,) [m] at t (n,) [s], what drove it, the model questioned.

    stop: when the motor stops [s]. labels: kind, frequency, phi, ... to report by. law: the command is what drives.
    sigma: (n,) noise that the track itself states [m], if any. shared: what it has in common with others of its
    apparatus. circumstances: when, by whom and with what it was recorded. measured: its jump height [m] with sigma, as
    its track was measured (`jumpvision.estimate.height.jump_height`); None where it was not.
    """

    name: str
    model: Model
    forcing: Forcing | Loop
    stop: float
    t: Array
    y: Array
    group: str
    condition: str
    law: bool
    labels: Mapping[str, object] = field(default_factory=dict)
    sigma: Array | None = None
    shared: Shared = field(default_factory=Shared)
    circumstances: Circumstances = field(default_factory=Circumstances)
    measured: tuple[float, float] | None = None


def coarseness(jumps: Sequence[Jump]) -> float:
    """Rounding step [m] of the tracks that their noise does not dither; 0 where there is none."""
    step = max(rounding_step(j.y) for j in jumps)
    rest = [r for j in jumps if (r := j.y[j.t < j.forcing.start]).size >= 6]
    # readings at rest that scatter by more than a step leave nothing of the rounding
    return 0.0 if rest and math.sqrt(np.mean([r.var() for r in rest])) > step else step


def observation(jump: Jump, motion: Motion, coarse: float) -> Observation:
    """The part of the track that is questioned: to the LANDINGS-th landing after the motor's stop.

    coarse: rounding step [m] by which the motion must have moved between two samples.
    """
    landed = motion.flights[:, 1]
    landed = landed[landed > jump.stop]
    end = landed[LANDINGS - 1] if landed.size >= LANDINGS else np.inf
    keep = np.flatnonzero(jump.t <= end)
    if coarse > 0:
        keep = keep[step_apart(motion.rod[-jump.t.size :][keep], coarse)]
    parts = parts_of(motion, jump)[-jump.t.size :][keep]
    return Observation(
        jump.name,
        jump.t[keep],
        jump.y[keep],
        jump.group,
        jump.condition,
        labels=dict(jump.labels),
        parts=parts,
        circumstances=jump.circumstances,
        measured=jump.measured,
    )


def parts_of(motion: Motion, jump: Jump) -> NDArray[np.str_]:
    """Part of the jump that each output time belongs to, as the baseline has it."""
    t = motion.t
    out = np.full(t.size, "pre_load", dtype="U12")
    air, intruding = motion.mode == 0, motion.mode == 2
    lifts, lands = motion.flights[:, 0], motion.flights[:, 1]
    flown = np.searchsorted(lands[np.isfinite(lands)], t, side="right")  # landings so far
    started = np.zeros(t.size, bool)
    digs = motion.events["time"][motion.events["kind"] == "intrude"]
    started = t >= (digs[0] if digs.size else np.inf)
    out[started] = "push_off"
    out[started & intruding] = "intrusion"
    last = np.zeros(t.size)
    if lands.size and np.isfinite(lands).any():
        ends = lands[np.isfinite(lands)]
        last = np.where(flown > 0, ends[np.maximum(flown - 1, 0)], -np.inf)
        after = flown > 0
        out[after] = "push_off"
        out[after & (t - last < 0.03)] = "landing"
        out[after & intruding] = "re_intrusion"
    out[air] = "flight"
    if lifts.size == 0:
        out[t < jump.forcing.start] = "pre_load"
    return out


KINDS = {"scale": (1.0, "1"), "offset": (0.0, "s"), "rate": (0.0, "1"), "lens": (0.0, "1")}  # declared value, unit


def groups(jumps: Sequence[Jump]) -> list[int]:
    """Number of each jump's apparatus, in the order of appearance."""
    names = list(dict.fromkeys(j.shared.apparatus for j in jumps))
    return [names.index(j.shared.apparatus) for j in jumps]


def common(jumps: Sequence[Jump]) -> tuple[Parameter, ...]:
    """A parameter for every common error that is stated, of every apparatus."""
    out: dict[str, Parameter] = {}
    for j, k in zip(jumps, groups(jumps)):
        sigmas = {
            "scale": j.shared.scale,
            "offset": j.shared.offset,
            "rate": j.shared.rate,
            "lens": 0.0 if j.shared.lens is None else 1.0,
        }
        for kind, sigma in sigmas.items():
            if sigma > 0:
                value, unit = KINDS[kind]
                ends = value - 8.0 * sigma, value + 8.0 * sigma  # as far as a fit may go
                name = Indexed(kind, k)
                out[name] = Parameter(name, value, *ends, sigma, sigma, unit)
    return tuple(out.values())


def is_common(name: str) -> bool:
    """Whether a parameter is one of an apparatus, not of the model."""
    return isinstance(name, Indexed) and name.of in KINDS


def common_error(values: Mapping[str, float], kind: str, apparatus: int) -> float:
    """A common error's value, the declared one where it is taken as exact."""
    return values.get(_name(kind, apparatus), KINDS[kind][0])


_name = functools.cache(Indexed)  # looked up for every prediction
