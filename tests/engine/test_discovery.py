"""A law that no vocabulary lists, hidden by the laboratory's own integrator, is found, written, read and used again."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from diagnosis_sample import diagnosis

from jumpvision.engine.detect import detect, directions
from jumpvision.engine.discovery import Laws
from jumpvision.engine.document.sentence import law_in_words
from jumpvision.engine.document.values import Status
from jumpvision.engine.fitting import Problem
from jumpvision.engine.naming import Explanation, Naming
from jumpvision.engine.order import Findings, Order, fit_baseline, silent
from jumpvision.experiment.campaign.model_file import model_toml
from jumpvision.experiment.inputs.model import read_model
from jumpvision.jumper.mechanisms.own import acts_on, bare, parameters_with, read_own
from jumpvision.jumper.mechanisms.registry import MECHANISMS, ModelParameters
from jumpvision.jumper.physics.forcing import sinusoid
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.question.discovered import JumperForms, JumperLaw
from jumpvision.jumper.question.forms import forms
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.jumps import Jump
from jumpvision.jumper.question.learning import learn_noise
from jumpvision.jumper.question.words import words_of
from jumpvision.laboratory.jumper import Law, Robot, motion_of

TRUE = 300.0  # N s/m^2, of a drag in proportion to depth and speed
ROBOT = Robot(1.125, 0.175, 0.04, 3300.0, 1.2, 0.0381, 9.81)
TERMS = ("two_resistance", "inertial_drag")
BED = {"k1": 2100.0, "k2": 1500.0, "delta": 0.012, "alpha": 40.0}
NOISE, AMPLITUDE, START = 5e-5, 0.0125, 0.1  # m, m, s


def campaign(rng: np.random.Generator) -> Jumper:
    """Four jumps of the laboratory, questioned with the model less the hidden drag."""
    model = Model(
        "granular", TERMS, ModelParameters(**BED), motor_mass=ROBOT.motor_mass, rod_mass=ROBOT.rod_mass,
        foot_mass=ROBOT.foot_mass, spring_stiffness=ROBOT.spring_stiffness, spring_damping=ROBOT.spring_damping,
        gravity=ROBOT.gravity, foot_radius=ROBOT.foot_radius, volume_fraction=0.57, grain_density=1000.0,
    )  # fmt: skip
    jumps, t = [], np.arange(0.0, 0.6, 0.002)
    for kind, phase in (("single", 1.5 * math.pi), ("stutter", 0.5 * math.pi)):
        for f in (6.0, 9.0):
            true = motion_of(
                ROBOT, Law(f, AMPLITUDE, phase, START), (*TERMS, "depth_rate_drag"), {**BED, "d_zv": TRUE},
                ground="granular", duration=0.6, bed_density=570.0, dt=5e-6, every=100,
            )  # fmt: skip
            height, law = np.interp(t, true.t, true.rod) - true.rest, sinusoid(f, AMPLITUDE, phase, 1.0, START)
            y, name = height + rng.normal(0.0, NOISE, t.size), f"{kind} {f}"
            jumps.append(Jump(name, model, law, START + 1 / f, t, y, name, name, True, labels={"kind": kind}))
    return Jumper(jumps, {"k1": (500.0, 6000.0), "alpha": (0.0, 300.0)}, {}, 1)


@pytest.fixture(scope="module")
def found() -> tuple[JumperLaw, Problem]:
    rng = np.random.default_rng(5)
    learned = learn_noise(campaign(rng))
    system = learned.system
    problem = Problem(system, learned.noise, learned.scatter)
    base = fit_baseline(problem, rng)
    test = detect(problem, base, directions(problem, base), rng)
    nothing = Naming((), Status.UNDETERMINED, Explanation(base, 1.0, 0.0), (), (), 1.0, {})
    order = Order(problem, rng, laws=lambda p: Laws(p, JumperForms(p.system), silent))
    law = order.beyond(Findings(learned.noise, base, test, [], nothing)).law
    assert law is not None
    return law, problem


def test_the_law_is_found_with_its_exponents(found):
    """Exponents within three of their sigmas; the strength at the typical depth and speed, 300 x 0.02 x 0.5 = 3 N."""
    law, _ = found
    told = law.described
    assert told.law == "-r * sign(v) * abs(v / v_0)**p * abs(z / z_0)**n" and told.acts_on == "foot"
    values = told.parameters
    for name, true in (("p", 1.0), ("n", 1.0), ("r", TRUE * 0.02 * 0.5)):
        assert abs(values[name].value - true) < 3.0 * values[name].sigma
        assert values[name].sigma < 0.2 * true
    assert values["v_0"].sigma == 0.0
    assert told.r2 > 0.95 and told.ceiling_r2 >= told.r2 and told.passive is True
    assert law.status == "complete"
    assert 0.0 < told.seen["z"][1] < 0.1 and told.seen["v"][0] < -0.05
    said = law_in_words(told, words_of(diagnosis()), "does")
    assert "p = 1.0" in said or "p = 0.9" in said


@pytest.mark.parametrize("ground", ["granular", "hard"])
def test_every_form_can_be_read_from_a_file(ground):
    """What a search may find is what [mechanism.NAME] takes: symbols, names, units."""
    foot = {"foot_radius": 0.0381} if ground == "granular" else {}
    robot = {"motor_mass": 1.0, "rod_mass": 0.2, "spring_stiffness": 3300.0, "spring_damping": 1.0, "gravity": 9.81}
    terms = ("linear_penetration",) if foot else ()
    library = forms(Model(ground, terms, ModelParameters(k=2000.0), foot_mass=0.04 * len(foot), **robot, **foot))
    assert len(library) > 15 and not set(library) & set(MECHANISMS)  # a form would hide the mechanism of its name
    for m in library.values():
        priors = {bare(m, p.name): (p.unit, p.prior(None)) for p in m.parameters}
        values = {n: {"unit": u, "start": q.start, "range": [q.low, q.high]} for n, (u, q) in priors.items()}
        for n, (_, q) in priors.items():
            if q.low >= q.high:
                del values[n]["range"]
        state = {"state": m.rate.text, "state_unit": "m"} if m.rate else {}
        table = {"acts_on": acts_on(m), "law": m.equation, "words": "found", "parameters": values, **state}
        assert read_own({"discovered_1": table}, "a file")[1] == [], m.name


def test_the_law_is_written_and_read_again(found, tmp_path):
    """model.toml holds the law with the fit's values and sigmas; what is read simulates as what was fitted, to 1 nm."""
    law, _ = found
    file = tmp_path / "model.toml"
    file.write_text(model_toml(law.fit, law.system, "found"))
    spec = read_model(file)
    (read,) = spec.mechanisms
    assert read.equation == law.law.equation and read.seen == law.law.seen
    assert spec.sigma["discovered_1_p"] == law.fit.sigma("discovered_1_p")
    fitted = law.system.build(law.fit.mechanisms, law.fit.named)
    given = {**spec.parameters, **{p.name: p.default for p in read.parameters}}
    again = replace(fitted, own=(read,), parameters=parameters_with((read,))(**given))
    jump = law.system.jumps[0]
    heights = [law.system._motion(jump, m, jump.t).rod for m in (fitted, again)]
    np.testing.assert_allclose(*heights, rtol=0, atol=1e-9)
