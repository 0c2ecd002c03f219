"""Pictures of a bed from the side, and of a laser line over a crater, of known height and volume."""

from __future__ import annotations

import numpy as np

from jumpvision.laboratory import write
from jumpvision.laboratory.films.bed import bed_picture, crater_profile, laser_picture
from jumpvision.laboratory.films.optics import record

SCALE, FLOOR = 5e-4, 420.0


def side_view(height: float, seed: int, *, lamp: float = 1.0, uneven: float = 0.0, noise: int = 0, gamma: float = 1.0):
    """(8-bit picture, true surface (column,) [m]) of a bed; the same seed gives the same grains."""
    rng = np.random.default_rng(seed)
    mean, surface = bed_picture(height, scale=SCALE, floor_row=FLOOR, shape=(450, 420), grain_diameter=1e-3, rng=rng)
    mean = mean * lamp * (1.0 - uneven * np.linspace(0, 1, mean.shape[1]))
    mean = 255.0 * (mean / 255.0) ** (1.0 / gamma)  # camera's response
    return record(mean, electrons_per_grey=40.0, read_noise=1.5, rng=np.random.default_rng(1000 + noise)), surface


SHAPE = {"depth": 5e-3, "radius": 10e-3, "rim_height": 1.3e-3, "rim_width": 3e-3}
PITCH = 2e-4


def write_line(folder, phi, volume, seed):
    """An experiment folder with the laser line over a crater of this volume."""
    rng = np.random.default_rng(seed)
    x = np.arange(460, dtype=float)
    r = np.abs(x - 230 - rng.uniform(-8, 8)) * PITCH
    shape = {k: SHAPE[k] for k in ("depth", "radius", "rim_width")}
    bare, bowl = crater_profile(r, rim_height=0.0, **shape)
    one, full = crater_profile(r, rim_height=1e-3, **shape)
    h = bare + (one - bare) * (volume - bowl) / (full - bowl)  # the volume is linear in the rim's height
    line = 60 - h / PITCH * np.sin(0.9)
    mean = laser_picture(
        line, rows=140, width=np.full(460, 1.8), peak=np.full(460, 170.0), background=np.full((140, 460), 20.0),
        speckle=0.05, speckle_size=1.5, rng=rng,
    )  # fmt: skip
    folder.mkdir(parents=True)
    write.picture(folder / "crater.png", record(mean, electrons_per_grey=60.0, read_noise=1.5, rng=rng))
    write.toml(
        folder / "experiment.toml",
        {"bed": {"volume_fraction": phi}, "crater_image": {"file": "crater.png", "scale": PITCH, "laser_angle": 0.9}},
    )
