"""The recipes of CONTRIBUTING.md ("Add a stage", "a film format") carried out in a copy of
the package: the files that they name, and all else follows."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import jumpvision

PACKAGE = Path(jumpvision.__file__).parent


def package_with(
    place: Path,
    new: dict[str, str],
    added: dict[str, str],
    edited: dict[str, dict[str, str]],
) -> None:
    """`place`/jumpvision with files of this text (new), with this at their end (added), with lines replaced (edited).

    Only rooms that change are copied; the others are links, so that their compiled code is known.
    """
    changed = {Path(*Path(name).parts[:-1][:2]) for name in (*new, *added, *edited)}
    copy = place / "jumpvision"
    for folder in {Path(), *(p for room in changed for p in room.parents)}:  # the wings of the rooms that change
        (copy / folder).mkdir(parents=True, exist_ok=True)
    for folder in [p.relative_to(copy) for p in (copy, *copy.iterdir())]:
        for part in (PACKAGE / folder).iterdir():
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


STAGE = '''"""Slip: how long the robot does not touch the ground (a stage of the recipe)."""

from jumpvision.experiment.inputs.logs import read_log
from jumpvision.experiment.inputs.parameters import SlipParams
from jumpvision.experiment.inputs.sections import ContactLog
from jumpvision.experiment.results.values import Slip
from jumpvision.experiment.workflow.stage import stage


@stage(
    version=1,
    any_of=("contact",),
)
def slip(contact: ContactLog, *, p: SlipParams) -> Slip:
    """Time in the air [s] from [contact_log].

    Every sample counts alike.
    """
    d = read_log(contact.path, "time_s", "contact", at_least=2)
    step = (d.time_s.iloc[-1] - d.time_s.iloc[0]) / (len(d) - 1)
    return Slip({"air_s": p.share * float(step * (d.contact == 0).sum())})
'''
RECORD = '''

class Slip(Values):
    """Time in the air [s]."""

    file = "slip.json"
'''
PARAMS = '''

@dataclass(frozen=True)
class SlipParams(Params):
    """How time in the air is counted."""

    stage: ClassVar[str] = "slip"

    share: float = param(1.0, "", "share of the time that counts", lo=0, hi=1)

'''
READER = '''"""Films of the recipe: a line "RECIPE height width rate", then bytes."""

from pathlib import Path

import numpy as np

from .base import Film, FrameError, Image, check_image, clock, lost


class RecipeFilm(Film):
    """A film of the recipe."""

    def __init__(self, path: Path, *, frame_rate: float | None, start: float) -> None:
        head, _, data = path.read_bytes().partition(b"\\n")
        try:
            magic, height, width, promised, rate = head.split()
            shape, n = (int(height), int(width)), int(promised)
        except ValueError:
            raise FrameError(f"{path}: not a film of the recipe; export it again") from None
        check_image(path, *shape)
        whole = min(n, len(data) // (shape[0] * shape[1]))
        self._frames = np.frombuffer(data, np.uint8, whole * shape[0] * shape[1]).reshape(whole, *shape)
        super().__init__(
            path,
            shape=shape,
            dtype=np.dtype(np.uint8),
            clock=clock(path, whole, start=start, frame_rate=frame_rate, stamps=np.arange(whole) / float(rate)),
            warnings=lost(path, whole, n),
            meta={"format": "recipe", "bit_depth": 8},
        )

    def _read(self, i: int) -> Image:
        return self._frames[i].copy()

    def close(self) -> None:
        del self._frames
'''
SCRIPT = """
import contextlib, inspect, io, json, sys, warnings
from pathlib import Path
sys.path.append(sys.argv[1])
import jumpvision as jv
from jumpvision.cli import main
import jumpvision.films.frames as frames
from jumpvision.experiment.init.recognise import recordings

assert frames.__file__.startswith(sys.argv[2]), frames.__file__
warnings.simplefilter("ignore")

def said(*words, code=0):
    with contextlib.redirect_stdout(io.StringIO()) as out, contextlib.redirect_stderr(io.StringIO()) as err:
        assert main(list(words)) == code, err.getvalue()
    return out.getvalue() + err.getvalue()

out = {"help": " ".join(said("--help").replace("│", " ").split())}
said("slip", "experiment", "--no-pictures")
out["file"] = json.loads(Path("results/experiment/slip.json").read_text())
out["notebook"] = jv.slip(jv.open("experiment", set=["slip.share=0.5"]), results="half").values
out["doc"] = inspect.getdoc(jv.slip)
Path("air.toml").write_text('stages = ["slip"]\\n[params.slip]\\nshare = 0.25\\n')
said("run", "experiment", "--pipeline", "air.toml", "--results", "quarter", "--no-report")
out["pipeline"] = json.loads(Path("quarter/slip.json").read_text())
out["refused"] = said("run", "experiment", "--set", "slip.share=2", code=2)
with frames.open_frames("film/rod.recipe") as film:
    out["film"] = [len(film), film.time_source, film[3].tolist(), list(film.time)]
with frames.open_frames("torn.recipe") as film:
    out["torn"] = [len(film), film.truncated]
for name in ("wrong.recipe", "film.unknown"):
    try:
        frames.open_frames(name)
    except frames.FrameError as e:
        out[name] = str(e)
out["recognised"] = [[r.section, r.file] for r in recordings(Path("film"), {})[0]]
import tables, reference
out["keys"], out["stub"] = tables.text(), reference.stub()
print(json.dumps(out))
"""


def test_a_stage_and_a_format_are_their_own_files(tmp_path):
    """Command line, notebook, pipeline, help, pages and errors know them."""
    before = '    ".seq": ('
    package_with(
        tmp_path,
        {"experiment/stages/slip.py": STAGE, "films/frames/recipe.py": READER},
        {"experiment/results/values.py": RECORD, "experiment/inputs/parameters.py": PARAMS},
        {"films/frames/opening.py": {before: '    ".recipe": ("recipe", "RecipeFilm"),\n' + before}},
    )
    for folder in ("experiment", "film"):
        (tmp_path / folder).mkdir()
    rows = [f"{0.01 * i:.2f},{int(not 20 <= i < 50)}" for i in range(101)]  # 0.3 s in the air
    (tmp_path / "experiment" / "contact.csv").write_text("time_s,contact\n" + "\n".join(rows) + "\n")
    (tmp_path / "experiment" / "experiment.toml").write_text('ground = "hard"\n[contact_log]\nfile = "contact.csv"\n')
    frames = np.random.default_rng(5).integers(0, 255, (6, 16, 9), np.uint8)
    film = b"RECIPE 16 9 6 200.0\n" + frames.tobytes()
    (tmp_path / "film" / "rod.recipe").write_bytes(film)
    (tmp_path / "torn.recipe").write_bytes(film[:-70])
    for name in ("wrong.recipe", "film.unknown"):
        (tmp_path / name).write_bytes(b"something else")
    out = run_there(tmp_path, SCRIPT, str(PACKAGE.parent / "docs"), str(tmp_path))
    assert [out[k]["air_s"] for k in ("file", "notebook", "pipeline")] == pytest.approx([0.3, 0.15, 0.075])
    assert "Time in the air [s] from [contact_log]" in out["help"]
    assert "(slip.json)" in out["doc"] and "share = 1.0: share of the time" in out["doc"]
    assert "### [params.slip]" in out["keys"] and "def slip(" in out["stub"] and "share" in out["refused"]
    assert out["film"] == [6, "file", frames[3].tolist(), pytest.approx(np.arange(6) / 200.0)]
    assert out["torn"] == [5, True] and "not a film of the recipe" in out["wrong.recipe"]
    assert " .recipe " in out["film.unknown"] and "| .recipe | A film of the recipe. |" in out["keys"]
    assert out["recognised"] == [["rod_video", "rod.recipe"]]
