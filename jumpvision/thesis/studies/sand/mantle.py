"""k_2 of a grown cone predicted from published stresses on its mantle, with their spread (thesis Figs 48b, 55)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.jumper.physics.hard.analysis import SINGLE
from jumpvision.jumper.physics.rft import Grains, generic_2d, generic_3d, of_plane
from jumpvision.thesis.studies.compute import Variable, dataset
from jumpvision.thesis.studies.study import Found, Sweep, study

from .feet import plate_stress
from .shared import batch, packings

THETAS = (55.0, 60.0, 65.0)  # deg, of the mantle; thesis: about 60
FRICTIONS = (0.2, 0.4, 0.6)  # of the foot's surface and of grains on grains, under the law in three dimensions
FREQUENCY = 8.0  # Hz, of the single jump that shows what the spread is worth
ENDS = ("own", "least", "mean", "greatest")


@dataclass(frozen=True)
class Predicted:
    """Least, mean and greatest k_2 / k_1 of the published stresses."""

    least: float
    mean: float
    greatest: float


def mantle_shares() -> dict[str, Array]:
    """k_2 / k_1 of a flat foot with a grown cone by each published law, over THETAS and what else the law asks for.

    k_2 / A_foot = sigma_z(theta) / cos(theta) (the mantle's area over the foot's), k_1 / A_foot = sigma_z(level plate).
    """
    laws = {
        "Li et al. 2013": [Grains(1.0, math.inf, stress=of_plane(generic_2d))],
        "Agarwal et al. 2023": [Grains(1.0, f, stress=generic_3d) for f in FRICTIONS],
    }
    return {
        name: np.array(
            [
                plate_stress(g, math.radians(t)) / math.cos(math.radians(t)) / plate_stress(g, 0.0)
                for g in grains
                for t in THETAS
            ]
        )
        for name, grains in laws.items()
    }


@study("mantle", "granular", source="Fig 48(b)", ranges={"phi": lambda s: packings(s, 13)}, needs_laws=True)
def mantle_resistance(s: Sweep) -> Found:
    """k_2 against packing beside that predicted from k_1 and published stresses on the cone's mantle, their spread."""
    laws, radius = s.setup.laws, s.setup.model.foot_radius
    lacking = [n for n in ("k1", "k2") if laws is None or n not in laws.laws]
    if laws is None or radius is None or lacking:
        what = ", ".join(lacking) or "[robot] foot_radius"
        raise InputError([f"--analysis mantle: needs {what}; give a file of laws with k1 and k2, and the foot"])
    phi = s.axis("phi")
    own = laws.points(phi, radius)
    shares = mantle_shares()
    every = np.concatenate(list(shares.values()))
    predicted = Predicted(float(every.min()), float(np.mean([x.mean() for x in shares.values()])), float(every.max()))
    k1, k2 = own["model.k1"], own["model.k2"]
    with_k2 = {"own": k2} | {n: getattr(predicted, n) * k1 for n in ENDS[1:]}
    scaled = (laws.foot_radius / radius) ** 2 if laws.foot_radius else 1.0
    jumps = [
        batch(s, {"phi": phi, "frequency": FREQUENCY, "phase": SINGLE}, laws=laws.with_law("k2", phi, scaled * k))
        for k in with_k2.values()
    ]
    results = {n: np.stack([j[n] for j in jumps]) for n in jumps[0]}
    area = math.pi * radius**2
    extra: dict[str, Variable] = {
        "k1_per_area": (("phi",), k1 / area, "N/m^3", "k_1 / foot area, of the laws"),
        "k2_per_area": (("k2", "phi"), np.stack(list(with_k2.values())) / area, "N/m^3", "k_2 / foot area"),
    }
    data = dataset(s, {"k2": list(ENDS), "phi": phi}, ("k2", "phi"), results, extra, facts=predicted)
    ratio = k2 / (predicted.mean * k1)
    high = 1e3 * np.asarray(results["jump_height_m"])
    rows = [
        s.number(f"k_2 / k_1 by {name}: mean, least to greatest", f"{x.mean():.2f}, {x.min():.2f} to {x.max():.2f}", "")
        for name, x in shares.items()
    ]
    where = f"phi {phi[0]:.3f} and {phi[-1]:.3f}"
    rows += [
        s.number(f"k_2 over the predicted one at {where}", f"{ratio[0]:.2f}, {ratio[-1]:.2f}", "1 at low and high phi"),
        s.number(
            f"single at {FREQUENCY:g} Hz, {where}: own k_2; least to greatest of the predicted",
            "; ".join(f"{h[0]:.1f}, {h[1]:.1f} to {h[3]:.1f} mm" for h in high[:, [0, -1]].T),
        ),
    ]
    return data, rows
