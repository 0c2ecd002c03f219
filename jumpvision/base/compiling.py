"""What numba has not compiled on this machine before takes it half a minute: whoever waits is told, once a run.

Why kernels that call each other have no `fastmath`: numba links the code of a function into each that calls it and
optimises the copy once more. All copies have one name, and the first that is loaded serves: where the inner function
is compiled in this process it is its own, where the outer one comes from the cache it is the outer one's. IEEE
arithmetic gives the same bits in both; sums that may be reordered ("reassoc"), or products that may be fused with a sum
("contract"), do not: the tracker's sigma and a sweep on hard ground had other last bits in the first run than after it.
"""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

GARBAGE_EVERY = 20_000  # new objects between two runs of the garbage collector; 100,000 gain no more time


def compiled_code_goes(package: Path, version: str) -> None:
    """Compiled functions are kept beside the package, or else under the home folder; where neither can be written (a
    package for all users, a container without a home) in a folder of the user's own among the temporary files.

    Nowhere does an installation meet what another one compiled: numba knows a function by the text of its own file, and
    what it imports, a record with other fields or another number, may have changed.
    """
    if "NUMBA_CACHE_DIR" in os.environ:
        return
    one = package / "__init__.py"
    mark = f"{version}-{one.stat().st_mtime_ns:x}" if one.exists() else version  # of one version there may be many
    if _writable(package):
        _clear_of_others(package, mark)
        return
    home = Path(os.environ.get("XDG_CACHE_HOME") or Path(os.path.expanduser("~")) / ".cache")
    there = next((p for p in (home, *home.parents) if p.is_dir()), home)
    own = home / "jumpvision" if _writable(there) else _among_the_temporary()
    os.environ["NUMBA_CACHE_DIR"] = str(own / f"compiled-{mark}")


def _clear_of_others(package: Path, mark: str) -> None:
    """Removes what another installation has compiled beside the package."""
    note = package / "__pycache__" / "compiled-for"
    try:
        before = note.read_text() if note.exists() else ""
        if before == mark:
            return
        for old in package.rglob("__pycache__/*.nb[ic]") if before else ():
            old.unlink(missing_ok=True)
        note.parent.mkdir(exist_ok=True)
        note.write_text(mark)
    except OSError:  # another process is at it, or a disk is full
        return


def _among_the_temporary() -> Path:
    """A folder of the user's own; a fresh one where somebody else's lies there: code that is loaded would be theirs."""
    user = os.getuid() if hasattr(os, "getuid") else 0
    own = Path(tempfile.gettempdir()) / f"jumpvision-{user}"
    try:
        own.mkdir(mode=0o700, exist_ok=True)
        if hasattr(os, "getuid") and (own.is_symlink() or own.stat().st_uid != user or own.stat().st_mode & 0o022):
            raise PermissionError
    except OSError:
        return Path(tempfile.mkdtemp(prefix="jumpvision-"))
    return own


def _writable(folder: Path) -> bool:
    try:
        with tempfile.TemporaryFile(dir=folder):
            return True
    except OSError:
        return False


class Notice(NamedTuple):
    """To be given by one process of a run: by the one that removes the file `unsaid`. Picklable where `give` is."""

    unsaid: Path
    give: Callable[[], None]


_notice: Notice | None = None  # of the run that this process belongs to


@contextlib.contextmanager
def noticed(give: Callable[[], None]) -> Iterator[None]:
    """Within, the first of this process and its workers that has to compile calls `give`, as it begins."""
    file, name = tempfile.mkstemp(prefix="jumpvision-")
    os.close(file)
    unsaid = Path(name)
    before = notice()
    pass_on(Notice(unsaid, give))
    try:
        yield
    finally:
        pass_on(before)
        unsaid.unlink(missing_ok=True)


def notice() -> Notice | None:
    """That of this process, for its workers."""
    return _notice


def pass_on(notice: Notice | None) -> None:
    """In a worker as it begins: the notice of the process that started it."""
    global _notice
    _notice = notice


def begins() -> None:
    """Numba begins to compile in this process."""
    if _notice is None:
        return
    try:
        _notice.unsaid.unlink()
    except OSError:  # another process, or this one, was first
        return
    _notice.give()
