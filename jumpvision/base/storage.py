"""Files written so that they are whole, old or new, at any moment; hashes; what killed runs leave behind."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import socket
import uuid
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any


def aside_folder(cache: Path) -> Path:
    """A new folder to write a cache entry in before it is renamed; its name says which process owns it."""
    aside = cache / f"writing-{socket.gethostname()}-{os.getpid()}-{uuid.uuid4().hex[:8]}"
    aside.mkdir(parents=True)
    return aside


def companions(path: Path) -> list[Path]:
    """A recording and the header files that belong to it (Photron .cih, .cihx)."""
    beside = [
        path.with_suffix(s) for s in (".cih", ".cihx", ".mraw") if path.suffix.lower() in (".mraw", ".cih", ".cihx")
    ]
    return [path, *(f for f in beside if f != path and f.is_file())]


def sha256(path: Path) -> str:
    """SHA-256 of a file's content, in hex."""
    with path.open("rb") as f:
        return hashlib.file_digest(f, "sha256").hexdigest()


def sealed(content: Mapping[str, object]) -> str:
    """JSON text that carries its own checksum, for `unsealed`."""
    return json.dumps({**content, "seal": _seal(content)}, indent=1)


def unsealed(text: str) -> Any:
    """The JSON object of a sealed text; ValueError where a bit of it has changed."""
    content = json.loads(text)
    if not isinstance(content, dict) or content.pop("seal", None) != _seal(content):
        raise ValueError("its checksum is wrong")
    return content


def _seal(content: Mapping[str, object]) -> str:
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()[:16]


def write_aside(path: Path, text: str) -> None:
    """Write a text file in one step: it is whole, old or new, at any moment."""
    path.parent.mkdir(parents=True, exist_ok=True)
    aside = path.with_name(f".{path.name}-{os.getpid()}-{uuid.uuid4().hex[:8]}.tmp")
    try:
        aside.write_text(text, encoding="utf-8")
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)


def copy_aside(source: Path, target: Path) -> None:
    """Copy a file in one step."""
    aside = target.with_name(f".{target.name}-{os.getpid()}-{uuid.uuid4().hex[:8]}.tmp")
    try:
        shutil.copyfile(source, aside)
        os.replace(aside, target)
    finally:
        aside.unlink(missing_ok=True)


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
    """Remove what killed runs of this machine left behind: aside folders and files of processes that are gone."""
    for f in [*cache.glob(f"writing-{socket.gethostname()}-*"), *_tmp_files(results), *_tmp_files(cache / "hashes")]:
        pid = int(f.name.split("-")[-2])
        if not _alive(pid):
            shutil.rmtree(f, ignore_errors=True) if f.is_dir() else f.unlink(missing_ok=True)


def _tmp_files(folder: Path) -> Iterator[Path]:
    for pattern in (".*-*-*.tmp", "*/.*-*-*.tmp"):
        yield from (f for f in folder.glob(pattern) if f.name.split("-")[-2].isdigit())


def _alive(pid: int) -> bool:
    if os.name == "nt":  # no harmless signal there: such a file is removed by `jumpvision cache`
        return True
    try:
        os.kill(pid, 0)
    except ProcessLookupError:
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
