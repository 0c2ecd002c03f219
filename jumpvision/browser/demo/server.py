"""The page's server: standard library only, on this machine only, answering with the package's solvers.

GET / and the page's files, GET /api/page (what the page is built from), POST /api/jump and POST /api/map (`jumper`).
Bad input is answered with 400 and {"problems": [{"keys", "text"}]}, keys being the settings that a problem names.
"""

from __future__ import annotations

import json
import re
import traceback
from collections.abc import Callable
from typing import Any

from jumpvision.base.local_page import LocalHandler, LocalServer, Refused, static_files
from jumpvision.base.schema import InputError

from . import controls, jumper

LARGEST = 2_000_000  # bytes of a question
QUESTIONS: dict[str, Callable[[Any], dict[str, Any]]] = {"/api/jump": jumper.jump, "/api/map": jumper.height_map}


class Server(LocalServer):
    """The jumper's page."""

    def __init__(self, port: int):
        self.files = static_files(__package__, "index.html")
        self.page = json.dumps(controls.page()).encode()
        super().__init__(port, Handler, "demo")


class Handler(LocalHandler):
    server: Server

    def do_GET(self) -> None:
        path = self.path.partition("?")[0]
        try:
            self.check_asker()
        except Refused as e:
            self._problem(e.status, e.text)
            return
        if path == "/api/page":
            self.send(200, "application/json", self.server.page)
        elif path in self.server.files:
            self.send(200, *self.server.files[path])
        else:
            self._problem(404, f"{path}: there is no such page")

    def do_POST(self) -> None:
        try:
            self.check_asker()
            body = self.body(LARGEST)
        except Refused as e:
            self._problem(e.status, e.text)
            return
        answer = QUESTIONS.get(self.path)
        if answer is None:
            self._problem(404, f"{self.path}: there is no such question")
            return
        try:
            question = json.loads(body)
            if not isinstance(question, dict):
                raise InputError(["question: must be a JSON object"])
            self._json(200, answer(question))
        except InputError as e:
            self._json(400, {"problems": [{"keys": keys(p), "text": p} for p in e.problems]})
        except (ValueError, RecursionError):
            self._problem(400, "question: must be JSON")
        except Exception:
            traceback.print_exc()
            self._problem(500, "the solver failed; the terminal of `jumpvision demo` says where")

    def _problem(self, status: int, text: str) -> None:
        self._json(status, {"problems": [{"keys": [], "text": text}]})

    def _json(self, status: int, answer: Any) -> None:
        self.send(status, "application/json", json.dumps(answer).encode())


NAMES = sorted({s.key for s in controls.SLIDERS})


def keys(problem: str) -> list[str]:
    """The settings that a problem is about: those named before its first colon or value."""
    head = re.split(r"[:=]", problem, maxsplit=1)[0]
    words = set(re.findall(r"\w+", head))
    return [n for n in NAMES if n in words]
