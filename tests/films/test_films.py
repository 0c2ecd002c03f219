"""How a stage opens a film: whose clock counts, and what happens to a film that was cut off."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from shared import SAMPLES

from jumpvision.experiment.inputs.sections import GrainVideo, MissingKey, RodVideo
from jumpvision.experiment.stages.grains.piv import piv
from jumpvision.experiment.stages.recordings import open_film, open_grains
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.films.frames import FrameError, open_frames
from jumpvision.films.parameters import PivParams
from jumpvision.laboratory import write


@pytest.fixture
def slow(tmp_path):
    """20 frames recorded at 500 per second and saved to be played at 25."""
    file = tmp_path / "slow.avi"
    frames = np.random.default_rng(0).integers(0, 255, (20, 40, 30), dtype=np.uint8)
    write.film(file, frames, rate=25.0)
    return {"file": "slow.avi", "path": file, "start": 2.0}


def test_the_files_own_stamps_win_and_the_difference_is_said_unless_the_clock_is_declared(slow, recwarn):
    with open_film(RodVideo(**slow, frame_rate=500.0, clock="declared")) as f:
        assert f.time == pytest.approx(2.0 + np.arange(20) / 500)
    assert not recwarn.list
    with (
        pytest.warns(StageWarning, match=r"500 Hz is declared.*25 Hz"),
        open_film(RodVideo(**slow, frame_rate=500.0)) as f,
    ):
        assert f.time == pytest.approx(2.0 + np.arange(20) / 25)
    with pytest.raises(MissingKey, match="frame_rate"):
        open_film(RodVideo(**slow, clock="declared"))


def test_a_cut_film_is_refused_or_accepted_as_asked(slow):
    data = slow["path"].read_bytes()
    slow["path"].write_bytes(data[: int(0.7 * len(data))])
    with pytest.raises(FrameError, match=r'truncated.*truncated = "accept"'):
        open_film(RodVideo(**slow))
    with pytest.warns(StageWarning, match="truncated"), open_film(RodVideo(**slow, truncated="accept")) as f:
        assert 5 < len(f) < 20


def test_a_region_is_matched_as_if_the_film_had_been_cut_to_it(tmp_path):
    """The same pixels give the same vectors, about the same foot; the recording is not a square, nor is the region."""
    left, top, right, bottom = 60, 12, 340, 250
    with open_frames(SAMPLES / "loose_sand" / "stutter-7.0Hz-film" / "grains.mkv") as film:
        for i in range(2):
            for name, part in (("whole", film[i]), ("cut", film[i][top : bottom + 1, left : right + 1])):
                (tmp_path / name).mkdir(exist_ok=True)
                cv2.imwrite(str(tmp_path / name / f"{i}.png"), part)
    roi = (float(left), float(top), float(right), float(bottom))
    foot = {"foot_row": 53.241, "axis_column": 195.5}
    whole = GrainVideo("whole", tmp_path / "whole", 500.0, 3e-4, **foot, roi=roi)
    cut = GrainVideo("cut", tmp_path / "cut", 500.0, 3e-4, foot_row=53.241 - top, axis_column=195.5 - left)
    (a, one), (b, two) = open_grains(whole, None), open_grains(cut, None)
    assert a.shape == b.shape == (239, 281) and (one.foot_row, one.axis_column) == (two.foot_row, two.axis_column)
    assert all(np.array_equal(x, y) for x, y in zip(a, b))
    assert np.array_equal(a.time, b.time)
    first, second = (piv(film, None, None, None, p=PivParams()).field.load() for film in (whole, cut))
    assert (first.chc > 0).mean() > 0.5
    assert first.equals(second)


def test_a_region_that_is_not_in_the_picture_is_refused(tmp_path):
    cv2.imwrite(str(tmp_path / "0.png"), np.zeros((30, 40), np.uint8))
    cv2.imwrite(str(tmp_path / "1.png"), np.zeros((30, 40), np.uint8))
    with pytest.raises(ValueError, match=r"roi = .*columns 0 to 39, rows 0 to 29"):
        open_grains(GrainVideo("x", tmp_path, 500.0, roi=(0.0, 0.0, 40.0, 20.0)), None)
    assert GrainVideo("x", roi=(9.0, 0.0, 3.0, 5.0)).check() and GrainVideo("x", roi=(1.0, 2.0)).check()
    assert GrainVideo("x", roi=(0.0, 0.0, 3.0, 5.0)).check() == []
