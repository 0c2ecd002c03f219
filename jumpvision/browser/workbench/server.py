"""The workbench's page, for who knows its address on this machine: answers from the readers, trackers and matchers.

GET / and the page's files; GET /api/state, /api/frame/SECTION/N/WIDTH.jpg, /api/track?since=N, /api/run. POST with a
JSON object, see `QUESTIONS`, or with a file, /api/add/file/NAME. Bad input is answered with 400 and {"problems": [text,
...]}.
"""

from __future__ import annotations

import dataclasses
import json
import math
import re
import traceback
from collections.abc import Callable
from pathlib import Path
from urllib.parse import unquote

from jumpvision.base.local_page import ALONE, LocalHandler, LocalServer, Refused, static_files
from jumpvision.base.record import plain
from jumpvision.base.schema import InputError
from jumpvision.films.frames import FrameError

from .bench import Benches
from .draft import draft_of
from .plotting import Motion, Part

LARGEST = 4_000_000  # bytes of a question
FRAME = re.compile(r"/api/frame/([a-z_]+)/([0-9]{1,9})/([0-9]{1,5})\.jpg")
TRACK = re.compile(r"/api/track\?since=([0-9]{1,9})")
REPORT = re.compile(r"/report/(?:([^/]+)/)?report\.html")
ADD = re.compile(r"/api/add/file/([^/]+)")
LARGEST_FILE = 10**12 - 1  # bytes
SMALL = re.compile(r"/small/([^/]+?)(?:/([0-9]{1,9}))?\.jpg")
WHY = re.compile(r"/api/why/([^/]+)")
Question = dict[str, object]


def _whole(q: Question, key: str) -> int:
    value = q.get(key)
    if isinstance(value, bool) or not isinstance(value, int):
        raise InputError([f"{key} = {value!r}: must be a whole number"])
    return value


def _text(q: Question, key: str) -> str:
    value = q.get(key)
    if not isinstance(value, str):
        raise InputError([f"{key} = {value!r}: must be text"])
    return value


def _number(q: Question, key: str) -> float:
    value = q.get(key)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise InputError([f"{key} = {value!r}: must be a number"])
    return float(value)


def _find(b: Benches, q: Question) -> object:
    seed = q.get("seed")
    if seed is None:
        return b.bench.find(_text(q, "section"), _whole(q, "frame"), None)
    if not (isinstance(seed, list) and len(seed) == 2 and all(isinstance(v, int | float) for v in seed)):
        raise InputError([f"seed = {seed!r}: must be [column, row] in px"])
    return b.bench.find(_text(q, "section"), _whole(q, "frame"), (float(seed[0]), float(seed[1])))


def _preview(b: Benches, q: Question) -> object:
    made = b.bench.composed(draft_of(q.get("draft")))
    made.check()
    return {"text": made.text, "difference": made.difference, "seen": made.seen, "table": made.table}


def _write(b: Benches, q: Question) -> object:
    return {"written": b.bench.write(draft_of(q.get("draft")), _text(q, "seen"))}


def _track(b: Benches, q: Question) -> object:
    b.bench.follow(draft_of(q.get("draft")))
    return {}


def _stop(b: Benches, _: Question) -> object:
    if b.bench.following:
        b.bench.following.stop()
    return {}


def _flow(b: Benches, q: Question) -> object:
    return b.bench.flow(draft_of(q.get("draft")), _whole(q, "frame"), _text(q, "map"), q.get("mean") is True)


def _all_pairs(b: Benches, q: Question) -> object:
    b.bench.all_pairs(draft_of(q.get("draft")))
    return {}


def _stop_pairs(b: Benches, _: Question) -> object:
    b.bench.flowing.stop()
    return {}


def _matched(b: Benches) -> object:
    run = b.bench.flowing.batch
    if run is None:
        return {"running": False}
    running = run.running  # before the rest: what comes with its end is then told
    now = {"what": run.what, "done": run.done, "total": run.total, "problem": run.problem, "notes": run.notes}
    return {"running": running, "matched": run.piv is not None, "mean": run.mean is not None, "why": run.why, **now}


def _change(b: Benches, q: Question) -> object:
    b.change(_text(q, "experiment"))
    return b.state()


def _role(b: Benches, q: Question) -> object:
    b.as_role(_text(q, "section"), _text(q, "role"))
    return b.state()


def _run(b: Benches, _: Question) -> object:
    b.run()
    return {}


def _halt(b: Benches, _: Question) -> object:
    if b.running:
        b.running.stop()
    return {}


def _motion(b: Benches, q: Question) -> Motion:
    return b.bench.motion(draft_of(q.get("draft")), _whole(q, "body") if "body" in q else 1)


def _fit(b: Benches, q: Question) -> object:
    part = Part(_text(q, "x"), _text(q, "y"), _number(q, "low"), _number(q, "high"), _text(q, "curve"))
    return _motion(b, q).fit(part)


def _keep(b: Benches, q: Question) -> object:
    b.bench.keep(q.get("page"))
    return {}


def _add(b: Benches, q: Question) -> object:
    files = q.get("files")
    whole = isinstance(files, dict) and all(type(n) is int and n >= 0 for n in files.values())
    if not isinstance(files, dict) or not whole:
        raise InputError(["files: must be an object, name: bytes"])
    b.add(_text(q, "folder"), files)
    return {}


def _added(b: Benches, _: Question) -> object:
    b.added()
    return b.state()


def _followed(b: Benches, since: int) -> object:
    rows, run = b.bench.followed(since)
    if run is None:
        return {"rows": [], "running": False, "finished": False}
    ended = not run.running  # before the rows are taken: none may come after the last answer
    rows = run.rows(since) if ended else rows
    now = {"doing": run.doing, "problem": run.problem, "notes": run.notes}
    return {"rows": rows, "running": not ended, "finished": run.finished, **now}


def _ran(b: Benches) -> object:
    run = b.running
    if run is None:
        return {"running": False}
    return {"running": run.running, "said": run.said, "lines": list(run.lines), "done": run.done, "total": run.total}


QUESTIONS: dict[str, Callable[[Benches, Question], object]] = {
    "/api/find": _find,
    "/api/preview": _preview,
    "/api/write": _write,
    "/api/track": _track,
    "/api/track/stop": _stop,
    "/api/flow": _flow,
    "/api/flow/all": _all_pairs,
    "/api/flow/stop": _stop_pairs,
    "/api/flow/light": lambda b, q: b.bench.lit(draft_of(q.get("draft")), _whole(q, "frame"), _whole(q, "width")),
    "/api/add": _add,
    "/api/add/end": _added,
    "/api/add/stop": lambda b, _: {"problem": b.stop_adding()},
    "/api/bed": lambda b, q: b.bench.bed(draft_of(q.get("draft")), _whole(q, "frame")),
    "/api/crater": lambda b, q: b.bench.crater(draft_of(q.get("draft")), _whole(q, "frame")),
    "/api/columns": lambda b, q: _motion(b, q).columns(),
    "/api/fit": _fit,
    "/api/simulated": lambda b, q: b.simulated(draft_of(q.get("draft"))),
    "/api/study": lambda b, q: b.studied(draft_of(q.get("draft"))),
    "/api/keep": _keep,
    "/api/logs": lambda b, q: b.bench.logs(draft_of(q.get("draft"))),
    "/api/open": _change,
    "/api/role": _role,
    "/api/run": _run,
    "/api/run/stop": _halt,
}


class Server(LocalServer):
    """Serves the benches of a path, with a user's own study. Raises InputError where nothing is there to open."""

    def __init__(self, path: Path, port: int, study: str = ""):
        self.files = static_files(__package__, "index.html")
        self.benches = Benches(path, study)
        super().__init__(port, Handler, "open", secret=True)

    def close_benches(self) -> None:
        """Stops what runs and gives the films back."""
        self.benches.close()


class Handler(LocalHandler):
    server: Server

    def do_GET(self) -> None:
        self._answer(self._get)

    def do_POST(self) -> None:
        self._answer(self._post)

    def _get(self) -> None:
        self.check_asker()
        benches, path = self.server.benches, self.place()
        if m := FRAME.fullmatch(path):
            self.send(200, "image/jpeg", benches.bench.film(m[1]).jpeg(int(m[2]), int(m[3])))
        elif m := TRACK.fullmatch(path):
            self._json(200, _followed(benches, int(m[1])))
        elif path == "/api/state":
            self._json(200, benches.state())
        elif path == "/api/flow/all":
            self._json(200, _matched(benches))
        elif path == "/api/earlier":
            self._json(200, benches.earlier())
        elif path == "/api/glance":
            self._json(200, benches.glance())
        elif m := SMALL.fullmatch(path):
            self.send(200, "image/jpeg", benches.small(unquote(m[1]), int(m[2]) if m[2] else None))
        elif m := WHY.fullmatch(path):
            self._json(200, benches.why(unquote(m[1])))
        elif m := REPORT.fullmatch(path):
            self.send(200, "text/html; charset=utf-8", benches.report(unquote(m[1] or "")), ALONE)
        elif path == "/api/run":
            self._json(200, _ran(benches))
        elif (file := path.partition("?")[0]) in self.server.files:
            self.send(200, *self.server.files[file])
        else:
            raise Refused(404, f"{path}: there is no such page")

    def _post(self) -> None:
        self.check_asker()
        path = self.place()
        if m := ADD.fullmatch(path):
            self._file(unquote(m[1]))
            return
        body = self.body(LARGEST)
        answer = QUESTIONS.get(path)
        if answer is None:
            raise Refused(404, f"{path}: there is no such question")
        try:
            question = json.loads(body)
        except (ValueError, RecursionError):
            raise Refused(400, "question: must be JSON") from None
        if not isinstance(question, dict):
            raise Refused(400, "question: must be a JSON object")
        self._json(200, answer(self.server.benches, question))

    def _file(self, name: str) -> None:
        adding, pieces = self.server.benches.adding, self.pieces(LARGEST_FILE, "application/octet-stream")
        if adding is None:
            self.close_connection = True
            raise Refused(400, f"{name}: no folder was begun for it")
        try:
            adding.write(name, pieces)
        except BaseException:
            self.close_connection = True
            raise
        self._json(200, {})

    def _answer(self, work: Callable[[], None]) -> None:
        try:
            work()
        except Refused as e:
            self._json(e.status, {"problems": [e.text]})
        except InputError as e:
            self._json(400, {"problems": e.problems})
        except (FrameError, ValueError, OSError) as e:
            if isinstance(e, ConnectionError | TimeoutError):
                raise
            self._json(400, {"problems": [str(e)]})
        except Exception:
            traceback.print_exc()
            self._json(500, {"problems": ["the workbench failed; the terminal of `jumpvision open` says where"]})

    def _json(self, status: int, answer: object) -> None:
        self.send(status, "application/json", json.dumps(plain(_open(answer))).encode())


def _open(value: object) -> object:
    """Records as objects, at any depth of lists and objects."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return dataclasses.asdict(value)
    return [_open(v) for v in value] if isinstance(value, list | tuple) else value
