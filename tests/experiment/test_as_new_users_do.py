"""What new users met who knew only the README: small drawn inputs, one section for each."""

from __future__ import annotations

import csv
import re
import warnings
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy import ndimage

import jumpvision as jv
from jumpvision.experiment.inputs.sections import RodVideo
from jumpvision.experiment.results.summary import JumpRow, Summary, Uncertain
from jumpvision.experiment.stages.recordings import open_film
from jumpvision.films.frames import FrameError
from jumpvision.laboratory import write
from jumpvision.report.pages.words import campaign_words
from tests.worlds.small import ball_film, edit, run_here, write_campaign

# -- a campaign that cannot be diagnosed ----------------------------------------------------------------------


def test_a_campaign_that_cannot_be_diagnosed_ends_with_its_table_and_page(tmp_path, capsys):
    """Five trials of one motion, one of them written without `start`: by their texts two motions, of which one has no
    track. `run` ends as without a [model]; the terminal and the page say what is lacking."""
    campaign, results = write_campaign(tmp_path / "campaign", 5), tmp_path / "results"
    toml = campaign / "campaign.toml"
    toml.write_text(toml.read_text() + "[model]\nterms = []\n")
    for folder in campaign.glob("jump-*"):
        file = folder / "experiment.toml"
        file.write_text(re.sub("frequency = .*", "frequency = 8.0", file.read_text()))
    edit(campaign / "jump-0003", "start = 0.1\n", "")
    assert run_here(campaign, results) == 0
    why = "5 jumps of 1 condition; at least 4 of 2 are needed"
    assert f"not diagnosed: {why}" in capsys.readouterr().err
    rows = list(csv.DictReader((results / "jumps.csv").open()))
    assert len(rows) == 5 and sum(bool(r["jump_height_m"]) for r in rows) >= 4
    assert f"Not diagnosed: {why}" in (results / "report.html").read_text()
    assert (results / "campaign.json").exists() and not (results / "diagnosis.json").exists()


# -- velocity fields without a rate ----------------------------------------------------------------------------


def pattern(shift: int = 0, shape: tuple[int, int] = (96, 128), seed: int = 3) -> np.ndarray:
    """Speckle moved to the right by whole px."""
    h, w = shape
    wide = ndimage.gaussian_filter(np.random.default_rng(seed).standard_normal((h, 2 * w)), 1.5)
    return 120.0 + 60.0 * np.roll(wide, shift, axis=1)[:, w // 2 : w // 2 + w] / wide.std()


@pytest.mark.parametrize("scale, length", [(None, "px"), (1e-4, "m")])
@pytest.mark.parametrize("frame_rate, time", [(None, "frame"), (100.0, "s")])
def test_without_a_rate_everything_is_per_frame(tmp_path, frame_rate, time, scale, length):
    """A shift of 2 px: the units of field, flow, mean, plot and export are one, and the value is in them."""
    frames = np.stack([pattern(2 * k) for k in range(5)])
    field = jv.piv(frames, frame_rate=frame_rate, scale=scale, window=32, step=16)
    speed = 2.0 * (scale or 1.0) * (frame_rate or 1.0)
    assert abs(float(field.u.median()) / speed - 1.0) < 0.01
    assert field.attrs["delta_t"] == pytest.approx(1.0 / (frame_rate or 1.0))
    assert (field.t.units, field.u.units, field.v_sigma.units) == (time, f"{length}/{time}", f"{length}/{time}")
    assert {v.units for v in jv.flow(field).data_vars.values()} == {f"1/{time}"}
    mean = jv.statistics([field.isel(t=k) for k in (0, 1, 2, 3) * 3])
    assert (mean.u.units, mean.uv.units, mean.vorticity.units) == (
        f"{length}/{time}",
        f"{length}^2/{time}^2",
        f"1/{time}",
    )
    axis = jv.plot(field, "speed", axis=Figure().subplots())
    assert [a.get_ylabel() for a in axis.figure.axes if a is not axis] == [f"speed [{length}/{time}]"]
    assert axis.get_title().endswith(f" {time}")
    (file,) = jv.export(field, tmp_path / "field.csv")
    assert file.read_text().splitlines()[0].startswith(f"t_{time},y_{length},x_{length},u_{length}_{time},")


# -- the mean of five fields -----------------------------------------------------------------------------------


# -- a shift beyond the search ----------------------------------------------------------------------------------


def told(a: np.ndarray, b: np.ndarray) -> str:
    """What `jv.piv` says of two pictures, as a warning or as an error; "" for nothing."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        try:
            jv.piv(a, b, window=32, step=16)
        except ValueError as e:
            return str(e)
    return "; ".join(str(w.message) for w in caught)


@pytest.mark.parametrize("shift", [60, 138])
def test_a_shift_beyond_the_passes_is_told_with_passes_that_measure_it(shift):
    """What the words name measures the shift to .01 px."""
    a, b = pattern(shape=(288, 512)), pattern(shift, shape=(288, 512))
    said = told(a, b)
    apart, passes = re.search(r"are (\d+) px apart, .* give passes=\((.*)\)$", said).groups()
    field = jv.piv(a, b, window=32, step=16, passes=tuple(map(int, passes.split(", "))))
    assert int(apart) == shift and abs(float(field.u.median()) - shift) < 0.01
    assert float((field.chc > 0).mean()) > 0.9 * (1.0 - shift / 512)  # what is in both pictures


@pytest.mark.parametrize("seed", [4, 5, 6])
def test_no_passes_are_named_where_none_would_do(seed):
    """Nothing in common, or a shift that the default finds."""
    assert "passes" not in told(pattern(), pattern(seed=seed)) and not told(pattern(), pattern(20))


# -- a rate and an exposure that disagree; one jump ---------------------------------------------------------------


def test_an_exposure_is_held_against_the_rate_that_times_the_film(tmp_path):
    """A film of 200 Hz: 4 ms fit its own stamps, whatever rate is declared beside them, but not a declared clock of
    500 Hz, which is refused with both rates; 40 ms fit neither."""
    file = tmp_path / "rod.avi"
    write.film(file, ball_film(), rate=200.0)
    section = RodVideo("rod.avi", path=file, frame_rate=500.0, exposure=4e-3)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        with open_film(section) as film:
            assert film.rate == pytest.approx(200.0)
        with pytest.raises(FrameError, match=r"at 500 Hz \(0.002 s\); 200 Hz by the film's own stamps"):
            open_film(replace(section, clock="declared"))
        with pytest.raises(
            FrameError, match=r"at 200 Hz \(0.005 s\): correct the rate, or the exposure \(in ms\? then give 4e-05"
        ):
            open_film(replace(section, exposure=0.04))


@pytest.mark.parametrize(
    "heights, said", [((0.0331,), "1 jump, 33.1 mm high."), ((0.0331, 0.0402), "2 jumps, 33.1 to 40.2 mm high.")]
)
def test_one_jump_is_one(heights, said):
    rows = [JumpRow("a", summary=Summary("a", jump_height=Uncertain(h, 1e-5, 0.0))) for h in heights]
    assert campaign_words(rows, None, None, 0)[0] == said
