"""The drag of sand fitted to the measured jumps of a campaign at every packing (thesis Fig 49, and b of eq. (34))."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.estimate.estimate import independent
from jumpvision.experiment.inputs.experiment import Experiment, open_campaign
from jumpvision.experiment.inputs.sections import Actuation
from jumpvision.experiment.workflow.many import run_campaign
from jumpvision.experiment.workflow.run import Plan
from jumpvision.jumper.physics.batch import OF_MODEL, resolve, simulated_points
from jumpvision.jumper.physics.model import fitted_parameter
from jumpvision.jumper.physics.packing import fit_packing_law
from jumpvision.thesis.studies.comparison import law_of, problem
from jumpvision.thesis.studies.compute import ATOL, RTOL, dataset
from jumpvision.thesis.studies.setup import setup_of
from jumpvision.thesis.studies.study import Found, Measured, Sweep, study

from .beds import kink

TRIED = {"b": np.geomspace(0.6, 120.0, 25), "alpha": np.geomspace(5.0, 1000.0, 25)}


@dataclass(frozen=True)
class Seen:
    """The measured jumps of a campaign: experiments, the numbers of their laws, heights [m] and volume fractions (n,).

    sigma, common: of the heights, all of it and the part that jumps share; phi_sigma, phi_common: of the packings.
    """

    used: list[Experiment]
    laws: dict[str, Array]
    height: Array
    sigma: Array
    common: Array
    phi: Array
    phi_sigma: Array
    phi_common: Array


def measured(given: Measured) -> Seen:
    """The campaign's jumps. InputError where none has a measured height and a packing."""
    campaign = open_campaign(given.campaign, overrides=given.overrides)
    if hard := [e for e in campaign.experiments if e.ground != "granular"]:
        raise InputError([f"{e.path}: ground = '{e.ground}': this fit is of granular ground" for e in hard])
    command = f"sweep granular --analysis {given.study.name}"
    plan, say = Plan(given.results, given.results / ".cache", stages=("summary",), command=command), given.say
    outcomes = run_campaign(campaign, plan, workers=given.workers, done=lambda o: say(f"{o.name}: {o.seconds:.1f} s"))
    used, laws, seen = [], [], []
    for e, o in zip(campaign.experiments, outcomes):
        why = problem(o) or ("" if o.summary.volume_fraction.value else "no volume fraction")
        if why:
            say(f"{e.name}: left out: {why}")
            continue
        for w in (w for w in o.warnings if (w["kind"], w["recording"]) == ("differs", "bed")):
            say(f"warning: {e.name}: {w['message']}")
        used.append(e)
        laws.append(law_of(e) | {"dwell_gain": e.required(Actuation).dwell_gain})
        seen.append((*o.summary.jump_height.numbers, *o.summary.volume_fraction.numbers))
    if not used:
        raise InputError([f"{campaign.path}: no experiment has a measured jump height and a volume fraction"])
    at = {n: np.array([law[n] for law in laws], float) for n in laws[0]}
    return Seen(used, at, *np.nan_to_num(np.array(seen)).T)


@dataclass(frozen=True)
class DragFit:
    """The parameter of the bed that is fitted."""

    parameter: str


@study("drag-fit", "granular", source="section 3.4")
def drag_fit(given: Measured) -> Found:
    """b (alpha without depth_drag) against packing, fitted to the jumps of a campaign.

    It has the least chi2 between measured and simulated heights at every packing. The data set has the jumps
    (dimension `jump`) and the packings; of five or more a law of phi is fitted. InputError where a campaign has no
    jump, or its model no drag.
    """
    seen = measured(given)
    used, phi, height, sigma, common = seen.used, seen.phi, seen.height, seen.sigma, seen.common
    robot = setup_of("granular", used[0].path, given.overrides, model_file=given.model_file, laws=given.laws)
    s = Sweep(given.study, dataclasses.replace(robot, thesis=False), {}, {}, given.workers, given.say)
    name = "b" if "depth_drag" in robot.model else "alpha"
    if not {"depth_drag", "inertial_drag"} & set(robot.model.terms):
        raise InputError(
            [
                f"model terms = {list(robot.model.terms)}: holds no drag to fit; add depth_drag or "
                "inertial_drag, or give --model FILE"
            ]
        )
    at, laws = dict(seen.laws), robot.laws.without([name]) if robot.laws else None
    if "kp" not in robot.values:
        del at["dwell_gain"]  # the law drives
    if laws and (said := laws.continued(phi)):
        given.say(said)
    tried = TRIED[name]

    def jumped(packing: Array) -> list[dict[str, Array]]:
        """The campaign's jumps at these packings with every value tried."""
        v = resolve(robot.values, at | {"phi": packing})
        if laws:
            v |= laws.points(packing, robot.model.foot_radius or math.nan, float(seen.phi_sigma.max()))
        v = {n: np.broadcast_to(x, phi.shape) for n, x in v.items()}
        values = [{**v, OF_MODEL + name: np.full(phi.size, x)} for x in tried]
        return [simulated_points(robot.model, x, rtol=RTOL, atol=ATOL) for x in values]

    found = jumped(phi)
    heights = np.stack([x["jump_height_m"] for x in found])
    order = np.argsort(phi)
    # beds further apart than 0.002 are different packings
    groups = np.split(order, np.flatnonzero(np.diff(phi[order]) > 0.002) + 1)
    own, off = independent(sigma, common), independent(seen.phi_sigma, seen.phi_common)
    tilted = np.zeros_like(heights)  # d height / d phi
    if (seen.phi_sigma > 0.0).any():
        inward = np.where(phi > phi.mean(), -1.0, 1.0) * np.maximum(seen.phi_sigma, 1e-6)
        tilted = (np.stack([x["jump_height_m"] for x in jumped(phi + inward)]) - heights) / inward
    slope = tilted[np.argmin(np.sum((heights - height) ** 2, axis=1))]
    own = np.hypot(own, slope * off)

    def fitted(heights: Array, height: Array) -> Array:
        return np.array([fitted_parameter(tried, heights[:, g], height[g], own[g]) for g in groups])

    fits = fitted(heights, height)
    # what the jumps share, of height or packing, moves all of them, and the parameter
    moved = [fitted(heights, height + common), fitted(heights + tilted * seen.phi_common, height)]
    shift = np.hypot(*(np.abs(x[:, 0] - fits[:, 0]) for x in moved))
    total = np.hypot(fits[:, 1], shift)
    packing = np.array([phi[g].mean() for g in groups])
    packing_sigma = np.array([np.hypot(off[g].mean() / math.sqrt(g.size), seen.phi_common[g].mean()) for g in groups])
    unit, per = ("1", "") if name == "b" else ("kg/m", " kg/m")
    best = {n: np.stack([x[n] for x in found])[np.argmin(np.abs(tried - np.nanmedian(fits[:, 0])))] for n in found[0]}
    data = dataset(
        s,
        {"jump": [e.name for e in used], "packing": packing},
        ("jump",),
        best,
        {
            "value": (("packing",), fits[:, 0], unit, f"{name} fitted to the measured jumps"),
            "value_sigma": (("packing",), total, unit, "its standard uncertainty, widened by the scatter"),
            "value_sigma_common": (("packing",), shift, unit, "the part of it that all packings share"),
            "chi2": (("packing",), fits[:, 2], "1", "of its heights"),
            "n": (("packing",), np.array([g.size for g in groups]), "1", "jumps"),
            "packing_sigma": (("packing",), packing_sigma, "1", "standard uncertainty of its volume fraction"),
            "phi_of_jump": (("jump",), phi, "1", "volume fraction"),
            "phi_of_jump_sigma": (("jump",), seen.phi_sigma, "1", "its standard uncertainty"),
            "measured_height_m": (("jump",), height, "m", "measured jump height"),
            "sigma_height_m": (("jump",), sigma, "m", "its standard uncertainty"),
        },
        facts=DragFit(name),
    )
    numbers = [
        s.number(
            f"{name} at phi {x:.4f}{f' ± {dx:.1g}' if dx else ''}, {g.size} jumps",
            f"{value:.3g} ± {sd:.2g}{per}, chi2 {c:.3g}",
        )
        for x, dx, g, (value, _, c), sd in zip(packing, packing_sigma, groups, fits, total)
    ]
    known = np.isfinite(fits[:, :2]).all(axis=1)
    if known.sum() >= 5:  # a law needs five packings
        fit = fit_packing_law(packing[known], fits[known, 0], fits[known, 1])
        law = fit.law
        numbers += [
            s.number(f"kink of {name} against phi", kink(fit, 0.01, f"{per} per 0.01".strip())),
            s.number(
                f"law of {name} for --laws",
                f"phi = {[round(x, 4) for x in law.phi]}, value = {[float(f'{x:.4g}') for x in law.value]}",
            ),
        ]
    return data, numbers
