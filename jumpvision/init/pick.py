"""`init --pick`: a page on this machine that shows first frames, takes clicks and gives the picks back.

GET / and the page's files, GET /api/pictures (what is to be picked where), GET /picture/SECTION.png, POST /api/picks
(section -> picks; it ends the page). Bad picks are answered with 400 and {"problems": [...]}.
"""

from __future__ import annotations

import json
import threading
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from jumpvision.base.local_page import LocalHandler, LocalServer, static_files
from jumpvision.base.schema import InputError

from .measure import Picks, picks_of
from .recognise import Recording, opened

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
        found = self.server.files.get(self.path.partition("?")[0]) if self.asked_here() else None
        if found:
            self.send(200, *found)
        else:
            self._problems(404, [f"{self.path}: there is no such page"])

    def do_POST(self) -> None:
        size = self.headers.get("Content-Length", "")
        body = self.rfile.read(int(size)) if size.isdigit() and int(size) <= LARGEST else b""
        if not body or self.path != "/api/picks" or not self.asked_here():
            self.close_connection = True
            self._problems(400, ["answer: must be sent to /api/picks of this machine, as JSON of a few lines"])
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
