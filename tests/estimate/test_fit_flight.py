"""Heights and flights of a bouncing spring-mass jumper integrated here, with fine steps."""

import math

import numba as nb
import numpy as np
import pytest

from jumpvision.estimate.flight import contact_flights, final_flight, flight_height, track_flights
from jumpvision.estimate.height import jump_height, rest_height

FINE, FPS = 20000, 200
KICK = 0.3


@nb.njit
def bounce(n, dt, g, k, c, m, kick):
    """Height above rest of a mass on a spring that cannot pull, kicked down at KICK; midpoint steps."""
    x, v = -m * g / k, 0.0
    out = np.empty(n)
    for i in range(n):
        out[i] = x + m * g / k
        if i == int(0.3 / dt):
            v = -kick
        a = -g + (-(k * x + c * v) / m if x <= 0.0 else 0.0)
        xm, vm = x + 0.5 * dt * v, v + 0.5 * dt * a
        am = -g + (-(k * xm + c * vm) / m if xm <= 0.0 else 0.0)
        x, v = x + dt * vm, v + dt * am
    return out


def hop(g, kick, c=0.0, span=1.4):
    h = bounce(int(span * FINE), 1.0 / FINE, g, 5760.6, c, 1.178, kick)
    t = np.arange(h.size) / FINE
    air = h > 1.178 * g / 5760.6
    up, down = np.flatnonzero(~air[:-1] & air[1:]), np.flatnonzero(air[:-1] & ~air[1:])
    return t, h, t[up] + 0.5 / FINE, t[down] + 0.5 / FINE


def film(rng, t, h, noise, lost=0.05):
    i = np.arange(rng.integers(0, FINE // FPS), t.size, FINE // FPS)
    seen = h[i] + rng.normal(0.0, noise, i.size)
    seen[rng.random(i.size) < lost] = np.nan
    return t[i], seen, np.full(i.size, noise)


def test_jump_height_and_its_sigma_with_lost_frames_and_a_shaking_foot():
    noise, shake = 5e-5, 3e-5
    t, h, _, _ = hop(9.81, 0.7, c=1.368)  # damped: the first hop is the highest
    rng, z, rest_z = np.random.default_rng(9), [], []
    for _ in range(150):
        true = h + shake * np.cos(2.0 * math.pi * 46.0 * t + rng.uniform(0.0, 2.0 * math.pi)) * (t > KICK)
        ft, fh, fs = film(rng, t, true, noise)
        rest = rest_height(ft, fh, fs, until=KICK - 0.01)
        got = jump_height(ft, fh, fs, motor_stop=KICK + 0.01, rest=rest, foot_frequency=46.0)
        z.append((got.value - true[t > KICK + 0.01].max()) / got.sigma)
        rest_z.append(rest.value / rest.sigma)
        if len(z) < 20:  # a shake that is not fitted costs no more than its amplitude
            got = jump_height(ft, fh, fs, motor_stop=KICK + 0.01, rest=rest, foot_frequency=None)
            assert abs(got.value - true.max()) < shake + 4.0 * got.sigma
    # 150 draws: 0.683 +- 3 * 0.038
    assert 0.565 < np.mean(np.abs(z) < 1.0) < 0.81
    assert 0.565 < np.mean(np.abs(rest_z) < 1.0) < 0.81
    assert abs(np.mean(z)) < 0.3


def test_the_rise_during_the_motor_is_apart_and_no_rest_and_no_samples_are_values():
    t = np.arange(0.0, 1.0, 1.0 / FPS)
    h = np.where(t < 0.2, 0.0, np.where(t < 0.4, 0.02 * np.sin(math.pi * (t - 0.2) / 0.2), 0.0))
    h = h + np.where((t >= 0.5) & (t < 0.7), 0.0123 - 0.5 * 2.46 * (t - 0.6) ** 2, 0.0)
    s = np.full(t.size, 1e-5)
    rest = rest_height(t, h, s, until=0.2)
    got = jump_height(t, h, s, motor_stop=0.4, rest=rest, foot_frequency=None)
    assert got.motor_rise == pytest.approx(0.02, abs=2e-4) and got.value == pytest.approx(0.0123, abs=5e-5)
    assert got.time == pytest.approx(0.6, abs=1e-3)
    none = rest_height(t, np.full(t.size, np.nan), s, until=0.2)
    assert math.isnan(none.value) and none.reason
    got = jump_height(t, h, s, motor_stop=5.0, rest=rest, foot_frequency=None)
    assert math.isnan(got.value) and got.reason


def late_flights(t, h, sigma, gravity, ripple=0.0):
    late = t > KICK + 0.01
    how = {"gravity": gravity, "shortest": 0.03, "max_gap": 0.03, "ripple": ripple}
    return track_flights(t[late], h[late], sigma[late], **how)


def test_a_damper_shifts_both_edges_by_c_over_k_and_leaves_the_flight_time():
    t, h, up, down = hop(9.81, 0.7, c=1.368)
    rng, edge, time = np.random.default_rng(12), [], []
    for _ in range(12):
        f = late_flights(*film(rng, t, h, 1e-5), 9.81)
        n = min(len(f), down.size)
        edge += list(f.lift_off[:n] - up[:n])
        time += list(f.time[:n] - (down - up[: down.size])[:n])
    assert np.median(edge) == pytest.approx(-1.368 / 5760.6, abs=1e-4)
    assert abs(np.nanmedian(time)) < 1e-4


def test_rest_and_ringing_are_no_flights_and_a_gap_ends_one_without_an_edge():
    rng = np.random.default_rng(13)
    t = np.arange(0.0, 2.0, 1.0 / FPS)
    s, how = np.full(t.size, 5e-5), {"gravity": 2.71, "shortest": 0.03, "max_gap": 0.03, "ripple": 0.0}
    for h in (0.0 * t, 4e-4 * np.cos(2.0 * math.pi * 11.0 * t)):
        assert len(track_flights(t, h + rng.normal(0.0, s), s, **how)) == 0
    t = np.arange(0.0, 0.6, 1.0 / FPS)
    h = 0.5 * 2.71 * (0.09 - (t - 0.3) ** 2)
    h[(t > 0.28) & (t < 0.34)] = np.nan
    f = track_flights(t, h, np.full(t.size, 1e-5), **how)
    assert len(f) == 2 and np.isnan(f.landing).all() and np.isnan(f.lift_off).all()


def test_contact_edges_debounce_and_the_final_flight():
    t = np.arange(0.0, 2.0, 1e-3)
    ground = (t < 0.5) | ((t > 0.61) & (t < 0.9)) | (t > 1.2)
    ground[(t > 0.497) & (t < 0.499)] = False  # the switch opens for a moment before it leaves,
    ground[(t > 1.2025) & (t < 1.2045)] = False  # bounces after landing,
    ground[(t > 1.05) & (t < 1.0515)] = True  # and flickers in the air
    f = contact_flights(t, ground.astype(float), debounce=0.003)
    assert len(f) == 2
    assert f.lift_off == pytest.approx([0.5, 0.9], abs=1.1e-3) and f.landing == pytest.approx([0.61, 1.2], abs=1.1e-3)
    assert f.landing_sigma == pytest.approx(1e-3 / math.sqrt(12.0), rel=1e-6)
    assert final_flight(f, after=0.7) == 1 and final_flight(f, after=0.6) == 1 and final_flight(f, after=1.5) is None
    high = flight_height(float(f.time[1]), float(f.time_sigma[1]), gravity=2.71)
    assert high.value == pytest.approx(2.71 * 0.3**2 / 8.0, rel=0.02)
    assert high.sigma == pytest.approx(2.71 * f.time[1] / 4.0 * f.time_sigma[1])


def test_contact_edge_sigma_is_the_true_error():
    rng, z = np.random.default_rng(14), []
    t = np.arange(0.0, 1.0, 1e-3)
    for _ in range(400):
        up, down = rng.uniform(0.3, 0.4), rng.uniform(0.6, 0.7)
        f = contact_flights(t, 1.0 - ((t > up) & (t < down)), debounce=0.003)
        z.append([(f.lift_off[0] - up) / f.lift_off_sigma[0], (f.time[0] - (down - up)) / f.time_sigma[0]])
    # uniform error: 1 sigma holds 1/sqrt(3) = 0.577; the difference of two (a triangle) 0.65
    assert np.mean(np.abs(z) < 1.0, axis=0) == pytest.approx([0.577, 0.650], abs=0.075)
    assert np.std(z, axis=0) == pytest.approx([1.0, 1.0], abs=0.12)
    f = contact_flights(t, ((t > 0.2) & (t < 0.8)).astype(float), debounce=0.003)  # begins and ends in the air
    assert len(f) == 2 and math.isnan(f.lift_off[0]) and math.isnan(f.landing[1])
    assert final_flight(f, after=0.0) is None
    with pytest.raises(ValueError, match=r"must be 0 \(air\) or 1"):
        contact_flights(t, t, debounce=0.003)


def test_a_shaking_foot_does_not_split_flights_when_its_ripple_is_told():
    t, h, up, _ = hop(2.71, 0.45, c=1.368)
    rng = np.random.default_rng(15)
    for _ in range(5):
        true = h + 3e-5 * np.cos(2.0 * math.pi * 46.0 * t + rng.uniform(0.0, 6.3)) * (t > KICK)
        assert len(late_flights(*film(rng, t, true, 1e-5), 2.71, ripple=3e-5)) == up.size


def test_a_height_is_no_surer_than_the_rest_it_is_counted_from():
    """Three frames of rest below 120 of a flight: rest has noise/sqrt(3), the apex 1.5 noise/sqrt(120), a quarter of
    it. 120 draws: 0.683 - 3 * 0.042; the scatter factor of three values widens sigma, to 0.76 of coverage."""
    rng, inside = np.random.default_rng(16), []
    t = np.concatenate([np.arange(3.0) / FPS, 0.05 + np.arange(120.0) / FPS])
    h = np.where(t < 0.04, 0.0, 0.05 - 0.5 * 2.71 * (t - 0.35) ** 2)
    s = np.full(t.size, 1e-4)
    for _ in range(120):
        seen = h + rng.normal(0.0, s)
        rest = rest_height(t, seen, s, until=0.04)
        got = jump_height(t, seen, s, motor_stop=0.05, rest=rest, foot_frequency=None)
        inside.append(abs(got.value - 0.05) < got.sigma)
    assert 0.683 - 0.127 < np.mean(inside) < 0.76 + 0.117
