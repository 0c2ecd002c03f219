"""The page's files: served on this machine only, or written to a folder for any web space. The page computes itself."""

from __future__ import annotations

import json
import mimetypes
import re
from importlib.resources import files
from pathlib import Path

from starlette.exceptions import HTTPException
from starlette.requests import Request
from starlette.responses import Response
from starlette.routing import Route

from jumpvision.base.local_page import LocalServer
from jumpvision.base.schema import InputError

from . import controls, laws

STATIC = files(__package__).joinpath("static")
MODULES = ("physics.js", "draw.js", "robot.js", "traces.js", "map.js", "page.js")  # each after those that it imports

IMPORT_OR_EXPORT = re.compile(r"^(import .*;\n|export )", re.MULTILINE)


def made_module() -> str:
    """Give the text of made.js, the module that is made from the package."""
    page = json.dumps(controls.page(), ensure_ascii=False)
    return f"export const bedLaw = {laws.bed_law(controls.BED_TERMS)};\nexport const page = {page};\n"


def script() -> str:
    """Give all modules as one classic script: browsers load no module from a folder (file://)."""
    text = "\n".join([made_module(), *(STATIC.joinpath(name).read_text("utf-8") for name in MODULES)])
    text = IMPORT_OR_EXPORT.sub("", text)
    return f'"use strict";\n{{\n{text}}}\n'


def page_files() -> dict[str, bytes]:
    """Give the content of every file of the page, by name."""
    static = {name: STATIC.joinpath(name).read_bytes() for name in ("index.html", "style.css", "icon.svg")}
    return {"jumper.js": script().encode(), **static}


class Server(LocalServer):
    """Return the jumper's page."""

    def __init__(self, port: int):
        content = page_files()

        def show(request: Request) -> Response:
            name = request.path_params.get("name", "index.html")
            if name not in content:
                raise HTTPException(404)
            return Response(content[name], media_type=mimetypes.guess_type(name)[0])

        super().__init__(port, [Route("/", show), Route("/{name}", show)], "demo")


def export(folder: Path) -> None:
    """Write the page into a new or empty folder, to be opened there or put on any web space."""
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        raise InputError([f"demo --export {folder}: is not empty; name a new or an empty folder"])
    folder.mkdir(parents=True, exist_ok=True)
    for name, content in page_files().items():
        (folder / name).write_bytes(content)
