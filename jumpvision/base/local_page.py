"""A page served on this machine only, by the standard library: its files, its server, one connection of a browser."""

from __future__ import annotations

import sys
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from typing import Any

from .schema import InputError

HOST = "127.0.0.1"
TYPES = {".html": "text/html", ".css": "text/css", ".js": "text/javascript", ".svg": "image/svg+xml"}
POLICY = "default-src 'self'; style-src 'self' 'unsafe-inline'; img-src 'self' data:; frame-ancestors 'none'"


def static_files(package: str, index: str) -> dict[str, tuple[str, bytes]]:
    """Address -> type and content of a package's static/. Only these are served: no address is turned into a path."""
    out = {}
    for f in files(package).joinpath("static").iterdir():
        suffix = f.name[f.name.rfind(".") :]
        if suffix in TYPES:
            out[f"/{f.name}"] = (f"{TYPES[suffix]}; charset=utf-8", f.read_bytes())
    out["/"] = out[f"/{index}"]
    return out


class LocalServer(ThreadingHTTPServer):
    """Listens on 127.0.0.1; port 0 takes a free one (`address` tells which). command: named where it cannot."""

    daemon_threads = True

    def __init__(self, port: int, handler: type[BaseHTTPRequestHandler], command: str):
        try:
            super().__init__((HOST, port), handler)
        except (OSError, OverflowError) as e:
            raise InputError([f"{command} --port {port}: {e}; give another port, or 0 for a free one"]) from None

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A browser that leaves in the middle of an answer is no error."""
        if not isinstance(sys.exc_info()[1], ConnectionError):
            super().handle_error(request, client_address)

    @property
    def address(self) -> str:
        return f"http://{HOST}:{self.server_port}/"


class LocalHandler(BaseHTTPRequestHandler):
    """One connection of a browser."""

    protocol_version = "HTTP/1.1"
    disable_nagle_algorithm = True

    def asked_here(self) -> bool:
        """Whether the browser asked for this machine by name: another site's name may be pointed here."""
        return self.headers.get("Host", "").rpartition(":")[0] in (HOST, "localhost")

    def send(self, status: int, kind: str, body: bytes) -> None:
        self.send_response(status)
        for name, value in {
            "Content-Type": kind,
            "Content-Length": str(len(body)),
            "Cache-Control": "no-store",
            "Content-Security-Policy": POLICY,
            "X-Content-Type-Options": "nosniff",
        }.items():
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, *_: Any) -> None:
        """No line for every request."""
