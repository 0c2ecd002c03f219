"""Worlds of noise: each family of track errors is what it says; campaigns of single trials repeat nothing.

No analysis is asked. About 6 s.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from jumpvision.laboratory import blind
from jumpvision.laboratory import recordings as logs
from jumpvision.laboratory import recordings as track_noise
from jumpvision.laboratory.campaign import write_campaign
from jumpvision.laboratory.jumper import Motion
from jumpvision.laboratory.protocol import Protocol, Records, RodTrack, jumps_of
from jumpvision.laboratory.samples import HARD_ROBOT

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


@pytest.mark.parametrize("rho", [0.0, 0.7])
def test_white_and_correlated_noise_has_the_stated_spread_and_correlation(rho):
    """n = 1e5 samples, of them n (1 - rho^2)/(1 + rho^2) independent for a spread: to 4/sqrt(2 n_eff); rho to
    4 sqrt((1 - rho^2)/n); two frames apart rho^2, its error below 4 sqrt((1 + 4 rho^2)/n)."""
    e = jitter(RodTrack(noise=NOISE, rho=rho))
    n = e.size
    independent = n * (1 - rho**2) / (1 + rho**2)
    assert e.std() == pytest.approx(NOISE, rel=4 / math.sqrt(2 * independent))
    for lag, off in ((1, 4 * math.sqrt((1 - rho**2) / n)), (2, 4 * math.sqrt((1 + 4 * rho**2) / n))):
        assert np.mean(e[:, lag:] * e[:, :-lag]) / NOISE**2 == pytest.approx(rho**lag, abs=off + 4 / math.sqrt(n))
    assert stats.kurtosis(e, axis=None) == pytest.approx(0.0, abs=4 * math.sqrt(24 / independent))


def test_t3_has_the_stated_spread_its_half_width_and_its_tails():
    """Quantiles of n = 1e5 samples at probability p: to 4 sqrt(p (1 - p)/n) in probability. The standard deviation
    itself converges too slowly (its fourth moment does not exist): the quantiles fix the scale noise / sqrt(3)."""
    e = np.abs(jitter(RodTrack(noise=NOISE, family="t3"))).ravel() / (NOISE / math.sqrt(3))
    for p in (0.5, 0.6827, 0.9, 0.99, 0.999):
        width = stats.t.ppf(0.5 + 0.5 * p, 3)
        assert np.mean(e < width) == pytest.approx(p, abs=4 * math.sqrt(p * (1 - p) / e.size))
    assert stats.t(3, scale=1 / math.sqrt(3)).std() == pytest.approx(1.0)


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


def test_the_wander_has_its_rms_is_slow_and_is_no_polynomial():
    """Every track's rms to rounding, its mean 0. The fastest sine, period 0.8 of N frames, changes by 2 pi/(0.8 N) of
    its amplitude a frame; three that nearly cancel leave steeper ones: half of the tracks stay below 4 times that.
    A polynomial of degree 2 leaves more than 1 % of the rms in nine tracks of ten."""
    wander = np.array([e.wander for e in drawn(RodTrack(noise=NOISE, drift=5e-5))])
    np.testing.assert_allclose(np.sqrt(np.mean(wander**2, axis=1)), 5e-5, rtol=1e-9)
    assert np.abs(wander.mean(axis=1)).max() < 1e-17
    steepest = np.abs(np.diff(wander, axis=1)).max(axis=1) / 5e-5
    assert np.median(steepest) < 4 * 2 * math.pi / (0.8 * N)
    design = np.polynomial.legendre.legvander(np.linspace(-1, 1, N), 2)
    left = wander - (design @ np.linalg.lstsq(design, wander.T, rcond=None)[0]).T
    assert np.mean(np.sqrt(np.mean(left**2, axis=1)) > 0.01 * 5e-5) > 0.9
    correlation = np.corrcoef(wander)[np.triu_indices(TRACKS, 1)]
    assert abs(np.mean(correlation)) < 0.1  # each track its own


def test_tracks_differ_by_the_ratio():
    """ln(own / nominal) is uniform on +-0.5 ln 5 (Kolmogorov-Smirnov at 1e-4), and each track errs as its own."""
    found = drawn(RodTrack(noise=NOISE, ratio=5.0))
    own = np.array([e.noise for e in found])
    assert own.min() >= NOISE / math.sqrt(5) and own.max() <= NOISE * math.sqrt(5)
    half = 0.5 * math.log(5)
    assert stats.kstest(np.log(own / NOISE), stats.uniform(-half, 2 * half).cdf).pvalue > 1e-4
    pull = np.array([e.jitter.std() for e in found]) / own  # to 1/sqrt(2 N) each
    assert np.std(pull) == pytest.approx(1 / math.sqrt(2 * N), rel=4 / math.sqrt(2 * TRACKS))


@pytest.mark.parametrize("noise, step", [(2e-4, 1e-4), (5e-5, 1e-4)])
def test_rounded_tracks_err_by_noise_and_step_together(noise, step):
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


def test_impossible_noise_is_refused():
    for wrong in ({"family": "cauchy"}, {"ratio": 0.2}, {"rho": 1.0}):
        with pytest.raises(ValueError, match="family of white, t3, outliers"):
            RodTrack(**wrong)


# ------------------------------------------------------------------------------------------------------------ campaigns
@pytest.mark.parametrize("ground", ["hard", "granular"])
@pytest.mark.parametrize("jumps, n", [("full", 24), ("few", 4)])
@pytest.mark.parametrize("trials", [1, 2])
def test_single_trials_are_different_conditions(ground, jumps, n, trials):
    made = blind.draw(rng(), ground=ground, hidden=(), trials=trials, jumps=jumps).protocol.jumps
    assert len(made) == n
    assert len({j.law for j in made}) == len({j.group for j in made}) == n // trials
    ranges = {
        kind: [min(f), max(f)]
        for kind in {j.kind for j in made}
        if (f := [j.law.frequency for j in made if j.kind == kind])
    }
    repeated = {kind: [min(f), max(f)] for kind, f, _ in blind.REPEATED[ground]}
    if jumps == "full":
        assert ranges == repeated
    assert all(repeated[k][0] <= low and high <= repeated[k][1] for k, (low, high) in ranges.items())


def test_a_campaign_tells_the_truth_of_its_noise():
    """Track minus noise-free track is the error that it tells, to rounding."""
    given = {"noise": 1e-4, "rho": 0.0, "step": 0.0, "family": "t3", "drift": 5e-5, "ratio": 5.0, "stated": False}
    setting = blind.draw(rng(4), ground="hard", hidden=(), jumps="few", nuisance=blind.Nuisance(**given))
    assert setting.nuisance == RodTrack(**given)
    quiet = RodTrack(noise=0.0)
    plain = replace(setting, protocol=replace(setting.protocol, records=Records(rod_track=quiet)))
    noisy, clean = blind.campaign(setting, rng(5), dt=5e-5), blind.campaign(plain, rng(5), dt=5e-5)
    for a, b in zip(noisy, clean):
        off = a.track["height_m"] - b.track["height_m"]
        off -= off[0] - (a.error.jitter + a.error.wander)[0]  # the camera's origin is drawn anew
        np.testing.assert_allclose(off, a.error.jitter + a.error.wander, atol=1e-12)
        assert "sigma_m" not in a.track and a.sigma == a.error.noise
    assert len({a.sigma for a in noisy}) == 4


def test_a_written_campaign_tells_the_truth_of_its_noise(tmp_path):
    """truth.json holds the track's own spread, outliers and wander; the table has no sigma_m where none is stated."""
    out = tmp_path / "out"
    robot = HARD_ROBOT._replace(motor_mass=1.0, rod_mass=0.2, spring_stiffness=5000.0, spring_damping=0.0, gravity=9.81)
    track = RodTrack(family="outliers", drift=5e-5, ratio=5.0, stated=False)
    jump = jumps_of("single", [9.0], [0.004])
    write_campaign(out, Protocol(robot, jump, Records(rod_track=track), ground="hard", duration=0.6), seed=3)
    (folder,) = (f for f in out.iterdir() if f.is_dir())
    true = json.loads((folder / "truth.json").read_text())["track"]
    lines = (folder / "rod_track.csv").read_text().splitlines()
    header = next(x for x in lines if not x.startswith("#"))
    assert header == "time_s,height_m"
    n = len(lines) - lines.index(header) - 1
    assert len(true["drift_m"]) == n and np.mean(np.square(true["drift_m"])) == pytest.approx(2.5e-9)
    assert 5e-5 / math.sqrt(5) <= true["sigma_m"] == true["noise_m"] <= 5e-5 * math.sqrt(5)
    assert all(0 <= i < n for i in true["outliers"])


def test_impossible_campaigns_are_refused():
    with pytest.raises(ValueError, match="trials = 0"):
        blind.draw(rng(), trials=0)
    with pytest.raises(ValueError, match="'full' or 'few'"):
        blind.draw(rng(), jumps="many")
