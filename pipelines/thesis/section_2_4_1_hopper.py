"""Section 2.4.1: the hopper driven without end, while the frequency goes up and then down: bifurcation, hysteresis."""

import matplotlib.pyplot as plt
import numpy as np
from common import HOPPER, SINGLE, arguments, compare, save

from jumpvision.jumper.physics.forcing import Segments
from jumpvision.jumper.physics.hard.jump import hard_jump

A, SETTLE, KEEP = 1e-3, 80, 40  # m, cycles that are left out at each frequency, cycles that are looked at
SAME = 2e-5  # m, apexes nearer than this are one
args = arguments(__doc__)
robot = HOPPER._replace(landing_loss=0.33)  # with it a bounce returns 0.8 of its speed, as measured
frequency = np.linspace(0.4, 2.2, 61 if args.small else 361) * robot.f0


def apexes(f):
    """Heights [m] above rest of the hops at each frequency (n,), in the order in which they are driven."""
    edges = np.concatenate([[0.0], np.cumsum((SETTLE + KEEP) / f)])
    same = np.ones(f.size)  # phase 3 pi/2: the motor is at rest between cycles
    law = Segments(np.stack([edges[:-1], edges[1:], A * same, A * same, 2.0 * np.pi * f, SINGLE * same], axis=-1))
    at = hard_jump(**robot._asdict(), forcing=law, t=None, t_end=law.stop).lift_off
    motion = hard_jump(**robot._asdict(), forcing=law, t=at, t_end=law.stop)
    position, rate = law(at)
    share = robot.motor_mass / robot.mass
    rise = np.maximum(motion.rod_velocity + share * rate, 0.0)
    height = (
        motion.rod + share * position + robot.mass * robot.gravity / robot.stiffness + rise**2 / (2.0 * robot.gravity)
    )
    return [height[(at >= a + SETTLE / x) & (at < b)] for a, b, x in zip(edges[:-1], edges[1:], f)]


up, down = apexes(frequency), apexes(frequency[::-1])[::-1]
number = np.array([[0 if h.size == 0 else 1 + np.sum(np.diff(np.sort(h)) > SAME) for h in way] for way in (up, down)])
ratio = frequency / robot.f0
shares = [100.0 * np.mean((number >= low) & (number <= high)) for low, high in ((1, 1), (2, 2), (3, 8), (9, 999))]
rows = compare(
    {
        "frequencies with 1, 2, 3 to 8, more apexes, %": (shares, "bifurcations, chaos"),
        "hops begin at f/f_0, going up": (ratio[np.argmax(number[0] > 0)], "hysteresis"),
        "hops end at f/f_0, going down": (ratio[np.argmax(number[1] > 0)], "hysteresis"),
    }
)
figure, axis = plt.subplots(figsize=(8, 4), layout="constrained")
for way, color, name in ((up, "C0", "frequency going up"), (down, "C1", "going down")):
    at = np.concatenate([np.full(h.size, r) for r, h in zip(ratio, way)])
    axis.plot(at, 1e3 * np.concatenate(way), ".", color=color, ms=1.5, label=name)
axis.set(xlabel="frequency / $f_0$", ylabel="apex above rest [mm]")
axis.legend(markerscale=5)
save(figure, rows, args.out)
