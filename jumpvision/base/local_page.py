"""A page served on this machine only, by Starlette and uvicorn: who may ask, what every answer says, the server."""

from __future__ import annotations

import mimetypes
import secrets
import socket
from collections.abc import Iterator, Sequence

import uvicorn
from anyio import from_thread  # of Starlette, whose threads they are
from starlette.applications import Starlette
from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.requests import ClientDisconnect, Request
from starlette.responses import JSONResponse
from starlette.routing import BaseRoute, Mount
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from .schema import InputError

HOST = "127.0.0.1"
for suffix, kind in {".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}.items():
    mimetypes.add_type(kind, suffix)  # Windows' registry may say otherwise
# of a page that holds all it needs: it reaches nothing, and none of this server's questions
ALONE = (
    "sandbox allow-scripts allow-popups; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; media-src data: blob:; font-src data:; frame-ancestors 'self'"
)
HEADERS = {
    "Cache-Control": "no-store",
    "Content-Security-Policy": (
        "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; frame-ancestors 'none'"
    ),
    "X-Content-Type-Options": "nosniff",
}


class OwnPage:
    """Answer our own page and programs on this machine that know the address; give every answer its `HEADERS`.

    Another site's name may be pointed here (Host), and any page that is open in the browser may send here (Origin).
    """

    def __init__(self, app: ASGIApp, root: str, port: int) -> None:
        self.app, self.root = app, root
        self.here = [f"{name}{end}" for end in (f":{port}", "")[: 1 + (port == 80)] for name in (HOST, "localhost")]

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        async def send_with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    headers.setdefault(name, value)
            await send(message)

        refusal = self.refusal(Headers(scope=scope), scope["path"])
        app = JSONResponse({"problems": [refusal]}, 403) if refusal else self.app
        await app(scope, receive, send_with_headers)

    def refusal(self, headers: Headers, path: str) -> str:
        """Say why nothing is answered; "" where it is."""
        if len(hosts := headers.getlist("host")) != 1 or hosts[0].lower() not in self.here:
            return f"Host: must be {' or '.join(self.here)}"
        if any(o.lower() not in [f"http://{h}" for h in self.here] for o in headers.getlist("origin")):
            return f"Origin: must be this page (http://{self.here[0]}); no other page may ask"
        if not secrets.compare_digest(path[: len(self.root)].encode(), self.root.encode()):
            return "the secret part of this address is missing; open the address that the terminal shows"
        return ""


class LocalServer:
    """Serve routes on 127.0.0.1; port 0 takes a free one (`address` tells which). command: named where it cannot.

    secret: only who knows the address is answered: its first part is drawn anew by every server, since other users of
    the machine reach the port too.
    """

    def __init__(self, port: int, routes: Sequence[BaseRoute], command: str, *, secret: bool = False) -> None:
        try:
            self.socket = socket.create_server((HOST, port))
        except (OSError, OverflowError) as e:
            raise InputError([f"{command} --port {port}: {e}; give another port, or 0 for a free one"]) from None
        self.socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)  # else 40 ms an answer on one connection
        self.port = self.socket.getsockname()[1]
        self.root = f"/{secrets.token_urlsafe(16)}/" if secret else "/"
        self.address = f"http://{HOST}:{self.port}{self.root}"
        app = Starlette(
            routes=[Mount(self.root[:-1], routes=routes)],
            exception_handlers={HTTPException: _problems, ValueError: _problems, OSError: _problems, 500: _problems},
        )
        config = uvicorn.Config(
            OwnPage(app, self.root, self.port),
            lifespan="off",
            ws="none",
            timeout_keep_alive=60,
            log_level="error",
            access_log=False,
        )
        self.server = uvicorn.Server(config)

    def serve_forever(self) -> None:
        """Answer until Ctrl-C (KeyboardInterrupt) or `close`."""
        self.server.run([self.socket])

    def close(self) -> None:
        """End `serve_forever`, which another thread runs."""
        self.server.should_exit = True


def _problems(request: Request, error: Exception) -> JSONResponse:
    """Answer what is wrong as {"problems": [text, ...]}."""
    if isinstance(error, HTTPException):
        if error.status_code in (404, 405):
            return JSONResponse({"problems": [f"{request.url.path}: there is no such page"]}, 404)
        return JSONResponse({"problems": [error.detail]}, error.status_code)
    if isinstance(error, ValueError | OSError):
        return JSONResponse({"problems": error.problems if isinstance(error, InputError) else [str(error)]}, 400)
    return JSONResponse({"problems": ["the server failed; the terminal of this command says where"]}, 500)


def pieces(request: Request, largest: int, kind: str) -> Iterator[bytes]:
    """Read a request's body in pieces as it comes, for a function in a thread.

    Raises HTTPException where the length [bytes] is not given, too large or not kept, or the type is not `kind`.
    """
    size = request.headers.get("Content-Length", "")
    if not size.isdecimal() or int(size) > largest:
        raise HTTPException(413, f"Content-Length: must be given and at most {largest} bytes")
    if request.headers.get("Content-Type", "").partition(";")[0].strip() != kind:
        raise HTTPException(415, f"Content-Type: must be {kind}")
    stream, came = request.stream(), 0
    try:
        while piece := from_thread.run(anext, stream, b""):
            came += len(piece)
            yield piece
    except ClientDisconnect:
        raise HTTPException(400, f"Content-Length: {size} bytes, but {came} came") from None
