"""Hidden effects: what can be hidden, the step of the campaigns, how a diagnosis is scored, the game on disk."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from jumpvision.base.schema import InputError
from jumpvision.cli import main
from jumpvision.experiment.inputs.experiment import open_campaign
from jumpvision.jumper.mechanisms.registry import MECHANISMS as VOCABULARY
from jumpvision.laboratory import blind, game
from jumpvision.laboratory.jumper import AT_THE_CAMERA, MECHANISMS, OUTSIDE


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


def test_the_step_of_the_campaigns_is_fine_enough():
    """Rod tracks with dt = 1e-5 against 2e-6 s: off by less than a fifth of the smallest noise."""
    s = shorter(blind.draw(rng(4), hidden=("added_mass",), strength=0.7, nuisance=QUIET), 5)
    coarse, fine = (blind.campaign(s, rng(5), dt=dt) for dt in (blind.DT, 2e-6))
    for a, b in zip(coarse, fine):
        assert np.sqrt(np.mean((a.track["height_m"] - b.track["height_m"]) ** 2)) < 1e-5


def test_same_seed_same_campaign_and_a_lag_hides_the_encoder():
    a, b = (blind.campaign(shorter(blind.draw(rng(10), hidden=("motor_lag",)), 12), rng(11)) for _ in range(2))
    np.testing.assert_array_equal(a[1].track["height_m"], b[1].track["height_m"])
    assert a[0].motor is None
    assert blind.campaign(shorter(blind.draw(rng(10), hidden=("payload",)), 23), rng(1))[0].motor is not None


# ------------------------------------------------------------------------------------------------------------ the game
def diagnosis(verdict="discrepant", named=(), twins=(), causes=(), status="complete") -> dict:
    return {"verdict": verdict, "named": list(named), "indistinguishable": [list(t) for t in twins],
            "causes": list(causes), "status": status}  # fmt: skip


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
