"""The built-in jumper behind the door of foreign simulators: the same verdicts? `python -m benchmarks.wrapped_jumper`.

Campaigns of the virtual laboratory are questioned twice: as `jumpvision diagnose` does, and through `jv.diagnose` with
the jumper's own predictions as a user's function, its vocabulary as a study's mechanisms and the noise as learned.
"""

from __future__ import annotations

import math
import sys
import time

import numpy as np
from numpy.typing import NDArray

import jumpvision as jv
from jumpvision.engine.fitting import Problem
from jumpvision.engine.order import Order
from jumpvision.engine.system import Parameter
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.learning import Learned, learn_noise
from jumpvision.laboratory.blind import Nuisance, campaign, draw

from .diagnosis import jumps_of

CASES = ("hard", ()), ("hard", ("motor_lag",)), ("granular", ("added_mass",)), ("hard", ("viscous_friction",))
CASES += ("granular", ()), ("granular", ("depth_drag",))


def as_parameter(p: Parameter) -> jv.Parameter:
    """A parameter of the engine as a user gives it."""
    sigma = p.sigma if math.isfinite(p.sigma) else None
    return jv.Parameter(p.name, p.start, (p.low, p.high), sigma, p.unit, scale=p.scale, log=p.log)


def wrapped(learned: Learned) -> tuple[list[jv.Recording], jv.Study]:
    """Recordings and study of a campaign of jumps."""
    system, noise = learned.system, learned.noise

    def simulate(p: dict[str, float], r: jv.Recording, instead: str = "") -> NDArray[np.float64]:
        there = {n: c for n, c in system.candidates.items() if not c.replaces or n == instead}
        active = [n for n, c in there.items() if c.replaces or p[c.parameters[0].name] != c.null]
        free = {q.name for q in system.baseline} | {q.name for n in active for q in there[n].parameters}
        values = {n: x for n, x in p.items() if n in free}
        return system.predict(tuple(active), values, [r.inputs["place"]])[0]

    mechanisms = []
    for name, c in system.candidates.items():
        own = [as_parameter(p) for p in c.parameters if p.name not in {q.name for q in system.baseline}]
        other = (lambda p, r, name=name: simulate(p, r, name)) if c.replaces else None
        mechanisms.append(jv.Mechanism(name, own, null=c.null, shapes=c.shapes, function=other))
    recordings = [
        jv.Recording(
            o.name, o.t, o.y, {"place": i}, o.labels, o.group, o.condition, noise.s * np.asarray(o.spread), o.parts
        )
        for i, o in enumerate(system.observations)
    ]
    channel = jv.Channel("height", "m", noise.s, noise.rho, noise.drift, zero_sigma=math.inf)
    return recordings, jv.Study(simulate, [as_parameter(p) for p in system.baseline], mechanisms, [channel])


def main() -> None:
    print("| same | hidden | jumper | wrapped | jumper [s] | wrapped [s] | runs |\n|---|---|---|---|---|---|---|")
    for k, (ground, hidden) in enumerate(CASES[: int(sys.argv[1]) if len(sys.argv) > 1 else None]):
        rng = np.random.default_rng([k, 77])
        setting = draw(rng, ground=ground, hidden=hidden, nuisance=Nuisance(1e-4, rho=0.0, step=0.0))
        jumps, fit, priors = jumps_of(setting, campaign(setting, rng))
        learned = learn_noise(Jumper(jumps, fit, priors, workers=1))
        began = time.perf_counter()
        stops = [j.stop for j in jumps]
        d = Order(Problem(learned.system, learned.noise), np.random.default_rng(1), by=("kind",), stops=stops).all()
        ours, middle = set(d.naming.named) if d.naming else set(), time.perf_counter()
        again = jv.diagnose(*wrapped(learned), avoid=True)
        took, theirs = time.perf_counter() - middle, set(again.named)
        same = "yes" if ours == theirs and d.adequate == again.adequate else "NO"
        names = [" + ".join(sorted(x)) or "-" for x in (set(hidden), ours, theirs)]
        runs = again.runs.made if again.runs else 0
        print(f"| {same} | {' | '.join(names)} | {middle - began:.0f} | {took:.0f} | {runs} |", flush=True)


if __name__ == "__main__":
    main()
