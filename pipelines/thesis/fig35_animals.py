"""Fig 35: height over body length of animals of one shape and many sizes, scaled from a human, beside real ones.

Mass as length^3, stiffness and stroke as length, eq. (14). The measured jumps are those of animals.csv, with sources.
"""

import matplotlib.pyplot as plt
import numpy as np
import pandas as pd
from common import HERE, HOPPER, SINGLE, STUTTER, arguments, compare, peak, save

from jumpvision.jumper.physics.hard.jump import hard_sweep, sine_rows

MASS, STIFFNESS, DAMPING, STROKE, LENGTH, G = 78.0, 28500.0, 950.0, 0.5, 1.8, 9.81  # of a human, SI
args = arguments(__doc__)
length = np.append(np.geomspace(1e-3, 5.0, 24 if args.small else 90), LENGTH)  # m
size = (length / LENGTH)[:, None]
mass, stiffness = MASS * size**3, STIFFNESS * size
zeta = DAMPING / (2.0 * np.sqrt(STIFFNESS * MASS))
ratio = np.geomspace(0.05, 4.0, 2001)  # frequency / f_0
robot = {
    "motor_mass": mass * (1.0 - HOPPER.rod_share),
    "rod_mass": mass * HOPPER.rod_share,
    "stiffness": stiffness,
    "damping": 2.0 * zeta * np.sqrt(stiffness * mass),
    "gravity": G,
    "landing_loss": 0.0,
}
f = ratio * np.sqrt(stiffness / mass) / (2.0 * np.pi)  # Hz, (length, ratio)


def best(phase):
    """Height [m] of the best jump of every length."""
    jumps = hard_sweep(sine_rows(f, STROKE * size, phase, 1.0), **robot)
    return np.array([peak(np.log(ratio), h)[1] for h in jumps["com_height_m"]])


def at_lengths(height):
    """Simulated height [m] of animals as long as the measured ones."""
    return own_length * np.interp(np.log(own_length), np.log(length[:-1]), (height / length)[:-1])


seen = pd.read_csv(HERE / "animals.csv", comment="#")
own_length, height = 1e-3 * seen["length [mm]"], seen["height [m]"]
stutter, single = best(STUTTER), best(SINGLE)
low, high = at_lengths(stutter), at_lengths(single)
animals = seen.kind == "animal"
within = (height >= low) & (height <= high)

rows = compare(
    {
        "human alpha": (MASS * G / (STIFFNESS * STROKE), "about 0.05"),
        "human damping ratio": (zeta, 0.32),
        "human stutter jump, m": (stutter[-1], 2),
        "human single jump, m": (single[-1], 5),
        "animals between stutter and single": (f"{within[animals].sum()} of {animals.sum()}", "most"),
    }
)
figure, axis = plt.subplots(figsize=(7, 5), layout="constrained")
axis.loglog(length[:-1], (stutter / length)[:-1], label="stutter jump")
axis.loglog(length[:-1], (single / length)[:-1], label="single jump")
for kind, mark in (("animal", "k."), ("robot", "rx")):
    axis.loglog(own_length[seen.kind == kind], (height / own_length)[seen.kind == kind], mark, label=f"{kind}s")
axis.set(xlabel="body length [m]", ylabel="height / body length")
axis.legend()
save(figure, rows, args.out)
