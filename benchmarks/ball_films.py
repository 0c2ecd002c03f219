"""Ball tracker on whole films: speed against decoding alone, and losses in random scenes with their truth.

Films are 640 x 480, 8 bits, a textured scene, noise 3 grey, a ball of 19 px. Seconds are processor time.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path
from typing import Any

import av
import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from benchmarks.ball import BACK, CONTRAST, disc_image
from jumpvision.films.frames import open_frames
from jumpvision.films.vision.ball.film import FilmTracker, track_film
from jumpvision.films.vision.ball.track import BallSettings

SHAPE, D, N = (480, 640), 19.0, 600
PERIOD = 200  # frames drawn; the film repeats them
CODECS: dict[str, tuple[str, str, dict[str, str]]] = {
    "ffv1.avi": ("ffv1", "gray", {}),
    "png.avi": ("png", "gray", {}),
    # by rate factor: from 18 on most of the noise is smoothed away, and a frame is decoded in no time
    **{f"h264_crf{crf}.mp4": ("libx264", "yuv420p", {"crf": str(crf)}) for crf in (0, 12, 18, 23, 30)},
}


def settings(**change: Any) -> BallSettings:
    plain = {
        "diameter": D, "polarity": "bright", "method": "disc", "search": 1.5, "seed": None, "streak": False,
        "exposure_fraction": 0.0,
    }  # fmt: skip
    return BallSettings(**(plain | change))


def placed(shape: tuple[int, int], x: float, y: float, d: float) -> NDArray[np.float64]:
    """Part of each pixel that is ball; only its surroundings are rendered."""
    m = int(d / 2 + 6)
    out = np.zeros((shape[0] + 4 * m, shape[1] + 4 * m))
    x0, y0 = round(x) - m, round(y) - m
    if -2 * m < x0 < shape[1] and -2 * m < y0 < shape[0]:
        at = np.s_[y0 + 2 * m : y0 + 4 * m + 1, x0 + 2 * m : x0 + 4 * m + 1]
        out[at] = disc_image((2 * m + 1, 2 * m + 1), x - x0, y - y0, d)
    return out[2 * m : -2 * m, 2 * m : -2 * m]


def speeds() -> None:
    rng = np.random.default_rng(1)
    scene = BACK + 50 * gaussian_filter(rng.normal(size=SHAPE), 3.0)
    k = np.arange(N)
    xs, ys = np.full(N, 320.3), 100 + 250 * np.abs(np.sin(3 * np.pi * k / PERIOD))
    frames = []
    for x, y in zip(xs[:PERIOD], ys):
        part = placed(SHAPE, x, y, D)
        image = scene * (1 - part) + (BACK + CONTRAST) * part + rng.normal(0, 3, SHAPE)
        frames.append(np.clip(np.rint(image), 0, 255).astype(np.uint8))
    frames *= N // PERIOD
    track_film(frames[:40], settings(), scene=True)  # compiled before the clock starts
    print("| film | reading or decoding alone, frames/s | tracked, frames/s | ratio | RMS about the truth, px |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for bits in (8, 12):
            write_mraw(Path(folder) / f"{bits}bit.mraw", frames, bits)
        for name, kind in CODECS.items():
            write_film(Path(folder) / name, frames, *kind)
        rows = []
        for path in sorted(Path(folder).glob("*.[mah][rvp]*")):
            alone, ours = np.median([[seconds(f, path) for f in (decode, tracked)] for _ in range(5)], axis=0)
            error = np.nanstd(np.concatenate([v - t for v, t in zip(tracked(path), (xs, ys))]))
            text = f"| {path.name} | {N / alone:.0f} | {N / ours:.0f} | {alone / ours:.2f} | {error:.4f} |"
            rows.append((alone / ours, text))
        print("\n".join(text for _, text in sorted(rows)), flush=True)  # the worst first


def seconds(work: Any, path: Path) -> float:
    began = time.process_time()
    work(path)
    return time.process_time() - began


def tracked(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    follower = FilmTracker(settings(), scene=True)
    with open_frames(path, seen=follower.see) as film:
        track = follower.finish(film) if film.shown else track_film(film, settings(), scene=True)
    return track[0].x, track[0].y


def decode(path: Path) -> None:
    if path.suffix == ".mraw":
        with open_frames(path) as film:
            for _ in film:
                pass
        return
    with av.open(str(path)) as container:
        container.streams.video[0].thread_type = "AUTO"
        for _ in container.decode(video=0):
            pass


def write_film(path: Path, frames: list[NDArray[np.uint8]], codec: str, pixels: str, options: dict[str, str]) -> None:
    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream(codec, rate=200, options=options)
        stream.height, stream.width = SHAPE
        stream.pix_fmt = pixels
        for image in frames:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="gray")))
        container.mux(stream.encode())


def write_mraw(path: Path, frames: list[NDArray[np.uint8]], bits: int) -> None:
    data = np.stack(frames)
    if bits == 12:
        v = data.astype(np.uint16).reshape(-1, 2) * 16
        data = np.stack([v[:, 0] >> 4, (v[:, 0] & 15) << 4 | v[:, 1] >> 8, v[:, 1] & 255], 1).astype(np.uint8)
    data.tofile(path)
    path.with_suffix(".cih").write_text(
        f"Record Rate(fps) : 200\nTotal Frame : {N}\nImage Width : {SHAPE[1]}\nImage Height : {SHAPE[0]}\n"
        f"Color Type : Mono\nColor Bit : {bits}\nFile Format : MRaw\n"
    )


def losses(scenes: int) -> None:
    """`scenes` of each kind: frames given as good that are off by more than a tenth of the ball are silent losses."""
    rng = np.random.default_rng(3)
    print("\n| scene | scenes | frames flagged | silent losses | largest error of a good frame, diameters |")
    print("|---|---|---|---|---|")
    shape, n = (190, 161), 24
    rows = np.indices(shape)[0]
    for kind in ("clutter", "occlusion", "second ball", "out of frame"):
        flagged = silent = 0
        worst = 0.0
        for _ in range(scenes):
            d, k = float(rng.uniform(11, 26)), np.arange(n)
            xs = 60 + rng.uniform(-1.0, 1.5) * k
            ys = 40 + (rng.uniform(7, 9) * k if kind == "out of frame" else 4.0 * k - 0.02 * k**2)
            texture = gaussian_filter(rng.normal(size=shape), rng.uniform(2.0, 5.0))
            back = BACK + (25.0 if kind == "clutter" else 5.0) * texture / texture.std()
            bar = 85 + rng.uniform(-10, 10), rng.uniform(0.3, 0.7) * d, float(rng.choice([35.0, 190.0]))
            images = []
            for i in k:
                part = placed(shape, xs[i], ys[i], d)
                image = back * (1 - part) + (BACK + CONTRAST) * part
                if kind == "occlusion":
                    image = np.where(np.abs(rows - bar[0]) < bar[1], bar[2], image)
                elif kind == "second ball":
                    other = placed(shape, 60 + 9.0 * (i - 11), ys[11] + 0.3 * d, d)
                    image = image * (1 - other) + (BACK + CONTRAST) * other
                images.append(np.clip(np.rint(image + rng.normal(0, 3, shape)), 0, 255).astype(np.uint8))
            t = track_film(images, settings(diameter=d, search=2.0, seed=(xs[0], ys[0])), scene=False)[0]
            error = np.hypot(t.x - xs, t.y - ys)[t.flag == ""] / d
            flagged += int(np.count_nonzero(t.flag != ""))
            silent += int(np.count_nonzero(error > 0.1))
            worst = max(worst, float(error.max(initial=0.0)))
        print(f"| {kind} | {scenes} | {flagged} of {scenes * n} | {silent} | {worst:.3f} |", flush=True)


if __name__ == "__main__":
    speeds()
    losses(50)
