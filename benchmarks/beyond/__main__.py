"""Campaigns with laws of no vocabulary: what is found in them, beside peers.

`python -m benchmarks.beyond [--worlds 0:32] [--who ours,sindy,genetic] [--controls N] [--noise M] [--workers N]
[--rows FILE]` prints the tables of `docs/benchmarks.md`; with --rows it takes up where it stopped. Ours is the command
`jumpvision diagnose` on a folder; fresh jumps that nobody was shown are predicted by `jumpvision simulate --model`.
--controls: campaigns of the vocabulary, in which nothing new is to be discovered.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from scipy.interpolate import CubicSpline

from benchmarks.rows import Row, gather, share
from jumpvision.laboratory import write
from jumpvision.laboratory.blind import Nuisance, choices, draw
from jumpvision.laboratory.campaign import carry_out, defaults

from . import peers
from .fit import Seen, bounds, fit, predicted, seen
from .motion import Array, Command, Law, follow
from .score import HELD_OUT, INSTRUMENTS, Found, read, score
from .worlds import AMPLITUDE, BARRED, NAMES, NOISES, START, SWEEPS, World, moved, times, tracks, world, write_folder

WHO = ("ours", "sindy", "genetic")
MODULES = {"sindy": "pysindy", "genetic": "gplearn"}
SWEPT, FINE = 7, np.arange(0.0, 2.5, 1e-3)  # frequencies; times of the true motion [s]
MINUTES = 3.0  # bar
ENTRY = "import sys; from jumpvision.cli import main; sys.exit(main(sys.argv[1:]))"


@dataclass(frozen=True)
class Case:
    """World `number` asked by `who`; noise [m]: other than the world's own; who = "control": of the vocabulary."""

    who: str
    number: int
    noise: float | None = None

    @property
    def key(self) -> str:
        return f"{self.who} {self.number}" + (f" {1e3 * self.noise:g}" if self.noise else "")


def run(case: Case) -> Row:
    """One campaign asked, and its answer scored."""
    if case.who == "control":
        return {"who": case.who, **control(case.number)}
    w = world(case.number, noise=case.noise)
    found, told = ours(w) if case.who == "ours" else peer(w, case.who)
    return {"who": case.who, "number": w.number, **score(w, found), **told}


# ---------------------------------------------------------------------------------------------------------------- ours
def command(*words: str) -> None:
    """A command of jumpvision; RuntimeError with its last lines where it fails."""
    done = subprocess.run([sys.executable, "-c", ENTRY, *words], capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"jumpvision {words[0]}: {(done.stderr or done.stdout)[-300:]}")


def asked(folder: Path, results: Path) -> tuple[float, float]:
    """Wall and processor seconds of `jumpvision diagnose`."""
    began, before = time.perf_counter(), os.times()
    command("diagnose", str(folder), "--results", str(results), "--workers", "1")
    after = os.times()
    used = after.children_user + after.children_system - before.children_user - before.children_system
    return time.perf_counter() - began, used


def ours(w: World) -> tuple[Found, Row]:
    """The answer of `jumpvision diagnose`, with what its model makes of the fresh jumps."""
    with tempfile.TemporaryDirectory() as where:
        out = Path(where)
        results, later = out / "found", out / "later"
        seconds, used = asked(write_folder(w, out), results)
        found = read(results, seconds=seconds)
        told: Row = {"cpu_s": used}
        try:
            fresh = write_folder(w, out, fresh=True)
            command("simulate", str(fresh), "--results", str(later), "--model", str(results / "model.toml"))
            found = replace(found, fresh_rms=unseen(w, fresh, later))
            told |= in_use(w, results, out)
        except (RuntimeError, FileNotFoundError, ValueError) as e:  # the row says that its model cannot be used
            told["fresh_failed"] = str(e)[-200:]
        return found, told


def in_use(w: World, results: Path, out: Path) -> Row:
    """What the truth makes of a plan and of a sweep with the answer's model: heights of the rod over rest [m]."""
    one = next(d for d in sorted((out / w.name).iterdir()) if d.name.startswith("single"))
    highest = max(float(np.ptp(moved(w, s).rod)) for s in w.shots if s.kind == "single")
    given = ("--experiment", str(one), "--model", str(results / "model.toml"))
    low, high = SWEEPS[w.ground][0][2]
    axes = ("--frequency", f"{low + 0.3}:{high - 0.3}:{SWEPT}", "--phase", f"{1.5 * np.pi}")
    command("sweep", w.ground, *given, *axes, "--results", str(out / "sweep"), "--no-pictures", "--workers", "1")
    with xr.open_dataset(out / "sweep" / "sweep.nc") as data:
        swept = data["jump_height_m"].squeeze()
        shots = [Command(AMPLITUDE[w.ground], float(f), 1.5 * np.pi, START) for f in swept["frequency"]]
        true = [height(w, c) for c in shots]
        told: Row = {"sweep_rms": float(np.sqrt(np.mean((swept.to_numpy() - true) ** 2)))}
    apex = f"{0.8 * highest:.4f}"
    try:
        command("plan", "--ground", w.ground, "--apex", apex, *given, "--results", str(out / "plan"), "--no-pictures")
    except RuntimeError as e:
        return told | {"plan_failed": str(e)[-200:]}
    plan = json.loads((out / "plan" / "plan.json").read_text(encoding="utf-8"))
    table = pd.read_csv(out / "plan" / "plan.csv")
    t, x = table["time_s"].to_numpy(), table["command_m"].to_numpy()
    path = np.stack([t, x, CubicSpline(t, x)(t, 1)], axis=1)
    reached = height(w, Command(0.0, 1.0, 0.0, 0.0, path=path))
    return told | {"plan_m": float(apex), "plan_reached": reached, "plan_spread": plan["apex_spread_m"]}


def height(w: World, c: Command) -> float:
    """The true jump height of a command [m]: of the rod over rest, once the motor has stopped."""
    stop = c.edges[3]  # where it may be falling already
    m = follow(w.jumper, c, w.law, np.unique(np.append(FINE, stop)))
    return float(np.max((m.rod - m.rod[0])[m.t >= stop]))


def unseen(w: World, fresh: Path, results: Path) -> float:
    """rms [m] of the fresh tracks about the simulation, which is as the answer's camera films it."""
    rest = []
    for one, y in zip(sorted(d for d in fresh.iterdir() if d.is_dir()), in_order(w)):
        s = pd.read_csv(results / one.name / "simulation.csv")
        t, rod = s["time_s"].to_numpy(), s["rod_m"].to_numpy()
        h = np.interp(times(), t, rod) - rod[0]
        rest.append(y - (h - h[times() < START].mean()))
    return float(np.sqrt(np.mean(np.concatenate(rest) ** 2)))


def in_order(w: World) -> list[Array]:
    """The fresh tracks in the order of their folders' names."""
    names = [f"{kind}-{c.frequency:g}Hz-{n:02d}" for n, (kind, c) in enumerate(w.fresh)]
    found = dict(zip(names, tracks(w, w.fresh)))
    return [found[n] for n in sorted(names)]


# --------------------------------------------------------------------------------------------------------------- peers
def peer(w: World, who: str) -> tuple[Found | None, Row]:
    """A peer's answer, with what it makes of the fresh jumps."""
    s = seen(w)
    began = time.perf_counter()
    base = fit(s, lambda v: Law(), {})
    answer = (peers.sindy if who == "sindy" else peers.genetic)(s, base, peers.windows(s, base))
    told: Row = {"baseline_chi2_n": base.chi2 / base.n}
    if answer is None:
        return Found("", "", fresh_rms=rms(w, s, base.values, Law())), told
    fresh = rms(w, s, answer.values, answer.law)
    found = Found(answer.words, answer.acts_on, seconds=time.perf_counter() - began, fresh_rms=fresh)
    return found, told | {"chi2_n": answer.chi2 / base.n}


def rms(w: World, s: Seen, values: dict[str, float], law: Law) -> float:
    """rms [m] of the fresh tracks about a simulation by `motion`."""
    rest = [a - b for a, b in zip(tracks(w, w.fresh), predicted(s, values, law, w.fresh))]
    return float(np.sqrt(np.mean(np.concatenate(rest) ** 2)))


# ------------------------------------------------------------------------------------------------------------ controls
def control(number: int) -> Row:
    """A campaign of the vocabulary as the hidden-effect game writes it: what is named, whether a law is discovered."""
    rng = np.random.default_rng([22, number])
    ground = ("granular", "hard")[number % 2]
    every = choices(ground)
    first, noise = every[number // 2 % len(every)], NOISES[number // 2 % 2]
    beside = [[]] if number // 4 % 2 == 0 else [[str(h)] for h in rng.permutation([h for h in every if h != first])]
    for other in beside:  # the first that can act together with it
        hidden = [first, *other]
        with suppress(ValueError):
            setting = draw(rng, ground=ground, hidden=hidden, nuisance=Nuisance(noise, 0.0, 0.0))
            break
    with tempfile.TemporaryDirectory() as where:
        out = Path(where)
        folder = out / "campaign"
        folder.mkdir()
        work = [(setting.protocol, jump) for jump in setting.protocol.jumps]
        carry_out(work, folder, seed=number, workers=1, sealed=True)
        write.toml(folder / "campaign.toml", defaults(setting.protocol))
        seconds, used = asked(folder, out / "found")
        found = read(out / "found", seconds=seconds)
    return {
        "number": number, "ground": ground, "hidden": hidden, "strength": setting.strength, "noise": noise,
        "named": found.named, "law": found.law, "acts_on": found.acts_on, "cpu_s": used,
    }  # fmt: skip


# --------------------------------------------------------------------------------------------------------------- table
def table(rows: list[Row]) -> str:
    """The tables of docs/benchmarks.md, worst first."""
    lines = ["| bar | asked | measured |", "|---|---|---|"]
    for who in WHO:
        mine = of(rows, who)
        if mine:
            lines += _bars(who, mine)
    lines += _against(rows)
    controls = of(rows, "control")
    if controls:
        good = [r for r in controls if "failed" not in r]
        new = [r for r in good if r["law"]]
        lines.append(
            f"| known mechanisms called discovered | <= 2 % | {share(len(new), len(good))} of {len(good)}, "
            f"{len(controls) - len(good)} failed |"
        )
    for who in WHO:
        mine = of(rows, who)
        if mine:
            lines += ["", f"{TITLES[who]}:", "", *_rows(mine)]
    if controls:
        lines += ["", "Controls in which a law was discovered, or that failed:", ""]
        lines += [f"- {r['key']}: {r.get('hidden')} {r.get('noise')}: {r.get('failed') or r['law']}"
                  for r in controls if r.get("failed") or r["law"]]  # fmt: skip
    return "\n".join(lines)


def of(rows: list[Row], who: str) -> list[Row]:
    """The rows of one answerer, those that failed too."""
    return [r for r in rows if r["key"].split()[0] == who]


def number(r: Row) -> int:
    """Of its world."""
    return int(r["key"].split()[1])


TITLES = {"ours": "jumpvision", "sindy": "PySINDy", "genetic": "gplearn"}


def _bars(who: str, mine: list[Row]) -> Iterator[str]:
    """One answerer's lines of the table of bars."""
    forms = [r for r in mine if number(r) < BARRED]
    active = [r for r in mine if number(r) >= BARRED]
    n, name = len(forms), TITLES[who]
    right = sum(r.get("right", False) for r in forms)
    near = sum(r.get("exponents", False) for r in forms)
    yield f"| {name}: right family | >= 20 of 24 | {right} of {n} |"
    yield f"| {name}: and exponents | within 0.1 or 2 sigma | {near} of {right} |"
    told = sum(r.get("instrument_told", False) for r in mine)
    yield f"| {name}: instrument told from force | >= 90 % | {share(told, len(mine))} |"
    held = [r.get("fresh") or np.nan for r in forms]
    yield f"| {name}: fresh jumps within {HELD_OUT} noise | >= 20 of 24 | {sum(h <= HELD_OUT for h in held)} of {n} |"
    if who == "ours":
        own = sum((r.get("held_out") or np.nan) <= HELD_OUT for r in forms)
        yield f"| {name}: its own held-out jumps within {HELD_OUT} noise | >= 20 of 24 | {own} of {n} |"
        wrong = sum(r.get("passive_wrong", False) for r in mine)
        yield f"| energy-creating laws called passive | 0 | {wrong} of {len(active)} |"
        yield f"| passive laws called active | - | {sum(r.get('active_wrong', False) for r in forms)} of {n} |"
        yield from _used(mine)
        took = [r["cpu_s"] / 60.0 for r in mine if "cpu_s" in r]
        if took:
            yield (
                f"| processor time a campaign | <= {2 * MINUTES:g} min ({MINUTES:g} on 2 cores) "
                f"| median {np.median(took):.1f}, worst {max(took):.1f} min |"
            )


def _used(mine: list[Row]) -> Iterator[str]:
    """What the truth makes of sweeps and plans with the models of laws that were right."""
    swept = [1e3 * r["sweep_rms"] for r in mine if r.get("right") and "sweep_rms" in r]
    if swept:
        text = f"median {np.median(swept):.3f}, worst {max(swept):.3f}"
        yield f"| sweeps with right laws: rms of the heights, mm | - | {text} |"
    planned = [r for r in mine if r.get("right") and "plan_reached" in r]
    off = [abs(r["plan_reached"] - r["plan_m"]) for r in planned]
    within = sum(d <= 3 * (r["plan_spread"] or 0.0) for d, r in zip(off, planned))
    failed = sum("plan_failed" in r for r in mine if r.get("right"))
    if planned or failed:
        text = f"median {1e3 * np.median(off):.3f}, worst {1e3 * max(off):.3f}; " if off else ""
        text += f"{within} of {len(off)} within, {failed} no plan"
        yield f"| plans with right laws: the truth's apex off by, mm | within 3 sigma | {text} |"


def _against(rows: list[Row]) -> Iterator[str]:
    """Ours against each peer on the fresh jumps of the same worlds."""
    ours = {number(r): r for r in of(rows, "ours") if number(r) < BARRED}
    for who in WHO[1:]:
        pairs = [(ours[number(r)], r) for r in of(rows, who) if number(r) in ours]
        better = sum((a.get("fresh") or np.inf) < (b.get("fresh") or np.inf) for a, b in pairs)
        if pairs:
            yield f"| better than {TITLES[who]} on fresh jumps | >= 20 of 24 | {better} of {len(pairs)} |"


def _rows(mine: list[Row]) -> Iterator[str]:
    """Every campaign of one answerer, the worst on fresh jumps first, those that failed before."""
    yield "| campaign | noise mm | law found | on | family | exponents | energy | fresh, noises | held out | s |"
    yield "|---|---|---|---|---|---|---|---|---|---|"
    for r in sorted(mine, key=lambda r: -(1e9 if "failed" in r else r.get("fresh") or 1e8)):
        if "failed" in r:
            yield f"| {r['key']} | | failed: {r['failed']} | | | | | | | {r['seconds']:.0f} |"
            continue
        law = cell(r["law"] or f"none, named: {', '.join(r['named']) or 'nothing'}")
        shape = ", ".join(f"{n} {v[0]:.3g}±{v[1]:.2g}" for n, v in r.get("shape", {}).items())
        energy = {True: "passive", False: "active"}.get(r.get("passive"), "-") + (
            " WRONG" if r["passive_wrong"] else ""
        )
        family = cell(f"{'right' if r['right'] else 'WRONG'}, like {r.get('looks_like', '-')}")
        place = ("instrument" if r.get("acts_on") in INSTRUMENTS else r.get("acts_on")) or "-"
        numbers = " | ".join(f"{r[k]:.2f}" if np.isfinite(r.get(k, np.nan)) else "-" for k in ("fresh", "held_out"))
        good = "yes" if r["exponents"] else "no"
        yield (
            f"| {r['number']} {r['family']}, {r['ground']} | {1e3 * r['noise']:g} | {law} | {place} | {family} "
            f"| {good} {shape} | {energy} | {numbers} | {r['seconds']:.0f} |"
        )


def cell(text: str) -> str:
    """As a cell of a table."""
    return text.replace("|", "\\|")


def sizes(numbers: list[int]) -> str:
    """How strong every hidden law is: what the declared model cannot fit, and how well its form could be told."""
    lines = [
        "| world | law | noise mm | non-centrality | shape, true ± what the campaign can tell |",
        "|---|---|---|---|---|",
    ]
    for n in numbers:
        w = world(n)
        b = bounds(w)
        names = ("clock", "lens", "lens_height") if w.form.acts_on in INSTRUMENTS else ("a", *w.form.shape)
        sigmas = [b["sigma"][m] for m in names if m in b["sigma"]]
        shape = ", ".join(f"{m} {v:.3g} ± {s:.1g}" for m, v, s in zip(("a", *w.form.shape), w.p, sigmas))
        lines.append(
            f"| {n} {w.ground} | {cell(w.form.words)} | {1e3 * w.noise:g} | {b['noncentrality']:.2g} | {shape} |"
        )
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--worlds", default=f"0:{len(NAMES)}", help="such as 0:24, or 3,18,20")
    parser.add_argument("--who", default=",".join(WHO))
    parser.add_argument("--controls", type=int, default=0)
    parser.add_argument("--noise", type=float, help="m: other than the worlds' own")
    parser.add_argument("--workers", type=int, default=1)
    parser.add_argument("--rows", help="file for one JSON line a campaign; those already there are not made again")
    parser.add_argument("--sizes", action="store_true", help="how strong the hidden laws are, instead")
    args = parser.parse_args()
    if ":" in args.worlds:
        numbers = list(range(*map(int, args.worlds.split(":"))))
    else:
        numbers = [int(n) for n in args.worlds.split(",") if n]
    if args.sizes:
        print(sizes(numbers))
        return
    who = [x for x in args.who.split(",") if x]
    for name in who:
        if name in MODULES and not peers.installed(MODULES[name]):
            print(f"{TITLES[name]}: not installed, left out (pip install -e '.[bench]')\n")
    who = [x for x in who if x not in MODULES or peers.installed(MODULES[x])]
    cases: list[Any] = [Case(x, n, args.noise) for n in numbers for x in who]
    cases += [Case("control", n) for n in range(args.controls)]
    print(table(gather(cases, run, args.rows, args.workers)))


if __name__ == "__main__":
    main()
