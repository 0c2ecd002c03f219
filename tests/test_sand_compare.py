"""Measured heights on sand beside models, on campaigns of the laboratory's own integrator."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from conftest import ROOT

from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.laboratory import recordings as logs
from jumpvision.laboratory import write
from jumpvision.laboratory.jumper import Law, Robot, motion_of
from jumpvision.sweeps.axes import read_laws
from jumpvision.sweeps.comparison import compare
from jumpvision.sweeps.figures import picture

NOISE = 5e-5  # m, of a track at 200 frames a second
SAND = Robot(1.125, 0.175, 0.04, 3300.0, 1.2, 0.0381, 9.81)
TERMS = ["two_resistance", "depth_drag", "added_mass"]
FIXED = {"C": 2.7, "mu": 2.0, "theta": math.pi / 3, "delta": 0.01}
LAWS = read_laws(ROOT / "pipelines" / "thesis" / "example_laws.toml")
STUTTER, SINGLE = 0.5 * math.pi, 1.5 * math.pi  # rad
KINDS = {"single": SINGLE, "stutter": STUTTER}


def bed_at(phi: float) -> dict[str, float]:
    """k1, k2, b of the example's bed."""
    return {n: float(LAWS.laws[n](phi)) for n in ("k1", "k2", "b")}


def sand_campaign(folder: Path, jumps: list[dict[str, Any]], extra: float = 0.0, **bed: Any) -> Path:
    """Tracks of jumps (kind, frequency, phi, delay) on the cone; extra [kg/m]: drag that no model declares."""
    rng = np.random.default_rng(53)
    folder.mkdir()
    model = {"terms": TERMS, **FIXED, **bed}
    tables: dict[str, Any] = {
        "ground": "granular",
        "robot": SAND._asdict(),
        "bed": {"grain_density": 1000.0},
        "model": model,
    }
    if not bed:
        tables["model.laws"] = {"foot_radius": 0.0381, "C": 2.7}
        for name in ("k1", "k2", "b"):
            law = LAWS.laws[name]
            tables[f"model.laws.{name}"] = {"phi": list(law.phi), "value": list(law.value)}
    write.toml(folder / "campaign.toml", tables)
    for i, jump in enumerate(jumps):
        kind, f, phi, delay = jump["kind"], jump["frequency"], jump.get("phi", 0.57), jump.get("delay", 0.0)
        terms, truth = list(TERMS), {**FIXED, **(bed or bed_at(phi))}
        if extra:
            terms, truth = [*terms, "inertial_drag"], {**truth, "alpha": extra}
        law = Law(f, 0.01875, KINDS[kind], 0.2, delay=delay)
        last, rho = law.stop + 0.5, 1000.0 * phi
        motion = motion_of(
            SAND, law, terms, truth, ground="granular", duration=last, bed_density=rho, dt=5e-6, every=20
        )
        own = folder / f"jump-{i:02d}"
        own.mkdir()
        write.table(own / "rod.csv", logs.rod_track(motion, rate=200.0, noise=NOISE, zero=0.01, rng=rng))
        actuation = {
            "kind": kind if not delay else "delayed_stutter",
            "frequency": f,
            "amplitude": 0.01875,
            "start": 0.2,
        }
        known = {"actuation": actuation | ({"delay": delay} if delay else {}), "rod_track": {"file": "rod.csv"}}
        write.toml(own / "experiment.toml", {"group": jump.get("group", ""), **known, "bed": {"volume_fraction": phi}})
    return folder


def compared(folder: Path, model: Path | None = None) -> xr.Dataset:
    return compare("granular", folder, folder.parent / "out", model=model, say=lambda _: None)


def test_heights_over_packing_stand_beside_the_models_laws(tmp_path):
    """Thesis Fig 45: two kinds at four packings, two trials each. The laboratory is the model: 0.15 mm is four sigma of
    two tracks (0.02 mm each)."""
    points = [(k, f, phi) for k, f in (("single", 9.0), ("stutter", 5.5)) for phi in (0.57, 0.59, 0.605, 0.62)]
    jumps = [{"kind": k, "frequency": f, "phi": phi, "group": f"{k} {phi}"} for k, f, phi in 2 * points]
    data = compared(sand_campaign(tmp_path / "c", jumps))
    assert data.sizes["condition"] == 8 and (data.trials == 2).all()
    assert sorted(data.kind.values.tolist()) == ["single"] * 4 + ["stutter"] * 4
    np.testing.assert_allclose(np.unique(data.phi), [0.57, 0.59, 0.605, 0.62])
    assert np.abs(data.difference_m).max() < 1.5e-4
    assert np.ptp(data.simulated_height_m.values[data.kind == "single"]) > 0.02
    assert picture(data).startswith(b"\x89PNG")


def test_a_second_model_has_residuals_of_its_own(tmp_path):
    """Thesis Fig 49: a drag that the declared model lacks is in the other."""
    jumps = [{"kind": "single", "frequency": f} for f in (5.0, 6.5, 8.0, 10.0)]
    bed = {"k1": 2100.0, "k2": 2100.0, "b": 17.2}
    folder = sand_campaign(tmp_path / "c", jumps, extra=60.0, **bed)
    values = "".join(f"{n} = {x}\n" for n, x in (bed | FIXED | {"alpha": 60.0}).items())
    (tmp_path / "model.toml").write_text(f"[model]\nterms = {[*TERMS, 'inertial_drag']}\n{values}".replace("'", '"'))
    data = compared(folder, model=tmp_path / "model.toml")
    assert data.model_name.values.tolist() == ["declared model", "model.toml"]
    off = data.measured_height_m - data.model_height_m
    assert np.abs(off.isel(model=1)).max() < 1.5e-4 and off.isel(model=0).max() > 5e-3
    assert picture(data).startswith(b"\x89PNG")
    assert data.attrs["p_value"] < 1e-4


def test_the_command_takes_a_second_model(tmp_path, capsys):
    """Two frequencies at two packings: a model of the loosest bed alone is off by some mm on the denser."""
    jumps = [{"kind": "single", "frequency": f, "phi": phi} for f in (7.0, 9.0) for phi in (0.57, 0.61)]
    folder, bed = tmp_path / "c", {"k1": 2100.0, "k2": 2100.0, "b": 17.2}
    sand_campaign(folder, jumps)
    values = "".join(f"{n} = {x}\n" for n, x in (bed | FIXED).items())
    (tmp_path / "model.toml").write_text(f"[model]\nterms = {TERMS}\n{values}".replace("'", '"'))
    call = ["sweep", "granular", "--analysis", "comparison", str(folder)]
    assert main([*call, "--model", str(tmp_path / "model.toml"), "--workers", "1"]) == 0
    assert "chi2" in capsys.readouterr().out
    with xr.open_dataset(tmp_path / "results" / "c" / "comparison.nc") as data:
        off = data.measured_height_m - data.model_height_m
        loose = data.phi.values < 0.58
        assert np.abs(off.isel(model=0)).max() < 1.5e-4 and np.abs(off.isel(model=1)).values[~loose].min() > 2e-3


def test_heights_over_delay(tmp_path):
    """Thesis Fig 47, its law driven without a loop."""
    jumps = [{"kind": "stutter", "frequency": 9.0, "delay": d} for d in (0.05, 0.08, 0.11, 0.14)]
    folder = sand_campaign(tmp_path / "c", jumps, k1=2100.0, k2=2100.0, b=17.2)
    data = compared(folder)
    np.testing.assert_allclose(data.delay, (0.05, 0.08, 0.11, 0.14))
    assert np.abs(data.difference_m).max() < 1.5e-4
    with pytest.raises(InputError, match="sweep granular compares it"):
        compare("hard", folder, tmp_path / "out")
