"""Fig 49: the constant drag alpha v^2 fitted to single jumps, and what it then makes of stutter jumps.

The dissertation fits alpha to measured heights; here the cone's single jumps stand for them.
"""

import matplotlib.pyplot as plt
import numpy as np
from common import DRAGS, arguments, compare, drag_of_singles, forces, heights, save

from jumpvision.jumper.physics.packing import fit_packing_law

args = arguments(__doc__)
frequency = np.linspace(3.0, 12.0, 37)  # Hz
single = heights("single", forces("cone"), laws=None, frequency=frequency)
alpha, rms, tried = drag_of_singles(single, laws=None, frequency=frequency)
spread = np.ptp(tried, axis=0)
drag = forces("constant drag", alpha=alpha)
best = {
    (kind, name): float(heights(kind, model, laws=None, frequency=frequency).max())
    for kind in ("single", "stutter")
    for name, model in (("cone", forces("cone")), ("drag", drag))
}
phi = np.linspace(0.57, 0.63, 5 if args.small else 13)
few = {"frequency": frequency[::3]}
by_phi = np.array([drag_of_singles(heights("single", forces("cone"), phi=x, **few), phi=x, **few)[0] for x in phi])
kink = fit_packing_law(phi, by_phi, 0.05 * by_phi)  # as if alpha were known to 5 %

rows = compare(
    {
        "alpha of the single jumps on loose sand, kg/m": (alpha, None),
        "rms of their heights, mm": (rms, None),
        "spread of heights over the drags at 3 and 12 Hz, mm": (spread[[0, -1]], "greatest at high frequency"),
        "best single jump: cone, constant drag, mm": ((best["single", "cone"], best["single", "drag"]), None),
        "best stutter: cone, constant drag, mm": (
            (best["stutter", "cone"], best["stutter", "drag"]),
            "over-estimated on loose sand",
        ),
        "kink of alpha against packing": (kink.phi_c, "about 0.605"),
        "slope of alpha below and above it, kg/m per 0.01": (
            (0.01 * kink.slope_below, 0.01 * kink.slope_above),
            "higher above",
        ),
    }
)
figure, axes = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
axes[0].plot(frequency, tried[::3].T, color="0.8")
axes[0].plot(frequency, single, "k", label="cone, taken as measured")
axes[0].plot(frequency, heights("single", drag, laws=None, frequency=frequency), label=f"α = {alpha:.0f} kg/m")
axes[0].set(
    xlabel="frequency [Hz]", ylabel="height of the single jump [mm]", title=f"grey: α from 0 to {DRAGS[-1]:.0f}"
)
axes[0].legend()
axes[1].plot(phi, by_phi, "o")
axes[1].plot(phi, kink.at(phi)[0])
axes[1].set(xlabel="volume fraction", ylabel="α [kg/m]")
save(figure, rows, args.out)
