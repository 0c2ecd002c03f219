"""The workbench with a flow: vectors, maps and profiles are those of the stages, and a person reaches them by hand."""

from __future__ import annotations

import http.client
import json
import os
import shutil
import subprocess
import threading
import time
import tomllib
import urllib.request
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import xarray as xr
from diagnosis_sample import causes as named_causes
from diagnosis_sample import diagnosis, parameter
from pace import Questions

import jumpvision as jv
from jumpvision.base.record import plain
from jumpvision.base.schema import InputError
from jumpvision.browser.workbench.bench import Benches
from jumpvision.browser.workbench.draft import draft_of
from jumpvision.browser.workbench.flowing import OF_ONE, Asked, Batch
from jumpvision.browser.workbench.server import Server
from jumpvision.browser.workbench.why import causes, said
from jumpvision.cli import main
from jumpvision.engine.document.values import Cell, Height, Pattern, Varies
from jumpvision.experiment.init.recognise import recordings
from jumpvision.experiment.results.tables import Profiles
from jumpvision.experiment.stages.grains.flow import derivatives
from jumpvision.experiment.stages.grains.statistics import along_line
from jumpvision.experiment.stages.track import BallFilm
from jumpvision.experiment.workflow.cluster import SELF
from jumpvision.films.grains.dataset import as_matched

ROWS, COLUMNS = 120, 176  # px; never square
TURN, RADIUS = 0.06, 40.0  # rad a frame and px: of the vortex


def vortex(n: int, seed: int = 3) -> list[np.ndarray]:
    """Frames (ROWS, COLUMNS) of particles in a vortex about the middle, anticlockwise as seen."""
    rng, middle = np.random.default_rng(seed), np.array([COLUMNS / 2, ROWS / 2])
    place = rng.uniform([-20, -20], [COLUMNS + 20, ROWS + 20], (1600, 2))
    y, x = np.mgrid[-4:5, -4:5]
    frames = []
    for _ in range(n):
        image = np.full((ROWS + 60, COLUMNS + 60), 20.0)
        for c, r in place + 30:
            i, j = round(r), round(c)
            image[i - 4 : i + 5, j - 4 : j + 5] += 130 * np.exp(-((y + i - r) ** 2 + (x + j - c) ** 2) / 2.6)
        frames.append(np.clip(image[30:-30, 30:-30] + rng.normal(0, 2, (ROWS, COLUMNS)), 0, 255).astype(np.uint8))
        away = place - middle
        a = -TURN * np.exp(-((np.hypot(*away.T) / RADIUS) ** 2))
        turned = [away[:, 0] * np.cos(a) - away[:, 1] * np.sin(a), away[:, 0] * np.sin(a) + away[:, 1] * np.cos(a)]
        place = np.clip(middle + np.column_stack(turned), -25, [COLUMNS + 25, ROWS + 25])
    return frames


def two_pictures(folder: Path) -> Path:
    folder.mkdir()
    for name, frame in zip("AB", vortex(2)):
        cv2.imwrite(str(folder / f"case{name}.png"), frame)
    return folder


def film(folder: Path, n: int = 13) -> Path:
    folder.mkdir()
    for k, frame in enumerate(vortex(n)):
        cv2.imwrite(str(folder / f"piv_{k:03d}.png"), frame)
    return folder


def stage(name: str, folder: Path) -> Path:
    """Results of a stage by the command line."""
    results = folder.parent / f"{folder.name}-results"
    assert main([name, str(folder), "--results", str(results), "--no-pictures"]) == 0
    return results


def of_file(file: Path, k: int) -> xr.Dataset:
    with xr.open_dataset(file, decode_times=False) as data:
        return data.isel(t=k).load().transpose("y", "x")


def same(shown: list, values: np.ndarray) -> None:
    assert np.array_equal(np.array(shown, float), values.ravel(), equal_nan=True)  # to the last bit


def waited(flowing) -> None:
    while flowing.batch.running:
        time.sleep(0.02)


# --- what is shown is what the stages give ----------------------------------------------------------------------------


SETTINGS = {
    "plain": "",
    "mask, part": "",
    "slow": "[params.piv]\nbaseline = 3\n",
    "steady": "[params.piv]\nensemble = 3\n",
    "light": '[params.piv]\nbackground = "minimum"\nclahe = 24\nwindow = 16\nstep = 12\n',
}


@pytest.mark.parametrize("name", SETTINGS)
def test_a_pair_on_the_page_is_the_stage_s_to_the_last_bit(name, tmp_path):
    folder = film(tmp_path / "film", 8)
    head = 'schema = 1\n[grain_video]\nfile = "piv_*.png"\nframe_rate = 100.0\nscale = 1e-4\n'
    if name == "mask, part":
        mask = np.full((ROWS, COLUMNS), 255, np.uint8)
        mask[70:, 90:] = 0
        cv2.imwrite(str(folder / "mask.png"), mask)
        head += "roi = [8, 4, 167, 115]\nleave_out = [[20, 20, 60, 20, 40, 50]]\n"
        head += '[grain_mask]\nfile = "mask.png"\n'
    (folder / "experiment.toml").write_text(head + SETTINGS[name])
    results = stage("piv", folder)
    stage("flow", folder)
    b = Benches(folder)
    last = len(xr.open_dataset(results / "piv.nc", decode_times=False).t) - 1
    size = 3 if name == "steady" else 1
    for k in (0, last // 2, last):
        u, flow = of_file(results / "piv.nc", k), of_file(results / "flow.nc", k)
        for what in OF_ONE:
            s = b.bench.flow(draft_of({}), k * size, what, False)
            same(s.values, np.hypot(u.u, u.v).values if what == "speed" else (u if what in u else flow)[what].values)
            assert s.frame == k * size and s.unit == ("m/s" if what in ("speed", "u", "v") else "1/s")
        same(s.u, u.u.values)
        same(s.reason, u.reason.values)
        assert s.measured == int(u.chc.sum())
    b.close()


def test_double_exposures_are_matched_as_the_stage_does(tmp_path):
    folder = tmp_path / "pairs"
    folder.mkdir()
    for k in range(2):
        for name, frame in zip("ab", vortex(2, seed=k)):
            cv2.imwrite(str(folder / f"run_{k:03d}{name}.png"), frame)
    (folder / "experiment.toml").write_text(
        'schema = 1\n[grain_video]\nfile = "run_*.png"\npairs = "names"\nframe_rate = 10.0\npair_time = 1e-3\n'
    )
    results, b = stage("piv", folder), Benches(folder)
    for frame, k in ((0, 0), (1, 0), (2, 1), (3, 1)):  # either picture of a pair
        s = b.bench.flow(draft_of({}), frame, "u", False)
        same(s.values, of_file(results / "piv.nc", k).u.values)
        assert s.frame == 2 * k
    b.close()


def many_pairs(folder: Path, n: int = 3) -> Path:
    """Double exposures: what moves is one vortex from A to B, another one from pair to pair."""
    folder.mkdir()
    for k in range(n):
        for name, frame in zip("AB", vortex(2, seed=k)):
            cv2.imwrite(str(folder / f"Jet_{k:04d}{name}.png"), frame)
    return folder


def test_a_folder_of_many_pairs_is_drafted_as_pairs_by_their_names(tmp_path):
    folder = many_pairs(tmp_path / "jet")
    assert main(["init", str(folder)]) == 0
    text = (folder / "experiment.toml").read_text()
    given = tomllib.loads(text)["grain_video"]
    assert given["file"] == "Jet_*[AB].png" and given["pairs"] == "names" and "# pair_time = " in text
    with pytest.raises(InputError, match="pair_time"):
        jv.piv(folder)  # the time from A to B is nobody's guess
    (folder / "experiment.toml").write_text(text.replace("# pair_time = ", "frame_rate = 10.0\npair_time = 1e-3"))
    found = jv.piv(folder).field
    assert found.sizes["t"] == 3
    for name, count in (("aside", 4), ("alone", 2)):  # a letter that is part of a word is none
        (tmp_path / name).mkdir()
        for f in sorted(folder.glob("*.png"))[:count]:
            letter = f.stem[-1] if name == "alone" else f"{f.stem[-2]}_data" if f.stem[-1] == "A" else f"{f.stem[-2]}_b"
            shutil.copy(f, tmp_path / name / f"jet_{letter}.png")
    assert [(r.file, "pairs" in r.values) for r in recordings(tmp_path / "alone", {})[0]] == [("jet_[AB].png", False)]
    assert not any("pairs" in r.values for r in recordings(tmp_path / "aside", {})[0])


def test_a_map_has_the_sign_and_the_place_of_the_truth(tmp_path):
    b = Benches(two_pictures(tmp_path / "pair"))
    s = b.bench.flow(draft_of({}), 0, "vorticity", False)
    field = np.array(s.values, float).reshape(len(s.rows), len(s.columns))
    row, column = (np.argmin(np.abs(np.array(a) - m)) for a, m in ((s.rows, ROWS / 2), (s.columns, COLUMNS / 2)))
    # twice the rate of turning in the middle, anticlockwise positive; planes over 3 vectors, 8 px apart, and windows of
    # 24 px see about a tenth less of a vortex of 40 px
    assert field[row, column] == pytest.approx(2 * TURN, rel=0.15) and s.unit == "1/frame"
    b.close()


def test_the_mean_and_its_profile_are_those_of_the_pipeline(tmp_path):
    folder = film(tmp_path / "film")
    line = [0.002, -0.006, 0.014, -0.005]
    text = 'schema = 1\n[grain_video]\nfile = "piv_*.png"\nframe_rate = 100.0\nscale = 1e-4\n'
    (folder / "experiment.toml").write_text(text + f"[params.profiles]\nlines = [{line}]\n")
    results = stage("profiles", folder)
    b = Benches(folder)
    b.bench.all_pairs(draft_of({}))
    waited(b.bench.flowing)
    s = b.bench.flow(draft_of({}), 0, "vorticity", True)
    with xr.open_dataset(results / "statistics.nc", decode_times=False) as mean:
        same(s.values, mean.vorticity.transpose("y", "x").values)
        same(s.u, mean.u.transpose("y", "x").values)
        assert s.fields == 12
    table = Profiles.load(results).table
    for column in ("s", "along", "along_sigma", "across", "across_sigma", "uv"):
        same(s.profile[column], table[column].to_numpy())
    one = b.bench.flow(draft_of({}), 3, "u", False)  # of the field that lies there already
    stage("piv", folder)
    same(one.values, of_file(results / "piv.nc", 3).u.values)
    b.close()


# --- after a run ------------------------------------------------------------------------------------------------------


def test_vectors_of_a_run_on_the_command_line_are_taken_while_they_hold(tmp_path):
    folder = film(tmp_path / "film", 4)
    text = 'schema = 1\n[grain_video]\nfile = "piv_*.png"\nframe_rate = 100.0\n'
    (folder / "experiment.toml").write_text(text)
    assert main(["piv", str(folder), "--no-pictures"]) == 0
    b = Benches(folder)
    e = b.earlier()
    assert e.held == ("piv.nc",) and e.changed == () and b.bench.flowing.batch.piv is not None
    same(b.bench.flow(draft_of({}), 2, "v", False).values, of_file(Path(e.results) / "piv.nc", 2).v.values)
    b.close()
    (folder / "experiment.toml").write_text(text + "[params.piv]\nwindow = 32\n")
    b = Benches(folder)
    assert (b.earlier().held, b.earlier().changed) == ((), ("piv.nc",)) and b.bench.flowing.batch is None
    b.close()


def test_a_track_of_the_command_line_is_there_when_the_page_opens(tmp_path, served):
    falling(tmp_path / "drop", lost=(7, 8))
    toml = 'schema = 1\n[rod_video]\nfile = "rod.npy"\nframe_rate = 100.0\nscale = 1e-3\n'
    (tmp_path / "drop" / "experiment.toml").write_text(toml)
    assert main(["track", str(tmp_path / "drop"), "--no-pictures"]) == 0
    s = served(tmp_path / "drop")
    before = asked(s, "api/earlier")
    assert before["held"] == ["track.csv"]
    (warning,) = before["warnings"]
    assert warning["recording"] == "rod_video" and warning["values"]["frame"] == 7
    track = asked(s, "api/track?since=0")
    assert track["finished"] and len(track["rows"]) == 20 and [r[3] != "" for r in track["rows"]].index(True) == 7


# --- by hand, in a browser --------------------------------------------------------------------------------------------


def falling(folder: Path, lost: tuple[int, ...] = ()) -> None:
    """A film of a ball, 20 frames, dark in those that are lost."""
    folder.mkdir()
    y, x = np.mgrid[:160, :120]
    frames = [30 + 170 / (1 + np.exp(np.clip(np.hypot(x - 60, y - 30 - 0.3 * k * k) - 9, -50, 50))) for k in range(20)]
    for k in lost:
        frames[k] = np.full((160, 120), 30.0)
    np.save(folder / "rod.npy", np.array(frames).astype(np.uint8))


def asked(server: Server, path: str):
    with urllib.request.urlopen(server.address + path) as reply:
        return json.loads(reply.read())


@pytest.fixture
def served():
    """Serves the workbench of a path."""
    servers = []

    def serve(path: Path) -> Server:
        servers.append(Server(path, 0))
        threading.Thread(target=servers[-1].serve_forever, daemon=True).start()
        return servers[-1]

    yield serve
    for s in servers:
        s.close()


class Hand:
    """A person at the page: clicks are counted, what the console says is kept."""

    def __init__(self, browser, server: Server, width: int = 1280, height: int = 800, scheme: str = "light"):
        size = {"width": width, "height": height}
        self.page = browser.new_context(viewport=size, color_scheme=scheme, accept_downloads=True).new_page()
        self.clicks, self.said = 0, []
        self.page.on("console", lambda m: self.said.append(m.text))
        self.page.on("pageerror", lambda e: self.said.append(str(e)))
        self.questions = Questions(self.page)
        self.page.goto(server.address)
        self.until("!!window.workbench?.ready")

    def get(self, what: str):
        return self.page.evaluate(what)

    def until(self, what: str, limit: float = 20.0) -> None:
        end = time.monotonic() + limit
        while not self.get(what):
            assert time.monotonic() < end, f"waited too long for {what}; {self.page.inner_text('#trouble')}"
            time.sleep(0.02)

    def click(self, where: str) -> None:
        self.page.locator(where).filter(visible=True).first.click()
        self.clicks += 1

    def choose(self, where: str, value: str) -> None:
        self.page.select_option(where, value)
        self.clicks += 2

    def drag(self, *places: tuple[float, float]) -> None:
        """From place to place of the film, column and row, by pointer events."""
        box, seen = self.page.locator("#film").bounding_box(), []
        for place in places:
            x, y = self.page.evaluate("([c, r]) => workbench.view.toScreen(c, r)", list(place))
            seen.append((box["x"] + x, box["y"] + y))
        self.page.mouse.move(*seen[0])
        self.page.mouse.down()
        for at in seen[1:]:
            self.page.mouse.move(*at, steps=4)
        self.page.mouse.up()
        self.clicks += 1

    def press(self, *places: tuple[float, float]) -> None:
        for c, r in places:
            x, y = self.page.evaluate("([c, r]) => workbench.view.toScreen(c, r)", [c, r])
            self.page.locator("#film").click(position={"x": x, "y": y})
            self.clicks += 1


def test_from_two_pictures_to_a_vorticity_map_and_a_profile(tmp_path, browser, served):
    folder = two_pictures(tmp_path / "pair")
    began = time.monotonic()
    h = Hand(browser, served(folder))
    for word in ("Ball in this frame", "ball [px]", "diameter"):
        assert not h.page.get_by_text(word).filter(visible=True).count()
    h.click("#act")  # match the pair
    h.until("workbench.store.flow")
    h.choose("#map", "vorticity")
    h.until("workbench.store.flow?.name === 'vorticity'")
    h.click("#tab-plot")
    h.click("#line")
    h.drag((30, 60), (90, 62), (140, 64))
    h.until("workbench.store.flow.profile.s")
    assert h.page.locator("#profile canvas").is_visible() and h.page.locator("#colours").is_visible()
    took = time.monotonic() - began
    assert took < 120 and h.clicks <= 8, (took, h.clicks)
    if place := os.environ.get("JUMPVISION_SCREENSHOTS"):
        h.page.screenshot(path=f"{place}/flow.png")
    # what is drawn is the library's, to the last digit
    lines = h.get("workbench.store.table.params.profiles.lines")
    assert lines[0] == pytest.approx([30, -60, 140, -64], abs=1.0)
    b = Benches(folder)
    piv, *_ = b.bench.flowing._pair(Asked.of(b.bench.composed(draft_of({})), None), 0)
    table = along_line(as_matched(piv.field).isel(t=0).transpose("y", "x"), lines[0])
    for column in ("s", "along", "across", "along_sigma", "across_sigma"):
        same(h.get(f"workbench.store.flow.profile.{column}"), table[column].to_numpy())
    same(h.get("workbench.store.flow.values"), derivatives(piv, 1).vorticity.isel(t=0).transpose("y", "x").values)
    b.close()
    with h.page.expect_download() as saved:
        h.page.get_by_role("button", name="Save the profile as CSV").click()
    assert np.array_equal(np.genfromtxt(saved.value.path(), delimiter=",", names=True)["along"], table.along)
    h.drag((140, 64), (140, 40))  # its end is taken hold of
    h.until("Math.abs(workbench.store.table.params.profiles.lines[0][3] + 40) < 1")
    h.page.keyboard.press("Control+z")
    h.until("Math.abs(workbench.store.table.params.profiles.lines[0][3] + 64) < 1")
    assert h.said == []


def test_a_folder_of_pairs_opens_as_pairs_and_their_time_is_typed(tmp_path, browser, served):
    folder = many_pairs(tmp_path / "jet", 10)  # a mean needs as many
    h = Hand(browser, served(folder))
    assert h.page.get_by_label("Pictures", exact=True).input_value() == "names"
    h.click("#act")
    h.until("workbench.store.flow")
    assert h.get("workbench.store.flow.speed") == "px/frame" and "Frames 0 and 1" in h.page.inner_text("#counts")
    h.page.keyboard.press("End")  # B of the last pair: its partner is A of it, not the picture after
    h.until("workbench.store.flow.frame === 18")
    h.page.get_by_role("button", name="Match all pairs").click()
    h.until("workbench.store.flow.mean")
    assert h.page.get_by_text("Mean of 10 fields.").is_visible()
    h.page.keyboard.press("1")
    h.page.get_by_label("Frame rate [1/s]").filter(visible=True).fill("10")
    h.page.get_by_label("From A to B [ms]").fill("2")
    h.until("workbench.store.table.grain_video.pair_time === 0.002")
    h.click("#tab-run")
    h.click("#write")
    h.page.wait_for_selector("text=Written:")
    given = tomllib.loads((folder / "experiment.toml").read_text())["grain_video"]
    assert {k: given[k] for k in ("pairs", "pair_time", "frame_rate")} == {
        "pairs": "names",
        "pair_time": 0.002,
        "frame_rate": 10,
    }
    h.click("#tab-find")
    h.until("workbench.store.flow && !workbench.store.flow.mean && workbench.store.flow.speed === 'px/s'")
    same(h.get("workbench.store.flow.u"), of_file(stage("piv", folder) / "piv.nc", 9).u.values)
    assert h.said == []


def test_what_the_mouse_has_set_is_repeated_by_the_command_line(tmp_path, browser, served):
    folder = film(tmp_path / "film", 4)
    h = Hand(browser, served(folder))
    label = lambda text: h.page.get_by_label(text, exact=True).filter(visible=True)  # noqa: E731
    label("Frame rate [1/s]").fill("250")
    h.page.locator("button[data-tool=marks]").filter(visible=True).click()
    h.drag((10, 100), (110, 100))
    label("Its length [mm]").fill("5")
    h.page.locator("button[data-tool=leave_out]").filter(visible=True).click()
    h.press((10, 10), (60, 10), (30, 50))
    h.page.keyboard.press("Enter")
    h.click("#act")
    h.until("workbench.store.flow")
    for text, value in (
        ("Window [px]", "32"),
        ("Step [px]", "10"),
        ("Local contrast (CLAHE), tiles of [px], 0: off", "40"),
    ):
        label(text).fill(value)
    label("Background").select_option("minimum")
    label("Show the picture as it is matched").check()
    h.until("workbench.store.lit")
    h.until("workbench.store.table.params?.piv?.background === 'minimum'")
    h.page.keyboard.press("Tab")
    h.until("Math.round(workbench.store.flow.columns[1] - workbench.store.flow.columns[0]) === 10")
    h.questions.answered()
    seen = h.get("[workbench.store.flow.u, workbench.store.flow.v, workbench.store.flow.speed]")
    h.click("#tab-run")
    h.click("#write")
    h.page.wait_for_selector("text=Written:")
    text = tomllib.loads((folder / "experiment.toml").read_text())
    assert text["params"]["piv"] == {"window": 32, "step": 10, "clahe": 40, "background": "minimum"}
    assert text["grain_video"]["scale"] == pytest.approx(5e-5, rel=0.03) and len(text["grain_video"]["leave_out"]) == 1
    field = of_file(stage("piv", folder) / "piv.nc", 0)
    same(seen[0], field.u.values)
    same(seen[1], field.v.values)
    assert seen[2] == "m/s" and h.said == []


def test_all_pairs_are_matched_with_progress_and_their_mean_is_shown(tmp_path, browser, served):
    h = Hand(browser, served(film(tmp_path / "film")))
    h.page.keyboard.press("t")
    h.until("workbench.store.flow")
    h.page.get_by_role("button", name="Match all pairs").click()
    h.until("workbench.store.flow.mean")
    assert h.page.get_by_text("Mean of 12 fields.").is_visible()
    h.page.select_option("#map", "tke")
    h.until("workbench.store.flow.name === 'tke'")
    assert h.get("workbench.store.flow.unit") == "px^2/s^2" and h.said == []


def test_the_matching_of_all_pairs_is_stopped_by_its_button(tmp_path, browser, served, monkeypatch):
    slow = Batch._progress

    def told(self, what, done, total):
        time.sleep(0.05)
        slow(self, what, done, total)

    monkeypatch.setattr(Batch, "_progress", told)
    s = served(film(tmp_path / "film", 60))
    h = Hand(browser, s)
    h.page.keyboard.press("2")
    h.page.get_by_role("button", name="Match all pairs").click()
    h.until("document.querySelector('progress[aria-label=\"Pairs matched\"]').value > 2")
    h.page.get_by_role("button", name="Stop", exact=True).filter(visible=True).click()
    h.page.get_by_text("stopped", exact=True).wait_for()
    batch = s.benches.bench.flowing.batch
    assert not batch.running and batch.piv is None and 2 < batch.done < 59
    assert h.page.get_by_role("button", name="Match all pairs").is_enabled()
    monkeypatch.undo()
    h.page.get_by_role("button", name="Match all pairs").click()  # and again, to its end
    h.until("workbench.store.flow?.mean", 60)
    assert h.get("workbench.store.flow.fields") == 59 and h.said == []


def test_a_track_of_the_command_line_is_plotted_without_tracking_again(tmp_path, browser, served, monkeypatch):
    folder = tmp_path / "drop"
    falling(folder, lost=(7,))
    toml = 'schema = 1\n[rod_video]\nfile = "rod.npy"\nframe_rate = 100.0\nscale = 1e-3\n'
    toml += '[rod_corrections]\nfile = "corrections.csv"\n'
    (folder / "experiment.toml").write_text(toml)
    (folder / "corrections.csv").write_text("frame,x_px,y_px,sigma_px\n7,60,44.7,0.5\n")
    anew = Benches(folder)
    draft = draft_of({"corrections": {"7": [60, 44.7]}})
    anew.bench.follow(draft)
    while anew.bench.following.running:
        time.sleep(0.02)
    expected = anew.bench.motion(draft).columns()
    anew.close()
    assert main(["track", str(folder), "--no-pictures"]) == 0
    monkeypatch.setattr(BallFilm, "see", None)  # nothing follows a ball any more
    monkeypatch.setattr(BallFilm, "tracks", None)
    s = served(folder)
    h = Hand(browser, s)
    h.until("workbench.store.track.rows.length === 20")
    h.click("#tab-plot")
    h.until("workbench.store.columns")
    found = h.get("workbench.store.columns.table")
    assert s.benches.bench.following is None and set(found) == set(expected.table)
    for name, values in expected.table.items():
        assert json.loads(json.dumps(plain(values))) == found[name], name  # to the last bit
    assert h.said == []
    motion, b = (lambda d: s.benches.bench.motion(draft_of(d))), {"corrections": {"7": [60, 44.7]}}
    with pytest.raises(InputError, match="correction of frame 7 was removed"):
        motion({})
    for values in ({"params.track": {"search": 3.0}}, {"rod_video": {"exposure": 1e-3}}):
        with pytest.raises(InputError, match="made with other values"):
            motion(b | {"values": values})
    twice = motion(b | {"values": {"rod_video": {"scale": 2e-3}}}).columns().table["height_m"]
    np.testing.assert_allclose(np.array(twice, float), 2 * np.array(expected.table["height_m"], float), rtol=1e-9)


def test_after_another_experiment_the_track_is_there_still(tmp_path, browser, served, monkeypatch):
    for name in ("a", "b"):
        (tmp_path / "drops").mkdir(exist_ok=True)
        falling(tmp_path / "drops" / name)
    h = Hand(browser, served(tmp_path / "drops"))
    h.page.keyboard.press("t")
    h.until("workbench.store.track.finished && workbench.store.track.rows.length === 20")
    track = h.get("workbench.store.track.rows")
    monkeypatch.setattr(BallFilm, "see", None)
    monkeypatch.setattr(BallFilm, "tracks", None)
    h.page.select_option("#experiment", "b")
    h.until("workbench.store.state.name === 'b' && workbench.store.track.rows.length === 0")
    h.page.select_option("#experiment", "a")
    h.until("workbench.store.state.name === 'a' && workbench.store.track.rows.length === 20")
    assert h.get("workbench.store.track.rows") == track and h.get("workbench.store.track.finished")
    h.click("#tab-plot")
    h.until("workbench.store.columns")
    assert len(h.get("workbench.store.columns.table.frame")) == 20 and h.said == []


def test_a_report_is_shown_inside_and_a_warning_goes_to_its_frame(tmp_path, browser, served):
    falling(tmp_path / "drop", lost=(7, 8))
    toml = 'schema = 1\n[rod_video]\nfile = "rod.npy"\nframe_rate = 100.0\nscale = 1e-3\n'
    (tmp_path / "drop" / "experiment.toml").write_text(toml)
    results = tmp_path / "results" / "drop"
    assert main(["track", str(tmp_path / "drop"), "--no-pictures"]) == 0
    (results / "report.html").write_text("<p>found</p><script>document.body.append('by a script')</script>")
    h = Hand(browser, served(tmp_path / "drop"))
    h.until("workbench.store.track.rows.length === 20")
    h.click("#tab-run")
    h.page.get_by_role("button", name="Show the report").click()
    inside = h.page.frame_locator("#report")
    inside.get_by_text("by a script").wait_for()
    h.page.get_by_role("button", name="Frame 7").click()
    h.until("workbench.store.frame === 7")
    assert h.page.locator("#film").is_visible() and h.said == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize(("width", "height"), [(1280, 800), (820, 1180)])
def test_no_serious_finding_of_axe_with_a_flow(scheme, width, height, tmp_path, browser, served):
    module = pytest.importorskip("axe_playwright_python.sync_playwright", reason="pip install axe-playwright-python")
    h = Hand(browser, served(two_pictures(tmp_path / "pair")), width, height, scheme)
    h.page.keyboard.press("t")
    h.until("workbench.store.flow")
    found = {}
    for step in "1245":
        h.page.keyboard.press(step)
        h.page.wait_for_timeout(60)
        for v in module.Axe().run(h.page).response["violations"]:
            if v["impact"] in ("serious", "critical"):
                found[step, v["id"]] = [n["html"] for n in v["nodes"]]
        assert h.get("document.documentElement.scrollWidth") <= width  # nothing is cut at the side
    assert found == {} and h.said == []


def test_the_bed_s_threshold_is_moved_by_hand_and_written(tmp_path, browser, served):
    folder = tmp_path / "bed"
    folder.mkdir()
    rng, rows = np.random.default_rng(1), np.arange(200)[:, None]
    surface = 80 + 4 * np.sin(np.arange(240) / 30)
    light = (
        40 + 170 / (1 + np.exp((rows - surface) / 6.0)) + rng.normal(0, 1, (200, 240))
    )  # a soft edge: the level counts
    cv2.imwrite(str(folder / "bed.png"), np.clip(light, 0, 255).astype(np.uint8))
    (folder / "experiment.toml").write_text(
        'schema = 1\n[bed_image]\nfile = "bed.png"\nscale = 1e-3\nfloor_row = 190\n'
        "[bed]\nsolid_volume = 2e-3\nlength = 0.24\nwidth = 0.15\n"
    )
    h = Hand(browser, served(folder))
    h.page.keyboard.press("t")
    h.until("workbench.store.bed")
    assert "phi" in h.page.inner_text("#packing")
    h.page.get_by_label("Surface by").select_option("threshold")
    level = h.page.get_by_label("Grains are darker than [grey levels]")
    level.wait_for()
    h.until("workbench.store.bed.threshold > 0")
    before = h.get("workbench.store.bed.row")
    box = level.bounding_box()
    h.page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + box["height"] / 2)
    h.page.mouse.down()
    h.page.mouse.move(box["x"] + 0.25 * box["width"], box["y"] + box["height"] / 2, steps=5)
    h.page.mouse.up()
    let_go = float(level.input_value())  # where the pointer left it: every level it passed was drawn too
    h.until(f"workbench.store.table.params?.bed?.threshold === {let_go} && workbench.store.bed.threshold === {let_go}")
    seen, set_to = h.get("workbench.store.bed.row"), h.get("workbench.store.bed.threshold")
    assert np.mean(seen) > np.mean(before) + 2  # darker: deeper
    h.click("#tab-run")
    h.click("#write")
    h.page.wait_for_selector("text=Written:")
    assert tomllib.loads((folder / "experiment.toml").read_text())["params"]["bed"] == {
        "method": "threshold",
        "threshold": set_to,
    }
    found = json.loads((stage("bed", folder) / "bed.json").read_text())
    assert np.round(found["profile"]["row_px"], 2).tolist() == seen and h.said == []


def test_the_crater_s_threshold_and_radius_are_moved_by_hand_and_written(tmp_path, browser, served):
    """A line that is faint on one side: how faint may be moved, and the run finds what was seen, to the last digit."""
    folder = tmp_path / "crater"
    folder.mkdir()
    rng, x, rows = np.random.default_rng(2), np.arange(300), np.arange(120)[:, None]
    line = 50 + 25 * np.exp(-(((x - 150.3) / 40) ** 2))
    crest = np.where(x < 40, 24.0, 160.0)  # 40 columns at 0.15 of the rest
    light = 20 + crest * np.exp(-0.5 * ((rows - line) / 1.8) ** 2) + rng.normal(0, 1, (120, 300))
    cv2.imwrite(str(folder / "crater.png"), np.clip(light, 0, 255).astype(np.uint8))
    (folder / "experiment.toml").write_text('schema = 1\n[crater_image]\nfile = "crater.png"\nscale = 1e-3\n')
    h = Hand(browser, served(folder))
    h.page.keyboard.press("t")
    h.until("workbench.store.bed")
    assert h.get("workbench.store.bed.lost") == pytest.approx(40, abs=4) and "cm³" in h.page.inner_text("#volume")
    level = h.page.get_by_label("Least contrast of the line (share of the typical)")
    box = level.bounding_box()
    h.page.mouse.move(box["x"] + 0.2 * box["width"], box["y"] + box["height"] / 2)
    h.page.mouse.down()
    h.page.mouse.move(box["x"] + 0.06 * box["width"], box["y"] + box["height"] / 2, steps=5)
    h.page.mouse.up()
    let_go = float(level.input_value())
    h.until(f"workbench.store.table.params?.crater?.contrast === {let_go} && workbench.store.bed.contrast === {let_go}")
    assert h.get("workbench.store.bed.lost") < 10
    h.page.get_by_label("Undisturbed beyond [mm]").fill("110")
    h.until("workbench.store.bed.radius === 0.11")
    seen = h.get("workbench.store.bed")
    good = [k for k, r in enumerate(seen["row"]) if r is not None]
    assert np.abs(np.array(seen["row"])[good].astype(float) - line[good])[40:].max() < 0.5
    h.click("#tab-run")
    h.click("#write")
    h.page.wait_for_selector("text=Written:")
    written = tomllib.loads((folder / "experiment.toml").read_text())["params"]["crater"]
    assert written == {"contrast": let_go, "radius": 0.11}
    found = json.loads((stage("crater", folder) / "crater.json").read_text())
    assert [found["volume_m3"], found["sigma_m3"]] == seen["volume"] and h.said == []
    rounded = [None if r is None else round(r, 2) for r in found["line"]["row_px"]]
    assert rounded == seen["row"]


def test_a_campaign_at_a_glance_marks_what_stands_out_and_opens_it(tmp_path, browser, served):
    campaign = tmp_path / "drops"
    campaign.mkdir()
    for name, lost in (("a", ()), ("b", (7, 8)), ("c", ())):
        falling(campaign / name, lost)
        toml = 'schema = 1\n[rod_video]\nfile = "rod.npy"\nframe_rate = 100.0\nscale = 1e-3\n'
        (campaign / name / "experiment.toml").write_text(toml)
        results = tmp_path / "results" / "drops" / name
        results.mkdir(parents=True)
        told = [{"kind": "frames", "message": "2 frames lost", "recording": "rod_video", "values": {}}] if lost else []
        numbers = {"jump_height_m": 0.03, "sigma_m": 1e-4, "simulated_height_m": 0.031}
        text = json.dumps({"experiment": name, "kind": "single", "warnings": told} | numbers)
        (results / "summary.json").write_text(text)
    h = Hand(browser, served(campaign))
    h.click("#glance-open")
    h.page.wait_for_selector("#glance tbody tr")
    first = h.page.locator("#glance tbody tr").first
    assert first.inner_text().split("\t")[2:] == ["b", "single", "30.00 ± 0.10", "+1.00", "1 warning", ""]
    h.until("[...document.querySelectorAll('#glance img')].every((i) => i.complete && i.naturalWidth > 0)")
    assert h.page.locator("#glance tr.odd").count() == 1
    h.page.get_by_role("button", name="c", exact=True).click()
    h.until("workbench.store.state.name === 'c'")
    assert h.said == []


def test_why_a_jump_stands_out_is_shown_of_its_results(tmp_path, browser, served):
    """Residual, the film's frame where it is greatest, and the log, side by side; the results stay as they are."""
    t, campaign = np.arange(20) / 100, tmp_path / "drops"
    campaign.mkdir()
    for name in ("a", "b"):
        falling(campaign / name)
        toml = '[rod_video]\nfile = "rod.npy"\nframe_rate = 100.0\nscale = 1e-3\n[motor_log]\nfile = "motor.csv"\n'
        (campaign / name / "experiment.toml").write_text(f"schema = 1\n{toml}")
        rows = "".join(f"{s:.3f},{0.001 * (k > 9)}\n" for k, s in enumerate(t))
        (campaign / name / "motor.csv").write_text(f"time_s,position_m\n{rows}")
        results = tmp_path / "results" / "drops" / name
        results.mkdir(parents=True)
        height = -0.0003 * np.arange(20.0) ** 2
        missed = 0.004 * np.exp(-((np.arange(20) - 13.0) ** 2))  # measured less simulated, greatest in frame 13
        lines = [f"{s},{h + m if name == 'b' else h},1e-5" for s, h, m in zip(t, height, missed)]
        (results / "rod.csv").write_text("\n".join(["time_s,height_m,sigma_m", *lines, ""]))
        lines = [f"{s},{0.2 + h},0,0,0,0" for s, h in zip(t, height)]
        (results / "simulation.csv").write_text(
            "\n".join(["time_s,rod_m,foot_m,motor_m,ground_N,spring_N", *lines, ""])
        )
        lines = [f"{k},{s},60,{30 + 0.3 * k * k},0.1,0,1e-5," for k, s in enumerate(t)]
        head = "frame,time_s,x_px,y_px,sigma_px,height_m,sigma_m,flag"
        (results / "track.csv").write_text("\n".join([head, *lines, ""]))
        (results / "summary.json").write_text(json.dumps({"experiment": name, "kind": "single", "jump_height_m": 0.03}))
    kept = {f: f.read_bytes() for f in sorted((tmp_path / "results").rglob("*")) if f.is_file()}
    h = Hand(browser, served(campaign))
    h.click("#glance-open")
    h.page.get_by_role("button", name="Why b").click()
    h.page.get_by_text("b: greatest residual 4.00 mm at 0.130 s").wait_for()
    found = h.get("workbench.store.why")
    assert found["frame"] == 13 and found["greatest"] == pytest.approx(0.004, abs=1e-9)
    np.testing.assert_allclose(found["y"], missed, atol=1e-12)
    h.until("document.querySelector('#why img').naturalWidth > 0")
    panels = h.page.locator("#why figure")
    assert panels.count() == 3 and "position (motor_log)" in panels.nth(2).inner_text()
    assert len({round(panels.nth(k).bounding_box()["y"]) for k in range(3)}) == 1  # side by side
    assert h.get("[...document.querySelectorAll('#why figure')].every((f) => f.scrollWidth <= f.clientWidth)")
    if place := os.environ.get("JUMPVISION_SCREENSHOTS"):
        h.page.screenshot(path=f"{place}/why.png")
    h.page.get_by_role("button", name="Why a").click()
    h.page.get_by_text("a: greatest residual 0.00 mm").wait_for()
    now = {f: f.read_bytes() for f in sorted((tmp_path / "results").rglob("*")) if f.is_file()}
    assert now == kept and h.said == []


def test_a_diagnosis_says_how_far_its_models_miss_a_jump():
    heights = [Height("b", "single", 7.0, None, 0.57, 0.030, 1e-5, 0.032, 0.0301)]
    cells = [Cell("single", "flight", -0.003, 9.0, 0.0, 9), Cell("stutter", "rest", 0.1, 9.0, 0.0, 9)]
    d = SimpleNamespace(heights=heights, where=cells)
    texts = said(d, "b")
    assert texts[:2] == ["model: height +2.00 mm", "extended model: height +0.10 mm"] and "flight, -3.00 mm" in texts[2]
    assert said(d, "a") == said(None, "b") == []


def test_the_cause_of_a_diagnosis_stands_beside_the_residual():
    """What is named for all jumps, and what is odd of one of them only there; nothing where nothing is known."""
    apart = {"p_value": 1e-9, "of": None, "unit": "1", "declared": 1.0, "at": {}}
    odd = [
        Varies("scale", Pattern.ODD, recordings=("b",), value=1.04, low=1.03, high=1.05, established=e, **apart)
        for e in (True, False)
    ]
    strength = {"C": parameter(2.7, 0.2)}
    lacking = diagnosis(named=("added_mass",), causes=named_causes(("added_mass",), strength), varies=(odd[0],))
    assert causes(None, "b") == []
    texts = causes(lacking, "b")
    assert "scale" in texts[0] and "4" in texts[0] and len(texts) == 2
    assert texts[1] == causes(lacking, "a")[0] and len(causes(lacking, "a")) == 1
    assert texts[1].startswith("the model lacks: added mass of the jammed cone (probability 0.9")
    assert "C = 2.7" in texts[1]
    assert causes(diagnosis(varies=(odd[1],)), "b") == ["diagnosis: no cause is named"]
    assert causes(diagnosis(verdict="adequate"), "b") == ["diagnosis: the model is adequate"]


@pytest.mark.long
def test_memory_is_flat_however_long_the_film_is(tmp_path, browser):
    """Peak of the server's process, in its own: a hand scrubs, then every frame is asked for once."""
    if not Path("/proc/self/status").exists():
        pytest.skip("the peak of another process is read in /proc, which this system has not")
    peaks = {n: scrubbed(tmp_path / str(n), n, browser) for n in (1000, 10_000)}
    assert peaks[10_000] <= 1.10 * peaks[1000], peaks


def scrubbed(folder: Path, n: int, browser) -> float:
    """Largest resident memory [MiB] of a server that showed all of a film of n frames, 96 x 64 px."""
    folder.mkdir()
    out = cv2.VideoWriter(str(folder / "rod.avi"), cv2.VideoWriter.fourcc(*"MJPG"), 100.0, (96, 64))
    for k in range(n):
        image = np.full((64, 96, 3), 30, np.uint8)
        out.write(cv2.circle(image, (48, int(32 + 16 * np.sin(k / 30))), 8, (200, 200, 200), -1, cv2.LINE_AA))
    out.release()
    command = [*SELF, "open", str(folder), "--no-browser", "--port", "0"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as run:
        try:
            h = Hand(browser, SimpleNamespace(address=(address := run.stdout.readline().strip())))
            box = h.page.locator("#scrub").bounding_box()
            at = box["y"] + box["height"] / 2
            h.page.mouse.move(box["x"] + 8, at)
            h.page.mouse.down()
            for share in (0.97, 0.1, 0.6, 0.3, 0.9):  # forth and back
                h.page.mouse.move(box["x"] + share * box["width"], at, steps=25)
            h.page.mouse.up()
            h.until(f"workbench.store.frame > {0.8 * n} && workbench.player.shown === workbench.store.frame")
            h.page.context.close()
            asking = http.client.HTTPConnection(*address.split("/")[2].split(":"))
            for k in range(n):
                asking.request("GET", f"/{address.split('/', 3)[3]}api/frame/rod_video/{k}/96.jpg")
                reply = asking.getresponse()
                assert reply.read()[:2] == b"\xff\xd8" and reply.status == 200
            status = Path(f"/proc/{run.pid}/status").read_text()
            return int(status.partition("VmHWM:")[2].split()[0]) / 1024
        finally:
            run.terminate()
