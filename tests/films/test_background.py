"""The still scene behind the ball: learned, removed, and what that does to positions."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from jumpvision.films.vision.ball.background import Background, SceneSum
from jumpvision.films.vision.ball.film import track_film
from jumpvision.films.vision.ball.track import BallSettings
from jumpvision.laboratory.films.rod import balls

SHAPE, RADIUS, COLUMN = (110, 52), 8.0, 24.3
SETTINGS = BallSettings(
    diameter=2 * RADIUS, polarity="bright", method="disc", search=1.5, seed=None, streak=False, exposure_fraction=0.0
)


def film(rng: np.random.Generator, texture: float) -> tuple[np.ndarray, np.ndarray]:
    """(frames, true rows): a ball bouncing in front of a textured scene, noise 2 grey, 8 bits."""
    scene = 30 + texture * gaussian_filter(rng.normal(size=SHAPE), 2.0) * 7.0
    rows = 30 + 50 * np.abs(np.sin(np.arange(120) / 9.0))
    share = balls(rows[:, None], COLUMN, radius=RADIUS, shape=SHAPE, blur_px=0.8, limb=0.0, side_light=0.0)
    frames = scene * (1 - share) + 190 * share + rng.normal(0, 2, share.shape)
    return np.clip(np.round(frames), 0, 255).astype(np.uint8), rows


def test_removing_a_known_scene_is_exact():
    """I = B (1 - s) + A s gives back s, scaled to an even scene."""
    rng = np.random.default_rng(0)
    scene, share = rng.uniform(10, 60, (20, 30)), rng.uniform(0, 1, (20, 30))
    scene[3, 4] = np.nan
    known = Background(scene, 35.0, 200.0)
    image = np.where(np.isfinite(scene), scene * (1 - share) + 200 * share, 77.0)
    clean = known.removed(image)
    assert clean[3, 4] == 77.0
    ok = np.isfinite(scene)
    assert clean[ok] == pytest.approx((35 * (1 - share) + 200 * share)[ok], abs=1e-9)


def test_a_textured_scene_no_longer_pulls_the_ball():
    """The error falls to that of an even scene, and the stated sigma covers it: 120 frames, 0.683 +- 3 * 0.042."""
    rng = np.random.default_rng(4)
    frames, rows = film(rng, texture=6.0)
    (plain,), (clean,) = track_film(frames, SETTINGS, scene=False), track_film(frames, SETTINGS, scene=True)
    error = [np.std(t.y - rows) for t in (plain, clean)]
    assert error[1] < 0.6 * error[0]
    z = (clean.y - rows - np.mean(clean.y - rows)) / clean.sigma
    assert 0.56 < np.mean(np.abs(z) < 1) < 0.81


def test_a_moving_scene_makes_nothing_worse():
    rng = np.random.default_rng(5)
    frames, rows = film(rng, texture=0.0)
    moving = frames + np.stack([gaussian_filter(rng.normal(0, 60, SHAPE), 2.0) for _ in frames]).clip(0, 40)
    (first,), (second,) = track_film(moving, SETTINGS, scene=False), track_film(moving, SETTINGS, scene=True)
    error = [np.nanstd(t.y - rows) for t in (first, second)]
    assert error[1] <= 1.05 * error[0]  # a scene that is not there is not subtracted, or does no harm


def test_a_ball_that_hides_the_scene_leaves_it_unknown():
    rng = np.random.default_rng(6)
    image = rng.normal(30, 2, SHAPE)
    views = SceneSum()
    for k in range(30):
        assert k >= 20 or views.background() is None
        views.add(image, [(COLUMN, 40.0, 2 * RADIUS)], 190.0)
    known = views.background()
    assert np.isnan(known.scene[40, 24])
    assert known.scene[90, 24] == pytest.approx(image[90, 24])
