"""The field of discs: conserved momentum, known flows through the same strain and momentum code as PIV, true sigma."""

from __future__ import annotations

import math

import numpy as np
import pytest
from dem_scene import KINDS, Scene, disc_field, foot_path, run_discs

from jumpvision.experiment.inputs.parameters import FlowParams
from jumpvision.experiment.inputs.sections import Bed, GrainVideo
from jumpvision.experiment.stages.grains.flow import flow
from jumpvision.laboratory.dem.discs import Box
from jumpvision.laboratory.dem.field import coarse_grain
from jumpvision.laboratory.dem.packing import pack
from jumpvision.thesis.studies.sand.disc_field import field_of_discs

D = 1e-3
BED = pack(Box(-0.03, 0.03, -0.04, 0.0), 0.78, diameter=D, density=1.0, rng=np.random.default_rng(0))
FILM = GrainVideo(file="discs", frame_rate=500.0, scale=1e-3, foot="half")
SAND = Bed(volume_fraction=0.57, grain_density=1000.0)


def moved(x, y, face=(0.0, -1e-4)):
    """`field_of_discs` of the bed's discs that go to x, y in 2 ms."""
    gx, gy = (np.arange(-0.0255, 0.026, 1e-3), np.arange(-0.0395, 0.0, 1e-3))
    return field_of_discs([0.0, 2e-3], [BED.x, x], [BED.y, y], BED.mass, face, grid_x=gx, grid_y=gy, width=1.5e-3)


def test_coarse_graining_conserves_mass_and_momentum():
    """Summed over a grid of w/5 that reaches past every kernel; its cut edge leaves under 0.1 %."""
    rng = np.random.default_rng(1)
    vx, vy = rng.normal(0.2, 0.3, (2, len(BED.x)))
    w = 1.5e-3
    gx, gy = np.arange(-0.036, 0.036, 0.2 * w), np.arange(-0.046, 0.006, 0.2 * w)
    f = coarse_grain(BED.x, BED.y, vx, vy, BED.mass, grid_x=gx, grid_y=gy, width=w)
    cell = (0.2 * w) ** 2
    assert np.sum(f.density) * cell == pytest.approx(BED.mass.sum(), rel=1e-3)
    assert np.nansum(f.density * f.u) * cell == pytest.approx(np.sum(BED.mass * vx), rel=1e-3)


def test_the_stated_sigma_of_the_local_mean_is_the_true_one():
    """Random velocities about zero, places 6 w apart; binomial 3 sigma of 0.68, 0.01 for the tails of Student."""
    inside = []
    gx, gy = np.arange(-0.024, 0.025, 9e-3), np.arange(-0.034, 0.0, 9e-3)
    for seed in range(60):
        vx, vy = np.random.default_rng(seed).normal(0.0, 0.3, (2, len(BED.x)))
        f = coarse_grain(BED.x, BED.y, vx, vy, BED.mass, grid_x=gx, grid_y=gy, width=1.5e-3)
        inside += [np.abs(f.u / f.u_sigma) < 1.0, np.abs(f.v / f.v_sigma) < 1.0]
    share, n = np.mean(inside), np.size(inside)
    assert share == pytest.approx(0.68, abs=0.01 + 3 * math.sqrt(0.68 * 0.32 / n))


def test_discs_in_simple_shear_have_its_shear_rate():
    """gamma/sqrt(2); a local mean lies at the discs' centroid, not at the grid point: mean within 2 %."""
    gamma = 20.0
    data = flow(moved(BED.x + gamma * BED.y * 2e-3, BED.y), FILM, SAND, None, p=FlowParams()).field
    inner = data.shear_rate.values[5:-5, 5:-5, 0]
    assert np.nanmean(inner) == pytest.approx(gamma / math.sqrt(2.0), rel=0.02)
    assert np.nanmean(data.vorticity.values[5:-5, 5:-5, 0]) == pytest.approx(-gamma, rel=0.02)


def test_discs_that_sink_together_carry_the_closed_form_momentum():
    """P = rho phi pi V H R^2/2 below the face: no interpolation can change a constant field."""
    data = moved(BED.x, BED.y - 1e-3)
    found = flow(data, FILM, SAND, None, p=FlowParams()).field
    height, radius, speed = 0.04 - 5e-5, 0.026, 0.5
    truth = 1000.0 * 0.57 * math.pi * speed * height * radius**2 / 2.0
    assert float(found.covered[0]) == pytest.approx(1.0, abs=1e-9)
    assert float(found.momentum[0]) == pytest.approx(truth, rel=1e-9)


def test_grids_must_be_even():
    with pytest.raises(ValueError, match="grid_x must be equally spaced"):
        coarse_grain([0.0], [0.0], [0.0], [0.0], [1.0], grid_x=[0.0, 1.0, 3.0], grid_y=[0.0, 1.0], width=1.0)
    with pytest.raises(ValueError, match="width = 0"):
        coarse_grain([0.0], [0.0], [0.0], [0.0], [1.0], grid_x=[0.0, 1.0], grid_y=[0.0, 1.0], width=0.0)


@pytest.mark.long
def test_the_stutter_jump_moves_the_most_grain_momentum():
    """Thesis Figs. 52 and 53: the stutter jump, which lands fastest, stands out; coarse discs of 2 mm."""
    scene, peak = Scene(grain=2e-3), {}
    for kind in KINDS:
        t, foot_y = foot_path(kind)
        d, m = run_discs(scene, t, foot_y, int((t[-1] - 1e-3) * 500), seed=3)
        field = disc_field(scene, d, m, step=4e-3, width=3e-3)
        peak[kind] = float(flow(field, FILM, SAND, None, p=FlowParams()).field.momentum.max())
    assert peak["stutter"] > 1.3 * max(peak["single"], peak["delayed_stutter"]), peak
