"""Many jumps in one compiled call, a batch or the tracks of a fit, are the jumps one by one."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from jumpvision.base.schema import InputError
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.batch import jump_batch, with_gain
from jumpvision.jumper.physics.forcing import Loop, Segments, delayed, from_log, sinusoid
from jumpvision.jumper.physics.hard.jump import half_cycle_rows, sine_rows
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import Tracks, simulate
from tests.worlds.cases import BED, SAND, case
from tests.worlds.sand import random_values


@pytest.mark.parametrize("name", ["cone", "everything", "hard, foot with mass"])
def test_batch_is_the_jumps_one_by_one(name):
    model, _ = case(name)
    rng = np.random.default_rng(5)
    frequency, k1, masses = rng.uniform(4, 12, 6), rng.uniform(1500, 2500, 6), rng.uniform(1.0, 1.2, 6)
    laws = half_cycle_rows(frequency, frequency, 0.01875, 0.5 * math.pi + 0.2, 0.04)
    got = jump_batch(model, laws, k1=k1, motor_mass=masses, rtol=1e-8, atol=1e-10)
    assert set(got["failure"]) == {""}
    for i in range(6):
        one = dataclasses.replace(
            model, parameters=dataclasses.replace(model.parameters, k1=k1[i]), motor_mass=masses[i]
        )
        law = Segments(laws[i])
        driven = np.linspace(law.start, law.stop, 100001)[:-1]
        m = simulate(one, law, t=np.append(driven, law.stop + 0.6), rtol=1e-8, atol=1e-10)
        for height in ("com_height", "jump_height", "driven_height"):
            # the same steps but for those that end at the 100,000 times; 100 x rtol x 20 mm as in test_granular
            assert got[height + "_m"][i] == pytest.approx(getattr(m, height), abs=2e-8)
        assert got["max_depth_m"][i] == pytest.approx(m.depth_max, abs=2e-8)
        assert got["lift_off_s"][i] == pytest.approx(m.flights[0, 0] - law.start, abs=1e-7)
        late = np.flatnonzero(m.flights[:, 1] > law.stop)
        if late.size:
            assert got["n_jumps"][i] == late[0] + 1
            assert got["flight_height_m"][i] == pytest.approx(m.flight_height, abs=1e-7)


def test_a_batch_by_the_feedback_loop_is_its_jumps_one_by_one_and_a_kp_of_0_the_law():
    model, _ = case("cone")
    rows = half_cycle_rows([6.0, 8.0, 9.0], [6.0, 8.0, 9.0], 0.01875, 0.5 * math.pi, [0.1, 0.3, 0.3])
    gain, most = np.array([0.06, 0.5, 1.0]), {"kd": 120.0, "max_force": 60.0, "max_speed": 1.2}
    loop = {**most, "kp": [2e4, 2e4, 0.0]}
    got = jump_batch(model, with_gain(rows, gain), loop=loop, rtol=1e-8, atol=1e-10)
    for i in range(3):
        law = Segments(rows[i])
        driver = law if i == 2 else Loop(law, 2e4, dwell_gain=gain[i], **most)
        m = simulate(model, driver, t=np.linspace(law.start, law.stop + 0.6, 2001), rtol=1e-8, atol=1e-10)
        for height in ("com_height", "jump_height", "driven_height"):
            # the same steps but for those that end at the times; 100 x rtol x 20 mm as above
            assert got[height + "_m"][i] == pytest.approx(getattr(m, height), abs=2e-8)
        assert got["max_depth_m"][i] == pytest.approx(m.depth_max, abs=2e-8)
    assert (got["peak_force_N"][:2] <= 60.0 + 1e-9).all() and (got["peak_motor_speed"][:2] <= 1.2 + 1e-6).all()


def test_shapes_broadcast_and_a_jump_off_the_ground_is_followed_to_its_landing():
    model, _ = case("plain")
    got = jump_batch(model, sine_rows([[6.0], [9.0]], 0.01875, 1.5 * math.pi, 1.0), alpha=[0.0, 20.0, 73.0], tail=0.05)
    assert got["com_height_m"].shape == (2, 3) and (got["flight_height_m"] > 0.01).all()
    assert (np.diff(got["com_height_m"], axis=1) > 0).all()  # a single jump pushes off the firmer ground


def test_what_cannot_be_followed_is_nan_with_a_reason():
    model = Model("granular", ("two_resistance",), ModelParameters(**{**BED, "k2": 0.0}), **SAND)
    got = jump_batch(model, sine_rows(7.0, 0.01875, 1.5 * math.pi, 1.0), k1=[2100.0, 500.0])
    assert got["failure"].tolist() == ["", "the bed cannot carry the robot"]
    assert np.isnan(got["com_height_m"]).tolist() == [False, True]


@pytest.mark.parametrize(
    "varied, said",
    [
        ({"k1": [2e3, -1.0, -2.0]}, "jump 1 of the batch: model k1 = -1.0: must be > 0"),
        ({"rod_mass": [0.1, math.nan]}, "jump 1 of the batch: model rod_mass = nan"),
        ({"foot_mass": [0.0]}, "jump 0 of the batch: model foot_mass: 0 kg; must be > 0"),
        ({"b": [1.0, 0.6, 0.4]}, "jump 2 of the batch: .* would create energy"),
        ({"k_1": [1.0]}, "jump_batch k_1: no value of a model"),
    ],
)
def test_bad_values_are_named(varied, said):
    with pytest.raises((InputError, ValueError), match=said):
        jump_batch(case("cone")[0], sine_rows(7.0, 0.01875, 0.0, 1.0), **varied)
    with pytest.raises(ValueError, match="contiguous"):
        jump_batch(case("cone")[0], [[0, 1, 0, 0, 0, 0], [2, 3, 0, 0, 0, 0.0]])


def test_no_random_jumper_stalls():
    """400 random robots, beds and laws with every term of the batch: all end, finite, no deeper than they can fall."""
    rng = np.random.default_rng(8)
    n = 400
    terms = ("two_resistance", "inertial_drag", "depth_drag", "added_mass", "reintrusion_overshoot",
             "stop_go_overshoot", "compaction")  # fmt: skip
    values = random_values(rng, n)
    some = ModelParameters(**{name: float(x[0]) for name, x in values.items() if name in vars(ModelParameters())})
    laws = sine_rows(rng.uniform(2, 20, n), rng.uniform(1e-3, 0.03, n), rng.uniform(0, 2 * math.pi, n), 2.0)
    got = jump_batch(Model("granular", terms, some, **SAND), laws, **values)
    assert set(got["failure"]) == {""}
    for name in ("com_height_m", "jump_height_m", "flight_height_m", "max_depth_m", "peak_force_N", "peak_power_W"):
        assert np.isfinite(got[name]).all(), name
    assert (got["com_height_m"] >= 0).all() and (got["max_depth_m"] > 0).all()


OTHER = {"motor_mass": 0.5, "rod_mass": 0.7, "foot_mass": 0.05, "spring_stiffness": 3300.0, "spring_damping": 1.2,
         "gravity": 9.81, "foot_radius": 0.0254}  # fmt: skip
ON_SAND = Model(
    "granular", ("two_resistance", "inertial_drag"), ModelParameters(k1=3000.0, k2=2000.0, delta=0.012, alpha=40.0),
    volume_fraction=0.57, grain_density=1000.0, **OTHER,
)  # fmt: skip
ON_HARD = Model("hard", (), ModelParameters(), **OTHER)


def forcings():
    law = sinusoid(6.0, 0.01, 0.0, 1.0, 0.2)
    t = np.arange(0.0, 0.6, 1e-3)
    return [law, delayed(7.0, 0.01, 3.14, 0.1, 0.15), from_log(t, law(t)[0], 1e-6), Loop(law, 1e5, 500.0)]


@pytest.mark.parametrize(("ground", "shift"), [("granular", 7e-4), ("hard", -3e-3)])
def test_the_same_as_jump_by_jump(ground, shift):
    """Laws, delays, logs and loops together; times that begin after the start, end before the motor or it all."""
    model = ON_SAND if ground == "granular" else ON_HARD
    other = dataclasses.replace(model, foot_mass=0.06)
    spans = [(0.0, 0.9), (0.3, 0.8), (0.0, 0.25), (0.05, 0.12)]
    times = [np.arange(a, b, 2e-3) for a, b in spans]
    jumps, stops = forcings(), [0.4, 0.6, 0.5, 0.38]
    tracks = Tracks(jumps, stops, times)
    out = np.full((2, tracks.t.size), -1.0)
    which, lanes, models = [0, 2, 3, 1, 2], [0, 0, 0, 0, 1], [model, other, model, other, model]
    t = np.stack([tracks.t + shift, tracks.t + 2 * shift])
    tracks.heights(which, lanes, models, t, out, rtol=1e-8, atol=1e-10)
    for i, lane, m in zip(which, lanes, models):
        t = times[i] + (1 + lane) * shift
        lead = [jumps[i].start] if t[0] > jumps[i].start else []
        motion = simulate(m, jumps[i], t=np.concatenate([lead, t]), rtol=1e-8, atol=1e-10, stop=stops[i])
        assert np.array_equal(out[lane, tracks.places[i]], motion.rod[-t.size :] - motion.rest)
