"""Heights from the contact sensor against heights from the track, on jumps of the laboratory. About 10 s."""

import math

import numpy as np

from jumpvision.estimate.estimate import Estimate
from jumpvision.estimate.flight import contact_flights, final_flight, flight_height
from jumpvision.estimate.height import jump_height, rest_height
from jumpvision.laboratory import recordings as logs
from jumpvision.laboratory.jumper import Law, motion_of
from jumpvision.laboratory.samples import HARD_ROBOT


def test_contact_and_video_heights_of_hard_ground_jumps_agree():
    """The rod leaves the ground when the spring is relaxed, M g/k above its rest: g t_f^2/8 + M g/k = jump height.

    1 kHz contact edges: sigma of t_f is sqrt(2/12) ms, of the height g t_f/4 of it, some 0.09 mm; the video adds
    0.02 mm. The spring's damping makes it push until c/k = 0.24 ms before it is relaxed: below 1 um of height at both
    ends. Four jumps: the difference over its sigma within 3.5, its rms 1 +- 3/sqrt(8).
    """
    r = HARD_ROBOT
    sag = (r.motor_mass + r.rod_mass) * r.gravity / r.spring_stiffness
    rng, pulls = np.random.default_rng(0), []
    for f in np.linspace(7.2, 9.3, 4):
        law = Law(float(f), 0.004, 0.5 * math.pi, 0.1)
        motion = motion_of(r, law, [], {}, ground="hard", duration=0.9, dt=5e-6)
        contact = logs.contact_log(motion, rate=1000.0)
        flights = contact_flights(contact["time_s"], contact["contact"], debounce=0.003)
        last = final_flight(flights, after=0.1 + 1 / f)
        flown = flight_height(float(flights.time[last]), float(flights.time_sigma[last]), gravity=r.gravity)
        track = logs.rod_track(motion, rate=200.0, noise=2e-5, zero=0.0, rng=rng)
        t, h, s = track.values()
        rest: Estimate = rest_height(t, h, s, until=0.1)
        near = t < flights.landing[last]
        seen = jump_height(t[near], h[near], s[near], motor_stop=0.1 + 1 / f, rest=rest, foot_frequency=None)
        pulls.append((flown.value + sag - seen.value) / math.hypot(flown.sigma, seen.sigma))
    assert np.max(np.abs(pulls)) < 3.5, pulls
    assert np.sqrt(np.mean(np.square(pulls))) < 1 + 3 / math.sqrt(8), pulls
