"""How jumps and their models are told: heights, the apparatus, the robot's parameters, and the words of the verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import ClassVar

import numpy as np

from jumpvision.base.numbers import said
from jumpvision.engine.document import values as record
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.document.document import agreement, document, interval
from jumpvision.engine.document.sentence import contradictions, plus_minus
from jumpvision.engine.document.sentence import sentence as sentence_of
from jumpvision.engine.document.words import Words
from jumpvision.engine.fitting import Fit
from jumpvision.engine.order import Findings
from jumpvision.engine.system import Indexed
from jumpvision.estimate.height import curve_height
from jumpvision.jumper.mechanisms.own import bare
from jumpvision.jumper.mechanisms.registry import MECHANISMS
from jumpvision.jumper.physics.model import ROBOT, Model

from .jumper import Jumper
from .jumps import is_common
from .learning import Learned

HEIGHTS_AGREE = 5e-5  # m: a smaller mean error of every kind of jump would read as 0.0 mm
APART = ("Films", "jumps")
BODIES = {
    "static": "a static force of the ground",
    "foot": "a force on the intruding foot",
    "foot_mass": "a mass that moves with the foot",
    "carriage": "a force on the carriage",
    "spring": "a force of the spring",
    "film_height": "an error of the filmed height",
    "film_time": "an error of the film's clock",
}
QUANTITIES = {
    "amplitude": "the amplitude of the drive",
    "frequency": "the frequency of the drive",
    "motor_lag": "the lag of the motor",
    "spring_stiffness": "the stiffness of the spring",
    "spring_damping": "the damping of the spring",
    "motor_mass": "the mass of the motor",
    "rod_mass": "the mass of the rod",
    "foot_mass": "the mass of the foot",
    "gravity": "gravity along the rail",
    "bed": "the stiffness of the bed",
    "scale": "the scale of the camera",
    "clock_offset": "the offset of the film's clock",
    "clock_rate": "the rate of the film's clock",
}
DRIVE = ("amplitude", "frequency", "phase", "delay")
KNOWN = {
    "frequency": ("frequency", "Hz"),
    "amplitude": ("amplitude", "m"),
    "delay": ("delay", "s"),
    "volume_fraction": ("the volume fraction", ""),
}


@dataclass(frozen=True)
class Beside:
    """What stands beside the jumps: energies of some, what films and tests measure, the jumps without these."""

    energy: tuple[record.Energies, ...] = ()
    confirmation: tuple[record.Confirmation, ...] = ()
    without_films: record.WithoutFilms | None = None


@dataclass(frozen=True)
class JumperSpeaker:
    """Jumps as the document has them. system: with the law of no vocabulary where one was found."""

    learned: Learned
    system: Jumper
    beside: Beside
    heights: ClassVar[bool] = True

    def model(self, fit: Fit) -> record.Model:
        """Terms and parameters of the models on every ground."""
        built = [self.system.build(fit.mechanisms, fit.named, g) for g in self.system.bases]
        return record.Model(tuple(dict.fromkeys(t for m in built for t in m.terms)), values(fit, self.system))

    def parameters(self, fit: Fit, mechanism: str) -> dict[str, record.Parameter]:
        """Those of a mechanism by name, the ends of a 90 % interval within its range."""
        own = self.system.model.mechanism(mechanism)
        return {
            bare(own, p.name) if own.own else p.name: interval(fit, p) for p in fit.parameters if p.name in own.names
        }

    def noise(self, d: Findings) -> record.Noise:
        """What is known of the noise and from where, with everything about it that a reader must be warned of."""
        learned, n = self.learned, self.learned.noise
        names = [j.name for j in learned.system.jumps]
        return record.Noise(
            sigma_m=learned.sigma,
            correlation=n.rho,
            # from 30 degrees of freedom Student's t is as good as normal
            tails=None if learned.tails > 30.0 else record.Tails(learned.tails),
            drift_m=n.drift,
            samples=n.n,
            sources={k: learned.sources.get(k) for k in ("stated", "rest", "flight", "repeats")},
            scatter={k: s for k, s in learned.scatter.items() if s > 0},
            # a track's own noise is listed from 1.5 times the typical one
            tracks={k: float(f) for k, f in zip(names, learned.tracks) if abs(math.log(f)) > math.log(1.5)},
            outliers=tuple(record.Outlier(*x) for x in learned.outliers),
            warnings=(*learned.warnings, *agreement(d), *unrepeated(learned, d)),
        )

    def completed(self, data: Diagnosis, d: Findings) -> Diagnosis:
        """The record with heights, what an apparatus has wrong in common, the jump to be made next, films and tests."""
        return replace(
            data,
            heights=heights_of(d, self.system),
            common=common_of(d.named_fit),
            next_experiment=proposal(d),
            energy=self.beside.energy,
            confirmation=self.beside.confirmation,
            without_films=self.beside.without_films,
        )

    def words(self, data: Diagnosis) -> Words:
        return words_of(data, {m.name: m.lacks for m in self.system.model.own})


def diagnosis_of(d: Findings, learned: Learned, beside: Beside | None = None) -> Diagnosis:
    """The record of a campaign's findings."""
    system = d.law.system if d.law else d.problem.system if d.problem else learned.system
    assert isinstance(system, Jumper)
    data = document(d, JumperSpeaker(learned, system, beside or Beside()))
    return replace(data, confirmed=confirmed(data))


def heights_of(d: Findings, system: Jumper) -> tuple[record.Height, ...]:
    """Measured height of every jump beside the re-fitted baseline's and the extended model's [m]."""
    every, best = range(len(system.observations)), d.best
    before = system.predict(d.baseline.mechanisms, d.baseline.named, every)
    after = system.predict(best.mechanisms, best.named, every) if best is not d.baseline else [None] * len(before)
    out = []
    for jump, o, y, z in zip(system.jumps, system.observations, before, after):
        frequency, delay, phi = (o.labels.get(k) for k in ("frequency", "delay", "volume_fraction"))
        measured = o.measured or (math.nan, math.nan)
        models = [math.nan if x is None else curve_height(o.t, x, jump.stop) for x in (y, z)]
        out.append(record.Height(o.name, str(o.labels.get("kind")), frequency, delay, phi, *measured, *models))
    return tuple(out)


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


def values(fit: Fit, system: Jumper) -> dict[str, float]:
    """Every parameter that the models with this fit's mechanisms need, and what of the robot was re-fitted."""
    out: dict[str, float] = {}
    for ground in system.bases:
        out = needed(system.build(fit.mechanisms, fit.named, ground)) | out
    return out | {n: v for n, v in fit.named.items() if n in ROBOT or _of_a_bed(n, system)}


def _of_a_bed(name: str, system: Jumper) -> bool:
    """Whether a parameter is that of one of several beds, `k1[1]`."""
    return isinstance(name, Indexed) and name.of in system.apart


def needed(model: Model) -> dict[str, float]:
    """Every parameter that a model's terms have."""
    names = dict.fromkeys(n for t in model.terms for n in model.mechanism(t).names)
    return {n: float(getattr(model.parameters, n)) for n in names}


def proposal(d: Findings) -> record.NextExperiment | None:
    """The jump to be made next."""
    if (p := d.next_experiment) is None:
        return None
    return record.NextExperiment(**p.labels, separates=p.separates, expected_log10_odds=p.expected_log10_odds)


def sentence(d: Diagnosis, lacks: Mapping[str, str] = MappingProxyType({})) -> str:
    """The verdict in plain words. lacks: what the model lacks without each mechanism of the user's own."""
    return sentence_of(d, words_of(d, lacks))


def words_of(d: Diagnosis, lacks: Mapping[str, str] = MappingProxyType({})) -> Words:
    """The words of jumps. lacks: as above."""
    return Words(
        misses=_misses(d),
        size=lambda x: f"{said(x, '.2g', 1e3)} mm",
        recordings="measured jumps",
        vocabulary="vocabulary",
        error="held-out track error",
        lacks={n: m.lacks for n, m in MECHANISMS.items()} | dict(lacks),
        acts_on=BODIES,
        apart=APART,
        quantities=QUANTITIES,
        drive=DRIVE,
        command="command",
        declared_in="experiment.toml says",
        one="jump",
        known=KNOWN,
    )


def _misses(d: Diagnosis) -> str:
    """What the simulation gets wrong: the mean height of the kind of jump that it misses most."""
    by_kind: dict[str, list[float]] = {}
    for h in d.heights:
        by_kind.setdefault(h.kind, []).append(h.simulated_m - h.measured_m)
    means = {k: np.array(v)[np.isfinite(v)] for k, v in by_kind.items()}
    kind, off = max(means.items(), key=lambda x: abs(x[1].mean()) if x[1].size else 0.0, default=("", np.zeros(0)))
    if not off.size:
        return "The simulation misses the measured tracks"
    if abs(mean := float(off.mean())) < HEIGHTS_AGREE:
        return f"The simulation meets the measured heights to {1e3 * HEIGHTS_AGREE:g} mm but not the tracks"
    error = f" ± {said(float(off.std() / math.sqrt(off.size)), '.1f', 1e3)}" if off.size > 1 else ""
    over = "over-predicts" if mean > 0 else "under-predicts"
    return f"The simulation {over} {kind.replace('_', ' ')} jumps by {said(abs(mean), '.1f', 1e3)}{error} mm"


def confirmed(d: Diagnosis) -> str | None:
    """The measurements by films and tests beside the jumps, in plain words; None where there is nothing to say."""
    masses = [r for r in d.confirmation if math.isfinite(r.by_film + r.by_jumps + (r.depth_m or math.nan))]
    apart = contradictions(d, APART)
    if apart or "added_mass" not in d.named or not masses:
        return apart
    row = max(masses, key=lambda r: r.by_film)
    film = plus_minus(1e3 * row.by_film, 1e3 * row.by_film_sigma)
    jumps = plus_minus(1e3 * row.by_jumps, 1e3 * row.by_jumps_sigma)
    return (
        f"The jumps alone imply {jumps} g of sand moving with the foot {said(row.depth_m, '.0f', 1e3)} mm deep; "
        f"the grain film {row.experiment} shows {film} g."
    )
