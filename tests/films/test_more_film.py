"""More film gives the same rows: films cut at several lengths, to the last digit from 60 frames on. About 10 s."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from jumpvision.films.vision.ball import film
from jumpvision.films.vision.ball.background import SceneSum
from jumpvision.films.vision.ball.film import FilmTracker, track_film
from jumpvision.films.vision.ball.track import BallSettings
from tests.worlds.ball_pictures import BACK, CONTRAST, ball_image, camera

N, SHAPE, D = 200, (110, 130), 14.0
CUTS = (61, 120)


def settings(seed):
    return BallSettings(
        diameter=None, polarity="bright", method="disc", search=1.5, seed=seed, streak=False, exposure_fraction=0.0
    )  # fmt: skip


def ways():
    """(name, (x, y) of every frame [px], sticker): a ball that hops behind a bar, one that rests first and leaves, and
    one that swings beside a sticker that looks like it."""
    k = np.arange(N)
    yield "hops", 65.0 - 45.0 * np.cos(k / 11.0), 90.0 - 70.0 * np.abs(np.sin(k / 9.0)), None
    yield "leaves", 30.0 + np.maximum(0, k - 15) * 2.5, 90.0 - 60.0 * np.sin(np.maximum(0, k - 15) / 30.0), None
    yield "swings", 65.0 + 45.0 * np.sin(k / 4.0), 40.0 + 12.0 * np.cos(k / 4.0), (65.3, 92.6)


def drawn(x, y, sticker):
    """Before a texture, and behind a bar."""
    rng = np.random.default_rng(5)
    behind = BACK + 8.0 * gaussian_filter(rng.normal(size=SHAPE), 2.5) * 8.0
    if sticker:
        behind += ball_image(SHAPE, *sticker, D, ss=4)[0] * (BACK + CONTRAST - behind)
    images = []
    for a, b in zip(x, y, strict=True):
        image = behind.copy()
        if a < SHAPE[1] + D:
            image += ball_image(SHAPE, a, b, D, ss=4)[0] * (BACK + CONTRAST - image)
        image[:, 60:64] = 45.0 if sticker is None else image[:, 60:64]
        images.append(camera(image, 2.0, rng))
    return images


@pytest.mark.parametrize(("x", "y", "sticker"), [w[1:] for w in ways()], ids=[w[0] for w in ways()])
def test_a_cut_film_gives_the_rows_of_the_whole(x, y, sticker):
    images = drawn(x, y, sticker)
    how = settings(None if sticker else (float(x[0]), float(y[0])))
    (whole,) = track_film(images, how, scene=True)
    inside = (x > D) & (x < SHAPE[1] - D) & (np.abs(x - 62.0) > D)
    good = whole.flag == ""
    # one in twenty may be lost as it comes out of the bar; noise 2 at D = 14: sigma 0.005 px, 0.1 px are 20
    assert good[inside].mean() > 0.95 and np.hypot(whole.x - x, whole.y - y)[good].max() < 0.1
    for n in CUTS:
        (cut,) = track_film(images[:n], how, scene=True)
        np.testing.assert_array_equal(cut.flag, whole.flag[:n])
        for one, all_ in ((cut.x, whole.x), (cut.y, whole.y), (cut.sigma, whole.sigma)):
            np.testing.assert_array_equal(one, all_[:n])


def test_a_scene_is_learned_until_it_is_known(monkeypatch):
    """A ball that rests hides what is behind it: the scene is learned until that was seen, and then no more."""
    k = np.arange(N)
    x, y = 30.0 + 0.0 * k, 90.0 - 30.0 * (1.0 - np.cos(np.maximum(0, k - 80) / 8.0))
    images, added = drawn(x, y, None), []
    add = SceneSum.add
    monkeypatch.setattr(SceneSum, "add", lambda self, *a: added.append(add(self, *a)))

    def scene() -> float:
        follower = FilmTracker(settings((30.0, 90.0)), scene=True)
        for image in images:
            follower.see(image)
        assert follower._behind is not None
        return follower._behind.scene[90, 30]

    # of the frames from 100 on every second counts, and 20 must show what was behind
    assert math.isfinite(scene()) and 100 < len(added) < 125
    monkeypatch.setattr(film, "LEARNED", (60, 70))
    added.clear()
    assert math.isnan(scene()) and len(added) == 70
