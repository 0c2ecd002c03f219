"""Campaigns whose experiments have models of their own: other beds, and motors of which some are logged."""

from __future__ import annotations

import tomllib
from dataclasses import replace

import numpy as np
import pytest

from jumpvision.base.schema import InputError
from jumpvision.engine.fitting import Problem
from jumpvision.experiment.campaign.model_file import model_files
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.question.jumper import Jumper, of_jump
from jumpvision.jumper.question.learning import learn_noise
from jumpvision.jumper.question.words import values as values_of
from jumpvision.laboratory.blind import Nuisance, campaign, draw
from tests.worlds.jumps import jumps_of

QUIET = Nuisance(5e-5, 0.0, 0.0)


def test_a_parameter_declared_apart_is_fitted_for_each_bed():
    """Two beds of 2,000 and 2,300 N/m, declared 2 % off; one friction. Priors of 100 N/m, each about its own value."""
    jumps, true = [], {}
    for seed, k1 in ((41, 2000.0), (44, 2300.0)):
        rng = np.random.default_rng(seed)
        hidden = draw(rng, ground="granular", hidden=("coulomb_friction",), nuisance=QUIET, jumps="few")
        values = {**hidden.protocol.parameters, "k1": k1, "k2": 1800.0, "alpha": 60.0, "dk": 0.0, "F_c": 0.1}
        hidden = replace(hidden, protocol=replace(hidden.protocol, parameters=values))
        found, fit, _ = jumps_of(hidden, campaign(hidden, rng))
        for j in found:
            declared = replace(j.model.parameters, k1=1.02 * k1, k2=1800.0)
            jumps.append(replace(j, model=replace(j.model, parameters=declared), name=f"{seed} {j.name}"))
        true[1.02 * k1] = k1
    system = Jumper(jumps, fit, {"k1": 100.0})
    assert system.apart == {"k1": sorted(true)}
    assert [(p.name, p.start) for p in system.baseline][1:] == [("k1[0]", 2040.0), ("k1[1]", 2346.0)]
    assert {"k1", "k1[0]", "k1[1]"} <= set(system.candidates["linear_penetration"].drops)
    assert "k1" not in [p.name for p in system.candidates["rft_cone"].parameters]
    learned = learn_noise(system)
    f = Problem(learned.system, learned.noise, learned.scatter).fit(("coulomb_friction",), {"F_c": 0.05})
    for k, k1 in enumerate((2000.0, 2300.0)):
        assert f.named[f"k1[{k}]"] == pytest.approx(k1, abs=4 * f.sigma(f"k1[{k}]"))
        assert f.sigma(f"k1[{k}]") < 25.0  # a quarter of the prior
    assert f.named["F_c"] == pytest.approx(0.1, abs=4 * f.sigma("F_c"))
    text = model_files(f, learned.system, "found")["model.toml"]
    assert tomllib.loads(text)["model"]["k1"] == f.named["k1[0]"] and "k1 declared as 2346" in text
    assert values_of(f, learned.system)["k1[1]"] == f.named["k1[1]"]


def test_a_value_of_the_robot_or_of_many_beds_is_not_fitted_apart():
    rng = np.random.default_rng(41)
    hidden = draw(rng, ground="granular", hidden=(), nuisance=QUIET)
    jumps, fit, _ = jumps_of(hidden, campaign(hidden, rng))
    own = [replace(j.model, parameters=replace(j.model.parameters, k1=2000.0 + i)) for i, j in enumerate(jumps)]
    with pytest.raises(InputError, match=r"k1: 24 values in one campaign.*at most 6 of the beds"):
        Jumper([replace(j, model=m) for j, m in zip(jumps, own)], fit, {"k1": 20.0})
    heavy = replace(jumps[0], model=replace(jumps[0].model, motor_mass=1.2))
    with pytest.raises(InputError, match=r"\[robot\] motor_mass: 2 values"):
        Jumper([heavy, *jumps[1:]], fit, {"motor_mass": 0.01})


def both_grounds(rng, force):
    """Four jumps on sand and four on hard ground of one robot, whose rail holds it with dry friction (N)."""
    jumps, ranges = [], {}
    for ground in ("hard", "granular"):
        setting = draw(rng, ground=ground, hidden=("coulomb_friction",), nuisance=QUIET, jumps="few")
        robot = setting.protocol.robot._replace(**SHARED)
        true = {**setting.protocol.parameters, "dk": 0.0, "F_c": force}
        setting = replace(setting, protocol=replace(setting.protocol, robot=robot, parameters=true))
        found, fit, _ = jumps_of(setting, campaign(setting, rng))
        own = {n: true[n] for n in ("k1", "k2", "delta") if n in true}
        for j in found:
            model = replace(j.model, parameters=replace(j.model.parameters, **own), **SHARED)
            jumps.append(replace(j, model=model, name=f"{ground} {j.name}"))
        ranges |= fit
    return jumps, ranges


SHARED = {"motor_mass": 1.003, "spring_stiffness": 5760.6, "spring_damping": 1.368, "gravity": 4.0}


def test_one_friction_is_fitted_to_jumps_on_both_grounds():
    """Of 0.2 N, on sand and on hard ground; restitution and drag are each of one ground only."""
    jumps, ranges = both_grounds(np.random.default_rng(47), 0.2)
    learned = learn_noise(Jumper(jumps, ranges, {}))
    f = Problem(learned.system, learned.noise, learned.scatter).fit(("coulomb_friction",), {"F_c": 0.1})
    assert f.named["F_c"] == pytest.approx(0.2, abs=4 * f.sigma("F_c")) and f.sigma("F_c") < 0.02
    terms = {n: tomllib.loads(text)["model"]["terms"] for n, text in model_files(f, learned.system, "found").items()}
    assert terms == {
        "model.toml": ["two_resistance", "inertial_drag", "coulomb_friction"],
        "model_hard.toml": ["landing_loss", "coulomb_friction"],
    }
    first = jumps[0].model
    more = replace(first, terms=(*first.terms, "viscous_friction"), parameters=replace(first.parameters, c_v=0.1))
    with pytest.raises(InputError, match="viscous_friction: in the model on hard ground, not in that on granular"):
        Jumper([replace(jumps[0], model=more), *jumps[1:]], ranges, {})


def test_a_lag_of_the_motor_acts_only_where_no_log_says_how_it_moved():
    rng = np.random.default_rng(43)
    setting = draw(rng, ground="hard", hidden=("motor_lag",), strength=0.7, nuisance=QUIET, jumps="few")
    jumps, fit, priors = jumps_of(setting, campaign(setting, rng))
    assert all(j.law for j in jumps)
    mixed = Jumper([replace(j, law=k % 2 == 0) for k, j in enumerate(jumps)], fit, priors)
    assert "motor_lag" in mixed.candidates
    values = {p.name: p.start for p in mixed.baseline}
    every = range(len(jumps))
    plain = mixed.predict((), values, every)
    lagging = mixed.predict(("motor_lag",), {**values, "tau": 5e-3}, every)
    moved = [float(np.max(np.abs(a - b))) for a, b in zip(plain, lagging)]
    assert all((m > 1e-4) == (k % 2 == 0) for k, m in enumerate(moved)), moved
    assert "motor_lag" not in Jumper([replace(j, law=False) for j in jumps], fit, priors).candidates


def test_a_force_that_no_model_declares_grows_with_the_foot():
    """Fitted of the first foot, alpha of a foot of half the radius is a quarter; what a model declares is its own."""
    robot = {"motor_mass": 1.1, "rod_mass": 0.175, "spring_stiffness": 5000.0, "spring_damping": 1.4, "gravity": 9.81}
    base = Model(
        "granular", ("two_resistance", "inertial_drag"), ModelParameters(k1=2200.0, k2=2200.0, delta=0.012, alpha=60.0),
        foot_mass=0.04, foot_radius=0.016, **robot,
    )  # fmt: skip
    own = replace(base, terms=("two_resistance",), foot_radius=0.008, parameters=replace(base.parameters, alpha=None))
    fitted = replace(base, parameters=replace(base.parameters, alpha=80.0))
    assert of_jump(fitted, own, {"alpha": 80.0}).parameters.alpha == pytest.approx(20.0)
    declared = replace(base, foot_radius=0.008)
    assert of_jump(fitted, declared, {"alpha": 80.0}).parameters.alpha == 80.0
