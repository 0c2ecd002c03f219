"""The hidden-effect game on disk: a blind campaign, its sealed answer, and the score of a diagnosis.

The answer lies beside the campaign, packed so that it is not read by accident, with a hash so that it is not changed.
"""

from __future__ import annotations

import base64
import hashlib
import json
import tempfile
import tomllib
import zlib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields, replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from jumpvision.base.schema import InputError, closest

from . import write
from .blind import ROBOTS, Nuisance, Setting, draw
from .campaign import PROTOCOL, carry_out, defaults, write_experiment, written
from .intrusions import scaled
from .jumper import AT_THE_CAMERA, KNOWN, OUTSIDE, UNLOGGED, Law, Samples
from .protocol import CAMERA_PARAMETERS, Protocol, checked, values_at
from .protocol_keys import Jump, MotorLog, Records, RodTrack


def sealed_file(out: Path) -> Path:
    """Where the answer of the campaign `out` lies."""
    out = out.absolute()
    return out.parent / f"{out.name}.sealed.json"


def write_blind(out: Path, *, seed: int, ground: str = "granular", workers: int = 1) -> None:
    """A campaign with a hidden effect (or none), and its answer. Raises InputError where either exists."""
    if ground not in ROBOTS:
        raise InputError([f"synth blind --ground {ground}: unknown ground{closest(ground, ROBOTS)}"])
    taken = [
        f"synth blind: {f} exists; give another folder or remove it" for f in (out, sealed_file(out)) if f.exists()
    ]
    if taken:
        raise InputError(taken)
    setting = draw(np.random.default_rng([seed, 1]), ground=ground)
    out.mkdir(parents=True)
    work = [(setting.protocol, jump) for jump in setting.protocol.jumps]
    carry_out(work, out, seed=seed, workers=workers, sealed=True)
    write.toml(out / "campaign.toml", defaults(setting.protocol), comment="Is the model below adequate? If not, why?")
    sealed_file(out).write_text(json.dumps(seal(answer_of(setting)), indent=1) + "\n", encoding="utf-8")


def truth_for(out: Path, like: str = "") -> Protocol:
    """The protocol by which further jumps of a written campaign are made: of a blind one by its sealed answer, of
    another by its own, of one in parts by that of the experiment `like`. Raises InputError where it is neither."""
    if sealed_file(out).exists():
        answer = unseal(sealed_file(out))
        ground = tomllib.loads((out / "campaign.toml").read_text(encoding="utf-8"))["ground"]
        setting = draw(np.random.default_rng(0), ground=ground, hidden=())  # for what all settings have alike
        track = RodTrack(**answer.nuisance)  # type: ignore[arg-type]
        log = MotorLog() if not UNLOGGED & {*answer.hidden} else None
        true = dict(answer.truth)
        terms = tuple(cast(Sequence[str], true.pop("terms")))
        records = Records(rod_track=track, motor_log=log)
        protocol = replace(setting.protocol, terms=terms, parameters=cast(Any, true), records=records)
        return checked(protocol, str(sealed_file(out)))
    if not (out / PROTOCOL).exists():
        raise InputError([f"{out}: no campaign of the laboratory; give one that synth or synth blind wrote"])
    parts = written(out)
    return max((p for p in parts if like.startswith(p.part)), key=lambda p: len(p.part), default=parts[0])


def record_jump(out: Path, folder: Path, motion: Mapping[str, Any], *, seed: int, number: int) -> list[str]:
    """The recordings of one jump more of the campaign `out`, put into `folder`; their names. motion: as [actuation],
    "custom" for that of motor_command.csv.

    Bed and foot are those that its experiment.toml declares, the forces of the ground as that foot feels them.
    """
    like = tomllib.loads((folder / "protocol.toml").read_text(encoding="utf-8")).get("like", "")
    protocol = truth_for(out, like)
    tables = tomllib.loads((folder / "experiment.toml").read_text(encoding="utf-8"))
    robot = protocol.robot._replace(**{k: v for k, v in tables.get("robot", {}).items() if k in protocol.robot._fields})
    size = robot.foot_radius / protocol.robot.foot_radius
    law: Law | Samples
    if motion["kind"] == "custom":
        t, x = np.loadtxt(folder / "motor_command.csv", delimiter=",", skiprows=1, usecols=(0, 1), unpack=True)
        law = Samples(x, (t.size - 1) / float(t[-1] - t[0]), float(t[0]))
        protocol = replace(protocol, records=replace(protocol.records, motor_log=MotorLog()))
    else:
        law = Law(
            motion["frequency"],
            motion["amplitude"],
            motion["phase"],
            motion["start"],
            motion["cycles"],
            motion.get("delay", 0.0),
            motion.get("dwell_gain", 1.0),
        )
    phi = tables.get("bed", {}).get("volume_fraction", protocol.jumps[0].volume_fraction)
    if size != 1.0:
        protocol = replace(protocol, parameters=scaled(values_at(protocol.parameters, phi), size))
    protocol = replace(protocol, robot=robot)
    jump = Jump(number, folder.name, folder.name, motion["kind"], law, phi)
    header = replace(protocol.header, duration=max(protocol.header.duration, law.stop + 1.0))
    with tempfile.TemporaryDirectory(dir=folder.parent, prefix=".lab-") as aside:
        write_experiment(replace(protocol, header=header), jump, out=Path(aside), seed=seed, sealed=True)
        made = [f for f in sorted((Path(aside) / folder.name).iterdir()) if f.name != "experiment.toml"]
        for f in made:
            f.replace(folder / f.name)
    return [f.name for f in made]


@dataclass(frozen=True)
class Answer:
    """What is hidden: mechanisms (outside: one of no vocabulary), their parameters and strengths, and the nuisance."""

    hidden: Sequence[str]
    outside: bool
    parameters: Mapping[str, float]
    strength: Sequence[float] = ()
    nuisance: Mapping[str, str | float] = field(default_factory=dict)
    truth: Mapping[str, object] = field(default_factory=dict)


def answer_of(setting: Setting) -> Answer:
    """What a setting hides."""
    names = {n for h in setting.hidden for n in parameters_of(h)}
    true = values_at(setting.protocol.parameters, 0.0) | setting.parameters
    return Answer(
        setting.hidden,
        setting.outside,
        {n: true[n] for n in sorted(names)},
        setting.strength,
        {f.name: getattr(setting.nuisance, f.name) for f in fields(Nuisance)},
        {"terms": setting.protocol.terms, **setting.protocol.parameters},
    )


def parameters_of(mechanism: str) -> tuple[str, ...]:
    """Names of a mechanism's parameters."""
    return (CAMERA_PARAMETERS[mechanism],) if mechanism in AT_THE_CAMERA else KNOWN[mechanism]


def seal(answer: Answer) -> dict[str, str]:
    """The answer, packed, with its SHA-256."""
    data = zlib.compress(json.dumps(asdict(answer), sort_keys=True).encode())
    note = "The answer of a blind campaign; jumpvision synth reveal opens it."
    return {"note": note, "sha256": hashlib.sha256(data).hexdigest(), "sealed": base64.b64encode(data).decode()}


def unseal(file: Path) -> Answer:
    """The answer in a sealed file. Raises InputError where it is missing or was changed."""
    try:
        packed = json.loads(file.read_text(encoding="utf-8"))
        data = base64.b64decode(packed["sealed"], validate=True)
    except FileNotFoundError as e:
        raise InputError([f"{file}: no sealed answer here; give the folder that synth blind wrote"]) from e
    except (ValueError, KeyError, TypeError) as e:
        raise InputError([f"{file}: not a sealed answer ({e}); make the campaign again from its seed"]) from e
    if hashlib.sha256(data).hexdigest() != packed.get("sha256"):
        raise InputError([f"{file}: the answer does not match its hash: it was changed; make the campaign again"])
    return Answer(**json.loads(zlib.decompress(data)))


def reveal(out: Path, results: Path | None = None) -> dict[str, str | float]:
    """The answer of `out`, and the scores of diagnosis.json and explore.json in results/<name> beside it (or in
    `results`), those that are there."""
    answer = unseal(sealed_file(out))
    answers: dict[str, str | float] = {"hidden": ", ".join(answer.hidden) or "nothing"}
    answers |= {f"true {k}": float(f"{v:.5g}") for k, v in answer.parameters.items()}
    answers |= {"strength (0-1)": ", ".join(f"{s:.2f}" for s in answer.strength)}
    folder = results or out.absolute().parent / "results" / out.absolute().name
    scores = {folder / "diagnosis.json": score, folder / "explore.json": score_explored}
    there = [f for f in scores if f.exists()]
    if not there:
        return answers | {"outcome": f"no {' and no '.join(map(str, scores))} yet: run jumpvision diagnose, or explore"}
    for file in there:
        answers |= scores[file](json.loads(file.read_text(encoding="utf-8")), answer)
    return answers


def score(diagnosis: Mapping[str, Any], answer: Answer) -> dict[str, str | float]:
    """outcome: right, twin (told apart from its twin by no data, and said so), partly, wrong, false alarm or missed;
    for every hidden mechanism that was named its parameters' errors and whether their intervals cover the truth."""
    named, hidden = set(diagnosis["named"]), set(answer.hidden)
    out: dict[str, str | float] = {
        "named": ", ".join(sorted(named)) or "nothing",
        "outcome": _outcome(diagnosis, named, hidden, answer.outside),
    }
    for cause in diagnosis["causes"]:
        if cause["mechanism"] in named & hidden:
            for name, found in cause["parameters"].items():
                true = answer.parameters.get(name)
                if true is not None:
                    out[f"error of {name}"] = found["value"] - true
                    out[f"interval of {name} covers"] = found["low"] <= true <= found["high"]
    return out


DECIDED = 0.95  # probability from which an exploration takes a cause for found


def score_explored(history: Mapping[str, Any], answer: Answer) -> dict[str, str | float]:
    """The same of what an exploration believes after its last round; "open" where causes are neither in nor out."""
    last = history["rounds"][-1]
    named = {m for m, p in last["causes"].items() if p >= DECIDED}
    doubted = {m for m, p in last["causes"].items() if 1.0 - DECIDED < p < DECIDED}
    beyond = "no set of the vocabulary explains" in last["end"]
    said: dict[str, Any] = {
        "verdict": "discrepant" if named or beyond else "adequate",
        "status": "partial" if beyond else "complete",
        "indistinguishable": [],
    }
    outcome = "open" if doubted else _outcome(said, named, set(answer.hidden), answer.outside)
    return {
        "explore named": ", ".join(sorted(named)) or "nothing",
        "explore left open": ", ".join(sorted(doubted)) or "nothing",
        "explore rounds": len(history["rounds"]),
        "explore outcome": outcome,
    }


def _outcome(diagnosis: Mapping[str, Any], named: set[str], hidden: set[str], outside: bool) -> str:
    discrepant = diagnosis["verdict"] == "discrepant"
    if not hidden:
        return "false alarm" if discrepant else "right"
    if not discrepant:
        return "missed"
    if outside:
        real = hidden - set(OUTSIDE)
        beyond = diagnosis["status"] != "complete" or diagnosis.get("discovered")
        return "right" if named <= real and beyond else "wrong"
    if named == hidden:
        return "right"
    twins = [set(group) for group in diagnosis["indistinguishable"]]

    def standing(mechanism: str) -> bool:  # itself, or a named one that the diagnosis says cannot be told from it
        return mechanism in named or any(mechanism in group and group & named for group in twins)

    excused = {n for n in named if n in hidden or any(n in group and group & hidden for group in twins)}
    if all(map(standing, hidden)) and excused == named:
        return "twin"
    if not named:
        return "missed"
    return "partly" if excused == named else "wrong"
