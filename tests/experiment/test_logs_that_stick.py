"""Logs that stick, end early, or are another's: named beside the track, which shows what they leave out."""

from __future__ import annotations

import numpy as np
import pytest

from jumpvision.experiment.stages.crosschecks import Motion, cross_checks

G, REST, STANCE = 9.81, 0.4, 0.08  # m/s^2, s before the first hop, s between two
NOISE = 5e-5  # m


def hops(rng, rate=500.0, end=0.4):
    """t, height (n,) and flights (k, 2) [s] of a body that hops ever lower, resting at 0 between."""
    flights, speed, at = [], rng.uniform(0.9, 1.6), REST
    while speed > 0.4:
        flights.append((at, at + 2.0 * speed / G))
        at, speed = flights[-1][1] + STANCE, 0.8 * speed
    t = np.arange(0.0, at + end, 1.0 / rate)
    h = sum(np.where((t > a) & (t < b), 0.5 * G * (t - a) * (b - t), 0.0) for a, b in flights)
    return t, h + rng.normal(0.0, NOISE, t.size), np.array(flights)


def said(t, h, clock, touches):
    motion = Motion(t, h, np.full(t.size, NOISE), G)
    return list(cross_checks("rod_track", motion, (clock, touches), None, None))


def contact(clock, flights):
    return np.where(((clock > flights[:, :1]) & (clock < flights[:, 1:])).any(axis=0), 0.0, 1.0)


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.parametrize("fault", ["always 1", "cut before", "cut between", "stuck from there"])
def test_a_contact_log_that_leaves_flights_out_is_named(fault, seed):
    """With how many flights it shows beside the track's."""
    t, h, flights = hops(np.random.default_rng([72, seed]))
    clock = np.arange(0.0, t[-1], 1e-3)
    touches, kept = contact(clock, flights), 0
    if fault == "always 1":
        touches[:] = 1.0
    elif fault == "cut before":
        clock, touches = clock[clock < 0.3], touches[clock < 0.3]
    else:
        kept, stops = 2, flights[1, 1] + 0.5 * STANCE
        touches[clock > stops] = 1.0
        if fault == "cut between":
            clock, touches = clock[clock < stops], touches[clock < stops]
    (doubt,) = said(t, h, clock, touches)
    assert (doubt.kind, doubt.recording) == ("differs", "contact_log")
    assert doubt.values == {"contact_flights": kept, "track_flights": len(flights)}
    assert ("it ends at" in str(doubt)) == fault.startswith("cut")


@pytest.mark.parametrize("seed", range(40))
def test_a_contact_log_that_is_whole_raises_no_doubt(seed):
    """Clocks within 2 ms, rates of films and switches, a switch that bounces for 3 ms."""
    rng = np.random.default_rng([73, seed])
    t, h, flights = hops(rng, rate=rng.choice([200.0, 500.0, 1000.0]))
    clock = np.arange(0.0, t[-1], rng.choice([1e-3, 5e-4]))
    touches = contact(clock, flights + rng.normal(0.0, 1e-3))
    for landing in flights[:, 1]:
        touches[(clock > landing) & (clock < landing + 0.003)] = rng.integers(0, 2)
    assert said(t, h, clock, touches) == []
