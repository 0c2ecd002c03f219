"""Spring stiffness from loading and unloading with errors in both. About 1 s."""

import numpy as np
import pytest

from jumpvision.fit.stiffness import spring_stiffness


def test_sigma_of_stiffness_and_hysteresis_are_the_true_errors():
    """k 3300 N/m, h 0.4 N, 0.1 mm and 0.3 N noise: a line by force errors alone would read k low by 4 %.

    400 draws: 0.683 +- 3 * 0.023, mean pull +- 3/20.
    """
    rng, pulls = np.random.default_rng(0), []
    true = np.r_[np.linspace(0, 2e-3, 40), np.linspace(2e-3, 0, 40)] * 10
    side = np.r_[np.ones(40), -np.ones(40)]
    for _ in range(400):
        x = true + rng.normal(0, 1e-4, 80)
        out = spring_stiffness(x, 5 + 3300 * true + 0.4 * side + rng.normal(0, 0.3, 80), x_sigma=1e-4, force_sigma=0.3)
        k, h = out["spring_stiffness"], out["spring_hysteresis_N"]
        pulls.append([(k.value - 3300) / k.sigma, (h.value - 0.4) / h.sigma])
    inside = np.mean(np.abs(pulls) < 1, axis=0)
    assert np.all(np.abs(inside - 0.683) < 0.08), inside
    assert np.all(np.abs(np.mean(pulls, axis=0)) < 0.2), np.mean(pulls, axis=0)


def test_a_spring_that_does_not_move_has_no_stiffness():
    assert (
        "move" in spring_stiffness(np.zeros(20), np.ones(20), x_sigma=1e-4, force_sigma=0.1)["spring_stiffness"].reason
    )


def test_a_wrong_sigma_is_refused():
    with pytest.raises(ValueError, match="force_sigma"):
        spring_stiffness(np.arange(9.0), np.arange(9.0), x_sigma=0.0, force_sigma=0.0)
