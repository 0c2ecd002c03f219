"""diagnosis.json (docs/files.md section 4), the extended model.toml, and the verdict in plain words."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from jumpvision.diagnosis.diagnose import Diagnosis
from jumpvision.diagnosis.fitting import Fit
from jumpvision.diagnosis.jumper.jumper import Jumper
from jumpvision.diagnosis.jumper.jumps import is_common
from jumpvision.diagnosis.naming import Explanation, Naming, likely
from jumpvision.diagnosis.noise.learning import Learned
from jumpvision.diagnosis.proposing import Gain
from jumpvision.mechanisms.parameters import MECHANISMS, ModelParameters
from jumpvision.physics.model import ROBOT

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
                **c.labels,
                "phase_of_jump": c.part,
                "mean_residual_m": c.mean_residual,
                "z_score": c.z_score,
                "p_value": c.p_value,
                "samples": c.n,
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
            if best
            else {"terms": list(system.model.terms), "parameters": values(d.baseline, system)}
        ),
        "gain": gain_of(d.gain) if best and d.gain else None,
        "extrapolation": {k: gain_of(g) for k, g in (d.extrapolation or {}).items()} if best else {},
        "next_experiment": proposal(d),
    }


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
        {
            "quantity": p.name,
            "declared": p.start,
            "stated_sigma": p.sigma,
            "value": fit.named[p.name],
            "sigma": fit.sigma(p.name),
            "unit": p.unit,
        }
        for p in fit.parameters
        if is_common(p.name)
    ]


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


PLAIN = {  # what a model lacks, by mechanism
    "linear_penetration": "a resistance in proportion to depth",
    "two_resistance": "a resistance that bends with depth",
    "rft_cone": "the resistance of a growing cone",
    "inertial_drag": "the drag of the grains that are pushed aside",
    "depth_drag": "the drag of grains that join the cone",
    "added_mass": "the added mass of the jammed cone",
    "foot_mass": "the right mass of the foot",
    "reintrusion_overshoot": "the extra force on landing in an old hole",
    "stop_go_overshoot": "the extra force after a pause in the sand",
    "compaction": "sand compacted by an earlier footprint",
    "viscous_friction": "viscous friction on the rail",
    "coulomb_friction": "dry friction on the rail",
    "spring_hardening": "the stiffening of the spring",
    "spring_damping": "the right damping of the spring",
    "spring_stiffness": "the right stiffness of the spring",
    "payload": "the right mass on the motor",
    "tilt": "the right gravity along the rail (a tilt)",
    "landing_loss": "the loss at touchdown",
    "motor_lag": "the lag of the motor",
    "camera_scale": "the right scale of the camera",
    "time_offset": "the right clock of the camera",
}


def sentence(data: Mapping[str, Any]) -> str:
    """The verdict in plain words."""
    if data["verdict"] == "adequate":
        return f"The simulation agrees with the measured jumps within their noise (p = {data['p_value']:.2g})."
    rows = data["heights"]
    by_kind: dict[str, list[float]] = {}
    for h in rows:
        by_kind.setdefault(str(h["kind"]), []).append(h["simulated_m"] - h["measured_m"])
    means = {k: (float(np.nanmean(v)), float(np.nanstd(v) / math.sqrt(len(v)))) for k, v in by_kind.items()}
    kind, (mean, error) = max(means.items(), key=lambda x: abs(x[1][0]))
    over = "over-predicts" if mean > 0 else "under-predicts"
    text = f"The simulation {over} {kind.replace('_', ' ')} jumps by {1e3 * abs(mean):.1f} ± {1e3 * error:.1f} mm"
    if not data["named"]:
        text += ", and no mechanism of the vocabulary explains all that it gets wrong"
        if near := data["closest"]:
            text += f"; the closest, {words(near['mechanisms'])}, "
            text += f"brings the held-out track error down {near['gain']['ratio']:.1f}x" if near["gain"] else "helps"
            text += f" and leaves {1e3 * near['rmse_track_m']:.2g} mm, beyond the noise"
        return text + generic(data, "would") + "."
    causes = " and ".join(PLAIN[m] for m in data["named"])
    text += f" because it lacks {causes}"
    if data["indistinguishable"]:
        twins = "; ".join(" or ".join(words([m]) for m in t) for t in data["indistinguishable"])
        text += f" (the data cannot tell apart: {twins})"
    if data["gain"]:
        it = "it" if len(data["named"]) == 1 else "them"
        text += f"; with {it} the held-out track error falls {data['gain']['ratio']:.3g}x"
    if data["remainder"]:
        text += f"; {100 * data['remainder']:.2g} % of the discrepancy (in chi^2) stays, beyond the noise" + generic(
            data, "describes it"
        )
    return text + "."


def generic(data: Mapping[str, Any], does: str) -> str:
    """What `unexplained` found, in words; "" where it is nothing."""
    left = data["unexplained"]
    if not (left and left["terms"]):
        return ""
    return f"; a force like {' + '.join(left['terms'])} {does} ({left['where']})"


def confirmed(data: Mapping[str, Any]) -> str | None:
    """The measurements by films and tests beside the jumps, in plain words; None where there are none."""
    rows = data["confirmation"]
    bad = [r for r in rows if r["verdict"] == "contradict"]
    if bad:
        told = "; ".join(
            f"{r['quantity']} is {measured(r['by_film'], r['by_film_sigma'])} by {r['source']}, "
            f"{measured(r['by_jumps'], r['by_jumps_sigma'])} by the jumps alone ({abs(r['z']):.1f} sigma apart)"
            for r in bad
        )
        return f"Films and jumps contradict each other: {told}."
    masses = [r for r in rows if r["quantity"] == "added_mass"]
    if "added_mass" not in data["named"] or not masses:
        return None
    row = max(masses, key=lambda r: r["by_film"])
    film, jumps = (measured(1e3 * row[f"by_{k}"], 1e3 * row[f"by_{k}_sigma"]) for k in ("film", "jumps"))
    return (
        f"The jumps alone imply {jumps} g of sand moving with the foot {1e3 * row['depth_m']:.0f} mm deep; "
        f"the grain film {row['experiment']} shows {film} g."
    )


def measured(value: float, sigma: float) -> str:
    """With as many digits as sigma has worth."""
    digits = max(0, -math.floor(math.log10(sigma))) if sigma > 0 else 1
    return f"{value:.{digits}f} ± {sigma:.{digits}f}"


def words(mechanisms: Sequence[str]) -> str:
    return " and ".join(m.replace("_", " ") for m in mechanisms)
