"""Packing of a bed against air pulses: both laws and one that is not listed, their sigma, and a campaign's beds."""

from __future__ import annotations

import json
import math
from itertools import product

import numpy as np
import pytest
import xarray as xr
from conftest import later

from jumpvision.cli import main
from jumpvision.laboratory.campaign import write_campaign
from jumpvision.laboratory.jumper import Law
from jumpvision.laboratory.protocol import BedImage, Jump, Protocol, Records
from jumpvision.laboratory.samples import SAND_ROBOT
from jumpvision.thesis.studies.sand.compaction import fit_compaction, share

PULSES = np.repeat([0.0, 1, 3, 10, 30, 100, 300], 3)
MEASURED, SCATTER = 3e-4, 1e-3  # of volume fraction
TRUTH = {  # of a bed after n pulses; the last is no law of the fit: grains that settle at two rates
    "logarithmic": lambda n: 0.571 + 0.069 * (1 - 1 / (1 + 0.35 * np.log(1 + n / 2.5))),
    "stretched": lambda n: 0.571 + 0.051 * (1 - np.exp(-((n / 40.0) ** 0.55))),
    "two rates": lambda n: 0.571 + 0.02 * (1 - np.exp(-n / 4.0)) + 0.03 * (1 - np.exp(-n / 90.0)),
}


def drawn(law, rng):
    phi = TRUTH[law](PULSES) + rng.normal(0, SCATTER, PULSES.size) + rng.normal(0, MEASURED, PULSES.size)
    return fit_compaction(PULSES, phi, np.full(PULSES.size, MEASURED))


def test_the_laws_worked_out_by_hand():
    assert share("logarithmic", [0.0, 2.5 * (np.e - 1)], 1.0, 2.5) == pytest.approx([0.0, 0.5], abs=1e-12)
    assert share("stretched", [0.0, 40.0], 0.55, 40.0) == pytest.approx([0.0, 1 - 1 / np.e], abs=1e-12)


@pytest.mark.parametrize("law", ["logarithmic", "stretched"])
def test_a_law_without_noise_is_found_and_turned_round(law):
    fit = fit_compaction(PULSES, TRUTH[law](PULSES), np.full(PULSES.size, 1e-6))
    assert fit.law == law and fit.decided and fit.scatter < 1e-6
    assert fit.at([0.0, 7.0, 200.0])[0] == pytest.approx(TRUTH[law](np.array([0.0, 7.0, 200.0])), abs=1e-6)
    assert fit.pulses(float(TRUTH[law](20.0)))[0] == pytest.approx(20.0, rel=1e-3)
    assert np.isnan(fit.pulses(0.5)).all() and np.isnan(fit.pulses(0.75)).all()


@pytest.mark.long
@pytest.mark.parametrize("law", ["two rates", *later("logarithmic", "stretched")])
def test_stated_sigma_covers(law):
    """60 campaigns of 21 beds: packings of the mean law at four numbers of pulses and the pulses of a packing.

    14 degrees of freedom of repeats: 2 sigma holds 93.5 %. 240 packings, of which those of one fit go together: 60 to
    240 independent ones; 3 binomial sigma of 120 are 6.7 %.
    """
    rng = np.random.default_rng(11)
    at, inside, right = np.array([0.5, 5.0, 20.0, 200.0]), [], []
    wanted = float(TRUTH[law](25.0))
    for _ in range(60):
        fit = drawn(law, rng)
        mean, sigma = fit.at(at)
        inside.append(np.abs(mean - TRUTH[law](at)) < 2 * sigma)
        n, s = fit.pulses(wanted)
        right.append(abs(n - 25.0) < 2 * s)
        assert 0.5 * SCATTER < fit.scatter < 1.8 * SCATTER
    assert np.mean(inside) > 0.935 - 0.067
    assert np.mean(right) > 0.935 - 0.095  # 60 of them: 3 binomial sigma
    assert np.mean(np.abs(mean - TRUTH[law](at)) < 0.05 * sigma) < 0.5  # and it is no bound


def test_what_beds_share_moves_the_law_and_not_its_scatter():
    rng = np.random.default_rng(2)
    phi = TRUTH["logarithmic"](PULSES) + rng.normal(0, SCATTER, PULSES.size)
    own, shared = (fit_compaction(PULSES, phi, np.zeros(PULSES.size), c) for c in (0.0, 0.004))
    assert shared.scatter == own.scatter
    assert shared.at(10.0)[1] == pytest.approx(np.hypot(own.at(10.0)[1], 0.004), rel=1e-3)


def test_a_bed_that_does_not_pack_is_no_law():
    fit = fit_compaction(PULSES, np.full(PULSES.size, 0.58) - 1e-4 * PULSES, np.full(PULSES.size, MEASURED))
    assert np.isnan(fit.pulses(0.6)).all()


def test_bad_calls_are_named():
    with pytest.raises(ValueError, match="3 different numbers of pulses"):
        fit_compaction([0, 1, 2, 2], [0.57, 0.58, 0.59, 0.59], np.full(4, 1e-3))
    with pytest.raises(ValueError, match="shapes"):
        fit_compaction(PULSES, PULSES[:3], PULSES)


def write_beds(out):
    """Pictures of beds after pulses, with and without shaking that halves tau, each made twice."""
    still, beds = Law(1.0, 0.0, 0.0, 0.2, 0.0), {}
    for n, shaking, trial in product((0.0, 1.0, 10.0, 30.0, 100.0, 300.0), (0.0, 1.0), (1, 2)):
        phi = 0.622 - 0.051 * math.exp(-((n * (1.0 + shaking) / 80.0) ** 0.55))
        group = f"pulses{n:g}-shaking{shaking:g}"
        told = f"\n[preparation]\npulses = {n}\nshaking = {shaking}\nair_speed = 0.3\n"
        beds[Jump(f"{group}-{trial}", group, "none", still, phi)] = told
    sand = {"terms": ("linear_penetration",), "parameters": {"k": 2100.0}, "scatter": {"volume_fraction": 0.0015}}
    write_campaign(out, Protocol(SAND_ROBOT, tuple(beds), Records(bed_image=BedImage()), duration=0.3, **sand), seed=3)
    for jump, told in beds.items():
        with (out / jump.name / "experiment.toml").open("a", encoding="utf-8") as file:
            file.write(told)


def test_a_campaign_of_beds_tells_its_law(tmp_path, capsys):
    """Pictures of the laboratory's beds: pulses for a packing within 3 sigma of its own law, by its own writing."""
    write_beds(tmp_path / "beds")
    call = ["sweep", "granular", "--analysis", "packing", "--campaign", str(tmp_path / "beds"), "--workers", "1"]
    assert main([*call, "--results", str(tmp_path / "out"), "--json"]) == 0
    rows = {r["quantity"]: r["ours"] for r in json.loads(capsys.readouterr().out)["numbers"]}
    assert (tmp_path / "out" / "packing.png").exists()
    for words, tau in (("pulses of 0.3 m/s", 80.0), ("pulses of 0.3 m/s and shaking of 1 m/s²", 40.0)):
        n, s = map(float, rows[f"{words}: pulses for 0.590"].split(" ± "))
        true = tau * np.log(0.051 / (0.622 - 0.590)) ** (1 / 0.55)
        assert abs(n - true) < 3 * s < true
    with xr.open_dataset(tmp_path / "out" / "packing.nc") as data:
        assert data.sizes["bed"] == 24 and data.sizes["setting"] == 2
        assert 0.4 < float(data.scatter[0]) / (0.0015 * 0.59) < 2.0  # 8 degrees of freedom: 95 % within 0.5 to 1.5


def test_pulses_that_would_fluidise_the_bed_are_warned_of(tmp_path, capsys):
    (tmp_path / "experiment.toml").write_text(
        'ground = "granular"\n[bed]\nvolume_fraction = 0.57\ngrain_diameter = 0.001\nlength = 0.5\nwidth = 0.5\n'
        "[preparation]\npulses = 10\nair_speed = 0.45\n"
        '[rod_track]\nfile = "rod.csv"\n',
        encoding="utf-8",
    )
    (tmp_path / "rod.csv").write_text("time_s,height_m\n" + "".join(f"{i / 200},0.0\n" for i in range(50)))
    main(["check", str(tmp_path)])
    said = capsys.readouterr()
    assert "pulses of 0.450 m/s pack the bed; from 0.395 m/s on they would fluidise it" in said.out + said.err
