"""Generic forces on the jumper, as a vocabulary: what `unexplained` describes a residual force by.

On the foot while it intrudes, against its motion: z^i |v|^j; a mass that moves with it, -z^i a; on the carriage,
against its motion: |x_r|^i |v_m|^j. Each has one number, its strength [N, m, s]; one at a time acts.
"""

from __future__ import annotations

import copy
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.diagnosis.system import Candidate, Observation, Parameter
from jumpvision.physics.model import Residual
from jumpvision.physics.sand.granular import CARRIAGE, CONE, FOOT, INTRUDE

from .jumper import Jumper

DEPTH, SPEED = 0.02, 0.5  # m, m/s: of an intrusion or a stroke, where a force of `share` of the weight matters


SHARE = 0.1


def name(on: int, i: int, j: int) -> str:
    """Such as `v*z^2`, `a*z`, `v_m*x_r`."""
    q, rate = ("x_r", "v_m") if on == CARRIAGE else ("z", "a" if on == CONE else "v")
    powers = [f"{n}^{p}" if p > 1 else n for n, p in ((rate, j), (q, i)) if p > 0]
    return "*".join(powers) if j else "*".join([f"sign({rate})", *powers])


def generic(ground: str) -> dict[str, Residual]:
    """Every shape that can act on this ground, by name."""
    foot = [(FOOT, i, j) for j in (0, 1, 2) for i in (0, 1, 2)] + [(CONE, i, 1) for i in (0, 1, 2)]
    rail = [(CARRIAGE, i, j) for j in (0, 1, 2) for i in (0, 1, 2)]
    chosen = [*(foot if ground == "granular" else []), *rail]
    return {name(on, i, j): Residual(on, float(i), 0.0 if on == CONE else float(j)) for on, i, j in chosen}


class Shaped:
    """A system of jumps that has these shapes beside its vocabulary."""

    def __init__(self, jumper: Jumper) -> None:
        self.jumper = jumper
        self.shapes = generic(jumper.model.ground)
        weight = jumper.model.M * jumper.model.g
        own = {
            n: Candidate((Parameter("r", 0.0, -1e3 * size, 1e3 * size, size, unit=unit(s)),))
            for n, s in self.shapes.items()
            for size in [SHARE * weight / (DEPTH**s.i * (SPEED**s.j if s.on != CONE else 30.0))]
        }
        self.candidates: Mapping[str, Candidate] = {**jumper.candidates, **own}

    @property
    def observations(self) -> Sequence[Observation]:
        return self.jumper.observations

    @property
    def baseline(self) -> tuple[Parameter, ...]:
        return self.jumper.baseline

    def predict(self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: Sequence[int]) -> list[Array]:
        return self._with(mechanisms, values).predict(*self._without(mechanisms, values), which)

    def scatter(
        self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: Sequence[int]
    ) -> Mapping[str, list[Array]]:
        return self._with(mechanisms, values).scatter(*self._without(mechanisms, values), which)

    def _with(self, mechanisms: tuple[str, ...], values: Mapping[str, float]) -> Jumper:
        for m in mechanisms:
            if m in self.shapes:
                out = copy.copy(self.jumper)
                out.model = replace(out.model, residual=replace(self.shapes[m], strength=values["r"]))
                return out
        return self.jumper

    def _without(
        self, mechanisms: tuple[str, ...], values: Mapping[str, float]
    ) -> tuple[tuple[str, ...], dict[str, float]]:
        return tuple(m for m in mechanisms if m not in self.shapes), {n: v for n, v in values.items() if n != "r"}

    def reach(self, shape: str, mechanisms: tuple[str, ...], values: Mapping[str, float]) -> str:
        """Where in depth and speed the shape acted: the range that holds nine tenths of the samples, in words."""
        jumper, model = self._with(mechanisms, values), None
        model = jumper.build(*self._without(mechanisms, values))
        depth, speed = [], []
        rail = self.shapes[shape].on == CARRIAGE
        for jump in jumper.jumps:
            motion = jumper._motion(jump, model, jump.t)
            acts = np.ones(motion.t.size, bool) if rail else motion.mode == INTRUDE
            rate = np.gradient(motion.motor, motion.t) if rail else motion.foot_velocity
            depth.append(np.abs(motion.rod if rail else motion.foot)[acts])
            speed.append(np.abs(rate)[acts])
        q, v = (np.quantile(np.concatenate(x), (0.05, 0.95)) for x in (depth, speed))
        what = ("rod", "|x_r|", "|v_m|") if rail else ("foot", "z", "|v|")
        return f"{what[0]}: {what[1]} {1e3 * q[0]:.0f}-{1e3 * q[1]:.0f} mm, {what[2]} {v[0]:.2f}-{v[1]:.2f} m/s"


def unit(shape: Residual) -> str:
    """Of the strength of a force N or a mass kg that is 1 at 1 m and 1 m/s."""
    parts = ["kg" if shape.on == CONE else "N"]
    for symbol, power in (("m", -shape.i - shape.j), ("s", shape.j)):
        if power:
            parts.append(symbol if power == 1 else f"{symbol}^{power:g}")
    return " ".join(parts)
