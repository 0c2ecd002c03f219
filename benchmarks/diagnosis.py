"""Hidden effects: campaigns of the virtual laboratory whose declared model lacks something, or nothing.

`python -m benchmarks.diagnosis [--nulls N] [--effects N] [--pairs N] [--outside N] [--workers N]` prints the tables of
`docs/benchmarks.md`. The data are made by the laboratory's own integrator.
"""

from __future__ import annotations

import argparse
import json
import os
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from jumpvision.engine.detect import detect, directions
from jumpvision.engine.fitting import Problem
from jumpvision.engine.naming import confidence_set
from jumpvision.engine.order import Order, fit_baseline
from jumpvision.experiment.inputs.sections import Actuation
from jumpvision.experiment.stages.rod import commanded
from jumpvision.jumper.mechanisms.registry import ModelParameters
from jumpvision.jumper.physics.forcing import from_motion
from jumpvision.jumper.physics.model import Model
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.jumps import Jump
from jumpvision.jumper.question.learning import learn_noise
from jumpvision.jumper.question.words import diagnosis_of
from jumpvision.laboratory.blind import ROBOTS, Nuisance, Recorded, Setting, campaign, choices, draw
from jumpvision.laboratory.game import score

ENCODER = 6.25e-6  # m
NOISES = {  # nuisance of the false-alarm table: rho, rounding step [m]
    "white": {"rho": 0.0, "step": 0.0},
    "correlated, rho 0.7": {"rho": 0.7, "step": 0.0},
    "rounded to 0.1 mm": {"rho": 0.0, "step": 1e-4},
    "correlated and rounded": {"rho": 0.5, "step": 5e-5},
}


@dataclass(frozen=True)
class Case:
    """One campaign: what is hidden ((): nothing), how strong, with what noise."""

    table: str
    seed: int
    ground: str
    hidden: tuple[str, ...]
    noise: float
    nuisance: dict[str, Any]
    strength: float | None = None
    trials: int = 1


def jumps_of(setting: Setting, recorded: list[Recorded]) -> tuple[list[Jump], dict[str, Any], dict[str, float]]:
    """(jumps, ranges, priors) as `jumpvision diagnose` would read them from the campaign's folders."""
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


def run(case: Case) -> dict[str, Any]:
    """One campaign made, questioned and scored."""
    rng = np.random.default_rng([case.seed, 77])
    setting = draw(
        rng, ground=case.ground, hidden=case.hidden, strength=case.strength, trials=case.trials,
        nuisance=Nuisance(case.noise, **case.nuisance),
    )  # fmt: skip
    jumps, fit, priors = jumps_of(setting, campaign(setting, rng))
    began = time.perf_counter()
    learned = learn_noise(Jumper(jumps, fit, priors, workers=1))
    system, noise, scatter = learned.system, learned.noise, learned.scatter
    out: dict[str, Any] = {"table": case.table, "hidden": "+".join(case.hidden) or "nothing", "noise": case.noise,
                           "ground": case.ground, "seed": case.seed, "s": noise.s, "rho": noise.rho,
                           "scatter": scatter}  # fmt: skip
    if not case.hidden:
        problem = Problem(system, noise, scatter)
        base = fit_baseline(problem, rng)
        found = detect(problem, base, directions(problem, base), rng)
        out |= {"p": found.p_value, "p_chi2": found.p_chi2, "p_score": found.p_score}
        out["outcome"] = "false alarm" if found.discrepant else "right"
    else:
        problem, stops = Problem(system, noise, scatter), [j.stop for j in jumps]
        d = Order(problem, rng, by=("kind",), stops=stops).all()
        data = diagnosis_of(d, learned)
        out |= {"p": data.p_value, "named": "+".join(data.named), "status": data.status}
        out |= score(data.values, setting.hidden, setting.parameters)
        out["twins"] = data.indistinguishable
        if d.naming:
            wrong = [e for e in d.naming.tried if set(e.mechanisms) != set(case.hidden)]
            best = min((e.fit.chi2 for e in wrong), default=np.nan)
            out["in_set"] = any(set(e.mechanisms) == set(case.hidden) for e in confidence_set(d.naming.tried))
            out["noncentrality"] = float(best - true_fit(problem, setting))
            out["best_chi2_per_n"] = d.naming.best.fit.chi2 / sum(r.size for r in d.baseline.residuals)
        out["detected"] = float(d.baseline.chi2 - sum(r.size - 1 for r in d.baseline.residuals))
        out["held_out"] = data.gain.rmse_track_after_m / noise.s if data.gain else None
        out["truth"] = dict(setting.parameters)
    out["seconds"] = time.perf_counter() - began
    return out


def true_fit(problem: Problem, setting: Setting) -> float:
    """chi^2 of the right model, fitted from the truth; NaN where the vocabulary has it not or it cannot be followed."""
    if not set(setting.hidden) <= set(problem.system.candidates):
        return float("nan")
    fit = problem.fit(setting.hidden, {**setting.protocol.parameters, **setting.parameters})
    return fit.chi2 if fit else float("nan")


def cases(nulls: int, effects: int, pairs: int, outside: int) -> Iterator[Case]:
    """The full set: nulls by kind of noise, every mechanism on every ground, pairs, effects of no vocabulary."""
    seed = 0
    for name, nuisance in NOISES.items():
        for i in range(nulls):
            seed += 1
            yield Case(f"null, {name}", seed, ("granular", "hard")[i % 2], (), (5e-5, 5e-4)[i // 2 % 2], nuisance)
    plain = {"rho": 0.0, "step": 0.0}
    for i in range(effects):
        for ground in ("granular", "hard"):
            for h in choices(ground):
                seed += 1
                yield Case("one", seed, ground, (h,), (5e-5, 5e-4)[i % 2], plain)
    rng = np.random.default_rng(5)
    for i in range(pairs):
        seed += 1
        ground = ("granular", "hard")[i % 2]
        pair = tuple(str(h) for h in rng.choice(choices(ground), 2, replace=False))
        yield Case("two", seed, ground, pair, (5e-5, 5e-4)[i // 2 % 2], plain, 0.6)
    for i in range(outside):
        for ground in ("granular", "hard"):
            for h in choices(ground, outside=True):
                seed += 1
                yield Case("outside", seed, ground, (h,), (5e-5, 5e-4)[i % 2], plain, 0.8)


def attempt(case: Case) -> dict[str, Any]:
    try:
        return run(case)
    except ValueError as e:
        return {"table": case.table, "hidden": "+".join(case.hidden), "ground": case.ground, "seed": case.seed,
                "noise": case.noise, "outcome": f"not possible: {e}", "seconds": 0.0}  # fmt: skip


DETECTABLE = 30.0  # non-centrality: a weaker effect cannot be demanded


def table(rows: list[dict[str, Any]]) -> str:
    """The tables of docs/benchmarks.md."""
    lines = ["| nothing hidden, noise | campaigns | called discrepant (nominal 2 %) |", "|---|---|---|"]
    for name in NOISES:
        mine = [r for r in rows if r["table"] == f"null, {name}"]
        if mine:
            lines.append(f"| {name} | {len(mine)} | {sum(r['outcome'] == 'false alarm' for r in mine)} |")
    lines += [
        "",
        "| hidden | campaigns | right | of them a declared twin | missed | wrong or in part | failed |",
        "|---|---|---|---|---|---|---|",
    ]
    named = {"one": "one mechanism", "two": "two at once", "outside": "of no vocabulary: said so"}
    for key, title in named.items():
        mine = [r for r in rows if r["table"] == key]
        known = ("right", "twin", "missed", "wrong", "partly")
        count = {o: sum(r["outcome"] == o for r in mine) for o in known}
        if mine:
            lines.append(
                f"| {title} | {len(mine)} | {count['right'] + count['twin']} | {count['twin']} | {count['missed']} "
                f"| {count['wrong'] + count['partly']} | {len(mine) - sum(count.values())} |"
            )
    one = [r for r in rows if r["table"] == "one"]
    lines += [
        "",
        "| one mechanism, non-centrality against the best wrong one | campaigns | right or twin | in the 90 % set "
        "| median error of its parameters |",
        "|---|---|---|---|---|",
    ]
    for title, mine in (
        ("1,000 and more", [r for r in one if r.get("noncentrality", np.nan) >= 1000]),
        ("30 to 1,000", [r for r in one if DETECTABLE <= r.get("noncentrality", np.nan) < 1000]),
        ("less", [r for r in one if r.get("noncentrality", np.nan) < DETECTABLE]),
        ("not known: missed, or the right model failed", [r for r in one if np.isnan(r.get("noncentrality", np.nan))]),
    ):
        right = sum(r["outcome"] in ("right", "twin") for r in mine)
        inside = [r.get("in_set", False) for r in mine]
        error = [
            abs(v / r["truth"][k[9:]])
            for r in mine
            for k, v in r.items()
            if k.startswith("error of ") and r["truth"].get(k[9:])
        ]
        share = f"{sum(inside)} of {len(inside)}" if inside else "-"
        lines.append(f"| {title} | {len(mine)} | {right} | {share} | {100 * np.median(error or [np.nan]):.2g} % |")
    covers = [v for r in rows for k, v in r.items() if k.startswith("interval of")]
    held = [r["held_out"] for r in rows if r.get("held_out") and r["outcome"] in ("right", "twin")]
    seconds = [r["seconds"] for r in rows if r["table"] in ("one", "two")]
    if covers and held:
        lines.append("")
        lines.append(
            f"90 % intervals of the named parameters cover {100 * np.mean(covers):.0f} % of {len(covers)}; held-out "
            f"track error after extension {np.median(held):.2f} of the noise (median; 90 %: "
            f"{np.quantile(held, 0.9):.2f}); {np.median(seconds):.0f} s a campaign of 24 jumps on one core (median)."
        )
    return "\n".join(lines)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    for option, default in (("nulls", 20), ("effects", 2), ("pairs", 8), ("outside", 2), ("workers", 2)):
        parser.add_argument(f"--{option}", type=int, default=default)
    parser.add_argument("--only", default="", help="hidden effects that contain this text")
    parser.add_argument("--rows", help="file for one JSON line a campaign; those already there are not made again")
    args = parser.parse_args()
    file = Path(args.rows or os.devnull)
    found = (
        [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
        if args.rows and file.exists()
        else []
    )
    done = {r["seed"] for r in found}
    every = cases(args.nulls, args.effects, args.pairs, args.outside)
    wanted = [c for c in every if args.only in "+".join(c.hidden) and c.seed not in done]
    with ProcessPoolExecutor(args.workers) as pool, file.open("a", encoding="utf-8") as rows:
        for row in pool.map(attempt, wanted):
            found.append(row)
            print(json.dumps(row, default=float), file=rows, flush=True)
    print(table(found))
