"""Files written so that they are whole, old or new, at any moment; hashes; what killed runs leave behind."""

from __future__ import annotations

import contextlib
import errno
import functools
import hashlib
import json
import os
import re
import shutil
import socket
import stat
import time
import uuid
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any


def aside_folder(cache: Path) -> Path:
    """A new folder to write a cache entry in before it is renamed; its name says who owns it."""
    aside = cache / f"writing-{_signed()}"
    aside.mkdir(parents=True)
    return aside


@functools.cache
def _owner() -> str:
    """This machine and its numbering of processes: two containers share a disk, perhaps a name, never both of these."""
    names = [socket.gethostname()]
    for file in ("/proc/sys/kernel/random/boot_id", "/proc/self/ns/pid"):
        with contextlib.suppress(OSError):
            names.append(os.readlink(file) if "/ns/" in file else Path(file).read_text().strip())
    return hashlib.sha256("\n".join(names).encode()).hexdigest()[:12]


def _signed() -> str:
    """HOST-OWNER-PID-RANDOM: the host for people, the rest for `sweep_leftovers`."""
    host = re.sub(r"[^A-Za-z0-9.]", "_", socket.gethostname())[:40]
    return f"{host}-{_owner()}-{os.getpid()}-{uuid.uuid4().hex[:8]}"


SIGNED = r"[A-Za-z0-9._]*-(?P<owner>[0-9a-f]{12})-(?P<pid>\d+)-[0-9a-f]{8}"
ASIDE_FOLDER, ASIDE_FILE = re.compile(rf"writing-{SIGNED}"), re.compile(rf"\..*-{SIGNED}\.tmp")
ABANDONED = 24 * 3600.0  # s without a change, after which what another machine was writing is given up


def _aside_file(target: Path) -> Path:
    """Where a file is written before it takes its place; a long name is cut, as names have an end."""
    return target.with_name(f".{target.name[:60]}-{_signed()}.tmp")


def irregular(path: Path) -> str:
    """Why something that is there cannot be read as a file or folder: a pipe or device never ends; "" where it can."""
    kind = path.stat().st_mode
    if stat.S_ISREG(kind) or stat.S_ISDIR(kind):
        return ""
    what = "a pipe" if stat.S_ISFIFO(kind) else "a socket" if stat.S_ISSOCK(kind) else "a device"
    return f"is {what}; only files are read: copy what comes from it into one"


def companions(path: Path) -> list[Path]:
    """A recording and the header files that belong to it (Photron .cih, .cihx)."""
    beside = [
        path.with_suffix(s) for s in (".cih", ".cihx", ".mraw") if path.suffix.lower() in (".mraw", ".cih", ".cihx")
    ]
    return [path, *(f for f in beside if f != path and f.is_file())]


def recording_names(path: Path) -> tuple[Path, list[str]]:
    """The files of a recording, itself with its headers, all of a folder, or all that a pattern fits: where they lie,
    and their names in order. There may be 100,000."""
    if path.is_dir():
        with os.scandir(path) as there:
            return path, sorted(f.name for f in there if f.is_file())
    return path.parent, sorted(f.name for f in (companions(path) if path.is_file() else path.parent.glob(path.name)))


def sha256(path: Path) -> str:
    """SHA-256 of a file's content, in hex."""
    with path.open("rb") as f:
        return hashlib.file_digest(f, "sha256").hexdigest()


Stamp = tuple[int, ...]


def stamp(path: Path | str) -> Stamp:
    """What changes with a file's content: size, dates and number.

    The time of the last change of any kind (on Windows: of creation) tells also an edit that keeps size and date, or a
    clock set back.
    """
    s = os.stat(path)
    return s.st_size, s.st_mtime_ns, s.st_ctime_ns, s.st_ino


FRESH = 2.0  # s; disks and network drives date changes no finer: a file just changed may change again unseen


def settled(at: Sequence[int], when: float) -> bool:
    """Whether a change after `when` [s since 1970] of a file that then had this stamp would have given it another."""
    changed = at[1] if os.name == "nt" else at[2]
    return when - changed / 1e9 > FRESH


def sealed(content: Mapping[str, object]) -> str:
    """JSON text behind its own checksum, for `unsealed`."""
    text = json.dumps(content)
    return f'["{_seal(text)}",\n{text}]\n'


def unsealed(text: str) -> Any:
    """The JSON object of a sealed text; ValueError where a bit of it has changed."""
    head, _, rest = text.partition("\n")
    if head != f'["{_seal(rest[:-2])}",':
        raise ValueError("its checksum is wrong")
    return json.loads(rest[:-2])


def _seal(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


class ChangedFile(OSError):
    """A file is not what it was said to be."""


@contextlib.contextmanager
def in_one_step(target: Path) -> Iterator[Path]:
    """Where to write a file, which then takes its place: it is whole, old or new, at any moment."""
    target.parent.mkdir(parents=True, exist_ok=True)
    aside = _aside_file(target)
    try:
        yield aside
        replace(aside, target)
    finally:
        aside.unlink(missing_ok=True)


def write_aside(path: Path, text: str | Iterable[str]) -> None:
    """Write a text file, whole or piece by piece, in one step. Lines end alike on all systems."""
    with in_one_step(path) as aside, aside.open("w", encoding="utf-8", newline="\n") as file:
        file.writelines([text] if isinstance(text, str) else text)


def write_bytes_aside(path: Path, content: bytes) -> None:
    """Likewise of a file that is no text."""
    with in_one_step(path) as aside:
        aside.write_bytes(content)


def copy_aside(source: Path, target: Path, digest: str) -> None:
    """Copy a file in one step. digest: the SHA-256 that the copy must have; ChangedFile otherwise."""
    with in_one_step(target) as aside:
        shutil.copyfile(source, aside)
        if sha256(aside) != digest:
            raise ChangedFile(errno.EIO, "changed while it was copied", str(source))


PATIENCE = (0.05, 0.1, 0.2, 0.4, 0.8)  # s; virus scanners and previews hold a file for a moment


def replace(source: Path, target: Path) -> None:
    """`os.replace`, though Windows refuses it while another program has the target open."""
    for pause in PATIENCE:
        try:
            os.replace(source, target)
            return
        except PermissionError:
            if os.name != "nt":
                raise
            time.sleep(pause)
    try:
        os.replace(source, target)
    except PermissionError:
        said = "open in another program (a table in Excel, a page in a browser?); close it there"
        raise PermissionError(errno.EACCES, said, str(target)) from None


def sync(folder: Path) -> None:
    """Make the entry's files durable before the rename that declares them whole."""
    for f in folder.iterdir():
        fd = os.open(f, os.O_RDWR)
        try:
            os.fsync(fd)
        finally:
            os.close(fd)


def remove_aside(folder: Path, cache: Path) -> None:
    """Remove a cache entry so that a run beside it sees it whole or not at all."""
    aside = aside_folder(cache)
    try:
        os.rename(folder, aside / "entry")
    except FileNotFoundError:  # somebody else was faster
        pass
    finally:
        shutil.rmtree(aside, ignore_errors=True)


def sweep_leftovers(results: Path, cache: Path) -> None:
    """Remove what killed runs left: asides of processes of this machine that are gone, and of others' long untouched.

    Names that `aside_folder` and `write_aside` do not give are left alone.
    """
    files = [f for p in (".*.tmp", "*/.*.tmp") for f in results.glob(p)]
    for pattern, found in ((ASIDE_FOLDER, cache.glob("writing-*")), (ASIDE_FILE, files)):
        for f in found:
            signed = pattern.fullmatch(f.name)
            if signed and not f.is_symlink() and not _alive(f, signed["owner"], int(signed["pid"])):
                shutil.rmtree(f, ignore_errors=True) if f.is_dir() else f.unlink(missing_ok=True)


def _alive(aside: Path, owner: str, pid: int) -> bool:
    """Whether somebody may still write there: on this machine the process is asked, of others the age tells."""
    if owner != _owner() or os.name == "nt":  # no harmless signal there
        try:
            changed = max(f.stat().st_mtime for f in (aside, *(aside.iterdir() if aside.is_dir() else ())))
        except OSError:  # it is under way: its owner lives
            return True
        return time.time() - changed < ABANDONED
    try:
        os.kill(pid, 0)
    except (ProcessLookupError, OverflowError):
        return False
    except OSError:
        return True
    return not _zombie(pid)


def _zombie(pid: int) -> bool:
    """Killed, but nobody has asked for its exit status yet (the first process of a container often never does)."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "ZX"
    except OSError:  # no /proc on this system, or gone by now
        return False
