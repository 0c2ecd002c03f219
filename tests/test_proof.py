"""A track proves itself: rulers, smudges, fast balls, targets that are no discs. Films drawn here by sub-pixels."""

from __future__ import annotations

import math
import warnings

import cv2
import numpy as np
import pytest

from jumpvision.init.recognise import by_picture
from jumpvision.stages.track import of_arrays
from jumpvision.vision.ball.moving import moving_paths, still_scene
from jumpvision.vision.ball.proof import proved
from jumpvision.vision.ball.track import BallSettings, track_ball

H, W, D = 200, 300, 14.0
FINE = 5


def mean(a):
    """Of the sub-pixels of each pixel."""
    return a.reshape(a.shape[0] // FINE, FINE, a.shape[1] // FINE, FINE).mean(axis=(1, 3))


def cover(x, y, d, shape=(H, W)):
    """(share (H, W) of each pixel within the disc, share of it in its lower half)."""
    sub = (np.arange(FINE) + 0.5) / FINE - 0.5
    v, u = np.meshgrid(
        (np.arange(shape[0])[:, None] + sub).ravel(), (np.arange(shape[1])[:, None] + sub).ravel(), indexing="ij"
    )
    inside = np.hypot(u - x, v - y) < d / 2
    return mean(inside), inside, u - x, v - y


def scene(ruler=True):
    out = np.full((H, W), 60.0)
    if ruler:  # with a round end, as bright and as wide as the ball
        out[120:, 40:54] = 210.0
        out += 150.0 * cover(46.5, 120.0, 14.0)[0] * (out < 100)
    return out


def film(track, rng, *, behind=None, tone=1.0, spin=0.0, noise=1.0):
    frames = []
    behind = scene() if behind is None else behind
    for i, (x, y) in enumerate(track):
        share, inside, u, v = cover(x, y, D)
        side = v * math.cos(spin * i) - u * math.sin(spin * i)
        light = mean(inside * np.where(side > 0, 210.0, tone * 210.0))
        frames.append(
            np.clip(np.rint(behind * (1 - share) + light + rng.normal(0, noise, (H, W))), 0, 255).astype(np.uint8)
        )
    return np.array(frames)


def toss(n, step, x0=70.0, y0=180.0):
    """A parabola: `step` px a frame to the right, up and down again."""
    i = np.arange(n)
    top = 0.5 * (n - 1)
    return np.stack([x0 + step * i, y0 - 150.0 * (1 - ((i - top) / top) ** 2)], axis=1)


def test_a_fast_ball_is_found_beside_a_ruler_that_looks_like_one():
    """10 frames, 1.7 to 4 diameters apart, no seed, no ball in the first: the ball in each, to 0.1 px; that a still
    thing was passed over is said."""
    truth = toss(10, 24.0, x0=-6.0)
    behind = scene() + 150.0 * cover(250.0, 60.0, D)[0]
    frames = film(truth, np.random.default_rng(0), behind=behind)
    with pytest.warns(UserWarning) as said:
        t = of_arrays(frames, diameter=D)
    assert (t.flag == "").sum() >= 8
    off = np.hypot(t.x_px - truth[:, 0], t.y_px - truth[:, 1])
    assert np.nanmax(off) < 0.1
    assert any("stands still and was not taken" in str(w.message) for w in said)


def test_a_click_is_followed_at_four_diameters_a_frame():
    truth = toss(8, 26.0)
    t = of_arrays(film(truth, np.random.default_rng(1)), seed=tuple(truth[0]), diameter=D)
    assert (t.flag == "").sum() >= 7
    assert np.nanmax(np.hypot(t.x_px - truth[:, 0], t.y_px - truth[:, 1])) < 0.1


def test_what_stands_still_while_something_else_moves_is_doubted():
    """A sticker is the only round thing; a bar moves. Nothing is tracked, and why is in every flag."""
    still = scene(ruler=False) + 150.0 * cover(46.5, 120.0, D)[0]
    frames = np.array([still for _ in range(12)])
    for i, f in enumerate(frames):
        f[30:90, 100 + 12 * i : 106 + 12 * i] = 200.0
    with pytest.warns(UserWarning, match="doubt: stands still while something moves"):
        t = of_arrays(frames + np.random.default_rng(2).normal(0, 1, frames.shape), diameter=D)
    assert (t.flag != "").all()
    with pytest.warns(UserWarning, match="doubt"):  # a click is believed
        t = of_arrays(frames + np.random.default_rng(2).normal(0, 1, frames.shape), diameter=D, seed=(46.5, 120.0))
    assert (t.flag == "").all()


def test_a_ball_at_rest_is_no_doubt():
    """At rest alone; and at rest, up and down, at rest again: its place is empty meanwhile. Nothing is said."""
    rng = np.random.default_rng(3)
    i = np.arange(40)
    up = np.where((i > 10) & (i < 30), 60.0 * np.sin(np.pi * (i - 10) / 20), 0.0)
    for track in (np.tile([150.0, 100.0], (10, 1)), np.stack([np.full(40, 150.0), 150.0 - up], axis=1)):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            t = of_arrays(film(track, rng, behind=scene(ruler=False)), diameter=D)
        assert (t.flag == "").all()


def test_frames_on_a_smudge_are_flagged():
    """A track that goes on at a smudge after its ball has left the picture: the same is there in the frames before."""
    rng = np.random.default_rng(4)
    behind = scene(ruler=False) + 150.0 * cover(200.0, 60.0, D)[0]
    truth = np.stack([40.0 + 6.0 * np.arange(20), np.full(20, 150.0)], axis=1)
    frames = film(truth, rng, behind=behind)
    settings = BallSettings(D, "bright", "disc", 1.5, tuple(truth[0]), False, 0.0)
    t = track_ball(frames, **vars(settings))
    wrong = np.arange(20) >= 14
    x, y = np.where(wrong, 200.0, t.x), np.where(wrong, 60.0, t.y)
    false = type(t)(x, y, t.sigma, t.diameter, t.chi2, t.flag)
    out = proved(false, list(frames), settings)
    assert all("the same stands here in frame" in f for f in out.flag[wrong])
    assert (out.flag[~wrong] == "").all() and np.isnan(out.x[wrong]).all()


def test_a_ball_of_two_tones_that_turns_is_followed_as_a_picture():
    """0.05 rad and 1 to 3 diameters a frame, clicked off its centre: the point clicked, to a tenth of a pixel rms; the
    picture is laid anew by interpolation, which costs more than the noise."""
    rng = np.random.default_rng(5)
    truth = toss(14, 15.0)
    frames = film(truth, rng, tone=0.4, spin=0.05, behind=scene(ruler=False))
    off = np.array([2.0, -1.0])
    t = of_arrays(frames, method="template", seed=tuple(truth[0] + off), diameter=D)
    a = 0.05 * np.arange(14)
    clicked = truth + np.stack(
        [off[0] * np.cos(a) - off[1] * np.sin(a), off[0] * np.sin(a) + off[1] * np.cos(a)], axis=1
    )
    good = (t.flag == "").to_numpy()
    assert good.sum() >= 13
    e = np.stack([t.x_px - clicked[:, 0], t.y_px - clicked[:, 1]], axis=1)[good]
    assert np.sqrt(np.mean((e - e.mean(axis=0)) ** 2)) < 0.1
    assert 0.001 < np.median(t.sigma_px[good]) < 0.2


def test_a_template_needs_a_click():
    with pytest.raises(ValueError, match="follows what is at the seed"):
        of_arrays(np.zeros((3, 50, 60)), method="template")


def test_flags_name_what_helps_and_the_border_only_where_it_was_crossed():
    """A jump of five diameters from slow motion, inside the picture; and a ball that runs out of it."""
    rng = np.random.default_rng(6)
    inside = np.concatenate([np.stack([100.0 + 2.0 * np.arange(5), np.full(5, 100.0)], axis=1), [[200.0, 40.0]]])
    s = {
        "diameter": D,
        "polarity": "bright",
        "method": "disc",
        "search": 1.5,
        "streak": False,
        "exposure_fraction": 0.0,
    }
    t = track_ball(film(inside, rng, behind=scene(ruler=False)), seed=tuple(inside[0]), **s)
    assert "left the image" not in t.flag[5] and t.flag[5] != ""
    leaving = np.stack([200.0 + 20.0 * np.arange(10), np.full(10, 100.0)], axis=1)
    t = track_ball(film(leaving, rng, behind=scene(ruler=False)), seed=tuple(leaving[0]), **s)
    assert (t.flag[:4] == "").all() and "left the image" in t.flag[-1]


def test_init_takes_no_ball_film_for_grains():
    """The first frame has a ruler, two stickers and a ball: no single one. What moves through the film is a ball."""

    class Film(list):
        pass

    behind = scene() + 150.0 * (cover(250.0, 50.0, D)[0] + cover(200.0, 170.0, 12.0)[0])
    frames = Film(film(toss(12, 18.0, x0=60.0), np.random.default_rng(7), behind=behind))
    assert by_picture(frames) == "rod_video"
    grains = np.random.default_rng(8).normal(100, 30, (80, 90))
    moving = Film(np.clip(np.roll(grains, i, axis=0), 0, 255).astype(np.uint8) for i in range(12))
    assert by_picture(moving) == "grain_video"


def test_paths_are_of_one_thing_each():
    """Two balls thrown at once: two paths, no spot in both."""
    rng = np.random.default_rng(9)
    one = toss(10, 15.0, x0=60.0) * [1.0, 0.4] + [0.0, 10.0]
    two = one + np.array([20.0, 90.0])
    frames = film(one, rng, behind=scene(ruler=False))
    other = film(two, rng, behind=scene(ruler=False))
    both = np.maximum(frames, other)
    found = moving_paths(list(both), still_scene(list(both)), D, "bright", 6.0)
    assert len(found) == 2
    spots = [{(s.i, s.x) for s in p} for p in found]
    assert not spots[0] & spots[1] and min(map(len, spots)) >= 7


def test_a_template_that_has_left_the_picture_is_not_found_elsewhere():
    """A two-toned target crosses the side edge; its double lies on the wall: flagged from there on."""
    rng = np.random.default_rng(6)
    frames, x = [], 30.0 + 14.0 * np.arange(14)
    for at in x:
        picture = np.full((90, 160), 80.0)
        for cx, cy in ((at, 40.0), (40.0, 75.0)):
            cv2.circle(picture, (round(cx), round(cy)), 8, 200, -1)
            cv2.ellipse(picture, (round(cx), round(cy)), (8, 8), 0, 0, 180, 140, -1)
        frames.append(np.clip(picture + rng.normal(0, 2, picture.shape), 0, 255).astype(np.uint8))
    t = of_arrays(np.array(frames), method="template", seed=(30.0, 40.0), diameter=17.0)
    inside = x < 148
    assert (t.flag[inside] == "").all() and np.abs(t.x_px[inside] - x[inside]).max() < 1.0
    assert (t.flag[~inside] != "").all() and t.flag.iloc[-1] == "left the image"
