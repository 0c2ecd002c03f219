"""A grain film of a simulated jump as a recording: the file, its section and its truth."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from jumpvision.base.arrays import Array
from jumpvision.laboratory import write
from jumpvision.laboratory.jumper import Motion
from jumpvision.laboratory.protocol import GrainFilm
from jumpvision.laboratory.write import Recording, Table

from .flow import Cone, Flow
from .grains import GrainScene, QuickGrainScene, View
from .optics import BedCamera, GrainCamera, distorted, exposed, lens_of, margin, reflection, seen_places, shade

CONE, FILM, GOOD = Cone(), GrainFilm(), GrainCamera()  # of the samples
Columns = dict[str, NDArray[Any]]


def mass_at_peak(pairs: Columns) -> float:
    """The added mass in view when the momentum in view is largest [kg], of the pairs that have one: the foot moves."""
    mass = pairs["added_mass_in_view_kg"]
    return float(mass[int(np.argmax(np.where(mass > 0.0, pairs["momentum_in_view_kg_m_s"], -np.inf)))])


@dataclass(frozen=True)
class FlowTruth:
    """What is true of a film of the prescribed flow, in every frame and between two."""

    conventions: str
    beta_deg: float
    layer_m: float
    mu: float
    theta_deg: float
    C: float
    surface_row_px: float
    exposure_s: float
    frames: Columns
    pairs: Columns


class Clock:
    """Which frames of a film were kept and when they were taken: number (n,), the stamp of their exposure's begin and
    the time it shows (n,) [s]."""

    def __init__(self, start: float, film: GrainFilm, camera: GrainCamera, rng: np.random.Generator):
        lost = rng.random(film.frames) < camera.dropped if camera.dropped else np.zeros(film.frames, bool)
        lost[0] = False
        self.number = np.flatnonzero(~lost)
        self.stamp: Array = start + self.number / film.rate
        self.shown: Array = self.stamp + camera.clock_offset + camera.clock_drift * self.stamp
        faulty = bool(camera.clock_offset or camera.clock_drift)
        self.extra = ({"frame": self.number} if camera.dropped else {}) | ({"shown_s": self.shown} if faulty else {})


class Glass:
    """Lens, darker corners and reflection between the grains and the chip."""

    def __init__(self, view: View, camera: GrainCamera | BedCamera):
        self.view, self.lens = view, lens_of(camera.k1, camera.k2, view.shape)
        m = margin(view.shape, self.lens)
        self.wide = View(
            (view.shape[0] + 2 * m, view.shape[1] + 2 * m), view.scale, view.surface_row + m, view.axis_column + m
        )
        self.light = shade(view.shape, camera.shading) if camera.shading else None
        self.glare = reflection(view.shape, camera.glare) if camera.glare else None

    def __call__(self, wide: NDArray[Any]) -> NDArray[Any]:
        """What the chip sees of a picture drawn in the view `wide`."""
        image = distorted(wide, self.lens, self.view.shape)
        if self.light is not None:
            image = image * self.light
        return image if self.glare is None else image + self.glare

    def tables(self, depth: float, start: float, rate: float, camera: GrainCamera) -> dict[str, Table]:
        """[grain_video] of grains.mkv from the time `start` [s] on at `rate` [1/s], its places as read off the first
        picture, where the foot's depth is `depth` [m], and that depth for [params.flow]."""
        row, column = seen_places(np.array([float(self.view.row(-depth))]), self.view.axis_column, self.lens)
        section: Table = {
            "file": "grains.mkv",
            "frame_rate": rate,
            "scale": self.view.scale * (1 + camera.scale_error),
            "foot_row": round(float(row[0]), 3),
            "axis_column": round(float(column[0]), 3),
            "foot": "half",
            "start": start,
        }
        return {"grain_video": section, "params.flow": {"initial_depth": round(depth, 6)}}


def start_of(motion: Motion) -> float:
    """Begin of a grain film [s]: just before the first landing, on a whole millisecond."""
    return round(float(motion.lift_offs[0] + motion.flights[0]) - 0.004, 3)


def write_grain_film(
    folder: Path,
    motion: Motion,
    bed_density: float,
    rng: np.random.Generator,
    *,
    radius: float,
    diameter: float,
    cone: Cone = CONE,
    film: GrainFilm = FILM,
    camera: GrainCamera = GOOD,
    quick: bool = False,
    start: float | None = None,
) -> Recording:
    """grains.mkv from `start` [s], by itself around the first landing and the push-off.

    bed_density: phi rho [kg/m^3]; radius of the foot, diameter of the grains [m]; camera: its faults; quick: by
    `QuickGrainScene`.
    """
    exposure, subs = 0.0005, 4
    start = start_of(motion) if start is None else start
    shape = (film.rows, film.columns)
    view = View(shape=shape, scale=film.scale, surface_row=47.0, axis_column=0.5 * shape[1] - 2.5)
    glass = Glass(view, camera)
    before = motion.t <= start
    z_start = float(-motion.foot[before].min())
    z_end = float(-motion.foot.min())
    flow = Flow(R=radius, **cone._asdict(), beta=math.radians(45.0), layer=0.008, z_range=(z_start, z_end))
    scene_of = QuickGrainScene if quick else GrainScene
    scene = scene_of(glass.wide, flow, z_start, diameter=diameter, spread=0.15, rng=rng)
    clock = Clock(start, film, camera, rng)
    depths = -motion.at("foot", clock.shown[:, None] + (np.arange(subs) + 0.5) / subs * exposure)
    frames = np.stack([exposed(glass(scene.frame(z)), camera, rng, bright=quick) for z in depths])
    write.movie(folder / "grains.mkv", frames, rate=film.rate, numbers=clock.number, bits=camera.bits)

    time, shown = clock.stamp + 0.5 * exposure, clock.shown + 0.5 * exposure
    true = FlowTruth(
        conventions="foot_speed is downward; momentum and added mass are those of the half foot (pi r dr dh), zero "
        "momentum while the grains rest; in_view: r up to the picture's edges, mean of both half-planes, from the "
        "face to the lower edge; front: thickness below the face at 0.9 of the foot's speed or more, on the axis",
        beta_deg=45.0,
        layer_m=flow.layer,
        mu=flow.mu,
        theta_deg=math.degrees(flow.theta),
        C=flow.C,
        surface_row_px=view.surface_row,
        exposure_s=exposure,
        frames=flow_truth(flow, view, motion, shown, bed_density) | {"time_s": time} | clock.extra,
        pairs=flow_truth(flow, view, motion, middle(shown), bed_density) | {"time_s": middle(time)},
    )
    truth = {"mu": true.mu, "beta_deg": true.beta_deg, "added_mass_kg": mass_at_peak(true.pairs)}
    tables = glass.tables(-float(motion.at("foot", shown[:1])[0]), start, film.rate, camera)
    return Recording(tables, {"grain_film": true}, truth)


def middle(t: Array) -> Array:
    """Middle of each pair."""
    return np.asarray(0.5 * (t[1:] + t[:-1]))


def flow_truth(flow: Flow, view: View, motion: Motion, time: Array, bed_density: float) -> Columns:
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
