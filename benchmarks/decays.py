"""Decay laws on drawn records, two repeats each: is the law named right, do the sigmas cover, do repeats agree?

    python -m benchmarks.decays [--records 200] [--seed 0] [--each]

A record: one law or two of viscous, quadratic and Coulomb friction, 10 to 60 swings, a spring that may stiffen, noise
of 0.05 to 0.5 % of the swing from one of five families, samples every 1/20 to 1/60 of a period; every fiftieth has 10^5
samples. Its repeat has a start, a phase and noise of its own. Truth by the classical Runge-Kutta steps on
the whole equation, of 1/50 rad, with friction's sign bisected at every reversal.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable

import numpy as np
from numba import njit
from scipy.signal import lfilter

from jumpvision.estimate.decay import LAWS, SETS, decay_law

Noise = Callable[[np.random.Generator, int], np.ndarray]


def _coloured(rng: np.random.Generator, n: int) -> np.ndarray:
    return lfilter([0.8], [1.0, -0.6], rng.normal(size=n + 100))[100:]


def _wandering(rng: np.random.Generator, n: int) -> np.ndarray:
    return rng.normal(size=n) + np.cumsum(rng.normal(size=n)) * 2.0 / math.sqrt(n)


NOISES: dict[str, Noise] = {
    "white": lambda rng, n: rng.normal(size=n),
    "heavy tails": lambda rng, n: rng.standard_t(4, n) / math.sqrt(2.0),
    "AR(1) 0.6": _coloured,
    "drift": _wandering,
    "uniform": lambda rng, n: rng.uniform(-1.0, 1.0, n) * math.sqrt(3.0),
}


@njit(cache=True)
def _half(
    y: float, v: float, h: float, w2: float, kappa: float, gamma: float, beta: float, dry: float
) -> tuple[float, float]:
    """One step of the classical fourth order on the whole equation, friction of one sign."""
    k = np.empty((4, 2))
    yy, vv = y, v
    for i in range(4):
        k[i, 0], k[i, 1] = vv, -w2 * (yy + kappa * yy**3) - 2.0 * gamma * vv - beta * abs(vv) * vv - dry
        f = h if i == 2 else 0.5 * h
        yy, vv = y + f * k[i, 0], v + f * k[i, 1]
    rise = (k[0] + 2.0 * k[1] + 2.0 * k[2] + k[3]) * h / 6.0
    return y + rise[0], v + rise[1]


@njit(cache=True)
def motion(t: np.ndarray, y: float, w: float, kappa: float, gamma: float, beta: float, dry: float) -> np.ndarray:
    """y at t of a body let go at rest from y at 0: steps of 1/50 rad, twenty times finer than the analysis takes."""
    out, at, v = np.empty(t.size), 0.0, 0.0
    side = -1.0 if y > 0 else 1.0
    for i in range(t.size):
        while at < t[i]:
            if v == 0.0 and abs(w * w * (y + kappa * y**3)) <= dry:
                break
            h = min(0.02 / w, t[i] - at)
            y1, v1 = _half(y, v, h, w * w, kappa, gamma, beta, dry * side)
            turns = v1 * side < 0.0
            if turns:
                low, high = 0.0, h
                for _ in range(50):
                    h = 0.5 * (low + high)
                    y1, v1 = _half(y, v, h, w * w, kappa, gamma, beta, dry * side)
                    low, high = (h, high) if v1 * side >= 0.0 else (low, h)
                v1, side = 0.0, -side
            y, v, at = y1, v1, at + h
        out[i] = y
    return out


def drawn(rng: np.random.Generator, number: int) -> tuple[tuple[str, ...], dict[str, float], list[tuple]]:
    """(laws, rates, two records (t, x, sigma))."""
    laws = SETS[number % 6]  # three alone, three pairs
    family = list(NOISES)[(number // 6) % 5]
    w, swings = 2.0 * math.pi * rng.uniform(0.5, 12.0), rng.uniform(10.0, 60.0)
    size, span = 10.0 ** rng.uniform(-3.0, 0.0), swings * 2.0 * math.pi / w
    loss = rng.uniform(1.0, 2.5) / span  # of the amplitude, alone
    share = rng.uniform(0.3, 0.7)
    parts = dict.fromkeys(LAWS, 0.0) | dict(zip(laws, (share, 1.0 - share) if len(laws) == 2 else (1.0,), strict=True))
    rates = {
        "viscous": loss * parts["viscous"],
        "quadratic": parts["quadratic"] * loss * 3.0 * math.pi / (4.0 * w * 0.6 * size),
        "coulomb": parts["coulomb"] * 0.5 * math.pi * loss * w * 0.5 * size,
    }
    kappa = rng.choice([0.0, 0.02]) / size**2
    level = size * 10.0 ** rng.uniform(-3.3, -2.3)
    records = []
    for _ in range(2):
        n = 100_000 if number % 50 == 7 else int(swings * rng.uniform(20.0, 60.0))
        start = size * rng.uniform(0.8, 1.0) * rng.choice([-1.0, 1.0])
        lead = rng.uniform(0.0, 1.0) / w  # the record begins within the first swing
        t = lead + np.linspace(0.0, span, n)
        x = motion(t, start, w, kappa, *(rates[k] for k in LAWS))
        moving = np.abs(x) > 0.03 * size
        n = int(np.flatnonzero(moving)[-1]) + 1  # as `swings_until` ends a record
        noise = level * NOISES[family](rng, n)
        records.append((t[:n], 0.3 * size + x[:n] + noise, np.full(n, level)))
    return laws, rates, records


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=200)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--each", action="store_true", help="a row a record, worst first")
    a = parser.parse_args()
    rows, pulls, apart = [], [], []
    named = {"right": 0, "undetermined": 0, "mixed": 0, "wrong": 0}
    for number in range(a.records):
        rng = np.random.default_rng([a.seed, number])
        laws, rates, records = drawn(rng, number)
        truth, found, worst, took = " + ".join(laws), [], 0.0, time.perf_counter()
        for t, x, sigma in records:
            d = decay_law(t, x, sigma, rng=np.random.default_rng(0))
            found.append(d)
            verdict = "right" if d.law == truth else d.law if d.law in named else "wrong"
            named[verdict] += 1
            mine = [(d.rate[k].value - rates[k]) / d.rate[k].sigma for k in laws if d.rate[k].sigma > 0]
            pulls += mine
            worst = max([worst, *map(abs, mine)]) + (100.0 if verdict == "wrong" else 10.0 * (verdict != "right"))
        for k in laws:
            one, two = (d.rate[k] for d in found)
            apart.append((one.value - two.value) / math.hypot(one.sigma, two.sigma))
        family = list(NOISES)[(number // 6) % 5]
        text = f"{number:4d} {truth:22s} {family:12s} n {records[0][0].size:6d}  {', '.join(d.law for d in found):45s} "
        rows.append((worst, text + f"{worst:6.1f} {time.perf_counter() - took:6.2f} s"))
    if a.each:
        for _, text in sorted(rows, reverse=True):
            print(text)
    n = sum(named.values())
    print("| what | of", n, "records |\n|---|---|")
    for k, v in named.items():
        print(f"| {k} | {v / n:.3f} ± {math.sqrt(max(v * (n - v), 1) / n**3):.3f} |")
    for what, z in (("rates within a sigma", pulls), ("repeats within a sigma", apart)):
        share = float(np.mean(np.abs(z) < 1.0))
        print(f"| {what} | {share:.3f} ± {math.sqrt(share * (1 - share) / len(z)):.3f}, rms {np.std(z):.2f} |")


if __name__ == "__main__":
    main()
