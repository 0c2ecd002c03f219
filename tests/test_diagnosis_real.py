"""The engine on one-dimensional bodies: drawn ones of known truth, a real pendulum, real falling balls."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from jumpvision.engine.fitting import Problem
from jumpvision.engine.noise.noise import Noise
from jumpvision.engine.order import Order
from tests.worlds import bodies as real
from tests.worlds.bodies import Ball, diagnose_balls, together
from tests.worlds.particle import LAW, UNDRIVEN, path

STEP = 2 * np.pi / 40000  # rad, of the encoder


def law(**values: float) -> np.ndarray:
    return np.array([values.get(n, 0.0) for n in LAW])


def test_a_fall_with_quadratic_drag_is_the_closed_form():
    """y = -ln(cosh(t sqrt(g q))) / q from rest; Runge-Kutta of fourth order with steps of 17 ms: h^5 n ~ 1e-7 m."""
    t, g, q = np.arange(0.0, 3.0, 1 / 15), 9.81, 0.03
    y = path(0.0, 0.0, t, law(gravity=g, quadratic=q), np.inf, UNDRIVEN)
    assert y == pytest.approx(-np.log(np.cosh(t * np.sqrt(g * q))) / q, abs=1e-6)


def test_dry_friction_takes_the_same_from_every_swing_and_holds():
    """x'' = -W x - f sign(v): each half swing loses 2 f / W, and the body rests once within f / W."""
    w, f = 65.0, 0.16
    t = np.linspace(0.0, 6.0, 6001)
    x = path(0.0066, 0.0, t, law(stiffness=w, coulomb=f), 1e-3, UNDRIVEN)  # sin x = x to 5e-8
    turns = np.abs(x[1:-1])[(np.diff(x[:-1]) * np.diff(x[1:])) < 0]
    assert turns == pytest.approx(0.0066 - 2 * f / w * np.arange(1, turns.size + 1), abs=2e-6)
    assert np.ptp(x[-1000:]) == 0.0 and abs(x[-1]) <= f / w


def test_presliding_follows_dahl():
    """Against du/dt = v (1 - u sign v) / delta integrated beside the motion."""
    w, f, delta = 65.0, 0.16, 1e-3

    def rate(_, s):
        return [s[1], -w * np.sin(s[0]) - f * s[2], (s[1] - abs(s[1]) * s[2]) / delta]

    t = np.arange(0.0, 2.0, 0.01)
    true = solve_ivp(rate, (0.0, 2.0), [0.03, -0.1, -1.0], t_eval=t, rtol=1e-10, atol=1e-12, max_step=1e-3).y[0]
    x = path(0.03, -0.1, t, law(stiffness=w, coulomb=f, presliding=delta), 5e-4, UNDRIVEN)
    assert x == pytest.approx(true, abs=2e-6)


def test_dry_friction_of_a_drawn_pendulum_is_named():
    """Truth by another solver, rounded as the encoder: friction within five sigma and 3 %, the gain far above 4."""
    rng = np.random.default_rng(3)
    body = real.pendulum(*real.dry_pendulum(rng), 4, STEP)
    found = Order(Problem(body, body.noise), rng).all()
    assert found.naming is not None and found.gain is not None
    assert "coulomb_friction" in found.naming.best.mechanisms
    f = found.naming.best.fit
    assert f.named["coulomb"] == pytest.approx(0.16, abs=5 * f.sigma("coulomb") + 0.03 * 0.16)
    assert found.gain.ratio > 4


@pytest.mark.long
def test_friction_is_named_beside_a_small_fault_of_the_encoder():
    """An encoder that errs by 0.3 mrad once a turn of 10 mrad is in no vocabulary; it leaves 1/100 of the 3.4 mrad that
    friction makes, (1/100)^2 of chi^2: friction is named, the rest is said to be there. At 3 mrad nothing is."""
    rng = np.random.default_rng(4)
    t, angle = real.dry_pendulum(rng)
    for error, named in ((0.3e-3, ("coulomb_friction",)), (3e-3, ())):
        body = real.pendulum(t, angle + error * np.sin(angle / 10e-3), 4, STEP)
        found = Order(Problem(body, body.noise), np.random.default_rng(1)).all().naming
        assert found is not None and found.named == named
        if named:
            assert 0 < found.left < 0.01
            f = found.best.fit.named["coulomb"]
            assert f == pytest.approx(0.16, rel=0.03)


@pytest.mark.parametrize("drag", [0.0, 0.02])
def test_drag_of_drawn_falls_is_found_and_nothing_else(drag):
    """Four drops in white noise of 5 cm: no drag is no news; drag of a tennis ball is named, within five sigma."""
    rng = np.random.default_rng(7)
    t = np.arange(0.0, 3.0, 1 / 15)
    tracks = []
    for v in (0.0, -0.3, 0.2, -0.5):
        true = solve_ivp(lambda _, s: [s[1], -9.81 - drag * abs(s[1]) * s[1]], (0, 3), [47.0, v], t_eval=t, rtol=1e-9)
        tracks.append((t, true.y[0] + rng.normal(0.0, 0.05, t.size)))
    body = real.ball(tracks, Noise(0.05, 0.0, 1 / 15))
    found = Order(Problem(body, body.noise), rng).all()
    assert found.adequate == (drag == 0.0)
    if drag:
        assert found.naming is not None and found.naming.named == ("quadratic_drag",)
        f = found.naming.best.fit
        assert f.named["quadratic"] == pytest.approx(drag, abs=5 * f.sigma("quadratic"))


@pytest.mark.parametrize(("noise", "scatter", "told_apart"), [(Noise(0.1, 0.8, 1 / 15), 0.04, False),
                                                              (Noise(0.005, 0.0, 1 / 15), 0.0, True)])  # fmt: skip
def test_a_wrong_scale_and_a_drag_are_declared_twins_only_where_the_falls_cannot_tell(noise, scatter, told_apart):
    """Truth: heights are 0.8 of what they were, no drag.

    A drag's own share of a fall of 46 m beside a scale is a third. In noise as
    that of the real falls, scale differing by 4 % from drop to drop, drag could make a third of the effect; in 5 mm of
    white noise it could not make a hundredth.
    """
    rng = np.random.default_rng(11)
    t = np.arange(0.0, 2.9, 1 / 15)
    tracks = []
    for _ in range(2):
        error = noise.s * rng.standard_normal(t.size)
        for k in range(1, t.size):
            error[k] = noise.rho * error[k - 1] + np.sqrt(1 - noise.rho**2) * error[k]
        tracks.append((t, (0.8 + scatter * 0.5 * rng.standard_normal()) * (46.0 - 0.5 * 9.81 * t**2) + error))
    found = Order(Problem(real.ball(tracks, noise), noise, {"scale": scatter}), rng).all()
    assert found.naming is not None and found.naming.named == ("camera_scale",)
    beside = {m for twins in found.naming.twins for m in twins} - {"camera_scale"}
    assert beside & {"viscous_drag", "quadratic_drag"} if not told_apart else not beside


def test_balls_of_one_drag_coefficient_are_one_model():
    """Four drawn balls, two drops each, c_D = 0.47 by scipy, white noise of 5 cm, heights in a scale known to 2 %."""
    rng, t = np.random.default_rng(5), np.arange(0.0, 2.9, 1 / 15)
    each = {
        "tennis": Ball(0.057, 0.033, False), "golf": Ball(0.046, 0.021, False), "bowling": Ball(2.3, 0.107, False),
        "holes": Ball(0.03, 0.036, True),
    }  # fmt: skip
    tracks = {}
    for name, b in each.items():
        drag = 0.47 * 0.5 * 1.2 * np.pi * b.radius**2 / b.mass
        fall = lambda _, s, drag=drag: [s[1], -9.81 - drag * abs(s[1]) * s[1]]  # noqa: E731
        true = solve_ivp(fall, (0, 3), [47.0, -0.2], t_eval=t, rtol=1e-9).y[0]
        tracks[name] = [(t, true + rng.normal(0.0, 0.05, t.size)) for _ in range(2)]
    system = together(tracks, each, Noise(0.05, 0.0, 1 / 15))
    found = diagnose_balls(system, 0.0).naming
    assert found is not None and found.named == ("drag",) and found.status == "complete"
    fit = found.best.fit
    assert fit.named["c_D"] == pytest.approx(0.47, abs=4 * fit.sigma("c_D"))
    assert fit.named["scale"] == pytest.approx(1.0, abs=4 * fit.sigma("scale"))


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
