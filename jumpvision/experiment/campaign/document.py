"""From findings to diagnosis.json (docs/files.md section 4), model.toml and the verdict in plain words."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from jumpvision.engine.diagnose import Findings
from jumpvision.engine.fitting import Fit
from jumpvision.engine.naming import Explanation
from jumpvision.engine.unexplained import Unexplained
from jumpvision.engine.worth.gain import apex
from jumpvision.experiment import files
from jumpvision.experiment.results import findings as record
from jumpvision.experiment.results.diagnosis import Diagnosis
from jumpvision.jumper.mechanisms.own import bare
from jumpvision.jumper.mechanisms.registry import MECHANISMS, ModelParameters
from jumpvision.jumper.physics.model import ROBOT, Model
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.jumps import called, is_common
from jumpvision.jumper.question.learning import Learned

from .discovered import Law, discovered_of, law_toml
from .findings import Teller, agreement, interval, rms, told


def document(
    d: Findings,
    learned: Learned,
    unexplained: record.Unexplained | None,
    *,
    energy: Sequence[record.Energies] = (),
    confirmation: Sequence[record.Confirmation] = (),
    without_films: record.WithoutFilms | None = None,
    law: Law | None = None,
) -> Diagnosis:
    """The record of a campaign's findings. unexplained: what generic forces say of the rest, None where it is nil.

    law: of no vocabulary, where one was found: the extended model has it.
    """
    system = law.system if law else learned.system
    best = law.fit if law else told(d)
    heights = heights_of(d, system, best)
    out = teller(system).record(d, best, noise_of(learned, d))
    out = replace(
        out,
        baseline=replace(out.baseline, rmse_height_m=rms([h.simulated_m - h.measured_m for h in heights])),
        heights=heights,
        unexplained=unexplained,
        next_experiment=proposal(d),
        common=common_of(told(d)),
        energy=tuple(energy),
        confirmation=tuple(confirmation),
        without_films=without_films,
    )
    if law:
        out = replace(
            out,
            named=law.fit.mechanisms[:-1],
            status=law.status,
            left_over=record.LeftOver(law.found.detection.chi2_per_dof, 1.0 - law.found.r2, 1.0),
            indistinguishable=(),
            closest=None,
            discovered=discovered_of(law),
        )
    lacks = {m.name: m.lacks for m in system.model.own}
    return replace(out, sentence=sentence(out, lacks), confirmed=confirmed(out))


def teller(system: Jumper) -> Teller:
    """How models of jumps are told."""

    def model(fit: Fit) -> record.Model:
        built = [system.build(fit.mechanisms, fit.named, g) for g in system.bases]
        return record.Model(tuple(dict.fromkeys(t for m in built for t in m.terms)), values(fit, system))

    return Teller(system, model, lambda e, mechanism: parameters_of(e, mechanism, system))


def heights_of(d: Findings, system: Jumper, best: Fit) -> tuple[record.Height, ...]:
    """Measured height of every jump beside the re-fitted baseline's and the extended model's [m]."""
    every = range(len(system.observations))
    before = system.predict(d.baseline.mechanisms, d.baseline.named, every)
    after = system.predict(best.mechanisms, best.named, every) if best is not d.baseline else [None] * len(before)
    out = []
    for jump, o, y, z in zip(system.jumps, system.observations, before, after):
        frequency, delay, phi = (o.labels.get(k) for k in ("frequency", "delay", "volume_fraction"))
        tops = [math.nan if x is None else apex(o.t, x, jump.stop) for x in (o.y, y, z)]
        out.append(record.Height(o.name, str(o.labels.get("kind")), frequency, delay, phi, *tops))
    return tuple(out)


def unexplained_of(found: Unexplained | None) -> record.Unexplained:
    """Generic forces as they are told."""
    if found is None:
        return record.Unexplained()
    each = zip(found.terms, found.coefficients, found.sigmas, found.units)
    strengths = {t: record.Coefficient(c, s, u) for t, c, s, u in each}
    return record.Unexplained(found.terms, strengths, found.r2, found.where, found.beside, found.stability)


HEAVY = 30.0  # degrees of freedom from which Student's t is as good as normal


def noise_of(learned: Learned, d: Findings) -> record.Noise:
    """What is known of the noise and from where, with everything about it that a reader must be warned of."""
    n = learned.noise
    sources = {k: learned.sources.get(k) for k in ("stated", "rest", "flight", "repeats")}
    names = [j.name for j in learned.system.jumps]
    return record.Noise(
        sigma_m=learned.sigma,
        correlation=n.rho,
        tails=None if learned.tails > HEAVY else record.Tails(learned.tails),
        drift_m=n.drift,
        samples=n.n,
        sources={k: record.NoiseSource(s.sigma, s.log_sigma, s.n) if s else None for k, s in sources.items()},
        scatter={k: s for k, s in learned.scatter.items() if s > 0},
        tracks={k: float(f) for k, f in zip(names, learned.tracks) if abs(math.log(f)) > math.log(1.5)},
        outliers=tuple(record.Outlier(*x) for x in learned.outliers),
        warnings=(*learned.warnings, *agreement(d), *unrepeated(learned, d)),
    )


def unrepeated(learned: Learned, d: Findings) -> list[str]:
    """The warning that a misfit may be what differs from trial to trial, where no trial was repeated."""
    if d.adequate or learned.sources.get("repeats"):
        return []
    return [
        "no condition was recorded twice: how much its trials would differ is not known, and a part of the misfit may "
        "be just that; repeat two or three conditions (same `group`)"
    ]


def common_of(fit: Fit) -> tuple[record.CommonError, ...]:
    """What an apparatus has wrong in common: as stated before, and as the jumps have it."""
    return tuple(
        record.CommonError(p.name, p.start, p.sigma, fit.named[p.name], fit.sigma(p.name), p.unit)
        for p in fit.parameters
        if is_common(p.name)
    )


def parameters_of(e: Explanation, mechanism: str, system: Jumper) -> dict[str, record.Parameter]:
    """Parameters of a mechanism by name, the ends of a 90 % interval within its range."""
    out = {}
    for p in e.fit.parameters:
        if p.name in (own := system.model.mechanism(mechanism)).names:
            out[bare(own, p.name) if own.own else p.name] = interval(e.fit, p)
    return out


def values(fit: Fit, system: Jumper) -> dict[str, float]:
    """Every parameter that the models with this fit's mechanisms need, and what of the robot was re-fitted."""
    out: dict[str, float] = {}
    for ground in system.bases:
        out = _needed(system.build(fit.mechanisms, fit.named, ground)) | out
    return out | {n: v for n, v in fit.named.items() if n in ROBOT or of_beds(n, system)}


def of_beds(name: str, system: Jumper) -> bool:
    """Whether a parameter is that of one of several beds, `k1[1]`."""
    return name.split("[")[0] in system.apart


def _needed(model: Model) -> dict[str, float]:
    """Every parameter that a model's terms have."""
    names = dict.fromkeys(n for t in model.terms for n in model.mechanism(t).names)
    return {n: float(getattr(model.parameters, n)) for n in names}


def proposal(d: Findings) -> record.NextExperiment | None:
    """The experiment to be done next."""
    if (p := d.next_experiment) is None:
        return None
    return record.NextExperiment(**p.labels, separates=p.separates, expected_log10_odds=p.expected_log10_odds)


def model_files(fit: Fit, system: Jumper, comment: str) -> dict[str, str]:
    """The model by the name of its file; of a campaign on both grounds the second has its ground in the name."""
    names = [files.MODEL, *(f"model_{g}.toml" for g in list(system.bases)[1:])]
    return {n: model_toml(fit, system, comment, g) for n, g in zip(names, system.bases)}


def model_toml(fit: Fit, system: Jumper, comment: str, ground: str = "") -> str:
    """The model as a file that `--model` takes: terms, parameters, their uncertainties; a re-fitted robot beside it."""
    model = system.build(fit.mechanisms, fit.named, ground)
    robot = {n: v for n, v in fit.named.items() if n in ROBOT}
    laws = [m for m in map(model.mechanism, model.terms) if m.own]
    apart = {*ROBOT, *(n for m in laws for n in m.names)}
    own = {n: v for n, v in _needed(model).items() if n not in apart}
    sigma = {p.name: fit.sigma(p.name) for p in fit.parameters}
    fields = ModelParameters.__dataclass_fields__
    lines = [f"# {comment}"]
    if differ := [n for n in system.differing if n not in robot]:
        first = next(j.name for j in system.jumps if j.model.ground == model.ground)
        lines.append(f"# {', '.join(differ)}: not the same in all experiments; here as in {first}")
    for name, k, x in ((n, k, x) for n, given in system.apart.items() for k, x in enumerate(given)):
        own_name = called(name, k)
        if own_name in sigma:
            lines.append(f"# {name} declared as {x:g}: {fit.named[own_name]!r} +- {sigma[own_name]:.2g}")
        if x == getattr(system.bases[model.ground].parameters, name):
            sigma[name] = sigma.get(own_name, 0.0)
    lines += ["[model]", "terms = " + json.dumps(list(model.terms))]
    lines += [
        f"{n} = {v!r}  # {fields[n].metadata['unit'] or '1'}: {fields[n].metadata['meaning']}" for n, v in own.items()
    ]
    lines += ["", "[model.sigma]  # standard uncertainties of the fit"]
    lines += [f"{n} = {sigma[n]!r}" for n in own if sigma.get(n, 0.0) > 0.0]
    if robot:
        lines += ["", "[robot]  # re-fitted"] + [f"{n} = {v!r}" for n, v in robot.items()]
        lines += ["", "[robot.sigma]"] + [f"{n} = {sigma[n]!r}" for n in robot]
    for m in laws:
        lines += law_toml(m, fit)
    return "\n".join(lines) + "\n"


HEIGHTS_AGREE = 5e-5  # m: a smaller mean error of every kind of jump would read as 0.0 mm


def sentence(d: Diagnosis, lacks: Mapping[str, str] = MappingProxyType({})) -> str:
    """The verdict in plain words. lacks: what the model lacks without each mechanism of the user's own."""
    if d.adequate:
        return f"The simulation agrees with the measured jumps within their noise (p = {d.p_value:.2g})."
    by_kind: dict[str, list[float]] = {}
    for h in d.heights:
        by_kind.setdefault(h.kind, []).append(h.simulated_m - h.measured_m)
    means = {k: (float(np.nanmean(v)), float(np.nanstd(v) / math.sqrt(len(v)))) for k, v in by_kind.items()}
    kind, (mean, error) = max(means.items(), key=lambda x: abs(x[1][0]))
    over = "over-predicts" if mean > 0 else "under-predicts"
    if abs(mean) < HEIGHTS_AGREE:
        text = f"The simulation meets the measured heights to {1e3 * HEIGHTS_AGREE:g} mm but not the tracks"
    else:
        text = f"The simulation {over} {kind.replace('_', ' ')} jumps by {1e3 * abs(mean):.1f} ± {1e3 * error:.1f} mm"
    if not d.named and not (d.discovered or d.closest or d.unexplained):
        return text + f", by so little (p = {d.p_value:.2g}) that no cause is likelier than chance."
    if not d.named:
        text += ", and no mechanism of the vocabulary explains all that it gets wrong"
        if d.discovered:
            return text + law_in_words(d.discovered) + "."
        if near := d.closest:
            text += f"; the closest, {words(near.mechanisms)}, "
            text += f"brings the held-out track error down {near.gain.ratio:.1f}x" if near.gain else "helps"
            text += f" and leaves {1e3 * near.rmse_track_m:.2g} mm, beyond the noise"
        return text + generic(d, "would") + "."
    partly = " in part" if d.status == "partial" else ""
    text += f"{partly} because it lacks {' and '.join(lacks.get(m) or MECHANISMS[m].lacks for m in d.named)}"
    if d.status == "partial" and d.left_over:
        text += (
            f", and {100 * d.left_over.share:.2g} % of the discrepancy (in chi^2) stays beyond the noise, unexplained"
        )
        if (wider := d.left_over.widened) > 1.05:
            text += f" (intervals are {wider:.2g} times wider for it)"
        text += generic(d, "describes it")
    if d.indistinguishable:
        twins = "; ".join(" or ".join(words([m]) for m in t) for t in d.indistinguishable)
        text += f" (the data cannot tell apart: {twins})"
    if d.gain:
        it = "it" if len(d.named) == 1 else "them"
        text += f"; with {it} the held-out track error falls {d.gain.ratio:.3g}x"
    return text + "."


BODIES = {
    "foot": "a force on the intruding foot",
    "foot_mass": "a mass that moves with the foot",
    "carriage": "a force on the carriage",
    "spring": "a force of the spring",
    "film_height": "an error of the filmed height",
    "film_time": "an error of the film's clock",
}


def law_in_words(law: record.Discovered) -> str:
    """What was discovered, as the end of the verdict."""
    free = ", ".join(
        f"{n} = {plus_minus(p.value, p.sigma)}{f' {p.unit}' if p.unit != '1' else ''}"
        for n, p in law.parameters.items()
        if p.sigma > 0.0
    )
    fixed = ", ".join(f"{n} = {p.value:g} {p.unit}" for n, p in law.parameters.items() if p.sigma == 0.0)
    text = f"; {BODIES[law.acts_on]} does: {law.law} with {free}{f' ({fixed})' if fixed else ''}"
    text += f", {100 * law.r2:.3g} % of it"
    if law.ceiling_r2 is not None:
        text += f" (any smooth force of the same position and rate: {100 * law.ceiling_r2:.3g} %)"
    if law.passive is not False:
        return text
    text += ", and it is active: it gives energy to what moves"
    return text + (", as a motor does or a resistance weaker than the model's" if law.part_passive else "")


def generic(d: Diagnosis, does: str) -> str:
    """What `unexplained` found, in words; "" where it is nothing."""
    left = d.unexplained
    if not (left and left.terms):
        return ""
    return f"; a force like {' + '.join(left.terms)} {does} ({left.where})"


def confirmed(d: Diagnosis) -> str | None:
    """The measurements by films and tests beside the jumps, in plain words; None where there are none."""
    bad = [r for r in d.confirmation if r.contradicts]
    if bad:
        said = "; ".join(
            f"{r.quantity} is {plus_minus(r.by_film, r.by_film_sigma)} by {r.source}, "
            f"{plus_minus(r.by_jumps, r.by_jumps_sigma)} by the jumps alone ({abs(r.z):.1f} sigma apart)"
            for r in bad
        )
        return f"Films and jumps contradict each other: {said}."
    masses = [r for r in d.confirmation if r.depth_m is not None]
    if "added_mass" not in d.named or not masses:
        return None
    row = max(masses, key=lambda r: r.by_film)
    film = plus_minus(1e3 * row.by_film, 1e3 * row.by_film_sigma)
    jumps = plus_minus(1e3 * row.by_jumps, 1e3 * row.by_jumps_sigma)
    return (
        f"The jumps alone imply {jumps} g of sand moving with the foot {1e3 * (row.depth_m or 0.0):.0f} mm deep; "
        f"the grain film {row.experiment} shows {film} g."
    )


def plus_minus(value: float, sigma: float) -> str:
    """With as many digits as sigma has worth."""
    digits = max(0, -math.floor(math.log10(sigma))) if sigma > 0 else 1
    return f"{value:.{digits}f} ± {sigma:.{digits}f}"


def words(mechanisms: Sequence[str]) -> str:
    return " and ".join(m.replace("_", " ") for m in mechanisms)
