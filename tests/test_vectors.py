"""Velocity fields of other programs, written here in their documented layouts, against what was written. About 15 s."""

import json
import math

import numpy as np
import pytest
import xarray as xr
from scipy.io import savemat

from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.results.fields import Flow, Piv
from jumpvision.experiment.workflow.stage import results_stages
from jumpvision.experiment.workflow.workspace import Workspace
from jumpvision.films.grains.column import follow_plug, scatter_sigma
from jumpvision.films.grains.gradients import correlated_variance

results_stages()  # registers them

RATE, SCALE, STEP = 500.0, 2e-4, 12  # 1/s, m/px, px
COLUMNS, ROWS = 30.0 + STEP * np.arange(41), 46.0 + STEP * np.arange(30)  # px, of the vectors; rows downwards
AXIS, FACE = 270.0, 34.0  # px: the foot's axis, and its face in the middle of the first pair
SPEED = 0.4 + 0.05 * np.arange(3)  # m/s, downwards, of the foot at the middle of the pairs
WIDE, DEEP, PLUG = 0.012, 0.010, 0.012  # m: v / foot = exp(-x^2/2 WIDE^2), times exp(-(d - PLUG)/DEEP) below PLUG
RHO, PHI = 1000.0, 0.57


def faces():
    """Height of the face [m] below its first place, at the middle of each pair."""
    return -np.concatenate([[0.0], np.cumsum(0.5 * (SPEED[1:] + SPEED[:-1]) / RATE)])


def flow_field(extra=True):
    """u, v [m/s], v up, shape (rows, columns, t): grains go down with the foot, a little u to tell axes apart."""
    x = (COLUMNS - AXIS) * SCALE
    d = ((ROWS - FACE) * SCALE)[:, None] + faces()[None, :]
    v = -SPEED * np.exp(-np.maximum(d - PLUG, 0.0) / DEEP)[:, None, :] * np.exp(-0.5 * (x / WIDE) ** 2)[None, :, None]
    u = 0.03 * (x[None, :, None] / 0.05) * np.ones_like(v)
    return u, v


BAD = (4, 7)  # the vector that the programs call bad, in every field


def openpiv(folder, turned):
    """openpiv.tools.save: tab, '%.4e', x y u v flags mask; turned: as after transform_coordinates."""
    u, v = flow_field()
    to_px = 1.0 / (SCALE * RATE)
    x, y = np.meshgrid(COLUMNS, ROWS)
    flags, mask = np.zeros(x.shape), np.zeros(x.shape)
    flags[BAD] = 1
    for k in range(v.shape[2]):
        down = -v[..., k] * to_px
        if turned:
            cols = (x, y[::-1], u[..., k] * to_px, -down, flags, mask)
        else:
            cols = (x, y, u[..., k] * to_px, down, flags, mask)
        name = folder / f"field_{k + 9}.txt"  # 9, 10, 11: not in alphabetical order
        table = np.stack([c.ravel() for c in cols], axis=1)
        np.savetxt(name, table, fmt="%.6e", delimiter="\t", header="x\ty\tu\tv\tflags\tmask")
    return "field_*.txt"


def pivlab_text(folder):
    """PIVlab's ASCII chart: three header lines, columns of the grid one after another, NaN where masked."""
    u, v = flow_field()
    x, y = np.meshgrid(COLUMNS, ROWS)
    (folder / "vectors").mkdir()
    for k in range(v.shape[2]):
        a, b = u[..., k] / (SCALE * RATE), -v[..., k] / (SCALE * RATE)
        a[BAD], b[BAD] = np.nan, np.nan
        lines = [
            "PIVlab by W.Th. & E.J.S., ASCII chart output - 01-Jan-2026",
            f"FRAME: {k + 1}, filenames: A: a.png & B: b.png, conversion factor xy (px -> m): 1, conversion factor uv "
            "(px/frame -> m/s): 1",
            "x [px],y [px],u [px/frame],v [px/frame]",
        ]
        rows = np.stack([f.T.ravel() for f in (x, y, a, b)], axis=1)
        lines += [",".join(f"{n:.9g}" for n in row) for row in rows]
        (folder / "vectors" / f"PIVlab_{k + 1:04d}.txt").write_bytes("\r\n".join(lines).encode() + b"\r\n")
    return "vectors"


def pivlab_mat(folder, metres, upwards):
    """PIVlab's MAT export: cells of grids; calibrated numbers carry calxy, calu and the sign of calv."""
    u, v = flow_field()
    x, y = np.meshgrid(COLUMNS, ROWS)
    n = v.shape[2]

    def cells(f):
        out = np.empty((n, 1), object)
        for k in range(n):
            out[k, 0] = f(k)
        return out

    length, speed = (SCALE, 1.0) if metres else (1.0, 1.0 / (SCALE * RATE))
    sign = 1.0 if upwards else -1.0
    kinds = np.ones(x.shape)
    kinds[BAD] = 2  # replaced
    top = ROWS[0] + ROWS[-1]
    data = {
        "x": cells(lambda k: x * length), "y": cells(lambda k: (top - y if upwards else y) * length),
        "u_original": cells(lambda k: u[..., k] * speed), "v_original": cells(lambda k: sign * v[..., k] * speed),
        "typevector_original": cells(lambda k: kinds), "u_filtered": cells(lambda k: u[..., k] * speed),
        "v_filtered": cells(lambda k: sign * v[..., k] * speed), "typevector_filtered": cells(lambda k: kinds),
        "u_smoothed": cells(lambda k: np.zeros((0, 0))), "calxy": length, "calu": speed, "calv": -sign * speed,
        "units": "[m] respectively [m/s]" if metres else "[px] respectively [px/frame]",
    }  # fmt: skip
    savemat(folder / "PIVlab.mat", data)
    return "PIVlab.mat"


def pivpy(folder, unit, dims):
    """pivpy schema 1: u, v, chc over (y, x, t) with 1-D coordinates, here in mm and mm/s or in pix and pix a frame."""
    u, v = flow_field()
    length, speed, names = (
        (SCALE * 1e3, 1e3, ("mm", "mm/s")) if unit == "mm" else (1.0, 1 / SCALE / RATE, ("pix", "pix"))
    )
    chc = np.ones(v.shape)
    chc[BAD] = 0
    at = ("y", "x", "t")
    data = xr.Dataset(
        {"u": (at, u * speed, {"units": names[1]}), "v": (at, v * speed, {"units": names[1]}), "chc": (at, chc)},
        coords={
            "x": ("x", COLUMNS * length, {"units": names[0]}), "y": ("y", (ROWS[0] + ROWS[-1] - ROWS) * length,
            {"units": names[0]}), "t": ("t", np.arange(3.0), {"units": "frame"}),
        },
        attrs={"delta_t": 0.0, "files": ["a.vc7"], "pivpy_schema_version": "1"},
    )  # fmt: skip
    data.transpose(*dims).to_netcdf(folder / "field.nc")
    return "field.nc"


TURNED = ROWS[0] + ROWS[-1]  # y up where a program turns the picture over: row + y
CASES = {  # how it is written; unit of length [m], y of the face, what [piv_field] has to add
    "openpiv": (lambda f: openpiv(f, True), 1.0, TURNED - FACE, 'length = "px"\nspeed = "px/frame"\n'),
    "openpiv-rows": (lambda f: openpiv(f, False), 1.0, FACE, 'length = "px"\nspeed = "px/frame"\nup = "-y"\n'),
    "pivlab-text": (pivlab_text, 1.0, FACE, ""),
    "pivlab-mat": (lambda f: pivlab_mat(f, False, False), 1.0, FACE, ""),
    "pivlab-mat-up": (lambda f: pivlab_mat(f, False, True), 1.0, TURNED - FACE, ""),
    "pivlab-mat-metres": (lambda f: pivlab_mat(f, True, False), SCALE, FACE, ""),
    "pivpy-mm": (lambda f: pivpy(f, "mm", ("y", "x", "t")), SCALE * 1e3, TURNED - FACE, ""),
    "pivpy-pix": (lambda f: pivpy(f, "pix", ("t", "x", "y")), 1.0, TURNED - FACE, ""),
}


def folder_of(folder, case):
    write, unit, face, more = CASES[case]
    folder.mkdir(exist_ok=True)
    file = write(folder)
    scale = f"scale = {SCALE}\n" if unit == 1.0 else ""
    sigma = 1e-3 / (SCALE * RATE) if unit == 1.0 else 1.0 if unit == SCALE * 1e3 else 1e-3  # 1 mm/s as the file counts
    text = f"[bed]\nvolume_fraction = {PHI}\ngrain_density = {RHO}\n[robot]\nfoot_radius = 0.0381\n"
    text += f'[piv_field]\nfile = "{file}"\nframe_rate = {RATE}\nsigma = {sigma}\n'
    text += f"foot_row = {face * unit}\naxis_column = {AXIS * unit}\n"
    (folder / "experiment.toml").write_text(text + scale + more)
    return folder


def made(folder, output):
    return Workspace(open_experiment(folder), folder.parent / "out", folder.parent / "cache").make(output)


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


def test_momentum_of_a_foreign_field(tmp_path):
    found = {}
    for case in ("openpiv", "pivlab-mat-metres", "pivpy-mm"):
        data = made(folder_of(tmp_path / case, case), Flow).field
        found[case] = data.momentum.values
    right, bottom = 2 * WIDE**2, PLUG + DEEP  # integrals over all r and all depths
    left_out = 1 - math.exp(-0.5 * (0.0504 / WIDE) ** 2)
    deep = (ROWS[-1] + STEP - FACE) * SCALE
    shown = bottom - DEEP * math.exp(-(deep - PLUG) / DEEP)
    truth = RHO * PHI * math.pi * SPEED * 0.5 * right * left_out * shown
    for case, p in found.items():
        # the foot's depth is that of the grains (4 % of 1 mm); r dr of 2.4 mm cells of a Gaussian 12 mm wide: 1 %
        assert p == pytest.approx(truth, rel=0.02), case


def test_our_own_file_comes_back_with_foot_and_sigma(tmp_path):
    first = made(folder_of(tmp_path / "a", "pivpy-mm"), Piv)
    (tmp_path / "b").mkdir()
    first.save(tmp_path / "b")
    (tmp_path / "b" / "experiment.toml").write_text('[piv_field]\nfile = "piv.nc"\nfoot_row = 5.0\naxis_column = 5.0\n')
    again = made(tmp_path / "b", Piv)
    for k in ("u", "v", "u_sigma", "chc", "foot_y", "foot_v", "x", "y", "t"):
        assert np.allclose(again.field[k].values, first.field[k].values, equal_nan=True), k
    assert again.geometry.overlap == pytest.approx(2.0)


def test_the_command_fits_a_foreign_field(tmp_path):
    folder = folder_of(tmp_path / "e", "pivlab-mat")
    assert not main(["fit", str(folder), "--results", str(tmp_path / "r"), "--json"])
    fits = json.loads((tmp_path / "r" / "fits.json").read_text())
    assert fits["log_a"]["value"] == pytest.approx(-1.0 / DEEP, rel=0.05)


def edited(folder, old, new):
    file = folder / "experiment.toml"
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    return folder


@pytest.mark.parametrize(
    "case, old, new, said",
    [
        ("openpiv", 'length = "px"\n', "", ["length", "no units", 'length = "px"']),
        ("openpiv", 'speed = "px/frame"\n', "", ["speed", "no units"]),
        ("pivlab-mat", f"frame_rate = {RATE}\n", "", ["frame_rate", "px/frame"]),
        ("pivlab-mat", f"scale = {SCALE}\n", "length = \"mm\"\n", ["scale", "metres"]),
        ("pivpy-mm", "[piv_field]\n", "[piv_field]\nscale = 1e-4\n", ["scale", "in mm"]),
    ],
)  # fmt: skip
def test_what_the_file_does_not_say_is_asked_for(tmp_path, case, old, new, said):
    folder = edited(folder_of(tmp_path / "e", case), old, new)
    with pytest.raises(InputError) as e:
        made(folder, Piv)
    for word in ("[piv_field]", str(folder), *said):
        assert word in str(e.value)


def test_an_axis_of_unknown_direction_is_asked_for(tmp_path):
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
    with pytest.raises(InputError, match=r"field_10\.txt: line"):
        made(folder, Piv)
    savemat(folder / "session.mat", {"resultslist": np.zeros((3, 3))})
    edited(folder, "field_*.txt", "session.mat")
    with pytest.raises(InputError, match="session; export"):
        made(folder, Piv)
    (folder / "old.mat").write_bytes(b"MATLAB 7.3 MAT-file" + b" " * 105 + b"\x00\x02IM" + b"\x00" * 400)
    edited(folder, "session.mat", "old.mat")
    with pytest.raises(InputError, match="-v7"):
        made(folder, Piv)
    edited(folder, "old.mat", "experiment.toml")
    with pytest.raises(InputError, match="no known vector file"):
        made(folder, Piv)


@pytest.mark.parametrize("length", [1, 2, 4])
def test_scatter_gives_the_noise_of_overlapping_windows(length):
    rng = np.random.default_rng(length)
    white = rng.normal(0.0, 1.0, (400, 60 + length))
    f = sum(white[:, k : k + 60] for k in range(length)) / math.sqrt(length)
    f += 0.3 * np.sin(np.arange(60) / 10.0)  # the flow: its second difference is 0.3/100
    # 400 x 60/length independent triples: the median has 1.2/sqrt(n) = 1 to 2 %
    assert scatter_sigma(f, np.ones(f.shape, bool), length) == pytest.approx(1.0, rel=0.05)
    # the same model of correlation as the momentum uses
    assert correlated_variance(np.array([[1.0, -2.0, 1.0]]), length) == pytest.approx(
        6.0 - 8.0 * max(0, 1 - 1 / length) + 2.0 * max(0, 1 - 2 / length)
    )


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
