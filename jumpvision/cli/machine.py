"""Commands about jumpvision and its machine: demo, params, cache, doctor, completion."""

from __future__ import annotations

import os
import platform
import shutil
import subprocess
import tempfile
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Literal

from jumpvision import __version__

from .app import DONE, app, cores


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
    with page.Server(port) as server:
        show.served(server, browser=browser)
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
    from . import terminal as show

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


NEEDED = (
    *("numpy", "scipy", "pandas", "xarray", "netCDF4", "numba"),
    *("opencv-python-headless", "scikit-image", "av", "tifffile", "matplotlib"),
)
EXTRAS = {  # package: what it is for, the extra that installs it
    "h5py": ("reads .h5 films and MATLAB fields", "hdf5"),
    "casadi": ("jumpvision plan", "plan"),
    "snakemake": ("run --profile", "workflow"),
}
CODECS = ("ffv1", "h264", "hevc", "mjpeg", "png", "rawvideo", "vp8", "vp9")
FILMS = "libvpx"  # writes track.webm and piv.webm
LITTLE = 2.0  # GB of free disk, below which a campaign's cache may not fit
Finding = tuple[str, str, str]  # what, found, remedy ("" where nothing lacks)


def findings(folder: Path) -> list[Finding]:
    """All of it; folder: where results would be written."""
    system = [
        ("jumpvision", __version__, ""),
        ("python", platform.python_version(), ""),
        ("system", platform.platform(), ""),
    ]
    return [*system, *packages(), *codecs(), *processors(), gpu(), browser(), *disk(folder)]


def packages() -> list[Finding]:
    """Versions; an optional package that is missing names its extra."""
    out = []
    for name in (*NEEDED, *EXTRAS):
        try:
            out.append((name, version(name), ""))
        except PackageNotFoundError:
            use, extra = EXTRAS.get(name, ("needed", ""))
            how = f'pip install "jumpvision[{extra}]"' if extra else "pip install --force-reinstall jumpvision"
            out.append((name, f"not installed ({use})", how))
    return out


def codecs() -> list[Finding]:
    """Films that can be read, and whether films can be written."""
    remedy = "pip install --force-reinstall --only-binary :all: av"
    try:
        import av
    except ImportError as e:
        return [("video codecs", f"PyAV cannot be loaded: {e}", remedy)]
    there = [c for c in CODECS if c in av.codecs_available]
    writes = FILMS in av.codecs_available
    return [
        ("video codecs", ", ".join(there), remedy if len(there) < len(CODECS) else ""),
        ("films for reports", FILMS if writes else f"{FILMS} is missing", "" if writes else remedy),
    ]


def processors() -> list[Finding]:
    """Cores that may be used, and memory."""
    out = [("cores", f"{cores()} of {os.cpu_count()} may be used", "")]
    if hasattr(os, "sysconf") and "SC_PHYS_PAGES" in os.sysconf_names:
        size = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE") / 1e9
        out.append(("memory", f"{size:.1f} GB", ""))
    return out


def gpu() -> Finding:
    """NVIDIA GPUs; nothing here needs one."""
    asked = "nvidia-smi", "--query-gpu=name,memory.total", "--format=csv,noheader"
    if shutil.which(asked[0]) is None:
        return "GPU", "none found (none is needed)", ""
    try:
        said = subprocess.run(asked, capture_output=True, text=True, timeout=10)
    except (OSError, subprocess.TimeoutExpired) as e:
        return "GPU", f"nvidia-smi does not answer: {e}", ""
    names = "; ".join(said.stdout.split("\n")).strip("; ") if said.returncode == 0 else ""
    return "GPU", f"{names} (not used)" if names else "none found (none is needed)", ""


def browser() -> Finding:
    """The browser that demo and open would open."""
    import webbrowser

    try:
        return "browser", getattr(webbrowser.get(), "name", None) or "the system's own", ""
    except webbrowser.Error:
        return "browser", "none found", "demo and open print an address: open it in any browser of this machine"


def disk(folder: Path) -> list[Finding]:
    """Where results, the cache and long fields are written, and what is free there."""
    from jumpvision.base.schema import InputError

    if not folder.is_dir():
        raise InputError([f"doctor {folder}: no such folder; name the one that results are to lie in"])
    out = []
    temporary = Path(tempfile.gettempdir())
    places = (("results and cache", folder, "--results, --cache"), ("temporary files", temporary, "TMPDIR"))
    for what, place, option in places:
        free = shutil.disk_usage(place).free / 1e9
        writable = os.access(place, os.W_OK)
        lacks = "not writable" if not writable else "little left" if free < LITTLE else ""
        found = f"{place.absolute()}: {free:.1f} GB free" + (f", {lacks}" if lacks else "")
        prune = "; jumpvision cache RESULTS --older-than 30d makes room" if writable else ""
        out.append((what, found, f"name another folder with {option}{prune}" if lacks else ""))
    return out
