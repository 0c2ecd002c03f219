"""Files that are dropped on the page, written piece by piece into a new folder: nothing that exists is touched."""

from __future__ import annotations

import contextlib
import errno
import re
import shutil
import threading
from collections.abc import Iterable, Mapping
from pathlib import Path

from jumpvision.base.schema import InputError
from jumpvision.experiment.init.recognise import KNOWN
from jumpvision.experiment.init.text import RESULTS

PART = ".part"  # of a file that is not whole yet
PLAIN = re.compile(r"[^\x00-\x1f/\\:*?\"<>|]{1,120}")  # a name on every system
MOST = 100_000  # files


class Adding:
    """A new folder that is being filled. files: name -> bytes. `stop` takes away what was written."""

    def __init__(self, beside: Path, name: str, files: Mapping[str, int]):
        self.folder, self._left = beside / name, dict(files)
        self.problem, self.writing, self._stopped, self._lock = "", False, False, threading.Lock()
        if problems := [*_name(self.folder, name), *_kinds(files)]:
            raise InputError(problems)
        free, needed = shutil.disk_usage(beside).free, sum(files.values())
        if needed > free:
            raise InputError([f"{beside}: no space: {_size(needed)} to copy, {_size(free)} free on this disk"])
        try:
            self.folder.mkdir()
        except FileExistsError:
            raise InputError([f"{self.folder}: exists already; give another name"]) from None
        except OSError as e:
            raise InputError([f"{self.folder}: cannot be made: {e.strerror}"]) from None
        self._written: list[Path] = []

    def write(self, name: str, pieces: Iterable[bytes]) -> None:
        """One of the files; it has its name when it is whole. What fails is taken away, and raised."""
        if name not in self._left or self.writing:
            raise InputError([f"{name}: is not awaited in {self.folder}"])
        target, size, self.writing = self.folder / name, 0, True
        part = target.with_name(name + PART)
        try:
            with part.open("xb") as f:
                for piece in pieces:
                    if self._stopped:
                        raise InputError(["stopped"])
                    size += f.write(piece)
            if size != self._left[name]:
                raise InputError([f"{target}: {size} bytes came of {self._left[name]}; it changed, add it again"])
            with self._lock:
                if self._stopped or target.exists():
                    raise InputError(["stopped" if self._stopped else f"{target}: exists already"])
                part.rename(target)
                self._written.append(target)
                del self._left[name]
        except BaseException as e:
            part.unlink(missing_ok=True)
            if self._stopped:
                self.stop()  # the folder can go now
            full = isinstance(e, OSError) and e.errno in (errno.ENOSPC, errno.EDQUOT)
            self.problem = f"{target}: no space left on this disk" if full else str(e)
            if full:
                raise InputError([self.problem]) from None
            raise
        finally:
            self.writing = False

    def done(self) -> Path:
        """The folder, once all is there."""
        if self._left:
            raise InputError([f"{self.folder}: {next(iter(self._left))} is missing"])
        return self.folder

    def stop(self) -> None:
        """Take away the files written here, and the folder where nothing else is in it."""
        with self._lock:
            self._stopped = True
            for f in self._written:
                f.unlink(missing_ok=True)
            with contextlib.suppress(OSError):  # not empty: of others, or a piece is just being written
                self.folder.rmdir()


def _name(folder: Path, name: str) -> list[str]:
    if not PLAIN.fullmatch(name) or name.startswith(".") or name != name.strip(" .") or name == RESULTS:
        return [f"folder = '{name}': must be a plain name, without / \\ : * ? \" < > | and not '{RESULTS}'"]
    return [f"{folder}: exists already; give another name"] if folder.exists() else []


def _kinds(files: Mapping[str, int]) -> list[str]:
    if not 0 < len(files) <= MOST:
        return [f"files: {len(files)}: must be 1 to {MOST}"]
    if len({f.lower() for f in files}) < len(files):
        return ["files: two have the same name; rename one"]
    bad = [f for f in files if not PLAIN.fullmatch(f) or f.startswith(".") or f != f.strip(" .")]
    if bad:
        return [f"'{bad[0]}': must be a plain name of a file"]
    unknown = [f for f in files if Path(f).suffix.lower() not in KNOWN]
    return [f"{f}: '{Path(f).suffix}' is no known recording; known: {' '.join(KNOWN)}" for f in unknown[:3]]


def _size(n: float) -> str:
    return f"{n / 1e9:.2f} GB" if n >= 1e8 else f"{n / 1e6:.2f} MB"
