"""What a file says beside its numbers: capture rates of phones, colour mosaics, scales, units, masses."""

from __future__ import annotations

import av
import numpy as np
import pytest

from jumpvision.base.schema import InputError
from jumpvision.experiment.init.recognise import recognised
from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.sections import RodTrack
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


LOG = {"time_s": np.arange(5) / 100.0, "height_m": np.array([0.0, 0.01, 0.031, 0.02, 0.0])}


def table(path, names, values):
    np.savetxt(path, np.column_stack([*values]), delimiter=",", header=",".join(names), comments="", fmt="%.6f")
    return path


@pytest.mark.parametrize(
    ("names", "units"),
    [
        (("Time (s)", "Position (cm)"), (1.0, 100.0)),
        (("Time (ms)", "Position (m)"), (1e3, 1.0)),
        (("Time [ms]", "Position (end) [mm]"), (1e3, 1e3)),
        (("Time( ms )", "Load cell (left) (mm)"), (1e3, 1e3)),
    ],
)
def test_units_in_round_brackets_are_units(tmp_path, names, units):
    """As phyphox, Capstone, Logger Pro and testing machines write them."""
    file = table(tmp_path / "log.csv", names, [v * u for v, u in zip(LOG.values(), units)])
    section = RodTrack("log.csv", path=file, columns=dict(zip(LOG, names)))
    log = read_log(section, *LOG)
    for column, true in LOG.items():
        assert log[column].to_numpy() == pytest.approx(true)


@pytest.mark.parametrize("word", ["filtered", "2", "Trigger", "V"])
def test_a_word_in_round_brackets_may_be_no_unit(tmp_path, word):
    """A unit of another dimension is refused; the true one may stand in square brackets behind."""
    names = ("t (s)", f"Position ({word})")
    file = table(tmp_path / "log.csv", names, LOG.values())

    def height(name):
        return read_log(RodTrack("log.csv", path=file, columns={"time_s": "t (s)", "height_m": name}), *LOG).height_m

    assert height(f"{names[1]} [cm]").to_numpy() == pytest.approx(0.01 * LOG["height_m"])
    if word == "V":
        with pytest.raises(InputError, match=r"Position \(V\) is in 'V'.*columns.height_m = 'Position \(V\) \[m\]'"):
            height(names[1])
    else:
        assert height(names[1]).to_numpy() == pytest.approx(LOG["height_m"])


@pytest.mark.surprise(
    package="npTDMS",
    version="1.13.0",
    behaviour="Values whose scale is of a kind that it does not know come raw, with a line in Python's log alone.",
    here="The channel is refused, with the kind of its scale and the remedy.",
)
@pytest.mark.parametrize("where", ["channel", "group", "file"])
def test_raw_values_of_an_unknown_tdms_scale_are_refused(tmp_path, where):
    nptdms = pytest.importorskip("nptdms")
    known = {"NI_Scale[0]_Linear_Slope": 50.0, "NI_Scale[0]_Linear_Y_Intercept": 0.0}
    known["NI_Scale[0]_Linear_Input_Source"] = 0xFFFFFFFF
    for kind, status, refused in [("Linear", "unscaled", 0), ("Bridge", "unscaled", 1), ("Bridge", "scaled", 0)]:
        scale = {"NI_Number_Of_Scales": 1, "NI_Scale[0]_Scale_Type": kind, "NI_Scaling_Status": status, **known}
        at = {k: scale if k == where else {} for k in ("channel", "group", "file")}
        with nptdms.TdmsWriter(tmp_path / "log.tdms") as out:
            out.write_segment(
                [
                    nptdms.RootObject(at["file"]),
                    nptdms.GroupObject("Log", at["group"]),
                    nptdms.ChannelObject("Log", "time_s", LOG["time_s"]),
                    nptdms.ChannelObject("Log", "height_m", LOG["height_m"] / 50.0, at["channel"]),
                ]
            )
        if refused:
            with pytest.raises(InputError, match=r"scale of kind Bridge.*save scaled values"):
                read_log(tmp_path / "log.tdms", "height_m", ordered=False)
        else:
            slope = 50.0 if status == "unscaled" else 1.0
            found = read_log(tmp_path / "log.tdms", "height_m", ordered=False).height_m.to_numpy()
            assert found == pytest.approx(LOG["height_m"] / 50.0 * slope)


@pytest.mark.parametrize("first", ["", "#multi:\n"])
def test_of_two_masses_of_tracker_one_is_named(tmp_path, first):
    """The rows that the arm leaves empty are its own."""
    arm = ["0.3\t0.02", "\t", "0.3\t0.01", "0.3\t0.03", "0.3\t0.02"]
    rows = [f"{t:.6E}\t0.1\t{y:.6E}\t{a}" for t, y, a in zip(*LOG.values(), arm)]
    file = tmp_path / "rod_track.csv"
    file.write_text(first + "\tmass A\t\tmass B\t\nt\tx\ty\tx\ty\n" + "\n".join(rows) + "\n")

    def height(name):
        section = RodTrack(file.name, path=file, columns={"time_s": "t", "height_m": name})
        return read_log(section, *LOG).height_m.to_numpy()

    assert height("mass A/y") == pytest.approx(LOG["height_m"])
    assert height("mass B/y") == pytest.approx([0.02, 0.01, 0.03, 0.02])
    found = recognised(tmp_path, file.name, None)
    assert found.values["columns"][0]["height_m"] == "mass A/y" and "or mass B/y?" in found.notes[0]
    with pytest.raises(InputError, match=r"height_m = 'y' missing.*mass A/y.*mass B/y"):
        height("y")
