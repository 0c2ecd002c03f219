"""Squat, countermovement, catapult: a body on a muscle in series with a spring (thesis Fig 14, after Alexander 1995).

One leg, straight up: the body of mass M is z above where it stands on a straight leg with the spring relaxed; the
muscle's own length is X <= 0 (0: the leg can be no longer), the spring is pressed by X - z, and one force,
F = k (X - z), goes through spring and muscle to the ground: M z'' = F - M g, X' = V(F). Without mass of the leg and
without damping.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba as nb

CURVATURE = 3.0  # Hill's, a/F_0 = 1/3: the greatest power comes at a third of v_max (thesis section 1.2.2: about 30 %)
STRETCHED, BEND = 1.8, 7.6  # force of a muscle that is pulled fast, in F_0, and how soon: the form of Otten (1987)
OWN_STEPS = 0.1  # of a step: in the time in which the spring follows the muscle
STEPS = 400  # at least, in the time sqrt(travel / g)
FOLD = 40  # halvings that find a depth or an instant

TECHNIQUES = ("squat", "countermovement", "catapult")


class Muscle(NamedTuple):
    """force: greatest of a muscle that keeps its length, F_0 [N]; speed: that of one without load, v_max [m/s]."""

    force: float
    speed: float

    @property
    def power(self) -> float:
        """The greatest [W], over all speeds."""
        at = (math.sqrt(1.0 + CURVATURE) - 1.0) / CURVATURE
        return self.force * self.speed * at * (1.0 - at) / (1.0 + CURVATURE * at)


class Leap(NamedTuple):
    """height: greatest rise over standing [m], NaN without a lift-off; lift_off [s], its speed [m/s]; lowest z [m].

    peak_force [N], peak_power [W] and work [J] are the muscle's.
    """

    height: float
    lift_off: float
    speed: float
    lowest: float
    peak_force: float
    peak_power: float
    work: float


@nb.njit(cache=True)
def shortening(force: float, most: float, speed: float) -> float:
    """V [m/s] of a muscle under a force [N], positive where it lengthens the leg; Hill's law, Otten's beyond F_0."""
    f = force / most
    if f <= 1.0:
        return speed * (1.0 - f) / (1.0 + CURVATURE * f)
    q = max((STRETCHED - f) / (STRETCHED - 1.0), -0.9 / BEND)  # at STRETCHED v = -v_max, a little beyond it gives way
    return speed * (q - 1.0) / (1.0 + BEND * q)


@nb.njit(cache=True)
def _rates(s: tuple[float, ...], straight: bool, air: bool, p: tuple[float, ...]) -> tuple[float, ...]:
    """Rates of z, v, X and of the muscle's work; p: M, g, k, F_0, v_max."""
    force = 0.0 if air else p[2] * (s[2] - s[0])
    V = 0.0 if straight else shortening(force, p[3], p[4])
    return s[1], force / p[0] - p[1], V, force * V


@nb.njit(cache=True)
def _step(s: tuple[float, ...], h: float, straight: bool, air: bool, p: tuple[float, ...]) -> tuple[float, ...]:
    """One step of Runge and Kutta of z, v, X, work."""
    a = _rates(s, straight, air, p)
    b = _rates(_on(s, a, 0.5 * h), straight, air, p)
    c = _rates(_on(s, b, 0.5 * h), straight, air, p)
    d = _rates(_on(s, c, h), straight, air, p)
    return _on(_on(_on(_on(s, a, h / 6.0), b, h / 3.0), c, h / 3.0), d, h / 6.0)


@nb.njit(cache=True)
def _on(s: tuple[float, ...], rate: tuple[float, ...], h: float) -> tuple[float, ...]:
    return s[0] + h * rate[0], s[1] + h * rate[1], s[2] + h * rate[2], s[3] + h * rate[3]


@nb.njit(cache=True)
def _beyond(s: tuple[float, ...], straight: bool, air: bool) -> bool:
    """Whether the leg has become straight, or has left the ground or met it, in a step that knew nothing of it."""
    return (not straight and s[2] > 0.0) or (s[2] - s[0] > 0.0 if air else s[2] - s[0] < 0.0)


@nb.njit(cache=True)
def push_off(z: float, v: float, X: float, travel: float, p: tuple[float, ...]) -> tuple[float, ...]:
    """From z, v, X at full activation to the flight; the values of a Leap. p as in `_rates`.

    A leg that leaves the ground before it is straight goes on lengthening at v_max and may meet it again: the flight
    is the one in which the leg becomes straight or the body comes to its top. Instants at which the leg becomes
    straight, leaves the ground or meets it are found by halving a step.
    """
    _, g, k, most, speed = p
    h = min(OWN_STEPS * most / (k * speed * (1.0 + CURVATURE)), math.sqrt(travel / g) / STEPS)
    s: tuple[float, ...] = (z, v, X, 0.0)
    t, straight, air = 0.0, X >= 0.0, False
    lowest, peak, power = z, k * (X - z), 0.0
    longest = 20.0 * math.sqrt(travel / g)  # a muscle that cannot lift the body sinks on
    while t < longest and s[0] > -10.0 * travel:
        after, used = _step(s, h, straight, air, p), h
        if _beyond(after, straight, air):
            low, used = 0.0, h
            for _ in range(FOLD):
                middle = 0.5 * (low + used)
                if _beyond(_step(s, middle, straight, air, p), straight, air):
                    used = middle
                else:
                    low = middle
            after = _step(s, used, straight, air, p)
            straight, air = straight or after[2] > 0.0, after[2] - after[0] < 0.0
        s, t = after, t + used
        lowest = min(lowest, s[0])
        if not air:
            force = k * (s[2] - s[0])
            peak = max(peak, force)
            power = power if straight else max(power, force * shortening(force, most, speed))
        if air and (straight or s[1] <= 0.0):  # nothing can push it any more before the top
            return s[0] + max(s[1], 0.0) ** 2 / (2.0 * g), t, s[1], lowest, peak, power, s[3]
    return math.nan, math.nan, math.nan, lowest, peak, power, s[3]


def leap(technique: str, muscle: Muscle, *, mass: float, gravity: float, stiffness: float, travel: float) -> Leap:
    """One jump; masses [kg], g [m/s^2], stiffness [N/m] of the spring, travel [m] of the body, down from standing.

    squat: at rest at -travel, then fully active. countermovement: standing, it lets itself fall, and is fully active
    from the depth that just brings it to -travel. catapult: held at -travel until the muscle has its full force.
    ValueError for another technique. A muscle weaker than the weight does not jump: NaN.
    """
    if technique not in TECHNIQUES:
        raise ValueError(f"technique = {technique!r}: must be one of {', '.join(TECHNIQUES)}")
    p = (mass, gravity, stiffness, muscle.force, muscle.speed)
    weight, nothing = mass * gravity, Leap(*[math.nan] * 7)
    if muscle.force <= weight or weight / stiffness >= travel:
        return nothing
    if technique == "squat":
        return Leap(*push_off(-travel, 0.0, min(0.0, -travel + weight / stiffness), travel, p))
    if technique == "catapult":
        return Leap(*push_off(-travel, 0.0, min(0.0, -travel + muscle.force / stiffness), travel, p))
    top = -weight / stiffness  # standing, the spring under the weight
    low, high, found = -travel, top, nothing
    for _ in range(FOLD):
        z = 0.5 * (low + high)
        fall = Leap(*push_off(z, -math.sqrt(2.0 * gravity * (top - z)), z, travel, p))
        if fall.lowest < -travel:
            low = z
        else:
            high, found = z, fall._replace(lift_off=fall.lift_off + math.sqrt(2.0 * (top - z) / gravity))
    return found
