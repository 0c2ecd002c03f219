"""`jumpvision diagnose`: the jumps of a campaign questioned, with the files that say what came out."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from jumpvision import __version__
from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.base.storage import copy_aside, write_aside
from jumpvision.diagnosis.diagnose import Diagnosis, diagnose
from jumpvision.diagnosis.fitting import Problem
from jumpvision.diagnosis.jumper.jumper import Jumper, content
from jumpvision.diagnosis.jumper.jumps import Jump
from jumpvision.diagnosis.jumper.shapes import Shaped
from jumpvision.diagnosis.noise.learning import learn_noise
from jumpvision.diagnosis.proposing import apex
from jumpvision.diagnosis.unexplained import unexplained
from jumpvision.inputs.experiment import Campaign
from jumpvision.inputs.sections import PHASES, Actuation
from jumpvision.physics.forcing import delayed, sinusoid
from jumpvision.results import plain
from jumpvision.workflow.run import Outcome

from .document import common_of, confirmed, document, model_toml, noise_of, sentence, values
from .films import confirmation, films, jumps_alone, ledgers
from .jumps import load_jumps, measurements, questioned, spec_of

SEED = 1  # of the simulated noise: the same data give the same answer
VERSION = 7  # of the method: another one asks again
FILE, MODEL, PICTURE = "diagnosis.json", "model.toml", "diagnosis.png"


Draw = Callable[[Diagnosis, Jumper, Mapping[str, Any]], bytes]


def question(
    campaign: Campaign,
    outcomes: Mapping[str, Outcome],
    results: Path,
    cache: Path,
    *,
    workers: int,
    draw: Draw | None,
    say: Callable[[str], None],
) -> tuple[dict[str, Any], list[Path]]:
    """(diagnosis.json as a dict, the files written into `results`); from the cache when nothing has changed.

    Raises InputError when there is too little to question.
    """
    experiments = questioned(campaign)
    if not experiments:
        raise InputError(
            [
                f"{campaign.path}: no experiment with [robot], a motor ([actuation] or [motor_log]), a track "
                "([rod_video] or [rod_track]) and, on granular ground, a [model]: nothing to diagnose"
            ]
        )
    jumps, left_out = load_jumps(experiments, outcomes)
    for why in left_out:
        say(f"left out: {why}")
    spec = spec_of(experiments[0])
    robot_sigma = {n: s for n, s in asdict(experiments[0].sections["robot"].sigma).items() if s}
    ranges = {n: (low, high) for n, (low, high) in spec.fit.items()}
    priors = {**spec.sigma, **robot_sigma}
    seen = films(outcomes)
    phi = jumps[0].model.volume_fraction
    beside = measurements(campaign.experiments, outcomes, experiments[0].sections["robot"], phi)
    entry = cache / "diagnose" / _key(jumps, ranges, priors, (seen, beside))
    names = (FILE, MODEL, PICTURE)[: 3 if draw else 2]
    if not all((entry / n).exists() for n in names):
        laws = [law for e in experiments if (law := e.section(Actuation)) is not None and law.moves]
        system = Jumper(jumps, ranges, priors, workers)
        try:
            learned = learn_noise(system)
        except ValueError as e:
            raise InputError([f"{campaign.path}: {e}"]) from None
        system = learned.system
        found = diagnose(
            system,
            learned.noise,
            np.random.default_rng(SEED),
            scatter=learned.scatter,
            measured=beside,
            by=("kind",),
            stops=[j.stop for j in jumps],
            runnable=proposals(system, laws),
            say=say,
        )
        problem = Problem(system, learned.noise, learned.scatter, beside)
        left = leftover(found, problem, system, say)
        data = document(found, system, heights_of(found, system), left)
        best = found.naming.best.fit if found.naming and found.naming.named else found.baseline
        alone = jumps_alone(best, problem)
        data |= {"noise": noise_of(learned, found), "common": common_of(found)}
        data |= {"energy": ledgers(found, system), "confirmation": confirmation(alone, system, seen, beside)}
        if any(r["verdict"] == "contradict" for r in data["confirmation"]) and beside:
            data["without_films"] = {"parameters": values(alone, system), "chi2": alone.chi2}
        data |= {"sentence": sentence(data), "confirmed": confirmed(data)}
        write_aside(entry / MODEL, model_toml(best, system, data["sentence"] + " Made by jumpvision diagnose."))
        if draw:
            (entry / PICTURE).write_bytes(draw(found, system, data))
        write_aside(entry / FILE, json.dumps(plain(data), indent=1) + "\n")  # last: the entry is whole
    for n in names:
        copy_aside(entry / n, results / n)
    data = json.loads((entry / FILE).read_text(encoding="utf-8"))
    for warning in data["noise"]["warnings"]:
        say(f"warning: {warning}")
    return data, [results / n for n in names]


def leftover(d: Diagnosis, problem: Problem, system: Jumper, say: Callable[[str], None]) -> dict[str, Any] | None:
    """`unexplained` of diagnosis.json: generic forces that describe what no mechanism explains; None where one does."""
    if d.naming is None or (d.naming.named and not d.naming.remainder):
        return None
    say("no mechanism explains all of it: describing what is left by generic forces")
    found = unexplained(problem, [d.baseline, d.naming.best.fit], Shaped(system), np.random.default_rng(SEED))
    if found is None:
        return {"terms": [], "r2": 0.0, "where": "no generic force describes it"}
    return found.document()


def _key(jumps: Sequence[Jump], ranges: Mapping[str, Any], priors: Mapping[str, float], seen: Any) -> str:
    """Digest of everything that the diagnosis depends on."""
    seen = [repr(x) for x in seen]  # arrays to the last bit that repr shows
    digest = hashlib.sha256(f"{VERSION} {__version__} {ranges} {priors} {seen}".encode())
    for j in jumps:
        said = (j.name, j.model, j.stop, j.group, j.condition, j.law, sorted(j.labels.items()))
        arrays = (j.t, j.y, j.sigma, j.shared.lens)
        digest.update(repr(said).encode() + b"".join(b"-" if a is None else a.tobytes() for a in arrays))
        digest.update(content(j.forcing) + repr(replace(j.shared, lens=None)).encode())
    return digest.hexdigest()[:24]


def heights_of(d: Diagnosis, system: Jumper) -> list[dict[str, Any]]:
    """Measured height of every jump beside the re-fitted baseline's and the extended model's [m]."""
    every = range(len(system.observations))
    best = d.naming.best.fit if d.naming and d.naming.named else None
    before = system.predict(d.baseline.mechanisms, d.baseline.named, every)
    after = system.predict(best.mechanisms, best.named, every) if best else [None] * len(before)
    out = []
    for jump, o, y, z in zip(system.jumps, system.observations, before, after):
        row = {"experiment": o.name, **o.labels, "measured_m": apex(o.t, o.y, jump.stop)}
        row["simulated_m"] = apex(o.t, y, jump.stop)
        row["extended_m"] = apex(o.t, z, jump.stop) if z is not None else None
        out.append(row)
    return out


@dataclass(frozen=True)
class Proposable:
    """An experiment that could be done with this robot."""

    labels: Mapping[str, Any]
    t: Array
    jump: Jump
    system: Jumper

    def predict(self, mechanisms: tuple[str, ...], values: Mapping[str, float]) -> Array:
        return self.system.height(self.jump, self.t, mechanisms, values)


def proposals(system: Jumper, laws: list[Actuation]) -> list[Proposable]:
    """Half-cycle jumps of the campaign's amplitude over kinds, frequencies about those done, and delays."""
    known = [law for law in laws if law.frequency and law.amplitude]
    if not known:
        return []
    amplitude = float(np.median([law.amplitude for law in known if law.amplitude]))
    f = [law.frequency for law in known if law.frequency]
    base, start = system.jumps[0], 0.2
    frame = float(np.median(np.diff(base.t)))
    out = []
    for kind in ("single", "stutter", "delayed_stutter"):
        for frequency in np.linspace(0.8 * min(f), 1.25 * max(f), 9).round(1):
            for delay in (0.05, 0.1, 0.2) if kind == "delayed_stutter" else (0.0,):
                phase = PHASES[kind]
                law = (
                    delayed(frequency, amplitude, phase, delay, start)
                    if delay
                    else sinusoid(frequency, amplitude, phase, 1.0, start)
                )
                t = np.arange(0.0, law.stop + 0.5, frame)
                jump = replace(base, forcing=law, stop=law.stop)
                labels = {"kind": kind, "frequency": float(frequency), "delay": delay}
                out.append(Proposable(labels, t, jump, system))
    return out
