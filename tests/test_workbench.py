"""The workbench: it shows what the stages give, what it writes stays readable; and the page in a real browser."""

from __future__ import annotations

import http.client
import json
import math
import shutil
import threading
import time
import tomllib
from pathlib import Path

import cv2
import numpy as np
import pytest
from conftest import SAMPLES
from pace import Questions, in_time

from jumpvision.base.schema import InputError
from jumpvision.browser.workbench.bench import Benches
from jumpvision.browser.workbench.draft import CORRECTIONS, draft_of
from jumpvision.browser.workbench.films import Shown
from jumpvision.browser.workbench.logs import POINTS, thinned
from jumpvision.browser.workbench.running import Running
from jumpvision.browser.workbench.server import Server
from jumpvision.cli import main
from jumpvision.experiment.init.edit import edited
from jumpvision.experiment.init.measure import tilt_of
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.inputs.sections import Calibration, RodCorrections, RodVideo
from jumpvision.experiment.stages.track import track
from jumpvision.films.calibration import CLICKED_MARK
from jumpvision.films.parameters import TrackParams
from jumpvision.films.vision.camera import camera

HARD = SAMPLES / "hard_ground"
SAND = SAMPLES / "loose_sand" / "stutter-7.0Hz-film"
SEEN = ("x_px", "y_px", "sigma_px", "flag")


def falling(folder: Path, n: int = 40, columns: int = 160, rows: int = 240) -> np.ndarray:
    """A film of a bright ball of 18 px on a parabola, written as rod.npy; true (n, 2) column, row."""
    folder.mkdir(parents=True, exist_ok=True)
    rng, t = np.random.default_rng(4), np.arange(n) / n
    truth = np.column_stack([60.3 + 20 * t, 200 - 400 * t * (1 - t)])
    y, x = np.mgrid[:rows, :columns]
    film = [30 + 170 / (1 + np.exp(np.clip((np.hypot(x - c, y - r) - 9) / 0.6, -50, 50))) for c, r in truth]
    np.save(folder / "rod.npy", np.clip(np.array(film) + rng.normal(0, 2, (n, rows, columns)), 0, 255).astype(np.uint8))
    return truth


@pytest.fixture
def hard(tmp_path) -> Path:
    shutil.copytree(HARD, tmp_path / "hard", ignore=shutil.ignore_patterns("truth.json"))
    return tmp_path / "hard"


@pytest.fixture
def served():
    """Serves the workbench of a path."""
    open_ones = []

    def serve(path: Path, study: str = "") -> Server:
        s = Server(path, 0, study)
        open_ones.append(s)
        threading.Thread(target=s.serve_forever, daemon=True).start()
        return s

    yield serve
    for s in open_ones:
        s.close()


def asked(server: Server, path: str, question: object = None, **headers: str) -> tuple[int, object]:
    c = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
    path = server.root + path.removeprefix("/")
    if question is None:
        c.request("GET", path, headers=headers)
    else:
        body = question if isinstance(question, bytes) else json.dumps(question)
        c.request("POST", path, body, {"Content-Type": "application/json"} | headers)
    reply = c.getresponse()
    content, kind = reply.read(), reply.headers.get_content_type()
    c.close()
    return reply.status, json.loads(content) if kind == "application/json" else content


def until(what, limit: float = 60.0) -> None:
    end = time.monotonic() + limit
    while not what():
        assert time.monotonic() < end, "waited too long"
        time.sleep(0.02)


# --- corrections by hand ---------------------------------------------------------------------------------------------


def test_a_correction_is_taken_marked_and_kept_beside_what_was_found(hard):
    e = open_experiment(hard)
    film, p = e.section(RodVideo), TrackParams(**e.params.get("track", {}), exposure_correction="none")
    plain = track(film, None, None, p=p).table
    (hard / CORRECTIONS).write_text("frame,x_px,y_px,sigma_px\n7,25.5,60.25,0.5\n300,24,61,0.8\n")
    by_hand = RodCorrections(CORRECTIONS, path=hard / CORRECTIONS)
    table = track(film, None, None, by_hand, p=p).table
    rows = [7, 300]
    assert table.corrected.to_numpy().nonzero()[0].tolist() == rows
    assert table.loc[rows, ["x_px", "y_px", "sigma_px"]].to_numpy().tolist() == [[25.5, 60.25, 0.5], [24, 61, 0.8]]
    assert (
        table.loc[rows, ["x_found_px", "y_found_px"]].to_numpy() == plain.loc[rows, ["x_px", "y_px"]].to_numpy()
    ).all()
    others = table.index.difference(rows)
    for column in plain.columns:  # all else as it was, bit for bit, but what rests on neighbours
        if not column.startswith("exposure_shift"):
            assert plain[column][others].equals(table[column][others]), column
    # up is against the rows: a row lower by so much is a height lower by so much times the scale
    down = table.y_px[7] - plain.y_px[7]
    assert table.height_m[7] - plain.height_m[7] == pytest.approx(-down * film.scale, abs=1e-12)
    for text, said in (("719,1,1,0.5", "0 to 718"), ("3.5,1,1,0.5", "frame = 3.5"), ("3,1,1,0", "above 0 px")):
        (hard / CORRECTIONS).write_text(f"frame,x_px,y_px,sigma_px\n{text}\n")
        with pytest.raises(InputError, match=said):
            track(film, None, None, by_hand, p=p)


def test_a_lost_frame_is_found_by_hand(tmp_path):
    truth = falling(tmp_path)
    film = np.load(tmp_path / "rod.npy")
    film[20] = 30  # a flash of darkness
    np.save(tmp_path / "rod.npy", film)
    (tmp_path / CORRECTIONS).write_text(f"frame,x_px,y_px,sigma_px\n20,{truth[20][0]},{truth[20][1]},0.5\n")
    head = 'schema = 1\n[rod_video]\nfile = "rod.npy"\nframe_rate = 100.0\nscale = 1e-3\n'
    (tmp_path / "experiment.toml").write_text(head + f'[rod_corrections]\nfile = "{CORRECTIONS}"\n')
    assert main(["track", str(tmp_path), "--results", str(tmp_path / "results"), "--no-pictures"]) == 0
    import pandas as pd

    table = pd.read_csv(tmp_path / "results" / "track.csv", keep_default_na=False)
    assert table.flag[20] == "" and table.flag_found[20].startswith("lost")
    off = np.hypot(table.x_px.astype(float) - truth[:, 0], table.y_px.astype(float) - truth[:, 1])
    assert off.max() < 6 * table.sigma_px.astype(float).max() and off[20] < 1e-6


# --- what is shown is what the stages give ---------------------------------------------------------------------------


def test_the_track_that_is_watched_is_the_stage_s(hard):
    e = open_experiment(hard)
    expected = track(
        e.section(RodVideo), e.section(Calibration), None, p=TrackParams(**e.params.get("track", {}))
    ).table
    b = Benches(hard)
    b.bench.follow(draft_of({}))
    until(lambda: not b.bench.following.running)
    rows, run = b.bench.followed(0)
    assert run.finished and not run.problem and len(rows) == len(expected)
    for k, column in enumerate(SEEN):
        assert [r[k] for r in rows] == [None if v != v else v for v in expected[column]], column
    b.close()


def test_a_run_is_stopped_where_it_is_and_its_rows_stay(hard, monkeypatch):
    b = Benches(hard)
    shown = threading.Event()
    one = type(b.bench.film("rod_video").film).__getitem__
    slow = lambda self, i: (shown.set(), time.sleep(0.002), one(self, i))[2]  # noqa: E731
    monkeypatch.setattr(
        "jumpvision.films.frames.base.Film.__iter__", lambda self: (slow(self, i) for i in range(len(self)))
    )
    b.bench.follow(draft_of({}))
    until(lambda: len(b.bench.followed(0)[0]) >= 32)
    b.bench.following.stop()
    rows, run = b.bench.followed(0)
    assert 32 <= len(rows) < 719 and not (run.finished or run.running or run.problem) and not any(r[3] for r in rows)
    assert len(b.bench.followed(10)[0]) == len(rows) - 10
    b.close()


def test_a_frame_is_shown_as_it_is(tmp_path):
    truth = falling(tmp_path)
    s = Shown(tmp_path / "rod.npy")
    for i, width, k in ((0, 160, 1.0), (17, 80, 0.5)):
        grey = cv2.imdecode(np.frombuffer(s.jpeg(i, width), np.uint8), cv2.IMREAD_GRAYSCALE).astype(float)
        assert grey.shape == (round(240 * k), width)
        weight = np.where(grey > 128, grey, 0)
        y, x = np.indices(grey.shape)
        place = np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()
        assert np.abs((place + 0.5) / k - 0.5 - truth[i]).max() < 0.3  # of a disc of 18 px by its bright half
    with pytest.raises(InputError, match=r"frame = 40: must be in \[0, 39\]"):
        s.jpeg(40, 160)
    s.close()


def test_lines_of_long_logs_keep_their_extremes():
    t = np.linspace(0, 1, 200_003)
    y = np.sin(40 * t)
    y[[777, 150_001]] = 9.0, -9.0
    seen_t, seen_y = thinned(t, y)
    assert len(seen_t) <= POINTS and (np.diff(seen_t) > 0).all()
    assert seen_y.max() == 9.0 and seen_y.min() == -9.0 and t[777] in seen_t


@pytest.mark.parametrize("up", ["-y", "+y", "-x", "+x"])
def test_the_rail_s_angle_makes_a_motion_along_it_all_height(up):
    along = {"-y": (12.0, -200.0), "+y": (12.0, 200.0), "-x": (-200.0, 12.0), "+x": (200.0, 12.0)}[up]
    a, length = np.array([300.0, 300.0]), math.hypot(*along)
    for b in (a + along, a - along):  # whichever end is clicked first
        view = camera(scale=1e-3, up=up, tilt=tilt_of((*a, *b), up), marks=(), k1=0, k2=0, centre=(0.0, 0.0))
        x, y = np.array([a, a + along]).T
        assert np.diff(view.height(x, y)) == pytest.approx(1e-3 * length, rel=1e-9)


# --- what is written -------------------------------------------------------------------------------------------------


TEXT = """# my words
schema = 1

[rod_video]   # the film
file = "rod.avi"
# scale =                       # m/px
up = "-y"  # as mounted

# [clock]
# offset_sigma =

[robot.sigma]
rod_mass = 0.1
"""


def test_an_edit_changes_its_lines_and_no_other():
    rod = {"scale": (1e-3, "marks"), "up": ("+x", ""), "start": (0.5, "")}
    others = {"clock": {"offset_sigma": (0.01, "drag")}, "params.track": {"seed": ([1.5, 2.0], "")}}
    new = edited(TEXT, {"rod_video": rod, **others}, "f")
    table = tomllib.loads(new)
    assert table["rod_video"] == {"file": "rod.avi", "scale": 1e-3, "up": "+x", "start": 0.5}
    assert table["clock"] == {"offset_sigma": 0.01} and table["params"]["track"]["seed"] == [1.5, 2.0]
    assert table["robot"] == {"sigma": {"rod_mass": 0.1}}
    kept = [line for line in TEXT.split("\n") if not any(w in line for w in ("scale =", "up =", "offset", "[clock]"))]
    assert [line for line in new.split("\n") if line in kept and line] == [line for line in kept if line]
    assert edited(new, {"rod_video": {"scale": (1e-3, "marks")}}, "f") == new  # twice is once
    with pytest.raises(InputError, match=r"f: \[a\] cannot be edited"):
        edited("a = 1\n", {"a": {"b": ([2], "")}}, "f")


@pytest.mark.parametrize(
    ("text", "new"),
    [
        ("[a]\nb = [\n 1,  # one\n]\nc = 3\n", "[a]\nb = [2]\nc = 3\n"),
        ("a = { b = [1], c = 3 }  # all\n", "a = { b = [2], c = 3 }  # all\n"),
        ("a.b = [1]\r\na.c = 3\r\n", "a.b = [2]\r\na.c = 3\r\n"),
        ("# mine\n[a]\n  'b'=[1]   # why\n\n\n# end", "# mine\n[a]\n  'b'=[2]   # why\n\n\n# end"),
    ],
)
def test_a_value_is_replaced_however_it_is_written(text, new):
    assert edited(text, {"a": {"b": ([2], "")}}, "f") == new
    assert edited(text, {"a": {"b": ([1], "again")}}, "f") == text  # nothing changes: not a byte


@pytest.mark.parametrize(
    ("text", "new"),
    [
        ("a.c = 3\n[d]\n", "a.c = 3\na.b = 2\n[d]\n"),
        ("[a]\nc = 3\n\n# of d\n[d]\n[a.e]\nx = 1\n", "[a]\nc = 3\n\n# of d\nb = 2\n[d]\n[a.e]\nx = 1\n"),
        ("[a]\nc = 3\n\n# of d\n[d]\nb = 1\n", "[a]\nc = 3\nb = 2\n\n# of d\n[d]\nb = 1\n"),
        ("[d]\n\n# [a]  # open\n# c = # m\n# b = # m\n", "[d]\n\n[a]  # open\n# c = # m\nb = 2\n"),
    ],
)
def test_a_value_is_put_into_its_section_however_that_is_written(text, new):
    assert edited(text, {"a": {"b": (2, "")}}, "f") == new


def test_nothing_is_written_over_that_somebody_else_changed(tmp_path, served):
    falling(tmp_path)
    s = served(tmp_path)
    draft = {
        "picks": {"rod_video": {"ball": [60, 200], "ball_diameter": 9.5}},
        "values": {"rod_video": {"frame_rate": 250}},
        "corrections": {"3": [61.5, 190]},
    }
    status, made = asked(s, "/api/preview", {"draft": draft})
    assert status == 200 and not list(tmp_path.glob("*.toml")) and made["table"]["rod_video"]["frame_rate"] == 250
    (tmp_path / "experiment.toml").write_text("schema = 1\n")
    status, said = asked(s, "/api/write", {"draft": draft, "seen": made["seen"]})
    assert status == 400 and "changed on the disk" in said["problems"][0]
    assert (tmp_path / "experiment.toml").read_text() == "schema = 1\n" and not (tmp_path / CORRECTIONS).exists()
    added = asked(s, "/api/preview", {"draft": draft})[1]["table"]["rod_video"]  # to what is there now
    assert added["file"] == "rod.npy" and added["frame_rate"] == 250
    (tmp_path / "experiment.toml").unlink()
    status, said = asked(s, "/api/write", {"draft": draft, "seen": made["seen"]})
    assert (status, said) == (200, {"written": [CORRECTIONS, "experiment.toml"]})
    e = open_experiment(tmp_path)
    assert e.section(RodVideo).ball_diameter == 0.0095 and e.section(RodCorrections).file == CORRECTIONS
    assert (tmp_path / CORRECTIONS).read_text() == f"frame,x_px,y_px,sigma_px\n3,61.5,190,{CLICKED_MARK.value:g}\n"
    # the scale is the ball's diameter over what was drawn, to the 1 % that it states
    assert e.section(RodVideo).scale == pytest.approx(9.5e-3 / 18, rel=0.02)
    assert Benches(tmp_path).bench.corrections() == {3: (61.5, 190.0)}


def test_init_pick_writes_what_is_known_and_opens_the_workbench(tmp_path, monkeypatch, capsys):
    falling(tmp_path)
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)

    def stopped(self) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Server, "serve_forever", stopped)
    assert main(["init", str(tmp_path), "--pick"]) == 0
    assert (tmp_path / "experiment.toml").exists() and opened[0].startswith("http://127.0.0.1:")
    assert main(["open", str(tmp_path / "rod.npy"), "--no-browser"]) == 0 and len(opened) == 1
    assert main(["open", str(tmp_path / "none")]) == 2
    assert "none: does not exist" in capsys.readouterr().err


# --- the server ------------------------------------------------------------------------------------------------------


def test_bad_questions_are_answered_with_what_is_wrong(tmp_path, served):
    falling(tmp_path)
    s = served(tmp_path)
    status, state = asked(s, "/api/state")
    assert status == 200 and state["films"][0]["rows"] == 240 and not state["films"][0]["timed"]
    for path, question, code, words in (
        ("/api/frame/rod_video/40/640.jpg", None, 400, "frame = 40"),
        ("/api/frame/rod_video/0/9.jpg", None, 400, "width = 9"),
        ("/api/frame/bed_image/0/640.jpg", None, 400, "[bed_image]"),
        ("/api/frame/../server.py", None, 404, "no such page"),
        ("/../server.py", None, 404, "no such page"),
        ("/api/nothing", {}, 404, "no such page"),
        ("/api/find", {"section": "rod_video", "frame": "0"}, 400, "frame = '0'"),
        ("/api/find", {"section": "rod_video", "frame": 0, "seed": [1]}, 400, "seed = [1]"),
        ("/api/preview", {"draft": []}, 400, "must be an object"),
        ("/api/preview", {"draft": {"values": {"rod_video": {"scale": -1}}}}, 400, "scale = -1"),
        ("/api/preview", {"draft": {"values": {"rod_vid": {}}}}, 400, "rod_vid"),
        ("/api/preview", {"draft": {"corrections": {"-1": [1, 2]}}}, 400, "frame = '-1'"),
        ("/api/preview", {"draft": {"corrections": {"1": [1, "a"]}}}, 400, "must be [column, row]"),
        ("/api/flow", {"draft": {}, "frame": 0, "map": "u"}, 400, "grain_video"),
        ("/api/role", {"section": "rod_video", "role": "crater_image"}, 400, "role = 'crater_image'"),
        ("/api/open", {"experiment": "../x"}, 400, "must be one of"),
        ("/api/preview", b"{", 400, "JSON"),
    ):  # fmt: skip
        status, said = asked(s, path, question)
        assert status == code and words in said["problems"][0], (path, question, said)
    assert asked(s, "/api/state", Host="elsewhere.example:80")[0] == 403
    assert asked(s, "/api/track", {}, Origin="https://elsewhere.example")[0] == 403
    assert asked(s, "/api/track", {}, **{"Content-Type": "text/plain"})[0] == 415
    assert asked(s, "/api/track", b" " * 4_000_001)[0] == 413
    assert s.benches.bench.following is None


def test_a_fault_of_ours_is_answered_and_told_in_the_terminal(tmp_path, served, capfd):
    falling(tmp_path)
    s = served(tmp_path)
    s.benches.bench.flowing, kept = None, s.benches.bench.flowing
    status, said = asked(s, "/api/flow/all")
    s.benches.bench.flowing = kept
    assert status == 500 and "the terminal" in said["problems"][0]
    until(lambda: "'NoneType' object has no attribute 'batch'" in capfd.readouterr().err)


def test_answers_on_one_connection_do_not_wait_for_each_other(tmp_path, served):
    """A header that is sent before its body waits 40 ms for the browser's acknowledgement, unless it is told not to."""
    falling(tmp_path)
    s, took = served(tmp_path), []
    c = http.client.HTTPConnection("127.0.0.1", s.port, timeout=60)
    for _ in range(40):
        began = time.perf_counter()
        c.request("GET", f"{s.root}api/run")
        assert c.getresponse().read() == b'{"running": false}'
        took.append(time.perf_counter() - began)
    c.close()
    assert min(took[-10:]) < 0.03


def test_who_does_not_know_the_address_is_not_answered(tmp_path, served):
    """Other users of the machine reach the port, too."""
    falling(tmp_path)
    s, other = served(tmp_path), served(tmp_path)
    assert s.root != other.root and len(s.root) > 20
    for place in ("/", "/api/state", "/main.js", other.root, other.root + "api/state", s.root[:-2] + "/api/state"):
        for method in ("GET", "POST"):
            c = http.client.HTTPConnection("127.0.0.1", s.port, timeout=60)
            c.request(method, place, b"{}" if method == "POST" else None, {"Content-Type": "application/json"})
            reply = c.getresponse()
            assert reply.status == 403 and b"secret part" in reply.read()
            c.close()
    assert asked(s, "/api/state")[0] == 200


def test_a_film_is_taken_for_another_kind_until_a_file_says_what_it_is(tmp_path, served):
    falling(tmp_path)
    s = served(tmp_path / "rod.npy")
    status, state = asked(s, "/api/role", {"section": "rod_video", "role": "grain_video"})
    assert status == 200 and [f["section"] for f in state["films"]] == ["grain_video"]
    asked(s, "/api/role", {"section": "grain_video", "role": "rod_video"})
    (tmp_path / "experiment.toml").write_text("schema = 1\n")
    status, said = asked(s, "/api/role", {"section": "rod_video", "role": "grain_video"})
    assert status == 400 and "experiment.toml" in said["problems"][0]


def test_a_campaign_is_opened_one_experiment_at_a_time(tmp_path, served):
    for name in ("a", "b"):
        falling(tmp_path / name, n=8)
    s = served(tmp_path)
    assert asked(s, "/api/state")[1]["experiments"] == ["a", "b"]
    assert asked(s, "/api/open", {"experiment": "b"})[1]["name"] == "b"
    assert s.benches.whole == tmp_path


def test_of_a_campaign_the_first_experiment_with_a_film_is_opened(tmp_path, served):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "experiment.toml").write_text('schema = 1\n[motor_log]\nfile = "motor.csv"\n')
    (tmp_path / "a" / "motor.csv").write_text("time_s,position_m\n0,0\n0.1,0\n")
    falling(tmp_path / "b", n=8)
    assert asked(served(tmp_path), "/api/state")[1]["name"] == "b"
    assert asked(served(tmp_path / "a"), "/api/state")[1]["films"] == []


def test_a_run_that_cannot_begin_says_so(tmp_path):
    run = Running(tmp_path / "none")
    until(lambda: not run.running)
    assert run.said == "not run" and "does not exist" in "\n".join(run.lines)


def test_frames_read_backwards_are_those_read_forwards(tmp_path, monkeypatch):
    """Where a read back is slow, those before it are made on the way: each once, and the same."""
    phone(tmp_path / "phone")
    file, read = tmp_path / "phone" / CASES["phone"][0], []
    there, back = Shown(file), Shown(file)
    monkeypatch.setattr("jumpvision.browser.workbench.films.SLOW", 0.0)
    monkeypatch.setattr(back, "_read", lambda i, real=back._read: read.append(i) or real(i))
    forwards = [there.jpeg(i, 320) for i in range(60)]
    assert [back._jpeg(i, 320) for i in range(59, -1, -1)] == forwards[::-1]
    assert sorted(read) == list(range(60)) and back._slow
    for film in (there, back):
        film.close()


# --- the page --------------------------------------------------------------------------------------------------------


class Page:
    """A page of the workbench; counts clicks, keeps what the console said."""

    def __init__(self, browser, server: Server, width: int = 1280, scheme: str = "light", touch: bool = False):
        context = browser.new_context(viewport={"width": width, "height": 800}, color_scheme=scheme, has_touch=touch)
        self.page, self.clicks, self.said = context.new_page(), 0, []
        self.page.on("console", lambda m: self.said.append(m.text))
        self.page.on("pageerror", lambda e: self.said.append(str(e)))
        self.questions = Questions(self.page)
        self.page.goto(server.address)
        self.until("!!window.workbench?.ready")
        self.until("workbench.store.looked || workbench.store.section !== 'rod_video'")

    def until(self, what: str) -> None:
        until(lambda: self.page.evaluate(what))

    def get(self, what: str):
        return self.page.evaluate(what)

    def click(self, where: str) -> None:
        self.page.locator(where).click()
        self.clicks += 1

    def click_film(self, column: float, row: float) -> None:
        x, y = self.page.evaluate("([c, r]) => workbench.view.toScreen(c, r)", [column, row])
        self.page.locator("#film").click(position={"x": x, "y": y})
        self.clicks += 1

    def type_into(self, label: str, text: str) -> None:
        self.page.get_by_label(label, exact=True).filter(visible=True).click()
        self.clicks += 1
        self.page.keyboard.type(text)


CASES = {  # file, a place to follow where no ball stands out, diameter [mm], whether it is a ball
    "photron_ball_12bit": ("ball_12bit.cihx", None, "5", True),
    "norpix_pims": ("sample_norpix6.seq", (28.5, 12.0), "1", False),
    "cine_pims": ("cine_781.cine", (128.0, 96.0), "2", False),
    "phone": ("VID_0001.mp4", None, "9.5", True),
}


def phone(folder: Path) -> None:
    """A colour MP4 (H.264) of a white ball that bounces in front of a soft background."""
    import av

    folder.mkdir()
    rng, (h, w) = np.random.default_rng(3), (360, 480)
    y, x = np.mgrid[:h, :w].astype(float)
    with av.open(str(folder / CASES["phone"][0]), "w") as out:
        stream = out.add_stream("libx264", rate=60)
        stream.width, stream.height, stream.pix_fmt, stream.options = w, h, "yuv420p", {"crf": "20"}
        for i in range(60):
            r = np.hypot(x - 200 - i / 3, y - 280 + 180 * abs(math.sin(0.07 * i)))
            grey = 70 + 20 * np.sin(x / 90) + 150 / (1 + np.exp(np.clip((r - 14) / 0.7, -50, 50)))
            grey += rng.normal(0, 2, grey.shape)
            image = np.repeat(np.clip(grey, 0, 255).astype(np.uint8)[:, :, None], 3, axis=2)
            for packet in stream.encode(av.VideoFrame.from_ndarray(image, format="rgb24")):
                out.mux(packet)
        for packet in stream.encode():
            out.mux(packet)


LONG = pytest.mark.long


@pytest.mark.parametrize("name", [pytest.param(n, marks=LONG if n == "phone" else ()) for n in CASES])
def test_from_an_unknown_film_to_a_written_track_in_six_clicks(name, tmp_path, browser, served, request):
    file, place, diameter, ball = CASES[name]
    if name == "phone":
        phone(tmp_path / name)
    else:
        shutil.copytree(request.getfixturevalue("real_data") / name, tmp_path / name, copy_function=shutil.copyfile)
    began = time.monotonic()
    p = Page(browser, served(tmp_path / name / file))
    if p.get("workbench.store.section") != "rod_video":
        p.click("button[data-role=rod_video]")
        p.until("workbench.store.section === 'rod_video'")
    if place:
        p.click_film(*place)
    p.type_into("Its diameter [mm]", diameter)
    p.until("workbench.store.table.rod_video?.ball_diameter")
    p.click("#act")
    p.until("!workbench.store.track.running && workbench.store.track.rows.length > 0")
    assert p.get("workbench.store.track.finished")
    lost, n = p.get("[workbench.store.track.rows.filter((r) => r[3]).length, workbench.store.track.rows.length]")
    assert lost == 0 if ball else p.page.get_by_text(f"{lost} lost").count()  # what is no ball is lost by its word
    p.click("#tab-run")
    p.click("#write")
    p.page.wait_for_selector("text=Written:")
    assert p.clicks <= 6 and time.monotonic() - began < 120 and p.said == []
    written = tomllib.loads((tmp_path / name / "experiment.toml").read_text(encoding="utf-8"))
    assert written["rod_video"]["file"] == file and ("scale" in written["rod_video"]) == ball
    assert n == len(open_experiment(tmp_path / name) and p.get("workbench.store.state.films[0].time"))


def test_a_frame_is_corrected_by_hand_and_a_log_is_moved(hard, browser, served):
    p = Page(browser, served(hard))
    p.page.keyboard.press("t")
    p.until("workbench.store.track.finished && !workbench.store.track.running")
    p.page.keyboard.press("Home")
    for _ in range(5):
        p.page.keyboard.press("ArrowRight")
    p.page.keyboard.press("c")
    p.click_film(30.0, 70.0)
    p.page.keyboard.press("Escape")
    assert p.get("workbench.store.draft.corrections[5]") == pytest.approx([30, 70], abs=0.3)  # a click has whole pixels
    box = p.page.locator("#timeline").bounding_box()
    middle = (box["x"] + 0.6 * box["width"], box["y"] + 0.5 * box["height"])  # the second of three lanes: the motor
    p.page.mouse.move(*middle)
    p.page.mouse.down()
    p.page.mouse.move(middle[0] + 50, middle[1])
    p.page.mouse.up()
    p.page.keyboard.press("5")
    p.until("workbench.store.preview?.difference.some((d) => d.includes('[rod_corrections]'))")
    p.click("#write")
    p.page.wait_for_selector("text=Written: corrections.csv, experiment.toml")
    e = open_experiment(hard)
    film = p.get("workbench.store.state.films[0].time")
    pixel = 1.2 * (film[-1] - film[0]) / (box["width"] - 84)  # s; the lane shows a tenth more on either side
    assert e.sections["motor_log"].start == pytest.approx(50 * pixel, rel=0.02)
    assert e.sections["clock"].offset_sigma == pytest.approx(pixel, rel=0.05)
    table = track(e.section(RodVideo), None, None, e.section(RodCorrections), p=TrackParams()).table
    assert table.corrected.to_numpy().nonzero()[0].tolist() == [5] and p.said == []
    p.page.reload()
    p.until("!!window.workbench?.ready")
    assert p.get("Object.keys(workbench.store.draft.corrections)") == ["5"]


@pytest.mark.long
def test_clicks_on_sand_become_foot_part_polygon_and_floor(tmp_path, browser, served):
    shutil.copytree(SAND, tmp_path / "film", ignore=shutil.ignore_patterns("truth.json", "*.toml"))
    p = Page(browser, served(tmp_path / "film"))
    p.click("button[data-section=grain_video]")
    for tool, places in (("foot", [(195, 53)]), ("roi", [(60, 12), (340, 200)])):
        p.page.locator(f"button[data-tool={tool}]:visible").click()
        for at in places:
            p.click_film(*at)
    p.page.locator("button[data-tool=leave_out]:visible").click()
    for at in ((80, 120), (120, 120), (100, 160)):
        p.click_film(*at)
    p.page.keyboard.press("Enter")
    p.click("button[data-section=bed_image]")
    p.page.get_by_label("Floor of the bed", exact=True).fill("620")  # by the keyboard alone
    p.page.keyboard.press("Tab")
    p.until("workbench.store.preview?.table.bed_image?.floor_row === 620")
    grain = p.get("workbench.store.preview.table.grain_video")
    place = p.get("workbench.store.state.films.map((f) => [f.section, f.columns, f.rows])")
    assert {s for s, *_ in place} == {"rod_video", "grain_video", "bed_image"}
    assert [grain["axis_column"], grain["foot_row"]] == pytest.approx([195, 53], abs=1.0)
    assert grain["roi"] == pytest.approx([60, 12, 340, 200], abs=1.5)
    assert (
        grain["leave_out"][0] == pytest.approx([80, 120, 120, 120, 100, 160], abs=1.0) and len(grain["leave_out"]) == 1
    )
    assert p.said == []


def test_an_experiment_without_a_film_says_so(tmp_path, browser, served):
    (tmp_path / "experiment.toml").write_text('schema = 1\n[motor_log]\nfile = "motor.csv"\n')
    (tmp_path / "motor.csv").write_text("time_s,position_m\n0,0\n0.1,0\n")
    p = Page(browser, served(tmp_path))
    assert "no film or picture" in p.page.inner_text("#hint") and p.page.locator("#tab-run").is_visible()
    assert not p.page.locator("#tab-scale").is_visible() and p.page.locator("#write").is_visible()
    assert p.said == []


@pytest.mark.parametrize(
    ("width", "scheme"),
    [(1280, "light"), *(pytest.param(*c, marks=LONG) for c in ((1280, "dark"), (820, "light"), (820, "dark")))],
)
def test_no_serious_finding_of_axe(width, scheme, hard, browser, served):
    module = pytest.importorskip("axe_playwright_python.sync_playwright", reason="pip install axe-playwright-python")
    p = Page(browser, served(hard), width, scheme, touch=width < 1000)
    found = {}
    for step in "12345":
        p.page.keyboard.press(step)
        p.page.wait_for_timeout(100)
        for v in module.Axe().run(p.page).response["violations"]:
            if v["impact"] in ("serious", "critical"):
                found[step, v["id"]] = [n["html"] for n in v["nodes"]]
    assert found == {} and p.said == []
    assert p.get("document.documentElement.scrollWidth") <= width  # nothing is cut at the side


@pytest.mark.long
def test_the_campaign_is_run_by_its_button(hard, browser, served):
    p = Page(browser, served(hard))
    p.page.keyboard.press("5")
    p.page.get_by_role("button", name="Run this experiment").click()
    until(lambda: p.page.get_by_text("done", exact=True).count() > 0, 600)
    summary = json.loads((hard.parent / "results" / "hard" / "summary.json").read_text())
    assert summary["jump_height_m"] > 0.03 and p.said == []


@pytest.mark.long
def test_scrubbing_and_controls_answer_in_time(tmp_path, browser, served):
    """1280 x 1024 px: 20 different frames a second under a moving hand, 95 % of what is typed answered within 0.1 s.
    The best of a few tries, in units of the machine's pace."""
    rng = np.random.default_rng(1)
    film = rng.integers(20, 60, (200, 1024, 1280), dtype=np.uint8)
    for i, image in enumerate(film):
        cv2.circle(image, (600, 900 - int(500 * abs(math.sin(i / 40)))), 24, 200, -1)
    np.save(tmp_path / "rod.npy", film)
    p = Page(browser, served(tmp_path))
    scrub = """async () => {
      const s = document.getElementById('scrub'), t = performance.now();
      let seen = 0, last = -1;
      for (let k = 0; performance.now() - t < 4000; k++) { s.value = Math.floor(s.max * (0.5 - 0.5 * Math.cos(k / 40)));
        s.dispatchEvent(new Event('input')); await new Promise(requestAnimationFrame);
        if (workbench.player.shown !== last) { seen++; last = workbench.player.shown; } }
      return seen / 4; }"""
    in_time(lambda: 1e3 / max(p.page.evaluate(scrub), 1e-3), 1e3 / 20)
    control = """async () => { const field = [...document.querySelectorAll('#step-scale label')].find((l) =>
        l.textContent === 'Frame rate [1/s]' && l.offsetParent).control, out = [];
      for (let k = 0; k < 60; k++) {
        const t = performance.now(); field.value = 100 + k; field.dispatchEvent(new Event('input'));
        while (workbench.store.table.rod_video.frame_rate !== 100 + k) await new Promise((r) => setTimeout(r, 1));
        out.push(performance.now() - t); } return out; }"""
    in_time(lambda: float(np.percentile(p.page.evaluate(control), 95)), 100.0)
