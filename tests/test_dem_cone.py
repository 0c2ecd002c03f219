"""Jammed front and cone of discs with friction: the discs' own truth, and what film and analysis make of it."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
from dem_scene import INSTANTS, ROUGH, Scene, analysed, run_discs, write_folder
from dem_truth import boundary, cone_of_discs, crossing, slope

from jumpvision.experiment.results.fields import Column
from jumpvision.experiment.stages.grains.cone import pushing

SCENE = Scene(foot=0.024, bed=(0.045, 0.060), shape=(200, 320), **ROUGH)
N = 16


def test_a_prescribed_cone_is_found_among_the_discs():
    """Scattered discs, 1 per mm^2, that move inside |x| = R - z/tan(theta), z < front and rest outside.

    A boundary lies between neighbours: 10 of them in the column, 1/(10 x 1 mm) apart, put the front to 0.1 mm; each row
    of 1 mm to about 1 mm, 34 rows over 17 mm the angle to atan(1 mm/(17 mm/sqrt(12) sqrt(34))) = 2 degrees.
    """
    rng = np.random.default_rng(0)
    x, z = rng.uniform(-0.06, 0.06, 12_000), rng.uniform(0.0, 0.1, 12_000)
    scene, theta = Scene(), math.radians(50.0)
    moves = (np.abs(x) < scene.foot - z / math.tan(theta)) & (z < 0.024)
    step = 0.4 / 500.0
    y = np.stack([-0.01 - z] * 2) - np.outer([0.0, step], moves)
    times = np.array([0.0, 0.002])
    m = SimpleNamespace(
        t=np.concatenate([[-1.0], np.repeat(times, INSTANTS)]), x=np.stack([x] * (2 * INSTANTS + 1)),
        y=np.concatenate([y[:1], np.repeat(y, INSTANTS, axis=0)]),
        foot_y=np.concatenate([[0.0], np.repeat([-0.01 + 0.5 * step, -0.01 - 0.5 * step], INSTANTS)]),
    )  # fmt: skip
    found = cone_of_discs(scene, m)
    assert found.speed == pytest.approx([0.4])
    assert found.front[0] == pytest.approx(0.024 + 0.5 * step, abs=4e-4)  # half the plug's step, and 3 gaps
    assert found.theta[0] == pytest.approx(50.0, abs=4.0)


def test_boundary_and_crossing():
    assert boundary(np.array([3.0, 1.0, 2.0, 4.0]), np.array([False, True, True, False])) == 2.5
    assert math.isnan(boundary(np.array([1.0, 2.0]), np.array([False, False])))
    z, v = np.arange(10.0), np.array([1.0, 1.0, 1.0, 1.0, 0.95, 0.85, 0.2, 0.0, 0.0, 0.0])
    assert crossing(z, v) == pytest.approx(4.5)
    assert math.isnan(crossing(z, np.ones(10)))


@pytest.fixture(scope="module")
def loop(tmp_path_factory):
    folder = tmp_path_factory.mktemp("rough")
    t = np.linspace(0.0, N / 500.0, 200)
    depth = 0.003 + 0.30 * t
    d, m = run_discs(SCENE, t, -depth, N, seed=2)
    write_folder(folder / "discs", SCENE, d, m, seed=2)
    return cone_of_discs(SCENE, m), analysed(folder / "discs", folder / "results")["column"]


@pytest.mark.long
def test_the_front_of_the_film_is_that_of_the_discs(loop):
    """Grains of 1 mm: the places differ by less than one (rms), and mu by 2 sigma = 2 x 0.7 mm/(2.6 mm sqrt(15)) of the
    slope of 15 such places over 8.4 mm of depth: 0.14, 9 % of it."""
    c, f = loop
    front = np.array([crossing(f.depth.values[:, k], f.speed.values[:, k]) for k in range(f.sizes["t"])])
    assert np.isfinite(front).sum() >= 14
    assert np.nanstd(front - c.front) < SCENE.grain
    assert abs(np.nanmean(front - c.front)) < SCENE.grain
    assert slope(c.depth, c.front) > 1.0  # a front runs ahead of the foot
    assert slope(c.depth, front) == pytest.approx(slope(c.depth, c.front), abs=0.14)


def test_the_cone_of_the_film_is_that_of_the_discs(loop):
    """On this small foot a side is 10 mm high and a window 6 mm: a frame's angle differs by 7 degrees rms, the mean of
    8 frames by 2.5, and 2 sigma are allowed."""
    c, f = loop
    apart = (f.theta_outline_deg.values - c.theta)[pushing(Column(f))]  # of the same 0.9 as the discs' cone
    assert np.isfinite(apart).sum() >= 7
    assert abs(np.nanmean(apart)) < 5.0
