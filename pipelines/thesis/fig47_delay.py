"""Fig 47: height of the delayed stutter against the pause between its halves, by the cone and an older force model."""

import matplotlib.pyplot as plt
import numpy as np
from common import DWELL, SAND, arguments, compare, drag_of_singles, forces, heights, save

from jumpvision.jumper.robots import THESIS_ROBOT

args = arguments(__doc__)
delay = np.linspace(0.0, 0.8, 33 if args.small else 161)  # s
frequency = np.linspace(3.0, 12.0, 37)  # Hz
bed, cone = {"laws": None, "dwell_gain": DWELL}, forces("cone", memory=True)
longest = heights("stutter", cone, delay=delay[-1], frequency=frequency, **bed)
f = float(longest.idxmax("frequency"))  # the best after the longest pause
height = heights("stutter", cone, delay=delay, frequency=f, **bed).values
rings = heights("stutter", cone, delay=delay, frequency=f, laws=None).values  # a motor that stands still in the pause
singles = heights("single", cone, frequency=frequency, **bed)
alpha, *_ = drag_of_singles(singles[::2], memory=True, frequency=frequency[::2], **bed)
older = heights(
    "stutter", forces("drag and overshoot", memory=True, alpha=alpha), delay=delay, frequency=f, **bed
).values

# half a period of the robot on its spring in series with the bed's first resistance
k1, mass = THESIS_ROBOT["granular"]["model"]["k1"], SAND["motor_mass"] + SAND["rod_mass"]
half = np.pi * np.sqrt(mass * (1.0 / SAND["spring_stiffness"] + 1.0 / k1))
first = int(np.argmax(np.where(delay <= 2.0 * half, height, -np.inf)))
late, below = delay >= delay[-1] - 2.0 * half, delay < delay[first]

rows = compare(
    {
        "best delay within one loaded period, ms": (1e3 * delay[first], "about 100"),
        "half a loaded period, ms": (1e3 * half, "half a 5 Hz oscillation: 100"),
        "no delay, best delay, 0.75 s, mm": ([height[0], height[first], np.interp(0.75, delay, height)], None),
        "best single jump, mm": (float(singles.max()), "below the delayed one"),
        "ringing left in the heights of long delays, mm": (np.ptp(height[late]), "none"),
        "the same without the lowered gain, mm": (np.ptp(rings[late]), None),
        "older model less cone, below and beyond the best delay, mm": (
            [np.mean((older - height)[below]), np.mean((older - height)[~below])],
            "too high below, agrees beyond",
        ),
    }
)
figure, axis = plt.subplots(figsize=(7, 4), layout="constrained")
axis.plot(1e3 * delay, height, label="cone")
axis.plot(1e3 * delay, older, "--", label="drag and overshoot")
axis.plot(1e3 * delay, rings, lw=0.7, label="cone, without the lowered gain")
axis.axhline(float(singles.max()), color="k", ls=":", label="best single jump")
axis.axvline(1e3 * half, color="0.7")
axis.set(xlabel="delay [ms]", ylabel="height [mm]", title=f"delayed stutter jump at {f:.3g} Hz; grey: half a period")
axis.legend()
save(figure, rows, args.out)
