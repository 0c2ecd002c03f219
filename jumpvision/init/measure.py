"""What is chosen by eye, from options or clicks, as keys of experiment.toml; and the motor's law from its log.

`init --pick`: a page on this machine that shows first frames, takes clicks and gives the picks back:
GET / and the page's files, GET /api/pictures (what is to be picked where), GET /picture/SECTION.png, POST /api/picks
(section -> picks; it ends the page). Bad picks are answered with 400 and {"problems": [...]}.
"""

from __future__ import annotations

import json
import math
import re
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from jumpvision.base.local_page import LocalHandler, LocalServer, Refused, static_files
from jumpvision.base.schema import InputError
from jumpvision.inputs.sections import PHASES
from jumpvision.vision.camera import READING, marks_share

from .recognise import FILMS, Recording, ball, moving_ball, opened

Values = dict[str, tuple[Any, str]]
FIRST = "column, row in the first frame"
FRAMES = 5  # that a ball's diameter is averaged over
BALL_SHARE = 0.01  # relative standard uncertainty of a scale by the diameter that a ball is seen with
RISE = 0.02  # of the amplitude: the motor has started


@dataclass(frozen=True)
class Picks:
    """Chosen in one film or picture; columns and rows in px, lengths in mm.

    ball: centre of the ball on the rod in the first frame. ball_diameter: its true diameter. marks: two points as
    x, y, x, y; distance: between them. foot: its lower face on its axis in the first frame. floor: row of the bed's.
    roi: two corners of the part of the grain film to match. rate: frames per second that the film was recorded at.
    """

    ball: tuple[float, ...] | None = None
    ball_diameter: float | None = None
    marks: tuple[float, ...] | None = None
    distance: float | None = None
    foot: tuple[float, ...] | None = None
    roi: tuple[float, ...] | None = None
    floor: float | None = None
    rate: float | None = None

    def check(self, where: str) -> list[str]:
        """What is wrong with them, in words."""
        sizes = (("ball", self.ball, 2), ("marks", self.marks, 4), ("foot", self.foot, 2), ("roi", self.roi, 4))
        out = [f"{where}: {k} = {list(v)}: must be {n} numbers" for k, v, n in sizes if v is not None and len(v) != n]
        lengths = (("ball diameter", self.ball_diameter), ("distance", self.distance), ("frame rate", self.rate))
        out += [f"{where}: {k} = {v:g}: must be > 0" for k, v in lengths if v is not None and not 0 < v < math.inf]
        if (self.marks is None) != (self.distance is None):
            out.append(f"{where}: two marks and their distance in mm belong together; give both")
        elif self.marks and not out and math.dist(self.marks[:2], self.marks[2:]) == 0:
            out.append(f"{where}: marks = {list(self.marks)}: the two points are the same")
        return out


def with_picks(folder: Path, recording: Recording, picks: Picks) -> tuple[Recording, Values]:
    """The recording with the values that the picks give, and values of [params.track]."""
    if problems := picks.check(f"{folder / recording.file}"):
        raise InputError(problems)
    values: Values = dict(recording.values)
    notes, track = list(recording.notes), Values()
    if picks.rate is not None and recording.section in FILMS:
        known = values.get("frame_rate", (picks.rate,))[0]
        values["frame_rate"] = (picks.rate, "as given")
        if abs(known / picks.rate - 1) > 1e-3:
            values["clock"] = ("declared", f"the file's own time stamps say {known:g} Hz")
    if recording.section == "rod_video":
        more, track, why = _ball(folder / recording.file, picks)
        values |= more
        notes += why
    if picks.marks and picks.distance:
        length = math.dist(picks.marks[:2], picks.marks[2:])
        scale = 1e-3 * picks.distance / length
        values["scale"] = (_digits(scale), f"{picks.distance:g} mm over {length:.1f} px")
        ends = np.array([complex(*picks.marks[:2]), complex(*picks.marks[2:])])
        clicks = f"each click good to {READING:g} px a coordinate, the distance exact"
        values["scale_sigma"] = (_rounded(scale * marks_share(ends, math.nan)), clicks)
    if recording.section == "grain_video" and picks.foot:
        values["axis_column"], values["foot_row"] = ((round(v, 2), "as picked") for v in picks.foot)
    if recording.section == "grain_video" and picks.roi:
        x, y = sorted(picks.roi[::2]), sorted(picks.roi[1::2])
        values["roi"] = ([round(v) for v in (x[0], y[0], x[1], y[1])], "as picked")
    if recording.section == "bed_image" and picks.floor is not None:
        values["floor_row"] = (round(picks.floor, 2), "as picked")
    return replace(recording, values=values, notes=tuple(notes)), track


def _ball(path: Path, picks: Picks) -> tuple[Values, Values, list[str]]:
    """Scale from the ball's diameter, its seed and polarity; notes."""
    values: Values = {}
    if picks.ball_diameter:
        values["ball_diameter"] = (1e-3 * picks.ball_diameter, "as given")
    seed = (picks.ball[0], picks.ball[1]) if picks.ball else None
    film, _ = opened(path)
    with film:
        seen = [(i, b) for i in range(min(FRAMES, len(film))) if (b := ball(film[i], seed))]
        moving = None if seen or seed else moving_ball(film)
    if moving:
        seen = [(moving[0], moving[1:])]
    if not seen:
        if seed is None:
            return values, {}, ["no ball was found in the first frames: give --ball COLUMN,ROW, or run init --pick"]
        values_of = {"method": ("template", "what was clicked is no plain disc"), "seed": (list(seed), FIRST)}
        where = f"column {seed[0]:g}, row {seed[1]:g}"
        return values, values_of, [f"no round ball at {where} of frame 0, as given: it is followed as a picture"]
    first, found = seen[0][0], [b for _, b in seen]
    polarity, column, row, _ = found[0]
    d = sum(f[3] for f in found) / len(found)
    if picks.ball_diameter:
        why = f"the ball's {picks.ball_diameter:g} mm over {d:.2f} px: good to 1 %; two marks are better"
        values["scale"] = (_digits(1e-3 * picks.ball_diameter / d), why)
        values["scale_sigma"] = (_rounded(BALL_SHARE * 1e-3 * picks.ball_diameter / d), f"{BALL_SHARE:.0%} of it")
    track: Values = {"seed": ([round(column, 1), round(row, 1)], FIRST)} if seed and first == 0 else {}
    if seed and first > 0:
        track = {"seed": (list(seed), FIRST)}
    if polarity == "dark":
        track["polarity"] = ("dark", "the ball is darker than what is behind it")
    return (
        values,
        track,
        [f"a {polarity} ball {d:.1f} px wide at column {column:.1f}, row {row:.1f} of frame {first}"],
    )


def _rounded(sigma: float) -> float:
    return float(f"{sigma:.2g}")


def _digits(value: float) -> float:
    return float(f"{value:.5g}")


KINDS = ("delayed_stutter", "delayed-stutter", "stutter", "single", "sine")


def law(name: str, log: Path | None) -> Values:
    """[actuation]: kind and frequency from the folder's name ("stutter-7.0Hz-1"), amplitude and
    start from the motor log. What is not known is left out."""
    kind = next((k for k in KINDS if k in name.lower().replace(" ", "_")), None)
    frequency = re.search(r"(\d+(?:\.\d+)?)\s*_?hz", name.lower())
    values: Values = {}
    if kind:
        kind = kind.replace("-", "_")
        values["kind"] = (kind, "by the folder's name")
    if frequency:
        values["frequency"] = (float(frequency[1]), "by the folder's name")
    if kind is None or frequency is None or log is None:
        return values
    from jumpvision.inputs.logs import read_log

    table = read_log(log, "time_s", "position_m")
    t, x = (table[c].to_numpy(float) for c in ("time_s", "position_m"))
    amplitude = float(x.max() - x.min()) / 2
    moved = abs(x - x[0]) > RISE * amplitude
    if not amplitude > 0 or not moved.any():
        return values
    late = math.acos(1 - RISE) if abs(math.sin(PHASES[kind])) == 1 else math.asin(RISE)  # rad from start to moved
    start = float(t[moved.argmax()]) - late / (2 * math.pi * float(frequency[1]))
    values["amplitude"] = (float(f"{amplitude:.4g}"), f"half the travel in {log.name}")
    values["start"] = (round(start, 4), f"when it moves in {log.name}; good to some ms, better from your controller")
    return values


def picks_of(table: Mapping[str, Any]) -> Picks:
    """Picks from the page's JSON. InputError for what is no number."""
    known = Picks.__dataclass_fields__
    out: dict[str, Any] = {}
    for key, value in table.items():
        if key not in known or value is None:
            continue
        items = value if isinstance(value, list) else [value]
        if not all(isinstance(v, int | float) and not isinstance(v, bool) and math.isfinite(v) for v in items):
            raise InputError([f"{key} = {value!r}: must be numbers"])
        out[key] = tuple(map(float, items)) if isinstance(value, list) else float(value)
    return Picks(**out)


LARGEST = 100_000  # bytes of an answer
MARKS = [("marks", 4, "Two marks (or the ends of a known length)"), ("distance", 1, "their distance [mm]")]
TOOLS: dict[str, list[tuple[str, int, str]]] = {  # section: (pick, how many numbers, its words)
    "rod_video": [("ball", 2, "Ball on the rod"), ("ball_diameter", 1, "its diameter [mm]"), *MARKS],
    "grain_video": [
        ("foot", 2, "Foot: its lower face, on its axis"),
        *MARKS,
        ("roi", 4, "Part to match (two corners; empty: all)"),
    ],
    "bed_image": [("floor", 1, "Floor of the bed (row)"), *MARKS],
    "crater_image": MARKS,
}


class Page:
    """Asks in the browser. port: 0 takes a free one. say: told the address."""

    def __init__(self, port: int, *, open_browser: bool, say: Callable[[str], None]):
        self.port, self.open_browser, self.say = port, open_browser, say

    def ask(self, folder: Path, found: Sequence[Recording]) -> Mapping[str, Picks]:
        """Picks by section for one folder; waits until the page is answered. None are asked where nothing is seen."""
        shown = [r for r in found if r.section in TOOLS]
        if not shown:
            return {}
        with Server(self.port, folder, shown) as server:
            self.say(f"{folder.name}: pick in the browser at {server.address} (Ctrl-C leaves everything unwritten)")
            if self.open_browser:
                import webbrowser

                webbrowser.open(server.address)
            threading.Thread(target=server.serve_forever, daemon=True).start()
            try:
                server.answered.wait()
            finally:
                server.shutdown()
        return server.picks


class Server(LocalServer):
    """Serves until picks came (`answered`)."""

    def __init__(self, port: int, folder: Path, found: Sequence[Recording]):
        self.answered, self.picks = threading.Event(), dict[str, Picks]()
        self.sections = {r.section for r in found}
        pictures, self.files = [], static_files(__package__, "pick.html")
        for r in found:
            png, shape = _first_frame(folder / r.file)
            self.files[f"/picture/{r.section}.png"] = ("image/png", png)
            tools = [{"key": k, "numbers": n, "label": label} for k, n, label in TOOLS[r.section]]
            pictures.append({"section": r.section, "file": r.file, "facts": r.facts, "shape": shape, "tools": tools})
        page = {"folder": folder.resolve().name, "pictures": pictures}
        self.files["/api/pictures"] = ("application/json", json.dumps(page).encode())
        super().__init__(port, Handler, "init")

    def take(self, answer: Any) -> None:
        """The page's answer. InputError with every problem."""
        if not isinstance(answer, dict) or not all(isinstance(v, dict) for v in answer.values()):
            raise InputError(["answer: must be a JSON object of sections"])
        picks = {s: picks_of(v) for s, v in answer.items() if s in self.sections}
        if problems := [p for s, v in picks.items() for p in v.check(s)]:
            raise InputError(problems)
        self.picks = picks


def _first_frame(path: Path) -> tuple[bytes, tuple[int, int]]:
    """The first frame as an 8 bit PNG, its darkest grey black and its brightest white; its (rows, columns)."""
    import cv2
    import numpy as np

    film, _ = opened(path)
    with film:
        image = np.asarray(film[0], float)
    low, high = np.nanmin(image), np.nanmax(image)
    grey = np.nan_to_num((image - low) * (255.0 / max(high - low, 1e-12))).round().astype(np.uint8)
    return cv2.imencode(".png", grey)[1].tobytes(), (image.shape[0], image.shape[1])


class Handler(LocalHandler):
    server: Server

    def do_GET(self) -> None:
        try:
            self.check_asker()
        except Refused as e:
            self._problems(e.status, [e.text])
            return
        found = self.server.files.get(self.path.partition("?")[0])
        if found:
            self.send(200, *found)
        else:
            self._problems(404, [f"{self.path}: there is no such page"])

    def do_POST(self) -> None:
        try:
            self.check_asker()
            body = self.body(LARGEST)
            if self.path != "/api/picks":
                raise Refused(404, f"{self.path}: an answer goes to /api/picks")
        except Refused as e:
            self._problems(e.status, [e.text])
            return
        try:
            self.server.take(json.loads(body))
        except InputError as e:
            self._problems(400, e.problems)
        except (ValueError, RecursionError):
            self._problems(400, ["answer: must be JSON"])
        else:
            self.close_connection = True
            self.send(200, "application/json", b"{}")
            self.server.answered.set()

    def _problems(self, status: int, problems: list[str]) -> None:
        self.send(status, "application/json", json.dumps({"problems": problems}).encode())
