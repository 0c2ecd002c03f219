"""The foot's face against drawn films.

The foot is drawn over discs that are new in part in every frame, by supersampling: no row is known to the tracker but
the first, to a pixel.
"""

import functools

import numpy as np
import pytest
from scipy import ndimage
from scipy.special import ndtr

from jumpvision.films.calibration import FACE_OF_FOOT, GRAINS_AT_FACE
from jumpvision.films.vision.foot_face import Stack, place, track_foot

SHAPE = (130, 200)  # rows, columns
CENTRE, HALF = 100.0, 60.0
FRAMES = 16
SETTINGS = {"column": CENTRE, "half_width": HALF, "depth": 24, "search": 10.0}
TRUTH = 48 + 13 * np.sin(np.arange(FRAMES) * 0.55) + 0.37 * np.arange(FRAMES)  # up to 7 px a frame, both ways


def draw(face, bed, carry, texture, sub=3):
    """One frame [grey]: discs whose part near the face follows it by `carry`, and a foot with a pattern of its own."""
    h, w = SHAPE
    q = (np.arange(sub) + 0.5) / sub - 0.5
    y, x = np.meshgrid(*(np.add.outer(np.arange(n), q).ravel() for n in SHAPE), indexing="ij")
    image = np.full(x.shape, 25.0)
    for gx, gy, r, grey in bed:
        gy = gy + carry * (face - TRUTH[0]) * np.exp(-max(gy - TRUTH[0], 0) / 30)
        cx, cy, reach = (gx + 0.5) * sub, (gy + 0.5) * sub, (r + 3) * sub
        rows = slice(max(0, int(cy - reach)), max(0, int(cy + reach)))
        box = rows, slice(max(0, int(cx - reach)), max(0, int(cx + reach)))
        rho = np.hypot(x[box] - gx, y[box] - gy)
        image[box] += (grey * (1 - 0.35 * (rho / r) ** 2) - image[box]) / (1 + np.exp((rho - r) / 0.3))
    body = 45 + texture * np.sin(0.5 * x + 1) * np.sin(0.6 * (y - face) + 0.3 * x)
    image += (body - image) / (1 + np.exp((y - face) / 0.3)) * (np.abs(x - CENTRE) < HALF)
    return image.reshape(h, sub, w, sub).mean((1, 3))


@functools.cache
def film(texture, carry):
    rng = np.random.default_rng(int(10 * carry) + texture)
    n = 1200
    bed = np.stack(
        [rng.uniform(-10, 210, n), rng.uniform(-20, 150, n), rng.uniform(2.5, 6.5, n), rng.uniform(60, 200, n)], 1
    )
    return [draw(f, bed, carry, texture) for f in TRUTH]


def camera(image, noise, rng):
    return np.clip(np.rint(image + rng.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)


def errors(texture, carry, noise, seed=1):
    rng = np.random.default_rng(seed)
    frames = (camera(i, noise, rng) for i in film(texture, carry))
    track = track_foot(frames, row=float(round(TRUTH[0])) + 1, **SETTINGS)
    assert (track.flag == "").all()
    return track, track.row - TRUTH


# a plain body of 7 blocks of columns: the grey of the grains varies by half their contrast over a rise of 1 px, about
# 0.25 px a block, 0.1 px for all; a texture of 12 grey levels over 2000 px with noise 2: 0.02 px
@pytest.mark.parametrize(("texture", "rms"), [(0, 0.15), (12, 0.04)])
def test_the_face_and_its_claimed_sigma(texture, rms):
    """Against frame 0, whose noise its film shares, for a textured body: of 12 films with each its own share inside (sd
    0.2) 0.683 +- 0.06, of 180 frames +- 0.035; three of both. A plain body's errors about the median of a film: 60
    values in four, 0.683 - 3 x 0.06; grains carried along err alike in all frames, which the scatter over the columns
    counts and the median takes off."""
    inside = []
    for carry in (1, 0.5):
        for noise in (2, 6):
            for seed in range(3 if texture else 1):
                track, e = errors(texture, carry, noise, seed)
                if noise == 2:
                    assert np.std(e) < rms
                    assert abs(np.median(e)) < track.offset_sigma  # 0.3 px: half the smallest grain's rise to the face
                inside.append(np.abs(((e - (e[0] if texture else np.median(e))) / track.sigma)[1:]) < 1)
    assert np.mean(inside) > 0.683 - (0.2 if texture else 0.18)
    assert not texture or np.mean(inside) < 0.683 + 0.2


def laid_up(rng, uneven):
    """Place of a face at row 20 and its sigma: 24 frames laid over each other on the body, grains that end `uneven` px
    rms higher or lower in each of 12 blocks of columns and do so in all frames."""
    stack, ends, y = Stack(), 20.0 + rng.normal(0.0, uneven, 12), np.arange(44.0)
    for _ in range(24):
        grains = 1.0 / (1.0 + np.exp((ends - y[:, None]) / 0.25))  # (row, block)
        strip = 45.0 + grains * rng.uniform(15.0, 155.0, 12)
        stack.add(np.repeat(strip, 16, axis=1) + rng.normal(0.0, 1.0, (44, 192)), 20.0)
    return stack.face()


def test_the_sigma_of_a_laid_up_face_is_that_of_its_few_blocks():
    """Blocks that end unevenly: over 50 films the face scatters by what sigma holds beyond that of even blocks, to
    four times 1/sqrt(100). (Growth and blur, which it does not know, are the same in all.)"""
    rng = np.random.default_rng(9)
    face, sigma = np.transpose([laid_up(rng, 0.3) for _ in range(50)])
    model = laid_up(rng, 0.0)[1]
    assert np.std(face) / np.sqrt(np.mean(sigma**2) - model**2) == pytest.approx(1.0, abs=0.4)
    assert abs(np.mean(face)) < model


def test_place_of_profiles_of_unknown_blur_and_growth():
    """Profiles drawn from the model, blur and growth as they are known beforehand: the mean square of error over sigma
    is 1, of 200 to three times sqrt(2/200). Half of the grains' scatter deep below would lie 0.2 px too deep."""
    (blur, by), (growth, grows), rough = GRAINS_AT_FACE.value
    rng, u, pulls = np.random.default_rng(3), np.arange(-12, 9.0), []
    for _ in range(200):
        f, b, s = rng.uniform(-2, 2), blur * np.exp(rng.normal(0, by)), rng.normal(growth, grows)
        profile = 30 * ndtr((u - f) / b) * (1 + s * np.clip(u - f, 0, 2.5)) + rng.normal(0, 30 * rough, u.size)
        centre, sigma = place(u, np.where(u < f - 2.5, 0, profile))
        pulls.append((centre - f) / sigma)
    assert np.mean(np.square(pulls)) == pytest.approx(1.0, abs=0.3)
    assert abs(np.mean(pulls)) < 3 / np.sqrt(200)


def foot_on_grains(face, lens, grey, touching, pattern, rng, sub=4):
    """One frame [grey]: grains, all new, that touch the face or are cut by it, and the foot, then the lens [px]."""
    shape = (90, 200)
    y, x = (np.add.outer(np.arange(n), (np.arange(sub) + 0.5) / sub - 0.5).ravel() for n in shape)
    image = np.full((y.size, x.size), 25.0)
    n, row = int(1.1 * shape[1] * (shape[0] - face)), np.arange(2.0, shape[1], 4.4)
    r = rng.uniform(1.7, 2.3, n)
    cx, cy = rng.uniform(0, shape[1], n), rng.uniform(face + (1.0 if touching else 0.3) * r, shape[0] + 5)
    if touching:
        cx[-row.size :], cy[-row.size :] = row + rng.uniform(-0.5, 0.5, row.size), face + r[-row.size :]
    for px, py, q, tone in zip(cx, cy, r, rng.uniform(60, 190, n)):
        box = tuple(slice(max(0, int((c - q - 1) * sub)), max(0, int((c + q + 2) * sub))) for c in (py, px))
        rho2 = ((y[box[0], None] - py) ** 2 + (x[box[1]] - px) ** 2) / q**2
        image[box] = np.where(rho2 < 1, tone * (1 - 0.4 * rho2), image[box])
    body = grey + 12 * pattern[np.clip(((y - face + 70) * sub).astype(int), 0, len(pattern) - 1)]
    image = np.where((y[:, None] < face) & (np.abs(x - CENTRE) < HALF), body, image)
    return ndimage.gaussian_filter(image, lens * sub).reshape(shape[0], sub, shape[1], sub).mean((1, 3))


def test_feet_on_round_grains(lens=0.55):
    """A dark foot on grains that touch it, and the negative of a bright one on grains cut by it, at 8 parts of
    a pixel: the face lies within two of the stated sigmas, which are those of the laid-up frames, not of an edge."""
    for k, (grey, touching) in enumerate([(45, True), (120, False)]):
        rng = np.random.default_rng([k, int(100 * lens)])
        pattern = ndimage.gaussian_filter(rng.normal(size=(480, 800)), 4.8)
        truth = 40 + 9 * np.sin(np.arange(8) * 1.1 + k) + 0.74 * np.arange(8)
        frames = [camera(foot_on_grains(f, lens, grey, touching, pattern / pattern.std(), rng), 2, rng) for f in truth]
        shown = [255 - f for f in frames] if k % 2 else frames
        track = track_foot(shown, row=float(round(truth[0])), **SETTINGS | {"depth": 16})
        assert (track.flag == "").all()
        assert abs(np.median(track.row - truth)) < 2 * track.offset_sigma < 0.8 * 2 * FACE_OF_FOOT.value


def rows_of(pattern, at):
    """The pattern on fractional rows, between two of them linearly."""
    i = np.clip(at.astype(int), 0, len(pattern) - 2)
    part = np.clip(at - i, 0, 1)[:, None]
    return pattern[i] * (1 - part) + pattern[i + 1] * part


def impact(seed, path=(40.0, 50.0, 60.0, 64.0, 64.5, 65.5, 67.0, 69.5, 73.0, 77.0, 81.0, 84.0, 86.0, 86.5)):
    """Film [grey] of a dark body that comes down on the dark floor of its hole at row 62 and pushes on, and its true
    rows: exposure a quarter of the frame's time, still glare on the glass, uneven light, photon noise.

    The body is a random pattern on a grid five times as fine, sampled linearly; grains are carried rigidly.
    """
    rng, sub, floor = np.random.default_rng(seed), 5, 62.0
    h, w = SHAPE

    def pattern(mean, spread, width):
        f = ndimage.gaussian_filter(rng.normal(size=(h * sub, w * sub)), width * sub)
        return mean + spread * f / f.std()

    body, bed = pattern(54.0, 12.0, 1.2), pattern(90.0, 35.0, 1.5)
    y, x = (np.arange(h * sub) + 0.5) / sub - 0.5, np.arange(w)
    rate = np.gradient(path)
    glare = 25 * np.exp(-(((x - 120) / 40) ** 2) - ((y[::sub, None] - 70) / 25) ** 2)
    light = 1 - 0.06 * x / w - 0.05 * (np.arange(h)[:, None] / h) ** 2
    frames, truth = [], []
    for face, v in zip(path, rate):
        total, rows = 0.0, face + v * np.array([-3, -1, 1, 3]) / 32
        for f in rows:
            deepest = max(f, floor)
            at = (y - f + 60) * sub  # the pattern's row 60 at the face
            moved = [rows_of(p, r) for p, r in ((body, at), (bed, (y - deepest + floor) * sub))]
            on, under = (np.clip((e - y) * sub + 0.5, 0, 1)[:, None] for e in (f, deepest))
            total = total + moved[0] * on + (1 - on) * (46.0 * under + moved[1] * (1 - under))
        image = ndimage.gaussian_filter(total.reshape(h, sub, w, sub).mean((1, 3)) / 4, 0.55) * light + glare
        frames.append(camera(image, 1.5, rng))
        truth.append(rows.mean())
    return frames, np.array(truth)


def test_an_impact_from_the_air_under_a_glare():
    """10 px a frame that stop within two, dark on dark in the first frames: no slip, and the motion to 0.03 px.

    12 grey levels over 100 columns and 9 rows at noise 1.5 fix a shift to 0.01 px (information sum); the glare moves
    a smooth body's edge by its slope over the contrast, 0.3 px, if nothing takes it off.
    """
    frames, truth = impact(0)
    track = track_foot(frames, row=truth[0], **SETTINGS)
    assert (track.flag == "").all()
    e = track.row - truth
    assert np.abs(e - e[0]).max() < 0.1 and np.std(e) < 0.03
    assert abs(e[0]) < 2 * track.offset_sigma


def test_lost_and_found_again():
    """A hand before the camera for two frames, NaN pixels in one, flicker of the lamp in one."""
    rng = np.random.default_rng(2)
    frames = [camera(i, 2, rng).astype(float) for i in film(12, 0.5)]
    frames[5] = rng.uniform(0, 255, SHAPE)
    frames[6] = np.full(SHAPE, 200.0)
    frames[9][20:30] = np.nan
    frames[12] += 15
    track = track_foot(frames, row=TRUTH[0], **SETTINGS)
    lost = np.isnan(track.row)
    assert np.flatnonzero(lost).tolist() == [5, 6, 9]
    assert (track.flag[lost] != "").all() and np.isnan(track.sigma[lost]).all()
    e = track.row - TRUTH
    assert np.nanstd(e) < 0.06


def test_bad_calls_and_frames_with_nothing_to_hold_on_to():
    a, b = film(0, 1)[:2]
    for frames, change, said in (
        ([a], {"half_width": 10}, "half_width = 10"),
        ([a], {"row": 3.0}, "row = 3.0"),
        ([a], {"depth": 60}, "depth = 60"),
        ([a, b[1:]], {}, "frame 1 is"),
    ):
        with pytest.raises(ValueError, match=said):
            track_foot(frames, **({"row": TRUTH[0]} | SETTINGS | change))
    found = track_foot([np.full(SHAPE, 90, np.uint8)], row=48.0, **SETTINGS)
    assert np.isnan(found.row[0]) and found.flag[0] != ""
    assert track_foot([], row=40.0, **SETTINGS).row.shape == (0,)


def test_a_foot_without_an_edge_is_followed_by_its_texture():
    """A textured body above ground of its own mean grey: its place is the one given, its motion is the true one.

    Texture of 25 grey levels in 16 x 60 px at noise 2 fixes a shift to well below 0.05 px (1/sqrt(information)).
    """
    rng = np.random.default_rng(5)
    texture = ndimage.gaussian_filter(rng.normal(0, 90, (60, SHAPE[1])), 1.5) + 70.0
    moves, frames = (0.0, 3.0, 7.0, 4.0), []
    for move in moves:  # whole pixels, so that the truth needs no interpolation
        image = np.full(SHAPE, 70.0)
        image[: 48 + int(move)] = texture[60 - 48 - int(move) :] if move else texture[60 - 48 :]
        frames.append(np.clip(image + rng.normal(0, 2, SHAPE), 0, 255).astype(np.uint8))
    found = track_foot(frames, row=47.5, **SETTINGS)
    assert found.row - found.row[0] == pytest.approx(moves, abs=0.15)
