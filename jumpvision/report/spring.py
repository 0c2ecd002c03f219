"""Figure of a spring test: force against displacement with its line, and what the line leaves over."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..digits import measured
from ..records import Fits, SpringTest
from ..stage import stage
from .pictures import Picture, png
from .style import MEASURED, MODEL, QUIET, styled


class SpringPicture(Picture):
    file = "spring.png"


@stage(version=1, picture=True)
def spring_picture(fit: Fits, spring: SpringTest) -> SpringPicture:
    """Loading and unloading apart; the two lines of a loop; turning points, which are left out, in grey."""
    fits, p = fit.values, {k: np.array(a, float) for k, a in spring.values["profile"].items()}
    x, left = p["displacement_m"] * 1e3, p["force_N"] - p["fitted_N"]
    with styled() as Figure:
        figure = Figure(figsize=(8.6, 3.4), layout="constrained")
        whole, rest = figure.subplots(1, 2, width_ratios=(1.3, 1))
        turning = p["direction"] == 0
        whole.plot(x[turning], p["force_N"][turning], ".", ms=3, color=QUIET, label="_turning")
        for sign, label, color in ((1, "growing displacement", MEASURED), (-1, "falling displacement", MODEL)):
            mine = p["direction"] == sign
            if mine.any():
                order = np.flatnonzero(mine)[np.argsort(x[mine])]
                whole.plot(x[mine], p["force_N"][mine], ".", ms=4, color=color, label=label)
                whole.plot(x[order], p["fitted_N"][order], color=color, lw=0.8)
                rest.plot(x[mine], left[mine], ".", ms=4, color=color)
        rest.axhline(0.0, color=QUIET, lw=0.8)
        whole.legend()
        whole.set(xlabel="displacement [mm]", ylabel="force [N]", title=f"k = {shown(fits['spring_stiffness'])} N/m")
        loop = fits.get("spring_hysteresis_N")
        title = f"hysteresis ±{shown(loop)} N" if loop else "one direction: no hysteresis measured"
        rest.set(xlabel="displacement [mm]", ylabel="measured − line [N]", title=title)
        return SpringPicture(png(figure))


def shown(fit: dict[str, Any]) -> str:
    return measured(fit["value"], fit["sigma"])
