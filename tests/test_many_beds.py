"""Campaigns whose experiments have models of their own: other beds, and motors of which some are logged."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.diagnosis import jumps_of
from jumpvision.base.schema import InputError
from jumpvision.diagnosis.diagnose import diagnose
from jumpvision.diagnosis.jumper.jumper import Jumper
from jumpvision.diagnosis.noise.learning import learn_noise
from jumpvision.lab.blind import Nuisance, campaign, draw

QUIET = Nuisance(5e-5, 0.0, 0.0)


@pytest.mark.long
def test_a_cause_is_named_over_two_beds_of_their_own_stiffness():
    """Dry friction of one size on two beds (k1 by [model], 1,900 to 2,400 N/m); each declared k1 is the true one."""
    jumps = []
    for seed in (41, 44):
        rng = np.random.default_rng(seed)
        hidden = draw(rng, ground="granular", hidden=("coulomb_friction",), strength=0.7, nuisance=QUIET, jumps="few")
        true = {**hidden.protocol.parameters, "alpha": 60.0, "dk": 0.0}
        hidden = replace(hidden, protocol=replace(hidden.protocol, parameters=true))
        found, fit, _ = jumps_of(hidden, campaign(hidden, rng))
        own = {n: true[n] for n in ("k1", "k2", "delta")}
        for j in found:
            model = replace(j.model, parameters=replace(j.model.parameters, **own))
            jumps.append(replace(j, model=model, name=f"{seed} {j.name}"))
    system = Jumper(jumps, fit, {})
    assert system.differing == ("k1", "k2")
    learned = learn_noise(system)
    stops = [j.stop for j in jumps]
    d = diagnose(learned.system, learned.noise, np.random.default_rng(1), scatter=learned.scatter, stops=stops)
    assert d.naming is not None and d.naming.named == ("coulomb_friction",) and d.naming.status == "complete"
    f = d.naming.best.fit
    assert f.named["F_c"] == pytest.approx(hidden.parameters["F_c"], abs=4 * f.sigma("F_c"))
    assert f.named["alpha"] == pytest.approx(60.0, abs=4 * f.sigma("alpha"))
    with pytest.raises(InputError, match=r"k1: 2 values in one campaign.*one for all"):
        Jumper(jumps, fit, {"k1": 20.0})


def test_a_lag_of_the_motor_acts_only_where_no_log_says_how_it_moved():
    rng = np.random.default_rng(43)
    setting = draw(rng, ground="hard", hidden=("motor_lag",), strength=0.7, nuisance=QUIET, jumps="few")
    jumps, fit, priors = jumps_of(setting, campaign(setting, rng))
    assert all(j.law for j in jumps)
    mixed = Jumper([replace(j, law=k % 2 == 0) for k, j in enumerate(jumps)], fit, priors)
    assert "motor_lag" in mixed.candidates
    values = {p.name: p.start for p in mixed.baseline}
    every = range(len(jumps))
    plain = mixed.predict((), values, every)
    lagging = mixed.predict(("motor_lag",), {**values, "tau": 5e-3}, every)
    moved = [float(np.max(np.abs(a - b))) for a, b in zip(plain, lagging)]
    assert all((m > 1e-4) == (k % 2 == 0) for k, m in enumerate(moved)), moved
    assert "motor_lag" not in Jumper([replace(j, law=False) for j in jumps], fit, priors).candidates
