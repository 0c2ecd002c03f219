"""A fresh environment, `pip install`, five lines: vectors of OpenPIV's own pair, a track, a diagnosis of two arrays."""

from __future__ import annotations

import os
import subprocess
import sys
import venv
from pathlib import Path

import numpy as np
import pytest
from shared import ROOT, SAMPLES

pytestmark = pytest.mark.long

PIV = """
import cv2, jumpvision as jv
a, b = (cv2.imread(f"{FOLDER}/exp1_001_{k}.bmp", cv2.IMREAD_GRAYSCALE) for k in "ab")
field = jv.piv(a, b)
print(float(field.v.median()), float((field.reason == 0).mean()))
"""
TRACK = """
import jumpvision as jv
from jumpvision.films.frames import open_frames
path = jv.track([frame for frame in open_frames("{FOLDER}/rod.avi")][:100], frame_rate=200)
print(float(path.sigma_px.median()), float((path.flag == "").mean()))
"""
DIAGNOSE = """
import numpy as np, jumpvision as jv
t, y, z = np.loadtxt("{FOLDER}/two.csv", delimiter=",", unpack=True)
recordings = [jv.Recording(f"drop {h}", t, x, inputs={"h": h}) for h, x in ((1.0, y), (2.0, z))]
fall = jv.Study(lambda p, r: r.inputs["h"] - p["g"] * r.t**2 / 2, [jv.Parameter("g", 9.81, sigma=0.01)], [])
print(jv.diagnose(recordings, fall).verdict)
"""


@pytest.fixture(scope="module")
def fresh(tmp_path_factory):
    """run(lines) in a new environment with nothing but this package; prints what the lines print."""
    folder = tmp_path_factory.mktemp("fresh")
    venv.create(folder / "venv", with_pip=True)
    python = folder / "venv" / ("Scripts" if sys.platform == "win32" else "bin") / "python"
    install = [python, "-m", "pip", "install", "-q", "--no-compile", str(ROOT)]  # as README does
    done = subprocess.run(install, capture_output=True, text=True)
    if done.returncode:
        pytest.skip(f"pip cannot install here: {done.stderr[-300:]}")
    own = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "NUMBA_CACHE_DIR")}

    def run(lines: str, data: Path) -> list[str]:
        assert len(lines.strip().splitlines()) <= 5
        code = lines.replace("{FOLDER}", data.as_posix())
        out = subprocess.run([python, "-c", code], capture_output=True, text=True, cwd=folder, env=own)
        assert out.returncode == 0, out.stderr
        return out.stdout.split()

    return run


def test_five_lines_measure_vectors_a_track_and_a_diagnosis(fresh, tmp_path):
    """OpenPIV's reference vectors of its pair move by 5 px down in the median. Of two falls through air the simulator
    knows nothing: not adequate."""
    sigma, found = map(float, fresh(TRACK, SAMPLES / "hard_ground"))
    assert 0.0 < sigma < 0.1 and found > 0.95
    rng, t = np.random.default_rng(1), np.arange(0.0, 0.6, 0.005)
    fall = np.log(np.cosh(np.sqrt(9.81 * 0.3) * t)) / 0.3  # m, with drag 0.3 v^2
    noise = 2e-4 * rng.standard_normal((2, t.size))
    np.savetxt(tmp_path / "two.csv", np.column_stack([t, 1.0 - fall + noise[0], 2.0 - fall + noise[1]]), delimiter=",")
    assert fresh(DIAGNOSE, tmp_path) == ["discrepant"]
    pair = Path(pytest.importorskip("openpiv").__file__).parent / "data" / "test1"
    v, measured = map(float, fresh(PIV, pair))
    assert -6.0 < v < -4.0 and measured > 0.8
