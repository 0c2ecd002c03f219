"""Fig 24: least amplitude that lifts the robot off the ground, against frequency, for start phases and cycle numbers.

A lift-off counts until the forcing ends, or until one natural period later: the easiest frequency depends on it.
"""

import matplotlib.pyplot as plt
import numpy as np
from common import HOPPER, arguments, compare, peak, save

from jumpvision.jumper.physics.hard.jump import hard_sweep, sine_rows

args = arguments(__doc__)
f0 = HOPPER.f0
ratio = np.arange(0.3, 1.45, 0.005 if args.small else 0.002)  # frequency / f_0
phase = np.array([0.0, 0.5, 0.75, 1.0]) * np.pi
cycles, wait = np.array([1.0, 5.0]), np.array([0.0, 1.0 / f0])  # wait [s]: counted after the end of the forcing

# the motion before the first lift-off is linear in the amplitude: one threshold, found by bisection
f, ph, n, w = np.broadcast_arrays(ratio * f0, phase[:, None], cycles[:, None, None], wait[:, None, None, None])
low, high = np.zeros(f.shape), np.full(f.shape, 0.02)  # m
for _ in range(24):
    middle = 0.5 * (low + high)
    lifts = hard_sweep(sine_rows(f, middle, ph, n), **HOPPER._asdict())["lift_off_s"] <= n / f + w
    low, high = np.where(lifts, low, middle), np.where(lifts, middle, high)
least = np.where(high < 0.02, high, np.nan)  # m, over wait, cycles, phase, frequency
easiest = np.array([[[peak(ratio, -a)[0] for a in b] for b in c] for c in least])

rows = compare(
    {
        **{
            f"easiest f/f_0, 1 cycle, phase {p:g} pi: within the forcing, one period later": (
                easiest[:, 0, i],
                "depends on the phase",
            )
            for i, p in enumerate(phase / np.pi)
        },
        "easiest f/f_0, 5 cycles: least and greatest": ((easiest[:, 1].min(), easiest[:, 1].max()), "nearly 1"),
    }
)
figure, axes = plt.subplots(1, 2, figsize=(9, 4), sharey=True, layout="constrained")
for axis, of_cycles, number in zip(axes, np.moveaxis(least, 1, 0), cycles):
    for i, p in enumerate(phase / np.pi):
        axis.semilogy(ratio, 1e3 * of_cycles[0, i], color=f"C{i}", label=f"phase {p:g} π")
        axis.semilogy(ratio, 1e3 * of_cycles[1, i], color=f"C{i}", ls="--")
    axis.set(title=f"{number:.0f} cycles (dashed: a period later too)", xlabel="frequency / $f_0$")
axes[0].set_ylabel("least amplitude [mm]")
axes[0].legend()
save(figure, rows, args.out)
