"""Fig 64: heights jumped against planned, by plans that know the sand or do not, on robots and beds a little off."""

import numpy as np
from common import arguments, compare, save
from matplotlib import pyplot as plt

from jumpvision.jumper.planning.jumper import Drive
from jumpvision.jumper.planning.ladder import ladder
from jumpvision.jumper.planning.plan import Planner, perturbed
from jumpvision.jumper.planning.transcription import Limits
from jumpvision.sweeps.plan import rigid
from jumpvision.sweeps.robot import setup_of

# relative standard deviation between the model planned with and the robot and bed that jump
UNKNOWN = {"k1": 0.03, "k2": 0.03, "b": 0.05, "C": 0.07, "motor_mass": 0.004, "spring_stiffness": 0.01}
args = arguments(__doc__)
apex = np.linspace(0.03, 0.04, 2) if args.small else np.linspace(0.02, 0.06, 9)  # m
setup = setup_of("granular", None, {})
motor, sand, hard = setup.motor, setup.model, rigid(setup.model)
limits = Limits(motor.max_force, motor.max_speed, motor.stroke)
planner = {m.ground: Planner(m, Drive(motor.kp, motor.kd), limits) for m in (hard, sand)}
plans = {ground: ladder(p, apex.tolist()).plans for ground, p in planner.items()}


def jumped(made_for, model, rng):
    """Heights [m] over (apex, robot) that the plans made for a ground reach on 8 robots around a model."""
    values = {**vars(model.parameters), **vars(model)}
    sigma = {
        n: s * values[n]
        for n, s in UNKNOWN.items()
        if model.ground == "granular" or n in ("motor_mass", "spring_stiffness")
    }
    robots = [perturbed(model, sigma, rng) for _ in range(8)]
    return np.array(
        [[planner[model.ground].resimulate(p.command, m)[0].jump_height for m in robots] for p in plans[made_for]]
    )


rng = np.random.default_rng(0)
groups = {
    "rigid plan, rigid ground": (jumped("hard", hard, rng), "3.4 ± 1.5 mm"),
    "granular plan, sand": (jumped("granular", sand, rng), "3.9 ± 2.1 mm, 6.6 %"),
    "rigid plan, sand": (jumped("hard", sand, rng), "40.6 %"),
}
found = {}
for name, (height, theirs) in groups.items():
    off = np.abs(height - apex[:, None])
    found[f"{name}: error of the height, mean and deviation mm, %"] = (
        (1e3 * off.mean(), 1e3 * off.std(), 100.0 * (off / apex[:, None]).mean()),
        theirs,
    )
worst = max(abs(p.resimulated_apex - p.apex) for some in plans.values() for p in some)
found["greatest miss of a plan by its own model, µm"] = (1e6 * worst, None)

figure, axis = plt.subplots(figsize=(5, 5), layout="constrained")
axis.plot(1e3 * apex, 1e3 * apex, "k:")
for name, (height, _) in groups.items():
    axis.errorbar(1e3 * apex, 1e3 * height.mean(axis=1), 1e3 * height.std(axis=1), fmt="o", capsize=3, label=name)
axis.set(xlabel="planned height [mm]", ylabel="height jumped [mm]")
axis.legend()
save(figure, compare(found), args.out)
