"""A copy of the package in which a recipe of CONTRIBUTING.md is carried out."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import jumpvision

ROOT = Path(jumpvision.__file__).parent
DOCS = ROOT.parent / "docs"


def package_with(
    place: Path,
    new: dict[str, str],
    added: dict[str, str] | None = None,
    edited: dict[str, dict[str, str]] | None = None,
    copied: tuple[str, ...] = (),
) -> None:
    """`place`/jumpvision with files of this text (new), with this at their end (added), with lines replaced (edited).

    Only rooms that change are copied, and those named (copied), which compile what changes into their own code; the
    others are links, so that their compiled code is known.
    """
    added, edited = added or {}, edited or {}
    changed = {Path(*Path(name).parts[:-1][:2]) for name in (*new, *added, *edited)} | {Path(name) for name in copied}
    copy = place / "jumpvision"
    for folder in {Path(), *(p for room in changed for p in room.parents)}:  # the wings of the rooms that change
        (copy / folder).mkdir(parents=True, exist_ok=True)
    for folder in [p.relative_to(copy) for p in (copy, *copy.iterdir())]:
        for part in (ROOT / folder).iterdir():
            here = folder / part.name
            if here in changed:
                shutil.copytree(part, copy / here, ignore=shutil.ignore_patterns("__pycache__"))
            elif not (copy / here).exists() and part.name != "__pycache__":
                (copy / here).symlink_to(part)
    for name, text in new.items():
        assert not (copy / name).exists()
        (copy / name).write_text(text, encoding="utf-8")
    for name, text in added.items():
        file = copy / name
        file.write_text(file.read_text(encoding="utf-8") + text, encoding="utf-8")
    for name, lines in edited.items():
        file = copy / name
        text = file.read_text(encoding="utf-8")
        for before, after in lines.items():
            assert text.count(before) == 1, before
            text = text.replace(before, after)
        file.write_text(text, encoding="utf-8")


def run_there(place: Path, script: str, *arguments: str) -> Any:
    """What the script prints as JSON in its last line; run in `place` with the package copied there."""
    call = [sys.executable, "-c", script, *arguments]
    environment = os.environ | {"PYTHONPATH": str(place)}
    done = subprocess.run(call, cwd=place, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout.splitlines()[-1])
