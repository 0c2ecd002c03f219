#!/usr/bin/env bash
# Guess: a grey film that PyAV writes with x264's lossless setting and pix_fmt "gray" comes back grey, bit for bit, as the
# same film written with FFV1 does: both are lossless, and grey has no colour matrix.
# Seen (av 18.1.0 with ffmpeg 8.1.2, imageio 2.38.1, opencv-python-headless 5.0.0.93): FFV1 does; from H.264 the same
# frames arrive named yuv420p, of no stated range, and are taken for studio range: to_ndarray(format="gray"), imageio's
# two plugins and OpenCV alike make 0..16 into 0, 235..255 into 255 and stretch what is between by 255/219. No frame is
# damaged and nothing warns. The stored luma (the first plane) is exact. The grains of a dark field vanish and a light
# level, mass of a particle or sub-pixel peak moves; the sender who checked his FFV1 film sees nothing wrong.
set -euo pipefail
folder=$(mktemp -d)
trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install -q av==18.1.0 imageio==2.38.1 imageio-ffmpeg==0.8.1 opencv-python-headless==5.0.0.93 numpy
cat > "$folder/grey.py" <<'PY'
import os
import sys

import av
import cv2
import imageio.v3
import numpy as np

ROWS, COLUMNS, FRAMES = 48, 256, 4
RAMP = np.tile(np.arange(256, dtype=np.uint8), (ROWS, 1))  # every grey once


def write(path: str, codec: str, options: dict[str, str]) -> None:
    with av.open(path, "w") as film:
        stream = film.add_stream(codec, rate=1000, options=options)
        stream.width, stream.height, stream.pix_fmt = COLUMNS, ROWS, "gray"
        for _ in range(FRAMES):
            film.mux(stream.encode(av.VideoFrame.from_ndarray(RAMP, format="gray")))
        film.mux(stream.encode())


def read(path: str) -> tuple[str, dict[str, np.ndarray]]:
    with av.open(path) as film:
        frame = next(film.decode(video=0))
        plane = frame.planes[0]
        rows = np.frombuffer(plane, np.uint8).reshape(-1, plane.line_size)[:ROWS, :COLUMNS]
        out = {"first plane": rows.copy(), "PyAV gray": frame.to_ndarray(format="gray")}
        name = frame.format.name
    for plugin in ("pyav", "FFMPEG"):
        out["imageio " + plugin] = imageio.v3.imread(path, plugin=plugin)[0][..., 0]
    ok, picture = cv2.VideoCapture(path).read()
    assert ok
    out["OpenCV"] = cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY)
    return name, {key: a[0].astype(int) for key, a in out.items()}


for codec, file, options in (("ffv1", "grey.mkv", {}), ("libx264", "grey.mp4", {"qp": "0"})):
    path = os.path.join(sys.argv[1], file)
    write(path, codec, options)
    name, seen = read(path)
    for key, row in seen.items():
        print(f"{codec:8s} as {name:8s} {key:15s} 4, 16, 40, 128, 235, 250 -> {row[[4, 16, 40, 128, 235, 250]]}")
        exact = codec == "ffv1" or key == "first plane"
        if exact:
            assert (row == np.arange(256)).all()
        else:
            assert row[:17].max() <= 1 and row[235:].min() >= 253 and abs(row[128] - (128 - 16) * 255 / 219) < 2.5
PY
"$folder/venv/bin/python" "$folder/grey.py" "$folder"
