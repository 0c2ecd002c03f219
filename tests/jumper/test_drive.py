"""Faults of the drive: beside closed forms and the laboratory's own writing."""

from __future__ import annotations

import math

import numpy as np
import pytest

from jumpvision.base.schema import InputError
from jumpvision.jumper.mechanisms import drive
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.batch import jump_batch
from jumpvision.jumper.physics.drive import cubics, played
from jumpvision.jumper.physics.energy import energy_ledger
from jumpvision.jumper.physics.forcing import Loop, Spline, sinusoid
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import Tracks, simulate
from jumpvision.laboratory.jumper import Law, Robot, motion_of

A, F = 0.01, 8.0  # m, Hz
W = 2.0 * math.pi * F
LAID = 1.5e-6 * A  # m, of a sine as cubics of 0.15 rad
SINE = cubics(sinusoid(F, A, 0.0, cycles=2.0))
HARD = {
    "motor_mass": 1.003, "rod_mass": 0.175, "foot_mass": 0.0, "spring_stiffness": 5760.6, "spring_damping": 1.368,
    "gravity": 2.70756,
}  # fmt: skip
FAULTS = {
    "loop_bandwidth": {"t_n": 2e-3, "zeta": 0.6},
    "speed_limit": {"top_speed": 0.12},
    "stroke_limit": {"reach": 3e-3},
    "drive_play": {"play": 5e-4, "flank": 0.5},
}


def of(fault: str, **more) -> Model:
    return Model("hard", (fault,), ModelParameters(**FAULTS[fault], **more), **HARD)


@pytest.mark.parametrize("flank", [-1.0, 0.6])
def test_play_of_a_sine_is_the_sine_clipped_and_shifted_by_half_the_play(flank):
    """X = x - b/2 on the way up, held at A - b/2 until x has gone down by b, and so on, less the gap it began in."""
    b = 2e-3
    motion = Spline(*drive.play(SINE.knots, SINE.c, b, flank))
    begins = 0.5 * flank * b  # of the gap's middle, so of the carriage beside x - b/2
    t = np.linspace(0.25 / F, 2.0 / F, 4001)
    x = A * np.sin(W * t)
    turn = (math.pi - math.asin(1.0 - b / A)) / W  # x has gone down by b from its top
    back = 1.0 / F - (math.asin(1.0 - b / A)) / W  # x has come up by b from its bottom
    phase = t - 1.0 / F * np.floor(t * F)
    down = (phase >= turn) & (phase < 0.75 / F)
    truth = np.where(down, x + 0.5 * b, x - 0.5 * b)
    truth = np.where((phase >= 0.25 / F) & (phase < turn), A - 0.5 * b, truth)
    truth = np.where((phase >= 0.75 / F) & (phase < back), -A + 0.5 * b, truth)
    np.testing.assert_allclose(motion(t)[0], truth + begins, atol=LAID)
    first = np.linspace(0.0, 0.25 / F, 501)
    rises = np.maximum(A * np.sin(W * first) - 0.5 * (1.0 - flank) * b, 0.0)
    np.testing.assert_allclose(motion(first)[0], rises, atol=LAID)
    np.testing.assert_array_equal(drive.play(SINE.knots, SINE.c, 0.0, flank)[1], SINE.c)


def test_a_stroke_is_cut_and_a_loop_lags_as_its_transfer_function_says():
    t = np.linspace(0.0, 2.0 / F, 4001)
    cut = Spline(*drive.stroke(SINE.knots, SINE.c, 0.4 * A))
    np.testing.assert_allclose(cut(t)[0], np.clip(A * np.sin(W * t), -0.4 * A, 0.4 * A), atol=LAID)
    t_n, zeta = 1e-3, 0.7
    led = Spline(*drive.loop(SINE.knots, SINE.c, t_n, zeta))
    late = t > 30.0 * t_n
    response = 1.0 / (1.0 - (W * t_n) ** 2 + 2j * zeta * W * t_n)
    truth = A * np.imag(response * np.exp(1j * W * t))
    np.testing.assert_allclose(led(t)[0][late], truth[late], atol=3.0 * LAID)
    assert led(led.stop)[0][0] == pytest.approx(0.0, abs=1e-8)
    nothing = Spline(*drive.loop(SINE.knots, SINE.c, 1e-6, zeta))
    np.testing.assert_allclose(nothing(t)[0], A * np.sin(W * t), atol=LAID + 2 * zeta * 1e-6 * A * W)


@pytest.mark.parametrize("fault", FAULTS)
def test_the_laboratory_writes_the_same_fault(fault):
    """Its steps of 20 us against pieces: a kink is late by a step at most, 1e-5 s x 0.3 m/s in half of it."""
    f, phase, size = 9.0, 0.4, 4e-3
    robot = Robot(HARD["motor_mass"], 0.175, 0.0, 5760.6, 1.368, 0.0381, 2.70756)
    law = Law(f, size, phase, 0.05)
    made = motion_of(robot, law, (fault,), FAULTS[fault], ground="hard", duration=0.5)
    ours = simulate(of(fault), sinusoid(f, size, phase, start=0.05), t=made.t, rtol=1e-8, atol=1e-10)
    plain = simulate(Model("hard", (), **HARD), sinusoid(f, size, phase, start=0.05), t=made.t, rtol=1e-8, atol=1e-10)
    np.testing.assert_allclose(ours.motor - ours.rod, made.motor, atol=8e-6)
    np.testing.assert_allclose(ours.rod, made.rod, atol=3e-5)
    assert np.abs(ours.rod - plain.rod).max() > 5e-4


def test_tracks_and_the_ledger_know_the_drive_too():
    law, t = sinusoid(9.0, 4e-3, 0.4, start=0.05), np.linspace(0.0, 0.4, 401)
    tracks = Tracks([law, law], [law.stop] * 2, [t, t[:200]])
    models = [of("drive_play"), of("stroke_limit"), Model("hard", (), **HARD), of("drive_play")]
    which, lanes = [0, 0, 1, 1], [0, 1, 0, 1]
    out = np.full((2, tracks.t.size), np.nan)
    tracks.heights(which, lanes, models, np.stack([tracks.t] * 2), out, rtol=1e-7, atol=1e-9)
    for i, lane, m in zip(which, lanes, models):
        own = simulate(m, law, t=t, rtol=1e-7, atol=1e-9)
        here = tracks.places[i]
        np.testing.assert_allclose(out[lane, here], (own.rod - own.rest)[: here.stop - here.start], atol=1e-12)
    ledger = energy_ledger(of("drive_play"), law, end=0.4)
    assert abs(ledger.residual) < 1e-6 * ledger.turnover


def test_where_a_drive_cannot_act_it_is_refused():
    law = sinusoid(9.0, 4e-3, 0.4)
    with pytest.raises(ValueError, match=r"'drive_play' acts on a motion"):
        played(of("drive_play"), Loop(law, 2e4, 100.0))
    with pytest.raises(InputError, match="'drive_play' is not swept over"):
        jump_batch(of("drive_play"), law.rows)
