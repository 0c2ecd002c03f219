"""Protocols and their campaigns; the faults of the camera."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import ncx2
from shared import ROOT

from jumpvision.base.schema import InputError
from jumpvision.experiment.inputs.experiment import open_campaign, open_experiment
from jumpvision.films.frames.opening import open_frames
from jumpvision.laboratory.campaign import write_campaign
from jumpvision.laboratory.films.optics import Camera, Lens, seen_places
from jumpvision.laboratory.films.rod import balls
from jumpvision.laboratory.protocol import ContactLog, MotorLog, Protocol, Records, RodFilm, RodTrack, jumps_of
from jumpvision.laboratory.samples import SAND_ROBOT

MECHANISMS = ("two_resistance", "inertial_drag")
SMALL = Protocol(
    SAND_ROBOT,
    jumps_of("single", [7.0, 9.0], volume_fraction=[0.57, 0.59])
    + jumps_of("delayed_stutter", [7.0], delay=[0.1], trials=2),
    Records(rod_track=RodTrack(noise=1e-4, rho=0.3), motor_log=MotorLog(), contact_log=ContactLog()),
    terms=(*MECHANISMS, "payload"),
    parameters={
        "k1": lambda phi: 2000.0 + 80e3 * (phi - 0.57),
        "k2": 2000.0,
        "delta": 0.012,
        "alpha": 70.0,
        "dm": 0.05,
    },
    scatter={"k1": 0.01, "volume_fraction": 0.001},
    duration=0.8,
    model={"terms": MECHANISMS, "k1": 2e3, "k2": 2e3, "delta": 0.012, "alpha": 60.0, "fit": {"alpha": [0.0, 300.0]}},
    robot_sigma={"spring_stiffness": 20.0},
)
FEW = replace(SMALL, jumps=jumps_of("single", [8.0]), model={})


def digest(folder: Path) -> dict[str, str]:
    files = sorted(p for p in folder.rglob("*") if p.is_file())
    return {str(p.relative_to(folder)): hashlib.sha256(p.read_bytes()).hexdigest() for p in files}


@pytest.fixture(scope="module")
def made(tmp_path_factory) -> Path:
    out = tmp_path_factory.mktemp("campaign") / "out"
    write_campaign(out, SMALL, seed=3)
    return out


# ------------------------------------------------------------------------------------------------------------ protocols
def test_a_campaign_is_valid_and_its_model_is_not_its_truth(made):
    campaign = open_campaign(made)
    names = [e.name for e in campaign.experiments]
    assert names == sorted([f"single-{f}Hz-phi{p}-1" for f in (7, 9) for p in (0.57, 0.59)]
                           + ["delayed_stutter-7Hz-1", "delayed_stutter-7Hz-2"])  # fmt: skip
    e = campaign.experiments[0]
    assert e.header.group == "delayed_stutter-7Hz"
    assert e.sections["actuation"].delay == 0.1
    assert e.sections["robot"].motor_mass == 1.125 and e.sections["robot"].sigma.spring_stiffness == 20.0
    assert "payload" not in e.sections["model"].terms and e.sections["model"].fit["alpha"] == (0.0, 300.0)
    assert {"rod_track", "motor_log", "contact_log"} <= set(e.sections)
    true = json.loads((made / "truth.json").read_text())
    assert true["terms"] == ["two_resistance", "inertial_drag", "payload"]
    assert true["parameters"] == {"k2": 2000.0, "delta": 0.012, "alpha": 70.0, "dm": 0.05}
    for p, k1 in ((0.57, 2000.0), (0.59, 3600.0)):  # 80 kN/m per unit of phi; 4 sigma of both scatters
        name = f"single-7Hz-phi{p}-1"
        true = json.loads((made / name / "truth.json").read_text())
        assert true["volume_fraction"] == pytest.approx(p, rel=0.004) and true["volume_fraction"] != p  # 4 sigma
        assert true["parameters"]["k1"] == pytest.approx(k1, abs=4 * (0.01 * k1 + 80e3 * 0.001 * p))
        assert campaign[name].sections["bed"].volume_fraction == pytest.approx(true["volume_fraction"], abs=1e-6)


def test_the_same_seed_gives_the_same_files_and_nothing_is_written_over(made, tmp_path):
    for name, seed in (("again", 3), ("other", 4)):
        write_campaign(tmp_path / name, replace(SMALL, jumps=SMALL.jumps[:1]), seed=seed)
    whole, again, other = digest(made), digest(tmp_path / "again"), digest(tmp_path / "other")
    name = "single-7Hz-phi0.57-1/rod_track.csv"
    assert again.items() <= whole.items() and other[name] != whole[name]
    with pytest.raises(InputError, match="exists"):
        write_campaign(made, SMALL, seed=3)
    assert digest(made) == whole


def filmed(tmp_path: Path, camera: Camera, file: str = "rod.avi") -> tuple[Path, dict]:
    write_campaign(tmp_path / "film", replace(FEW, records=Records(rod_film=RodFilm(file)), camera=camera), seed=7)
    folder = tmp_path / "film" / "single-8Hz-1"
    return folder, json.loads((folder / "truth.json").read_text())


def stack(folder: Path, rate: float | None = 200.0):
    section = open_experiment(folder).sections["rod_video"]
    film = open_frames(section.path, frame_rate=rate)
    return np.stack(list(film)), film


def test_dropped_frames_clock_and_scale_of_a_protocol(tmp_path):
    camera = Camera(dropped=0.1, clock_offset=0.004, clock_drift=0.002, scale_error=0.01, bits=12)
    folder, true = filmed(tmp_path, camera, "rod.mkv")
    images, film = stack(folder)
    t = np.array(true["film"]["time_s"])
    assert 0.03 < 1 - len(t) / 159 < 0.2  # 159 frames: 0.1 +- 4 sqrt(0.09/159)
    np.testing.assert_allclose(film.time + 0.0005, t, atol=1e-6)
    np.testing.assert_allclose(true["film"]["shown_s"], t + 0.004 + 0.002 * t, atol=1e-9)
    assert images.dtype == np.uint16 and 2500 < images.max() < 4096
    assert open_experiment(folder).sections["rod_video"].scale == pytest.approx(5e-4 * 1.01)
    rise = np.array(true["film"]["y_px"])[0] - np.array(true["film"]["y_px"])
    np.testing.assert_allclose(rise * 5e-4, np.array(true["film"]["rod_m"]) - true["rest_rod_m"], atol=2e-5)


def test_a_lens_shows_the_ball_where_its_formula_says():
    """The drawn ball against an area integral over seen pixels (8 x 8 points each) of the blurred disc, whose value at
    rho is the chance that a Gaussian point lands in the disc: weight to 1e-4, centre to 1e-3 px; and the centre that
    the truth states solves true = seen (1 + k1 r^2 + k2 r^4)."""
    lens = Lens(2e-5, 3e-9, 60.0, 20.0)
    rows, column, radius = np.array([[22.3], [80.6]]), 31.7, 8.2
    film = balls(rows, column, radius=radius, shape=(121, 61), blur_px=0.7, limb=0.0, side_light=0.0, lens=lens)
    y, x = seen_places(rows[:, 0], column, lens)
    r2 = (y - lens.row) ** 2 + (x - lens.column) ** 2
    more = 1 + lens.k1 * r2 + lens.k2 * r2**2
    np.testing.assert_allclose(lens.row + (y - lens.row) * more, rows[:, 0], atol=1e-8)
    np.testing.assert_allclose(lens.column + (x - lens.column) * more, column, atol=1e-8)
    assert np.abs(y - rows[:, 0]).min() > 0.2
    rho = np.linspace(0, 20, 2001)
    disc = ncx2.cdf((radius / 0.7) ** 2, 2, (rho / 0.7) ** 2)
    fine = (np.arange(121 * 8) + 0.5) / 8 - 0.5
    yy, xx = np.meshgrid(fine, fine[: 61 * 8], indexing="ij")
    q = (yy - lens.row) ** 2 + (xx - lens.column) ** 2
    m = 1 + lens.k1 * q + lens.k2 * q * q
    for k in range(2):
        away = np.hypot(lens.row + (yy - lens.row) * m - rows[k, 0], lens.column + (xx - lens.column) * m - column)
        cover = np.interp(away, rho, disc)
        weight = film[k].sum()
        assert weight == pytest.approx(cover.sum() / 64, rel=1e-4)
        assert film[k].sum(axis=1) @ np.arange(121) / weight == pytest.approx(
            (yy * cover).sum() / cover.sum(), abs=1e-3
        )
        assert film[k].sum(axis=0) @ np.arange(61) / weight == pytest.approx((xx * cover).sum() / cover.sum(), abs=1e-3)


@pytest.mark.parametrize(("bits", "step"), [(8, 1.0), (12, 1 / 16), (16, 1 / 256)])
def test_noise_of_deeper_pixels(bits, step):
    """mean/gain + read^2 + step^2/12, in 8-bit grey levels; 200,000 pixels give it to 0.3 %, asked within 2 %."""
    from jumpvision.laboratory.films.optics import record

    image = record(np.full((400, 500), 90.0), electrons_per_grey=45.0, read_noise=0.5, bits=bits,
                   rng=np.random.default_rng(3))  # fmt: skip
    assert image.dtype == (np.uint8 if bits == 8 else np.uint16)
    assert (image * step).var() == pytest.approx(90 / 45 + 0.25 + step**2 / 12, rel=0.02)


@pytest.mark.long
def test_the_examples_of_the_documentation(tmp_path, monkeypatch):
    """Each runs as it stands, after those before it; the first writes its campaign."""
    page = (ROOT / "docs" / "laboratory.md").read_text(encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    names: dict[str, object] = {}
    for code in page.split("```python\n")[1:]:
        exec(code.split("```")[0], names)
    campaign = open_campaign(tmp_path / "my_campaign")
    assert len(campaign.experiments) == 3
    for e in campaign.experiments:
        assert {"rod_video", "rod_track", "motor_log", "contact_log", "bed_image"} <= set(e.sections)
