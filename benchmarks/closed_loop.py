"""The closed loop: discs under a jumper's foot, filmed, measured by `jumpvision fit`, beside the discs' own motion.

    python -m benchmarks.closed_loop      # 16,000 discs, 34 to 80 frames, three jumps: about 10 minutes on one core

Every number comes with its truth: the discs' displacements, on a raster of nearest discs (momentum), or coarse-grained
and put through the same column and shear code (front and band angle, which need a field).
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import xarray as xr

from jumpvision.fit.line import fit_line_robust
from jumpvision.lab.dem_film import DiscCamera
from jumpvision.params import ColumnParams, FlowParams
from jumpvision.records import Column, Flow, Piv
from jumpvision.sections import Bed, GrainVideo
from jumpvision.stages.column import column
from jumpvision.stages.cone import cone_fits
from jumpvision.stages.flow import flow

sys.path.insert(0, "tests")
import dem_scene as loop

STEP, WIDTH = 2e-3, 1.5e-3  # m: grid and kernel of the discs' own field; the kernel acts like PIV's 24 px window


def own(scene: loop.Scene, d, m) -> tuple[Flow, Column]:
    """The discs' own field through the stages flow and column."""
    piv = Piv(loop.disc_field(scene, d, m, STEP, WIDTH))
    film = GrainVideo(file="discs", frame_rate=loop.RATE, scale=STEP, foot="half")
    bed = Bed(volume_fraction=loop.PHI, grain_density=loop.DENSITY)
    depth = -float(loop.mid_exposure(m)[3][0])
    found = flow(piv, film, bed, None, p=FlowParams(initial_depth=depth))
    return found, column(piv, found, p=ColumnParams())


def band_angle(field: xr.Dataset, foot_y: float, half_width: float) -> float:
    """Angle [deg] against the horizontal of the two bands of shear that start at the foot's edges; NaN where none.

    In each row down to one half width below the face the column of the greatest shear rate on either side; a straight
    line through them, both sides taken together.
    """
    depth, reach = [], []
    for side in (-1, 1):
        part = field.where((side * field.x > 0.1 * half_width) & (side * field.x < 1.2 * half_width), drop=True)
        for y in part.y.values:
            if not 0.004 < foot_y - y < half_width:
                continue
            row = part.shear_rate.sel(y=y).values
            if np.isfinite(row).sum() > 3:
                depth.append(foot_y - y)
                reach.append(abs(float(part.x.values[int(np.nanargmax(row))])))
    if len(depth) < 8:
        return math.nan
    line = fit_line_robust(np.array(depth), np.array(reach), np.full(len(depth), 2e-3), reject=4.0)
    return math.degrees(math.atan2(1.0, -line.slope))


def angles(field: xr.Dataset, foot_y: np.ndarray, frames: np.ndarray, half_width: float) -> np.ndarray:
    """Band angle of the given frames."""
    return np.array([band_angle(field.isel(t=k), float(foot_y[k]), half_width) for k in frames])


def one(kind: str, scene: loop.Scene, folder: Path) -> dict[str, float]:
    """Everything about one jump."""
    t, foot_y = loop.foot_path(kind)
    n = int((t[-1] - loop.EXPOSURE) * loop.RATE)
    d, m = loop.run_discs(scene, t, foot_y, n, seed=1)
    loop.write_folder(folder / kind, scene, d, m, seed=1)
    seen = loop.analysed(folder / kind, folder / f"{kind}-results")
    truth = loop.true_momentum(scene, d, m)
    own_flow, own_column = own(scene, d, m)
    got, sigma = seen["flow"].momentum.values, seen["flow"].momentum_sigma.values
    large = np.abs(truth["field"]) > 0.1 * truth["field"].max()
    ratio, pull = got / np.where(large, truth["field"], np.nan) - 1.0, (got - truth["field"]) / sigma
    own_fit, piv_fit = cone_fits(own_column), cone_fits(Column(seen["column"]))
    pushing = np.flatnonzero((seen["flow"].foot_speed.values > 0.2) & large)
    foot = seen["piv"].foot_y.values
    theta = [angles(f, foot, pushing, scene.foot) for f in (own_flow.field, seen["flow"])]
    both = own_column.field.jammed_thickness.values - seen["column"].jammed_thickness.values
    face = loop.mid_exposure(m)[3]
    speed = -np.diff(face) * loop.RATE
    steady = speed > 0.2
    mass = seen["flow"].added_mass.values[steady] / (truth["field"] / np.where(steady, speed, 1.0))[steady] - 1.0
    return {
        "frames": len(got),
        "peak grain momentum, discs [g m/s]": 1e3 * truth["field"].max(),
        "peak grain momentum, film [g m/s]": 1e3 * got.max(),
        "momentum: greatest error above a tenth of the peak [%]": 100 * np.abs(ratio[large]).max(),
        "momentum: rms error there [%]": 100 * math.sqrt(np.mean(ratio[large] ** 2)),
        "momentum: frames inside 2 sigma [%]": 100 * np.mean(np.abs(pull) < 2),
        "added mass: rms error at foot speeds above 0.2 m/s [%]": 100 * math.sqrt(np.nanmean(mass[large[steady]] ** 2)),
        "momentum of the discs with their true density / constant density": float(
            np.sum(truth["grains"][large]) / np.sum(truth["field"][large])
        ),
        "jammed thickness, film - discs, median of the frames [mm]": 1e3 * float(np.nanmedian(both)),
        "jammed thickness, film - discs, half of the frames within [mm]": 1e3 * float(np.nanmedian(np.abs(both))),
        "mu, discs": own_fit["mu"].value,
        "mu, discs: sigma": own_fit["mu"].sigma,
        "mu, film": piv_fit["mu"].value,
        "mu, film: sigma": piv_fit["mu"].sigma,
        "beta, discs [deg]": own_fit["beta_deg"].value,
        "beta, film [deg]": piv_fit["beta_deg"].value,
        "theta, discs, median [deg]": float(np.nanmedian(theta[0])),
        "theta, film, median [deg]": float(np.nanmedian(theta[1])),
        "theta, film - discs, rms of the frames [deg]": math.sqrt(np.nanmean((theta[1] - theta[0]) ** 2)),
        "foot's depth: greatest error [px]": float(
            np.abs(seen["flow"].foot_depth.values + 0.5 * (face[1:] + face[:-1])).max() / scene.scale
        ),
    }


def film_rate() -> float:
    """Frames of 512 x 512 px a second of CPU: 3 instants of 4,000 discs, lens, light and noise."""
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-0.03, 0.03, (3, 4000)), rng.uniform(-0.06, 0.0, (3, 4000))
    camera = DiscCamera((512, 512), np.full(4000, 5e-4), scale=1.2e-4, surface_row=20.0, axis_column=255.5,
                        half_width=0.012, height=0.004, glare=25.0, rng=rng)  # fmt: skip
    best = math.inf
    for _ in range(20):
        began = time.process_time()
        camera.record(camera.frame(x, y, np.full(3, -0.004)), electrons_per_grey=60.0, read_noise=1.0, rng=rng)
        best = min(best, time.process_time() - began)
    return 1.0 / best


def main(*kinds: str) -> None:
    scene = loop.Scene()
    with tempfile.TemporaryDirectory() as folder:
        columns = {kind: one(kind, scene, Path(folder)) for kind in kinds or loop.KINDS}
    print(f"Area fraction {scene.fraction:g}, sliding friction {scene.coulomb:g} m/s^2, grains of 4 px.\n")
    print("| | " + " | ".join(k.replace("_", " ") for k in columns) + " |\n|---|" + "---|" * len(columns))
    for name in next(iter(columns.values())):
        print(f"| {name} | " + " | ".join(f"{c[name]:.3g}" for c in columns.values()) + " |")
    print(f"\nThe film is drawn at {film_rate():.0f} frames of 512 x 512 px a second of one core.")


if __name__ == "__main__":
    main(*sys.argv[1:])
