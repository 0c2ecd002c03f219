"""Ring-down: drawn damped cosines in the range of the robot. About 25 s."""

import math
import tracemalloc

import numpy as np
import pytest

import jumpvision as jv
from jumpvision.estimate.ringdown import ring_down, swings_until

ZETA = 0.0083


def draw(rng, amplitude, noise, span, f0, fps=200.0):
    t = np.arange(0.0, span, 1.0 / fps) + 3.0
    w0 = 2.0 * math.pi * f0
    wd = w0 * math.sqrt(1.0 - ZETA**2)
    tau = t - t[0]
    x = 1e-3 + amplitude * np.exp(-ZETA * w0 * tau) * np.cos(wd * tau + rng.uniform(0.0, 2.0 * math.pi))
    return t, x + rng.normal(0.0, noise, t.size), wd / (2.0 * math.pi)


@pytest.mark.parametrize("amplitude, noise, span, f0", [(5e-5, 2e-5, 0.5, 9.3), (3e-3, 2e-5, 1.5, 10.1)])
def test_sigmas_are_the_true_errors(amplitude, noise, span, f0):
    rng, z = np.random.default_rng(5), []
    for _ in range(150):
        t, x, f = draw(rng, amplitude, noise, span, f0)
        x[rng.random(t.size) < 0.05] = np.nan  # lost frames
        r = ring_down(t, x, np.full(t.size, noise))
        assert r.reason == ""
        z.append(
            [(r.frequency - f) / r.frequency_sigma, (r.zeta - ZETA) / r.zeta_sigma, (r.offset - 1e-3) / r.offset_sigma]
        )
    inside = np.mean(np.abs(z) < 1.0, axis=0)
    # 150 draws: 0.683 +- 3 * 0.038; the scatter factor adds up to 0.2/sqrt(95) * 0.48 = 0.01
    assert np.all((inside > 0.565) & (inside < 0.81)), inside
    assert np.all(np.abs(np.mean(z, axis=0)) < 0.3)  # 3/sqrt(150) = 0.245, and the curvature of zeta
    assert set(r.estimates()) == {"zeta", "frequency_hz", "omega0"}


def test_amplitude_and_phase_are_those_drawn():
    """300 frames of noise a 150th: of a cosine known but for its frequency and damping, sigma is below .004."""
    for phase in (-2.0, 0.4, 1.9):
        tau = np.arange(300) / 200.0
        x = 3e-3 * np.exp(-ZETA * 60.0 * tau) * np.cos(60.0 * tau + phase)
        r = ring_down(tau + 3.0, x + np.random.default_rng(2).normal(0.0, 2e-5, 300), np.full(300, 2e-5))
        assert r.phase == pytest.approx(phase, abs=0.02) and r.amplitude == pytest.approx(3e-3, rel=0.02)


def test_noise_alone_is_not_an_oscillation():
    rng = np.random.default_rng(1)
    t = np.arange(150) / 200.0
    found = [ring_down(t, rng.normal(0.0, 1e-4, t.size), np.full(t.size, 1e-4)) for _ in range(60)]
    assert sum(r.reason == "" for r in found) <= 1  # 60 * FALSE_ALARM = 0.06 expected
    assert "no significant oscillation" in found[0].reason and math.isnan(found[0].zeta)
    assert "needs 8" in ring_down([0.0, 1.0], [0.0, 1.0], [1.0, 1.0]).reason


def test_the_rest_after_a_body_has_stuck_is_no_ring_down():
    """Dry friction stops an oscillation off its equilibrium; a viscous one goes on to the end of the record."""
    t = np.arange(0.0, 20.0, 0.01)
    noise = np.full(t.size, 1e-4)
    wave = np.clip(1.0 - 0.2 * t, 0.0, None) * np.cos(8.0 * t) + np.where(t < 5.0, 0.0, 0.004)
    x = wave + np.random.default_rng(0).normal(0.0, 1e-4, t.size)
    assert t[swings_until(x, noise) - 1] == pytest.approx(5.0, abs=0.25)
    ringing = np.exp(-0.1 * t) * np.cos(8.0 * t)
    assert swings_until(ringing, noise) == t.size


def test_a_long_record_takes_memory_in_proportion():
    """A periodogram of all frequencies at all times took n^2: 37 GiB for 25,014 samples. Here 1 kB a sample at most."""
    n = 50_000
    t = np.arange(n) * 1e-3
    x = 0.01 * np.exp(-0.02 * t) * np.cos(2.0 * np.pi * 3.3 * t) + np.random.default_rng(0).normal(0.0, 1e-4, n)
    tracemalloc.start()
    found = ring_down(t, x, np.full(n, 1e-4))
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert abs(found.frequency - 3.3) < 5.0 * found.frequency_sigma < 1e-4
    assert peak < 1000 * n


def test_records_of_any_sampling_start_at_the_right_peak():
    """Frequencies up to nine tenths of the Nyquist frequency, samples out of step by up to a third of their spacing."""
    rng = np.random.default_rng(7)
    for jitter, f in ((0.0, 2.0), (0.3, 17.0), (0.3, 61.0), (0.0, 90.0), (0.3, 90.0)):
        t = np.sort(np.arange(500) * 5e-3 + jitter * 5e-3 * rng.uniform(-1.0, 1.0, 500))
        x = 0.01 * np.cos(2.0 * np.pi * f * t + 0.4) + rng.normal(0.0, 1e-3, 500)
        found = ring_down(t, x, np.full(500, 1e-3))
        assert abs(found.frequency - f) < 5.0 * found.frequency_sigma


def test_strong_damping_is_a_share_of_the_undamped_frequency(zeta=0.3):
    """zeta = decay / w0, where the ring-down is seen at w0 sqrt(1 - zeta^2): they differ by 5 %."""
    w0, t = 2.0 * math.pi * 9.0, np.arange(0.0, 0.6, 1e-3)
    x = np.exp(-zeta * w0 * t) * np.cos(w0 * math.sqrt(1.0 - zeta**2) * t + 0.4)
    r = ring_down(t, x + np.random.default_rng(3).normal(0.0, 1e-3, t.size), np.full(t.size, 1e-3))
    assert abs(r.zeta - zeta) < 4.0 * r.zeta_sigma < 4e-3 * zeta
    assert r.omega0 == pytest.approx(w0, abs=4.0 * r.omega0_sigma) and r.omega0_sigma < 1e-3 * w0


def test_a_ring_down_of_an_angle_has_the_angle_s_units():
    t = np.arange(0.0, 4.0, 5e-3)
    x = 0.3 * np.exp(-0.4 * t) * np.cos(12.0 * t) + 1e-4 * np.random.default_rng(1).standard_normal(t.size)
    units = jv.ringdown(t, x, 1e-4)["unit"]
    assert units["ring_offset"] == "unit of x"
    assert units["decay_quadratic_rate"] == "1/(unit of x)" and units["decay_coulomb_rate"] == "(unit of x)/s^2"
    t[40] = t[39]
    with pytest.raises(ValueError, match=r"row 40, t = 0.195 after 0.195 in row 39"):
        jv.ringdown(t, x, 1e-4)
