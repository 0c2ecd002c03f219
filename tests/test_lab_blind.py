"""Hidden effects: what is drawn, what the campaigns show of it, and how a diagnosis is scored. About 12 s."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from conftest import later

from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.experiment.inputs.experiment import open_campaign
from jumpvision.jumper.mechanisms.registry import MECHANISMS as VOCABULARY
from jumpvision.laboratory import blind, game
from jumpvision.laboratory.jumper import AT_THE_CAMERA, MECHANISMS, OUTSIDE, truth_of


def rng(seed: int = 1) -> np.random.Generator:
    return np.random.default_rng(seed)


QUIET = blind.Nuisance(noise=1e-12, rho=0.0, step=0.0)


def shorter(setting: blind.Setting, step: int) -> blind.Setting:
    return replace(setting, protocol=replace(setting.protocol, jumps=setting.protocol.jumps[::step]))


def test_every_cause_of_the_vocabulary_can_be_hidden():
    """All but linear_penetration, which the two-resistance model holds (k1 = k2): the model would be adequate."""
    can = {h for g in ("hard", "granular") for h in blind.choices(g)}
    assert can == set(VOCABULARY) - {"linear_penetration"}
    assert set(MECHANISMS) | set(AT_THE_CAMERA) == set(VOCABULARY)
    assert not set(OUTSIDE) & set(VOCABULARY)
    assert set(blind.choices("hard", outside=True)) <= set(OUTSIDE) == set(blind.choices("granular", outside=True))
    for ground in ("hard", "granular"):
        assert all(ground in VOCABULARY[h].grounds for h in blind.choices(ground))


@pytest.mark.parametrize("ground", ["hard", "granular"])
def test_drawn_shares_strengths_and_nuisance_are_as_said(ground):
    """300 draws: a share p to 3.5 sqrt(p (1 - p)/300)."""
    a = rng(2)
    drawn = [blind.draw(a, ground=ground) for _ in range(300)]
    for share, is_it in (
        (0.15, lambda s: not s.hidden),
        (0.55, lambda s: len(s.hidden) == 1 and not s.outside),
        (0.20, lambda s: len(s.hidden) == 2),
        (0.10, lambda s: s.outside),
    ):
        assert abs(np.mean([is_it(s) for s in drawn]) - share) < 3.5 * np.sqrt(share * (1 - share) / 300)
    noise = np.array([s.nuisance.noise for s in drawn])
    assert 5e-5 <= noise.min() < 6e-5 and 4.5e-4 < noise.max() <= 5e-4
    rho = np.array([s.nuisance.rho for s in drawn])
    assert (rho == 0).any() and 0.6 < rho.max() < 0.7
    levels = np.concatenate([s.strength for s in drawn if s.hidden])
    assert levels.min() < 0.05 and levels.max() > 0.95
    for s in drawn:  # the declared model never holds what is hidden
        assert not set(s.hidden) & set(s.protocol.model.get("terms", ()))
        assert set(s.hidden) <= set(s.protocol.terms)


def test_declared_values_are_wrong_within_what_they_say():
    """True minus declared stiffness over its sigma: unit spread, 200 draws to 3.5/sqrt(400) = 0.18."""
    a = rng(3)
    pulls = []
    for _ in range(200):
        p = blind.draw(a, hidden=()).protocol
        pulls.append(p.parameters["dk"] / p.robot_sigma["spring_stiffness"])
        assert abs(p.parameters["k1"] - p.model["k1"]) < 4.5 * p.model["sigma"]["k1"]
    assert np.std(pulls) == pytest.approx(1.0, abs=0.18)


def test_the_step_of_the_campaigns_is_fine_enough():
    """Rod tracks with dt = 1e-5 against 2e-6 s: off by less than a fifth of the smallest noise."""
    s = shorter(blind.draw(rng(4), hidden=("added_mass",), strength=0.7, nuisance=QUIET), 5)
    coarse, fine = (blind.campaign(s, rng(5), dt=dt) for dt in (blind.DT, 2e-6))
    for a, b in zip(coarse, fine):
        assert np.sqrt(np.mean((a.track["height_m"] - b.track["height_m"]) ** 2)) < 1e-5


@pytest.mark.parametrize("ground", ["hard", *later("granular")])
def test_every_effect_shows_in_the_tracks(ground):
    """At full strength the rod moves by more than the largest noise's error of a mean over a track (0.5/sqrt(360) mm)
    in some jump; at strength 0 by less than a quarter of that at strength 1."""
    for name in blind.choices(ground) + blind.choices(ground, outside=True):
        if name in ("two_resistance", "rft_cone"):
            continue  # the static force itself: nothing is left without it
        moved = []
        for strength in (0.0, 1.0):
            s = shorter(blind.draw(rng(6), ground=ground, hidden=(name,), strength=strength, nuisance=QUIET), 12)
            p = s.protocol
            plain = replace(p, terms=tuple(t for t in p.terms if t != name))
            if name in AT_THE_CAMERA:
                off = {"scale": 1.0} if name == "camera_scale" else {"dt": 0.0}
                plain = replace(p, parameters={**p.parameters, **off})
            with_it, without = (blind.campaign(replace(s, protocol=q), rng(7), dt=2e-5) for q in (p, plain))
            moved.append(max(np.std(a.track["height_m"] - b.track["height_m"]) for a, b in zip(with_it, without)))
        assert moved[1] > 5e-4 / np.sqrt(360), name
        assert moved[0] < 0.35 * moved[1], name


def test_noise_is_what_was_asked():
    """Marginal spread and neighbour correlation of 24 x 361 samples, n (1 - rho)/(1 + rho) = 2900 of them independent:
    the spread to 3.5/sqrt(2 x 2900) = 5 %, rho to 3.5 sqrt((1 - rho^2)/8600) = 0.033."""
    s = blind.draw(rng(8), hidden=(), nuisance=blind.Nuisance(noise=2e-4, rho=0.5, step=0.0))
    still = replace(s.protocol, records=replace(s.protocol.records, rod_track=replace(s.nuisance, noise=0.0)))
    noisy, clean = (blind.campaign(replace(s, protocol=q), rng(9), dt=5e-5) for q in (s.protocol, still))
    error = [a.track["height_m"] - b.track["height_m"] for a, b in zip(noisy, clean)]
    assert np.sqrt(np.mean([e @ e / len(e) for e in error])) == pytest.approx(2e-4, rel=0.05)
    neighbours = np.mean([np.mean(e[1:] * e[:-1]) for e in error]) / np.mean([np.mean(e * e) for e in error])
    assert neighbours == pytest.approx(0.5, abs=0.035)
    assert noisy[0].track["sigma_m"] == pytest.approx(2e-4)


def test_same_seed_same_campaign_and_a_lag_hides_the_encoder():
    a, b = (blind.campaign(shorter(blind.draw(rng(10), hidden=("motor_lag",)), 12), rng(11)) for _ in range(2))
    np.testing.assert_array_equal(a[1].track["height_m"], b[1].track["height_m"])
    assert a[0].motor is None
    assert blind.campaign(shorter(blind.draw(rng(10), hidden=("payload",)), 23), rng(1))[0].motor is not None


def test_impossible_draws_are_refused():
    with pytest.raises(ValueError, match="does not act on hard ground"):
        blind.draw(rng(), ground="hard", hidden=("added_mass",))
    with pytest.raises(ValueError, match="cannot act together"):
        blind.draw(rng(), hidden=("two_resistance", "rft_cone"))


def test_drawn_pairs_can_act_together():
    """A cone with little drag would create energy, which the laboratory refuses: such draws are drawn again."""
    a = rng(12)
    for _ in range(60):
        p = blind.draw(a, hidden=("added_mass", "inertial_drag")).protocol
        truth_of(p.robot, p.terms, p.parameters, ground="granular", bed_density=570.0)


# ------------------------------------------------------------------------------------------------------------ the game
def diagnosis(verdict="discrepant", named=(), twins=(), causes=(), status="complete") -> dict:
    return {"verdict": verdict, "named": list(named), "indistinguishable": [list(t) for t in twins],
            "causes": list(causes), "status": status}  # fmt: skip


@pytest.mark.parametrize(
    ("found", "hidden", "outcome"),
    [
        (diagnosis("adequate"), (), "right"),
        (diagnosis(named=["tilt"]), (), "false alarm"),
        (diagnosis(), (), "false alarm"),
        (diagnosis("adequate"), ("tilt",), "missed"),
        (diagnosis(status="undetermined"), ("tilt",), "missed"),
        (diagnosis(named=["tilt"]), ("tilt",), "right"),
        (diagnosis(named=["payload"]), ("tilt",), "wrong"),
        (diagnosis(named=["camera_scale"], twins=[["tilt", "camera_scale"]]), ("tilt",), "twin"),
        (diagnosis(named=["tilt"]), ("tilt", "payload"), "partly"),
        (diagnosis(named=["tilt", "payload"]), ("payload", "tilt"), "right"),
        (diagnosis(named=["tilt", "payload"]), ("payload",), "wrong"),
        (diagnosis(named=["payload", "camera_scale"], twins=[["tilt", "camera_scale"]]), ("payload", "tilt"), "twin"),
        (diagnosis(status="undetermined"), ("depth_rate_drag",), "right"),
        (diagnosis(named=["inertial_drag"]), ("depth_rate_drag",), "wrong"),
        (diagnosis("adequate"), ("depth_rate_drag",), "missed"),
    ],
)
def test_scores(found, hidden, outcome):
    assert game.score(found, hidden, {})["outcome"] == outcome


def test_score_of_parameters():
    cause = {"mechanism": "tilt", "parameters": {"dg": {"value": 0.21, "low": 0.18, "high": 0.24, "unit": "m/s^2"}}}
    found = diagnosis(named=["tilt"], causes=[cause])
    told = game.score(found, ("tilt",), {"dg": 0.2})
    assert told["error of dg"] == pytest.approx(0.01)
    assert told["interval of dg covers"] is True
    cause["parameters"]["dg"]["high"] = cause["parameters"]["dg"]["low"] + 0.01
    assert game.score(found, ("tilt",), {"dg": 0.2})["interval of dg covers"] is False
    assert "error of dg" not in game.score(found, ("payload",), {"dg": 0.2})


def test_the_game_on_disk(tmp_path, monkeypatch, capsys):
    """The campaign is valid and holds no truth, its model is what was drawn; the answer opens and is scored."""
    drawn = blind.draw(rng(), hidden=("payload",), strength=0.5)
    monkeypatch.setattr(game, "draw", lambda a, ground: shorter(drawn, 8))
    out = tmp_path / "game"
    assert main(["synth", "blind", str(out), "--seed", "5"]) == 0
    assert "experiments: 3 done" in capsys.readouterr().err
    campaign = open_campaign(out)
    assert len(campaign.experiments) == 3
    section = campaign.experiments[0].sections["model"]
    assert list(section.terms) == drawn.protocol.model["terms"] and "payload" not in section.terms
    assert section.fit["alpha"] == (0.0, 300.0)
    assert not list(out.rglob("*truth*"))
    sealed = game.sealed_file(out)
    assert sealed.parent == tmp_path and b"payload" not in sealed.read_bytes()
    told = game.reveal(out)
    assert told["hidden"] == "payload" and "no " in told["outcome"]
    assert told["true dm"] == pytest.approx(drawn.parameters["dm"], rel=1e-4) and told["strength (0-1)"] == "0.50"
    results = tmp_path / "results" / "game"
    results.mkdir(parents=True)
    (results / "diagnosis.json").write_text(json.dumps(diagnosis(named=["payload"])))
    assert game.reveal(out)["outcome"] == "right"
    assert main(["synth", "reveal", str(out)]) == 0
    assert "right" in capsys.readouterr().out
    with pytest.raises(InputError, match="exists"):
        game.write_blind(out, seed=5)
    with pytest.raises(InputError, match="unknown ground"):
        game.write_blind(tmp_path / "other", seed=5, ground="ice")
    with pytest.raises(InputError, match="no sealed answer"):
        game.reveal(tmp_path / "elsewhere")
