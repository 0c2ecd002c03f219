"""The engine on real bodies in one dimension: a pendulum, falling balls; their integrator against closed forms."""

from __future__ import annotations

import numpy as np
import pytest

from tests.worlds import bodies as real
from tests.worlds.particle import LAW, path


def law(**values: float) -> np.ndarray:
    return np.array([values.get(n, 0.0) for n in LAW])


def test_a_fall_with_quadratic_drag_is_the_closed_form():
    """y = -ln(cosh(t sqrt(g q))) / q from rest; Runge-Kutta of fourth order with steps of 17 ms: h^5 n ~ 1e-7 m."""
    t, g, q = np.arange(0.0, 3.0, 1 / 15), 9.81, 0.03
    y = path(0.0, 0.0, t, law(gravity=g, quadratic=q), np.inf)
    assert y == pytest.approx(-np.log(np.cosh(t * np.sqrt(g * q))) / q, abs=1e-6)


def test_dry_friction_takes_the_same_from_every_swing_and_holds():
    """x'' = -W x - f sign(v): each half swing loses 2 f / W, and the body rests once within f / W."""
    w, f = 65.0, 0.16
    t = np.linspace(0.0, 6.0, 6001)
    x = path(0.0066, 0.0, t, law(stiffness=w, coulomb=f), 1e-3)  # sin x = x to 5e-8
    turns = np.abs(x[1:-1])[(np.diff(x[:-1]) * np.diff(x[1:])) < 0]
    assert turns == pytest.approx(0.0066 - 2 * f / w * np.arange(1, turns.size + 1), abs=2e-6)
    assert np.ptp(x[-1000:]) == 0.0 and abs(x[-1]) <= f / w


@pytest.mark.long
def test_the_real_pendulum_has_dry_friction(real_data):
    """Every model that is left has Coulomb friction; motions held out are predicted four times better and more."""
    body = real.swing(real_data / "kaheman_single_pendulum")
    found = real.questioned(body)
    assert found.naming is not None and found.gain is not None
    assert real.any_of(found, ["coulomb_friction"]) > 0.999
    assert found.naming.named == ("coulomb_friction",)
    assert 0 < found.naming.left < 0.01  # the encoder's own faults, or the bearing's
    assert found.naming.best.fit.named["coulomb"] == pytest.approx(0.16, abs=0.01)  # 0.163 by a quick fit of others
    assert found.gain.ratio > 4 and found.gain.ratio_ci95[0] > 4


def test_the_real_balls_have_drag_that_is_never_negative(real_data):
    """Light balls: drag in every model that is left. Heavy ones: nothing, or what a camera's scale could do as well."""
    every = real.drops(real_data / "desilva_ball_drops")
    noise, scale = real.repeats(every)
    assert 0.02 < scale < 0.08
    for name in ("Bowling Ball", "Golf Ball", "Tennis Ball", "Whiffle Ball 2"):
        body = real.ball(every[name], noise)
        found = real.questioned(body, {"scale": scale})
        if name in ("Bowling Ball", "Golf Ball"):
            assert found.adequate
            # t^4 beside 1, t, t^2 in white noise: 29 % of its length; the noise here is correlated
            assert real.own_share(body) < 0.4
            continue
        assert found.naming is not None and found.gain is not None
        assert real.any_of(found, real.DRAG) > 0.98
        assert all(e.fit.named.get(n, 0.0) >= 0.0 for e in found.naming.tried for n in ("viscous", "quadratic"))
        assert found.gain.ratio > 3
