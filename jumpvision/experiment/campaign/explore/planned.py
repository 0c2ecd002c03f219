"""What a planned protocol can and cannot tell, before the first jump, and the shortest one that tells what is asked."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import product
from pathlib import Path

import numpy as np

from jumpvision.base.schema import REQUIRED, InputError, Toml, closest, param, read
from jumpvision.base.storage import write_aside
from jumpvision.engine.fitting import Problem
from jumpvision.engine.noise.noise import Noise
from jumpvision.engine.worth.identify import Information, Shown, information, limits_of_causes, shortest
from jumpvision.experiment.campaign.jumps import spec_of
from jumpvision.experiment.inputs.experiment import Experiment, merged, without_folder
from jumpvision.experiment.inputs.parameters import SimulateParams
from jumpvision.experiment.inputs.sections import PHASES, Actuation, Bed, Motor, Robot
from jumpvision.experiment.stages.simulate import build_model, driver
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.jumps import Jump

from .offers import AFTER, START, every, limits_of, named

FILE = "identifiability.json"
LONGEST = 16  # jumps of a shortest protocol, at most


@dataclass(frozen=True)
class Sweep:
    """One [[jumps]]: every combination of its lists, `trials` times."""

    kind: str = param(REQUIRED, "", "jump type", choices=tuple(PHASES))
    frequency: tuple[float, ...] = param(REQUIRED, "Hz", "forcing frequency", lo=0, open_lo=True)
    amplitude: tuple[float, ...] = param(REQUIRED, "m", "forcing amplitude", lo=0, open_lo=True)
    delay: tuple[float, ...] = param((0.0,), "s", "pause between the two half cycles", lo=0)
    cycles: float = param(1.0, "", "number of cycles", lo=0, open_lo=True)
    trials: int = param(1, "", "repetitions of each", lo=1, hi=1000)


@dataclass(frozen=True)
class Camera:
    """[record.rod_track]: how well a track will be known."""

    rate: float = param(200.0, "1/s", "samples a second", lo=0, open_lo=True)
    noise: float = param(5e-5, "m", "standard deviation", lo=0, open_lo=True)
    rho: float = param(0.0, "", "correlation of neighbouring samples", lo=0, hi=0.97)


@dataclass(frozen=True)
class Planned:
    """A protocol not yet carried out, with a campaign.toml. logged: whether the motor's encoder is."""

    campaign: Toml
    laws: Sequence[Actuation]
    camera: Camera
    logged: bool
    where: str


def read_planned(folder: Path, protocol: Path) -> Planned:
    """A protocol beside the campaign.toml of a folder. Raises InputError with every problem found."""
    tables = []
    for file in (folder / "campaign.toml", protocol):
        try:
            tables.append(tomllib.loads(file.read_text(encoding="utf-8-sig")))
        except tomllib.TOMLDecodeError as e:
            raise InputError([f"{file}: not valid TOML: {e}"]) from e
        except OSError as e:
            raise InputError([f"{file}: cannot be read: {e.strerror}; give one"]) from e
    table, problems, laws = tables[1], [], []
    given = table.get("jumps")
    if not isinstance(given, list) or not given:
        raise InputError([f"{protocol}: [[jumps]]: missing; give at least one with kind, frequency and amplitude"])
    for k, sweep in enumerate(given, 1):
        as_lists = {n: [v] if n in _LISTS and isinstance(v, int | float) else v for n, v in dict(sweep).items()}
        s, more = read(Sweep, as_lists, f"{protocol}: [[jumps]] number {k}:", extra=("phase", "volume_fraction"))
        problems += more
        if s is not None:
            each = product(s.frequency, s.amplitude, s.delay, range(s.trials))
            laws += [Actuation(s.kind, f, a, PHASES[s.kind], s.cycles, d, start=START) for f, a, d, _ in each]
    record = table.get("record", {})
    camera, more = read(
        Camera, record.get("rod_track", {}), f"{protocol}: [record.rod_track]", extra=tuple(record.get("rod_track", {}))
    )
    if problems + more:
        raise InputError(problems + more)
    known = {k: v for k, v in record.get("rod_track", {}).items() if k in ("rate", "noise", "rho")}
    return Planned(tables[0], laws, replace(camera, **known), "motor_log" in record, str(protocol))


_LISTS = ("frequency", "amplitude", "delay")


@dataclass(frozen=True)
class Identified:
    """What a protocol tells of every cause; what the shortest is that tells those asked for, and what none can tell."""

    causes: Sequence[Shown]
    jumps: int
    noise: float
    asked: Mapping[str, float]
    shortest: Sequence[str]
    never: Mapping[str, Sequence[str]]
    whole: bool

    @property
    def data(self) -> Mapping[str, object]:
        """identifiability.json; a strength that is NaN as null."""
        causes = [asdict(c) | {"from_": c.from_ if math.isfinite(c.from_) else None} for c in self.causes]
        return {**asdict(self), "causes": causes}

    def save(self, folder: Path) -> Path:
        folder.mkdir(parents=True, exist_ok=True)
        write_aside(folder / FILE, json.dumps(self.data, indent=1) + "\n")
        return folder / FILE

    @property
    def sentences(self) -> list[str]:
        """In words."""
        blind = [c.mechanism for c in self.causes if not math.isfinite(c.from_)]
        out = [f"{self.jumps} jumps, {1e3 * self.noise:g} mm of noise; linear about the declared model"]
        out += [f"cannot detect {', '.join(blind)}: no value in their range would show"] if blind else []
        out += [
            f"no offered jump separates {m} at {self.asked[m]:g} from {', '.join(x)}" for m, x in self.never.items()
        ]
        if self.shortest:
            end = "" if self.whole else f" (incomplete: {LONGEST} jumps are too few)"
            out.append(f"shortest protocol for {', '.join(self.asked)}{end}: {', '.join(self.shortest)}")
        return out


def identified(planned: Planned, tell: Sequence[str], workers: int = 1) -> Identified:
    """What a planned protocol can tell. tell: causes, CAUSE or CAUSE=STRENGTH; without a number a usual strength."""
    laws = list(planned.laws)
    offered = [law for law in every(laws, limits_of(laws, None)) if law not in laws] if tell else []
    info = information(_problem(planned, [*laws, *offered], workers))
    asked = _asked(tell, info)
    taken, never = shortest(info, asked, LONGEST) if asked else ([], {})
    names = [named([*laws, *offered][k]) for k in taken]
    whole = len(taken) < LONGEST
    return Identified(
        limits_of_causes(info, range(len(laws))), len(laws), planned.camera.noise, asked, names, never, whole
    )


def _asked(tell: Sequence[str], info: Information) -> dict[str, float]:
    out, problems = {}, []
    for text in tell:
        cause, _, value = text.partition("=")
        if cause not in info.strengths:
            problems.append(f"explore --tell {text}: unknown cause{closest(cause, info.strengths)}")
            continue
        p, null = info.strengths[cause], info.nulls[list(info.strengths).index(cause)]
        try:
            out[cause] = float(value) if value else float(null + p.scale)
        except ValueError:
            problems.append(f"explore --tell {text}: must be CAUSE or CAUSE=NUMBER")
            continue
        if not p.low <= out[cause] <= p.high or out[cause] == null:
            problems.append(
                f"explore --tell {text}: {p.name} must be in [{p.low:g}, {p.high:g}] {p.unit}, not {null:g}"
            )
    if problems:
        raise InputError(problems)
    return out


def _problem(planned: Planned, laws: Sequence[Actuation], workers: int) -> Problem:
    jumps = [_jump(planned, law) for law in laws]
    e = _experiment(planned, laws[0])
    spec, robot = spec_of(e), e.section(Robot)
    priors = {n: s for n, s in asdict(robot.sigma).items() if s} if robot else {}
    system = Jumper(jumps, {n: (low, high) for n, (low, high) in spec.fit.items()}, {**spec.sigma, **priors}, workers)
    return Problem(system, Noise(planned.camera.noise, planned.camera.rho, 1.0 / planned.camera.rate))


def _experiment(planned: Planned, law: Actuation) -> Experiment:
    motion = {k: v for k, v in asdict(law).items() if v is not None}
    return without_folder(merged(planned.campaign, {"actuation": motion}), planned.where)


def _jump(planned: Planned, law: Actuation) -> Jump:
    e = _experiment(planned, law)
    robot = e.section(Robot)
    if robot is None:
        raise InputError([f"{planned.where}: campaign.toml [robot]: missing; give the robot that will jump"])
    model = build_model(e, robot, spec_of(e), e.section(Bed), None)
    forcing, stop = driver(None, law, None if planned.logged else e.section(Motor), SimulateParams())
    t = np.arange(0.0, stop + AFTER, 1.0 / planned.camera.rate)
    labels = {"kind": law.kind, "frequency": law.frequency, "delay": law.delay}
    name = named(law)
    return Jump(name, model, forcing, stop, t, np.zeros(t.size), name, name, not planned.logged, labels)
