"""The exposure's share in a height, against films whose exposure is sampled at many instants. About 5 s."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest

import jumpvision as jv
from jumpvision.estimate.height import exposure_shift, shift_noise, shift_sigma
from jumpvision.experiment.inputs.sections import RodVideo
from jumpvision.experiment.stages.track import at_mid_exposure, from_film
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.films.parameters import TrackParams
from tests.worlds.ball_pictures import BACK, CONTRAST, ball_image, camera, track

RATE, T = 200.0, 0.004  # exposed for 80 % of a frame


def oscillation(time, f):
    return 1.5 * np.sin(2 * np.pi * f * time)


def test_free_fall_is_shifted_by_a_t_squared_over_24_and_gaps_are_left_out():
    time = np.arange(12) / RATE
    height = -4.9 * time**2
    height[7] = np.nan
    shift = exposure_shift(time, height, T)
    known = np.isfinite(shift)
    assert known.tolist() == [False, *[True] * 5, False, False, False, True, True, False]
    assert shift[known] == pytest.approx(-9.8 * T**2 / 24)
    assert np.isnan(exposure_shift(np.delete(time, 5), np.delete(height, 5), T)[4:6]).all()


@pytest.mark.parametrize("f", [12.0, 25.0])
def test_amplitude_of_a_filmed_oscillation(f):
    """f T = 0.05 and 0.1: sinc takes 0.4 and 1.6 % of the amplitude; what the correction leaves is of fourth order,
    (pi f T)^4/120 and the second difference's own sinc^2(f/rate): below 0.1 %."""
    rng = np.random.default_rng(1)
    n, d, shape = 48, 16.0, (45, 40)
    time = (np.arange(n) + 0.37) / RATE
    sub = T * ((np.arange(15) + 0.5) / 15 - 0.5)
    images = []
    for t in time:
        rows = 22.3 - oscillation(t + sub, f)
        images.append(
            camera(BACK + CONTRAST * np.mean([ball_image(shape, 19.6, y, d, ss=4)[0] for y in rows], 0), 0.5, rng)
        )
    found = track(images, d, streak=True, exposure_fraction=T * RATE)
    assert not any(found.flag)
    height = -found.y
    fit = {}
    for name, h in (("raw", height), ("corrected", height - exposure_shift(time, height, T))):
        ok = np.isfinite(h)
        basis = np.column_stack([np.sin(2 * np.pi * f * time), np.cos(2 * np.pi * f * time), np.ones(n)])[ok]
        fit[name] = float(np.hypot(*np.linalg.lstsq(basis, h[ok])[0][:2])) / 1.5
    # noise 0.5: sigma 0.002 px, of the amplitude 0.002 sqrt(2/48)/1.5 = 0.03 %; three of those and the fourth order
    assert fit["raw"] == pytest.approx(np.sinc(f * T), abs=0.002)
    assert fit["corrected"] == pytest.approx(1.0, abs=0.002)


def test_a_height_belongs_to_the_middle_of_its_exposure(tmp_path):
    """A ball that rises by 2.5 px a frame and is exposed for 0.8 of it, stamped at the begin of the exposure: where its
    streak is centred it was 0.4 frames later, 1 px higher. Positions are good to 0.01 px; a tenth of one is allowed."""
    rng, n, d, shape = np.random.default_rng(5), 16, 14.0, (72, 40)
    sub = T * (np.arange(15) + 0.5) / 15
    stamp = 0.3 + np.arange(n) / RATE

    def row(t):
        return 55.3 - 2.5 * RATE * (t - 0.3)

    images = [
        camera(BACK + CONTRAST * np.mean([ball_image(shape, 19.6, y, d, ss=4)[0] for y in row(t + sub)], 0), 0.5, rng)
        for t in stamp
    ]
    np.save(tmp_path / "rise.npy", np.stack(images))
    film = RodVideo("rise.npy", path=tmp_path / "rise.npy", frame_rate=RATE, scale=1e-3, exposure=T, start=0.3)
    (motion,), _ = from_film(film, None, TrackParams(diameter=d))
    arrays = jv.track(np.stack(images), frame_rate=RATE, exposure=T, diameter=d)
    for found, begin in ((motion, 0.0), (arrays, 0.3)):
        time, y = found.time_s.to_numpy() + begin, found.y_px.to_numpy()
        assert not any(found.flag) and np.abs(y - row(time)).max() < 0.1
        assert time == pytest.approx(stamp + T / 2, abs=1e-12)


def test_it_is_said_or_applied_never_silent(recwarn):
    time = np.arange(40) / RATE
    height = 1e-3 * oscillation(time, 25.0)
    motion = pd.DataFrame({"time_s": time, "height_m": height, "sigma_m": 1e-6, "flag": ""})
    shift = exposure_shift(time, height, T)
    own = np.where(np.isfinite(shift), 1e-6 * np.sqrt(6) * (T * RATE) ** 2 / 24, np.nan)
    said = motion.assign(exposure_shift_m=shift, exposure_shift_sigma_m=own)
    with pytest.warns(StageWarning, match=r"exposure 0\.004 s.*apply"):
        pd.testing.assert_frame_equal(at_mid_exposure(motion, T, "report"), said)
    with pytest.warns(StageWarning, match="not taken out of 2 frames"):
        better = at_mid_exposure(motion, T, "apply")
    assert np.max(np.abs(better.height_m - height)) == pytest.approx(np.nanmax(np.abs(shift)))
    assert better.exposure_shift_m.equals(said.exposure_shift_m)
    recwarn.clear()
    # no warning, but the number is always there; without an exposure it is unknown, not zero
    pd.testing.assert_frame_equal(at_mid_exposure(motion, T, "none"), said)
    rough = motion.assign(sigma_m=1e-3)
    assert at_mid_exposure(rough, T, "report").exposure_shift_m.equals(said.exposure_shift_m)
    assert at_mid_exposure(motion, 0.0, "apply").exposure_shift_m.isna().all() and not recwarn.list


def test_the_correction_adds_the_noise_that_it_says():
    """4000 heights of white noise: their scatter is known to 1.1 %, the rule is for neighbours that are independent."""
    rng = np.random.default_rng(2)
    time, height = np.arange(4000) / RATE, rng.normal(0, 1.0, 4000)
    scatter = np.nanstd(height - exposure_shift(time, height, 1 / RATE))
    assert scatter == pytest.approx(shift_sigma(np.ones(1), time, 1 / RATE)[0], rel=0.035)
    own = np.nanstd(exposure_shift(time, height, 1 / RATE))
    assert own == pytest.approx(shift_noise(np.ones(1), time, 1 / RATE)[0], rel=0.05)
