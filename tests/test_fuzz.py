"""Damaged files of every kind: a clear error or sound frames; no crash, hang, lost memory. (About 30 s.)"""

from __future__ import annotations

import sys

import fuzz_files
import pytest

CASES = 120  # of each kind
KINDS = [
    "film.npy", "film.h5", "film.seq", "film.cine", "packed.cine", "film.mraw", "film.cihx", "stack.tif", "imagej.tif",
    "image.png", "image.jpg", "image.bmp", "image.pgm", "ffv1.avi", "ffv1.mkv", "h264.mp4", "mjpeg.avi", "raw.avi",
    "vp9.webm", "motor.csv", "motor.tdms", "motor.mat", "motor-v73.mat", "map.npz", "map.npy", "experiment.toml",
]  # fmt: skip


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits time and memory of processes as Linux does")
@pytest.mark.parametrize("name", KINDS)
def test_damaged_files_are_read_or_refused(tmp_path, name):
    if name not in fuzz_files.samples(tmp_path):
        pytest.skip(f"no encoder for {name} here")
    refused, findings = fuzz_files.fuzz(tmp_path, name, 0, CASES)
    assert findings == []
    assert refused > 0  # the damage did reach what matters


def test_the_same_case_is_the_same_damage():
    good = bytes(range(256)) * 9
    assert fuzz_files.damage(good, 7, text=False) == fuzz_files.damage(good, 7, text=False)
    changed = sum(fuzz_files.damage(good, s, text=False) != good for s in range(100))
    assert changed >= 95  # a change may put back what was there
