"""Picture of the air through the bed: what the bed needs, what the fan gives (thesis Fig 41)."""

from __future__ import annotations

import numpy as np

from ..physics.fluidisation import Drop
from ..records import Geometry
from ..sections import Fan, NotApplicable
from ..stage import stage
from .pictures import Picture, png
from .style import ACCENT, GREEN, MEASURED, MODEL, QUIET, styled


class AirPicture(Picture):
    file = "air.png"


@stage(version=1, picture=True)
def air_picture(geometry: Geometry, fan: Fan) -> AirPicture:
    """Pressure against air speed: Ergun, Wu, the bed's weight, the fan's curve and where it works."""
    flow, height = geometry.values["fluidisation"], geometry.values["bed_height_m"]
    if flow is None or height is None or not fan.speed:
        raise NotApplicable(
            ["air_picture needs [bed] grain_diameter, a volume fraction, the bed's height and the fan's curve"]
        )
    v = np.linspace(0.0, max(1.6 * flow["onset_wu_m_s"], fan.speed[-1]), 300)
    with styled() as Figure:
        figure = Figure(figsize=(6.0, 3.6), layout="constrained")
        axis = figure.subplots()
        for name, color in (("ergun", QUIET), ("wu", MEASURED)):
            drop = Drop(**flow["laws"][name])
            onset = flow[f"onset_{name}_m_s"]
            axis.plot(v, height * drop(v) / 1e3, color=color, label=f"{name.title()}, onset {onset:.3f} m/s")
            axis.plot(onset, flow["bed_weight_Pa"] / 1e3, "o", color=color, ms=4)
        axis.axhline(flow["bed_weight_Pa"] / 1e3, color=GREEN, ls="--", lw=1, label="weight of the bed")
        axis.plot(fan.speed, np.array(fan.pressure) / 1e3, ".-", color=MODEL, label="fan")
        if fan.loss:
            lifted = np.minimum(height * Drop(**flow["laws"]["wu"])(v), flow["bed_weight_Pa"])
            axis.plot(v, (lifted + fan.loss * v**2) / 1e3, color=MEASURED, ls=":", label="bed (Wu) and duct")
        if flow["fan_speed_m_s"] is not None:
            axis.plot(
                flow["fan_speed_m_s"], flow["fan_pressure_Pa"] / 1e3, "*", ms=11, color=ACCENT, label="works here"
            )
        axis.set_ylim(0.0, 1.15 * max(flow["bed_weight_Pa"], max(fan.pressure)) / 1e3)
        state = "the bed is fluidised" if flow["fluidised"] else "the bed stays at rest"
        axis.set(title=f"air through the bed: {state}", xlabel="superficial air speed [m/s]", ylabel="pressure [kPa]")
        axis.legend()
        return AirPicture(png(figure))
