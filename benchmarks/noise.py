"""What a diagnosis says of the noise, and what it then calls discrepant, in worlds whose noise it does not know.

`python -m benchmarks.noise [--each N] [--power N] [--named N] [--cells TEXT] [--spoil F] [--workers N] [--rows FILE]`
prints the tables of `docs/benchmarks.md`; with --rows it takes up where it stopped. --cells: only those whose name
holds every word of TEXT, e.g. "null 1 24 t3". --spoil: multiplies the learned s before the test: the false alarms must
then fail.
"""

from __future__ import annotations

import argparse
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from jumpvision.engine.detect import Detection, detect, directions
from jumpvision.engine.fitting import Problem
from jumpvision.engine.noise.noise import Noise
from jumpvision.engine.order import Order, fit_baseline
from jumpvision.jumper.question.jumper import Jumper
from jumpvision.jumper.question.jumps import Jump
from jumpvision.jumper.question.learning import Learned, learn_noise
from jumpvision.jumper.question.words import diagnosis_of
from jumpvision.laboratory.blind import Nuisance, Recorded, Setting, campaign, choices, draw
from jumpvision.laboratory.game import score
from jumpvision.laboratory.recordings import NU

from .diagnosis import jumps_of
from .oracle import Oracle, Unreachable, level_for
from .rows import Row, gather, interval, share

Array = NDArray[np.float64]

FAMILIES: dict[str, dict[str, Any]] = {
    "white": {},
    "AR 0.7": {"rho": 0.7},
    "t3": {"family": "t3"},
    "0.5 % outliers": {"family": "outliers"},
    "drift 0.05 mm": {"drift": 5e-5},
    "rounded to 0.1 mm": {"step": 1e-4},
    "5:1 by track": {"ratio": 5.0},
}
SIZES = {4: "few", 24: "full"}
GROUNDS, NOISES = ("granular", "hard"), (5e-5, 5e-4)  # m
TARGET = 100.0  # non-centrality of the hidden effect
NEAR, BAR, FOUND = 0.10, 0.04, 0.95  # bars: learned s, false alarms, detected
HALF = 0.6827  # of the errors lie within this half width


@dataclass(frozen=True)
class Cell:
    """One line of a table. table: null or power; spoil: factor on the learned s."""

    table: str
    trials: int
    size: int
    family: str
    spoil: float = 1.0

    @property
    def name(self) -> str:
        spoilt = f" spoilt {self.spoil:g}" if self.spoil != 1.0 else ""
        return f"{self.table} {self.trials} {self.size} {self.family}{spoilt}"


@dataclass(frozen=True)
class Case:
    """One campaign of a cell, its number from 0 on: grounds and noise levels alternate. naming: what is hidden is to be
    named too, which takes ten times as long."""

    cell: Cell
    number: int
    naming: bool = True

    @property
    def key(self) -> str:
        return f"{self.cell.name} #{self.number}"

    @property
    def seed(self) -> list[int]:
        c = self.cell
        return [18, c.table == "power", c.trials, c.size, list(FAMILIES).index(c.family), self.number]

    @property
    def ground(self) -> str:
        return GROUNDS[self.number % 2]

    @property
    def noise(self) -> float:
        return NOISES[self.number // 2 % 2]

    def setting(self, hidden: Sequence[str] = (), strength: float | None = None) -> Setting:
        """The campaign's setting: the same but for the strength of what is hidden."""
        return draw(
            np.random.default_rng([*self.seed, 1]), ground=self.ground, hidden=hidden, strength=strength,
            trials=self.cell.trials, jumps=SIZES[self.cell.size],
            nuisance=Nuisance(self.noise, **{"rho": 0.0, "step": 0.0} | FAMILIES[self.cell.family]),
        )  # fmt: skip

    def tracks(self, setting: Setting) -> list[Recorded]:
        """The campaign's tracks: with the same errors, whatever is hidden."""
        return campaign(setting, np.random.default_rng([*self.seed, 2]))


def questioned(jumps: list[Jump], fit: dict[str, Any], priors: dict[str, float]) -> Learned:
    """The jumps as a system that is asked, with what is learned of their noise."""
    return learn_noise(Jumper(jumps, fit, priors, workers=1))


def spoilt(noise: Noise, by: float) -> Noise:
    """A noise with a wrong standard deviation; its wander stays."""
    return replace(noise, s=noise.s * by)


def true_half_width(recorded: Sequence[Recorded], family: str) -> Array:
    """(jump,) half width [m] that holds 68.27 % of the errors of heavy tails; else the standard deviation, rounding
    included, outliers and wander not."""
    sigma = np.array([r.sigma for r in recorded])
    if FAMILIES[family].get("family") == "t3":
        return np.asarray(sigma * np.sqrt((NU - 2.0) / NU) * stats.t.ppf(0.5 + 0.5 * HALF, NU))
    return sigma


# ----------------------------------------------------------------------------------------------------------------- rows
def run(case: Case) -> Row:
    """One campaign made, questioned and scored."""
    return null(case) if case.cell.table == "null" else power(case)


def null(case: Case) -> Row:
    """The declared model is true: what is learned of the noise, and whether the model is called discrepant."""
    rng = np.random.default_rng([*case.seed, 3])
    setting = case.setting()
    recorded = case.tracks(setting)
    jumps, fit, priors = jumps_of(setting, recorded)
    learned = questioned(jumps, fit, priors)
    problem = Problem(learned.system, spoilt(learned.noise, case.cell.spoil), learned.scatter)
    found = tested(problem, rng)
    return {
        **about(case, learned),
        "ratio": list(learned.sigma * learned.tracks / true_half_width(recorded, case.cell.family)),
        "alarm": found.discrepant, "p": found.p_value, "p_chi2": found.p_chi2, "p_score": found.p_score,
        "chi2_per_dof": found.chi2_per_dof,
    }  # fmt: skip


def tested(problem: Problem, rng: np.random.Generator) -> Detection:
    """Whether the declared model, fitted, is called discrepant."""
    base = fit_baseline(problem, rng)
    return detect(problem, base, directions(problem, base), rng)


def power(case: Case) -> Row:
    """One effect of non-centrality TARGET is hidden: whether it is detected, and named."""
    rng = np.random.default_rng([*case.seed, 3])
    setting, level, reached = hide(case)
    jumps, fit, priors = jumps_of(setting, case.tracks(setting))
    learned = questioned(jumps, fit, priors)
    system, stops = learned.system, [j.stop for j in jumps]
    told = {**about(case, learned), "hidden": setting.hidden[0], "strength": level, "noncentrality": reached}
    if not case.naming:
        found = tested(Problem(system, learned.noise, learned.scatter), rng)
        return {**told, "detected": found.discrepant, "p": found.p_value, "chi2_per_dof": found.chi2_per_dof}
    d = Order(Problem(system, learned.noise, learned.scatter), rng, by=("kind",), stops=stops).all()
    data = diagnosis_of(d, learned)
    outcome = score(data.values, setting.hidden, setting.parameters)["outcome"]
    return {
        **told, "detected": not d.adequate, "outcome": outcome, "named": data.named, "p": d.detection.p_value,
        "chi2_per_dof": d.detection.chi2_per_dof,
    }  # fmt: skip


def hide(case: Case) -> tuple[Setting, float, float]:
    """(setting, strength, non-centrality) with one effect, drawn among those that can be as plain as TARGET."""
    order = np.random.default_rng([*case.seed, 4]).permutation(choices(case.ground))
    for name in (str(n) for n in order):

        def drawn(level: float, name: str = name) -> Setting:
            return case.setting((name,), level)

        try:
            first = drawn(0.0)
            level, reached = level_for(TARGET, drawn, Oracle(first, case.tracks(first)), 0.0)
        except Unreachable:
            continue
        return drawn(level), level, reached
    raise Unreachable(f"{case.key}: no effect can be made as plain as {TARGET:g}")


def about(case: Case, learned: Learned) -> Row:
    """What a row of either table says of the campaign and of the noise that was learned."""
    noise = learned.noise
    return {
        "cell": case.cell.name, "ground": case.ground, "noise": case.noise, "s": noise.s, "rho": noise.rho,
        "drift": noise.drift, "sigma": learned.sigma, "tails": learned.tails, "outliers": len(learned.outliers),
        "warnings": list(learned.warnings), "log_sigma": noise.log_sigma,
    }  # fmt: skip


# --------------------------------------------------------------------------------------------------------------- tables
def cells(spoil: float) -> Iterator[Cell]:
    """Nulls of both sizes, then power with 24 jumps (not where the noise is spoilt)."""
    for table, sizes in (("null", (4, 24)), ("power", (24,))):
        for family in FAMILIES:
            for trials in (1, 2):
                for size in sizes:
                    if table == "null" or spoil == 1.0:
                        yield Cell(table, trials, size, family, spoil)


def nulls_table(rows: Sequence[Row], asked: Sequence[Cell]) -> list[str]:
    """Worst first: by false alarms, then by the share of tracks whose s is within 10 %."""
    head = [
        "| noise | trials | jumps | campaigns | false alarms (nominal 2 %, bar 4 %) | learned s / true s, median "
        "| within 10 % | chi^2/dof, median (5-95 %) | with a warning | failed |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    lines = []
    for cell in asked:
        good, bad = split(rows, cell)
        ratio = np.concatenate([r["ratio"] for r in good]) if good else np.array([np.nan])
        near = np.abs(ratio - 1.0) < NEAR
        alarms = sum(r["alarm"] for r in good)
        chi2 = np.quantile([r["chi2_per_dof"] for r in good], [0.5, 0.05, 0.95]) if good else [np.nan] * 3
        warned = sum(bool(r.get("warnings")) for r in good)
        title = cell.family + (f", learned s x {cell.spoil:g}" if cell.spoil != 1.0 else "")
        line = (
            f"| {title} | {cell.trials} | {cell.size} | {len(good) + len(bad)} | {share(alarms, len(good))} "
            f"| {np.median(ratio):.3f} | {100 * np.mean(near):.0f} % "
            f"| {chi2[0]:.2f} ({chi2[1]:.2f}-{chi2[2]:.2f}) | {warned} | {len(bad)} |"
        )
        lines.append((-alarms / max(len(good), 1), float(np.mean(near)), -len(bad), line))
    return head + [line for *_, line in sorted(lines)] if lines else []


def power_table(rows: Sequence[Row], asked: Sequence[Cell]) -> list[str]:
    """Worst first: by the share detected."""
    head = [
        "| one effect of non-centrality 100, noise | trials | campaigns | detected (bar 95 %) "
        "| named right or its twin | failed |",
        "|---|---|---|---|---|---|",
    ]
    lines = []
    for cell in asked:
        good, bad = split(rows, cell)
        seen, asked_names = sum(r["detected"] for r in good), [r["outcome"] for r in good if "outcome" in r]
        named = sum(o in ("right", "twin") for o in asked_names)
        lines.append((seen / max(len(good), 1), -len(bad),
                      f"| {cell.family} | {cell.trials} | {len(good) + len(bad)} | {share(seen, len(good))} "
                      f"| {share(named, len(asked_names))} | {len(bad)} |"))  # fmt: skip
    return head + [line for *_, line in sorted(lines)] if lines else []


def split(rows: Sequence[Row], cell: Cell) -> tuple[list[Row], list[Row]]:
    """(rows of a cell, those of them that failed)."""
    mine = [r for r in rows if r["key"].rpartition(" #")[0] == cell.name]
    return [r for r in mine if "failed" not in r], [r for r in mine if "failed" in r]


def verdict(rows: Sequence[Row], asked: Sequence[Cell]) -> list[str]:
    """Cells beyond their bar, `surely` where the interval leaves no doubt; cells whose learned s is off; failures."""
    out = []
    for cell in asked:
        good, _ = split(rows, cell)
        if not good:
            continue
        key, bar, high = ("alarm", BAR, True) if cell.table == "null" else ("detected", FOUND, False)
        count = sum(r[key] for r in good)
        low, up = interval(count, len(good))
        beyond = count / len(good) > bar if high else count / len(good) < bar
        surely = low > bar if high else up < bar
        if beyond:
            out.append(f"* {cell.name}: {share(count, len(good))}, bar {100 * bar:g} %{': surely' if surely else ''}")
        if cell.table == "null":
            off = float(np.median(np.concatenate([r["ratio"] for r in good])))
            out += [f"* {cell.name}: learned s {off:.3f} times the true one"] if abs(off - 1.0) > NEAR else []
    reasons = Counter(r["failed"] for r in rows if "failed" in r)
    return out + [f"* failed {n} times: {why}" for why, n in reasons.most_common()]


def report(rows: Sequence[Row], asked: Sequence[Cell]) -> str:
    """The tables and what is beyond the bars."""
    nulls = nulls_table(rows, [c for c in asked if c.table == "null"])
    powers = power_table(rows, [c for c in asked if c.table == "power"])
    return "\n".join([*nulls, "", *powers, "", *verdict(rows, asked)]).strip()


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--each", type=int, default=100, help="campaigns of each cell of nulls")
    parser.add_argument("--power", type=int, default=40, help="campaigns of each cell with a hidden effect")
    parser.add_argument("--named", type=int, default=4, help="of these: whose effect is named too")
    parser.add_argument("--cells", default="", help="words that the name of a cell must hold")
    parser.add_argument("--spoil", type=float, default=1.0, help="factor on the learned s")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rows", help="file of one JSON line a campaign; those already there are not made again")
    args = parser.parse_args()
    asked = [c for c in cells(args.spoil) if all(f" {w} " in f" {c.name} " for w in args.cells.split())]
    if not asked:
        parser.error(f"--cells {args.cells!r}: none of these: {', '.join(c.name for c in cells(args.spoil))}")
    number = {"null": args.each, "power": args.power}
    cases = [Case(c, i, i < args.named) for c in asked for i in range(number[c.table])]
    print(report(gather(cases, run, args.rows, args.workers), asked))


if __name__ == "__main__":
    main()
