"""Displacement fields beside OpenPIV on the same images in the same run: a markdown table on standard output.

    python -m benchmarks.piv            # drawn grains and particles, and the image pair that ships with OpenPIV
    JUMPVISION_REAL_DATA=folder ...     # also opencorr_patterns/ (known deformation) and pivlab_karman/ (real flow)

OpenPIV 64-32-16-16 px windows, ours 24 px; vectors every 8 px. "unsmoothed" is smooth = "none" of [params.piv], "fast"
its preset. Errors are mean end-point errors [px] over all vectors at least 32 px inside the image, replaced ones
included, each method judged at its own places. Without truth the number is the RMS grey difference left over when the
field has brought both frames together. (The sum of forward and backward displacement judges nothing here: both methods
treat the frames alike, so it is zero.) A second table, beside the image correlation of pyvale where that is installed,
gives every method its best setting too, chosen by the truth; a third one is of narrow shear bands, a fourth of the
response to waves and to a step. Speed: `benchmarks.piv_speed`.
"""

from __future__ import annotations

import contextlib
import importlib.resources
import importlib.util
import io
import itertools
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import RegularGridInterpolator

from jumpvision.films.vision.piv.engine import piv_pair
from tests.worlds.grain_pictures import FIELDS, SETTINGS, camera, grains, spots

Array = NDArray[np.float64]
Field = tuple[Array, Array, Array, Array]  # x (nx,), y (ny,), u, v (ny, nx); mid-time, y down
Truth = Callable[[Array, Array], tuple[Array, Array]]

BORDER = 32


def ours(a: Array, b: Array) -> Field:
    f = piv_pair(a, b, **SETTINGS)
    return f.x, f.y, f.u, f.v


def unsmoothed(a: Array, b: Array) -> Field:
    f = piv_pair(a, b, **SETTINGS, smooth="none")
    return f.x, f.y, f.u, f.v


def fast(a: Array, b: Array) -> Field:
    f = piv_pair(a, b, **SETTINGS, preset="fast")
    return f.x, f.y, f.u, f.v


def openpiv(a: Array, b: Array) -> Field:
    from openpiv import windef
    from openpiv.settings import PIVSettings

    s = PIVSettings()
    windows = tuple(w for w in (64, 32, 16, 16) if 4 * w <= min(a.shape))  # its splines need four vectors a side
    s.windowsizes, s.overlap, s.num_iterations = windows, tuple(w // 2 for w in windows), len(windows)
    with contextlib.redirect_stdout(io.StringIO()):
        x, y, u, v, _ = windef.simple_multipass(a.astype(np.int32), b.astype(np.int32), s)
    # its rows run up; its places as they are give it the smallest errors on drawn shear, rotation and vortex
    rows = y[::-1, 0] if y[0, 0] > y[-1, 0] else y[:, 0]
    return x[0], rows, np.asarray(u), -np.asarray(v)


Points = tuple[Array, Array, Array, Array]  # x, y, u, v, all (n,); mid-time, y down


def pyvale(a: Array, b: Array, size: int = 21, shape: str = "AFFINE", kernel: int = 5) -> Points:
    """Subsets of size px every 8 px; kernel = 1: without its Gaussian of 1 px. The other settings are its own."""
    from pyvale import dic

    with tempfile.TemporaryDirectory() as folder:
        dic.calculate_2d(
            a, b, np.ones(a.shape, np.uint8), [a.shape[1] // 2, a.shape[0] // 2], size, 8, shape_function=shape,
            image_filter_kernel=kernel, precision=1e-4, threshold=0.5, output_below_threshold=True,
            output_basepath=folder, print_level=0,
        )  # fmt: skip
        found = dic.import_2d(str(next(Path(folder).iterdir())), ",", layout="column", print_level=0)
    x, y, u, v = (np.asarray(q, float).ravel() for q in (found.ss_x, found.ss_y, found.u_px, found.v_px))
    return x + u / 2, y + v / 2, u, v  # its subsets sit in the first frame


def inside(field: Field, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    x, y = np.meshgrid(field[0], field[1])
    return (x >= BORDER) & (y >= BORDER) & (x < shape[1] - BORDER) & (y < shape[0] - BORDER)


def against(field: Field, shape: tuple[int, ...], truth: Truth) -> float:
    u, v = truth(*np.meshgrid(field[0], field[1]))
    return float(np.nanmean(np.hypot(field[2] - u, field[3] - v)[inside(field, shape)]))


def left_over(field: Field, a: Array, b: Array) -> float:
    """RMS grey difference of the frames once each is moved half-way by the field (Lanczos, neither method's own)."""
    rows, columns = np.mgrid[BORDER : a.shape[0] - BORDER, BORDER : a.shape[1] - BORDER].astype(np.float64)
    u, v = (
        RegularGridInterpolator((field[1], field[0]), np.nan_to_num(f), method="cubic")((rows, columns))
        for f in field[2:]
    )
    first, second = (
        cv2.remap(
            i.astype(np.float32),
            (columns + side * u / 2).astype(np.float32),
            (rows + side * v / 2).astype(np.float32),
            cv2.INTER_LANCZOS4,
        )
        for i, side in ((a, -1), (b, 1))
    )
    return float(np.sqrt(np.mean((first - second) ** 2)))


def at_mid_time(truth: Truth) -> Truth:
    """The same motion, named by the place half-way instead of the place in the first frame."""

    def half_way(x: Array, y: Array) -> tuple[Array, Array]:
        x0, y0 = x, y
        for _ in range(50):
            u, v = truth(x0, y0)
            x0, y0 = x - u / 2, y - v / 2
        return truth(x0, y0)

    return half_way


def drawn() -> Iterator[tuple[str, Array, Array, Truth]]:
    shape = (256, 328)
    for name, displacement in FIELDS.items():
        pair = grains(shape, displacement, np.random.default_rng(11))
        for noise in (2, 6):
            rng = np.random.default_rng(12)
            yield f"grains, {name}, noise {noise}", *(camera(i, noise, rng) for i in pair), displacement
    rng = np.random.default_rng(13)
    n = 3500
    x, y, grey = rng.uniform(-20, 350, n), rng.uniform(-20, 276, n), rng.uniform(60, 160, n)
    for d in (0.25, 0.5, 0.75):
        pair = [spots(shape, x + s * d / 2, y, grey, 3) for s in (-1, 1)]
        a, b = (camera(i, 0, rng) for i in pair)
        yield f"3 px particles moved by {d} px", a, b, lambda x, y, d=d: (d + 0 * x, 0 * x)


def speckle(folder: Path) -> Iterator[tuple[str, Array, Array, Truth]]:
    """OpenCorr patterns; the deformations as fitted in the data's SOURCE.txt, 0-based pixels."""
    motions: dict[str, Truth] = {
        "Shear": lambda x, y: (0.01 * (y - 250), 0.01 * (x - 250)),
        "Tension": lambda x, y: (5 + 0.02 * (x - 250), -0.01 * (y - 250)),
    }
    for k in (1, 3, 5, 10):
        a = cv2.imread(str(folder / f"Pattern_{k}.bmp"), cv2.IMREAD_GRAYSCALE)
        for name, truth in motions.items():
            b = cv2.imread(str(folder / f"Pattern_{k}_{name}.bmp"), cv2.IMREAD_GRAYSCALE)
            yield f"speckle {k}, {name.lower()}", a, b, at_mid_time(truth)


def untold(data: Path | None) -> Iterator[tuple[str, Array, Array]]:
    shipped = Path(str(importlib.resources.files("openpiv"))) / "data" / "test1"
    pairs = [("OpenPIV's test pair", shipped / "exp1_001_a.bmp", shipped / "exp1_001_b.bmp")]
    if data is not None and (data / "pivlab_karman").is_dir():
        k = data / "pivlab_karman"
        pairs += [("PIVlab Karman street", k / "PIVlab_Karman_01.bmp", k / "PIVlab_Karman_02.bmp")]
        pairs += [("PIVlab jet", k / "Jet_0001A.jpg", k / "Jet_0001B.jpg")]
    for name, a, b in pairs:
        yield name, *(cv2.imread(str(f), cv2.IMREAD_GRAYSCALE) for f in (a, b))


def main() -> None:
    data = Path(os.environ["JUMPVISION_REAL_DATA"]) if "JUMPVISION_REAL_DATA" in os.environ else None
    cases = list(drawn())
    if data is not None and (data / "opencorr_patterns").is_dir():
        cases += speckle(data / "opencorr_patterns")
    methods = (openpiv, ours, unsmoothed, fast)
    for method in methods:  # compiles
        method(*cases[0][1:3])
    names = "jumpvision", "unsmoothed", "fast"
    print(f"| images | OpenPIV error | {' | '.join(names)} | {' | '.join(n + ' / OpenPIV' for n in names)} |")
    print("|---" * 8 + "|")

    def row(name: str, judge: Callable[[Callable[[Array, Array], Field]], float]) -> None:
        errors = [judge(method) for method in methods]
        ratios = (f"{e / errors[0]:.2f}" for e in errors[1:])
        print(f"| {name} | {' | '.join(f'{e:.4f}' for e in errors)} | {' | '.join(ratios)} |", flush=True)

    for name, a, b, truth in cases:
        row(name, lambda method, a=a, b=b, truth=truth: against(method(a, b), a.shape, truth))
    for name, a, b in untold(data):
        row(f"{name} (grey levels left over)", lambda method, a=a, b=b: left_over(method(a, b), a, b))
    correlation()
    bands()
    responses()


def smooth_field(wave: float) -> Truth:
    """Up to 4 px, of so many px a wave."""
    k = 2 * np.pi / wave
    return lambda x, y: (4 * np.sin(k * y + 0.5) * np.cos(k * x), 3 * np.cos(k * y) * np.sin(k * x + 1))


def correlation() -> None:
    """Beside pyvale: with one setting for all pictures, and with each method's best one, which the truth chooses."""
    if importlib.util.find_spec("pyvale") is None:
        print("\nBeside pyvale: left out, it is not installed (it needs an environment of its own).")
        return
    shape = (256, 328)
    fields = {name: (FIELDS[name], (2.5, 6.5)) for name in ("uniform", "shear", "vortex")}
    fields |= {f"7 px, smooth to 4 px, waves of {n} px": (smooth_field(n), (3.0, 4.0)) for n in (200, 300)}
    theirs = list(itertools.product((15, 21, 31, 41, 51), ("AFFINE", "QUAD"), (5, 1)))
    own = list(itertools.product((16, 24, 32, 40, 48), ("none", "adaptive")))
    print(
        "\nBeside pyvale, grains, noise 2; pyvale: subsets of 21 px, affine, its Gaussian; best: least by the truth of"
    )
    print(f"{len(theirs)} (pyvale: subset, shape, Gaussian) and {len(own)} settings (jumpvision: window, smoothing).\n")
    print("| images | pyvale | best pyvale | jumpvision | unsmoothed | best jumpvision | ratio | ratio of the best |")
    print("|---" * 8 + "|")
    for name, (truth, radius) in fields.items():
        rng = np.random.default_rng(18)
        a, b = (camera(i, 2, rng) for i in grains(shape, truth, np.random.default_rng(17), radius=radius))

        def error(points: Points, shape: tuple[int, int] = shape, truth: Truth = truth) -> float:
            x, y, u, v = points
            within = (x >= BORDER) & (y >= BORDER) & (x < shape[1] - BORDER) & (y < shape[0] - BORDER)
            tu, tv = truth(x, y)
            return float(np.nanmean(np.hypot(u - tu, v - tv)[within]))

        def matched(window: int, smooth: str, a: Array = a, b: Array = b) -> Points:
            f = piv_pair(a, b, **(SETTINGS | {"window": window, "smooth": smooth}))
            x, y = np.meshgrid(f.x, f.y)
            return x.ravel(), y.ravel(), f.u.ravel(), f.v.ravel()

        of_pyvale = {s: error(pyvale(a, b, *s)) for s in theirs}
        of_ours = {s: error(matched(*s)) for s in own}
        best, ours_best = (min(q, key=q.__getitem__) for q in (of_pyvale, of_ours))
        plain, usual = of_pyvale[21, "AFFINE", 5], of_ours[24, "adaptive"]
        gaussian = "" if best[2] > 1 else ", no Gaussian"
        print(
            f"| {name} | {plain:.4f} | {of_pyvale[best]:.4f} ({best[0]} px {best[1].lower()}{gaussian}) | "
            f"{usual:.4f} | {of_ours[24, 'none']:.4f} | "
            f"{of_ours[ours_best]:.4f} ({ours_best[0]} px, {ours_best[1]}) | "
            f"{usual / plain:.2f} | {of_ours[ours_best] / of_pyvale[best]:.2f} |", flush=True,
        )  # fmt: skip


def bands() -> None:
    """Two blocks 3 px apart in motion, a band of 3 px between them, noise 2: where u passes through zero, by column."""
    print(
        "\nShear band 3 px wide between blocks that differ by 3 px in motion, noise 2, four bands; far: more than 1.5"
    )
    print("steps from it. Place of the jump: where u passes through the mean of both blocks in a column of vectors.\n")
    print(
        "| method | place of the jump off by [px]: rms, greatest | columns within 2 px | mean of a band's columns off, "
        "greatest [px] | far: wrong by > 0.1 px | greatest far error [px] |"
    )
    print("|---" * 6 + "|")
    pairs = []
    for k, middle in enumerate((124.0, 126.6, 128.0, 130.7)):

        def motion(x: Array, y: Array, m: float = middle) -> tuple[Array, Array]:
            return 1.5 * np.clip((y - m) / 1.5, -1, 1), 0.4 + 0 * x

        rng = np.random.default_rng(k)
        frames = grains((256, 232), motion, np.random.default_rng(30 + k))
        pairs.append((middle, [camera(i, 2, rng) for i in frames]))
    for method in (openpiv, ours, unsmoothed, fast):
        off, far = [], []
        for middle, (a, b) in pairs:
            x, y, u, v = method(a, b)
            after = np.argmax(u > 0, axis=0)
            columns = np.arange(len(x))
            u0, u1 = u[after - 1, columns], u[after, columns]
            off.append(y[after - 1] - u0 / (u1 - u0) * (y[after] - y[after - 1]) - middle)
            truth = 1.5 * np.clip((y - middle) / 1.5, -1, 1)[:, None]
            far.append(
                np.hypot(u - truth, v - 0.4)[(np.abs(y - middle) > 12) & (np.abs(y - 128) < 128 - BORDER)].ravel()
            )
        o, e = np.concatenate(off), np.concatenate(far)
        print(
            f"| {method.__name__} | {np.sqrt(np.mean(o**2)):.2f}, {np.abs(o).max():.2f} | "
            f"{np.mean(np.abs(o) < 2):.0%} | {max(abs(q.mean()) for q in off):.2f} | {np.mean(e > 0.1):.1%} | "
            f"{e.max():.2f} |", flush=True,
        )  # fmt: skip


WAVES = (20, 30, 40, 60, 90, 130)  # px


def responses() -> None:
    """What is left of waves of 1 px, and how wide a step of 2 px becomes."""
    print("\nWaves of 1 px along y: the share that the vectors hold; a step of 2 px: rows from 10 to 90 % of it.")
    print("Grains of 7 px, noise 2, a vector every 4 px.\n")
    print(f"| setting | {' | '.join(f'{p} px' for p in WAVES)} | step, rows |")
    print("|---" * (len(WAVES) + 2) + "|")
    shape, at = (256, 200), 128.0

    def pair(motion: Truth) -> tuple[Array, Array]:
        rng = np.random.default_rng(21)
        a, b = (camera(i, 2, rng) for i in grains(shape, motion, np.random.default_rng(22), radius=(3.0, 4.0)))
        return a, b

    waves = [(p, pair(lambda x, y, p=p: (np.sin(2 * np.pi * y / p), 0 * x))) for p in WAVES]
    step = pair(lambda x, y: (np.tanh((y - at) / 0.5), 0.4 + 0 * x))
    for window, preset, smooth in (
        (24, "default", "none"),
        (24, "default", "adaptive"),
        (24, "fast", "adaptive"),
        (24, "sharp", "adaptive"),
        (40, "sharp", "none"),
    ):
        settings = SETTINGS | {"window": window, "step": 4, "preset": preset, "smooth": smooth}
        held = []
        for p, (a, b) in waves:
            f = piv_pair(a, b, **settings)
            wave = np.sin(2 * np.pi * f.y / p)
            held.append(float(np.nanmean(f.u * wave[:, None]) / np.mean(wave**2)))
        f = piv_pair(*step, **settings)
        profile = np.nanmedian(f.u, axis=1)
        near = np.abs(f.y - at) < 40
        low, high = (np.interp(q, profile[near], f.y[near]) for q in (-0.8, 0.8))
        print(
            f"| {window} px, {preset}, {smooth} | {' | '.join(f'{h:.2f}' for h in held)} | {high - low:.1f} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
