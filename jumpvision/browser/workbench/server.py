"""The workbench's page, for who knows its address on this machine: answers from the readers, trackers and matchers.

GET / and the page's files; GET /api/state, /api/frame/SECTION/N/WIDTH.jpg, /api/track?since=N, /api/run. POST with a
JSON object, see `QUESTIONS`, or with a file, /api/add/file/NAME. Bad input is answered with 400 and {"problems": [text,
...]}.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import BaseRoute, Mount, Route
from starlette.staticfiles import StaticFiles

from jumpvision.base.local_page import ALONE, LocalServer, pieces
from jumpvision.base.record import plain
from jumpvision.base.schema import InputError

from .bench import Benches
from .draft import draft_of
from .plotting import Motion, Part

LARGEST = 4_000_000  # bytes of a question
LARGEST_FILE = 10**12 - 1  # bytes
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
    "/api/candidates": lambda b, q: b.bench.candidates(_whole(q, "frame")),
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
        self.benches = Benches(path, study)
        super().__init__(port, routes(self.benches), "open", secret=True)

    def close(self) -> None:
        """Stops what runs and gives the films back."""
        super().close()
        self.benches.close()


def routes(b: Benches) -> list[BaseRoute]:
    """Return the routes of the workbench; parts of a path are arguments by name."""

    def json_route(path: str, answer: Callable[..., object]) -> Route:
        return Route(path, lambda r: _json(answer(**r.path_params)))

    def picture(path: str, jpeg: Callable[..., bytes]) -> Route:
        return Route(path, lambda r: Response(jpeg(**r.path_params), media_type="image/jpeg"))

    def question_route(path: str, answer: Callable[[Benches, Question], object]) -> Route:
        return Route(path, lambda r: _json(answer(b, _question(r))), methods=["POST"])

    def report(r: Request) -> Response:
        page = b.report(r.path_params.get("name", ""))
        return Response(page, media_type="text/html", headers={"Content-Security-Policy": ALONE})

    def add_file(r: Request) -> Response:
        if b.adding is None:
            raise InputError([f"{r.path_params['name']}: no folder was begun for it"])
        b.adding.write(r.path_params["name"], pieces(r, LARGEST_FILE, "application/octet-stream"))
        return _json({})

    return [
        picture("/api/frame/{section}/{i:int}/{width:int}.jpg", lambda section, **at: b.bench.film(section).jpeg(**at)),
        Route("/api/track", lambda r: _json(_followed(b, int(r.query_params.get("since", "0"))))),
        json_route("/api/state", b.state),
        json_route("/api/flow/all", lambda: _matched(b)),
        json_route("/api/earlier", b.earlier),
        json_route("/api/glance", b.glance),
        json_route("/api/why/{name}", b.why),
        json_route("/api/run", lambda: _ran(b)),
        picture("/small/{name}/{frame:int}.jpg", b.small),
        picture("/small/{name}.jpg", b.small),
        Route("/report/report.html", report),
        Route("/report/{name}/report.html", report),
        Route("/api/add/file/{name}", add_file, methods=["POST"]),
        *(question_route(path, answer) for path, answer in QUESTIONS.items()),
        Mount("/", StaticFiles(packages=[(str(__package__), "static")], html=True)),
    ]


def _question(request: Request) -> Question:
    try:
        question = json.loads(b"".join(pieces(request, LARGEST, "application/json")))
    except (ValueError, RecursionError):
        raise HTTPException(400, "question: must be JSON") from None
    if not isinstance(question, dict):
        raise HTTPException(400, "question: must be a JSON object")
    return question


def _json(answer: object) -> Response:
    return Response(json.dumps(plain(_open(answer))), media_type="application/json")


def _open(value: object) -> object:
    """Records as objects, at any depth of lists and objects."""
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return dataclasses.asdict(value)
    return [_open(v) for v in value] if isinstance(value, list | tuple) else value
