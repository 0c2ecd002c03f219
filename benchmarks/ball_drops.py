"""Eleven real balls, two drops each, as one model: what they share is a drag coefficient, the air and the camera.

`python -m benchmarks.ball_drops` prints the tables (JUMPVISION_REAL_DATA must hold the recordings). A ball's drag is
rho c_D (A/m) v|v| / 2 with its own area and mass, linear drag b (r/m) v; balls with holes may have a c_D of their own.
The scale of the heights has a prior of 2 %, and differs from drop to drop by what two drops of one ball show.
"""

from __future__ import annotations

import math
import os
import time
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from jumpvision.engine.fitting import Fit, Problem
from jumpvision.engine.noise.noise import Noise
from jumpvision.engine.order import Findings, Order
from jumpvision.engine.study.particle import LAW, SENSOR, Body
from jumpvision.engine.system import Candidate, Observation, Parameter

from .diagnosis_real import GRAVITY, PEER, Array, best_of, drops, repeats

AIR = 1.2  # kg/m^3
OUNCE = 0.0283495  # kg
ROWS = {  # as the workbook calls them -> as balls.txt does
    "Baseball": "baseball", "Blue Basketball": "bluebasketball", "Green Basketball": "greenbasketball",
    "Volleyball": "volleyball", "Bowling Ball": "bowlingball", "Golf Ball": "golfball", "Tennis Ball": "tennisball",
    "Whiffle Ball 1": "wiffleball1", "Whiffle Ball 2": "wiffleball2", "Yellow Whiffle Ball": "yellowWiffle",
    "Orange Whiffle Ball": "orangeWiffle",
}  # fmt: skip
VOLLEYBALL = (9.5, 66.0)  # oz, cm: the middle of what its rules allow; the file has question marks
PRIOR = 0.02  # of the common scale


@dataclass(frozen=True)
class Ball:
    """mass [kg], radius [m]; holes: whether the shell has holes."""

    mass: float
    radius: float
    holes: bool

    @property
    def terms(self) -> Array:
        """rho A / (2 m) [1/m], r/m [m/kg], weight of the displaced air over the ball's."""
        area, volume = math.pi * self.radius**2, 4.0 / 3.0 * math.pi * self.radius**3
        return np.array([0.5 * AIR * area, self.radius, AIR * volume]) / self.mass


def balls(folder: Path) -> dict[str, Ball]:
    """Every ball by the workbook's name."""
    rows = [line.split() for line in (folder / "balls.txt").read_text().splitlines()[1:] if line.strip()]
    given = {r[0]: VOLLEYBALL if "?" in r[1] else (float(r[1]), float(r[2])) for r in rows}
    return {
        name: Ball(given[row][0] * OUNCE, 0.01 * given[row][1] / (2 * math.pi), "iffle" in row)
        for name, row in ROWS.items()
    }


class Balls(Body):
    """Falls of many balls with one set of parameters. each: the ball of every observation."""

    each: Sequence[Ball]

    def predict(self, mechanisms: tuple[str, ...], values: Mapping[str, float], which: Sequence[int]) -> list[Array]:
        return [self._best(i, self.law(i, values), values.get("scale", SENSOR["scale"])) for i in which]

    def law(self, i: int, values: Mapping[str, float]) -> Array:
        """Numbers of LAW for an observation."""
        b = self.each[i]
        drag, slow, lift = b.terms
        c = values.get("c_D", 0.0) + (values.get("holes", 0.0) if b.holes else 0.0)
        numbers = {"gravity": GRAVITY * (1.0 - values.get("displaced", 0.0) * lift), "quadratic": drag * c}
        return np.array([(numbers | {"viscous": slow * values.get("linear", 0.0)}).get(n, 0.0) for n in LAW])


def together(tracks: Mapping[str, list[tuple[Array, Array]]], each: Mapping[str, Ball], noise: Noise) -> Balls:
    """All drops as one system; free fall is questioned, its heights in a scale that is known to PRIOR."""
    seen, of = [], []
    for name, found in tracks.items():
        for k, (t, y) in enumerate(found, 1):
            seen.append(Observation(f"{name} {k}", t, y, name, name, labels={"kind": name}))
            of.append(each[name])
    scale = Parameter("scale", 1.0, 0.7, 1.4, 0.02, PRIOR)
    vocabulary = {
        "drag": Candidate((Parameter("c_D", 0.0, 0.0, 2.0, 0.05),)),
        "drag_of_holes": Candidate((Parameter("holes", 0.0, -1.0, 2.0, 0.05),)),
        "linear_drag": Candidate((Parameter("linear", 0.0, 0.0, 10.0, 0.1, unit="kg/(m s)"),)),
        "buoyancy": Candidate((Parameter("displaced", 0.0, 0.0, 2.0, 0.2),)),
    }
    out = Balls(seen, noise, {}, (scale,), vocabulary, wander=("scale",))
    out.each = of
    return out


def questioned(system: Balls, scatter: float) -> Findings:
    """By the engine; the conditions are the balls: a gain is on balls that were not fitted."""
    return Order(Problem(system, system.noise, {"scale": scatter}), np.random.default_rng(1), by=("kind",)).all()


def left(system: Balls, fit: Fit) -> list[tuple[str, float]]:
    """(ball, chi^2 per reading that a fit leaves), the greatest first."""
    each: dict[str, list[Array]] = {}
    for o, r in zip(system.observations, fit.residuals):
        each.setdefault(o.condition, []).append(r)
    found = {name: float(np.mean(np.concatenate(r) ** 2)) for name, r in each.items()}
    return sorted(found.items(), key=lambda x: -x[1])


def sindy_law(system: Balls, fitted: Sequence[int], window: int, threshold: float) -> Array:
    """[gravity, c_D, holes, linear] by pysindy from these drops, with the same terms as ours, each scaled to its
    greatest; the ball enters as a control that does not change."""
    import pysindy as ps
    from scipy.signal import savgol_filter

    states, controls, times = [], [], []
    for i in fitted:
        o, b = system.observations[i], system.each[i]
        t = np.linspace(o.t[0], o.t[-1], o.t.size)
        y = np.interp(t, o.t, o.y)
        states.append(
            np.stack([savgol_filter(y, window, 3, deriv=d, delta=float(t[1] - t[0])) for d in (0, 1)], axis=1)
        )
        controls.append(np.tile([b.terms[0], float(b.holes), b.terms[1]], (t.size, 1)))
        times.append(t)
    v, u = np.concatenate([s[:, 1] for s in states]), np.concatenate(controls)
    raw = [np.full(v.size, GRAVITY), u[:, 0] * v * np.abs(v), u[:, 0] * u[:, 1] * v * np.abs(v), u[:, 2] * v]
    sizes = [float(np.max(np.abs(x))) for x in raw]
    functions = [
        lambda x, v, d, h, s: -GRAVITY * np.ones_like(v) / sizes[0],
        lambda x, v, d, h, s: -d * v * np.abs(v) / sizes[1],
        lambda x, v, d, h, s: -d * h * v * np.abs(v) / sizes[2],
        lambda x, v, d, h, s: -s * v / sizes[3],
    ]
    library = ps.CustomLibrary(functions, function_names=[lambda *a: "f"] * 4)
    optimizer = ps.EnsembleOptimizer(ps.STLSQ(threshold=threshold, alpha=1e-6), bagging=True, n_models=20)
    model = ps.SINDy(optimizer=optimizer, feature_library=library)
    model.fit(states, t=times, u=controls)
    return model.coefficients()[1] / sizes


def error_of(system: Balls, numbers: Array, held: Sequence[int]) -> float:
    """Sum of squares of drops as a law of `sindy_law` predicts them, the start fitted as for ours [m^2]."""
    total = 0.0
    for i in held:
        gravity, c, holes, linear = numbers
        drag, slow, _ = system.each[i].terms
        law = {
            "gravity": GRAVITY * gravity,
            "quadratic": drag * (c + holes * system.each[i].holes),
            "viscous": slow * linear,
        }
        y = system._best(i, np.array([law.get(n, 0.0) for n in LAW]), 1.0)
        total += float(np.sum((system.observations[i].y - y) ** 2))
    return total if math.isfinite(total) else math.inf


def best_sindy(system: Balls) -> tuple[Array, float, str]:
    """(law from all drops, rms of balls held out in turn [m], settings): those of the least rms over a grid."""
    names = list(dict.fromkeys(o.condition for o in system.observations))
    folds = [[i for i, o in enumerate(system.observations) if o.condition == n] for n in names]
    n = sum(o.t.size for o in system.observations)
    best = (np.zeros(4), math.inf, "")
    np.random.seed(1)  # noqa: NPY002 pysindy draws its bags from the global generator
    for window in (7, 21):
        for threshold in (0.01, 0.1, 0.3):
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                total = 0.0
                for held in folds:
                    rest = [i for i in range(len(system.observations)) if i not in held]
                    total += error_of(system, sindy_law(system, rest, window, threshold), held)
                if math.sqrt(total / n) < best[1]:
                    law = sindy_law(system, range(len(system.observations)), window, threshold)
                    best = (law, math.sqrt(total / n), f"window {window}, threshold {threshold:g}")
    return best


def main() -> None:
    real = os.environ.get("JUMPVISION_REAL_DATA")
    if not real:
        raise SystemExit("JUMPVISION_REAL_DATA is not set: the recordings are not here")
    folder = Path(real) / "desilva_ball_drops"
    every = drops(folder)
    noise, scatter = repeats(every)
    system = together(every, balls(folder), noise)
    began = time.perf_counter()
    d = questioned(system, scatter)
    took = time.perf_counter() - began
    print(
        f"noise {noise.s:.3f} m, rho {noise.rho:.2f}; scale from drop to drop {100 * scatter:.1f} %, prior {PRIOR:g}\n"
    )
    print("| method | law | balls held out, rms m | time |\n|---|---|---|---|")
    n = d.naming
    named = f"named {' + '.join(n.named) or 'nothing'} ({n.status})" if n else "adequate"
    after = f"{d.gain.track_after:.3f} (free fall {d.gain.track_before:.3f})" if d.gain else "-"
    print(f"| ours: {named} | {best_of(d)} | {after} | {took:.0f} s |")
    if PEER:
        began = time.perf_counter()
        law, rms, settings = best_sindy(system)
        took = time.perf_counter() - began
        words = ", ".join(f"{n} {x:.3g}" for n, x in zip(("gravity x", "c_D", "holes", "linear"), law))
        print(f"| pysindy, strong, ensemble ({settings}) | {words} | {rms:.3f} | {took:.0f} s |")
    if n:
        print("\n| mechanism | probability, were the vocabulary all there is | stated |\n|---|---|---|")
        for m, p in sorted(n.probabilities.items(), key=lambda x: -max(x[1])):
            print(f"| {m} | {min(p):.3g} - {max(p):.3g} | {n.probability(m):.3g} |")
        print(f"\nwithout each quarter of the balls: {d.gain.selection if d.gain else '-'}")
        print(
            "chi^2 per reading that it leaves, by ball: "
            + ", ".join(f"{b} {x:.1f}" for b, x in left(system, n.best.fit))
        )


if __name__ == "__main__":
    main()
