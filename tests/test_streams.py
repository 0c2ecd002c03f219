"""A stdout that closes, narrows or is none; Ctrl-C; a film without a folder."""

from __future__ import annotations

import os
import shlex
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import jumpvision as jv
from jumpvision.cli import folders, main
from jumpvision.cli.streams import Lasting

SAMPLES = Path(__file__).parents[1] / "data_samples"
RUN = [sys.executable, "-m", "jumpvision"]


@pytest.fixture(scope="module")
def hard_ground():
    return SAMPLES / "hard_ground"


def test_what_nobody_reads_goes_nowhere():
    reads, writes = os.pipe()
    stream = Lasting(os.fdopen(writes, "w"))
    stream.write("one\n")
    stream.flush()
    os.close(reads)
    for _ in range(3):
        assert stream.write("two\n") == 4
        stream.flush()
    stream.close()


@pytest.mark.parametrize("asked", ["--help", "--version"])
def test_a_pipe_that_closes_is_no_error(asked):
    command = f"{shlex.join([*RUN, asked])} | true; test ${{PIPESTATUS[0]}} = 0"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stderr == ""


@pytest.mark.parametrize("columns", ["0", "1", "-3"])
def test_no_width_is_no_error(columns, hard_ground, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", columns)
    assert main(["check", str(hard_ground)]) == 0
    said = capsys.readouterr()
    assert "hard_ground" in said.out and "Traceback" not in said.err


def test_a_width_that_is_no_number_is_no_error(hard_ground):
    """Of a process of its own: it is read as the modules are loaded, too."""
    done = subprocess.run(
        [*RUN, "check", str(hard_ground)],
        capture_output=True,
        text=True,
        env={**os.environ, "COLUMNS": "wide"},
        timeout=60,
        check=False,
    )
    assert done.returncode == 0 and "hard_ground" in done.stdout and "Traceback" not in done.stderr


def test_a_closed_stdout_is_no_error(hard_ground):
    done = subprocess.run(
        ["bash", "-c", f"{shlex.join([*RUN, 'check', str(hard_ground)])} >&-"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0 and "Traceback" not in done.stderr


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
    bed = sand / "bed.png"
    with open_frames(bed) as picture:
        assert jv.bed(bed, floor_row=200).equals(jv.bed(picture[0], floor_row=200))
    with open_frames(sand / "grains.mkv", frame_rate=500.0) as film:
        import cv2

        for k in (10, 11):
            cv2.imwrite(str(tmp_path / f"{k}.png"), film[k])
        assert np.array_equal(
            jv.piv(tmp_path / "10.png", tmp_path / "11.png", window=32, step=32).u,
            jv.piv(film[10], film[11], window=32, step=32).u,
            equal_nan=True,
        )


def test_what_a_stage_lacks_is_said_at_once_and_its_neighbours_are_done(hard_ground, tmp_path, capsys):
    folder = tmp_path / "jump"
    folder.mkdir()
    for name in ("rod.avi", "motor.csv", "contact.csv", "experiment.toml"):
        (folder / name).write_bytes((hard_ground / name).read_bytes())
    (folder / "bed.png").write_bytes((SAMPLES / "loose_sand" / "stutter-7.0Hz-film" / "bed.png").read_bytes())
    with (folder / "experiment.toml").open("a") as toml:
        toml.write('\n[bed_image]\nfile = "bed.png"\n')
    assert main(["run", str(folder), "--no-pictures"]) == 1
    said = capsys.readouterr().err
    assert "[bed_image] scale: missing" in said and "[bed_image] floor_row: missing" in said
    assert "0 of 1 experiments done, 1 in part" in said
    assert (tmp_path / "results" / "jump" / "track.csv").exists()


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


def test_results_of_a_sample_lie_beside_the_samples(tmp_path):
    from jumpvision.experiment.campaign.folder import results_of

    samples = tmp_path / "data_samples"
    for inside, name in (("hard_ground", "hard_ground"), ("loose_sand/stutter-7.0Hz-film", "stutter-7.0Hz-film")):
        assert results_of(samples / inside) == tmp_path / "results" / name
    assert results_of(samples) == tmp_path / "results" / "data_samples"
    assert results_of(tmp_path / "mine" / "jump") == tmp_path / "mine" / "results" / "jump"
