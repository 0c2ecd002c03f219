"""The page's files: served on this machine only, or written to a folder for any web space. The page computes itself;
served, it may also have the recordings of a sealed world questioned by `jumpvision diagnose` (POST /api/diagnose)."""

from __future__ import annotations

import json
import re
import subprocess
import threading
from pathlib import Path
from tempfile import TemporaryDirectory

from jumpvision.base.local_page import TYPES, LocalHandler, LocalServer, Refused, static_files
from jumpvision.base.schema import InputError
from jumpvision.engine.document.diagnosis import Diagnosis
from jumpvision.experiment.workflow.cluster import SELF

from . import controls

DATA = "page.js"  # what the page is built from: a module, so that it also loads without a server
BUNDLE = "jumper.js"  # all modules in one classic script: browsers load no module from a folder (file://)


LARGEST = 2_000_000  # bytes of a campaign: six jumps of some seconds, with motor logs
FILE = re.compile(r"campaign\.toml|jump-[1-6]/(experiment\.toml|rod_track\.csv|motor\.csv)")
PATIENCE = 900  # s


def page_files(*, served: bool = True) -> dict[str, tuple[str, bytes]]:
    """Address -> type and content; what the page is built from is made now. served: whether it may ask this server."""
    data = f"export default {json.dumps(controls.page() | {'served': served}, ensure_ascii=False)};\n".encode()
    return {**static_files(__package__, "index.html"), f"/{DATA}": (f"{TYPES['.js']}; charset=utf-8", data)}


class Server(LocalServer):
    """The jumper's page."""

    def __init__(self, port: int):
        self.files = page_files()
        self.asking = threading.Lock()  # one question at a time
        super().__init__(port, Handler, "demo", secret=True)


class Handler(LocalHandler):
    server: Server

    def do_GET(self) -> None:
        try:
            self.check_asker()
            path = self.place().partition("?")[0]
        except Refused as e:
            self.send(e.status, "text/plain; charset=utf-8", e.text.encode())
            return
        if path in self.server.files:
            self.send(200, *self.server.files[path])
        else:
            self.send(404, "text/plain; charset=utf-8", f"{path}: there is no such page".encode())

    def do_POST(self) -> None:
        try:
            self.check_asker()
            place, files = self.place(), _campaign(self.body(LARGEST))
            if place != "/api/diagnose":
                raise Refused(404, f"{place}: there is no such question")
            if not self.server.asking.acquire(blocking=False):
                raise Refused(503, "a diagnosis is running; ask again when it is finished")
            try:
                status, answer = 200, diagnosed(files)
            finally:
                self.server.asking.release()
        except Refused as e:
            status, answer = e.status, {"problem": e.text}
        self.send(status, "application/json", json.dumps(answer).encode())


def _campaign(body: bytes) -> dict[str, str]:
    """The files of a campaign, by path, as the page writes them."""
    try:
        files = json.loads(body)
    except (ValueError, RecursionError):
        raise Refused(400, "question: must be JSON") from None
    if not isinstance(files, dict) or not all(FILE.fullmatch(k) and isinstance(v, str) for k, v in files.items()):
        raise Refused(400, "question: must hold campaign.toml and jump-1 to jump-6 as texts")
    return files


def diagnosed(files: dict[str, str]) -> dict[str, object]:
    """What `jumpvision diagnose` says of a campaign, in a process of its own. Refused where it says nothing."""
    with TemporaryDirectory() as made:
        folder, results = Path(made) / "world", Path(made) / "results"
        for name, text in files.items():
            (folder / name).parent.mkdir(parents=True, exist_ok=True)
            (folder / name).write_text(text, encoding="utf-8")
        command = [*SELF, "diagnose", str(folder), "--results", str(results), "--no-pictures"]
        try:
            run = subprocess.run(command, capture_output=True, text=True, errors="replace", timeout=PATIENCE)
        except subprocess.TimeoutExpired:
            raise Refused(504, f"diagnose: no answer in {PATIENCE} s") from None
        if not (results / Diagnosis.file).exists():
            raise Refused(400, (run.stderr.strip().splitlines() or ["diagnose: failed"])[-1])
        said = json.loads((results / Diagnosis.file).read_text(encoding="utf-8"))
    return {k: said[k] for k in ("verdict", "named", "indistinguishable")}


def export(folder: Path) -> list[Path]:
    """Writes the page into a new or empty folder, to be opened there or put on any web space: the files written."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError([f"demo --export {folder}: is not empty; name a new or an empty folder"])
    pages = {name[1:]: x for name, (_, x) in page_files(served=False).items() if name != "/"}
    modules = {name: x.decode() for name, x in pages.items() if name.endswith(".js")}
    index = pages["index.html"].decode().replace('type="module" src="main.js"', f'defer src="{BUNDLE}"')
    written = {n: x for n, x in pages.items() if n not in modules} | {BUNDLE: bundled(modules, "main.js").encode()}
    written |= {"index.html": index.encode()}  # the last: a folder with it is whole
    folder.mkdir(parents=True, exist_ok=True)
    for name in sorted(written, key="index.html".__eq__):
        (folder / name).write_bytes(written[name])
    return [folder / name for name in written]


IMPORT = re.compile(r'^import (\w+|\{[^}]*\}) from "([^"]+)";$', re.MULTILINE)
EXPORT = re.compile(r"^export (?:async )?(?:const|let|function|class) (\w+)", re.MULTILINE)


def bundled(modules: dict[str, str], first: str) -> str:
    """The modules as one classic script, each in a function of its own, those it imports before it."""
    order: list[str] = []

    def visit(name: str) -> None:
        for _, source in IMPORT.findall(modules[name]):
            other = _beside(name, source)
            if other not in order:
                visit(other)
        order.append(name)

    visit(first)
    parts = [_wrapped(name, modules[name]) for name in order]
    return "\n".join(['"use strict";', "(() => {", "const modules = {};", *parts, "})();", ""])


def _wrapped(name: str, text: str) -> str:
    """A module as a function that leaves what it exports in `modules`."""
    exported = EXPORT.findall(text)
    if "export default " in text:
        exported = ["default: whole"]
    text = IMPORT.sub(lambda m: _taken(m[1], _beside(name, m[2])), text)
    text = text.replace("export default ", "const whole = ")
    text = re.sub(r"^export ", "", text, flags=re.MULTILINE)
    return f"modules[{name!r}] = (() => {{\n{text}\nreturn {{ {', '.join(exported)} }};\n}})();"


def _taken(what: str, source: str) -> str:
    """An import as a constant of the bundle."""
    names = what.replace(" as ", ": ") if what.startswith("{") else f"{{ default: {what} }}"
    return f"const {names} = modules[{source!r}];"


def _beside(name: str, source: str) -> str:
    """The path that a module's import names."""
    parts = name.split("/")[:-1]
    for step in source.split("/"):
        if step == "..":
            parts.pop()
        elif step != ".":
            parts.append(step)
    return "/".join(parts)
