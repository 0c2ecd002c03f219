"""The log evidence of a diagnosis against nested sampling (dynesty), at the ends of the ranges too.

`python -m benchmarks.evidence [--campaigns N]` prints a table, the greatest difference first. Each campaign has four
jumps; the models are the baseline and some with one mechanism, its strength at the end of its range among them. Nested
sampling draws from the priors within BOX standard deviations of the fit (and within the ranges); what lies outside is
left out of both, and the volume of the box is exact.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from benchmarks.rows import Row, gather
from jumpvision.engine.fitting import Problem
from jumpvision.engine.order import fit_baseline
from jumpvision.engine.system import parameters
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.learning import learn_noise
from jumpvision.laboratory.blind import Nuisance, campaign, draw

from .diagnosis import jumps_of

BOX = 6.0  # standard deviations of the fit
LIVE = 100  # points of the nested sampling
HIDDEN = ((), ("coulomb_friction",), ("payload",), ("spring_damping",), ("camera_scale",))
ASKED = ("coulomb_friction", "viscous_friction", "payload", "spring_hardening", "camera_scale")
FAR = 1e-4  # of a prior's width, where a fit gives no scale


@dataclass(frozen=True)
class Case:
    """A campaign, and the model whose evidence is asked for."""

    number: int

    @property
    def key(self) -> str:
        return f"evidence #{self.number}"


def run(case: Case) -> Row:
    """Both log evidences of one model."""
    from dynesty import NestedSampler

    rng = np.random.default_rng([212, case.number])
    hidden = HIDDEN[case.number % len(HIDDEN)]
    setting = draw(rng, ground="hard", hidden=hidden, strength=0.3, nuisance=Nuisance(2e-4, 0.0, 0.0), jumps="few")
    learned = learn_noise(Jumper(*jumps_of(setting, campaign(setting, rng)), workers=1))
    problem = Problem(learned.system, learned.noise, learned.scatter)
    base = fit_baseline(problem, rng)
    mechanism = ASKED[case.number // len(HIDDEN) % len(ASKED)]
    fit = problem.fit((mechanism,), base.named)
    assert fit is not None
    free = parameters(problem.system, (mechanism,))
    width = np.array([BOX * max(fit.sigma(p.name), FAR * p.scale) for p in free])
    low = np.maximum(fit.values - width, [p.low for p in free])
    high = np.minimum(fit.values + width, [p.high for p in free])

    def log_likelihood(x: NDArray[np.float64]) -> float:
        cost = problem.cost((mechanism,), dict(zip((p.name for p in free), x.tolist())))
        return -0.5 * cost if math.isfinite(cost) else -1e300

    began = time.process_time()
    sampler = NestedSampler(
        log_likelihood, lambda u: low + u * (high - low), len(free), nlive=LIVE, rstate=rng, sample="rwalk"
    )
    sampler.run_nested(dlogz=0.1, print_progress=False)
    found = sampler.results
    inside = float(np.sum(np.log((high - low) / np.array([p.width for p in free]))))
    ours = fit.log_evidence + 0.5 * sum(
        float(np.sum(np.log1p(size * size))) for _, size in fit.frame
    )  # of the noise: in `cost` it is not
    at_end = any(p.at_end(v) for p, v in zip(free, fit.values))
    return {
        "hidden": "+".join(hidden) or "nothing", "model": mechanism, "at an end": at_end, "ours": ours,
        "nested": float(found.logz[-1]) + inside, "sigma": float(found.logzerr[-1]),
        "processor_s": time.process_time() - began,
    }  # fmt: skip


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=30)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rows", help="file of one JSON line a campaign; those already there are not made again")
    args = parser.parse_args()
    rows = gather([Case(i) for i in range(args.campaigns)], run, args.rows, args.workers)
    good = sorted((r for r in rows if "failed" not in r), key=lambda r: -abs(r["ours"] - r["nested"]))
    print("| hidden | model | strength at an end | ours | nested sampling | difference |\n|---|---|---|---|---|---|")
    for r in good:
        off = f"{r['ours'] - r['nested']:+.2f} ± {r['sigma']:.2f}"
        end = "yes" if r["at an end"] else "no"
        print(f"| {r['hidden']} | {r['model']} | {end} | {r['ours']:.2f} | {r['nested']:.2f} | {off} |")
    for r in rows:
        if "failed" in r:
            print(f"* failed: {r['key']}: {r['failed']}")


if __name__ == "__main__":
    main()
