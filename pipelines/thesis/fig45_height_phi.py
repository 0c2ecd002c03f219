"""Fig 45(a): height of the single jump over frequency and volume fraction of the bed."""

import matplotlib.pyplot as plt
import numpy as np
from common import LAWS, SAND, SINGLE, arguments, compare, save

import jumpvision as jv

args = arguments(__doc__)
frequency = np.linspace(3.0, 12.0, 13 if args.small else 37)  # Hz
phi = np.linspace(0.57, 0.63, 4 if args.small else 25)
law = {"phase": SINGLE, "amplitude": 0.01875, "frequency": frequency}
height = 1e3 * jv.sweep("granular", robot=SAND, laws=LAWS, phi=phi, **law).jump_height_m  # mm
hard = 1e3 * float(jv.sweep("hard", robot=SAND, **law).jump_height_m.max())
best = height.max("frequency")


def broad(values):
    """Lowest and highest frequency [Hz] at which a jump reaches nine tenths of the highest."""
    return frequency[values > 0.9 * values.max()][[0, -1]]


rows = compare(
    {
        "best single jump on loose sand, mm": (float(best[0]), None),
        "the same over that on hard ground": (float(best[0]) / hard, "about 1/3"),
        "best single jump on dense sand, mm": (float(best[-1]), None),
        "within 10 % of it on loose sand, Hz": (broad(height.isel(phi=0).values), "a broad range"),
        "within 10 % of it on dense sand, Hz": (broad(height.isel(phi=-1).values), "a broad range"),
    }
)
figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
figure.colorbar(axis.pcolormesh(phi, frequency, height.transpose("frequency", "phi")), ax=axis, label="height [mm]")
axis.plot(phi, height.idxmax("frequency"), "w.")
axis.set(xlabel="volume fraction", ylabel="frequency [Hz]", title="single jump; white: best")
save(figure, rows, args.out)
