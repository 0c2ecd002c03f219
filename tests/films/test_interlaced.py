"""Interlaced films: told from others, followed as they stand."""

from __future__ import annotations

import json

import cv2
import numpy as np
import pandas as pd
import pytest

from jumpvision.cli import main
from jumpvision.films.vision.interlaced import is_interlaced

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


def test_interlaced_frames_are_told_and_whole_ones_are_not_called_so():
    rng = np.random.default_rng(3)
    for order in ("top", "bottom", ""):
        for noise, speed in ((0.5, 4.0), (2.0, 6.0), (6.0, 12.0)):  # px a frame; half of it between the fields
            frames, _ = film(rng, order, n=6, noise=noise, speed=speed)
            assert is_interlaced(frames) == bool(order), (order, noise, speed)
        assert not is_interlaced(film(rng, "", n=6, noise=2.0, speed=1.0)[0])
    still, _ = film(rng, "", n=6, speed=0.0)
    assert not is_interlaced(still) and not is_interlaced(still[:1])
    rows = np.tile(np.array([0, 255], np.uint8)[:, None], (48, W))  # a striped wall that stands is no reason
    assert not is_interlaced([np.maximum(rows, f) for f in still])


@pytest.mark.parametrize("order", ["top", "bottom", ""])
def test_a_film_in_which_little_moves_fast_is_told_too(order):
    """A ball crosses in 3 of 14 frames, a hand that goes by 1 px a frame is in all: it outvoted the ball."""
    rng = np.random.default_rng(8)
    frames, _ = film(rng, order, n=14, speed=20.0, noise=0.0)
    frames[3:] = 60
    yy, xx = np.mgrid[:H, :W]
    for i in range(14):
        hand, late = (np.hypot((xx - 90) / 1.5, yy - 60 - i - 0.5 * j) < 16 for j in (0, 1))
        if order:
            hand[(order == "top") :: 2] = late[(order == "top") :: 2]
        frames[i] = np.where(hand, 130, frames[i]) + rng.normal(0, 1.0, (H, W))
    assert is_interlaced(frames) == bool(order)


def test_a_folder_with_an_interlaced_film_says_so(tmp_path):
    """Every third frame shows no ball: with a tenth of the frames lost the film is asked whether it is interlaced."""
    frames, _ = film(np.random.default_rng(9), "bottom", speed=4.0)
    frames[::3] = 60
    (tmp_path / "clip").mkdir()
    for i, f in enumerate(frames):
        cv2.imwrite(str(tmp_path / "clip" / f"{i:03d}.png"), f)
    text = 'ground = "hard"\n[rod_video]\nfile = "clip"\nframe_rate = 25.0\n[params.track]\ndiameter = 15.0\n'
    (tmp_path / "experiment.toml").write_text(text, encoding="utf-8")
    assert main(["track", str(tmp_path), "--results", str(tmp_path / "r"), "--no-pictures"]) == 0
    table = pd.read_csv(tmp_path / "r" / "track.csv")
    assert len(table) == 14  # as it stands
    said = json.loads((tmp_path / "r" / "provenance.json").read_text())["warnings"]
    assert any("interlaced" in w and "bwdif" in w for w in said)
