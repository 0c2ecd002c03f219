"""Spring stiffness from loading and unloading with errors in both, and its command."""

import json

import numpy as np
import pytest

from jumpvision.cli import main
from jumpvision.estimate.robot import direction, spring_stiffness

LOOP = np.r_[np.linspace(0, 2e-2, 40), np.linspace(2e-2, 0, 40)]
SIDE = np.r_[np.ones(40), -np.ones(40)]


@pytest.mark.parametrize("force_sigma", [0.3, None])
def test_sigma_of_stiffness_and_hysteresis_are_the_true_errors(force_sigma):
    """k 3300 N/m, h 0.4 N, 0.1 mm and 0.3 N noise: a line by force errors alone would read k low.

    400 draws: 0.683 +- 3 * 0.023, mean pull +- 3/20; the correlation time is never below 1, which widens sigma by 3 %.
    """
    rng, pulls = np.random.default_rng(0), []
    for _ in range(400):
        x, f = LOOP + rng.normal(0, 1e-4, 80), 5 + 3300 * LOOP + 0.4 * SIDE + rng.normal(0, 0.3, 80)
        out = spring_stiffness(x, f, x_sigma=1e-4, force_sigma=force_sigma).fits
        truth = {"spring_stiffness": 3300, "spring_hysteresis_N": 0.4, "spring_curvature": 0.0}
        pulls.append([(out[k].value - v) / out[k].sigma for k, v in truth.items()])
    inside = np.mean(np.abs(pulls) < 1, axis=0)
    assert np.all(np.abs(inside - 0.70) < 0.07), inside
    assert np.all(np.abs(np.mean(pulls, axis=0)) < 0.2), np.mean(pulls, axis=0)


def test_noise_in_the_displacement_does_not_lower_the_stiffness():
    """1 mm noise on 20 mm: least squares reads k low by var(noise)/var(x) = 2.8 %; mean of 200, sigma 0.05 %."""
    rng = np.random.default_rng(1)
    x = np.linspace(0, 0.02, 400)
    found = [spring_stiffness(x + rng.normal(0, 1e-3, 400), 3300 * x + rng.normal(0, 0.2, 400), x_sigma=1e-3,
                              force_sigma=0.2).fits["spring_stiffness"].value for _ in range(200)]  # fmt: skip
    assert np.mean(found) == pytest.approx(3300, rel=0.003)


def test_noise_that_is_shared_along_the_record_widens_sigma():
    """A load cell that drifts: noise averaged over 15 of 300 samples. White sigmas would cover 20 %.

    Ten independent values a stroke leave the correlation itself uncertain: measured 80 %, on the safe side.
    300 draws: +- 3 * 0.025 about 0.68 to 0.80.
    """
    rng, inside = np.random.default_rng(2), []
    x = np.r_[np.linspace(0, 0.02, 150), np.linspace(0.02, 0, 150)]
    for _ in range(300):
        drift = np.convolve(rng.normal(0, 0.2, 314), np.ones(15) / 15**0.5, "valid")
        k = spring_stiffness(x, 3300 * x + drift, x_sigma=0.0, force_sigma=None).fits["spring_stiffness"]
        inside.append(abs(k.value - 3300) < k.sigma)
    assert 0.60 < np.mean(inside) < 0.88, np.mean(inside)


def test_direction_of_a_dense_noisy_record():
    """Two loops at 1 kHz: neighbouring samples differ by less than the noise; turning points are left out."""
    t = np.linspace(0, 2, 4001)
    true = 0.01 * (1 - np.cos(2 * np.pi * t))
    x = true + np.random.default_rng(3).normal(0, 2e-5, t.size)
    side = direction(x, 4e-4, 1.2e-4)
    wrong = (side != 0) & (side != np.sign(np.sin(2 * np.pi * t)))
    assert wrong[100:-100].sum() == 0  # the record's ends rest at zero, where noise hides the direction
    assert wrong.mean() < 0.01
    known = side != 0
    assert known.mean() > 0.8
    assert set(direction(np.linspace(0, 1, 9), 0.02, 0.0)) == {1.0}  # hung weights, one direction
    assert set(direction(-np.linspace(0, 1, 9), 0.02, 0.0)) == {-1.0}


def test_a_hardening_spring_is_seen_and_does_not_hide_its_loop():
    """Stiffness 3700 N/m in the middle, 3300 to 4100 at the ends; loop 0.4 N under a bend of 1 N."""
    rng, false = np.random.default_rng(4), 0
    force = 3300 * LOOP + 2e4 * LOOP**2 + 0.4 * SIDE + rng.normal(0, 0.1, 80)
    out = spring_stiffness(LOOP, force, x_sigma=0.0, force_sigma=None).fits
    truth = {"spring_stiffness": 3700.0, "spring_hysteresis_N": 0.4, "spring_curvature": 4e4}
    for name, value in truth.items():
        assert out[name].value == pytest.approx(value, abs=4 * out[name].sigma)
        assert out[name].sigma < 0.05 * value
    x = np.linspace(0, 0.02, 200)
    out = spring_stiffness(
        x, 3300 * x + 1e4 * x**2 + rng.normal(0, 0.1, 200), x_sigma=0.0, force_sigma=0.1
    ).fits["spring_curvature"]  # fmt: skip
    assert out.value == pytest.approx(2e4, abs=3 * out.sigma)
    assert out.value > 4 * out.sigma
    for _ in range(200):
        out = spring_stiffness(x, 3300 * x + rng.normal(0, 0.1, 200), x_sigma=0.0, force_sigma=0.1).fits
        false += abs(out["spring_curvature"].value) > 4 * out["spring_curvature"].sigma
    assert false <= 1  # 0.013 expected


def test_a_spring_that_does_not_move_has_no_stiffness():
    found = spring_stiffness(np.zeros(20), np.ones(20), x_sigma=1e-4, force_sigma=0.1)
    assert "move" in found.fits["spring_stiffness"].reason


@pytest.fixture
def folder(tmp_path):
    """A spring on a testing machine: millimetres, the spring's own force, 0.4 N of friction."""
    rng, out = np.random.default_rng(5), tmp_path / "spring"
    out.mkdir()
    force = -(2 + 3300 * LOOP + 0.4 * SIDE + rng.normal(0, 0.1, 80))
    rows = [f"{1e3 * a:.3f}, {b:.4f}" for a, b in zip(LOOP, force)]
    (out / "spring.csv").write_text("displacement_mm, force_N\n" + "\n".join(rows) + "\n")
    (out / "experiment.toml").write_text(
        '[robot]\nspring_stiffness = 3200.0\n[spring_log]\nfile = "spring.csv"\nforce = "against"\n'
    )
    return out


def test_the_fit_command_gives_stiffness_hysteresis_figure_and_warnings(folder, tmp_path, capsys):
    results = tmp_path / "r"
    assert main(["run", str(folder), "--results", str(results)]) == 0
    err = capsys.readouterr().err
    fits = json.loads((results / "fits.json").read_text())
    for key, truth in (("spring_stiffness", 3300.0), ("spring_hysteresis_N", 0.4), ("spring_force_at_zero_N", 2.0)):
        assert fits[key]["value"] == pytest.approx(truth, abs=4 * fits[key]["sigma"])
    summary = json.loads((results / "summary.json").read_text())
    assert summary["spring_stiffness_N_m"] == fits["spring_stiffness"]["value"]
    assert summary["spring_stiffness_N_m_sigma"] == fits["spring_stiffness"]["sigma"] < 10
    assert main(["figures", str(results), "--only", "spring", "--format", "png"]) == 0
    assert (results / "figures" / "spring.png").stat().st_size > 5000
    assert "hysteresis" in err and "[robot] gives 3200 N/m" in err and "straight" not in err


BROKEN = {
    "wrong direction": (("toml", '"against"', '"along"'), ('give [spring_log] force = "against"',)),
    "no displacement": (("csv", "displacement_mm", "x"), ("spring.csv", "displacement_m missing")),
    "negative sigma": (("toml", 'force = "against"', "force_sigma = -1.0"), ("[spring_log]", "force_sigma = -1.0")),
}


@pytest.mark.parametrize("name", BROKEN)
def test_bad_input_is_one_clear_error(name, folder, tmp_path, capsys):
    (kind, old, new), parts = BROKEN[name]
    file = folder / ("experiment.toml" if kind == "toml" else "spring.csv")
    text = file.read_text()
    assert old in text
    file.write_text(text.replace(old, new))
    assert main(["fit", str(folder), "--results", str(tmp_path / "r")]) in (1, 2)
    said = [t for t in capsys.readouterr().err.splitlines() if t.startswith(("jumpvision: ", "error: "))]
    assert len(said) == 1, said
    for part in parts:
        assert part in said[0]
    made = tmp_path / "r"
    assert not any((made / f).exists() for f in ("fits.json", "spring.json", "spring.png"))
