"""Tracks of many jumps in one compiled call: the same numbers as jump by jump."""

import dataclasses

import numpy as np
import pytest

from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.forcing import Loop, delayed, from_log, sinusoid
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import Tracks, simulate

ROBOT = {"motor_mass": 0.5, "rod_mass": 0.7, "foot_mass": 0.05, "spring_stiffness": 3300.0, "spring_damping": 1.2,
         "gravity": 9.81, "foot_radius": 0.0254}  # fmt: skip
SAND = Model(
    "granular", ("two_resistance", "inertial_drag"), ModelParameters(k1=3000.0, k2=2000.0, delta=0.012, alpha=40.0),
    volume_fraction=0.57, grain_density=1000.0, **ROBOT,
)  # fmt: skip
HARD = Model("hard", (), ModelParameters(), **ROBOT)


def forcings():
    law = sinusoid(6.0, 0.01, 0.0, 1.0, 0.2)
    t = np.arange(0.0, 0.6, 1e-3)
    return [law, delayed(7.0, 0.01, 3.14, 0.1, 0.15), from_log(t, law(t)[0], 1e-6), Loop(law, 1e5, 500.0)]


@pytest.mark.parametrize("ground", ["granular", "hard"])
@pytest.mark.parametrize("shift", [0.0, 7e-4, -3e-3])
def test_the_same_as_jump_by_jump(ground, shift):
    """Laws, delays, logs and loops together; times that begin after the start, end before the motor or it all."""
    model = SAND if ground == "granular" else HARD
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


def test_only_the_jumps_asked_for_are_written():
    tracks = Tracks(forcings()[:2], [0.4, 0.6], [np.arange(0.0, 0.5, 2e-3)] * 2)
    out = np.full((1, tracks.t.size), -1.0)
    tracks.heights([1], [0], [SAND], tracks.t[None], out, rtol=1e-7, atol=1e-9)
    assert np.all(out[0, tracks.places[0]] == -1.0) and np.all(out[0, tracks.places[1]] > -1.0)


def test_a_bed_that_cannot_carry_gives_nan_and_a_loop_with_a_lag_is_refused():
    soft = dataclasses.replace(SAND, parameters=dataclasses.replace(SAND.parameters, k2=0.0))
    tracks = Tracks(forcings()[:1], [0.4], [np.arange(0.0, 0.5, 2e-3)])
    out = np.zeros((1, tracks.t.size))
    weak = dataclasses.replace(soft, parameters=dataclasses.replace(soft.parameters, k1=1.0))
    tracks.heights([0], [0], [weak], tracks.t[None], out, rtol=1e-7, atol=1e-9)
    assert np.isnan(out).all()
    lag = dataclasses.replace(
        HARD, terms=("motor_lag",), parameters=dataclasses.replace(HARD.parameters, tau=4e-3)
    )  # fmt: skip
    looped = Tracks(forcings()[3:], [0.4], [np.arange(0.0, 0.5, 2e-3)])
    with pytest.raises(ValueError, match="motor_lag"):
        looped.heights([0], [0], [lag], looped.t[None], out, rtol=1e-7, atol=1e-9)
