#!/usr/bin/env bash
# Guess: `cv2.phaseCorrelate(a, b, window)` reads its pictures; the window is laid over copies of them.
# Seen (opencv-python-headless 4.13.0.92 and 5.0.0.93; opencv-contrib-python 5.1.0.95 no longer): after the call a and b
# are the pictures times the window, if their sides are ones that the Fourier transform likes (128 or 100 px; 127 or 97 are
# copied first), so whoever tries it on another format sees nothing. In a film's loop each frame stands in two pairs: it
# enters the second darkened already, its new neighbour not, and a quarter of its light is left for what is measured
# afterwards. (createHanningWindow is no Hann window either but its square root: after two calls it is one.) A film
# kept as bytes is safe, as its conversion to float is a copy; one kept as float, as after a flat-field correction, is not.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
cat > "$folder/film.py" <<'PY'
import cv2
import numpy as np


def left(side: int) -> tuple[float, float]:
    """Light of the middle one of three frames over what it was, after the pairs (0, 1) and (1, 2), and its largest change."""
    frame = np.random.default_rng(0).uniform(50.0, 200.0, (side, side))
    film = np.array([np.roll(frame, 2 * k, 1) for k in range(3)])
    before = film.copy()
    window = cv2.createHanningWindow((side, side), cv2.CV_64F)
    for k in (0, 1):
        cv2.phaseCorrelate(film[k], film[k + 1], window)
    hann = np.sin(np.pi * np.arange(side) / (side - 1)) ** 2  # along one side
    assert np.abs(window**2 - hann * hann[:, None]).max() < 1e-9
    return film[1].sum() / before[1].sum(), np.abs(film[1] - before[1] * window**2).max()


for side in (128, 100, 127, 97):
    light, off = left(side)
    fast = cv2.getOptimalDFTSize(side) == side
    print(f"OpenCV {cv2.__version__}, {side} px: light left in a frame after two pairs {light:.3f}")
    if fast:
        assert 0.2 < light < 0.3 and off < 1e-9, "the window squared is in the frame"
    else:
        assert light == 1.0
PY
for version in 4.13.0.92 5.0.0.93; do
  python3 -m venv --clear "$folder/venv"
  "$folder/venv/bin/pip" install -q opencv-python-headless==$version numpy
  "$folder/venv/bin/python" "$folder/film.py"
done
