"""The figure of planning.md (thesis Figs 65 and 66): `python docs/planning.py` writes docs/images/planning.png."""

from __future__ import annotations

import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")
sys.path.insert(0, str(Path(__file__).parents[1]))

import numpy as np

from benchmarks.plan import LIMITS, LOOP, SAND
from jumpvision.jumper.planning.plan import Planner
from jumpvision.report.figures.pictures import png
from jumpvision.report.style import MEASURED, MODEL, styled
from jumpvision.thesis.studies.plan import rigid

OUT = Path(__file__).parent / "images" / "planning.png"
LADDER = (0.02, 0.03, 0.04, 0.05, 0.06)


def main() -> None:
    """Motor against time of the plans for 20 to 60 mm on both grounds, and a landing that sticks."""
    with styled() as Figure:
        import matplotlib as mpl

        figure = Figure(figsize=(10.0, 6.0), layout="constrained")
        axes = figure.subplots(2, 3)
        for row, objective in zip(axes, ("effort", "power")):
            for axis, model in zip(row, (rigid(SAND), SAND)):
                planner = Planner(model, LOOP, LIMITS, objective)
                for i, apex in enumerate(LADDER):
                    plan = planner.plan(apex)
                    t = np.linspace(0.0, plan.command.stop, 400)
                    X = np.interp(t, plan.motion.t, plan.motion.motor - plan.motion.rod)
                    axis.plot(1e3 * t, 1e3 * X, color=mpl.colormaps["viridis"](i / 5), label=f"{1e3 * apex:.0f} mm")
                axis.set(title=f"{model.ground} ground, least {objective}", xlabel="time [ms]")
            row[0].set_ylabel("motor on the rod [mm]")
        axes[0, 0].legend(fontsize=7)
        sticks(axes[:, 2])
        OUT.write_bytes(png(figure))


def sticks(axes: np.ndarray) -> None:
    """Rod and motor of a jump that lands and stands, beside a single jump."""
    for motion, color in (("single", MODEL), ("stick", MEASURED)):
        plan = Planner(rigid(SAND), LOOP, LIMITS, motion=motion).plan(0.04)
        m = plan.motion
        show = m.t < 0.7
        axes[0].plot(1e3 * m.t[show], 1e3 * (m.rod - m.rest)[show], color=color, label=motion)
        axes[1].plot(1e3 * m.t[show], 1e3 * (m.motor - m.rod)[show], color=color)
    axes[0].set(title="hard ground: rod over rest [mm]", xlabel="time [ms]")
    axes[1].set(title="motor on the rod [mm]", xlabel="time [ms]")
    axes[0].legend(fontsize=7)


if __name__ == "__main__":
    main()
