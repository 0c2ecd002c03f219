"""Jumps that are not yet measured: those that could be made next with a robot, and those that a campaign declares."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, replace
from typing import TYPE_CHECKING

import numpy as np

from jumpvision.base.schema import InputError
from jumpvision.engine.fitting import Problem
from jumpvision.engine.noise.noise import Noise
from jumpvision.experiment.inputs.experiment import Campaign, Experiment
from jumpvision.experiment.inputs.parameters import SimulateParams
from jumpvision.experiment.inputs.sections import PHASES, Actuation, Bed, Motor, MotorLog, Robot, RodVideo
from jumpvision.experiment.stages.rod import commanded
from jumpvision.experiment.stages.simulate import build_model, driver
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.jumper.mechanisms.record import Mechanism
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.jumps import Jump

from .jumps import questioned, spec_of

if TYPE_CHECKING:
    from jumpvision.engine.worth.isolable import Isolable

START, AFTER = 0.2, 0.8  # s: of rest before the motor, recorded after it
TRACK_RATE_HZ, TRACK_NOISE_M = 200.0, 5e-5  # of a track whose film says nothing else
DELAYS = (0.05, 0.1, 0.2)  # s, of a delayed stutter


def usual(laws: Sequence[Actuation]) -> list[Actuation]:
    """Half-cycle jumps of the campaign's amplitude over kinds, frequencies about those done, and delays."""
    known = [law for law in laws if law.frequency and law.amplitude]
    if not known:
        return []
    amplitude = round(float(np.median([law.amplitude for law in known if law.amplitude])), 6)
    done = [law.frequency for law in known if law.frequency]
    frequencies = np.linspace(0.8 * min(done), 1.25 * max(done), 9).round(1).tolist()
    delays = {"single": (0.0,), "stutter": (0.0,), "delayed_stutter": DELAYS}
    return [
        Actuation(kind, f, amplitude, round(PHASES[kind], 8), 1.0, delay, start=START)
        for kind, each in delays.items()
        for f in frequencies
        for delay in each
    ]


def unmade(base: Jump, law: Actuation) -> Jump:
    """A jump of this command with the robot, the ground and the apparatus of another, its track not yet there."""
    forcing = commanded(law)
    t = np.arange(0.0, forcing.stop + AFTER, float(np.median(np.diff(base.t))))
    name = f"{law.kind}-{law.frequency:g}Hz" + (f"-{law.delay:g}s" if law.delay else "")
    return replace(
        base,
        name=name,
        forcing=forcing,
        stop=forcing.stop,
        t=t,
        y=np.zeros(t.size),
        group=name,
        condition=name,
        labels={"kind": law.kind, "frequency": law.frequency, "delay": law.delay},
        sigma=None,
        shared=replace(base.shared, lens=None),
    )


def offer(
    problem: Problem,
    system: Jumper,
    laws: Sequence[Actuation],
    ranges: Mapping[str, tuple[float, float]],
    priors: Mapping[str, float],
    own: Sequence[Mechanism] = (),
) -> tuple[Problem, list[int]]:
    """(the jumps made with these beside them, places of these): a system that foretells them with the same noise.

    ranges, priors, own: those that `system` was made with.
    """
    new = [unmade(system.jumps[0], law) for law in laws]
    wider = Jumper([*system.jumps, *new], ranges, priors, system.workers, own)
    ones = [np.ones(j.t.size) for j in wider.jumps]
    asked = problem.asked_of(wider.weighted(ones, system.scattering))
    return asked, list(range(len(system.jumps), len(wider.jumps)))


def weigh_declared(campaign: Campaign, workers: int = 1) -> Isolable:
    """Tabulate which causes the jumps of a campaign could show, from what is declared alone.

    Raises InputError where no experiment says how it is driven.
    """
    from jumpvision.engine.worth.isolable import weigh_causes

    made: list[tuple[Experiment, Jump]] = []
    left_out = []
    for e in questioned(campaign):
        try:
            made.append((e, _declared(e)))
        except InputError as x:
            left_out.append(f"{e.name}: {x.problems[0]}")
    if not made:
        said = "no experiment with [robot] and [actuation] to predict"
        raise InputError([f"{campaign.path}: {said}; {'; '.join(left_out)}"])
    first, jumps = made[0][0], [j for _, j in made]
    spec = spec_of(first)
    priors = {**spec.sigma, **{n: s for n, s in asdict(first.required(Robot).sigma).items() if s}}
    system = Jumper(jumps, {n: (low, high) for n, (low, high) in spec.fit.items()}, priors, workers)
    noise = Noise(TRACK_NOISE_M, 0.0, float(np.median(np.diff(jumps[0].t))))
    return weigh_causes(Problem(system, noise), f"jumps with {1e3 * TRACK_NOISE_M:g} mm of noise", left_out)


def _declared(e: Experiment) -> Jump:
    """Return the jump of an experiment as declared, without its track."""
    law, log, film = e.section(Actuation), e.section(MotorLog), e.section(RodVideo)
    if law is None or not law.moves or law.kind == "custom":
        raise InputError(["only a log says how it is driven"])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", StageWarning)  # said where it is simulated
        model = build_model(e, e.required(Robot), spec_of(e), e.section(Bed), None)
        forcing, stop = driver(None, law, None if log else e.section(Motor), SimulateParams())
    t = np.arange(0.0, stop + AFTER, 1.0 / ((film and film.frame_rate) or TRACK_RATE_HZ))
    labels = {"kind": law.kind, "frequency": law.frequency, "delay": law.delay}
    return Jump(e.name, model, forcing, stop, t, np.zeros(t.size), e.name, e.name, log is None, labels)
