"""Figs 29, 30, 31 and 33(a-d): position, spring force and the three powers of chosen jumps on hard ground."""

import matplotlib.pyplot as plt
import numpy as np
from common import HOPPER, SINGLE, STUTTER, arguments, compare, save

from jumpvision.jumper.physics.energy import powers
from jumpvision.jumper.physics.forcing import sinusoid
from jumpvision.jumper.physics.hard.jump import hard_jump

args = arguments(__doc__)
f0, A = HOPPER.f0, 4e-3  # Hz, m
CASES = {
    "slow stutter": (0.54, STUTTER),
    "best stutter of the dissertation": (0.72, STUTTER),
    "best stutter": (0.7386, STUTTER),
    "best single": (1.5405, SINGLE),
    "impulse at the start": (1.0, np.pi),
}
figure, axes = plt.subplots(3, len(CASES), figsize=(14, 7), sharex=True, sharey="row", layout="constrained")
found = {}
for column, (name, (ratio, phase)) in zip(axes.T, CASES.items()):
    law = sinusoid(ratio * f0, A, phase)
    t = np.linspace(0.0, law.stop + 0.2, 500 if args.small else 3000)
    jump = hard_jump(**HOPPER._asdict(), forcing=law, t=t, t_end=t[-1])
    power = powers(jump, law, motor_mass=HOPPER.motor_mass, rod_mass=HOPPER.rod_mass, gravity=HOPPER.gravity)
    driven = t < law.stop
    shown = {n: power[f"{n}_power"] for n in ("internal", "external", "absolute")}
    found |= {
        f"{name}: height, mm": (1e3 * jump.com_height, None),
        f"{name}: peak internal, external, absolute power, W": ([x[driven].max() for x in shown.values()], None),
    }
    if name == "impulse at the start":
        found["work of the impulses at its start and end, J"] = (jump.impulse_work_J, None)
    column[0].plot(1e3 * t, 1e3 * jump.rod, label="rod")
    column[0].plot(1e3 * t, 1e3 * law(t)[0], label="motor on the rod")
    column[1].plot(1e3 * t, jump.spring_force)
    for kind, x in shown.items():
        column[2].plot(1e3 * t, np.where(driven, x, np.nan), label=kind)
    column[0].set_title(name, fontsize=9)
    column[2].set_xlabel("time [ms]")
for axis, label in zip(axes[:, 0], ("position [mm]", "spring force [N]", "power [W]")):
    axis.set_ylabel(label)
axes[0, 0].legend()
axes[2, 0].legend()
save(figure, compare(found), args.out)
