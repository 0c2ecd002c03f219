"""diagnosis.json (CONTRACT.md section 4) and the extended model.toml."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..diagnosis.apparatus import is_common
from ..diagnosis.diagnose import Diagnosis
from ..diagnosis.fitting import Fit
from ..diagnosis.gain import Gain
from ..diagnosis.jumper import Jumper
from ..diagnosis.learning import Learned
from ..diagnosis.naming import Explanation, Naming, likely
from ..physics.model import ROBOT
from ..physics.parameters import MECHANISMS, ModelParameters

Z90 = 1.645  # half width of a 90 % interval, in sigmas
TOP = 12  # cells of "where"


def document(d: Diagnosis, system: Jumper, heights: Sequence[Mapping[str, Any]], unexplained: Any) -> dict[str, Any]:
    """diagnosis.json. heights: measured and simulated heights of every jump (see `heights_of`)."""
    n = d.naming
    best = n.best.fit if n and n.named else None
    return {
        "schema": 1,
        "verdict": "adequate" if d.adequate else "discrepant",
        "p_value": d.detection.p_value,
        "baseline": {
            "terms": list(system.model.terms),
            "parameters": values(d.baseline, system),
            "rmse_height_m": rms([h["simulated_m"] - h["measured_m"] for h in heights]),
            "rmse_track_m": rmse_track(d.baseline, system),
            "chi2_per_dof": d.detection.chi2_per_dof,
        },
        "where": [
            {
                **c.labels, "phase_of_jump": c.part, "mean_residual_m": c.mean_residual, "z_score": c.z_score,
                "p_value": c.p_value, "samples": c.n,
            }
            for c in d.where[:TOP]
        ],
        "heights": [dict(h) for h in heights],
        "causes": causes(n) if n else [],
        "named": list(n.named) if n else [],
        "remainder": n.remainder if n and n.named else None,
        "indistinguishable": [list(t) for t in n.twins] if n else [],
        "closest": closest(d, system) if n and not n.named else None,
        "unexplained": unexplained,
        "extended_model": (
            {"terms": list(system.build(best.mechanisms, best.named).terms), "parameters": values(best, system)}
            if best else {"terms": list(system.model.terms), "parameters": values(d.baseline, system)}
        ),
        "gain": gain_of(d.gain) if best and d.gain else None,
        "extrapolation": {k: gain_of(g) for k, g in (d.extrapolation or {}).items()} if best else {},
        "next_experiment": proposal(d),
    }  # fmt: skip


HEAVY = 30.0  # degrees of freedom from which Student's t is as good as normal
LOOSE = 0.5  # chi^2 per degree of freedom below which a model agrees better than noise lets it


def noise_of(learned: Learned, d: Diagnosis) -> dict[str, Any]:
    """What is known of the noise and from where, with everything about it that a reader must be warned of."""
    n = learned.noise
    sources = {
        k: None if s is None else {"sigma_m": s.sigma, "log_sigma": s.log_sigma, "n": s.n}
        for k, s in ((k, learned.sources.get(k)) for k in ("stated", "rest", "flight", "repeats"))
    }
    names = [j.name for j in learned.system.jumps]
    unlike = {k: float(f) for k, f in zip(names, learned.tracks) if abs(math.log(f)) > math.log(1.5)}
    return {
        "sigma_m": learned.sigma,
        "correlation": n.rho,
        "tails": None if learned.tails > HEAVY else {"student_degrees": learned.tails},
        "drift_m": n.drift,
        "samples": n.n,
        "sources": sources,
        "scatter": {k: s for k, s in learned.scatter.items() if s > 0},
        "tracks": unlike,
        "outliers": [{"experiment": e, "time_s": t, "sigmas": z} for e, t, z in learned.outliers],
        "warnings": [*learned.warnings, *agreement(d), *unrepeated(learned, d)],
    }


def agreement(d: Diagnosis) -> list[str]:
    """Warnings where the best model agrees with the data too well, or not as well as the noise says."""
    best = d.naming.best if d.naming and d.naming.named else None
    test = best.detection if best else d.detection
    if test is None:
        return []
    if test.chi2_per_dof < LOOSE:
        return [
            f"chi^2 per degree of freedom of the best model is {test.chi2_per_dof:.2g}: the noise is taken too large, "
            "and effects may hide in it; look at where it was learned (`sources`)"
        ]
    if best and test.discrepant:
        return [
            f"chi^2 per degree of freedom of the best model is {test.chi2_per_dof:.3g} (p = {test.p_value:.2g}): more "
            "is left than the noise explains"
        ]
    return []


def unrepeated(learned: Learned, d: Diagnosis) -> list[str]:
    """The warning that a misfit may be what differs from trial to trial, where no trial was repeated."""
    if d.adequate or learned.sources.get("repeats"):
        return []
    return [
        "no condition was recorded twice: how much its trials would differ is not known, and a part of the misfit may "
        "be just that; repeat two or three conditions (same `group`)"
    ]


def common_of(d: Diagnosis) -> list[dict[str, Any]]:
    """What an apparatus has wrong in common: as stated before, and as the jumps have it."""
    fit = d.naming.best.fit if d.naming and d.naming.named else d.baseline
    return [
        {"quantity": p.name, "declared": p.start, "stated_sigma": p.sigma, "value": fit.named[p.name],
         "sigma": fit.sigma(p.name), "unit": p.unit}
        for p in fit.parameters if is_common(p.name)
    ]  # fmt: skip


def closest(d: Diagnosis, system: Jumper) -> dict[str, Any] | None:
    """The likeliest model where none passes the test; None where that is the baseline."""
    assert d.naming
    e = d.naming.best
    if not e.mechanisms:
        return None
    return {
        "mechanisms": list(e.mechanisms),
        "probability": e.probability,
        "parameters": {name: value for m in e.mechanisms for name, value in parameters_of(e, m).items()},
        "rmse_track_m": rmse_track(e.fit, system),
        "gain": gain_of(d.gain) if d.gain else None,
    }


def causes(n: Naming) -> list[dict[str, Any]]:
    """Mechanisms by probability, each with the parameters of the likeliest model that has it."""
    out = []
    for mechanism in likely(n.tried)[:8]:
        e = next(e for e in n.tried if mechanism in e.mechanisms)
        out.append(
            {
                "mechanism": mechanism,
                "with": [m for m in e.mechanisms if m != mechanism],
                "probability": n.probability(mechanism),
                "delta_score": e.delta_score,
                "parameters": parameters_of(e, mechanism),
            }
        )
    return out


def parameters_of(e: Explanation, mechanism: str) -> dict[str, dict[str, Any]]:
    """{name: {value, low, high, unit}} of a mechanism, the ends of a 90 % interval within its range."""
    out = {}
    for p in e.fit.parameters:
        if p.name in MECHANISMS[mechanism].parameters:
            value, half = e.fit.named[p.name], Z90 * e.fit.sigma(p.name)
            ends = {"low": max(value - half, p.low), "high": min(value + half, p.high)}
            out[p.name] = {"value": value, **ends, "unit": p.unit or "1"}
    return out


def values(fit: Fit, system: Jumper) -> dict[str, float]:
    """Every parameter that the model with this fit's mechanisms needs, and what of the robot was re-fitted."""
    model = system.build(fit.mechanisms, fit.named)
    names = dict.fromkeys(n for t in model.terms for n in MECHANISMS[t].parameters)
    out = {n: float(getattr(model.parameters, n)) for n in names}
    return out | {n: v for n, v in fit.named.items() if n in ROBOT}


def rmse_track(fit: Fit, system: Jumper) -> float:
    """Root mean square of measured minus predicted height over all tracks [m]."""
    predicted = system.predict(fit.mechanisms, fit.named, range(len(system.observations)))
    return rms(np.concatenate([o.y - y for o, y in zip(system.observations, predicted)]))


def rms(x: Any) -> float:
    x = np.asarray(x, float)
    x = x[np.isfinite(x)]
    return float(np.sqrt(np.mean(x * x))) if x.size else math.nan


def gain_of(g: Gain) -> dict[str, Any]:
    return {
        "holdout": list(g.held_out),
        "rmse_height_before_m": g.height_before,
        "rmse_height_after_m": g.height_after,
        "rmse_track_before_m": g.track_before,
        "rmse_track_after_m": g.track_after,
        "ratio": g.ratio,
        "ratio_ci95": list(g.ratio_ci95),
        "claimed": g.claimed,
    }


def proposal(d: Diagnosis) -> dict[str, Any] | None:
    p = d.next_experiment
    if p is None:
        return None
    return {**p.labels, "separates": list(p.separates), "expected_log10_odds": p.expected_log10_odds}


def model_toml(fit: Fit, system: Jumper, comment: str) -> str:
    """The model as a file that `--model` takes: terms, parameters, their uncertainties; a re-fitted robot beside it."""
    model = system.build(fit.mechanisms, fit.named)
    robot = {n: v for n, v in fit.named.items() if n in ROBOT}
    own = {n: v for n, v in values(fit, system).items() if n not in ROBOT}
    sigma = {p.name: fit.sigma(p.name) for p in fit.parameters}
    fields = ModelParameters.__dataclass_fields__
    lines = [f"# {comment}", "[model]", "terms = " + json.dumps(list(model.terms))]
    lines += [
        f"{n} = {v!r}  # {fields[n].metadata['unit'] or '1'}: {fields[n].metadata['meaning']}" for n, v in own.items()
    ]
    lines += ["", "[model.sigma]  # standard uncertainties of the fit"]
    lines += [f"{n} = {sigma[n]!r}" for n in own if sigma.get(n, 0.0) > 0.0]
    if robot:
        lines += ["", "[robot]  # re-fitted"] + [f"{n} = {v!r}" for n, v in robot.items()]
        lines += ["", "[robot.sigma]"] + [f"{n} = {sigma[n]!r}" for n in robot]
    return "\n".join(lines) + "\n"
