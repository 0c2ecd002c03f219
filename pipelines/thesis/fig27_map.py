"""Figs 27, 28, Table 3: height, number and power of jumps over frequency and start phase; the best of each kind."""

import matplotlib.pyplot as plt
import numpy as np
from common import HARD, HOPPER, SINGLE, STUTTER, arguments, compare, peak, save

import jumpvision as jv

args = arguments(__doc__)
f0, A = HOPPER.f0, 4e-3  # Hz, m
n = 60 if args.small else 300
frequency, phase = np.linspace(0.2, 1.8, n) * f0, np.linspace(0.0, 2.0 * np.pi, n)
jumps = jv.sweep("hard", robot=HARD, amplitude=A, frequency=frequency, phase=phase)

fine = np.linspace(0.3, 2.5, 4401) * f0
best = jv.sweep("hard", robot=HARD, amplitude=A, frequency=fine, phase=[STUTTER, SINGLE])
(f_stutter, stutter), (f_single, single) = (peak(fine, h) for h in best.com_height_m.transpose("phase", "frequency"))
near = fine[best.com_height_m.isel(phase=1) > 0.99 * single] / f0


def at(quantity, f, kind):
    """Value of a quantity of the jump of a kind at a frequency [Hz]."""
    return float(best[quantity].sel(phase=kind).interp(frequency=f))


def ratio(quantity, f1, f2):
    """Single jump at f1 over stutter jump at f2 [Hz]."""
    return at(quantity, f1, SINGLE) / at(quantity, f2, STUTTER)


rows = compare(
    {
        "f_0, Hz": (f0, 11.13),
        "damping ratio": (HOPPER.zeta, 0.0083),
        "alpha": (HOPPER.mass * HOPPER.gravity / (HOPPER.stiffness * A), "0.13 and 0.14"),
        "best f/f_0 of the stutter jump": (f_stutter / f0, "0.72 simulated, 0.78 measured"),
        "best f/f_0 of the single jump": (f_single / f0, "1.4, the edge of the sweep"),
        "f/f_0 of the single within 1 % of its best": ((near[0], near[-1]), None),
        "height of the best stutter jump, mm": (1e3 * stutter, "about 35"),
        "height of the best single jump, mm": (1e3 * single, "about 35"),
        "single / stutter, peak power at the best": (ratio("peak_power_W", f_single, f_stutter), 1.66),
        "single / stutter, peak power at 1.4 and 0.78 f_0": (ratio("peak_power_W", 1.4 * f0, 0.78 * f0), 1.66),
        "single / stutter, peak force at the best": (ratio("peak_force_N", f_single, f_stutter), 1 / 1.25),
        "most jumps of a multi-jump above 3 Hz": (float(jumps.n_jumps.sel(frequency=slice(3.0, None)).max()), 5),
    }
)
figure, axes = plt.subplots(1, 3, figsize=(12, 4), layout="constrained")
shown = (1e3 * jumps.com_height_m, jumps.n_jumps.clip(0, 6), jumps.peak_power_W)
for axis, values, title in zip(axes, shown, ("height [mm]", "number of jumps", "peak power [W]")):
    drawn = axis.pcolormesh(phase / np.pi, frequency / f0, values.transpose("frequency", "phase"))
    figure.colorbar(drawn, ax=axis)
    axis.set(title=title, xlabel="start phase [π]")
axes[0].set_ylabel("frequency / $f_0$")
axes[0].plot([0.5, 1.5], [f_stutter / f0, f_single / f0], "w+")
save(figure, rows, args.out)
