"""Fig 36: a stutter jump whose two half cycles have frequencies of their own, beside those of one frequency."""

import matplotlib.pyplot as plt
import numpy as np
from common import HARD, HOPPER, SINGLE, STUTTER, arguments, compare, save

import jumpvision as jv

args = arguments(__doc__)
f0 = HOPPER.f0
alpha = np.array([0.03, 0.14, 0.5, 0.84, 0.86, 0.88, 1.2])
if not args.small:
    alpha = np.sort(np.append(np.geomspace(0.02, 1.5, 60), 0.14))
first = np.linspace(0.1, 2.0, 500 if args.small else 950) * f0  # a narrow ridge in the first frequency ...
second = np.geomspace(0.5, 40.0, 40 if args.small else 60) * f0  # ... that is flat in the second
two = jv.sweep("hard", robot=HARD, phase=STUTTER, alpha=alpha, frequency=first, frequency2=second)
one = jv.sweep("hard", robot=HARD, phase=[STUTTER, SINGLE], alpha=alpha, frequency=np.linspace(0.1, 2.5, 2401) * f0)

pair = two.isel(two.com_height_m.argmax(["frequency", "frequency2"]))
stutter, single = (x.isel(x.com_height_m.argmax(["frequency"])) for x in (one.isel(phase=0), one.isel(phase=1)))
other = np.maximum(stutter.com_height_m, single.com_height_m)
gain, over_stutter = pair.com_height_m / other, pair.com_height_m / stutter.com_height_m
joined = alpha[over_stutter < 1.01]

rows = compare(
    {
        "two frequencies jump higher than both others": (
            "always" if (gain > 0.9995).all() else "not always",  # the grid of frequencies costs 0.05 % at most
            "always",
        ),
        "height over the better of the others at alpha 0.14": (float(gain.sel(alpha=0.14)), None),
        "alpha from which it gains less than 1 % over the stutter": (joined[0] if joined.size else np.nan, 0.9),
        "first frequency below the stutter's, % of alphas": (
            100.0 * float((pair.frequency <= stutter.frequency).mean()),
            "always",
        ),
    }
)
stroke = HOPPER.mass * HOPPER.gravity / (HOPPER.stiffness * alpha)  # m
figure, axes = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
for name, jumps in (("two frequencies", pair), ("stutter", stutter), ("single", single)):
    axes[0].loglog(alpha, jumps.com_height_m / stroke, label=name)
    axes[1].loglog(alpha, jumps.frequency / f0, label=name)
axes[1].loglog(alpha, pair.frequency2 / f0, "C0--", label="the second of the two")
for axis, label in zip(axes, ("height / A", "best frequency / $f_0$")):
    axis.set(xlabel="α = M g/(k A)", ylabel=label)
    axis.legend()
save(figure, rows, args.out)
