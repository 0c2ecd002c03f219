"""The actuator against its command: of one experiment in time, of a campaign over frequency (thesis Fig 19c)."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..digits import measured
from ..logs import read_log
from ..records import Fits
from ..sections import Actuation, MotorLog, NotApplicable
from ..stage import stage
from ..stages.motor import commanded, read_motor
from .pictures import Picture, png
from .style import ACCENT, MEASURED, MODEL, QUIET, styled


class MotorPicture(Picture):
    file = "motor.png"


@stage(version=1, picture=True)
def motor_picture(fits: Fits, log: MotorLog, law: Actuation) -> MotorPicture:
    """Encoder and command, their difference, and where force was logged the work it does."""
    v = fits.values
    if (v.get("actuator_ratio") or {}).get("value") is None:
        raise NotApplicable(["motor_picture needs a log from rest to rest"])
    t, position = read_motor(log, law)
    shown = (t > law.start - 0.05) & (t < law.stop + 0.1)
    t, position = t[shown], position[shown]
    command = commanded(law)(t)[0]
    logged = read_log(log.path, "time_s", "position_m", optional=("force_N",))
    force = logged.force_N.to_numpy()[shown] if "force_N" in logged else None
    with styled() as Figure:
        panels = 3 if force is not None and "motor_work_J" in v else 2
        figure = Figure(figsize=(3.3 * panels, 3.2), layout="constrained")
        axes = figure.subplots(1, panels)
        axes[0].plot(t, command * 1e3, color=MODEL, label="command")
        axes[0].plot(t, position * 1e3, ".", ms=2, color=MEASURED, label="encoder")
        axes[0].legend()
        ratio, lag = v["actuator_ratio"], v["actuator_lag_s"]
        axes[0].set(title=f"ratio {measured(ratio['value'], ratio['sigma'])}", ylabel="motor on the rod [mm]")
        axes[1].plot(t, (position - command) * 1e3, color=MEASURED, lw=0.8)
        axes[1].set(title=f"lag {measured(lag['value'], lag['sigma'], 1e3)} ms", ylabel="encoder − command [mm]")
        if force is not None and "motor_work_J" in v:
            work = np.r_[0.0, np.cumsum(0.5 * (force[1:] + force[:-1]) * np.diff(position))]
            axes[2].plot(t, work, color=MEASURED)
            done, peak = v["motor_work_J"], v.get("peak_power_W") or {"value": None, "sigma": None}
            axes[2].axhline(done["value"], color=QUIET, lw=0.8, ls="--")
            title = f"work {measured(done['value'], done['sigma'])} J"
            if peak["value"] is not None:
                title += f"\npeak power {measured(peak['value'], peak['sigma'])} W"
            axes[2].set(title=title, ylabel="work of the motor's force [J]")
        for axis in axes:
            axis.axvspan(law.start, law.stop, color=ACCENT, alpha=0.12, lw=0)
            axis.set_xlabel("time [s]")
        return MotorPicture(png(figure))


def actuator(rows: list[dict[str, Any]], fit: dict[str, Any], Figure: Any) -> Any:
    """Amplitude ratio with the -3 dB level and the bandwidth, and lag, both with 2 sigma."""
    figure = Figure(figsize=(8.6, 3.2), layout="constrained")
    left, right = figure.subplots(1, 2)
    f = np.array([r["frequency_hz"] for r in rows])
    for axis, name, factor in ((left, "actuator_ratio", 1.0), (right, "actuator_lag_s", 1e3)):
        value, sigma = (np.array([r[k] for r in rows]) * factor for k in (name, f"{name}_sigma"))
        axis.errorbar(f, value, 2 * sigma, fmt="o", ms=4, lw=0.8, color=MEASURED)
        axis.set(xlabel="frequency [Hz]")
    gain, cut = fit["gain"]["value"], fit["bandwidth_hz"]
    if gain is not None:
        left.axhline(gain / np.sqrt(2), color=QUIET, lw=0.8, ls="--", label="−3 dB")
    if cut["value"] is not None:
        left.axvspan(*fit["bandwidth_ci95_hz"], color=MODEL, alpha=0.2, lw=0)
        left.axvline(cut["value"], color=MODEL, lw=0.8, label=f"{measured(cut['value'], cut['sigma'])} Hz")
    left.set(title="encoder / command", ylabel="amplitude ratio")
    left.legend()
    right.set(title="lag behind the command", ylabel="lag [ms]")
    return figure
