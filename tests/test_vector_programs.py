"""Vectors of other programs: what they interpolated, which way y counts, DaVis and Insight; small files written here,
and real ones (JUMPVISION_REAL_DATA)."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from jumpvision.base.schema import InputError
from jumpvision.experiment.init.recognise import recognised
from jumpvision.experiment.inputs.sections import PivField
from jumpvision.experiment.inputs.vectors import read_vectors
from jumpvision.experiment.stages.grains.vectors import foreign_field

REAL = Path(os.environ.get("JUMPVISION_REAL_DATA", "")) / "vector_files"
real = pytest.mark.skipif(not REAL.is_dir(), reason="JUMPVISION_REAL_DATA names no folder with vector_files")
X, Y = 16.0 * np.arange(1, 8), 16.0 * np.arange(1, 6)  # px, of the picture: rows downwards
TURN = 0.1  # 1/frame, of a rigid rotation; counter-clockwise as one sees it, so that its vorticity is 2 x TURN


def rotation():
    """x, y and u, v of the picture (y and v downwards), (rows, columns); no vector is zero."""
    x, y = np.meshgrid(X, Y)
    return x, y, TURN * (y - Y.mean() - 3.0), -TURN * (x - X.mean() - 3.0)


def vorticity(field):
    """dv/dx - du/dy over coordinates that count right and up."""
    f = field.sortby("x").sortby("y").isel(t=0)
    return f.v.differentiate("x") - f.u.differentiate("y")


def pivpy(path, chc, born, *, bad=None, **values):
    """A file as pivpy saves it, y falling: chc (rows, columns), and what it read it from. bad: vectors put to it."""
    _, _, u, v = rotation()
    v = -v
    if bad is not None:
        u, v = np.where(bad, 0.0, u), np.where(bad, 0.0, v)
    at = ("y", "x", "t")
    data = xr.Dataset(
        {"u": (at, u[..., None]), "v": (at, v[..., None]), "chc": (at, np.asarray(chc, float)[..., None])},
        coords={"x": X, "y": Y[::-1], "t": [0.0]},
        attrs={"files": [born], "pivpy_schema_version": "1"},
    )
    data.to_netcdf(path)
    return path


ODD = np.zeros((5, 7), bool)
ODD[1, 2] = ODD[3, 3] = True


@pytest.mark.parametrize(
    ("born", "good", "odd", "empty"),
    [
        ("B00001.vc7", 1, 5, False),  # DaVis interpolated
        ("PIVlab.mat", 1, 2, False),  # PIVlab replaced
        ("Run1.vec", 1, -1, False),  # Insight refused
        ("Run1.vec", 1, 2, False),  # and took from elsewhere
        ("field.txt", 0, 1, True),  # OpenPIV's flags, its NaN put to 0 by pivpy
        ("B00001.txt", 1, 1, True),  # DaVis' text: zeros where masked
    ],
)
def test_what_a_program_interpolated_was_not_measured(tmp_path, born, good, odd, empty):
    file = pivpy(tmp_path / "a.nc", np.where(ODD, odd, good), born, bad=ODD if empty else None)
    assert np.array_equal(read_vectors(file).valid[..., 0], ~ODD)


def test_second_peaks_of_davis_are_measured(tmp_path):
    file = pivpy(tmp_path / "a.nc", np.where(ODD, 5, 2), "B00001.vc7")
    assert np.array_equal(read_vectors(file).valid[..., 0], ~ODD)


def test_flags_that_may_mean_either_are_asked_for(tmp_path):
    file = pivpy(tmp_path / "a.nc", ODD, "field.txt")
    with pytest.raises(InputError, match=r"give measured = \[0\], or \[1\]"):
        read_vectors(file)
    assert np.array_equal(read_vectors(file, (0.0,)).valid[..., 0], ~ODD)
    assert np.array_equal(read_vectors(file, (1.0,)).valid[..., 0], ODD)


def test_a_field_without_a_measured_vector_is_refused(tmp_path):
    file = pivpy(tmp_path / "a.nc", 0 * ODD - 1, "Run1.vec")
    with pytest.raises(InputError, match="no vector is measured by its flags"):
        read_vectors(file)


def openpiv(path, upwards, top_first):
    x, y, u, v = rotation()
    y = (Y[0] + Y[-1] - y) if upwards else y
    order = slice(None) if top_first else slice(None, None, -1)
    columns = [c[order].ravel() for c in (x, y, u, -v if upwards else v, 0 * x, 0 * x)]
    np.savetxt(path, np.stack(columns, 1), "%.6e", "\t", header="x\ty\tu\tv\tflags\tmask")
    return path


@pytest.mark.parametrize("upwards", [True, False])
@pytest.mark.parametrize("top_first", [True, False])
def test_the_sense_of_rotation_is_right_or_asked_for(tmp_path, upwards, top_first):
    """Rows that ascend are those of the picture, or were sorted with y up: vorticity came as -0.2 for 0.2."""
    file = openpiv(tmp_path / "a.txt", upwards, top_first)
    keys = {"length": "px", "speed": "px/frame", "frame_rate": 1.0, "sigma": 0.1}
    falls = upwards is top_first
    if not falls:
        with pytest.raises(InputError, match=r"up: y grows along the rows .* give up = "):
            foreign_field(PivField(file.name, file, **keys), None)
    up = "file" if falls and upwards else "+y" if upwards else "-y"
    found = vorticity(foreign_field(PivField(file.name, file, up=up, **keys), None).field)
    assert found.values == pytest.approx(np.full(found.shape, 2 * TURN))


def davis(path, decimal=",", rows=None):
    """As DaVis writes a vector field: y up in mm, falling; zeros where masked."""
    x, y, u, v = rotation()
    u, v = np.where(ODD, 0.0, u), np.where(ODD, 0.0, -v)
    lines = ["\t".join(f"{n:.6g}" for n in row) for row in zip(*(c.ravel() for c in (x, np.flipud(y), u, v)))]
    head = '#DaVis 8.1.6 2D-vector 16 5 7 "position" "mm" "position" "mm" "velocity" "m/s"\n'
    path.write_text(head + "\n".join(lines[:rows]).replace(".", decimal) + "\n")
    return path


@pytest.mark.parametrize("decimal", [",", "."])
def test_davis_text(tmp_path, decimal):
    found = read_vectors(davis(tmp_path / "B1.txt", decimal))
    _, _, u, v = rotation()
    assert (found.length, found.speed, found.up) == ("mm", "m/s", "+y")
    assert np.array_equal(found.valid[..., 0], ~ODD)
    assert found.u[..., 0][~ODD] == pytest.approx(u[~ODD], rel=1e-5)
    assert found.v[..., 0][~ODD] == pytest.approx(-v[~ODD], rel=1e-5)
    with pytest.raises(InputError, match="28 rows, 35 by its header: cut off"):
        read_vectors(davis(tmp_path / "B2.txt", decimal, rows=28))


def insight(path, rows=None):
    x, y, u, v = rotation()
    head = 'TITLE="E:\\5%G\\Größe.vec" VARIABLES="X pixel", "Y pixel", "U pixel", "V pixel", "CHC", '
    head += 'DATASETAUXDATA MicrosecondsPerDeltaT="2000.0" ZONE I=7, J=5, F=POINT\n'
    flag = np.where(ODD, -1, 1)
    lines = [", ".join(f"{n:.6f}" for n in row) for row in zip(*(c.ravel() for c in (x, np.flipud(y), u, -v, flag)))]
    path.write_bytes((head + "\n".join(lines[:rows]) + "\n").encode("latin-1"))
    return path


def test_insight_vec(tmp_path):
    file = insight(tmp_path / "Run1.vec")
    found = read_vectors(file)
    assert (found.length, found.speed, found.up, found.pair) == ("pixel", "pixel", "+y", pytest.approx(2e-3))
    assert np.array_equal(found.valid[..., 0], ~ODD)
    keys = {"length": "px", "sigma": 0.1}
    field = foreign_field(PivField(file.name, file, frame_rate=500.0, **keys), None).field
    assert vorticity(field).values == pytest.approx(np.full((5, 7), 2 * TURN * 500.0))
    with pytest.raises(
        InputError, match=r"frame_rate = 25: the images of a pair are 0.002 s apart by the file, 0.04 s"
    ):
        foreign_field(PivField(file.name, file, frame_rate=25.0, **keys), None)
    with pytest.raises(InputError, match="21 rows, 35 by its header"):
        read_vectors(insight(tmp_path / "cut.vec", rows=21))


@pytest.mark.parametrize("write", [davis, insight])
def test_init_knows_the_fields(tmp_path, write):
    name = write(tmp_path / ("B.txt" if write is davis else "R.vec")).name
    assert recognised(tmp_path, name, None).section == "piv_field"


@real
def test_real_davis_text_with_decimal_commas():
    found = read_vectors(REAL / "davis8_decimal_comma_B00001.txt")
    table = np.loadtxt(
        [r.replace(",", ".") for r in (REAL / "davis8_decimal_comma_B00001.txt").read_text().splitlines()[1:]]
    )
    assert found.u.shape == (64, 64, 1) and (found.length, found.speed, found.up) == ("mm", "m/s", "+y")
    assert found.x[0] == -14.9635 and found.y[[0, -1]].tolist() == [32.4113, -6.71505]
    assert np.array_equal(found.u[..., 0].ravel(), table[:, 2])
    assert found.valid.sum() == (table[:, 2:] != 0.0).any(axis=1).sum() < 64 * 64


@real
def test_real_insight_files():
    found = read_vectors(REAL / "insight_Run000001.vec")
    assert found.u.shape == (63, 63, 1) and (found.length, found.speed, found.up) == ("mm", "m/s", "+y")
    assert found.valid.sum() == 3616 and found.pair == pytest.approx(2e-3) and found.u[0, 13, 0] == 0.009765
    found = read_vectors(REAL / "insight_day2a005000.vec")
    assert found.u.shape == (43, 41, 1) and found.valid.sum() == 1500 and found.pair == pytest.approx(0.055)


@real
def test_real_openpiv_files():
    found = read_vectors(REAL / "openpiv_interTest.txt")
    assert found.up == "+y" and found.valid.sum() == 565
    assert read_vectors(REAL / "openpiv_old_exp1_001_b.vec").up is None
