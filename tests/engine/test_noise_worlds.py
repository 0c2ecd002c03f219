"""Noise of the laboratory: each family of track errors is what it says. No analysis is asked."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy import stats

from jumpvision.laboratory import recordings as logs
from jumpvision.laboratory import recordings as track_noise
from jumpvision.laboratory.jumper import Motion
from jumpvision.laboratory.protocol import RodTrack

N, TRACKS, NOISE = 400, 250, 2e-4  # samples of a track, tracks, m


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


def drawn(how: RodTrack, seed: int = 2, tracks: int = TRACKS) -> list[track_noise.Errors]:
    a = rng(seed)
    return [track_noise.errors(N, how, a) for _ in range(tracks)]


def jitter(how: RodTrack) -> np.ndarray:
    return np.array([e.jitter for e in drawn(how)])


def uniform_motion(speed: float) -> Motion:
    """A rod that rises at `speed` [m/s] for 2 s; nothing else of it matters here."""
    t = np.arange(2001) * 1e-3
    zero = np.zeros(t.size)
    return Motion(t, speed * t, *([zero] * 8), zero > 0, zero[:0], zero[:0], 0.0)


def test_correlated_noise_has_the_stated_spread_and_correlation(rho=0.7):
    """n = 1e5 samples, of them n (1 - rho^2)/(1 + rho^2) independent for a spread: to 4/sqrt(2 n_eff); rho to
    4 sqrt((1 - rho^2)/n); two frames apart rho^2, its error below 4 sqrt((1 + 4 rho^2)/n)."""
    e = jitter(RodTrack(noise=NOISE, rho=rho))
    n = e.size
    independent = n * (1 - rho**2) / (1 + rho**2)
    assert e.std() == pytest.approx(NOISE, rel=4 / math.sqrt(2 * independent))
    for lag, off in ((1, 4 * math.sqrt((1 - rho**2) / n)), (2, 4 * math.sqrt((1 + 4 * rho**2) / n))):
        assert np.mean(e[:, lag:] * e[:, :-lag]) / NOISE**2 == pytest.approx(rho**lag, abs=off + 4 / math.sqrt(n))
    assert stats.kurtosis(e, axis=None) == pytest.approx(0.0, abs=4 * math.sqrt(24 / independent))


def test_outliers_are_a_half_percent_of_frames_and_8_to_60_sigma():
    """Share p of n frames to 4 sqrt(p/n); signs of m outliers to 4/sqrt(m); mean size 34 to 4 x 52/sqrt(12 m)."""
    found = drawn(RodTrack(noise=NOISE, family="outliers"))
    out = np.concatenate([e.jitter[e.outliers] for e in found]) / NOISE
    others = np.concatenate([np.delete(e.jitter, e.outliers) for e in found]) / NOISE
    n, m = N * TRACKS, out.size
    assert m / n == pytest.approx(0.005, abs=4 * math.sqrt(0.005 / n))
    assert np.abs(out).min() >= 8 and np.abs(out).max() <= 60
    assert np.abs(out).mean() == pytest.approx(34, abs=4 * 52 / math.sqrt(12 * m))
    assert np.mean(np.sign(out)) == pytest.approx(0, abs=4 / math.sqrt(m))
    assert others.std() == pytest.approx(1, rel=4 / math.sqrt(2 * n)) and np.abs(others).max() < 6


def test_rounded_tracks_err_by_noise_and_step_together(noise=5e-5, step=1e-4):
    """A rod that moves by 5.3 steps a frame: readings are multiples of the step, errors spread as sqrt(noise^2 +
    step^2/12), n = 1.6e4 to 4/sqrt(2 n) = 2.3 %; sigma_m says so."""
    a, how = rng(3), RodTrack(noise=noise, step=step)
    motion = uniform_motion(0.106)
    seen = [logs.seen_rod(motion, how, zero=0.01, rng=a) for _ in range(40)]
    t = seen[0].columns["time_s"]
    error = np.array([s.columns["height_m"] - (0.106 * t - 0.01) for s in seen])
    sigma = math.sqrt(noise**2 + step**2 / 12)
    assert error.std() == pytest.approx(sigma, rel=4 / math.sqrt(2 * error.size))
    np.testing.assert_allclose(seen[0].columns["sigma_m"], sigma)
    steps = seen[0].columns["height_m"] / step
    np.testing.assert_allclose(steps, np.rint(steps), atol=1e-6)


def test_what_a_track_states_and_what_it_does_not():
    """sigma_m: this track's own noise and the rounding, whatever the tails and the wander; or nothing."""
    motion, others = uniform_motion(0.0), {"noise": NOISE, "step": 1e-4, "drift": 1e-3, "ratio": 5.0, "family": "t3"}
    seen = logs.seen_rod(motion, RodTrack(**others), zero=0.0, rng=rng())
    np.testing.assert_allclose(seen.columns["sigma_m"], math.hypot(seen.error.noise, 1e-4 / math.sqrt(12)))
    assert seen.sigma == seen.columns["sigma_m"][0] and seen.error.noise != NOISE
    silent = logs.seen_rod(motion, RodTrack(**others, stated=False), zero=0.0, rng=rng())
    assert list(silent.columns) == ["time_s", "height_m"]
    np.testing.assert_array_equal(silent.columns["height_m"], seen.columns["height_m"])


def test_scale_and_clock_of_a_track_are_wrong_as_declared():
    """Reported = (1 + scale_error) of the height at t + clock_offset + clock_drift t; exact for a uniform motion."""
    how = RodTrack(noise=0.0, scale_error=0.01, clock_offset=2e-3, clock_drift=1e-3)
    seen = logs.seen_rod(uniform_motion(0.3), how, zero=0.0, rng=rng()).columns
    t = seen["time_s"][:-2]  # the last would lie beyond the motion
    np.testing.assert_allclose(seen["height_m"][:-2], 1.01 * 0.3 * (t + 2e-3 + 1e-3 * t), atol=1e-12)
