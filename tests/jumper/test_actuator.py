"""The actuator against its command: exact first- and second-order filters, encoder steps."""

import math

import numpy as np
import pytest
from scipy.signal import lsim

from jumpvision.cli import main
from jumpvision.estimate.robot import bandwidth, follow, motor_power, response
from jumpvision.laboratory import write

STEP = 6.25e-6  # m, encoder


def record(f, *, kind=1.5 * math.pi, cycles=1, tau=0.0, amplitude=0.01, rate=1000.0):
    """time, command and what a first-order lag makes of it, from rest to rest."""
    t = np.arange(0.0, 0.2 + cycles / f + 0.3, 1 / rate)
    angle = 2 * math.pi * f * np.clip(t - 0.2, 0, cycles / f) + kind
    command = amplitude * (np.sin(angle) - math.sin(kind))
    fine = np.linspace(0, t[-1], 8 * t.size)
    smooth = amplitude * (np.sin(2 * math.pi * f * np.clip(fine - 0.2, 0, cycles / f) + kind) - math.sin(kind))
    out = np.interp(t, fine, lsim(([1.0], [tau, 1.0]), smooth, fine)[1]) if tau else command
    return t, command, out


@pytest.mark.parametrize(("kind", "cycles"), [(1.5 * math.pi, 1), (0.5 * math.pi, 0.5), (0.3, 3)])
def test_ratio_and_lag_of_a_first_order_actuator_whatever_the_command(kind, cycles):
    """tau = 4 ms at 7 Hz: H = 1/(1 + i w tau). Without noise what is left is the interpolation of the truth, 1e-4."""
    t, x, y = record(7.0, kind=kind, cycles=cycles, tau=0.004)
    h = 1 / (1 + 2j * math.pi * 7.0 * 0.004)
    out = follow(t, x, y, frequency=7.0, noise=1e-9)
    assert out["actuator_ratio"].value == pytest.approx(abs(h), abs=1e-3)
    assert out["actuator_lag_s"].value == pytest.approx(-np.angle(h) / (2 * math.pi * 7.0), abs=3e-5)
    assert out["actuator_tau_s"].value == pytest.approx(0.004, abs=4e-5)


def test_sigmas_of_ratio_and_lag_are_the_true_errors():
    """400 draws of 50 um noise: 0.683 +- 3 * 0.023."""
    rng, pulls = np.random.default_rng(0), []
    t, x, y = record(7.0)
    for _ in range(400):
        out = follow(t, x, y + rng.normal(0, 5e-5, t.size), frequency=7.0, noise=5e-5)
        pulls.append([(out["actuator_ratio"].value - 1) / out["actuator_ratio"].sigma,
                      out["actuator_lag_s"].value / out["actuator_lag_s"].sigma])  # fmt: skip
    inside = np.mean(np.abs(pulls) < 1, axis=0)
    assert np.all(np.abs(inside - 0.683) < 0.07), inside


def test_the_bandwidth_of_a_campaign_covers_the_truth():
    """Twelve frequencies, 0.5 % noise; 80 draws: sigma 0.683 +- 3 * 0.052, the interval 0.95 - 3 * 0.025."""
    f, rng, pulls, held, orders = np.linspace(2, 24, 12), np.random.default_rng(1), [], [], []
    q = np.array([1.0, 0.012, 0.014])
    grid = np.linspace(0.01, 60, 200_001)
    true = grid[np.flatnonzero(np.abs(response(grid, q)) < q[0] / math.sqrt(2))[0]]
    for _ in range(80):
        h = response(f, q) + 0.005 * (rng.normal(size=12) + 1j * rng.normal(size=12))
        b = bandwidth(f, np.abs(h), np.full(12, 0.005), -np.angle(h) / (2 * math.pi * f), rng=rng)
        orders.append(b.order)
        pulls.append((b.cutoff.value - true) / b.cutoff.sigma)
        held.append(b.low <= true <= b.high)
    assert np.mean(np.array(orders) == q.size - 1) > 0.9
    assert 0.52 < np.mean(np.abs(pulls) < 1) < 0.86
    assert np.mean(held) > 0.87


def test_a_response_that_never_falls_has_no_bandwidth():
    f = np.linspace(2, 14, 6)
    b = bandwidth(f, np.full(6, 1.0), np.full(6, 1e-3), np.full(6, 1e-6), rng=np.random.default_rng(0))
    assert math.isnan(b.cutoff.value) and "3 dB" in b.cutoff.reason


def test_power_and_work_of_a_known_force():
    """F = c X' + k X on X = A sin: work over a cycle pi c w A^2, peak speed A w; 300 draws of 0.2 N and 2 um.

    Coverage of the work 0.683 +- 3 * 0.027; a peak is picked from noisy candidates, so only within 4 sigma.
    """
    w, A, c, k = 2 * math.pi * 7.0, 0.01, 20.0, 800.0
    t = np.arange(0.0, 0.5, 1e-3)
    x = A * np.sin(w * t)
    force = c * A * w * np.cos(w * t) + k * x
    stop = 3 / 7.0
    rng, pulls = np.random.default_rng(2), []
    inside = t <= stop
    exact = float(np.trapezoid(force[inside] * A * w * np.cos(w * t[inside]), t[inside]))
    assert exact == pytest.approx(3 * math.pi * c * w * A**2, rel=2e-2)
    for _ in range(300):
        out = motor_power(t, x + rng.normal(0, 2e-6, t.size), force + rng.normal(0, 0.2, t.size), position_noise=2e-6,
                          period=1 / 7.0, begin=0.0, end=stop)  # fmt: skip
        pulls.append((out["motor_work_J"].value - exact) / out["motor_work_J"].sigma)
    assert abs(np.mean(np.abs(pulls) < 1) - 0.683) < 0.08
    assert abs(out["peak_speed_m_s"].value) == pytest.approx(A * w, abs=4 * out["peak_speed_m_s"].sigma + 1e-3 * A * w)
    power = force * A * w * np.cos(w * t)
    assert out["peak_power_W"].value == pytest.approx(
        power.max(), abs=4 * out["peak_power_W"].sigma + 2e-3 * power.max()
    )


@pytest.fixture
def campaign(tmp_path):
    rng = np.random.default_rng(3)
    for f in (2.0, 4.0, 6.0, 9.0, 12.0, 16.0, 20.0):
        folder = tmp_path / "c" / f"f{f:g}"
        folder.mkdir(parents=True)
        t, _, y = record(f, tau=0.01)
        y = np.rint((y + rng.normal(0, 5e-6, t.size)) / STEP) * STEP
        write.table(folder / "motor.csv", {"time_s": t, "position_m": y})
        (folder / "experiment.toml").write_text(
            f'[actuation]\nkind = "single"\nfrequency = {f}\namplitude = 0.01\nstart = 0.2\n'
            '[motor_log]\nfile = "motor.csv"\n'
        )
    return tmp_path / "c"


def test_a_campaign_of_logs_gives_the_bandwidth(campaign, tmp_path):
    """tau = 10 ms: -3 dB at 1/(2 pi tau) = 15.9 Hz; the discrete truth is good to 1e-3."""
    import json

    import pandas as pd

    results = tmp_path / "r"
    assert main(["run", str(campaign), "--results", str(results), "--workers", "1", "--no-pictures"]) == 0
    table = pd.read_csv(results / "actuator.csv")
    assert len(table) == 7 and (table.actuator_ratio.diff().dropna() < 0).all()
    data = json.loads((results / "actuator_bandwidth.json").read_text())
    assert data["bandwidth_hz"]["value"] == pytest.approx(1 / (2 * math.pi * 0.01), rel=5e-3)
    assert data["tau_s"]["value"] == pytest.approx(0.01, rel=5e-3)
    assert "Actuator" in (results / "report.html").read_text()
