"""Frames that come twice, and light that stands still while the rest moves: named, and left out where that is right."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

import jumpvision as jv
from jumpvision.films.vision.scene import scene_shift

H, W = 120, 150  # px


def spots(rng, n, shift):
    """n particles of 4 px at places that repeat beyond the picture, moved by (x, y)."""
    places = rng.uniform(0.0, 1.0, (n, 2)) * (W + 20, H + 20)
    rows, columns = np.arange(H)[:, None], np.arange(W)[:, None]
    x, y = ((places + shift) % (W + 20, H + 20) - 10).T
    return 90.0 * (np.exp(-((rows - y) ** 2) / 2.0) @ np.exp(-((columns - x) ** 2) / 2.0).T)


def flow(seed, stuck):
    """(frames, px a frame to the right) of 700 particles that move by 8 px in all, and of some that do not."""
    steps = 9
    u = 8.0 / steps
    noise = np.random.default_rng([75, seed])
    still = 20.0 + spots(np.random.default_rng([2, seed]), stuck, 0.0)
    film = [still + spots(np.random.default_rng([1, seed]), 700, (u * k, 0.0)) for k in range(steps + 1)]
    return np.clip(np.rint(film + noise.normal(0.0, 2.0, (steps + 1, H, W))), 0, 255).astype(np.uint8), u


def told(frames, **settings):
    with warnings.catch_warnings(record=True) as said:
        warnings.simplefilter("always")
        field = jv.piv(frames, window=24, step=12, **settings)
    return field, [str(w.message) for w in said]


@pytest.mark.parametrize("seed", range(3))
def test_particles_on_the_glass_are_named_with_their_share(seed):
    """150 beside 700: 18 % of the light, by which displacements come out too small."""
    frames, u = flow(seed, 150)
    field, said = told(frames)
    assert 0.7 * u < float(field.u.mean()) < 0.95 * u
    share = [float(s.split("%")[0]) for s in said if "stands still" in s]
    assert len(share) == 1 and 10.0 < share[0] < 26.0


@pytest.mark.parametrize("seed", range(3))
def test_clean_particles_raise_no_doubt(seed):
    frames, u = flow(seed, 0)
    field, said = told(frames)
    assert said == [] and float(field.u.mean()) == pytest.approx(u, abs=0.01)


def test_a_pair_with_a_frame_twice_has_no_vectors():
    """Neither that of one picture nor the next, which holds the motion of two frames; the others keep theirs."""
    frames, u = flow(0, 0)
    field, said = told(frames[[0, 1, 2, 2, 3, 4]])
    assert [bool(np.isfinite(field.u.isel(t=k)).any()) for k in range(5)] == [True, True, False, False, True]
    assert float(field.u.mean()) == pytest.approx(u, abs=0.01)
    assert said[0].startswith("1 of 6 frames are the picture before again, first 3")


@pytest.mark.parametrize("every", [2, 5])
def test_a_ball_filmed_at_a_lower_rate_than_the_film_has(every):
    """Repeats are flagged; the rest is where the ball is."""
    rng = np.random.default_rng([76, every])
    t = np.arange(60) / 120.0
    y = 90.0 - 60.0 * np.sin(2.0 * math.pi * t) ** 2
    rows, columns = np.mgrid[:H, :W]
    clean = [40.0 + 150.0 * np.clip(9.5 - np.hypot(columns - 70.0, rows - at), 0.0, 1.0) for at in y]
    frames = np.clip(np.rint(clean + rng.normal(0.0, 3.0, (60, H, W))), 0, 255).astype(np.uint8)
    first = np.arange(60) // 2 * 2 if every == 2 else np.arange(60) - (np.arange(60) % 5 == 4)
    with pytest.warns(UserWarning, match=rf"{60 // every} of 60 frames are the picture before again, one in {every}"):
        track = jv.track(frames[first], frame_rate=120.0, diameter=19.0)
    assert list(np.flatnonzero(track.flag != "")) == list(np.flatnonzero(first != np.arange(60)))
    good = track.flag == ""
    assert np.abs(track.y_px[good] - y[good]).max() < 0.2  # px, ten times the noise of a place


def woven(shift, pitch, turn):
    """A cloth of two waves at right angles, moved by (x, y)."""
    rows, columns = np.mgrid[:H, :W] * 1.0
    x, y = columns - shift[0], rows - shift[1]
    a, b = x * math.cos(turn) + y * math.sin(turn), y * math.cos(turn) - x * math.sin(turn)
    k = 2.0 * math.pi / pitch
    return 110.0 + 45.0 * np.cos(k * a) + 35.0 * np.cos(k * b)


@pytest.mark.parametrize("shift", [(7.0, 0.0), (-2.0, 1.5), (12.0, 1.0)])
def test_a_pattern_that_repeats_is_known_but_for_its_period(shift):
    """The smallest displacement is given, of 12 px periods turned by 0.2 rad, with a sigma that holds one."""
    rng, pitch, turn = np.random.default_rng([77]), 12.0, 0.2
    pair = [np.rint(woven(d, pitch, turn) + rng.normal(0.0, 2.0, (H, W))).astype(np.uint8) for d in ((0, 0), shift)]
    field, said = told(np.array(pair))
    axes = np.array([[math.cos(turn), math.sin(turn)], [-math.sin(turn), math.cos(turn)]])
    cell = axes @ shift
    least = axes.T @ (cell - pitch * np.rint(cell / pitch))
    assert float(field.u.median()) == pytest.approx(least[0], abs=0.05)
    assert float(-field.v.median()) == pytest.approx(least[1], abs=0.05)
    assert float(field.u_sigma.median()) == pytest.approx(pitch, rel=0.03)
    assert any("repeats every 12 px" in s for s in said)


@pytest.mark.parametrize("seed", range(6))
def test_a_camera_that_was_touched_is_told_with_shift_and_frame(seed):
    """A textured scene in noise, before which a bright disc moves; it stands elsewhere from frame 25 on, or not."""
    rng, shift = np.random.default_rng([79, seed]), (0.0, 0.0) if seed % 2 else (1.3, -1.8)
    rows, columns = np.mgrid[:H, :W] * 1.0
    waves = [(*rng.uniform(-0.6, 0.6, 2), rng.uniform(0.0, 6.28)) for _ in range(40)]
    film = []
    for k in range(40):
        x, y = (columns - shift[0], rows - shift[1]) if k >= 25 else (columns, rows)
        scene = 60.0 + 3.0 * sum(np.cos(a * x + b * y + c) for a, b, c in waves)
        disc = np.clip(9.0 - np.hypot(x - 75.0, y - 20.0 - 2.0 * k), 0.0, 1.0)
        film.append(
            np.rint(scene + disc * (190.0 - scene) + rng.normal(0.0, 4.0, (H, W))).clip(0, 255).astype(np.uint8)
        )
    said = scene_shift(np.array(film))
    assert (said != "") == (seed % 2 == 0)
    if said:
        x, y, frame = (
            float(said.split(a)[1].split(b)[0]) for a, b in (("stands ", " px"), ("and ", " px"), ("frame ", " on"))
        )
        assert math.hypot(x - shift[0], y - shift[1]) < 0.3 and abs(frame - 25) <= 5  # a ninth of the film


def test_frames_of_two_scenes_have_no_displacement():
    """What is matched by chance is told."""
    frames = np.array([flow(seed, 0)[0][0] for seed in (5, 6)])
    try:
        _, said = told(frames)
    except ValueError as e:
        said = [str(e)]
    assert any("were matched" in s or "no vector in the field" in s for s in said)
