"""How a stage opens a film: whose clock counts, and what happens to a film that was cut off."""

from __future__ import annotations

import numpy as np
import pytest

from jumpvision.frames import FrameError
from jumpvision.lab import write
from jumpvision.pipeline import StageWarning
from jumpvision.sections import MissingKey, RodVideo
from jumpvision.stages.films import open_film


@pytest.fixture
def slow(tmp_path):
    """20 frames recorded at 500 per second and saved to be played at 25."""
    file = tmp_path / "slow.avi"
    frames = np.random.default_rng(0).integers(0, 255, (20, 40, 30), dtype=np.uint8)
    write.film(file, frames, rate=25.0)
    return {"file": "slow.avi", "path": file, "start": 2.0}


def test_the_files_own_stamps_win_and_the_difference_is_said(slow):
    with (
        pytest.warns(StageWarning, match=r"500 Hz is declared.*25 Hz"),
        open_film(RodVideo(**slow, frame_rate=500.0)) as f,
    ):
        assert f.time == pytest.approx(2.0 + np.arange(20) / 25)


def test_a_film_saved_at_playback_rate_is_timed_as_declared(slow, recwarn):
    with open_film(RodVideo(**slow, frame_rate=500.0, clock="declared")) as f:
        assert f.time == pytest.approx(2.0 + np.arange(20) / 500)
    assert not recwarn.list


def test_a_declared_clock_needs_its_rate(slow):
    with pytest.raises(MissingKey, match="frame_rate"):
        open_film(RodVideo(**slow, clock="declared"))


def test_a_cut_film_is_refused_or_accepted_as_asked(slow):
    data = slow["path"].read_bytes()
    slow["path"].write_bytes(data[: int(0.7 * len(data))])
    with pytest.raises(FrameError, match=r'truncated.*truncated = "accept"'):
        open_film(RodVideo(**slow))
    with pytest.warns(StageWarning, match="truncated"), open_film(RodVideo(**slow, truncated="accept")) as f:
        assert 5 < len(f) < 20
