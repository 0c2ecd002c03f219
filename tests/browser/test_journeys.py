"""Journeys through the workbench in a real browser: track, fit, flow, campaign, add; by pointer, keys and fingers."""

from __future__ import annotations

import csv
import io
import json
import math
import shutil
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pandas as pd
import pytest

from jumpvision.base.record import plain
from jumpvision.base.schema import InputError
from jumpvision.browser.workbench.adding import Adding
from jumpvision.browser.workbench.bench import Benches
from jumpvision.browser.workbench.draft import draft_of
from jumpvision.browser.workbench.flowing import Batch
from jumpvision.cli import main
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.stages.track import BallFilm
from tests.worlds.hand import AXE, Hand, opened, serious, serving, until
from tests.worlds.recorded import FILM, RATE, RULER, SCALE, G, double_exposures, drop, flow_film, two_pictures
from tests.worlds.results import STUDY, of_file, same, stage

SAMPLES = Path(__file__).parents[2] / "data_samples"
LONG = pytest.mark.long


def tree(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


def rows_of(text: str, delimiter: str = ",") -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text), delimiter=delimiter))


def differing(rows: list[dict[str, str]], table: dict[str, list]) -> list[str]:
    """Columns of a file that are not those of the page to the last digit."""

    def read(name: str) -> list:
        return [r[name] if name.startswith("flag") else float(r[name]) if r[name] else None for r in rows]

    return [name for name in rows[0] if read(name) != table.get(name)]


def reload(p: Hand) -> None:
    """Load the page anew: draft, step, frame, fit and track are there again."""
    state = """[workbench.store.draft, workbench.store.step, workbench.store.frame, workbench.store.track.rows,
        workbench.store.step === 'plot' && workbench.store.fit?.parameters.length]"""
    was = p.get(f"JSON.stringify({state})")
    p.again()
    p.until(f"JSON.stringify({state}) === {json.dumps(was)}")


# --- track ------------------------------------------------------------------------------------------------------------


def test_track(tmp_path, browser):
    """From a film of which nothing is known to g in ten clicks; page, clipboard, file and command line say the same.
    Whenever the page is loaded anew, all is there again; nothing new lies beside the film but results."""
    folder = tmp_path / "ball"
    drop(folder)
    with opened(browser, folder / "drop.npy") as p:
        p.page.context.grant_permissions(["clipboard-read", "clipboard-write"])
        p.measure()
        p.plot()
        p.choose("Plot", "vy")
        over = p.page.locator("#plot .u-over")
        p.drag_in(over, 0.1, 0.9)
        slope = p.fit("line", 2)[1]
        assert p.clicks <= 10
        p.page.locator("#said").wait_for()
        assert p.page.inner_text("#said").startswith("g = 9.") and "m/s²" in p.page.inner_text("#said")
        assert slope["name"] == "b" and abs(slope["value"] + G) < 3 * slope["sigma"] and slope["sigma"] < 0.05
        # the ruler: two clicks of 0.5 px on 200 px, each of which may lie up to a quarter of a screen's pixel off
        assert slope["sigma_common"] == pytest.approx(G * 0.5 * math.sqrt(2) / 200, rel=0.02)
        assert "frames" in p.page.inner_text("#numbers") and p.page.locator("#residual canvas").is_visible()
        box = over.bounding_box()
        p.page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 20)  # to that frame of the film
        p.until("Math.abs(workbench.store.frame - 24) <= 2")
        reload(p)
        p.choose("Plot", "y")
        p.click("button[data-curve=parabola]")  # over the film it lies where the ball is
        p.until("workbench.store.fit?.parameters.length === 3 && workbench.store.fit.column")
        seen, model = p.get("[workbench.store.track.rows, workbench.store.fit]")
        off = [math.dist(r[:2], (c, d)) for r, c, d in zip(seen, model["column"], model["row"]) if c is not None]
        assert len(off) > 20 and max(off) < 0.05
        p.click("#tab-check")
        p.key("c")
        p.click_film((100, 50))
        p.key("Escape")
        reload(p)
        assert {"marks", "distance"} <= set(p.draft["picks"]["rod_video"]) and len(p.draft["corrections"]) == 1
        # the cross is put, moved and turned
        p.click("#tab-scale")
        p.click("button[data-tool=origin]")
        p.click_film((100, 120))
        p.until("workbench.store.table.rod_video?.origin?.length === 2")
        p.drag_film((100, 120), (60, 200))
        assert p.draft["values"]["rod_video"]["origin"] == pytest.approx([60, 200], abs=0.5)
        x, y = p.at(*p.draft["values"]["rod_video"]["origin"])
        angle = math.radians(10)  # the end of y, 60 px of the screen above the origin, to the left
        p.drag((x, y - 60), (x - 80 * math.sin(angle), y - 80 * math.cos(angle)))
        assert p.draft["values"]["calibration"]["tilt"] == pytest.approx(angle, abs=0.02)
        p.label("Turned by [°]").fill("10")  # what is drawn can be typed
        assert p.draft["values"]["calibration"]["tilt"] == pytest.approx(angle, abs=1e-9)
        reload(p)
        kept = folder / "results" / "drop" / "workbench.json"  # where another server finds it
        until(lambda: kept.exists() and json.loads(kept.read_text())["draft"] == p.draft)
        assert sorted(f.name for f in folder.iterdir()) == ["drop.npy", "results"]
        given = p.write()
        assert "ground" not in given and given["calibration"]["tilt"] == pytest.approx(angle, abs=1e-9)
        assert len(given["rod_video"]["origin"]) == 2
        assert main(["track", str(folder), "--results", str(tmp_path / "out"), "--no-pictures"]) == 0
        written = rows_of((tmp_path / "out" / "track.csv").read_text())
        assert len(written) == 48 and {"x_m", "y_m", "height_m"} <= set(written[0])
        assert [k for k, r in enumerate(written) if float(r["corrected"])] == list(map(int, p.draft["corrections"]))
        p.click("#tab-plot")
        p.until("workbench.store.columns?.table.x_m")
        until(lambda: not differing(written, p.get("workbench.store.columns.table")))
        p.click("button[data-view=sheet]")
        p.page.locator("#sheet tbody td").first.wait_for()
        p.press("Copy")
        p.page.get_by_text("48 rows copied.").wait_for()
        with p.page.expect_download() as saved:
            p.press("Save as CSV")
        read = rows_of(Path(saved.value.path()).read_text(encoding="utf-8"))
        assert read == rows_of(p.get("navigator.clipboard.readText()"), "\t") and len(read) == 48
        assert differing(read, p.get("workbench.store.columns.table")) == []
        assert {"time_s", "x_m", "y_m", "sigma_m", "vy_m_s", "v_sigma_m_s", "flag"} <= set(read[0])


def test_lost_and_corrected(tmp_path, browser, monkeypatch):
    """Half a ruler blocks nothing; a ruler is moved, undone, redone; a lost frame is put by hand and gone on with."""
    truth = drop(tmp_path / "ball", lost=(20, 21, 22))
    with opened(browser, tmp_path / "ball" / "drop.npy") as p:
        p.click("button[data-tool=marks]")
        p.click_film((30, 20))  # one end alone
        assert len(p.draft["picks"]["rod_video"]["marks"]) == 2
        see, gate = BallFilm.see, iter(range(100))

        def held(self, image):
            if next(gate) == 40:  # until it is told to stop
                until(lambda: p.server.benches.bench.following._stop.is_set())
            return see(self, image)

        monkeypatch.setattr(BallFilm, "see", held)
        p.click("#act")
        p.until("/40 of 48/.test(document.body.innerText)")
        assert p.page.locator("#trouble").is_hidden()
        p.press("Stop")
        p.until("!workbench.store.track.running")
        assert 3 < p.get("workbench.store.track.rows.length") < 48 and not p.get("workbench.store.track.finished")
        monkeypatch.undo()
        p.click("#track")
        p.followed()
        assert p.get("workbench.store.track.rows.map((r, i) => r[3] ? i : -1).filter((i) => i >= 0)") == [20, 21, 22]
        p.click("#tab-scale")
        before = p.get("workbench.view.toScreen(0, 0)")
        scale = "Math.abs(workbench.store.table.rod_video?.scale - %s) < 1e-5"
        p.click("button[data-tool=marks]")
        p.drag_film((40, 30), (40, 130))
        assert p.draft["picks"]["rod_video"]["marks"] == pytest.approx([40, 30, 40, 130], abs=0.5)
        p.page.keyboard.type("100")
        p.until(scale % 1e-3)
        p.drag_film((40, 130), (40, 230))  # its lower end is taken hold of
        p.until(scale % 0.5e-3)
        assert p.get("workbench.view.toScreen(0, 0)") == before  # the film stayed
        p.page.locator("#film").focus()
        for key, there in (("Control+z", 1e-3), ("Control+Shift+Z", 0.5e-3)):
            p.key(key)
            p.until(scale % there)
        p.drag_film((120, 60), (140, 90))  # elsewhere a drag moves the film
        assert p.get("workbench.view.toScreen(0, 0)") != before
        p.click("#tab-check")
        for there in (22, 21, 20):
            p.page.get_by_role("button", name="‹ Previous lost").click()
            p.until(f"workbench.store.frame === {there}")
        p.click("[data-tool=correct]")
        p.click_film(tuple(truth[20]))
        p.until("Object.keys(workbench.store.draft.corrections).join() === '20'")
        p.key("Escape")
        p.page.evaluate("window.before = workbench.store.track")
        p.page.route("**/api/track", lambda route: route.abort())  # the server is gone for once
        with p.page.expect_event("requestfailed"):
            p.key("t")
        p.until("workbench.store.track === window.before")  # nothing is lost
        p.page.unroute("**/api/track")
        p.said.clear()  # the browser's own words of that
        p.key("t")
        assert p.get("workbench.store.track !== window.before")  # before the server answers
        p.followed()
        p.plot()
        p.until("workbench.store.columns?.table.corrected?.[20]")
        table = p.get("workbench.store.columns.table")
        assert [i for i, f in enumerate(table["flag"]) if f] == [21, 22]
        assert math.dist((table["x_px"][20], table["y_px"][20]), truth[20]) < 1.0
        while not p.page.locator("#undo").is_disabled():
            p.click("#undo")
        assert not p.draft["corrections"] and p.draft["picks"].get("rod_video", {}).get("marks") is None
        assert p.page.locator("#redo").is_enabled()


def test_keys(tmp_path, browser):
    """Space plays and arrows step; a click with Shift marks the ball, which is written."""
    folder = tmp_path / "ball"
    truth = drop(folder, n=40, experiment=FILM)
    with opened(browser, folder) as p:
        for pressed, there in (
            *(("ArrowRight", 1), ("ArrowRight", 2), ("ArrowLeft", 1), ("Shift+ArrowRight", 11), ("Shift+ArrowLeft", 1)),
            *(("End", 39), ("ArrowRight", 39), ("Home", 0), ("ArrowLeft", 0)),
        ):
            p.key(pressed)
            assert p.get("workbench.store.frame") == there, pressed
        p.key(" ")
        p.until("workbench.player.playing && workbench.store.frame > 2")
        p.key(" ")
        p.until("!workbench.player.playing")
        p.key("?")
        assert "Mark the ball in this frame and step on" in p.page.inner_text("#help")
        p.key("Escape")
        p.key("t")
        p.followed()
        p.key("3")
        p.key("Home")
        for _ in range(5):
            p.key("ArrowRight")
        for k in range(5, 9):
            assert p.get("workbench.store.frame") == k
            p.mark(truth[k] + 0.7)
        p.click_film(truth[20])  # without Shift it marks nothing here
        assert p.get("workbench.store.frame") == 9 and list(p.draft["corrections"]) == ["5", "6", "7", "8"]
        p.key("Control+z")  # one mark at a time
        assert list(p.draft["corrections"]) == ["5", "6", "7"]
        p.key("Control+Shift+z")
        marked = np.array([p.draft["corrections"][str(k)] for k in range(5, 9)])
        assert np.abs(marked - (truth[5:9] + 0.7)).max() <= 0.5 * p.pixel + 0.01
        p.write()
        rows = rows_of((folder / "corrections.csv").read_text())
        assert [[float(r["x_px"]), float(r["y_px"])] for r in rows] == marked.tolist()
        p.again()
        assert list(p.draft["corrections"]) == ["5", "6", "7", "8"]  # of the file


class Fingers(Hand):
    """A tablet: touches at places of the window, as the browser gets them from a screen."""

    def touch(self, kind: str, *places: tuple[float, float]) -> None:
        points = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(places)]
        self.wire.send("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": points})

    def swipe(self, *ways: tuple[tuple[float, float], tuple[float, float]]) -> None:
        """Move a finger along each way, all at once."""
        self.touch("Start", *(a for a, _ in ways))
        for k in (0.2, 0.4, 0.6, 0.8, 1.0):
            self.touch("Move", *((a[0] + k * (b[0] - a[0]), a[1] + k * (b[1] - a[1])) for a, b in ways))
        self.page.wait_for_timeout(150)  # it rests before it is lifted: else it flings, and the next tap stops that
        self.touch("Move", *(b for _, b in ways))
        self.touch("End")
        self.page.wait_for_timeout(350)  # a tap at once would be the second of a double tap

    def tap(self, where: str) -> None:
        self.page.locator(where).filter(visible=True).first.tap()

    def to_film(self) -> None:
        """Scroll back to the film, on a screen held upright."""
        self.page.locator("#film").scroll_into_view_if_needed()

    def tap_film(self, column: float, row: float) -> None:
        self.to_film()
        self.page.touchscreen.tap(*self.at(column, row))


SMALL = """[...document.querySelectorAll("button, select, input:not([type=checkbox], [type=file])")]
  .filter((e) => e.checkVisibility() && e.getBoundingClientRect().height < 44)
  .map((e) => `${e.tagName} ${e.id || e.textContent} ${e.getBoundingClientRect().height}`)"""


@pytest.mark.parametrize("size", [(768, 1024), pytest.param((1024, 768), marks=LONG)], ids=str)
def test_fingers(size, tmp_path, browser):
    """From a film to g on a tablet, of which each button is 44 px high, as Apple and WCAG 2.5.5 have it."""
    truth = drop(tmp_path / "ball")
    with opened(browser, tmp_path / "ball" / "drop.npy", size, touch=True, hand=Fingers) as p:
        p.wire, small = p.page.context.new_cdp_session(p.page), set()
        for step in ("find", "check", "plot", "run", "scale"):
            p.tap(f"#tab-{step}")
            small |= set(p.get(SMALL))
        assert small == set()
        p.label("Frame rate [1/s]").fill("250")
        p.tap("button[data-tool=marks]")
        p.to_film()
        p.swipe((p.at(*RULER[:2]), p.at(RULER[2], RULER[3] - 30)))
        p.until("workbench.store.draft.picks.rod_video?.marks?.length === 4")
        p.to_film()
        p.swipe((p.at(RULER[2], RULER[3] - 30), p.at(*RULER[2:])))  # its end, moved
        p.until("Math.abs(workbench.store.draft.picks.rod_video.marks[3] - 220) < 2")
        assert np.abs(np.array(p.draft["picks"]["rod_video"]["marks"]) - RULER).max() <= p.pixel + 0.01
        p.label("Its length [mm]").fill("200")
        p.until("Math.abs(workbench.store.table.rod_video?.scale - 1e-3) < 1e-5")
        p.to_film()
        # two fingers: apart by twice as much is twice as large, and what lay between them stays there
        k, middle = 1 / p.pixel, p.at(90, 100)
        p.swipe(*(((middle[0] + s * 40, middle[1]), (middle[0] + s * 80, middle[1])) for s in (-1, 1)))
        p.until(f"workbench.view.toScreen(1, 0)[0] - workbench.view.toScreen(0, 0)[0] > {1.5 * k}")
        assert 1 / p.pixel == pytest.approx(2 * k, rel=0.02) and math.dist(p.at(90, 100), middle) < 3
        before = p.at(90, 100)
        p.swipe((before, (before[0] + 60, before[1] + 30)))  # one finger moves the picture
        assert math.dist(p.at(90, 100), (before[0] + 60, before[1] + 30)) < 8  # but for the first pixels, of a tap
        assert p.draft["picks"]["rod_video"].get("ball") is None  # none of that was a tap
        p.tap("#zoom-fit")
        p.tap_film(*truth[0])
        p.until("workbench.store.draft.picks.rod_video.ball?.length === 2 && workbench.store.ball")
        assert math.dist(p.draft["picks"]["rod_video"]["ball"], truth[0]) <= p.pixel + 0.1
        p.tap("#act")
        p.followed()
        p.tap("#tab-check")
        p.tap("[data-tool=correct]")
        p.page.get_by_label("After a click: next frame").check()
        frame = p.get("workbench.store.frame")
        assert frame == len(truth) - 1  # the page follows the tracker to the end
        p.tap("#back")
        p.until(f"workbench.store.frame === {frame - 1}")
        p.tap_film(*truth[frame - 1] + 0.5)
        p.until(f"workbench.store.frame === {frame}")
        assert list(p.draft["corrections"]) == [str(frame - 1)]
        p.tap("#undo")
        p.tap("#tab-plot")
        p.page.locator("#plot .u-over").wait_for()
        p.label("Plot").select_option("vy")
        p.page.locator("#plot").scroll_into_view_if_needed()
        box = p.page.locator("#plot .u-over").bounding_box()
        y = box["y"] + box["height"] / 2
        p.swipe(((box["x"] + 0.15 * box["width"], y), (box["x"] + 0.85 * box["width"], y)))
        p.until("workbench.store.plot.part?.length === 2")
        p.tap("button[data-curve=line]")
        p.until("workbench.store.fit?.parameters.length === 2")
        slope = p.get("workbench.store.fit.parameters[1]")
        assert abs(slope["value"] + G) < 3 * slope["sigma"]
        assert p.get("document.documentElement.scrollWidth") <= size[0]


# --- fit --------------------------------------------------------------------------------------------------------------


def test_fit(tmp_path, browser):
    """Columns lie against each other, a second ball and a study of one's own beside; a bad part says why."""
    truth = drop(tmp_path / "ball", experiment=FILM)
    film = np.load(tmp_path / "ball" / "drop.npy")
    y, x = np.mgrid[: film.shape[1], : film.shape[2]]
    rise = np.column_stack([np.full(len(film), 184.0), 205 - 2.0 * np.arange(len(film))])  # 0.5 m/s up
    for image, (c, r) in zip(film, rise):
        image[np.hypot(x - c, y - r) < 8] = 200
    np.save(tmp_path / "ball" / "drop.npy", film)
    for folder in ("lab", "ball"):
        (tmp_path / folder).mkdir(exist_ok=True)
        (tmp_path / folder / "mine.py").write_text(STUDY)
    with (
        pytest.raises(InputError, match="lies in the folder of recordings"),
        serving(tmp_path / "ball", f"{tmp_path / 'ball' / 'mine.py'}:study"),
    ):
        pass
    with opened(browser, tmp_path / "ball", study=f"{tmp_path / 'lab' / 'mine.py'}:study") as p:
        p.click_film(truth[0])
        p.click("button[data-tool=markers]")
        p.click_film(rise[0])
        p.click("#act")
        p.followed()
        p.plot()
        p.choose("against", "x")
        p.choose("Plot", "y")
        bend = p.fit("parabola", 3)[2]  # y = -g x²/(2 u²), u = 0.4 m/s
        assert bend["unit"] == "1/m" and abs(bend["value"] + G / 0.4**2) < 3 * bend["sigma"]
        p.choose("against", "time")
        p.drag_in(p.page.locator("#plot .u-over"), 0.5, 0.53)
        p.click("button[data-curve=sine]")
        p.page.get_by_text("take a longer part").wait_for()
        p.press("Whole")
        p.choose("Plot", "energy")
        rate = p.fit("line", 2)[1]  # nothing is lost in a drawn fall
        assert rate["unit"] == "m²/s³" and abs(rate["value"]) < 4 * rate["sigma"]
        # g is 9.0 in the study and 9.81 in the film: what is left is the followed height less its formula
        assert p.page.locator("button[data-curve=simulated]").is_hidden()  # nothing was run
        p.click("button[data-curve=study]")
        p.until("document.getElementById('step-plot').innerText.includes('with its first values')")
        p.until("workbench.store.fit?.column && workbench.store.fit.parameters.length === 0")
        assert "mine.py:study" in p.page.inner_text("#numbers")
        table, fit = p.get("[workbench.store.columns.table, workbench.store.fit]")
        t, height = (np.array(table[k]) for k in ("time_s", "height_m"))
        own = (height[1] - height[0]) / (t[1] - t[0]) * t - 4.5 * t**2
        assert np.allclose(np.array(fit["residual"], float), height - own, atol=1e-12)
        # over the film it is drawn where it puts the ball: at the last frame 7.2 px above where the ball is
        assert abs(fit["row"][-1] - (truth[0, 1] - own[-1] / SCALE)) < 0.1
        assert abs(fit["column"][-1] - truth[-1, 0]) < 0.1 and truth[-1, 1] - fit["row"][-1] > 5
        p.choose("Body", "2")
        p.choose("Plot", "vy")
        assert p.fit("line", 2)[0]["value"] == pytest.approx(0.5, rel=0.02)
        p.said = [t for t in p.said if "status of 400" not in t]  # of the part that was too short


def test_hard_ground(tmp_path, browser):
    """The last run's track is there, its simulated jump lies over it with the residual; a log is moved by hand."""
    hard, results = tmp_path / "hard", tmp_path / "results" / "hard"
    shutil.copytree(SAMPLES / "hard_ground", hard, ignore=shutil.ignore_patterns("truth.json"))
    assert main(["simulate", str(hard), "--no-pictures"]) == 0
    with opened(browser, hard) as p:
        p.until("workbench.store.track.rows.length > 700")  # the track of that run, which is not made again
        p.click("#tab-plot")
        p.click("button[data-curve=simulated]")
        p.until("!!workbench.store.fit?.column")
        track, jump = (
            np.genfromtxt(results / f, delimiter=",", names=True, dtype=None) for f in ("track.csv", "simulation.csv")
        )
        height = np.interp(track["time_s"], jump["time_s"], jump["rod_m"] - jump["rod_m"][0], left=np.nan, right=np.nan)
        found = np.array(p.get("workbench.store.fit.residual"), float)
        assert np.allclose(found, track["height_m"] - height, atol=1e-12, equal_nan=True)
        assert np.isfinite(found).sum() > 600 and "rms of" in p.page.inner_text("#numbers")
        p.until("document.getElementById('step-plot').innerText.includes('As the last run simulated it')")
        p.click("#tab-scale")
        box = p.page.locator("#timeline").bounding_box()
        x, y = box["x"] + 0.6 * box["width"], box["y"] + 0.5 * box["height"]  # the second of three lanes: the motor
        p.drag((x, y), (x + 50, y))
        p.write()
        e, film = open_experiment(hard), p.get("workbench.store.state.films[0].time")
        pixel = 1.2 * (film[-1] - film[0]) / (box["width"] - 84)  # s; the lane shows a tenth more on either side
        assert e.sections["motor_log"].start == pytest.approx(50 * pixel, rel=0.02)
        assert e.sections["clock"].offset_sigma == pytest.approx(pixel, rel=0.05)


# --- flow -------------------------------------------------------------------------------------------------------------


def test_flow(tmp_path, browser):
    """From two pictures to a vorticity map and a profile in eight clicks, each number the library's to the last bit."""
    with opened(browser, two_pictures(tmp_path / "pair")) as p:
        for word in ("Ball in this frame", "ball [px]", "diameter"):
            assert not p.page.get_by_text(word).filter(visible=True).count()
        p.click("#act")  # match the pair
        p.until("workbench.store.flow")
        p.choose("Map", "vorticity")
        p.until("workbench.store.flow?.name === 'vorticity'")
        p.click("#tab-plot")
        p.click("#line")
        p.drag_film((30, 60), (90, 62), (140, 64))
        p.until("workbench.store.flow.profile.s")
        assert p.page.locator("#profile canvas").is_visible() and p.page.locator("#colours").is_visible()
        assert p.clicks <= 8
        lines = p.get("workbench.store.table.params.profiles.lines")
        assert lines[0] == pytest.approx([30, -60, 140, -64], abs=1.0)
        found = plain(asdict(p.server.benches.bench.flow(draft_of(p.draft), 0, "vorticity", False)))
        seen = p.get("workbench.store.flow")
        for key in ("u", "v", "values", "profile"):
            assert seen[key] == found[key], key
        with p.page.expect_download() as saved:
            p.press("Save the profile as CSV")
        along = np.genfromtxt(saved.value.path(), delimiter=",", names=True)["along"]
        assert along.tolist() == seen["profile"]["along"]
        p.drag_film((140, 64), (140, 40))  # its end is taken hold of
        p.until("Math.abs(workbench.store.table.params.profiles.lines[0][3] + 40) < 1")
        p.key("Control+z")
        p.until("Math.abs(workbench.store.table.params.profiles.lines[0][3] + 64) < 1")


def test_flow_set_by_the_mouse_is_repeated_by_the_command_line(tmp_path, browser, monkeypatch):
    """Scale, part and windows of a film; the matching of all its pairs is stopped, and made again to their mean."""
    with opened(browser, folder := flow_film(tmp_path / "film", 12)) as p:
        p.label("Frame rate [1/s]").fill("250")
        p.click("button[data-tool=marks]")
        p.drag_film((10, 100), (110, 100))
        p.label("Its length [mm]").fill("5")
        p.click("button[data-tool=leave_out]")
        p.click_film((10, 10), (60, 10), (30, 50))
        p.key("Enter")
        p.click("button[data-tool=roi]")
        p.click_film((8, 4), (168, 112))
        p.click("#act")
        p.until("workbench.store.flow")
        for text, value in (("Window [px]", "32"), ("Step [px]", "10")):
            p.label(text).fill(value)
        p.label("Local contrast (CLAHE), tiles of [px], 0: off").fill("40")
        p.label("Background").select_option("minimum")
        p.label("Show the picture as it is matched").check()
        p.until("workbench.store.lit && workbench.store.table.params?.piv?.background === 'minimum'")
        progress, gate = Batch._progress, []

        def held(self, what, done, total):
            if done == 2 and not gate:  # until it is told to stop
                gate.append(done)
                until(self._stop.is_set)
            progress(self, what, done, total)

        monkeypatch.setattr(Batch, "_progress", held)
        p.press("Match all pairs")
        until(lambda: gate)
        p.press("Stop")
        p.page.get_by_text("stopped", exact=True).wait_for()
        batch = p.server.benches.bench.flowing.batch
        assert not batch.running and batch.piv is None
        p.press("Match all pairs")  # and again, to its end
        p.until("workbench.store.flow?.mean && workbench.store.flow.fields === 11")
        p.page.get_by_text("Mean of 11 fields.").wait_for()
        p.choose("Map", "tke")
        p.until("workbench.store.flow.name === 'tke' && workbench.store.flow.unit === 'm^2/s^2'")
        given = p.write()
        assert given["params"]["piv"] == {"window": 32, "step": 10, "clahe": 40, "background": "minimum"}
        assert given["grain_video"]["scale"] == pytest.approx(5e-5, rel=0.03)
        for key, place in (("leave_out", [10, 10, 60, 10, 30, 50]), ("roi", [8, 4, 168, 112])):
            assert np.ravel(given["grain_video"][key]) == pytest.approx(place, abs=1.0)
        field = of_file(stage("piv", folder) / "piv.nc", 0)
        p.click("#tab-find")
        p.choose("of", "")
        p.until("workbench.store.flow && !workbench.store.flow.mean && workbench.store.flow.speed === 'm/s'")
        for name in ("u", "v"):
            same(p.get(f"workbench.store.flow.{name}"), field[name].values)


def test_thresholds_of_bed_and_crater_are_moved_by_hand_and_written(tmp_path, browser):
    """A soft edge, a line that is faint on one side: where the level lies counts, and the run finds what was seen."""
    rng, bed, crater = np.random.default_rng(1), tmp_path / "bed", tmp_path / "crater"
    x, rows = np.arange(300), np.arange(200)[:, None]
    edge = 40 + 170 / (1 + np.exp((rows - 80 - 4 * np.sin(x / 30)) / 6.0))
    line = 50 + 25 * np.exp(-(((x - 150.3) / 40) ** 2))
    crest = np.where(x < 40, 24.0, 160.0)  # 40 columns at 0.15 of the rest
    lit = 20 + crest * np.exp(-0.5 * ((rows - line) / 1.8) ** 2)
    for folder, light, more in (
        (bed, edge, "[bed]\nsolid_volume = 2e-3\nlength = 0.3\nwidth = 0.15\n"),
        (crater, lit, ""),
    ):
        folder.mkdir()
        grey = np.clip(light + rng.normal(0, 1, light.shape), 0, 255).astype(np.uint8)
        cv2.imwrite(str(folder / f"{folder.name}.png"), grey)
        section = f'[{folder.name}_image]\nfile = "{folder.name}.png"\nscale = 1e-3\n'
        (folder / "experiment.toml").write_text(f"schema = 1\n{section}{more}")
    moved = "[workbench.store.table.params?.%s?.%s, workbench.store.bed.%s].every((v) => v === %s)"
    with opened(browser, bed) as p:
        p.label("Floor of the bed").fill("190")  # by the keyboard alone
        p.key("Tab")
        p.until("workbench.store.preview?.table.bed_image?.floor_row === 190")
        p.key("t")
        p.until("workbench.store.bed")
        assert "phi" in p.page.inner_text("#packing")
        p.choose("Surface by", "threshold")
        p.until("workbench.store.bed.threshold > 0")
        before = p.get("workbench.store.bed.row")
        level = p.slide("Grains are darker than [grey levels]", 0.5, 0.25)  # every level it passed was drawn too
        p.until(moved % ("bed", "threshold", "threshold", level))
        seen, given = p.get("workbench.store.bed.row"), p.write()
        assert np.mean(seen) > np.mean(before) + 2  # darker: deeper
        assert given["params"]["bed"] == {"method": "threshold", "threshold": level}
        assert given["bed_image"]["floor_row"] == 190
        found = json.loads((stage("bed", bed) / "bed.json").read_text())
        assert np.round(found["profile"]["row_px"], 2).tolist() == seen
    with opened(browser, crater) as p:
        p.key("t")
        p.until("workbench.store.bed")
        assert p.get("workbench.store.bed.lost") == pytest.approx(40, abs=4) and "cm³" in p.page.inner_text("#volume")
        level = p.slide("Least contrast of the line (share of the typical)", 0.2, 0.06)
        p.until(moved % ("crater", "contrast", "contrast", level))
        assert p.get("workbench.store.bed.lost") < 10
        p.label("Undisturbed beyond [mm]").fill("110")
        p.until("workbench.store.bed.radius === 0.11")
        seen = p.get("workbench.store.bed")
        row = np.array(seen["row"], float)  # NaN where lost
        assert np.nanmax(np.abs(row - line)[45:]) < 0.5
        assert p.write()["params"]["crater"] == {"contrast": level, "radius": 0.11}
        found = json.loads((stage("crater", crater) / "crater.json").read_text())
        assert [found["volume_m3"], found["sigma_m3"]] == seen["volume"]
        assert [None if r is None else round(r, 2) for r in found["line"]["row_px"]] == seen["row"]


# --- campaign ---------------------------------------------------------------------------------------------------------


def results_of_two(campaign: Path) -> None:
    """Write experiments a and b, with results as of a run: the jump of b is missed by 4 mm in frame 13."""
    k = np.arange(20)
    t, height, missed = k / RATE, -0.0003 * k**2, 0.004 * np.exp(-((k - 13.0) ** 2))
    of_jump = {"time_s": t, "rod_m": 0.2 + height} | dict.fromkeys(("foot_m", "motor_m", "ground_N", "spring_N"), 0.0)
    of_track = {"frame": k, "time_s": t, "x_px": 60.0, "y_px": 30 - height / SCALE, "sigma_px": 0.1}
    for name in "ab":
        drop(campaign / name, n=20, size=(130, 160), experiment=f'{FILM}[motor_log]\nfile = "motor.csv"\n')
        pd.DataFrame({"time_s": t, "position_m": 0.001 * (k > 9)}).to_csv(campaign / name / "motor.csv", index=False)
        results = campaign.parent / "results" / campaign.name / name
        results.mkdir(parents=True)
        for file, columns in (
            ("rod", {"time_s": t, "height_m": height + missed * (name == "b"), "sigma_m": 1e-5}),
            ("simulation", of_jump),
            ("track", of_track | {"height_m": height, "sigma_m": 1e-5, "flag": ""}),
        ):
            pd.DataFrame(columns).to_csv(results / f"{file}.csv", index=False)
        told = {"kind": "frames", "message": "2 frames lost", "recording": "rod_video", "values": {}}
        numbers = {"jump_height_m": 0.03, "sigma_m": 1e-4, "simulated_height_m": 0.031}
        summary = {"experiment": name, "kind": "single", "warnings": [told] * (name == "b")} | numbers
        (results / "summary.json").write_text(json.dumps(summary))


def test_campaign(tmp_path, browser, monkeypatch):
    """What stands out is marked at a glance, why is shown of its results, which stay as they are; a track stays."""
    results_of_two(campaign := tmp_path / "drops")
    kept = tree(tmp_path / "results")
    with opened(browser, campaign) as p:
        p.key("t")
        p.until("workbench.store.track.finished && workbench.store.track.rows.length === 20")
        track = p.get("workbench.store.track.rows")
        monkeypatch.setattr(BallFilm, "see", None)  # nothing follows a ball any more
        monkeypatch.setattr(BallFilm, "tracks", None)
        p.click("#glance-open")
        first = p.page.locator("#glance tbody tr").first
        first.wait_for()
        assert first.inner_text().split("\t")[2:7] == ["b", "single", "30.00 ± 0.10", "+1.00", "1 warning"]
        p.until("[...document.querySelectorAll('#glance img')].every((i) => i.complete && i.naturalWidth > 0)")
        assert p.page.locator("#glance tr.odd").count() == 1
        p.press("Why b")
        p.page.get_by_text("b: greatest residual 4.00 mm at 0.052 s").wait_for()
        found = p.get("workbench.store.why")
        assert found["frame"] == 13 and found["greatest"] == pytest.approx(0.004, abs=1e-9)
        np.testing.assert_allclose(found["y"], 0.004 * np.exp(-((np.arange(20) - 13.0) ** 2)), atol=1e-12)
        p.until("document.querySelector('#why img').naturalWidth > 0")
        panels = p.page.locator("#why figure")
        assert panels.count() == 3 and "position (motor_log)" in panels.nth(2).inner_text()
        assert len({round(panels.nth(k).bounding_box()["y"]) for k in range(3)}) == 1  # side by side
        assert p.get("[...document.querySelectorAll('#why figure')].every((f) => f.scrollWidth <= f.clientWidth)")
        p.press("Why a")
        p.page.get_by_text("a: greatest residual 0.00 mm").wait_for()
        p.press("b")
        p.until("workbench.store.state.name === 'b' && workbench.store.track.rows.length === 0")
        p.page.select_option("#experiment", "a")
        p.until("workbench.store.state.name === 'a' && workbench.store.track.rows.length === 20")
        assert p.get("workbench.store.track.rows") == track and p.get("workbench.store.track.finished")
        p.click("#tab-plot")
        p.until("workbench.store.columns?.table.frame.length === 20")
    now = tree(tmp_path / "results")
    assert {f: now[f] for f in kept} == kept


def test_after_a_run(tmp_path, browser, monkeypatch):
    """A track of the command line is plotted without tracking again, what it warned of is gone to, its report shown."""
    drop(folder := tmp_path / "drop", n=20, size=(130, 160), lost=(7, 8, 9),
         experiment=FILM + '[rod_corrections]\nfile = "corrections.csv"\n')  # fmt: skip
    (folder / "corrections.csv").write_text("frame,x_px,y_px,sigma_px\n7,101.5,34.0,0.5\n")
    by_hand = {"corrections": {"7": [101.5, 34.0]}}
    anew = Benches(folder)
    anew.bench.follow(draft_of(by_hand))
    until(lambda: not anew.bench.following.running)
    expected = anew.bench.motion(draft_of(by_hand)).columns()
    anew.close()
    assert main(["track", str(folder), "--no-pictures"]) == 0
    page = "<p>found</p><script>document.body.append('by a script')</script>"
    (tmp_path / "results" / "drop" / "report.html").write_text(page)
    monkeypatch.setattr(BallFilm, "see", None)
    monkeypatch.setattr(BallFilm, "tracks", None)
    with opened(browser, folder) as p:
        p.until("workbench.store.track.rows.length === 20")
        p.click("#tab-plot")
        p.until("workbench.store.columns")
        found, bench = p.get("workbench.store.columns.table"), p.server.benches.bench
        assert bench.following is None and set(found) == set(expected.table)
        for name, values in expected.table.items():
            assert plain(values) == found[name], name  # to the last bit
        for draft, said in (
            ({}, "correction of frame 7 was removed"),
            (by_hand | {"values": {"params.track": {"search": 3.0}}}, "made with other values"),
            (by_hand | {"values": {"rod_video": {"exposure": 1e-3}}}, "made with other values"),
        ):
            with pytest.raises(InputError, match=said):
                bench.motion(draft_of(draft))
        p.click("#tab-run")
        p.press("Show the report")
        p.page.frame_locator("#report").get_by_text("by a script").wait_for()
        p.press("Frame 7")
        p.until("workbench.store.frame === 7")
        assert p.page.locator("#film").is_visible()


# --- add --------------------------------------------------------------------------------------------------------------


def dropped(p: Hand, *files: Path) -> None:
    """Drop files from outside on the middle of the page."""
    data = {"items": [], "files": [str(f) for f in files], "dragOperationsMask": 1}
    wire = p.page.context.new_cdp_session(p.page)
    for kind in ("dragEnter", "dragOver", "drop"):
        wire.send("Input.dispatchDragEvent", {"type": kind, "x": 600, "y": 300, "data": data})
    p.page.locator("#adding").wait_for()


def chosen(p: Hand, file: Path) -> None:
    with p.page.expect_file_chooser() as asked:
        p.click("#add")
    asked.value.set_files(file)
    p.page.locator("#adding").wait_for()


def test_add(tmp_path, browser, monkeypatch):
    """Files and folders become experiments beside the open one, whole or not at all; a copy that is stopped is gone."""
    drop(work := tmp_path / "work" / "drop", n=20, size=(130, 160))
    source = double_exposures(tmp_path / "camera", 3)
    (letter := tmp_path / "letter.docx").write_text("x")
    shutil.copy(work / "drop.npy", tmp_path / "toss.npy")
    with opened(browser, work) as p:
        dropped(p, *sorted(source.iterdir()), letter)
        assert "6 files" in p.page.inner_text("#adding") and "letter.docx" in p.page.inner_text("#adding")
        name = p.page.get_by_label("Its name")
        name.fill("drop")
        p.press("Copy and open")
        p.page.get_by_text("give another name").wait_for()
        name.fill("jet")
        p.press("Copy and open")
        p.until("workbench.store.state.name === 'jet'")
        assert tree(tmp_path / "work" / "jet") == tree(source)
        assert p.get("workbench.store.table.grain_video.pairs") == "names"
        p.said = [t for t in p.said if "status of 400" not in t]  # of the name that is taken
        p.page.select_option("#experiment", "drop")  # what was open is there still
        p.until("workbench.store.state.name === 'drop'")
        dropped(p, source)
        assert name.input_value() == "camera"  # the folder's own name is proposed
        p.key("Enter")
        p.until("workbench.store.state.name === 'camera'")
        assert tree(tmp_path / "work" / "camera") == tree(source)
        chosen(p, tmp_path / "toss.npy")
        p.press("Copy and open")
        p.until("workbench.store.state.name === 'toss'")
        assert p.get("workbench.store.state.experiments") == ["drop", "jet", "camera", "toss"]
        p.key("t")
        p.until("workbench.store.track.rows.length === 20")
        write, begun = Adding.write, []

        def held(self, name, pieces):
            write(self, name, (begun.append(1) or until(lambda: self._stopped) or piece for piece in pieces))

        monkeypatch.setattr(Adding, "write", held)
        chosen(p, tmp_path / "toss.npy")
        name.fill("new")
        p.press("Copy and open")
        until(lambda: begun)
        assert list((tmp_path / "work" / "new").glob("*.part"))
        p.press("Cancel")
        p.page.get_by_text("what was copied is removed").wait_for()
        until(lambda: not (tmp_path / "work" / "new").exists())
        assert p.get("workbench.store.state.name") == "toss"
        p.said = [t for t in p.said if "status of 400" not in t]


# --- who cannot see or point so well ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("size", "scheme", "what"),
    [
        *(((1280, 800), "light", "flow"), ((820, 1180), "dark", "ball")),
        *(pytest.param(*p, marks=LONG) for p in (((1280, 800), "dark", "flow"), ((820, 1180), "light", "ball"))),
    ],
    ids=str,
)
def test_no_serious_finding_of_axe(size, scheme, what, tmp_path, browser):
    """In each step with a ball or with a flow, with the table, and nothing is cut at the side."""
    module = pytest.importorskip(AXE, reason="pip install axe-playwright-python")
    drop(tmp_path / "ball", experiment=FILM)
    place, found = tmp_path / "ball" if what == "ball" else two_pictures(tmp_path / "pair"), {}
    with opened(browser, place, size, scheme, touch=size[0] < 1000) as p:
        p.key("t")
        if what == "ball":
            p.followed()
            p.plot()
            p.fit("line", 2)
            for view in ("sheet", "some"):
                p.click(f"button[data-view={view}]")
                found[view] = serious(p.page, module)
        else:
            p.until("workbench.store.flow")
        for step in "1235" if what == "ball" else "1245":
            p.key(step)
            found[step] = serious(p.page, module)
    assert {k: v for k, v in found.items() if v} == {}


@LONG
def test_in_firefox(firefox, tmp_path):
    """A report's figures are read, and the workbench tracks and shows, with nothing on the console."""
    folder = tmp_path / "hard"
    shutil.copytree(SAMPLES / "hard_ground", folder, ignore=shutil.ignore_patterns("truth.json"))
    assert main(["run", str(folder), "--results", str(tmp_path / "results")]) == 0
    report = SimpleNamespace(page=firefox.new_page(), said=[])
    report.page.on("pageerror", lambda e: report.said.append(str(e)))
    report.page.goto((tmp_path / "results" / "report.html").as_uri())
    assert report.page.evaluate("document.documentElement.scrollWidth <= innerWidth")
    report.page.locator("figure.drawn a.point").first.click()
    report.page.wait_for_url("**/report.html")
    assert report.page.locator("figure.drawn svg").first.is_visible() and report.said == []
    with serving(folder) as server:
        p = Hand(firefox.new_page(), server)
        p.until("workbench.player.shown === 0")
        p.key("t")
        p.followed()
        assert p.get("workbench.store.track.rows.filter((r) => r[3]).length") == 0
        p.page.locator("#scrub").fill("300")
        p.until("workbench.player.shown === 300")
        p.key("5")
        p.page.locator("#write").wait_for(state="visible")
        assert p.said == []
        p.page.close()
