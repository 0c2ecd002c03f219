"""Velocity fields of other programs, written here in their documented layouts, against what was written."""

import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from scipy.io import savemat

from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.experiment.results.fields import Flow, Piv
from jumpvision.experiment.stages.grains.piv import add_foot
from jumpvision.experiment.workflow.stage import results_stages
from jumpvision.films.grains.column import follow_plug, scatter_sigma
from jumpvision.films.grains.gradients import correlated_variance
from jumpvision.films.vision.foot_face import FootTrack
from tests.worlds.vector_files import (
    AXIS,
    BAD,
    CASES,
    COLUMNS,
    DEEP,
    FACE,
    PHI,
    PLUG,
    RATE,
    RHO,
    ROWS,
    SCALE,
    SPEED,
    STEP,
    WIDE,
    faces,
    flow_field,
    folder_of,
    made,
)

results_stages()  # registers them


@pytest.mark.parametrize("case", CASES)
def test_every_format_gives_the_field_that_was_written(tmp_path, case):
    field = made(folder_of(tmp_path / "e", case), Piv).field
    u, v = flow_field()
    x, y = (COLUMNS - AXIS) * SCALE, -(ROWS - FACE) * SCALE
    got = field.sortby("x").sortby("y", ascending=False)
    assert got.u.dims == ("y", "x", "t") and got.u.attrs["units"] == "m/s" and got.x.attrs["units"] == "m"
    assert got.x.values == pytest.approx(x, abs=1e-9) and got.y.values == pytest.approx(y, abs=1e-9)
    assert got.t.values == pytest.approx((np.arange(3) + 0.5) / RATE)
    near = y < -0.0125  # above it vectors may be masked as lying over the foot's face, below every case agrees
    ok = got.chc.values > 0
    expected = np.ones(ok.shape, bool)
    expected[BAD] = False
    assert np.array_equal(ok[near], expected[near])
    assert got.u.values[ok] == pytest.approx(u[ok], abs=1e-6) and got.v.values[ok] == pytest.approx(v[ok], abs=1e-6)
    assert got.v_sigma.values[ok] == pytest.approx(np.full(ok.sum(), 1e-3))
    # the foot: grains within 1.5 windows (7.2 mm) of the face are in the plug and within 5 mm of the axis lag by up to
    # 1 - exp(-5^2/2/12^2) = 8 %, 3 % in the mean
    assert -field.foot_v.values == pytest.approx(SPEED, rel=0.04)
    assert field.foot_y.values == pytest.approx(faces(), abs=0.04 * abs(faces()[-1]) + 1e-9)


def test_momentum_and_fit_of_a_foreign_field(tmp_path):
    right, bottom = 2 * WIDE**2, PLUG + DEEP  # integrals over all r and all depths
    left_out = 1 - math.exp(-0.5 * (0.0504 / WIDE) ** 2)
    deep = (ROWS[-1] + STEP - FACE) * SCALE
    shown = bottom - DEEP * math.exp(-(deep - PLUG) / DEEP)
    truth = RHO * PHI * math.pi * SPEED * 0.5 * right * left_out * shown
    for case in ("openpiv", "pivlab-mat-metres", "pivpy-mm"):
        p = made(folder_of(tmp_path / case, case), Flow).field.momentum.values
        # the foot's depth is that of the grains (4 % of 1 mm); r dr of 2.4 mm cells of a Gaussian 12 mm wide: 1 %
        assert p == pytest.approx(truth, rel=0.02), case
    assert not main(["fit", str(tmp_path / "openpiv"), "--results", str(tmp_path / "r"), "--no-pictures"])
    fits = json.loads((tmp_path / "r" / "fits.json").read_text())
    assert fits["log_a"]["value"] == pytest.approx(-1.0 / DEEP, rel=0.05)


def test_our_own_file_comes_back_with_foot_and_sigma(tmp_path):
    first = made(folder_of(tmp_path / "a", "pivpy-mm"), Piv)
    (tmp_path / "b").mkdir()
    first.save(tmp_path / "b")
    (tmp_path / "b" / "experiment.toml").write_text('[piv_field]\nfile = "piv.nc"\nfoot_row = 5.0\naxis_column = 5.0\n')
    again = made(tmp_path / "b", Piv)
    for k in ("u", "v", "u_sigma", "chc", "foot_y", "foot_v", "x", "y", "t"):
        assert np.allclose(again.field[k].values, first.field[k].values, equal_nan=True), k
    assert again.geometry.overlap == pytest.approx(2.0)


def edited(folder, old, new):
    file = folder / "experiment.toml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    return folder


def test_what_the_file_does_not_say_is_asked_for(tmp_path):
    for k, (case, old, new, said) in enumerate((
        ("openpiv", 'length = "px"\n', "", ["length", "no units", 'length = "px"']),
        ("openpiv", 'speed = "px/frame"\n', "", ["speed", "no units"]),
        ("pivlab-mat", f"frame_rate = {RATE}\n", "", ["frame_rate", "px/frame"]),
        ("pivlab-mat", f"scale = {SCALE}\n", "length = \"mm\"\n", ["scale", "metres"]),
        ("pivpy-mm", "[piv_field]\n", "[piv_field]\nscale = 1e-4\n", ["scale", "in mm"]),
    )):  # fmt: skip
        folder = edited(folder_of(tmp_path / str(k), case), old, new)
        with pytest.raises(InputError) as e:
            made(folder, Piv)
        assert all(word in str(e.value) for word in ("[piv_field]", str(folder), *said))
    folder = folder_of(tmp_path / "e", "pivpy-mm")
    data = xr.load_dataset(folder / "field.nc", decode_times=False).sortby("y")
    data.to_netcdf(folder / "other.nc")
    edited(folder, "field.nc", "other.nc")
    with pytest.raises(InputError, match="up = "):
        made(folder, Piv)
    edited(folder, "[piv_field]\n", '[piv_field]\nup = "+y"\n')
    assert made(folder, Piv).field.v.min() < -0.4


def test_broken_files_say_what_is_wrong(tmp_path):
    folder = folder_of(tmp_path / "e", "openpiv-rows")
    (folder / "field_10.txt").write_text((folder / "field_10.txt").read_text().replace("\t", " ", 3)[:-40])
    savemat(folder / "session.mat", {"resultslist": np.zeros((3, 3))})
    (folder / "old.mat").write_bytes(b"MATLAB 7.3 MAT-file" + b" " * 105 + b"\x00\x02IM" + b"\x00" * 400)
    names = ("field_*.txt", "session.mat", "old.mat", "experiment.toml")
    for k, said in enumerate((r"field_10\.txt: line", "session; export", "-v7", "no known vector file")):
        if k:
            edited(folder, names[k - 1], names[k])
        with pytest.raises(InputError, match=said):
            made(folder, Piv)


def test_scatter_gives_the_noise_of_overlapping_windows():
    for length in (1, 4):
        white = np.random.default_rng(length).normal(0.0, 1.0, (400, 60 + length))
        f = sum(white[:, k : k + 60] for k in range(length)) / math.sqrt(length)
        f += 0.3 * np.sin(np.arange(60) / 10.0)  # the flow: its second difference is 0.3/100
        # 400 x 60/length independent triples: the median has 1.2/sqrt(n) = 1 to 2 %
        assert scatter_sigma(f, np.ones(f.shape, bool), length) == pytest.approx(1.0, rel=0.05)
        # the same model of correlation as the momentum uses
        expected = 6.0 - 8.0 * max(0, 1 - 1 / length) + 2.0 * max(0, 1 - 2 / length)
        assert correlated_variance(np.array([[1.0, -2.0, 1.0]]), length) == pytest.approx(expected)


def test_a_followed_foot_has_its_true_error(n=4000):
    """Place and speed from rows of 0.1 px noise: neighbours share a row, 4 sigma of the scatter are sqrt(1.5) 4.5 %."""
    time, film = np.arange(n) * 1e-3, SimpleNamespace(scale=1e-4, foot_row=20.0)
    row = 20.0 + 300.0 * time + np.random.default_rng(4).normal(0.0, 0.1, n)
    got, p = {}, SimpleNamespace(gap=1, ensemble=1)
    add_foot(got, FootTrack(row, np.full(n, 0.1), np.full(n, ""), 0.0), time, film, 1, p)
    found = {k: got[k][1] for k in got}
    place = -300.0 * (time[1:] + time[:-1]) / 2 * 1e-4
    assert np.std((found["foot_y"] - place) / found["foot_y_sigma"]) == pytest.approx(1.0, abs=0.055)
    assert np.std((found["foot_v"] + 0.03) / found["foot_v_sigma"]) == pytest.approx(1.0, abs=0.055)


def test_the_plug_gives_the_foot_with_its_true_error():
    rng, z = np.random.default_rng(1), []
    x, y, t = np.linspace(-0.02, 0.02, 21), -np.linspace(0.001, 0.05, 50), np.linspace(0.0, 0.02, 11)
    truth = -0.3 + 5.0 * t
    place = -0.3 * t + 2.5 * t**2
    for _ in range(100):
        noise = rng.normal(0.0, 0.01, (50, 21, 11))
        got = follow_plug(truth + noise, np.full(noise.shape, 0.01), np.ones(noise.shape, bool), x, y, t,
                          half_width=0.005, window=0.008, correlation_length=1.0)  # fmt: skip
        z.append(
            [(got.foot_v[-1] - truth[-1]) / got.foot_v_sigma[-1], (got.foot_y[-1] - place[-1]) / got.foot_y_sigma[-1]]
        )
    # rows are taken as alike, which white noise is not: 8 rows, so the sigma is 2.8 times too large and never too small
    assert np.all(np.abs(z) < 1.3) and np.all(np.abs(np.mean(z, axis=0)) < 3 * 0.36 / math.sqrt(100))
