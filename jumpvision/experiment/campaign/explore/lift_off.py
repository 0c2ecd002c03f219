"""The smallest amplitude that lifts off hard ground, by bisection over trials, with its interval.

Until the foot leaves, the spring is compressed, so the rod lies below M g / k over rest; M all that the spring carries.
A trial's track is fitted by the model's, with a factor and a stiffness, its greatest height compared with that
threshold: r, above 1 where it lifted. In contact the motion is linear in the amplitude A, so a trial near the threshold
also says where it is: A / r.
"""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from jumpvision.base.arrays import Z90, Array
from jumpvision.base.schema import InputError
from jumpvision.base.storage import write_aside
from jumpvision.experiment.campaign.diagnose import Question
from jumpvision.experiment.inputs.sections import PHASES, Actuation
from jumpvision.jumper.physics.forcing import Segments
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.physics.sand.jump import simulate
from jumpvision.jumper.question.jumper import ATOL, RTOL
from jumpvision.jumper.question.jumps import Jump

from .handover import prepare
from .offers import START, Way
from .rounds import limits_for

FILE, KINDS = "lift_off.json", ("single", "stutter", "sine")

TRIALS, CLOSE = 12, 0.005  # trials at most; relative half width of the 90 % interval that is enough
NEAR, SURE = (0.4, 1.15), 2.0  # ratios of trials that are averaged; sigmas by which one lifted, or did not
STEP, FINER = 1e-3, 10  # relative, of the stiffness; times a frame
FACTOR = 2.0  # by which the amplitude is changed until a trial lifts and another does not


@dataclass(frozen=True)
class Trial:
    """A jump of amplitude [m]; ratio: its greatest height over the threshold, above 1 where it lifted, and sigma."""

    amplitude: float
    ratio: float
    sigma: float

    @property
    def lifted(self) -> bool:
        return self.ratio > 1.0


@dataclass(frozen=True)
class Threshold:
    """Amplitude [m] with its 90 % interval, the trials it is of, and the amplitude to try next (None: enough)."""

    value: float
    low: float
    high: float
    trials: int
    next: float | None


def height_of_lift_off(model: Model) -> float:
    """Of the rod over rest, where the foot leaves hard ground [m]."""
    return (model.M + model.m_f) * model.g / model.k_s


def trial(jump: Jump) -> Trial:
    """What the track of a jump says. Raises InputError on sand, and for a motion that is no sinusoid."""
    if jump.model.ground != "hard" or not isinstance(jump.forcing, Segments):
        what = "on sand, where the foot leaves at no one height" if jump.model.ground != "hard" else "by its motor log"
        raise InputError([f"{jump.name}: is {what}; the threshold is looked for on hard ground, by a commanded law"])
    amplitude = float(jump.forcing.rows[0, 3])
    use = jump.t < jump.stop + 0.5  # flights later after the motor's stop tell of landings
    measured, rest = jump.t[use], jump.t[use] < jump.forcing.start
    fine = np.linspace(measured[0], measured[-1], FINER * measured.size)  # frames miss the top by a per cent and more
    stiffer = replace(jump.model, spring_stiffness=jump.model.spring_stiffness * (1.0 + STEP))
    at, moved = (_height(jump, m, fine) for m in (jump.model, stiffer))
    both = np.stack([at, (moved - at) / STEP], axis=1)  # by a factor; by stiffness, which tells near resonance
    columns = np.stack([np.interp(measured, fine, c) for c in both.T], axis=1)
    y = jump.y[use] - jump.y[use][rest].mean()
    inverse = np.linalg.inv(columns.T @ columns)
    found = inverse @ (columns.T @ y)
    noise = max(float((y - columns @ found).std(ddof=3)), 1e-9)
    top, least = both[int(np.argmax(both @ found))], height_of_lift_off(jump.model)
    ratio = float(top @ found) / least * (1.0 + float(found[1] / found[0]))
    sigma = noise / least * math.sqrt(float(top @ inverse @ top) + 1.0 / max(int(rest.sum()), 1))
    return Trial(amplitude, ratio, sigma)


def _height(jump: Jump, model: Model, t: Array) -> Array:
    """Of the rod over rest at t (n,), as a model has it [m]."""
    motion = simulate(model, jump.forcing, t=t, rtol=RTOL, atol=ATOL, stop=jump.stop)
    return np.asarray(motion.rod[-t.size :] - motion.rest)


def threshold(trials: Sequence[Trial], common: float = 0.0) -> Threshold:
    """The smallest amplitude that lifts off, as far as trials say. common: relative sigma of M g / k, alike in all.

    Until two amplitudes enclose it, the next trial is FACTOR away; then in the middle of them; where trials can no
    longer be told from the threshold itself they are averaged.
    """
    lifted = [t.amplitude for t in trials if t.ratio - 1.0 > SURE * t.sigma]
    stayed = [t.amplitude for t in trials if 1.0 - t.ratio > SURE * t.sigma]
    low, high = max(stayed, default=0.0), min(lifted, default=math.inf)
    near = [t for t in trials if NEAR[0] < t.ratio < NEAR[1]]
    if near:
        weight = np.array([1.0 / (t.sigma / t.ratio) ** 2 for t in near])
        each = np.array([math.log(t.amplitude / t.ratio) for t in near])
        mean = float(weight @ each / weight.sum())
        scatter = float(weight @ (each - mean) ** 2) / max(len(near) - 1, 1)
        sigma = math.hypot(math.sqrt(max(scatter, 1.0) / weight.sum()), common)
        value, half = math.exp(mean), Z90 * sigma
        enough = len(trials) >= TRIALS or (half < max(CLOSE, Z90 * common * 1.1) and len(near) > 1)
        return Threshold(value, value * math.exp(-half), value * math.exp(half), len(trials), None if enough else value)
    if low > 0 and math.isfinite(high):
        middle = math.sqrt(low * high)
    else:
        middle = high / FACTOR if math.isfinite(high) else low * FACTOR
    return Threshold(middle, low, high, len(trials), None if len(trials) >= TRIALS else middle)


def search(
    asked: Question, kind: str, frequency: float, results: Path, waiting: Sequence[Path]
) -> tuple[Threshold, Path | None]:
    """(what the trials of a kind and frequency in the campaign say, the folder of the next, None where none is needed).

    lift_off.json has it. While a folder waits for its recordings no other is prepared.
    """
    mine = [j for j in asked.jumps if j.labels.get("kind") == kind and j.labels.get("frequency") == frequency]
    trials = [trial(j) for j in mine]
    stiffness = asked.jumps[0].model.k_s
    common = asked.priors.get("spring_stiffness", 0.0) / stiffness
    limits = limits_for(asked)
    usual = float(np.median([a.amplitude for e in asked.experiments if (a := e.section(Actuation)) and a.amplitude]))
    found = threshold(trials, common) if trials else Threshold(usual, 0.0, math.inf, 0, usual)
    high = found.high if math.isfinite(found.high) else None
    data = asdict(found) | {"high": high, "kind": kind, "frequency": frequency, "each": [asdict(t) for t in trials]}
    results.mkdir(parents=True, exist_ok=True)
    write_aside(results / FILE, json.dumps(data, indent=1) + "\n")
    if found.next is None or waiting:
        return found, None
    law = Actuation(kind, frequency, float(f"{found.next:.4g}"), PHASES[kind], start=START)
    name = f"lift-off-{kind}-{frequency:g}Hz-{len(trials) + 1:02d}"
    like = next((e for e in asked.experiments if e.ground == "hard"), None)
    if like is None:
        raise InputError([f"{asked.experiments[0].path.parent}: no experiment on hard ground; --lift-off needs one"])
    return found, prepare(
        like, Way(law), name, limits, [f"trial {len(trials) + 1} of the smallest amplitude that lifts off"]
    )
