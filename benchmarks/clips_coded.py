"""Compressed clips of twenty kinds as people film them: is the ball found, and what are its rows worth?

    python -m benchmarks.clips_coded [--seed 0] [--films 3] [--kinds blur,ruler] [--against TREE] [--each]

Discs are drawn by coverage of sub-pixels and instants of the exposure, in colour, before drawn scenes, blurred as a
lens does and coded by x264 (one thread, fixed settings, crf 23 to 30: it repeats). Nothing here is the tracker's.
--against runs the same films through the tracker of another source tree, in a process of its own; `shared` is the rms
error of the rows that both trees have.

found: films in which nine tenths of the rows where the ball is whole and free are good and within 0.3 diameters.
false: good rows that are 0.5 diameters or more off. cover: share of errors within one sigma, common offset included.
cuts: films whose first 60 and 80 % give the rows of the whole, but for LAG rows at the end: the same flags, places
within a sigma. s: processor time.
"""

from __future__ import annotations

import argparse
import math
import os
import pickle
import subprocess
import sys
import tempfile
import time
import warnings
from dataclasses import dataclass
from pathlib import Path

import av
import cv2
import numpy as np

H, W = 240, 320
SUB = 6  # sub-pixels of a pixel, each way
LAG = 8  # rows before a cut that more film may change
LENS = 0.7  # px
GREY = np.ones(3)
ORANGE = np.array([1.0, 0.58, 0.12])
CHANGED = 1.0  # sigma: a row that moved by more is another one


@dataclass
class Clip:
    """truth (n, 2) [px]; seen (n,); d [px]; dark: the ball is darker than the scene; frames (n, H, W, 3) uint8."""

    kind: str
    truth: np.ndarray
    seen: np.ndarray
    d: float
    dark: bool
    frames: np.ndarray
    crf: int


@dataclass
class Plan:
    """What a kind changes of a plain throw."""

    d: tuple[float, float] = (13.0, 24.0)
    speed: tuple[float, float] = (0.5, 1.6)  # diameters a frame
    shutter: tuple[float, float] = (0.0, 0.15)  # share of a frame
    rough: float = 2.0  # grey levels rms of the wall
    ball: tuple[float, float] = (190.0, 235.0)
    wall: tuple[float, float] = (50.0, 110.0)
    tint: np.ndarray | None = None
    tone: float = 1.0  # of the ball's dark half
    shade: float = 0.0  # of its light, from side to side
    things: tuple[str, ...] = ()
    way: str = "throw"


KINDS = {
    "plain": Plan(),
    "small": Plan(d=(6.5, 10.0)),
    "tiny fast": Plan(d=(6.0, 9.0), speed=(2.0, 3.0)),
    "large": Plan(d=(30.0, 40.0), speed=(0.2, 0.6)),
    "blur": Plan(speed=(1.6, 2.2), shutter=(0.45, 0.55)),
    "far": Plan(d=(8.0, 14.0), speed=(3.0, 6.0)),
    "far blur": Plan(d=(9.0, 14.0), speed=(2.5, 3.5), shutter=(0.25, 0.4)),
    "two-tone": Plan(tone=0.55),
    "ruler": Plan(things=("ruler",)),
    "hand": Plan(things=("hand",), way="held"),
    "bounce": Plan(way="bounce", speed=(0.4, 0.9)),
    "leap": Plan(way="leap"),
    "orange": Plan(tint=ORANGE, ball=(205.0, 235.0), wall=(95.0, 120.0)),
    "post": Plan(things=("post",), speed=(0.3, 0.7)),
    "textured": Plan(rough=14.0),
    "dark": Plan(ball=(20.0, 45.0), wall=(150.0, 195.0)),
    "hopper": Plan(way="hopper", d=(9.0, 16.0), things=("rod",)),
    "side light": Plan(shade=0.5),
    "returns": Plan(way="returns", speed=(0.5, 0.9)),
    "stickers": Plan(things=("stickers", "shadow")),
}


def way_of(plan: Plan, d: float, rng: np.random.Generator) -> tuple[np.ndarray, int]:
    """Places (n, 2) of the ball [px] a frame, and how many frames it is held before."""
    speed, side = rng.uniform(*plan.speed) * d, rng.choice([-1.0, 1.0])
    vx, held = rng.uniform(0.75, 0.95) * speed, 14 if plan.way == "held" else 0
    flight = 0.8 * W / vx
    n = int(np.clip(held + 1.05 * flight + 4.0, 14, 80)) if plan.way in ("throw", "held") else 60
    k = np.arange(n, dtype=float)
    x, y = 0.12 * W, 0.75 * H
    if plan.way == "held":
        k = np.maximum(0.0, k - held)
    if plan.way in ("throw", "held"):
        top = rng.uniform(0.45, 0.6) * H
        xs, ys = x + vx * k, y - 4.0 * top * (k / flight) * (1.0 - k / flight)
    elif plan.way == "bounce":
        vx, fall = 0.35 * speed, 0.5 * H
        period = 2.0 * math.sqrt(2.0 * fall / (0.12 * speed))
        phase = (k + 0.3 * period) % period / period
        loss = 0.8 ** ((k + 0.3 * period) // period)
        xs, ys = x + vx * k, 0.8 * H - loss * fall * 4.0 * phase * (1.0 - phase)
    elif plan.way == "leap":
        away = (k >= 20) & (k < 40)
        xs, ys = 0.35 * W + 0.15 * d * k + 90.0 * away, 0.5 * H + 8.0 * np.sin(k / 6.0) - 10.0 * away
    elif plan.way == "hopper":
        start = 12.0
        t = np.maximum(0.0, k - start)
        xs = 0.5 * W + 0.3 * np.sin(t / 5.0)
        ys = 0.6 * H - 0.9 * d * np.sin(t / 2.5) * np.minimum(1.0, t / 20.0) - 25.0 * np.abs(np.sin(t / 15.0))
    else:  # returns: up out of the picture and back
        xs, ys = 0.15 * W + 0.55 * W * k / n, 0.8 * H - 4.0 * 1.1 * H * (k / n) * (1.0 - k / n)
    if side < 0:
        xs = W - 1.0 - xs
    return np.stack([xs, ys], axis=1) + rng.uniform(-0.5, 0.5, 2), held


def cover(x: float, y: float, r: float, streak: np.ndarray, tone: float, turn: float, shade: float) -> tuple:
    """(window, share, light): of each pixel, exposure and ball; light is 1 on a plain ball."""
    pad = r + 3.0 + 0.5 * np.abs(streak).max()
    x0, x1, y0, y1 = max(0, int(x - pad)), min(W, int(x + pad) + 2), max(0, int(y - pad)), min(H, int(y + pad) + 2)
    if x1 <= x0 or y1 <= y0:
        return (slice(0, 0), slice(0, 0)), np.zeros((0, 0)), np.zeros((0, 0))
    sub = (np.arange(SUB) + 0.5) / SUB - 0.5
    xs, ys = (np.arange(x0, x1)[:, None] + sub).ravel() - x, (np.arange(y0, y1)[:, None] + sub).ravel() - y
    share, light = np.zeros((2, ys.size, xs.size))
    steps = max(1, math.ceil(2.0 * math.hypot(*streak)))
    for t in (np.arange(steps) + 0.5) / steps - 0.5:
        u, v = np.meshgrid((xs - t * streak[0]) / r, (ys - t * streak[1]) / r)
        inside = np.clip((1.0 - np.hypot(u, v)) * r * SUB + 0.5, 0.0, 1.0)
        face = np.where(v * math.cos(turn) - u * math.sin(turn) > 0.1, 1.0, tone) * (1.0 + 0.5 * shade * u)
        share += inside / steps
        light += inside * face / steps
    shape = (y1 - y0, SUB, x1 - x0, SUB)
    return (slice(y0, y1), slice(x0, x1)), share.reshape(shape).mean((1, 3)), light.reshape(shape).mean((1, 3))


def polygon(picture: np.ndarray, points: np.ndarray, grey: np.ndarray) -> np.ndarray:
    """Draw a filled polygon (m, 2) [px], its edges anti-aliased, in place; returns the share of each pixel."""
    fine = np.zeros((H * SUB, W * SUB), np.uint8)
    cv2.fillPoly(fine, [np.rint((points + 0.5) * SUB - 0.5).astype(np.int32)], 255)
    share = cv2.resize(fine, (W, H), interpolation=cv2.INTER_AREA)[..., None] / 255.0
    picture[:] = picture * (1.0 - share) + grey * share
    return share[..., 0]


def box(x0: float, y0: float, x1: float, y1: float) -> np.ndarray:
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def ring(x: float, y: float, a: float, b: float, turn: float = 0.0) -> np.ndarray:
    """An ellipse as a polygon."""
    t = np.linspace(0.0, 2.0 * math.pi, 60, endpoint=False)
    u, v = a * np.cos(t), b * np.sin(t)
    return np.stack([x + u * math.cos(turn) - v * math.sin(turn), y + u * math.sin(turn) + v * math.cos(turn)], axis=1)


def scene_of(plan: Plan, d: float, wall: float, ball: float, rng: np.random.Generator) -> np.ndarray:
    """The scene (H, W, 3) without ball [grey]."""
    rough = cv2.GaussianBlur(rng.normal(size=(H, W)), (0, 0), rng.uniform(1.5, 6.0))
    v, u = np.mgrid[:H, :W]
    grey = wall + 15.0 * (rng.uniform(-1, 1) * u / W + rng.uniform(-1, 1) * v / H) + plan.rough * rough / rough.std()
    picture = grey[..., None] * GREY
    polygon(picture, box(-1, 0.9 * H, W, H), 0.8 * wall * GREY)
    if "ruler" in plan.things:
        x, top, half = rng.uniform(0.3, 0.7) * W, rng.uniform(0.1, 0.4) * H, 0.5 * d
        polygon(picture, box(x - half, top, x + half, H), ball * GREY)
        polygon(picture, ring(x, top, half, half), ball * GREY)
        for k, y in enumerate(np.arange(top + d, 0.95 * H, 0.45 * d)):
            polygon(picture, box(x - half, y, x + (half if k % 5 == 0 else 0), y + 1.2), 0.3 * wall * GREY)
    if "stickers" in plan.things:
        for _ in range(3):
            x, y, r = rng.uniform(0.1, 0.9) * W, rng.uniform(0.1, 0.8) * H, 0.5 * d * rng.uniform(0.7, 1.3)
            polygon(picture, ring(x, y, r, r), (wall + rng.uniform(0.5, 1.0) * (ball - wall)) * GREY)
    return picture


def clip(kind: str, number: int, seed: int) -> Clip:
    """Draw a clip; the same for the same numbers."""
    plan = KINDS[kind]
    rng = np.random.default_rng([seed, number, list(KINDS).index(kind)])
    d, wall, ball = rng.uniform(*plan.d), rng.uniform(*plan.wall), rng.uniform(*plan.ball)
    if plan.speed[0] >= 2.5:
        d = min(d, 14.0)
    tint = plan.tint if plan.tint is not None else GREY
    scene = scene_of(plan, d, wall, ball, rng)
    truth, held = way_of(plan, d, rng)
    shutter, noise, crf = rng.uniform(*plan.shutter), rng.uniform(0.8, 2.5), int(rng.integers(23, 31))
    spin, phase = rng.uniform(-0.15, 0.15), rng.uniform(0, 6.3)
    velocity = np.gradient(truth, axis=0)
    velocity[: held + 1] = 0.0
    jumps = np.hypot(*np.diff(truth, axis=0).T) > 60.0 if plan.way == "leap" else np.zeros(len(truth) - 1, bool)
    velocity[np.r_[jumps, False] | np.r_[False, jumps]] = 0.0
    frames, seen = [], np.ones(len(truth), bool)
    yy, xx = np.mgrid[:H, :W]
    post = 0.5 * W + rng.uniform(-20, 20)
    for i, (x, y) in enumerate(truth):
        picture = scene.copy()
        if "shadow" in plan.things:
            at, share, _ = cover(x + 0.9 * d, y + 0.8 * d, 0.5 * d, np.zeros(2), 1.0, 0.0, 0.0)
            picture[at] *= 1.0 - 0.35 * share[..., None]
        if "rod" in plan.things:
            polygon(picture, box(x - 1.2, y, x + 1.2, 0.9 * H), 0.5 * wall * GREY)
        at, share, light = cover(x, y, 0.5 * d, velocity[i] * shutter, plan.tone, phase + spin * i, plan.shade)
        picture[at] = picture[at] * (1.0 - share[..., None]) + light[..., None] * ball * tint
        free = np.zeros((H, W))
        free[at] = share
        hidden = np.zeros((H, W))
        if "post" in plan.things:
            hidden = polygon(picture, box(post - 0.4 * d, 0, post + 0.4 * d, H), 0.6 * wall * GREY)
        if "hand" in plan.things:  # palm beneath the ball, fingers about it; sinks after the throw
            sink = 2.5 * max(0, i - held)
            hx, hy = truth[0, 0], truth[0, 1] + 0.75 * d + sink
            skin = np.array([0.78, 0.6, 0.5]) * 190.0
            hidden = polygon(picture, ring(hx, hy, 1.5 * d, 0.6 * d, 0.2), skin)
            hidden = hidden + polygon(picture, ring(hx - 0.6 * d, hy - 0.4 * d, 0.25 * d, 0.6 * d, 0.3), skin)
            hidden = hidden + polygon(picture, box(hx - 0.8 * d, hy, hx + 0.8 * d, H), 0.8 * skin)
        covered = float((free * (hidden > 0.02)).sum() / max(free.sum(), 1e-9))
        # before what is as bright as itself a ball has no rim
        near = np.hypot(xx - x, yy - y) < 0.6 * d
        blind = near.any() and np.mean(np.abs(scene[near].mean(axis=1) - ball) < 0.4 * abs(wall - ball)) > 0.1
        seen[i] = not blind and covered < 0.02 and 0.7 * d < x < W - 0.7 * d and 0.7 * d < y < H - 0.7 * d
        picture = cv2.GaussianBlur(picture, (0, 0), LENS) + rng.normal(0.0, noise, (H, W, 1))
        frames.append(np.clip(np.rint(picture), 0, 255).astype(np.uint8))
    return Clip(kind, truth, seen, d, ball < wall, np.array(frames), crf)


def write(path: Path, frames: np.ndarray, crf: int) -> None:
    """Code frames (n, H, W, 3) by x264."""
    options = {"crf": str(crf), "preset": "medium", "threads": "1"}
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=60, options=options)
        stream.height, stream.width, stream.pix_fmt = H, W, "yuv420p"
        stream.thread_count = 1
        for image in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")))
        container.mux(stream.encode())


def same_rows(whole: dict, cut: dict) -> bool:
    """Whether the rows of a cut film are those of the whole, but for LAG at its end."""
    n = len(cut["flag"]) - LAG
    good = whole["flag"][:n] == ""
    if (good != (cut["flag"][:n] == "")).any():
        return False
    off = np.maximum(np.abs(whole["x"][:n] - cut["x"][:n]), np.abs(whole["y"][:n] - cut["y"][:n]))[good]
    return bool((off < CHANGED * whole["sigma"][:n][good]).all())


def tracked(path: str, **how: object) -> dict:
    """Columns of the track that the tree on the path gives, with the processor time that it took [s]."""
    from jumpvision.films.arrays.track import track

    began = time.process_time()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        t = track(path, **how)
    return {
        "x": t.x_px.to_numpy(),
        "y": t.y_px.to_numpy(),
        "sigma": t.sigma_px.to_numpy(),
        "flag": t.flag.to_numpy().astype(str),
        "time": time.process_time() - began,
    }


def tracks_of(folder: Path) -> list[dict]:
    """The tracks of every film of a folder: unclicked, clicked, and of its parts where there are some."""
    paths, out = sorted(folder.glob("*.pickle")), []
    tracked(str(paths[0].with_suffix(".mp4")))  # compiled before the clock starts
    for path in paths:
        c = pickle.loads(path.read_bytes())
        how = {"polarity": "dark" if c["dark"] else "bright"}
        if c["number"] % 2:
            how["diameter"] = c["d"]
        click = tuple(c["truth"][0] + np.array([0.2, -0.15]) * c["d"])
        film = str(path.with_suffix(".mp4"))
        made = {"unclicked": tracked(film, **how), "clicked": tracked(film, **how, seed=click)}
        made["cuts"] = [tracked(str(p), **how) for p in sorted(folder.glob(path.stem + "_*.mp4"))]
        out.append(made)
    return out


@dataclass
class Rows:
    """Of one track, in its first frames: good, hit (n,) bool, error (n, 2) [px], sigma (n,) [px]."""

    good: np.ndarray
    hit: np.ndarray
    error: np.ndarray
    sigma: np.ndarray


def rows_of(c: dict, t: dict) -> Rows:
    """The rows of a track beside the truth of its clip; a hit is near the ball where it is seen."""
    n = min(len(c["truth"]), len(t["flag"]))
    error = np.stack([t["x"][:n], t["y"][:n]], axis=1) - c["truth"][:n]
    good = t["flag"][:n] == ""
    return Rows(good, good & c["seen"][:n] & (np.hypot(*error.T) < 0.3 * c["d"]), error, t["sigma"][:n])


def counts(c: dict, made: dict, other: dict, each: bool) -> list[float]:
    """What a row of the table is summed from, of one clip. other: the tracks of another tree, or the same."""
    out: list[float] = []
    for how in ("unclicked", "clicked"):
        r, s = rows_of(c, made[how]), rows_of(c, other[how])
        seen = c["seen"][: len(r.good)]
        false = r.good & ~(np.hypot(*r.error.T) < 0.5 * c["d"])
        inside, both = np.abs(r.error[r.hit]) < r.sigma[r.hit][:, None], r.hit & s.hit
        out += [float(r.hit[seen].mean() >= 0.9), false.sum(), r.good.sum(), inside.sum(), inside.size]
        out += [
            float((r.error[r.hit] ** 2).sum()),
            float((r.error[both] ** 2).sum()),
            2 * both.sum(),
            made[how]["time"],
        ]
        if each:
            why = sorted({str(f)[:40] for f in made[how]["flag"][: len(seen)][seen & ~r.good]})[:3]
            cover_, rms = inside.mean() if inside.size else math.nan, math.sqrt(out[-4] / max(inside.size, 1))
            print(
                f"{c['kind']:10s} {c['number']} {how:9s} d {c['d']:4.1f} crf {c['crf']} hit {r.hit[seen].mean():4.0%} "
                f"false {false.sum():2d} cover {cover_:4.2f} rms {rms:5.3f} {why}"
            )
    same = [same_rows(made["unclicked"], cut) for cut in made["cuts"]]
    return [*out, float(bool(same) and all(same)), float(bool(same))]


def judged(clips: list[dict], tracks: list[dict], others: list[dict], each: bool) -> None:
    """Print a table of kinds and of all."""
    table: dict[str, list[list[float]]] = {}
    for c, made, other in zip(clips, tracks, others, strict=True):
        table.setdefault(c["kind"], []).append(counts(c, made, other, each))
    print("| kind | films | found | clicked | false rows | cover | rms px | shared | cuts | s |")
    print("|---|---|---|---|---|---|---|---|---|---|")
    every = [row for rows in table.values() for row in rows]
    for kind, part in [*table.items(), ("all", every)]:
        a = np.sum(part, axis=0)
        values, both = max(a[4] + a[13], 1), max(a[7] + a[16], 1)
        print(
            f"| {kind} | {len(part)} | {a[0]:.0f} | {a[9]:.0f} | {a[1] + a[10]:.0f} of {a[2] + a[11]:.0f} "
            f"| {(a[3] + a[12]) / values:.2f} | {math.sqrt((a[5] + a[14]) / values):.3f} "
            f"| {math.sqrt((a[6] + a[15]) / both):.3f} | {a[18]:.0f} of {a[19]:.0f} | {a[8] + a[17]:.1f} |",
            flush=True,
        )


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--films", type=int, default=3, help="of each kind; the first two are cut, too")
    parser.add_argument("--kinds", default=",".join(KINDS))
    parser.add_argument("--against", help="another source tree that gets the same films")
    parser.add_argument("--each", action="store_true", help="a line a film")
    parser.add_argument("--of", type=Path, help="folder of films; the tracks are written to tracks.pkl there")
    a = parser.parse_args()
    if a.of:
        (a.of / "tracks.pkl").write_bytes(pickle.dumps(tracks_of(a.of)))
        return
    with tempfile.TemporaryDirectory() as name:
        folder, clips = Path(name), []
        for kind in a.kinds.split(","):
            for number in range(a.films):
                c = clip(kind, number, a.seed)
                stem = f"{list(KINDS).index(kind):02d}-{number}"
                write(folder / f"{stem}.mp4", c.frames, c.crf)
                for share in (0.6, 0.8) if number < 2 else ():
                    write(folder / f"{stem}_{share}.mp4", c.frames[: int(share * len(c.frames))], c.crf)
                facts = {k: v for k, v in vars(c).items() if k != "frames"} | {"number": number}
                (folder / f"{stem}.pickle").write_bytes(pickle.dumps(facts))
                clips.append(facts)
        trees = [os.getcwd(), *([a.against] if a.against else [])]
        tracks = []
        for tree in trees:
            command = [sys.executable, os.path.abspath(__file__), "--of", name]
            subprocess.run(command, check=True, cwd=tree, env=os.environ | {"PYTHONPATH": tree})
            tracks.append(pickle.loads((folder / "tracks.pkl").read_bytes()))
        for tree, made, other in zip(trees, tracks, tracks[::-1], strict=True):
            print(f"\n{tree}")
            judged(clips, made, other, a.each)


if __name__ == "__main__":
    main()
