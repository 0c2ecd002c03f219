"""Slow intrusion: logs of the laboratory, whose force law and noise share nothing with the fit."""

import json
import math

import numpy as np
import pandas as pd
import pytest
from shared import later

from jumpvision.cli import main
from jumpvision.estimate.mean import correlation_time
from jumpvision.estimate.strokes import deep_ripple
from jumpvision.experiment.campaign.measured.intrusions import FITTED, Fitted, SlowIntrusion, bed_laws
from jumpvision.experiment.inputs.parameters import IntrusionParams
from jumpvision.experiment.stages.bed.intrusion import curves_of
from jumpvision.laboratory import write
from jumpvision.laboratory.intrusions import Arm, Grains, log
from jumpvision.sweeps.axes import read_laws

ARM = Arm(surface=0.0007)
DOWN = [("to", 0.06)]


def fitted(moves, grains, arm=ARM, seed=0, start=-0.006, radius=None):
    d = log(moves, grains, arm, start=start, rng=np.random.default_rng(seed))
    return curves_of(d["time_s"], d["depth_m"], d["force_N"], "log", IntrusionParams(), radius)


def near(e, true, sigmas=4.0):
    assert abs(e.value - true) < sigmas * e.sigma, (e, true)


@pytest.mark.long
def test_sigmas_of_both_slopes_bend_contact_and_weight_are_the_true_errors():
    """Load cell noise and grain fluctuations of 0.3 N over 1 mm: some 30 independent samples in the whole log.

    90 logs: 0.683 +- 3 * 0.049 = 0.54..0.83; mean pull +- 3/sqrt(90) = 0.32, and the posterior mean of a bend is skew
    by some 0.2 sigma. The 95 % interval: 0.95 - 3 * 0.023 = 0.88.
    """
    truth = {"k1": 2000.0, "k2": 1200.0, "delta": 0.015, "contact_depth_m": 0.0007, "weight_N": 0.8}
    pulls, held = [], []
    for seed in range(90):
        r = fitted(DOWN, Grains(fluctuation=0.3), seed=seed)
        pulls.append([(r.fits[k].value - v) / r.fits[k].sigma for k, v in truth.items()])
        low, high = r.slopes.shape_interval()
        held.append(low < 0.015 < high)
    inside = np.mean(np.abs(pulls) < 1.0, axis=0)
    sure = np.arange(5) == list(truth).index("contact_depth_m")
    assert np.all((inside > 0.54) & ((inside < 0.86) | sure)), inside
    assert np.all(np.abs(np.mean(pulls, axis=0)) < 0.55), np.mean(pulls, axis=0)
    assert np.mean(held) > 0.88
    if inside[sure][0] >= 0.86:
        pytest.xfail(f"the contact point's sigma is too wide: {inside[sure][0]:.2f} of the logs within it")


@pytest.mark.long
def test_the_second_slope_is_refused_where_there_is_none():
    """p is uniform under the null: of 40 logs 2 +- 1.4 below 0.05, and half below 0.5."""
    p = np.array([fitted(DOWN, Grains(fluctuation=0.3, k2=2000.0), seed=100 + i).p_one_slope for i in range(40)])
    assert np.sum(p < 0.05) <= 6
    assert 0.3 < np.mean(p < 0.5) < 0.7 + 0.05
    fits = fitted(DOWN, Grains(fluctuation=0.1, k2=2000.0)).fits
    assert math.isnan(fits["delta"].value) and "one slope" in fits["delta"].reason
    near(fits["k1"], 2000.0)
    assert fitted(DOWN, Grains(fluctuation=0.1)).p_one_slope == 0.001


def test_a_log_that_begins_in_contact_takes_its_depth_as_it_stands():
    fits = fitted(DOWN, Grains(fluctuation=0.1), Arm(weight=0.0), start=2e-4).fits
    assert "in contact" in fits["contact_depth_m"].reason
    for name, true in (("k1", 2000.0), ("k2", 1200.0), ("delta", 0.015)):
        near(fits[name], true)


def test_reintrusions_are_found_proportional_to_depth():
    moves = [m for z in np.arange(0.006, 0.058, 0.006) for m in (("to", z), ("to", -0.003))] + DOWN
    r = fitted(moves, Grains(fluctuation=0.1), Arm(surface=0.003))
    b, fits = r.likelier.model.bins, r.fits
    assert b.event_kind == ("reintrusion",) * 9 and np.isnan(b.event_pause).all()
    assert b.event_depth == pytest.approx(np.arange(0.006, 0.058, 0.006), abs=1e-5)
    for name, true in (("lam", 0.004), ("s", 300.0), ("s_intercept", 0.0), ("s_exponent", 1.0)):
        near(fits[name], true)
    assert fits["s"].sigma < 0.05 * 300 and fits["s_exponent"].sigma < 0.1


def test_stop_and_go_knows_its_pauses_and_their_effect():
    moves = [m for i, z in enumerate(np.arange(0.005, 0.06, 0.005)) for m in (("to", z), ("pause", (0.2, 1, 5)[i % 3]))]
    r = fitted([*moves, *DOWN], Grains(fluctuation=0.1, per_decade=60.0))
    b = r.likelier.model.bins
    assert set(b.event_kind) == {"stop_go"}
    assert b.event_pause[:3] == pytest.approx([0.2, 1.0, 5.0], abs=0.01)  # to some samples of 2 ms
    near(r.fits["s_p"], 200.0)
    near(r.fits["s_p_per_decade"], 60.0)


@pytest.mark.long
def test_repeated_stops_compound_where_they_do():
    """Steps of 1 and 6 mm in turn: what is left of the last overshoot differs, so c is likelier apart from s."""
    at = np.cumsum([0.008] + [0.001, 0.006] * 7)
    moves = [m for z in at for m in (("to", z), ("pause", 0.5))] + [("to", at[-1] + 0.01)]
    grains = Grains(fluctuation=0.02, build_up=1e-4)
    for carry in (0.0, 0.7):
        fits = fitted(moves, Grains(**{**vars(grains), "carry": carry})).fits
        near(fits["s_p_compounding"], carry)
        assert fits["s_p_compounding"].sigma < 0.15


def rings(z, k1, sigma, mu, R):
    """The growing cone summed over its way: no law of the package (theta 60 degrees)."""
    way = np.arange(0.0, max(z, 0.0) + 1e-9, 5e-5)
    face = np.clip(R - mu * way / math.sqrt(3.0), 0.0, None) ** 2 / R**2
    return float(np.trapezoid(k1 * face + sigma * math.pi * R**2 * 2.0 * (1.0 - face), way))


@pytest.mark.parametrize("radius", [0.0127, 0.0381])
def test_the_cone_is_fitted_to_the_log_itself(radius):
    """k1, sigma_cone and mu of the truth within 3 sigma; two slopes leave k1 of the widest foot 10 % low."""
    k1, mu = 0.46e6 * math.pi * radius**2, 2.2
    sigma = 0.5 * k1 / (2.0 * math.pi * radius**2)
    z = np.linspace(0.0, 0.07, 351)
    F = np.array([rings(x, k1, sigma, mu, radius) for x in z])
    grains = Grains(static=lambda x: float(np.interp(x, z, F)), fluctuation=6e-5 * k1)
    fits = fitted(DOWN, grains, radius=radius).fits
    for name, true in (("k1_cone", k1), ("sigma_cone", sigma), ("mu_cone", mu)):
        near(fits[name], true, 3.0)
    if radius > 0.03:
        assert fits["k1"].value < 0.93 * k1 and fits["k1_cone"].sigma < 0.02 * k1


@pytest.mark.parametrize("cone", [True, *later(False)])
def test_laws_of_a_bed_take_k1_of_what_tells_the_intrusions(cone):
    """Five beds, the foot of 76 mm: k1 of the cone's own fit where the cone grows, of two slopes where it bends."""
    radius, rows, true = 0.0381, [], []
    z = np.linspace(0.0, 0.07, 351)
    for i, phi in enumerate((0.57, 0.58, 0.59, 0.60, 0.61)):
        k1, grown = 2000.0 + 300.0 * i, 0.5 * (2000.0 + 300.0 * i) / (2.0 * math.pi * radius**2)
        F = np.array([rings(x, k1, grown, 2.2, radius) for x in z])
        static = {"static": lambda x, F=F: float(np.interp(x, z, F))} if cone else {"k1": k1, "k2": 0.6 * k1}
        found = fitted(DOWN, Grains(fluctuation=6e-5 * k1, **static), seed=i, radius=radius)
        fits = {n: Fitted(e.value, e.sigma) for n in FITTED if (e := found.fits.get(n))}
        odds = found.cone_entry(math.pi / 3, radius)["log_odds"]
        none, unknown = np.zeros(0), dict.fromkeys(FITTED, Fitted(math.nan, math.nan))
        rows.append(
            SlowIntrusion(str(phi), radius, phi, 0.0, 0.0, unknown | fits, none, none, none, None, cone_odds=odds)
        )
        true.append(k1)
    laws = bed_laws(rows)
    assert set(laws.fits) == ({"k1", "sigma_cone", "mu"} if cone else {"k1", "k2", "delta"})
    packings = np.array([r.volume_fraction for r in rows])
    assert laws.fits["k1"].line(packings) == pytest.approx(true, rel=0.02)  # a log's sigma is 1 %; slopes are 10 % off
    assert ("rft_cone" in laws.toml("test")) == cone


def test_oscillations_below_the_bend_are_measured():
    """A saw tooth of amplitude 0.8 N has variance 0.8^2/3; bins of 0.28 mm average 5 % of a 3 mm saw away."""
    r = fitted(DOWN, Grains(fluctuation=0.1, saw=0.8)).slopes
    bend = r.surface + r.fits["shape"].value
    ripple = deep_ripple(r.model.bins.z, r.residual, surface=r.surface, bend=bend)
    assert ripple.variance.value == pytest.approx(0.8**2 / 3, abs=4 * ripple.variance.sigma + 0.05 * 0.21)
    assert ripple.spacing == pytest.approx(0.003, rel=0.1)
    assert "no oscillation" in fitted(DOWN, Grains(fluctuation=0.1)).fits["ripple_N"].reason


def test_correlation_time_of_an_autoregressive_series():
    """rho = 0.8: (1 + rho)/(1 - rho) = 9; relative error of the windowed sum about sqrt(2 (2 M + 1)/n) = 7 %."""
    rng, x = np.random.default_rng(0), np.zeros(40_000)
    for i in range(1, x.size):
        x[i] = 0.8 * x[i - 1] + rng.normal()
    assert correlation_time(x) == pytest.approx(9.0, rel=0.21)
    assert correlation_time(rng.normal(size=40_000)) == pytest.approx(1.0, abs=0.05)


@pytest.fixture
def folder(tmp_path):
    d = log(
        [("to", 0.02), ("to", -0.003), *DOWN], Grains(fluctuation=0.1), ARM, start=-0.006, rng=np.random.default_rng(3)
    )
    write.table(tmp_path / "intrusion.csv", d)
    (tmp_path / "experiment.toml").write_text(
        '[robot]\nfoot_radius = 0.0381\n[intrusion_log]\nfile = "intrusion.csv"\n'
    )
    return tmp_path


def test_the_command_writes_the_names_of_the_contract(folder, tmp_path):
    assert main(["run", str(folder), "--results", str(tmp_path / "r")]) == 0
    fits = json.loads((tmp_path / "r" / "fits.json").read_text())
    for name, true in (("k1", 2000.0), ("k2", 1200.0), ("delta", 0.015), ("s", 300.0), ("lam", 0.004)):
        assert abs(fits[name]["value"] - true) < 4.0 * fits[name]["sigma"], name
        assert set(fits[name]) >= {"value", "sigma", "unit", "n", "chi2"}
    record = json.loads((tmp_path / "r" / "intrusion.json").read_text())
    assert [e["kind"] for e in record["events"]] == ["reintrusion"]
    cone = {k: np.array(v) for k, v in record["cone"].items()}
    assert cone["flat_N"] + cone["mantle_N"] == pytest.approx(cone["force_N"])
    assert fits["sigma_cone"]["unit"] == "N/m^3" and fits["mu_cone"]["value"] == pytest.approx(float(cone["mu"]))


@pytest.mark.parametrize(
    "change, parts",
    [
        (lambda d: d.rename(columns={"depth_m": "depth"}), ("depth_m", "missing")),
        (lambda d: d.assign(force_N=d.force_N.where(d.index != 6)), ("force_N", "row 7", "finite")),
        (lambda d: d[:5], ("5 rows", "at least 40")),
    ],
)
def test_a_bad_log_is_one_clear_error(folder, tmp_path, capsys, change, parts):
    file = folder / "intrusion.csv"
    change(pd.read_csv(file)).to_csv(file, index=False)
    assert main(["intrusion", str(folder), "--results", str(tmp_path / "r")]) in (1, 2)
    said = capsys.readouterr().err
    assert said.count("error: ") + said.count("jumpvision: ") == 1
    assert all(part in said for part in ("intrusion.csv", *parts)) and not (tmp_path / "r" / "intrusion.json").exists()


@pytest.mark.long
def test_a_campaign_shows_the_foot_area_law_and_the_critical_packing(tmp_path):
    """13 logs: k1 = 0.46e6 A (...) bends at phi_c = 0.605 and the saw begins there; F ~ R^2 by construction."""
    assert main(["synth", "intrusion", str(tmp_path / "s")]) == 0
    path, results = tmp_path / "s" / "intrusion", tmp_path / "r"
    assert main(["run", str(path), "--results", str(results), "--workers", "1", "--no-pictures"]) == 0
    table = pd.read_csv(results / "intrusion.csv")
    truth = [json.loads((path / n / "truth.json").read_text())["fits"] for n in table.experiment]
    for name in ("k1", "k2", "delta", "s", "s_p", "lam"):
        pull = (table[name] - [t[name] for t in truth]) / table[f"{name}_sigma"]
        assert pull.abs().max() < 4.0, (name, pull)
    data = json.loads((results / "intrusion_laws.json").read_text())
    for name, true in (("k1_radius_exponent", 2.0), ("k2_radius_exponent", 2.0), ("phi_c_from_k1", 0.605)):
        assert abs(data["laws"][name]["value"] - true) < 4.0 * data["laws"][name]["sigma"], name
    low, high = data["phi_c_from_ripple_ci95"]
    assert low - 0.002 < 0.605 < high and high - low < 0.01  # weak oscillations just above phi_c are not seen
    assert len(data["cone"]) == 13
    laws = read_laws(results / "bed_laws.toml")
    assert set(laws.laws) == {"k1", "k2", "delta"} and laws.foot_radius == 0.0381
    own = [t for t, r in zip(truth, table.itertuples()) if r.foot_radius_m == 0.0381]
    packing = table.volume_fraction[table.foot_radius_m == 0.0381]
    for name, rel in (("k1", 0.01), ("k2", 0.01), ("delta", 0.03)):  # sigmas of one log are 0.2 to 1 %, 1 to 3 %
        assert [float(x) for x in laws.laws[name](packing)] == pytest.approx([t[name] for t in own], rel=rel)
    for name in ("k1", "k2"):
        low, high = data["bed_laws"][name]["phi_c_ci95"]
        assert low - 0.001 < 0.605 < high + 0.001 and high - low < 0.01
    assert not data["bed_laws"]["delta"]["kinked"]  # the same at every packing
    assert "Slow intrusions" in (results / "report.html").read_text()
