"""Measured jump heights of a campaign beside simulation: their difference and its significance.

Every experiment goes through the pipeline (what is there already is not computed again); each is simulated at its own
robot, model and motor by the stage `simulate`.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, cast

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from jumpvision.base.arrays import Array
from jumpvision.base.progress import watch
from jumpvision.base.schema import InputError, check_value
from jumpvision.estimate.estimate import independent
from jumpvision.estimate.mean import Agreement, agreement
from jumpvision.experiment.inputs.experiment import Campaign, Experiment, open_campaign
from jumpvision.experiment.inputs.model import ModelSpec, read_model
from jumpvision.experiment.inputs.parameters import SimulateParams
from jumpvision.experiment.inputs.sections import Actuation, Bed, Motor, MotorLog, Robot
from jumpvision.experiment.results.fields import as_attributes, attributes_of
from jumpvision.experiment.results.tables import RodMotion
from jumpvision.experiment.results.values import BedHeight
from jumpvision.experiment.stages.recordings import shared_of
from jumpvision.experiment.stages.simulate import simulate
from jumpvision.experiment.stages.summary import simulated_height
from jumpvision.experiment.workflow.many import run_campaign
from jumpvision.experiment.workflow.run import Outcome, Plan
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.experiment.workflow.workspace import Workspace
from jumpvision.jumper.mechanisms.registry import ModelParameters

from .axes import AXES
from .robot import Say, Setup, Tables, setup_of
from .sweep import Origin

FILE = "comparison.nc"
LEVEL = 0.05  # corrected p of a condition that stands out
LAW = ("frequency", "phase", "amplitude", "cycles", "delay")  # of a condition
DECLARED = "declared model"


@dataclass(frozen=True)
class Jump:
    """One measured jump: height with its sigma and the model's [m]; steps: of the model per sigma of a parameter.

    sigma is all of the height's uncertainty, common the part of it that other jumps of the `apparatus` share.
    """

    experiment: Experiment
    height: float
    sigma: float
    common: float
    apparatus: str
    model: float
    steps: dict[str, float]
    phi: float = math.nan  # volume fraction, as given or measured
    bed: BedHeight | None = None
    other: float = math.nan  # m, by the model of a file

    @property
    def law(self) -> dict[str, float]:
        return law_of(self.experiment)

    @property
    def condition(self) -> tuple[str | float, ...]:
        """Trials of the same group and law are repeats; without a group beds that are as dense."""
        group = self.experiment.header.group
        bed = 0.0 if group or math.isnan(self.phi) else round(self.phi, 3)
        return (group, bed, *(round(x, 9) for x in self.law.values()))


def law_of(e: Experiment) -> dict[str, float]:
    """The numbers of [actuation]; the phase counts modulo 2 pi."""
    a = e.required(Actuation)
    return {
        "frequency": a.frequency or math.nan,
        "phase": a.start_phase % (2 * math.pi),
        "amplitude": a.amplitude or math.nan,
        "cycles": a.cycles,
        "delay": a.delay,
    }


@dataclass(frozen=True)
class Comparison:
    """The campaign as a whole: chi2 of its conditions, its probability, and the least of any one (Holm)."""

    campaign: str
    chi2: float
    conditions: int
    p_value: float
    p_largest: float


def compare(
    ground: str,
    folder: Path,
    results: Path,
    *,
    model: Path | None = None,
    overrides: Tables | None = None,
    workers: int = 1,
    say: Say = print,
) -> xr.Dataset:
    """Measured jump heights of a campaign beside their simulation, with the significance of the difference.

    The models are the declared one and that of the file `model`. Returns conditions (dimension `condition`) and trials.
    InputError where a campaign has no jump to compare. Experiments without a height are told.
    """
    overrides = overrides or {}
    campaign = open_campaign(folder, overrides=overrides)
    other = [e for e in campaign.experiments if e.ground != ground]
    if other:
        raise InputError(
            [
                f"{e.path}: ground = '{e.ground}': sweep {e.ground} compares it; give campaigns of one ground"
                for e in other
            ]
        )
    command = f"jumpvision sweep {ground} --analysis comparison"
    replaced = read_model(model) if model else None
    plan = Plan(results, results / ".cache", stages=("summary",), command=command)
    outcomes = run_campaign(campaign, plan, workers=workers, done=lambda o: say(f"{o.name}: {o.seconds:.1f} s"))
    jumps = []
    for e, o in zip(campaign.experiments, watch(outcomes, "simulations")):
        why = problem(o) or unmodelled(e)
        if why:
            say(f"{e.name}: left out: {why}")
        else:
            jumps.append(measured_jump(e, o, plan, replaced))
    if not jumps:
        raise InputError(
            [
                f"{campaign.path}: no experiment has a measured jump height; it needs [rod_video] or "
                "[rod_track], and an [actuation] that moves"
            ]
        )
    keys = list(dict.fromkeys(sorted(j.condition for j in jumps)))
    at = np.array([keys.index(j.condition) for j in jumps])
    names = list(dict.fromkeys(n for j in jumps for n in j.steps))
    steps = np.array([[j.steps.get(n, 0.0) for n in names] for j in jumps]).reshape(len(jumps), len(names))
    height, sigma, common, simulated = (
        np.array([getattr(j, n) for j in jumps]) for n in ("height", "sigma", "common", "model")
    )
    shared = [common * np.array([j.apparatus == one for j in jumps]) for one in {j.apparatus: None for j in jumps}]
    found = agreement(
        height,
        independent(sigma, common),
        simulated,
        at,
        steps,
        rng=np.random.default_rng(0),
        shared=np.transpose(shared) if common.any() else (),
    )
    firsts = [[j for j, c in zip(jumps, at) if c == k] for k in range(found.trials.size)]
    by_model = {DECLARED: found.model}
    if model:
        by_model[model.name] = np.array([np.mean([j.other for j in trials]) for trials in firsts])
    robot = setup_of(ground, jumps[0].experiment.path, overrides, bed_seen=jumps[0].bed)
    return _dataset(campaign, robot, jumps, at, steps, names, found, by_model)


def unmodelled(e: Experiment) -> str:
    """Why an experiment has no simulation; "" when it has."""
    if e.section(Robot) is None:
        return "[robot]: missing"
    return "[model]: missing, on sand" if e.ground == "granular" and e.section(ModelSpec) is None else ""


def problem(o: Outcome) -> str:
    """Why an experiment cannot be compared; "" when it can."""
    if o.errors:
        return o.errors[0]
    if None in o.summary.jump_height:
        return "no measured jump height: " + ("; ".join(o.not_run) or "its track does not give one")
    return ""


def measured_jump(e: Experiment, o: Outcome, plan: Plan, other: ModelSpec | None = None) -> Jump:
    """The measured height beside the model's, and what one sigma of each uncertain parameter does to the latter. other:
    a model whose height is taken too."""
    bed = BedHeight.load(o.results) if o.made(BedHeight) else None
    workspace = Workspace(e, o.results, plan.cache)
    rod, p = workspace.make(RodMotion), workspace.parameters(simulate)
    log, law, motor = e.section(MotorLog), e.section(Actuation), e.section(Motor)

    def height(robot: Robot, spec: ModelSpec, p: SimulateParams = p) -> float:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", StageWarning)  # told when the stage itself ran
            done = simulate(e, robot, spec, log, law, motor, e.section(Bed), bed, rod, p=p)
        return float(simulated_height(done, law, log) or math.nan)

    robot, spec = e.required(Robot), e.section(ModelSpec) or ModelSpec()  # hard ground without [model]: no term
    steps = {name: (height(*high) - height(*low)) * share for name, low, high, share in variations(robot, spec)}
    model = height(robot, spec)
    if log is not None:  # smoothed by its encoder's step: twice that shows what smoothing does, 0 where the law drives
        coarse = dataclasses.replace(p, encoder_step=2.0 * p.encoder_step)
        steps["motor_log of " + ", ".join(f"{x:g}" for x in law_of(e).values())] = height(robot, spec, coarse) - model
    by_other = height(robot, other) if other is not None else math.nan
    phi = o.summary.volume_fraction.value
    seen = o.summary.jump_height.numbers
    return Jump(e, *seen, shared_of(e).apparatus, model, steps, math.nan if phi is None else phi, bed, by_other)


Version = tuple[Robot, ModelSpec]


def variations(robot: Robot, spec: ModelSpec) -> Iterator[tuple[str, Version, Version, float]]:
    """Of every uncertain parameter: name, one sigma below, one above (where allowed), and sigma / their distance."""
    for f in dataclasses.fields(robot.sigma):
        value, sigma = getattr(robot, f.name), getattr(robot.sigma, f.name)
        if value is not None and sigma > 0.0:
            lo, hi = _ends(Robot, f.name, value, sigma)
            low, high = (dataclasses.replace(robot, **cast(Any, {f.name: x})) for x in (lo, hi))
            yield f"robot.{f.name}", (low, spec), (high, spec), sigma / (hi - lo)
    for name, sigma in spec.sigma.items():
        if name in spec.parameters and sigma > 0.0:
            lo, hi = _ends(ModelParameters, name, spec.parameters[name], sigma)
            less, more = (dataclasses.replace(spec, parameters={**spec.parameters, name: x}) for x in (lo, hi))
            yield f"model.{name}", (robot, less), (robot, more), sigma / (hi - lo)


def _ends(owner: Any, name: str, value: float, sigma: float) -> tuple[float, float]:
    """value -+ sigma, or value itself on the side where that is not allowed."""
    meta = next(f.metadata for f in dataclasses.fields(owner) if f.name == name)
    lo, hi = (x if not check_value(x, float, meta)[1] else value for x in (value - sigma, value + sigma))
    return lo, hi


def _dataset(
    campaign: Campaign,
    robot: Setup,
    jumps: list[Jump],
    at: NDArray[np.int64],
    steps: Array,
    names: list[str],
    found: Agreement,
    by_model: dict[str, Array],
) -> xr.Dataset:
    first = [jumps[int(np.flatnonzero(at == c)[0])] for c in range(found.trials.size)]
    by_condition: dict[str, tuple[ArrayLike, str, str]] = {
        "measured_height_m": (found.measured, "m", "jump_height, mean of the trials"),
        "measured_sigma_m": (found.sigma, "m", "its standard uncertainty, with the scatter of trials"),
        "measured_sigma_common_m": (found.sigma_common, "m", "the part of it that conditions of one apparatus share"),
        "simulated_height_m": (found.model, "m", "jump_height of the simulation, mean over the trials' own parameters"),
        "model_sigma_m": (
            found.model_sigma,
            "m",
            "its standard uncertainty from [robot.sigma], [model.sigma] and the motor log",
        ),
        "difference_m": (found.measured - found.model, "m", "measured - simulated"),
        "z": (found.z, "1", "difference / sqrt(measured_sigma^2 + model_sigma^2), as a normal deviate"),
        "p": (found.p, "1", "two-sided probability of z"),
        "p_corrected": (found.p_holm, "1", "p corrected for the number of conditions (Holm)"),
        "stands_out": ((found.p_holm < LEVEL).astype(np.int8), "1", f"p_corrected < {LEVEL:g}"),
        "trials": (found.trials, "1", "experiments combined"),
        "scatter_m": (found.scatter, "m", "standard deviation of trials beyond their stated errors"),
        "scatter_dof": (found.dof, "1", "repeats from which the scatter is known; inf without repeats"),
    }
    by_trial: dict[str, tuple[ArrayLike, str, str]] = {
        "trial_condition": (at, "1", "index of its condition"),
        "trial_height_m": (np.array([j.height for j in jumps]), "m", "jump_height as measured"),
        "trial_sigma_m": (np.array([j.sigma for j in jumps]), "m", "its stated standard uncertainty"),
        "trial_simulated_m": (np.array([j.model for j in jumps]), "m", "jump_height of its simulation"),
    }

    def over(dim: str, columns: dict[str, tuple[ArrayLike, str, str]]) -> dict[str, xr.Variable]:
        return {
            n: xr.Variable((dim,), v, {"units": unit, "long_name": words}) for n, (v, unit, words) in columns.items()
        }

    variables = over("condition", by_condition) | over("trial", by_trial)
    words = {"units": "m", "long_name": "change of the simulated height by one sigma of the parameter"}
    variables["model_step_m"] = xr.Variable(("trial", "parameter"), steps, words)
    words = {"units": "m", "long_name": "jump_height by each model"}
    variables["model_height_m"] = xr.Variable(("model", "condition"), list(by_model.values()), words)
    coords = {
        n: xr.Variable(
            ("condition",),
            [{**j.law, "phi": j.phi}[n] for j in first],
            {"units": AXES[n].unit or "1", "long_name": AXES[n].meaning},
        )
        for n in (*LAW, "phi")
    }
    coords |= {
        "group": xr.Variable(("condition",), [j.experiment.header.group for j in first]),
        "kind": xr.Variable(("condition",), [j.experiment.required(Actuation).kind for j in first]),
        "model_name": xr.Variable(("model",), list(by_model)),
        "experiment": xr.Variable(("trial",), [j.experiment.name for j in jumps]),
        "parameter": xr.Variable(("parameter",), names),
    }
    whole = Comparison(
        campaign.path.resolve().name,
        chi2=found.chi2,
        conditions=found.trials.size,
        p_value=found.p_value,
        p_largest=float(found.p_holm.min()),
    )
    return xr.Dataset(variables, coords, as_attributes(Origin.of(robot, "comparison")) | as_attributes(whole))


def rows(data: xr.Dataset) -> list[dict[str, str | float | None]]:
    """One row a condition, and one of all."""
    columns = {
        "frequency_hz": data.frequency,
        "phase_rad": data.phase,
        "amplitude_mm": data.amplitude * 1e3,
        **({"volume_fraction": data.phi} if np.isfinite(data.phi).any() else {}),
        "trials": data.trials,
        "measured_mm": data.measured_height_m * 1e3,
        "sigma_mm": data.measured_sigma_m * 1e3,
        "simulated_mm": data.simulated_height_m * 1e3,
        "model_sigma_mm": data.model_sigma_m * 1e3,
        "difference_mm": data.difference_m * 1e3,
        "z": data.z,
        "p_corrected": data.p_corrected,
    }
    out: list[dict[str, str | float | None]] = []
    for c, odd in enumerate(data.stands_out.values):
        numbers = {n: float(f"{float(v[c]):.{2 if n == 'p_corrected' else 5}g}") for n, v in columns.items()}
        numbers["trials"] = int(data.trials[c])
        out.append({"group": str(data.group.values[c]), **numbers, "note": "stands out" if odd else ""})
    whole = attributes_of(Comparison, data)
    p = float(f"{whole.p_value:.2g}")
    known = {"group": "all", "trials": int(data.trials.sum()), "p_corrected": p}
    return [*out, dict.fromkeys(out[0]) | known | {"note": f"chi2 {whole.chi2:.4g} of {len(out)} conditions"}]
