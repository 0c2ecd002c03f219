"""The page's server: standard library only, on this machine only, answering with the package's solvers.

GET / and the page's files, GET /api/page (what the page is built from), POST /api/jump and POST /api/map (`jumper`).
Bad input is answered with 400 and {"problems": [{"keys", "text"}]}, keys being the settings that a problem names.
"""

from __future__ import annotations

import json
import re
import sys
import traceback
from collections.abc import Callable
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any

from ..schema import InputError
from . import controls, jumper

HOST = "127.0.0.1"
LARGEST = 2_000_000  # bytes of a question
TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
POLICY = "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; frame-ancestors 'none'"
QUESTIONS: dict[str, Callable[[Any], dict[str, Any]]] = {"/api/jump": jumper.jump, "/api/map": jumper.height_map}


def static_files() -> dict[str, tuple[str, bytes]]:
    """Address -> type and content of the page's files. Only these are served: no address is turned into a path."""
    out = {}
    for f in files(__package__).joinpath("static").iterdir():
        suffix = f.name[f.name.rfind(".") :]
        if suffix in TYPES:
            out[f"/{f.name}"] = (f"{TYPES[suffix]}; charset=utf-8", f.read_bytes())
    out["/"] = out["/index.html"]
    return out


class Server(ThreadingHTTPServer):
    """Listens on 127.0.0.1; port 0 takes a free one (`address` tells which)."""

    daemon_threads = True

    def __init__(self, port: int):
        self.files = static_files()
        self.page = json.dumps(controls.page()).encode()
        try:
            super().__init__((HOST, port), Handler)
        except (OSError, OverflowError) as e:
            raise InputError([f"demo --port {port}: {e}; give another port, or 0 for a free one"]) from None

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that leaves in the middle of an answer is no error."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)

    @property
    def address(self) -> str:
        return f"http://{HOST}:{self.server_port}/"


class Handler(BaseHTTPRequestHandler):
    """One connection of a browser."""

    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    server: Server

    def do_GET(self) -> None:
        path = self.path.partition("?")[0]
        if not self._local():
            return
        if path == "/api/page":
            self._send(200, "application/json", self.server.page)
        elif path in self.server.files:
            self._send(200, *self.server.files[path])
        else:
            self._problem(404, f"{path}: there is no such page")

    def do_POST(self) -> None:
        size = self.headers.get("Content-Length", "")
        if not size.isdigit() or int(size) > LARGEST:
            self.close_connection = True
            self._problem(413, f"Content-Length: must be given and at most {LARGEST} bytes")
            return
        body = self.rfile.read(int(size))
        if not self._local():
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

    def _local(self) -> bool:
        """Whether the browser asked for this machine by name: another site's name may be pointed here."""
        host = self.headers.get("Host", "").rpartition(":")[0]
        if host in (HOST, "localhost"):
            return True
        self._problem(403, f"Host: must be {HOST} or localhost")
        return False

    def _problem(self, status: int, text: str) -> None:
        self._json(status, {"problems": [{"keys": [], "text": text}]})

    def _json(self, status: int, answer: Any) -> None:
        self._send(status, "application/json", json.dumps(answer).encode())

    def _send(self, status: int, kind: str, body: bytes) -> None:
        self.send_response(status)
        for name, value in {
            "Content-Type": kind, "Content-Length": str(len(body)), "Cache-Control": "no-store",
            "Content-Security-Policy": POLICY, "X-Content-Type-Options": "nosniff",
        }.items():  # fmt: skip
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        """No line for every request."""


NAMES = sorted({s.key for s in controls.SLIDERS})


def keys(problem: str) -> list[str]:
    """The settings that a problem is about: those named before its first colon or value."""
    head = re.split(r"[:=]", problem, maxsplit=1)[0]
    words = set(re.findall(r"\w+", head))
    return [n for n in NAMES if n in words]
