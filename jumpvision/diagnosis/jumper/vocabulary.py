"""The mechanisms a jumper's model may lack, as candidates."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

from jumpvision.diagnosis.system import Candidate, Parameter
from jumpvision.mechanisms.record import Body, Mechanism
from jumpvision.mechanisms.registry import MECHANISMS, acting
from jumpvision.physics.model import Model


def candidates(
    model: Model, *, command_drives: bool, priors: Mapping[str, float] | None = None
) -> dict[str, Candidate]:
    """Every mechanism of the model's ground that is not in it, the static forces last: each in place of its own.

    command_drives: the command, not the encoder, drives the model (else there is no `motor_lag`).
    priors: standard uncertainties of shape parameters that the model's author gave.
    """
    statics = acting(Body.STATIC)
    return {
        m.name: _candidate(m, model, priors or {})
        for m in [*(m for m in MECHANISMS.values() if m not in statics), *statics]
        if model.ground in m.grounds and m.name not in model.terms and m.possible(model, command_drives)
    }


def _candidate(m: Mechanism, model: Model, sigma: Mapping[str, float]) -> Candidate:
    parameters, grids = [], []
    for p in m.parameters:
        if p.name not in m.assumed:
            q = p.prior(model)
            spread = sigma.get(p.name, q.sigma) if math.isfinite(q.sigma) else q.sigma
            parameters.append(Parameter(p.name, q.start, q.low, q.high, q.scale, spread, p.unit, q.log))
            grids.append(q.grid or (q.start,))
    if m.acts_on is Body.STATIC:
        own = model.acting(Body.STATIC)[0]
        drops = tuple(sorted(set(own.names) - set(m.names)))
        return Candidate(tuple(parameters), replaces=own.name, drops=drops)
    shapes = tuple(itertools.product(*grids[1:]))
    return Candidate(tuple(parameters), null=parameters[0].start, shapes=shapes, goes_with=m.goes_with)
