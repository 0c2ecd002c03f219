"""Interlaced films: told from others, split into their half pictures, and a ball followed in both with a true sigma."""

from __future__ import annotations

import warnings

import cv2
import numpy as np
import pandas as pd
import pytest

import jumpvision as jv
from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.films.frames.base import Clock, Film
from jumpvision.films.vision.fields import Fields, field, order_of

H, W, FINE = 96, 128, 4


def ball(x, y, d):
    """A disc by coverage of sub-pixels, in a slightly soft picture."""
    yy, xx = np.mgrid[: H * FINE, : W * FINE] / FINE + 0.5 / FINE - 0.5
    cover = (np.hypot(xx - x, yy - y) < d / 2).reshape(H, FINE, W, FINE).mean(axis=(1, 3))
    return cv2.GaussianBlur(60.0 + 140.0 * cover, (0, 0), 0.7)


def film(rng, order, n=14, d=15.0, noise=2.0, speed=6.0):
    """frames (n, H, W) and the ball's place in every half frame (2 n, 2); order: "" for a film of whole frames."""
    start, v = np.array([20.0, 70.0]) + rng.uniform(-2, 2, 2), np.array([0.8, -0.9]) * speed * rng.uniform(0.7, 1.0)
    k = np.arange(2 * n)[:, None] / 2.0
    at = start + v * k + np.array([0.0, 0.22]) * k**2
    frames = []
    for i in range(n):
        one, two = (ball(*at[2 * i + j], d) for j in (0, 1))
        if order:
            first = 0 if order == "top" else 1
            one[1 - first :: 2] = two[1 - first :: 2]
        frames.append(np.clip(np.rint(one + rng.normal(0, noise, (H, W))), 0, 255).astype(np.uint8))
    return np.array(frames), at


@pytest.mark.parametrize("lower", [False, True])
@pytest.mark.parametrize("rows", [8, 9])
def test_a_field_of_a_plane_is_the_plane(rows, lower):
    """Between the first and the last of its own rows; beyond them the nearest one."""
    plane = (np.arange(rows)[:, None] + 2.0 * np.arange(5)).astype(np.float32)
    mine = np.arange(rows)[int(lower) :: 2]
    wanted = np.clip(np.arange(rows), mine[0], mine[-1])[:, None] + 2.0 * np.arange(5)
    np.testing.assert_allclose(field(plane, lower), wanted)


def test_the_order_of_the_fields_is_told_and_whole_frames_are_not_called_interlaced():
    rng = np.random.default_rng(3)
    for order in ("top", "bottom", ""):
        for noise in (0.5, 2.0, 6.0):
            for speed in (4.0, 6.0, 12.0):  # px a frame; half of it between the fields
                frames, _ = film(rng, order, n=6, noise=noise, speed=speed)
                assert order_of(frames) == order, (order, noise, speed)
            assert order_of(film(rng, "", n=6, noise=noise, speed=1.0)[0]) == ""
    still, _ = film(rng, "", n=6, speed=0.0)
    assert order_of(still) == "" and order_of(still[:1]) == ""
    rows = np.tile(np.array([0, 255], np.uint8)[:, None], (48, W))  # a striped wall that stands is no reason
    assert order_of([np.maximum(rows, f) for f in still]) == ""


@pytest.mark.parametrize("order", ["top", "bottom", ""])
def test_a_film_in_which_little_moves_fast_is_told_too(order):
    """A ball crosses in 3 of 14 frames, a hand that goes by 1 px a frame is in all: it outvoted the ball."""
    rng = np.random.default_rng(8)
    frames, _ = film(rng, order, n=14, speed=20.0, noise=0.0)
    frames[3:] = 60
    yy, xx = np.mgrid[:H, :W]
    for i in range(14):
        halves = [np.hypot((xx - 90) / 1.5, yy - 60 - i - 0.5 * j) < 16 for j in (0, 1)]
        hand = halves[0].copy()
        if order:
            hand[(order == "top") :: 2] = halves[1][(order == "top") :: 2]
        frames[i] = np.where(hand, 130, frames[i]) + rng.normal(0, 1.0, (H, W))
    assert order_of(frames) == order


class Stack(Film):
    def __init__(self, frames, time):
        super().__init__(
            __file__, shape=frames.shape[1:], dtype=frames.dtype, clock=Clock(time, "file", []), warnings=[], meta={}
        )
        self.frames = frames

    def _read(self, i):
        return self.frames[i].copy()

    def close(self):
        pass


def test_fields_come_at_half_the_interval_and_a_gap_stays_a_gap():
    frames, _ = film(np.random.default_rng(0), "bottom", n=4)
    halves = Fields(Stack(frames, np.array([0.0, 0.04, 0.16, 0.20])), lower=True)
    np.testing.assert_allclose(halves.time, [0.0, 0.02, 0.04, 0.06, 0.16, 0.18, 0.20, 0.22])
    assert len(halves) == 8
    np.testing.assert_array_equal(halves[4], field(frames[2], True))
    np.testing.assert_array_equal(halves[5], field(frames[2], False))


@pytest.mark.parametrize("order", ["top", "bottom"])
def test_a_ball_is_followed_in_both_fields_within_its_sigma(order):
    """12 films of 28 half pictures. sigma_px is of either coordinate: columns are surer than rows, of which half are
    made up; rows (heights) lie within it in 68.3 +- 3 * 2.6 % of 330, and one more tenth may be lost to the rim."""
    rng = np.random.default_rng(5)
    pulls, off = [], []
    for _ in range(12):
        frames, at = film(rng, order)
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            seen = jv.track(frames, diameter=15.0, polarity="bright", fields=order, frame_rate=25.0)
        assert len(seen) == 28 and seen.time_s.to_numpy() == pytest.approx(np.arange(28) / 50.0)
        good = (seen.flag == "").to_numpy()
        assert good.mean() > 0.9
        error = seen[["x_px", "y_px"]].to_numpy()[good] - at[good]
        off.append(error)
        pulls.append(error / seen.sigma_px.to_numpy()[good][:, None])
    error, pull = np.concatenate(off), np.concatenate(pulls)
    assert np.abs(error).max() < 0.5 and np.abs(error.mean(axis=0)).max() < 0.01
    inside = np.mean(np.abs(pull) < 1.0, axis=0)
    assert 0.58 < inside[1] < 0.77 and inside[0] > 0.68


def test_who_follows_whole_frames_of_an_interlaced_film_is_told(tmp_path):
    frames, _ = film(np.random.default_rng(8), "top", speed=12.0, n=8)
    with pytest.warns(UserWarning, match='the film is interlaced.* give fields = "top"'):
        jv.track(frames, diameter=15.0, polarity="bright")
    with pytest.raises(InputError, match="fields = 'up': must be one of together, top, bottom"):
        jv.track(frames, fields="up")


def test_a_folder_with_an_interlaced_film_is_tracked_in_its_fields(tmp_path):
    frames, at = film(np.random.default_rng(9), "bottom")
    (tmp_path / "clip").mkdir()
    for i, f in enumerate(frames):
        cv2.imwrite(str(tmp_path / "clip" / f"{i:03d}.png"), f)
    text = 'ground = "hard"\n[rod_video]\nfile = "clip"\nframe_rate = 25.0\nfields = "{}"\n'
    text += "[params.track]\ndiameter = 15.0\n"
    (tmp_path / "experiment.toml").write_text(text.format("bottom"), encoding="utf-8")
    assert main(["track", str(tmp_path), "--results", str(tmp_path / "r"), "--no-pictures"]) == 0
    table = pd.read_csv(tmp_path / "r" / "track.csv")
    assert len(table) == 28 and np.diff(table.time_s) == pytest.approx(0.02)
    good = table.flag.isna().to_numpy()
    assert good.mean() > 0.9
    assert np.abs(table[["x_px", "y_px"]].to_numpy()[good] - at[good]).max() < 0.5
    (tmp_path / "experiment.toml").write_text(text.format("upper"), encoding="utf-8")
    assert main(["check", str(tmp_path)]) == 2
