"""Whether 90 % intervals hold the truth where the apparatus errs alike in every jump, with and without films.

`python -m benchmarks.coverage [--campaigns N] [--undeclared] [--workers N] [--rows FILE]` prints the tables of
`docs/benchmarks.md`; with --rows it takes up where it stopped. --undeclared: the analysis is not told of the camera's
errors (scale, clock), nor of films: coverage must then fall below the bar, which shows that it can.
"""

from __future__ import annotations

import argparse
import importlib
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from jumpvision.diagnosis.diagnose import Diagnosis, diagnose
from jumpvision.diagnosis.fitting import Fit
from jumpvision.diagnosis.jumps import Jump
from jumpvision.lab.blind import campaign
from jumpvision.lab.seal import answer_of, score
from jumpvision.question.document import Z90, document
from jumpvision.question.run import heights_of

from .diagnosis import jumps_of
from .noise import questioned
from .rows import Row, gather, interval, share
from .shared_world import Film, World, physical, stated, world

LOW, HIGH, LEAST = 0.86, 0.94, 0.80  # bars: coverage of all named parameters, and of each one at least
PLANTED, FLAGGED, FALSE = 5.0, 0.95, 0.02  # sigma of a planted contradiction; bars
API = (("jumpvision.diagnosis.jumps", "Shared"), ("jumpvision.diagnosis.measured", "Measured"),
       ("jumpvision.diagnosis.measured", "confirmation"))  # fmt: skip
ROBOT = ("spring_stiffness", "gravity")  # with stated sigmas in every campaign


@dataclass(frozen=True)
class Case:
    """Campaign `number`; undeclared: the analysis does not know what may be wrong."""

    number: int
    undeclared: bool

    @property
    def key(self) -> str:
        return f"{'undeclared' if self.undeclared else 'declared'} #{self.number}"


# --------------------------------------------------------------------------------------------------- the analysis asked
def part(module: str, name: str) -> Any:
    """A name of the package. Raises ImportError that names both where it is not there (yet)."""
    try:
        return getattr(importlib.import_module(module), name)
    except AttributeError as e:
        raise ImportError(f"{module}.{name}: not there") from e


def sharing(jumps: Sequence[Jump]) -> list[Jump]:
    """The jumps, each with what is stated of the camera that all share."""
    shared = part(*API[0])(**stated())
    changed: dict[str, Any] = {"shared": shared}
    return [replace(j, **changed) for j in jumps]


def measured(film: Film) -> Any:
    """A film as the analysis takes it."""
    record = part(*API[1])
    return record(film.names, film.values, film.covariance, film.source)


def confirmation(d: Diagnosis, system: Any, film: Any) -> list[dict[str, Any]]:
    """Rows with quantity, by_jumps, by_film, z, verdict."""
    rows: list[dict[str, Any]] = part(*API[2])(d, system, [film])
    return rows


@dataclass(frozen=True)
class Question:
    """A campaign as the analysis is asked about it."""

    case: Case
    jumps: list[Jump]
    fit: dict[str, Any]
    priors: dict[str, float]

    def answer(self, film: Film | None) -> tuple[Diagnosis, Any, Any]:
        """(diagnosis, system, the film as the analysis took it)."""
        taken = None if film is None else measured(film)
        more = {} if taken is None else {"measured": [taken]}
        jumps = self.jumps if self.case.undeclared else sharing(self.jumps)
        system, noise, scatter, _ = questioned(jumps, self.fit, self.priors, **more)
        rng = np.random.default_rng([182, self.case.number])
        d = diagnose(system, noise, rng, scatter=scatter, by=("kind",), stops=[j.stop for j in jumps])
        return d, system, taken


# ----------------------------------------------------------------------------------------------------------------- rows
def run(case: Case) -> Row:
    """One campaign: intervals without and with its film; a contradiction planted in the film, and none."""
    w = world(case.number)
    rng = np.random.default_rng([183, case.number])
    question = Question(case, *jumps_of(w.setting, campaign(w.setting, rng)))
    out: Row = {"kind": w.kind, "hidden": list(w.setting.hidden), "common": w.common}
    d, system, _ = question.answer(None)
    out["alone"] = scored(d, system, w)
    if case.undeclared:
        return out
    with_film, system, taken = question.answer(w.film)
    out["filmed"] = scored(with_film, system, w)
    out["flagged"] = flagged(confirmation(with_film, system, taken))
    if planted := contradiction(d, w.film, rng):
        name, off = planted
        shifted, system, taken = question.answer(off)
        out |= {"planted": name, "found": flagged(confirmation(shifted, system, taken))}
    return out


def best_of(d: Diagnosis) -> Fit:
    """The fit that a diagnosis stands by."""
    return d.naming.best.fit if d.naming and d.naming.named else d.baseline


def contradiction(d: Diagnosis, film: Film, rng: np.random.Generator) -> tuple[str, Film] | None:
    """(parameter, the film with it off by PLANTED sigma of film minus jumps); None where the jumps say none of them.

    d: the diagnosis of the jumps alone.
    """
    fit = best_of(d)
    for name in rng.permutation([n for n in film.names if n in fit.named]).tolist():
        by = PLANTED * math.hypot(film.sigma(name), fit.sigma(name))
        for sign in rng.permutation([-1.0, 1.0]):
            off = film.shifted(name, float(sign) * by)
            if physical(name, float(off.values[film.names.index(name)])):
                return name, off
    return None


def flagged(rows: Sequence[dict[str, Any]]) -> bool:
    """Whether the confirmation says that film and jumps contradict each other."""
    return any(r["verdict"] == "contradict" for r in rows)


def scored(d: Diagnosis, system: Any, w: World) -> Row:
    """The outcome, and whether every 90 % interval holds the truth: of parameters as they are printed, of right names
    and of those beside wrong or missing ones; of the baseline's fitted ones; of the robot's stated ones."""
    unexplained: Any = {"terms": []} if d.naming and not d.naming.named else None
    data = document(d, system, heights_of(d, system), unexplained)
    named = {
        name: (p["low"], p["high"])
        for cause in data["causes"]
        if cause["mechanism"] in set(data["named"]) & set(w.setting.hidden)
        for name, p in cause["parameters"].items()
    }
    fit = best_of(d)
    others = {p.name: p for p in fit.parameters if p.name not in named and p.name in w.true}
    half = {n: Z90 * fit.sigma(n) for n in others}
    rest = {n: (max(fit.named[n] - half[n], p.low), min(fit.named[n] + half[n], p.high)) for n, p in others.items()}
    fitted = {n: ends for n, ends in rest.items() if n in w.setting.protocol.tables.get("model", {}).get("fit", {})}
    printed = [held(n, ends, w) for n, ends in named.items() if n in w.true]
    outcome = score(data, answer_of(w.setting))["outcome"]
    return {
        "outcome": outcome, "named": data["named"],
        "named parameters": printed if outcome == "right" else [],
        "partly named": printed if outcome != "right" else [],
        "fitted parameters": [held(n, ends, w) for n, ends in fitted.items()],
        "stated parameters": [held(n, rest[n], w) for n in ROBOT if n in rest],
        "chi2_per_dof": d.detection.chi2_per_dof,
    }  # fmt: skip


def held(name: str, ends: tuple[float, float], w: World) -> Row:
    """An interval, its truth, and whether it holds it."""
    return {"name": name, "low": ends[0], "high": ends[1], "true": w.true[name],
            "holds": ends[0] <= w.true[name] <= ends[1]}  # fmt: skip


# --------------------------------------------------------------------------------------------------------------- tables
def report(rows: Sequence[Row]) -> str:
    """Coverage over all and of each parameter, names, contradictions; what is beyond the bars; what failed."""
    good = [r for r in rows if "failed" not in r]
    lines = ["| 90 % intervals of | without films | with films |", "|---|---|---|"]
    for group, title in (
        ("named parameters", "all named parameters (bar 86-94 %)"),
        ("partly named", "those beside a wrong or missing name"),
        ("fitted parameters", "all fitted ones of the baseline"),
        ("stated parameters", "the robot's stated ones"),
    ):
        alone, filmed = (intervals_of(good, k, group) for k in ("alone", "filmed"))
        lines.append(f"| {title} | {cover(alone)} | {cover(filmed)} |")
        for name in sorted({i["name"] for i in alone + filmed}):
            mine = ([i for i in found if i["name"] == name] for found in (alone, filmed))
            lines.append(f"| &emsp;`{name}` (bar 80 %) | {' | '.join(cover(m) for m in mine)} |")
    lines += ["", "| names | campaigns | right or twin | wrong or in part | missed |", "|---|---|---|---|---|"]
    for key, title in (("alone", "without films"), ("filmed", "with films")):
        said = [r[key]["outcome"] for r in good if key in r]
        right, missed = sum(o in ("right", "twin") for o in said), said.count("missed")
        lines.append(f"| {title} | {len(said)} | {share(right, len(said))} | {len(said) - right - missed} | {missed} |")
    planted, none = [r["found"] for r in good if "found" in r], [r["flagged"] for r in good if "flagged" in r]
    lines += ["", "| film and jumps | campaigns | called a contradiction |", "|---|---|---|"]
    lines.append(
        f"| a contradiction of 5 sigma planted (bar 95 %) | {len(planted)} | {share(sum(planted), len(planted))} |"
    )
    lines.append(f"| none planted (bar 2 %) | {len(none)} | {share(sum(none), len(none))} |")
    return "\n".join(
        [*lines, "", *verdict(good), *[f"* failed: {r['key']}: {r['failed']}" for r in rows if "failed" in r]]
    )


def intervals_of(rows: Sequence[Row], key: str, group: str) -> list[Row]:
    """Every interval of a group, of the diagnoses without (alone) or with films (filmed)."""
    return [i for r in rows if key in r for i in r[key][group]]


def cover(intervals: Sequence[Row]) -> str:
    """`88.1 % (84.2-91.3) of 201`; the interval takes them as independent, which those of one campaign are not."""
    n = len(intervals)
    return f"{share(sum(i['holds'] for i in intervals), n)} of {n}"


def verdict(rows: Sequence[Row]) -> list[str]:
    """Coverages and shares beyond their bars, said to be so where the 95 % interval leaves no doubt."""
    out = []
    for key in ("alone", "filmed"):
        every = intervals_of(rows, key, "named parameters")
        names = sorted({i["name"] for i in every})
        for title, low, high, mine in [("all named", LOW, HIGH, every)] + [
            (n, LEAST, 1.0, [i for i in every if i["name"] == n]) for n in names
        ]:
            out += beyond(f"{key}, {title}", sum(i["holds"] for i in mine), len(mine), low, high)
    planted, none = [r["found"] for r in rows if "found" in r], [r["flagged"] for r in rows if "flagged" in r]
    out += beyond("contradiction planted", sum(planted), len(planted), FLAGGED, 1.0)
    return out + beyond("none planted", sum(none), len(none), 0.0, FALSE)


def beyond(title: str, count: int, n: int, low: float, high: float) -> list[str]:
    """A line where a share lies outside its bar; `surely`: its whole interval does."""
    if n == 0 or low <= count / n <= high:
        return []
    least, most = interval(count, n)
    surely = ": surely" if most < low or least > high else ""
    return [f"* {title}: {share(count, n)} of {n}, bar {100 * low:g}-{100 * high:g} %{surely}"]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--campaigns", type=int, default=150)
    parser.add_argument("--undeclared", action="store_true", help="the analysis is not told what may be wrong")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--rows", help="file of one JSON line a campaign; those already there are not made again")
    args = parser.parse_args()
    if not args.undeclared:
        try:
            for module, name in API:
                part(module, name)
        except ImportError as e:
            parser.error(f"{e}; only --undeclared can be asked without it")
    cases = [Case(i, args.undeclared) for i in range(args.campaigns)]
    print(report(gather(cases, run, args.rows, args.workers)))


if __name__ == "__main__":
    main()
