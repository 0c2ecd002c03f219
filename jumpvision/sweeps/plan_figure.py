"""Figure of a planned jump."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.report.figures.pictures import png
from jumpvision.report.style import ACCENT, GREEN, MEASURED, MODEL, QUIET, styled

from .plan import Planned, PlanNumbers

if TYPE_CHECKING:
    from matplotlib.axes import Axes

SHADES = {"stuck": "#00000000", "intrude": "#D5A06033", "air": "#8fc7ff33"}
AFTER = 0.12  # s shown after the apex, or after the command


def end_of(planned: Planned) -> float:
    """Time [s] to which a plan is shown: past its apex and past the end of its command, whichever is later."""
    motion = planned.plan.motion
    return max(float(motion.t[np.argmax(motion.rod)]), planned.plan.command.stop) + AFTER


def plan_picture(planned: Planned) -> bytes:
    """Command and motor, rod and foot, their speeds, motor force and power against time, with the phases shaded; PNG.

    Beside a landing that sticks the single jump to the same apex; beside a plan the jump that played it.
    """
    plan, planner = planned.plan, planned.planner
    motion = plan.motion
    show = motion.t <= end_of(planned)
    t, X = motion.t[show], (motion.motor - motion.rod)[show]
    with styled() as Figure:
        figure = Figure(figsize=(7.2, 8.2), layout="constrained")
        motor, body, speed, effort = axes = figure.subplots(4, 1, sharex=True, height_ratios=(1.2, 1.2, 1, 1))
        motor.plot(1e3 * t, 1e3 * plan.command(t)[0], color=QUIET, ls="--", label="command")
        motor.plot(1e3 * t, 1e3 * X, color=MEASURED, label="motor")
        motor.set(ylabel="motor on the rod [mm]", title=_title(planned.numbers))
        _bodies(body, planned, show)
        _speeds(speed, planned, t, np.gradient(X, t))
        force, power = _effort(planned, t, X, show)
        effort.plot(1e3 * t, force, color=ACCENT, label="motor force [N]")
        effort.plot(1e3 * t, power, color=MEASURED, lw=1.0, label="motor power [W]")
        effort.set(xlabel="time [ms]", ylabel="force [N], power [W]")
        for other, color, name in _others(planned, t[-1]):
            motor.plot(1e3 * other[0], 1e3 * other[1], color=color, lw=1.0, label=name)
            body.plot(1e3 * other[2], 1e3 * other[3], color=color, lw=1.0, label=f"rod, {name}")
        for axis in axes:
            _phases(axis, planner.sequence, plan.durations)
            axis.legend(loc="best", fontsize=7, ncols=2)
        return png(figure)


def _bodies(axis: Axes, planned: Planned, show: NDArray[np.bool_]) -> None:
    """Rod and foot against time [ms], and the height that was asked for."""
    motion, numbers = planned.plan.motion, planned.numbers
    t = 1e3 * motion.t[show]
    axis.plot(t, 1e3 * (motion.rod[show] - motion.rest), color=MODEL, label="rod over rest")
    axis.plot(t, 1e3 * motion.foot[show], color=GREEN, label="foot")
    wanted, height = ("apex wanted", numbers.apex_m) if numbers.clear_m is None else ("obstacle", numbers.clear_m)
    axis.axhline(1e3 * height, color=QUIET, lw=0.8, ls=":", label=wanted)
    axis.set(ylabel="height [mm]")


def _speeds(axis: Axes, planned: Planned, t: Array, V: Array) -> None:
    """Speed of the foot against time, on sand in the scale of its way into it; on hard ground beside the motor's."""
    motion = planned.plan.motion
    foot = motion.foot_velocity[: t.size]
    axis.plot(1e3 * t, 1e3 * foot, color=GREEN, label="foot")
    axis.axhline(0.0, color=QUIET, lw=0.8)
    axis.set(ylabel="speed [mm/s]")
    flown = motion.flights[:, 0]
    before = t < (flown[0] if flown.size else np.inf)
    if planned.numbers.ground == "granular" and (most := float(np.abs(foot[before]).max(initial=0.0))) > 0.0:
        axis.set_ylim(-1.2e3 * most, 0.6e3 * most)
    else:
        axis.plot(1e3 * t, 1e3 * V, color=MEASURED, lw=1.0, label="motor on the rod")


def _effort(planned: Planned, t: Array, X: Array, show: NDArray[np.bool_]) -> tuple[Array, Array]:
    """Motor force [N] and power [W]."""
    plan, m, d = planned.plan, planned.planner.model, planned.planner.drive
    (x_c, v_c), V = plan.command(t), np.gradient(X, t)
    if d.kp > 0:
        force = d.kp * (x_c - X) + d.kd * (v_c - V) + m.m_m * m.g
    else:
        force = m.m_m * (np.gradient(np.gradient(plan.motion.motor[show], t), t) + m.g)
    return force, force * V


Track = tuple[Array, Array, Array, Array]  # times and motor on the rod, times and rod over rest [s, m]


def _others(planned: Planned, end: float) -> Iterator[tuple[Track, str, str]]:
    """What is drawn beside a plan, with its colour and name."""
    if planned.beside is not None:
        m = planned.beside.motion
        show = m.t <= end
        yield (m.t[show], (m.motor - m.rod)[show], m.t[show], (m.rod - m.rest)[show]), ACCENT, "single jump"
    if planned.recorded is not None:
        r = planned.recorded
        t, rod, _ = r.rod.arrays
        ran, seen = ((x >= r.late) & (x <= r.late + end) for x in (r.motor_t, t))
        name = f"{r.name}, recorded ({_signed(planned.numbers.overshoot_m)} mm)"
        yield (r.motor_t[ran] - r.late, r.motor[ran], t[seen] - r.late, rod[seen]), "black", name


def _signed(height: float | None) -> str:
    return "" if height is None else f"{1e3 * height:+.1f}"


def _title(n: PlanNumbers) -> str:
    if n.highest_apex_m is not None:
        return f"highest jump found: {1e3 * n.highest_apex_m:.1f} mm; {1e3 * n.apex_m:.1f} mm wanted"
    if n.clear_m is not None and n.clear_s is not None:
        return f"{1e3 * n.clear_s:.0f} ms above {1e3 * n.clear_m:.1f} mm on {n.ground} ground, {n.objective}"
    return f"apex {1e3 * n.apex_m:.1f} mm on {n.ground} ground, {n.objective}"


def _phases(axis: Axes, sequence: tuple[str, ...], durations: Array) -> None:
    ends = 1e3 * np.cumsum(durations)
    for mode, begin, end in zip(sequence, [0.0, *ends], ends):
        axis.axvspan(begin, end, color=SHADES[mode], lw=0)
