"""Figs 60, 61: one stutter jump on loose sand by each force model; the spring's force while the motor swings up."""

import matplotlib.pyplot as plt
import numpy as np
from common import AMPLITUDE, SAND, STUTTER, arguments, compare, drag_of_singles, forces, heights, save

from jumpvision.jumper.mechanisms.cone import cone_mass
from jumpvision.jumper.physics.forcing import sinusoid
from jumpvision.jumper.physics.sand.jump import simulate
from jumpvision.sweeps.robot import setup_of

args = arguments(__doc__)
frequency = np.linspace(3.0, 12.0, 37)  # Hz
few = {"laws": None, "frequency": frequency[::3]}
alpha = drag_of_singles(heights("single", forces("cone"), **few), **few)[0]
f = float(heights("stutter", forces("cone"), phi=0.63, frequency=frequency).idxmax("frequency"))  # best on dense sand
law = sinusoid(f, AMPLITUDE, STUTTER)
t = np.linspace(0.0, law.stop + 0.5, 2001)
upswing = (t > law.stop - 0.5 / f) & (t < law.stop)

theirs = {"constant drag": "slightly above static, sinks less", "cone": "lower, less compression in the upswing"}
figure, axes = plt.subplots(3, 1, figsize=(7, 8), sharex=True, layout="constrained")
found = {}
for name in ("static", "constant drag", "depth drag", "drag and added mass", "cone"):
    model = setup_of("granular", None, {"model": forces(name, alpha=alpha)}).model
    jump = simulate(model, law, t=t, rtol=1e-7, atol=1e-9)
    pushed = upswing & (t > jump.flights[0, 1]) if len(jump.flights) else upswing  # after the landing of the hop
    late = t[pushed][np.argmax(jump.spring_force[pushed])] - t[upswing][0]
    numbers = (1e3 * jump.jump_height, jump.spring_force[upswing].mean(), 1e3 * late, 1e3 * jump.depth_max)
    found[f"{name}: height mm, mean force N, time of its peak ms, depth mm"] = (numbers, theirs.get(name))
    for axis, values in zip(axes, (1e3 * (jump.rod - jump.rest), 1e3 * jump.foot, jump.spring_force)):
        axis.plot(1e3 * t, values, label=name)
whole = {n: model.symbol(n) for n in ("C", "mu", "theta", "R", "phi", "rho")}
found["greatest added mass / mass of the foot"] = (cone_mass(np, z=0.1, **whole) / SAND["foot_mass"], "over 4")
for axis, label in zip(axes, ("rod [mm]", "foot [mm]", "spring force [N]")):
    axis.axvspan(1e3 * (law.stop - 0.5 / f), 1e3 * law.stop, color="0.9")
    axis.set_ylabel(label)
axes[0].set_title(f"stutter jump at {f:.3g} Hz; grey: the motor swings up")
axes[0].legend(fontsize=8)
axes[2].set_xlabel("time [ms]")
save(figure, compare(found), args.out)
