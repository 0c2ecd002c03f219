"""Section 3.4: what the cone's added mass and the scale b of its drag do to jumps, on loose and dense sand."""

import matplotlib.pyplot as plt
import numpy as np
from common import LAWS, arguments, compare, forces, heights, save

from jumpvision.sweeps.axes import read_laws

args = arguments(__doc__)
frequency = np.linspace(3.0, 12.0, 13 if args.small else 37)  # Hz
scale = (0.5, 1.0, 2.0)
b = read_laws(LAWS).laws["b"]
beds = {"loose": 0.57, "dense": 0.63}
found = {}
figure, axes = plt.subplots(2, 2, figsize=(9, 7), sharex=True, layout="constrained")
for row, (bed, phi) in zip(axes, beds.items()):
    for axis, kind in zip(row, ("single", "stutter")):
        law = {"phi": phi, "frequency": frequency}
        h = [heights(kind, forces("cone", b=x * float(b(phi))), **law).values for x in scale]
        massless = heights(kind, forces("depth drag"), **law).values
        lost = massless.max() - h[1].max()
        theirs = "negligible" if bed == "dense" else "lowers it" if kind == "stutter" else None
        found[f"added mass lowers the best {kind} on {bed} sand by mm, %"] = (
            (lost, 100.0 * lost / massless.max()),
            theirs,
        )
        if kind == "single":
            found[f"b halved to doubled moves the single on {bed} sand at 3, 12 Hz by mm"] = (
                np.ptp(h, axis=0)[[0, -1]],
                "most at high frequency",
            )
        for x, line in zip(scale, h):
            axis.plot(frequency, line, label=f"{x:g} b")
        axis.plot(frequency, massless, "k:", label="without added mass")
        axis.set(title=f"{kind}, {bed} sand", ylabel="height [mm]")
for axis in axes[1]:
    axis.set_xlabel("frequency [Hz]")
axes[0, 0].legend()
save(figure, compare(found), args.out)
