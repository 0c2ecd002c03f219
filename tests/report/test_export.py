"""Results for other programs: read back by those programs' libraries, equal to the last bit; whole or not there."""

from __future__ import annotations

import hashlib
import json
import shutil
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from jumpvision.cli import main
from tests.worlds.small import leftovers


@pytest.fixture
def campaign(calm) -> Path:
    """Results of two experiments; their terms of use stand in campaign.toml."""
    return calm / "results"


@pytest.fixture
def field(tmp_path) -> tuple[Path, xr.Dataset]:
    """Results with a field of 3 times on 5 x 4 places, as piv.nc has them (y falling, NaN where nothing matched)."""
    rng = np.random.default_rng(5)
    shape = (5, 4, 3)
    data = xr.Dataset(
        {n: (("y", "x", "t"), rng.normal(size=shape), {"units": "m/s"}) for n in ("u", "v", "u_sigma")}
        | {"reason": (("y", "x", "t"), rng.integers(0, 4, shape).astype("i1"))}
        | {"foot_y": ("t", rng.normal(size=3), {"units": "m"}), "scale": ((), 1.2e-4)},
        coords={
            "x": ("x", -0.01 + 0.0024 * np.arange(4), {"units": "m"}),
            "y": ("y", 0.02 - 0.003 * np.arange(5), {"units": "m"}),
            "t": ("t", 0.28 + 0.002 * np.arange(3), {"units": "s"}),
        },
        attrs={"delta_t": 0.002},
    )
    data.u[2, 1, 0] = np.nan
    folder = tmp_path / "results" / "exp"
    folder.mkdir(parents=True)
    data.to_netcdf(folder / "piv.nc", engine="netcdf4")
    declare(folder)
    return folder, data


def declare(folder: Path) -> None:
    """provenance.json of what lies there."""
    outputs = {f.name: hashlib.sha256(f.read_bytes()).hexdigest() for f in folder.iterdir() if f.suffix != ".json"}
    told = {"outputs": outputs, "made": {}, "versions": {}, "warnings": [], "inputs": {}, "command": "a test"}
    (folder / "provenance.json").write_text(json.dumps(told))


def export(folder: Path, kind: str, out: Path) -> Path:
    assert main(["export", str(folder), "--to", kind, "--out", str(out)]) == 0
    return out


def numbers(file: Path) -> pd.DataFrame:
    """Read with Python's own float, which rounds nothing."""
    return pd.read_csv(file, dtype=str, keep_default_na=False).map(lambda v: float(v or "nan"))


def test_a_field_as_csv_is_the_field(field, tmp_path):
    folder, data = field
    out = export(folder, "csv", tmp_path / "out")
    table = numbers(out / "piv_y_x_t.csv")
    assert list(table) == ["y_m", "x_m", "t_s", "u_m_s", "v_m_s", "u_sigma_m_s", "reason"]
    back = table.set_index(["y_m", "x_m", "t_s"]).to_xarray().sortby("y_m", ascending=False)
    for name, column in (("u", "u_m_s"), ("v", "v_m_s"), ("reason", "reason")):
        np.testing.assert_array_equal(back[column].values, data[name].values)
    np.testing.assert_array_equal(numbers(out / "piv_t.csv").foot_y_m, data.foot_y)
    assert pd.read_csv(out / "piv.csv").scale[0] == 1.2e-4
    assert dict(pd.read_csv(out / "piv_attributes.csv").values) == {"delta_t": 0.002}


def test_a_campaign_as_csv(campaign, tmp_path, capsys):
    """Every table with its bytes, every fit with its uncertainty, every value of a summary."""
    out = export(campaign, "csv", tmp_path / "out")
    assert (out / "jumps.csv").read_bytes() == (campaign / "jumps.csv").read_bytes()
    fits = json.loads((campaign / "jump-0001" / "fits.json").read_text())
    table = pd.read_csv(out / "jump-0001" / "fits.csv", dtype=str, keep_default_na=False).set_index("name")
    assert set(table.index) == set(fits)
    for name, entry in fits.items():
        for key in ("value", "sigma"):
            assert table[key][name] == ("" if entry[key] is None else repr(float(entry[key]))), name
    said = dict(pd.read_csv(out / "jump-0001" / "summary.csv", dtype=str).values)
    summary = json.loads((campaign / "jump-0001" / "summary.json").read_text())
    assert float(said["jump_height_m"]) == summary["jump_height_m"]
    page = (campaign / "jump-0001" / "report.html").read_text()
    assert "<p>Recordings: Doe et al., J. Exp. 7 (2024), doi:10.1234/abc.5 (CC-BY-4.0)</p>" in page


def test_vtk_reads_the_field_back(field, tmp_path):
    """Places, times, values and vectors, by VTK's own reader."""
    vtk = pytest.importorskip("vtkmodules.vtkIOXML")
    from vtkmodules.util.numpy_support import vtk_to_numpy

    folder, data = field
    out = export(folder, "vtk", tmp_path / "out")
    assert sorted(f.name for f in out.iterdir()) == ["piv.pvd", *(f"piv_000{k}.vti" for k in range(3))]
    rising = data.sortby("y")
    for k in range(3):
        reader = vtk.vtkXMLImageDataReader()
        reader.SetFileName(str(out / f"piv_000{k}.vti"))
        reader.Update()
        image = reader.GetOutput()
        assert image.GetDimensions() == (4, 5, 1)
        for i, (x, y) in enumerate((x, y) for y in rising.y.values for x in rising.x.values):
            assert image.GetPoint(i)[:2] == pytest.approx((x, y), abs=1e-15)
        values = {n: vtk_to_numpy(image.GetPointData().GetArray(n)) for n in ("u", "v", "reason", "velocity")}
        for name in ("u", "v", "reason"):
            np.testing.assert_array_equal(values[name].reshape(5, 4), rising[name].values[..., k])
        np.testing.assert_array_equal(values["velocity"][:, 1], values["v"])
        assert not values["velocity"][:, 2].any()
        assert vtk_to_numpy(image.GetFieldData().GetArray("TimeValue"))[0] == data.t.values[k]
        assert f'timestep="{float(data.t[k])!r}" file="piv_000{k}.vti"' in (out / "piv.pvd").read_text()


def test_places_that_no_image_has_are_refused(field, tmp_path, capsys):
    folder, data = field
    data.assign_coords(x=np.array([0.0, 1.0, 2.0, 4.0])).to_netcdf(folder / "piv.nc", engine="netcdf4")
    declare(folder)
    assert main(["export", str(folder), "--to", "vtk", "--out", str(tmp_path / "out")]) == 2
    assert "not evenly spaced" in capsys.readouterr().err
    assert not (tmp_path / "out").exists() and leftovers(tmp_path) == []


def test_an_ro_crate_by_its_own_library(campaign, field, tmp_path, capsys):
    """Every result is in it with its checksum; runs, terms of use and inputs are said; nothing is left out."""
    rocrate = pytest.importorskip("rocrate.rocrate")
    out = export(campaign, "ro-crate", tmp_path / "out")
    crate = rocrate.ROCrate(str(out))
    parts = {e.id: e for e in crate.data_entities}
    for name in ("jump-0000", "jump-0001"):
        told = json.loads((campaign / name / "provenance.json").read_text())
        assert (told["license"], told["citation"]) == ("CC-BY-4.0", "Doe et al., J. Exp. 7 (2024), doi:10.1234/abc.5")
        for file, digest in told["outputs"].items():
            assert parts[f"{name}/{file}"]["identifier"] == f"sha256:{digest}"
            assert hashlib.sha256((out / name / file).read_bytes()).hexdigest() == digest
        run = crate.dereference(f"#run-{name}")
        assert run.type == "CreateAction" and run["instrument"]["name"] == "jumpvision"
        assert {e["identifier"] for e in run["object"]} == {f"sha256:{d}" for d in told["inputs"].values()}
    assert "jumps.csv" in parts and "campaign.json" in parts
    lying = {f.relative_to(out).as_posix() for f in out.rglob("*") if f.is_file()}
    assert lying == parts.keys() | {"ro-crate-metadata.json"}
    assert [e.id for e in crate.root_dataset["license"]] == ["https://spdx.org/licenses/CC-BY-4.0"]
    assert [e.id for e in crate.root_dataset["citation"]] == ["https://doi.org/10.1234/abc.5"]
    assert "no license" not in capsys.readouterr().err
    bare = export(field[0], "ro-crate", tmp_path / "bare")
    assert "not stated" in rocrate.ROCrate(str(bare)).root_dataset["license"]
    assert "no license" in capsys.readouterr().err


def test_an_export_is_whole_or_not_there(campaign, tmp_path, monkeypatch, kind="csv"):
    """The disk fills in the middle: nothing is left. An export that is there is not written over."""
    out = tmp_path / "out"
    copy, calls = shutil.copyfile, []

    def full(*args, **kwargs):
        calls.append(args)
        if len(calls) > 2:
            raise OSError(28, "No space left on device", str(args[1]))
        return copy(*args, **kwargs)

    with monkeypatch.context() as m:
        m.setattr(shutil, "copyfile", full)
        m.setattr(shutil, "copy", full)
        assert main(["export", str(campaign), "--to", kind, "--out", str(out)]) == 1
    assert list(tmp_path.iterdir()) == []
    export(campaign, kind, out)
    before = {f: f.read_bytes() for f in out.rglob("*") if f.is_file()}
    assert main(["export", str(campaign), "--to", "csv", "--out", str(out)]) == 2
    assert {f: f.read_bytes() for f in out.rglob("*") if f.is_file()} == before


def test_what_is_not_what_its_run_has_written_is_refused(campaign, tmp_path, capsys):
    changed = tmp_path / "changed"
    shutil.copytree(campaign, changed)
    with (changed / "jump-0000" / "rod.csv").open("a") as f:
        f.write("9,9,9,9\n")
    assert main(["export", str(changed), "--to", "csv", "--out", str(tmp_path / "out")]) == 2
    assert "rod.csv: not what its run has written" in capsys.readouterr().err
    assert main(["export", str(tmp_path), "--to", "csv", "--out", str(tmp_path / "out")]) == 2
    assert "no results there" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
