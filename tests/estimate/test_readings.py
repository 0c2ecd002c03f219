"""Values that are no readings, drawn into motions, forces and angles: found and left out; sound ones are left."""

from __future__ import annotations

import math

import numpy as np
import pytest

import jumpvision as jv
from jumpvision.estimate.estimate import Estimate
from jumpvision.estimate.height import jump_height
from jumpvision.estimate.readings import only_readings, readings

STEP = 6.25e-6  # m, of an encoder


def motor(rng):
    """Positions (n,) [m] at 1 kHz of a motor that rests, makes one or two periods and rests."""
    t, start, f = np.arange(0.0, 1.2, 1e-3), rng.uniform(0.15, 0.4), rng.uniform(4.0, 15.0)
    moves = (t > start) & (t < start + rng.integers(1, 3) / f)
    x = rng.uniform(2e-3, 8e-3) * np.where(moves, np.sin(2.0 * math.pi * f * (t - start)), 0.0)
    step = rng.choice([STEP, 1e-6, 0.0])
    return np.rint(x / step) * step if step else x


def force(rng):
    """Depth (n,) [m] and a force [N] of two slopes with noise, rounded or not."""
    z = np.linspace(-rng.uniform(0.002, 0.008), rng.uniform(0.03, 0.06), rng.integers(1500, 4000))
    d = np.clip(z, 0.0, None)
    f = rng.uniform(800, 3000) * np.minimum(d, 0.015) + rng.uniform(400, 1500) * np.clip(d - 0.015, 0.0, None)
    f, step = f + rng.uniform(0.05, 0.2) * rng.normal(size=z.size), rng.choice([0.01, 0.0])
    return z, np.rint(f / step) * step if step else f


def hop(rng):
    """Heights (n,) [m] of a body that rests, flies and rests."""
    rate, flight = rng.choice([120.0, 240.0, 500.0]), rng.uniform(0.15, 0.3)
    s = np.clip(np.arange(0.0, 1.0, 1.0 / rate) - 0.35, 0.0, flight)
    return 0.5 * 9.81 * s * (flight - s) + rng.normal(0.0, rng.choice([5e-6, 2e-5, 1e-4]), s.size)


def angle(rng):
    t = np.arange(0.0, 4.0, 1.0 / rng.choice([50.0, 100.0, 200.0]))
    return rng.choice([-1.0, 1.0]) * rng.uniform(3.0, 9.0) * t + 0.4 * np.sin(3.0 * t) + rng.normal(0.0, 1e-2, t.size)


def renewed(rng):
    x = motor(rng)
    every = rng.integers(2, 15)
    return x[np.arange(x.size) // every * every], None, x


def twice(rng):
    h = hop(rng)
    k = np.arange(h.size)
    return h[k // 2 * 2 if rng.integers(2) else k - (k % 5 == 4)], None, h


def clipped(rng):
    z, f = force(rng)
    return np.minimum(f, rng.uniform(0.4, 0.9) * f.max()), z, f


def stuck(rng):
    z, f = force(rng)
    a, stale = rng.integers(500, f.size - 400), f.copy()
    stale[a : a + rng.integers(60, 300)] = f[a]
    return stale, z, f


def zero_rows(rng):
    x = motor(rng)
    for i in rng.choice(np.flatnonzero(np.abs(x) > 0.3 * np.abs(x).max()), 3, replace=False):
        x[i] = 0.0
    return x, None, x


def two_sources(rng):
    x = np.repeat(motor(rng), 2)
    late = np.r_[np.zeros(60), x[:-60]]
    x[1::2] = late[1::2]
    return x, None, x


def wrapped(rng):
    a = angle(rng)
    return ((a + math.pi) % (2.0 * math.pi) - math.pi if rng.integers(2) else np.degrees(a) % 360.0), None, a


def roll_over(rng):
    count = np.rint(np.cumsum(np.abs(rng.normal(20.0, 3.0, 300))) + rng.integers(0, 500))
    return count % 1024 * STEP, None, count * STEP


FAULTS = {
    renewed: "is renewed every",
    twice: "is renewed every",
    clipped: "clipped",
    stuck: "stands still",
    zero_rows: "leaps in",
    two_sources: "to and fro",
    wrapped: "undone",
    roll_over: "undone",
}


@pytest.mark.parametrize("fault", FAULTS)
@pytest.mark.parametrize("seed", range(10))
def test_what_is_no_reading_is_named_and_left_out(fault, seed):
    """What is kept is the reading itself; a turn is undone but for the first value's own."""
    x, driven, true = fault(np.random.default_rng([72, seed]))
    seen = readings(x, driven)
    assert any(FAULTS[fault] in d.text for d in seen.doubts)
    if fault in (wrapped, roll_over):
        true = np.degrees(true) if np.ptp(x) > 10.0 else true
        assert np.allclose(seen.values - seen.values[0], true - true[0], atol=1e-6 * np.ptp(true))
    elif fault in (renewed, twice, clipped):
        assert np.array_equal(seen.values[seen.kept], true[seen.kept])
        assert seen.kept.sum() > 0.05 * x.size


@pytest.mark.parametrize("make", [motor, hop, angle, lambda rng: force(rng)[1]])
@pytest.mark.parametrize("seed", range(20))
def test_a_sound_record_is_left_as_it_is(make, seed):
    x = make(np.random.default_rng([73, seed]))
    seen = readings(x)
    assert seen.doubts == [] and seen.kept.all() and np.array_equal(seen.values, x)


@pytest.mark.parametrize("seed", range(3))
def test_a_clipped_load_cell_gives_the_slopes_below_its_end(seed):
    """Within five of the sigmas stated, where the whole force gave 380 N/m less."""
    rng = np.random.default_rng([74, seed])
    z = np.linspace(-0.004, 0.045, 3000)
    d = np.clip(z, 0.0, None)
    f = np.where(d < 0.014, 1900.0 * d, 26.6 + 1100.0 * (d - 0.014)) + 0.05 * rng.normal(size=z.size)
    with pytest.warns(UserWarning, match="force_N stands at its greatest value 42 in"):
        found = jv.intrusion(z, np.minimum(f, 42.0))
    for name, true in (("k1", 1900.0), ("k2", 1100.0)):
        value, sigma = found.loc[name, ["value", "sigma"]]
        assert abs(value - true) < 5.0 * sigma < 0.02 * true


@pytest.mark.parametrize("seed", range(5))
def test_a_top_that_the_track_does_not_show_is_no_height(seed):
    """Three bounces, of the first the upper half is hidden: the top of the second is none. That of the first is told
    from the motion on both sides to 5 %."""
    rng = np.random.default_rng([78, seed])
    t = np.arange(0.0, 1.3, 1.0 / 500.0)
    h, at, tops = np.zeros(t.size), 0.2, []
    for flight in rng.uniform(0.2, 0.3) * 0.8 ** np.arange(3.0):
        s = np.clip(t - at, 0.0, flight)
        h, at = h + 0.5 * 9.81 * s * (flight - s), at + flight
        tops.append(9.81 * flight**2 / 8.0)
    rest, sigma, h = Estimate(0.0, 1e-6, "m", 100, 0.0), np.full(t.size, 1e-5), h + rng.normal(0.0, 1e-5, t.size)
    whole, hidden = (
        jump_height(t, seen, sigma, motor_stop=0.2, rest=rest, foot_frequency=None)
        for seen in (h, np.where((h > 0.5 * tops[0]) & (t < at - 0.6 * (at - 0.2)), np.nan, h))
    )
    assert whole.value == pytest.approx(tops[0], abs=5.0 * whole.sigma) and whole.gap == 0.0
    assert math.isnan(hidden.value) and hidden.gap > 0.05
    assert float(hidden.reason.split("about ")[1].split(" m")[0]) == pytest.approx(tops[0], rel=0.05)


def test_a_depth_that_is_set_step_by_step_keeps_its_rows():
    """Steps of 0.5 mm that are held for 12 rows, under a force with noise."""
    z = np.repeat(np.arange(0.0, 0.05, 5e-4), 12)
    seen = only_readings({"depth_m": z, "force_N": 1500.0 * z + np.random.default_rng(0).normal(0.0, 0.1, z.size)}, z)
    assert seen.doubts == [] and seen.kept.all()


@pytest.mark.parametrize("x", [np.arange(60.0), np.repeat([0.0, 5.0], 40), np.zeros(60)])
def test_a_ramp_a_switch_and_a_rest_are_sound(x):
    seen = readings(x)
    assert seen.kept.all() and seen.doubts == []


def test_spikes_on_a_rest_without_noise_are_left_out():
    x = np.zeros(80)
    x[[10, 30, 50, 70]] = 40.0, 73.3, 333.7, 777.1
    assert list(np.flatnonzero(~readings(x).kept)) == [10, 30, 50, 70]
