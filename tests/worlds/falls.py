"""Falls of a body with a drag that grows in proportion to time: heights in closed form, and the study that asks."""

from __future__ import annotations

import numpy as np

import jumpvision as jv

T = np.arange(80) / 200
SIGMA = 1e-3  # m


def fall(p, r):
    return 0.5 * p["g"] * r.t**2 - p.get("c", 0.0) * r.t**3


def falls(seed, g=9.81, c=0.0, n=3):
    """Heights fallen [m], as the integral of the speed g t - 3 c t^2 over the steps of the record."""
    rng, (gauss, weight) = np.random.default_rng(seed), np.polynomial.legendre.leggauss(3)
    inner = np.concatenate([[0.0], np.diff(T)])[:, None] * (gauss - 1) / 2 + T[:, None]
    y = np.cumsum(np.concatenate([[0.0], np.diff(T)]) / 2 * ((g * inner - 3 * c * inner**2) @ weight))
    return [jv.Recording(f"fall {k}", T, y + SIGMA * rng.standard_normal(T.size)) for k in range(n)]


def study(function=fall, **more):
    drag = jv.Mechanism("drag", [jv.Parameter("c", 0.0, (-5, 5), unit="m/s^3")], "the drag of the air")
    given = {"mechanisms": [drag], "channels": [jv.Channel("y", "m", noise=SIGMA, consider=())], **more}
    return jv.Study(function, [jv.Parameter("g", 9.8, (9, 11))], **given)
