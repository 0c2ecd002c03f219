"""A pendulum as a user's own simulator: the study's integrator is a leapfrog, the truth scipy's DOP853."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp

import jumpvision as jv

T = np.arange(0.0, 2.0, 0.02)


def swing(p, r):
    """Angle by leapfrog, 10 steps a sample: 0.2 mrad off DOP853 at most, the noise is 1 mrad."""
    W, viscous, quadratic, dry = (p[n] for n in ("W", "viscous", "quadratic", "dry"))
    sin, tanh = math.sin, math.tanh
    a, out = r.inputs["start"], []
    w = -1e-3 * W * sin(a)
    for _ in r.t:
        out.append(a)
        for _ in range(10):  # written out: it is walked some ten million times
            a += 2e-3 * w
            w -= 2e-3 * (W * sin(a) + viscous * w + quadratic * abs(w) * w + dry * tanh(w / 0.02))
    return np.array(out)


def study(function=swing, **more):
    one = {"unit": "1", "scale": 0.1}
    mechanisms = [
        jv.Mechanism("viscous_drag", [jv.Parameter("viscous", 0.0, (0, 3), **one)], "drag of the speed"),
        jv.Mechanism("quadratic_drag", [jv.Parameter("quadratic", 0.0, (0, 3), **one)], "drag of the speed squared"),
        jv.Mechanism("dry_friction", [jv.Parameter("dry", 0.0, (0, 5), **one)], "dry friction in the bearing"),
    ]
    parameters = [jv.Parameter("W", 50.0, (30, 90), unit="1/s^2")]
    return jv.Study(function, parameters, mechanisms, [jv.Channel("angle", "rad", noise=1e-3)], **more)


def true_swing(start, w=60.0, viscous=0.0, quadratic=0.0, dry=0.0):
    """Angle and rate (2, n) by DOP853."""

    def rate(_, s):
        drag = viscous * s[1] + quadratic * abs(s[1]) * s[1] + dry * np.tanh(s[1] / 0.02)
        return [s[1], -w * np.sin(s[0]) - drag]

    return solve_ivp(rate, (0, T[-1]), [start, 0.0], "DOP853", T, rtol=1e-9, atol=1e-11, max_step=5e-3).y


def world(seed=1, n=4, noise=1e-3, **hidden):
    """Swings of a pendulum W = 60 by another integrator."""
    rng = np.random.default_rng(seed)
    starts = [0.3 + 0.2 * k for k in range(n)]
    angles = [true_swing(a, **hidden)[0] + noise * rng.standard_normal(T.size) for a in starts]
    return [jv.Recording(f"swing {k}", T, y, {"start": starts[k]}) for k, y in enumerate(angles)]
