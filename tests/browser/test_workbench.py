"""The workbench without a browser: what it answers is what the stages give, what it writes, what it refuses."""

from __future__ import annotations

import errno
import http.client
import json
import math
import os
import socket
import tomllib
import tracemalloc
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
import xarray as xr
from diagnosis_sample import causes as named_causes
from diagnosis_sample import diagnosis, parameter
from scipy.stats import chi2

import jumpvision as jv
from jumpvision.base.schema import InputError
from jumpvision.browser.workbench.adding import Adding
from jumpvision.browser.workbench.bench import Benches
from jumpvision.browser.workbench.draft import CORRECTIONS, draft_of
from jumpvision.browser.workbench.films import Shown
from jumpvision.browser.workbench.flowing import OF_ONE
from jumpvision.browser.workbench.logs import POINTS, thinned
from jumpvision.browser.workbench.plotting import Part
from jumpvision.browser.workbench.running import Running
from jumpvision.browser.workbench.server import Server
from jumpvision.browser.workbench.why import causes, said
from jumpvision.cli import main
from jumpvision.engine.document.values import Cell, Height, Pattern, Varies
from jumpvision.experiment.init.edit import edited
from jumpvision.experiment.init.measure import tilt_of
from jumpvision.experiment.init.recognise import recordings
from jumpvision.experiment.inputs.experiment import open_experiment
from jumpvision.experiment.inputs.sections import RodCorrections, RodVideo
from jumpvision.experiment.results.tables import Profiles
from jumpvision.experiment.stages.track import track
from jumpvision.films.calibration import CLICKED_MARK
from jumpvision.films.parameters import TrackParams
from jumpvision.films.vision.camera import camera
from tests.worlds.hand import asked, serving, until
from tests.worlds.recorded import (
    COLUMNS,
    FILM,
    PICTURES,
    RATE,
    ROWS,
    SCALE,
    G,
    double_exposures,
    drop,
    flow_film,
    vortex,
)  # fmt: skip
from tests.worlds.results import STUDY, of_file, same, stage

KNOWN = {"values": {"rod_video": {"frame_rate": RATE, "scale": SCALE}}}
PIECE = bytes(range(256)) * 4096  # 1 MiB


def tracked(b: Benches, draft: dict) -> object:
    """Track the film on the bench and return the motion."""
    b.bench.follow(draft_of(draft))
    until(lambda: not b.bench.following.running)
    return b.bench.motion(draft_of(draft))


# --- what is shown is what the stages give ----------------------------------------------------------------------------


def test_a_correction_is_taken_marked_and_kept_beside_what_was_found(tmp_path):
    """Frame 7 is moved, frame 20 was lost; all else is as it was, bit for bit, but what rests on neighbours."""
    truth = drop(tmp_path / "a", lost=(20,), experiment=FILM + f'[rod_corrections]\nfile = "{CORRECTIONS}"\n')
    file = tmp_path / "a" / CORRECTIONS
    rows, at = [7, 20], [[95.5, 60.25, 0.5], [*truth[20].tolist(), 0.8]]
    file.write_text("frame,x_px,y_px,sigma_px\n" + "".join(f"{k},{x},{y},{s}\n" for k, (x, y, s) in zip(rows, at)))
    e, p = open_experiment(tmp_path / "a"), TrackParams(exposure_correction="none")
    film, by_hand = e.section(RodVideo), e.section(RodCorrections)
    plain, table = (track(film, None, None, c, p=p).table for c in (None, by_hand))
    assert table.corrected.to_numpy().nonzero()[0].tolist() == rows
    assert table.loc[rows, ["x_px", "y_px", "sigma_px"]].to_numpy().tolist() == at
    np.testing.assert_array_equal(table.loc[rows, ["x_found_px", "y_found_px"]], plain.loc[rows, ["x_px", "y_px"]])
    assert table.flag[20] == "" and table.flag_found[20].startswith("lost") and plain.flag[20].startswith("lost")
    others = table.index.difference(rows)
    for column in plain.columns:
        if not column.startswith("exposure_shift"):
            assert plain[column][others].equals(table[column][others]), column
    # up is against the rows: a row lower by so much is a height lower by so much times the scale
    down = table.y_px[7] - plain.y_px[7]
    assert table.height_m[7] - plain.height_m[7] == pytest.approx(-down * film.scale, abs=1e-12)
    for text, told in (("48,1,1,0.5", "0 to 47"), ("3.5,1,1,0.5", "frame = 3.5"), ("3,1,1,0", "above 0 px")):
        file.write_text(f"frame,x_px,y_px,sigma_px\n{text}\n")
        with pytest.raises(InputError, match=told):
            track(film, None, None, by_hand, p=p)
    file.unlink()
    (tmp_path / "a" / "experiment.toml").write_text(FILM)
    expected, b = track(film, None, None, p=TrackParams()).table, Benches(tmp_path / "a")
    tracked(b, {})
    seen, run = b.bench.followed(0)
    assert run.finished and not run.problem and b.bench.followed(10)[0] == seen[10:]
    for k, column in enumerate(("x_px", "y_px", "sigma_px", "flag")):
        assert [r[k] for r in seen] == [None if v != v else v for v in expected[column]], column
    b.close()


def test_a_frame_is_shown_as_it_is_forwards_and_backwards(tmp_path, monkeypatch):
    """The ball lies where it is drawn, at the size of the screen; frames read backwards are those read forwards."""
    truth = drop(tmp_path)
    there, back = (Shown(tmp_path / "drop.npy") for _ in range(2))
    for i, width, k in ((0, 200, 1.0), (17, 100, 0.5)):
        grey = cv2.imdecode(np.frombuffer(there.jpeg(i, width), np.uint8), cv2.IMREAD_GRAYSCALE).astype(float)
        assert grey.shape == (round(240 * k), width)
        weight = np.where(grey > 180, grey, 0)
        y, x = np.indices(grey.shape)
        place = np.array([(weight * x).sum(), (weight * y).sum()]) / weight.sum()
        assert np.abs((place + 0.5) / k - 0.5 - truth[i]).max() < 0.3  # of a disc of 16 px by its bright half
    with pytest.raises(InputError, match=r"frame = 48: must be in \[0, 47\]"):
        there.jpeg(48, 200)
    monkeypatch.setattr("jumpvision.browser.workbench.films.SLOW", 0.0)  # those before are made on the way
    forwards = [there.jpeg(i, 100) for i in range(48)]
    assert [back._jpeg(i, 100) for i in range(47, -1, -1)] == forwards[::-1] and back._slow
    assert len(set(forwards)) == 48
    monkeypatch.setattr("jumpvision.browser.workbench.films.KEPT", sum(map(len, forwards[:10])))  # bytes
    for i in range(48):
        there._jpeg(i, 64)
    assert sum(map(len, list(there._kept.values()))) <= sum(map(len, forwards[:10]))  # however long the film is
    for film in (there, back):
        film.close()


def test_lines_of_long_logs_keep_their_extremes():
    t = np.linspace(0, 1, 200_003)
    y = np.sin(40 * t)
    y[[777, 150_001]] = 9.0, -9.0
    seen_t, seen_y = thinned(t, y)
    assert len(seen_t) <= POINTS and (np.diff(seen_t) > 0).all()
    assert seen_y.max() == 9.0 and seen_y.min() == -9.0 and t[777] in seen_t


def test_the_rail_s_angle_makes_a_motion_along_it_all_height():
    for up, along in (("-y", (12.0, -200.0)), ("+y", (12.0, 200.0)), ("-x", (-200.0, 12.0)), ("+x", (200.0, 12.0))):
        a, length = np.array([300.0, 300.0]), math.hypot(*along)
        for b in (a + along, a - along):  # whichever end is clicked first
            view = camera(scale=1e-3, up=up, tilt=tilt_of((*a, *b), up), marks=(), k1=0, k2=0, centre=(0.0, 0.0))
            x, y = np.array([a, a + along]).T
            assert np.diff(view.height(x, y)) == pytest.approx(1e-3 * length, rel=1e-9)


def test_g_of_drawn_drops_lies_within_its_sigma(tmp_path):
    """By a parabola of y and by a line of its speed: the sum of (error/sigma)^2 of n drops with an exact scale is that
    of n normal errors, but for one of a hundred experiments."""
    n, pulls = 12, []
    for seed in range(n):
        drop(tmp_path / str(seed), seed, n=28, size=(130, 160))
        b = Benches(tmp_path / str(seed) / "drop.npy")
        motion = tracked(b, KNOWN)
        parts = (Part("time", "y", 0.0, 1.0, "parabola"), Part("time", "vy", 0.0, 1.0, "line"))
        g = [motion.fit(part).parameters[-1] for part in parts]
        pulls.append([(e.value + G) / e.sigma for e in g])
        b.close()
    low, high = chi2.ppf([0.005, 0.995], n)
    total = np.sum(np.square(pulls), axis=0)
    assert (low < total).all() and (total < high).all(), total


SETTINGS = {
    "mask, part": "[params.piv]\n",
    "slow": "[params.piv]\nbaseline = 3\n",
    "steady, light": '[params.piv]\nensemble = 3\nbackground = "minimum"\nclahe = 24\nwindow = 16\nstep = 12\n',
}


@pytest.mark.parametrize("name", SETTINGS)
def test_a_pair_on_the_page_is_the_stage_s_to_the_last_bit(name, tmp_path):
    folder, head = flow_film(tmp_path / "film", 7), PICTURES
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
    size = 3 if "steady" in name else 1
    for k in (0, last):
        u, flow = of_file(results / "piv.nc", k), of_file(results / "flow.nc", k)
        for what in OF_ONE:
            s = b.bench.flow(draft_of({}), k * size, what, False)
            same(s.values, np.hypot(u.u, u.v).values if what == "speed" else (u if what in u else flow)[what].values)
            assert s.frame == k * size and s.unit == ("m/s" if what in ("speed", "u", "v") else "1/s")
        same(s.u, u.u.values)
        same(s.reason, u.reason.values)
        assert s.measured == int(u.chc.sum())
    b.close()


def test_double_exposures_are_drafted_as_pairs_by_their_names_and_matched_as_the_stage_does(tmp_path):
    folder = double_exposures(tmp_path / "jet", 2)
    assert main(["init", str(folder)]) == 0
    text = (folder / "experiment.toml").read_text()
    given = tomllib.loads(text)["grain_video"]
    assert given["file"] == "Jet_*[AB].png" and given["pairs"] == "names" and "# pair_time = " in text
    with pytest.raises(InputError, match="pair_time"):
        jv.piv(folder)  # the time from A to B is nobody's guess
    (folder / "experiment.toml").write_text(text.replace("# pair_time = ", "frame_rate = 10.0\npair_time = 1e-3"))
    results, b = stage("piv", folder), Benches(folder)
    for frame, k in ((0, 0), (1, 0), (2, 1), (3, 1)):  # either picture of a pair
        s = b.bench.flow(draft_of({}), frame, "u", False)
        same(s.values, of_file(results / "piv.nc", k).u.values)
        assert s.frame == 2 * k
    b.close()
    for names, pairs in ((("A", "B"), [("jet_[AB].png", False)]), (("0_data", "0_b", "1_data", "1_b"), None)):
        (other := tmp_path / names[0]).mkdir()
        for name, frame in zip(names, vortex(len(names))):  # a letter that is part of a word is none
            cv2.imwrite(str(other / f"jet_{name}.png"), frame)
        found = [(r.file, "pairs" in r.values) for r in recordings(other, {})[0]]
        assert found == pairs if pairs else not any(paired for _, paired in found)


def test_the_mean_and_its_profile_are_those_of_the_pipeline_and_are_taken_while_they_hold(tmp_path):
    line = [0.002, -0.006, 0.014, -0.005]
    text = PICTURES + f"[params.profiles]\nlines = [{line}]\n"
    folder = flow_film(tmp_path / "film", 11, text)
    b = Benches(folder)
    b.bench.all_pairs(draft_of({}))
    until(lambda: not b.bench.flowing.batch.running)
    s, one = (b.bench.flow(draft_of({}), k, what, mean) for k, what, mean in ((0, "vorticity", True), (3, "u", False)))
    b.close()
    assert main(["profiles", str(folder), "--no-pictures"]) == 0
    results = tmp_path / "results" / "film"
    with xr.open_dataset(results / "statistics.nc", decode_times=False) as mean:
        same(s.values, mean.vorticity.transpose("y", "x").values)
        same(s.u, mean.u.transpose("y", "x").values)
    assert s.fields == 10
    table = Profiles.load(results).table
    for column in ("s", "along", "along_sigma", "across", "across_sigma", "uv"):
        same(s.profile[column], table[column].to_numpy())
    same(one.values, of_file(results / "piv.nc", 3).u.values)  # of the field that lay there already
    for added, held, changed in (("", ("piv.nc",), ()), ("[params.piv]\nwindow = 32\n", (), ("piv.nc",))):
        (folder / "experiment.toml").write_text(text + added)
        b = Benches(folder)
        assert (b.earlier().held, b.earlier().changed) == (held, changed)
        assert (b.bench.flowing.batch is None) == bool(added)
        if held:
            same(b.bench.flow(draft_of({}), 2, "v", False).values, of_file(results / "piv.nc", 2).v.values)
        b.close()


def test_a_diagnosis_says_how_far_its_models_miss_a_jump_and_what_they_lack():
    """What is named for all jumps, and what is odd of one of them only there; nothing where nothing is known."""
    heights = [Height("b", "single", 7.0, None, 0.57, 0.030, 1e-5, 0.032, 0.0301)]
    cells = [Cell("single", "flight", -0.003, 9.0, 0.0, 9), Cell("stutter", "rest", 0.1, 9.0, 0.0, 9)]
    d = SimpleNamespace(heights=heights, where=cells)
    texts = said(d, "b")
    assert texts[:2] == ["model: height +2.00 mm", "extended model: height +0.10 mm"] and "flight, -3.00 mm" in texts[2]
    assert said(d, "a") == said(None, "b") == causes(None, "b") == []
    apart = {"p_value": 1e-9, "of": None, "unit": "1", "declared": 1.0, "at": {}}
    odd = [
        Varies("scale", Pattern.ODD, recordings=("b",), value=1.04, low=1.03, high=1.05, established=e, **apart)
        for e in (True, False)
    ]
    named = named_causes(("added_mass",), {"C": parameter(2.7, 0.2)})
    lacking = diagnosis(named=("added_mass",), causes=named, varies=(odd[0],))
    texts = causes(lacking, "b")
    assert "scale" in texts[0] and "4" in texts[0] and len(texts) == 2 and causes(lacking, "a") == texts[1:]
    assert "added mass" in texts[1] and "0.9" in texts[1] and "C = 2.7" in texts[1]
    assert causes(diagnosis(varies=(odd[1],)), "b") == ["diagnosis: no cause is named"]
    assert causes(diagnosis(verdict="adequate"), "b") == ["diagnosis: the model is adequate"]


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


def test_a_value_is_replaced_or_added_however_its_section_is_written():
    for text, new in (
        ("[a]\nb = [\n 1,  # one\n]\nc = 3\n", "[a]\nb = [2]\nc = 3\n"),
        ("a = { b = [1], c = 3 }  # all\n", "a = { b = [2], c = 3 }  # all\n"),
        ("a.b = [1]\r\na.c = 3\r\n", "a.b = [2]\r\na.c = 3\r\n"),
        ("# mine\n[a]\n  'b'=[1]   # why\n\n\n# end", "# mine\n[a]\n  'b'=[2]   # why\n\n\n# end"),
    ):
        assert edited(text, {"a": {"b": ([2], "")}}, "f") == new
        assert edited(text, {"a": {"b": ([1], "again")}}, "f") == text  # nothing changes: not a byte
    for text, new in (
        ("a.c = 3\n[d]\n", "a.c = 3\na.b = 2\n[d]\n"),
        ("[a]\nc = 3\n\n# of d\n[d]\n[a.e]\nx = 1\n", "[a]\nc = 3\n\n# of d\nb = 2\n[d]\n[a.e]\nx = 1\n"),
        ("[a]\nc = 3\n\n# of d\n[d]\nb = 1\n", "[a]\nc = 3\nb = 2\n\n# of d\n[d]\nb = 1\n"),
        ("[d]\n\n# [a]  # open\n# c = # m\n# b = # m\n", "[d]\n\n[a]  # open\n# c = # m\nb = 2\n"),
    ):
        assert edited(text, {"a": {"b": (2, "")}}, "f") == new


def test_nothing_is_written_over_that_somebody_else_changed(tmp_path):
    drop(tmp_path)
    draft = {
        "picks": {"rod_video": {"ball": [90, 30], "ball_diameter": 9.5}},
        "values": {"rod_video": {"frame_rate": 250}},
        "corrections": {"3": [61.5, 190]},
    }
    file = tmp_path / "experiment.toml"
    with serving(tmp_path) as s:
        status, made = asked(s, "/api/preview", {"draft": draft})
        assert status == 200 and not file.exists() and made["table"]["rod_video"]["frame_rate"] == 250
        file.write_text("schema = 1\n")
        status, told = asked(s, "/api/write", {"draft": draft, "seen": made["seen"]})
        assert status == 400 and "changed on the disk" in told["problems"][0]
        assert file.read_text() == "schema = 1\n" and not (tmp_path / CORRECTIONS).exists()
        added = asked(s, "/api/preview", {"draft": draft})[1]["table"]["rod_video"]  # to what is there now
        assert added["file"] == "drop.npy" and added["frame_rate"] == 250
        file.unlink()
        written = asked(s, "/api/write", {"draft": draft, "seen": made["seen"]})
        assert written == (200, {"written": [CORRECTIONS, "experiment.toml"]})
    e = open_experiment(tmp_path)
    assert e.section(RodVideo).ball_diameter == 0.0095 and e.section(RodCorrections).file == CORRECTIONS
    assert (tmp_path / CORRECTIONS).read_text() == f"frame,x_px,y_px,sigma_px\n3,61.5,190,{CLICKED_MARK.value:g}\n"
    # the scale is the ball's diameter over what was drawn, to the 1 % that it states
    assert e.section(RodVideo).scale == pytest.approx(9.5e-3 / 16, rel=0.02)
    assert Benches(tmp_path).bench.corrections() == {3: (61.5, 190.0)}


def test_a_page_is_kept_among_the_results_and_found_by_the_next_server(tmp_path):
    drop(tmp_path / "one", n=12)
    empty = {"picks": {}, "values": {}, "corrections": {}}
    page = {"at": 1, "draft": empty | {"picks": {"rod_video": {"ball": [60, 200]}}}, "step": "find"}
    kept = tmp_path / "results" / "one" / "workbench.json"
    with serving(tmp_path / "one") as s:
        assert asked(s, "/api/keep", {"page": page}) == (200, {})
        assert [f.name for f in (tmp_path / "one").iterdir()] == ["drop.npy"] and json.loads(kept.read_text()) == page
        with serving(tmp_path / "one") as other:
            assert asked(other, "/api/state")[1]["kept"] == page
        asked(s, "/api/keep", {"page": {"draft": empty}})
        assert not kept.exists()  # nothing is left to keep
        for bad in (None, [], {"draft": 3}):
            assert asked(s, "/api/keep", {"page": bad})[0] == 400


def test_init_pick_writes_what_is_known_and_opens_the_workbench(tmp_path, monkeypatch, capsys):
    drop(tmp_path)
    opened = []
    monkeypatch.setattr("webbrowser.open", opened.append)

    def stopped(self) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Server, "serve_forever", stopped)
    assert main(["init", str(tmp_path), "--pick"]) == 0
    assert (tmp_path / "experiment.toml").exists() and opened[0].startswith("http://127.0.0.1:")
    assert main(["open", str(tmp_path / "drop.npy"), "--no-browser"]) == 0 and len(opened) == 1
    assert main(["open", str(tmp_path / "none")]) == 2
    assert "none: does not exist" in capsys.readouterr().err


# --- what is refused -------------------------------------------------------------------------------------------------


def test_bad_questions_are_answered_with_what_is_wrong(tmp_path, capfd):
    drop(tmp_path)
    whole = {"draft": KNOWN, "x": "time", "y": "y", "low": 0, "high": 10, "curve": "line"}
    dark = {"draft": {"values": {"params.track": {"polarity": "dark"}}}}
    with serving(tmp_path) as s:
        status, state = asked(s, "/api/state")
        assert status == 200 and state["films"][0]["rows"] == 240 and not state["films"][0]["timed"]

        def refused(*rows: tuple[str, object, int, str]) -> None:
            for path, question, code, words in rows:
                status, told = asked(s, path, question)
                assert status == code and words in told["problems"][0], (path, question, told)

        refused(
            ("/api/frame/rod_video/48/640.jpg", None, 400, "frame = 48"),
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
            ("/api/columns", {"draft": {}}, 400, "track the film first"),
            ("/api/track", b" " * 4_000_001, 413, "Content-Length"),
        )
        for code, headers in (
            (403, {"Host": "elsewhere.example:80"}),
            (403, {"Origin": "https://elsewhere.example"}),
            (415, {"Content-Type": "text/plain"}),
        ):
            assert asked(s, "/api/track", {}, **headers)[0] == code
        assert s.benches.bench.following is None
        asked(s, "/api/track", {"draft": KNOWN})
        until(lambda: not s.benches.bench.following.running)
        (x, y, *_), likeliest = (
            s.benches.bench.followed(5)[0][0],
            max(asked(s, "/api/candidates", {"frame": 5})[1], key=lambda c: c[3]),
        )
        assert np.hypot(likeliest[0] - x, likeliest[1] - y) < 1.0 and likeliest[3] > 0.95
        assert asked(s, "/api/fit", whole)[0] == 200
        refused(
            ("/api/fit", whole | {"y": "z"}, 400, "y = 'z': must be one of"),
            ("/api/fit", whole | {"x": "y"}, 400, "another column than x"),
            ("/api/fit", whole | {"curve": "spiral"}, 400, "curve = 'spiral'"),
            ("/api/fit", whole | {"low": None}, 400, "low = None: must be a number"),
            ("/api/fit", whole | {"high": 0.001}, 400, "it needs 3 or more"),
            ("/api/columns", dark, 400, "track the film again"),  # other values would give another track
        )
        # a frame rate is taken without another look at the film
        slow = asked(s, "/api/columns", {"draft": {"values": {"rod_video": {"frame_rate": 10.0, "scale": SCALE}}}})[1]
        assert slow["table"]["time_s"][:3] == [0.0, 0.1, 0.2]
        s.benches.bench.flowing, kept = None, s.benches.bench.flowing
        refused(("/api/flow/all", None, 500, "the terminal"))  # a fault of ours
        s.benches.bench.flowing = kept
        until(lambda: "'NoneType' object has no attribute 'batch'" in capfd.readouterr().err)


def test_who_does_not_know_the_address_is_not_answered(tmp_path):
    """Other users of the machine reach the port, too."""
    drop(tmp_path, n=12)
    with serving(tmp_path) as s, serving(tmp_path) as other:
        assert s.root != other.root and len(s.root) > 20 and s.socket.getsockname()[0] == "127.0.0.1"
        assert s.socket.getsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY)  # else an answer waits 40 ms for the browser
        for place in ("/", "/api/state", "/main.js", other.root, other.root + "api/state", s.root[:-2] + "/api/state"):
            for question in (None, {}):
                status, told = asked(s, "", question, root=place)
                assert status == 403 and "secret part" in str(told)
        assert asked(s, "/api/state")[0] == 200


def test_a_study_that_fails_or_fits_no_ball_says_so(tmp_path):
    drop(tmp_path / "ball", n=12)
    (tmp_path / "mine.py").write_text(STUDY)
    for name, values, says in (
        ("broken", KNOWN, "raised OSError: no licence"),
        ("absent", KNOWN, "has no attribute 'absent'"),
        ("two", KNOWN, "has 2 channels"),
        ("study", {}, "scale: missing"),
    ):
        with serving(tmp_path / "ball" / "drop.npy", f"{tmp_path / 'mine.py'}:{name}") as s:
            tracked(s.benches, values)
            status, answer = asked(s, "/api/study", {"draft": values})
            assert status == 400 and says in answer["problems"][0], (name, answer)
    with serving(tmp_path / "ball" / "drop.npy") as s:
        assert asked(s, "/api/study", {"draft": {}})[0] == 400 and asked(s, "/api/state")[1]["study"] == ""


def test_a_campaign_is_opened_one_experiment_at_a_time_and_a_film_is_of_the_kind_that_a_file_says(tmp_path):
    """The first experiment with a film is opened; without a file a film may be taken for another kind."""
    (tmp_path / "c" / "a").mkdir(parents=True)
    (tmp_path / "c" / "a" / "experiment.toml").write_text('schema = 1\n[motor_log]\nfile = "motor.csv"\n')
    (tmp_path / "c" / "a" / "motor.csv").write_text("time_s,position_m\n0,0\n0.1,0\n")
    for name in ("b", "d"):
        drop(tmp_path / "c" / name, n=8)
    taken = {"section": "rod_video", "role": "grain_video"}
    with serving(tmp_path / "c") as s:
        state = asked(s, "/api/state")[1]
        assert (state["name"], state["experiments"]) == ("b", ["a", "b", "d"])
        assert asked(s, "/api/open", {"experiment": "d"})[1]["name"] == "d" and s.benches.whole == tmp_path / "c"
        assert asked(s, "/api/open", {"experiment": "a"})[1]["films"] == []
    with serving(tmp_path / "c" / "b" / "drop.npy") as s:
        status, state = asked(s, "/api/role", taken)
        assert status == 200 and [f["section"] for f in state["films"]] == ["grain_video"]
        asked(s, "/api/role", {"section": "grain_video", "role": "rod_video"})
        (tmp_path / "c" / "b" / "experiment.toml").write_text("schema = 1\n")
        status, told = asked(s, "/api/role", taken)
        assert status == 400 and "experiment.toml" in told["problems"][0]
    run = Running(tmp_path / "none")
    until(lambda: not run.running)
    assert run.said == "not run" and "does not exist" in "\n".join(run.lines)


# --- what is added ---------------------------------------------------------------------------------------------------


def sent(s: Server, name: str, content: bytes) -> tuple[int, object]:
    return asked(s, f"api/add/file/{name}", content, **{"Content-Type": "application/octet-stream"})


def tree(folder: Path) -> dict[str, bytes]:
    return {str(f.relative_to(folder)): f.read_bytes() for f in sorted(folder.rglob("*")) if f.is_file()}


def test_a_film_is_sent_in_pieces_and_half_of_one_leaves_nothing(tmp_path):
    drop(tmp_path / "drop", n=12)
    new, size, before = tmp_path / "new", 64 * len(PIECE), tree(tmp_path)
    with serving(tmp_path / "drop") as s:
        assert asked(s, "api/add", {"folder": "new", "files": {"a.npy": size, "b.csv": 3}}) == (200, {})
        c = http.client.HTTPConnection("127.0.0.1", s.port)
        kind = {"Content-Type": "application/octet-stream", "Content-Length": str(size)}
        tracemalloc.start()
        c.request("POST", f"{s.root}api/add/file/a.npy", iter([PIECE] * 40), kind)
        until(lambda: any(p.stat().st_size >= 30 * len(PIECE) for p in new.glob("*")))
        assert [p.name for p in new.iterdir()] == ["a.npy.part"]  # until it is whole
        assert tracemalloc.get_traced_memory()[1] < 8 * len(PIECE)  # it does not stand in memory
        tracemalloc.stop()
        c.sock.shutdown(socket.SHUT_RDWR)
        c.close()
        until(lambda: not s.benches.adding.writing and not list(new.iterdir()))
        assert sent(s, "b.csv", b"abc") == (200, {})
        status, answer = asked(s, "api/add/end", {})
        assert status == 400 and "a.npy is missing" in answer["problems"][0]
        status, answer = asked(s, "api/add/stop", {})
        assert status == 200 and "came" in answer["problem"] and tree(tmp_path) == before and not new.exists()


def test_what_cannot_be_added_is_refused(tmp_path):
    drop(tmp_path / "drop", n=12)
    before = tree(tmp_path)
    with serving(tmp_path / "drop") as s:
        for folder, files, told in (
            ("drop", {"a.npy": 1}, "exists|is open"),
            ("../out", {"a.npy": 1}, "plain name"),
            (".x", {"a.npy": 1}, "plain name"),
            ("results", {"a.npy": 1}, "plain name"),
            ("new", {"../a.npy": 1}, "plain name of a file"),
            ("new", {"a.npy": 1, "A.npy": 1}, "same name"),
            ("new", {"letter.docx": 1}, "'.docx' is no known recording"),
            ("new", {"a.npy": 10**18}, "no space: .* GB to copy"),
            ("new", {}, "must be 1 to"),
        ):
            status, answer = asked(s, "api/add", {"folder": folder, "files": files})
            with pytest.raises(InputError, match=told):
                raise InputError(answer["problems"])
            assert status == 400 and tree(tmp_path) == before and not (tmp_path / "new").exists()
        assert asked(s, "api/add", {"folder": "new", "files": {"a.npy": 1}}, root="/")[0] == 403
        assert sent(s, "a.npy", b"x")[0] == 400  # none begun

    def no_space():
        yield b"xx"
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    for name, pieces, old, told in (
        ("full", [b"new"], b"old", "exists already"),  # of somebody else, meanwhile
        ("disk", no_space(), None, "no space left on this disk"),
        ("short", [b"xx"], None, "2 bytes came of 3"),
    ):
        adding = Adding(tmp_path, name, {"a.npy": 3})
        if old:
            (tmp_path / name / "a.npy").write_bytes(old)
        with pytest.raises(InputError, match=told):
            adding.write("a.npy", pieces)
        adding.stop()
        assert tree(tmp_path / name) == ({"a.npy": old} if old else {}) and (tmp_path / name).exists() == bool(old)
