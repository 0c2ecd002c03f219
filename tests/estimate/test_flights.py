"""The record as one motion: rest, throws, bounces, a wrong scale, noise that nobody states; truths in closed form."""

import math
import warnings
from itertools import pairwise

import numpy as np
import pandas as pd
import pytest
from scipy.integrate import solve_ivp

import jumpvision as jv
from jumpvision.estimate.flight import Ring, in_flight, restitution, track_flights
from jumpvision.estimate.flight.beyond import Beyond, Drive
from tests.worlds.bodies import drops
from tests.worlds.flights import MODELLED, MUST, ball, filmed, jumper, matched, right_count

G = 9.81


def throw(rate, up=0.4, speed=1.3, span=1.0):
    """Rest, one throw at `up` s and back: t, h, landing."""
    t, down = np.arange(0.0, span, 1.0 / rate), up + 2.0 * speed / G
    return t, np.where((t > up) & (t < down), 0.5 * G * (t - up) * (down - t), 0.0), down


def bounces(rate, e=0.85, fall=0.3, n=8):
    """A ball let go at 0.1 s and the edges of its n bounces, impacts shorter than a sample; then it lies still."""
    edges, v = [0.1 + math.sqrt(2.0 * fall / G)], math.sqrt(2.0 * fall * G)
    for _ in range(n):
        v *= e
        edges.append(edges[-1] + 2.0 * v / G)
    t, at = np.arange(0.0, edges[-1] + 0.3, 1.0 / rate), np.array(edges)
    h = np.where(t < 0.1, fall, np.where(t < at[0], fall - 0.5 * G * (t - 0.1) ** 2, 0.0))
    for a, b in pairwise(at):
        h = np.where((t >= a) & (t < b), 0.5 * G * (t - a) * (b - t), h)
    return t, h, at


def coloured(rng, n, rho=0.7):
    out = rng.normal(size=n)
    for i in range(1, n):
        out[i] = rho * out[i - 1] + math.sqrt(1.0 - rho**2) * out[i]
    return out


def found(t, h, sigma, **more):
    return track_flights(t, h, sigma, **({"gravity": G, "shortest": 0.0, "max_gap": 0.05} | more))


def test_a_rod_at_rest_and_a_swing_that_stays_on_its_spring_do_not_fly():
    rng, t = np.random.default_rng(1), np.arange(0.0, 1.0, 1e-3)
    for k in range(24):
        noise = 5e-5 if k < 12 else 2e-4
        h = noise * (rng.normal(size=t.size) if k % 2 else coloured(rng, t.size))
        assert len(found(t, h, np.full(t.size, noise) if k % 4 < 2 else None)) == 0
    w = 2.0 * math.pi * 11.0
    h = 0.9 * G / w**2 * np.cos(w * t) * np.exp(-0.5 * t)  # its greatest acceleration is 0.9 g
    assert len(found(t, h + rng.normal(0.0, 5e-5, t.size), np.full(t.size, 5e-5))) == 0


NOISE = {  # share within one sigma if it were taken for white
    "white": lambda rng, n: rng.normal(size=n),
    "correlated, 0.3": coloured,
    "drift, 0.4": lambda rng, n: rng.normal(size=n) + 2.0 * np.cumsum(rng.normal(size=n)) / math.sqrt(n),
}


@pytest.mark.parametrize("noise", NOISE)
def test_one_throw_is_one_flight_timed_within_its_sigma(noise):
    rng, z, rate = np.random.default_rng(12), [], 500 if noise == "white" else 1000
    for _ in range(60):
        up = rng.uniform(0.3, 0.5)
        t, h, down = throw(rate, up)
        f = found(t, h + 5e-5 * NOISE[noise](rng, t.size), np.full(t.size, 5e-5))
        assert len(f) == 1
        assert noise != "white" or abs(f.time[0] - (down - up)) < 0.5 / rate
        z.append([(f.lift_off[0] - up) / f.lift_off_sigma[0], (f.time[0] - (down - up)) / f.time_sigma[0]])
    # 60 draws: 0.683 +- 3 * 0.06, a mean of 3 / sqrt(60)
    assert np.all(np.abs(np.mean(np.abs(z) < 1.0, axis=0) - 0.683) < 0.18)
    assert np.all(np.abs(np.mean(z, axis=0)) < 0.39)
    if noise == "white":
        ((i, j),) = in_flight(t, h + rng.normal(0.0, 5e-5, t.size), np.full(t.size, 5e-5), gravity=G)
        assert t[i] == pytest.approx(up, abs=0.004) and t[j - 1] == pytest.approx(down, abs=0.004)


def hop(rng, rate, dip=0.0):
    """Rest, a dip of 0.2 s from which a kick throws it at `up`, and rest where it lands: t, h, up, time in flight."""
    up, lasts = rng.uniform(0.3, 0.4), rng.uniform(0.12, 0.3)
    t = rng.uniform(0.0, 1.0 / rate) + np.arange(0.0, up + lasts + 0.3, 1.0 / rate)
    flown, dipped = np.clip(t - up, 0.0, lasts), np.clip((t - up + 0.2) / 0.2, 0.0, 1.0)
    return t, 0.5 * G * flown * (lasts - flown) - dip * np.sin(math.pi * dipped) ** 2, up, lasts


@pytest.mark.parametrize("factor", [0.02, 1.0, 4.0])
def test_rows_that_state_sigmas_of_their_own_are_believed_up_to_a_factor(factor):
    """60 hops: 0.683 +- 3 * 0.06, and no wider than twice what the times scatter by."""
    rng, miss = np.random.default_rng(31), []
    for _ in range(60):
        t, h, _, lasts = hop(rng, float(rng.choice([240.0, 500.0])))
        sigma = 3e-5 * np.exp(0.3 * rng.normal(size=t.size))
        f = found(t, h + factor * sigma * rng.normal(size=t.size), sigma)
        assert len(f) == 1
        miss.append((f.time[0] - lasts, f.time_sigma[0]))
    off, said = np.array(miss).T
    assert abs(np.mean(np.abs(off) < said) - 0.683) < 0.18
    assert np.median(said) < 2.0 * 1.483 * np.median(np.abs(off))


def test_a_rest_that_is_calmer_than_the_flight_tells_neither_its_noise_nor_its_own_level():
    """As a coder freezes the picture: errors of 0.2 mm in motion, one of them that stays at rest; stated 0.05 mm."""
    rng, z = np.random.default_rng(32), []
    for _ in range(60):
        t, h, _, lasts = hop(rng, 240.0)
        error = np.where(h > 0.0, 2e-4 * rng.normal(size=t.size), 2e-4 * rng.normal() + 1e-5 * rng.normal(size=t.size))
        f = found(t, h + error, np.full(t.size, 5e-5))
        assert len(f) == 1
        z.append((f.time[0] - lasts) / f.time_sigma[0])
    assert abs(np.mean(np.abs(z) < 1.0) - 0.683) < 0.18  # 60 draws: 3 * 0.06


def test_a_kick_after_a_gentle_dip_is_not_told_late():
    rng, z = np.random.default_rng(33), []
    for _ in range(60):
        t, h, up, _ = hop(rng, float(rng.choice([240.0, 500.0, 1000.0])), dip=rng.uniform(0.001, 0.008))
        noise = math.exp(rng.uniform(math.log(5e-7), math.log(5e-5)))
        f = found(t, h + rng.normal(0.0, noise, t.size), np.full(t.size, noise))
        k = int(np.argmin(np.abs(f.lift_off - up)))
        z.append((f.lift_off[k] - up) / f.lift_off_sigma[k])
    assert abs(np.mean(np.abs(z) < 1.0) - 0.683) < 0.18  # a parabola as long as noise allows: 0.41 of them
    assert abs(np.mean(z)) < 0.2 + 3.0 / math.sqrt(60.0) and np.max(np.abs(z)) < 5.0


def test_a_ball_bounces_as_often_as_it_does_and_its_restitution_covers():
    rng, z = np.random.default_rng(4), []
    for k in range(20):
        t, h, edges = bounces(float(rng.choice([240.0, 500.0, 1000.0])))
        f = found(t, h + rng.normal(0.0, 5e-5, t.size), None if k % 2 else np.full(t.size, 5e-5))
        assert len(f) == 9
        assert f.kinds[0] == ("release", "impact") and f.kinds[-1] == ("impact", "rest")
        assert f.time[1:] == pytest.approx(np.diff(edges), abs=1e-3)
        e = restitution(f.only(np.arange(9) > 0), after=0.0)
        z.append((e.value - 0.85) / e.sigma)
    assert np.mean(np.abs(z) < 1.0) > 0.683 - 0.32  # 20 draws: 3 * 0.104
    assert abs(np.mean(z)) < 0.7
    f = found(t, np.round(h, 4), None)  # lies still to the last digit
    assert len(f) == 9 and f.time[1:] == pytest.approx(np.diff(edges), abs=1e-3)


def test_contacts_that_take_time_leave_flight_times_and_restitution_covered():
    rng, z, e = np.random.default_rng(21), [], []
    for _ in range(25):
        r = filmed(rng, lambda rng: ball(rng, float(rng.choice([1e-3, 2e-3, 3e-3]))), MODELLED)
        f, must = r.flights(), r.seen(MUST)
        for i, k in matched(f, r.scene.flights, r.t[-1]):
            if k and must[k] and np.isfinite(f.time[i]):
                z.append((f.time[i] - np.diff(r.scene.flights[k])[0]) / f.time_sigma[i])
        bounced = restitution(f.only(np.arange(len(f)) > 0), after=0.0)
        e.append((bounced.value - r.scene.e) / bounced.sigma)
    # as 25 draws, those of a ball have their ground in common: 0.683 +- 3 * 0.093, a mean of 3 / 5
    for miss in (z, e):
        assert abs(np.mean(np.abs(miss) < 1.0) - 0.683) < 0.28
        assert abs(np.mean(miss)) < 0.6 and np.max(np.abs(miss)) < 6.0  # crossings of parabolas are off by 100


def test_bounces_that_drown_in_noise_are_no_ground():
    rng, z = np.random.default_rng(22), []
    for _ in range(16):
        t, h, edges = bounces(500.0, e=0.7, fall=0.1, n=14)
        f = found(t, h + rng.normal(0.0, 1e-4, t.size), None)
        last = int(np.flatnonzero(f.landing < edges[8])[-1])  # of 0.7 mm: 7 sigma
        z.append((f.landing[last] - edges[np.argmin(np.abs(edges - f.landing[last]))]) / f.landing_sigma[last])
    assert abs(np.mean(z)) < 0.75 and np.max(np.abs(z)) < 4.5  # 3 / sqrt(16); met with what drowned: -4 and early


def test_flights_of_a_foot_and_a_motor_are_counted_and_timed():
    rng, right, z = np.random.default_rng(24), [], []
    for _ in range(8):
        r = filmed(rng, lambda rng: jumper(rng, foot=True, motor=True), MODELLED)
        f, must = r.flights(), r.seen(MUST)
        right.append(right_count(r, f))
        for i, k in matched(f, r.scene.flights, r.t[-1]):
            if must[k] and np.isfinite(f.time[i]):
                z.append((f.time[i] - np.diff(r.scene.flights[k])[0]) / f.time_sigma[i])
    assert np.sum(right) >= 6  # of 8, each with 0.92: 7.4 - 2 * 0.8
    assert abs(np.mean(np.abs(z) < 1.0) - 0.683) < 0.27  # about 27 flights: 3 * 0.09


def test_a_wrong_scale_and_a_wrong_sigma_are_doubts_with_their_numbers():
    rng = np.random.default_rng(6)
    t, h, down = throw(500)
    for scale in (1.2, 0.95, 1.0):
        f = found(t, scale * h + rng.normal(0.0, 5e-5, t.size), np.full(t.size, 5e-5))
        assert len(f) == 1 and f.time[0] == pytest.approx(down - 0.4, abs=1e-3)
        assert [d.kind for d in f.doubts] == ["scale"] * (scale != 1.0)
        if f.doubts:
            bend, sigma, gravity = f.doubts[0].values.values()
            assert gravity == G and abs(bend - scale * G) < 4.0 * sigma
    track = h + rng.normal(0.0, 2e-4, t.size)
    f, right = found(t, track, np.full(t.size, 5e-5)), found(t, track, np.full(t.size, 2e-4))
    assert [d.kind for d in f.doubts] == ["noise"] and not right.doubts
    assert f.time_sigma[0] == pytest.approx(right.time_sigma[0], rel=0.15)


def test_flights_of_a_table_of_arrays_and_what_they_refuse():
    rng = np.random.default_rng(10)
    t, h, edges = bounces(500.0)
    track = h + rng.normal(0.0, 5e-5, t.size)
    table = jv.flights(pd.DataFrame({"time_s": t, "height_m": track, "sigma_m": 5e-5}))
    pd.testing.assert_frame_equal(table, jv.flights(t, track, 5e-5))
    assert table.height_m.to_numpy()[1:] == pytest.approx(G * np.diff(edges) ** 2 / 8.0, abs=1e-3)
    assert np.all(np.abs(table.curvature_m_s2 + G) < 5.0 * table.curvature_sigma_m_s2)
    assert table.attrs["restitution"][0] == pytest.approx(0.85, abs=0.01)
    with pytest.warns(UserWarning, match="scale, frame rate or tilt"):
        jv.flights(t, 1.2 * track)
    for given, said in (
        ((pd.DataFrame({"height_m": h}),), "no column time_s"), ((t[::-1], h), "must increase"),
        ((t, h, 0.0), "must be > 0"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=said):
            jv.flights(*given)


def test_real_balls_fall_as_they_should(real_data):
    """A bowling ball has next to no drag; whatever flies, flies within its record and at no more than gravity."""
    every = drops(real_data / "desilva_ball_drops")
    for name, tracks in every.items():
        for t, h in tracks:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                table = jv.flights(t, h)
            bend = -table.curvature_m_s2
            assert len(table) <= 2 and np.all(bend < G + 4.0 * table.curvature_sigma_m_s2), name
    t, h = every["Bowling Ball"][0]
    whole = jv.flights(t, h)
    assert len(whole) == 1 and whole.begins[0] == whole.ends[0] == "outside"


def test_a_foot_and_a_motor_beside_the_parabola_are_those_of_their_equations():
    """Integrated from the lift-off: backwards on the ground, forwards in the air, then with the foot stopped."""
    k, c, m, m_f, v = 5000.0, 3.0, 1.2, 0.05, 0.6
    size, w = 0.004, 60.0

    def o(t):
        return size * np.sin(w * t)

    def rates(t, s, held):
        pull = -k * (s[0] - o(t) - s[2]) - c * (s[1] - size * w * np.cos(w * t) - s[3])
        return [s[1], -G + pull / m, 0.0 if held else s[3], 0.0 if held else -G - pull / m_f]

    lift, land = 0.01, 0.06
    stretch = m_f * G / k - c / k * (v - size * w * np.cos(w * lift))
    begin = [stretch + o(lift), v, 0.0, 0.0]
    before, flown, after = np.linspace(lift, -0.02, 31), np.linspace(lift, land, 51), np.linspace(land, 0.09, 31)

    def run(held, t, s):
        return solve_ivp(rates, (t[0], t[-1]), s, t_eval=t, args=(held,), rtol=1e-10, atol=1e-13).y

    air = run(False, flown, begin)
    y = np.concatenate([run(True, before, begin)[0][::-1][:-1], air[0][:-1], run(True, after, [*air[:3, -1], 0.0])[0]])
    tau = np.concatenate([before[::-1][:-1], flown[:-1], after])
    share, light = m_f / (m + m_f), 1.0 / m + 1.0 / m_f
    ring, fine = Ring(math.sqrt(k * light), 0.5 * c * light, share), np.linspace(-0.03, 0.1, 4001)
    assert ring.lag == pytest.approx(c / k, rel=1e-12)
    beyond = Beyond(tau, (-1, 1), c / k, ring, Drive(fine, o(fine)), lift)
    added = beyond.added(np.array([lift, land]), np.full(2, math.sqrt(k / m)))
    slope = v * (1.0 - share) + G * lift  # of the common centre of mass, at tau = 0
    model = slope * tau - 0.5 * G * tau**2 + added @ [slope, G, 1.0]
    off = y - model
    assert np.ptp(off) < 5e-6  # the least noise of a film; what is added is
    assert np.ptp(added @ [slope, G, 1.0]) > 1e-3
