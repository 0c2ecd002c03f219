"""A track proves itself: rulers, smudges, fast balls, targets that are no discs. Films drawn here by sub-pixels."""

from __future__ import annotations

import math
import warnings

import cv2
import numpy as np
import pytest

from jumpvision.experiment.init.recognise import by_picture
from jumpvision.films.arrays.track import track as of_arrays
from jumpvision.films.vision.ball.film import track_ball
from jumpvision.films.vision.ball.track import BallSettings

H, W, D = 200, 300, 14.0
FINE = 5


def mean(a):
    """Of the sub-pixels of each pixel."""
    return a.reshape(a.shape[0] // FINE, FINE, a.shape[1] // FINE, FINE).mean(axis=(1, 3))


def near(x, y, reach):
    """The part of the picture (rows, columns) within `reach` [px] of (x, y), and its sub-pixels' places (u, v) from
    there: what is drawn has ended there, and the rest of the picture is not computed."""
    rows, columns = (range(*np.clip([round(at) - reach, round(at) + reach + 1], 0, n)) for at, n in ((y, H), (x, W)))
    sub = (np.arange(FINE) + 0.5) / FINE - 0.5
    v, u = np.meshgrid(*((np.array(a)[:, None] + sub).ravel() for a in (rows, columns)), indexing="ij")
    return (slice(rows.start, rows.stop), slice(columns.start, columns.stop)), u - x, v - y


def cover(x, y, d):
    """Share (H, W) of each pixel within the disc."""
    out = np.zeros((H, W))
    box, u, v = near(x, y, math.ceil(d / 2) + 2)
    out[box] = mean(np.hypot(u, v) < d / 2)
    return out


def two_tones(x, y, turn, light, dark):
    """The light (H, W) of a ball of two tones whose boundary has turned by `turn` [rad]."""
    out = np.zeros((H, W))
    box, u, v = near(x, y, math.ceil(D / 2) + 2)
    out[box] = mean((np.hypot(u, v) < D / 2) * np.where(v * math.cos(turn) - u * math.sin(turn) > 0, light, dark))
    return out


def scene(ruler=True):
    out = np.full((H, W), 60.0)
    if ruler:  # with a round end, as bright and as wide as the ball
        out[120:, 40:54] = 210.0
        out += 150.0 * cover(46.5, 120.0, 14.0) * (out < 100)
    return out


def film(track, rng, *, behind=None, tone=1.0, spin=0.0, noise=1.0):
    frames = []
    behind = scene() if behind is None else behind
    for i, (x, y) in enumerate(track):
        picture = behind * (1 - cover(x, y, D)) + two_tones(x, y, spin * i, 210.0, tone * 210.0)
        frames.append(np.clip(np.rint(picture + rng.normal(0, noise, (H, W))), 0, 255).astype(np.uint8))
    return np.array(frames)


def toss(n, step, x0=70.0, y0=180.0):
    """A parabola: `step` px a frame to the right, up and down again."""
    i = np.arange(n)
    top = 0.5 * (n - 1)
    return np.stack([x0 + step * i, y0 - 150.0 * (1 - ((i - top) / top) ** 2)], axis=1)


def test_a_fast_ball_is_found_beside_a_ruler_that_looks_like_one():
    """10 frames, 1.7 to 4 diameters apart, no seed, no ball in the first: the ball in each, to 0.1 px."""
    truth = toss(10, 24.0, x0=-6.0)
    behind = scene() + 150.0 * cover(250.0, 60.0, D)
    frames = film(truth, np.random.default_rng(0), behind=behind)
    t = of_arrays(frames, diameter=D)
    assert (t.flag == "").sum() >= 8
    off = np.hypot(t.x_px - truth[:, 0], t.y_px - truth[:, 1])
    assert np.nanmax(off) < 0.1


def test_a_click_on_a_dark_ball_follows_it_and_not_its_shadow():
    """2 to 4 diameters a frame before a bright wall, the shadow 1.1 diameters beside it and longer in the picture."""
    truth, frames = toss(12, -25.0, x0=272.0, y0=170.0), []
    for x, y in truth:
        picture = np.full((H, W), 190.0) * (1 - 0.25 * cover(x + 0.8 * D, y + 0.8 * D, D))
        picture += (40.0 - picture) * cover(x, y, D)
        frames.append(picture + np.random.default_rng(len(frames)).normal(0, 1.0, (H, W)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        t = of_arrays(np.array(frames), diameter=D, polarity="dark", seed=tuple(truth[0] + [2.0, -2.0]))
    off = np.hypot(t.x_px - truth[:, 0], t.y_px - truth[:, 1])
    assert (t.flag == "").sum() >= 10
    assert np.nanmax(off) < 0.1


def test_what_stands_still_while_something_else_moves_is_doubted():
    """A sticker is the only round thing; a bar moves. Nothing is tracked, and why is in every flag; a click is
    believed."""
    frames = np.array([scene(ruler=False) + 150.0 * cover(46.5, 120.0, D) for _ in range(12)])
    for i, f in enumerate(frames):
        f[30:90, 100 + 12 * i : 106 + 12 * i] = 200.0
    frames += np.random.default_rng(2).normal(0, 1, frames.shape)
    for click in ({}, {"seed": (46.5, 120.0)}):
        with pytest.warns(UserWarning, match="doubt" if click else "doubt: stands still while something moves"):
            t = of_arrays(frames, diameter=D, **click)
        assert ((t.flag == "") == bool(click)).all()


def test_a_ball_at_rest_is_no_doubt():
    """At rest, up and down, at rest again: its place is empty meanwhile. Nothing is said."""
    i = np.arange(40)
    up = np.where((i > 10) & (i < 30), 60.0 * np.sin(np.pi * (i - 10) / 20), 0.0)
    track = np.stack([np.full(40, 150.0), 150.0 - up], axis=1)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        t = of_arrays(film(track, np.random.default_rng(3), behind=scene(ruler=False)), diameter=D)
    assert (t.flag == "").all()


@pytest.mark.parametrize("back", [True, False])
def test_a_ball_is_not_taken_for_its_like_that_was_seen_beside_it(back):
    """Its like comes out of behind a post on its own way; the ball turns back there, and is seen again, or stays."""
    i, rng, frames = np.arange(24), np.random.default_rng(11), []
    way = np.minimum(i, 24 - i) if back else np.minimum(i, 12)
    one = np.stack([20.0 + 10.0 * way, 60.0 + 3.0 * np.maximum(i - 12, 0) * back], axis=1)
    other = np.stack([-12.0 + 12.0 * i, 140.0 - 6.5 * i], axis=1)
    for a, b in zip(one, other):
        share = np.maximum(cover(*a, D), cover(*b, D))
        share[:, 124:156] = 0.0
        frames.append(np.rint(60.0 + 150.0 * share + rng.normal(0, 1.0, (H, W))).astype(np.uint8))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        t = of_arrays(np.array(frames), diameter=D, seed=tuple(one[0]))
    off = np.hypot(t.x_px - one[:, 0], t.y_px - one[:, 1])
    assert (t.flag[:10] == "").all() and np.nanmax(off) < 0.1
    assert ((t.flag[15:] == "") == back).all()


def test_what_was_clicked_on_a_ball_of_two_tones_that_turns_is_followed():
    """0.05 rad and 1 to 3 diameters a frame, clicked off its centre: that place, to 0.05 px rms about what all frames
    share, which is the first frame's own error and what the drawn rim of 5 x 5 sub-pixels is off by: 0.15 px."""
    rng = np.random.default_rng(5)
    truth = toss(14, 15.0)
    frames = film(truth, rng, tone=0.4, spin=0.05, behind=scene(ruler=False))
    t = of_arrays(frames, diameter=D, method="template", seed=tuple(truth[0] + [2.0, -1.0]))
    clicked = (truth @ [1, 1j]) + (2.0 - 1.0j) * np.exp(0.05j * np.arange(14))
    good = (t.flag == "").to_numpy()
    assert good.sum() >= 13
    e = (t.x_px + 1j * t.y_px - clicked)[good]
    assert np.sqrt(np.mean(np.abs(e - e.mean()) ** 2) / 2) < 0.05
    assert abs(e.mean()) < 0.15
    with pytest.raises(ValueError, match="follows what is at the seed"):
        of_arrays(frames, method="template")


BLUR, MANY = 0.7, 10  # px: of a lens; sub-pixels of a pixel, each way


def lens(x, y, turn, tone=0.4):
    """The scene with a ball of two tones, both sharp, through a lens that blurs what is in front of it."""
    n, x0, y0 = 20, round(x), round(y)
    sub = (np.arange(MANY) + 0.5) / MANY - 0.5
    at = (np.arange(-n, n + 1)[:, None] + sub).ravel()
    u, v = np.meshgrid(at + x0 - x, at + y0 - y)
    inside = np.clip((D / 2 - np.hypot(u, v)) * MANY + 0.5, 0.0, 1.0)
    side = np.clip((v * math.cos(turn) - u * math.sin(turn)) * MANY + 0.5, 0.0, 1.0)
    fine = 60.0 * (1 - inside) + 210.0 * inside * (tone + (1 - tone) * side)
    fine = cv2.GaussianBlur(fine, (0, 0), BLUR * MANY, borderType=cv2.BORDER_REPLICATE)
    out = np.full((H + 2 * n, W + 2 * n), 60.0)
    out[y0 : y0 + 2 * n + 1, x0 : x0 + 2 * n + 1] = fine.reshape(2 * n + 1, MANY, 2 * n + 1, MANY).mean(axis=(1, 3))
    return out[n:-n, n:-n]


def test_the_sigma_of_a_target_of_two_tones_covers(films=4):
    """Films of 14 frames, noise 3, 0.05 rad a frame, blurred as a lens does. sigma is the larger of two axes that
    differ by 1.27: it covers 68 % along one, 80 % along the other, 74 % in all, within three standard deviations."""
    errors, sigmas = [], []
    for seed in range(films):
        rng = np.random.default_rng([9, seed])
        truth = toss(14, 15.0) + rng.uniform(-0.5, 0.5, (14, 2))
        clean = np.array([lens(x, y, 0.05 * k) for k, (x, y) in enumerate(truth)])
        frames = np.clip(np.rint(clean + rng.normal(0, 3.0, clean.shape)), 0, 255).astype(np.uint8)
        t = of_arrays(frames, diameter=D, method="template", seed=tuple(truth[0]))
        good = (t.flag == "").to_numpy()
        e = np.stack([t.x_px - truth[:, 0], t.y_px - truth[:, 1]], axis=1)[good]
        errors.append(e - np.median(e, axis=0))
        sigmas.append(np.repeat(t.sigma_px[good].to_numpy()[:, None], 2, axis=1))
    error, sigma = np.concatenate(errors), np.concatenate(sigmas)
    assert error.size >= 320 / 12 * films
    assert abs(np.mean(np.abs(error) < sigma) - 0.74) < 3 * math.sqrt(0.74 * 0.26 / (28 * films))
    assert np.sqrt(np.mean(error**2)) < 0.03


def test_flags_name_the_border_only_where_it_was_crossed():
    """A jump of eight diameters from slow motion, inside the picture, is found; a ball that runs out of it has left."""
    rng = np.random.default_rng(6)
    inside = np.concatenate([np.stack([100.0 + 2.0 * np.arange(5), np.full(5, 100.0)], axis=1), [[200.0, 40.0]]])
    leaving = np.stack([200.0 + 20.0 * np.arange(10), np.full(10, 100.0)], axis=1)
    for way in (inside, leaving):
        settings = BallSettings(D, "bright", "disc", 1.5, tuple(way[0]), False, 0.0)
        t = track_ball(film(way, rng, behind=scene(ruler=False)), **vars(settings))
        assert (t.flag[:4] == "").all() and ("left the image" in t.flag[-1]) == (way is leaving)
    assert np.hypot(*(np.stack([t.x, t.y], axis=1) - way)[:4].T).max() < 0.1


def test_init_takes_no_ball_film_for_grains():
    """The first frame has a ruler, two stickers and a ball: no single one. What moves through the film is a ball."""
    behind = scene() + 150.0 * (cover(250.0, 50.0, D) + cover(200.0, 170.0, 12.0))
    assert by_picture(list(film(toss(12, 18.0, x0=60.0), np.random.default_rng(7), behind=behind))) == "rod_video"
    grains = np.random.default_rng(8).normal(100, 30, (80, 90))
    moving = [np.clip(np.roll(grains, i, axis=0), 0, 255).astype(np.uint8) for i in range(12)]
    assert by_picture(moving) == "grain_video"


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
