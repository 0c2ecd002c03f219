"""The workbench by keys, as in Tracker, and by fingers on a tablet: real key and touch events in a browser."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.stats import chi2
from test_workbench import falling, served, until  # noqa: F401 (served: a fixture)
from test_workbench_ball import RULER, Hand, drop

from jumpvision.browser.workbench.bench import Benches
from jumpvision.browser.workbench.draft import draft_of
from jumpvision.browser.workbench.plotting import Part
from jumpvision.cli import main
from jumpvision.experiment.results.tables import Track

TABLETS = [(1024, 768), (768, 1024)]


# --- keys ------------------------------------------------------------------------------------------------------------


def test_space_plays_and_arrows_step(tmp_path, served, browser):  # noqa: F811
    falling(tmp_path / "ball")
    p = Hand(browser, served(tmp_path / "ball" / "rod.npy"))
    key, frame = p.page.keyboard.press, lambda: p.get("workbench.store.frame")
    steps = [
        "ArrowRight",
        "ArrowRight",
        "ArrowLeft",
        "Shift+ArrowRight",
        "Shift+ArrowLeft",
        "End",
        "ArrowRight",
        "Home",
        "ArrowLeft",
    ]
    for pressed, there in zip(steps, (1, 2, 1, 11, 1, 39, 39, 0, 0), strict=True):
        key(pressed)
        assert frame() == there, pressed
    key(" ")
    p.until("workbench.player.playing")
    p.until("workbench.store.frame > 2")
    key(" ")
    p.until("!workbench.player.playing")
    at = frame()
    p.page.wait_for_timeout(200)
    assert frame() == at and p.said == []
    key("?")
    assert "Mark the ball in this frame and step on" in p.page.inner_text("#help")
    p.page.context.close()


def test_shift_click_marks_the_ball_and_steps_on_and_the_command_line_has_it(tmp_path, served, browser):  # noqa: F811
    truth = falling(tmp_path / "ball")
    (tmp_path / "ball" / "experiment.toml").write_text('[rod_video]\nfile = "rod.npy"\nframe_rate = 40\nscale = 1e-3\n')
    p = Hand(browser, served(tmp_path / "ball"))
    p.page.keyboard.press("t")
    p.until("workbench.store.track.finished && !workbench.store.track.running")
    p.page.keyboard.press("3")
    p.page.keyboard.press("Home")
    for _ in range(5):
        p.page.keyboard.press("ArrowRight")
    for k in range(5, 9):
        assert p.get("workbench.store.frame") == k
        p.page.keyboard.down("Shift")
        p.page.mouse.click(*p.at(*truth[k] + 0.7))
        p.page.keyboard.up("Shift")
    assert p.get("workbench.store.frame") == 9  # and a click without Shift does not mark here
    p.page.mouse.click(*p.at(*truth[20]))
    assert p.get("workbench.store.frame") == 9 and list(p.draft["corrections"]) == ["5", "6", "7", "8"]
    p.page.keyboard.press("Control+z")  # one mark at a time
    assert list(p.draft["corrections"]) == ["5", "6", "7"]
    p.page.keyboard.press("Control+Shift+z")
    marked = np.array([p.draft["corrections"][str(k)] for k in range(5, 9)])
    pixel = 1 / (p.get("workbench.view.toScreen(1, 0)[0] - workbench.view.toScreen(0, 0)[0]"))  # the mouse's step
    assert np.abs(marked - (truth[5:9] + 0.7)).max() <= 0.5 * pixel + 0.01
    p.page.keyboard.press("5")
    p.until("workbench.store.preview?.difference.some((d) => d.includes('[rod_corrections]'))")
    p.click("#write")
    p.page.wait_for_selector("text=Written: corrections.csv, experiment.toml")
    assert main(["track", str(tmp_path / "ball"), "--results", str(tmp_path / "results")]) == 0
    table = Track.load(tmp_path / "results").table
    assert table.corrected.to_numpy().nonzero()[0].tolist() == [5, 6, 7, 8]
    assert table.loc[[5, 6, 7, 8], ["x_px", "y_px"]].to_numpy().tolist() == marked.tolist() and p.said == []
    p.page.context.close()


# --- fingers ---------------------------------------------------------------------------------------------------------


class Fingers(Hand):
    """A tablet: touches at places of the window, as the browser gets them from a screen."""

    def __init__(self, browser, server, size: tuple[int, int]):
        super().__init__(browser, server, size[0], touch=True)
        self.page.set_viewport_size({"width": size[0], "height": size[1]})
        self.wire = self.page.context.new_cdp_session(self.page)

    def touch(self, kind: str, *places: tuple[float, float]) -> None:
        points = [{"x": x, "y": y, "id": k} for k, (x, y) in enumerate(places)]
        self.wire.send("Input.dispatchTouchEvent", {"type": f"touch{kind}", "touchPoints": points})

    def swipe(self, *ways: tuple[tuple[float, float], tuple[float, float]]) -> None:
        """A finger along each way, all at once."""
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
        """What is typed next may have scrolled it away, on a screen held upright."""
        self.page.locator("#film").scroll_into_view_if_needed()

    def tap_film(self, column: float, row: float) -> None:
        self.to_film()
        self.page.touchscreen.tap(*self.at(column, row))

    @property
    def pixel(self) -> float:
        """Film pixels in one of the screen."""
        return 1 / self.get("workbench.view.toScreen(1, 0)[0] - workbench.view.toScreen(0, 0)[0]")


@pytest.mark.parametrize("size", TABLETS, ids=str)
def test_fingers_measure_track_zoom_and_fit(size, tmp_path, served, browser):  # noqa: F811
    """From a film to g on a tablet: ruler by a finger, its end moved, two fingers zoom, taps on ball and plot."""
    truth = drop(tmp_path / "ball")
    p = Fingers(browser, served(tmp_path / "ball" / "drop.npy"), size)
    p.page.get_by_label("Frame rate [1/s]").filter(visible=True).fill("250")
    p.tap("button[data-tool=marks]")
    p.to_film()
    p.swipe((p.at(*RULER[:2]), p.at(RULER[2], RULER[3] - 30)))
    p.until("workbench.store.draft.picks.rod_video?.marks?.length === 4")
    p.to_film()
    p.swipe((p.at(RULER[2], RULER[3] - 30), p.at(*RULER[2:])))  # its end, moved
    p.until("Math.abs(workbench.store.draft.picks.rod_video.marks[3] - 220) < 2")
    assert np.abs(np.array(p.draft["picks"]["rod_video"]["marks"]) - RULER).max() <= p.pixel + 0.01
    p.page.get_by_label("Its length [mm]").filter(visible=True).fill("200")
    p.until("Math.abs(workbench.store.table.rod_video?.scale - 1e-3) < 1e-5")
    p.to_film()
    # two fingers: apart by twice as much is twice as large, and what lay between them stays there
    k, middle = 1 / p.pixel, p.at(90, 100)
    ways = [((middle[0] + s * 40, middle[1]), (middle[0] + s * 80, middle[1])) for s in (-1, 1)]
    p.swipe(*ways)
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
    p.until("workbench.store.track.finished && !workbench.store.track.running")
    # a mark by a finger, and the next frame
    p.tap("#tab-check")
    p.tap("[data-tool=correct]")
    p.page.get_by_label("After a click: next frame").check()
    frame = p.get("workbench.store.frame")
    assert frame == len(p.get("workbench.store.track.rows")) - 1  # the page follows the tracker to the end
    p.tap("#back")
    p.until(f"workbench.store.frame === {frame - 1}")
    p.tap_film(*truth[frame - 1] + 0.5)
    p.until(f"workbench.store.frame === {frame}")
    assert list(p.draft["corrections"]) == [str(frame - 1)]
    p.tap("#undo")
    # a part of the plot by a finger, and a fit
    p.tap("#tab-plot")
    p.page.wait_for_selector("#plot .u-over")
    p.page.get_by_label("Plot", exact=True).filter(visible=True).select_option("vy")
    p.page.wait_for_timeout(300)
    p.page.locator("#plot").scroll_into_view_if_needed()
    box = p.page.locator("#plot .u-over").bounding_box()
    y = box["y"] + box["height"] / 2
    p.swipe(((box["x"] + 0.15 * box["width"], y), (box["x"] + 0.85 * box["width"], y)))
    p.until("workbench.store.plot.part?.length === 2")
    p.tap("button[data-curve=line]")
    p.page.wait_for_selector("#said:visible")
    assert p.page.inner_text("#said").startswith("g = 9.")
    slope = p.get("workbench.store.fit.parameters.find((q) => q.name === 'b')")
    assert abs(slope["value"] + 9.81) < 3 * slope["sigma"]
    assert p.get("document.documentElement.scrollWidth") <= size[0] and p.said == []
    p.page.context.close()


@pytest.mark.parametrize("size", TABLETS, ids=str)
def test_what_a_finger_has_to_hit_is_large_enough(size, tmp_path, served, browser):  # noqa: F811
    """44 px high, as Apple and WCAG 2.5.5 have it; in every step."""
    drop(tmp_path / "ball", n=12)
    p = Fingers(browser, served(tmp_path / "ball" / "drop.npy"), size)
    small = set()
    for step in ("scale", "find", "check", "plot", "run"):
        p.tap(f"#tab-{step}")
        small |= set(
            p.get("""[...document.querySelectorAll("button, select, input:not([type=checkbox], [type=file])")]
          .filter((e) => e.checkVisibility() && e.getBoundingClientRect().height < 44)
          .map((e) => `${e.tagName} ${e.id || e.textContent} ${e.getBoundingClientRect().height}`)""")
        )
    assert small == set()
    p.page.context.close()


# --- lost, corrected, gone on with; every curve ----------------------------------------------------------------------


def test_a_lost_frame_is_found_corrected_and_gone_on_with(tmp_path, served, browser):  # noqa: F811
    """The ball is gone in frames 20 to 22: found by the buttons, put by hand in 20, and tracked again with that."""
    truth = falling(tmp_path / "ball", n=60)
    film = np.load(tmp_path / "ball" / "rod.npy")
    film[20:23] = film[20:23].min()
    np.save(tmp_path / "ball" / "rod.npy", film)
    p = Hand(browser, served(tmp_path / "ball" / "rod.npy"))
    p.click("#tab-find")
    p.click("#track")
    p.until("workbench.store.track.finished && !workbench.store.track.running")
    assert p.get("workbench.store.track.rows.map((r, i) => r[3] ? i : -1).filter((i) => i >= 0)") == [20, 21, 22]
    p.click("#tab-check")
    p.page.get_by_role("button", name="‹ Previous lost").click()
    p.until("workbench.store.frame === 22")
    for _ in range(2):
        p.page.get_by_role("button", name="‹ Previous lost").click()
    p.until("workbench.store.frame === 20")
    p.click("[data-tool=correct]")
    p.page.mouse.click(*p.at(*truth[20]))
    p.until("Object.keys(workbench.store.draft.corrections).join() === '20'")
    p.page.keyboard.press("Escape")
    p.page.evaluate("window.before = workbench.store.track")
    asked = []
    p.page.route("**/api/track", lambda route: (asked.append(1), route.abort()))  # the server is gone for once
    p.page.keyboard.press("t")
    p.until("workbench.store.track === window.before")  # again: nothing is lost
    assert asked == [1]
    p.page.unroute("**/api/track")
    p.said.clear()  # the browser's own words of that
    p.page.keyboard.press("t")
    assert p.get("workbench.store.track !== window.before")  # before the server answers
    p.until("workbench.store.track.finished && !workbench.store.track.running")
    p.click("#tab-plot")
    p.page.wait_for_selector("#plot .u-over")
    table = p.get("workbench.store.columns.table")
    assert [i for i, f in enumerate(table["flag"]) if f] == [21, 22] and table["corrected"][20]
    assert math.dist((table["x_px"][20], table["y_px"][20]), truth[20]) < 1.0 and p.said == []
    p.page.context.close()


@pytest.mark.parametrize(
    ("curve", "name", "value", "motion"),
    [
        ("sine", "f", 3.0, lambda t: 30 * np.sin(2 * np.pi * 3 * t)),
        ("damped", "f", 3.0, lambda t: 30 * np.exp(-2 * t) * np.sin(2 * np.pi * 3 * t)),
        ("decay", "τ", 0.3, lambda t: 60 * np.exp(-t / 0.3)),
        ("damped", "τ", 0.5, lambda t: 30 * np.exp(-2 * t) * np.sin(2 * np.pi * 3 * t)),
        ("parabola", "a", -100.0, lambda t: 50 * t**2),
        ("line", "b", -80.0, lambda t: 80 * t),
    ],
    ids=lambda v: v if isinstance(v, str) else "",
)
def test_every_curve_finds_the_motion_that_was_drawn(curve, name, value, motion, tmp_path):
    """In px; rows count down, y up. Of three films the error over its sigma is that of a sigma that is true (chance
    1e-3; over 24 films of the sine it was 1.26 rms), and a sigma is below a hundredth."""
    t, z = np.arange(100) / 100, []
    y, x = np.mgrid[:160, :120]
    draft = draft_of({"values": {"rod_video": {"frame_rate": 100.0}}})
    for seed in range(3):
        rng = np.random.default_rng(seed)
        rows = 60.0 + rng.uniform() + motion(t)
        film = [30 + 170 / (1 + np.exp(np.clip((np.hypot(x - 60.3, y - r) - 8) / 0.6, -50, 50))) for r in rows]
        film = np.array(film) + rng.normal(0, 2, (100, 160, 120))
        (tmp_path / str(seed)).mkdir()
        np.save(tmp_path / str(seed) / "rod.npy", np.clip(film, 0, 255).astype(np.uint8))
        b = Benches(tmp_path / str(seed) / "rod.npy")
        b.bench.follow(draft)
        until(lambda: b.bench.following.finished)  # noqa: B023
        fit = b.bench.motion(draft).fit(Part("time", "y", 0.0, 1.0, curve))
        found = next(p for p in fit.parameters if p.name == name)
        z.append((found.value - value) / found.sigma)
        assert found.sigma < 0.01 * abs(value) and fit.rms < 0.1
        b.close()
    assert np.sum(np.square(z)) < chi2.ppf(1 - 1e-3, 3), z
