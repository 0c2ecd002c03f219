"""The workbench: films and logs looked at, clicked, tracked and set up in a browser."""

from __future__ import annotations

from pathlib import Path

from .app import DONE, app


@app.command(name="open")
def open_path(path: Path, /, *, port: int = 0, browser: bool = True) -> int:
    """The workbench: a page in the browser to look at films, set scale and marks, track, correct and run.

    Everything stays on this machine; files are written only when the page's button says so. Ctrl-C stops it.

    Example: jumpvision open my_jump

    Parameters
    ----------
    path
        A film, the folder of one experiment, or a folder of such folders.
    port
        Of http://127.0.0.1; default: a free one.
    browser
        Open the page in the browser.
    """
    from jumpvision.browser.workbench.server import Server

    from . import terminal as show

    with Server(path, port) as server:
        try:
            show.served(server, browser=browser)
        finally:
            server.close_benches()
    return DONE
