"""Clips as teachers film them: is the right ball found, or refused, and how near to the bound?

    python -m benchmarks.clips [--clips 300] [--seed 0] [--click] [--each] [--faces]

A clip: a ball tossed before a wall with a ruler, a hand that lets go of it, stickers and chalk, its shadow, 15 to 60
frames a second, 0.3 to 8 diameters a frame, seen through MPEG-4, motion JPEG, stills of a low quality, or no codec;
some interlaced. Drawn by coverage of sub-pixels and thrown by a parabola with drag: nothing of the virtual laboratory.
Discs are told from two-tone and textured balls, which without a click may be refused, and are tracked as templates with
one. A frame counts as seen where the ball is whole, not behind the hand, not before what is
as bright as itself, and not interlaced.
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
import pandas as pd

from benchmarks.ball import through
from jumpvision.films.arrays.track import track as of_arrays

FINE = 4  # sub-pixels of a pixel, each way: of what stands still
ROUND = 16  # of the ball's, whose rim 4 draw wrong by a noise of some grey levels


@dataclass
class Clip:
    """frames (n, H, W) uint8; truth (n, 2) [px]; seen (n,): the ball is whole and free; d [px]; what it was made of."""

    frames: np.ndarray
    truth: np.ndarray
    seen: np.ndarray
    d: float
    dark: bool
    kind: str
    words: str
    clean: list[np.ndarray]
    noise: float
    spin: float  # rad a frame


def wall(rng: np.random.Generator, h: int, w: int, level: float, d: float, ball: float) -> tuple[np.ndarray, list[str]]:
    """The scene without ball: light, texture, ruler, stickers, chalk."""
    rough = cv2.GaussianBlur(rng.normal(size=(h, w)), (0, 0), rng.uniform(2, 15))
    yy, xx = np.mgrid[:h, :w]
    a = rng.uniform(0, 2 * math.pi)
    out = (
        level
        + rng.uniform(0, 25) * (xx * math.cos(a) / w + yy * math.sin(a) / h)
        + rng.uniform(0, 5) * rough / rough.std()
    )
    words = []
    if rng.random() < 0.6:  # a ruler, as bright as the ball, with a round end
        wide, x, top = rng.uniform(0.8, 1.3) * d, rng.uniform(0.1, 0.9) * w, rng.uniform(0.1, 0.5) * h
        fine = np.full((h * FINE, w * FINE), 0, np.uint8)
        r = int(wide * FINE / 2)
        cx, cy = int(x * FINE), int(top * FINE)
        cv2.rectangle(fine, (cx - r, cy), (cx + r, h * FINE), 255, -1)
        cv2.circle(fine, (cx, cy), r, 255, -1)
        for k, y in enumerate(range(cy + 3 * r, h * FINE, max(4, int(0.4 * d * FINE)))):
            cv2.rectangle(fine, (cx - r, y), (cx - r + (2 * r if k % 5 == 0 else r), y + FINE), 0, -1)
        share = cv2.resize(fine, (w, h), interpolation=cv2.INTER_AREA) / 255.0
        out = out * (1 - share) + (ball + rng.uniform(-15, 10)) * share
        words.append("ruler")
    for _ in range(rng.poisson(0.8)):  # stickers and chalk
        x, y, r = rng.uniform(0, w), rng.uniform(0, h), 0.5 * d * rng.uniform(0.6, 1.5)
        fat = 1.0 if rng.random() < 0.5 else rng.uniform(1.5, 4.0)
        turn = rng.uniform(0, math.pi)
        u, v = (
            (xx - x) * math.cos(turn) + (yy - y) * math.sin(turn),
            (yy - y) * math.cos(turn) - (xx - x) * math.sin(turn),
        )
        share = np.clip((r - np.hypot(u / fat, v)) / rng.choice([1.0, 4.0]) + 0.5, 0, 1)
        out = out * (1 - share) + (level + (ball - level) * rng.uniform(0.5, 1.05)) * share
        words.append("sticker" if fat == 1.0 else "chalk")
    return out, words


def face(kind: str, u: np.ndarray, v: np.ndarray, turn: float, dark: float, seed: int) -> np.ndarray:
    """Brightness 0..1 of a ball's face at (u, v) of its radius: 1 where it is a plain disc."""
    a, b = u * math.cos(turn) + v * math.sin(turn), v * math.cos(turn) - u * math.sin(turn)
    if kind == "two-tone":
        return np.where(b > 0.1, 1.0, dark)
    if kind == "textured":
        phases = np.random.default_rng(seed).uniform(0, 6.3, 6)
        waves = sum(np.cos(3 * a * math.cos(p) + 5 * b * math.sin(p) + 7 * p) for p in phases)
        return np.clip(0.55 + 0.25 * waves, 0.0, 1.0)
    return np.ones_like(u)


def draw(
    picture: np.ndarray, x: float, y: float, r: float, ball: float, level: float, how: tuple, streak: tuple
) -> None:
    """The ball over the picture, in place: coverage of sub-pixels, mean over the exposure."""
    h, w = picture.shape
    pad = r + 2 + 0.5 * max(abs(streak[0]), abs(streak[1]))
    x0, x1, y0, y1 = max(0, int(x - pad)), min(w, int(x + pad) + 2), max(0, int(y - pad)), min(h, int(y + pad) + 2)
    if x1 <= x0 or y1 <= y0:
        return
    sub = (np.arange(ROUND) + 0.5) / ROUND - 0.5
    xs = (np.arange(x0, x1)[:, None] + sub).ravel()
    ys = (np.arange(y0, y1)[:, None] + sub).ravel()
    part = np.zeros((y1 - y0, x1 - x0))
    light = np.zeros_like(part)
    steps = max(1, math.ceil(math.hypot(*streak) * 2))
    for k in range(steps):
        f = (k + 0.5) / steps - 0.5
        u, v = np.meshgrid((xs - x - f * streak[0]) / r, (ys - y - f * streak[1]) / r)
        inside = np.hypot(u, v) < 1.0
        grey = level + (ball - level) * face(how[0], u, v, how[1], how[2], how[3])
        for total, values in ((part, inside), (light, inside * grey)):
            total += values.reshape(y1 - y0, ROUND, x1 - x0, ROUND).mean(axis=(1, 3)) / steps
    picture[y0:y1, x0:x1] = picture[y0:y1, x0:x1] * (1 - part) + light


def through_codec(rng: np.random.Generator, frames: list[np.ndarray], fps: float) -> tuple[list[np.ndarray], str]:
    """Frames as a camera's file gives them back."""
    how = str(rng.choice(["none", "stills", "MJPG", "mp4v"], p=[0.15, 0.25, 0.25, 0.35]))
    if how == "stills":
        how = f"jpeg {int(rng.integers(35, 90))}"
    return through(how, frames, fps), how


def clip(seed: int, number: int, faces: bool = False) -> Clip:
    """One clip, the same for the same numbers, in which the ball is seen in six frames or more; faces: of two tones or
    textured, without a codec."""
    for attempt in range(20):
        made = _clip(np.random.default_rng([seed, number, attempt]), faces)
        if made.seen.sum() >= 6 or "interlaced" in made.words:
            break
    return made


def _clip(rng: np.random.Generator, faces: bool) -> Clip:
    """One as it comes."""
    h, w = int(rng.choice([240, 360, 480])), int(rng.choice([320, 480, 640]))
    d, fps = rng.uniform(9, 26), rng.uniform(15, 60)
    kind = str(rng.choice(["disc", "two-tone", "textured"], p=[0.0, 0.5, 0.5] if faces else [0.8, 0.1, 0.1]))
    dark = rng.random() < 0.2
    level, ball = (
        (rng.uniform(150, 200), rng.uniform(20, 60)) if dark else (rng.uniform(30, 110), rng.uniform(180, 235))
    )
    scene, words = wall(rng, h, w, level, d, ball)
    speed = math.exp(rng.uniform(math.log(0.3), math.log(8.0))) if rng.random() < 0.3 else rng.uniform(2.0, 8.0)
    n = int(np.clip(rng.uniform(0.8, 2.2) * (w + h) / (speed * d), 8, 60))
    # thrown from low on one side, up and over: a parabola in frames, drag beside it
    x, y = rng.uniform(0.05, 0.3) * w, rng.uniform(0.6, 0.95) * h
    angle, side = rng.uniform(0.6, 1.45), rng.choice([-1, 1])
    vx, vy = speed * d * math.cos(angle), -speed * d * math.sin(angle)
    if side < 0:
        x, vx = w - x, -vx
    # high enough to stay in the picture for the most part
    gravity = max(vy * vy / (2 * max(y - 0.1 * h, 1)), 0.002 * d)
    interlaced = rng.random() < 0.08 and not faces
    held = int(rng.integers(0, 4)) if rng.random() < 0.5 else 0
    hand = rng.random() < 0.5
    shadow, exposure = rng.random() < 0.4, rng.uniform(0.0, 0.06)
    spin, seed_face, tone = rng.normal(0, 0.05), int(rng.integers(1e6)), rng.uniform(0.1, 0.5)
    drag = rng.uniform(0, 0.02)
    noise = rng.uniform(0.5, 4.0)
    where, speeds = [], []
    for k in range(2 * n):  # half frames
        if k >= 2 * held:
            x, y, vy = x + 0.5 * vx, y + 0.5 * vy, vy + 0.5 * gravity
            vx, vy = vx * (1 - 0.5 * drag), vy * (1 - 0.5 * drag)
        where.append((x, y))
        speeds.append((vx, vy) if k >= 2 * held else (0.0, 0.0))
    x0, y0 = where[0]
    frames, clean, seen = [], [], np.ones(n, bool)
    hidden = np.abs(scene - ball) < 0.4 * abs(level - ball)  # as bright as the ball: no rim to see there
    phase = rng.uniform(0, 6)
    yy, xx = np.mgrid[:h, :w]
    for i in range(n):
        fields = []
        for k in (2 * i, 2 * i + 1) if interlaced else (2 * i,):
            (bx, by), v = where[k], speeds[k]
            picture = scene.copy()
            if shadow:
                cv2.circle(picture, (int(bx + 0.8 * d), int(by + 0.8 * d)), int(d / 2), level * 0.75, -1)
            how = (kind, phase + spin * k / 2, tone, seed_face)
            draw(picture, bx, by, d / 2, ball, level, how, (v[0] * exposure, v[1] * exposure))
            if hand:  # lets go and sinks
                hx, hy = x0 + 0.2 * d, y0 + d + max(0, i - held) * 1.5
                cv2.ellipse(
                    picture, (int(hx), int(hy)), (int(1.6 * d), int(0.8 * d)), 20, 0, 360, 0.5 * (level + ball), -1
                )
                if math.hypot((bx - hx) / 2.2, by - hy) < 1.7 * d:
                    seen[i] = False
            fields.append(cv2.GaussianBlur(picture, (0, 0), 0.7))
        if interlaced:
            fields[0][1::2] = fields[1][1::2]
            seen[i] = False
        inside = 0.7 * d < where[2 * i][0] < w - 0.7 * d and 0.7 * d < where[2 * i][1] < h - 0.7 * d
        seen[i] &= inside
        if inside:
            x, y = where[2 * i]
            near = np.hypot(xx - x, yy - y) < 0.6 * d
            seen[i] &= hidden[near].mean() < 0.1
        clean.append(fields[0])
        frames.append(np.clip(np.rint(fields[0] + rng.normal(0, noise, (h, w))), 0, 255).astype(np.uint8))
    words += ["hand"] * hand + ["shadow"] * shadow + ["interlaced"] * interlaced
    frames, codec = (frames, "none") if faces else through_codec(rng, frames, fps)
    truth = np.array(where[::2])
    at = ", ".join([kind, "dark" if dark else "bright", f"{d:.0f} px", f"{speed:.1f} d/frame", codec, *words])
    return Clip(np.array(frames), truth, seen, d, dark, kind, at, clean, noise, spin)


def bound(c: Clip, i: int) -> float:
    """Cramer-Rao bound of one coordinate [px] in a frame of white noise: position and turn unknown (a disc's
    size and levels tell nothing of its place), averaged over x and y; from differences of the picture as it was drawn,
    before the codec."""
    x, y = c.truth[i]
    r = int(0.75 * c.d + 6)
    x0, y0 = max(0, int(x) - r), max(0, int(y) - r)
    part = c.clean[i][y0 : int(y) + r + 1, x0 : int(x) + r + 1]
    gy, gx = np.gradient(part)
    v, u = np.indices(part.shape)
    turned = ((u + x0 - x) * gy - (v + y0 - y) * gx) * (np.hypot(u + x0 - x, v + y0 - y) < 0.5 * c.d - 1.0)
    d = np.stack([gx.ravel(), gy.ravel(), turned.ravel()])
    fisher = d @ d.T / c.noise**2
    fisher[2, 2] += 1.0  # a turn is known to 1 rad
    return math.sqrt(0.5 * float(np.trace(np.linalg.inv(fisher)[:2, :2])))


def tracked(c: Clip, p: dict) -> tuple[pd.DataFrame, list[str]]:
    """The track of a clip and what is said of it."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        return of_arrays(c.frames, **p), [str(w.message) for w in caught]


def judged(c: Clip, click: bool) -> tuple[str, float, float, str]:
    """("found" | "refused" | "part" | "false", scatter over the bound, share of errors within sigma, words)."""
    p: dict = {"polarity": "dark" if c.dark else "bright"}
    if click or int(c.d * 100) % 2:
        p["diameter"] = float(c.d)
    if click:
        p["seed"] = tuple(c.truth[0] + np.array([0.2, -0.15]) * c.d)
        if c.kind != "disc":
            p["method"] = "template"
    n = min(len(c.frames), len(c.truth))
    truth, seen, said = c.truth[:n], c.seen[:n], []
    try:
        t, said = tracked(c, p)
        if told := [s for s in said if "interlaced" in s]:  # nobody takes its places for those of one instant
            return "refused", math.nan, math.nan, told[0][:60]
    except ValueError as e:
        return "refused", math.nan, math.nan, str(e)[:60]
    good = (t.flag == "").to_numpy()[:n]
    if p.get("method") == "template":  # the clicked point, which turns with it
        angle, from_centre = c.spin * np.arange(n) * len(c.truth) / n, p["seed"] - c.truth[0]
        turned = np.stack([np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)], axis=1).reshape(n, 2, 2)
        truth = truth + turned @ from_centre
    off = np.hypot(t.x_px[:n] - truth[:, 0], t.y_px[:n] - truth[:, 1]).to_numpy()
    wrong = good & (off > 0.5 * c.d)
    hit = (good & (off < 0.3 * c.d))[seen].mean() if seen.any() else 0.0
    words = (
        f"{good.sum()} of {n} good, {wrong.sum()} wrong, {hit:.0%} of {seen.sum()} seen; {said[0][:70] if said else ''}"
    )
    if wrong.sum() > 0.1 * max(good.sum(), 1):
        return (
            ("doubted" if any("alternative" in s or "doubt" in s for s in said) else "false"),
            math.nan,
            math.nan,
            words,
        )
    if not good.any():
        return "refused", math.nan, math.nan, words + str(t.flag[0])
    use = np.flatnonzero(good & seen & (off < 0.3 * c.d))
    ratio = covered = math.nan
    if use.size > 4 and hit >= 0.9 and "interlaced" not in c.words:
        e = np.stack([t.x_px.to_numpy()[use] - truth[use, 0], t.y_px.to_numpy()[use] - truth[use, 1]], axis=1)
        e = e - np.median(e, axis=0)
        ratio = float(np.sqrt(np.mean(e**2)) / np.mean([bound(c, i) for i in use]))
        covered = float(np.mean(np.abs(e) < t.sigma_px.to_numpy()[use][:, None]))
    return ("found" if hit >= 0.9 else "part"), ratio, covered, words


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--clips", type=int, default=300)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--click", action="store_true", help="the ball's place in the first frame is given")
    parser.add_argument("--each", action="store_true", help="a row a clip, worst first")
    parser.add_argument("--faces", action="store_true", help="balls of two tones and textures alone, without codecs")
    a = parser.parse_args()
    order = ("false", "doubted", "part", "refused", "found")
    rows, ratios, shares = [], {"disc": [], "template": []}, {"disc": [], "template": []}
    for number in range(a.first, a.first + a.clips):
        c = clip(a.seed, number, a.faces)
        began = time.perf_counter()
        verdict, ratio, covered, words = judged(c, a.click)
        took = time.perf_counter() - began
        plain = c.words.split(", ")[4] == "none"
        if math.isfinite(ratio) and plain:
            kind = "disc" if c.kind == "disc" else "template"
            ratios[kind].append(ratio)
            shares[kind].append(covered)
            words = f"{ratio:.2f} of the bound, {covered:.0%} within sigma; {words}"
        rows.append((order.index(verdict), verdict, f"{number:4d} {took:5.1f} s {c.words}: {words}"))
        if a.each:
            print(f"# {number} {verdict} {ratio:.2f} {covered:.2f}", file=sys.stderr, flush=True)
    if a.each:
        for _, verdict, text in sorted(rows):
            print(f"{verdict:8s} {text}")
    n = len(rows)
    print(f"| {'with a click' if a.click else 'without a seed'} | of {n} clips |\n|---|---|")
    for verdict in order:
        k = sum(r[1] == verdict for r in rows)
        print(f"| {verdict} | {k / n:.3f} ± {math.sqrt(max(k * (n - k), 1) / n**3):.3f} |")
    for what, values in ratios.items():
        if values:
            far, within = np.percentile(values, 90), np.mean(shares[what])
            print(
                f"| scatter over the bound, {what}, no codec | {np.median(values):.2f} (of {len(values)}; nine in ten "
                f"below {far:.2f}); within sigma {within:.0%} |"
            )


if __name__ == "__main__":
    main()
