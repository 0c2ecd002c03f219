"""Fig 14: squat, countermovement and catapult of a body on a muscle in series with a spring (after Alexander 1995).

The body of mass 1 and weight 1 is z above where it stands on a straight leg, the muscle's own length is X <= 0 (0:
the leg is straight), one force F = k (X - z) goes through both: z'' = F - 1, X' = V(F). Lengths in units of the travel.
"""

import matplotlib.pyplot as plt
import numpy as np
from common import arguments, compare, save
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

STRENGTHS = {"human": 2.3, "bush baby": 12.0, "insect": 58.0}  # force of the muscle in weights, section 1.2.2
SPEED = 5.0  # of the muscle without load, in sqrt(g travel)
CURVATURE, STRETCHED, BEND = 3.0, 1.8, 7.6  # Hill's law, a/F_0 = 1/3; pulled, the form of Otten (1987)
args = arguments(__doc__)
compliance = np.linspace(0.02, 0.98, 9 if args.small else 33)  # stretch of the spring under the muscle's force


def shortening(f):
    """Speed of a muscle under a force in units of its own, over that without load."""
    q = np.maximum((STRETCHED - f) / (STRETCHED - 1.0), -0.9 / BEND)
    return (1.0 - f) / (1.0 + CURVATURE * f) if f <= 1.0 else (q - 1.0) / (1.0 + BEND * q)


def push_off(z, v, X, strength, k):
    """Height of the jump from z, v, X at full activation (NaN: none), and the lowest z on the way."""

    def rates(t, s):
        force = 0.0 if air else k * (s[2] - s[0])
        return s[1], force - 1.0, 0.0 if straight else SPEED * shortening(force / strength)

    def straightens(t, s):
        return s[2] if not straight else -1.0

    def contact(t, s):  # the leg leaves the ground, or meets it
        return s[2] - s[0] - 1e-12 if not air else s[0] - s[2] - 1e-12

    def top(t, s):
        return s[1] if air else -1.0

    straightens.direction, contact.direction, top.direction = 1, -1, -1
    straightens.terminal = contact.terminal = top.terminal = True
    s, t, straight, air, lowest = [z, v, X], 0.0, X >= 0.0, False, z
    while t < 20.0 and not (air and straight):
        way = solve_ivp(rates, (t, 20.0), s, "LSODA", events=(straightens, contact, top), rtol=1e-8, atol=1e-10)
        s, t, lowest = way.y[:, -1], way.t[-1], min(lowest, way.y[0].min())
        if way.t_events[2].size or way.status == 0:
            return (s[0] if air else np.nan), lowest
        straight, air = straight or bool(way.t_events[0].size), air ^ bool(way.t_events[1].size)
    return (s[0] + max(s[1], 0.0) ** 2 / 2.0 if air else np.nan), lowest


def leap(technique, strength, stretch):
    """Height of a jump, in travels."""
    k = strength / stretch
    if technique == "squat":  # at rest a travel below standing
        return push_off(-1.0, 0.0, min(0.0, -1.0 + 1.0 / k), strength, k)[0]
    if technique == "catapult":  # held there until the muscle has its whole force
        return push_off(-1.0, 0.0, min(0.0, -1.0 + strength / k), strength, k)[0]

    def fall(z):  # standing, it lets itself fall, and is active from z on
        return push_off(z, -np.sqrt(2.0 * (-1.0 / k - z)), z, strength, k)

    return fall(brentq(lambda z: fall(z)[1] + 1.0, -1.0 + 1e-9, -1.0 / k - 1e-9, xtol=1e-6))[0]


TECHNIQUES = ("squat", "countermovement", "catapult")
THEIRS = (
    "catapult and countermovement alike, squat the lowest",
    "the catapult above the countermovement, squat the lowest",
    "the catapult the highest by far",
)
heights = np.array([[[leap(n, s, c) for c in compliance] for n in TECHNIQUES] for s in STRENGTHS.values()])
mean = [h[:, np.isfinite(h).all(axis=0)].mean(axis=1) for h in heights]
rows = compare(
    {f"{name}: mean squat, countermovement, catapult, travels": (m, t) for name, m, t in zip(STRENGTHS, mean, THEIRS)}
)
figure, axes = plt.subplots(1, 3, figsize=(12, 4), layout="constrained")
for axis, (name, strength), h in zip(axes, STRENGTHS.items(), heights):
    axis.plot(compliance, h.T, label=TECHNIQUES)
    axis.set(title=f"{name}, {strength:g} weights", xlabel="compliance $F_0$ / (k travel)")
axes[0].set_ylabel("height / travel")
axes[0].legend()
save(figure, rows, args.out)
