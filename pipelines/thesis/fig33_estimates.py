"""Fig 33(e): estimates of the best stutter frequency, eqs (8), (10), (12) and (13), beside simulation."""

import matplotlib.pyplot as plt
import numpy as np
from common import HOPPER, STUTTER, arguments, compare, peak, save

from jumpvision.jumper.physics.hard.jump import hard_sweep, sine_rows

args = arguments(__doc__)
alpha = np.geomspace(0.02, 1.5, 24 if args.small else 120)  # M g/(k A)
ratio = np.linspace(0.1, 2.0, 1901)  # frequency / f_0
root = np.sqrt(alpha)
first = np.sqrt(alpha / 18.0)  # time to the first lift-off
a, b, c = 0.25 - (2.0 - alpha) / (2.0 * alpha * np.pi**2), 1.0 - first, 1.0 + alpha / 16.0 - 2.0 * first
estimates = {
    "(8), half a fall": 0.5 * np.pi * root,
    "(10), fall and push": 1.0 / (0.5 + 1.0 / (np.pi * root)),
    "(12), three parts": 2.0 * c / (b + np.sqrt(np.maximum(b * b - 4.0 * a * c, 0.0))),
}
# eq. (13), energy that one grounded cycle leaves: r^4/(1 - r^2)^2 (1 - cos 2 pi/r), without its hole at r = 1
energy = 2.0 * (np.pi * ratio * np.sinc(1.0 - 1.0 / ratio) / (1.0 + ratio)) ** 2
beyond = peak(ratio[ratio > 0.6], energy[ratio > 0.6])[0]


def best(robot):
    """Best frequency / f_0 of the stutter jump of a robot, over alpha."""
    stroke = robot.mass * robot.gravity / (robot.stiffness * alpha[:, None])
    jumps = hard_sweep(sine_rows(ratio * robot.f0, stroke, STUTTER, 1.0), **robot._asdict())
    return np.array([peak(ratio, h)[0] for h in jumps["com_height_m"]])


plain = best(HOPPER._replace(damping=0.0, rod_mass=0.0, motor_mass=HOPPER.mass))
own, low = best(HOPPER), alpha < 0.9
verdicts = ("not accurate", "more accurate", "most accurate")
rows = compare(
    {
        **{
            f"rms error of eq. {name} below alpha 0.9, f_0": (np.sqrt(np.mean((x - plain)[low] ** 2)), verdict)
            for (name, x), verdict in zip(estimates.items(), verdicts)
        },
        "best f/f_0 by eq. (13)": (beyond, 1.2),
        "best f/f_0 simulated, alpha above 0.9": ((plain[~low].min(), plain[~low].max()), 1.2),
    }
)
figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
axis.semilogx(alpha, plain, "k", label="simulated, no rod, no damping")
axis.semilogx(alpha, own, "k:", label="simulated, this robot")
for name, x in estimates.items():
    axis.semilogx(alpha, x, label=f"eq. {name}")
axis.axhline(beyond, color="C3", ls="--", label="eq. (13)")
axis.set(xlabel="α = M g/(k A)", ylabel="best frequency / $f_0$", ylim=(0.0, 2.0))
axis.legend()
save(figure, rows, args.out)
