"""The notebook's functions: what the page says runs, agrees with the command line, and shows itself."""

from __future__ import annotations

import inspect
import json
import pydoc
import re
import shutil
import subprocess
import sys
import warnings
from dataclasses import fields
from pathlib import Path

import numpy as np
import pytest
from conftest import ROOT, SAMPLES
from scipy.special import ndtr

import jumpvision as jv
from jumpvision.base.schema import InputError
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


def test_the_page_says_what_happens(cells):
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


def test_the_command_line_finds_what_the_notebook_has_computed(cells, samples, capsys):
    assert main(["fit", str(samples / "data_samples" / "hard_ground"), "--json", "--no-pictures"]) == 0
    done = json.loads(capsys.readouterr().out)["experiments"][0]
    assert {s["state"] for s in done["stages"]} == {"cached"}
    assert (samples / "results" / "hard_ground" / "provenance.json").exists()


def test_folders_and_records_show_themselves(cells, samples):
    shown = cells["track"]._repr_html_()
    assert "track.csv" in shown and "height_m" in shown and "data:image/png;base64," in shown
    assert "jump_height_m" in cells["fits"]._repr_html_()
    assert "[rod_video]" in cells["experiment"]._repr_html_() and "ball_diameter" in cells["experiment"]._repr_html_()
    assert "single-10.0Hz-1" in cells["campaign"]._repr_html_()


def test_names_are_escaped():
    from jumpvision.base.notebook import page, table

    assert "<script>" not in page("<script>", table([{"a": "<script>"}]))


def test_run_gives_a_row_an_experiment(samples, tmp_path):
    folder = tmp_path / "two"
    for name in ("single-6.5Hz-1", "single-4.5Hz-1"):
        shutil.copytree(samples / "data_samples" / "loose_sand" / name, folder / name)
    shutil.copy(samples / "data_samples" / "loose_sand" / "campaign.toml", folder)
    (folder / "single-4.5Hz-1" / "rod_track.csv").write_text("time_s,height_m\n0,0\n")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        table = jv.run(jv.open(folder), pictures=False)
    assert list(table.experiment) == ["single-4.5Hz-1", "single-6.5Hz-1"]
    assert "rod_track.csv" in table.problem[0] and table.problem.isna()[1]
    assert abs(table.jump_height_m[1] - 45.6e-3) < 1e-3  # docs/samples.md
    assert (tmp_path / "results" / "two" / "jumps.csv").exists()


def test_bad_calls_name_the_remedy(samples):
    campaign = jv.open(samples / "data_samples" / "loose_sand")
    with pytest.raises(InputError, match=r"campaign\[name\]"):
        jv.track(campaign)
    with pytest.raises(InputError, match=r"did you mean 'single-6.5Hz-1'"):
        campaign["single-6.5Hz-11"]
    with pytest.raises(AttributeError, match="no attribute 'tracks'"):
        jv.tracks  # noqa: B018


def test_every_stage_is_a_function_with_its_help_and_its_parameters():
    for stage in results_stages():
        function = getattr(jv, stage.name)
        assert stage.name in jv.__all__ and stage.name in dir(jv)
        assert stage.help in inspect.getdoc(function) and stage.output.file in function.__doc__
        assert all(f.name in function.__doc__ for f in (fields(stage.params) if stage.params else ()))
    for name in jv.VERBS:
        assert name in jv.__all__ and getattr(jv, name).__doc__
    shown = pydoc.render_doc(jv.fit, renderer=pydoc.plaintext)
    call = "".join(shown.splitlines()[2:4]).replace(" ", "")  # Python 3.13 puts each argument on a line of its own
    assert call.startswith("fit(experiment") and "Ring-down, flights" in shown and "debounce" in shown


def test_the_import_is_light():
    """Nothing heavy until a stage is asked for (0.05 s alone; the aim is 0.5 s)."""
    code = "import sys, jumpvision; print(sorted({'numpy','numba','pandas','cv2','xarray','scipy'} & set(sys.modules)))"
    out = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert out.strip() == "[]"


def test_type_checkers_see_what_python_finds():
    """The stub is generated (test_docs.py keeps it fresh): the return type of every function is its record."""
    stub = (Path(jv.__file__).parent / "__init__.pyi").read_text(encoding="utf-8")
    for stage in results_stages():
        assert f"def {stage.name}(" in stub and f"-> {stage.output.__name__}:" in stub
    assert (Path(jv.__file__).parent / "py.typed").exists()
    assert all(getattr(jv, name).__annotations__["return"] for name in jv.VERBS)


# ---- images in, tables out: drawn here, not by the laboratory --------------------------------------------------------
def ball_film(rng, n=60, rate=500.0, noise=2.0):
    """Frames (n, 64, 120) of a bright disc of 11 px on a parabola, a pixel the mean of 8 x 8 points; its path [px]."""
    t = np.arange(n) / rate
    x, y = 20.0 + 700.0 * t, 50.0 - 600.0 * t + 0.5 * 1.0e4 * t * t
    rows, columns = (np.arange(8 * k).reshape(-1, 1) / 8 + 1 / 16 - 0.5 for k in (64, 120))
    frames = []
    for a, b in zip(x, y):
        inside = (columns.T - a) ** 2 + (rows - b) ** 2 < 5.5**2
        share = inside.reshape(64, 8, 120, 8).mean(axis=(1, 3))
        frames.append(np.clip(40 + 150 * share + noise * rng.standard_normal(share.shape), 0, 255).astype(np.uint8))
    return t, x, y, np.stack(frames)


def test_a_ball_is_tracked_in_an_array(tmp_path, monkeypatch):
    """rms of (found - true) / sigma within 0.8 to 1.25: 3 sigma of 360 numbers are 11 %, the drawing's points add."""
    monkeypatch.chdir(tmp_path)
    pulls, ends = [], []
    for seed in range(3):
        t, x, y, frames = ball_film(np.random.default_rng(seed))
        d = jv.track(frames, frame_rate=500.0, scale=1e-4, diameter=11)
        assert (d.flag == "").all() and list(tmp_path.iterdir()) == []
        pulls += [(d.x_px - x) / d.sigma_px, (d.y_px - y) / d.sigma_px]
        np.testing.assert_allclose(d.y_m, -1e-4 * d.y_px)
        np.testing.assert_allclose(d.time_s, t)
        free = slice(3, None, 7)  # windows of 7 frames that share none
        ends += [(d.vx_m_s - 0.07)[free] / d.v_sigma_m_s[free], (d.ay_m_s2 + 1.0)[free] / d.a_sigma_m_s2[free]]
    assert 0.8 < np.sqrt(np.mean(np.concatenate(pulls) ** 2)) < 1.25
    assert 0.6 < np.sqrt(np.mean(np.concatenate(ends) ** 2)) < 1.45  # 54 numbers: 3 sigma are 29 %
    pixels = jv.track(list(frames[:3]), diameter=11, window=3)
    assert "x_m" not in pixels and pixels.vx_px_s.iloc[0] == pytest.approx(700 / 500, abs=0.05)


def test_axes_exposure_and_a_centre_of_mass_in_arrays():
    """Two discs on parabolas, exposed for 90 % of a frame (20 instants each): the centre of mass of 1 and 3 kg, in axes
    turned by 30 degrees about a point. Errors in units of sigma: 76 numbers, 3 sigma are 24 %."""
    rng, rate, share = np.random.default_rng(4), 200.0, 0.9
    t = (np.arange(40) + share / 2) / rate
    instants = (np.arange(20) + 0.5) / 20 * share / rate - share / 2 / rate
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


def test_a_pair_is_matched_as_arrays(tmp_path, monkeypatch):
    """Random grains moved by a phase ramp, 1.37 px right and 0.61 px up, without noise: to 0.01 px."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(1)
    f = np.fft.fftfreq(256)
    grain = np.exp(-2.0 * (np.pi * 1.2) ** 2 * (f[:, None] ** 2 + f**2))
    spectrum = np.fft.fft2(rng.standard_normal((256, 256))) * grain
    a, b = (np.fft.ifft2(spectrum * np.exp(-2j * np.pi * k * (1.37 * f - 0.61 * f[:, None]))).real for k in (-0.5, 0.5))
    size = 40.0 / a.std()
    a, b = 128.0 + size * a, 128.0 + size * b
    d = jv.piv(a, b)
    assert list(tmp_path.iterdir()) == [] and d.u.dims == ("y", "x")
    inner = d.isel(x=slice(2, -2), y=slice(2, -2))
    assert abs(inner.u - 1.37).max() < 0.01 and abs(inner.v - 0.61).max() < 0.01
    film = jv.piv(np.stack([a, b, a]), frame_rate=100.0, scale=1e-3, window=32)
    assert film.sizes["t"] == 2 and film.t.values == pytest.approx([0.005, 0.015])
    assert float(film.u[0].median()) == pytest.approx(0.137, abs=1e-3)
    assert float(film.u[1].median()) == pytest.approx(-0.137, abs=1e-3)


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


def test_the_volume_of_a_crater_by_map_and_by_line():
    """A dip of -4 mm exp(-r^2 / 2 w^2), w = 8 mm: -2 pi 4 mm w^2; what lies beyond 4 w is 3e-4 of it."""
    scale, w, deep = 5e-4, 0.008, 0.004
    x = (np.arange(161) - 80) * scale
    dip = lambda r2: -deep * np.exp(-r2 / (2 * w * w))  # noqa: E731
    rng, true = np.random.default_rng(3), -2 * np.pi * deep * w * w
    z = dip(x[None, :] ** 2 + x[:, None] ** 2) + 2e-5 * rng.standard_normal((161, 161))
    by_map = jv.crater(z, scale=scale, axis=(80, 80), radius=0.034)
    assert by_map.volume_m3 == pytest.approx(true, abs=4 * by_map.sigma_m3 + 1e-3 * abs(true))
    angle = 0.6
    row = 60.0 - dip(x**2) * np.sin(angle) / scale
    line = 20 + 180 * np.exp(-0.5 * ((np.arange(120)[:, None] - row[None, :]) / 1.5) ** 2)
    picture = np.clip(line + 2 * rng.standard_normal(line.shape), 0, 250).astype(np.uint8)
    by_line = jv.crater(picture, scale=scale, laser_angle=angle, axis=80, radius=0.034)
    assert by_line.volume_m3 == pytest.approx(true, abs=4 * by_line.sigma_m3 + 1e-3 * abs(true))
    assert by_line.sigma_m3 < 0.05 * abs(true) and by_line.depth_m == pytest.approx(deep, rel=0.05)


@pytest.mark.long
def test_the_resistances_of_a_slow_intrusion():
    """Two slopes of 2,000 and 1,400 N/m that meet 12 mm down, from contact at 5 mm; 0.05 N of noise."""
    depth = np.linspace(0.0, 0.05, 4000)
    below = np.maximum(depth - 0.005, 0.0)
    force = np.where(below < 0.012, 2000 * below, 2000 * 0.012 + 1400 * (below - 0.012))
    force = force + 0.05 * np.random.default_rng(4).standard_normal(depth.size)
    table = jv.intrusion(depth, force)
    for name, true in {"k1": 2000.0, "k2": 1400.0, "delta": 0.012, "contact_depth_m": 0.005}.items():
        assert table.value[name] == pytest.approx(true, abs=4 * table.sigma[name]), name
    assert table.sigma["k1"] < 50


def test_the_damping_of_a_ring_down():
    """2 mm exp(-zeta w0 t) cos(w_d t), zeta 0.02, 9 Hz; the noise, 0.01 mm, is found from the record."""
    t, w = np.arange(0.0, 2.0, 1e-3), 2 * np.pi * 9.0
    zeta = 0.02
    w0 = w / np.sqrt(1 - zeta**2)
    y = 2e-3 * np.exp(-zeta * w0 * t) * np.cos(w * t) + 1e-5 * np.random.default_rng(6).standard_normal(t.size)
    table = jv.ringdown(t, y)
    for name, true in {"zeta": zeta, "frequency_hz": 9.0, "omega0": w0, "ring_amplitude": 2e-3}.items():
        assert table.value[name] == pytest.approx(true, abs=4 * table.sigma[name]), name
    assert table.value["decay_viscous_share"] > 0.9
    with pytest.raises(ValueError, match=r"sigma: must be > 0"):
        jv.ringdown(t, y, sigma=0.0)


def test_wrong_images_and_parameters_are_named(samples):
    with pytest.raises(InputError, match=r"jv.piv windw = 32: unknown key; did you mean 'window'"):
        jv.piv(np.zeros((64, 64)), np.zeros((64, 64)), windw=32)
    with pytest.raises(ValueError, match="give grey images"):
        jv.piv(np.zeros((64, 64)))
    with pytest.raises(ValueError, match="make it grey"):
        jv.track(np.zeros((2, 8, 8, 3)))
    for call, why in (
        (lambda: jv.track(np.zeros((2, 8, 8)), exposure_correction="none"), "exposure_correction: not for arrays"),
        (lambda: jv.track(np.zeros((2, 8, 8)), exposure=2.0), "exposure = 2.0: must be 0 to one frame"),
        (lambda: jv.track(np.zeros((2, 8, 8)), masses=(1.0, 2.0)), "masses.*must be 1 numbers > 0"),
        (lambda: jv.track(np.zeros((2, 8, 8)), origin=(1.0,)), "origin.*column, row"),
        (lambda: jv.track(np.zeros((2, 8, 8)), window=1), "window = 1: must be >= 3"),
        (lambda: jv.bed(np.zeros((9, 9)), floor_row=5, reference_height=0.1), "reference_height: not for arrays"),
        (lambda: jv.crater(np.zeros((30, 30)), scale=-1.0), "scale = -1.0: must be a finite"),
        (lambda: jv.intrusion(np.zeros(50), np.zeros(50), foot_radius=-1.0), "foot_radius = -1.0: must be a finite"),
        (lambda: jv.piv(np.zeros((64, 64)), np.zeros((64, 64)), scale=0.0), "scale = 0.0: must be a number"),
    ):
        with pytest.raises(InputError, match=why):
            call()
    with pytest.raises(InputError, match="in its TOML"):
        jv.track(samples / "hard_ground", polarity="dark")


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


@pytest.mark.parametrize(
    ("tables", "arrays", "said"),
    [
        ({"ground": "hard", "model": {"terms": []}}, (), "robot: missing"),
        (TABLES | {"robot": {"motor_mass": -1.0}}, (), r"jv.simulate \[robot\] motor_mass = -1.0: must be in"),
        (TABLES | {"rod_video": {"file": "rod.avi"}}, (), r"\[rod_video\]: a recording; it needs a folder"),
        (TABLES, ([0.0, 1.0], [0.0, 0.0]), "give 8 or more, finite and increasing"),
    ],
)
def test_a_model_of_tables_that_cannot_be_is_said(tables, arrays, said):
    with pytest.raises(ValueError, match=said):
        jv.simulate(tables, *arrays)
