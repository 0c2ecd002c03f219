"""Measured jump heights of a campaign beside simulation, along any axis: their difference and its significance.

Every experiment goes through the pipeline (what is there already is not computed again); each is simulated at its own
robot, model and motor by the stage `simulate`.
"""

from __future__ import annotations

import dataclasses
import math
import warnings
from collections.abc import Iterator, Sequence
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
from jumpvision.experiment.stages.rod import total_mass
from jumpvision.experiment.stages.simulate import simulate
from jumpvision.experiment.stages.summary import simulated_height
from jumpvision.experiment.workflow.many import run_campaign
from jumpvision.experiment.workflow.run import Outcome, Plan
from jumpvision.experiment.workflow.stage import StageWarning
from jumpvision.experiment.workflow.workspace import Workspace
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.batch import hard_points, resolve

from .along import DECLARED, LAW, OVER, Along, Place, drawn_along
from .axes import AXES
from .robot import Say, Setup, Tables, setup_of
from .sweep import Origin

FILE = "comparison.nc"
LEVEL = 0.05  # corrected p of a condition that stands out
COORDS = OVER
DRAWN = 80  # points an axis of the simulated map behind the measured points


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
    def at(self) -> dict[str, float]:
        """The numbers of OVER."""
        robot = self.experiment.required(Robot)
        mass, k, law = total_mass(robot) or math.nan, robot.spring_stiffness or math.nan, self.law
        alpha = mass * robot.gravity / (k * law["amplitude"])
        rest = {"alpha": alpha, "gravity": robot.gravity, "phi": self.phi, "foot_radius": robot.foot_radius or math.nan}
        return {**law, **rest}

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
    over: str = "",
    overrides: Tables | None = None,
    workers: int = 1,
    say: Say = print,
) -> xr.Dataset:
    """Measured jump heights of a campaign beside their simulation, with the significance of the difference.

    Along what varies most, or `over` an axis: series of jumps that differ in it alone, and each model's curve, the
    declared one's and that of the file `model`. Returns conditions (dimension `condition`), trials and curves.
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
    robot = setup_of(ground, jumps[0].experiment.path, overrides, bed_seen=jumps[0].bed)
    data = _dataset(campaign, robot, jumps, at, steps, names, found)
    firsts = [[j for j, c in zip(jumps, at) if c == k] for k in range(found.trials.size)]
    places = [
        Place(
            {n: float(np.mean([j.at[n] for j in trials])) for n in OVER},
            trials[0].experiment.required(Actuation).kind,
            trials[0].experiment,
            trials[0].bed,
        )
        for trials in firsts
    ]
    files = [None, *([model] if model else [])]
    along = drawn_along(places, over, files, overrides, workers=workers, say=say)
    spread = [np.std([j.height for j in trials], ddof=1) if len(trials) > 1 else math.nan for trials in firsts]
    by_other = [float(np.mean([j.other for j in trials])) for trials in firsts]
    data = data.assign(_along(along, files, np.array(spread), np.stack([found.model, by_other])[: len(files)]))
    labels = {
        "series_name": ("series", along.names),
        "model_name": ("model", [f.name if f else DECLARED for f in files]),
    }
    data = data.assign_coords(labels).assign_attrs(as_attributes(Drawn(along.over)))
    return data


@dataclass(frozen=True)
class Drawn:
    """The axis along which a comparison is drawn."""

    over: str


def _along(found: Along, files: Sequence[Path | None], spread: Array, by_model: Array) -> dict[str, xr.Variable]:
    """Series and curves as variables."""

    def variable(dims: tuple[str, ...], values: ArrayLike, unit: str, words: str) -> xr.Variable:
        return xr.Variable(dims, values, {"units": unit, "long_name": words})

    over = AXES[found.over]
    return {
        "condition_series": variable(("condition",), found.series, "1", "index of its series"),
        "trial_spread_m": variable(("condition",), spread, "m", "standard deviation of its trials; NaN for one"),
        "model_height_m": variable(("model", "condition"), by_model, "m", "jump_height by each model"),
        "curve_at": variable(("series", "point"), found.x, over.unit or "1", over.meaning),
        "curve_m": variable(
            ("series", "model", "point"), found.curves, "m", "jump_height of a model between the points"
        ),
    }


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
    coords = {
        n: xr.Variable(
            ("condition",), [j.at[n] for j in first], {"units": AXES[n].unit or "1", "long_name": AXES[n].meaning}
        )
        for n in COORDS
    }
    coords |= {
        "group": xr.Variable(("condition",), [j.experiment.header.group for j in first]),
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
    behind, more = simulated_map(robot, jumps)
    return xr.Dataset(
        variables | behind, coords | more, as_attributes(Origin.of(robot, "comparison")) | as_attributes(whole)
    )


def simulated_map(robot: Setup, jumps: list[Jump]) -> tuple[dict[str, xr.Variable], dict[str, xr.Variable]]:
    """The model's height between the points, over frequency and phase; nothing where robots or the rest differ."""
    rest = {n: {round(j.law[n], 9) for j in jumps} for n in LAW[2:]}
    sections = [(j.experiment.section(Robot), j.experiment.section(ModelSpec)) for j in jumps]
    spec = sections[0][1]
    # the height a camera reports is another, and so is the motion of a motor that a loop drives
    other = (spec is not None and "camera_scale" in spec.terms) or any(j.experiment.section(Motor) for j in jumps)
    if not robot.exact or other or any(len(v) > 1 for v in rest.values()) or any(s != sections[0] for s in sections):
        return {}, {}
    axes = []
    for n in LAW[:2]:
        x = np.array([j.law[n] for j in jumps])
        margin = 0.08 * np.ptp(x) or 0.1 * x[0] or 0.3  # around the range of the points
        axes.append(np.linspace(max(x.min() - margin, 0.05 * x.min()), x.max() + margin, DRAWN))
    given = {n: np.asarray(v.pop()) for n, v in rest.items()}
    grid = resolve(robot.values, given | {"frequency": axes[0][:, None], "phase": axes[1]})
    height = hard_points({n: np.broadcast_to(v, (DRAWN, DRAWN)) for n, v in grid.items()})["jump_height_m"]
    words = {"units": "m", "long_name": "jump_height simulated between the conditions"}
    dims = ("map_frequency", "map_phase")
    return {"simulated_map_m": xr.Variable(dims, height, words)}, {
        n: xr.Variable((n,), a, {"units": AXES[n[4:]].unit}) for n, a in zip(dims, axes)
    }


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
