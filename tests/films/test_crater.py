"""Crater volumes of known shapes, the critical packing, real depth maps, and the stage through the command line."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pandas as pd
import pytest
import tifffile
from matplotlib.figure import Figure
from scipy.ndimage import gaussian_filter, gaussian_filter1d

from jumpvision.cli import main
from jumpvision.estimate.crater import critical_fraction, line_crater
from jumpvision.estimate.crater_map import map_crater
from jumpvision.experiment.inputs.sections import CraterDepth
from jumpvision.experiment.stages.bed.crater import crater, read_map
from jumpvision.films.parameters import CraterParams
from jumpvision.laboratory import write
from jumpvision.laboratory.films.bed import crater_profile
from jumpvision.report.figures.bed import draw_map
from tests.worlds.bed_pictures import PITCH, SHAPE, write_line


def line_trial(seed, *, uneven, known):
    """(error, sigma, noise_sigma): grain-wide roughness of 0.1 mm; each half's relief scaled by 1 + N(0, uneven)."""
    rng = np.random.default_rng(seed)
    x = np.arange(500) * PITCH
    axis = x.mean() + rng.uniform(-2e-3, 2e-3)
    h, volume = crater_profile(np.abs(x - axis), **SHAPE)
    h = h * np.where(x < axis, *(1 + rng.normal(0, uneven, 2)))
    rough = gaussian_filter1d(rng.normal(size=x.size), 2.0)
    h = h + 1e-4 * rough / rough.std() + 0.01 * x
    h[320:332] = np.nan
    c = line_crater(x, h, np.full(x.size, 1e-5), axis=axis if known else None)
    assert c.reason == ""
    return c.volume - volume, c.sigma, c.noise_sigma


@pytest.mark.parametrize(("uneven", "known"), [(0.0, False), (0.1, True)])
def test_the_volume_by_a_line_and_its_sigma(uneven, known):
    error, sigma, noise = np.array([line_trial(s, uneven=uneven, known=known) for s in range(150)]).T
    # bias: a twentieth of the volume's 8.8e-7 m^3, what the rim's unseen tail may hold
    assert abs(error.mean()) < 4.4e-8
    # 150 trials: +- 3 * 0.038; two halves say little about their asymmetry: where there is none sigma is 0.09 wide
    assert 0.683 - 0.114 < np.mean(np.abs(error) < sigma) < 0.683 + 0.09 + 0.114
    if not uneven:
        assert abs(np.mean(np.abs(error) < noise) - 0.683) < 0.114


def test_the_volume_by_a_map_and_its_sigma():
    z = []
    y, x = np.mgrid[:130, :140] * 1e-3
    for seed in range(30):
        rng = np.random.default_rng(seed)
        x0, y0 = 0.07 + rng.uniform(-5e-3, 5e-3), 0.062
        h, volume = crater_profile(np.hypot(x - x0, y - y0), **(SHAPE | {"radius": 12e-3}))
        rough = gaussian_filter(rng.normal(size=x.shape), 1.5)
        h = h + 2e-4 * rough / rough.std() + 0.02 * x - 0.01 * y
        h[rng.integers(0, 130, 12), rng.integers(0, 140, 12)] += 0.05  # pixels that saw something else
        c = map_crater(h, 1e-3)
        assert c.axis == pytest.approx((x0, -y0), abs=1e-3)
        z.append((c.volume - volume) / c.sigma)
    assert abs(np.mean(np.abs(z) < 1.0) - 0.683) < 3 * 0.085 + 0.03  # 30 maps; 0.03: spikes are not all removed alike


def test_a_plane_holds_no_crater_and_a_cut_crater_is_refused():
    rng = np.random.default_rng(0)
    assert "no crater" in map_crater(1e-4 * rng.normal(size=(80, 80)), 1e-3).reason
    x = np.arange(300) * PITCH
    flat = line_crater(x, 1e-4 * rng.normal(size=300), np.full(300, 1e-5))
    assert "no crater" in flat.reason and np.isnan(flat.volume)
    cut, _ = crater_profile(np.abs(x - x[-30]), **SHAPE)
    assert line_crater(x, cut + 1e-5 * rng.normal(size=300), np.full(300, 1e-5)).reason != ""


def test_the_critical_packing_is_covered(n=25, understated=2.0):
    """V = 3e-5 m^3 (phi - 0.605) with errors in both; where errors are understated the scatter widens sigma."""
    inside, inside95 = [], []
    for seed in range(120):
        rng = np.random.default_rng(seed)
        phi = np.linspace(0.57, 0.63, n)
        volume = 3e-5 * (phi - 0.605) + rng.normal(0, understated * 1e-7, n)
        seen = phi + rng.normal(0, understated * 1e-3, n)
        c = critical_fraction(seen, np.full(n, 1e-3), volume, np.full(n, 1e-7))
        inside.append(abs(c.value - 0.605) < c.sigma)
        inside95.append(c.low95 < 0.605 < c.high95)
    # 120 draws: +- 3 * 0.0425; the scatter factor never shrinks sigma: 0.2/sqrt(n - 2), up to 0.03 of coverage more
    assert 0.683 - 0.128 < np.mean(inside) < 0.683 + 0.158
    assert np.mean(inside95) > 0.95 - 0.06
    c = critical_fraction([0.57, 0.58, 0.59], [0, 0, 0], [-3e-6, -2e-6, -1e-6], [1e-7] * 3)
    assert np.isnan(c.value) and "compacted" in c.reason
    assert "fewer than three" in critical_fraction([0.57], [0.0], [1.0], [1.0]).reason


def test_two_halves_tell_little_of_their_own_asymmetry():
    """Hardly any noise, halves whose relief differs by 10 %: the mean of two values is within one sigma of Student's t
    with one freedom, 1.84 times half their difference, in 0.683 of 300 (+- 3 * 0.027); within half of it in a half."""
    x, inside = np.arange(500) * PITCH, []
    axis = float(x.mean())
    h, volume = crater_profile(np.abs(x - axis), **SHAPE)
    for seed in range(300):
        rng = np.random.default_rng([7, seed])
        uneven = h * np.where(x < axis, *(1 + rng.normal(0, 0.1, 2))) + rng.normal(0, 2e-6, x.size)
        c = line_crater(x, uneven, np.full(x.size, 2e-6), axis=axis, radius=0.03)
        inside.append(abs(c.volume - volume) < c.sigma)
    assert np.mean(inside) == pytest.approx(0.683, abs=0.081)


def test_errors_of_the_packing_are_in_the_chi2_of_its_zero():
    """Where errors are as stated chi2 is n - 2 on average, here with those of phi five times those of the volume:
    60 draws of 18 degrees of freedom, +- 3 * 6/sqrt(60)."""
    phi, chi2 = np.linspace(0.57, 0.63, 20), []
    for seed in range(60):
        rng = np.random.default_rng([8, seed])
        seen, volume = phi + rng.normal(0, 2e-3, 20), 3e-5 * (phi - 0.605) + rng.normal(0, 1.2e-8, 20)
        chi2.append(critical_fraction(seen, np.full(20, 2e-3), volume, np.full(20, 1.2e-8)).chi2)
    assert np.mean(chi2) == pytest.approx(18.0, abs=2.4)


# -- through the command line --------------------------------------------------------------------------------


def test_a_campaign_of_craters_gives_the_critical_packing(tmp_path):
    """A line from 0.9 rad above the ground shows heights by the sine of it; each volume is the drawn one."""
    true = {f"phi{phi}": 4e-5 * (phi - 0.605) for phi in (0.575, 0.59, 0.6, 0.61, 0.63)}
    for i, (name, volume) in enumerate(true.items()):
        write_line(tmp_path / "c" / name, float(name[3:]), volume, i)
    results = tmp_path / "r"
    assert main(["crater", str(tmp_path / "c"), "--results", str(results), "--workers", "1", "--no-pictures"]) == 0
    table = pd.read_csv(results / "craters.csv").set_index("experiment")
    for name, volume in true.items():
        assert table.volume_m3[name] == pytest.approx(volume, abs=4 * table.sigma_m3[name] + 1e-8)
    assert table.sigma_m3["phi0.59"] < 6e-8
    phi_c = json.loads((results / "fits.json").read_text())["phi_c"]
    assert phi_c["value"] == pytest.approx(0.605, abs=4 * phi_c["sigma"] + 1e-4)
    assert phi_c["low95"] < phi_c["value"] < phi_c["high95"]


def test_a_depth_map_in_every_format(tmp_path):
    """Millimetres from a camera above: -0.001 m a unit."""
    y, x = np.mgrid[:90, :100] * 1e-3
    h, volume = crater_profile(np.hypot(x - 0.05, y - 0.045), **(SHAPE | {"radius": 8e-3}))
    stored = (800.0 - 1e3 * (h + 2e-5 * np.random.default_rng(0).normal(size=h.shape))).astype(np.float32)
    np.save(tmp_path / "map.npy", stored)
    np.savez(tmp_path / "map.npz", depth=stored, note=np.array("mm"))
    tifffile.imwrite(tmp_path / "map.tif", stored)
    for name in ("map.npz", "map.tif", "map.npy"):
        assert np.array_equal(read_map(CraterDepth(name, tmp_path / name)), stored)
    (tmp_path / "experiment.toml").write_text(
        f'[crater_depth]\nfile = "{name}"\nscale = 1e-3\nheight_scale = -1e-3\naxis = [50.0, 45.0]\n'
    )
    assert main(["crater", str(tmp_path), "--results", str(tmp_path / "r"), "--no-pictures"]) == 0
    d = json.loads((tmp_path / "r" / "crater.json").read_text())
    # 16-bit floats of 800 mm round to 0.06 um: no part of it; the rest is the noise
    assert d["volume_m3"] == pytest.approx(volume, abs=4 * d["sigma_m3"])
    assert d["sigma_m3"] < 0.05 * abs(volume)
    assert d["volume_fraction"] is None


def test_the_drawn_disc_lies_about_the_crater_of_its_map(tmp_path):
    """Deepest at column 72, row 30 of 100 x 90 pixels, which nobody states: the circle's middle, to 1 pixel."""
    y, x = np.mgrid[:90, :100] * 1e-3
    h, _ = crater_profile(np.hypot(x - 0.072, y - 0.030), **(SHAPE | {"radius": 8e-3}))
    np.save(tmp_path / "map.npy", h + 2e-5 * np.random.default_rng(0).normal(size=h.shape))
    depth = CraterDepth("map.npy", tmp_path / "map.npy", scale=1e-3)
    axis = Figure().subplots()
    draw_map(axis.figure, axis, crater(None, depth, None, None, None, p=CraterParams()).values, depth)
    (circle,) = axis.lines
    column, row = (np.mean([np.min(v), np.max(v)]) for v in circle.get_data())
    assert (column, row) == pytest.approx((72.0, 30.0), abs=1.0)
    shown = np.asarray(axis.images[0].get_array())
    assert shown[round(row), round(column)] < 0.5 * shown.min()  # negative: deep


LINE = '[crater_image]\nfile = "c.png"\nscale = 2e-4\n'
DEPTH = '[crater_depth]\nfile = "c.npy"\nscale = 1e-3\n'
BROKEN = {  # name: (experiment.toml, c.npy, what the message must say)
    "no line": (LINE, None, ("c.png", "line")),
    "angle in degrees": (LINE + "laser_angle = 45.0\n", None, ("laser_angle = 45.0", "rad")),
    "three maps": (DEPTH, np.zeros((3, 60, 60)), ("c.npy", "one 2-D array")),
    "objects": (DEPTH, np.array([{}] * 4, dtype=object), ("c.npy", "plain numbers")),
}


@pytest.mark.parametrize("name", BROKEN)
def test_one_clear_error_and_nothing_written(name, tmp_path, capsys):
    text, array, parts = BROKEN[name]
    (tmp_path / "experiment.toml").write_text(text)
    write.picture(tmp_path / "c.png", np.random.default_rng(1).integers(18, 23, (60, 90), dtype=np.uint8))
    if array is not None:
        np.save(tmp_path / "c.npy", array, allow_pickle=True)
    assert main(["crater", str(tmp_path), "--results", str(tmp_path / "r"), "--no-pictures"]) in (1, 2)
    said = [t for t in capsys.readouterr().err.splitlines() if t.startswith(("jumpvision: ", "error: "))]
    assert len(said) == 1 and all(part in said[0] for part in parts), said
    assert not (tmp_path / "r" / "crater.json").exists()


def test_fluidised_and_compacted_beds_are_told_apart(real_data, tmp_path):
    """Kinect maps by others: a lump of sand digs into a fluidised bed and piles up on a compacted one."""
    campaign = tmp_path / "c"
    for file in sorted((real_data / "craters_kinect").glob("[cf]*.npz")):
        folder = campaign / file.stem
        folder.mkdir(parents=True)
        shutil.copy(file, folder)
        (folder / "experiment.toml").write_text(
            f'[crater_depth]\nfile = "{file.name}"\nscale = 2.8025e-3\nheight_scale = 1e-3\n'
        )
    assert main(["crater", str(campaign), "--results", str(tmp_path / "r"), "--no-pictures", "--workers", "1"]) == 0
    t = pd.read_csv(tmp_path / "r" / "craters.csv")
    loose, dense = (t[t.experiment.str.startswith(k)] for k in ("fluidized", "compacted"))
    assert (len(loose), len(dense)) == (6, 3)
    # every pair by more than two of its sigmas
    gap = dense.volume_m3.to_numpy()[:, None] - loose.volume_m3.to_numpy()
    assert (gap > 2 * np.hypot(dense.sigma_m3.to_numpy()[:, None], loose.sigma_m3.to_numpy())).all()
    assert (loose.depth_m > 5 * dense.depth_m.max()).all()


def test_what_a_depth_camera_has_not_measured_is_no_depth(tmp_path):
    """A hole of 9 x 9 in a map of distances in steps of 0.1 mm: the volume is that of the map without it, but for a few
    % of what of the crater lies in the hole, which its rim does not tell. A map that begins at 0 has depths there."""
    y, x = np.mgrid[-90:91, -90:91]
    noise = np.random.default_rng(3).normal(0.0, 4.0, x.shape)
    distance = np.rint(8000.0 + 250.0 * np.exp(-(x**2 + y**2) / (2 * 12.0**2)) + noise).astype(np.uint16)

    def seen(z):
        np.save(tmp_path / "map.npy", z)
        return read_map(CraterDepth("map.npy", tmp_path / "map.npy"))

    whole, own = map_crater(-1e-4 * seen(distance), 0.002), 81 * 0.002**2 * 0.25 * 25e-3  # m^3 in the hole
    for nothing in (0, 65535):
        holed = distance.copy()
        holed[96:105, 96:105] = nothing
        assert np.isnan(seen(holed)).sum() == 81
        assert abs(map_crater(-1e-4 * seen(holed), 0.002).volume - whole.volume) < 0.1 * own
    assert np.isfinite(seen((8250 - distance.astype(int)).clip(0, None).astype(np.uint16))).all()
