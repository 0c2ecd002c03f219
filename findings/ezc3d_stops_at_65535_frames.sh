#!/usr/bin/env bash
# Guess: what ezc3d writes, ezc3d reads: a library that has handled long C3D files for years gives back 70 000 frames.
# Seen (ezc3d 1.7.2 of August 2026, Linux): of 70 000 frames at 1 kHz it reads 65 535, of their 140 000 force samples
# 131 070, without a word. The file holds all of them (its length says so); the count of frames, 16 bits in this format, is
# written as 65 535 and believed. POINT:FRAMES set to -1 or 70 000 before writing changes nothing. 65 535 frames are 11
# minutes of a motion lab at 100 Hz but one minute at 1 kHz, and what is lost is the end: the jump after a long wait.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q ezc3d==1.7.2 numpy
cat > "$folder/long.py" <<'PY'
import os
import sys

import ezc3d
import numpy as np

FRAMES, PER = 70_000, 2  # force samples a frame


def write(path: str, count: int | None) -> None:
    film = ezc3d.c3d()
    film["parameters"]["POINT"]["RATE"]["value"] = [1000]
    film["parameters"]["POINT"]["LABELS"]["value"] = ("foot",)
    film["parameters"]["ANALOG"]["RATE"]["value"] = [1000 * PER]
    film["parameters"]["ANALOG"]["LABELS"]["value"] = ("Fz",)
    points = np.ones((4, 1, FRAMES))
    points[0, 0] = np.arange(FRAMES)
    film["data"]["points"] = points
    film["data"]["analogs"] = np.arange(FRAMES * PER, dtype=float).reshape(1, 1, -1)
    if count is not None:
        film["parameters"]["POINT"]["FRAMES"]["value"] = [count]
    film.write(path)


path = os.path.join(sys.argv[1], "long.c3d")
for count in (None, -1, FRAMES):
    write(path, count)
    held = os.path.getsize(path) // (4 * 4 + 4 * PER)  # floats: x, y, z, residual; the force
    data = ezc3d.c3d(path)["data"]
    points, forces = data["points"].shape[2], data["analogs"].shape[2]
    print(f"FRAMES {count}: {FRAMES} written, room for {held} in the file; read {points} frames, {forces} forces, last x {data['points'][0, 0, -1]:.0f}")
    assert held >= FRAMES and points == 65535 and forces == PER * 65535
PY
"$folder/venv/bin/python" "$folder/long.py" "$folder"
