"""Are the sigmas of mu, beta, theta, C and the added mass the true ones? Grain films of one jump with other grains.

    python -m benchmarks.grain_films 10      # films; about a minute each on one core

The films differ in grains, light and noise; the flow is prescribed: its mu, beta, theta, C and added mass in view are
known. An error that all films share is a bias (blur of the windows, say), which no scatter can show.
"""

from __future__ import annotations

import json
import sys
import tempfile
from pathlib import Path

import numpy as np

from jumpvision.cli import main as command
from jumpvision.lab import write
from jumpvision.lab.grain_record import film_brief, write_grain_film
from jumpvision.lab.jumper import simulate as jump
from jumpvision.lab.mechanisms import Law
from jumpvision.lab.samples import PHASE, SAND_ROBOT, SAND_TERMS, SAND_TRUTH, START

PHI, DENSITY, FRAMES = 0.57, 1000.0, 30
TRUTH = {"mu": 2.0, "theta": np.radians(60.0), "C": 2.7}


def one(folder: Path, seed: int, **smooth: str) -> tuple[dict[str, dict[str, float]], dict[str, float]]:
    """(fits.json, the truth) of one film."""
    folder.mkdir(parents=True)
    law = Law(7.0, 0.01875, PHASE["stutter"], START)
    motion = jump(SAND_ROBOT, law, SAND_TERMS, SAND_TRUTH, ground="granular", duration=0.46, bed_density=PHI * DENSITY)
    section, depth, true = write_grain_film(
        folder, motion, PHI * DENSITY, np.random.default_rng(seed), radius=0.0381, diameter=0.001, n=FRAMES, quick=True,
        **TRUTH,
    )  # fmt: skip
    write.toml(folder / "experiment.toml", {
        "ground": "granular", "robot": {"foot_radius": 0.0381},
        "bed": {"volume_fraction": PHI, "grain_density": DENSITY}, "grain_video": section,
        "params.flow": {"initial_depth": float(depth)},
        **({"params.piv": smooth} if smooth else {}),
    })  # fmt: skip
    if command(["fit", str(folder), "--results", str(folder / "results"), "--no-pictures"]):
        raise SystemExit(f"jumpvision fit {folder} failed")
    return json.loads((folder / "results" / "fits.json").read_text()), film_brief(true)


def main(films: int, **smooth: str) -> None:
    rows: dict[str, list[tuple[float, float]]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for seed in range(films):
            fits, brief = one(Path(folder) / str(seed), seed, **smooth)
            known = {
                "mu": brief["mu"], "beta_deg": brief["beta_deg"], "added_mass_kg": brief["added_mass_kg"],
                "theta_deg": 60.0, "mu_cone": 2.0, "theta_cone_deg": 60.0, "C": 2.7,
            }  # fmt: skip
            for name, truth in known.items():
                rows.setdefault(name, []).append((fits[name]["value"] - truth, fits[name]["sigma"]))
    print("| fit | bias | scatter of the films | stated sigma | scatter / stated | films within 1 sigma, 2 sigma |")
    print("|---|---|---|---|---|---|")
    for name, pairs in rows.items():
        e, s = np.array(pairs).T
        spread = float(np.std(e, ddof=1))
        inside = ", ".join(f"{np.mean(np.abs(e) < k * s):.0%}" for k in (1, 2))
        print(
            f"| {name} | {e.mean():.3g} | {spread:.3g} | {np.median(s):.3g} | {spread / np.median(s):.2f} | {inside} |"
        )


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 10, **({"smooth": sys.argv[2]} if len(sys.argv) > 2 else {}))
