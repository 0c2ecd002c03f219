"""Make every picture of docs/images: `python docs/pictures.py [NAME ...]`, some minutes for all; `--stale`: the stale.

Beside the pictures stands inputs.json: of each file its SHA-256, and what it was made from, by which
tests/test_pictures.py finds the stale ones: numbers and words of a small copy of the figure (fewer points, the same
code); of the results of the samples the versions of the stages; of a page in the browser its HTML and style.
"""

from __future__ import annotations

import hashlib
import io
import json
import math
import os
import re
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from matplotlib.collections import Collection, QuadMesh
from matplotlib.figure import Figure
from PIL import Image

from jumpvision.cli import main as command
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
INPUTS = IMAGES / "inputs.json"
HIDDEN = {"e": 0.1}  # landing loss that the model of the comparison's campaign does not know
WIDTH = 1000  # px of the pictures of hard ground: that of a page
STAGES = ("track", "rod", "bed", "piv", "flow", "column", "fit", "simulate", "summary")  # of the samples' heights


class Picture(NamedTuple):
    """make(few): draws the figure, of few points or all, and gives the PNG; inputs(): what it is made from, as JSON."""

    make: Callable[[bool], bytes]
    inputs: Callable[[], Any]
    colours: int = 0  # of its palette; 0: all
    width: int = 0  # px; 0: as drawn


# -- what a figure draws ---------------------------------------------------------------------------------------------
@contextmanager
def figures_made() -> Iterator[list[Figure]]:
    """Every figure that is made meanwhile."""
    found: list[Figure] = []
    whole = Figure.__init__

    def kept(self: Figure, *args: Any, **given: Any) -> None:
        whole(self, *args, **given)
        found.append(self)

    Figure.__init__ = kept  # type: ignore[method-assign]
    try:
        yield found
    finally:
        Figure.__init__ = whole  # type: ignore[method-assign]


def moments(*arrays: Any) -> list[float]:
    """Count, then mean and rms of each array without what is not finite, to four digits."""
    out = [float(np.size(arrays[0]))]
    for a in arrays:
        a = np.ma.filled(np.ma.asarray(a, float), np.nan)
        a = a[np.isfinite(a)]
        out += [float(f"{v:.4g}") for v in (a.mean(), math.sqrt((a**2).mean()))] if a.size else [0.0, 0.0]
    return out


def drawn(figure: Figure) -> list[dict[str, Any]]:
    """Of each panel its words, and the moments of its lines, maps and markers."""
    out = []
    for axes in figure.axes:
        words = [axes.get_title(loc="left"), axes.get_title(), axes.get_xlabel(), axes.get_ylabel()]
        words += [t.get_text() for t in (*axes.texts, *(axes.get_legend().texts if axes.get_legend() else ()))]
        data = [moments(line.get_xdata(), line.get_ydata()) for line in axes.lines]
        for c in axes.collections:
            data.append(moments(c.get_array() if isinstance(c, QuadMesh) else vertices(c)))
        data += [moments(i.get_array()) for i in axes.images]
        out.append({"words": " | ".join(w for w in words if w), "data": data})
    return out


def vertices(c: Collection) -> np.ndarray:
    """Of markers their places, of filled bands their corners."""
    places = np.ma.asarray(c.get_offsets())
    return places if places.size > 2 else np.concatenate([np.ravel(p.vertices) for p in c.get_paths()] or [[0.0]])


def of_small_copy(make: Callable[[bool], bytes]) -> Callable[[], Any]:
    """What the figures of few points draw."""

    def inputs() -> Any:
        with figures_made() as found:
            make(True)
        return [drawn(f) for f in found]

    return inputs


def differs(was: Any, now: Any, where: str = "") -> str:
    """Where two inputs differ by more than 0.2 % of a number or by a word; "" where they do not.

    Four digits are kept, so numbers within half of the fourth are alike; other machines change the last of sixteen.
    """
    if isinstance(was, float | int) and isinstance(now, float | int):
        return "" if abs(was - now) <= 2e-3 * max(abs(was), abs(now)) + 1e-9 else f"{where}: {was} is now {now}"
    if isinstance(was, str) and isinstance(now, str):
        old, new = (re.split(r"(\d+\.?\d*)", t) for t in (was, now))
        same = (
            old[::2] == new[::2]
            and all(  # a number in words may round the other way
                abs(float(a) - float(b)) <= 1.001 * 10.0 ** -len(a.partition(".")[2])
                for a, b in zip(old[1::2], new[1::2])
            )
        )
        return "" if same else f"{where}: {was!r} is now {now!r}"
    if isinstance(was, dict) and isinstance(now, dict) and was.keys() == now.keys():
        return next(filter(None, (differs(was[k], now[k], f"{where} {k}") for k in was)), "")
    if isinstance(was, list) and isinstance(now, list) and len(was) == len(now):
        return next(filter(None, (differs(a, b, f"{where} {i}") for i, (a, b) in enumerate(zip(was, now)))), "")
    return f"{where}: {str(was)[:80]} is now {str(now)[:80]}"


# -- pictures of jumps ----------------------------------------------------------------------------------------------
def comparison(few: bool) -> bytes:
    """Forty jumps of the laboratory against the model that does not know HIDDEN."""
    with tempfile.TemporaryDirectory() as place:
        folder = campaign(Path(place) / "campaign", 3 if few else 40)
        data = compare("hard", folder, Path(place) / "results", say=lambda text: None)
    with styled() as new:
        figure = sweep_figure(data, new)
        return b"" if few else png(figure)


def campaign(folder: Path, n: int) -> Path:
    """Tracks of n jumps of the laboratory, on scattered frequencies and phases, with HIDDEN in force."""
    rng = np.random.default_rng(20140630)
    folder.mkdir()
    robot = {n: round(v, 9) for n, v in HARD_ROBOT._asdict().items()}
    sigma = {"spring_stiffness": 30.0, "spring_damping": 0.1, "gravity": 0.01}
    write.toml(folder / "campaign.toml", {"ground": "hard", "robot": robot, "robot.sigma": sigma})
    laws = zip(rng.uniform(6.0, 17.0, 40), rng.uniform(0.35 * math.pi, 1.7 * math.pi, 40))
    for i, (f, phase) in zip(range(n), laws):
        law = Law(round(float(f), 2), 0.004, round(float(phase), 3), 0.2)
        motion = motion_of(HARD_ROBOT, law, ["landing_loss"], HIDDEN, ground="hard", duration=1.0, dt=5e-6, every=20)
        own = folder / f"jump-{i:02d}"
        own.mkdir()
        write.table(own / "rod.csv", logs.rod_track(motion, rate=200.0, noise=5e-5, zero=0.0, rng=rng))
        text = {"kind": "sine", "frequency": law.frequency, "amplitude": 0.004, "phase": law.phase, "start": 0.2}
        write.toml(own / "experiment.toml", {"actuation": text, "rod_track": {"file": "rod.csv"}})
    return folder


def planning(few: bool) -> bytes:
    """Motor against time of the plans for 20 to 60 mm on both grounds, and a landing that sticks (Figs 65, 66)."""
    import matplotlib as mpl

    sys.path.append(str(ROOT))
    from jumpvision.jumper.planning.plan import Planner
    from jumpvision.sweeps.plan import rigid
    from tests.worlds.plans import LIMITS, LOOP, SAND

    ladder = (0.03, 0.04) if few else (0.02, 0.03, 0.04, 0.05, 0.06)
    with styled() as new:
        figure = new(figsize=(10.0, 6.0), layout="constrained")
        axes = figure.subplots(2, 3)
        for row, objective in zip(axes, ("effort", "power")):
            for axis, model in zip(row, (rigid(SAND), SAND)):
                planner = Planner(model, LOOP, LIMITS, objective)
                for i, apex in enumerate(ladder):
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
        return b"" if few else png(figure)


# -- pictures that a command makes -----------------------------------------------------------------------------------
def of_command(words: str, few_words: str, colours: int = 0, width: int = 0) -> Picture:
    """The picture that a command writes, with other options for few points."""

    def make(few: bool) -> bytes:
        with tempfile.TemporaryDirectory() as place:
            asked = [*(few_words if few else words).split(), "--results", place, "--workers", "1", "--json"]
            done(asked)
            (file,) = Path(place).glob("*.png")
            return file.read_bytes()

    return Picture(make, of_small_copy(make), colours, width)


def done(words: list[str]) -> None:
    """Runs a command of jumpvision; what it says is left out."""
    said, sys.stdout = sys.stdout, io.StringIO()
    try:
        code = command(words)
    finally:
        sys.stdout = said
    if code:
        raise SystemExit(f"jumpvision {' '.join(words)}: exit {code}")


def of_samples(file: str) -> Picture:
    """A picture of the samples' results, which are computed for it in results/loose_sand (what is there is kept)."""
    results = ROOT / "results" / "loose_sand"

    def make(few: bool) -> bytes:
        from jumpvision.report.figures.diagnosis import heights

        done(["run", str(ROOT / "data_samples" / "loose_sand"), "--results", str(results), "--json"])
        if file != "heights.png":
            return (results / file).read_bytes()
        table = pd.read_csv(results / "jumps.csv")
        with styled() as new:
            return png(heights(table.astype(object).where(table.notna(), None).to_dict("records"), new))

    def inputs() -> Any:
        from jumpvision.experiment.campaign.diagnose import VERSION
        from jumpvision.experiment.workflow.stage import stage_named

        truth = hashlib.sha256((ROOT / "data_samples" / "loose_sand" / "truth.json").read_bytes()).hexdigest()
        asked = {"diagnose": VERSION} if file == "diagnosis.png" else {}
        return {"samples": truth} | {name: stage_named(name).version for name in STAGES} | asked

    return Picture(make, inputs, colours=256)


# -- pages in a browser ----------------------------------------------------------------------------------------------
def of_page(wing: str, shoot: Callable[[Any], bytes], width: int = 0) -> Picture:
    """A screenshot of a page, shrunk to a width [px]; its inputs are the HTML and style of the page."""
    static = ROOT / "jumpvision" / "browser" / wing / "static"

    def make(few: bool) -> bytes:
        from playwright.sync_api import sync_playwright

        with sync_playwright() as p:
            path = os.environ.get("JUMPVISION_CHROMIUM")
            browser = p.chromium.launch(executable_path=path, args=["--no-sandbox", "--disable-gpu"])
            try:
                return shoot(browser)
            finally:
                browser.close()

    def inputs() -> Any:
        return {f: hashlib.sha256((static / f).read_bytes()).hexdigest() for f in ("index.html", "style.css")}

    return Picture(make, inputs, 256, width)


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
        server.shutdown()
        server.server_close()


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


PICTURES: dict[str, Picture] = {
    "hard_map": of_command("sweep hard", "sweep hard --frequency 5:18:8 --phase 0:6.2:7", 256, WIDTH),
    "hard_comparison": Picture(comparison, of_small_copy(comparison), 256, WIDTH),
    "planning": Picture(planning, of_small_copy(planning)),
    "dem_hexagonal": of_command(
        "dem --bed hexagonal --beds 1",
        "dem --bed hexagonal --beds 1 --half-width 0.02 --depth 0.02 --foot 0.005 --stroke 0.003",
    ),
    "heights": of_samples("heights.png"),
    "diagnosis": of_samples("diagnosis.png"),
    "demo_sand": of_page("demo", demo, 1100),
    "workbench": of_page("workbench", workbench),
}


def small(picture: Picture, made: bytes) -> bytes:
    """A PNG in the width and the palette of its page."""
    image = Image.open(io.BytesIO(made)).convert("RGB")
    if picture.width:
        size = (picture.width, round(image.height * picture.width / image.width))
        image = image.resize(size, Image.Resampling.LANCZOS)
    if picture.colours:
        image = image.quantize(picture.colours, kmeans=4 if picture.width else 0, dither=Image.Dither.NONE)
    out = io.BytesIO()
    image.save(out, "png", optimize=True)
    return out.getvalue()


def known() -> dict[str, Any]:
    """What inputs.json says, by picture."""
    return json.loads(INPUTS.read_text(encoding="utf-8")) if INPUTS.exists() else {}


def stale(name: str) -> str:
    """Why a picture must be made anew, "" where it need not."""
    kept, file = known().get(name), IMAGES / f"{name}.png"
    if kept is None or not file.exists():
        return "it was never made by this command"
    if hashlib.sha256(file.read_bytes()).hexdigest() != kept["png"]:
        return "its file is not the one that was made"
    return differs(kept["inputs"], plain(PICTURES[name].inputs()))


def plain(inputs: Any) -> Any:
    """As JSON gives it back."""
    return json.loads(json.dumps(inputs))


def keep(name: str, made: bytes) -> None:
    """Write a picture and what it was made from."""
    picture = PICTURES[name]
    file = IMAGES / f"{name}.png"
    file.write_bytes(small(picture, made))
    found = known() | {name: {"png": hashlib.sha256(file.read_bytes()).hexdigest(), "inputs": picture.inputs()}}
    lines = ",\n".join(f"{json.dumps(n)}: {json.dumps(found[n], ensure_ascii=False)}" for n in sorted(found))
    INPUTS.write_text("{\n" + lines + "\n}\n", encoding="utf-8")


def main(words: list[str]) -> None:
    """The pictures named, or all, or those that are stale."""
    names = [w for w in words if w != "--stale"] or list(PICTURES)
    unknown = [n for n in names if n not in PICTURES]
    if unknown:
        raise SystemExit(f"no such picture: {', '.join(unknown)}; there are {', '.join(PICTURES)}")
    for name in names:
        why = stale(name) if "--stale" in words else "asked for"
        if why:
            print(f"docs/images/{name}.png: {why}", flush=True)
            keep(name, PICTURES[name].make(False))


if __name__ == "__main__":
    main(sys.argv[1:])
