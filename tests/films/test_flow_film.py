"""Films of any flow: double exposures, masks, background and light, what a steady flow gives. Textures drawn here."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

import jumpvision as jv
from jumpvision.base.schema import InputError
from jumpvision.experiment.results.fields import Piv
from jumpvision.films.frames import FrameError
from jumpvision.films.vision.piv.pair import MASKED
from jumpvision.report.figures.flows import validation_picture, worst_of_parts

SIZE = 128
RATE, APART = 10.0, 2e-3  # pairs a second; s from A to B
SET = "window = 24\nstep = 12\n"


def texture(rng: np.random.Generator) -> np.ndarray:
    """Blobs of about 4 px, periodic, so that a shift is exact: (SIZE, SIZE), 0 to 1."""
    k = np.hypot(*np.meshgrid(np.fft.fftfreq(SIZE), np.fft.fftfreq(SIZE)))
    a = np.fft.ifft2(np.fft.fft2(rng.standard_normal((SIZE, SIZE))) * np.exp(-((k * 8.0) ** 2))).real
    return (a - a.min()) / np.ptp(a)


def moved(image: np.ndarray, right: float, down: float) -> np.ndarray:
    ky, kx = np.meshgrid(np.fft.fftfreq(SIZE), np.fft.fftfreq(SIZE), indexing="ij")
    return np.fft.ifft2(np.fft.fft2(image) * np.exp(-2j * np.pi * (kx * right + ky * down))).real


def save(file, image) -> None:
    cv2.imwrite(str(file), np.clip(np.rint(200.0 * image + 20.0), 0, 255).astype(np.uint8))


def folder(path, names, images, more="", params="", others=""):
    path.mkdir(exist_ok=True)
    for name, image in zip(names, images, strict=True):
        save(path / name, image)
    text = f'[grain_video]\nfile = "*[0-9ab].png"\nframe_rate = {RATE}\n{more}{others}\n[params.piv]\n{SET}{params}'
    (path / "experiment.toml").write_text(text)
    return jv.open(path)


@pytest.fixture(scope="module")
def doubled():
    """Three pairs whose textures have nothing in common, B moved by 1.5 px to the right and k - 1 px up."""
    rng = np.random.default_rng(5)
    pairs = [(a := texture(rng), moved(a, 1.5, -(k - 1.0))) for k in range(3)]
    return [image for pair in pairs for image in pair]


PAIRS = f'pairs = "{{}}"\npair_time = {APART}\n'
IN_ORDER = [f"f{k}.png" for k in range(6)]


@pytest.mark.parametrize(
    ("how", "names"),
    [
        ("order", [f"f{k}.png" for k in range(6)]),
        ("names", [f"f{k}{c}.png" for k in range(3) for c in "ab"]),
        ("names", [f"pair{k}_{c}.png" for k in (3, 4, 5) for c in (1, 2)]),
    ],
)
def test_double_exposures_are_matched_with_their_own_partner(tmp_path, doubled, how, names):
    found = jv.piv(folder(tmp_path / "f", names, doubled, PAIRS.format(how))).field
    assert found.sizes["t"] == 3
    np.testing.assert_allclose(found.t, np.arange(3) / RATE + 0.5 * APART)
    for k in range(3):  # 0.02 px: what one window of 24 px of such blobs is uncertain by is 0.005
        assert np.abs(found.u.isel(t=k) * APART - 1.5).max() < 0.02
        assert np.abs(found.v.isel(t=k) * APART - (k - 1.0)).max() < 0.02
    assert found.attrs["stride_frames"] == 2 and found.attrs["delta_t"] == pytest.approx(APART)


def test_names_with_all_a_first_and_a_picture_without_partner(tmp_path, doubled):
    names, images = [f"a_{k}.png" for k in range(3)] + ["b_0.png", "b_2.png"], [doubled[i] for i in (0, 2, 4, 1, 5)]
    with pytest.warns(UserWarning, match=r"1 picture.*without a partner left out, the first a_1.png"):
        found = jv.piv(folder(tmp_path / "f", names, images, PAIRS.format("names"))).field
    np.testing.assert_allclose(found.v.mean(("y", "x")) * APART, [-1.0, 1.0], atol=0.01)


def test_an_ensemble_of_double_exposures_is_their_mean_and_has_no_longer_baseline(tmp_path, doubled):
    same = [image for a in doubled[::2] for image in (a, moved(a, 1.5, 0.0))]
    found = jv.piv(folder(tmp_path / "f", IN_ORDER, same, PAIRS.format("order"), "ensemble = 2\n"))
    assert found.field.sizes["t"] == 2
    assert np.abs(found.field.u * APART - 1.5).max() < 0.02
    with pytest.raises(ValueError, match="double exposures: A is matched with its B alone"):
        jv.piv(folder(tmp_path / "f", IN_ORDER, doubled, PAIRS.format("order"), "baseline = 3\n"))


@pytest.mark.parametrize(
    ("names", "more", "said"),
    [
        ([f"f{k}.png" for k in (0, 1, 3, 4, 5, 6)], PAIRS.format("order"), "a frame is missing after frame 1"),
        (IN_ORDER, 'pairs = "order"\n', r"\[grain_video\] pair_time"),
        (IN_ORDER, 'pairs = "order"\npair_time = 0.2\n', "longer than from one pair to the next"),
        ([f"{c}0.png" for c in "xyzuvw"], PAIRS.format("names"), "no two names differ in"),
    ],
)
def test_pairs_that_cannot_be_told_are_refused(tmp_path, doubled, names, more, said):
    with pytest.raises((InputError, FrameError), match=said):
        jv.piv(folder(tmp_path / "f", names, doubled, more))


@pytest.fixture(scope="module")
def sliding():
    """Twelve frames of one texture that moves by 1.2 px to the left each."""
    a = texture(np.random.default_rng(6))
    return [moved(a, -1.2 * k, 0.0) for k in range(12)]


NAMES = [f"f{k:02d}.png" for k in range(12)]


def masked(field) -> np.ndarray:
    return (field.reason == MASKED).transpose("t", "y", "x").values


def test_polygons_and_mask_pictures_leave_out_the_same(tmp_path, sliding):
    """The left half but 4 px: windows with more than half of their pixels in it, whatever the axes begin with."""
    edge, roi = SIZE // 2, f"roi = [20, 0, {SIZE - 1}, {SIZE - 1}]\n"
    polygon = f"leave_out = [[0, 0, {edge - 1}, 0, {edge - 1}, {SIZE - 1}, 0, {SIZE - 1}]]\n"
    a = jv.piv(folder(tmp_path / "a", NAMES, sliding, roi + polygon)).field
    picture = np.full((SIZE, SIZE), 255, np.uint8)
    picture[:, :edge] = 0
    (tmp_path / "b").mkdir()
    cv2.imwrite(str(tmp_path / "b" / "mask.png"), picture)
    b = jv.piv(folder(tmp_path / "b", NAMES, sliding, roi, others='\n[grain_mask]\nfile = "mask.png"\n')).field
    column = a.x.values - a.x.values[0] + 12 + 20
    expected = np.broadcast_to(column < edge - 0.5, masked(a).shape)
    assert (masked(a) == expected).all() and (masked(b) == masked(a)).all()
    kept = ~expected[0]
    assert np.abs(a.u.transpose("t", "y", "x").values[:, kept] / RATE + 1.2).max() < 0.02


def test_a_mask_that_moves_and_one_of_another_film(tmp_path, sliding):
    (tmp_path / "f").mkdir()
    for k in range(12):
        picture = np.full((SIZE, SIZE), 255, np.uint8)
        picture[: 6 * k] = 0
        cv2.imwrite(str(tmp_path / "f" / f"mask{k:02d}.tif"), picture)
    made = folder(tmp_path / "f", NAMES, sliding, others='\n[grain_mask]\nfile = "mask*.tif"\n')
    counts = masked(jv.piv(made).field).sum(axis=(1, 2))
    assert counts[0] == 0 and counts[-1] > 20 and (np.diff(counts) >= 0).all()
    (tmp_path / "f" / "mask11.tif").unlink()
    with pytest.raises(ValueError, match=r"11 picture.* px: must be 1 or 12 of 128 x 128 px, as the film's frames"):
        jv.piv(made)


def test_a_mask_of_each_array(sliding):
    masks = np.ones((3, SIZE, SIZE), bool)
    masks[2, :40] = False
    found = jv.piv(np.array(sliding[:3]) * 200.0, mask=masks, window=24, step=12)
    assert (found.reason.isel(t=1) == MASKED).sum() > (found.reason.isel(t=0) == MASKED).sum() == 0
    with pytest.raises(ValueError, match="one of each of the 3 frames"):
        jv.piv(np.array(sliding[:3]), mask=masks[:2])


def test_a_still_background_is_taken_away_and_uneven_light_evened(sliding):
    """Behind a still texture three times as strong the strongest wins, which stands. The background of twelve frames
    keeps a little of what moves: 0.2 px of 1.2. A lamp beside the picture: contrast falls to a tenth across it."""
    film = np.array([40.0 * image + 120.0 * texture(np.random.default_rng(7)) for image in sliding])
    assert np.median(np.abs(jv.piv(film, window=24, step=12).u)) < 0.3
    for how in ("minimum", "mean"):
        found = jv.piv(film, window=24, step=12, background=how)
        assert np.median(np.abs(found.u + 1.2)) < 0.2, how
    with pytest.raises(ValueError, match="needs 3 frames"):
        jv.piv(film[0], film[1], window=24, step=12, background="mean")
    film = np.array([200.0 * image * np.linspace(1.0, 0.1, SIZE)[None] for image in sliding[:3]])
    assert np.abs(jv.piv(film, window=24, step=12, clahe=32).u + 1.2).median() < 0.05


def test_the_background_of_double_exposures_is_that_of_a_and_of_b(tmp_path):
    """A and B are lit by two lasers, each with its own still pattern."""
    rng = np.random.default_rng(8)
    still = texture(rng), texture(rng)
    images = []
    for _ in range(8):
        a = texture(rng)
        images += [0.25 * a + 0.6 * still[0], 0.25 * moved(a, 2.0, 0.0) + 0.6 * still[1]]
    names = [f"f{k:02d}.png" for k in range(16)]
    made = folder(tmp_path / "f", names, images, PAIRS.format("order"), 'background = "mean"\n')
    assert np.median(np.abs(jv.piv(made).field.u * APART - 2.0)) < 0.1


@pytest.fixture(scope="module")
def steady_run(tmp_path_factory):
    """A sheared stream, u = 0.4 (1 + 0.5 y/H) px a frame, all of it swaying by 0.3 sin; 40 frames, drawn by warping."""
    path = tmp_path_factory.mktemp("flow")
    a = texture(np.random.default_rng(9)).astype(np.float32)
    rows, columns = np.meshgrid(np.arange(SIZE, dtype=np.float32), np.arange(SIZE, dtype=np.float32), indexing="ij")
    speed = 0.4 * (1.0 + 0.5 * (SIZE - rows) / SIZE)
    frames, gone = [], np.zeros_like(rows)
    for k in range(41):
        frames.append(cv2.remap(a, np.mod(columns - gone, SIZE), rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_WRAP))
        gone = gone + speed + np.float32(0.3 * np.sin(2.4 * k))
    lines = "\n[params.profiles]\nlines = [[64, -110, 64, -20]]\n"
    made = folder(path / "f", [f"f{k:02d}.png" for k in range(41)], frames, params=lines)
    return made, speed * RATE


def test_mean_fluctuation_and_profile_of_a_steady_flow(steady_run):
    made, speed = steady_run
    mean = jv.statistics(made).field
    rows = (-mean.y.values).round().astype(int)
    inner = mean.isel(x=slice(1, -1))
    true = np.broadcast_to(speed[rows, 64][:, None], inner.u.shape)
    sway = 0.3 * np.sin(2.4 * np.arange(40)) * RATE
    np.testing.assert_allclose(inner.u.values, true + sway.mean(), atol=0.2)  # 0.02 px a frame
    assert np.median(np.abs(inner.u_rms - sway.std())) < 0.05 * sway.std()
    assert np.median(inner.v_rms) < 0.05 * sway.std()
    slope = -0.4 * 0.5 * RATE / SIZE  # v_x - u_y, y up
    assert np.median(inner.vorticity) == pytest.approx(slope, rel=0.1)
    assert mean.attrs["fields"] == 40


def test_a_profile_reads_the_field_along_its_line(steady_run):
    made, speed = steady_run
    table = jv.profiles(made).table
    assert table.s.iloc[-1] == pytest.approx(90.0) and (table.x == 64.0).all()
    # upwards, the flow to the right is to the right of the line: across, positive to its left, is -u
    np.testing.assert_allclose(table.across, -table.u)
    np.testing.assert_allclose(table.along, table.v)
    middle = table.iloc[2:-2]
    expected = speed[(-middle.y).round().astype(int), 64] + 3.0 * np.sin(2.4 * np.arange(40)).mean()
    np.testing.assert_allclose(middle.u, expected, atol=0.25)
    other = jv.open(made.path, set=["profiles.lines=[[500, -10, 600, -10]]"])
    with pytest.raises(ValueError, match=r"lines\[0\].*nothing was measured on it; the field lies in x"):
        jv.profiles(other)


@pytest.mark.filterwarnings("error")
def test_a_moment_without_one_valid_vector_is_drawn_and_of_a_long_film_the_worst_of_each_part(steady_run):
    """The worst moment, of which the picture is made; nothing was drawn, under a warning of numpy."""
    field = jv.piv(steady_run[0]).field.load().copy(deep=True)
    for name in ("u", "v", "chc"):
        field[name][..., 7] = np.nan
    assert validation_picture(Piv(field)) is not None
    measured = np.ones(100_001)
    measured[[0, 777, 100_000]] = 0.5, 0.0, 0.2
    at = worst_of_parts(measured)
    assert len(at) == 2000 and {0, 777, 100_000} <= set(at.tolist()) and (np.diff(at) > 0).all()
    assert worst_of_parts(measured[:2000]).tolist() == list(range(2000))
