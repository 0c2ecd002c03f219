"""The sand's numbers of docs/physics.md by an integrator of this file's own: scipy's DOP853, no code of the package.

Equations as the page has them (section 3): motor, rod and foot, the cone of eq. (34), a bed that remembers a pause,
the motor's loop. The package's solver, the laboratory's and this one were written apart.
"""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from test_behaviour import ALL, RINGS, kept_remembering, remembered

M_M, M_R, M_F, K, C_S, G, R = 1.125, 0.175, 0.04, 3300.0, 1.2, 9.81, 0.0381
M = M_M + M_R
A, START, AFTER = 0.01875, 0.01, 0.5
KP, KD, MOST = 20000.0, 120.0, 100.0  # N/m, N s/m, N
RHO = 1000.0
PHASES = {"single": (1.5 * math.pi, 0.0), "stutter": (0.5 * math.pi, 0.0), "delayed stutter": (0.5 * math.pi, 0.75)}
AIR, REST, INTRUSION = range(3)


class Bed:
    """Sand of a packing by the example laws; what a pause at the depth `stop` left."""

    def __init__(self, phi, s_p=3000.0, lam=0.010):
        self.k1 = np.interp(phi, [0.57, 0.605, 0.63], [2100.0, 3500.0, 9000.0])
        self.k2 = np.interp(phi, [0.57, 0.63], [2100.0, 4500.0])
        self.b = np.interp(phi, [0.57, 0.605, 0.63], [17.2, 22.0, 40.0])
        self.delta, self.mu, self.tan, self.grains = 0.010, 2.0, math.tan(math.pi / 3), 2.7 * phi * RHO
        self.s_p, self.lam, self.stop = s_p, lam, None

    def force(self, z):
        extra = self.s_p * self.stop * math.exp(-(z - self.stop) / self.lam) if self.stop is not None else 0.0
        return self.k1 * min(z, self.delta) + self.k2 * max(z - self.delta, 0.0) + extra

    def slope(self, z):
        """dm_a/dz, eqs (23), (24), (32)."""
        return self.grains * self.mu * math.pi * max(R - self.mu * z / self.tan, 0.0) ** 2

    def mass(self, z):
        """Eq. (33)."""
        h = min(self.mu * z, R * self.tan)
        return self.grains * h * math.pi * (R**2 + h**2 / (3.0 * self.tan**2) - R * h / self.tan)


class Command:
    """X_c and its rate: a cycle, with a pause between its halves."""

    def __init__(self, f, phase, delay):
        self.w, self.phase, self.delay = 2.0 * math.pi * f, phase, delay
        self.half, self.stop = START + 0.5 / f, START + 1.0 / f + delay
        self.turns = [START, self.half, *([self.half + delay] if delay else []), self.stop, self.stop + AFTER]

    def pausing(self, t):
        return self.half <= t < self.half + self.delay

    def __call__(self, t):
        if t < START:
            return 0.0, 0.0
        moves = t < self.stop and not self.pausing(t)
        u = min(t, self.half) - START + max(min(t, self.stop) - self.half - self.delay, 0.0)
        X = A * (math.sin(self.w * u + self.phase) - math.sin(self.phase))
        return X, A * self.w * math.cos(self.w * u + self.phase) if moves else 0.0


def sheet_height(f, phase, delay, bed, gain):
    """jump_height [mm]; gain: of the loop in the pause, 1 for a motor that follows its command."""
    command, looped = Command(f, phase, delay), gain < 1.0
    depth = (M + M_F) * G / bed.k1
    assert depth < bed.delta
    # state: x_r + (m_m/M) X, its rate, foot, its speed, X, its rate (the last two of the loop)
    rest = -depth - M * G / K
    s, mode, t, top = np.array([rest, 0.0, -depth, 0.0, 0.0, 0.0]), REST, 0.0, -math.inf

    def rod(t, s):
        X, V = s[4:] if looped else command(t)
        return s[0] - M_M / M * X, s[1] - M_M / M * V, X, V

    def spring(t, s):
        x, v, *_ = rod(t, s)
        return -K * (x - s[2]) - C_S * (v - s[3])

    def rates(t, s, mode, bed, depth, paused):
        F = spring(t, s)
        foot = 0.0
        if mode == AIR:
            foot = -G - F / M_F
        elif mode == INTRUSION:
            z = -s[2]
            drag = bed.b * bed.slope(z) * s[3] ** 2
            foot = (bed.force(z) + drag - F - M_F * G) / (M_F + bed.mass(z))
        turn = 0.0
        if looped:
            X_c, V_c = command(t)
            # of the pause as it stands over this piece: at its last instant the law would have gone on
            motor = (gain if paused else 1.0) * KP * (X_c - s[4]) + KD * (V_c - s[5]) + M_M * G
            motor = min(max(motor, -MOST), MOST)
            turn = motor / M_M + motor / M_R - F / M_R
        return np.array([s[1], F / M - G, s[3] if mode != REST else 0.0, foot, s[5] if looped else 0.0, turn])

    def lands(t, s, mode, bed, depth, paused):
        return s[2] + depth if mode == AIR else 1.0

    def stops(t, s, mode, bed, depth, paused):
        return s[3] if mode == INTRUSION else -1.0

    def yields(t, s, mode, bed, depth, paused):
        # it settles on the yield surface: rounding must not push it, or the bed would remember a pause that was none
        return spring(t, s) + M_F * G - bed.force(depth) - 1e-9 * M * G if mode == REST else -1.0

    def lifts(t, s, mode, bed, depth, paused):
        return spring(t, s) + M_F * G if mode == REST else 1.0

    def turns(t, s, *_):
        return rod(t, s)[1]

    events = (lands, stops, yields, lifts, turns)
    for event, direction in zip(events, (-1, 1, 1, -1, -1)):
        event.direction, event.terminal = direction, event is not turns
    for end in command.turns:
        paused = command.pausing(t)
        while t < end:
            done = solve_ivp(
                rates, (t, end), s, "DOP853", events=events, args=(mode, bed, depth, paused),
                rtol=1e-10, atol=1e-13, max_step=2e-3,
            )  # fmt: skip
            assert done.success
            t, s = done.t[-1], done.y[:, -1].copy()
            if t > command.stop:
                seen = [*zip(done.t_events[4], done.y_events[4]), (t, s), (done.t[0], done.y[:, 0])]
                top = max([top, *(rod(*x)[0] for x in seen)])
            if done.status != 1:
                continue
            if mode == AIR:
                s[2], s[3] = -depth, s[3] * M_F / (M_F + bed.mass(depth))
                mode = INTRUSION
            elif mode == INTRUSION:
                mode, depth, s[3] = REST, -s[2], 0.0
                bed.stop = depth
            elif done.t_events[3].size:
                mode, bed.stop = AIR, None  # a flight lets the bed forget the pause
            else:
                mode = INTRUSION
    return 1e3 * (top - rest)


@pytest.mark.parametrize("kind, phi, sheet, gain, settings", ALL)
def test_an_integrator_of_this_file_gives_the_sheet_s_heights_and_the_program_s(kind, phi, sheet, gain, settings):
    """To 0.1 mm those of the sheet, which prints as many digits; to 0.01 mm those of the program."""
    f = kept_remembering(kind, gain, settings is RINGS)
    own = sheet_height(f, *PHASES[kind], Bed(phi, **(settings or {})), gain)
    assert own == pytest.approx(sheet, abs=0.1)
    assert own == pytest.approx(remembered(kind, phi, gain, settings).item(), abs=0.01)
