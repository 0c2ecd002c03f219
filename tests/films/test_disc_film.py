"""A stored film of discs (data/discs) through piv, flow, column and fit, against the discs' own motion."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest
import xarray as xr
from shared import ROOT

from jumpvision.cli import main
from jumpvision.experiment.results.fields import Column
from jumpvision.experiment.stages.grains.cone import pushing

FOLDER = ROOT / "tests" / "data" / "discs"
RATE, SCALE, GRAIN = 500.0, 2.5e-4, 1e-3  # frames/s, m/px, m


@pytest.fixture(scope="module")
def truth():
    """What the discs do: see data/discs/README.md; depth [m], speed [m/s] of the foot in each pair of frames."""
    with np.load(FOLDER / "truth.npz") as stored:
        true = SimpleNamespace(**stored)
    true.x, true.y = 2e-6 * true.x_2um, 2e-6 * true.y_2um
    true.depth = -0.5 * (true.foot_y_m[1:] + true.foot_y_m[:-1])
    true.speed = -np.diff(true.foot_y_m) / np.diff(true.time_s)
    return true


@pytest.fixture(scope="module")
def seen(tmp_path_factory):
    results = tmp_path_factory.mktemp("results")
    assert main(["fit", str(FOLDER), "--results", str(results)]) == 0
    return SimpleNamespace(
        **{n: xr.load_dataset(results / f"{n}.nc", decode_times=False) for n in ("piv", "flow", "column")}
    )


def test_the_foot_is_found_where_it_was(truth, seen):
    """Grains that touch the face hide its edge by up to half a pixel, alike in all frames. Of the motion, known
    to 0.01 px, the range over 15 pairs is 3 sigma of it: 0.03 px, twice that allowed."""
    assert seen.flow.foot_depth.values == pytest.approx(truth.depth, abs=0.5 * SCALE)
    assert np.ptp(seen.flow.foot_depth.values - truth.depth) < 0.06 * SCALE
    error = (seen.flow.foot_speed.values - truth.speed) / (SCALE * RATE)
    assert np.sqrt(np.mean(error**2)) < 0.03 * math.sqrt(2.0)  # 0.03 px of each of two frames


def test_momentum_and_added_mass_of_the_grains_are_those_of_the_discs(truth, seen):
    """3 % rms above a fifth of the peak, and the stated sigma is the true one: 14 of 15 frames or more inside 2 of it.

    Added mass is momentum over the foot's speed: 0.01 px of it in 2.4 px a frame are 0.4 %.
    """
    true = truth.momentum_kg_m_s
    large = true > 0.2 * true.max()
    assert large.sum() >= 5
    got, sigma = seen.flow.momentum.values, seen.flow.momentum_sigma.values
    assert np.sqrt(np.mean((got / true - 1.0)[large] ** 2)) < 0.03
    assert np.sum(np.abs(got - true) < 2.0 * sigma) >= 14
    mass, true_mass = seen.flow.added_mass.values, true / truth.speed
    assert np.sqrt(np.mean((mass / true_mass - 1.0)[large] ** 2)) < 0.03
    assert np.sum(np.abs(mass - true_mass) < 2.0 * seen.flow.added_mass_sigma.values) >= 14


def test_velocities_are_those_of_the_discs(truth, seen):
    """Mean of the discs about each vector, by a Gaussian of 1.2 mm as wide as a window: 0.1 px rms below the foot."""
    piv, apart = seen.piv, []
    columns, rows = (a.ravel() for a in np.meshgrid(piv.x, piv.y))
    for k in range(piv.sizes["t"]):
        x = 0.5 * (truth.x[:, k] + truth.x[:, k + 1])
        y = 0.5 * (truth.y[:, k] + truth.y[:, k + 1]) - truth.foot_y_m[0]  # heights in piv.nc: from the first face
        square = np.subtract.outer(columns, x) ** 2 + np.subtract.outer(rows, y) ** 2
        weight = truth.radius_m**2 * np.exp(-0.5 * square / 1.2e-3**2)
        for name, place in (("u", truth.x), ("v", truth.y)):
            own = weight @ (place[:, k + 1] - place[:, k]) / weight.sum(axis=1)
            one = piv.isel(t=k)
            use = (one.chc > 0) & (piv.y < piv.foot_y[k] - 0.003)
            apart.append((one[name].values / RATE - own.reshape(one.chc.shape))[use.transpose("y", "x").values] / SCALE)
    error = np.concatenate(apart)
    assert error.size > 10_000
    assert np.sqrt(np.mean(error**2)) < 0.1
    assert abs(error.mean()) < 0.02


def crossing(depth, speed):
    """Depth [m] where a measured column (NaN: no vector) first falls below 0.9 of its plateau, between its points.

    The plateau is the median of what exceeds 0.95 of the greatest speed; nothing is fitted. NaN where it never falls.
    """
    order = np.argsort(depth)
    z, v = depth[order], speed[order]
    z, v = z[np.isfinite(v)], v[np.isfinite(v)]
    level = 0.9 * float(np.median(v[: max(3, int(np.sum(v > 0.95 * v.max())))]))
    below = np.flatnonzero(v < level)
    if below.size == 0 or below[0] == 0:
        return math.nan
    k = int(below[0])
    return float(z[k - 1] + (v[k - 1] - level) / (v[k - 1] - v[k]) * (z[k] - z[k - 1]))


def test_the_front_of_the_film_is_that_of_the_discs(truth, seen):
    """Grains of 1 mm: the places differ by less than one (rms), and mu by 2 sigma = 2 x 0.7 mm/(2.6 mm sqrt(15)) of the
    slope of 15 such places over 8.4 mm of depth: 0.14, 9 % of it."""
    f = seen.column
    front = np.array([crossing(f.depth.values[:, k], f.speed.values[:, k]) for k in range(f.sizes["t"])])
    found = np.isfinite(front)
    assert found.sum() >= 14
    assert np.nanstd(front - truth.front_m) < GRAIN
    assert abs(np.nanmean(front - truth.front_m)) < GRAIN
    mu = np.polyfit(truth.depth, truth.front_m, 1)[0]
    assert mu > 1.0  # a front runs ahead of the foot
    assert np.polyfit(truth.depth[found], front[found], 1)[0] == pytest.approx(mu, abs=0.14)


def test_the_cone_of_the_film_is_that_of_the_discs(truth, seen):
    """On this small foot a side is 10 mm high and a window 6 mm: a frame's angle differs by 7 degrees rms, the mean of
    8 frames by 2.5, and 2 sigma are allowed."""
    apart = (seen.column.theta_outline_deg.values - truth.theta_deg)[pushing(Column(seen.column))]  # of the same 0.9
    assert np.isfinite(apart).sum() >= 7
    assert abs(np.nanmean(apart)) < 5.0
