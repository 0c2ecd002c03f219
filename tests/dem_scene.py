"""The closed loop: discs under the foot of a jumper, their film, its analysis, and the discs' own truth.

The discs' own numbers use neither the gridding nor the momentum code: the field is that of the nearest disc on a fine
raster, with the displacement between two frames as its velocity.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr

from jumpvision.cli import main
from jumpvision.experiment.results.fields import Piv
from jumpvision.laboratory import write
from jumpvision.laboratory.dem.discs import Discs
from jumpvision.laboratory.dem.motion import Friction, Motion, discs_under_foot
from jumpvision.laboratory.films.discs import DiscCamera, disc_momentum
from jumpvision.laboratory.films.grains import View
from jumpvision.laboratory.jumper import Law as Drive
from jumpvision.laboratory.jumper import motion_of
from jumpvision.laboratory.samples import PHASE, SAND_ROBOT, SAND_TERMS, SAND_TRUTH, START
from jumpvision.thesis.studies.sand.disc_field import field_of_discs

RATE, EXPOSURE, INSTANTS = 500.0, 2e-4, 3
DENSITY, PHI = 1000.0, 0.57  # kg/m^3 of the grains and volume fraction that the analysis is told
ROUGH = {"fraction": 0.55, "friction": 0.5, "coulomb": 150.0}  # a bed in which a front runs ahead and a cone grows
KINDS = {"single": (7.5, 0.0), "stutter": (7.0, 0.0), "delayed_stutter": (7.0, 0.1)}  # Hz, s


@dataclass(frozen=True)
class Scene:
    """foot [m] its half width, bed [m] half width and depth, picture (rows, columns), scale [m/px], fraction: area.

    coulomb [m/s^2]: drag of the carpet; friction: coefficient between grains.
    """

    foot: float = 0.0381
    bed: tuple[float, float] = (0.070, 0.125)
    shape: tuple[int, int] = (464, 520)
    scale: float = 2.5e-4
    grain: float = 1e-3
    fraction: float = 0.72
    surface_row: float = 20.0
    coulomb: float = 10.0
    friction: float = 0.0

    @property
    def axis(self) -> float:
        return 0.5 * (self.shape[1] - 1)


def foot_path(kind: str) -> tuple[np.ndarray, np.ndarray]:
    """Times [s] and heights [m] of the foot while it digs deepest in the jump of `kind`, from its depth before on."""
    return landing(kind)[:2]


def landing(kind: str) -> tuple[np.ndarray, np.ndarray, float]:
    """The same, and the height [m] of the floor of the hole that the foot has dug before."""
    frequency, delay = KINDS[kind]
    law = Drive(frequency, 0.01875, PHASE[kind], START, delay=delay)
    m = motion_of(SAND_ROBOT, law, SAND_TERMS, SAND_TRUTH, ground="granular", duration=0.46, bed_density=DENSITY * PHI)
    end = m.t < (m.lift_offs[1] if kind != "single" else m.lift_offs[0])
    begun = START if kind == "single" else m.lift_offs[0] + m.flights[0] - 0.002
    use = end & (m.t >= begun)
    return m.t[use] - m.t[use][0], m.foot[use], float(m.foot[m.t <= begun].min())


def frame_times(n: int) -> np.ndarray:
    """Instants of n exposures [s], (n, INSTANTS), and none else."""
    return np.arange(n)[:, None] / RATE + (np.arange(INSTANTS) + 0.5) / INSTANTS * EXPOSURE


def run_discs(scene: Scene, t: np.ndarray, foot_y: np.ndarray, n: int, seed: int,
              deepest: float | None = None) -> tuple[Discs, Motion]:  # fmt: skip
    """Discs in a bed that the foot has entered, at the instants of n exposures of the foot's path (t, foot_y).

    deepest [m]: height of the floor of the hole from which the foot starts; default: where it starts.
    """
    times = np.concatenate([[0.0], frame_times(n).ravel()])
    return discs_under_foot(
        t, foot_y, times, half_width=scene.foot, bed=scene.bed, diameter=scene.grain, fraction=scene.fraction,
        friction=Friction(scene.coulomb, scene.friction), rng=np.random.default_rng(seed), deepest=deepest,
    )  # fmt: skip


def mid_exposure(m: Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Time, x, y of the discs and height of the foot in the middle of each exposure."""
    k = slice(1 + INSTANTS // 2, None, INSTANTS)
    return m.t[k], m.x[k], m.y[k], m.foot_y[k]


def write_folder(folder: Path, scene: Scene, d: Discs, m: Motion, seed: int) -> None:
    """An experiment folder with the film of the discs."""
    folder.mkdir(parents=True)
    rng = np.random.default_rng([seed, 1])
    camera = DiscCamera(scene.shape, d.radius, scale=scene.scale, surface_row=scene.surface_row, axis_column=scene.axis,
                        half_width=scene.foot, height=0.012, glare=25.0, rng=rng)  # fmt: skip
    n = (len(m.t) - 1) // INSTANTS
    frames = []
    for k in range(n):
        at = slice(1 + k * INSTANTS, 1 + (k + 1) * INSTANTS)
        mean = camera.frame(m.x[at], m.y[at], m.foot_y[at])
        frames.append(camera.record(mean, electrons_per_grey=60.0, read_noise=1.0, rng=rng))
    write.film(folder / "grains.mkv", np.stack(frames), rate=RATE)
    face = mid_exposure(m)[3][0]
    write.toml(folder / "experiment.toml", {
        "ground": "granular",
        "robot": {"foot_radius": scene.foot},
        "bed": {"volume_fraction": PHI, "grain_density": DENSITY},
        "grain_video": {"file": "grains.mkv", "frame_rate": RATE, "scale": scene.scale, "axis_column": scene.axis,
                        "foot_row": float(scene.surface_row - face / scene.scale), "foot": "half"},
        "params.flow": {"initial_depth": float(-face)},
    })  # fmt: skip


def analysed(folder: Path, results: Path) -> dict[str, xr.Dataset]:
    """The project's own analysis of the folder."""
    try:
        code = main(["fit", str(folder), "--results", str(results)])
    except SystemExit as end:
        code = end.code
    assert not code, f"jumpvision fit {folder}: exit code {code}"
    return {name: xr.load_dataset(results / f"{name}.nc", decode_times=False) for name in ("piv", "flow", "column")}


def true_momentum(scene: Scene, d: Discs, m: Motion) -> dict[str, np.ndarray]:
    """Momentum over the frames' pairs [kg m/s]: `field` at constant density, the integral of docs/physics.md section 4,
    and `grains` with the density the discs really have."""
    t, x, y, face = mid_exposure(m)
    view = View(scene.shape, scene.scale, scene.surface_row, scene.axis)
    field = disc_momentum(view, t, x, y, face, diameter=scene.grain, bed_density=DENSITY * PHI)
    left, right = (-0.5 - scene.axis) * scene.scale, (scene.shape[1] - 0.5 - scene.axis) * scene.scale
    bottom = -(scene.shape[0] - 0.5 - scene.surface_row) * scene.scale
    grains = []
    for k in range(len(t) - 1):
        at = np.stack([0.5 * (x[k] + x[k + 1]), 0.5 * (y[k] + y[k + 1])], axis=1)
        speed = -(y[k + 1] - y[k]) / (t[k + 1] - t[k])
        top = 0.5 * (face[k] + face[k + 1])
        inside = (at[:, 0] > left) & (at[:, 0] < right) & (at[:, 1] > bottom) & (at[:, 1] < top)
        area = math.pi * d.radius**2 / scene.fraction
        grains.append(0.5 * math.pi * DENSITY * PHI * np.sum((speed * np.abs(at[:, 0]) * area)[inside]))
    return {"field": field, "grains": np.array(grains)}


def disc_field(scene: Scene, d: Discs, m: Motion, step: float, width: float) -> Piv:
    """The discs' coarse-grained field over the picture, as stage piv gives one."""
    t, x, y, face = mid_exposure(m)
    left = (-0.5 - scene.axis) * scene.scale
    bottom = -(scene.shape[0] - 0.5 - scene.surface_row) * scene.scale
    grid_x = np.arange(left + 0.5 * step, -left, step)
    grid_y = np.arange(bottom + 0.5 * step, 0.0, step)
    return field_of_discs(t, x, y, d.mass, face, grid_x=grid_x, grid_y=grid_y, width=width)
