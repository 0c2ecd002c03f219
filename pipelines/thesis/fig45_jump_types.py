"""Figs 45(b), 59(b): single, stutter and delayed stutter against packing, by the cone and by an older force model.

Each kind at its best frequency in the densest bed. The bed remembers a pause of the foot, the motor's gain is lowered
in it. The older model's constant drag is fitted to the cone's single jumps, as the dissertation fits it to its own.
"""

import matplotlib.pyplot as plt
import numpy as np
from common import (
    AMPLITUDE,
    DWELL,
    KINDS,
    arguments,
    compare,
    drag_of_singles,
    first_crossing,
    forces,
    heights,
    save,
)

from jumpvision.jumper.physics.forcing import Loop, delayed
from jumpvision.jumper.physics.packing import fit_packing_law
from jumpvision.jumper.physics.sand.jump import simulate
from jumpvision.jumper.robots import THESIS_ROBOT
from jumpvision.sweeps.robot import setup_of

args = arguments(__doc__)
phi = np.linspace(0.57, 0.63, 5 if args.small else 13)
frequency = np.linspace(3.0, 12.0, 37)  # Hz
cone = forces("cone", memory=True)
few = {"frequency": frequency[::3], "dwell_gain": DWELL, "memory": True}
alpha = []  # kg/m, of every packing
for x in phi:
    singles = heights("single", cone, phi=x, frequency=frequency[::3], dwell_gain=DWELL)
    alpha.append(drag_of_singles(singles, phi=x, **few)[0])

kept, by_cone, older = {}, {}, {}
for kind in KINDS:
    dense = heights(kind, cone, phi=phi[-1], frequency=frequency, dwell_gain=DWELL)
    kept[kind] = float(dense.idxmax("frequency"))
    law = {"frequency": kept[kind], "dwell_gain": DWELL}
    by_cone[kind] = heights(kind, cone, phi=phi, **law).values
    models = [forces("drag and overshoot", memory=True, alpha=a) for a in alpha]
    older[kind] = [float(heights(kind, m, phi=x, **law)) for m, x in zip(models, phi)]

# how much deeper the foot stands after the preliminary hop of the delayed jump: the push starts from there
motor = THESIS_ROBOT["granular"]["motor"]
command = delayed(
    kept["delayed stutter"], AMPLITUDE, KINDS["delayed stutter"]["phase"], KINDS["delayed stutter"]["delay"]
)
t = np.linspace(0.0, command.stop + 0.5, 3001)
loop = Loop(command, **{n: motor[n] for n in ("kp", "kd", "max_force", "max_speed")}, dwell_gain=DWELL)
foot = simulate(setup_of("granular", None, {"model": cone}).model, loop, t=t, rtol=1e-6, atol=1e-9).foot
sunk = foot[0] - foot[t < command.rows[1, 1]][-1]
after = by_cone["delayed stutter"][0] + 1e3 * sunk  # mm above the rest after the hop
kink = fit_packing_law(phi, by_cone["single"], np.ones(phi.size))  # as if heights were known to 1 mm

ends = [0, -1]
rows = compare(
    {
        "single jump, loose and dense sand, mm": (by_cone["single"][ends], None),
        "stutter jump, loose and dense sand, mm": (by_cone["stutter"][ends], "below, above the single"),
        "delayed stutter, loose and dense sand, mm": (by_cone["delayed stutter"][ends], "above, below the single"),
        "older model's stutter, loose and dense sand, mm": (np.array(older["stutter"])[ends], "too high, right"),
        "packing whose single is as high as the delayed from after the hop": (
            first_crossing(phi, by_cone["single"] - after),
            "0.605, the critical one, and higher",
        ),
        "kink of the single's height": (kink.phi_c, "about 0.605"),
    }
)
figure, axis = plt.subplots(figsize=(6, 4), layout="constrained")
for i, kind in enumerate(KINDS):
    axis.plot(phi, by_cone[kind], f"C{i}", label=f"{kind}, {kept[kind]:.3g} Hz")
    axis.plot(phi, older[kind], f"C{i}--")
axis.set(xlabel="volume fraction", ylabel="height [mm]", title="cone; dashed: drag and overshoot")
axis.legend()
save(figure, rows, args.out)
