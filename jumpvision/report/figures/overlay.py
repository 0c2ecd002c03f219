"""The film of the ball with its track drawn in, to check by eye; `[params.overlay] every = 1` shows every frame."""

from __future__ import annotations

import io
from itertools import pairwise
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from jumpvision.base.progress import watch
from jumpvision.inputs.parameters import OverlayParams
from jumpvision.inputs.sections import NotApplicable, RodVideo
from jumpvision.results.tables import Track
from jumpvision.stages.recordings import open_film
from jumpvision.workflow.stage import stage

from .pictures import Picture

SHORT_SIDE = 360  # px at least, by whole factors: small films are enlarged
MOST = 300  # frames shown where nothing else is asked for
RATE = 25  # frames a second when played
TAIL = 100  # frames of path behind the ball
COLOURS = ((60, 220, 60), (60, 160, 255), (255, 120, 200))  # of the balls in turn; BGR
LOST = (60, 60, 255)
SHIFT = 4  # bits of sub-pixel drawing


class TrackFilm(Picture):
    """A VP8 film."""

    file = "track.webm"


@stage(version=2, picture=True)
def overlay(track: Track, film: RodVideo, *, p: OverlayParams) -> TrackFilm:
    """Every p.every-th frame, or MOST evenly, with a cross and path for each ball, or the reason why it was lost."""
    if p.every == 0:
        raise NotApplicable(["overlay.every = 0: no film of the track is asked for"])
    with open_film(film) as frames:
        shown = range(0, len(frames), p.every or -(-len(frames) // MOST))
        white = brightness(frames[len(frames) // 2])
        factor = max(1, round(SHORT_SIDE / min(frames.shape)))
        pictures = (drawn(frames[i], (track.table, *track.others), i, white, factor) for i in shown)
        return TrackFilm(webm(watch(pictures, "frames drawn", len(shown))))


def brightness(image: NDArray[Any]) -> float:
    """Grey that is shown white."""
    return max(1.0, float(np.percentile(image, 99.9)))


def drawn(image: NDArray[Any], tables: Any, i: int, white: float, factor: int) -> NDArray[np.uint8]:
    """Frame i (row, column, BGR), enlarged, with the balls' positions; even sides, as the codec needs."""
    grey = np.clip(np.nan_to_num(image) * (255.0 / white), 0, 255).astype(np.uint8)
    big = cv2.resize(grey, None, fx=factor, fy=factor, interpolation=cv2.INTER_NEAREST)
    out = cv2.cvtColor(big[: big.shape[0] // 2 * 2, : big.shape[1] // 2 * 2], cv2.COLOR_GRAY2BGR)
    for k, table in enumerate(tables):
        colour = COLOURS[k % len(COLOURS)]
        # pixel centres at integers: the centre of pixel 0 lies at (factor - 1)/2 in the enlarged picture
        path = (table[["x_px", "y_px"]].to_numpy(float)[max(0, i - TAIL) : i + 1] + 0.5) * factor - 0.5
        fixed = np.rint(path * 2**SHIFT)
        for a, b in pairwise(fixed):
            if np.isfinite(a).all() and np.isfinite(b).all():
                cv2.line(out, point(a), point(b), colour, 1, cv2.LINE_AA, SHIFT)
        if np.isfinite(fixed[-1]).all():
            for d in ((7, 0), (0, 7)):
                arm = np.array(d) * 2**SHIFT
                cv2.line(out, point(fixed[-1] - arm), point(fixed[-1] + arm), colour, 1, cv2.LINE_AA, SHIFT)
        else:
            text = str(table.flag.iloc[i])
            cv2.putText(out, text, (6, 32 + 14 * k), cv2.FONT_HERSHEY_SIMPLEX, 0.4, LOST, 1, cv2.LINE_AA)
    cv2.putText(out, f"frame {i}", (6, 16), cv2.FONT_HERSHEY_SIMPLEX, 0.4, (255, 255, 255), 1, cv2.LINE_AA)
    return np.asarray(out, dtype=np.uint8)


def point(v: NDArray[np.float64]) -> tuple[int, int]:
    """As OpenCV wants it."""
    return int(v[0]), int(v[1])


def webm(pictures: Any) -> bytes:
    """A film of BGR pictures."""
    import av

    out = io.BytesIO()
    with av.open(out, "w", format="webm", options={"fflags": "+bitexact"}) as container:
        stream: Any = container.add_stream(
            "libvpx", rate=RATE, options={"deadline": "realtime", "cpu-used": "8", "crf": "18", "b": "2M"}
        )
        stream.pix_fmt = "yuv420p"
        for k, image in enumerate(pictures):
            if k == 0:
                stream.height, stream.width = image.shape[:2]
            container.mux(stream.encode(av.VideoFrame.from_ndarray(image, format="bgr24")))
        container.mux(stream.encode())
    return out.getvalue()
