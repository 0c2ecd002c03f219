"""Laws of the bed against phi, drawn and fitted back, in files and in maps on sand. Truth: the coverage of stated
uncertainties; jump.simulate with parameters put in by hand."""

import dataclasses
import math
import tomllib

import numpy as np
import pytest
from shared import ROOT

from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.jumper.physics.forcing import sinusoid
from jumpvision.jumper.physics.packing import Laws, PackingLaw, fit_packing_law
from jumpvision.jumper.physics.sand.jump import simulate
from jumpvision.sweeps.axes import read_laws
from jumpvision.sweeps.robot import setup_of
from jumpvision.sweeps.sweep import sweep

EXAMPLE = ROOT / "pipelines" / "thesis" / "example_laws.toml"
SAND = setup_of("granular", None, {})
PHI = np.repeat(np.linspace(0.57, 0.63, 9), 2)


# -- laws ------------------------------------------------------------------------------------------------------------
def kinked(phi, phi_c=0.605, below=40e3, above=220e3):
    return 3500.0 + below * np.minimum(phi - phi_c, 0.0) + above * np.maximum(phi - phi_c, 0.0)


def test_a_law_without_noise_is_found_exactly():
    fit = fit_packing_law(PHI, kinked(PHI), np.full(PHI.size, 10.0))
    assert fit.phi_c == pytest.approx(0.605, abs=1e-7)  # the search stops at 1e-9 in phi
    assert (fit.slope_below, fit.slope_above) == pytest.approx((40e3, 220e3), rel=1e-4)
    np.testing.assert_allclose(fit.law(PHI), kinked(PHI), rtol=1e-6)
    assert fit.p_straight < 1e-3 and fit.interval[0] <= 0.605 <= fit.interval[1]


def test_uncertainties_of_a_fitted_law_are_true():
    """z of every parameter, 95 % interval of phi_c and sigma of the value over 300 draws."""
    rng = np.random.default_rng(11)
    sigma = 100.0 + 100.0 * rng.random(PHI.size)
    truth, z, inside = np.array([0.605, 3500.0, 40e3, 220e3]), [], 0
    for _ in range(300):
        fit = fit_packing_law(PHI, kinked(PHI) + sigma * rng.standard_normal(PHI.size), sigma, rng=rng)
        found = np.array([fit.phi_c, fit.value_c, fit.slope_below, fit.slope_above])
        z.append((found - truth) / np.sqrt(np.diag(fit.covariance)))
        inside += fit.interval[0] <= 0.605 <= fit.interval[1]
    # the scatter factor max(1, chi2/dof) of 14 degrees of freedom widens by 7 % on average; 300 draws: 4 % of a sigma
    assert np.all(np.abs(np.std(z, axis=0) - 0.95) < 0.13), np.std(z, axis=0)
    assert np.all(np.abs(np.mean(z, axis=0)) < 0.2)  # 0.06 expected of chance; bias of a kink below 0.2 sigma
    assert 0.92 * 300 < inside <= 0.995 * 300, inside  # 95 % widened by the same factor, +- 4 binomial sigmas below
    # they err together as stated, to four times 1/sqrt(300): a kink found too far up lies too high on a rising law
    stated = fit_packing_law(PHI, kinked(PHI), sigma).covariance
    size = np.sqrt(np.diag(stated))
    drawn = np.corrcoef(z, rowvar=False)
    np.testing.assert_allclose(drawn, stated / np.outer(size, size), atol=4.0 / math.sqrt(300.0))
    assert drawn[0, 1] > 0.5


def test_a_straight_law_seldom_asks_for_a_kink():
    rng = np.random.default_rng(5)
    p = [
        fit_packing_law(PHI, 3000.0 + 5e4 * (PHI - 0.6) + 100.0 * rng.standard_normal(PHI.size),
                        np.full(PHI.size, 37.0), rng=rng).p_straight
        for _ in range(200)
    ]  # fmt: skip
    # uniform, whatever the stated sigma: 5 % and 50 % of 200, +- 4 binomial sigmas
    assert np.mean(np.array(p) < 0.05) < 0.05 + 4 * math.sqrt(0.05 * 0.95 / 200)
    assert abs(np.mean(np.array(p) < 0.5) - 0.5) < 4 * math.sqrt(0.25 / 200)


def test_a_law_that_cannot_be_fitted_or_asked_is_refused():
    with pytest.raises(ValueError, match="five or more"):
        fit_packing_law([0.57, 0.58, 0.6, 0.61, np.nan], np.ones(5), np.ones(5))
    with pytest.raises(ValueError, match="sigma: must be > 0"):
        fit_packing_law(PHI, PHI, np.zeros(PHI.size))
    with pytest.raises(ValueError, match=r"outside 0.57 to 0.6"):
        PackingLaw((0.57, 0.6), (1.0, 2.0))([0.58, 0.61])


def test_a_law_reaches_beyond_its_ends_by_what_a_volume_fraction_is_uncertain_by():
    law = PackingLaw((0.57002, 0.6, 0.63004), (2000.0, 3000.0, 6000.0))
    slope = 1000.0 / (0.6 - 0.57002)
    assert float(law(0.57)) == pytest.approx(2000.0 - slope * 2e-5)  # told with three decimals
    assert float(law(0.5693, sigma=3e-4)) == pytest.approx(2000.0 - slope * 7.2e-4)
    with pytest.raises(ValueError, match=r"outside 0\.57002 to 0\.63004"):
        law(0.5693, sigma=2e-4)
    with pytest.raises(ValueError, match="phi = nan"):
        law(np.nan)
    laws = Laws({"k1": law})
    assert "2e-05 beyond 0.57002 to 0.63004, where the laws of k1" in laws.continued(0.57) and not laws.continued(0.6)


def test_the_example_holds_the_printed_set():
    laws, p = read_laws(EXAMPLE), SAND.model.parameters
    at = laws.points(0.57, SAND.model.foot_radius)
    for name in ("k1", "k2", "delta", "b", "C", "mu"):
        assert float(at[f"model.{name}"]) == getattr(p, name)
    assert float(at["model.k1"]) / (math.pi * 3.81**2) / 100 == pytest.approx(0.46, abs=0.005)  # N/cm^3


def test_a_bad_file_of_laws_is_told(tmp_path):
    for text, words in (
        ("k7 = 1.0", "did you mean"),
        ("k1 = {phi = [0.6, 0.57], value = [1.0, 2.0]}", "increasing"),
        ("k1 = {phi = [0.57, 0.6], value = [1.0]}", "as long"),
        ("k1 = {phi = [0.57, 0.6], value = [1.0, -2.0]}", "k1 = -2"),
        ("foot_radius = 0\nk1 = 1.0", "foot_radius = 0"),
        ("", "holds no law"),
    ):
        (tmp_path / "laws.toml").write_text(text)
        with pytest.raises(InputError) as error:
            read_laws(tmp_path / "laws.toml")
        assert words in str(error.value) and "laws.toml" in str(error.value)


SINGLE = ROOT / "data_samples" / "loose_sand" / "single-6.5Hz-1"
MODEL_LAWS = """
[model.laws]
foot_radius = 0.01905
[model.laws.k1]
phi = [0.56, 0.58, 0.63]
value = [500.0, 700.0, 1700.0]
[model.laws.delta]
phi = [0.56, 0.58]
value = [0.010, 0.014]
"""


def test_laws_of_a_model_file_give_an_experiment_the_values_of_its_packing(tmp_path):
    """By hand at the phi of the sample; a foot of twice the radius has four times the force."""
    phi = tomllib.loads((SINGLE / "experiment.toml").read_text())["bed"]["volume_fraction"]
    (tmp_path / "laws.toml").write_text(MODEL_LAWS)
    k1, delta = 4 * (500.0 + (phi - 0.56) / 0.02 * 200.0), 0.010 + (phi - 0.56) / 0.02 * 0.004
    sets = ["--set", f"model.k1={k1}", "--set", f"model.delta={delta}"]
    for name, more in (("a", ["--model", str(tmp_path / "laws.toml")]), ("b", sets), ("plain", [])):
        assert main(["simulate", str(SINGLE), "--results", str(tmp_path / name), *more]) == 0
    a, b, plain = (np.loadtxt(tmp_path / n / "simulation.csv", delimiter=",", skiprows=1) for n in ("a", "b", "plain"))
    np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9)
    assert np.abs(a[:, 1] - plain[:, 1]).max() > 1e-4
    assert read_laws(tmp_path / "laws.toml").laws["k1"].value == (500.0, 700.0, 1700.0)  # the same file for a sweep


@pytest.mark.parametrize(
    "text, words",
    [
        ("[model.laws.k1]\nphi = [0.6, 0.63]\nvalue = [1.0, 2.0]\n", "phi = 0.5708 is outside 0.6 to 0.63"),
        ("[model.laws.k_1]\nphi = [0.5, 0.63]\nvalue = [1.0, 2.0]\n", "k_1: unknown parameter of the bed"),
        ("[model]\nlaws = 'laws.toml'\n", "laws = 'laws.toml': must be a table of laws"),
    ],
)
def test_bad_laws_of_a_model_are_told(text, words, tmp_path, capsys):
    (tmp_path / "laws.toml").write_text(text)
    call = ["simulate", str(SINGLE), "--results", str(tmp_path / "r"), "--model", str(tmp_path / "laws.toml")]
    assert main(call) in (1, 2)
    assert words in capsys.readouterr().err


# -- sweeps ----------------------------------------------------------------------------------------------------------


AT = {"frequency": "7", "phase": "1.5708"}


def test_a_point_of_a_sweep_over_phi_has_the_parameters_of_the_laws():
    """Foot twice as wide as that of the laws: forces by area (4), and the laws' own values where they hold."""
    data = sweep("granular", AT | {"phi": "0.58:0.62:2", "foot_radius": "0.0762"}, laws=read_laws(EXAMPLE))
    assert data.jump_height_m.dims == ("phi",) and "example" in data.attrs["laws_source"]
    for i, (k1, k2, b) in enumerate(  # by hand from example_laws.toml
        [(2100 + 1400 * 10 / 35, 2100 + 2400 * 10 / 60, 17.2 + 4.8 * 10 / 35),
         (3500 + 5500 * 15 / 25, 2100 + 2400 * 50 / 60, 22.0 + 18.0 * 15 / 25)]
    ):  # fmt: skip
        p = dataclasses.replace(SAND.model.parameters, k1=4 * k1, k2=4 * k2, b=b)
        model = dataclasses.replace(SAND.model, parameters=p, foot_radius=0.0762,
                                    volume_fraction=float(data.phi[i]))  # fmt: skip
        law = sinusoid(7.0, 0.01875, 1.5708)
        jump = simulate(model, law, t=[0.0, law.stop + 0.6], rtol=1e-9, atol=1e-11)
        assert float(data.jump_height_m[i]) == pytest.approx(jump.jump_height, abs=2e-6)  # rtol 1e-6 of the sweep


def test_a_model_file_replaces_the_model(tmp_path):
    file = tmp_path / "model.toml"
    file.write_text(
        '[model]\nterms = ["two_resistance", "inertial_drag"]\nk1 = 2100\nk2 = 2100\ndelta = 0.01\nalpha = 73'
    )
    data = sweep("granular", AT | {"frequency": "6:8:2"}, model=file)
    drag = dataclasses.replace(SAND.model.parameters, alpha=73.0)
    model = dataclasses.replace(SAND.model, terms=("two_resistance", "inertial_drag"), parameters=drag)
    law = sinusoid(8.0, 0.01875, 1.5708)
    jump = simulate(model, law, t=[0.0, law.stop + 0.6], rtol=1e-9, atol=1e-11)
    assert float(data.jump_height_m[1]) == pytest.approx(jump.jump_height, abs=2e-6)
    assert "model.toml" in data.attrs["robot"]
    file.write_text('[model]\nterms = ["two_resistance"]\nk1 = 2100\nk2 = 2100')
    with pytest.raises(InputError, match=r"model.toml: model delta: missing"):
        setup_of("granular", None, {}, model_file=file)
    file.write_text("k1 = 2100")
    with pytest.raises(InputError, match=r"\[model\]: missing"):
        setup_of("granular", None, {}, model_file=file)


def test_a_diagnosis_gives_the_robot_that_it_fitted(tmp_path):
    """A stiffness half a per cent off is a quarter of a millimetre of height."""
    file = tmp_path / "model.toml"
    file.write_text("[model]\nterms = ['linear_penetration']\nk = 2000.0\n[robot]\nspring_stiffness = 3210.0\n")
    assert setup_of("granular", None, {}, model_file=file).model.k_s == 3210.0
    given = {"robot": {"spring_stiffness": 3000.0}}
    assert setup_of("granular", None, given, model_file=file).model.k_s == 3000.0
