"""The recipe "Add a film format" of CONTRIBUTING.md in a copy of the package: two files, and all else follows."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from recipe import package_with
from test_ball import BACK, CONTRAST, ball_image

import jumpvision

PACKAGE = Path(jumpvision.__file__).parent
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
LINE = '    ".recipe": ("recipe", "RecipeFilm"),\n'
RATE, SCALE, SHAPE, N = 200.0, 2e-4, (160, 90), 40  # 1/s, m/px
SCRIPT = """
import json, sys
from pathlib import Path
sys.path.append(sys.argv[1])
from jumpvision.cli import main
from jumpvision.films.frames import FrameError, open_frames
from jumpvision.experiment.init.recognise import recordings
import jumpvision.films.frames as frames

assert frames.__file__.startswith(sys.argv[2]), frames.__file__
with open_frames("experiment/rod.recipe") as film:
    out = {"n": len(film), "time": list(film.time), "source": film.time_source, "pixel": int(film[3][2, 1])}
with open_frames("torn.recipe") as film:
    out["torn"] = [len(film), film.truncated]
for name in ("wrong.recipe", "film.unknown"):
    try:
        open_frames(name)
    except FrameError as e:
        out[name] = str(e)
assert main(["track", "experiment", "--results", "results", "--no-pictures"]) == 0
out["recognised"] = [[r.section, r.file] for r in recordings(Path("experiment"), {})[0]]
import tables
out["docs"] = tables.text()
print(json.dumps(out))
"""


def rows_of_ball() -> np.ndarray:
    """Row of the ball's centre in each frame [px]: a fall."""
    return 30.0 + 0.5 * 9.81 / SCALE * (np.arange(N) / RATE) ** 2 / 12.0


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """A folder with the package (its other rooms linked, so that their compiled code is known) and films."""
    place = tmp_path_factory.mktemp("recipe")
    before = '    ".seq": ('
    opening = {"films/frames/opening.py": {before: LINE + before}}
    package_with(place, {"films/frames/recipe.py": READER}, edited=opening)
    rng = np.random.default_rng(5)
    pixels = [
        (BACK + CONTRAST * ball_image(SHAPE, 45.3, row, 40.0)[0] + rng.normal(0.0, 1.0, SHAPE)).round().astype(np.uint8)
        for row in rows_of_ball()
    ]
    film = f"RECIPE {SHAPE[0]} {SHAPE[1]} {N} {RATE}\n".encode() + b"".join(p.tobytes() for p in pixels)
    folder = place / "experiment"
    folder.mkdir()
    (folder / "rod.recipe").write_bytes(film)
    (folder / "experiment.toml").write_text(
        f'ground = "hard"\n[rod_video]\nfile = "rod.recipe"\nscale = {SCALE}\nball_diameter = {40 * SCALE}\n'
    )
    (place / "torn.recipe").write_bytes(film[: -SHAPE[0] * SHAPE[1] // 2])
    (place / "wrong.recipe").write_bytes(b"something else")
    (place / "film.unknown").write_bytes(b"something else")
    environment = os.environ | {"PYTHONPATH": str(place)}
    command = [sys.executable, "-c", SCRIPT, str(PACKAGE.parent / "docs"), str(place)]
    done = subprocess.run(command, cwd=place, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return place, json.loads(done.stdout.splitlines()[-1]), pixels


def test_the_film_opens_with_its_frames_and_times(place):
    _, out, pixels = place
    assert (out["n"], out["source"], out["pixel"]) == (N, "file", pixels[3][2, 1])
    np.testing.assert_allclose(out["time"], np.arange(N) / RATE)
    assert out["torn"] == [N - 1, True]


def test_errors_and_pages_know_the_format(place):
    _, out, _ = place
    assert "not a film of the recipe" in out["wrong.recipe"]
    assert " .recipe " in out["film.unknown"]  # among those that are allowed
    assert "| .recipe | A film of the recipe. |" in out["docs"]
    assert out["recognised"] == [["rod_video", "rod.recipe"]]


def test_a_ball_is_tracked_in_it(place):
    folder, _, _ = place
    track = pd.read_csv(folder / "results" / "track.csv")
    assert track.flag.isna().all()
    miss = track.y_px - rows_of_ball()
    assert np.sqrt(np.mean(miss**2)) < 0.05  # px; the stated sigma is about 0.01
