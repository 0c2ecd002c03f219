"""Commands about jumpvision itself: demo, params, cache, doctor, completion."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from .app import DONE, app


@app.command
def demo(*, port: int = 8765, browser: bool = True) -> int:
    """The interactive jumper: a page in the browser, computed on this machine; Ctrl-C stops it.

    Example: jumpvision demo --port 8765

    Parameters
    ----------
    port
        Of http://127.0.0.1; 0 takes a free one.
    browser
        Open the page in the browser.
    """
    from .. import show
    from ..demo.jumper import warm_up
    from ..demo.server import Server

    with Server(port) as server:
        show.line("compiling the solvers (the first time up to a minute) ...")
        warm_up()
        print(server.address, flush=True)
        show.line("Ctrl-C stops the server")
        if browser:
            import webbrowser

            webbrowser.open(server.address)
        try:
            server.serve_forever()
        except KeyboardInterrupt:
            show.line("stopped")
    return DONE


@app.command
def params(stage: str | None = None, *, json: bool = False) -> int:
    """Tables of all parameters: default, unit, allowed values and meaning.

    Example: jumpvision params piv
    """
    from .. import show
    from ..params import PARAMS
    from ..schema import InputError, closest, table_of

    if stage is not None and stage not in PARAMS:
        raise InputError([f"params {stage}: unknown stage{closest(stage, PARAMS)}"])
    rows = [{"stage": s, **row} for s, cls in PARAMS.items() if stage in (None, s) for row in table_of(cls)]
    show.result(rows, rows, as_json=json)
    return DONE


@app.command
def cache(
    path: Path = Path("results"),
    /,
    *,
    older_than: str | None = None,
    keep: str | None = None,
    all: bool = False,
    json: bool = False,
) -> int:
    """Size of the cache by stage; with an option, make it smaller. Safe beside a running run.

    Example: jumpvision cache results/loose_sand --older-than 30d

    Parameters
    ----------
    path
        A results folder, a folder of them, or a cache folder.
    older_than
        Delete what was not used for so long, e.g. 12h, 30d.
    keep
        Delete the longest unused until so much is left, e.g. 500MB, 5GB.
    all
        Delete everything; a later run computes it again.
    json
        Machine-readable result on stdout.
    """
    from .. import cache as store
    from .. import show

    age = store.quantity(older_than, store.SECONDS, "--older-than") if older_than is not None else None
    size = store.quantity(keep, store.BYTES, "--keep") if keep is not None else None
    caches = store.caches_of(path)
    entries = [e for c in caches for e in store.entries_of(c)]
    out = entries if all else store.to_prune(entries, older_than=age, keep=size)
    store.prune(out)
    if all or age is not None or size is not None:
        for folder in caches:
            store.tidy(folder)
    rows = store.table(entries, out)
    data = {"caches": [str(c) for c in caches], "stages": rows, "freed_bytes": sum(e.nbytes for e in out)}
    show.result(data, rows, as_json=json)
    return DONE


@app.command
def doctor(path: Path = Path("."), /, *, json: bool = False) -> int:
    """Versions, codecs, cores, GPU and free disk, with what to do about what lacks; for a report of a problem.

    Example: jumpvision doctor

    Parameters
    ----------
    path
        Where results are to lie.
    json
        Machine-readable result on stdout.
    """
    from .. import show
    from ..doctor import findings

    found = findings(path)
    data = {**{what: text for what, text, _ in found}, "remedies": {w: remedy for w, _, remedy in found if remedy}}
    show.result(data, [{"what": w, "found": text, "remedy": remedy} for w, text, remedy in found], as_json=json)
    return DONE


@app.command
def completion(shell: Literal["bash", "zsh", "fish", "powershell"] | None = None, /, *, install: bool = False) -> int:
    """Completion of commands and options by the shell's TAB key: prints its script, or installs it.

    Example: jumpvision completion bash --install

    Parameters
    ----------
    shell
        Default: the shell that runs this.
    install
        Write the script where the shell looks for it, and load it when it starts.
    """
    from cyclopts.completion import ShellDetectionError

    from .. import show
    from ..schema import InputError

    try:
        if not install:
            print(app.generate_completion(shell=shell))
            return DONE
        written = app.install_completion(shell=shell)
    except ShellDetectionError:
        raise InputError(["completion: the shell is not known; name it: bash, zsh, fish or powershell"]) from None
    show.line(f"written: {written}; open a new terminal to use it")
    return DONE
