"""Section 3.4: height against the radius of the foot: static and drag forces grow as R^2, the added mass as R^3."""

import matplotlib.pyplot as plt
import numpy as np
from common import SAND, SINGLE, STUTTER, arguments, compare, save

import jumpvision as jv
from jumpvision.jumper.mechanisms.cone import cone_mass, cone_mass_slope
from jumpvision.jumper.robots import THESIS_ROBOT

args = arguments(__doc__)
radius = np.linspace(0.0254, 0.06, 5 if args.small else 33)  # m
frequency = np.linspace(3.0, 12.0, 37)  # Hz
height = 1e3 * np.array(
    [
        jv.sweep("granular", robot=SAND, foot_radius=radius, frequency=frequency, phase=p).jump_height_m.max(
            "frequency"
        )
        for p in (SINGLE, STUTTER)
    ]
)
bed, model = THESIS_ROBOT["granular"]["bed"], THESIS_ROBOT["granular"]["model"]
cone = {n: model[n] for n in ("C", "mu", "theta")} | {"phi": bed["volume_fraction"], "rho": bed["grain_density"]}
mass = np.array([cone_mass(np, z=1.0, R=r, **cone) for r in radius])  # kg, of the grown cone
drag = model["b"] * np.array([cone_mass_slope(np, z=0.0, R=r, **cone) for r in radius])  # kg/m, at the surface
own = cone_mass(np, z=1.0, R=SAND["foot_radius"], **cone)

rows = compare(
    {
        "power of R of the added mass": (np.polyfit(np.log(radius), np.log(mass), 1)[0], 3),
        "power of R of the drag": (np.polyfit(np.log(radius), np.log(drag), 1)[0], 2),
        "best single jump at 25.4 and 60 mm, mm": (height[0, [0, -1]], None),
        "best stutter jump at 25.4 and 60 mm, mm": (height[1, [0, -1]], None),
        "added mass / mass of this foot": (own / SAND["foot_mass"], "over 4"),
    }
)
figure, axes = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
axes[0].plot(1e3 * radius, height.T, label=["single", "stutter"])
axes[0].set(xlabel="radius of the foot [mm]", ylabel="best height [mm]")
axes[1].loglog(1e3 * radius, mass, label="added mass [kg]")
axes[1].loglog(1e3 * radius, drag, label="drag [kg/m]")
axes[1].set(xlabel="radius of the foot [mm]")
for axis in axes:
    axis.legend()
save(figure, rows, args.out)
