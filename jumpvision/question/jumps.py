"""The jumps of a campaign as the diagnosis needs them: tracks from the results, each with its model and its driver."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np

from ..campaign import Outcome
from ..diagnosis.jumps import Jump, Shared
from ..experiment import Campaign, Experiment
from ..model_spec import ModelSpec
from ..params import SimulateParams
from ..records import BedHeight, RodMotion
from ..schema import InputError, read
from ..sections import Actuation, Bed, Motor, MotorLog, Robot, RodTrack, RodVideo
from ..stage import StageWarning
from ..stages.bed import packing
from ..stages.common import shared_of
from ..stages.simulate import build_model, driver

FEWEST, CONDITIONS = 4, 2  # jumps, and different conditions among them, that can tell anything
LOGGED = "logged_motion"  # kind of a jump that only a motor log describes, such as a planned one


def questioned(campaign: Campaign) -> list[Experiment]:
    """Experiments with a robot, something that drives it and a track, of the ground that most of them have."""
    usable = [e for e in campaign.experiments if _usable(e)]
    if not usable:
        return []
    ground = Counter(e.ground for e in usable).most_common(1)[0][0]
    return [e for e in usable if e.ground == ground]


def worth_asking(campaign: Campaign) -> bool:
    """Whether the campaign has a [model] to question and enough jumps for it."""
    usable = questioned(campaign)
    motions = {repr(law) if (law := e.section(Actuation)) else e.header.group or e.name for e in usable}
    return len(usable) >= FEWEST and len(motions) >= CONDITIONS and _has_values(usable)


def _has_values(usable: list[Experiment]) -> bool:
    specs = [e.section(ModelSpec) for e in usable]
    return any(specs) and not any(s.laws for s in specs if s)


def _usable(e: Experiment) -> bool:
    law = e.section(Actuation)
    moved = e.section(MotorLog) is not None or (law is not None and law.moves)
    tracked = "rod_video" in e.sections or "rod_track" in e.sections
    return moved and tracked and e.section(Robot) is not None and (e.ground == "hard" or "model" in e.sections)


def load_jumps(experiments: list[Experiment], outcomes: Mapping[str, Outcome]) -> tuple[list[Jump], list[str]]:
    """(jumps, what was left out and why), from the rod.csv of each experiment's results.

    Raises InputError when the experiments question different models, or when too few jumps are left.
    """
    left_out: list[str] = []
    jumps: list[Jump] = []
    spec = spec_of(experiments[0])
    for e in experiments:
        if spec_of(e) != spec:
            raise InputError(
                [
                    f"{e.path / 'experiment.toml'}: [model] differs from that of {experiments[0].name}; one model is "
                    "questioned at a time: give it in campaign.toml, or diagnose the experiments in separate campaigns"
                ]
            )
        outcome = outcomes[e.name]
        file = outcome.results / RodMotion.file
        if not file.exists():
            left_out.append(f"{e.name}: {outcome.errors[0] if outcome.errors else 'no track'}")
            continue
        jumps.append(_jump(e, outcome.results))
    conditions = {j.condition for j in jumps}
    if len(jumps) < FEWEST or len(conditions) < CONDITIONS:
        raise InputError(
            [
                f"diagnose: {len(jumps)} jumps of {len(conditions)} conditions; at least {FEWEST} of {CONDITIONS} are "
                "needed" + "".join(f"; left out: {why}" for why in left_out)
            ]
        )
    return _conditioned(jumps), left_out


def spec_of(e: Experiment) -> ModelSpec:
    """[model], or the contract's default."""
    spec: ModelSpec | None = e.section(ModelSpec)
    if spec is not None and spec.laws:
        raise InputError([f"{e.path / 'experiment.toml'}: [model.laws]: one set of parameters is questioned at a time; "
                          "give values in place of laws, and a campaign for each packing"])  # fmt: skip
    if spec is not None:
        return spec
    if e.ground == "hard":
        return ModelSpec()
    raise InputError([f"{e.path / 'experiment.toml'}: [model]: missing; on granular ground its parameters are needed"])


def _jump(e: Experiment, results: Path) -> Jump:
    law, log, section = e.section(Actuation), e.section(MotorLog), e.section(Bed)
    bed = BedHeight.load(results) if (results / BedHeight.file).exists() else None
    p, _ = read(SimulateParams, e.params.get("simulate", {}), "")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StageWarning)  # said by the stage `simulate`
        model = build_model(e, e.section(Robot), spec_of(e), section, bed)
        forcing, stop = driver(log, law, e.section(Motor), p or SimulateParams())
    rod = RodMotion.load(results)
    t, y, sigma = rod.arrays
    phi = packing(section, bed)[0]
    labels = {
        "kind": law.kind if law else LOGGED,
        "frequency": law.frequency if law else None,
        "delay": law.delay if law else 0.0,
        "volume_fraction": None if phi is None else round(phi, 2),
    }
    known = (
        (LOGGED, e.header.group or e.name) if law is None
        else (law.kind, law.frequency, law.amplitude, law.start_phase, law.cycles, law.delay)
    )  # fmt: skip
    condition = " ".join(str(x) for x in (*known, labels["volume_fraction"]))
    return Jump(
        e.name, model, forcing, stop, t, y, e.header.group or condition, condition,
        law=log is None, labels=labels, sigma=sigma if states_noise(e) else None, shared=common_errors(e, rod),
    )  # fmt: skip


def _conditioned(jumps: list[Jump]) -> list[Jump]:
    """Trials of a group share a condition."""
    condition: dict[str, str] = {}
    for j in jumps:
        condition.setdefault(j.group, j.condition)
    return [replace(j, condition=condition[j.group]) for j in jumps]


def states_noise(e: Experiment) -> bool:
    """Whether the noise of the track is stated: our own tracks state it, a table may."""
    table = e.section(RodTrack)
    if e.section(RodVideo) is not None or table is None:
        return True
    with table.path.open(encoding="utf-8-sig", errors="replace") as file:  # checked as a whole when it was tracked
        return "sigma_m" in file.readline()


def common_errors(e: Experiment, rod: RodMotion) -> Shared:
    """What the recording shares with others of its apparatus."""
    s = shared_of(e)
    lens = rod.lens
    return Shared(s.apparatus, s.scale, s.offset, s.rate, lens if np.any(lens) else None)
