"""Slow intrusions of a flat foot on a robot arm with known truth: one log, a campaign of beds and feet.

The bed answers with two resistances; a pause or a withdrawal leaves an overshoot behind, proportional to the depth it
happened at, that fades over a length as the foot goes on; deep in a dense bed the force saws (stick and slip of shear
planes). The load cell adds white noise, the grains add fluctuations that are correlated along the depth.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jumpvision.base.arrays import Array

from . import write

Move = tuple[str, float]  # of the arm: ("to", depth [m]) | ("pause", time [s])


@dataclass(frozen=True)
class Grains:
    """What the foot feels. k1, k2 [N/m], delta, lam, saw_length, grain_length, build_up [m], saw, fluctuation [N].

    static: another force against depth [m -> N] in place of the two resistances.
    """

    k1: float = 2000.0
    k2: float = 1200.0
    delta: float = 0.015
    s: float = 300.0  # N/m: overshoot after a withdrawal / depth
    s_p: float = 200.0  # N/m: after a pause of one second
    per_decade: float = 0.0  # N/m: more overshoot a factor ten of pause
    carry: float = 0.0  # share of what is left of the last overshoot that the next one gains
    lam: float = 0.004
    saw: float = 0.0
    saw_length: float = 0.003
    fluctuation: float = 0.0
    grain_length: float = 0.001
    build_up: float = 2e-4
    static: Callable[[float], float] | None = None


@dataclass(frozen=True)
class Arm:
    """The arm and its load cell: speed [m/s], rate [1/s], weight [N], surface [m] (of the grains), noise [N]."""

    speed: float = 0.01
    rate: float = 500.0
    weight: float = 0.8
    surface: float = 0.0
    noise: float = 0.05
    step: float = 1e-5  # m, resolution of the depth


def path(moves: Sequence[Move], arm: Arm, start: float) -> tuple[Array, Array]:
    """time [s], depth [m] of the protocol, from depth `start`."""
    depth, z = [start], start
    for kind, value in moves:
        if kind == "pause":
            depth += [z] * round(value * arm.rate)
        else:
            n = max(1, round(abs(value - z) / arm.speed * arm.rate))
            depth += list(z + (value - z) * np.arange(1, n + 1) / n)
            z = value
    return np.arange(len(depth)) / arm.rate, np.array(depth)


def log(moves: Sequence[Move], grains: Grains, arm: Arm, *, start: float, rng: np.random.Generator) -> dict[str, Array]:
    """Columns time_s, depth_m, force_N (positive against the intrusion) of a protocol."""
    t, depth = path(moves, arm, start)
    force = np.zeros(t.size)
    deepest, peak, at, resting, lifted = arm.surface, 0.0, 0.0, 0.0, False
    rough = _fluctuation(depth, grains, rng)
    for i in range(1, t.size):
        z, down = depth[i], depth[i] > depth[i - 1]
        if depth[i] == depth[i - 1]:
            resting += 1.0 / arm.rate
        elif not down:
            lifted = lifted or deepest > arm.surface
        if z > deepest and down:  # into fresh grains
            if deepest > arm.surface and (lifted or resting > 2.0 / arm.rate):
                left = peak * np.exp(-(deepest - at) / grains.lam) if peak else 0.0
                rate = grains.s if lifted else grains.s_p + grains.per_decade * np.log10(resting)
                peak, at = rate * (deepest - arm.surface) + grains.carry * left, deepest
            lifted, resting, deepest = False, 0.0, z
            force[i] = virgin(z - arm.surface, grains) + rough[i] * min(1.0, (z - arm.surface) / grains.grain_length)
            force[i] += _saw(z - arm.surface, grains)
            if peak:
                force[i] += peak * np.exp(-(z - at) / grains.lam)
                force[i] *= min(1.0, (z - at) / grains.build_up)
        elif z == deepest and deepest > arm.surface and not lifted:
            force[i] = 0.97 * force[i - 1] if resting < 3.0 / arm.rate else force[i - 1]  # relaxes a little, then holds
    force += arm.weight + rng.normal(0.0, arm.noise, t.size)
    return {"time_s": t, "depth_m": np.rint(depth / arm.step) * arm.step, "force_N": force}


def virgin(z: Array | float, g: Grains) -> Array:
    """Static force of a first slow intrusion to depth z [m] below the surface [N]."""
    z = np.asarray(z, dtype=float)
    if g.static is not None:
        return np.vectorize(g.static, otypes=[float])(z)
    return np.where(z < 0, 0.0, np.where(z < g.delta, g.k1 * z, g.k1 * g.delta + g.k2 * (z - g.delta)))


def _saw(z: float, g: Grains) -> float:
    """Zero-mean saw tooth below delta, amplitude `saw` [N]."""
    return g.saw * (2.0 * ((z / g.saw_length) % 1.0) - 1.0) if z > g.delta and g.saw else 0.0


def _fluctuation(depth: Array, g: Grains, rng: np.random.Generator) -> Array:
    """Gaussian noise [N] with correlation exp(-|dz|/grain_length) along the path."""
    out, step = np.zeros(depth.size), np.abs(np.diff(depth, prepend=depth[0]))
    white = rng.normal(size=depth.size)
    keep = np.exp(-step / g.grain_length)
    out[0] = white[0]
    for i in range(1, depth.size):
        out[i] = keep[i] * out[i - 1] + np.sqrt(1.0 - keep[i] ** 2) * white[i]
    return g.fluctuation * out


RADII = (0.0127, 0.0191, 0.0254, 0.0318, 0.0381)  # m, at the loose packing
PACKINGS = (0.57, 0.58, 0.59, 0.60, 0.61, 0.62, 0.63)
CRITICAL = 0.605
STRESS = 0.46e6  # N/m^3: k1 / foot area at phi 0.57
START = -0.006  # m: the log begins in the air


def grains(radius: float, phi: float) -> Grains:
    """The bed's answer to a foot: k1 bends up at phi_c, the saw begins there; delta is where the cone is complete."""
    area, over = math.pi * radius**2, max(0.0, phi - CRITICAL)
    k1 = STRESS * area * (1.0 + 12.0 * (phi - 0.57) + 60.0 * over)
    return Grains(
        k1=k1,
        k2=0.55 * k1,
        delta=0.4 * radius,
        s=0.15 * k1,
        s_p=0.1 * k1,
        fluctuation=0.002 * k1 * 0.03,
        saw=0.8e-3 * k1 * over / 0.02,
    )


PROTOCOLS: dict[str, list[Move]] = {
    "intrusion": [("to", 0.06)],
    "reintrusion": [m for z in (0.012, 0.024, 0.036, 0.048) for m in (("to", z), ("to", -0.004))] + [("to", 0.06)],
    "stop-go": [m for i in range(5) for m in (("to", 0.01 * (i + 1)), ("pause", (0.3, 3.0)[i % 2]))] + [("to", 0.06)],
}


def intrusion_campaign(folder: Path, *, seed: int = 20140630) -> None:
    """Write the campaign: an experiment a foot, a packing and a protocol, each with truth.json."""
    rng = np.random.default_rng(seed)
    cases = [("intrusion", r, 0.57) for r in RADII] + [("intrusion", 0.0381, phi) for phi in PACKINGS[1:]]
    cases += [(kind, 0.0318, 0.57) for kind in ("reintrusion", "stop-go")]
    folder.mkdir(parents=True)
    write.toml(folder / "campaign.toml", {"ground": "granular"}, comment="Slow intrusions of the virtual laboratory")
    for kind, radius, phi in cases:
        one(folder / f"{kind}-R{radius * 1e3:.1f}mm-phi{phi:.2f}", kind, radius, phi, rng)


def one(folder: Path, kind: str, radius: float, phi: float, rng: np.random.Generator) -> None:
    """One experiment folder."""
    folder.mkdir()
    bed, arm = grains(radius, phi), Arm(surface=float(np.round(rng.normal(0.0, 5e-4), 5)))
    write.table(folder / "intrusion.csv", log(PROTOCOLS[kind], bed, arm, start=START, rng=rng))
    tables: write.Table = {
        "schema": 1,
        "robot": {"foot_radius": radius},
        "bed": {"volume_fraction": phi},
        "intrusion_log": {"file": "intrusion.csv"},
    }
    write.toml(folder / "experiment.toml", tables)
    fits = {name: getattr(bed, name) for name in ("k1", "k2", "delta")}
    fits |= {"contact_depth_m": arm.surface, "weight_N": arm.weight}
    fits |= {name: getattr(bed, name) for name in ("lam", "s", "s_p")}
    write.truth(folder / "truth.json", {"fits": fits, "saw_N": bed.saw})
