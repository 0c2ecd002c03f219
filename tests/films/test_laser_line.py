"""The laser line on pictures drawn by area integration, with speckle, changing width, uneven light and gaps."""

from __future__ import annotations

import numpy as np
import pytest

from jumpvision.films.vision.laser_line import laser_line
from jumpvision.laboratory.films.bed import laser_picture
from jumpvision.laboratory.films.optics import record

NX, ROWS = 500, 160


def draw(seed, *, speckle=0.0, size=1.5, width=2.0, peak=180.0, light=15.0, lamp=1.0):
    """(picture, true rows, columns with a line): a bowl with a rim, crest and width changing, columns 300-319 empty."""
    rng = np.random.default_rng(seed)
    x = np.arange(NX, dtype=float)
    r = x - NX / 2 + rng.uniform(-9, 9)
    line = 70 + rng.uniform(-0.5, 0.5) + 40 * np.exp(-((r / 70) ** 2)) - 8 * np.exp(-(((abs(r) - 115) / 30) ** 2))
    crest = lamp * peak * (1 + 0.25 * np.sin(x / 85 + 1))
    crest[300:320] = 0.0
    dark = 20.0 + light * (x / NX)[None, :] + light * (np.arange(ROWS) / ROWS)[:, None]
    mean = laser_picture(
        line + 0.01 * x, rows=ROWS, width=width * (1 + 0.2 * np.sin(x / 60)), peak=crest, background=dark,
        speckle=speckle, speckle_size=size, rng=rng,
    )  # fmt: skip
    return record(mean, electrons_per_grey=60.0, read_noise=1.5, rng=rng), line + 0.01 * x, crest > 0


# kind of picture: largest rms error [px]. Without speckle the bar is 0.03 px. Speckle sets a floor of its own in
# proportion to its contrast; the bounds there are the rms that was measured, plus a tenth.
KINDS = [({}, 0.03), ({"speckle": 0.15}, 0.092), ({"peak": 60.0, "speckle": 0.05}, 0.080)]


@pytest.mark.parametrize(("kind", "bar"), KINDS, ids=str)
def test_rows_are_found_and_their_sigma_is_true(kind, bar):
    error, z = [], []
    for seed in range(2):
        picture, line, there = draw(seed, **kind)
        found = laser_line(picture, saturation=255.0)
        good = found.flag == ""
        assert (good == there).mean() > 0.995  # the edges of the gap may go either way
        e = (found.row - line)[good & there]
        error.append(e)
        z.append(e / found.sigma[good & there])
    error, z = np.concatenate(error), np.concatenate(z)
    assert np.sqrt(np.mean(error**2)) < bar
    # 960 columns, speckle shared by about two neighbours: 0.683 +- 3 sqrt(2 * 0.22 / 960) = +- 0.064
    assert abs(np.mean(np.abs(z) < 1.0) - 0.683) < 0.064
    assert abs(z.mean()) < 3.0 * np.sqrt(2.0 / z.size) + 0.03


def test_a_saturated_crest_is_left_out_not_believed():
    """288 grey at the crest, clipped at 255: still within the bar of the unclipped line; sigma may be too large."""
    error, z = [], []
    for seed in range(2):
        picture, line, _ = draw(seed, lamp=1.6)
        found = laser_line(picture, saturation=255.0)
        good = found.flag == ""
        error.append((found.row - line)[good])
        z.append(error[-1] / found.sigma[good])
    assert np.sqrt(np.mean(np.concatenate(error) ** 2)) < 0.03
    assert np.mean(np.abs(np.concatenate(z)) < 1.0) > 0.63


def test_a_gap_is_flagged_and_a_dark_picture_has_no_line():
    picture, _, there = draw(0)
    found = laser_line(picture)
    assert (found.flag[~there][2:-2] == "no line").all()
    assert np.isnan(found.row[~there][2:-2]).all()
    dark = record(np.full((60, 80), 20.0), electrons_per_grey=60.0, read_noise=1.5, rng=np.random.default_rng(0))
    assert (laser_line(dark).flag != "").all()
    with pytest.raises(ValueError, match="12 rows and 8 columns"):
        laser_line(np.zeros((5, 80)))
