"""The command doctor: what of an installation and its computer a report of a problem has to say."""

from __future__ import annotations

import os
import platform
import re
import shutil
import tempfile
from importlib.metadata import PackageNotFoundError, requires, version
from pathlib import Path

from jumpvision import __version__

from .app import DONE, app, cores


@app.command
def doctor(path: Path = Path("."), /, *, json: bool = False) -> int:
    """Versions, codecs, cores and free disk, and what to do where one is missing; for a report of a problem.

    Example: jumpvision doctor

    Parameters
    ----------
    path
        Folder for results.
    json
        Machine-readable result on stdout.
    """
    from . import terminal as show

    found = findings(path)
    data = {**{what: text for what, text, _ in found}, "remedies": {w: remedy for w, _, remedy in found if remedy}}
    show.result(data, [{"what": w, "found": text, "remedy": remedy} for w, text, remedy in found], as_json=json)
    return DONE


DEVELOPERS = ("test", "docs", "dev", "bench")  # extras of nobody who only measures
CODECS = ("ffv1", "h264", "hevc", "mjpeg", "png", "rawvideo", "vp8", "vp9")
FILMS = "libvpx"  # writes track.webm and piv.webm
Finding = tuple[str, str, str]  # what, found, remedy ("" where nothing lacks)


def findings(folder: Path) -> list[Finding]:
    """All of it; folder: where results would be written."""
    system = [
        ("jumpvision", __version__, ""),
        ("python", platform.python_version(), ""),
        ("system", platform.platform(), ""),
    ]
    return [*system, *packages(), *codecs(), *processors(), browser(), *disk(folder)]


def packages() -> list[Finding]:
    """List the versions of all packages in jumpvision's metadata, extras too, and the command for a missing one."""
    listed: dict[str, str] = {}  # package: its extra, "" where it is needed
    for text in requires(__package__.partition(".")[0]) or []:
        name, _, condition = text.partition(";")
        extra = re.search(r"extra *== *['\"]([\w-]+)['\"]", condition)
        if extra is None or extra[1] not in DEVELOPERS:
            listed.setdefault(re.split(r"[\s<>=!~(\[;]", name.strip())[0], extra[1] if extra else "")
    out = []
    for name, extra_name in listed.items():
        try:
            out.append((name, version(name), ""))
        except PackageNotFoundError:
            use = f"for the extra {extra_name}" if extra_name else "needed"
            how = f'"jumpvision[{extra_name}]"' if extra_name else "--force-reinstall jumpvision"
            out.append((name, f"not installed ({use})", f"pip install {how}"))
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
        raise InputError([f"doctor {folder}: no such folder; name the folder for results"])
    out = []
    temporary = Path(tempfile.gettempdir())
    places = (("results and cache", folder, "--results, --cache"), ("temporary files", temporary, "TMPDIR"))
    for what, place, option in places:
        free = shutil.disk_usage(place).free / 1e9
        writable = os.access(place, os.W_OK)
        # below 2 GB of free disk a campaign's cache may not fit
        lacks = "not writable" if not writable else "little left" if free < 2.0 else ""
        found = f"{place.absolute()}: {free:.1f} GB free" + (f", {lacks}" if lacks else "")
        prune = "; jumpvision cache RESULTS --older-than 30d makes room" if writable else ""
        out.append((what, found, f"name another folder with {option}{prune}" if lacks else ""))
    return out
