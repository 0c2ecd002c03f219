"""How often the stated sigma of displacement vectors covers their true errors: a markdown table on standard output.

    python -m benchmarks.piv_sigma          # seeds 201 to 203
    python -m benchmarks.piv_sigma 7 8      # others

Drawn grains of 6-8 px (5-13 px in eddies) and particles of 3 px, 256 x 328 px, window 24 px, vectors every 8 px, all
vectors up to the edge of the picture. Share of errors within one and two sigma, 68 and 95 % where it is true; u and v,
all seeds together. Errors of smoothed vectors are alike over many vectors: of a field moved as a whole a picture
holds some tens of independent ones, so such a row is sure to 3-5 %.
"""

from __future__ import annotations

import sys
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from benchmarks.piv import Array, Truth
from jumpvision.films.vision.piv.engine import piv_pair
from jumpvision.films.vision.piv.pair import MEASURED
from tests.worlds.grain_pictures import FIELDS, SETTINGS, camera, grains, spots

SHAPE = (256, 328)
NOISES = (0, 2, 6)
Pair = list[NDArray[np.float64]]


def waves(length: float, size: float) -> Truth:
    k = 2 * np.pi / length
    return lambda x, y: (size * np.sin(k * y + 0.5) * np.cos(k * x), size * np.cos(k * y) * np.sin(k * x + 1))


def plunge(x: Array, y: Array) -> tuple[Array, Array]:
    """Grains that a foot 160 px wide pushes down and aside, less the deeper."""
    across, down = (x - 164.0) / 110.0, (y - 60.0) / 80.0
    share = np.exp(-0.5 * across**2 - 0.8 * np.maximum(down, 0)) / (1 + np.exp(-(down + 0.5) / 0.25))
    return 1.8 * across * share, 3.0 * share


def turbulence(seed: int, slope: float) -> Truth:
    """Forty waves of 12 to 300 px, 1.5 px in all; energy over a wave number falls with the power `slope` of it."""
    rng = np.random.default_rng(seed)
    length = np.geomspace(12, 300, 40)
    k, angle, phase = 2 * np.pi / length, rng.uniform(0, 2 * np.pi, 40), rng.uniform(0, 6.3, 40)
    size = length ** ((slope - 1) / 2)  # of equal steps in log k
    size *= 1.5 * np.sqrt(2 / np.sum(size**2))

    def motion(x: Array, y: Array) -> tuple[Array, Array]:
        wave = size * np.cos(np.multiply.outer(x, k * np.cos(angle)) + np.multiply.outer(y, k * np.sin(angle)) + phase)
        return (-np.sin(angle) * wave).sum(-1), (np.cos(angle) * wave).sum(-1)

    return motion


def of_grains(radius: tuple[float, float] = (3.0, 4.0)) -> Callable[[Truth, int], Pair]:
    return lambda truth, seed: grains(SHAPE, truth, np.random.default_rng(seed), radius=radius, sub=3)


def particles(truth: Truth, seed: int) -> Pair:
    rng = np.random.default_rng(seed)
    n = int(0.03 * (SHAPE[0] + 40) * (SHAPE[1] + 40))
    x, y, grey = rng.uniform(-20, SHAPE[1] + 20, n), rng.uniform(-20, SHAPE[0] + 20, n), rng.uniform(60, 160, n)
    u, v = truth(x, y)
    return [spots(SHAPE, x + s * u / 2, y + s * v / 2, grey, 3) for s in (-1, 1)]


def families(seed: int) -> dict[str, tuple[Truth, Callable[[Truth, int], Pair]]]:
    u, v = np.random.default_rng(seed).uniform(0, 3, 2)
    sheared: Truth = lambda x, y: (0.006 * (y - 100) + u, 0.4 + 0 * y)  # noqa: E731
    small, any_size = of_grains(), of_grains((2.5, 6.5))
    return {
        "moved as a whole": (lambda x, y: (u + 0 * x, v + 0 * x), small),
        "sheared": (sheared, small),
        "waves of 260 px, 2.8 px": (waves(260, 2.8), small),
        "waves of 100 px, 1.5 px": (waves(100, 1.5), small),
        "eddies of 95 px, 2 px": (FIELDS["vortex"], any_size),
        "a foot that plunges": (plunge, small),
        "band of 20 px, 3 px": (lambda x, y: (1.5 * np.tanh((y - 0.2 * x - 87) / 10), 0.4 + 0 * x), small),
        "3 px particles, sheared": (sheared, particles),
        "turbulence, slope 3": (turbulence(seed, 3.0), particles),
        "turbulence, slope 5/3": (turbulence(seed, 5 / 3), particles),
    }


def covered(truth: Truth, pictures: Pair, noise: float, seed: int) -> tuple[Array, Array, float]:
    """|error| over sigma of unsmoothed and smoothed vectors, and these errors' mean square [px^2]."""
    rng = np.random.default_rng(seed)
    f = piv_pair(*(camera(i, noise, rng) for i in pictures), **SETTINGS)
    true = np.stack(truth(*np.meshgrid(f.x, f.y)))
    good = np.isin(f.reason, MEASURED)
    drawn = np.stack([f.u, f.v]) - true
    z = [np.abs(e / s)[:, good] for e, s in ((f.matched[:2] - true, f.matched[2:]), (drawn, [f.u_sigma, f.v_sigma]))]
    return z[0].ravel(), z[1].ravel(), float(np.mean(drawn[:, good] ** 2))


def main() -> None:
    seeds = [int(q) for q in sys.argv[1:]] or [201, 202, 203]
    print("Within 1 sigma (2 sigma), %: unsmoothed vectors; smoothed; rms error of these [px].\n")
    print(f"| field | {' | '.join(f'noise {n}: matched | drawn | rms' for n in NOISES)} |")
    print("|---" * (1 + 3 * len(NOISES)) + "|")
    pictures = {}
    for seed in seeds:
        for name, (truth, draw) in families(seed).items():
            pictures.setdefault(name, []).append((seed, truth, draw(truth, seed)))
    for name, several in pictures.items():
        cells = []
        for noise in NOISES:
            matched, drawn, square = zip(*(covered(t, p, noise, 1000 * k + noise) for k, t, p in several))
            for z in (np.concatenate(matched), np.concatenate(drawn)):
                cells.append(f"{np.mean(z < 1):.0%} ({np.mean(z < 2):.0%})".replace("%", ""))
            cells.append(f"{np.sqrt(np.mean(square)):.4f}")
        print(f"| {name} | {' | '.join(cells)} |", flush=True)


if __name__ == "__main__":
    main()
