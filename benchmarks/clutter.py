"""Tracks in clutter, by a second drawing: rows found, and rows that are silently false.

    python -m benchmarks.clutter [--clips 300] [--seed 0] [--click] [--family toss] [--each]
    python -m benchmarks.clutter --longer [--clips 40] [--seed 0]

Families: `toss` (a ball before chalk, studs, glints, a shadow, a hand that lets go), `alike` (two alike balls, tossed),
`toy` (a spinning thing of three tones before chalk, brick and a floor), `wrong` (a dark ball, called bright), `nine`
(nine discs of one size in a box, one clicked), `fast` (12 px, 3 to 7 diameters a frame, clicked), `pendulum` (a ball of
two tones), `swing` (a pendulum's plain ball), `rod` (a ball that rests, hops and rests again). Edges are drawn by the
normal distribution of the distance to them: no sub-pixels, as `benchmarks.clips` has, and nothing of the virtual
laboratory. A row is false where it is unflagged and half a diameter or more off; `--longer` cuts films of 600 frames at
four lengths and compares the rows that these share. What a cut cannot know is counted, and told apart: a ball that has
not left its first place in it, but for UNSEEN frames or fewer, so that it shows neither which of the balls moves nor
what is behind.
"""

from __future__ import annotations

import argparse
import math
import sys
import time
import warnings
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.special import ndtr
from scipy.stats import beta

from jumpvision.films.arrays.track import track as of_arrays

FAMILIES = ("toss", "alike", "toy", "wrong", "nine", "fast", "pendulum", "swing", "rod")
SAME = 0.1  # sigma: a row at the same place
UNSEEN, CLEAR = 20, 5.0  # frames in which a place is seen without its ball; px about a ball
BLUR = 0.75  # px, of a lens
MIX = {"toss": 0.7, "alike": 0.3}  # of the bar


@dataclass
class Film:
    """frames (n, H, W) uint8; truth (k, n, 2) [px]: of the ball that is asked for, then of its likes; seen (n,): it is
    whole, free and sharp; how: the call's settings; words: what it was made of."""

    frames: np.ndarray
    truth: np.ndarray
    seen: np.ndarray
    d: float
    how: dict
    words: str


def edge(distance: np.ndarray) -> np.ndarray:
    return ndtr(-distance / BLUR)


def near(
    shape: tuple[int, int], x: float, y: float, reach: float
) -> tuple[tuple[slice, slice], np.ndarray, np.ndarray]:
    """The part of a picture about (x, y), and its pixels' places from there."""
    h, w = shape
    x0, x1 = (int(np.clip(v, 0, w)) for v in (x - reach, x + reach + 2))
    y0, y1 = (int(np.clip(v, 0, h)) for v in (y - reach, y + reach + 2))
    v, u = np.mgrid[y0:y1, x0:x1]
    return (slice(y0, y1), slice(x0, x1)), u - x, v - y


def disc(picture: np.ndarray, x: float, y: float, d: float, grey: float, way: tuple[float, float] = (0.0, 0.0)) -> None:
    """A disc of one grey in place, smeared over a way."""
    length = math.hypot(*way)
    part, u, v = near(picture.shape, x, y, d / 2 + length / 2 + 4)
    steps = max(1, math.ceil(2 * length))
    share = np.zeros(u.shape)
    for k in range(steps):
        f = (k + 0.5) / steps - 0.5
        share += edge(np.hypot(u - f * way[0], v - f * way[1]) - d / 2) / steps
    picture[part] += share * (grey - picture[part])


def two_toned(picture: np.ndarray, x: float, y: float, d: float, greys: tuple[float, float], turn: float) -> None:
    part, u, v = near(picture.shape, x, y, d / 2 + 4)
    side = edge(v * math.cos(turn) - u * math.sin(turn))
    grey = greys[0] * side + greys[1] * (1 - side)
    share = edge(np.hypot(u, v) - d / 2)
    picture[part] += share * (grey - picture[part])


def toy(picture: np.ndarray, x: float, y: float, d: float, greys: tuple[float, float, float], turn: float) -> None:
    """A spinner: three round arms of three greys about a hub, as wide as d."""
    for k, grey in enumerate(greys):
        a = turn + k * 2 * math.pi / 3
        disc(picture, x + 0.28 * d * math.cos(a), y + 0.28 * d * math.sin(a), 0.46 * d, grey)
    disc(picture, x, y, 0.3 * d, float(np.mean(greys)))


def wall(
    rng: np.random.Generator, shape: tuple[int, int], level: float, bright: float, d: float
) -> tuple[np.ndarray, list]:
    """Brick or plaster, a floor, chalk strokes and round studs as bright as the ball."""
    h, w = shape
    yy, xx = np.mgrid[:h, :w].astype(float)
    picture, words = np.full(shape, level), []
    if rng.random() < 0.5:
        words.append("brick")
        bw, bh = rng.uniform(24, 50), rng.uniform(10, 20)
        row = np.floor(yy / bh).astype(int)
        u = (xx + 0.5 * bw * (row % 2)) % bw
        tone = rng.normal(0, rng.uniform(2, 8), (row.max() + 1, int(w / bw) + 3))
        picture += tone[row, ((xx + 0.5 * bw * (row % 2)) // bw).astype(int)]
        joint = np.minimum(np.minimum(u, bw - u), np.minimum(yy % bh, bh - yy % bh))
        picture += rng.uniform(5, 25) * edge(joint - 1.0)
    if rng.random() < 0.5:
        words.append("floor")
        top = rng.uniform(0.75, 0.95) * h
        picture += edge(top - yy) * rng.uniform(-25, 25)
        picture += edge(top - yy) * rng.normal(0, 6, shape)
    rough = cv2.GaussianBlur(rng.normal(size=shape), (0, 0), rng.uniform(1.5, 8))
    picture += rng.uniform(0, 4) * rough / rough.std() + rng.uniform(-20, 20) * xx / w
    for _ in range(rng.poisson(1.5)):
        words.append("chalk")
        x, y, a, n = rng.uniform(0, w), rng.uniform(0, h), rng.uniform(0, math.pi), rng.uniform(1, 5) * d
        u = np.clip((xx - x) * math.cos(a) + (yy - y) * math.sin(a), 0, n)
        off = np.hypot(xx - x - u * math.cos(a), yy - y - u * math.sin(a)) - rng.uniform(0.1, 0.5) * d
        grains = np.clip(1.0 + 0.3 * rng.normal(size=shape), 0, 1)
        picture += edge(off) * grains * rng.uniform(0.4, 1.0) * (bright - level)
    for _ in range(rng.poisson(1.5)):
        words.append("stud")
        grey = level + (bright - level) * rng.uniform(0.6, 1.1)
        disc(picture, rng.uniform(0, w), rng.uniform(0, h), d * rng.uniform(0.6, 1.5), grey)
    return picture, words


def thrown(rng: np.random.Generator, shape: tuple[int, int], n: int, speed: float, held: int = 0) -> np.ndarray:
    """(n, 2): held, then tossed across the picture and back down."""
    h, w = shape
    side = rng.choice([-1, 1])
    x0, y0 = (0.5 - side * rng.uniform(0.2, 0.42)) * w, rng.uniform(0.6, 0.9) * h
    angle = rng.uniform(0.7, 1.4)
    vx, vy = side * speed * math.cos(angle), -speed * math.sin(angle)
    gravity = vy**2 / (2 * (y0 - rng.uniform(0.08, 0.3) * h))
    t = np.maximum(np.arange(n) - held, 0)
    return np.stack([x0 + vx * t, y0 + vy * t + 0.5 * gravity * t**2], axis=1)


def boxed(rng: np.random.Generator, shape: tuple[int, int], n: int, speed: float, d: float, k: int = 1) -> np.ndarray:
    """(k, n, 2): discs that fly straight between the walls of the picture; they pass one before the other."""
    size = np.array([shape[1], shape[0]]) - 2 * d
    a = rng.uniform(0, 2 * math.pi, k)
    way = speed * np.stack([np.cos(a), np.sin(a)], axis=1)
    at = rng.uniform(0, 1, (k, 1, 2)) * size + way[:, None] * np.arange(n)[None, :, None]
    at = np.abs((at + size) % (2 * size) - size)  # mirrored
    return at + d


def inside(at: np.ndarray, shape: tuple[int, int], d: float) -> np.ndarray:
    h, w = shape
    m = 0.5 * d + 3
    return (at[:, 0] > m) & (at[:, 0] < w - m) & (at[:, 1] > m) & (at[:, 1] < h - m)


def apart(at: np.ndarray, others: np.ndarray, d: float) -> np.ndarray:
    """Whether a ball is clear of others (k, n, 2)."""
    return (
        np.all(np.hypot(*np.moveaxis(others - at, -1, 0)) > 1.6 * d, axis=0) if len(others) else np.ones(len(at), bool)
    )


def film(family: str, seed: int, number: int, frames: int | None = None) -> Film:
    """One film, the same for the same numbers, in which the ball is seen in six frames or more."""
    for attempt in range(50):
        made = _film(family, np.random.default_rng([seed, FAMILIES.index(family), number, attempt]), frames)
        if made.seen.sum() >= 6 and (not made.how.get("needs_first", True) or made.seen[0]):
            break
    return made


def _film(family: str, rng: np.random.Generator, frames: int | None) -> Film:
    shape = (int(rng.choice([240, 360])), int(rng.choice([320, 480])))
    h, w = shape
    d = 12.0 if family == "fast" else float(rng.uniform(10, 24))
    dark = family == "wrong" or (family in ("toss", "alike") and rng.random() < 0.25)
    level, ball = (
        (rng.uniform(140, 200), rng.uniform(20, 60)) if dark else (rng.uniform(40, 100), rng.uniform(180, 235))
    )
    bright = rng.uniform(200, 240) if family == "wrong" else ball
    noise = rng.uniform(0.5, 4.0)
    speed = rng.uniform(0.5, 4.0) * d
    scene, words = wall(rng, shape, level, bright, d)
    if family in ("nine", "fast"):
        scene, words = np.full(shape, level) + cv2.GaussianBlur(rng.normal(0, 20, shape), (0, 0), 4), []
    n = frames or int(np.clip(1.6 * (w + h) / speed, 12, 60))
    held = int(rng.integers(0, 4)) if family in ("toss", "toy") and rng.random() < 0.5 else 0
    turn, spin = rng.uniform(0, 6), rng.uniform(0.1, 0.6) * rng.choice([-1, 1])
    tones = rng.permutation([0.35, 0.65, 1.0]) * (ball - 10) + 10
    n = frames or {"nine": 60, "fast": 40}.get(family, n)
    others = np.zeros((0, n, 2))
    if family in ("pendulum", "swing"):
        length, amplitude, period = rng.uniform(0.5, 0.8) * h, rng.uniform(0.3, 0.9), rng.uniform(25, 70)
        length = min(length, 0.42 * w / math.sin(amplitude))
        swing = (
            amplitude
            * np.exp(-np.arange(n) * rng.uniform(0, 3e-4))
            * np.cos(2 * math.pi * np.arange(n) / period + turn)
        )
        at = np.stack([w / 2 + length * np.sin(swing), 0.1 * h + length * np.cos(swing)], axis=1)
        spin = 0.0
    elif family == "rod":
        t = np.arange(n) - rng.uniform(40, 130)
        hop = rng.uniform(0.3, 0.7) * h * np.exp(-np.maximum(t, 0) / rng.uniform(60, 200))
        up = np.where(t > 0, hop * np.abs(np.sin(t * math.pi / rng.uniform(30, 80))), 0.0)
        at = np.stack([0.5 * w + 0.01 * up, 0.9 * h - d - np.where(up > 0.5, up, 0.0)], axis=1)
    elif family == "nine":
        all_at = boxed(rng, shape, n, rng.uniform(0.2, 1.2) * d, d, 9)
        at, others = all_at[0], all_at[1:]
        greys = rng.uniform(100, 160, 9)
    elif family == "fast":
        at = boxed(rng, shape, n, rng.uniform(3, 7) * d, d)[0]
    else:
        at = thrown(rng, shape, n, speed, held)
        if family == "alike":
            others = thrown(rng, shape, n, rng.uniform(0.7, 1.4) * speed)[None]
    step = np.vstack([np.diff(at, axis=0), at[-1:] - at[-2:-1]])
    exposure = rng.uniform(0, 0.05)
    hand = family in ("toss", "toy") and rng.random() < 0.5
    shadow = family in ("toss", "alike", "toy", "wrong") and rng.random() < 0.4
    glints = (
        rng.uniform(0, 1, (int(rng.poisson(2)), 2)) * [w, h] if family in ("toss", "alike", "toy") else np.zeros((0, 2))
    )
    seen = inside(at, shape, d) & apart(at, others, d)
    pictures = []
    yy, xx = np.mgrid[:h, :w]
    for i in range(n):
        picture = scene.copy()
        for gx, gy in glints:  # they flicker
            disc(picture, gx, gy, rng.uniform(2, 0.7 * d), rng.uniform(level, 255))
        (x, y), way = at[i], tuple(exposure * step[i])
        if shadow:
            part, u, v = near(shape, x + 0.9 * d, y + 0.7 * d, d)
            picture[part] *= 1 - 0.25 * ndtr(-(np.hypot(u, v) - d / 2) / 2.0)
        covered = np.abs(scene - ball)[np.hypot(xx - x, yy - y) < 0.62 * d] < 0.4 * abs(level - ball)
        seen[i] &= covered.size > 0 and covered.mean() < 0.1
        if family in ("pendulum", "swing"):
            a = math.atan2(x - w / 2, y - 0.1 * h)
            u = np.abs((xx - w / 2) * math.cos(a) - (yy - 0.1 * h) * math.sin(a)) - 0.6
            picture += edge(u) * (yy > 0.1 * h) * (yy < y) * (0.7 * level - picture)
            second = ball if family == "swing" else 0.25 * ball + 0.75 * level
            two_toned(picture, x, y, d, (ball, second), a + turn)
        elif family == "toy":
            toy(picture, x, y, d, tuple(tones), turn + spin * i)
        elif family == "nine":
            for k in range(8, -1, -1):
                disc(picture, *(others[k - 1, i] if k else at[i]), d, greys[k])
        else:
            for o in others:
                disc(picture, *o[i], d, ball)
            disc(picture, x, y, d, ball, way)
        if hand:
            hx, hy = at[0] + [0.2 * d, d + 1.5 * max(0, i - held)]
            part, u, v = near(shape, hx, hy, 2 * d)
            share = edge((np.hypot(u / 1.6, v / 0.8) - d) * 1.1)
            picture[part] += share * (0.5 * (level + ball) - picture[part])
            seen[i] &= math.hypot((x - hx) / 2.0, y - hy) > 1.6 * d
        if family == "nine":
            seen[i] &= abs(greys[0] - level) > 25
        pictures.append(np.clip(np.rint(picture + rng.normal(0, noise, shape)), 0, 255).astype(np.uint8))
    how = {"polarity": "dark" if dark and family != "wrong" else "bright"}
    if family == "nine" and greys[0] < level:
        how["polarity"] = "dark"
    how["needs_first"] = family in ("nine", "fast")
    parts = [family, f"{d:.0f} px", f"{speed / d:.1f} d/frame", f"noise {noise:.1f}", *words]
    parts += ["hand"] * hand + ["shadow"] * shadow + ["glints"] * bool(len(glints))
    return Film(np.array(pictures), np.concatenate([at[None], others]), seen, d, how, ", ".join(parts))


def settings(f: Film, family: str, click: bool, number: int) -> dict:
    """Of `jv.track`: of every second film the diameter is given, clicked ones have it too."""
    how = {k: v for k, v in f.how.items() if k != "needs_first"}
    click = click or family in ("nine", "fast")
    if click or number % 2:
        how["diameter"] = f.d
    if click:
        how["seed"] = tuple(float(v) for v in f.truth[0, 0] + np.array([0.15, -0.1]) * f.d)
        if family in ("toy", "pendulum"):
            how["method"] = "template"
    return how


def tracked(frames: np.ndarray, how: dict):
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        t = of_arrays(frames, **how)
    return t, [str(w.message) for w in caught]


def judged(f: Film, family: str, click: bool, number: int) -> tuple[str, int, int, str]:
    """("found" | "part" | "refused" | "doubted" | "false"), false rows, good rows, words."""
    t, said = tracked(f.frames, settings(f, family, click, number))
    good = (t.flag == "").to_numpy()
    at = np.stack([t.x_px, t.y_px], axis=1)
    off = np.hypot(*np.moveaxis(f.truth - at, -1, 0))  # (k, n)
    if family == "alike" and not click:  # either ball, but one
        off = off[[int(np.argmax([np.sum(good & (o < 0.5 * f.d)) for o in off]))]]
    wrong = good & ~(off[0] < 0.5 * f.d)
    seen = f.seen if len(off) == len(f.truth) else inside(f.truth[0], f.frames.shape[1:], f.d) & f.seen
    hit = float((good & (off[0] < 0.3 * f.d))[seen].mean())
    doubted = any("doubt" in s for s in said)
    verdict = "found" if hit >= 0.9 else "part" if good.any() else "refused"
    if wrong.any():
        verdict = "doubted" if doubted else "false"
    untrue = [s for s in said if "stands still and was not taken" in s and stands_at_ball(s, f)]
    left = int(sum("left the image" in s for s in t.flag[f.seen]))
    extra = f"; says the ball stands still: {untrue[0][:60]}" if untrue else ""
    extra += f"; {left} rows left the image of a ball seen" if left else ""
    where = "" if not wrong.any() else " rows " + " ".join(map(str, np.flatnonzero(wrong)[:12]))
    why = ""
    if verdict in ("part", "refused"):
        flags = [str(s)[:44] for s in t.flag[f.seen & ~good]]
        why = "; " + "; ".join(f"{flags.count(s)} x {s}" for s in sorted(set(flags), key=flags.count)[-2:])
    words = (
        f"{good.sum()} of {len(good)} good, {wrong.sum()} false{where}, {hit:.0%} of {f.seen.sum()} seen{why}{extra}"
    )
    return verdict, int(wrong.sum()) * (not doubted), int(good.sum()), words


def stands_at_ball(said: str, f: Film) -> bool:
    """Whether "a ball-like thing at (x, y) stands still" is said of where the moving ball is seen."""
    x, y = (float(v) for v in said.split("at (")[1].split(")")[0].split(","))
    path = f.truth[0][f.seen]
    return bool(np.any(np.hypot(path[:, 0] - x, path[:, 1] - y) < 0.5 * f.d)) and np.ptp(path, axis=0).max() > 2 * f.d


def interval(k: int, n: int) -> str:
    """95 % of the binomial distribution (Clopper and Pearson)."""
    low = beta.ppf(0.025, k, n - k + 1) if k else 0.0
    high = beta.ppf(0.975, k + 1, n - k) if k < n else 1.0
    return f"{100 * low:.1f} to {100 * high:.1f} %"


def clips(a: argparse.Namespace) -> None:
    families = [a.family] if a.family else [*MIX]
    order = ("false", "doubted", "refused", "part", "found")
    rows, wrong, good = [], 0, 0
    for family in families:
        share = 1.0 if a.family else MIX[family]
        for number in range(round(a.clips * share)):
            f = film(family, a.seed, number)
            began = time.perf_counter()
            verdict, k, n, words = judged(f, family, a.click, number)
            rows.append(
                (
                    order.index(verdict),
                    number,
                    f"{verdict:8s} {number:3d} {time.perf_counter() - began:5.1f} s {f.words}: {words}",
                )
            )
            wrong, good = wrong + k, good + n
    if a.each:
        print("\n".join(r[2] for r in sorted(rows)))
    total = len(rows)
    counts = [sum(r[0] == k for r in rows) for k in range(5)]
    heads = (
        "films",
        "found",
        "part of the frames",
        "refused",
        "false, and a doubt told",
        "silently false",
        "such rows",
    )
    found = f"{counts[4]} of {total} ({interval(counts[4], total)})"
    how = f"{a.family or 'mix'}, {'clicked' if a.click else 'no click'}, seed {a.seed}"
    print(row(*heads), "|---" * len(heads) + "|", row(how, found, *counts[3::-1], f"{wrong} of {good}"), sep="\n")


def row(*cells: object) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


CUTS = (100, 200, 350, 600)
LONG = ("pendulum", "rod", "fast", "swing", "nine")


def longer(a: argparse.Namespace) -> None:
    """Films cut at four lengths: rows that a cut shares with the whole film."""
    states = moved = digits = shared = same_films = same_digits = waits = same_known = 0
    worst = 0.0
    for number in range(a.clips):
        family = a.family or LONG[number % len(LONG)]
        f = film(family, a.seed, number, frames=CUTS[-1])
        how = settings(f, family, False, number)
        whole = tracked(f.frames, how)[0]
        off_by, places, some, known = [], 0, 0, True
        for n in CUTS[:-1]:
            t, same = tracked(f.frames[:n], how)[0], whole.iloc[:n]
            good, also = ((s.flag == "").to_numpy() for s in (t, same))
            off = np.hypot(t.x_px - same.x_px, t.y_px - same.y_px).to_numpy()[good & also]
            far = off / same.sigma_px.to_numpy()[good & also]
            off_by.append(int((good != also).sum()))
            places, some = places + int((far > SAME).sum()), some + int((off > 0).sum())
            worst, shared = max(worst, float(np.max(far, initial=0.0))), shared + n
            away = np.hypot(*(f.truth[0, :n] - f.truth[0, 0]).T) > f.d + CLEAR
            rests, other = away.sum() <= UNSEEN, off_by[-1] > 0 or bool((far > SAME).any())
            waits, known = waits + (rests and other), known and (rests or not other)
        states, moved, digits = states + sum(off_by), moved + places, digits + some
        same_films += not sum(off_by) and not places
        same_digits += not sum(off_by) and not some
        same_known += known
        if a.each:
            found = int((whole.flag == "").sum())
            words = f"{number} {f.words}: {found} found; {off_by} states, {places} places, {some} digits differ"
            print(words, file=sys.stderr, flush=True)
    heads = (
        f"films cut at {CUTS}",
        "same rows",
        "same but for cuts in which the ball rests",
        "such cuts",
        "same digits",
        "rows found in one cut only",
        f"off by > {SAME} sigma",
        "other digits",
        "farthest, sigma",
    )
    films = f"{same_films} of {a.clips}", f"{same_known} of {a.clips}", waits, f"{same_digits} of {a.clips}"
    counts = f"{states} of {shared}", moved, digits, f"{worst:.3g}"
    print(row(*heads), "|---" * len(heads) + "|", row(f"seed {a.seed}", *films, *counts), sep="\n")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--family", choices=FAMILIES, default=None)
    parser.add_argument("--click", action="store_true", help="the ball's place in the first frame is given")
    parser.add_argument("--each", action="store_true", help="a row a film, worst first")
    parser.add_argument("--longer", action="store_true", help="films cut at four lengths")
    a = parser.parse_args()
    longer(a) if a.longer else clips(a)


if __name__ == "__main__":
    main()
