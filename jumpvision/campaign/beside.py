"""What a campaign found beside the truth that synthetic folders state. For people only: no analysis reads a truth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from jumpvision.base.numbers import measured, plain_number, with_digits_of
from jumpvision.inputs.experiment import Campaign
from jumpvision.inputs.sections import Bed, Robot
from jumpvision.mechanisms.parameters import MECHANISMS, ModelParameters
from jumpvision.workflow.run import Outcome, truth_of

Z90, Z95 = 1.645, 1.960  # half widths of intervals of a normal error, in sigmas
INSIDE, OUTSIDE, ABSENT = "inside 95 %", "outside 95 %", "does not act"

QUANTITIES = (  # summary key, its sigma, heading, factor
    ("jump_height_m", "sigma_m", "height [mm]", 1e3),
    ("simulated_height_m", None, "model [mm]", 1e3),
    ("volume_fraction", "sigma_volume_fraction", "phi", 1.0),
    ("mu", "mu_sigma", "mu", 1.0),
    ("beta_deg", "beta_deg_sigma", "beta [deg]", 1.0),
    ("added_mass_kg", "added_mass_kg_sigma", "added mass [kg]", 1.0),
    ("frequency_hz", "frequency_hz_sigma", "ring-down [Hz]", 1.0),
    ("zeta", "zeta_sigma", "zeta", 1.0),
)


def known_truth(campaign: Campaign) -> dict[str, dict[str, Any]]:
    """The summaries that synthetic folders state, by experiment."""
    return {e.name: truth_of(e.path).get("summary", {}) for e in campaign.experiments}


def off(value: float | None, sigma: float | None, true: float | None) -> float | None:
    """(found - true) / sigma; None where one of them is not known."""
    return None if value is None or true is None or not sigma else (value - true) / sigma


def judged(sigmas: float | None) -> str:
    """Whether a truth lies inside the 95 % interval, and how far outside; "" where that cannot be said."""
    if sigmas is None:
        return ""
    return INSIDE if abs(sigmas) <= Z95 else f"{OUTSIDE} ({abs(sigmas):.1f} sigma)"


@dataclass(frozen=True)
class Truth:
    """What truth.json of a campaign states of its mechanisms. parameters: by name, SI units."""

    terms: tuple[str, ...]
    parameters: Mapping[str, Any]

    @classmethod
    def of(cls, campaign: Campaign) -> Truth | None:
        """None for recorded campaigns and sealed ones."""
        stated = truth_of(campaign.path)
        return cls(tuple(stated.get("terms", ())), stated["parameters"]) if "parameters" in stated else None

    def value(self, name: str) -> float | None:
        """A parameter's one true value; None where none is stated, or a law of the bed."""
        found = self.parameters.get(name)
        return float(found) if isinstance(found, int | float) else None

    def acts(self, name: str) -> bool:
        """Whether a mechanism with this parameter is part of the truth."""
        return any(name in MECHANISMS[t].parameters for t in self.terms if t in MECHANISMS)


def models(causes: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Causes without those that name a model again by another of its mechanisms."""
    first: dict[frozenset[str], dict[str, Any]] = {}
    for c in causes:
        key = frozenset([c["mechanism"], *c["with"]])
        one = first.setdefault(key, {**c, "parameters": {}})
        one["parameters"] = {**one["parameters"], **c["parameters"]}
    return list(first.values())


def is_named(cause: Mapping[str, Any], diagnosis: Mapping[str, Any]) -> bool:
    """Whether this is the model that the diagnosis names."""
    return bool(diagnosis["named"]) and {cause["mechanism"], *cause["with"]} == set(diagnosis["named"])


def sigma_of(parameter: Mapping[str, Any]) -> float:
    """Standard uncertainty from the 90 % interval, of whose ends one may be that of the parameter's range."""
    value = parameter["value"]
    return float(max(value - parameter["low"], parameter["high"] - value)) / Z90


def true_words(name: str, parameter: Mapping[str, Any], truth: Truth) -> tuple[str, str]:
    """(the true value to the digits of the fitted one, whether it lies inside the 95 % interval)."""
    true = truth.value(name) if truth.acts(name) else None
    if true is None:
        return ("" if truth.acts(name) else ABSENT), ""
    sigma = sigma_of(parameter)
    return with_digits_of(true, sigma), judged(off(parameter["value"], sigma, true))


def parameter_rows(diagnosis: Mapping[str, Any], campaign: Campaign) -> list[dict[str, str]]:
    """One row a parameter of the named mechanisms: fitted value, 90 % interval and, where stated, the truth."""
    named = next((c for c in models(diagnosis["causes"]) if is_named(c, diagnosis)), None)
    truth = Truth.of(campaign)
    rows = []
    for name, p in (named["parameters"] if named else {}).items():
        digits = sigma_of(p)
        row = {"parameter": name, "fitted": measured(p["value"], digits)}
        row["90 %"] = f"{with_digits_of(p['low'], digits)} to {with_digits_of(p['high'], digits)}"
        row["unit"] = unit_of(p["unit"])
        if truth:
            row["true"], row["truth is"] = true_words(name, p, truth)
        rows.append(row | {"meaning": ModelParameters.__dataclass_fields__[name].metadata["meaning"]})
    return rows


def unit_of(unit: str) -> str:
    """As a person writes it: nothing for a number without unit."""
    return "" if unit == "1" else unit


def said_true(cause: Mapping[str, Any], truth: Truth) -> str:
    """The true parameters of a model in words, and which of them lie outside the 95 % interval."""
    words = [(name, *true_words(name, p, truth)) for name, p in cause["parameters"].items()]
    said = [f"{name} {true}" if true == ABSENT else f"{name} = {true}" for name, true, _ in words if true]
    bad = [f"{name} {mark}" for name, _, mark in words if mark.startswith(OUTSIDE)]
    judged_all = f"all {INSIDE}" if any(mark for *_, mark in words) else ""
    return "; ".join(x for x in (", ".join(said), ", ".join(bad) or judged_all) if x)


def confirmation_rows(diagnosis: Mapping[str, Any], campaign: Campaign) -> list[dict[str, str]]:
    """One row a quantity that films or tests measure: by them, by the jumps alone, z of the two, the truth."""
    truth = Truth.of(campaign)
    rows = []
    for r in diagnosis["confirmation"]:
        row = {"quantity": _spoken(r), "source": r["source"], "unit": unit_of(r["unit"])}
        row["measured"] = measured(r["by_film"], r["by_film_sigma"])
        row["jumps alone"] = measured(r["by_jumps"], r["by_jumps_sigma"])
        row |= {"z": "" if r["z"] is None else f"{r['z']:+.1f}", "verdict": r["verdict"]}
        if truth:
            true = true_mass(r, campaign, truth) if r["quantity"] == "added_mass" else truth.value(r["quantity"])
            row["true"] = "" if true is None else with_digits_of(true, _finer(r))
            row["truth is"] = _both(r, true)
        rows.append(row)
    return rows


def _spoken(row: Mapping[str, Any]) -> str:
    """What a row of `confirmation` is about."""
    if row["quantity"] == "added_mass":
        return f"added mass, {1e3 * row['depth_m']:.1f} mm deep"
    return str(row["quantity"])


def _finer(row: Mapping[str, Any]) -> float | None:
    """The smaller of the two uncertainties, which says how many digits count."""
    return min((s for k in ("by_film_sigma", "by_jumps_sigma") if (s := row[k])), default=None)


def _both(row: Mapping[str, Any], true: float | None) -> str:
    """Whether a truth lies inside the 95 % intervals of film and jumps; who has it outside is told."""
    marks = {k: judged(off(row[f"by_{k}"], row[f"by_{k}_sigma"], true)) for k in ("film", "jumps")}
    bad = [
        f"{mark} by {row['source'].split()[0] if k == 'film' else 'the jumps'}"
        for k, mark in marks.items()
        if mark.startswith(OUTSIDE)
    ]
    return "; ".join(bad) or (INSIDE if any(marks.values()) else "")


def true_mass(row: Mapping[str, Any], campaign: Campaign, truth: Truth) -> float | None:
    """Mass that truly moves with the whole foot [kg] at the depth of a row, in view of the film or not."""
    from jumpvision.mechanisms.cone import cone_mass

    e = campaign[row["experiment"]]
    robot, bed, own = e.section(Robot), e.section(Bed), truth_of(e.path)
    C, mu, theta = (truth.value(n) for n in ("C", "mu", "theta"))
    R, phi = robot and robot.foot_radius, own.get("volume_fraction")
    if C is None or mu is None or theta is None or R is None or phi is None or bed is None:
        return None
    return float(cone_mass(np, row["depth_m"], C, mu, theta, R, phi, bed.grain_density))


def heights_and_more(campaign: Campaign, outcomes: Sequence[Outcome]) -> Iterator[tuple[str, float]]:
    """(what, sigmas from the truth) of everything that the tables of experiments state with an uncertainty."""
    truth = known_truth(campaign)
    for o in outcomes:
        for key, sigma, heading, _ in QUANTITIES:
            z = off(o.summary.get(key), o.summary.get(sigma) if sigma else None, truth[o.name].get(key))
            if z is not None:
                yield f"{o.name} {heading.split(' [')[0]}", z


def chance(campaign: Campaign, outcomes: Sequence[Outcome]) -> str:
    """Which measured values have their truth outside 95 %, and how many would by chance; "" where none is stated."""
    found = dict(heights_and_more(campaign, outcomes))
    if not found:
        return ""
    bad = {k: z for k, z in found.items() if abs(z) > Z95}
    names = ", ".join(f"{k} ({abs(z):.1f} sigma)" for k, z in bad.items())
    text = f"The truth is {INSIDE} of {len(found) - len(bad)} of the {len(found)} values with an uncertainty"
    return text + (f", {OUTSIDE} of {names}: by chance about {0.05 * len(found):.1f} would be." if bad else ".")


def overview(campaign: Campaign, outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """One row an experiment: jump height, model and bed, with the truth beside them where the folder is synthetic."""
    truth = known_truth(campaign)
    rows = []
    for o in outcomes:
        row: dict[str, Any] = {"experiment": o.name}
        for key, sigma, heading, factor in QUANTITIES[:3]:
            if any(x.summary.get(key) is not None for x in outcomes):
                row[heading] = measured(o.summary.get(key), o.summary.get(sigma) if sigma else None, factor)
                if any(key in t for t in truth.values()):
                    row[f"true {heading.split()[0]}"] = plain_number(truth[o.name].get(key), factor)
        rows.append(row)
    return rows


def details(campaign: Campaign, outcomes: Sequence[Outcome]) -> list[dict[str, Any]]:
    """One row a quantity that only some experiments have: the cone from grain films, the ring-down."""
    truth = known_truth(campaign)
    synthetic = any(truth.values())
    return [
        {
            "experiment": o.name,
            "quantity": heading,
            "measured": measured(o.summary[key], o.summary.get(sigma), factor),
            **({"true": plain_number(truth[o.name].get(key), factor)} if synthetic else {}),
        }
        for o in outcomes
        for key, sigma, heading, factor in QUANTITIES[3:]
        if o.summary.get(key) is not None
    ]
