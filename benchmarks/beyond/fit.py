"""What is seen of a world, and a law fitted to it through the whole simulation by Gauss-Newton, for peers and bounds.

The peers' laws get the known ground and robot fitted again beside them, which no such peer does by itself; with the
true law in it the same fit says how well the campaign can tell its exponents, and how far the model without it is off.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from . import motion as mo
from .motion import Array, Law
from .worlds import ROBOTS, START, Shot, World, distortion, jumper_of, times, tracks

LawOf = Callable[[Mapping[str, float]], Law]
STEP = 2e-4  # s: rod within 1e-8 m of `motion.STEP`
MOVE = 1e-3  # of a parameter's own size: finite differences


@dataclass(frozen=True)
class Seen:
    """A campaign as it is handed to an analyst: nothing in it is known to the truth alone.

    values: declared, robot and ground; free: ranges that may be fitted; sigma: of those that have a prior.
    """

    ground: str
    values: dict[str, float]
    free: dict[str, tuple[float, float]]
    sigma: dict[str, float]
    shots: tuple[Shot, ...]
    tracks: list[Array]
    noise: float

    @property
    def names(self) -> tuple[str, ...]:
        """Declared parameters that a fit may move."""
        return (*self.free, *self.sigma)


def seen(w: World, *, clean: bool = False) -> Seen:
    """What an analyst is given of a world; clean: without noise."""
    sigma = {k.removeprefix("robot."): v for k, v in w.sigma.items()}
    values = {**ROBOTS[w.ground], **w.declared}
    return Seen(w.ground, values, dict(w.free), sigma, w.shots, tracks(w, clean=clean), w.noise)


def predicted(s: Seen, values: Mapping[str, float], law: Law, shots: Sequence[Shot] | None = None) -> list[Array]:
    """Tracks (n,) [m] of the jumps, less their mean before the start; `clock` and `lens...` in values distort them."""
    values = {**s.values, **values}
    jumper, out = jumper_of(s.ground, values), []
    rate = 1.0 + values.get("clock", 0.0)
    lens, which = values.get("lens", 0.0), int(values.get("lens_form", 1))
    for shot in s.shots if shots is None else shots:
        m = mo.follow(jumper, shot.command, law, times() * rate, step=STEP)
        h = m.rod - m.rod[0]
        y = h + lens * distortion(which, h, values.get("lens_height", 0.0))
        out.append(y - y[times() < START].mean())
    return out


@dataclass(frozen=True)
class Fit:
    """values: fitted, by name; sigma: their standard uncertainties; chi2 with the priors; n: readings."""

    values: dict[str, float]
    sigma: dict[str, float]
    chi2: float
    n: int


def fit(
    s: Seen, law: LawOf, own: Mapping[str, float], *, start: Mapping[str, float] | None = None, rounds: int = 8
) -> Fit:
    """The law with its parameters `own` (name -> start) and the declared parameters, by damped Gauss-Newton.

    law(values): the hidden law; start: of declared parameters, by default their declared values.
    """
    names = [*s.names, *own]
    x = np.array([{**s.values, **(start or {}), **own}[n] for n in names], float)
    size = np.abs(x) + np.array([{"clock": 1e-3, "lens": 0.1, "lens_height": 0.01}.get(n, 0.0) for n in names])
    target = np.array([s.values.get(n, 0.0) for n in names])
    weight = np.array([1.0 / s.sigma[n] if n in s.sigma else 0.0 for n in names])
    data = np.concatenate(s.tracks)
    A = np.eye(x.size)

    def residual(x: Array) -> Array:
        values = dict(zip(names, x.tolist()))
        try:
            with np.errstate(all="ignore"):  # a law that explodes is no fit
                model = np.concatenate(predicted(s, values, law(values)))
        except (RuntimeError, ValueError):
            model = np.full(data.size, np.inf)
        return np.concatenate([(data - model) / s.noise, (target - x) * weight])

    r = residual(x)
    damping, J = 1e-3, np.zeros((r.size, x.size))
    for _ in range(rounds):
        for i in range(x.size):
            h = MOVE * size[i]
            J[:, i] = (residual(x + h * np.eye(x.size)[i]) - r) / h
        A, gradient = J.T @ J, J.T @ r
        before = float(r @ r)
        for _ in range(6):
            step = np.linalg.solve(A + damping * np.diag(np.diag(A) + 1e-12), -gradient)
            new = x + step
            for i, n in enumerate(names):
                if n in s.free:
                    new[i] = np.clip(new[i], *s.free[n])
            trial = residual(new)
            if np.isfinite(trial).all() and trial @ trial < before:
                x, r, damping = new, trial, max(damping / 10.0, 1e-9)
                break
            damping *= 10.0
        if before - float(r @ r) < 1e-2 + 1e-6 * before:
            break
    sigma = np.sqrt(np.diag(np.linalg.pinv(A)))
    return Fit(dict(zip(names, x.tolist())), dict(zip(names, sigma.tolist())), float(r @ r), data.size)


def true_form(w: World) -> tuple[LawOf, dict[str, float]]:
    """The true law as a function of its parameters, and their true values."""
    form = w.form
    if form.acts_on == "film_time":
        return lambda v: Law(), {"clock": w.p[0]}
    if form.acts_on == "film_height":
        own = {"lens": w.p[0]} | ({"lens_height": w.p[1]} if len(w.p) > 1 else {})
        return lambda v: Law(), own
    own = dict(zip(("a", *form.shape), w.p))

    def law(v: Mapping[str, float]) -> Law:
        return w.law._replace(p=tuple([*(v[n] for n in own), 0.0, 0.0][:3]))  # type: ignore[arg-type]

    return law, own


def bounds(w: World, *, every: int = 3) -> dict[str, Any]:
    """How well the campaign can be told: chi2 that the declared model cannot remove (noncentrality), and the standard
    uncertainties of the true law's parameters, were its form known. every: from each so-many-th jump, scaled up."""
    s = seen(w, clean=True)
    s = replace(s, shots=s.shots[::every], tracks=s.tracks[::every], noise=s.noise / np.sqrt(every))
    if w.form.acts_on == "film_height":
        s = replace(s, values={**s.values, "lens_form": float(w.form.which)})
    without = fit(s, lambda v: Law(), {})
    law, own = true_form(w)
    told = fit(s, law, own, start={n: w.true[n] for n in s.names}, rounds=1)
    return {"noncentrality": without.chi2, "left": told.chi2, "sigma": {n: told.sigma[n] for n in own}}
