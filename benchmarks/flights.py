"""Flights in drawn tracks (`tests/worlds/flights.py`): counted right, do their sigmas cover, is a wrong scale told?

python -m benchmarks.flights [--full] [--seed 0] [--each]
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import dataclass

import numpy as np

from jumpvision.estimate.flight import Flights, contact_flights, restitution
from tests.worlds.flights import (
    MODELLED,
    MUST,
    OTHER,
    G,
    Record,
    Rng,
    Scene,
    abrupt,
    ball,
    filmed,
    jumper,
    matched,
    rest,
    right_count,
)  # fmt: skip

KINDS = ("", "motor", "foot", "foot motor", "sand", "sand motor")


@dataclass
class Row:
    """A bar: its measure, how many of how many, and what it must be."""

    name: str
    value: float
    sigma: float
    low: float
    high: float
    n: int
    note: str = ""

    @property
    def worst(self) -> float:
        """By how many standard errors it is outside the bar."""
        return max(self.low - self.value, self.value - self.high) / max(self.sigma, 1e-9)

    def __str__(self) -> str:
        bar = f"{self.low:g} to {self.high:g}" if self.low > -9 and self.high < 9 else (
            f"at least {self.low:g}" if self.low > -9 else f"at most {self.high:g}"
        )  # fmt: skip
        kept = "kept" if self.low <= self.value <= self.high else "within its error" if self.worst < 2 else "NOT kept"
        return f"| {self.name} | {self.value:.3f} ± {self.sigma:.3f} | {bar} | {kept} | {self.n} | {self.note} |"


def share(name: str, flags: list[bool], low: float = -10.0, high: float = 10.0, note: str = "") -> Row:
    """The share of True with its binomial error."""
    n = max(len(flags), 1)
    p = sum(flags) / n
    return Row(name, p, math.sqrt(max(p * (1.0 - p), 0.25 / n) / n), low, high, len(flags), note)


def covered(name: str, z: list[float]) -> list[Row]:
    """Share within a sigma, and bias in sigmas."""
    a = np.array([x for x in z if np.isfinite(x)])
    if not a.size:
        return []
    note = f"rms {np.sqrt(np.mean(a**2)):.2f}, median {np.median(a):+.2f}, beyond 5: {np.sum(np.abs(a) > 5)}"
    bias = Row(
        f"{name}: size of the bias in sigmas (mean of those within 5)",
        abs(float(np.mean(a[np.abs(a) < 5]))),
        1.0 / math.sqrt(a.size),
        -10,
        0.2,
        a.size,
    )
    return [share(f"{name}: within a sigma", list(np.abs(a) < 1.0), 0.64, 0.72, note), bias]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--full", action="store_true", help="400 records a bar")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--only", default="", help="parts whose name holds this")
    parser.add_argument("--each", action="store_true", help="say every record that is wrong")
    a = parser.parse_args()
    number = 400 if a.full else 60
    began = time.perf_counter()
    rows: list[Row] = []
    for k, part in enumerate(PARTS):
        if a.only in part.__name__:
            rows += part(np.random.default_rng([a.seed, k]), number, a.each)
    print("| bar | measured | must be | | of | |\n|---|---|---|---|---|---|")
    for row in sorted(rows, key=lambda r: -r.worst):
        print(row)
    print(f"\nseed {a.seed}, {number} records a bar, {time.perf_counter() - began:.0f} s")


def say(each: bool, r: Record, f: Flights) -> None:
    if each:
        true = [f"{x:.4f}-{y:.4f}" for x, y in r.scene.flights]
        got = [f"{x:.4f}-{y:.4f} {'/'.join(k)}" for x, y, k in zip(f.lift_off, f.landing, f.kinds)]
        stated = "stated" if r.sigma is not None else "not stated"
        print(
            f"  {r.scene.name}, {r.family} {r.rate:g} Hz {1e6 * r.noise:.0f} um {stated}: {true} found {got}",
            flush=True,
        )


def at_rest(rng: Rng, number: int, each: bool) -> list[Row]:
    """No flights where nothing moves."""
    rows = []
    for families in (MODELLED, OTHER):
        false = []
        for _ in range(number):
            r = filmed(rng, rest, families)
            f = r.flights()
            false.append(len(f) > 0)
            if len(f):
                say(each, r, f)
        rows.append(share(f"rest, {' or '.join(families)}: records with a flight", false, high=0.01))
    return rows


def single(rng: Rng, number: int, each: bool) -> list[Row]:
    """Jumps that begin and end abruptly."""
    rows = []
    for families in (MODELLED, OTHER):
        one, lift, lasts, height, samples = [], [], [], [], []
        for _ in range(number):
            r = filmed(rng, lambda rng: abrupt(rng, 0.002), families)
            while not r.seen(MUST)[0]:
                r = filmed(rng, lambda rng: abrupt(rng, 0.002), families)
            f = r.flights()
            one.append(len(f) == 1)
            if len(f) != 1:
                say(each, r, f)
                continue
            true = r.scene.flights[0]
            lift.append((f.lift_off[0] - true[0]) / f.lift_off_sigma[0])
            lasts.append((f.time[0] - np.diff(true)[0]) / f.time_sigma[0])
            height.append((G * f.time[0] ** 2 / 8.0 - r.scene.heights[0]) / (G * f.time[0] / 4.0 * f.time_sigma[0]))
            samples.append(abs(f.time[0] - np.diff(true)[0]) * r.rate)
            if abs(lasts[-1]) > 4:
                say(each, r, f)
        name = f"abrupt jump, {' or '.join(families)}"
        rows.append(share(f"{name}: exactly one", one, low=0.98))
        rows += [
            x
            for n, z in (("lift-off", lift), ("flight time", lasts), ("height", height))
            for x in covered(f"{name}: {n}", z)
        ]
        rows.append(
            share(
                f"{name}: flight time within half a sample",
                [s <= 0.5 for s in samples],
                low=0.99,
                note=f"median {np.median(samples):.3f}",
            )
        )
    return rows


def jumpers(rng: Rng, number: int, each: bool) -> list[Row]:
    """Spring, foot, motor; hard ground and sand."""
    rows = []
    kinds: list[dict[str, bool]] = [dict.fromkeys(names.split(), True) for names in KINDS]
    for kind in kinds:
        right, lift, lasts, name, beside = [], [], [], "", []
        for _ in range(max(number // 4, 20)):
            r = filmed(rng, lambda rng, kind=kind: jumper(rng, **kind), MODELLED)
            name = r.scene.name
            f = r.flights()
            right.append(right_count(r, f))
            if not right[-1]:
                say(each, r, f)
            must = r.seen(MUST)
            for i, k in matched(f, r.scene.flights, r.t[-1]):
                if must[k] and np.isfinite(f.time[i]):
                    true = r.scene.flights[k]
                    lift.append((f.lift_off[i] - true[0]) / f.lift_off_sigma[i])
                    lasts.append((f.time[i] - (true[1] - true[0])) / f.time_sigma[i])
            beside += contact_beside(rng, r, f)
        rows.append(share(f"{name}: right count", right, low=0.98))
        rows += [x for n, z in (("lift-off", lift), ("flight time", lasts)) for x in covered(f"{name}: {n}", z)]
        rows.append(share(f"{name}: contact log within 2 sigma of both", beside, low=0.95))
    return rows


def contact_beside(rng: Rng, r: Record, f: Flights) -> list[bool]:
    """Whether lift-off and landing agree with a contact log of 1 kHz, for flights that must be seen."""
    t = rng.uniform(0.0, 1e-3) + np.arange(0.0, r.scene.span, 1e-3)
    edges = np.where(np.isfinite(r.scene.flights), r.scene.flights, r.scene.span + 1.0)
    air = np.any((t[:, None] > edges[:, 0]) & (t[:, None] < edges[:, 1]), axis=1)
    log = contact_flights(t, (~air).astype(float), debounce=0.0)
    out, must = [], r.seen(MUST)
    for i, k in matched(f, r.scene.flights, r.t[-1]):
        near = np.flatnonzero(np.abs(log.lift_off - r.scene.flights[k, 0]) < 2e-3)
        if must[k] and near.size:
            for a, sa, b, sb in (
                (f.lift_off[i], f.lift_off_sigma[i], log.lift_off[near[0]], log.lift_off_sigma[near[0]]),
                (f.landing[i], f.landing_sigma[i], log.landing[near[0]], log.landing_sigma[near[0]]),
            ):
                if np.isfinite(a) and np.isfinite(b):
                    out.append(bool(abs(a - b) < 2.0 * math.hypot(sa, sb)))
    return out


def balls(rng: Rng, number: int, each: bool) -> list[Row]:
    """Bounces to where they drown."""
    rows = []
    for contact, families in ((0.0, MODELLED), (None, MODELLED), (0.0, OTHER)):
        right, z, lasts = [], [], []
        for _ in range(number):
            length = contact if contact is not None else float(rng.choice([1e-3, 2e-3, 3e-3]))
            r = filmed(rng, lambda rng, length=length: ball(rng, length), families)
            f = r.flights()
            right.append(right_count(r, f))
            if not right[-1]:
                say(each, r, f)
            for i, k in matched(f, r.scene.flights, r.t[-1]):
                if r.seen(MUST)[k] and np.isfinite(f.time[i]) and k:
                    lasts.append((f.time[i] - np.diff(r.scene.flights[k])[0]) / f.time_sigma[i])
            e = restitution(f.only(np.arange(len(f)) > 0), after=0.0)
            z.append((e.value - r.scene.e) / e.sigma)
        name = f"ball, contacts of {'0' if contact is not None else '1 to 3'} ms, {' or '.join(families)}"
        rows.append(share(f"{name}: right count", right, low=0.95))
        rows += covered(f"{name}: restitution", z) + covered(f"{name}: flight times", lasts)
    return rows


def scales(rng: Rng, number: int, each: bool) -> list[Row]:
    """Tracks whose scale, or rate, is wrong: said, or not said where it is right."""
    told, small, false = [], [], []
    for _ in range(number):
        for wrong in (True, False, None):
            make = [lambda rng: abrupt(rng, 0.01), ball, lambda rng: jumper(rng)][int(rng.integers(3))]
            r = filmed(rng, make, MODELLED)
            if not r.seen(MUST).any():
                continue
            off = (
                0.0
                if wrong is False
                else 0.02
                if wrong is None
                else math.exp(rng.uniform(math.log(0.03), math.log(0.3)))
            )
            factor = (1.0 + off) ** float(rng.choice([-1.0, 1.0]))
            if rng.integers(2):  # the scale; else the rate
                r = Record(
                    r.scene, r.t, r.h * factor, None if r.sigma is None else r.sigma * factor, r.noise, r.rate, r.family
                )
                change = factor
            else:
                s = factor**-0.5
                moved = Scene(**{**r.scene.__dict__, "flights": r.scene.flights * s})
                r = Record(moved, r.t * s, r.h, r.sigma, r.noise, r.rate / s, r.family)
                change = factor
            f = r.flights()
            said = bool(f.doubts)
            best = max(np.diff(r.scene.flights, axis=1)[r.seen(MUST), 0], default=0.0)
            eff = r.noise * (math.sqrt(1.7 / 0.3) if r.family == "AR .7" else 1.0)
            known = eff * math.sqrt(720.0 / max(best * r.rate, 4.0)) / max(best, 1e-9) ** 2
            if wrong is True:
                if abs(change - 1.0) * r.scene.gravity > 6.0 * known:
                    told.append(said)
                    if not said:
                        say(each, r, f)
            elif wrong is False:
                false.append(said)
                if said:
                    say(each, r, f)
            else:
                for i, k in matched(f, r.scene.flights, r.t[-1]):
                    if r.seen(MUST)[k] and np.isfinite(f.time[i]):
                        off = abs(f.time[i] - np.diff(r.scene.flights[k])[0])
                        small.append(said or bool(off < 2.0 * f.time_sigma[i]))
    return [
        share("scale or rate off by 3-30 %, its curvature known to a sixth of that: told", told, low=0.95),
        share("scale and rate right: told all the same", false, high=0.02),
        share("scale or rate off by 2 %: told, or flight times within 2 sigma", small, low=0.95),
    ]


PARTS = (at_rest, single, balls, jumpers, scales)


if __name__ == "__main__":
    main()
