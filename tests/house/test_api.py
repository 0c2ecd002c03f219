"""The notebook's functions: what the page says runs, agrees with the command line, and shows itself."""

from __future__ import annotations

import inspect
import json
import re
import shutil
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr
from shared import ROOT, SAMPLES

import jumpvision as jv
from jumpvision.base.notebook import page, table
from jumpvision.cli import main
from jumpvision.experiment.workflow.stage import results_stages

PAGE = (ROOT / "docs" / "notebook.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def samples(tmp_path_factory):
    """Copies of the samples, without the campaign's films, which take minutes."""
    root = tmp_path_factory.mktemp("notebook")
    shutil.copytree(SAMPLES / "hard_ground", root / "data_samples" / "hard_ground")
    leave = shutil.ignore_patterns("*film", "stutter-*", "delayed*")
    shutil.copytree(SAMPLES / "loose_sand", root / "data_samples" / "loose_sand", ignore=leave)
    return root


@pytest.fixture(scope="module")
def cells(samples):
    """The names that the quick cells of docs/notebook.md define."""
    blocks = re.findall(r"(<!-- .*? -->\n)?```python\n(.*?)```", PAGE, flags=re.S)
    names: dict = {}
    with pytest.MonkeyPatch.context() as m:
        m.chdir(samples)
        for mark, code in blocks:
            compile(code, "notebook.md", "exec")
            if not mark:
                exec(code.replace("print(error)", "caught = error"), names)  # Python forgets `error` after the block
    return names


def test_the_page_says_what_happens(cells, samples, capsys):
    """The command line finds what the notebook has computed; folders and records show themselves."""
    truth = json.loads((SAMPLES / "hard_ground" / "truth.json").read_text())["summary"]
    fit = cells["fits"].table.loc["jump_height_m"]
    assert abs(fit.value - truth["jump_height_m"]) < 4 * fit.sigma
    assert cells["caught"].problems[0].endswith("piv needs [grain_video] or [piv_field]")
    assert len(cells["height"]) == len(cells["track"].table) and 0 < cells["sigma"].max() < 1e-4
    assert all(0.04 < apex < 0.06 for apex in cells["apexes"])  # docs/samples.md: 45.6 mm, the model's 48.1 mm
    for name, true in (("u", 2.0), ("v", 1.0)):
        assert abs(float(cells["field"][name].median()) - true) < 0.02
    assert abs(float(cells["flow"].vorticity.median())) < 3 * float(cells["flow"].vorticity_sigma.median())
    assert cells["best"].dims == ("frequency",) and float(cells["best"].max()) > 0.005
    assert main(["fit", str(samples / "data_samples" / "hard_ground"), "--json", "--no-pictures"]) == 0
    done = json.loads(capsys.readouterr().out)["experiments"][0]
    assert {s["state"] for s in done["stages"]} == {"cached"}
    shown = cells["track"]._repr_html_()
    assert "track.csv" in shown and "height_m" in shown and "data:image/png;base64," in shown
    assert "[rod_video]" in cells["experiment"]._repr_html_() and "single-10.0Hz-1" in cells["campaign"]._repr_html_()
    assert "<script>" not in page("<script>", table([{"a": "<script>"}]))


def test_every_stage_is_a_function_with_its_help_and_its_parameters():
    """Type checkers see what Python finds: the return type of every function is its record."""
    stub = (Path(jv.__file__).parent / "__init__.pyi").read_text(encoding="utf-8")
    for stage in results_stages():
        function = getattr(jv, stage.name)
        assert stage.name in jv.__all__ and stage.name in dir(jv)
        assert stage.help in inspect.getdoc(function) and stage.output.file in function.__doc__
        assert all(f.name in function.__doc__ for f in (fields(stage.params) if stage.params else ()))
        assert f"def {stage.name}(" in stub and f"-> {stage.output.__name__}:" in stub
    for name in jv.VERBS:
        assert name in jv.__all__ and getattr(jv, name).__doc__ and getattr(jv, name).__annotations__["return"]


# ---- images in, tables out: drawn here, not by the laboratory --------------------------------------------------------


def test_axes_exposure_and_a_centre_of_mass_in_arrays():
    """Two discs on parabolas, exposed for 90 % of a frame (8 instants each): the centre of mass of 1 and 3 kg, in axes
    turned by 30 degrees about a point. Errors in units of sigma: 76 numbers, 3 sigma are 24 %."""
    rng, rate, share = np.random.default_rng(4), 200.0, 0.9
    t = (np.arange(40) + share / 2) / rate
    instants = (np.arange(8) + 0.5) / 8 * share / rate - share / 2 / rate
    rows, columns = (np.arange(4 * k).reshape(-1, 1) / 4 + 1 / 8 - 0.5 for k in (90, 160))

    def places(s):
        return (20 + 500 * s, 60 - 300 * s + 2000 * s**2), (130 - 400 * s, 30 + 100 * s + 900 * s**2)

    frames = []
    for now in t:
        light = 0.0
        for s in now + instants:
            inside = sum((columns.T - x) ** 2 + (rows - y) ** 2 < 6.0**2 for x, y in places(s)) > 0
            light = light + inside.reshape(90, 4, 160, 4).mean(axis=(1, 3)) / len(instants)
        frames.append(np.clip(40 + 150 * light + 2 * rng.standard_normal(light.shape), 0, 255).astype(np.uint8))
    d = jv.track(
        frames, frame_rate=rate, exposure=share / rate, scale=1e-3, origin=(10.0, 80.0), angle=np.pi / 6,
        masses=(1.0, 3.0), seed=(20, 60), markers=[(130, 30)], diameter=12,
    )  # fmt: skip
    whole = d[d.body == 0].reset_index(drop=True)
    assert sorted(d.body.unique()) == [0, 1, 2] and np.allclose(whole.time_s, t)
    good = (whole.flag == "").to_numpy() & whole.shift_x_px.notna().to_numpy()
    assert good.sum() >= 25  # the discs cover each other for a while
    (ax, ay), (bx, by) = places(t)
    want = ((ax + 3 * bx) / 4 - 10 - 1j * ((ay + 3 * by) / 4 - 80)) * 1e-3 * np.exp(-1j * np.pi / 6)
    off = np.concatenate([(whole.x_m - want.real)[good], (whole.y_m - want.imag)[good]])
    assert np.sqrt(np.mean((off / np.tile(whole.sigma_m[good], 2)) ** 2)) == pytest.approx(1.0, abs=0.3)
    bend = -1j * 2 * (2000 + 3 * 900) / 4 * 1e-3 * np.exp(-1j * np.pi / 6)
    for found, true in ((whole.ax_m_s2, bend.real), (whole.ay_m_s2, bend.imag)):
        pull = ((found - true) / whole.a_sigma_m_s2)[good]
        assert np.sqrt(np.mean(pull**2)) == pytest.approx(1.0, abs=0.5)  # neighbours share their samples


def test_the_height_of_a_bed_in_a_picture():
    """A dark bed under light, its edge 1.2 px wide at row 80 + 0.02 column, grains of 0.3 px; floor at row 200."""
    rng, column = np.random.default_rng(2), np.arange(400)
    edge = 80.0 + 0.02 * (column - 199.5) + 0.3 * rng.standard_normal(400)
    light = ndtr((edge[None, :] - np.arange(220)[:, None]) / 1.2)
    picture = np.clip(20 + 180 * light + 2 * rng.standard_normal(light.shape), 0, 255).astype(np.uint8)
    found = jv.bed(picture, floor_row=200.0).iloc[0]
    assert found.height_px == pytest.approx(120.0, abs=4 * found.sigma_px) and found.sigma_px < 0.1
    assert found.tilt_rad == pytest.approx(-0.02, abs=1e-3)
    both = jv.bed(np.stack([picture, picture]), floor_row=200.0, scale=1e-4)
    assert list(both.height_m) == pytest.approx([found.height_px * 1e-4] * 2)


def test_the_volume_of_a_crater_by_map():
    """A dip of -4 mm exp(-r^2 / 2 w^2), w = 8 mm: -2 pi 4 mm w^2; what lies beyond 4 w is 3e-4 of it."""
    scale, w, deep = 5e-4, 0.008, 0.004
    x = (np.arange(161) - 80) * scale
    dip = lambda r2: -deep * np.exp(-r2 / (2 * w * w))  # noqa: E731
    rng, true = np.random.default_rng(3), -2 * np.pi * deep * w * w
    z = dip(x[None, :] ** 2 + x[:, None] ** 2) + 2e-5 * rng.standard_normal((161, 161))
    by_map = jv.crater(z, scale=scale, axis=(80, 80), radius=0.034)
    assert by_map.volume_m3 == pytest.approx(true, abs=4 * by_map.sigma_m3 + 1e-3 * abs(true))


def test_wrong_images_and_parameters_are_named(samples):
    two, image = np.zeros((2, 8, 8)), np.zeros((64, 64))
    for call, why in (
        (lambda: jv.piv(image, image, windw=32), r"jv.piv windw = 32: .*'window'"),
        (lambda: jv.piv(image), "grey images"),
        (lambda: jv.track(np.zeros((2, 8, 8, 3))), "grey"),
        (lambda: jv.track(two, exposure_correction="none"), "exposure_correction: not for arrays"),
        (lambda: jv.track(two, exposure=2.0), "exposure = 2.0: must be 0 to one frame"),
        (lambda: jv.track(two, masses=(1.0, 2.0)), "masses.*must be 1 numbers > 0"),
        (lambda: jv.track(two, origin=(1.0,)), "origin.*column, row"),
        (lambda: jv.track(two, window=1), "window = 1: must be >= 3"),
        (lambda: jv.bed(np.zeros((9, 9)), floor_row=5, reference_height=0.1), "reference_height: not for arrays"),
        (lambda: jv.crater(np.zeros((30, 30)), scale=-1.0), "scale = -1.0"),
        (lambda: jv.intrusion(np.zeros(50), np.zeros(50), foot_radius=-1.0), "foot_radius = -1.0"),
        (lambda: jv.track(samples / "hard_ground", polarity="dark"), "TOML"),
        (lambda: jv.track(jv.open(samples / "data_samples" / "loose_sand")), r"campaign\[name\]"),
        (lambda: jv.ringdown(np.arange(99.0), np.zeros(99), sigma=0.0), "sigma: must be > 0"),
        (lambda: jv.simulate({"ground": "hard", "model": {"terms": []}}), "robot: missing"),
        (lambda: jv.simulate(TABLES | {"robot": {"motor_mass": -1.0}}), r"jv.simulate \[robot\] motor_mass = -1.0"),
        (lambda: jv.simulate(TABLES | {"rod_video": {"file": "rod.avi"}}), r"\[rod_video\].*needs a folder"),
        (lambda: jv.simulate(TABLES, [0.0, 1.0], [0.0, 0.0]), "8 or more, finite and increasing"),
    ):
        with pytest.raises(ValueError, match=why):
            call()


TABLES = {
    "ground": "hard",
    "robot": {"motor_mass": 1.003, "rod_mass": 0.175, "spring_stiffness": 5760.6, "spring_damping": 2.0},
    "model": {"terms": []},
    "actuation": {"kind": "single", "frequency": 8.0, "amplitude": 0.004, "start": 0.1},
}


def test_a_model_of_tables_moves_as_in_a_folder(tmp_path):
    """Also driven by arrays: its own motor every ms, whose sudden ends a spline rounds: 2 % of the apex."""
    text = [f"ground = {json.dumps(TABLES['ground'])}"]
    for name in ("robot", "model", "actuation"):
        text += [f"[{name}]", *(f"{k} = {json.dumps(v)}" for k, v in TABLES[name].items())]
    (tmp_path / "jump").mkdir()
    (tmp_path / "jump" / "experiment.toml").write_text("\n".join(text))
    there = jv.simulate(tmp_path / "jump", results=tmp_path / "results").table
    here = jv.simulate(TABLES)
    np.testing.assert_array_equal(here.to_numpy(), there.to_numpy())
    at_rest = {k: v for k, v in TABLES.items() if k != "actuation"}
    driven = jv.simulate(at_rest, here.time_s, here.motor_m - here.rod_m)
    apex = here.rod_m.max() - here.rod_m[0]
    assert apex > 0.005
    assert abs(driven.rod_m.max() - driven.rod_m[0] - apex) < 0.02 * apex
