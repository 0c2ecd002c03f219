"""The volume fraction of a campaign's beds against what packed them: the apparatus' law (thesis section 3.2.1)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import xarray as xr

from jumpvision.base.arrays import Array
from jumpvision.base.schema import InputError
from jumpvision.estimate.estimate import independent
from jumpvision.experiment.inputs.experiment import open_campaign
from jumpvision.experiment.inputs.sections import Preparation
from jumpvision.experiment.results.fields import as_attributes
from jumpvision.experiment.workflow.many import run_campaign
from jumpvision.experiment.workflow.run import Plan
from jumpvision.thesis.studies.compute import Origin
from jumpvision.thesis.studies.sand.compaction import LEAST, NAMES, Compaction, fit_compaction
from jumpvision.thesis.studies.study import Found, Measured, Row, study

TARGETS = np.arange(0.50, 0.701, 0.005)  # volume fractions that pulses are told for, within those measured


class Prepared(NamedTuple):
    """One bed: its experiment, [preparation], volume fraction, all of its sigma and the part that beds share."""

    name: str
    how: Preparation
    phi: float
    sigma: float
    common: float

    @property
    def setting(self) -> tuple[float, float]:
        """Air speed [m/s] (-1: not told) and shaking [m/s^2]: beds of one setting share a law."""
        return -1.0 if self.how.air_speed is None else self.how.air_speed, self.how.shaking


@dataclass(frozen=True)
class Settings:
    """The settings in words, by `setting`, as text with " | " between them."""

    settings: str


def prepared(given: Measured) -> list[Prepared]:
    """The campaign's beds. InputError where none tells its pulses and has a volume fraction."""
    campaign = open_campaign(given.campaign, overrides=given.overrides)
    command = f"sweep granular --analysis {given.study.name}"
    plan, say = Plan(given.results, given.results / ".cache", stages=("summary",), command=command), given.say
    outcomes = run_campaign(campaign, plan, workers=given.workers, done=lambda o: say(f"{o.name}: {o.seconds:.1f} s"))
    out = []
    for e, o in zip(campaign.experiments, outcomes):
        how, (phi, sigma, common) = e.section(Preparation), o.summary.volume_fraction
        if how is None or phi is None:
            why = "no [preparation]" if how is None else o.errors[0] if o.errors else "no volume fraction"
            say(f"{e.name}: left out: {why}")
            continue
        out.append(Prepared(e.name, how, phi, sigma or 0.0, common or 0.0))
    if not out:
        raise InputError([f"{campaign.path}: no experiment has [preparation] pulses and a volume fraction"])
    return out


@study("packing", "granular", source="section 3.2.1", model_file=False)
def packing(given: Measured) -> Found:
    """Volume fraction of a campaign's beds against air pulses and shaking: the law, its scatter, pulses for a packing.

    One law (`compaction`) for each setting of air speed and shaking. InputError where no setting has enough different
    numbers of pulses.
    """
    beds = prepared(given)
    by_setting = {s: [b for b in beds if b.setting == s] for s in sorted({b.setting for b in beds})}
    laws: dict[tuple[float, float], Compaction] = {}
    for setting, some in by_setting.items():
        pulses = np.array([b.how.pulses for b in some])
        if np.unique(pulses).size < LEAST:
            few = f"{np.unique(pulses).size} different numbers of pulses"
            given.say(f"{_words(setting)}: left out: {few}; a law needs {LEAST}")
            continue
        sigma, common = np.array([b.sigma for b in some]), np.array([b.common for b in some])
        phi = np.array([b.phi for b in some])
        laws[setting] = fit_compaction(pulses, phi, independent(sigma, common), float(common.mean()))
    if not laws:
        raise InputError([f"{given.campaign}: no setting of [preparation] has {LEAST} different numbers of pulses"])
    used = [b for s in laws for b in by_setting[s]]
    return _dataset(given, used, laws), [r for s, law in laws.items() for r in _rows(s, law, by_setting[s])]


def _words(setting: tuple[float, float]) -> str:
    air, shaking = setting
    words = [f"pulses of {air:g} m/s"] if air >= 0 else ["pulses"]
    return " and ".join([*words, f"shaking of {shaking:g} m/s²"] if shaking else words)


def _rows(setting: tuple[float, float], law: Compaction, beds: list[Prepared]) -> list[Row]:
    sigma = np.sqrt(np.maximum(np.diag(law.covariance), 0.0))
    values = ", ".join(f"{n} {v:.4g} ± {s:.2g}" for n, v, s in zip(NAMES[law.law], law.values, sigma))
    sure = "" if law.decided else "; the other law is as good"
    sure += f"; beds are off it by {law.lack:.1g}" if law.lack else ""
    out = [
        {"quantity": f"{_words(setting)}: law", "ours": f"{law.law}: {values}{sure}"},
        {
            "quantity": f"{_words(setting)}: scatter of a preparation",
            "ours": f"{law.scatter:.2g} of volume fraction, {law.n} beds",
        },
    ]
    within = [b.phi for b in beds]
    for target in TARGETS[(min(within) < TARGETS) & (max(within) > TARGETS)]:
        n, s = law.pulses(float(target))
        if np.isfinite(n) and n <= law.range[1]:
            out.append({"quantity": f"{_words(setting)}: pulses for {target:.3f}", "ours": f"{n:.3g} ± {s:.2g}"})
    return [{"quantity": r["quantity"], "thesis": "", "RK4": "", "ours": r["ours"]} for r in out]


def _dataset(given: Measured, used: list[Prepared], laws: dict[tuple[float, float], Compaction]) -> xr.Dataset:
    of = {s: i for i, s in enumerate(laws)}
    most = max(law.range[1] for law in laws.values())
    curve = np.expm1(np.linspace(0.0, np.log1p(most), 120))  # places of the drawn law
    lines = np.array([law.at(curve) for law in laws.values()])

    def of_beds(values: list[float] | Array, unit: str, meaning: str) -> xr.Variable:
        return xr.Variable(("bed",), np.asarray(values), {"units": unit, "long_name": meaning})

    def of_laws(values: list[float] | Array, unit: str, meaning: str) -> xr.Variable:
        return xr.Variable(("setting",), np.asarray(values), {"units": unit, "long_name": meaning})

    sigma = np.array([np.sqrt(np.maximum(np.diag(law.covariance), 0.0)) for law in laws.values()])
    values = np.array([law.values for law in laws.values()])
    variables = {
        "pulses": of_beds([b.how.pulses for b in used], "1", "air pulses since fluidisation"),
        "volume_fraction": of_beds([b.phi for b in used], "1", "of the bed"),
        "sigma_volume_fraction": of_beds([b.sigma for b in used], "1", "its standard uncertainty"),
        "setting_of_bed": of_beds(np.array([of[b.setting] for b in used]), "1", "index of its setting"),
        "air_speed": of_laws([s[0] for s in laws], "m/s", "of a pulse; -1: not given"),
        "shaking": of_laws([s[1] for s in laws], "m/s^2", "amplitude of the bed's acceleration"),
        "scatter": of_laws([law.scatter for law in laws.values()], "1", "standard deviation of a preparation"),
        "lack": of_laws([law.lack for law in laws.values()], "1", "what means of beds are off the law, beyond errors"),
        "chi2": of_laws([law.chi2 for law in laws.values()], "1", "of the beds"),
        "law_volume_fraction": xr.Variable(("setting", "law_pulses"), lines[:, 0], {"units": "1"}),
        "law_sigma": xr.Variable(("setting", "law_pulses"), lines[:, 1], {"units": "1"}),
    }
    for k, name in enumerate(("loose", "dense", "shape", "tau")):
        unit = {"tau": "pulses"}.get(name, "1")
        variables[name] = of_laws(values[:, k], unit, f"{name} of the law")
        variables[f"{name}_sigma"] = of_laws(sigma[:, k], unit, "its standard uncertainty")
    coords = {
        "experiment": xr.Variable(("bed",), [b.name for b in used]),
        "law": xr.Variable(("setting",), [law.law for law in laws.values()]),
        "law_pulses": xr.Variable(("law_pulses",), curve, {"units": "1"}),
    }
    made = Origin.of(None, given.study.name)
    return xr.Dataset(variables, coords, as_attributes(made) | as_attributes(Settings(" | ".join(map(_words, laws)))))
