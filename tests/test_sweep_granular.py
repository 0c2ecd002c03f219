"""Laws of the bed against phi and the granular sweeps: laws drawn and fitted back, axes, files, figures, bad calls.

Truth: laws drawn with known noise, the coverage of their stated uncertainties; jump.simulate with parameters put in by
hand for a point of a sweep; equations (32) and (33) for scaling. About 20 s on one core.
"""

import dataclasses
import functools
import json
import math
import os
import shutil
import subprocess
import sys
import tomllib
import types
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from conftest import later

from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.jumper.physics.batch import resolve, simulated_points
from jumpvision.jumper.physics.forcing import sinusoid
from jumpvision.jumper.physics.model import fitted_drag, fitted_parameter, force_model
from jumpvision.jumper.physics.packing import Laws, PackingLaw, fit_packing_law
from jumpvision.jumper.physics.sand.jump import simulate
from jumpvision.laboratory import samples
from jumpvision.laboratory.campaign import write_campaign
from jumpvision.laboratory.jumper import Law, motion_of
from jumpvision.laboratory.protocol import BedImage, Protocol, Records, RodTrack, jumps_of
from jumpvision.thesis.figures.sweeps import picture
from jumpvision.thesis.studies.axes import EXAMPLE, read_laws
from jumpvision.thesis.studies.compute import write
from jumpvision.thesis.studies.sand.shared import with_alpha
from jumpvision.thesis.studies.setup import setup_of
from jumpvision.thesis.studies.study import Call, run, studies

SMALL = {  # fewer points where the defaults are for a figure
    "height-phi": {"frequency": "5:11:7", "phi": "0.57:0.63:5"},
    "jump-types": {"phi": "0.57:0.63:5"},
    "plan-heights": {"apex": "0.03:0.04:2"},
    "plan-strategies": {"apex": "0.03:0.04:2"},
    "delay": {"delay": "0:0.3:31", "frequency": "8:11:4"},
    "alpha-fit": {"frequency": "5:11:7", "phi": "0.57:0.63:5"},
    "drag-scale": {"frequency": "5:11:4"},
    "foot-radius": {"foot_radius": "0.03:0.05:3"},
}
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


def test_the_parts_of_a_fitted_law_err_together_as_it_says():
    """The kink's place, value and slopes over 300 draws: correlations to four times 1/sqrt(300), the strongest far
    beyond; a kink found too far up lies too high on a law that rises."""
    rng = np.random.default_rng(12)
    fits = [
        fit_packing_law(PHI, kinked(PHI) + 100.0 * rng.standard_normal(PHI.size), np.full(PHI.size, 100.0), rng=rng)
        for _ in range(300)
    ]
    drawn = np.corrcoef([[f.phi_c, f.value_c, f.slope_below, f.slope_above] for f in fits], rowvar=False)
    stated = fit_packing_law(PHI, kinked(PHI), np.full(PHI.size, 100.0)).covariance
    size = np.sqrt(np.diag(stated))
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


def line(low, high):
    """A parameter that grows from low at phi 0.57 to high at 0.63."""
    return lambda phi: low + (high - low) * (phi - 0.57) / 0.06


MEASURED_BEDS = Protocol(
    samples.SAND_ROBOT,
    jumps_of("single", [8.0, 10.0], volume_fraction=[0.57, 0.60]),
    Records(rod_track=RodTrack(), bed_image=BedImage()),
    terms=samples.SAND_TERMS,
    parameters=samples.SAND_TRUTH
    | {"k1": line(2100.0, 4500.0), "k2": 2100.0, "delta": 0.015, "b": line(17.2, 40.0), "theta": 1.0471975512},
    duration=0.7,
    model={"terms": samples.SAND_TERMS, "k1": 2100.0, "k2": 2100.0, "delta": 0.015, "C": 2.7, "mu": 2.0, "b": 20.0},
)


@pytest.mark.long
def test_the_drag_is_fitted_to_jumps_on_beds_of_measured_packing_and_an_override_says_so(tmp_path, capsys):
    """The laws begin where the loosest bed was seen; sigma of phi 2e-4 moves k1 by 8 N/m, b by some 0.1."""
    (tmp_path / "laws.toml").write_text("k1 = {phi = [0.5702, 0.63], value = [2108.0, 4500.0]}")
    folder = str(tmp_path / "jumps")
    write_campaign(tmp_path / "jumps", MEASURED_BEDS, seed=samples.SEED)
    call = ["sweep", "granular", "--analysis", "drag-fit", "--campaign", folder, "--workers", "1", "--no-pictures"]
    call += ["--laws", str(tmp_path / "laws.toml"), "--results"]
    capsys.readouterr()
    assert main([*call, str(tmp_path / "r")]) == 0
    assert "their outer lines go on" in capsys.readouterr().err
    with xr.open_dataset(tmp_path / "r" / "drag-fit.nc") as data:
        assert float(data.phi_of_jump_sigma.min()) > 1e-5 and float(data.packing_sigma.max()) < 1e-3
        truth = np.interp(data.packing, [0.57, 0.63], [17.2, 40.0])
        assert (np.abs(data.value - truth) < 4.0 * data.value_sigma + 0.01 * truth).all()  # 1 %: the law of k1 is off
    assert main([*call, str(tmp_path / "o"), "--set", "bed.volume_fraction=0.6"]) == 0
    told = capsys.readouterr().err
    assert told.count("[bed] volume_fraction = 0.6 overrides 0.5") == 2
    one = tmp_path / "jumps" / "single-8Hz-phi0.57-1"
    robot = setup_of("granular", one, {})
    assert robot.values["phi"] == pytest.approx(0.57, abs=1e-3) and robot.phi_sigma > 0.0
    assert "as measured" in robot.name


def test_the_example_holds_the_printed_set():
    laws, p = read_laws(EXAMPLE), SAND.model.parameters
    at = laws.points(0.57, SAND.model.foot_radius)
    for name in ("k1", "k2", "delta", "b", "C", "mu"):
        assert float(at[f"model.{name}"]) == getattr(p, name)
    assert float(at["model.k1"]) / (math.pi * 3.81**2) / 100 == pytest.approx(0.46, abs=0.005)  # N/cm^3


@pytest.mark.parametrize(
    "text, words",
    [
        ("k7 = 1.0", "did you mean"),
        ("k1 = {phi = [0.6, 0.57], value = [1.0, 2.0]}", "increasing"),
        ("k1 = {phi = [0.57, 0.6], value = [1.0]}", "as long"),
        ("k1 = {phi = [0.57, 0.6], value = [1.0, -2.0]}", "k1 = -2"),
        ("k1 = 'stiff'", "must be a number, or a table"),
        ("foot_radius = 0\nk1 = 1.0", "foot_radius = 0"),
        ("", "holds no law"),
        ("k1 = [", "not valid TOML"),
    ],
)
def test_a_bad_file_of_laws_is_told(text, words, tmp_path):
    (tmp_path / "laws.toml").write_text(text)
    with pytest.raises(InputError) as error:
        read_laws(tmp_path / "laws.toml")
    assert words in str(error.value) and "laws.toml" in str(error.value)


# -- the drag of the singles -----------------------------------------------------------------------------------------
def test_a_drag_is_fitted_back():
    """Heights linear in alpha between the ones tried: the fit is exact there, and at an end it says so by staying."""
    alpha, slope = np.array([0.0, 10.0, 40.0, 100.0]), np.array([1e-4, 3e-4])
    heights = 0.04 + alpha[:, None] * slope
    found, rms = fitted_drag(alpha, heights, [0.04 + 27.0 * slope[0], 0.04 + 27.0 * slope[1]])
    assert found == pytest.approx(27.0, abs=1e-3) and rms < 1e-7  # xatol 1e-4
    assert fitted_drag(alpha, heights, [0.2, np.nan])[0] == pytest.approx(100.0, abs=1e-3)
    with pytest.raises(ValueError, match="no jump is finite"):
        fitted_drag(alpha, heights, [np.nan, np.nan])


def test_a_constant_drag_is_that_of_the_machines_own_foot():
    """Laws of another foot are scaled with its area: a drag tried on a wider foot is not, whatever foot they are of."""
    for own in (0.0381, 0.0762):
        wide = dataclasses.replace(
            SAND, laws=read_laws(EXAMPLE), model=dataclasses.replace(SAND.model, foot_radius=own)
        )
        laws = with_alpha(types.SimpleNamespace(setup=wide), np.array([0.58, 0.60]), 50.0)
        np.testing.assert_allclose(laws.points([0.58, 0.60], own)["model.alpha"], 50.0, rtol=1e-12)


SINGLE = Path(__file__).parents[1] / "data_samples" / "loose_sand" / "single-6.5Hz-1"
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
@functools.cache
def study(name, laws=None, model=None, **axes):
    return run(Call("granular", axes, name, laws=laws, model=model, say=lambda text: None))


def contract(folder):
    script = os.environ.get("JUMPVISION_CONTRACT_CHECK")
    if not script:
        pytest.skip("JUMPVISION_CONTRACT_CHECK does not name contract_check.py")
    done = subprocess.run([sys.executable, script, str(folder)], capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_point_of_a_sweep_over_phi_has_the_parameters_of_the_laws():
    """Foot twice as wide as that of the laws: forces by area (4), and the laws' own values where they hold."""
    data, _ = study("map", laws=EXAMPLE, phi="0.58:0.62:2", foot_radius="0.0762", frequency="7", phase="1.5708")
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


def test_the_laws_change_nothing_where_they_are_the_model():
    with_laws, _ = study("map", laws=EXAMPLE, frequency="5:9:3", phase="4.7124")
    without, _ = study("map", frequency="5:9:3", phase="4.7124")
    np.testing.assert_array_equal(with_laws.jump_height_m, without.jump_height_m)


def test_a_model_file_replaces_the_model(tmp_path):
    file = tmp_path / "model.toml"
    file.write_text(
        '[model]\nterms = ["two_resistance", "inertial_drag"]\nk1 = 2100\nk2 = 2100\ndelta = 0.01\nalpha = 73'
    )
    data, _ = study("map", model=file, frequency="6:8:2", phase="1.5708")
    model = force_model(SAND.model, "constant drag", alpha=73.0)
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


ALL = [n for n, s in studies("granular").items() if not (s.of_campaign or s.any_axes)]
LONG = ("plan-heights", "plan-strategies", "jump-types")


@pytest.mark.parametrize("name", [n for n in ALL if n not in LONG] + later(*LONG))
def test_every_analysis_gives_a_file_a_figure_and_numbers(name, tmp_path):
    if name.startswith("plan"):
        pytest.importorskip("casadi", reason="planning needs CasADi: pip install 'jumpvision[plan]'")
    data, rows = study(name, **SMALL.get(name, {}))
    assert rows and all(r["ours"] and "nan" not in r["ours"] for r in rows)
    assert all("units" in v.attrs for v in data.data_vars.values())
    write(data, tmp_path)
    assert picture(data).startswith(b"\x89PNG")
    contract(tmp_path)


def test_granular_plans_hold_on_sand_and_rigid_ones_do_not():
    """Thesis Fig 64; robots and beds a few per cent off move a height by some per cent."""
    pytest.importorskip("casadi", reason="planning needs CasADi: pip install 'jumpvision[plan]'")
    data, _ = study("plan-heights", **SMALL["plan-heights"])
    off = np.abs(data.jumped_m - data.apex).mean("robot") / data.apex
    assert (off.sel(group="granular plan, sand") < 0.05).all()
    assert (off.sel(group="rigid plan, rigid ground") < 0.05).all()
    assert (off.sel(group="rigid plan, sand") > 0.4).all()
    np.testing.assert_allclose(data.resimulated_m, np.stack([data.apex] * 2), atol=1e-4)


def test_foot_forces_scale_with_area_and_added_mass_with_volume():
    data, _ = study("foot-radius", **SMALL["foot-radius"])
    r = data.foot_radius.values
    np.testing.assert_allclose(data.drag_kg_per_m / data.drag_kg_per_m[0], (r / r[0]) ** 2, rtol=1e-12)
    np.testing.assert_allclose(data.added_mass_kg / data.added_mass_kg[0], (r / r[0]) ** 3, rtol=1e-12)
    cone = math.pi * r**3 * math.tan(math.pi / 3) / 3  # the cone of height R tan(theta) that (33) ends as
    np.testing.assert_allclose(data.added_mass_kg, 2.7 * 0.57 * 1000.0 * cone, rtol=1e-9)


# -- the command -----------------------------------------------------------------------------------------------------
def test_the_command(tmp_path, capsys):
    words = ["--laws", str(EXAMPLE), "--phi", "0.58:0.62:3", "--frequency", "8", "--phase", "4.712"]
    assert main(["sweep", "granular", *words, "--results", str(tmp_path), "--json", "--workers", "1"]) == 0
    said = json.loads(capsys.readouterr().out)
    assert [os.path.basename(f) for f in said["files"]] == ["sweep.nc", "sweep.png"]
    contract(tmp_path)


@pytest.mark.parametrize(
    "words, told",
    [
        (["granular", "--analysis", "jump-type"], "did you mean 'jump-types'"),
        (["hard", "--analysis", "delay"], "is of granular ground"),
        (["hard", "--laws", str(EXAMPLE)], "no meaning on hard ground"),
        (["granular", "--laws", "nowhere.toml"], "cannot be read"),
        (["granular", "--model", "nowhere.toml"], "cannot be read"),
        (["granular", "--laws", str(EXAMPLE), "--phi", "0.5:0.6:3"], "outside 0.57 to 0.63"),
        (["granular", "--analysis", "jump-types", "--phi", "0.5:0.6:3"], "outside 0.57 to 0.63"),
        (["granular", "--analysis", "delay", "--foot-radius", "0.03"], "does not use it"),
        (["granular", "--analysis", "delay", "--set", 'model.terms=["two_resistance"]'], "add depth_drag"),
    ],
)
def test_a_bad_call_is_told_and_writes_nothing(words, told, tmp_path, capsys):
    assert main(["sweep", *words, "--results", str(tmp_path / "out"), "--workers", "1"]) == 2
    assert told in capsys.readouterr().err and not (tmp_path / "out").exists()


# -- the drag of measured jumps --------------------------------------------------------------------------------------
def test_a_parameter_fitted_to_jumps_has_a_true_uncertainty():
    """Heights of the laboratory's own integrator with b against phi put in, 0.3 mm of noise: pulls of 40 fits."""
    rng, tried, sigma = np.random.default_rng(4), np.geomspace(5.0, 60.0, 25), 3e-4
    frequency, robot = np.array([5.0, 7.0, 9.0, 11.0]), setup_of("granular", None, {})
    pulls = []
    for b in (14.0, 17.2, 22.0, 40.0):
        truth = {**samples.SAND_TRUTH, "b": b, "delta": 0.01}
        true = [
            motion_of(samples.SAND_ROBOT, Law(f, 0.01875, 1.5 * math.pi, 0.05), samples.SAND_TERMS, truth,
                       ground="granular", bed_density=570.0, duration=1.0, dt=1e-5, every=10).jump_height
            for f in frequency
        ]  # fmt: skip
        v = resolve(robot.values, {"frequency": frequency[None, :], "phase": 1.5 * math.pi, "model.b": tried[:, None]})
        v = {n: np.broadcast_to(x, (tried.size, 4)).ravel() for n, x in v.items()}
        heights = simulated_points(robot.model, v, rtol=1e-7, atol=1e-9)["jump_height_m"].reshape(-1, 4)
        for _ in range(10):
            value, spread, _ = fitted_parameter(
                tried, heights, true + sigma * rng.standard_normal(4), np.full(4, sigma)
            )
            pulls.append((value - b) / spread)
    # 40 pulls of a unit normal (a little less where chi2 widens them): rms within 4/sqrt(80)
    assert 0.55 < np.sqrt(np.mean(np.square(pulls))) < 1.45 and abs(np.mean(pulls)) < 4 / math.sqrt(40), pulls


def test_an_end_of_the_tried_values_is_no_answer():
    heights = np.linspace(0.05, 0.01, 5)[:, None] * np.ones(3)
    assert np.isnan(fitted_parameter(np.arange(5.0), heights, np.full(3, 0.005), np.full(3, 1e-4))).all()


def test_the_drag_of_a_campaign_is_the_one_put_in(tmp_path, capsys):
    """Twelve jumps of the sample. Its k1 differs by 1 % from jump to jump: 0.3 mm of height, 2 % of b."""
    sand = SINGLE.parent
    for folder in sand.glob("*-1"):
        shutil.copytree(folder, tmp_path / "sand" / folder.name)
    shutil.copy(sand / "campaign.toml", tmp_path / "sand")
    (tmp_path / "cone.toml").write_text(
        "[model]\nterms = ['two_resistance', 'depth_drag', 'added_mass']\n"
        "k1 = 2100.0\nk2 = 2100.0\ndelta = 0.012\nC = 2.7\nmu = 2.0\nb = 10.0\n"
    )
    call = ["sweep", "granular", "--analysis", "drag-fit", "--campaign", str(tmp_path / "sand")]
    assert (
        main([*call, "--model", str(tmp_path / "cone.toml"), "--results", str(tmp_path / "r"), "--workers", "1"]) == 0
    )
    assert "b at phi 0.57" in capsys.readouterr().out
    with xr.open_dataset(tmp_path / "r" / "drag-fit.nc") as data:
        assert data.attrs["parameter"] == "b" and data.n.values.tolist() == [12]
        assert float(data.value[0]) == pytest.approx(17.2, rel=0.05) and 0.0 < float(data.value_sigma[0]) < 0.5
    assert (tmp_path / "r" / "drag-fit.png").stat().st_size > 5000
    assert (
        main(call[:4]) == 2 and "--analysis comparison or drag-fit or packing: go together" in capsys.readouterr().err
    )


def test_a_diagnosis_gives_the_robot_that_it_fitted(tmp_path):
    """A stiffness half a per cent off is a quarter of a millimetre of height."""
    file = tmp_path / "model.toml"
    file.write_text("[model]\nterms = ['linear_penetration']\nk = 2000.0\n[robot]\nspring_stiffness = 3210.0\n")
    assert setup_of("granular", None, {}, model_file=file).model.k_s == 3210.0
    given = {"robot": {"spring_stiffness": 3000.0}}
    assert setup_of("granular", None, given, model_file=file).model.k_s == 3000.0
