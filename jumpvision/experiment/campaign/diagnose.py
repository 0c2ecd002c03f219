"""`jumpvision diagnose`: the jumps of a campaign questioned, with the files that say what came out."""

from __future__ import annotations

import hashlib
import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from jumpvision import __version__
from jumpvision.base.schema import InputError
from jumpvision.base.storage import ChangedFile, copy_aside
from jumpvision.base.threads import at_most
from jumpvision.engine.discovery import Laws
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.document.document import worth_telling
from jumpvision.engine.document.measured import motions_alone
from jumpvision.engine.document.values import WithoutFilms
from jumpvision.engine.fitting import Problem
from jumpvision.engine.order import Findings, Order
from jumpvision.engine.priors import Measured
from jumpvision.experiment import files
from jumpvision.experiment.inputs.experiment import Campaign, Experiment
from jumpvision.experiment.inputs.model import Considered
from jumpvision.experiment.inputs.sections import Actuation
from jumpvision.experiment.workflow import entries
from jumpvision.experiment.workflow.run import Outcome
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.jumper.mechanisms.record import Mechanism
from jumpvision.jumper.question.discovered import JumperForms
from jumpvision.jumper.question.jumper import Jumper, content
from jumpvision.jumper.question.jumps import Jump
from jumpvision.jumper.question.learning import learn_noise
from jumpvision.jumper.question.suggest import suggested
from jumpvision.jumper.question.words import Beside, diagnosis_of, values, words_of

from .films import Film, confirmation, energies, films
from .jumps import load_jumps, measurements, questioned, spec_of
from .mend import written
from .model_file import model_files
from .offers import offer, usual

SEED = 1  # of the simulated noise: the same data give the same answer
VERSION = 20  # of the method: another one asks again
STAGE = "diagnose"

Say = Callable[[str], None]
Draw = Callable[[Findings, Jumper, Diagnosis], bytes]


class Question(NamedTuple):
    """What a campaign is asked: its jumps, what may be re-fitted, and what films and tests measure beside them.

    ranges, priors: of parameters by name (low and high; sigma). phi: volume fraction of the bed, or None.
    """

    experiments: list[Experiment]
    jumps: list[Jump]
    ranges: Mapping[str, tuple[float, float]]
    priors: Mapping[str, float]
    films: list[Film]
    measured: list[Measured]
    own: tuple[Mechanism, ...]

    def digest(self) -> str:
        """Of everything that the diagnosis depends on."""
        own = [(m.name, m.acts_on, m.law, dict(m.let), m.state, m.parameters) for m in self.own]
        measured = [(m.names, m.source, m.values.tobytes(), m.covariance.tobytes()) for m in self.measured]
        folders = [e.path.resolve().name for e in self.experiments]  # which the lines that would mend it name
        beside = [repr(x) for x in (self.films, measured, own, folders)]
        digest = hashlib.sha256(f"{VERSION} {__version__} {self.ranges} {self.priors} {beside}".encode())
        for j in self.jumps:
            said = (j.name, j.model, j.stop, j.group, j.condition, j.law, sorted(j.labels.items()))
            arrays = (j.t, j.y, j.sigma, j.shared.lens)
            digest.update(repr(said).encode() + b"".join(b"-" if a is None else a.tobytes() for a in arrays))
            digest.update(
                content(j.forcing) + repr((replace(j.shared, lens=None), j.circumstances, j.measured)).encode()
            )
        return digest.hexdigest()


def question(
    campaign: Campaign,
    outcomes: Mapping[str, Outcome],
    results: Path,
    cache: Path,
    *,
    workers: int,
    draw: Draw,
    pictured: bool = True,
    say: Say,
    fresh: bool = False,
) -> tuple[Diagnosis, list[Path]]:
    """(the diagnosis, the files written into `results`); from the cache when nothing has changed.

    pictured: its picture is among them; it is drawn and kept in any case, for whoever asks the same again with it.
    fresh: not where other versions of the packages made it. Raises InputError when there is too little to question.
    """
    asked = asked_of(campaign, outcomes, say)
    digest = asked.digest()
    for attempt in range(entries.ATTEMPTS):
        held = _kept(cache, digest, fresh=fresh)
        if held is None:
            with at_most(workers):
                answer = _answer(asked, campaign.path, workers, draw, say)
            held = _keep(cache, digest, answer, fresh=fresh), answer.data
        receipt, data = held
        names = [n for n in receipt["outputs"] if pictured or n != files.PICTURE]
        try:
            for n in names:
                copy_aside(entries.place(cache, STAGE, receipt["key"]) / n, results / n, receipt["outputs"][n])
            break
        except (FileNotFoundError, ChangedFile):  # pruned, or mended by another run, in between
            if attempt == entries.ATTEMPTS - 1:
                raise
    for warning in data.noise.warnings:
        say(f"warning: {warning}")
    return data, [results / n for n in names]


def _kept(cache: Path, asked: str, *, fresh: bool) -> tuple[entries.Receipt, Diagnosis] | None:
    """The answer of an earlier run, where it is whole."""
    key = _key(asked)
    try:
        with entries.opened(cache, STAGE, key) as receipt:
            found = receipt, Diagnosis.load(entries.place(cache, STAGE, key))
        return None if fresh and receipt["versions"] != entries.versions() else found
    except FileNotFoundError:
        return None
    except entries.CorruptEntry as e:
        warnings.warn(StageWarning("cache", f"{e}; asked again"), stacklevel=3)
        return None


def _key(asked: str) -> str:
    return hashlib.sha256(asked.encode()).hexdigest()


def asked_of(campaign: Campaign, outcomes: Mapping[str, Outcome], say: Say) -> Question:
    """What the campaign's results let one ask. Raises InputError when that is too little."""
    experiments = questioned(campaign)
    if not experiments:
        raise InputError(
            [
                f"{campaign.path}: no experiment with [robot], a motor ([actuation] or [motor_log]), a track "
                "([rod_video] or [rod_track]) and, on granular ground, a [model]: nothing to diagnose"
            ]
        )
    jumps, left_out, warned = load_jumps(experiments, outcomes)
    for why in left_out:
        say(f"left out: {why}")
    for text in warned:
        say(f"warning: {text}")
    robot = experiments[0].sections["robot"]
    priors = {n: s for n, s in asdict(robot.sigma).items() if s}
    ranges: dict[str, tuple[float, float]] = {}
    for spec in {e.ground: spec_of(e) for e in reversed(experiments)}.values():  # one on each ground
        priors = {**spec.sigma, **priors}
        ranges |= {n: (low, high) for n, (low, high) in spec.fit.items()}
    phi = next((j.model.volume_fraction for j in jumps if j.model.volume_fraction is not None), None)
    beside = measurements(campaign.experiments, outcomes, robot, phi)
    section = experiments[0].section(Considered)
    own = tuple(m for m in section.mechanisms if m.name not in spec.terms) if section else ()
    return Question(experiments, jumps, ranges, priors, films(outcomes), beside, own)


class Answer(NamedTuple):
    """What the files of a diagnosis hold. models: model.toml, and another on another ground; picture: a PNG."""

    data: Diagnosis
    models: Mapping[str, str]
    picture: bytes


def _keep(cache: Path, asked: str, answer: Answer, *, fresh: bool) -> entries.Receipt:
    """Keep the files in the cache."""

    def fill(folder: Path) -> None:
        (folder / Diagnosis.file).write_text(answer.data.text, encoding="utf-8", newline="\n")
        for name, text in answer.models.items():
            (folder / name).write_text(text, encoding="utf-8", newline="\n")
        (folder / files.PICTURE).write_bytes(answer.picture)

    return entries.keep(
        cache,
        STAGE,
        _key(asked),
        fill,
        version=VERSION,
        warnings=[],
        not_applicable=[],
        good=lambda: _kept(cache, asked, fresh=fresh) is not None,
    )


BY = ("kind",)


def _answer(asked: Question, path: Path, workers: int, draw: Draw, say: Say) -> Answer:
    try:
        learned = learn_noise(Jumper(asked.jumps, asked.ranges, asked.priors, workers, asked.own))
    except ValueError as e:
        raise InputError([f"{path}: {e}"]) from None
    system, rng = learned.system, np.random.default_rng(SEED)
    problem = Problem(system, learned.noise, learned.scatter, asked.measured)
    driven = [a for e in asked.experiments if (a := e.section(Actuation)) is not None and a.moves]

    def laws(p: Problem) -> Laws:
        assert isinstance(p.system, Jumper)
        return Laws(p, JumperForms(p.system), say)

    order = Order(
        problem,
        rng,
        by=BY,
        stops=[j.stop for j in asked.jumps],
        laws=laws,
        offered=lambda: offer(problem, system, usual(driven), asked.ranges, asked.priors, asked.own),
        say=say,
    )
    found = order.explain(order.look())
    if not found.adequate:
        say(diagnosis_of(found, learned).sentence)
    found = worth_telling(order.foretell(found))
    if found.problem is not None:
        problem = found.problem
        assert isinstance(problem.system, Jumper)
        system = problem.system
    alone = motions_alone(found.named_fit, problem)
    rows = confirmation(alone, system, asked.films, asked.measured)
    apart = asked.measured and any(r.contradicts for r in rows)
    without = WithoutFilms(values(alone, system), alone.chi2) if apart else None
    data = diagnosis_of(found, learned, Beside(tuple(energies(found, system)), tuple(rows), without))
    data = replace(data, suggested=suggested(data.varies, written(asked.experiments), words_of(data)))
    with_law = found.law.system if found.law else system
    assert isinstance(with_law, Jumper)
    models = model_files(found.best, with_law, data.sentence + " Made by jumpvision diagnose.")
    return Answer(data, models, draw(found, system, data))
