"""Slow intrusions drawn with a known cone, fitted by `jumpvision intrusion`: failures, and what the sigmas cover.

    python -m benchmarks.intrusions [LOGS] [FIRST]      # 600 logs: some 15 minutes of one core

Feet of 5 to 38.1 mm, packings, cones, protocols (one stroke; withdrawals or pauses 1 to 10 mm apart) and five families
of noise, drawn log by log. The force is the resistance of the growing cone summed over thin rings with the discs'
numbers here (no law of the package); only the arm's motion and the overshoots are the laboratory's. The fit
knows white noise and fluctuations of exponential correlation; three of the families are neither.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from jumpvision.experiment.inputs.parameters import IntrusionParams
from jumpvision.experiment.stages.bed.intrusion import curves_of
from jumpvision.laboratory.intrusions import Arm, Grains, Move, log

Array = NDArray[np.float64]
THETA, DEEPEST, START = math.pi / 3, 0.06, -0.006  # rad, m, m
FAMILIES = ("cell", "heavy", "smooth", "saw", "growing")
PROTOCOLS = ("stroke", "stroke", "reintrusion", "stop_go")
CONE = ("k1_cone", "sigma_cone", "mu_cone")
OVERSHOOTS = ("s", "s_p", "lam")


@dataclass(frozen=True)
class Drawn:
    """What one log is made of: SI units; step [m] between events."""

    seed: int
    family: str
    protocol: str
    radius: float
    truth: dict[str, float]
    step: float
    noise: float
    fluctuation: float
    grain: float


def drawn(seed: int) -> Drawn:
    """One log's numbers."""
    rng = np.random.default_rng(np.random.SeedSequence([20140630, seed]))
    radius = math.exp(rng.uniform(math.log(0.005), math.log(0.0381)))
    area, protocol = math.pi * radius**2, PROTOCOLS[rng.integers(len(PROTOCOLS))]
    k1 = rng.uniform(0.3e6, 1.5e6) * area
    truth = {
        "k1_cone": k1,
        "sigma_cone": rng.uniform(0.3, 0.8) * k1 * math.cos(THETA) / area,
        "mu_cone": rng.uniform(1.5, 3.5),
    }
    if protocol != "stroke":
        name = {"reintrusion": "s", "stop_go": "s_p"}[protocol]
        truth |= {name: rng.uniform(0.08, 0.25) * k1, "lam": rng.uniform(0.002, 0.006)}
    return Drawn(
        seed,
        FAMILIES[seed % len(FAMILIES)],
        protocol,
        radius,
        truth,
        float(rng.choice([0.001, 0.003, 0.01])),
        rng.uniform(0.01, 0.05),
        rng.uniform(0.0005, 0.003) * k1 * 0.03,
        rng.uniform(0.0005, 0.002),
    )


def rings(d: Drawn) -> tuple[Array, Array]:
    """Depth [m] and force [N]: what each 5 um of the way add, face and mantle."""
    z = np.arange(0.0, 0.075, 5e-6)
    face = math.pi * np.clip(d.radius - d.truth["mu_cone"] * z / math.tan(THETA), 0.0, None) ** 2
    area = math.pi * d.radius**2
    rate = d.truth["k1_cone"] / area * face + d.truth["sigma_cone"] * (area - face) / math.cos(THETA)
    return z, np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * np.diff(z))])


def rough(d: Drawn, z: Array, rng: np.random.Generator) -> Array:
    """Fluctuation of the grains [N] at depths z (n,) [m] along the way, of variance about 1 times `fluctuation`^2."""
    way, n = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(z)))]), z.size
    if d.family == "smooth":  # Gaussian correlation
        grid = np.arange(0.0, way[-1] + 1e-3, 1e-4)
        taps = np.exp(-0.5 * (np.arange(-60, 61) * 1e-4 / d.grain) ** 2)
        noise = np.convolve(rng.normal(size=grid.size + 120), taps / np.sqrt(np.sum(taps**2)), mode="valid")
        return d.fluctuation * np.interp(way, grid, noise)
    if d.family == "saw":  # grows, slips by a random share
        out, level = np.empty(n), 0.0
        slip = rng.uniform(0.5, 1.5)
        for i in range(n):
            level += (way[i] - way[i - 1]) / (3.0 * d.grain) if i else 0.0
            if level > slip:
                level, slip = level - slip * rng.uniform(0.5, 1.0), rng.uniform(0.5, 1.5)
            out[i] = level
        return d.fluctuation * 2.0 * (out - 0.5)
    out, keep = rng.normal(size=n), np.exp(-np.diff(way, prepend=0.0) / d.grain)
    for i in range(1, n):
        out[i] = keep[i] * out[i - 1] + math.sqrt(1.0 - keep[i] ** 2) * out[i]
    return d.fluctuation * out * (2.0 * np.clip(z, 0.0, None) / DEEPEST if d.family == "growing" else 1.0)


def moves(d: Drawn) -> list[Move]:
    """The protocol: to the deepest point, with events every `step`."""
    if d.protocol == "stroke":
        return [("to", DEEPEST)]
    first = max(0.006, d.step)
    depths = np.arange(first, DEEPEST - 0.004, d.step)
    event: Move = ("pause", 0.2) if d.protocol == "stop_go" else ("to", -0.002)
    return [m for z in depths for m in (("to", float(z)), event)] + [("to", DEEPEST)]


def recorded(d: Drawn) -> dict[str, Array]:
    """time_s, depth_m, force_N."""
    rng = np.random.default_rng(np.random.SeedSequence([7, d.seed]))
    z, F = rings(d)
    surface = float(np.round(rng.normal(0.0, 5e-4), 5))
    laws = {n: d.truth.get(n, 0.0) for n in ("s", "s_p")} | {"lam": d.truth.get("lam", 0.004)}
    quiet = log(
        moves(d),
        Grains(static=lambda depth: float(np.interp(depth, z, F)), **laws),
        Arm(surface=surface, noise=0.0),
        start=START,
        rng=rng,
    )
    below = quiet["depth_m"] - surface
    grains = rough(d, quiet["depth_m"], rng) * np.clip(below / d.grain, 0.0, 1.0)
    white = rng.standard_t(4, below.size) / math.sqrt(2.0) if d.family == "heavy" else rng.normal(size=below.size)
    return quiet | {"force_N": quiet["force_N"] + grains + d.noise * white}


def judged(seed: int) -> tuple[Drawn, str, dict[str, tuple[float, float]]]:
    """The log, how its fit failed ("" where it did not), and name: (error in sigmas, sigma over truth)."""
    d = drawn(seed)
    r = recorded(d)
    try:
        found = curves_of(r["time_s"], r["depth_m"], r["force_N"], f"log {seed}", IntrusionParams(), d.radius)
    except (ValueError, ArithmeticError, np.linalg.LinAlgError) as error:
        return d, f"{type(error).__name__}: {error}", {}
    pulls, why = {}, ""
    for name, true in d.truth.items():
        e = found.fits.get(name)
        if e is None or not (math.isfinite(e.value) and e.sigma > 0.0):
            why = f"{name}: no value"
            continue
        pulls[name] = ((e.value - true) / e.sigma, e.sigma / true)
    delta = found.fits["delta"]
    if delta.known and not 0.0 < delta.value < DEEPEST:
        why = f"delta = {1e3 * delta.value:.1f} mm"
    return d, why, pulls


def table(results: list[tuple[Drawn, str, dict[str, tuple[float, float]]]]) -> Iterator[str]:
    """Coverage by parameter and by what the logs differ in, the least first; then every failure."""
    groups: dict[str, list[tuple[float, float]]] = {}
    for d, _, pulls in results:
        size = "R < 10 mm" if d.radius < 0.01 else "R < 20 mm" if d.radius < 0.02 else "R >= 20 mm"
        for name, pull in pulls.items():
            cone = name in CONE
            keys = [f"cone, {size}", f"cone, noise {d.family}", f"cone, {d.protocol}", "cone, all"] if cone else []
            for key in (*keys, name, *([] if cone else [f"{name}, steps of {1e3 * d.step:.0f} mm"])):
                groups.setdefault(key, []).append(pull)
    rows = []
    for key, values in groups.items():
        pull, share = np.array(values).T
        inside = float(np.mean(np.abs(pull) < 2.0))
        error = math.sqrt(max(inside * (1.0 - inside), 0.02) / pull.size)
        worst = float(np.abs(pull).max())
        rows.append((inside, f"| {key} | {pull.size} | {100 * inside:.1f} ± {100 * error:.1f} | {pull.mean():+.2f} | "
                     f"{pull.std():.2f} | {worst:.1f} | {100 * np.median(share):.1f} |"))  # fmt: skip
    yield "| what | values | inside 2 sigma [%] | mean error [sigma] | spread | worst | median sigma / truth [%] |"
    yield "|---|---|---|---|---|---|---|"
    yield from (text for _, text in sorted(rows))
    failed = [(d, why) for d, why, _ in results if why]
    yield f"\nfailures: {len(failed)} of {len(results)}"
    yield from (f"- log {d.seed}: R {1e3 * d.radius:.1f} mm, {d.family}, {d.protocol}: {why}" for d, why in failed)


def main(logs: int = 600, first: int = 0) -> None:
    with ProcessPoolExecutor(2) as pool:
        results = list(pool.map(judged, range(first, first + logs), chunksize=4))
    print("\n".join(table(results)))


if __name__ == "__main__":
    main(*map(int, sys.argv[1:]))
