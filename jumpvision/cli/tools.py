"""Commands about jumpvision itself: demo, params, cache, completion."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from .app import DONE, app


@app.command
def demo(*, port: int = 8765, browser: bool = True, export: Path | None = None) -> int:
    """The interactive jumper: a page in the browser, which computes itself; Ctrl-C stops the server.

    Example: jumpvision demo --port 8765

    Parameters
    ----------
    port
        Of http://127.0.0.1; 0 takes a free one.
    browser
        Open the page in the browser.
    export
        Write the page into this new folder instead: open its index.html, or put it on any web space.
    """
    from jumpvision.browser.demo import server as page

    from . import terminal as show

    if export is not None:
        page.export(export)
        print(export / "index.html")
        return DONE
    show.served(page.Server(port), browser=browser)
    return DONE


@app.command
def params(stage: str | None = None, *, json: bool = False) -> int:
    """Tables of all parameters: default, unit, allowed values and meaning.

    Example: jumpvision params piv
    """
    from jumpvision.base.schema import InputError, closest, table_of
    from jumpvision.experiment.inputs.parameters import PARAMS

    from . import terminal as show

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
    from jumpvision.experiment.workflow import cache as store

    from . import terminal as show

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

    from jumpvision.base.schema import InputError

    from . import application
    from . import terminal as show

    every = application()
    try:
        if not install:
            print(every.generate_completion(shell=shell))
            return DONE
        written = every.install_completion(shell=shell)
    except ShellDetectionError:
        raise InputError(["completion: the shell is not known; name it: bash, zsh, fish or powershell"]) from None
    show.line(f"written: {written}; open a new terminal to use it")
    return DONE
