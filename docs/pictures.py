"""Make the pictures of docs/images: `python docs/pictures.py [NAME ...]`, some minutes for all."""

from __future__ import annotations

import io
import math
import os
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
from PIL import Image

from jumpvision.cli import main as command
from jumpvision.films.vision.ball.film import FilmTracker
from jumpvision.films.vision.ball.track import BallSettings
from jumpvision.laboratory import recordings as logs
from jumpvision.laboratory import write
from jumpvision.laboratory.jumper import Law, motion_of
from jumpvision.laboratory.samples import HARD_ROBOT
from jumpvision.report.figures.pictures import png
from jumpvision.report.style import MEASURED, MODEL, styled
from jumpvision.sweeps.comparison import compare
from jumpvision.sweeps.figures import sweep_figure

os.environ.setdefault("OMP_NUM_THREADS", "1")
ROOT = Path(__file__).parents[1]
IMAGES = Path(__file__).with_name("images")
HIDDEN = {"e": 0.1}  # landing loss that the model of the comparison's campaign does not know
PAGE_PX = 1000  # of a page of the site


# -- pictures of jumps ----------------------------------------------------------------------------------------------
def comparison() -> bytes:
    """Forty jumps of the laboratory against the model that does not know HIDDEN."""
    with tempfile.TemporaryDirectory() as place:
        folder = campaign(Path(place) / "campaign")
        data = compare("hard", folder, Path(place) / "results", say=lambda text: None)
    with styled() as new:
        return png(sweep_figure(data, new))


def campaign(folder: Path) -> Path:
    """Tracks of forty jumps of the laboratory, on scattered frequencies and phases, with HIDDEN in force."""
    rng = np.random.default_rng(20140630)
    folder.mkdir()
    robot = {n: round(v, 9) for n, v in HARD_ROBOT._asdict().items()}
    sigma = {"spring_stiffness": 30.0, "spring_damping": 0.1, "gravity": 0.01}
    write.toml(folder / "campaign.toml", {"ground": "hard", "robot": robot, "robot.sigma": sigma})
    laws = zip(rng.uniform(6.0, 17.0, 40), rng.uniform(0.35 * math.pi, 1.7 * math.pi, 40))
    for i, (f, phase) in enumerate(laws):
        law = Law(round(float(f), 2), 0.004, round(float(phase), 3), 0.2)
        motion = motion_of(HARD_ROBOT, law, ["landing_loss"], HIDDEN, ground="hard", duration=1.0, dt=5e-6, every=20)
        own = folder / f"jump-{i:02d}"
        own.mkdir()
        write.table(own / "rod.csv", logs.rod_track(motion, rate=200.0, noise=5e-5, zero=0.0, rng=rng))
        text = {"kind": "sine", "frequency": law.frequency, "amplitude": 0.004, "phase": law.phase, "start": 0.2}
        write.toml(own / "experiment.toml", {"actuation": text, "rod_track": {"file": "rod.csv"}})
    return folder


def candidates() -> bytes:
    """Two throws that are one outline for a while, and glints: all candidates, and the track of the ball clicked."""
    rng, i, d = np.random.default_rng(4), np.arange(30.0), 16.0
    rise, column, row = 0.35 * i**2, np.arange(330), np.arange(240)[:, None]
    ours, other = (30.0 + 8.0 * i, 190.0 - 10.0 * i + rise), (52.5 + 5.5 * i, 199.0 - 11.0 * i + rise)
    frames = []
    for k in range(i.size):
        picture = 70.0 + 12.0 * (np.sin(0.11 * column) * np.cos(0.09 * row) > 0.6)
        for x, y in (ours, other):
            share = 0.5 - 0.5 * np.tanh((np.hypot(column - x[k], row - y[k]) - 0.5 * d) / 0.9)
            picture = picture + share * (210.0 - picture)
        for _ in range(3):
            picture[np.hypot(column - rng.uniform(20, 310), row - rng.uniform(20, 220)) < rng.uniform(3, 5)] = 150.0
        frames.append(np.clip(np.rint(picture + rng.normal(0, 1.5, picture.shape)), 0, 255).astype(np.uint8))
    follower = FilmTracker(BallSettings(d, "bright", "disc", 1.5, (ours[0][0], ours[1][0]), False, 0.0), scene=True)
    for frame in frames:
        follower.see(frame)
    track = follower.finish(frames)[0]
    with styled() as new:
        figure = new(figsize=(10.0, 3.6), layout="constrained")
        axes = figure.subplots(1, 2)
        axes[0].grid(visible=False)
        axes[0].imshow(np.max(frames, axis=0), cmap="gray", vmin=40, vmax=255)
        for k in range(i.size):
            x, y, _, p = np.array(follower.candidates(k)).T
            for ax, u, v in ((axes[0], x, y), (axes[1], np.full(x.size, k), x)):
                ax.scatter(u, v, s=9 + 40 * p, facecolors="none", edgecolors=MODEL, linewidths=0.8)
        axes[0].plot(track.x, track.y, ".", color=MEASURED, ms=4)
        axes[1].plot(i, track.x, ".-", color=MEASURED, ms=4, label="rows that are sure")
        axes[1].scatter([], [], facecolors="none", edgecolors=MODEL, label="candidates, larger: likelier")
        axes[0].set(xlabel="column [px]", ylabel="row [px]", title="all frames in one")
        axes[1].set(xlabel="frame", ylabel="column [px]", title="one outline in frames 3 to 15")
        axes[1].legend()
        return png(figure)


def planning() -> bytes:
    """Motor against time of the plans for 20 to 60 mm on both grounds, and a landing that sticks (Figs 65, 66)."""
    import matplotlib as mpl

    sys.path.append(str(ROOT))
    from jumpvision.jumper.planning.plan import Planner
    from jumpvision.sweeps.plan import rigid
    from tests.worlds.plans import LIMITS, LOOP, SAND

    with styled() as new:
        figure = new(figsize=(10.0, 6.0), layout="constrained")
        axes = figure.subplots(2, 3)
        for row, objective in zip(axes, ("effort", "power")):
            for axis, model in zip(row, (rigid(SAND), SAND)):
                planner = Planner(model, LOOP, LIMITS, objective)
                for i, apex in enumerate((0.02, 0.03, 0.04, 0.05, 0.06)):
                    plan = planner.plan(apex)
                    t = np.linspace(0.0, plan.command.stop, 400)
                    X = np.interp(t, plan.motion.t, plan.motion.motor - plan.motion.rod)
                    axis.plot(1e3 * t, 1e3 * X, color=mpl.colormaps["viridis"](i / 5), label=f"{1e3 * apex:.0f} mm")
                axis.set(title=f"{model.ground} ground, least {objective}", xlabel="time [ms]")
            row[0].set_ylabel("motor on the rod [mm]")
        axes[0, 0].legend(fontsize=7)
        for motion, color in (("single", MODEL), ("stick", MEASURED)):
            m = Planner(rigid(SAND), LOOP, LIMITS, motion=motion).plan(0.04).motion
            show = m.t < 0.7  # s: the landing and a second of standing are seen
            axes[0, 2].plot(1e3 * m.t[show], 1e3 * (m.rod - m.rest)[show], color=color, label=motion)
            axes[1, 2].plot(1e3 * m.t[show], 1e3 * (m.motor - m.rod)[show], color=color)
        axes[0, 2].set(title="hard ground: rod over rest [mm]", xlabel="time [ms]")
        axes[1, 2].set(title="motor on the rod [mm]", xlabel="time [ms]")
        axes[0, 2].legend(fontsize=7)
        return png(figure)


# -- pictures that a command makes -----------------------------------------------------------------------------------
def picture_of_command(words: str) -> bytes:
    """Return the picture that a command writes."""
    with tempfile.TemporaryDirectory() as place:
        done([*words.split(), "--results", place, "--workers", "1", "--json"])
        (file,) = Path(place).glob("*.png")
        return file.read_bytes()


def done(words: list[str]) -> None:
    """Runs a command of jumpvision; what it says is left out."""
    said, sys.stdout = sys.stdout, io.StringIO()
    try:
        code = command(words)
    finally:
        sys.stdout = said
    if code:
        raise SystemExit(f"jumpvision {' '.join(words)}: exit {code}")


def picture_of_samples(file: str) -> bytes:
    """Return a picture of the samples' results, which are computed in results/loose_sand (what is there is kept)."""
    from jumpvision.report.figures.diagnosis import heights

    results = ROOT / "results" / "loose_sand"
    done(["run", str(ROOT / "data_samples" / "loose_sand"), "--results", str(results), "--json"])
    if file != "heights.png":
        return (results / file).read_bytes()
    table = pd.read_csv(results / "jumps.csv")
    with styled() as new:
        return png(heights(table.astype(object).where(table.notna(), None).to_dict("records"), new))


# -- pages in a browser ----------------------------------------------------------------------------------------------
def picture_of_page(shoot: Callable[[Any], bytes]) -> bytes:
    """Return a screenshot that `shoot` takes in a browser."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as p:
        path = os.environ.get("JUMPVISION_CHROMIUM")
        browser = p.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
        try:
            return shoot(browser)
        finally:
            browser.close()


def until(page: Any, condition: str) -> None:
    """Waits for a condition in JavaScript, 60 s at most."""
    for _ in range(2000):
        if page.evaluate(condition):
            return
        page.wait_for_timeout(30)
    raise SystemExit(f"the page never came to: {condition}")


@contextmanager
def opened(browser: Any, server: Any, width: int, height: int) -> Iterator[Any]:
    """A page of a server in the browser, its window as large as asked for."""
    threading.Thread(target=server.serve_forever, daemon=True).start()
    context = browser.new_context(viewport={"width": width, "height": height}, reduced_motion="reduce")
    page = context.new_page()
    page.goto(server.address)
    try:
        yield page
    finally:
        context.close()
        server.close()


def demo(browser: Any) -> bytes:
    """The interactive jumper on sand."""
    from jumpvision.browser.demo.server import Server

    with opened(browser, Server(0), 1280, 800) as page:
        page.locator("input[value=granular]").check(force=True)
        until(page, "document.querySelector('#map-note').textContent === '36 × 36 jumps'")  # drawn finer and finer
        page.wait_for_timeout(500)
        return page.screenshot(full_page=True)


def workbench(browser: Any) -> bytes:
    """The sample on hard ground, tracked, at the third step."""
    from jumpvision.browser.workbench.server import Server

    with opened(browser, Server(ROOT / "data_samples" / "hard_ground", 0), 1280, 800) as page:
        until(page, "!!window.workbench?.ready && workbench.store.looked")
        page.keyboard.press("t")
        until(page, "workbench.store.track.finished && !workbench.store.track.running")
        page.keyboard.press("3")
        page.keyboard.press("Home")
        for _ in range(130):  # to a landing
            page.keyboard.press("ArrowRight")
        page.wait_for_timeout(1500)
        return page.screenshot()


PICTURES: dict[str, tuple[Callable[[], bytes], int]] = {  # what makes it, and its width [px]; 0: as drawn
    "hard_map": (partial(picture_of_command, "sweep hard"), PAGE_PX),
    "hard_comparison": (comparison, PAGE_PX),
    "candidates": (candidates, PAGE_PX),
    "planning": (planning, 0),
    "dem_hexagonal": (partial(picture_of_command, "dem --bed hexagonal --beds 1"), 0),
    "heights": (partial(picture_of_samples, "heights.png"), 0),
    "diagnosis": (partial(picture_of_samples, "diagnosis.png"), 0),
    "demo_sand": (partial(picture_of_page, demo), 1100),
    "workbench": (partial(picture_of_page, workbench), 0),
}


def shrink(made: bytes, width: int) -> bytes:
    """Return a PNG in a width [px] and 256 colours."""
    image = Image.open(io.BytesIO(made)).convert("RGB")
    if width:
        image = image.resize((width, round(image.height * width / image.width)), Image.Resampling.LANCZOS)
    out = io.BytesIO()
    image.quantize(256, dither=Image.Dither.NONE).save(out, "png", optimize=True)
    return out.getvalue()


def main(names: list[str]) -> None:
    """Make the pictures named, or all."""
    if unknown := [n for n in names if n not in PICTURES]:
        raise SystemExit(f"no such picture: {', '.join(unknown)}; there are {', '.join(PICTURES)}")
    for name in names or PICTURES:
        make, width = PICTURES[name]
        (IMAGES / f"{name}.png").write_bytes(shrink(make(), width))


if __name__ == "__main__":
    main(sys.argv[1:])
