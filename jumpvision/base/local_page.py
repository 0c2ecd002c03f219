"""A page served on this machine only, by the standard library: its files, its server, one connection of a browser."""

from __future__ import annotations

import re
import secrets
import socket
import sys
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files

from .schema import InputError

HOST = "127.0.0.1"
PIECE = 2**20  # bytes of what is sent that are in memory at a time
TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
# of a page that holds all it needs: it reaches nothing, and none of this server's questions
ALONE = (
    "sandbox allow-scripts allow-popups; default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data: blob:; media-src data: blob:; font-src data:; frame-ancestors 'self'"
)
POLICY = "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; frame-ancestors 'none'"


def static_files(package: str, index: str) -> dict[str, tuple[str, bytes]]:
    """Address -> type and content of a package's static/ and the folders in it. Only these are served: no address is
    turned into a path."""
    out, folders = {}, [("/", files(package).joinpath("static"))]
    for prefix, folder in folders:
        for f in folder.iterdir():
            suffix = f.name[f.name.rfind(".") :]
            if f.is_dir():
                folders.append((f"{prefix}{f.name}/", f))
            elif suffix in TYPES:
                out[prefix + f.name] = (f"{TYPES[suffix]}; charset=utf-8", f.read_bytes())
    out["/"] = out[f"/{index}"]
    return out


class LocalServer(ThreadingHTTPServer):
    """Listens on 127.0.0.1; port 0 takes a free one (`address` tells which). command: named where it cannot.

    secret: only who knows the address is answered: its first part is drawn anew by every server, since other users of
    the machine reach the port too.
    """

    daemon_threads = True

    def __init__(self, port: int, handler: type[BaseHTTPRequestHandler], command: str, *, secret: bool = False):
        self.root = f"/{secrets.token_urlsafe(16)}/" if secret else "/"
        try:
            super().__init__((HOST, port), handler)
        except (OSError, OverflowError) as e:
            raise InputError([f"{command} --port {port}: {e}; give another port, or 0 for a free one"]) from None

    def handle_error(self, request: socket.socket | tuple[bytes, socket.socket], client_address: object) -> None:
        """A browser that leaves in the middle of an answer is no error."""
        if not isinstance(sys.exc_info()[1], ConnectionError | TimeoutError):
            super().handle_error(request, client_address)

    @property
    def address(self) -> str:
        return f"http://{HOST}:{self.server_port}{self.root}"


class Refused(Exception):
    """A request that is not answered; status: of HTTP."""

    def __init__(self, status: int, text: str):
        self.status, self.text = status, text
        super().__init__(text)


class LocalHandler(BaseHTTPRequestHandler):
    """One connection of a browser."""

    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True
    timeout = 60.0  # s without a byte, after which a connection is given up
    server: LocalServer

    def check_asker(self) -> None:
        """Refused unless our own page, or a program on this machine, asks.

        Another site's name may be pointed here (Host), and any page that is open in the browser may send here (Origin).
        """
        port = self.server.server_port
        here = [f"{name}:{port}" for name in (HOST, "localhost")]
        if port == 80:
            here += [HOST, "localhost"]
        hosts, origins = self.headers.get_all("Host", []), self.headers.get_all("Origin", [])
        if len(hosts) != 1 or hosts[0].lower() not in here:
            self.close_connection = True
            raise Refused(403, f"Host: must be {' or '.join(here)}")
        if any(o.lower() not in [f"http://{h}" for h in here] for o in origins):
            self.close_connection = True
            raise Refused(403, f"Origin: must be this page (http://{here[0]}); no other page may ask")
        if self.command != "POST" and (self.headers.get("Content-Length", "0") != "0" or self._chunked):
            self.close_connection = True
            raise Refused(400, f"{self.command}: has no body")

    def place(self) -> str:
        """What is asked for, from / on; Refused where the address lacks the server's own part."""
        root, begin = self.server.root, self.path[: len(self.server.root)]
        if not secrets.compare_digest(begin.encode(), root.encode()):
            self.close_connection = True
            raise Refused(403, "the secret part of this address is missing; open the address that the terminal shows")
        return self.path[len(root) - 1 :]

    @property
    def _chunked(self) -> bool:
        return "Transfer-Encoding" in self.headers

    def body(self, largest: int) -> bytes:
        """What was sent, JSON by its own word; Refused where its length [bytes] is not given, too large or not kept."""
        return b"".join(self.pieces(largest, "application/json"))

    def pieces(self, largest: int, kind: str) -> Iterator[bytes]:
        """`body`, of a kind, as it comes."""
        said = self.headers.get_all("Content-Length", [])
        self.close_connection = True  # what is not read is not the next request
        if self._chunked or len(said) != 1 or not re.fullmatch("[0-9]{1,12}", said[0]) or int(said[0]) > largest:
            raise Refused(413, f"Content-Length: must be given once and at most {largest} bytes")
        if self.headers.get_content_type() != kind:
            raise Refused(415, f"Content-Type: must be {kind}")
        left = int(said[0])
        while left:
            piece = self.rfile.read(min(left, PIECE))
            if not piece:
                raise Refused(400, f"Content-Length: {said[0]} bytes, but {int(said[0]) - left} came")
            left -= len(piece)
            yield piece
        self.close_connection = self.headers.get("Connection", "").lower() == "close"

    def send(self, status: int, kind: str, body: bytes, policy: str = POLICY) -> None:
        self.send_response(status)
        for name, value in {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
            "Content-Security-Policy": policy,
            "X-Content-Type-Options": "nosniff",
        }.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: object) -> None:
        """No line for every request."""
