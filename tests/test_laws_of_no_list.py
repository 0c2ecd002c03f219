"""Worlds with laws of no list: their integrator against the analysis' and the laboratory's."""

from __future__ import annotations

import math

import numpy as np
import pytest
from conftest import later

from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.forcing import delayed, sinusoid
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand import jump
from jumpvision.laboratory.jumper import Law as LabLaw
from jumpvision.laboratory.jumper import Robot, motion_of
from tests.worlds import laws as worlds
from tests.worlds import motion as mo

T = np.arange(0.0, 1.8, 0.005)


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
