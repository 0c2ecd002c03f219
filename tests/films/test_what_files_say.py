"""What a file says beside its numbers: capture rates of phones, colour mosaics, scales, units, masses."""

from __future__ import annotations

import av
import numpy as np
import pytest

from jumpvision.films import open_frames
from jumpvision.films.vision.interlaced import is_interlaced


def phone_film(path, rate, notes):
    """Seven grey frames in an MP4 with notes as phones write them."""
    with av.open(str(path), "w", options={"movflags": "use_metadata_tags"}) as container:
        container.metadata.update(notes)
        stream = container.add_stream("libx264", rate=rate, options={"qp": "0"})
        stream.height, stream.width, stream.pix_fmt = 32, 48, "yuv420p"
        for k in range(7):
            grey = np.full((32, 48), 20 * k, np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, format="gray").reformat(format="yuv420p")))
        container.mux(stream.encode())


@pytest.mark.parametrize("capture", ["240.000000", "960", "30.000000", "29.5", "many"])
def test_slow_motion_of_a_phone_is_timed_as_recorded(tmp_path, capture):
    """Android notes the capture rate of every film; that of a usual film is the nominal one and changes nothing."""
    phone_film(tmp_path / "f.mp4", 30, {"com.android.capture.fps": capture})
    slow = capture in ("240.000000", "960")
    rate = float(capture) if slow else 30.0
    with open_frames(tmp_path / "f.mp4") as film:
        assert film.time == pytest.approx(np.arange(7) / rate)
        assert film.meta["recorded_rate_hz"] == rate
        assert [f"recorded at {rate:g} Hz" in w for w in film.warnings] == [True] * slow
    with open_frames(tmp_path / "f.mp4", frame_rate=rate) as film:  # agrees
        assert len(film.warnings) == slow


def ball_film(rng, light, ball, n=6, shape=(120, 160)):
    """Frames of a coloured ball that moves before a wall: (n, h, w, 3), of colours (red, green, blue)."""
    y, x = np.mgrid[: shape[0], : shape[1]]
    frames = []
    for k in range(n):
        cover = np.clip(12.5 - np.hypot(x - 40 - 9 * k, y - 60 - 4 * k), 0, 1)[..., None]
        frames.append((1 - cover) * light + cover * ball)
    return np.array(frames) + rng.normal(0, 2, (n, *shape, 3))


@pytest.mark.parametrize("first", [(0, 0), (0, 1), (1, 0), (1, 1)])
def test_the_raw_film_of_a_colour_camera_is_named(tmp_path, first):
    """Red, green, green, blue in each 2 x 2 pixels, by which of them the sensor begins."""
    rng = np.random.default_rng(3)
    colour = ball_film(rng, np.array([130.0, 140.0, 120.0]), np.array([220.0, 110.0, 20.0]))
    y, x = np.mgrid[: colour.shape[1], : colour.shape[2]]
    filtered = (y + first[0]) % 2 + (x + first[1]) % 2  # 0 red, 1 green, 2 blue
    raw = np.take_along_axis(colour, filtered[None, ..., None], axis=3)[..., 0]
    for name, film in (("raw", raw), ("grey", colour @ [0.299, 0.587, 0.114])):
        np.save(tmp_path / f"{name}.npy", np.clip(np.rint(film), 0, 255).astype(np.uint8))
        with open_frames(tmp_path / f"{name}.npy", frame_rate=100.0) as opened:
            assert ["mosaic (Bayer)" in w for w in opened.warnings] == [True] * (name == "raw")
            assert not is_interlaced(opened)
