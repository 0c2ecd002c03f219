"""How plainly a hidden effect shows to somebody who knows the noise and lacks only the baseline's free parameters.

Everything here is the laboratory's: its integrator makes the tracks with and without the effect and, by finite
differences, what the baseline's parameters do. No simulation of the analysis is used.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.laboratory.blind import DT, EFFECTS, EVERY, Recorded, Setting
from jumpvision.laboratory.campaign import jump_of
from jumpvision.laboratory.jumper import AT_THE_CAMERA, STATIC
from jumpvision.laboratory.protocol import Protocol, RodTrack
from jumpvision.laboratory.recordings import NU, SHARE, slow

Array = NDArray[np.float64]

LANDINGS = 2  # after the motor's stop: what follows is not questioned
WANDERS = 4000  # drawn for the covariance of one
LEVELS = -3.0, 1.15  # of an effect's strength, 0 weak .. 1 strong as `draw` counts
NEAR = 0.05  # of the logarithm of the non-centrality asked for


class Unreachable(ValueError):
    """No strength of this effect shows as plainly as asked for."""


def heights(protocol: Protocol) -> list[tuple[Array, Array, float]]:
    """(t (n,) [s], rod above rest as the camera reports it (n,) [m], end of what is questioned [s]) of every jump."""
    out = []
    for jump in protocol.jumps:
        motion, _, p = jump_of(protocol, jump, np.random.default_rng(0), dt=DT, every=EVERY)
        rate = protocol.records.rod_track.rate
        t = np.arange(int(motion.t[-1] * rate + 1e-6) + 1) / rate
        y = p.get("scale", 1.0) * (motion.at("rod", t + p.get("dt", 0.0)) - motion.rest)
        landings = motion.lift_offs + motion.flights
        landings = landings[landings > jump.law.stop]
        out.append((t, y, float(landings[LANDINGS - 1]) if landings.size >= LANDINGS else math.inf))
    return out


def without(setting: Setting) -> Protocol:
    """The setting's protocol less its one hidden effect. Raises Unreachable for a static force: nothing is left."""
    (name,) = setting.hidden
    p = setting.protocol
    if name in STATIC:
        raise Unreachable(f"{name}: the static force itself")
    if name in AT_THE_CAMERA:
        null = {"camera_scale": {"scale": 1.0}, "time_offset": {"dt": 0.0}}[name]
        return replace(p, parameters={**p.parameters, **null})
    return replace(p, terms=tuple(t for t in p.terms if t != name))


def moved(protocol: Protocol) -> list[tuple[Protocol, float, float]]:
    """What the baseline may fit, each as (the protocol with it changed, by how much, its prior's sigma or inf)."""
    model, robot = protocol.model, protocol.robot_sigma
    steps = {n: (0.05 * (high - low), math.inf) for n, (low, high) in model.get("fit", {}).items()}
    steps |= {n: (s, s) for n, s in model.get("sigma", {}).items()}
    if "spring_stiffness" in robot:
        steps["dk"] = (robot["spring_stiffness"],) * 2
    out = []
    for name, (step, sigma) in steps.items():
        if name in protocol.parameters:  # the truth's own; the rest is nobody's here
            out.append((replace(protocol, parameters=_changed(protocol.parameters, name, step)), step, sigma))
    return out


def _changed(parameters: Mapping[str, Any], name: str, by: float) -> dict[str, Any]:
    return {**parameters, name: parameters[name] + by}


@cache
def wander(n: int) -> Array:
    """(n, n) covariance of a wander of unit rms over n frames, from many that were drawn."""
    a = np.random.default_rng(0)
    drawn = np.array([slow(n, a) for _ in range(WANDERS)])
    return np.asarray(drawn.T @ drawn / WANDERS)


def variance(sigma: float, family: str) -> float:
    """1 / Fisher information about the place of one sample of noise of standard deviation sigma [m^2].

    Student's t of NU degrees of freedom and scale c: (NU + 1) / (NU + 3) / c^2, c^2 = (NU - 2) / NU sigma^2. Among
    outliers that tell nothing: 1 - SHARE of the Gaussian's.
    """
    if family == "t3":
        return (NU + 3.0) / (NU + 1.0) * (NU - 2.0) / NU * sigma**2
    return sigma**2 / (1.0 - SHARE) if family == "outliers" else sigma**2


def whitener(n: int, sigma: float, how: RodTrack) -> Array:
    """(n, n) lower triangle L with L L' = covariance of a whole track; sigma [m]: jitter and rounding of this track."""
    rounding = how.step**2 / 12.0
    lags = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
    jitter = variance(math.sqrt(sigma**2 - rounding), how.family)
    covariance = jitter * np.power(how.rho, lags) if how.rho else jitter * np.eye(n)
    covariance = covariance + rounding * np.eye(n)
    if how.drift:
        covariance = covariance + how.drift**2 * wander(n)
    return np.asarray(np.linalg.cholesky(covariance))


class Oracle:
    """A campaign's noise and what its baseline can mimic; setting: any with the effect, recorded: its tracks."""

    def __init__(self, setting: Setting, recorded: list[Recorded]) -> None:
        plain = without(setting)
        self.clean = heights(plain)
        changed = [(heights(p), step, sigma) for p, step, sigma in moved(plain)]
        self.priors = [sigma for _, _, sigma in changed]
        self.lower, self.kept, columns = [], [], []
        for i, (t, y, end) in enumerate(self.clean):
            kept = int(np.sum(t <= end))  # a leading block of L whitens the leading samples
            self.kept.append(kept)
            self.lower.append(whitener(t.size, recorded[i].sigma, setting.nuisance)[:kept, :kept])
            slopes = [(there[i][1] - y)[:kept] / step for there, step, _ in changed]
            columns.append(np.reshape(slopes, (len(slopes), kept)).T)
        self.basis = self._basis(columns)

    def _white(self, i: int, x: Array) -> Array:
        """Columns x (n, k) of track i as independent numbers of unit variance, their zero level projected out."""
        level = np.linalg.solve(self.lower[i], np.ones(self.kept[i]))
        level /= np.linalg.norm(level)
        white = np.linalg.solve(self.lower[i], x)
        return np.asarray(white - np.multiply.outer(level, level @ white))

    def _basis(self, columns: list[Array]) -> Array:
        """Orthonormal directions of what the baseline's parameters do, priors' rows below."""
        white = [self._white(i, c) for i, c in enumerate(columns)]
        matrix = np.vstack([*white, np.diag([1.0 / s for s in self.priors])])
        scale = np.linalg.norm(matrix, axis=0)
        u, s, _ = np.linalg.svd(matrix / np.where(scale > 0, scale, 1.0), full_matrices=False)
        return np.asarray(u[:, s > 1e-9 * s.max(initial=1e-300)])

    def noncentrality(self, protocol: Protocol) -> float:
        """Squared length of the effect in `protocol`, in noise units, less what the baseline mimics."""
        there = heights(protocol)
        effect = [
            self._white(i, (a[1] - b[1])[:k, None])[:, 0]
            for i, (a, b, k) in enumerate(zip(there, self.clean, self.kept))
        ]
        x = np.concatenate([*effect, np.zeros(len(self.priors))])
        x = x - self.basis @ (self.basis.T @ x)
        return float(x @ x)


def level_for(
    target: float, drawn: Callable[[float], Setting], oracle: Oracle, first: float = 0.4
) -> tuple[float, float]:
    """(strength, non-centrality) at which the one effect of drawn(strength) has the non-centrality `target`.

    The non-centrality goes about as the square of the effect. Raises Unreachable where it does not get there.
    """
    (name,) = drawn(first).hidden
    ((weak, strong, _),) = EFFECTS[name].drawn.values()
    origin = 1.0 if name == "compaction" else 0.0
    growth = 2.0 * math.log((strong - origin) / (weak - origin))  # of ln(non-centrality), a level
    level = first
    for _ in range(10):
        found = oracle.noncentrality(drawn(level).protocol)
        if not found > 0.0:
            raise Unreachable(f"{name}: no effect at strength {level:.2f}")
        off = math.log(target / found)
        if abs(off) < NEAR:
            return level, found
        to = min(max(level + min(max(off / growth, -1.0), 1.0), LEVELS[0]), LEVELS[1])
        if to == level:
            raise Unreachable(f"{name}: non-centrality {found:.3g} at strength {level:.2f}")
        level = to
    raise Unreachable(f"{name}: the strength of non-centrality {target:g} was not found")
