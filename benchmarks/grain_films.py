"""Are the sigmas of mu, beta, theta, C, added mass and momentum the true ones? Films of cones of 40-60 degrees.

    python -m benchmarks.grain_films [films [seed]]      # 40 films of eight kinds, from seed 0; 20 s each on one core

The films differ in cone, grains, light and noise; the flow is prescribed: its mu, beta, theta, C, added mass and
momentum in view are known. An error that all films share is a bias (blur of the windows, say), which no scatter can
show. C counts the grains beyond the picture too, 1 to 2 % of the momentum, which the film does not show.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

import numpy as np
import xarray as xr

from jumpvision.cli import main as command
from jumpvision.films.calibration import FACE_READ
from jumpvision.laboratory import write
from jumpvision.laboratory.films.flow import Cone
from jumpvision.laboratory.films.grain_record import write_grain_film
from jumpvision.laboratory.films.optics import GrainCamera
from jumpvision.laboratory.jumper import Law, motion_of
from jumpvision.laboratory.protocol import GrainFilm
from jumpvision.laboratory.samples import PHASE, SAND_ROBOT, SAND_TERMS, SAND_TRUTH, START
from jumpvision.laboratory.write import Recording

PHI, DENSITY, FRAMES, C = 0.57, 1000.0, 30, 2.7
FILMS: tuple[tuple[float, float, GrainCamera], ...] = (  # theta [deg], mu, camera
    (60.0, 2.0, GrainCamera()), (40.0, 1.6, GrainCamera()),
    (50.0, 2.2, GrainCamera(read_noise=4.0, electrons_per_grey=20.0)), (45.0, 1.8, GrainCamera()),
    (55.0, 1.8, GrainCamera(glare=25.0)), (60.0, 2.4, GrainCamera()),
    (60.0, 1.6, GrainCamera(read_noise=4.0)), (50.0, 1.8, GrainCamera()),
)  # fmt: skip


def one(folder: Path, seed: int, **smooth: str) -> tuple[dict[str, dict[str, float]], xr.Dataset, Recording]:
    """fits.json, flow.nc and the truth of one film."""
    folder.mkdir(parents=True)
    theta, mu, camera = FILMS[seed % len(FILMS)]
    rng = np.random.default_rng(seed)
    law = Law(7.0, 0.01875, PHASE["stutter"], START)
    motion = motion_of(
        SAND_ROBOT, law, SAND_TERMS, SAND_TRUTH, ground="granular", duration=0.46, bed_density=PHI * DENSITY
    )
    film = write_grain_film(
        folder, motion, PHI * DENSITY, rng, radius=0.0381, diameter=0.001, quick=True,
        cone=Cone(mu, np.radians(theta), C), film=GrainFilm(frames=FRAMES), camera=camera,
    )  # fmt: skip
    # who reads the face off the screen is off by FACE_READ; to 3 px it is found
    film.tables["grain_video"]["foot_row"] += float(np.clip(rng.normal(0.0, FACE_READ.value), -3.0, 3.0))
    write.toml(folder / "experiment.toml", {
        "ground": "granular", "robot": {"foot_radius": 0.0381},
        "bed": {"volume_fraction": PHI, "grain_density": DENSITY}, **film.tables,
        **({"params.piv": smooth} if smooth else {}),
    })  # fmt: skip
    if command(["fit", str(folder), "--results", str(folder / "results"), "--no-pictures"]):
        raise SystemExit(f"jumpvision fit {folder} failed")
    fits = json.loads((folder / "results" / "fits.json").read_text())
    return fits, xr.load_dataset(folder / "results" / "flow.nc"), film


def momentum(flow: xr.Dataset, film: Recording) -> tuple[np.ndarray, np.ndarray]:
    """(error, sigma) over the true momentum in view, above a tenth of its peak and while grains move all through."""
    known = film.truth["grain_film"].pairs["momentum_in_view_kg_m_s"]
    moving = known > 0.1 * known.max()
    moving[1:] &= known[:-1] > 0
    moving[:-1] &= known[1:] > 0
    known, found, sigma = (a[moving] for a in (known, flow.momentum.values, flow.momentum_sigma.values))
    return found / known - 1.0, sigma / known


def main(films: int, first: int = 0, **smooth: str) -> None:
    rows: dict[str, list[tuple[float, float]]] = {}
    frames: list[tuple[np.ndarray, np.ndarray]] = []
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(first, first + films):
            fits, flow, film = one(Path(folder) / str(seed), seed, **smooth)
            theta, mu, _ = FILMS[seed % len(FILMS)]
            known = {
                "mu": mu, "beta_deg": 45.0, "added_mass_kg": film.summary["added_mass_kg"], "theta_deg": theta,
                "theta_outline_deg": theta, "theta_bands_deg": theta, "mu_cone": mu, "theta_cone_deg": theta, "C": C,
            }  # fmt: skip
            for name, truth in known.items():
                rows.setdefault(name, []).append((fits[name]["value"] - truth, fits[name]["sigma"]))
            frames.append(momentum(flow, film))
    print("| fit | bias | greatest error | scatter of the films | stated sigma | films within 1 sigma, 2 sigma |")
    print("|---|---|---|---|---|---|")
    for name, pairs in rows.items():
        e, s = np.array(pairs).T
        inside = ", ".join(f"{np.mean(np.abs(e) < k * s):.0%}" for k in (1, 2))
        print(
            f"| {name} | {e.mean():.3g} | {np.abs(e).max():.3g} | {np.std(e, ddof=1):.3g} | {np.median(s):.3g} | "
            f"{inside} |"
        )
    print("\n| film: theta, mu | frames | momentum: mean error | greatest | median sigma | within 1 sigma, 2 sigma |")
    print("|---|---|---|---|---|---|")
    kinds = {f"{theta:g} deg, {mu:g}": frames[i :: len(FILMS)] for i, (theta, mu, _) in enumerate(FILMS)}
    for name, some in {**{n: f for n, f in kinds.items() if f}, "all": frames}.items():
        e, s = (np.concatenate(a) for a in zip(*some))
        inside = ", ".join(f"{np.mean(np.abs(e) < k * s):.0%}" for k in (1, 2))
        print(
            f"| {name} | {e.size} | {100 * e.mean():.2f} % | {100 * np.abs(e).max():.2f} % | "
            f"{100 * np.median(s):.2f} % | {inside} |"
        )


if __name__ == "__main__":
    numbers = [int(a) for a in sys.argv[1:3]] or [40]
    main(*numbers, **({"smooth": sys.argv[3]} if len(sys.argv) > 3 else {}))
