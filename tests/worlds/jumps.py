"""A campaign of the laboratory as `jumpvision diagnose` would read it from its folders, and the question put to it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from jumpvision.engine.discovery import Laws
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.engine.fitting import Problem
from jumpvision.engine.order import Order, silent
from jumpvision.experiment.inputs.sections import Actuation
from jumpvision.experiment.stages.rod import commanded
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.forcing import from_motion
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.question.discovered import JumperForms
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.jumps import Jump
from jumpvision.jumper.question.learning import learn_noise
from jumpvision.jumper.question.words import diagnosis_of
from jumpvision.laboratory.blind import ROBOTS, Recorded, Setting

ENCODER = 6.25e-6  # m


@dataclass(frozen=True)
class Task:
    """A campaign: its jumps (tracks, what drove them, the declared model), ranges and priors of declared values."""

    jumps: list[Jump]
    ranges: dict[str, tuple[float, float]]
    priors: dict[str, float]


def jumps_of(setting: Setting, recorded: list[Recorded]) -> tuple[list[Jump], dict[str, Any], dict[str, float]]:
    """Return (jumps, ranges, priors) of a campaign's recordings."""
    ground, spec, sigma = setting.protocol.ground, setting.protocol.model, setting.protocol.robot_sigma
    parameters = {k: v for k, v in spec.items() if k not in ("terms", "fit", "sigma")}
    fit = {k: (float(v[0]), float(v[1])) for k, v in spec.get("fit", {}).items()}
    parameters |= {k: sum(v) / 2 for k, v in fit.items() if k not in parameters}
    jumps = []
    for i, r in enumerate(recorded):
        model = Model(
            ground, tuple(spec["terms"]), ModelParameters(**parameters),
            **ROBOTS[ground]._asdict(), volume_fraction=r.volume_fraction or None,
            grain_density=setting.protocol.bed.grain_density,
        )  # fmt: skip
        j, m = r.jump, r.jump.law
        law = Actuation(j.kind, m.frequency, m.amplitude, m.phase, m.cycles, m.delay, start=m.start)
        forcing = commanded(law)
        if r.motor is not None:
            time_s, position = r.motor["time_s"], r.motor["position_m"]
            if np.max(np.abs(position - forcing(time_s)[0])) > ENCODER:
                forcing = from_motion(time_s, position, ENCODER / np.sqrt(12.0))
        t, height = r.track["time_s"], r.track["height_m"]
        phi = round(r.volume_fraction, 2) if r.volume_fraction else None
        condition = f"{j.kind} {m.frequency} {m.delay} {phi}"
        labels = {"kind": j.kind, "frequency": m.frequency, "delay": m.delay, "volume_fraction": phi}
        y = height - height[t < law.start].mean()
        by_law, stated = r.motor is None, r.track.get("sigma_m")
        jumps.append(
            Jump(f"{condition}-{i}", model, forcing, law.stop, t, y, condition, condition, by_law, labels, stated)
        )
    return jumps, fit, {**spec.get("sigma", {}), **sigma}


def diagnose_jumps(task: Task) -> Diagnosis:
    """Diagnose a campaign by the whole order, laws of no list included."""
    learned = learn_noise(Jumper(task.jumps, task.ranges, task.priors, workers=1))
    problem = Problem(learned.system, learned.noise, learned.scatter)
    laws = lambda p: Laws(p, JumperForms(p.system), silent)  # noqa: E731
    stops = [j.stop for j in task.jumps]
    order = Order(problem, np.random.default_rng(1), by=("kind",), stops=stops, laws=laws)
    return diagnosis_of(order.all(), learned)
