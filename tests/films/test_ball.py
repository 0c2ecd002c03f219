"""Ball tracker against films rendered here by area sampling (nothing shared with the disc model). About 20 s."""

import os

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from shared import later

from tests.worlds.ball_pictures import BACK, CONTRAST, ball_image, camera, track

REAL = os.environ.get("JUMPVISION_REAL_DATA", "")


def film(xs, ys, d, shape, *, noise, rng, dark=False, **kw):
    frames = []
    for x, y in zip(xs, ys):
        part, lit = ball_image(shape, x, y, d, **kw)
        grey = BACK + CONTRAST * (part + lit)
        frames.append(camera(210.0 - grey if dark else grey, noise, rng))
    return frames


def jitter(d, n, rng, spread=0.5):
    """A film format that is never square and n sub-pixel positions in it."""
    shape = (int(2 * d + 18), int(2 * d + 25))
    return shape, shape[1] / 2 + rng.uniform(-spread, spread, n), shape[0] / 2 + rng.uniform(-spread, spread, n)


def cramer_rao(d, noise, rng):
    """Least possible standard error of one coordinate, from finite differences of the renderer.

    A symmetric disc's position is uncorrelated with its radius, blur and levels: the bound needs d image/d x only."""
    shape, xs, ys = jitter(d, 4, rng)
    e = 0.02
    slopes = [(ball_image(shape, x + e, y, d)[0] - ball_image(shape, x - e, y, d)[0]) / (2 * e) for x, y in zip(xs, ys)]
    return np.sqrt((noise**2 + 1 / 12) / np.mean([np.sum((CONTRAST * s) ** 2) for s in slopes]))


def test_error_against_the_cramer_rao_bound_and_against_the_stated_sigma():
    rng = np.random.default_rng(11)
    pulls = []
    for d, noise in ((10, 5.0), (20, 2.0), (20, 15.0), (40, 5.0)):
        shape, xs, ys = jitter(d, 120, rng)
        t = track(film(xs, ys, d, shape, noise=noise, rng=rng), d)
        assert not any(t.flag)
        error = np.concatenate([t.x - xs, t.y - ys])
        # 240 errors: their RMS is uncertain by 1/sqrt(480) = 4.6 %; 1.1 aimed at, plus two of those
        assert np.sqrt(np.mean(error**2)) < 1.2 * cramer_rao(d, noise, rng)
        pulls.append(error / np.concatenate([t.sigma, t.sigma]))
        # The stated diameter is unbiased: its error is that of a coordinate times sqrt(2) (whole rim against cos^2)
        assert abs(np.mean(t.diameter) - d) < 0.002 + 4 * np.median(t.sigma) * np.sqrt(2 / 120)
    pulls = np.concatenate(pulls)
    # 960 errors: the coverage of one sigma has a standard error of 1.5 %; 68.3 +- 4.5 %
    assert 0.638 < np.mean(np.abs(pulls) < 1) < 0.728
    assert abs(np.mean(pulls)) < 4 / np.sqrt(len(pulls))


@pytest.mark.parametrize("d", [10, *later(40)])
def test_no_sub_pixel_bias_without_noise(d):
    shape = (2 * d + 20, 2 * d + 31)
    ys, xs = shape[0] / 2 + np.linspace(0, 1, 21), shape[1] / 2 + (0.618 * np.arange(21)) % 1
    images = [BACK + CONTRAST * ball_image(shape, x, y, d, ss=16)[0] for x, y in zip(xs, ys)]
    t = track(images, d)
    assert np.max(np.abs([t.x - xs, t.y - ys])) < 0.002


def test_small_oscillation_is_recovered_and_the_threshold_method_shows_what_it_is_for():
    rng = np.random.default_rng(3)
    d, n = 19, 160
    phase = 2 * np.pi * np.arange(n) / 23.7
    shape = (60, 71)
    ys, xs = 29.8 + 0.06 * np.sin(phase), np.full(n, 35.2)
    images = film(xs, ys, d, shape, noise=1.5, rng=rng)
    basis = np.column_stack([np.sin(phase), np.cos(phase), np.ones(n)])
    tracks = {m: track(images, d, method=m).y for m in ("disc", "threshold")}
    fits = {m: np.linalg.lstsq(basis, y)[0] for m, y in tracks.items()}
    # Noise of the amplitude: 0.0028 px / sqrt(n/2) = 0.0003, half a per cent
    assert np.hypot(*fits["disc"][:2]) == pytest.approx(0.06, rel=0.02)
    scatter = {m: np.std(y - basis @ fits[m]) for m, y in tracks.items()}
    assert scatter["threshold"] > 5 * scatter["disc"]  # pixel locking of a binary centroid


@pytest.mark.parametrize("d", [12, 30])
def test_shading_does_not_shift_the_centre(d):
    rng = np.random.default_rng(4)
    shape, xs, ys = jitter(d, 40, rng, spread=3.0)
    t = track(film(xs, ys, d, shape, noise=2.0, rng=rng, shade=(0.2, 0.0)), d)
    assert np.abs(np.mean(t.x - xs)) < 0.03
    assert np.abs(np.mean(t.y - ys)) < 0.01


@pytest.mark.parametrize("length", [0.5, 2.0])
def test_streak_gives_the_mid_exposure_centre(length):
    """Exposure of 80 % of the frame interval, streaks of half and of two ball diameters, slightly oblique."""
    rng = np.random.default_rng(5)
    d, n = 16, 8
    w = np.array([0.2, 1.0]) * length * d / np.hypot(0.2, 1.0)
    shape = (int(5 * d + n * w[1] / 0.8), int(6 * d + n * w[0] / 0.8))
    k = np.arange(n)
    xs, ys = 2.5 * d + k * w[0] / 0.8, 2.5 * d + k * w[1] / 0.8
    images = film(xs, ys, d, shape, noise=0.3, rng=rng, streak=tuple(w), ss=6)
    t = track(images, d, streak=True, exposure_fraction=0.8, search=4.0)
    assert not any(t.flag)
    assert np.abs(np.mean(t.x - xs)) < 0.01
    assert np.abs(np.mean(t.y - ys)) < 0.01
    assert np.mean(t.diameter) == pytest.approx(d, abs=0.05)


def test_fast_ball_dark_ball_and_highlight():
    """Two diameters a frame; a dark ball with a saturated highlight off its middle; no diameter given."""
    rng = np.random.default_rng(6)
    d, n = 24, 10
    xs, ys = 40 + 3.3 * np.arange(n), 40 + 48.3 * np.arange(n)
    images = film(xs, ys, d, (520, 140), noise=3.0, rng=rng, dark=True)
    yy, xx = np.indices(images[0].shape)
    for x, y, image in zip(xs, ys, images):
        image[np.hypot(xx - x - 1.5, yy - y + 2) < 3.5] = 255
    for size in (d, None):
        t = track(images, size, polarity="dark", search=3.0)
        assert not any(t.flag)
        # 4.5 sigma for the largest of 20 errors, and the highlight's pixelated rim must not pull
        assert np.max(np.abs([t.x - xs, t.y - ys]) / t.sigma) < 4.5


def scene(kind, rng):
    """Images, true centres and which frames show the whole ball undisturbed; the ball's diameter."""
    d, n = float(rng.uniform(11, 26)), 24
    shape = (190, 161)
    k = np.arange(n)
    xs = 60 + rng.uniform(-1.0, 1.5) * k
    ys = 40 + 4.0 * k - 0.02 * k**2 if kind != "leaves" else 40 + rng.uniform(7, 9) * k
    rows = np.indices(shape)[0]
    clutter = gaussian_filter(rng.normal(size=shape), 4.0)
    back = BACK + 5.0 * clutter / clutter.std()
    images = []
    for i in range(n):
        part = ball_image(shape, xs[i], ys[i], d, ss=6)[0]
        image = back * (1 - part) + (BACK + CONTRAST) * part
        if kind == "bar":  # something dark before the ball, larger than it
            image = np.where(np.abs(rows - 85) < rng.uniform(0.6, 0.7) * d, 35.0, image)
        elif kind == "bright bar":
            image = np.where(np.abs(rows - 85) < 0.3 * d, 190.0, image)
        elif kind == "second ball":  # crosses the path before the ball
            other = ball_image(shape, 60 + 9.0 * (i - 11), ys[11] + 0.3 * d, d, ss=6)[0]
            image = image * (1 - other) + (BACK + CONTRAST) * other
        elif kind == "blank" and 8 <= i < 12:
            image = np.full(shape, (0.0, 255.0, np.nan, 40.0)[i - 8])
        images.append(np.where(np.isnan(image), np.nan, np.clip(np.rint(image + rng.normal(0, 3, shape)), 0, 255)))
    return images, xs, ys, d


@pytest.mark.parametrize("kind", ["bar", "bright bar", "second ball", "leaves", "blank"])
def test_losses_are_flagged_never_silent(kind):
    """12 random scenes of each kind: no good frame is off, and the ball is found again when it reappears."""
    rng = np.random.default_rng(["bar", "bright bar", "second ball", "leaves", "blank"].index(kind))
    again = 0
    for _ in range(12):
        images, xs, ys, d = scene(kind, rng)
        t = track(images, d, seed=(xs[0], ys[0]))
        good = t.flag == ""
        assert good[0] and np.all(np.isnan(t.x[~good])) and np.all(np.isfinite(t.sigma[good]))
        assert not good.all()
        error = np.hypot(t.x - xs, t.y - ys)[good]
        # A loss is a ball's width away; an overlap that is not seen as one may pull by less than a tenth of it
        assert np.max(error) < 0.1 * d, (kind, d, error.max(), t.flag.tolist())
        again += bool(good[-1]) if kind != "leaves" else not good[-1]
        if kind == "leaves":
            out = (ys > images[0].shape[0] - d / 2) | (xs < d / 2) | (xs > images[0].shape[1] - d / 2)
            assert not np.any(good & out)
    assert again >= 11


def test_two_balls_without_a_seed_are_not_guessed():
    rng = np.random.default_rng(8)
    a, b = ball_image((90, 140), 40.3, 45.1, 20.0)[0], ball_image((90, 140), 100.3, 45.1, 20.0)[0]
    image = camera(BACK + CONTRAST * (a + b), 3.0, rng)
    t = track([image], 20.0)
    assert "against a path with at" in t.flag[0] and np.isnan(t.x[0])
    assert abs(track([image], 20.0, seed=(97.0, 47.0)).x[0] - 100.3) < 0.05


def test_frame_types_and_bad_frames():
    rng = np.random.default_rng(9)
    good = BACK + CONTRAST * ball_image((60, 71), 35.2, 30.4, 19.0)[0]
    noisy = np.clip(np.rint(good + rng.normal(0, 2, good.shape)), 0, 255)
    dead = noisy.copy()
    dead[20, 30:33] = np.nan
    bad = [np.full((60, 71), v) for v in (0.0, 255.0, np.nan, np.inf)]
    t = track([noisy, *bad, dead, noisy.astype(np.uint8), noisy.astype(np.uint16)], 19.0)
    assert [f == "" for f in t.flag] == [True] + [False] * 4 + [True] * 3
    assert np.max(np.abs(t.x[[0, 5, 6, 7]] - 35.2)) < 0.03  # 4 sigma at noise 2
    assert not len(track([], 19.0).x)
    t = track(bad, None, method="threshold")
    assert all(t.flag)


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"polarity": "red"}, "polarity"),
        ({"method": "best"}, "method"),
        ({"search": 0.0}, "search"),
        ({"exposure_fraction": 1.5}, "exposure_fraction"),
        ({"seed": (np.nan, 3.0)}, "seed"),
        ({"diameter": 2.0}, "diameter"),
    ],
)
def test_a_bad_call_is_refused_by_name(change, name):
    with pytest.raises(ValueError, match=name):
        track([np.zeros((20, 30))], 19.0, **change)
    with pytest.raises(ValueError, match="images\\[0\\]"):
        track([np.zeros((20, 30, 3))], 19.0)


def test_threshold_method_states_its_error():
    rng = np.random.default_rng(10)
    pulls = []
    for d, noise in ((12, 5.0), (19, 2.0), (40, 10.0)):
        shape, xs, ys = jitter(d, 80, rng)
        t = track(film(xs, ys, d, shape, noise=noise, rng=rng), d, method="threshold")
        assert not any(t.flag)
        pulls.append(np.concatenate([t.x - xs, t.y - ys]) / np.concatenate([t.sigma, t.sigma]))
    # An estimate over sub-pixel positions, see half_height_centroid: 480 errors, RMS within 20 % of the stated
    assert 0.8 < np.sqrt(np.mean(np.concatenate(pulls) ** 2)) < 1.2


@pytest.mark.skipif(not REAL, reason="JUMPVISION_REAL_DATA is not set: no real recording here")
def test_real_falling_ball():
    """Back-lit steel ball, 126 px, highlight inside, saturated background: scatter about its parabola."""
    b = np.fromfile(os.path.join(REAL, "photron_ball_12bit", "ball_12bit.mraw"), np.uint8).astype(np.uint16)
    b = b.reshape(-1, 3)
    frames = np.stack([b[:, 0] << 4 | b[:, 1] >> 4, (b[:, 1] & 15) << 8 | b[:, 2]], 1).reshape(15, 384, 384)
    t = track(frames, 126.3, polarity="dark", search=1.0)
    assert not any(t.flag)
    k = np.arange(15)
    scatter = [np.std(v - np.polyval(np.polyfit(k, v, 2), k)) for v in (t.x, t.y)]
    assert scatter[0] < 0.0025 and scatter[1] < 0.0035
    assert np.mean(t.diameter) == pytest.approx(126.3, abs=0.3)
    assert np.polyfit(k, t.y, 1)[0] == pytest.approx(2.65, abs=0.01)
    # The stated uncertainty starts with all that the edge model leaves and learns that it is the same in every frame
    assert max(scatter) / 3 < t.sigma[-1] < 3 * max(scatter)
