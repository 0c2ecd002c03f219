"""Fig 32(a, b): height over amplitude, for frequency and amplitude of stutter and single jump; the best frequency."""

import matplotlib.pyplot as plt
import numpy as np
from common import HARD, HOPPER, SINGLE, STUTTER, arguments, compare, peak, save

import jumpvision as jv

args = arguments(__doc__)
ratio = np.linspace(0.2, 3.0, 561 if args.small else 1401)  # frequency / f_0
amplitude = np.linspace(0.5e-3, 8e-3, 16 if args.small else 121)  # m, with 4 mm among them
jumps = jv.sweep("hard", robot=HARD, phase=[STUTTER, SINGLE], amplitude=amplitude, frequency=ratio * HOPPER.f0)
relative = jumps.com_height_m / jumps.amplitude
best = np.array([[peak(ratio, h)[0] for h in kind] for kind in relative.values])  # of f_0, over (phase, amplitude)
at_4 = np.argmin(np.abs(amplitude - 4e-3))

rows = compare(
    {
        "best f/f_0 of the stutter jump at 4 mm": (best[0, at_4], "0.72"),
        "best f/f_0 of the single jump at 4 mm": (best[1, at_4], "1.4, the edge of the sweep"),
        "best f/f_0 of the stutter jump at 8 mm": (best[0, -1], None),
        "best f/f_0 of the single jump at 8 mm": (best[1, -1], "rises with the amplitude"),
        "greatest height / A of the stutter, single jump": (relative.max(["amplitude", "frequency"]).values, None),
    }
)
figure, axes = plt.subplots(1, 2, figsize=(9, 4), sharey=True, layout="constrained")
for axis, values, line, title in zip(axes, relative, best, ("stutter", "single")):
    drawn = axis.pcolormesh(1e3 * amplitude, ratio, values.transpose("frequency", "amplitude"))
    axis.plot(1e3 * amplitude, line, "w")
    figure.colorbar(drawn, ax=axis, label="height / A")
    axis.set(title=f"{title}; white: best", xlabel="amplitude [mm]")
axes[0].set_ylabel("frequency / $f_0$")
save(figure, rows, args.out)
