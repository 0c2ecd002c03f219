"""Time of a vector beside OpenPIV on the same images in the same run, and the errors of both: a markdown table.

    python -m benchmarks.piv_speed          # five drawn fields of 1280 x 1024 px and their middles, OpenPIV's own pair
    JUMPVISION_REAL_DATA=folder ...         # also pivlab_karman/: a street of eddies and a jet

Grains of 7 px, noise 2: moved as a whole, sheared, in waves of 2.8 px, under a foot that plunges, with a shear band.
Least of three turns, the methods one after the other in each; processor time with one thread each, and wall time with
all cores (OpenPIV has one thread). The rows with the least ratio come first. Drawing takes some minutes.
"""

from __future__ import annotations

import contextlib
import math
import os
import platform
import time
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np

from benchmarks.piv import Array, Truth, against, fast, left_over, openpiv, ours, untold
from jumpvision.base.threads import at_most
from tests.worlds.grain_pictures import camera, grains

SHAPE, SMALL = (1024, 1280), ((256, 320), (128, 160), (80, 96))  # px; the smaller are middles of the first
TURNS = 3


def waves(x: Array, y: Array) -> tuple[Array, Array]:
    k = 2 * np.pi / 260
    return 2.8 * np.sin(k * y + 0.5) * np.cos(k * x), 2.8 * np.cos(k * y) * np.sin(k * x + 1)


def plunge(x: Array, y: Array) -> tuple[Array, Array]:
    """Grains that a foot 320 px wide pushes down and aside, less the deeper."""
    across, down = (x - 640.0) / 220.0, (y - 250.0) / 200.0
    share = np.exp(-0.5 * across**2 - 0.8 * np.maximum(down, 0)) / (1 + np.exp(-(down + 0.5) / 0.25))
    return 1.8 * across * share, 3.0 * share


FIELDS: dict[str, Truth] = {
    "uniform": lambda x, y: (3.37 + 0 * x, -2.21 + 0 * x),
    "shear": lambda x, y: (0.006 * (y - 512), 0.4 + 0 * y),
    "waves of 260 px": waves,
    "plunge": plunge,
    "band": lambda x, y: (1.5 * np.tanh((y - 0.2 * x - 380) / 10), 0.4 + 0 * x),
}


def cases(data: Path | None) -> Iterator[tuple[str, Array, Array, Truth | None]]:
    for name, truth in FIELDS.items():
        pair = grains(SHAPE, truth, np.random.default_rng(7), radius=(3.0, 4.0), sub=3)
        rng = np.random.default_rng(3)
        a, b = (camera(i, 2, rng) for i in pair)
        yield f"{name}, {SHAPE[1]} x {SHAPE[0]}", a, b, truth
        for height, width in SMALL:
            top, left = (SHAPE[0] - height) // 2, (SHAPE[1] - width) // 2
            cut = np.s_[top : top + height, left : left + width]
            yield (
                f"{name}, {width} x {height}",
                a[cut].copy(),
                b[cut].copy(),
                lambda x, y, t=truth, x0=left, y0=top: t(x + x0, y + y0),
            )
    for name, a, b in untold(data):
        yield f"{name}, {a.shape[1]} x {a.shape[0]}", a, b, None


@contextlib.contextmanager
def threads(number: int) -> Iterator[None]:
    cv2.setNumThreads(number)
    with at_most(number):
        yield


def main() -> None:
    data = Path(os.environ["JUMPVISION_REAL_DATA"]) if "JUMPVISION_REAL_DATA" in os.environ else None
    cores = os.cpu_count() or 1
    rows = []
    for name, a, b, truth in cases(data):
        least = {(m, n): math.inf for m in (openpiv, ours, fast) for n in (1, cores)}
        errors = {}
        for _ in range(TURNS):
            for (method, number), best in least.items():
                if method is openpiv and number > 1:
                    continue
                with threads(number):
                    clock = time.process_time if number == 1 else time.perf_counter
                    wall, begin = time.perf_counter(), clock()
                    field = method(a, b)
                    least[method, number] = min(best, (clock() - begin) / field[2].size)
                    if method is openpiv:
                        wall = (time.perf_counter() - wall) / field[2].size
                        least[method, cores] = min(least[method, cores], wall)
                errors[method] = left_over(field, a, b) if truth is None else against(field, a.shape, truth)
        ratios = [least[openpiv, n] / least[m, n] for m in (fast, ours) for n in (1, cores)]
        rows.append((min(ratios), name, 1e6 * least[openpiv, 1], ratios, [errors[m] for m in (openpiv, fast, ours)]))
        print(f"# {name}: {', '.join(f'{r:.1f}' for r in ratios)}", flush=True)
    print(f"\nProcessor: {processor()}, {cores} cores; load {os.getloadavg()[0]:.1f} at the end.\n")
    print(
        "| pictures | OpenPIV [us a vector] | its time / `fast`, one thread | all cores | / default, one thread | "
        "all cores | error [px]: OpenPIV, `fast`, default | default / OpenPIV |"
    )
    print("|---" * 8 + "|")
    for _, name, its, ratios, (theirs, quick, usual) in sorted(rows, key=lambda r: r[0]):
        of = ", ".join(f"{e:.4f}" if theirs < 5 else f"{e:.1f} grey" for e in (theirs, quick, usual))
        print(f"| {name} | {its:.0f} | {' | '.join(f'{r:.1f}' for r in ratios)} | {of} | {usual / theirs:.2f} |")


def processor() -> str:
    with contextlib.suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text().splitlines():
            if line.startswith("model name"):
                return line.split(":")[1].strip()
    return platform.processor() or platform.machine()


if __name__ == "__main__":
    main()
