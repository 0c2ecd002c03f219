"""The energy ledger closes for any model, and would not if a loss were forgotten."""

import math

import numpy as np
import pytest

from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.energy import energy_ledger
from jumpvision.jumper.physics.forcing import Loop, delayed
from jumpvision.jumper.physics.model import Model
from tests.worlds.cases import HARD, SAND, case


def random_model(rng, loop):
    u = rng.uniform
    optional = ["inertial_drag", "depth_drag", "reintrusion_overshoot", "stop_go_overshoot", "compaction",
                "viscous_friction", "spring_hardening", "coulomb_friction"] + ["motor_lag"] * (not loop)  # fmt: skip
    p = ModelParameters(k=u(800, 8000), k1=u(800, 8000), k2=u(500, 8000), delta=u(0.002, 0.02), sigma_cone=u(1e5, 1e6),
                        mu=u(1.5, 3), alpha=u(10, 100), b=u(0.5, 20), C=u(0.5, 4), s=u(0, 2000), s_p=u(0, 2000),
                        lam=u(1e-3, 1e-2), factor=u(0.8, 1.5), c_v=u(0, 2), F_c=u(0, 2), tau=u(1e-3, 1e-2),
                        k_3=u(0, 1e7), e=u(0, 0.5))  # fmt: skip
    if u() < 0.2:
        terms = ["landing_loss", *(t for t in optional[5:] if u() < 0.5)]
        return Model("hard", terms, p, **(HARD if u() < 0.5 else SAND))
    terms = [rng.choice(["two_resistance", "linear_penetration", "rft_cone"]), *(t for t in optional if u() < 0.5)]
    if "depth_drag" in terms:
        terms.append("added_mass")
    return Model("granular", terms, p, **{**SAND, "foot_mass": u(0.01, 0.3), "spring_damping": u(0, 4)})


@pytest.mark.parametrize("loop", [False, True])
def test_closes_for_random_models(loop):
    rng = np.random.default_rng(11)
    seen = set()
    for _ in range(30):
        model = random_model(rng, loop)
        amplitude = 0.004 if model.ground == "hard" else 0.01875
        law = delayed(rng.uniform(4, 12), amplitude, rng.uniform(0, 2 * math.pi), rng.uniform(0, 0.1), start=0.02)
        limits = {"max_speed": rng.uniform(0.1, 1.0), "stroke": rng.uniform(0.5, 2.5) * amplitude}
        forcing = Loop(law, kp=2e4, kd=120.0, max_force=100.0, **limits) if loop else law
        books = energy_ledger(model, forcing, end=rng.uniform(0.1, 0.9), rtol=1e-9, atol=1e-11)
        # a tolerance of 1e-9 a step, some hundred steps
        assert abs(books.residual) < 1e-6 * books.turnover, model
        assert all(x >= -1e-9 for n, x in books.losses.items() if n != "added_mass")
        seen |= {n for n, x in books.losses.items() if x != 0.0}
    assert {"two_resistance", "rft_cone", "inertial_drag", "depth_drag", "added_mass", "viscous_friction",
            "coulomb_friction", "reintrusion_overshoot", "landing", "spring_damping"} <= seen  # fmt: skip


def test_a_loss_left_out_is_seen():
    """Every entry of the richest case is far above the bound to which the ledger closes: dropping it breaks it."""
    model, law = case("everything")
    books = energy_ledger(model, law, end=0.8)
    assert abs(books.residual) < 1e-7 * books.turnover
    assert set(books.losses) == {"two_resistance", "depth_drag", "added_mass", "inertial_drag", "reintrusion_overshoot",
                                 "stop_go_overshoot", "viscous_friction", "spring_damping", "landing"}  # fmt: skip
    for name, value in books.losses.items():
        assert abs(value) > 1e-4 * books.turnover, name
