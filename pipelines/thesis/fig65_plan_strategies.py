"""Fig 65: what the motor does in plans of least peak power for a ladder of heights, on rigid ground and on sand."""

import matplotlib.pyplot as plt
import numpy as np
from common import arguments, compare, save

from jumpvision.jumper.planning.jumper import Drive
from jumpvision.jumper.planning.ladder import ladder
from jumpvision.jumper.planning.plan import Planner
from jumpvision.jumper.planning.transcription import Limits
from jumpvision.sweeps.plan import rigid
from jumpvision.sweeps.robot import setup_of

args = arguments(__doc__)
apex = np.linspace(0.03, 0.04, 2) if args.small else np.linspace(0.02, 0.06, 9)  # m
setup = setup_of("granular", None, {})
motor = setup.motor
limits = Limits(motor.max_force, motor.max_speed, motor.stroke)
figure, axes = plt.subplots(1, 2, figsize=(9, 4), sharey=True, layout="constrained")
travel, pull, excess = {}, {}, {}
for axis, (ground, model) in zip(axes, {"rigid": rigid(setup.model), "sand": setup.model}.items()):
    found = ladder(Planner(model, Drive(motor.kp, motor.kd), limits, "power"), apex.tolist())
    moved = [(p.motion.motor - p.motion.rod)[p.motion.t < p.command.stop] for p in found.plans]  # m, motor on the rod
    travel[ground] = np.array([np.ptp(x) for x in moved])
    pull[ground] = np.array([-x.min() for x in moved]) / travel[ground]
    excess[ground] = 100.0 * np.array(found.excess)
    for height, plan, x in zip(apex, found.plans, moved):
        t = plan.motion.t[: x.size] - plan.durations[:-1].sum()  # s, from the take-off
        axis.plot(1e3 * t, 1e3 * x, color=plt.cm.viridis((height - apex[0]) / (apex[-1] - apex[0])))
    axis.set(title=f"{ground} ground, {1e3 * apex[0]:.0f} to {1e3 * apex[-1]:.0f} mm", xlabel="time from take-off [ms]")
axes[0].set_ylabel("motor on the rod [mm]")
ratio = travel["sand"] / travel["rigid"]

rows = compare(
    {
        "travel of the motor, sand over rigid: first, last, mean": ((ratio[0], ratio[-1], ratio.mean()), "nearly 2"),
        "share of the travel that is a pull, rigid, %": (100.0 * pull["rigid"].mean(), "pull, then push"),
        "share of the travel that is a pull, sand, %": (100.0 * pull["sand"].mean(), "a single quick thrust"),
        "peak power above the least of any shape, at most, %": (max(x.max() for x in excess.values()), None),
    }
)
save(figure, rows, args.out)
