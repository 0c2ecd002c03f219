"""The jumps of a campaign as the diagnosis needs them, and what its films measure of the model beside them."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.numbers import format_count
from jumpvision.base.schema import InputError, WarningRecord, read, warnings_in
from jumpvision.engine.priors import Measured
from jumpvision.experiment.inputs.experiment import Campaign, Experiment
from jumpvision.experiment.inputs.model import ModelSpec
from jumpvision.experiment.inputs.parameters import SimulateParams
from jumpvision.experiment.inputs.sections import Actuation, Bed, Clock, Motor, MotorLog, Robot, RodTrack, RodVideo
from jumpvision.experiment.results.tables import RodMotion, Simulation
from jumpvision.experiment.results.values import BedHeight, Fits
from jumpvision.experiment.stages.bed.height import packing
from jumpvision.experiment.stages.fit import height_fits
from jumpvision.experiment.stages.recordings import shared_of
from jumpvision.experiment.stages.rod import motor_runs, total_mass
from jumpvision.experiment.stages.simulate import build_model, driver
from jumpvision.experiment.workflow.run import Outcome
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.jumper.question.jumps import Jump, Shared

from .circumstances import circumstances

FEWEST, CONDITIONS = 4, 2  # jumps, and different conditions among them, that can tell anything
LOGGED = "logged_motion"  # kind of a jump that only a motor log describes, such as a planned one


def questioned(campaign: Campaign) -> list[Experiment]:
    """Experiments with a robot, something that drives it, a track and, on granular ground, a model."""
    return [e for e in campaign.experiments if _usable(e)]


def _law(e: Experiment) -> Actuation | None:
    """[actuation] that tells the motion; None where only a log does."""
    law: Actuation | None = e.section(Actuation)
    return law if law and law.kind != "custom" else None


def _usable(e: Experiment) -> bool:
    law = e.section(Actuation)
    moved = e.section(MotorLog) is not None or (law is not None and law.moves)
    tracked = "rod_video" in e.sections or "rod_track" in e.sections
    return moved and tracked and e.section(Robot) is not None and (e.ground == "hard" or "model" in e.sections)


def load_jumps(
    experiments: list[Experiment], outcomes: Mapping[str, Outcome]
) -> tuple[list[Jump], list[str], list[str]]:
    """(jumps, what was left out and why, warnings no stage has said), from the rod.csv of each experiment's results.

    The experiments' models on one ground have the same terms; their parameters may differ, by [model.laws] of the
    packing too. Raises InputError where terms or what may be fitted differ, or when too few jumps are left.
    """
    left_out: list[str] = []
    warned: list[str] = []
    jumps: list[Jump] = []
    first: dict[str, Experiment] = {}
    sand = any(e.ground == "granular" for e in experiments)
    known = circumstances(experiments)
    for e in experiments:
        if sand and e.ground == "hard" and e.section(ModelSpec) is None:
            left_out.append(
                f"{e.name}: on hard ground, in a campaign on sand; with a [model] it is tested with the others"
            )
            continue
        like = first.setdefault(e.ground, e)
        own, spec = spec_of(e), spec_of(like)
        if differs := [n for n in ("terms", "fit", "sigma") if getattr(own, n) != getattr(spec, n)]:
            raise InputError(
                [
                    f"{e.path / 'experiment.toml'}: [model] {', '.join(differs)}: not those of {like.name}; "
                    f"models on {e.ground} ground have the same terms and fit the same parameters (values may differ): "
                    "give both in campaign.toml, or diagnose the experiments in separate campaigns"
                ]
            )
        outcome = outcomes[e.name]
        if not outcome.made(RodMotion):
            left_out.append(f"{e.name}: {outcome.errors[0] if outcome.errors else 'no track'}")
            continue
        jump, warnings_of_jump = _jump(e, outcome)
        jumps.append(replace(jump, circumstances=known[e.name]))
        warned += [f"{e.name}: {t['message']}" for t in warnings_of_jump if not outcome.made(Simulation)]
    conditions = {j.condition for j in jumps}
    if len(jumps) < FEWEST or len(conditions) < CONDITIONS:
        had = f"{format_count(len(jumps), 'jump')} of {format_count(len(conditions), 'condition')}"
        lacking = "".join(f"; left out: {why}" for why in left_out)
        raise InputError([f"{had}; at least {FEWEST} of {CONDITIONS} are needed{lacking}"])
    return _conditioned(jumps), left_out, warned


def spec_of(e: Experiment) -> ModelSpec:
    """[model], or the contract's default."""
    spec: ModelSpec | None = e.section(ModelSpec)
    if spec is not None:
        return spec
    if e.ground == "hard":
        return ModelSpec()
    raise InputError([f"{e.path / 'experiment.toml'}: [model]: missing; on granular ground its parameters are needed"])


def _jump(e: Experiment, outcome: Outcome) -> tuple[Jump, list[WarningRecord]]:
    """The jump, and what the stage `simulate` would say of its model and its motor."""
    law, log, section = _law(e), e.section(MotorLog), e.section(Bed)
    bed = BedHeight.load(outcome.results) if outcome.made(BedHeight) else None
    p, _ = read(SimulateParams, e.params.get("simulate", {}), "")
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", StageWarning)
        model = build_model(e, e.required(Robot), spec_of(e), section, bed)
        forcing, stop = driver(
            log, e.section(Actuation), e.section(Motor), p or SimulateParams(), sand=e.ground == "granular"
        )
    rod = RodMotion.load(outcome.results)
    # by the stage's own function: a jump whose grain film is still being matched has no fits.json yet
    height = height_fits(rod, e.section(Robot), motor_runs(e.section(Actuation), log), e.section(Clock)).get(
        "jump_height_m"
    )
    t, y, sigma = rod.arrays
    phi = packing(section, bed)[0]
    labels = {
        "kind": law.kind if law else LOGGED,
        "frequency": law.frequency if law else None,
        "delay": law.delay if law else 0.0,
        "volume_fraction": None if phi is None else round(phi, 2),
    }
    known = (
        (LOGGED, e.header.group or e.name)
        if law is None
        else (law.kind, law.frequency, law.amplitude, law.start_phase, law.cycles, law.delay)
    )
    condition = " ".join(str(x) for x in (*known, labels["volume_fraction"]))
    jump = Jump(
        e.name,
        model,
        forcing,
        stop,
        t,
        y,
        e.header.group or condition,
        condition,
        law=log is None,
        labels=labels,
        sigma=sigma if states_noise(e) else None,
        shared=common_errors(e, rod),
        measured=(height.value, height.sigma) if height and height.known else None,
    )
    return jump, warnings_in(caught)


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


CONE = {"C": ("C", 1.0), "mu": ("mu_cone", 1.0), "theta": ("theta_cone_deg", math.pi / 180.0)}  # fits.json, to SI
ALIKE = 0.01  # relative difference of foot radius, or volume fraction, up to which two experiments tell of one model


def measurements(
    experiments: Sequence[Experiment], outcomes: Mapping[str, Outcome], robot: Robot, phi: float | None
) -> list[Measured]:
    """Of all experiments with a foot and a bed like those of the jumps: the cone by grain films (C, mu, theta), the
    static force and its overshoots by intrusions, the spring by its own test, its damping by ring-downs without a
    motor. Several of a kind are averaged, what they share is not.
    """
    found: dict[str, list[tuple[str, Measured, Array]]] = {}
    for e in experiments:
        outcome = outcomes.get(e.name)
        if outcome is None or not outcome.made(Fits) or not _alike(e, robot, phi):
            continue
        fits = Fits.load(outcome.results)
        kinds = {"film": CONE, "spring test": _own("spring_stiffness")}
        if "intrusion_log" in e.sections:
            kinds["intrusion"] = _own("k1", "k2", "delta")
            for kind, strength in (("paused intrusion", "s_p"), ("repeated intrusion", "s")):
                if fits.get(strength) is not None:  # lam is then of these events
                    kinds[kind] = _own(strength, "lam")
        if (damping := _damping(e)) is not None:
            kinds["ring-down"] = {"spring_damping": ("zeta", damping)}
        for kind, names in kinds.items():
            if (seen := _read(fits, names, f"{kind} {e.name}")) is not None:
                found.setdefault(kind, []).append((e.name, *seen))
    return [_together(kind, seen) for kind, seen in found.items()]


def _own(*names: str) -> dict[str, tuple[str, float]]:
    return {n: (n, 1.0) for n in names}


def _damping(e: Experiment) -> float | None:
    """2 sqrt(k M) [N s/m], by which zeta is the spring's damping; None where a motor moves or the robot is unknown."""
    robot, law = e.section(Robot), e.section(Actuation)
    mass = total_mass(robot)
    if robot is None or not robot.spring_stiffness or mass is None or (law is not None and law.moves):
        return None
    return 2.0 * math.sqrt(robot.spring_stiffness * mass)


def _alike(e: Experiment, robot: Robot, phi: float | None) -> bool:
    """Whether what an experiment measures of foot and sand is that of the jumps."""
    own, bed = e.section(Robot), e.section(Bed)
    pairs = [(own.foot_radius if own else None, robot.foot_radius), (bed.volume_fraction if bed else None, phi)]
    return all(a is None or b is None or abs(a - b) <= ALIKE * abs(b) for a, b in pairs)


def _read(fits: Fits, names: Mapping[str, tuple[str, float]], source: str) -> tuple[Measured, Array] | None:
    """(what fits.json says of these parameters, its covariance that other experiments share); None where nothing."""
    have = {n: (e, unit) for n, (key, unit) in names.items() if (e := fits.get(key)) and e.sigma > 0.0}
    if not have:
        return None
    value = np.array([e.value * u for e, u in have.values()])
    sigma = np.array([e.sigma * u for e, u in have.values()])
    common = np.array([e.sigma_common * u for e, u in have.values()])
    keys = list(have)
    correlation = np.eye(len(keys))
    for i, a in enumerate(keys):
        for j, b in enumerate(keys):
            entry = fits.get(f"correlation_{a}_{b}") or fits.get(f"correlation_{b}_{a}")
            if i != j and entry and entry.known:
                correlation[i, j] = entry.value
    own = np.sqrt(np.maximum(sigma**2 - common**2, 0.0))
    shared = np.outer(common, common)
    return Measured(tuple(keys), value, correlation * np.outer(own, own) + shared, source), shared


def _together(kind: str, seen: Sequence[tuple[str, Measured, Array]]) -> Measured:
    """The mean of several measurements of the same parameters, its covariance widened where they scatter by more."""
    names = max((m.names for _, m, _ in seen), key=len)
    seen = [x for x in seen if x[1].names == names]
    if len(seen) == 1:
        return seen[0][1]
    shared = np.mean([s for _, _, s in seen], axis=0)
    weights = [np.linalg.inv(m.covariance - s) for _, m, s in seen]
    covariance = np.linalg.inv(np.sum(weights, axis=0))
    mean = covariance @ np.sum([w @ m.values for w, (_, m, _) in zip(weights, seen)], axis=0)
    chi2 = sum(float((m.values - mean) @ w @ (m.values - mean)) for w, (_, m, _) in zip(weights, seen))
    wider = max(1.0, chi2 / (len(names) * (len(seen) - 1)))
    plural = {"film": "grain films"}.get(kind, kind + "s")
    return Measured(names, mean, covariance * wider + shared, f"{len(seen)} {plural}")
