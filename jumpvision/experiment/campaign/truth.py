"""What a campaign found beside the truth that synthetic folders state. For people only: no analysis reads a truth."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isfinite
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from jumpvision.base.arrays import Z95, measured, plain_number, with_digits_of
from jumpvision.base.schema import Toml
from jumpvision.experiment.inputs.experiment import Campaign
from jumpvision.experiment.inputs.sections import Bed, Robot
from jumpvision.experiment.workflow.run import Outcome

if TYPE_CHECKING:
    from jumpvision.engine.document.diagnosis import Diagnosis
    from jumpvision.engine.document.values import Cause, Confirmation, Parameter
    from jumpvision.experiment.results.fields import Flow
    from jumpvision.experiment.results.summary import Summary

INSIDE, OUTSIDE, ABSENT = "inside 95 %", "outside 95 %", "does not act"


class Quantity(NamedTuple):
    """A number of summary.json as tables show it, with the key of its standard uncertainty."""

    key: str
    sigma: str | None
    heading: str
    factor: float = 1.0

    @property
    def word(self) -> str:
        return self.heading.split(" [")[0]

    def of(self, summary: Summary) -> tuple[float | None, float | None]:
        """(value, standard uncertainty), None where unknown."""
        known: Toml = summary.values
        return known.get(self.key), known.get(self.sigma) if self.sigma else None


OVERVIEW = (
    Quantity("jump_height_m", "sigma_m", "height [mm]", 1e3),
    Quantity("simulated_height_m", None, "model [mm]", 1e3),
    Quantity("volume_fraction", "sigma_volume_fraction", "phi"),
)
DETAILS = (
    Quantity("mu", "mu_sigma", "mu"),
    Quantity("beta_deg", "beta_deg_sigma", "beta [deg]"),
    Quantity("added_mass_kg", "added_mass_kg_sigma", "added mass [kg]"),
    Quantity("frequency_hz", "frequency_hz_sigma", "ring-down [Hz]"),
    Quantity("zeta", "zeta_sigma", "zeta"),
)


def true_summaries(campaign: Campaign, outcomes: Sequence[Outcome]) -> dict[str, dict[str, float | None]]:
    """The summaries that synthetic folders state, by experiment; the added mass at the time it was measured at."""
    out = {e.name: truth_of(e.path) for e in campaign.experiments}
    for o in outcomes if any("grain_film" in t for t in out.values()) else ():
        from jumpvision.experiment.results.fields import Flow

        if "grain_film" in out[o.name] and o.made(Flow):
            at = true_added_mass(out[o.name]["grain_film"]["pairs"], Flow.over_time(o.results))
            out[o.name] = {**out[o.name], "summary": {**out[o.name]["summary"], "added_mass_kg": at}}
    return {name: dict(t.get("summary", {})) for name, t in out.items()}


def true_added_mass(pairs: Mapping[str, Sequence[float]], flow: Flow) -> float | None:
    """The true added mass in view [kg] at the time of the greatest momentum measured; None where it is not known.

    The momentum is flat at its peak where the foot slows down: a frame beside it can have another mass by 10 %.
    """
    import numpy as np

    from jumpvision.films.grains.momentum import peak_momentum

    peak = peak_momentum(flow.field.momentum, flow.field.added_mass)
    if peak is None:
        return None
    near = int(np.argmin(np.abs(np.asarray(pairs["time_s"]) - float(flow.field.t[peak]))))
    return pairs["added_mass_in_view_kg"][near] or None


def sigmas_off(value: float | None, sigma: float | None, true: float | None) -> float | None:
    """(found - true) / sigma; None where one of them is not known."""
    if value is None or true is None or not sigma:
        return None
    z = (value - true) / sigma
    return z if isfinite(z) else None


def judged(sigmas: float | None) -> str:
    """Whether a truth lies inside the 95 % interval, and how far outside; "" where that cannot be said."""
    if sigmas is None:
        return ""
    return INSIDE if abs(sigmas) <= Z95 else f"{OUTSIDE} ({abs(sigmas):.1f} sigma)"


@dataclass(frozen=True)
class Truth:
    """What truth.json of a campaign states of its mechanisms. parameters: by name, SI units."""

    terms: tuple[str, ...]
    parameters: Toml

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
        from jumpvision.jumper.mechanisms.registry import MECHANISMS  # compiles: not where pages stay as they are

        return any(name in MECHANISMS[t].names for t in self.terms if t in MECHANISMS)


def true_words(name: str, parameter: Parameter, truth: Truth) -> tuple[str, str]:
    """(the true value to the digits of the fitted one, whether it lies inside the 95 % interval)."""
    true = truth.value(name) if truth.acts(name) else None
    if true is None:
        return ("" if truth.acts(name) else ABSENT), ""
    return with_digits_of(true, parameter.sigma), judged(sigmas_off(parameter.value, parameter.sigma, true))


def parameter_rows(diagnosis: Diagnosis, campaign: Campaign) -> list[dict[str, str]]:
    """One row a parameter of the named mechanisms: fitted value, 90 % interval and, where stated, the truth."""
    from jumpvision.jumper.mechanisms.registry import ModelParameters

    named = next((c for c in diagnosis.models if diagnosis.names(c)), None)
    truth = Truth.of(campaign)
    rows = []
    for name, p in (named.parameters if named else {}).items():
        row = {"parameter": name, "fitted": measured(p.value, p.sigma)}
        row["90 %"] = f"{with_digits_of(p.low, p.sigma)} to {with_digits_of(p.high, p.sigma)}"
        row["unit"] = unit_words(p.unit)
        if truth:
            row["true"], row["truth is"] = true_words(name, p, truth)
        rows.append(row | {"meaning": ModelParameters.__dataclass_fields__[name].metadata["meaning"]})
    return rows


def true_parameters(cause: Cause, truth: Truth) -> str:
    """The true parameters of a model in words, and which of them lie outside the 95 % interval."""
    words = [(name, *true_words(name, p, truth)) for name, p in cause.parameters.items()]
    said = [f"{name} {true}" if true == ABSENT else f"{name} = {true}" for name, true, _ in words if true]
    bad = [f"{name} {mark}" for name, _, mark in words if mark.startswith(OUTSIDE)]
    judged_all = f"all {INSIDE}" if any(mark for *_, mark in words) else ""
    return "; ".join(x for x in (", ".join(said), ", ".join(bad) or judged_all) if x)


def confirmation_rows(diagnosis: Diagnosis, campaign: Campaign) -> list[dict[str, str]]:
    """One row a quantity that films or tests measure: by them, by the jumps alone, z of the two, the truth."""
    truth = Truth.of(campaign)
    rows = []
    for r in diagnosis.confirmation:
        mass = r.depth_m is not None
        quantity = f"added mass, {1e3 * r.depth_m:.1f} mm deep" if r.depth_m is not None else r.quantity
        row = {"quantity": quantity, "source": r.source, "unit": unit_words(r.unit)}
        row["measured"] = measured(finite(r.by_film), r.by_film_sigma)
        row["jumps alone"] = measured(finite(r.by_jumps), r.by_jumps_sigma)
        row |= {"z": f"{r.z:+.1f}" if isfinite(r.z) else "", "verdict": r.verdict}
        if truth:
            true = true_mass(r, campaign, truth) if mass else truth.value(r.quantity)
            finer = min((s for s in (r.by_film_sigma, r.by_jumps_sigma) if s > 0.0), default=None)
            row["true"] = "" if true is None else with_digits_of(true, finer)
            row["truth is"] = judged_by_both(r, true)
        rows.append(row)
    return rows


def finite(value: float) -> float | None:
    """None for a number that is not known."""
    return value if isfinite(value) else None


def judged_by_both(r: Confirmation, true: float | None) -> str:
    """Whether a truth lies inside the 95 % intervals of film and jumps; who has it outside is told."""
    film, jumps = (judged(sigmas_off(*x, true)) for x in ((r.by_film, r.by_film_sigma), (r.by_jumps, r.by_jumps_sigma)))
    marks = {r.source.split()[0]: film, "the jumps": jumps}
    bad = [f"{mark} by {who}" for who, mark in marks.items() if mark.startswith(OUTSIDE)]
    return "; ".join(bad) or (INSIDE if film or jumps else "")


def unit_words(unit: str) -> str:
    """A unit as a person writes it: nothing for a number without one."""
    return "" if unit == "1" else unit


def true_mass(row: Confirmation, campaign: Campaign, truth: Truth) -> float | None:
    """Mass that truly moves with the whole foot [kg] at the depth of a row, in view of the film or not."""
    import numpy as np

    from jumpvision.jumper.mechanisms.cone import cone_mass

    assert row.experiment is not None
    e = campaign[row.experiment]
    robot, bed, own = e.section(Robot), e.section(Bed), truth_of(e.path)
    C, mu, theta = (truth.value(n) for n in ("C", "mu", "theta"))
    R, phi = robot.foot_radius if robot else None, own.get("volume_fraction")
    if C is None or mu is None or theta is None or R is None or phi is None or bed is None:
        return None
    return float(cone_mass(np, z=row.depth_m, C=C, mu=mu, theta=theta, R=R, phi=phi, rho=bed.grain_density))


def deviations(campaign: Campaign, outcomes: Sequence[Outcome]) -> Iterator[tuple[str, float]]:
    """(what, sigmas from the truth) of everything that the tables of experiments state with an uncertainty."""
    truth = true_summaries(campaign, outcomes)
    for o in outcomes:
        for q in (*OVERVIEW, *DETAILS):
            if (z := sigmas_off(*q.of(o.summary), truth[o.name].get(q.key))) is not None:
                yield f"{o.name} {q.word}", z


def coverage_words(campaign: Campaign, outcomes: Sequence[Outcome]) -> str:
    """Which measured values have their truth outside 95 %, and how many would by chance; "" where none is stated."""
    found = dict(deviations(campaign, outcomes))
    if not found:
        return ""
    bad = {k: z for k, z in found.items() if abs(z) > Z95}
    names = ", ".join(f"{k} ({abs(z):.1f} sigma)" for k, z in bad.items())
    text = f"The truth is {INSIDE} of {len(found) - len(bad)} of the {len(found)} values with an uncertainty"
    return text + (f", {OUTSIDE} of {names}: by chance about {0.05 * len(found):.1f} would be." if bad else ".")


def overview(campaign: Campaign, outcomes: Sequence[Outcome]) -> list[dict[str, str]]:
    """One row an experiment: jump height, model and bed, with the truth beside them where the folder is synthetic."""
    truth = true_summaries(campaign, outcomes)
    shown = [q for q in OVERVIEW if any(q.of(o.summary)[0] is not None for o in outcomes)]
    stated = {q for q in shown if any(q.key in t for t in truth.values())}
    rows = []
    for o in outcomes:
        row = {"experiment": o.name}
        for q in shown:
            row[q.heading] = measured(*q.of(o.summary), q.factor)
            if q in stated:
                row[f"true {q.word}"] = plain_number(truth[o.name].get(q.key), q.factor)
        rows.append(row)
    return rows


def details(campaign: Campaign, outcomes: Sequence[Outcome]) -> list[dict[str, str]]:
    """One row a quantity that only some experiments have: the cone from grain films, the ring-down."""
    truth = true_summaries(campaign, outcomes)
    stated = any(truth.values())
    rows = []
    for o in outcomes:
        for q in (q for q in DETAILS if q.of(o.summary)[0] is not None):
            row = {"experiment": o.name, "quantity": q.heading, "measured": measured(*q.of(o.summary), q.factor)}
            if stated:
                row["true"] = plain_number(truth[o.name].get(q.key), q.factor)
            rows.append(row)
    return rows


def truth_of(folder: Path) -> Toml:
    """truth.json of a synthetic folder, for showing beside the results only; {} for a recorded one."""
    file = folder / "truth.json"
    try:
        return dict(json.loads(file.read_text(encoding="utf-8"))) if file.exists() else {}
    except ValueError:
        return {}
