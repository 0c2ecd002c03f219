"""What the films and tests of a campaign measure of the model's own parameters, beside what its jumps imply."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ..campaign import Outcome
from ..diagnosis.measured import Measured
from ..experiment import Experiment
from ..records import Fits
from ..sections import Actuation, Bed, Robot
from ..stages.body import total_mass

CONE = {"C": ("C", 1.0), "mu": ("mu_cone", 1.0), "theta": ("theta_cone_deg", math.pi / 180.0)}  # fits.json, to SI
ALIKE = 0.01  # relative difference of foot radius, or volume fraction, up to which two experiments tell of one model


def measurements(
    experiments: Sequence[Experiment], outcomes: Mapping[str, Outcome], robot: Robot, phi: float | None
) -> list[Measured]:
    """Of all experiments with a foot and a bed like those of the jumps: the cone by grain films (C, mu, theta), the
    static force by intrusions, the spring by its own test, its damping by ring-downs without a motor. Several of a kind
    are averaged, what they share is not.
    """
    found: dict[str, list[tuple[str, Measured, np.ndarray[Any, Any]]]] = {}
    for e in experiments:
        outcome = outcomes.get(e.name)
        if outcome is None or not (outcome.results / Fits.file).exists() or not _alike(e, robot, phi):
            continue
        fits = Fits.load(outcome.results).values
        kinds = {"film": CONE, "spring test": _own("spring_stiffness")}
        if "intrusion_log" in e.sections:
            kinds["intrusion"] = _own("k1", "k2", "delta")
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


def _read(
    fits: Mapping[str, Any], names: Mapping[str, tuple[str, float]], source: str
) -> tuple[Measured, np.ndarray[Any, Any]] | None:
    """(what fits.json says of these parameters, its covariance that other experiments share); None where nothing."""
    have = {n: (fits[key], unit) for n, (key, unit) in names.items() if fits.get(key, {}).get("sigma")}
    if not have:
        return None
    value = np.array([f["value"] * u for f, u in have.values()])
    sigma = np.array([f["sigma"] * u for f, u in have.values()])
    common = np.array([f.get("sigma_common", 0.0) * u for f, u in have.values()])
    keys = list(have)
    correlation = np.eye(len(keys))
    for i, a in enumerate(keys):
        for j, b in enumerate(keys):
            entry = fits.get(f"correlation_{a}_{b}") or fits.get(f"correlation_{b}_{a}")
            if i != j and entry and entry["value"] is not None:
                correlation[i, j] = entry["value"]
    own = np.sqrt(np.maximum(sigma**2 - common**2, 0.0))
    shared = np.outer(common, common)
    return Measured(tuple(keys), value, correlation * np.outer(own, own) + shared, source), shared


def _together(kind: str, seen: Sequence[tuple[str, Measured, np.ndarray[Any, Any]]]) -> Measured:
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
