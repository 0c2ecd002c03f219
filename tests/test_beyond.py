"""Worlds with laws of no vocabulary: their integrator against both others, their folders, the score of an answer."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from conftest import later

from benchmarks.beyond import motion as mo
from benchmarks.beyond import score, worlds
from jumpvision.experiment.inputs.experiment import open_campaign
from jumpvision.experiment.inputs.model import ModelSpec
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.forcing import delayed, sinusoid
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand import jump
from jumpvision.laboratory.jumper import Law as LabLaw
from jumpvision.laboratory.jumper import Robot, motion_of

T = np.arange(0.0, 1.8, 0.005)
WRITTEN = {
    "speed_power": "a * abs(v)**p",
    "depth_power": "a * z**q * abs(v)",
    "depth_decay": "a * exp(-z / l)",
    "saturating": "a * abs(v) / (abs(v) + v0)",
    "since_contact": "a * z * exp(-contact_s / tau)",
    "spring_dry": "-a * abs(stretch) * sign(stretch_rate)",
    "rail_rising": "-a * exp((x_r + x_m - h) / l) * v_m",  # x_m is from its rest, the worlds' from the surface
    "rail_patch": "-a * exp(-((x_r + x_m - h - x0) / w)**2) * v_m",
    "clock": "a * time_s",
    "lens_tilted": "a * h**2",
}


def first(family: str) -> worlds.World:
    return worlds.world(worlds.NAMES.index(family))


@pytest.mark.parametrize("family", [*later("speed_power"), "rail_rising"])
def test_without_a_law_the_motion_is_that_of_the_analysis(family):
    """Rods of three jumps of other kinds, granular and hard, to 1 um: neither shares code with the other."""
    w = first(family)
    own = worlds.ROBOTS[w.ground]
    values = ModelParameters(**w.declared)
    sand = {"volume_fraction": worlds.PHI, "grain_density": worlds.DENSITY} if w.ground == "granular" else {}
    model = Model(w.ground, w.terms, values, **own, **sand)
    for shot in (w.shots[3], w.shots[15], w.shots[-1]):
        c = shot.command
        cycle = mo.follow(w.nominal, c, mo.Law(), T)
        plain = (c.frequency, c.amplitude, c.phase)
        forcing = delayed(*plain, c.delay, start=c.start) if c.delay else sinusoid(*plain, start=c.start)
        theirs = jump.simulate(model, forcing, t=T, rtol=1e-10, atol=1e-12)
        assert np.max(np.abs(cycle.rod - theirs.rod)) < 1e-6
        assert np.max(np.abs(cycle.foot - theirs.foot)) < 1e-6


def test_a_law_acts_as_the_laboratory_has_it():
    """d z |v| on the foot is an effect of the laboratory too: rods to 1 um, its step being 2e-6 s."""
    r = worlds.ROBOTS["granular"]
    terms = ("linear_penetration", "depth_drag", "added_mass", "depth_rate_drag")
    p = {"k": 2100.0, "b": 12.0, "C": 2.7, "mu": 2.0, "theta": math.pi / 3, "d_zv": 300.0}
    theirs = motion_of(
        Robot(**r), LabLaw(5.3, 0.01875, 0.5 * math.pi, 0.2), terms, p, ground="granular", duration=1.5,
        bed_density=570.0, every=2500,
    )  # fmt: skip
    ours = mo.follow(
        worlds.jumper_of("granular", r | p), mo.Command(0.01875, 5.3, 0.5 * math.pi, 0.2),
        mo.Law(mo.FOOT, mo.DEPTH_POWER, (300.0, 1.0, 0.0)), theirs.t,
    )  # fmt: skip
    assert np.max(np.abs(ours.rod - theirs.rod)) < 1e-6
    without = mo.follow(
        worlds.jumper_of("granular", r | p), mo.Command(0.01875, 5.3, 0.5 * math.pi, 0.2), mo.Law(), theirs.t
    )
    assert np.max(np.abs(ours.rod - without.rod)) > 1e-3  # the law is felt


def test_a_path_through_knots_is_the_command_that_it_follows():
    """Hermite's cubics through 400 knots of a sine: h^4/384 of its fourth derivative, 2e-11 m here."""
    w = worlds.world(0)
    c = w.shots[0].command
    k = np.linspace(c.start, c.edges[3], 400)
    angle = 2 * math.pi * c.frequency * (k - c.start) + c.phase
    X = c.amplitude * (np.sin(angle) - math.sin(c.phase))
    V = 2 * math.pi * c.frequency * c.amplitude * np.cos(angle)
    t = np.arange(0.0, 1.5, 0.005)
    a, b = (mo.follow(w.jumper, x, w.law, t) for x in (c, c._replace(path=np.stack([k, X, V], axis=1))))
    assert np.max(np.abs(a.rod - b.rod)) < 1e-9 and a.rod.max() > 0.01


def test_a_campaign_is_read_as_it_was_declared(tmp_path):
    w = first("since_contact")
    campaign = open_campaign(worlds.write_folder(w, tmp_path))
    assert len(campaign.experiments) == 24
    one = campaign.experiments[0].section(ModelSpec)
    assert tuple(one.terms) == w.terms
    assert (tmp_path / f"{w.name}.sealed.json").exists()


def test_the_plan_holds_24_forms_and_some_that_give_energy():
    forms = [worlds.FAMILIES[n] for n in worlds.NAMES]
    assert not any(f.active for f in forms[: worlds.BARRED]) and all(f.active for f in forms[worlds.BARRED :])
    p = np.concatenate([worlds.world(n).p for n in range(len(worlds.NAMES))])
    assert np.all(np.abs(p - np.round(p, 2)) > 1e-12)  # not round


FEW = [
    "depth_power",
    "since_contact",
    "rail_patch",
    "lens_tilted",
]  # one of each kind of form: body, clock, place, lens


@pytest.mark.parametrize("family", FEW + later(*(w for w in WRITTEN if w not in FEW)))
def test_the_truth_as_an_answer_is_right_and_a_wrong_one_is_not(family):
    w = first(family)
    values = dict(zip(("a", *w.form.shape), w.p))
    truth = score.Found(WRITTEN[family], w.form.acts_on, parameters={n: (v, 0.01 * abs(v)) for n, v in values.items()})
    row = score.score(w, truth)
    assert row["right"] and row["exponents"] and row["instrument_told"]
    assert row["r2_force"] == pytest.approx(1.0, abs=1e-6)
    other = "b * v_m" if w.form.acts_on != "carriage" else "b * z * abs(v)"
    wrong = score.score(w, replace(truth, law=other, acts_on="carriage" if "v_m" in other else "foot",
                                   parameters={"b": (1.0, 0.1)}))  # fmt: skip
    assert not wrong["right"] and not wrong["exponents"]


def test_an_exponent_is_read_off_the_behaviour_with_the_sigma_of_the_parameters():
    """a |v|^(n/4) with n known to 0.2: p to 0.05."""
    w = first("speed_power")
    law = score.Found("a * abs(v)**(n / 4)", "foot", parameters={"a": (w.p[0], 0.0), "n": (4 * w.p[1], 0.2)})
    value, sigma = score.score(w, law)["shape"]["p"]
    assert value == pytest.approx(w.p[1], abs=1e-6) and sigma == pytest.approx(0.05, rel=0.02)


def test_a_law_with_an_internal_state_is_followed_along_the_motion():
    """u' = stretch' - u/tau by Heun at 1 ms against the worlds' own filter: r2 to 1e-4, tau to 1 %."""
    w = first("spring_arm")
    a, tau = w.p
    law = score.Found("-a * u", "spring", parameters={"a": (a, 0.0), "tau": (tau, 0.0)}, state="stretch_rate - u / tau")
    row = score.score(w, law)
    assert row["right"] and row["r2_force"] > 0.9999
    assert row["shape"]["tau"][0] == pytest.approx(tau, rel=0.01)


def test_active_and_passive_are_told():
    w = first("active_push")
    law = score.Found("a * v_m", "carriage", parameters={"a": (0.3, 0.01)}, passive=True)
    assert score.score(w, law)["passive_wrong"]
    assert not score.score(w, replace(law, passive=False))["passive_wrong"]
