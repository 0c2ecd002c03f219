"""A grain film of a simulated jump as a recording: the file, its section and its truth."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from . import write
from .grain_film import GrainCamera, View
from .grain_flow import Flow
from .grain_quick import QuickGrainCamera
from .jumper import Motion
from .sensor import record, record_bright

Array = NDArray[np.float64]

GRAIN_RATE = 500.0  # 1/s


def film_brief(grains: Mapping[str, Any]) -> dict[str, float]:
    """What summary.json should say of a grain film; the added mass is the one in view when the momentum is largest."""
    peak = int(np.argmax(grains["pairs"]["momentum_in_view_kg_m_s"]))
    mass = float(grains["pairs"]["added_mass_in_view_kg"][peak])
    return {"mu": grains["mu"], "beta_deg": grains["beta_deg"], "added_mass_kg": mass}


def write_grain_film(
    folder: Path,
    motion: Motion,
    bed_density: float,
    rng: np.random.Generator,
    *,
    radius: float,
    mu: float,
    theta: float,
    C: float,
    diameter: float,
    n: int = 58,
    shape: tuple[int, int] = (464, 396),
    quick: bool = False,
) -> tuple[dict[str, Any], float, dict[str, Any]]:
    """grains.mkv around the first landing and the push-off: its section, the foot's depth in frame 0 [m], its truth.

    bed_density: phi rho [kg/m^3]; radius of the foot, diameter of the grains [m]; mu, theta, C of the cone; n frames;
    quick: by `grain_quick`.
    """
    exposure, subs = 0.0005, 4
    landing = motion.lift_offs[0] + motion.flights[0]
    start = round(float(landing) - 0.004, 3)
    view = View(shape=shape, scale=3e-4, surface_row=47.0, axis_column=0.5 * shape[1] - 2.5)
    before = motion.t <= start
    z_start = float(-motion.foot[before].min())
    z_end = float(-motion.foot.min())
    flow = Flow(
        R=radius,
        mu=mu,
        theta=theta,
        C=C,
        beta=math.radians(45.0),
        layer=0.008,
        z_range=(z_start, z_end),
    )
    camera = (QuickGrainCamera if quick else GrainCamera)(view, flow, z_start, diameter=diameter, spread=0.15, rng=rng)
    first = start + np.arange(n)[:, None] / GRAIN_RATE
    depths = -motion.at("foot", first + (np.arange(subs) + 0.5) / subs * exposure)
    expose = record_bright if quick else record
    frames = np.stack([expose(camera.frame(z), electrons_per_grey=60.0, read_noise=1.0, rng=rng) for z in depths])
    write.film(folder / "grains.mkv", frames, rate=GRAIN_RATE)

    time = first[:, 0] + 0.5 * exposure
    depth_0 = -float(motion.at("foot", time[:1])[0])
    section = {
        "file": "grains.mkv",
        "frame_rate": GRAIN_RATE,
        "scale": view.scale,
        "foot_row": round(float(view.row(-depth_0)), 3),
        "axis_column": view.axis_column,
        "foot": "half",
        "start": start,
    }
    true = {
        "conventions": "foot_speed is downward; momentum and added mass are those of the half foot (pi r dr dh), zero "
        "momentum while the grains rest; in_view: r up to the picture's edges, mean of both half-planes, from the "
        "face to the lower edge; front: thickness below the face at 0.9 of the foot's speed or more, on the axis",
        "beta_deg": 45.0,
        "layer_m": flow.layer,
        "mu": flow.mu,
        "theta_deg": math.degrees(flow.theta),
        "C": flow.C,
        "surface_row_px": view.surface_row,
        "exposure_s": exposure,
        "frames": flow_truth(flow, view, motion, time, bed_density),
        "pairs": flow_truth(flow, view, motion, time[:-1] + 0.5 / GRAIN_RATE, bed_density),
    }
    return section, depth_0, true


def flow_truth(flow: Flow, view: View, motion: Motion, time: Array, bed_density: float) -> dict[str, Array]:
    """Columns of the grain film's truth at the times given [s], shape (n,)."""
    foot, rate = motion.at("foot", time), motion.at("foot_rate", time)
    deepest = np.array([motion.foot[motion.t <= t].min() for t in time])
    moving = (foot <= deepest + 1e-7) & (rate < 0)
    out: dict[str, list[float]] = {}
    for z, v, go in zip(-foot, -rate, moving):
        row = flow.truth(
            float(z),
            float(v) if go else 0.0,
            bed_density=bed_density,
            left=(view.axis_column + 0.5) * view.scale,
            right=(view.shape[1] - 0.5 - view.axis_column) * view.scale,
            bottom=(view.shape[0] - 0.5 - float(view.row(-z))) * view.scale,
        )
        row["front_m"] = flow.front(float(z), 0.9)
        for name, value in row.items():
            out.setdefault(name, []).append(value)
    columns = {name: np.array(values) for name, values in out.items()}
    rows = np.asarray(view.row(foot))
    still = {"time_s": time, "foot_row_px": rows, "foot_depth_m": -foot, "foot_speed_m_s": -rate}
    return still | {"grains_move": moving} | columns
