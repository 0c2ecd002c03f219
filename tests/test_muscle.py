"""A muscle in series with a spring (thesis Fig 14): closed forms, another integrator, energy, which is highest."""

import math

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from jumpvision.jumper.physics.hard.muscle import BEND, CURVATURE, STRETCHED, TECHNIQUES, Muscle, leap, shortening
from jumpvision.thesis.studies.study import Call, run

BODY = {"mass": 1.2, "gravity": 9.81, "travel": 0.05}
WEIGHT = BODY["mass"] * BODY["gravity"]
RATE = math.sqrt(BODY["gravity"] * BODY["travel"])


def of(technique, force, speed, compliance):
    """A jump by strength in weights, v_max in sqrt(g travel), F_0 / (k travel)."""
    muscle = Muscle(force * WEIGHT, speed * RATE)
    return leap(technique, muscle, **BODY, stiffness=muscle.force / (compliance * BODY["travel"]))


def test_the_muscle_s_law():
    """Hill: v_max without load, none at F_0, most power at a third of v_max; pulled at v_max it bears 1.8 F_0."""
    V = np.linspace(0.0, 1.0, 2001)
    F = (1.0 - V) / (1.0 + CURVATURE * V)
    np.testing.assert_allclose([shortening(f, 1.0, 1.0) for f in F], V, atol=1e-12)
    assert V[np.argmax(F * V)] == pytest.approx(1.0 / 3.0, abs=6e-4)
    assert Muscle(2.0, 3.0).power == pytest.approx(6.0 * (F * V).max(), rel=1e-6)
    pulled = np.linspace(-1.0, 0.0, 101)
    bears = STRETCHED - (STRETCHED - 1.0) * (1.0 + pulled) / (1.0 - BEND * pulled)
    np.testing.assert_allclose([shortening(f, 1.0, 1.0) for f in bears], pulled, atol=1e-12)


def test_a_fast_muscle_on_a_stiff_spring_gives_its_whole_force_all_the_way():
    """(F_0 - M g) travel / (M g) over standing, less what Hill's law takes at the last speed, and the spring."""
    v = math.sqrt(2.0 * (12.0 - 1.0)) / 500.0  # of v_max
    off = (1.0 + CURVATURE) * v * 12.0 / 11.0 + 0.02
    assert of("squat", 12.0, 500.0, 0.02).height == pytest.approx(11.0 * BODY["travel"], rel=off)


def test_a_slow_muscle_behind_a_catch_leaves_the_spring_s_energy():
    """- travel + F_0^2 / (2 k M g): the muscle does not move in the time of the shot, so that the leg stays bent.

    It flies with the leg as it was; at 0.02 sqrt(g travel) the muscle shortens by less than a thousandth meanwhile.
    """
    height = BODY["travel"] * (-1.0 + 0.5 * 58.0 * 0.6)
    assert of("catapult", 58.0, 0.02, 0.6).height == pytest.approx(height, rel=1e-3)
    whole = of("catapult", 58.0, 5.0, 1.0)  # the spring's stretch is the travel: the muscle has nothing left to do
    assert whole.height == pytest.approx(BODY["travel"] * (-1.0 + 0.5 * 58.0), rel=1e-9) and whole.work == 0.0


@pytest.mark.parametrize("technique", TECHNIQUES)
@pytest.mark.parametrize(
    "force, speed, compliance", [(2.3, 5.0, 0.5), (12.0, 2.0, 0.1), (58.0, 10.0, 0.4), (58.0, 1.0, 0.3)]
)
def test_the_height_is_the_muscle_s_work_and_the_spring_s(technique, force, speed, compliance):
    """M g times the rise from where the push begins = work + the spring's energy then, which a fall throws away."""
    found = of(technique, force, speed, compliance)
    k = force * WEIGHT / (compliance * BODY["travel"])
    if (
        technique == "countermovement"
    ):  # from standing: z = - M g / k, the spring's energy is lost where the muscle lets go
        start, spring = -WEIGHT / k, 0.0
    else:
        start, spring = -BODY["travel"], 0.5 * ((WEIGHT if technique == "squat" else force * WEIGHT) ** 2) / k
    assert WEIGHT * (found.height - start) == pytest.approx(found.work + spring, rel=1e-6)


def independent(technique, force, speed, compliance):
    """Height by scipy (DOP853, 1e-10), of a spring that only pushes."""
    m, g, travel = BODY["mass"], BODY["gravity"], BODY["travel"]
    F0, top = force * WEIGHT, speed * RATE
    k = F0 / (compliance * travel)

    def V(f):
        f = f / F0
        if f <= 1.0:
            return top * (1.0 - f) / (1.0 + CURVATURE * f)
        q = (STRETCHED - f) / (STRETCHED - 1.0)
        return top * (q - 1.0) / (1.0 + BEND * q)

    def rates(t, s, straight):
        f = k * max(s[2] - s[0], 0.0)
        return [s[1], f / m - g, 0.0 if straight else V(f)]

    def go(s):
        for straight in (False, True):
            event = (lambda t, s, _: s[2]) if not straight else (lambda t, s, _: s[2] - s[0])
            if not straight and s[2] >= 0.0:
                continue
            event.terminal, event.direction = True, -1.0 if straight else 1.0
            done = solve_ivp(rates, (0.0, 5.0), s, "DOP853", args=(straight,), events=event, rtol=1e-10, atol=1e-13)
            s = done.y[:, -1]
            if s[0] > s[2]:
                break
        return s[0] + s[1] ** 2 / (2.0 * g), done

    if technique == "squat":
        return go([-travel, 0.0, -travel + WEIGHT / k])[0]
    if technique == "catapult":
        return go([-travel, 0.0, -travel + F0 / k])[0]

    def falls_from(z):
        return [z, -math.sqrt(2.0 * g * (-WEIGHT / k - z)), z]

    def too_deep(z):  # how far below -travel the lowest point lies
        turns = lambda t, s: s[1]  # noqa: E731
        turns.terminal, turns.direction = True, 1.0
        down = solve_ivp(
            lambda t, s: rates(t, s, False), (0.0, 5.0), falls_from(z), "DOP853", events=turns, rtol=1e-10, atol=1e-13
        )
        return down.y[0, -1] + travel

    return go(falls_from(brentq(too_deep, -travel, -WEIGHT / k - 1e-9, xtol=1e-12)))[0]


@pytest.mark.parametrize("technique", TECHNIQUES)
@pytest.mark.parametrize(
    "force, speed, compliance", [(2.3, 5.0, 0.5), (12.0, 2.0, 0.1), (12.0, 10.0, 0.8), (58.0, 5.0, 0.3)]
)
def test_another_integrator_finds_the_same_height(technique, force, speed, compliance):
    found = of(technique, force, speed, compliance).height
    assert found == pytest.approx(independent(technique, force, speed, compliance), abs=1e-5 * BODY["travel"] * force)


def test_a_countermovement_goes_as_deep_as_the_squat_begins_and_what_cannot_jump_does_not():
    assert of("countermovement", 12.0, 5.0, 0.3).lowest == pytest.approx(-BODY["travel"], rel=1e-9)
    assert math.isnan(of("squat", 0.9, 5.0, 0.3).height)
    with pytest.raises(ValueError, match="must be one of squat, countermovement, catapult"):
        of("hop", 2.0, 5.0, 0.3)


def test_the_order_of_the_techniques_is_that_of_fig_14():
    """The squat never above; the catapult far above of the strong; of the weak it is like the countermovement."""
    data, rows = run(Call("hard", {}, "muscle", say=lambda text: None))
    h = data.relative_height
    squat, counter, shot = (h.sel(technique=t) for t in TECHNIQUES)
    assert (squat <= 1.002 * counter).all() and (squat <= 1.002 * shot).all()
    alike = abs(shot / counter - 1.0).sel(strength="human").mean()
    above = (shot / counter).mean("compliance")
    assert alike < 0.1 and above.sel(strength="bush baby") > 1.05 and above.sel(strength="insect") > 1.3
    assert len(rows) == 3 and np.isfinite(data.used_power_W).any()
