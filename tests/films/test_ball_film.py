"""Balls in whole films: several at once, and a film that is tracked while it is decoded. About 8 s."""

from __future__ import annotations

import time
import tracemalloc
from pathlib import Path

import av
import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from jumpvision.cli import main
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.inputs.sections import NotApplicable
from jumpvision.experiment.results.tables import Track
from jumpvision.experiment.workflow.stage import results_stages
from jumpvision.experiment.workflow.workspace import Workspace
from jumpvision.films.frames import open_frames
from jumpvision.films.vision.ball import background, film
from jumpvision.films.vision.ball.background import Kept, Window
from jumpvision.films.vision.ball.film import FilmTracker, track_film
from jumpvision.films.vision.ball.measure import DiscMeasure
from jumpvision.films.vision.ball.track import BallSettings
from jumpvision.report.figures.overlays import TrackFilm
from tests.worlds.ball_pictures import BACK, CONTRAST, ball_image, camera

results_stages()  # this file may run alone

D, N = 14.0, 40


def settings(**change):
    plain = {
        "diameter": D, "polarity": "bright", "method": "disc", "search": 1.5, "seed": None, "streak": False,
        "exposure_fraction": 0.0,
    }  # fmt: skip
    return BallSettings(**(plain | change))


def two_balls(rng, *, crossing):
    """Frames and true (x, y) of a ball on the rod and one on the foot, which nearly touch or pass each other."""
    k = np.arange(N)
    if crossing:  # past each other: for eight frames the two pictures are one
        rod, foot = (38.0 + 0.1 * k, 30.0 + 1.8 * k), (38.7 + 0.1 * k, 100.0 - 1.8 * k)
    else:  # nearly touching at the lowest point
        rod, foot = (38.0 + 0.1 * k, 30.0 + 32.0 * np.sin(np.pi * k / N) ** 2), (41.0 + 0.0 * k, 78.5 + 0.0 * k)
    frames = []
    for i in k:
        a, b = (ball_image((130, 84), x[i], y[i], D, ss=6)[0] for x, y in (rod, foot))
        frames.append(camera(BACK + CONTRAST * (1 - (1 - a) * (1 - b)), 2.0, rng))
    return frames, np.array(rod), np.array(foot)


@pytest.mark.parametrize("crossing", [False, True])
def test_two_balls_keep_their_names(crossing):
    """Near each other and through each other: every position given is that of the right ball."""
    frames, *truth = two_balls(np.random.default_rng(1), crossing=crossing)
    seeds = [tuple(float(v[0]) for v in xy) for xy in truth]
    tracks = track_film(frames, settings(seed=seeds[0]), scene=True, markers=[seeds[1]])
    assert len(tracks) == 2
    for track, (x, y) in zip(tracks, truth, strict=True):
        good = track.flag == ""
        assert good[-5:].all() and good.mean() > (0.6 if crossing else 0.9)
        # noise 2 at D = 14: sigma 0.005 px; balls that nearly touch may pull each other by a few hundredths
        assert np.hypot(track.x - x, track.y - y)[good].max() < 0.1


class Asked(list):
    """Frames that remember which of them were asked for."""

    def __init__(self, frames):
        super().__init__(frames)
        self.numbers = []

    def __getitem__(self, i):
        self.numbers.append(i)
        return super().__getitem__(i)


def test_a_followed_film_is_not_read_again():
    """What the track is asked for at its end was kept: of a film, each frame costs the decoding of all from its last
    key frame on."""
    rng, k = np.random.default_rng(4), np.arange(60)
    rest = np.maximum(0, np.minimum(k - 12, 50 - k))  # rests, moves, rests where it was: places with many frames
    images = [camera(ball_image((130, 84), 40.0, 28.0 + 2.0 * y, D, ss=4)[0] * CONTRAST + BACK, 2.0, rng) for y in rest]
    follower, frames = FilmTracker(settings(), scene=True), Asked(images)
    for image in images:
        follower.see(image)
    track = follower.finish(frames)[0]
    assert frames.numbers == [] and (track.flag == "").all()


def test_a_ball_that_bounces_is_not_decoded_again_at_every_bounce():
    """Whether two balls met there is asked of what was kept of the frames, though it lies outside the ball's window."""
    rng, k = np.random.default_rng(2), np.arange(160)
    y = 34.0 + 120.0 * np.abs(np.sin(np.pi * (k - 7) / 40.0))  # up to 9 px a frame, four bounces
    images = [camera(BACK + CONTRAST * ball_image((190, 84), 40.0, v, D, ss=6)[0], 2.0, rng) for v in y]
    follower, frames = FilmTracker(settings(), scene=True), Asked(images)
    for image in images:
        follower.see(image)
    (track,) = follower.finish(frames)
    assert (track.flag == "").all() and np.max(np.hypot(track.x - 40.0, track.y - y)) < 0.1
    assert len(frames.numbers) < 4, frames.numbers


@pytest.mark.parametrize("streak", [False, True])
def test_frames_followed_in_a_row_are_those_measured_one_by_one(monkeypatch, streak):
    """In front of a texture, behind a bar for some frames, at the picture's edge, through a sudden turn: the compiled
    way through what is a matter of course gives what the other gives, to a hundredth of sigma since a fit that is begun
    elsewhere ends as near, and is taken."""
    rng, n = np.random.default_rng(8), 150
    texture = gaussian_filter(rng.normal(size=(150, 70)), 2.5)
    xs, ys = np.linspace(14.0, 50.0, n), 14.0 + np.abs(110.0 * np.sin(np.arange(n) / 9.0))
    images = []
    for x, y in zip(xs, ys, strict=True):
        image = BACK + 15.0 * texture / texture.std()
        image += ball_image(image.shape, x, y, D, ss=4)[0] * (BACK + CONTRAST - image)
        image[60:66] = 45.0
        images.append(camera(image, 3.0, rng))
    how = settings(seed=(xs[0], ys[0]), streak=streak, exposure_fraction=0.2 if streak else 0.0)
    counted = []
    monkeypatch.setattr("jumpvision.films.vision.ball.film.WORTHWHILE", 10)
    follow = DiscMeasure.follow
    monkeypatch.setattr(DiscMeasure, "follow", lambda *a: counted.append(follow(*a)) or counted[-1])
    quick = track_film(images, how, scene=True)[0]
    assert sum(map(len, counted)) > n // 3
    monkeypatch.setattr("jumpvision.films.vision.ball.film.WORTHWHILE", 10**9)
    slow = track_film(images, how, scene=True)[0]
    lost = quick.flag != ""
    assert np.array_equal(lost, slow.flag != "") and 5 < np.count_nonzero(lost) < n // 2
    for a, b in ((quick.x, slow.x), (quick.y, slow.y), (quick.sigma, slow.sigma)):
        assert np.nanmax(np.abs(a - b) / slow.sigma) < 0.01


class Alone(list):
    """Frames of a reader that serves one thread at a time."""

    busy = False

    def __getitem__(self, i):
        assert not self.busy
        self.busy = True
        time.sleep(1e-4)
        self.busy = False
        return super().__getitem__(i)


def test_a_film_is_read_by_one_thread_at_a_time(monkeypatch):
    """While the track is proved the balls are measured again; with nothing kept both read the film."""
    frames, *_ = two_balls(np.random.default_rng(9), crossing=False)
    monkeypatch.setattr(film, "MEMORY", 0)
    track = track_film(Alone(frames), settings(seed=(38.0, 30.0)), scene=True)[0]
    assert np.array_equal(track.y, track_film(frames, settings(seed=(38.0, 30.0)), scene=True)[0].y, equal_nan=True)


def film_file(path: Path, frames) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream("ffv1", rate=200)
        stream.height, stream.width = frames[0].shape
        stream.pix_fmt = "gray"
        for image in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray")))
        container.mux(stream.encode())
    return path


def test_two_balls_of_an_experiment_give_two_tables(tmp_path):
    frames, *truth = two_balls(np.random.default_rng(2), crossing=False)
    film_file(tmp_path / "rod.avi", frames)
    (tmp_path / "experiment.toml").write_text(
        'schema = 1\n[rod_video]\nfile = "rod.avi"\nscale = 1e-3\nball_diameter = 0.014\n'
        "[params.track]\nseed = [38, 30]\nmarkers = [[41, 78]]\n"
    )
    space = Workspace(open_experiment(tmp_path), tmp_path / "out", tmp_path / "cache")
    made = space.make(Track)
    again = Workspace(open_experiment(tmp_path), tmp_path / "out", tmp_path / "cache").make(Track)
    for table in (made.others[0], again.others[0], Track.load(tmp_path / "out").others[0]):
        assert np.nanmax(np.abs(table.y_px - truth[1][1])) < 0.1
        assert list(table.columns) == list(made.table.columns)
    assert np.ptp(made.others[0].height_m.dropna()) < 1e-4 < np.ptp(made.good.height_m)


def test_a_film_without_a_scale_is_tracked_in_pixels(tmp_path, capsys):
    """The same places as with a scale; no heights, no rod and no shifts of the exposure; a jump still needs one."""
    frames, (_, rod_y), _ = two_balls(np.random.default_rng(7), crossing=False)
    scaled, plain = tmp_path / "scaled", tmp_path / "plain"
    for folder, more in ((scaled, "scale = 1e-3\n"), (plain, "")):
        folder.mkdir()
        film_file(folder / "ball.avi", frames)
        own = f'[rod_video]\nfile = "ball.avi"\nexposure = 1e-4\nframe_rate = 200.0\n{more}'
        (folder / "experiment.toml").write_text(own + "[params.track]\nseed = [38, 30]\ndiameter = 14\n")
    assert main(["check", str(plain)]) == 0
    assert "[rod_video] scale: missing: the track will be in px alone" in capsys.readouterr().err
    for folder in (scaled, plain):
        assert main(["run", str(folder), "--results", str(tmp_path / "r" / folder.name), "--no-report"]) == 0
    assert "rod needs [rod_video] scale: the track is in px alone" in capsys.readouterr().err
    there, here = (Track.load(tmp_path / "r" / n).table for n in ("scaled", "plain"))
    for column in ("x_px", "y_px", "sigma_px"):
        assert np.array_equal(there[column], here[column], equal_nan=True)
    assert here.height_m.isna().all() and here.sigma_m.isna().all() and np.nanmax(np.abs(here.y_px - rod_y)) < 0.1
    assert not (tmp_path / "r" / "plain" / "rod.csv").exists() and (tmp_path / "r" / "plain" / "track.png").exists()
    with (plain / "experiment.toml").open("a") as file:
        file.write('[actuation]\nkind = "single"\nfrequency = 8.0\namplitude = 0.01\n')
    assert main(["check", str(plain)]) == 2
    assert main(["track", str(plain), "--results", str(tmp_path / "jump")]) == 1
    assert "[rod_video] scale: missing; give scale" in capsys.readouterr().err


def test_a_film_tracked_while_it_is_decoded_is_the_film_tracked_afterwards(tmp_path):
    frames, (_, rod_y), _ = two_balls(np.random.default_rng(3), crossing=False)
    frames = [f[:70] for f in frames]
    path = film_file(tmp_path / "rod.avi", frames)
    follower = FilmTracker(settings(seed=(38.0, 30.0)), scene=True)
    with open_frames(path, seen=follower.see) as film:
        assert film.shown
        (track,) = follower.finish(film)
        (after,) = track_film(film, settings(seed=(38.0, 30.0)), scene=True)
    assert np.array_equal(track.y, after.y, equal_nan=True) and np.array_equal(track.flag, after.flag)
    assert np.nanstd(track.y - rod_y) < 0.02


def test_a_film_with_lost_frames_is_not_taken_for_what_was_shown(tmp_path):
    frames = two_balls(np.random.default_rng(4), crossing=False)[0]
    path = film_file(tmp_path / "rod.avi", frames)
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 0xFF  # one packet's checksum no longer holds
    path.write_bytes(data)
    with open_frames(path, seen=lambda image: None) as film:
        assert len(film) < N and not film.shown


def test_windows_that_are_not_kept_are_read_again(monkeypatch):
    frames, *_ = two_balls(np.random.default_rng(5), crossing=False)
    kept = track_film(frames, settings(seed=(38.0, 30.0)), scene=True)[0]
    monkeypatch.setattr("jumpvision.films.vision.ball.film.MEMORY", 0)
    read = track_film(frames, settings(seed=(38.0, 30.0)), scene=True)[0]
    assert np.allclose(read.y, kept.y, atol=1e-9, equal_nan=True)


def test_a_track_does_not_depend_on_where_its_windows_are_kept(monkeypatch):
    frames, *_ = two_balls(np.random.default_rng(3), crossing=False)
    kept = track_film(frames, settings(seed=(38.0, 30.0)), scene=True)[0]
    monkeypatch.setattr(background, "HELD", 1)  # in a file from the first byte on
    filed = track_film(frames, settings(seed=(38.0, 30.0)), scene=True)[0]
    for name in ("x", "y", "sigma", "chi2"):
        assert np.array_equal(getattr(kept, name), getattr(filed, name), equal_nan=True)


def test_windows_come_back_as_they_were_and_take_the_memory_of_a_few(monkeypatch):
    """3,000 windows of 40 x 30 px of 16 bits are 7.2 MB; in a file they take 40 bytes each."""
    monkeypatch.setattr(background, "HELD", 2**16)
    rng = np.random.default_rng(1)
    few = [rng.integers(0, 60000, (40, 30)).astype(np.uint16) for _ in range(7)]
    tracemalloc.start()
    try:
        kept = Kept()
        for k in range(3000):
            kept.append(None if k % 5 == 4 else Window(few[k % 7], k, 2 * k))
        held = tracemalloc.get_traced_memory()[0]
    finally:
        tracemalloc.stop()
    assert held < 400_000 and len(kept) == 3000
    for k in (0, 4, 1001, 2999, -2):
        if k % 5 == 4:
            assert kept[k] is None
        else:
            pixels, x0, y0 = kept[k]
            assert np.array_equal(pixels, few[(k % 3000) % 7]) and (x0, y0) == (k % 3000, 2 * (k % 3000))
            assert pixels.dtype == np.uint16 and pixels.flags.writeable
    with pytest.raises(IndexError):
        kept[3000]


def test_where_the_disk_is_full_no_window_is_kept():
    kept = Kept()
    kept.append(Window(np.ones((2, 3), np.uint8), 0, 0))

    class Full:
        def seek(self, _):
            raise OSError(28, "No space left on device")

    kept._file, file = Full(), kept._file
    kept.append(Window(np.ones((2, 3), np.uint8), 0, 0))
    kept._file = file
    assert kept[0] is not None and kept[1] is None


def test_overlay_film_shows_the_cross_where_the_ball_is(tmp_path):
    """Every second frame; green is drawn nowhere but along the path and at the ball."""
    frames, (rod_x, rod_y), _ = two_balls(np.random.default_rng(6), crossing=False)
    film_file(tmp_path / "rod.avi", frames)
    (tmp_path / "experiment.toml").write_text(
        'schema = 1\n[rod_video]\nfile = "rod.avi"\nscale = 1e-3\nball_diameter = 0.014\n'
        "[params.track]\nseed = [38, 30]\n[params.overlay]\nevery = 2\n"
    )
    space = Workspace(open_experiment(tmp_path), tmp_path / "out", tmp_path / "cache")
    space.make(TrackFilm)
    with av.open(str(tmp_path / "out" / "track.webm")) as container:
        shown = [f.to_ndarray(format="rgb24").astype(int) for f in container.decode(video=0)]
    assert len(shown) == N // 2
    factor = shown[0].shape[1] // 84
    last = shown[-1]
    green = np.argwhere(last[:, :, 1] - last[:, :, [0, 2]].max(axis=2) > 60)
    k = 2 * (len(shown) - 1)
    centre = np.array([(rod_y[k] + 0.5) * factor, (rod_x[k] + 0.5) * factor])
    assert np.hypot(*(green - centre).T).min() < 2
    assert green[:, 0].max() < (rod_y.max() + 0.5) * factor + 9


def test_no_overlay_film_where_none_is_wanted(tmp_path):
    film_file(tmp_path / "rod.avi", two_balls(np.random.default_rng(6), crossing=False)[0][:3])
    (tmp_path / "experiment.toml").write_text(
        'schema = 1\n[rod_video]\nfile = "rod.avi"\nscale = 1e-3\nball_diameter = 0.014\n'
        "[params.track]\nseed = [38, 30]\n[params.overlay]\nevery = 0\n"
    )
    space = Workspace(open_experiment(tmp_path), tmp_path / "out", tmp_path / "cache")
    with pytest.raises(NotApplicable, match=r"overlay\.every = 0"):
        space.make(TrackFilm)
