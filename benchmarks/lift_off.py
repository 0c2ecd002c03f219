"""The smallest amplitude that lifts off, by trials of the laboratory, against that of the laboratory's integrator.

`python -m benchmarks.lift_off [ROBOTS]`: hard ground, 0.05 mm of noise, springs known to 0.5 %.
"""

from __future__ import annotations

import math
import sys
from dataclasses import replace

import numpy as np

from benchmarks.diagnosis import jumps_of
from jumpvision.experiment.campaign.explore.lift_off import Threshold, Trial, threshold, trial
from jumpvision.laboratory.blind import Nuisance, campaign, draw
from jumpvision.laboratory.jumper import Law, motion_of
from jumpvision.laboratory.protocol import Protocol
from jumpvision.laboratory.protocol_keys import Jump

PHASES = {"single": 1.5 * math.pi, "stutter": 0.5 * math.pi}


def exact(p: Protocol, frequency: float, phase: float) -> float:
    """The threshold [m] of the laboratory's own motion."""
    low, high = 1e-4, 1e-2
    _, true = p.truth(0.0, np.random.default_rng(0))
    while high / low > 1.0005:
        law = Law(frequency, math.sqrt(low * high), phase, 0.2)
        motion = motion_of(p.robot, law, p.terms, true, ground="hard", duration=0.7, dt=1e-5, every=10)
        low, high = (low, law.amplitude) if len(motion.lift_offs) else (law.amplitude, high)
    return math.sqrt(low * high)


def searched(seed: int) -> tuple[str, float, float, Threshold]:
    """(kind, frequency [Hz], exact threshold [m], what the trials say) of one robot."""
    rng = np.random.default_rng([seed, 3])
    setting = draw(rng, ground="hard", hidden=(), nuisance=Nuisance(5e-5, 0.0, 0.0))
    p, frequency, kind = setting.protocol, float(rng.choice([7.0, 9.0, 11.0, 14.0])), str(rng.choice(list(PHASES)))
    amplitude: float | None = float(np.exp(rng.uniform(math.log(1e-3), math.log(8e-3))))
    trials: list[Trial] = []
    while amplitude is not None:
        law = Law(frequency, amplitude, PHASES[kind], 0.2)
        made = replace(setting, protocol=replace(p, jumps=(Jump(len(trials), "trial", "trial", kind, law, 0.57),)))
        trials.append(trial(jumps_of(made, campaign(made, rng))[0][0]))
        found = threshold(trials, 0.005)
        amplitude = found.next
    return kind, frequency, exact(p, frequency, PHASES[kind]), found


def main(robots: int = 16) -> None:
    off, inside = [], 0
    for seed in range(robots):
        kind, frequency, true, found = searched(seed)
        off.append(abs(found.value / true - 1.0))
        inside += found.low <= true <= found.high
        print(f"{kind} {frequency:g} Hz: {1e3 * true:.4f} mm, found {1e3 * found.value:.4f} "
              f"({1e3 * found.low:.4f} to {1e3 * found.high:.4f}) in {found.trials} trials", flush=True)  # fmt: skip
    print(f"{robots} robots: error {100 * max(off):.2f} % at most, {100 * float(np.median(off)):.2f} % in the median, "
          f"{sum(x < 0.02 for x in off)} within 2 %, {inside} 90 % intervals hold the truth")  # fmt: skip


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
