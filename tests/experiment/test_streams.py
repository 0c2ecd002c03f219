"""A stdout that closes, narrows or is none; Ctrl-C; a film without a folder."""

from __future__ import annotations

import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from shared import SAMPLES

import jumpvision as jv
from jumpvision.cli import folders, main

RUN = [sys.executable, "-m", "jumpvision"]


@pytest.fixture(scope="module")
def hard_ground():
    return SAMPLES / "hard_ground"


def test_a_stdout_that_closes_or_is_none_and_a_width_that_is_no_number_are_no_errors(hard_ground):
    check = shlex.join([*RUN, "check", str(hard_ground)])
    closes = f"{shlex.join([*RUN, '--help'])} | true; test ${{PIPESTATUS[0]}} = 0"
    for command in (closes, f"COLUMNS=wide {check} >&-"):
        done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, timeout=120, check=False)
        assert done.returncode == 0 and "Traceback" not in done.stderr, command


def test_ctrl_c_says_how_to_go_on(monkeypatch, capsys, hard_ground):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr(folders, "work", interrupted)
    assert main(["run", str(hard_ground)]) == 130
    assert "run the same command again to resume" in capsys.readouterr().err


def test_a_film_is_tracked_without_a_folder(hard_ground, tmp_path, capsys):
    film = tmp_path / "ball.avi"
    film.write_bytes((hard_ground / "rod.avi").read_bytes())
    assert main(["track", str(film), "--no-pictures"]) == 0
    assert (tmp_path / "results" / "ball" / "track.csv").exists()
    assert [f.name for f in tmp_path.iterdir() if f.is_file()] == ["ball.avi"]  # nothing beside it
    assert main(["run", str(film)]) == 2
    assert f"jumpvision track {film}" in capsys.readouterr().err


def test_functions_of_arrays_take_paths(hard_ground, tmp_path):
    """The same numbers as of the frames; the clock is the film's own."""
    from jumpvision.films.frames import open_frames

    with open_frames(hard_ground / "rod.avi") as film:
        frames = [film[k] for k in range(30)]
        of_arrays = jv.track(frames, frame_rate=film.rate)
    of_path = jv.track(hard_ground / "rod.avi")
    assert np.allclose(of_path.time_s[:30], of_arrays.time_s, atol=1e-12)
    assert np.allclose(of_path.x_px[:30], of_arrays.x_px, atol=0.05, equal_nan=True)  # the scene is learned from more
    sand = SAMPLES / "loose_sand" / "stutter-7.0Hz-film"
    with open_frames(sand / "grains.mkv", frame_rate=500.0) as film:
        import cv2

        for k in (10, 11):
            cv2.imwrite(str(tmp_path / f"{k}.png"), film[k])
        assert np.array_equal(
            jv.piv(tmp_path / "10.png", tmp_path / "11.png", window=32, step=32).u,
            jv.piv(film[10], film[11], window=32, step=32).u,
            equal_nan=True,
        )


def test_a_shipped_pipeline_has_a_name(tmp_path, monkeypatch):
    """From anywhere; a name that is none is told with those that are; a file of one's own goes before."""
    from jumpvision.base.schema import InputError
    from jumpvision.experiment.workflow.run import read_pipeline

    monkeypatch.chdir(tmp_path)
    assert read_pipeline(Path("piv_only")).stages[:2] == ("piv", "flow")
    with pytest.raises(InputError, match="piv_onl: no such file; give one, or a name: granular, hard_ground, piv_only"):
        read_pipeline(Path("piv_onl"))
    (tmp_path / "piv_only").write_text('stages = ["track"]\n')
    assert read_pipeline(Path("piv_only")).stages == ("track",)
