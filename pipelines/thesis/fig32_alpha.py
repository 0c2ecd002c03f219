"""Fig 32: best height, frequency and power of stutter and single jump against alpha = M g/(k A)."""

import matplotlib.pyplot as plt
import numpy as np
from common import HARD, HOPPER, SINGLE, STUTTER, arguments, compare, first_crossing, peak, save

import jumpvision as jv

args = arguments(__doc__)
ratio = np.linspace(0.3, 2.2, 951 if args.small else 3801)  # frequency / f_0
alpha = np.geomspace(0.05, 1.4, 24 if args.small else 90)
jumps = jv.sweep("hard", robot=HARD, alpha=alpha, phase=[STUTTER, SINGLE], frequency=ratio * HOPPER.f0)


def best_of(height):
    """Frequency / f_0 and height [m] of the highest jump over (alpha, phase), and its peak power [W]."""
    found = np.array([[peak(ratio, h) for h in both] for both in jumps[height].values])
    at = jumps[height].argmax("frequency")
    return found[..., 0], found[..., 1], jumps.peak_power_W.isel(frequency=at).values


best, height, power = best_of("com_height_m")
_, flight, _ = best_of("flight_height_m")


def passes(values):
    """The least alpha at which the stutter jump's value passes the single jump's."""
    return np.exp(first_crossing(np.log(alpha), np.log(values[:, 0] / values[:, 1])))


at_09, at_12 = (np.array([np.interp(np.log(a), np.log(alpha), best[:, i]) for i in (0, 1)]) for a in (0.9, 1.2))
rows = compare(
    {
        "alpha where the stutter height passes the single's": (passes(height), 0.09),
        "the same by flight time": (passes(flight), 0.09),
        "alpha where the stutter power passes the single's": (passes(power), 0.28),
        "alpha up to which the stutter has more height per power": (passes(height / power), "at every alpha"),
        "best f/f_0 at alpha 0.9, stutter": (at_09[0], "about 1.2"),
        "best f/f_0 at alpha 0.9, single": (at_09[1], "about 1.2"),
        "best f/f_0 at alpha 1.2, stutter": (at_12[0], 1.2),
    }
)
stroke = HOPPER.mass * HOPPER.gravity / (HOPPER.stiffness * alpha[:, None])  # m, amplitude A
scale = HOPPER.stiffness * stroke**2 * 2.0 * np.pi * HOPPER.f0  # W, k A^2 w_0
figure, axes = plt.subplots(1, 3, figsize=(12, 4), layout="constrained")
panels = (height / stroke, best, power / scale)
for axis, values, title in zip(axes, panels, ("height / A", "best frequency / $f_0$", "peak power / $k A^2 ω_0$")):
    axis.semilogx(alpha, values, label=["stutter", "single"])
    axis.set(title=title, xlabel="α = M g/(k A)")
axes[0].legend()
save(figure, rows, args.out)
