"""The closed loop: discs under a jumper's foot, filmed, measured by `jumpvision fit`, beside the discs' own motion.

    python -m benchmarks.closed_loop      # 12,000 to 16,000 discs, 28 to 80 frames, three jumps, two beds: 15 minutes

Every number comes with its truth from the discs' displacements: on a raster of nearest discs (momentum), or disc by
disc (front and cone: `dem_truth`). The smooth bed (0.72, no friction) has the momentum; the rough one (0.55, friction
0.5) makes a front and a cone.
"""

from __future__ import annotations

import math
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

from jumpvision.experiment.results.fields import Column
from jumpvision.experiment.stages.grains.cone import broader_than_column, cone_fits, front_line, pushing, sides
from jumpvision.laboratory.films.discs import DiscCamera

sys.path.insert(0, "tests")
import dem_scene as loop
from dem_truth import cone_of_discs, crossing, slope

MOVING = 0.1  # m/s: foot speed above which front and cone of the discs are compared


def one(kind: str, scene: loop.Scene, folder: Path) -> dict[str, float]:
    """Everything about one jump."""
    t, foot_y = loop.foot_path(kind)
    n = int((t[-1] - loop.EXPOSURE) * loop.RATE)
    d, m = loop.run_discs(scene, t, foot_y, n, seed=1)
    loop.write_folder(folder / kind, scene, d, m, seed=1)
    seen = loop.analysed(folder / kind, folder / f"{kind}-results")
    truth = loop.true_momentum(scene, d, m)
    got, sigma = seen["flow"].momentum.values, seen["flow"].momentum_sigma.values
    large = np.abs(truth["field"]) > 0.1 * truth["field"].max()
    ratio, pull = got / np.where(large, truth["field"], np.nan) - 1.0, (got - truth["field"]) / sigma
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
        "foot's depth: greatest error [px]": float(
            np.abs(seen["flow"].foot_depth.values + 0.5 * (face[1:] + face[:-1])).max() / scene.scale
        ),
    }


def rough(kind: str, scene: loop.Scene, folder: Path, seed: int = 1) -> dict[str, float]:
    """Front and cone in the rough bed, until the foot stands; the hole is as deep as the foot has dug it before."""
    t, foot_y, floor = loop.landing(kind)
    n = int(t[np.argmin(foot_y)] * loop.RATE) + 3
    d, m = loop.run_discs(scene, t, foot_y, n, seed=seed, deepest=floor)
    loop.write_folder(folder / kind, scene, d, m, seed=seed)
    seen = loop.analysed(folder / kind, folder / f"{kind}-results")
    c, column = cone_of_discs(scene, m), Column(seen["column"])
    fits, f = cone_fits(column), column.field
    use = c.speed > MOVING
    front = np.array([crossing(f.depth.values[:, k], f.speed.values[:, k]) for k in range(f.sizes["t"])])
    push, contour = pushing(column), f.theta_outline_deg.values
    seen_sides = push & np.isfinite(contour) & np.isfinite(c.theta)
    apart = (contour - c.theta)[seen_sides]
    side = sides(f, push)[0]
    broad = broader_than_column(column, fits["theta_deg"], "outline" if side.reason else "cone")
    fitted = front_line(f, push, push & broad).used
    both = use & np.isfinite(front) & np.isfinite(c.front)
    mu, crossed = (slope(c.depth[both], y[both]) for y in (c.front, front))
    mu_fitted = slope(c.depth[fitted], c.front[fitted])
    theta = float(np.mean(c.theta[seen_sides]))
    truth, got = loop.true_momentum(scene, d, m)["field"], seen["flow"].momentum.values
    large, pull = truth > 0.1 * truth.max(), (got - truth) / seen["flow"].momentum_sigma.values
    return {
        "frames in which the foot moves and both have a front": int(both.sum()),
        "mu, discs": mu,
        "mu, film: column's crossing": crossed,
        "mu, film: column's crossing: error [%]": 100 * (crossed / mu - 1.0),
        "front, film's crossing - discs: median [mm]": 1e3 * float(np.nanmedian((front - c.front)[use])),
        "front, film's crossing - discs: standard deviation [mm]": 1e3 * float(np.nanstd((front - c.front)[use])),
        "mu, discs, in the frames of `fit`": mu_fitted,
        "mu, film: `fit`": fits["mu"].value,
        "mu, film: `fit`: stated sigma": fits["mu"].sigma,
        "mu, film: `fit`: error [%]": 100 * (fits["mu"].value / mu_fitted - 1.0),
        "frames in which the foot pushes": int(push.sum()),
        "frames of these with a front": int((push & np.isfinite(f.jammed_thickness.values)).sum()),
        "frames of mu of `fit`": int(fitted.sum()),
        "theta, discs, where the foot pushes: mean [deg]": theta,
        "theta, film: `fit` [deg]": fits["theta_deg"].value,
        "theta, film: `fit`: stated sigma [deg]": fits["theta_deg"].sigma,
        "theta, film: `fit`: error [deg]": fits["theta_deg"].value - theta,
        "theta, film: contour of 0.9 of `fit`: error [deg]": fits["theta_outline_deg"].value - theta,
        "theta, contour of 0.9 - discs: median of the frames [deg]": float(np.median(apart)),
        "theta, contour of 0.9 - discs: mean of the frames [deg]": float(np.mean(apart)),
        "theta, contour of 0.9 - discs: rms of the frames [deg]": math.sqrt(np.mean(apart**2)),
        "momentum: greatest error above a tenth of the peak [%]": 100 * np.abs(got / truth - 1.0)[large].max(),
        "momentum: mean error there [%]": 100 * np.mean((got / truth - 1.0)[large]),
        "momentum: rms error there [%]": 100 * math.sqrt(np.mean((got / truth - 1.0)[large] ** 2)),
        "momentum: stated sigma there, median [%]": 100 * np.median((got / truth - 1.0)[large] / pull[large]),
        "momentum: frames there inside 1 sigma [%]": 100 * np.mean(np.abs(pull[large]) < 1),
        "momentum: frames inside 2 sigma [%]": 100 * np.mean(np.abs(pull) < 2),
    }


def table(columns: dict[str, dict[str, float]]) -> None:
    """A markdown table on standard output, a column a jump."""
    print("| | " + " | ".join(k.replace("_", " ") for k in columns) + " |\n|---|" + "---|" * len(columns))
    for name in next(iter(columns.values())):
        print(f"| {name} | " + " | ".join(f"{c[name]:.3g}" for c in columns.values()) + " |")


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
    for measure, scene in ((one, loop.Scene()), (rough, loop.Scene(**loop.ROUGH))):
        with tempfile.TemporaryDirectory() as folder:
            columns = {kind: measure(kind, scene, Path(folder)) for kind in kinds or loop.KINDS}
        print(f"Area fraction {scene.fraction:g}, friction between grains {scene.friction:g}, sliding friction "
              f"{scene.coulomb:g} m/s^2, grains of 4 px.\n")  # fmt: skip
        table(columns)
        print()
    print(f"The film is drawn at {film_rate():.0f} frames of 512 x 512 px a second of one core.")


if __name__ == "__main__":
    main(*sys.argv[1:])
